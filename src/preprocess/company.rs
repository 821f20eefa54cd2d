//! Points of surfaces, told from strays by the company that they have.

use crate::median::median;
use crate::spatial::KdTree;

/// Neighbours that tell a point from a stray.
const NEIGHBORS: usize = 4;

/// How far away the farthest of them is of a stray, at least [the same of points that are known to be of a surface].
const ALONE: f64 = 3.0;

/// Points of that surface that are asked.
const ASKED: usize = 1000;

/// How near points must be to others to be of a surface.
pub(super) struct Company {
    tree: KdTree,
    /// Squared distance within which a point of a surface has its neighbours \[length²\].
    reach_sq: f64,
}

impl Company {
    /// As it is among `points` of those with the indices `on` a surface; `None` where there are none.
    pub(super) fn of(points: &[[f64; 3]], on: &[usize]) -> Option<Self> {
        let tree = KdTree::new(points).ok()?;
        let asked = on.iter().step_by(on.len().div_ceil(ASKED).max(1));
        let mut reaches_sq: Vec<f64> = asked.map(|&i| reach_sq(&tree, &points[i], NEIGHBORS + 1)).collect();
        let reach_sq = ALONE * ALONE * median(&mut reaches_sq)?;
        Some(Self { tree, reach_sq })
    }

    /// Whether one of the points has its neighbours.
    pub(super) fn holds(&self, point: &[f64; 3]) -> bool {
        reach_sq(&self.tree, point, NEIGHBORS + 1) <= self.reach_sq
    }

    /// Whether a point that need not be one of them would.
    pub(super) fn would_hold(&self, point: &[f64; 3]) -> bool {
        reach_sq(&self.tree, point, NEIGHBORS) <= self.reach_sq
    }
}

/// Squared distance of the farthest of the `count` points nearest to a place.
fn reach_sq(tree: &KdTree, place: &[f64; 3], count: usize) -> f64 {
    tree.k_nearest(place, count).last().map_or(f64::INFINITY, |farthest| farthest.distance_sq)
}

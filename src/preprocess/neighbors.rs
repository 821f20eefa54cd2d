//! The k nearest neighbours of every point, found once and used by several stages.

use rayon::prelude::*;

use super::check_finite;
use crate::error::{Error, Result};
use crate::spatial::KdTree;

/// Points that [`median_spacing`] looks at.
const SPACING_SAMPLE: usize = 2000;

/// The `k` nearest neighbours of every point, nearest first, ties by index; a point is its own neighbour.
#[derive(Debug, Clone, PartialEq)]
pub struct KNeighbors {
    k: usize,
    indices: Vec<u32>,
    distances_sq: Vec<f64>,
}

impl KNeighbors {
    /// Searches the neighbours of `points` in `tree`; `k` is limited to the size of the tree.
    ///
    /// # Errors
    /// [`Error::InvalidParameter`] when `k` is 0, [`Error::NonFinite`].
    pub fn new(tree: &KdTree, points: &[[f64; 3]], k: usize) -> Result<Self> {
        if k == 0 {
            return Err(Error::InvalidParameter {
                name: "k",
                value: "0".into(),
                expected: "at least 1 neighbour",
            });
        }
        check_finite(points)?;
        let k = k.min(tree.len());
        let mut indices = vec![0; points.len() * k];
        let mut distances_sq = vec![0.0; points.len() * k];
        indices.par_chunks_mut(k).zip(distances_sq.par_chunks_mut(k)).zip(points).with_min_len(256).for_each(
            |((indices, distances_sq), point)| {
                for (slot, found) in tree.k_nearest(point, k).into_iter().enumerate() {
                    indices[slot] = found.index;
                    distances_sq[slot] = found.distance_sq;
                }
            },
        );
        Ok(Self { k, indices, distances_sq })
    }

    /// Neighbours of each point.
    #[must_use]
    pub fn k(&self) -> usize {
        self.k
    }

    /// Number of points.
    #[must_use]
    pub fn len(&self) -> usize {
        self.indices.len() / self.k
    }

    /// Whether there is no point.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.indices.is_empty()
    }

    /// Indices of the neighbours of point `index`, and the squared distances to them [length squared].
    #[must_use]
    pub fn of(&self, index: usize) -> (&[u32], &[f64]) {
        let range = index * self.k..(index + 1) * self.k;
        (&self.indices[range.clone()], &self.distances_sq[range])
    }

    /// Calls `f` with every point, its neighbours and their squared distances, in parallel.
    pub(crate) fn map<T: Send>(&self, f: impl Fn(usize, &[u32], &[f64]) -> T + Sync) -> Vec<T> {
        (0..self.len())
            .into_par_iter()
            .with_min_len(256)
            .map(|i| {
                let (indices, distances_sq) = self.of(i);
                f(i, indices, distances_sq)
            })
            .collect()
    }
}

/// Median distance of a point to its nearest neighbour [length], over up to 2000 points taken at even steps.
///
/// Exact duplicates are not neighbours. 0 when all points coincide.
#[must_use]
pub fn median_spacing(tree: &KdTree, points: &[[f64; 3]]) -> f64 {
    let step = points.len().div_ceil(SPACING_SAMPLE).max(1);
    let mut spacings: Vec<f64> = points
        .par_iter()
        .step_by(step)
        .filter_map(|point| tree.nearest_distinct(point))
        .map(|found| found.distance_sq.sqrt())
        .collect();
    if spacings.is_empty() {
        return 0.0;
    }
    let middle = spacings.len() / 2;
    *spacings.select_nth_unstable_by(middle, f64::total_cmp).1
}

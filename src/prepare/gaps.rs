//! How far apart the lines lie of a sensor that measures line by line, as a profiler does that is moved over the part.

use nalgebra::Vector3;
use rayon::prelude::*;

use crate::directions::tangents;
use crate::median::median;
use crate::spatial::KdTree;

/// Gaps between the lines in which the points of a surface lie.
#[derive(Debug, Clone, Copy)]
pub(super) struct Gaps {
    /// From one line to the next \[length\].
    width: f64,
    /// From one point to the next in a line \[length\].
    along: f64,
}

impl Gaps {
    /// Looks for gaps between `points`, which `tree` holds, and which are `along` apart in a line; `None` where they fill the
    /// surface.
    ///
    /// Places beside the points tell: where these fill the surface, one is near any place on it, however far beside; between lines
    /// the nearest point is the farther away the farther beside a place is, up to half of the gap. The nearest neighbours of a
    /// point lie on its own line and know nothing of the next one.
    pub(super) fn between(
        points: &[[f64; 3]],
        normals: &[[f64; 3]],
        tree: &KdTree,
        along: f64,
    ) -> Option<Self> {
        /// Width of a gap from which on points lie in lines [distance of the points in a line]: in 216 scans by cameras it is
        /// measured as below 3.8, and as below 5.7 where points lie on a surface at random.
        const LEAST: f64 = 6.0;
        /// Points beside which places are looked at.
        const LOOKED_AT: usize = 1000;
        /// How far beside, at first, and how often twice as far \[distance of the points in a line\].
        const BESIDE: f64 = 4.0;
        const LOOKS: u32 = 4;
        /// Median distance to the nearest point at which the gap may be wider [distance of the places]: 0.7 beside a single line.
        const WIDER: f64 = 0.4;
        let step = points.len().div_ceil(LOOKED_AT).max(1);
        let looked_at: Vec<usize> = (0..points.len()).step_by(step).collect();
        let distance_beside = |(place, &i): (usize, &usize), away: f64| {
            // The golden angle spreads the directions evenly.
            let (sin, cos) = (2.399_963 * place as f64).sin_cos();
            let [u, v] = tangents(&normals[i].into());
            let beside = Vector3::from(points[i]) + (u * cos + v * sin) * away;
            tree.nearest(&beside.into()).distance_sq.sqrt()
        };
        let mut width = 0.0;
        for look in 0..LOOKS {
            let away = BESIDE * along * f64::from(1_u32 << look);
            let places = looked_at.par_iter().enumerate();
            let mut distances: Vec<f64> = places.map(|place| distance_beside(place, away)).collect();
            let typical = median(&mut distances).unwrap_or(0.0);
            // It is even between 0 and half of the gap.
            width = 4.0 * typical;
            if typical <= WIDER * away {
                break;
            }
        }
        (width > LEAST * along).then_some(Self { width, along })
    }

    /// Whether they are narrow enough to show a part between them, unlike those between the corners of a mesh.
    pub(super) fn are_narrow(self, diameter: f64) -> bool {
        /// Width of a gap, at most [diameters].
        const MOST: f64 = 0.1;
        self.width < MOST * diameter
    }

    /// Neighbours of a point on its own line and on the two next to it.
    pub(super) fn neighbors_across(self) -> usize {
        /// How far they reach \[gaps\].
        const REACH: f64 = 1.2;
        /// More would not be local.
        const MOST: f64 = 150.0;
        let area_of_point = self.width * self.along;
        let area = std::f64::consts::PI * (REACH * self.width).powi(2);
        (area / area_of_point).min(MOST).ceil() as usize
    }

    /// Spacing of points that leave no place without a match: half a gap is twice as far, about what a match may be away where an
    /// order is found (1.9 spacings).
    pub(super) fn spacing(self) -> f64 {
        self.width / 4.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Result;

    /// The gaps between points 1 apart in lines `width` apart, on a square of 120 x 120.
    fn gaps(width: usize) -> Result<Option<Gaps>> {
        let lines = (0..120).step_by(width);
        let points: Vec<[f64; 3]> =
            lines.flat_map(|x| (0..120).map(move |y| [x, y, 0].map(f64::from))).collect();
        let normals = vec![[0.0, 0.0, 1.0]; points.len()];
        Ok(Gaps::between(&points, &normals, &KdTree::new(&points)?, 1.0))
    }

    #[test]
    fn points_in_lines_leave_gaps() -> Result<()> {
        for width in [1, 2, 3] {
            assert!(gaps(width)?.is_none(), "{width}: {:?}", gaps(width)?);
        }
        for width in [8, 12, 20] {
            let found = gaps(width)?.map_or(0.0, |gaps| gaps.width / width as f64);
            assert!((0.7..1.4).contains(&found), "{width}: {found}");
        }
        Ok(())
    }
}

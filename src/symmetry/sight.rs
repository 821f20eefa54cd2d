//! What is known of the space about one axis: free space, and the sector of which nothing was measured.

use std::f64::consts::TAU;

use nalgebra::{Vector2, Vector3};

use crate::symmetry::axis::Axis;
use crate::symmetry::surface::Surface;
use crate::symmetry::visibility::{Seen, Visibility};

/// What the cameras say about places near an axis.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sight<'a> {
    visibility: Option<&'a Visibility>,
    unseen: Option<Sector>,
}

impl<'a> From<Option<&'a Visibility>> for Sight<'a> {
    fn from(visibility: Option<&'a Visibility>) -> Self {
        Self { visibility, unseen: None }
    }
}

impl<'a> Sight<'a> {
    /// Looks for a sector about `axis` of which nothing was measured: there, no return says nothing.
    #[must_use]
    pub(crate) fn about(axis: &Axis, surface: &Surface, visibility: Option<&'a Visibility>) -> Self {
        // One view leaves so much unseen that an empty sector means nothing.
        let several = visibility.filter(|v| v.views() > 1);
        Self { visibility, unseen: several.and_then(|_| Sector::unseen(surface, axis)) }
    }

    /// Whether viewpoints are known.
    #[must_use]
    pub(crate) fn is_known(&self) -> bool {
        self.visibility.is_some()
    }

    /// Whether a missing return tells a gap in the part.
    #[must_use]
    pub(crate) fn tells_gaps(&self) -> bool {
        self.visibility.is_some_and(|visibility| !visibility.is_patchy)
    }

    /// Width of the sector of which nothing was measured \[rad\].
    #[must_use]
    pub(crate) fn unseen(&self) -> Option<f64> {
        self.unseen.map(|sector| sector.width)
    }

    /// [`Visibility::seen`], but a ray through the sector of which nothing was measured may have met something there, and
    /// its return have been lost with the rest; without viewpoints any place counts as free.
    #[must_use]
    #[inline]
    pub(crate) fn seen(&self, point: &Vector3<f64>, normal: &Vector3<f64>, margin: f64) -> Seen {
        let is_barred = |camera: &Vector3<f64>| self.unseen.is_some_and(|sector| sector.meets(camera, point));
        self.visibility.map_or(Seen::Free, |v| v.seen(point, Some(normal), margin, is_barred))
    }
}

/// A sector about an axis.
#[derive(Debug, Clone, Copy)]
struct Sector {
    axis: Axis,
    tangents: [Vector3<f64>; 2],
    /// Inward normals of its two edges, in the plane of the tangents of the axis; from angles they would be made again for
    /// every place.
    edges: [Vector2<f64>; 2],
    /// Below π, so that the sector is convex \[rad\].
    width: f64,
    /// Largest distance of a point from the axis \[length\].
    rim: f64,
}

impl Sector {
    /// The sector from the angle `start`, from the first tangent of the axis, on \[rad\].
    fn new(axis: &Axis, start: f64, width: f64, rim: f64) -> Self {
        let edge = |angle: f64| Vector2::new(-angle.sin(), angle.cos());
        Self {
            axis: *axis,
            tangents: axis.tangents(),
            edges: [edge(start), -edge(start + width)],
            width,
            rim,
        }
    }

    /// The one sector in which no camera measured anything, where it is wider than the gaps of the part itself, which
    /// come at every fraction of a turn.
    fn unseen(surface: &Surface, axis: &Axis) -> Option<Self> {
        const BINS: usize = 120;
        /// Bins of the narrowest and the widest one: a wider one is the side of the part that no camera faced.
        const WIDTH: [usize; 2] = [12, 42];
        /// Bins by which it is wider than the next.
        const WIDER: usize = 12;
        /// Points nearer to the axis than this say little about their angle [largest distance].
        const NEAR: f64 = 0.1;
        /// More points than this do not fill more bins.
        const LOOKED_AT: usize = 5000;
        let points = &surface.samples.points;
        let step = points.len().div_ceil(LOOKED_AT).max(1);
        let tangents = axis.tangents();
        let place = |p: &Vector3<f64>| {
            let [x, y] = tangents.map(|tangent| tangent.dot(&(p - axis.point)));
            ((x * x + y * y).sqrt(), y.atan2(x).rem_euclid(TAU))
        };
        let places: Vec<(f64, f64)> = points.iter().step_by(step).map(place).collect();
        let rim = places.iter().map(|place| place.0).fold(0.0, f64::max);
        let mut counts = [0_usize; BINS];
        for (_, angle) in places.into_iter().filter(|(radius, _)| *radius > NEAR * rim) {
            counts[((angle / TAU * BINS as f64) as usize).min(BINS - 1)] += 1;
        }
        let first = counts.iter().position(|&count| count > 0)?;
        // Runs of empty bins, from a bin that is not.
        let (mut runs, mut length) = (Vec::new(), 0);
        for bin in first..=first + BINS {
            if counts[bin % BINS] == 0 {
                length += 1;
            } else if length > 0 {
                runs.push((length, bin - length));
                length = 0;
            }
        }
        runs.sort_unstable_by(|a, b| b.cmp(a));
        let &(widest, start) = runs.first()?;
        let next = runs.get(1).map_or(0, |run| run.0);
        let alone = (WIDTH[0]..=WIDTH[1]).contains(&widest) && widest >= next + WIDER;
        let bin = TAU / BINS as f64;
        // The bins on either side are empty in part.
        let (start, width) = ((start as f64 - 1.0) * bin, (widest + 2) as f64 * bin);
        alone.then(|| Self::new(axis, start, width, rim))
    }

    /// Whether the straight way from one point to another leads through the sector.
    fn meets(&self, from: &Vector3<f64>, to: &Vector3<f64>) -> bool {
        let flat = |p: &Vector3<f64>| Vector2::from(self.tangents.map(|t| t.dot(&(p - self.axis.point))));
        let (begin, way) = (flat(from), flat(to) - flat(from));
        // The share of the way on the inner side of both edges.
        let (mut first, mut last) = (0.0_f64, 1.0_f64);
        for normal in &self.edges {
            let (height, rise) = (normal.dot(&begin), normal.dot(&way));
            if rise > 0.0 {
                first = first.max(-height / rise);
            } else if rise < 0.0 {
                last = last.min(-height / rise);
            } else if height < 0.0 {
                return false;
            }
        }
        let nearest = if way == Vector2::zeros() { 0.0 } else { -begin.dot(&way) / way.norm_squared() };
        first <= last && (begin + way * nearest.clamp(first, last)).norm() <= self.rim
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use super::*;

    #[test]
    fn a_way_meets_a_sector_between_its_edges_and_within_its_rim() {
        let axis = Axis { direction: Vector3::z_axis(), point: Vector3::new(5.0, 5.0, 0.0) };
        let [u, v] = axis.tangents();
        let at = |[x, y]: [f64; 2]| axis.point + u * x + v * y + Vector3::z();
        // The quarter where both coordinates are positive, out to a distance of 1.
        let sector = Sector::new(&axis, 0.0, FRAC_PI_2, 1.0);
        let meets = |from, to| sector.meets(&at(from), &at(to)) && sector.meets(&at(to), &at(from));
        assert!(meets([3.0, 3.0], [-0.5, -0.5]));
        assert!(meets([1.2, -0.6], [-0.6, 1.2]));
        assert!(meets([0.1, 3.0], [0.1, 0.5]));
        let misses = |from, to| !sector.meets(&at(from), &at(to)) && !sector.meets(&at(to), &at(from));
        // On the other side, past one edge, past the other, along both, and beyond the rim.
        assert!(misses([-3.0, -3.0], [-0.5, -0.5]));
        assert!(misses([3.0, -0.1], [0.5, -0.1]));
        assert!(misses([-0.1, 3.0], [-0.1, 0.5]));
        assert!(misses([-1.0, 0.5], [0.5, -1.0]));
        assert!(misses([3.0, 3.0], [1.0, 1.0]));
        assert!(misses([3.0, -1.0], [-1.0, 3.0]));
    }
}

//! The surface in rings about an axis: what any rotation maps to itself as a whole.

use std::collections::HashSet;

use nalgebra::Vector3;
use rayon::prelude::*;

use crate::symmetry::axis::Axis;
use crate::symmetry::surface::Samples;

/// Size of a ring in radius and height [largest radius].
const SIZE: f64 = 0.04;

/// Radius and height of a ring in steps of its size.
pub(crate) type Ring = (i32, i32);

/// Rings about an axis.
pub(crate) struct Rings {
    axis: Axis,
    /// Width and height of a ring \[length\].
    size: f64,
}

impl Rings {
    /// Rings of a size that suits the farthest of some points.
    pub(crate) fn about(axis: &Axis, samples: &Samples) -> Self {
        let largest = samples.points.iter().map(|p| axis.distance(p)).fold(f64::MIN_POSITIVE, f64::max);
        Self { axis: *axis, size: SIZE * largest }
    }

    /// The ring of a point.
    pub(crate) fn of(&self, point: &Vector3<f64>) -> Ring {
        let height = self.axis.direction.dot(&(point - self.axis.point));
        ((self.axis.distance(point) / self.size) as i32, (height / self.size).floor() as i32)
    }

    /// At most `count` of some points in some rings.
    pub(crate) fn within(&self, rings: &HashSet<Ring>, samples: &Samples, count: usize) -> Samples {
        let Samples { points, normals } = samples;
        let inside: Vec<usize> =
            (0..points.len()).into_par_iter().filter(|&i| rings.contains(&self.of(&points[i]))).collect();
        let chosen = Samples {
            points: inside.iter().map(|&i| points[i]).collect(),
            normals: inside.iter().map(|&i| normals[i]).collect(),
        };
        chosen.strided(count)
    }
}

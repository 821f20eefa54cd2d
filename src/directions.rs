//! Directions in space: two across a third, and many that leave no side out.

use nalgebra::Vector3;

/// The golden angle \[rad\]: no small multiple of it comes near a full turn, nor near a fraction of one.
pub(crate) const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;

/// Two unit vectors that span the plane normal to the unit vector `direction`; right-handed with it.
pub(crate) fn tangents(direction: &Vector3<f64>) -> [Vector3<f64>; 2] {
    let least = Vector3::ith(direction.iamin(), 1.0);
    let u = direction.cross(&least).normalize();
    [u, direction.cross(&u)]
}

/// Unit vectors at these heights along z, each the golden angle farther about it than the one before: spread evenly over the
/// sphere where the heights are evenly spaced (Fibonacci lattice).
pub(crate) fn spiral(heights: impl Iterator<Item = f64>) -> impl Iterator<Item = Vector3<f64>> {
    heights.enumerate().map(|(i, z)| {
        let radius = (1.0 - z * z).sqrt();
        let (sin, cos) = (GOLDEN_ANGLE * i as f64).sin_cos();
        Vector3::new(radius * cos, radius * sin, z)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tangents_span_the_plane_across() {
        for direction in spiral([-0.9, -0.3, 0.0, 0.4, 1.0].into_iter()) {
            let [u, v] = tangents(&direction);
            assert!((u.cross(&v) - direction).norm() < 1e-15);
        }
    }

    #[test]
    fn a_spiral_leaves_no_side_out() {
        const COUNT: usize = 500;
        let heights = (0..COUNT).map(|i| (2.0 * i as f64 + 1.0) / COUNT as f64 - 1.0);
        let directions: Vec<Vector3<f64>> = spiral(heights).collect();
        // A cap of this radius has twelve of them on average.
        let radius = (4.0 * 12.0 / COUNT as f64).sqrt();
        for toward in spiral((0..40).map(|i| (2.0 * i as f64 + 1.0) / 40.0 - 1.0)) {
            let within = directions.iter().filter(|d| d.angle(&toward) < radius).count();
            assert!((8..=16).contains(&within), "{within} near {toward}");
        }
    }
}

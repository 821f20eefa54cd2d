//! The axis of a surface of revolution from its normals, all of which meet it.

use nalgebra::{Matrix3, SymmetricEigen, Vector3};

use crate::symmetry::axis::Axis;
use crate::symmetry::surface::Surface;

/// The line that the normals of a surface of revolution all meet: the linear complex of lines that fits them best
/// (Pottmann and Randrup, "Rotational and helical surface approximation for reverse engineering", Computing 60, 1998),
/// reweighted so that features that are not round do not pull it aside. `None` where it is not determined.
#[must_use]
pub(crate) fn axis_of_revolution(surface: &Surface) -> Option<Axis> {
    /// Points whose normals are asked.
    const ASKED: usize = 2000;
    /// Rounds of reweighting.
    const ROUNDS: usize = 8;
    /// Distance by which a normal misses the line at which its weight is a half [typical distance of the points].
    const MISS: f64 = 0.03;
    let samples = surface.samples.strided(ASKED);
    let middle = samples.points.iter().sum::<Vector3<f64>>() / samples.points.len() as f64;
    let lines: Vec<(Vector3<f64>, Vector3<f64>)> =
        samples.points.iter().zip(&samples.normals).map(|(p, n)| (n.cross(&(p - middle)), *n)).collect();
    let size_sq =
        samples.points.iter().map(|p| (p - middle).norm_squared()).sum::<f64>() / lines.len() as f64;
    let mut weights = vec![1.0; lines.len()];
    let mut found = None;
    for _ in 0..ROUNDS {
        let [mut moments, mut mixed, mut directions] = [Matrix3::zeros(); 3];
        for ((moment, normal), weight) in lines.iter().zip(&weights) {
            moments += moment * (moment * *weight).transpose();
            mixed += moment * (normal * *weight).transpose();
            directions += normal * (normal * *weight).transpose();
        }
        // A normal meets the line along d through c where moment . d + normal . (d x c) = 0.
        let elimination = -directions.try_inverse()? * mixed.transpose();
        let eigen = SymmetricEigen::try_new(moments + mixed * elimination, f64::EPSILON, 100)?;
        let direction: Vector3<f64> = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into();
        let moment_of_line = elimination * direction;
        found = Axis::new(direction, middle + moment_of_line.cross(&direction));
        for (weight, (moment, normal)) in weights.iter_mut().zip(&lines) {
            let miss = moment.dot(&direction) + normal.dot(&moment_of_line);
            *weight = 1.0 / (1.0 + miss * miss / (MISS * MISS * size_sq));
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use nalgebra::{Rotation3, Unit};

    use super::*;
    use crate::directions::GOLDEN_ANGLE;
    use crate::symmetry::surface::Samples;

    /// A ball on a stem about the z axis, and as many points again as `bumps` says that face anywhere.
    fn ball_on_a_stem(bumps: usize) -> Samples {
        let mut samples = Samples { points: Vec::new(), normals: Vec::new() };
        for i in 0..1500 {
            let angle = GOLDEN_ANGLE * i as f64;
            let around = Vector3::new(angle.cos(), angle.sin(), 0.0);
            let share = i as f64 / 1500.0;
            let facing = around * (1.0 - share * share).sqrt() + Vector3::z() * share;
            let (point, normal) = if i % 4 == 0 {
                (around * 0.1 - Vector3::z() * share, around)
            } else {
                (facing * 0.3, facing)
            };
            samples.points.push(point);
            samples.normals.push(normal);
            if i < bumps {
                samples.points.push(point);
                samples.normals.push(Rotation3::new(facing.yzx() * 2.0) * normal);
            }
        }
        samples
    }

    fn found_in(samples: Samples) -> Option<Axis> {
        axis_of_revolution(&Surface::new(samples, true, 0.01, 0.05))
    }

    #[test]
    fn all_normals_meet_the_axis() -> Result<(), &'static str> {
        let turn = Rotation3::new(Vector3::new(0.4, -1.1, 0.3));
        let shift = Vector3::new(3.0, -2.0, 5.0);
        for bumps in [0, 150] {
            let mut samples = ball_on_a_stem(bumps);
            samples.points.iter_mut().for_each(|p| *p = turn * *p + shift);
            samples.normals.iter_mut().for_each(|n| *n = turn * *n);
            let found = found_in(samples).ok_or("no axis")?;
            let truth = Axis { direction: Unit::new_normalize(turn * Vector3::z()), point: shift };
            let limit = if bumps == 0 { 1e-6 } else { 0.01 };
            assert!(found.angle_to(&truth) < limit, "{}", found.angle_to(&truth));
            assert!(found.distance(&shift) < limit, "{}", found.distance(&shift));
        }
        Ok(())
    }

    #[test]
    fn normals_of_a_plane_say_nothing() {
        let points = (0..200).map(|i| Vector3::new(f64::from(i % 20), f64::from(i / 20), 0.0)).collect();
        assert!(found_in(Samples { points, normals: vec![Vector3::z(); 200] }).is_none());
    }
}

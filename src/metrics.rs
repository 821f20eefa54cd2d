//! Pose errors as the field measures them.

use nalgebra::{Isometry3, Point3};
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::frames::check_pose;
use crate::preprocess::check_finite;
use crate::spatial::KdTree;
use crate::symmetry::axis::Axis;

/// ADD-S: mean distance from each estimated point to the nearest true one \[length\].
///
/// `points` are in the object frame, poses are `world_from_object`. Reference: Xiang et al., PoseCNN (2018); equation
/// (8) of Dai et al. (arXiv 2606.16593).
///
/// ```
/// use sympose::metrics::adds;
/// use sympose::nalgebra::Isometry3;
/// // Two points that a half turn about z exchanges: which of both is which does not count.
/// let points = [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]];
/// let turned = Isometry3::rotation([0.0, 0.0, std::f64::consts::PI].into());
/// assert!(adds(&points, &turned, &Isometry3::identity())? < 1e-12);
/// assert_eq!(adds(&points, &Isometry3::translation(0.0, 0.0, 0.1), &Isometry3::identity())?, 0.1);
/// # Ok::<(), sympose::Error>(())
/// ```
///
/// # Errors
/// Those of [`KdTree::new`] for the points; [`Error::InvalidParameter`] for a pose that is not finite.
pub fn adds(points: &[[f64; 3]], estimated: &Isometry3<f64>, truth: &Isometry3<f64>) -> Result<f64> {
    check_pose("estimated", estimated)?;
    check_pose("truth", truth)?;
    let tree = KdTree::new(points)?;
    let truth_from_estimated = truth.inverse() * estimated;
    let parts: Vec<f64> = points
        .par_chunks(1024)
        .map(|chunk| {
            chunk
                .iter()
                .map(|p| {
                    let moved = truth_from_estimated * Point3::from(*p);
                    tree.nearest(&moved.coords.into()).distance_sq.sqrt()
                })
                .sum()
        })
        .collect();
    Ok(parts.iter().sum::<f64>() / points.len() as f64)
}

/// MSSD: the largest distance between estimated and true points, minimised over the symmetries of the part \[length\].
///
/// `symmetries` are motions in the object frame that leave the part unchanged; the identity is always among them.
/// Reference: Hodan et al., BOP Challenge 2020.
///
/// ```
/// use sympose::metrics::mssd;
/// use sympose::nalgebra::Isometry3;
/// let points = [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]];
/// let turned = Isometry3::rotation([0.0, 0.0, std::f64::consts::PI].into());
/// assert_eq!(mssd(&points, &turned, &Isometry3::identity(), &[])?, 2.0);
/// assert!(mssd(&points, &turned, &Isometry3::identity(), &[turned])? < 1e-12);
/// # Ok::<(), sympose::Error>(())
/// ```
///
/// # Errors
/// [`Error::InsufficientData`] without points, [`Error::NonFinite`] for points and [`Error::InvalidParameter`] for poses or
/// symmetries that are not finite.
pub fn mssd(
    points: &[[f64; 3]],
    estimated: &Isometry3<f64>,
    truth: &Isometry3<f64>,
    symmetries: &[Isometry3<f64>],
) -> Result<f64> {
    if points.is_empty() {
        return Err(Error::InsufficientData {
            stage: "MSSD",
            needed: 1,
            got: 0,
            hint: "give points of the surface",
        });
    }
    check_finite(points)?;
    check_pose("estimated", estimated)?;
    check_pose("truth", truth)?;
    symmetries.iter().try_for_each(|symmetry| check_pose("symmetries", symmetry))?;
    let largest = |symmetry: &Isometry3<f64>| {
        let target = truth * symmetry;
        points
            .iter()
            .map(|p| (estimated * Point3::from(*p) - target * Point3::from(*p)).norm_squared())
            .fold(0.0, f64::max)
    };
    let identity = [Isometry3::identity()];
    let best = identity.iter().chain(symmetries).map(largest).fold(f64::INFINITY, f64::min);
    Ok(best.sqrt())
}

/// Angle between two axes, sign ignored [rad, at most pi/2].
#[must_use]
pub fn axis_angle(estimated: &Axis, truth: &Axis) -> f64 {
    estimated.angle_to(truth)
}

/// Distance of the true centre from the estimated axis line \[length\].
#[must_use]
pub fn axis_offset(estimated: &Axis, true_center: &[f64; 3]) -> f64 {
    estimated.distance(&(*true_center).into())
}

//! Poses and planes in their frames: the frame that turns with a cloud, from an axis to a pose, from the local frame to the
//! world.

use nalgebra::{Isometry3, Matrix3, Rotation3, SymmetricEigen, UnitQuaternion, Vector3};
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::preprocess::CHUNK;
use crate::symmetry::axis::Axis;
use crate::symmetry::order::Order;

/// The pose on `axis`, and its heading \[rad\]; of the equivalent ones the one nearest in rotation to `preferred`, if there
/// is one.
pub(crate) fn place(
    axis: &Axis,
    height: f64,
    heading: f64,
    order: Order,
    preferred: Option<Isometry3<f64>>,
) -> (Isometry3<f64>, f64) {
    let pose = |angle: f64| {
        let about_axis = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle);
        axis.frame() * Isometry3::from_parts(Vector3::new(0.0, 0.0, height).into(), about_axis)
    };
    let Some(preferred) = preferred else { return (pose(heading), heading) };
    let nearest = heading + nearest_turn(&pose(heading).rotation, &preferred.rotation, order);
    (pose(nearest), nearest)
}

/// The turn about z, one of the `order`, after which `rotation` comes nearest to the one that is `wanted` \[rad\].
pub(crate) fn nearest_turn(
    rotation: &UnitQuaternion<f64>,
    wanted: &UnitQuaternion<f64>,
    order: Order,
) -> f64 {
    let [x, y] = [wanted * Vector3::x(), wanted * Vector3::y()];
    let axes = [rotation * Vector3::x(), rotation * Vector3::y()];
    // The trace of wanted' rotation turn(a) is greatest at this angle.
    let best = (axes[1].dot(&x) - axes[0].dot(&y)).atan2(axes[0].dot(&x) + axes[1].dot(&y));
    match order {
        Order::Cyclic(n) => {
            let sector = std::f64::consts::TAU / f64::from(n);
            (best / sector).round() * sector
        }
        _ => best,
    }
}

/// Refuses a pose with a NaN or infinite number; `name` is the parameter that it came from.
pub(crate) fn check_pose(name: &'static str, pose: &Isometry3<f64>) -> Result<()> {
    let Isometry3 { rotation, translation } = pose;
    if rotation.coords.iter().chain(translation.vector.iter()).all(|x| x.is_finite()) {
        return Ok(());
    }
    let value = format!("{:?}, quaternion {:?}", translation.vector.as_slice(), rotation.coords.as_slice());
    Err(Error::InvalidParameter { name, value, expected: "a pose of finite numbers" })
}

/// Height above the point of the axis at which it meets a plane; `None` when it runs along the plane.
pub(crate) fn height_over(axis: &Axis, [x, y, z, d]: [f64; 4]) -> Option<f64> {
    let normal = Vector3::new(x, y, z);
    let cosine = normal.dot(&axis.direction);
    (cosine.abs() > 0.1).then(|| -(normal.dot(&axis.point) + d) / cosine)
}

pub(crate) fn plane_in_world([x, y, z, d]: [f64; 4], world_from_local: &Isometry3<f64>) -> [f64; 4] {
    let normal = world_from_local * Vector3::new(x, y, z);
    [normal.x, normal.y, normal.z, d - normal.dot(&world_from_local.translation.vector)]
}

/// Centroid and principal axes; the sign of each axis follows the third moment, so that the frame turns with the data.
pub(crate) fn principal_frame(points: &[[f64; 3]]) -> Result<Isometry3<f64>> {
    let count = points.len() as f64;
    let centroid = sum_over(points, |p| p).map(|sum| sum / count);
    let off = |p: [f64; 3]| [p[0] - centroid[0], p[1] - centroid[1], p[2] - centroid[2]];
    let [xx, xy, xz, yy, yz, zz] = sum_over(points, |p| {
        let [x, y, z] = off(p);
        [x * x, x * y, x * z, y * y, y * z, z * z]
    });
    let covariance = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz) / count;
    let centroid = Vector3::from(centroid);
    let eigen = SymmetricEigen::try_new(covariance, f64::EPSILON, 100)
        .ok_or(Error::Degenerate { shape: "too ill-conditioned for principal axes" })?;
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    let [largest, middle] = [eigen.eigenvalues[order[0]], eigen.eigenvalues[order[1]]];
    // What is left of identical points are the rounding errors of where they are.
    if largest <= (1e-12 * centroid.amax()).powi(2) {
        return Err(Error::Degenerate { shape: "identical" });
    }
    if middle <= 1e-12 * largest {
        return Err(Error::Degenerate { shape: "collinear" });
    }
    let axes: [Vector3<f64>; 2] = [0, 1].map(|i| eigen.eigenvectors.column(order[i]).into());
    let skews = sum_over(points, |p| axes.map(|axis| axis.dot(&Vector3::from(off(p))).powi(3)));
    let [x, y]: [Vector3<f64>; 2] = std::array::from_fn(|i| if skews[i] < 0.0 { -axes[i] } else { axes[i] });
    let rotation = Rotation3::from_basis_unchecked(&[x, y, x.cross(&y)]);
    Ok(Isometry3::from_parts(centroid.into(), rotation.into()))
}

/// Sums of `N` numbers for each point, in an order that does not depend on the number of threads.
fn sum_over<const N: usize>(points: &[[f64; 3]], terms: impl Fn([f64; 3]) -> [f64; N] + Sync) -> [f64; N] {
    let add = |sums: [f64; N], terms: [f64; N]| std::array::from_fn(|i| sums[i] + terms[i]);
    let chunk = |chunk: &[[f64; 3]]| chunk.iter().fold([0.0; N], |sums, p| add(sums, terms(*p)));
    points.par_chunks(CHUNK).map(chunk).collect::<Vec<_>>().into_iter().fold([0.0; N], add)
}

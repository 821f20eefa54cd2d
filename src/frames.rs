//! Poses and planes in their frames: from an axis to a pose, from the local frame to the world.

use nalgebra::{Isometry3, UnitQuaternion, Vector3};

use crate::symmetry::axis::Axis;
use crate::symmetry::complete::axis_frame;
use crate::symmetry::order::Order;

/// The pose on `axis`; of the equivalent ones the one nearest in rotation to `preferred`, if there is one.
pub(crate) fn place(
    axis: &Axis,
    height: f64,
    heading: f64,
    order: Order,
    preferred: Option<Isometry3<f64>>,
) -> Isometry3<f64> {
    let pose = |angle: f64| {
        let about_axis = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle);
        axis_frame(axis) * Isometry3::from_parts(Vector3::new(0.0, 0.0, height).into(), about_axis)
    };
    let Some(preferred) = preferred else { return pose(heading) };
    let (steps, start) = match order {
        Order::Cyclic(n) => (n, heading),
        _ => {
            // Any angle will do: turn +x as near to the preferred +x as it gets.
            let x = axis_frame(axis).inverse() * (preferred * Vector3::x());
            (1, x.y.atan2(x.x))
        }
    };
    let angles = (0..steps).map(|k| start + std::f64::consts::TAU * f64::from(k) / f64::from(steps));
    let away = |angle: &f64| pose(*angle).rotation.angle_to(&preferred.rotation);
    pose(angles.min_by(|a, b| away(a).total_cmp(&away(b))).unwrap_or(heading))
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

//! The symmetry axis as a line: four parameters, not six.

use nalgebra::{Isometry3, Matrix3, Rotation3, Unit, UnitVector3, Vector3, Vector4};

use crate::directions::tangents;

/// What noise turns normals out of the planes through the axis [sine of the angle].
pub(crate) const ASIDE: f64 = 0.3;

/// A line in space: where the rotations of a symmetry take place.
///
/// Rotation about the line and sliding along it change nothing, so a step has four parameters: two tilt the direction
/// and two shift the point, all in the plane normal to the axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Axis {
    /// Unit direction.
    pub direction: UnitVector3<f64>,
    /// A point on the line, kept near the centroid of the cloud so that tilt and shift stay well scaled.
    pub point: Vector3<f64>,
}

impl Axis {
    /// A line through `point`; `None` when `direction` has no length.
    #[must_use]
    pub fn new(direction: Vector3<f64>, point: Vector3<f64>) -> Option<Self> {
        Unit::try_new(direction, 1e-12).map(|direction| Self { direction, point })
    }

    /// Two unit vectors that span the plane normal to the axis; right-handed with the direction.
    #[must_use]
    pub fn tangents(&self) -> [Vector3<f64>; 2] {
        tangents(&self.direction)
    }

    /// Frame with +z along the line and the origin at its point: +x and +y are the tangents.
    #[must_use]
    pub fn frame(&self) -> Isometry3<f64> {
        let [x, y] = self.tangents();
        let rotation = Rotation3::from_basis_unchecked(&[x, y, self.direction.into_inner()]);
        Isometry3::from_parts(self.point.into(), rotation.into())
    }

    /// Applies a step: tilt about both tangents \[rad\], then shift along both \[length\].
    #[must_use]
    pub fn retract(&self, step: &Vector4<f64>) -> Self {
        let [u, v] = self.tangents();
        let tilt = Rotation3::new(u * step[0] + v * step[1]);
        Self {
            direction: Unit::new_normalize(tilt * self.direction.into_inner()),
            point: self.point + u * step[2] + v * step[3],
        }
    }

    /// The step that leads to a line nearby: [`Axis::retract`] takes it there, but for terms of second order.
    #[must_use]
    pub fn step_to(&self, other: &Self) -> Vector4<f64> {
        let [u, v] = self.tangents();
        let turned = other.direction.into_inner() - self.direction.into_inner();
        let shifted = other.project(&self.point) - self.point;
        // A tilt about u moves the direction along -v, one about v along u.
        Vector4::new(-v.dot(&turned), u.dot(&turned), u.dot(&shifted), v.dot(&shifted))
    }

    /// The same line, held by its point nearest to `center`.
    #[must_use]
    pub fn recentered(&self, center: &Vector3<f64>) -> Self {
        Self { direction: self.direction, point: self.project(center) }
    }

    /// The line with its last digits dropped: held near `center`, on a lattice with steps of a part in `steps`, of a radian
    /// or of `radius` \[length\].
    #[must_use]
    pub fn rounded(&self, center: &Vector3<f64>, radius: f64, steps: f64) -> Self {
        let direction = self.direction.map(|x| (x * steps).round() / steps);
        let foot = (self.project(center) - center).map(|x| (x / radius * steps).round() / steps * radius);
        Self { direction: Unit::new_normalize(direction), point: center + foot }
    }

    /// The point of the line nearest to `p`.
    #[must_use]
    pub fn project(&self, p: &Vector3<f64>) -> Vector3<f64> {
        let a = self.direction.into_inner();
        self.point + a * a.dot(&(p - self.point))
    }

    /// Distance of `p` from the line.
    #[must_use]
    pub fn distance(&self, p: &Vector3<f64>) -> f64 {
        (p - self.project(p)).norm()
    }

    /// How far a unit `normal` at `p` stands out of the plane through the line: its component in the direction in which `p` moves
    /// when it is turned, 0 on the line.
    #[must_use]
    pub fn around(&self, p: &Vector3<f64>, normal: &Vector3<f64>) -> f64 {
        let moves = self.direction.cross(&(p - self.point));
        moves.try_normalize(0.0).map_or(0.0, |moves| moves.dot(normal))
    }

    /// Angle between two undirected lines, in [0, pi/2] radians.
    #[must_use]
    pub fn angle_to(&self, other: &Self) -> f64 {
        let (a, b) = (self.direction.into_inner(), other.direction.into_inner());
        a.cross(&b).norm().atan2(a.dot(&b).abs())
    }

    /// Rotation about the line by `angle` \[rad\].
    #[must_use]
    pub fn turn(&self, angle: f64) -> Turn {
        let rotation = Rotation3::from_axis_angle(&self.direction, angle).into_inner();
        Turn { rotation, translation: self.point - rotation * self.point }
    }

    /// Reflection in the plane through the line at `angle` from the first tangent \[rad\].
    #[must_use]
    pub(crate) fn mirror(&self, angle: f64) -> Turn {
        let [u, v] = self.tangents();
        let normal = v * angle.cos() - u * angle.sin();
        let rotation = Matrix3::identity() - 2.0 * normal * normal.transpose();
        Turn { rotation, translation: self.point - rotation * self.point }
    }
}

/// A rotation about a line, or a reflection in a plane through it, as the motion `q = rotation p + translation`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Turn {
    /// Rotation matrix, or that of a reflection.
    pub rotation: Matrix3<f64>,
    /// Translation \[length\].
    pub translation: Vector3<f64>,
}

impl Turn {
    /// Moves a point.
    #[must_use]
    pub fn apply(&self, p: &Vector3<f64>) -> Vector3<f64> {
        self.rotation * p + self.translation
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn oblique() -> Axis {
        let direction = Unit::new_normalize(Vector3::new(0.3, -0.2, 0.9));
        Axis { direction, point: Vector3::new(1.0, 2.0, 3.0) }
    }

    #[test]
    fn retract_moves_along_the_tangents() {
        let axis = oblique();
        let [u, v] = axis.tangents();
        assert!((u.cross(&v) - axis.direction.into_inner()).norm() < 1e-14);
        let moved = axis.retract(&Vector4::new(0.0, 1e-3, 0.2, 0.0));
        assert!((moved.angle_to(&axis) - 1e-3).abs() < 1e-12);
        assert!((moved.point - axis.point - u * 0.2).norm() < 1e-14);
    }

    #[test]
    fn a_step_leads_where_it_was_read_from() {
        let step = Vector4::new(1e-6, -2e-6, 3e-6, 4e-6);
        assert!((oblique().step_to(&oblique().retract(&step)) - step).norm() < 1e-10);
    }

    #[test]
    fn turn_keeps_the_axis() {
        let axis = oblique();
        let on_axis = axis.point + axis.direction.into_inner() * 7.0;
        assert!((axis.turn(1.2).apply(&on_axis) - on_axis).norm() < 1e-13);
    }

    #[test]
    fn a_mirror_keeps_its_plane_and_turns_the_other_side_over() {
        let axis = oblique();
        let [u, v] = axis.tangents();
        let along = u * 0.6_f64.cos() + v * 0.6_f64.sin();
        let across = axis.direction.cross(&along);
        let at = |side: f64| axis.point + along * 2.0 + axis.direction.into_inner() * 3.0 + across * side;
        let mirror = axis.mirror(0.6);
        assert!((mirror.apply(&at(0.7)) - at(-0.7)).norm() < 1e-13);
        assert!((mirror.rotation * along - along).norm() < 1e-13);
    }

    #[test]
    fn what_faces_around_the_line_stands_out_of_the_plane_through_it() {
        let axis = Axis { direction: Vector3::z_axis(), point: Vector3::new(1.0, 0.0, 5.0) };
        let at = Vector3::new(3.0, 0.0, -2.0);
        assert_eq!(axis.around(&at, &Vector3::y()), 1.0);
        assert_eq!(axis.around(&at, &-Vector3::y()), -1.0);
        assert_eq!(axis.around(&at, &Vector3::new(0.6, 0.0, 0.8)), 0.0);
        assert_eq!(axis.around(&Vector3::new(1.0, 0.0, 2.0), &Vector3::y()), 0.0);
    }
}

//! Uncertainty of the pose in the object frame, with the motions that the data does not fix.

use nalgebra::{Matrix4, SMatrix, SVector, SymmetricEigen, Vector2, Vector3};

use crate::result::FreeDirection;
use crate::symmetry::axis::Axis;
use crate::symmetry::sandwich::Sandwich;

/// What is known of the frame beside the axis itself.
#[derive(Debug, Clone, Copy)]
pub(crate) struct AlongAxis {
    /// Standard deviation of the origin along the axis \[length\]; infinite when it is free.
    pub slide: f64,
    /// Standard deviation of the rotation about the axis \[rad\]; infinite when it is free.
    pub yaw: f64,
}

/// What errors common to many patches add to the variance where views were not compared; from the coverage on synthetic scans.
pub(crate) const INFLATION: f64 = 2.0;

/// By how much the axis may be off along the direction in which all sensors stand aside [point spacings]; from the errors of
/// synthetic scans. About half of that goes where points at the rim of what they saw weigh less.
const ONE_SIDED: f64 = 0.04;

/// Errors of the axis that many residuals have in common.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CommonErrors {
    /// By what the covariance is larger than noise alone would make it.
    pub inflation: f64,
    /// What is added to it, as patches of the surface are too small to show it: errors in the places of the views, and what comes
    /// of seeing one side alone.
    pub added: Matrix4<f64>,
}

impl CommonErrors {
    /// The same with what comes of seeing one side alone: `toward_sensors` is the mean unit direction from the part to the
    /// sensors, short where they stand all round, and `spacing` the distance between points \[length\].
    pub(crate) fn seen_from(mut self, toward_sensors: &Vector3<f64>, axis: &Axis, spacing: f64) -> Self {
        let aside = Vector2::from(axis.tangents().map(|tangent| tangent.dot(toward_sensors)));
        let shift = aside * (aside.norm() * ONE_SIDED * spacing);
        let mut shifts = self.added.fixed_view_mut::<2, 2>(2, 2);
        shifts += shift * shift.transpose();
        self
    }

    /// By how much errors of the views tilt the axis in any one direction \[rad\].
    pub(crate) fn tilt_by_views(&self) -> f64 {
        (0.5 * (self.added[(0, 0)] + self.added[(1, 1)])).sqrt()
    }
}

/// Relative curvature below which an axis parameter counts as free.
const RANK_TOLERANCE: f64 = 1e-9;

/// Curvature below which a direction counts as free where another one does, too [curvature that noise of the normals alone gives].
/// Balls have 0.9 to 1.3, the second weakest direction of 248 scans of parts has 1.5 and more.
const ABOVE_NOISE: f64 = 1.4;

/// Least share of an error that a round is taken to make good: below it, that was not measured.
const LEAST_PACE: f64 = 0.05;

/// The inverse of a pace, none of whose singular values counts as less than [`LEAST_PACE`] or more than 1.
fn bounded_inverse(pace: &Matrix4<f64>) -> Matrix4<f64> {
    let Some(mut svd) = pace.try_svd(true, true, f64::EPSILON, 100) else {
        return Matrix4::identity() / LEAST_PACE;
    };
    svd.singular_values.apply(|share| *share = share.clamp(LEAST_PACE, 1.0));
    svd.pseudo_inverse(0.0).unwrap_or_else(|_| Matrix4::identity() / LEAST_PACE)
}

/// The 6x6 covariance (rotation x y z \[rad\], translation x y z \[length\]; object frame) and its free directions.
///
/// `sandwich` belongs to tilt about both tangents and shift along both, about the point of the axis; `radius` is the
/// size of the part, which makes tilt and shift comparable. `heading` turns the tangents into +x and +y; `height` is where
/// the origin lies above the point of the axis.
///
/// `pace` is the share of an error that shows in the residuals ([`matching_pace`]): matches are made anew wherever the
/// axis is, so that J'WJ for fixed matches promises too much.
///
/// The inverse of J'WJ alone would be far too small: each point takes part in many residuals, and neighbours share their
/// errors (Bonnabel et al., arXiv 1410.7632, on ICP).
///
/// [`matching_pace`]: crate::symmetry::pace::matching_pace
#[must_use]
pub(crate) fn pose_covariance(
    sandwich: &Sandwich,
    pace: &Matrix4<f64>,
    common: &CommonErrors,
    radius: f64,
    heading: f64,
    height: f64,
    along: AlongAxis,
) -> ([[f64; 6]; 6], Vec<FreeDirection>) {
    let (of_noise, mut free) = axis_covariance(sandwich, pace, radius);
    // Where a direction is free, such errors along it would spoil the others.
    let added = if free.is_empty() { common.added } else { Matrix4::zeros() };
    let of_axis = common.inflation * of_noise + added;
    let embed = frame_from_axis(heading, height);
    let mut covariance = embed * of_axis * embed.transpose();
    covariance[(2, 2)] = along.yaw * along.yaw;
    covariance[(5, 5)] = along.slide * along.slide;
    if along.yaw.is_infinite() {
        free.insert(0, FreeDirection::Yaw);
    }
    if along.slide.is_infinite() {
        free.push(FreeDirection::Slide);
    }
    for (direction, indices) in [(FreeDirection::Tilt, [0, 1]), (FreeDirection::Shift, [3, 4])] {
        if free.contains(&direction) {
            for i in indices {
                covariance.set_row(i, &SVector::<f64, 6>::zeros().transpose());
                covariance.set_column(i, &SVector::<f64, 6>::zeros());
                covariance[(i, i)] = f64::INFINITY;
            }
        }
    }
    // Symmetric to the last bit.
    let mean = |i: usize, j: usize| 0.5 * (covariance[(i, j)] + covariance[(j, i)]);
    (std::array::from_fn(|i| std::array::from_fn(|j| mean(i, j))), free)
}

/// What noise gives to the covariance of tilt \[rad\] and shift \[length\] of the axis along its tangents, with the free
/// directions.
fn axis_covariance(
    sandwich: &Sandwich,
    pace: &Matrix4<f64>,
    radius: f64,
) -> (Matrix4<f64>, Vec<FreeDirection>) {
    // Tilt as the shift that it is at the radius.
    let scale = Matrix4::from_diagonal(&[1.0 / radius, 1.0 / radius, 1.0, 1.0].into());
    let lever = Matrix4::from_diagonal(&[radius, radius, 1.0, 1.0].into());
    let [hessian, scatter, noise] =
        [&sandwich.hessian, &sandwich.scatter, &sandwich.noise].map(|form| scale * form * scale);
    let largest = hessian.diagonal().max();
    let eigen = SymmetricEigen::try_new(hessian, f64::EPSILON, 100).filter(|_| largest > 0.0);
    let Some(SymmetricEigen { eigenvalues, eigenvectors }) = eigen else {
        return (Matrix4::zeros(), vec![FreeDirection::Tilt, FreeDirection::Shift]);
    };
    let directions = || eigenvalues.iter().zip(eigenvectors.column_iter());
    let beside_noise: Vec<f64> = directions()
        .map(|(value, vector)| value / vector.dot(&(noise * vector)).max(f64::MIN_POSITIVE))
        .collect();
    // A ball leaves two directions free; a single weak one is only weak.
    let is_ball = beside_noise.iter().filter(|ratio| **ratio < ABOVE_NOISE).count() > 1;
    let mut is_free = [false; 4];
    let mut inverse = Matrix4::zeros();
    for ((value, vector), ratio) in directions().zip(&beside_noise) {
        if *value > RANK_TOLERANCE * largest && !(is_ball && *ratio < ABOVE_NOISE) {
            inverse += vector * vector.transpose() / *value;
        } else {
            (0..4).for_each(|i| is_free[i] |= vector[i].abs() > 0.1);
        }
    }
    let step = bounded_inverse(&(lever * pace * scale)) * inverse;
    let covariance = scale * step * scatter * step.transpose() * scale;
    let tilt = (is_free[0] || is_free[1]).then_some(FreeDirection::Tilt);
    let shift = (is_free[2] || is_free[3]).then_some(FreeDirection::Shift);
    (covariance, tilt.into_iter().chain(shift).collect())
}

/// How the frame moves with the axis: `heading` turns the tangents into +x and +y, and the origin lies `height` above the
/// point of the axis, so that tilting the axis moves it: t += omega x (height z).
fn frame_from_axis(heading: f64, height: f64) -> SMatrix<f64, 6, 4> {
    let (sin, cos) = heading.sin_cos();
    let mut embed = SMatrix::<f64, 6, 4>::zeros();
    for (row, column, value) in [(0, 0, cos), (0, 1, sin), (1, 0, -sin), (1, 1, cos)] {
        embed[(row, column)] = value;
        embed[(row + 3, column + 2)] = value;
        // x moves by +height * omega_y, y by -height * omega_x.
        let (moved, sign) = if row == 1 { (3, 1.0) } else { (4, -1.0) };
        embed[(moved, column)] += sign * height * value;
    }
    embed
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sensors_to_one_side_leave_a_shift_toward_them_uncertain() {
        let spacing = 0.1;
        let variances = |toward: Vector3<f64>, axis: &Axis| {
            let none = CommonErrors { inflation: 1.0, added: Matrix4::zeros() };
            let added = none.seen_from(&toward, axis, spacing).added;
            assert_eq!(added.fixed_view::<2, 4>(0, 0).amax(), 0.0);
            let along = |direction: Vector3<f64>| {
                let shift = Vector2::from(axis.tangents().map(|tangent| tangent.dot(&direction)));
                shift.dot(&(added.fixed_view::<2, 2>(2, 2) * shift))
            };
            [along(Vector3::x()), along(Vector3::y())]
        };
        let axis = Axis { point: Vector3::zeros(), direction: Vector3::z_axis() };
        assert_eq!(variances(Vector3::z(), &axis), [0.0, 0.0]);
        let [along, across] = variances(Vector3::new(0.8, 0.0, 0.6), &axis);
        assert!((along.sqrt() - 0.8 * 0.8 * ONE_SIDED * spacing).abs() < 1e-12 && across < 1e-12);
        // Sensors all round.
        let [along, _] = variances(Vector3::new(0.2, 0.0, 0.1), &axis);
        assert!(along.sqrt() < 0.05 * ONE_SIDED * spacing);
    }
}

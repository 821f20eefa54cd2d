//! One correspondence as whitened rows: point-to-point, symmetric point-to-plane, or distribution-to-distribution.

use nalgebra::{Matrix3, Vector3};

use crate::config::Residual;

/// Up to three rows `m`; the residual of a difference vector `e` is the norm of the `m . e`.
#[derive(Debug, Clone, Copy)]
pub struct Rows {
    rows: [Vector3<f64>; 3],
    len: usize,
}

impl Rows {
    /// The rows.
    #[must_use]
    pub fn as_slice(&self) -> &[Vector3<f64>] {
        &self.rows[..self.len]
    }

    /// Norm of the whitened difference.
    #[must_use]
    #[inline]
    pub fn residual(&self, difference: &Vector3<f64>) -> f64 {
        match self.as_slice() {
            [m] => m.dot(difference),
            rows => rows.iter().map(|m| m.dot(difference).powi(2)).sum::<f64>().sqrt(),
        }
    }
}

/// Thickness of the local Gaussian of GICP along its normal, relative to its extent in the plane, as a variance.
const FLATNESS: f64 = 1e-2;

impl Residual {
    /// Rows for a rotated point with the (rotated) normal `normal`, matched to a point with normal `matched`.
    ///
    /// Point-to-plane takes the *normalised* sum of both normals, which is exact to second order (Rusinkiewicz, A
    /// symmetric objective function for ICP, 2019); normals of unknown orientation are first made to agree.
    #[must_use]
    #[inline(always)]
    pub fn rows(self, normal: &Vector3<f64>, matched: &Vector3<f64>) -> Rows {
        match self {
            Self::PointToPoint => Rows { rows: [Vector3::x(), Vector3::y(), Vector3::z()], len: 3 },
            Self::PointToPlane => {
                let agreeing = if normal.dot(matched) < 0.0 { -matched } else { *matched };
                let sum = normal + agreeing;
                let length = sum.norm();
                let direction = if length > 0.0 { sum / length } else { *normal };
                Rows { rows: [direction, Vector3::zeros(), Vector3::zeros()], len: 1 }
            }
            Self::Distribution => {
                let covariance: Matrix3<f64> = 2.0 * Matrix3::identity()
                    - (1.0 - FLATNESS) * (normal * normal.transpose() + matched * matched.transpose());
                // Scaled so that the information along a common normal is one, as for point-to-plane.
                let information = covariance.try_inverse().map(|inverse| inverse * (2.0 * FLATNESS));
                let factor = information.and_then(|m| m.cholesky()).map(|c| c.l().transpose());
                let factor = factor.unwrap_or_else(Matrix3::identity);
                let row = |i: usize| factor.row(i).transpose();
                Rows { rows: [row(0), row(1), row(2)], len: 3 }
            }
        }
    }
}

//! A scan against the reference surface: six degrees of freedom, point-to-plane, robust.

use nalgebra::{Isometry3, Matrix6, Point3, SymmetricEigen, Translation3, UnitQuaternion, Vector3, Vector6};
use rayon::prelude::*;

use super::register::Freedom;
use super::sides::SidedSurface;
use crate::config::Residual;
use crate::control::Control;
use crate::error::Result;
use crate::result::FreeDirection;
use crate::symmetry::covariance::INFLATION;
use crate::symmetry::robust::{HUBER_WIDTH, Huber, robust_sigma};
use crate::symmetry::sandwich::PATCHES;
use crate::symmetry::surface::{Gate, Samples};
use crate::symmetry::view_errors::{ViewErrors, rigid_row};

/// Smallest cosine between the normals of a match.
pub(super) const MIN_COSINE: f64 = 0.8;

/// Eigenvalue of the scaled information, against the largest, below which a direction is free.
const RANK_TOLERANCE: f64 = 1e-9;

/// By what the variance is larger than that of the scan alone: the reference was measured as well.
const BOTH_MEASURED: f64 = 2.0;

/// A scan laid on the surface.
#[derive(Debug, Clone)]
pub(super) struct Fit {
    /// Reference frame from the frame of the scan.
    pub object_from_scan: Isometry3<f64>,
    /// Robust standard deviation of the distances to the surface \[length\].
    pub sigma: f64,
    /// J'WJ, rotation about the origin of the reference frame, then translation.
    hessian: Matrix6<f64>,
    /// Sum over patches of the scan of the outer product of J'Wr.
    scatter: Matrix6<f64>,
    /// The same for errors in the places of the views.
    scatter_of_views: Matrix6<f64>,
    /// By what the covariance is larger than noise alone would make it.
    inflation: f64,
}

/// One scan point matched to the surface.
struct Match {
    jacobian: Vector6<f64>,
    residual: f64,
}

/// The distance of a scan point from the plane of the surface point that it meets.
pub(super) fn residual(
    surface: &SidedSurface,
    object_from_scan: &Isometry3<f64>,
    (point, normal): (&Vector3<f64>, &Vector3<f64>),
    gate: f64,
) -> Option<(Vector3<f64>, Vector3<f64>, f64)> {
    let point = (object_from_scan * Point3::from(*point)).coords;
    let normal = object_from_scan * normal;
    let (met, facing) = surface.matching(&point, &normal, Gate::new(gate, MIN_COSINE))?;
    let rows = Residual::PointToPlane.rows(&normal, facing);
    let row = *rows.as_slice().first()?;
    Some((point, row, row.dot(&(point - met))))
}

impl Fit {
    /// Gauss-Newton from `start`, its gate narrowing through `gates` \[length\]. With `free_yaw` the turn about z is kept.
    pub(super) fn new(
        surface: &SidedSurface,
        samples: &Samples,
        start: Isometry3<f64>,
        gates: &[f64],
        free_yaw: bool,
        control: &Control,
    ) -> Result<Self> {
        const ROUNDS: usize = 12;
        const TOLERANCE: f64 = 1e-4;
        let mut fit = Self {
            object_from_scan: start,
            sigma: 0.0,
            hessian: Matrix6::zeros(),
            scatter: Matrix6::zeros(),
            scatter_of_views: Matrix6::zeros(),
            inflation: BOTH_MEASURED * INFLATION,
        };
        for &gate in gates {
            for _ in 0..ROUNDS {
                control.check()?;
                let gradient = fit.linearize(surface, samples, gate);
                let Some(step) = solve(fit.hessian, gradient, surface.radius, free_yaw) else { break };
                let (turn, shift): (Vector3<f64>, Vector3<f64>) =
                    (step.fixed_rows::<3>(0).into(), step.fixed_rows::<3>(3).into());
                let motion =
                    Isometry3::from_parts(Translation3::from(shift), UnitQuaternion::from_scaled_axis(turn));
                fit.object_from_scan = motion * fit.object_from_scan;
                if turn.norm() * surface.radius + shift.norm() < TOLERANCE * surface.spacing {
                    break;
                }
            }
        }
        Ok(fit)
    }

    /// Matches the scan anew; sums the normal equations and returns J'Wr.
    fn linearize(&mut self, surface: &SidedSurface, samples: &Samples, gate: f64) -> Vector6<f64> {
        let pose = self.object_from_scan;
        let matches: Vec<Option<Match>> = samples
            .points
            .par_iter()
            .zip(&samples.normals)
            .map(|row| {
                let (point, plane, residual) = residual(surface, &pose, row, gate)?;
                let moment = point.cross(&plane);
                let jacobian = Vector6::new(moment.x, moment.y, moment.z, plane.x, plane.y, plane.z);
                Some(Match { jacobian, residual })
            })
            .collect();
        let mut residuals: Vec<f64> = matches.iter().flatten().map(|m| m.residual).collect();
        self.sigma = robust_sigma(&mut residuals).max(1e-9 * surface.radius);
        let loss = Huber { width: HUBER_WIDTH * self.sigma };
        self.hessian = Matrix6::zeros();
        self.scatter = Matrix6::zeros();
        let mut sum = Vector6::zeros();
        for patch in matches.chunks(matches.len().div_ceil(PATCHES).max(1)) {
            let mut gradient = Vector6::zeros();
            for Match { jacobian, residual } in patch.iter().flatten() {
                let weight = loss.weight(*residual);
                self.hessian += jacobian * jacobian.transpose() * weight;
                gradient += jacobian * (weight * residual);
            }
            self.scatter += gradient * gradient.transpose();
            sum += gradient;
        }
        sum
    }

    /// The same pose, judged by the points of the scan as they were `measured`: refined ones have their noise in common with their
    /// copies about the axis, which many patches hold.
    pub(super) fn judged_by(&self, surface: &SidedSurface, measured: &Samples, gate: f64) -> Self {
        let mut fit = self.clone();
        fit.linearize(surface, measured, gate);
        fit
    }

    /// Finds what errors in the places of the views do to J'Wr; they turn about the `centroid` of the scan.
    pub(super) fn consider_views(
        &mut self,
        surface: &SidedSurface,
        samples: &Samples,
        gate: f64,
        errors: &ViewErrors,
        centroid: &Vector3<f64>,
    ) {
        let Some(spread) = errors.spread else { return };
        let pose = self.object_from_scan;
        let loss = Huber { width: HUBER_WIDTH * self.sigma };
        let centroid = (pose * Point3::from(*centroid)).coords;
        let mut responses = vec![Matrix6::zeros(); errors.views];
        for (i, row) in samples.points.iter().zip(&samples.normals).enumerate() {
            let Some((point, plane, residual)) = residual(surface, &pose, row, gate) else { continue };
            let moment = point.cross(&plane);
            let jacobian = Vector6::new(moment.x, moment.y, moment.z, plane.x, plane.y, plane.z);
            // Errors have no preferred direction, so that the frame does not matter.
            let response =
                jacobian * loss.weight(residual) * rigid_row(&plane, &(point - centroid), surface.radius);
            for (sum, &share) in responses.iter_mut().zip(errors.shares(i)).filter(|(_, share)| **share > 0.0)
            {
                *sum += response * f64::from(share);
            }
        }
        self.scatter_of_views = spread.scatter(&responses, surface.radius);
        self.inflation = BOTH_MEASURED * errors.inflation();
    }

    /// The 6x6 covariance in the object frame and its free directions, as those of an estimate.
    ///
    /// Neighbouring residuals share their errors, which the scatter over patches holds.
    pub(super) fn covariance(&self, radius: f64, freedom: Freedom) -> ([[f64; 6]; 6], Vec<FreeDirection>) {
        const NAMES: [FreeDirection; 6] = [
            FreeDirection::Tilt,
            FreeDirection::Tilt,
            FreeDirection::Yaw,
            FreeDirection::Shift,
            FreeDirection::Shift,
            FreeDirection::Slide,
        ];
        let scale = scaling(radius);
        let hessian = fixed(scale * self.hessian * scale, freedom);
        let largest = hessian.diagonal().max();
        let mut free = [false, false, freedom.turns, false, false, freedom.slides];
        let mut inverse = Matrix6::zeros();
        if let Some(eigen) = SymmetricEigen::try_new(hessian, f64::EPSILON, 100).filter(|_| largest > 0.0) {
            for (value, vector) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
                if *value > RANK_TOLERANCE * largest {
                    inverse += vector * vector.transpose() / *value;
                } else {
                    (0..6).for_each(|i| free[i] |= vector[i].abs() > 0.1);
                }
            }
        }
        let scatter = self.inflation * self.scatter + self.scatter_of_views;
        let mut covariance = scale * inverse * scale * scatter * scale * inverse * scale;
        for i in (0..6).filter(|i| free[*i]) {
            covariance.row_mut(i).fill(0.0);
            covariance.column_mut(i).fill(0.0);
            covariance[(i, i)] = f64::INFINITY;
        }
        let mut named: Vec<FreeDirection> = Vec::new();
        for i in [2, 0, 1, 3, 4, 5] {
            if free[i] && !named.contains(&NAMES[i]) {
                named.push(NAMES[i]);
            }
        }
        // Symmetric to the last bit.
        let mean = |i: usize, j: usize| 0.5 * (covariance[(i, j)] + covariance[(j, i)]);
        (std::array::from_fn(|i| std::array::from_fn(|j| mean(i, j))), named)
    }
}

/// Makes rotations and translations comparable.
fn scaling(radius: f64) -> Matrix6<f64> {
    let turn = 1.0 / radius;
    Matrix6::from_diagonal(&Vector6::new(turn, turn, turn, 1.0, 1.0, 1.0))
}

/// The information without the turn about z, or the slide along it, where the surface leaves them free.
fn fixed(mut hessian: Matrix6<f64>, freedom: Freedom) -> Matrix6<f64> {
    let held = hessian.diagonal().max();
    for (i, _) in [(2, freedom.turns), (5, freedom.slides)].into_iter().filter(|(_, is_free)| *is_free) {
        hessian.row_mut(i).fill(0.0);
        hessian.column_mut(i).fill(0.0);
        hessian[(i, i)] = held;
    }
    hessian
}

/// The step that makes the gradient vanish, hardly damped; `None` without matches.
fn solve(
    hessian: Matrix6<f64>,
    mut gradient: Vector6<f64>,
    radius: f64,
    free_yaw: bool,
) -> Option<Vector6<f64>> {
    const DAMPING: f64 = 1e-8;
    if free_yaw {
        gradient[2] = 0.0;
    }
    let scale = scaling(radius);
    let scaled = fixed(scale * hessian * scale, Freedom { turns: free_yaw, slides: false });
    let damped = scaled + Matrix6::identity() * (DAMPING * scaled.diagonal().max());
    Some(-scale * damped.cholesky()?.solve(&(scale * gradient)))
}

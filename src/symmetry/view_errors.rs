//! How well the views fit each other: errors in the places of the cameras, and what they do to the axis.

use nalgebra::{Matrix4, Matrix6, RowVector6, SMatrix, Vector3, Vector6};
use rayon::prelude::*;

use crate::config::Residual;
use crate::median::robust_sigma;
use crate::symmetry::alignment::{Correspondences, SelfAlignment, Unknowns, residuals};
use crate::symmetry::axis::Axis;
use crate::symmetry::order::Turns;
use crate::symmetry::refine::RefineParams;
use crate::symmetry::robust::Huber;
use crate::symmetry::surface::{Gate, Samples, Surface};

/// What each view measured near each point of a surface.
#[derive(Debug, Clone)]
pub struct Looks {
    /// Number of views, two or more.
    pub views: usize,
    /// For each point and each view how many measurements there are: views are the inner index.
    pub counts: Vec<f32>,
    /// The sum of their heights over the point, along its normal \[length\].
    pub heights: Vec<f32>,
}

/// How far views are off their places. All that a view measured is off in the same way, so that no number of points averages
/// it out.
#[derive(Debug, Clone)]
pub struct ViewErrors {
    /// Number of views.
    pub views: usize,
    /// For each point of the surface and each view, its share of the measurements there.
    shares: Vec<f32>,
    /// Standard deviation of the place of a view, in each of three directions \[length\].
    pub shift: f64,
    /// Standard deviation of its rotation about the centroid of the surface, about each of three directions \[rad\].
    pub turn: f64,
    /// Standard deviation of a measurement beside these errors \[length\].
    pub noise: f64,
}

/// Heights beyond this are of another surface [their standard deviation].
const OUTLYING: f64 = 4.0;

/// Share of its measurements that a view must have in common with others, to say anything of its error: fewer are those at
/// edges, where the means of two views lie on different surfaces.
const SHARED: f64 = 0.15;

/// Points of the surface whose matches tell what errors of the views do to the axis; it is their mean that counts.
const SAMPLES: usize = 4_000;

impl ViewErrors {
    /// Measures how far apart views lie where they see the same surface. `None` where hardly any do.
    ///
    /// Each view has a rigid error of its own; the heights of its measurements over what all of them say together are linear
    /// in it. Errors of all views are drawn from one distribution, whose two variances are found as in a model with random
    /// effects (Laird and Ware 1982, by expectation maximisation): what a view does not show of its error says nothing.
    #[must_use]
    pub fn measure(looks: &Looks, surface: &Surface) -> Option<Self> {
        /// Outliers are told from noise beside the errors, which are known only once outliers are left out.
        const ROUNDS: usize = 2;
        let views = looks.views;
        let mut errors = vec![Vector6::zeros(); views];
        let mut noise = looks.noise(surface, &errors)?;
        let mut variances = [0.0; 2];
        for _ in 0..ROUNDS {
            (variances, errors) = draw(&looks.evidence(surface, &errors, noise), surface.radius)?;
            // A view was compared with the others, which are off as well.
            let own = (views - 1) as f64 / views as f64;
            variances = variances.map(|variance| variance * own);
            errors.iter_mut().for_each(|error| *error *= own);
            noise = looks.noise(surface, &errors)?;
        }
        let [shift, turn] = variances.map(f64::sqrt);
        let share = |row: &[f32]| {
            let total = row.iter().sum::<f32>().max(1.0);
            row.iter().map(|count| count / total).collect::<Vec<_>>()
        };
        let shares = looks.counts.chunks_exact(views).flat_map(share).collect();
        Some(Self { views, shares, shift, turn: turn / surface.radius, noise })
    }

    /// What these errors add to the covariance of `axis`, by tilt about both tangents \[rad\] and shift along both \[length\],
    /// about the point of the axis.
    ///
    /// Both ends of a match move with the views that saw them, each by its share.
    #[must_use]
    pub fn covariance_of_axis(
        &self,
        surface: &Surface,
        axis: &Axis,
        turns: &Turns,
        residual: Residual,
        params: &RefineParams,
    ) -> Matrix4<f64> {
        let samples = surface.samples.strided(SAMPLES);
        let count = samples.points.len();
        let gate = Gate::new(params.gate * surface.spacing, params.max_normal_angle.cos());
        let correspondences = Correspondences::find(surface, &samples, axis, turns, gate);
        let mut found = residuals(surface, &samples, axis, turns, &correspondences, residual);
        let width = params.huber_width * robust_sigma(&mut found).max(1e-9 * surface.radius);
        let problem = SelfAlignment {
            surface,
            samples: &samples,
            turns,
            correspondences: &correspondences,
            residual,
            loss: Huber { width },
            anchor: params.anchor,
            max_offset: 0.0,
        };
        let unknowns = Unknowns { axis: *axis, offsets: Vec::new() };
        let leverages = problem.leverages(axis);
        let row = |direction: &Vector3<f64>, point: &Vector3<f64>| {
            rigid_row(direction, &(point - surface.centroid), surface.radius)
        };
        let mut hessian = Matrix4::zeros();
        let mut responses = vec![SMatrix::<f64, 4, 6>::zeros(); self.views];
        for i in 0..count {
            let moved = self.shares(i * surface.len() / count);
            problem.visit(&unknowns, &leverages, i, |term, j| {
                let weighted = term.jacobian() * term.weight;
                hessian += weighted * term.jacobian().transpose();
                let from = row(&term.row(), &samples.points[i]);
                let to = row(&term.direction, &surface.samples.points[j]);
                for ((response, &moved), &met) in responses.iter_mut().zip(moved).zip(self.shares(j)) {
                    if moved + met > 0.0 {
                        *response += weighted * (from * f64::from(moved) - to * f64::from(met));
                    }
                }
            });
        }
        let inverse = hessian.try_inverse().unwrap_or_default();
        inverse * self.scatter(&responses, surface.radius) * inverse
    }

    /// The share of each view in the measurements of a point.
    pub(crate) fn shares(&self, point: usize) -> &[f32] {
        &self.shares[point * self.views..(point + 1) * self.views]
    }

    /// Covariance of what answers to the errors of each view as `responses` say, in terms of a [`rigid_row`] with `radius`.
    pub(crate) fn scatter<const R: usize>(
        &self,
        responses: &[SMatrix<f64, R, 6>],
        radius: f64,
    ) -> SMatrix<f64, R, R> {
        let (shift, turn) = (self.shift, self.turn * radius);
        let spread = Matrix6::from_diagonal(&Vector6::new(shift, shift, shift, turn, turn, turn));
        let of_view = |response: &SMatrix<f64, R, 6>| {
            let moved = response * spread;
            moved * moved.transpose()
        };
        responses.iter().map(of_view).sum()
    }
}

/// Derivative of the height along `normal` by a rigid motion of the point at `arm` from the centroid of the surface: by its shift,
/// and by its rotation about the centroid, as the shift that this is at `radius`.
pub(crate) fn rigid_row(normal: &Vector3<f64>, arm: &Vector3<f64>, radius: f64) -> RowVector6<f64> {
    let moment = arm.cross(normal) / radius;
    RowVector6::new(normal.x, normal.y, normal.z, moment.x, moment.y, moment.z)
}

/// What all heights that a view shares with others say of its error.
struct Evidence {
    information: Matrix6<f64>,
    /// The same times the error.
    weighted: Vector6<f64>,
}

/// Where a view and others saw the same point.
struct Shared {
    /// Derivative of a height by the error of its view.
    row: RowVector6<f64>,
    /// Measurements of the view.
    count: f64,
    /// Their share in all.
    share: f64,
    /// Their mean height over all \[length\].
    height: f64,
    /// What the errors of all views leave of it, as that of a single measurement \[length\].
    left: f64,
}

impl Looks {
    /// The points that `view` shares with others.
    fn shared(
        &self,
        view: usize,
        surface: &Surface,
        errors: &[Vector6<f64>],
    ) -> impl Iterator<Item = Shared> {
        let Samples { points, normals } = &surface.samples;
        let seen = self.counts.chunks_exact(self.views).zip(self.heights.chunks_exact(self.views));
        seen.zip(points.iter().zip(normals)).filter_map(move |((counts, heights), (point, normal))| {
            let count = counts[view];
            let total: f32 = counts.iter().sum();
            if count == 0.0 || count == total {
                return None;
            }
            let row = rigid_row(normal, &(point - surface.centroid), surface.radius);
            let lift = |(seen, error): (&f32, &Vector6<f64>)| f64::from(seen / total) * (row * error)[0];
            let mean: f64 = counts.iter().zip(errors).filter(|(seen, _)| **seen > 0.0).map(lift).sum();
            let [count, share, height] = [count, count / total, heights[view] / count].map(f64::from);
            // The view has a share in the mean over which heights are taken.
            let left = (height + mean - (row * errors[view])[0]) * (count / (1.0 - share)).sqrt();
            Some(Shared { row, count, share, height, left })
        })
    }

    /// Standard deviation of a measurement beside the `errors` of the views \[length\]; `None` where no two views share a point.
    fn noise(&self, surface: &Surface, errors: &[Vector6<f64>]) -> Option<f64> {
        let of_view = |view: usize| self.shared(view, surface, errors).map(|shared| shared.left).collect();
        let mut left = (0..self.views).into_par_iter().map(of_view).collect::<Vec<Vec<f64>>>().concat();
        (!left.is_empty()).then(|| robust_sigma(&mut left).max(1e-6 * surface.spacing))
    }

    /// What the heights say of the error of each view, but for those that `errors` and `noise` do not explain; `None` where a
    /// view shares too few.
    fn evidence(&self, surface: &Surface, errors: &[Vector6<f64>], noise: f64) -> Vec<Option<Evidence>> {
        let of_view = |view: usize| {
            let (mut information, mut weighted) = (Matrix6::zeros(), Vector6::zeros());
            let all: f64 = self.counts.iter().skip(view).step_by(self.views).copied().map(f64::from).sum();
            let mut in_common = 0.0;
            for Shared { row, count, share, height, left } in self.shared(view, surface, errors) {
                in_common += count;
                if left.abs() < OUTLYING * noise {
                    information += row.transpose() * row * (count * (1.0 - share));
                    weighted += row.transpose() * (count * height);
                }
            }
            (in_common > SHARED * all).then(|| Evidence {
                information: information / (noise * noise),
                weighted: weighted / (noise * noise),
            })
        };
        (0..self.views).into_par_iter().map(of_view).collect()
    }
}

/// Variances of shift and of turn at the radius [squared length], and the error of each view; `None` where there is no
/// evidence. A view without any has an error of zero here.
fn draw(evidence: &[Option<Evidence>], radius: f64) -> Option<([f64; 2], Vec<Vector6<f64>>)> {
    /// Errors from which the search begins, and that are left of those of which nothing is known [radii].
    const START: f64 = 1e-4;
    const ROUNDS: usize = 100;
    /// Change of both variances below which they are found.
    const TOLERANCE: f64 = 0.01;
    let known = evidence.iter().flatten().count();
    if known == 0 {
        return None;
    }
    let mut variances = [(START * radius).powi(2); 2];
    let mut errors = vec![Vector6::zeros(); evidence.len()];
    for _ in 0..ROUNDS {
        let [shift, turn] = variances.map(f64::recip);
        let prior = Matrix6::from_diagonal(&Vector6::new(shift, shift, shift, turn, turn, turn));
        let mut expected = [0.0; 2];
        for (error, of_view) in errors.iter_mut().zip(evidence) {
            let Some(Evidence { information, weighted }) = of_view else { continue };
            let posterior = (information + prior).try_inverse()?;
            *error = posterior * weighted;
            for i in 0..6 {
                expected[i / 3] += (error[i] * error[i] + posterior[(i, i)]) / (3 * known) as f64;
            }
        }
        let change = |i: usize| (expected[i] / variances[i] - 1.0).abs();
        let is_found = change(0) < TOLERANCE && change(1) < TOLERANCE;
        // Errors of nothing are approached without an end.
        variances = expected.map(|variance| variance.max((1e-9 * radius).powi(2)));
        if is_found {
            break;
        }
    }
    Some((variances, errors))
}

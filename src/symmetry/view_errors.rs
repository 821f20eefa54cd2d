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
use crate::symmetry::surface::{Gate, Surface};

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
    views: usize,
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
    /// Measures how far apart views lie where they see the same surface. `None` where
    /// hardly any do.
    ///
    /// Each view has a rigid error of its own; the heights of its measurements over what all of them say together are linear
    /// in it. Errors of all views are drawn from one distribution, whose two variances are found as in a model with random
    /// effects (Laird and Ware 1982, by expectation maximisation): what a view does not show of its error says nothing.
    #[must_use]
    pub fn measure(looks: &Looks, surface: &Surface) -> Option<Self> {
        /// Noise is known only once the errors are, and these only once outliers are told from noise.
        const ROUNDS: usize = 2;
        let views = looks.views;
        let mut errors = vec![Vector6::zeros(); views];
        let mut noise = looks.noise(surface, &errors)?;
        let mut variances = [0.0; 2];
        for _ in 0..ROUNDS {
            let evidence = looks.evidence(surface, &errors, noise);
            (variances, errors) = draw(&evidence, surface.radius)?;
            noise = looks.noise(surface, &errors)?;
        }
        // Each view was compared with the others, which are off as well.
        let [shift, turn] = variances.map(|variance| (variance * (views - 1) as f64 / views as f64).sqrt());
        let share = |row: &[f32]| {
            let total = row.iter().sum::<f32>().max(1.0);
            row.iter().map(|count| count / total).collect::<Vec<_>>()
        };
        let shares = looks.counts.chunks_exact(views).flat_map(share).collect();
        Some(Self { views, shares, shift, turn: turn / surface.radius, noise })
    }

    /// How far a view is off at the rim of the surface \[length\].
    #[must_use]
    pub fn at_rim(&self, surface: &Surface) -> f64 {
        self.shift.hypot(self.turn * surface.radius)
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
        let shares = |point: usize| &self.shares[point * self.views..(point + 1) * self.views];
        let mut hessian = Matrix4::zeros();
        let mut responses = vec![SMatrix::<f64, 4, 6>::zeros(); self.views];
        for i in 0..count {
            let moved = shares(i * surface.len() / count);
            problem.visit(&unknowns, &leverages, i, |term, j| {
                let weighted = term.jacobian() * term.weight;
                hessian += weighted * term.jacobian().transpose();
                let from = rigid_row(surface, &term.row(), &samples.points[i]);
                let to = rigid_row(surface, &term.direction, &surface.samples.points[j]);
                for ((response, &moved), &met) in responses.iter_mut().zip(moved).zip(shares(j)) {
                    if moved + met > 0.0 {
                        *response += weighted * (from * f64::from(moved) - to * f64::from(met));
                    }
                }
            });
        }
        let Some(inverse) = hessian.try_inverse() else { return Matrix4::zeros() };
        let (shift, turn) = (self.shift, self.turn * surface.radius);
        let spread = Vector6::new(shift, shift, shift, turn, turn, turn);
        let scatter = responses.iter().map(|response| {
            let moved = inverse * response * Matrix6::from_diagonal(&spread);
            moved * moved.transpose()
        });
        scatter.sum()
    }
}

/// Derivative of the height along `normal` by a rigid motion of `point`: by its shift, and by its rotation about the centroid of
/// the surface, as the shift that this is at the radius.
fn rigid_row(surface: &Surface, normal: &Vector3<f64>, point: &Vector3<f64>) -> RowVector6<f64> {
    let moment = (point - surface.centroid).cross(normal) / surface.radius;
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
    point: usize,
    /// Measurements of the view.
    count: f64,
    /// Their share in all.
    share: f64,
    /// Their mean height over all \[length\].
    height: f64,
}

impl Looks {
    fn shared(&self, view: usize) -> impl Iterator<Item = Shared> {
        let rows = self.counts.chunks_exact(self.views).zip(self.heights.chunks_exact(self.views));
        rows.enumerate().filter_map(move |(point, (counts, heights))| {
            let count = counts[view];
            let total: f32 = counts.iter().sum();
            (count > 0.0 && count < total).then(|| Shared {
                point,
                count: f64::from(count),
                share: f64::from(count / total),
                height: f64::from(heights[view] / count),
            })
        })
    }

    /// Standard deviation of a measurement beside the `errors` of the views \[length\]; `None` where no two views share a point.
    fn noise(&self, surface: &Surface, errors: &[Vector6<f64>]) -> Option<f64> {
        let of_view = |view: usize| -> Vec<f64> {
            let left = |shared: Shared| shared.left(surface, &errors[view]) * shared.count.sqrt();
            self.shared(view).map(left).collect()
        };
        let mut left = (0..self.views).into_par_iter().map(of_view).collect::<Vec<_>>().concat();
        (!left.is_empty()).then(|| robust_sigma(&mut left).max(1e-6 * surface.spacing))
    }

    /// What the heights say of the error of each view, but for those that `errors` and `noise` do not explain; `None` where a
    /// view shares too few.
    fn evidence(&self, surface: &Surface, errors: &[Vector6<f64>], noise: f64) -> Vec<Option<Evidence>> {
        let of_view = |view: usize| {
            let (mut information, mut weighted) = (Matrix6::zeros(), Vector6::zeros());
            let all: f64 = self.counts.iter().skip(view).step_by(self.views).copied().map(f64::from).sum();
            let mut in_common = 0.0;
            for shared in self.shared(view) {
                in_common += shared.count;
                if shared.left(surface, &errors[view]).abs() * shared.count.sqrt() < OUTLYING * noise {
                    let row = shared.row(surface).transpose();
                    information += row * row.transpose() * (shared.count * (1.0 - shared.share));
                    weighted += row * (shared.count * shared.height);
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

impl Shared {
    fn row(&self, surface: &Surface) -> RowVector6<f64> {
        rigid_row(surface, &surface.samples.normals[self.point], &surface.samples.points[self.point])
    }

    /// What an error of the view leaves of the height. The view has a share in the mean that heights are taken over.
    fn left(&self, surface: &Surface, error: &Vector6<f64>) -> f64 {
        self.height - (1.0 - self.share) * (self.row(surface) * error)[0]
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

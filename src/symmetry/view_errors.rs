//! How well the views fit each other: errors in the places of the cameras, and what they do to the axis.

use nalgebra::{Matrix4, Matrix6, RowVector6, SMatrix, SVector, Vector3, Vector6};
use rayon::prelude::*;

use crate::config::Residual;
use crate::median::robust_sigma;
use crate::symmetry::alignment::{SelfAlignment, Unknowns};
use crate::symmetry::axis::Axis;
use crate::symmetry::covariance::INFLATION;
use crate::symmetry::order::Turns;
use crate::symmetry::refine::{Aligner, RefineParams};
use crate::symmetry::surface::{Samples, Surface};
use crate::symmetry::view_axes::covariance_of_view_axes;

/// What each view measured near each point of a surface.
#[derive(Debug, Clone)]
pub struct Looks {
    /// Number of views that saw anything of the surface, two or more.
    pub views: usize,
    /// For each point and each view how many measurements there are: views are the inner index.
    pub counts: Vec<f32>,
    /// For each [`step`](Self::step)-th point and each view the sum of their heights over the point, along its normal \[length\].
    pub heights: Vec<f32>,
}

/// How far views are off their places.
#[derive(Debug, Clone, Copy)]
pub struct Spread {
    /// Standard deviation of the place of a view, in each of three directions \[length\].
    pub shift: f64,
    /// Standard deviation of its rotation about the centroid of the surface, about each of three directions \[rad\].
    pub turn: f64,
    /// Standard deviation of a measurement beside these errors \[length\]; a part of them is left in it.
    pub noise: f64,
    /// Number of views that share enough surface with others to tell.
    pub known: usize,
}

/// Errors of the views: all that a view measured is off in the same way, so that no number of points averages it out.
#[derive(Debug, Clone)]
pub struct ViewErrors {
    /// Number of views.
    pub views: usize,
    /// Their size; `None` where hardly any of them saw the same surface.
    pub spread: Option<Spread>,
    /// For each point of the surface and each view, its share of the measurements there.
    shares: Vec<f32>,
}

/// Heights beyond this are of another surface [their standard deviation].
const OUTLYING: f64 = 4.0;

/// Share of its measurements that a view must have in common with others, to say anything of its error: fewer are those at
/// edges, where the means of two views lie on different surfaces.
const SHARED: f64 = 0.15;

/// Points of the surface whose matches tell what errors of the views do to the axis; it is their mean that counts.
const SAMPLES: usize = 4_000;

/// Points of the surface at which heights are compared: a hundredth of the noise is left in their mean.
const COMPARED: usize = 10_000;

impl ViewErrors {
    /// Measures how far apart views lie where they see the same surface.
    #[must_use]
    pub fn measure(looks: Looks, surface: &Surface) -> Self {
        let spread = looks.spread(surface);
        let Looks { views, counts: mut shares, .. } = looks;
        for row in shares.chunks_exact_mut(views) {
            let total = row.iter().sum::<f32>().max(1.0);
            row.iter_mut().for_each(|share| *share /= total);
        }
        Self { views, spread, shares }
    }

    /// By what the covariance is larger than noise alone would make it, beside errors of the views that were measured.
    #[must_use]
    pub fn inflation(&self) -> f64 {
        if self.spread.is_some() { 1.0 } else { INFLATION }
    }

    /// What these errors add to the covariance of `axis`, by tilt about both tangents \[rad\] and shift along both \[length\],
    /// about the point of the axis.
    ///
    /// Both ends of a match move with the views that saw them, each by its share. Matches that are made anew follow the views as
    /// they follow the axis, so that the pace of matching has no part in it.
    #[must_use]
    pub fn covariance_of_axis(
        &self,
        surface: &Surface,
        axis: &Axis,
        turns: &Turns,
        residual: Residual,
        params: &RefineParams,
    ) -> Matrix4<f64> {
        let samples = &surface.samples.strided(SAMPLES);
        let aligner = Aligner { surface, samples, turns, residual, params };
        let (problem, _) = aligner.problem(axis, aligner.last_gate());
        match &self.spread {
            Some(spread) => self.response_of_axis(&problem, axis, spread),
            None => covariance_of_view_axes(&problem, axis, self),
        }
    }

    fn response_of_axis(&self, problem: &SelfAlignment, axis: &Axis, spread: &Spread) -> Matrix4<f64> {
        let SelfAlignment { surface, samples, .. } = problem;
        let unknowns = Unknowns { axis: *axis, offsets: Vec::new() };
        let leverages = problem.leverages(axis);
        let row = |direction: &Vector3<f64>, point: &Vector3<f64>| {
            rigid_row(direction, &(point - surface.centroid), surface.radius)
        };
        let mut hessian = Matrix4::zeros();
        let mut responses = vec![SMatrix::<f64, 4, 6>::zeros(); self.views];
        for i in 0..samples.points.len() {
            let moved = self.shares(i * surface.len() / samples.points.len());
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
        inverse * spread.scatter(&responses, surface.radius) * inverse
    }

    /// The share of each view in the measurements of a point.
    pub(crate) fn shares(&self, point: usize) -> &[f32] {
        &self.shares[point * self.views..(point + 1) * self.views]
    }
}

impl Spread {
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
        let sum: SMatrix<f64, R, R> = responses.iter().map(of_view).sum();
        sum * uncertain(3 * (self.known - 1))
    }
}

/// Derivative of the height along `normal` by a rigid motion of the point at `arm` from the centroid of the surface: by its shift,
/// and by its rotation about the centroid, as the shift that this is at `radius`.
pub(crate) fn rigid_row(normal: &Vector3<f64>, arm: &Vector3<f64>, radius: f64) -> RowVector6<f64> {
    let moment = arm.cross(normal) / radius;
    RowVector6::new(normal.x, normal.y, normal.z, moment.x, moment.y, moment.z)
}

/// What is known of the error of a view, in a few numbers: the first half of them are of one kind, the others of another.
pub(super) struct ViewEvidence<const R: usize> {
    pub(super) information: SMatrix<f64, R, R>,
    /// The same times the error.
    pub(super) weighted: SVector<f64, R>,
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
    /// From one of `points` of a surface to the next at which heights are compared.
    #[must_use]
    pub fn step(points: usize) -> usize {
        points.div_ceil(COMPARED).max(1)
    }

    /// How far the views are off their places; `None` where hardly any two see the same surface.
    ///
    /// Each view has a rigid error of its own; the heights of its measurements over what all of them say together are linear
    /// in it.
    fn spread(&self, surface: &Surface) -> Option<Spread> {
        /// Outliers are told from noise beside the errors, which are known only once outliers are left out.
        const ROUNDS: usize = 2;
        let mut drawn = Drawn { variances: [0.0; 2], errors: vec![Vector6::zeros(); self.views], known: 0 };
        let mut noise = self.noise(surface, &drawn.errors)?;
        for _ in 0..ROUNDS {
            drawn = draw(&self.evidence(surface, &drawn.errors, noise), surface.radius)?;
            // A view was compared with the others, which are off as well.
            let own = (drawn.known - 1) as f64 / drawn.known as f64;
            drawn.variances = drawn.variances.map(|variance| variance * own);
            drawn.errors.iter_mut().for_each(|error| *error *= own);
            noise = self.noise(surface, &drawn.errors)?;
        }
        let [shift, turn] = drawn.variances.map(f64::sqrt);
        Some(Spread { shift, turn: turn / surface.radius, noise, known: drawn.known })
    }

    /// The points that `view` shares with others.
    fn shared(
        &self,
        view: usize,
        surface: &Surface,
        errors: &[Vector6<f64>],
    ) -> impl Iterator<Item = Shared> {
        let Samples { points, normals } = &surface.samples;
        let step = Self::step(points.len());
        self.heights.chunks_exact(self.views).enumerate().filter_map(move |(compared, heights)| {
            let point = step * compared;
            let counts = &self.counts[point * self.views..(point + 1) * self.views];
            let (point, normal) = (&points[point], &normals[point]);
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
    fn evidence(
        &self,
        surface: &Surface,
        errors: &[Vector6<f64>],
        noise: f64,
    ) -> Vec<Option<ViewEvidence<6>>> {
        let of_view = |view: usize| {
            let (mut information, mut weighted) = (Matrix6::zeros(), Vector6::zeros());
            let step = self.views * Self::step(surface.len());
            let all: f64 = self.counts.iter().skip(view).step_by(step).copied().map(f64::from).sum();
            let mut in_common = 0.0;
            for Shared { row, count, share, height, left } in self.shared(view, surface, errors) {
                in_common += count;
                if left.abs() < OUTLYING * noise {
                    information += row.transpose() * row * (count * (1.0 - share));
                    weighted += row.transpose() * (count * height);
                }
            }
            (in_common > SHARED * all).then(|| ViewEvidence {
                information: information / (noise * noise),
                weighted: weighted / (noise * noise),
            })
        };
        (0..self.views).into_par_iter().map(of_view).collect()
    }
}

/// By how much a variance found from so few `degrees` of freedom is larger to whoever relies on it: that of Student's
/// distribution, three at most.
pub(super) fn uncertain(degrees: usize) -> f64 {
    let degrees = degrees.max(3) as f64;
    degrees / (degrees - 2.0)
}

/// Errors of views as the evidence makes them likely.
pub(super) struct Drawn<const R: usize> {
    /// Of either kind [squared length].
    pub(super) variances: [f64; 2],
    /// Of each view; zero without evidence.
    pub(super) errors: Vec<SVector<f64, R>>,
    /// Number of views with evidence, two or more.
    pub(super) known: usize,
}

/// The errors of views, and their variances; `None` without evidence of two views.
///
/// Errors of all views are drawn from one distribution, whose variances make the evidence most likely (MacKay 1992, Bayesian
/// interpolation): what a view does not show of its error counts for nothing.
pub(super) fn draw<const R: usize>(evidence: &[Option<ViewEvidence<R>>], radius: f64) -> Option<Drawn<R>> {
    /// Errors from which the search begins [radii].
    const START: f64 = 0.01;
    /// Errors that count as none [radii].
    const NOTHING: f64 = 1e-6;
    const ROUNDS: usize = 100;
    /// Change of both variances below which they are found.
    const TOLERANCE: f64 = 0.01;
    /// Numbers below which nothing is determined.
    const LEAST: f64 = 1e-6;
    let half = R / 2;
    let known = evidence.iter().flatten().count();
    if known < 2 {
        return None;
    }
    let least = (NOTHING * radius).powi(2);
    let mut variances = [(START * radius).powi(2); 2];
    let mut errors = vec![SVector::zeros(); evidence.len()];
    for _ in 0..ROUNDS {
        let prior = SMatrix::from_diagonal(&SVector::<f64, R>::from_fn(|i, _| variances[i / half].recip()));
        // How many numbers the evidence determines, and the sum of their squares.
        let (mut determined, mut squares) = ([0.0; 2], [0.0; 2]);
        for (error, of_view) in errors.iter_mut().zip(evidence) {
            let Some(ViewEvidence { information, weighted }) = of_view else { continue };
            let posterior = (information + prior).cholesky()?.inverse();
            *error = posterior * weighted;
            for i in 0..R {
                determined[i / half] += 1.0 - posterior[(i, i)] / variances[i / half];
                squares[i / half] += error[i] * error[i];
            }
        }
        let before = variances;
        variances = std::array::from_fn(|i| {
            if determined[i] > LEAST { (squares[i] / determined[i]).max(least) } else { least }
        });
        if (0..2).all(|i| (variances[i] / before[i] - 1.0).abs() < TOLERANCE) {
            break;
        }
    }
    variances.iter().all(|variance| variance.is_finite()).then_some(Drawn { variances, errors, known })
}

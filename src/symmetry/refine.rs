//! Refinement of an axis: coarse to fine matching, then joint optimisation of the axis and the points.

use nalgebra::{Matrix4, Vector3};
use serde::{Deserialize, Serialize};

use crate::config::Residual;
use crate::control::Control;
use crate::error::Result;
use crate::symmetry::alignment::{Correspondences, SelfAlignment, Unknowns, residuals};
use crate::symmetry::axis::Axis;
use crate::symmetry::order::{Order, Turns};
use crate::symmetry::robust::{Huber, robust_sigma};
use crate::symmetry::solver::{Minimum, RobustProblem, minimize};
use crate::symmetry::surface::{Gate, Samples, Surface};

/// How an axis is refined.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RefineParams {
    /// Rotations used for the axis, at most.
    pub max_turns: usize,
    /// Rotations used for the joint optimisation, at most.
    pub max_joint_turns: usize,
    /// Last gate on the distance of a match [point spacings].
    pub gate: f64,
    /// Largest angle between the normals of a match \[rad\].
    pub max_normal_angle: f64,
    /// Width of Huber's loss [standard deviations of the residual].
    pub huber_width: f64,
    /// Rounds of matching on a part of the points, at most.
    pub max_rounds: usize,
    /// Rounds of matching on all points, at most.
    pub max_full_rounds: usize,
    /// Steps of the joint optimisation, at most.
    pub max_joint_steps: u64,
    /// Motion of the axis below which a round counts as converged [point spacings at the rim].
    pub tolerance: f64,
    /// Weight of a point's own measurement against one match in the joint optimisation.
    pub anchor: f64,
}

impl Default for RefineParams {
    fn default() -> Self {
        Self {
            max_turns: 5,
            max_joint_turns: 6,
            gate: 2.0,
            max_normal_angle: 0.6,
            huber_width: 1.345,
            max_rounds: 30,
            max_full_rounds: 3,
            max_joint_steps: 2,
            tolerance: 1e-3,
            anchor: 1.0,
        }
    }
}

/// An axis refined on a surface.
#[derive(Debug, Clone)]
pub struct Refined {
    /// The axis, held near the centroid of the surface.
    pub axis: Axis,
    /// Displacement of each point \[length\]; empty when the points were held fixed.
    pub offsets: Vec<Vector3<f64>>,
    /// Robust standard deviation of the residuals of the matches \[length\].
    pub sigma: f64,
    /// Share of rotated points that met the surface.
    pub share: f64,
    /// Rounds of matching.
    pub rounds: usize,
    /// Whether the last round moved less than the tolerance.
    pub converged: bool,
    /// J'WJ of the four axis parameters at the solution, for residuals of unit variance.
    pub information: Matrix4<f64>,
    /// Robust joint cost per match before and after the joint optimisation [squared length].
    pub costs: Vec<f64>,
}

/// The gates of a coarse to fine schedule: from `first` to `last`, halving.
fn gates(first: f64, last: f64) -> Vec<f64> {
    let mut gates = vec![last];
    while let Some(&widest) = gates.last()
        && widest * 1.5 < first
    {
        gates.push((widest * 2.0).min(first));
    }
    gates.reverse();
    gates
}

/// Largest motion of the rim between two axes, as an angle times a radius plus a shift \[length\].
fn motion(from: &Axis, to: &Axis, radius: f64) -> f64 {
    let centered = to.recentered(&from.point);
    from.angle_to(to) * radius + (centered.point - from.point).norm()
}

/// Aligns the surface with its own rotated copies, moving only the axis.
///
/// `gates` are the distances \[length\] by which a rotated point may miss the surface, at the start and at the end; the
/// gate halves from one to the other.
///
/// # Errors
/// When the work is cancelled.
#[allow(clippy::too_many_arguments)]
pub fn align(
    surface: &Surface,
    samples: &Samples,
    start: Axis,
    turns: &Turns,
    residual: Residual,
    [first_gate, last_gate]: [f64; 2],
    params: &RefineParams,
    control: &Control,
) -> Result<Refined> {
    let centroid = surface.centroid();
    let radius = rim(surface, &centroid);
    let mut axis = start.recentered(&centroid);
    let mut refined = Refined {
        axis,
        offsets: Vec::new(),
        sigma: 0.0,
        share: 0.0,
        rounds: 0,
        converged: false,
        information: Matrix4::zeros(),
        costs: Vec::new(),
    };
    let schedule = gates(first_gate, last_gate);
    for (level, &distance) in schedule.iter().enumerate() {
        let last = level + 1 == schedule.len();
        let gate = Gate { distance, cosine: params.max_normal_angle.cos() };
        let rounds = if last { params.max_rounds } else { params.max_rounds.min(3) };
        for _ in 0..rounds {
            control.check()?;
            let correspondences = Correspondences::find(surface, samples, &axis, turns, gate);
            let mut found = residuals(surface, samples, &axis, turns, &correspondences, residual);
            let sigma = robust_sigma(&mut found).max(1e-9 * radius);
            let problem = SelfAlignment {
                surface,
                samples,
                turns,
                correspondences: &correspondences,
                residual,
                loss: Huber { width: params.huber_width * sigma },
                anchor: params.anchor,
                max_offset: 0.0,
            };
            let solved = minimize(problem, Unknowns { axis, offsets: Vec::new() }, 1)?;
            let moved = solved.param.axis.recentered(&centroid);
            let step = motion(&axis, &moved, radius);
            axis = moved;
            refined.rounds += 1;
            refined.sigma = sigma;
            refined.share = correspondences.share();
            refined.converged = step < params.tolerance * surface.spacing;
            if refined.converged || (!last && step < 0.1 * distance) {
                break;
            }
        }
    }
    refined.axis = axis;
    Ok(refined)
}

/// The paper's joint optimisation: axis and points together, from an aligned axis. With `joint` false the points stay
/// where they were measured, and only the information about the axis is gathered.
///
/// # Errors
/// When the work is cancelled.
pub fn refine_jointly(
    surface: &Surface,
    aligned: &Refined,
    order: Order,
    residual: Residual,
    joint: bool,
    params: &RefineParams,
    control: &Control,
) -> Result<Refined> {
    let centroid = surface.centroid();
    let radius = rim(surface, &centroid);
    let turns = Turns::all(order, params.max_joint_turns);
    let gate = Gate { distance: params.gate * surface.spacing, cosine: params.max_normal_angle.cos() };
    let offsets = if joint { vec![Vector3::zeros(); surface.len()] } else { Vec::new() };
    let unknowns = Unknowns { axis: aligned.axis, offsets };
    control.check()?;
    let samples = &surface.samples;
    let correspondences = Correspondences::find(surface, samples, &unknowns.axis, &turns, gate);
    let mut found = residuals(surface, samples, &unknowns.axis, &turns, &correspondences, residual);
    let sigma = robust_sigma(&mut found).max(1e-9 * radius);
    let problem = SelfAlignment {
        surface,
        samples,
        turns: &turns,
        correspondences: &correspondences,
        residual,
        loss: Huber { width: params.huber_width * sigma },
        anchor: params.anchor,
        max_offset: surface.spacing,
    };
    let matches = correspondences.count().max(1) as f64;
    let (unknowns, costs, information) = if joint {
        let Minimum { param, costs, hessian } = minimize(problem, unknowns, params.max_joint_steps)?;
        (param, costs, hessian)
    } else {
        let linear = problem.linearize(&unknowns)?;
        (unknowns, [linear.cost; 2], linear.hessian)
    };
    Ok(Refined {
        axis: unknowns.axis.recentered(&centroid),
        offsets: unknowns.offsets,
        sigma,
        share: correspondences.share(),
        information,
        costs: costs.map(|cost| cost / matches).to_vec(),
        ..aligned.clone()
    })
}

/// Root mean square distance of the points from their centroid \[length\].
fn rim(surface: &Surface, centroid: &Vector3<f64>) -> f64 {
    let sum: f64 = surface.samples.points.iter().map(|p| (p - centroid).norm_squared()).sum();
    (sum / surface.len() as f64).sqrt()
}

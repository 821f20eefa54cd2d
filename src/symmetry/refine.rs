//! Refinement of an axis: coarse to fine matching, then joint optimisation of the axis and the points.

use nalgebra::{Unit, Vector3, Vector4};
use serde::{Deserialize, Serialize};

use crate::config::Residual;
use crate::control::Control;
use crate::error::Result;
use crate::symmetry::alignment::{Correspondences, SelfAlignment, Unknowns, residuals};
use crate::symmetry::axis::Axis;
use crate::symmetry::order::Turns;
use crate::symmetry::robust::{HUBER_WIDTH, Huber, robust_sigma};
use crate::symmetry::sandwich::Sandwich;
use crate::symmetry::score::match_score;
use crate::symmetry::settle::Rest;
use crate::symmetry::solver::{Minimum, RobustProblem, minimize};
use crate::symmetry::surface::{Gate, Samples, Surface};
use crate::validate::positive;

/// How an axis is refined.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RefineParams {
    /// Points on which the axis is refined, at most; more of them change less than the noise does (docs/experiments.md).
    pub samples: usize,
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
    /// Weight of a point's own measurement against one match in the joint optimisation; 0.3 measured best
    /// (docs/experiments.md).
    pub anchor: f64,
}

impl Default for RefineParams {
    fn default() -> Self {
        Self {
            samples: 20_000,
            max_turns: 5,
            max_joint_turns: 12,
            gate: 2.0,
            max_normal_angle: 0.6,
            huber_width: HUBER_WIDTH,
            max_rounds: 30,
            max_full_rounds: 12,
            max_joint_steps: 2,
            tolerance: 1e-3,
            anchor: 0.3,
        }
    }
}

impl RefineParams {
    /// Gate with which the refinement begins, on a surface of this point `spacing` \[length\].
    pub(crate) fn first_gate(&self, spacing: f64) -> f64 {
        /// Times as wide as the last one.
        const WIDER: f64 = 6.0;
        WIDER * self.gate * spacing
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
    /// Rounds of matching.
    pub rounds: usize,
    /// What the uncertainty of the four axis parameters is made of.
    pub sandwich: Sandwich,
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

/// Least share of an error that a round is taken to make good.
const LEAST_GAIN: f64 = 0.03;

/// Change from one axis to the next: of the direction at the rim, and of the point \[length\].
#[derive(Debug, Clone, Copy)]
struct Motion {
    rim: Vector3<f64>,
    point: Vector3<f64>,
}

impl Motion {
    /// Both axes must be held by their point nearest to the same centre.
    fn between(from: &Axis, to: &Axis, radius: f64) -> Self {
        let rim = (to.direction.into_inner() - from.direction.into_inner()) * radius;
        Self { rim, point: to.point - from.point }
    }

    fn dot(&self, other: &Self) -> f64 {
        self.rim.dot(&other.rim) + self.point.dot(&other.point)
    }

    fn length(&self) -> f64 {
        self.rim.norm() + self.point.norm()
    }

    /// Share of the motion `before` that is left in this one; `None` unless both have one direction and this one is shorter.
    ///
    /// Noise lets a rotated point always find some neighbour nearby, so each round makes good only a share of the error,
    /// the same share every time.
    fn ratio(&self, before: &Self) -> Option<f64> {
        let (along, before_sq) = (self.dot(before), before.dot(before));
        let share = along / before_sq;
        (along > 0.9 * (before_sq * self.dot(self)).sqrt() && share < 1.0).then_some(share)
    }

    fn applied(&self, axis: &Axis, times: f64, radius: f64) -> Axis {
        let direction = axis.direction.into_inner() + self.rim * (times / radius);
        Axis { direction: Unit::new_normalize(direction), point: axis.point + self.point * times }
    }
}

/// Aligns a surface with its own rotated copies.
#[derive(Debug, Clone, Copy)]
pub struct Aligner<'a> {
    /// The measured surface.
    pub surface: &'a Surface,
    /// The points of it that are rotated.
    pub samples: &'a Samples,
    /// Rotations of the symmetry and their weights.
    pub turns: &'a Turns,
    /// Distance that is minimised.
    pub residual: Residual,
    /// How far and how often.
    pub params: &'a RefineParams,
}

impl<'a> Aligner<'a> {
    /// [`Aligner::align`], then again from starts tilted to either side of what it found; the axis about which most points meet
    /// wins.
    ///
    /// Where it is not known from which side a point was seen, one side of a blade may come to rest on the other, a little
    /// beside the truth.
    ///
    /// # Errors
    /// Those of [`Aligner::align`].
    pub fn align_from_beside(&self, start: Axis, gates: [f64; 2], control: &Control) -> Result<Refined> {
        /// Tilt of these starts \[rad\].
        const TILT: f64 = 0.02;
        /// Matches that another axis must have [those of the best one].
        const BETTER: f64 = 1.02;
        let gate = self.gate(gates[1]);
        let matched = |axis: &Axis| {
            match_score(self.surface, self.samples, axis, self.turns, gate, None.into()).matched as f64
        };
        let mut best = self.align(start, gates, control)?;
        let mut most = matched(&best.axis);
        for [x, y] in [[TILT, 0.0], [-TILT, 0.0], [0.0, TILT], [0.0, -TILT]] {
            let other = self.align(best.axis.retract(&Vector4::new(x, y, 0.0, 0.0)), gates, control)?;
            let count = matched(&other.axis);
            if count > BETTER * most {
                (best, most) = (other, count);
            }
        }
        Ok(best)
    }

    /// Moves only the axis.
    ///
    /// `gates` are the distances \[length\] by which a rotated point may miss the surface, at the start and at the end; the
    /// gate halves from one to the other.
    ///
    /// # Errors
    /// [`Error::InvalidParameter`](crate::Error::InvalidParameter) for a gate that is not positive and finite,
    /// [`Error::Cancelled`](crate::Error::Cancelled), [`Error::DeadlineExceeded`](crate::Error::DeadlineExceeded).
    pub fn align(
        &self,
        start: Axis,
        [first_gate, last_gate]: [f64; 2],
        control: &Control,
    ) -> Result<Refined> {
        let Self { surface: Surface { centroid, radius, spacing, .. }, params, .. } = self;
        // Halved any number of times, no gate comes down to zero.
        positive("gates", first_gate)?;
        positive("gates", last_gate)?;
        let mut axis = start.recentered(centroid);
        let (mut last_sigma, mut rounds_made) = (0.0, 0);
        // Share of an error of the axis that a round makes good, in (0, 1]; the rest is lost to the noise.
        let mut gain = 1.0;
        let schedule = gates(first_gate, last_gate);
        for (level, &distance) in schedule.iter().enumerate() {
            let last = level + 1 == schedule.len();
            let gate = self.gate(distance);
            let rounds = if last { params.max_rounds } else { params.max_rounds.min(3) };
            let mut before: Option<Motion> = None;
            for _ in 0..rounds {
                control.check()?;
                let Round { axis: moved, sigma } = self.round(&axis, gate)?;
                let motion = Motion::between(&axis, &moved, *radius);
                // Under a wide gate the first steps are large and say little about the next ones.
                let ratio = before.filter(|_| last).and_then(|before| motion.ratio(&before));
                if let Some(ratio) = ratio {
                    gain = (1.0 - ratio).clamp(LEAST_GAIN, 1.0);
                }
                // Aitken's extrapolation to where ever shorter steps would end, no farther than matches are looked for.
                let ahead = ratio.map_or(0.0, |ratio| 1.0 / (1.0 - ratio).max(LEAST_GAIN) - 1.0);
                let ahead = ahead.min(distance / motion.length());
                // What is left when each round makes good only a share; an extrapolated step needs one more to say so.
                let step = motion.length() / gain;
                axis = motion.applied(&moved, ahead, *radius).recentered(centroid);
                // An extrapolated step says nothing about the pace.
                before = (ahead == 0.0).then_some(motion);
                (last_sigma, rounds_made) = (sigma, rounds_made + 1);
                if step < params.tolerance * spacing || (!last && step < 0.1 * distance) {
                    break;
                }
            }
        }
        Ok(Refined {
            axis,
            offsets: Vec::new(),
            sigma: last_sigma,
            rounds: rounds_made,
            sandwich: Sandwich::default(),
            costs: Vec::new(),
        })
    }

    /// The paper's joint optimisation: axis and points together, from an aligned axis; then all points of the surface follow
    /// the axis. With `joint` false the points stay where they were measured, and only the information about the axis is
    /// gathered.
    ///
    /// # Errors
    /// [`Error::Cancelled`](crate::Error::Cancelled), [`Error::DeadlineExceeded`](crate::Error::DeadlineExceeded), and
    /// [`Error::InvalidParameter`](crate::Error::InvalidParameter) should the solver library fail by itself.
    pub fn refine_jointly(&self, aligned: &Refined, joint: bool, control: &Control) -> Result<Refined> {
        control.check()?;
        let gate = self.last_gate();
        let (problem, sigma) = self.problem(&aligned.axis, gate);
        let moving = if joint { self.samples.points.len() } else { 0 };
        let unknowns = Unknowns { axis: aligned.axis, offsets: vec![Vector3::zeros(); moving] };
        let (axis, costs, offsets) = if joint {
            let steps = self.params.max_joint_steps;
            let Minimum { param, costs } = minimize(&problem, unknowns, steps)?;
            let axis = param.axis.recentered(&self.surface.centroid);
            control.check()?;
            let SelfAlignment { turns, residual, loss, anchor, max_offset, .. } = problem;
            let rest = Rest { turns, gate, residual, loss, anchor, max_offset, steps };
            (axis, costs, rest.offsets(self.surface, &axis, control)?)
        } else {
            (aligned.axis, [problem.cost(&unknowns)?; 2], Vec::new())
        };
        let matches = problem.correspondences.count().max(1) as f64;
        Ok(Refined {
            axis,
            sandwich: problem.sandwich(&axis),
            offsets,
            sigma,
            costs: costs.map(|cost| cost / matches).to_vec(),
            ..aligned.clone()
        })
    }

    /// Matches once and takes one step.
    pub(super) fn round(&self, axis: &Axis, gate: Gate) -> Result<Round> {
        let (problem, sigma) = self.problem(axis, gate);
        let solved = minimize(&problem, Unknowns { axis: *axis, offsets: Vec::new() }, 1)?;
        Ok(Round { axis: solved.param.axis.recentered(&self.surface.centroid), sigma })
    }

    /// The matches about `axis`, with a loss as wide as they scatter: their robust standard deviation \[length\].
    pub(super) fn problem(&self, axis: &Axis, gate: Gate) -> (SelfAlignment<'a>, f64) {
        let Self { surface, samples, turns, residual, params } = *self;
        let correspondences = Correspondences::find(surface, samples, axis, turns, gate);
        let mut found = residuals(surface, samples, axis, turns, &correspondences, residual);
        let sigma = robust_sigma(&mut found).max(1e-9 * surface.radius);
        let loss = Huber { width: params.huber_width * sigma };
        let (anchor, max_offset) = (params.anchor, surface.spacing);
        let problem =
            SelfAlignment { surface, samples, turns, correspondences, residual, loss, anchor, max_offset };
        (problem, sigma)
    }

    /// The gate on which the refinement ends.
    pub(super) fn last_gate(&self) -> Gate {
        self.gate(self.params.gate * self.surface.spacing)
    }

    fn gate(&self, distance: f64) -> Gate {
        Gate::new(distance, self.params.max_normal_angle.cos())
    }
}

/// An axis after one round of matching.
pub(super) struct Round {
    /// Held by its point nearest to the centroid of the surface.
    pub(super) axis: Axis,
    /// Robust standard deviation of the residuals before the step \[length\].
    sigma: f64,
}

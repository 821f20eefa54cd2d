//! Axis and order together: axes proposed under several orders, each asked for the order that it really has.

use std::f64::consts::TAU;

use nalgebra::Vector3;
use rayon::prelude::*;

use crate::control::Control;
use crate::error::Result;
use crate::symmetry::axis::Axis;
use crate::symmetry::detect::{DetectParams, detect_order};
use crate::symmetry::order::{Order, Turns};
use crate::symmetry::propose::{Proposal, ProposeParams, is_admitted, outline_center, propose};
use crate::symmetry::revolution::axis_of_revolution;
use crate::symmetry::score::{MatchScore, match_score};
use crate::symmetry::sight::Sight;
use crate::symmetry::surface::{Gate, Surface};
use crate::symmetry::sweep::{SURVEY_ORDER, Turning, Witness};
use crate::symmetry::visibility::Visibility;

/// Orders under which axes are proposed when none is known: small primes, whose multiples they also find, and turns
/// that share no small divisor, which find high orders and surfaces of revolution.
pub const HYPOTHESES: [Order; 5] =
    [Order::Cyclic(2), Order::Cyclic(3), Order::Cyclic(5), Order::Cyclic(7), Order::Continuous];

/// Orders for a second search where these lead to none: those of fans, whose blades often have such a number against
/// resonance, and hardly meet themselves under other turns.
pub const LARGER_HYPOTHESES: [Order; 4] =
    [Order::Cyclic(11), Order::Cyclic(13), Order::Cyclic(17), Order::Cyclic(19)];

/// Proposals of each hypothesis that are asked for their order.
const ASKED: usize = 3;

/// The most points and axes of each round of a hypothesis.
const OPEN_SAMPLES: [usize; 3] = [120, 250, 600];
const OPEN_KEPT: [usize; 3] = [12, 5, ASKED];

/// The most points on which the order of a proposed axis is found.
const QUICK: usize = 250;

/// Points on which axes that were not proposed by turns are judged.
const JUDGED: usize = 1000;

/// Rotations under which axes are proposed where several views show the part.
const SEVERAL_VIEWS_TURNS: usize = 3;

/// An axis is as good as the best one when its score reaches this share of it.
const EQUALLY_GOOD: f64 = 0.85;

/// The same where several views show the part: turns of a larger group take more of it out of sight, on a table above all,
/// and with little in sight that contradicts them a larger group found by chance is rare.
pub(crate) const EQUALLY_GOOD_SEVERAL: f64 = 0.72;

/// The same where no viewpoint is known, so that hidden surface counts as missing.
const EQUALLY_GOOD_UNSEEN: f64 = 0.6;

/// The same where the order of the axis follows from half turns that are as good as the best.
const FOLLOWING: f64 = 0.6;

/// Everything the search needs beside the surface.
#[derive(Clone, Copy)]
pub struct SearchContext<'a> {
    /// Size of the part \[length\].
    pub diameter: f64,
    /// Directions worth a try: the normal of the support plane.
    pub hints: &'a [Vector3<f64>],
    /// A direction that the axis must stay near.
    pub within: Option<Vector3<f64>>,
    /// What the cameras saw to be empty.
    pub visibility: Option<&'a Visibility>,
    /// How axes are proposed.
    pub propose: &'a ProposeParams,
    /// How orders are found.
    pub detect: &'a DetectParams,
    /// What a match may differ in.
    pub gate: Gate,
    /// Cancellation and deadline.
    pub control: &'a Control,
}

impl SearchContext<'_> {
    fn admits(&self, axis: &Axis, surface: &Surface) -> bool {
        is_admitted(axis, &surface.centroid, self.diameter, self.within, self.propose)
    }

    /// How well the surface meets itself under the turns of an order.
    fn score(&self, surface: &Surface, axis: &Axis, order: Order, sight: Sight<'_>) -> MatchScore {
        let turns = Turns::half(order, self.propose.max_turns);
        match_score(surface, &surface.samples.strided(JUDGED), axis, &turns, self.gate, sight)
    }

    /// Whether two axes are so near each other that the order of one is that of the other.
    fn is_same(&self, known: &Axis, other: &Axis) -> bool {
        known.angle_to(other) < 0.02 && known.distance(&other.point) < 0.01 * self.diameter
    }
}

/// An axis with the order that it was proposed or found to have; `None` when no rotation about it fits.
#[derive(Debug, Clone)]
pub struct Found {
    /// Axis and score.
    pub proposal: Proposal,
    /// Order.
    pub order: Option<Order>,
    /// The order whose turns aligned the axis.
    pub hypothesis: Order,
    /// Share of the observed surface that the order explains.
    pub explained: f64,
}

/// Axes under a known order, best first.
///
/// # Errors
/// Those of [`propose`].
pub fn search_known(surface: &Surface, order: Order, context: &SearchContext<'_>) -> Result<Vec<Found>> {
    let mut proposals = propose_under(surface, order, context)?;
    if order == Order::Continuous && context.propose.search {
        lead_by_normals(&mut proposals, surface, context);
    }
    let found = proposals.into_iter().map(|proposal| {
        let explained = proposal.score.explained();
        Found { proposal, order: Some(order), hypothesis: order, explained }
    });
    Ok(found.collect())
}

/// Puts the axis that all normals meet first where it is about as good as the best of the `proposals`: from one view any
/// axis through the middle of a ball seems to explain all but what sticks out of it.
fn lead_by_normals(proposals: &mut Vec<Proposal>, surface: &Surface, context: &SearchContext<'_>) {
    let Some(axis) = axis_of_revolution(surface).filter(|axis| context.admits(axis, surface)) else { return };
    let score = context.score(surface, &axis, Order::Continuous, context.visibility.into());
    let best = proposals.first().map_or(0.0, |proposal| proposal.score.value());
    if score.value() >= EQUALLY_GOOD * best {
        proposals.insert(0, Proposal { axis, score });
    }
}

/// Axes and orders, best first, from axes proposed under each of the `hypotheses`: of those that explain the data about equally
/// well, the one with the largest group.
///
/// A dihedral part has two-fold axes across its main one that match as well; the largest group tells them apart, and so does
/// an order that follows from two of them.
///
/// # Errors
/// Those of [`propose`].
pub fn search_unknown(
    surface: &Surface,
    hypotheses: &[Order],
    context: &SearchContext<'_>,
) -> Result<Vec<Found>> {
    let quick = DetectParams {
        max_order: context.detect.max_order.min(SURVEY_ORDER),
        samples: context.detect.samples.min(QUICK),
        ring_samples: context.detect.ring_samples.min(QUICK),
        ..context.detect.clone()
    };
    // What one view shows of a part is little evidence, and all of it is needed.
    let several = context.visibility.is_some_and(|v| v.views() > 1);
    let params = ProposeParams {
        max_turns: context.propose.max_turns.min(if several { SEVERAL_VIEWS_TURNS } else { usize::MAX }),
        samples: least(context.propose.samples, OPEN_SAMPLES),
        kept: least(context.propose.kept, OPEN_KEPT),
        ..context.propose.clone()
    };
    let context = SearchContext { propose: &params, ..*context };
    let mut proposed: Vec<(Axis, Order)> = Vec::new();
    for &hypothesis in hypotheses {
        let proposals = propose_under(surface, hypothesis, &context)?;
        proposed.extend(proposals.into_iter().map(|proposal| (proposal.axis, hypothesis)));
    }
    let admitted = |axes: Vec<Axis>| {
        let admitted = axes.into_iter().filter(|axis| context.admits(axis, surface));
        admitted.map(|axis| (axis, Order::Continuous)).collect::<Vec<_>>()
    };
    let mut found: Vec<Found> = Vec::new();
    consider(&mut found, surface, proposed, &quick, &context)?;
    if context.propose.search {
        let derived = centered(&found, surface).into_iter().chain(axis_of_revolution(surface)).collect();
        consider(&mut found, surface, admitted(derived), &quick, &context)?;
    }
    // The main axis of a dihedral part, and one of an order without a divisor among those asked for: a gear of 37 teeth.
    let thorough = DetectParams { max_order: context.detect.max_order, ..quick.clone() };
    let main = admitted(across(&found).into_iter().chain(without_order(&found, surface, &context)).collect());
    found.retain(|f| {
        f.order.is_some() || main.iter().all(|(axis, _)| !context.is_same(axis, &f.proposal.axis))
    });
    consider(&mut found, surface, main, &thorough, &context)?;
    let best =
        found.iter().filter(|f| f.order.is_some()).map(|f| f.proposal.score.value()).fold(0.0, f64::max);
    let equally_good = match context.visibility {
        _ if several => EQUALLY_GOOD_SEVERAL,
        Some(_) => EQUALLY_GOOD,
        None => EQUALLY_GOOD_UNSEEN,
    };
    let half_turns: Vec<Axis> = (found.iter())
        .filter(|f| f.order == Some(Order::Cyclic(2)) && f.proposal.score.value() >= equally_good * best)
        .map(|f| f.proposal.axis)
        .collect();
    let rank = |f: &Found| {
        let score = f.proposal.score.value();
        let follows = score >= FOLLOWING * best && follows_from_half_turns(f, &half_turns, context.diameter);
        let good = f.order.is_some() && (score >= equally_good * best || follows);
        let group = if good { f.order.map_or(0, group_size) } else { 0 };
        (f.order.is_some(), group)
    };
    found.sort_by(|a, b| {
        rank(b).cmp(&rank(a)).then(b.proposal.score.value().total_cmp(&a.proposal.score.value()))
    });
    Ok(found)
}

/// The smaller of two numbers, three times.
fn least(given: [usize; 3], enough: [usize; 3]) -> [usize; 3] {
    std::array::from_fn(|i| given[i].min(enough[i]))
}

/// Asks axes for their orders, but those that are known already; each comes with the order that it was proposed under.
fn consider(
    found: &mut Vec<Found>,
    surface: &Surface,
    proposed: Vec<(Axis, Order)>,
    quick: &DetectParams,
    context: &SearchContext<'_>,
) -> Result<()> {
    let mut distinct: Vec<(Axis, Order)> = Vec::new();
    for (axis, hypothesis) in proposed {
        let mut known = found.iter().map(|f| &f.proposal.axis).chain(distinct.iter().map(|(axis, _)| axis));
        if !known.any(|known| context.is_same(known, &axis)) {
            distinct.push((axis, hypothesis));
        }
    }
    let ask = |(axis, hypothesis): (Axis, Order)| {
        context.control.check()?;
        let sight = Sight::about(&axis, surface, context.visibility);
        let (gate, witness, control) = (context.gate, Witness::Cameras, context.control);
        let turning = Turning { surface, axis: &axis, gate, sight, witness, control };
        let detection = detect_order(&turning, quick)?;
        let score = context.score(surface, &axis, detection.order.unwrap_or(hypothesis), sight);
        Ok(Found {
            proposal: Proposal { axis, score },
            order: detection.order,
            hypothesis,
            explained: detection.explained,
        })
    };
    found.extend(distinct.into_par_iter().map(ask).collect::<Result<Vec<Found>>>()?);
    Ok(())
}

/// Axes across the best pairs of two-fold axes: half turns about two lines make a turn about the line across both, so
/// that where there are two, a dihedral part has its main axis.
fn across(found: &[Found]) -> Vec<Axis> {
    /// Two-fold axes that are paired.
    const PAIRED: usize = 4;
    /// Least sine of the angle between them.
    const APART: f64 = 0.1;
    let mut folds: Vec<&Found> = found.iter().filter(|f| f.order == Some(Order::Cyclic(2))).collect();
    folds.sort_by(|a, b| b.proposal.score.value().total_cmp(&a.proposal.score.value()));
    let axes: Vec<&Axis> = folds.iter().take(PAIRED).map(|f| &f.proposal.axis).collect();
    let mut main = Vec::new();
    for (i, a) in axes.iter().enumerate() {
        for b in &axes[..i] {
            let normal = a.direction.cross(&b.direction);
            // Where the first axis comes nearest to the second one.
            let along = (b.point - a.point).cross(&b.direction).dot(&normal) / normal.norm_squared();
            let crossing = a.point + a.direction.into_inner() * along;
            main.extend((normal.norm() > APART).then(|| Axis::new(normal, crossing)).flatten());
        }
    }
    main
}

/// Whether the order of an axis follows, in part at least, from half turns that hold about two axes across it: one after the
/// other they turn by twice the angle between these axes.
fn follows_from_half_turns(main: &Found, half_turns: &[Axis], diameter: f64) -> bool {
    /// Cosine of the angle between lines that are across one another.
    const ACROSS: f64 = 0.02;
    /// Distance between lines that meet [diameters].
    const MEETING: f64 = 0.01;
    /// What the angle of a turn may be off \[rad\].
    const OFF: f64 = 0.01;
    let Some(Order::Cyclic(n)) = main.order else { return false };
    let axis = &main.proposal.axis;
    let is_across = |other: &&Axis| {
        let normal = axis.direction.cross(&other.direction);
        axis.direction.dot(&other.direction).abs() < ACROSS
            && (other.point - axis.point).dot(&normal).abs() < MEETING * diameter
    };
    let across: Vec<&Axis> = half_turns.iter().filter(is_across).collect();
    let step = TAU / f64::from(n);
    let is_of_order = |a: &Axis, b: &Axis| {
        let turn = 2.0 * a.angle_to(b);
        let steps = (turn / step).round();
        // Half a turn, which is all that axes at right angles make, says nothing of an order beyond two.
        (turn - steps * step).abs() < OFF && steps >= 1.0 && 2.0 * steps < f64::from(n)
    };
    across.iter().enumerate().any(|(i, a)| across[..i].iter().any(|b| is_of_order(a, b)))
}

/// The best directions through the middle of the outline: turns of a wrong order align a direction, but where a part of the
/// outline is missing they pull the axis aside.
fn centered(found: &[Found], surface: &Surface) -> Vec<Axis> {
    /// Directions that are tried.
    const TRIED: usize = 6;
    /// Angle between them \[rad\].
    const APART: f64 = 0.05;
    through_middle(&directions(found.iter().collect(), TRIED, APART), surface)
}

/// The same for directions about which no order was found, but the surface agrees at most angles.
fn without_order(found: &[Found], surface: &Surface, context: &SearchContext<'_>) -> Vec<Axis> {
    const TRIED: usize = 6;
    const APART: f64 = 0.02;
    /// Share of the surface that agrees at some order, and score under rotations by any angle.
    const AGREEING: (f64, f64) = (0.7, 0.5);
    let has_order = |axis: &Axis| {
        let mut known = found.iter().filter(|f| f.order.is_some()).map(|f| &f.proposal.axis);
        known.any(|known| known.angle_to(axis) < APART)
    };
    let unknown = found.iter().filter(|f| f.explained > AGREEING.0 && !has_order(&f.proposal.axis)).collect();
    let mut axes = through_middle(&directions(unknown, TRIED, APART), surface);
    let sight = |axis: &Axis| Sight::about(axis, surface, context.visibility);
    axes.retain(|axis| context.score(surface, axis, Order::Continuous, sight(axis)).value() > AGREEING.1);
    axes
}

/// The axes of the best scores, each in a direction of its own.
fn directions(mut found: Vec<&Found>, count: usize, apart: f64) -> Vec<&Axis> {
    found.sort_by(|a, b| b.proposal.score.value().total_cmp(&a.proposal.score.value()));
    let mut distinct: Vec<&Axis> = Vec::new();
    for axis in found.into_iter().map(|f| &f.proposal.axis) {
        if distinct.len() < count && distinct.iter().all(|known| known.angle_to(axis) > apart) {
            distinct.push(axis);
        }
    }
    distinct
}

/// Lines in the directions of some axes, through the middle of the outline along each.
fn through_middle(axes: &[&Axis], surface: &Surface) -> Vec<Axis> {
    /// Points of the outline.
    const OUTLINE: usize = 2000;
    let points = surface.samples.strided(OUTLINE).points;
    axes.iter().map(|axis| Axis { point: outline_center(&points, axis), ..**axis }).collect()
}

/// Rotations of a group, for comparing groups; those of a surface of revolution are without number.
#[must_use]
pub fn group_size(order: Order) -> u32 {
    match order {
        Order::Cyclic(n) => n,
        Order::Continuous => u32::MAX,
        Order::Auto => 0,
    }
}

fn propose_under(surface: &Surface, order: Order, context: &SearchContext<'_>) -> Result<Vec<Proposal>> {
    propose(surface, &Turns::half(order, context.propose.max_turns), context)
}

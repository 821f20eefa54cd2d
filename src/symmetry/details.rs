//! Details that lower a symmetry: bolt holes on a disc, or on a sprocket with many more teeth.
//!
//! They cover so little of their ring that few of its points meet them at any one angle, and their evidence drowns in that of the
//! rest. So each ring is asked alone whether something contradicts the group that holds for all the others, and where it does,
//! which part of the group holds there. A keyway, or a single boss, leaves none.

use std::collections::{BTreeSet, HashMap, HashSet};

use rayon::prelude::*;

use crate::error::Result;
use crate::symmetry::axis::Turn;
use crate::symmetry::detect::{BY_CHANCE, DetectParams, largest_group};
use crate::symmetry::misfit::is_misfit;
use crate::symmetry::order::{Order, Turns};
use crate::symmetry::rings::{Ring, Rings};
use crate::symmetry::surface::{Gate, Samples};
use crate::symmetry::sweep::{Sweep, Tally, Turned, Turning, Witness, fraction};
use crate::symmetry::walls::walls;

/// Details that contradict the group that holds for all the rest.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Details {
    /// A part of the group holds for them, too.
    OfOrder {
        /// The order of that part.
        order: u32,
        /// The larger one of all but these details.
        rest: Order,
        /// Whether so little is known of them that, of all orders, it may hold by chance.
        faint: bool,
    },
    /// None does: a keyway, a missing tooth, a recess in one end of a plate, or teeth that are finer than the orders that are
    /// looked for, or whose number is not certain.
    OfNone,
}

/// Points of the rings with details that are asked.
pub(super) const SAMPLES: usize = 1500;

/// Distance of a match beside that elsewhere: the rim of a hole must not match what comes to lie in it, and where there is a
/// surface no ray goes on behind it, so that nothing speaks against points that miss it.
const NARROW: f64 = 0.7;

/// Rotations of a group by which the rings with details are found, at most.
const TURNS: usize = 24;

/// The details that contradict a group `order` which holds otherwise, as the cameras see it.
///
/// # Errors
/// [`Error::Cancelled`](crate::Error::Cancelled), [`Error::DeadlineExceeded`](crate::Error::DeadlineExceeded).
pub(crate) fn contradicting_details(
    turning: &Turning<'_>,
    order: Order,
    params: &DetectParams,
) -> Result<Option<Details>> {
    /// Points that are asked, and for how many rotations of them at least.
    const ASKED: usize = 5000;
    const ROTATED: usize = 30_000;
    const LIMITS: Limits =
        Limits { contradicted: (0.006, 8.0), left: 0.25, expected: 12.0, beside: 0.0, support: 0.0 };
    let turning = narrow(turning, Witness::Cameras);
    let surface = &turning.surface.samples;
    let turns = turns_of(order, &turning);
    let asked = surface.strided(ASKED.max(ROTATED / turns.len()));
    let rings = Rings::about(turning.axis, &asked);
    let with_details = rings_with_details(&turning, &turns, (&rings, &asked), LIMITS.contradicted);
    let samples = rings.within(&with_details, surface, SAMPLES);
    let Some(told) = what_they_tell(&turning, order, &samples, &LIMITS, params)? else { return Ok(None) };
    let is_misfit = || is_misfit(&turning, order, &rings, &with_details, &told.against);
    Ok(told.of_order.or_else(|| is_misfit().then_some(Details::OfNone)))
}

/// The same, as its walls show it: slots so narrow that no camera sees through them, and ribs as narrow.
///
/// # Errors
/// [`Error::Cancelled`](crate::Error::Cancelled), [`Error::DeadlineExceeded`](crate::Error::DeadlineExceeded).
pub(crate) fn contradicting_walls(
    turning: &Turning<'_>,
    order: Order,
    params: &DetectParams,
) -> Result<Option<Details>> {
    /// Points that are asked, at least, and rotations of them.
    const ASKED: usize = 2000;
    const ROTATED: usize = 200_000;
    // What is flat seldom contradicts a wall by chance, and of a discrete group there are few parts.
    let expected = if order == Order::Continuous { 12.0 } else { 8.0 };
    let limits =
        Limits { contradicted: (0.03, 3.0), left: 0.1, expected, beside: 0.5, support: params.support };
    let turning = narrow(turning, Witness::Flats);
    let turns = turns_of(order, &turning);
    let walls = walls(turning.surface, turning.axis, ASKED.max(ROTATED / turns.len()));
    let rings = Rings::about(turning.axis, &walls);
    let with_details = rings_with_details(&turning, &turns, (&rings, &walls), limits.contradicted);
    // A sweep turns every second point the other way; of so few each has to go both ways.
    let samples = rings.within(&with_details, &walls, SAMPLES).twice();
    let told = what_they_tell(&turning, order, &samples, &limits, params)?;
    Ok(told.and_then(|told| told.of_order))
}

/// The same turning with another `witness`, and matches nearer than elsewhere.
fn narrow<'a>(turning: &Turning<'a>, witness: Witness) -> Turning<'a> {
    let gate = Gate { distance: NARROW * turning.gate.distance, ..turning.gate };
    Turning { gate, witness, ..*turning }
}

/// Rotations of a group, at most [`TURNS`] of them.
fn turns_of(order: Order, turning: &Turning<'_>) -> Vec<Turn> {
    Turns::all(order, TURNS).angles().map(|angle| turning.axis.turn(angle)).collect()
}

/// What counts as a detail, and what a part of the group must have that holds for details.
#[derive(Debug, Clone, Copy)]
struct Limits {
    /// Share of the evidence in a ring with details that speaks against the group, and the amount of it, more than that.
    contradicted: (f64, f64),
    /// Share of the evidence against the group that may speak against the part, on average.
    left: f64,
    /// Evidence against the part that there would be if it held no better than the group, at least.
    expected: f64,
    /// Share of the evidence against the group that must speak against one order more and one less than the part, of a surface of
    /// revolution: where few teeth are in sight, either fits about as well.
    beside: f64,
    /// [`OrderEvidence::support`](crate::symmetry::sweep::OrderEvidence::support) of the part, at least.
    support: f64,
}

/// The rings in which something speaks against the group, of those of the points that are `asked`.
fn rings_with_details(
    turning: &Turning<'_>,
    turns: &[Turn],
    (rings, asked): (&Rings, &Samples),
    (share, evidence): (f64, f64),
) -> HashSet<Ring> {
    let found: Vec<Tally> = (asked.points.par_iter().zip(&asked.normals))
        .map(|(point, normal)| {
            let mut tally = Tally::default();
            turns.iter().for_each(|turn| tally.add(turning.outcome(point, normal, turn)));
            tally
        })
        .collect();
    let mut tallies: HashMap<Ring, Tally> = HashMap::new();
    for (point, tally) in asked.points.iter().zip(&found) {
        tallies.entry(rings.of(point)).or_default().merge(tally);
    }
    let has_details = |tally: &Tally| tally.share_against() > share && tally.against() > evidence;
    tallies.into_iter().filter(|(_, tally)| has_details(tally)).map(|(ring, _)| ring).collect()
}

/// What points of rings with details tell.
struct Told {
    /// Evidence against the group.
    against: Tally,
    /// The part of the group that holds for them.
    of_order: Option<Details>,
}

/// Asks points of rings with details for the parts of a group; `None` where too little speaks against it.
fn what_they_tell(
    turning: &Turning<'_>,
    order: Order,
    samples: &Samples,
    limits: &Limits,
    params: &DetectParams,
) -> Result<Option<Told>> {
    if samples.points.is_empty() {
        return Ok(None);
    }
    let (fractions, parts): (Vec<_>, Vec<u32>) = match order {
        Order::Cyclic(n) => {
            let fractions: BTreeSet<(u32, u32)> = (1..=n / 2).map(|k| fraction(k, n)).collect();
            (fractions.into_iter().collect(), (2..n).filter(|&part| n.is_multiple_of(part)).collect())
        }
        _ => (params.fractions(), (2..=params.max_order).collect()),
    };
    let sweep = Sweep::new(turning, samples, fractions, Turned::All)?;
    let everything: Vec<usize> = (0..samples.points.len()).collect();
    let against = match order {
        Order::Cyclic(n) => sweep.order(n, &everything).sum,
        _ => sweep.generic(&everything),
    };
    let share = against.share_against();
    if share * against.total() < limits.expected {
        return Ok(None);
    }
    let is_alone = |part: u32| {
        let against = |order: u32| sweep.order(order, &everything).sum.share_against();
        order != Order::Continuous
            || [part - 1, part + 1].iter().all(|&beside| against(beside) >= limits.beside * share)
    };
    let part = part_that_holds(&sweep, &everything, &parts, share, limits).filter(|&part| is_alone(part));
    let of_order = part.map(|part| {
        let expected = share * sweep.order(part, &everything).sum.total();
        // Of a discrete group there are few parts.
        let faint = order == Order::Continuous && expected < BY_CHANCE;
        Details::OfOrder { order: part, rest: order, faint }
    });
    Ok(Some(Told { against, of_order }))
}

/// The largest of the `parts` of the group that holds for the details, too: little speaks against it, and enough would if the same
/// `share` did as against the whole group.
fn part_that_holds(
    sweep: &Sweep,
    samples: &[usize],
    parts: &[u32],
    share: f64,
    limits: &Limits,
) -> Option<u32> {
    /// Share of the evidence against the group that may speak against a part of it at the worst angle.
    const WORST: f64 = 0.5;
    /// How much more evidence a half turn needs, which has only one angle to be contradicted at.
    const HALF_TURN: f64 = 1.5;
    let expected = |part: u32| if part == 2 { HALF_TURN * limits.expected } else { limits.expected };
    let holding: Vec<(u32, f64)> = (parts.iter())
        .map(|&part| (part, sweep.order(part, samples)))
        .filter(|(part, evidence)| {
            evidence.sum.share_against() < limits.left * share
                && evidence.worst < WORST * share
                && evidence.support >= limits.support
                && share * evidence.sum.total() > expected(*part)
        })
        .map(|(part, evidence)| (part, evidence.sum.share_against()))
        .collect();
    largest_group(&holding).map(|(part, _)| part)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::Control;
    use crate::symmetry::sight::Sight;
    use crate::symmetry::sweep::tests::sweep;
    use crate::symmetry::sweep::up_to;
    use crate::symmetry::walls::tests::{axis, slotted};

    #[test]
    fn a_half_turn_needs_more_evidence_than_other_turns() {
        let all_but = |fraction| -> Vec<(u32, u32)> {
            up_to(6).into_iter().filter(|other| *other != fraction).collect()
        };
        // A share of 0.1 of `samples` contradictions would be expected.
        let limits =
            Limits { contradicted: (0.0, 0.0), left: 0.25, expected: 12.0, beside: 0.0, support: 0.2 };
        let holding = |fraction, samples: usize| {
            part_that_holds(&sweep(6, &all_but(fraction)), &vec![0; samples], &[2, 3], 0.1, &limits)
        };
        assert_eq!(holding((1, 3), 115), None);
        assert_eq!(holding((1, 3), 140), Some(3));
        assert_eq!(holding((1, 2), 140), None);
        assert_eq!(holding((1, 2), 200), Some(2));
    }

    #[test]
    fn walls_tell_which_part_of_a_group_slots_have() -> Result<()> {
        let (axis, control, params) = (axis(), Control::default(), DetectParams::default());
        let found = |slots: u32, order: Order| {
            let surface = &slotted(slots);
            let spacing = surface.spacing;
            let gate = Gate { off_plane: 1.1 * spacing, ..Gate::new(1.9 * spacing, 0.8) };
            let (sight, witness) = (Sight::from(None), Witness::Cameras);
            let turning = Turning { surface, axis: &axis, gate, sight, witness, control: &control };
            contradicting_walls(&turning, order, &params)
        };
        let of = |order: u32, rest: Order| Some(Details::OfOrder { order, rest, faint: false });
        assert_eq!(found(4, Order::Cyclic(8))?, of(4, Order::Cyclic(8)));
        assert_eq!(found(5, Order::Cyclic(15))?, of(5, Order::Cyclic(15)));
        assert_eq!(found(6, Order::Continuous)?, of(6, Order::Continuous));
        assert_eq!(found(6, Order::Cyclic(6))?, None);
        // No part of the group has them.
        assert_eq!(found(4, Order::Cyclic(9))?, None);
        assert_eq!(found(0, Order::Continuous)?, None);
        Ok(())
    }
}

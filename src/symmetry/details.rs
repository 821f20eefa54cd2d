//! Details that lower a symmetry: bolt holes on a disc, or on a sprocket with many more teeth.
//!
//! They cover so little of their ring that few of its points meet them at any one angle, and their evidence drowns in that of the
//! rest. So each ring is asked alone whether something contradicts the group that holds for all the others, and where it does,
//! which part of the group holds there. A keyway, or a single boss, leaves none.

use std::collections::{BTreeSet, HashMap, HashSet};
use std::f64::consts::TAU;

use rayon::prelude::*;

use crate::error::Result;
use crate::symmetry::axis::Turn;
use crate::symmetry::detect::{BY_CHANCE, DetectParams, largest_group};
use crate::symmetry::order::{Order, Turns};
use crate::symmetry::rings::{Ring, Rings};
use crate::symmetry::score::Outcome;
use crate::symmetry::surface::{Gate, Samples};
use crate::symmetry::sweep::{Sweep, Tally, Turned, Turning, fraction};

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
const SAMPLES: usize = 1500;

/// Evidence against a group that there would have to be if it held no better than the whole one.
const EXPECTED: f64 = 12.0;

/// The details that contradict a group `order` which holds otherwise.
///
/// # Errors
/// [`Error::Cancelled`](crate::Error::Cancelled), [`Error::DeadlineExceeded`](crate::Error::DeadlineExceeded).
pub(crate) fn contradicting_details(
    turning: &Turning<'_>,
    order: Order,
    params: &DetectParams,
) -> Result<Option<Details>> {
    /// Distance of a match beside that elsewhere: the rim of a hole must not match what comes to lie in it, and where there is
    /// a surface no ray goes on behind it, so that nothing speaks against points that miss it.
    const NARROW: f64 = 0.7;
    let gate = Gate { distance: NARROW * turning.gate.distance, ..turning.gate };
    let turning = Turning { gate, ..*turning };
    let (rings, with_details) = rings_with_details(&turning, order);
    if with_details.is_empty() {
        return Ok(None);
    }
    let samples = rings.within(&with_details, &turning.surface.samples, SAMPLES);
    let (fractions, parts): (Vec<_>, Vec<u32>) = match order {
        Order::Cyclic(n) => {
            let fractions: BTreeSet<(u32, u32)> = (1..=n / 2).map(|k| fraction(k, n)).collect();
            (fractions.into_iter().collect(), (2..n).filter(|&part| n.is_multiple_of(part)).collect())
        }
        _ => (params.fractions(), (2..=params.max_order).collect()),
    };
    let sweep = Sweep::new(&turning, &samples, fractions, Turned::All)?;
    let everything: Vec<usize> = (0..samples.points.len()).collect();
    let against = match order {
        Order::Cyclic(n) => sweep.order(n, &everything).sum,
        _ => sweep.generic(&everything),
    };
    if against.share_against() * against.total() < EXPECTED {
        return Ok(None);
    }
    Ok(match part_that_holds(&sweep, &everything, &parts, against.share_against()) {
        Some(part) => {
            let expected = against.share_against() * sweep.order(part, &everything).sum.total();
            // Of a discrete group there are few parts.
            let faint = order == Order::Continuous && expected < BY_CHANCE;
            Some(Details::OfOrder { order: part, rest: order, faint })
        }
        None => is_misfit(&turning, order, &rings, &with_details, &against).then_some(Details::OfNone),
    })
}

/// All rings, and those in which something speaks against the group.
fn rings_with_details(turning: &Turning<'_>, order: Order) -> (Rings, HashSet<Ring>) {
    /// Points that are asked, and for how many rotations of them at least; rotations of a surface of revolution.
    const ASKED: usize = 5000;
    const ROTATED: usize = 30_000;
    const TURNS: usize = 24;
    /// Share of the evidence in a ring that must speak against the group, and the least amount of it.
    const CONTRADICTED: (f64, f64) = (0.006, 8.0);
    let turns: Vec<_> = Turns::all(order, TURNS).angles().map(|angle| turning.axis.turn(angle)).collect();
    let asked = turning.surface.samples.strided(ASKED.max(ROTATED / turns.len()));
    let rings = Rings::about(turning.axis, &asked);
    let evidence: Vec<Tally> = (asked.points.par_iter().zip(&asked.normals))
        .map(|(point, normal)| {
            let mut tally = Tally::default();
            turns.iter().for_each(|turn| tally.add(turning.outcome(point, normal, turn)));
            tally
        })
        .collect();
    let mut tallies: HashMap<Ring, Tally> = HashMap::new();
    for (point, tally) in asked.points.iter().zip(&evidence) {
        tallies.entry(rings.of(point)).or_default().merge(tally);
    }
    let contradicted =
        |tally: &Tally| tally.share_against() > CONTRADICTED.0 && tally.against() > CONTRADICTED.1;
    let with_details = tallies.into_iter().filter(|(_, tally)| contradicted(tally)).map(|(ring, _)| ring);
    (rings, with_details.collect())
}

/// The largest of the `parts` of the group that holds for the details, too: little speaks against it, and [`EXPECTED`] would if
/// the same `share` did as against the whole group.
fn part_that_holds(sweep: &Sweep, samples: &[usize], parts: &[u32], share: f64) -> Option<u32> {
    /// Share of the evidence against the group that may speak against a part of it, on average and at the worst angle.
    const LEFT: [f64; 2] = [0.25, 0.5];
    /// How much more evidence a half turn needs, which has only one angle to be contradicted at.
    const HALF_TURN: f64 = 1.5;
    let expected = |part: u32| if part == 2 { HALF_TURN * EXPECTED } else { EXPECTED };
    let holding: Vec<(u32, f64)> = (parts.iter())
        .map(|&part| (part, sweep.order(part, samples)))
        .filter(|(part, evidence)| {
            evidence.sum.share_against() < LEFT[0] * share
                && evidence.worst < LEFT[1] * share
                && share * evidence.sum.total() > expected(*part)
        })
        .map(|(part, evidence)| (part, evidence.sum.share_against()))
        .collect();
    largest_group(&holding).map(|(part, _)| part)
}

/// Whether details have no part in the group `order`: what speaks `against` it is much of what is known of their rings, or comes
/// together at places about which little else is known. Noise, missing returns and those that strayed into a hole speak
/// against it here and there.
fn is_misfit(
    turning: &Turning<'_>,
    order: Order,
    rings: &Rings,
    with_details: &HashSet<Ring>,
    against: &Tally,
) -> bool {
    /// Contradictions that come together, at least. In 1504 scans of 188 parts keyways, missing teeth and single bosses have 220
    /// and more but for one (66); by chance two right answers have 119 and 177, all others up to 92.
    const TOGETHER: f64 = 100.0;
    /// Share of what is known of the rings that is much of it, and the least amount.
    const MUCH: f64 = 0.5;
    const LEAST: f64 = 40.0;
    /// The same where a surface of revolution was found: teeth too fine for the orders that are looked for contradict it a
    /// little at every place.
    const MUCH_OF_REVOLUTION: f64 = 0.1;
    /// Fewer points are strays.
    const POINTS: usize = 10;
    /// Rotations of each point, at most.
    const TURNS: usize = 60;
    /// Rotations of all points, at least: the fewer there are of each, the more points must show what comes together.
    const ROTATED: usize = 20_000;
    let turns: Vec<f64> = Turns::all(order, TURNS).angles().collect();
    let count = SAMPLES.max(ROTATED / turns.len());
    let samples = rings.within(with_details, &turning.surface.samples, count);
    let much = if order == Order::Continuous { MUCH_OF_REVOLUTION } else { MUCH };
    let is_much = against.share_against() > much && against.against() > LEAST;
    is_much && samples.points.len() >= POINTS
        || contradicted_together(turning, &samples, rings, &turns) >= TOGETHER
}

/// Contradictions of points that come from one sector, or come to lie in one: of a boss that stands alone, or where something
/// is missing. The larger number of both.
fn contradicted_together(turning: &Turning<'_>, samples: &Samples, rings: &Rings, turns: &[f64]) -> f64 {
    let axis = turning.axis;
    let moves: Vec<Turn> = turns.iter().map(|&angle| axis.turn(angle)).collect();
    let outcomes: Vec<Vec<Outcome>> = (samples.points.par_iter().zip(&samples.normals))
        .map(|(point, normal)| moves.iter().map(|turn| turning.outcome(point, normal, turn)).collect())
        .collect();
    let tangents = axis.tangents();
    let mut number_of_ring: HashMap<Ring, usize> = HashMap::new();
    let (mut left, mut reached): (Vec<PlacesOfRing>, Vec<PlacesOfRing>) = (Vec::new(), Vec::new());
    for (sample, (point, outcomes)) in samples.points.iter().zip(&outcomes).enumerate() {
        let ring = *number_of_ring.entry(rings.of(point)).or_insert(left.len());
        if ring == left.len() {
            left.push(Default::default());
            reached.push(Default::default());
        }
        let [x, y] = tangents.map(|tangent| tangent.dot(&(point - axis.point)));
        let angle = y.atan2(x);
        for (turn, &outcome) in turns.iter().zip(outcomes) {
            left[ring].at(angle).add(sample, outcome);
            reached[ring].at(angle + turn).add(sample, outcome);
        }
    }
    most_together(&left).max(most_together(&reached))
}

/// Contradictions in that narrow sector about the axis where most are, in all rings, at places where they are most of what is
/// known: about a rim they come at any angle by chance.
fn most_together(rings: &[PlacesOfRing]) -> f64 {
    /// Places side by side that make the sector.
    const SIDE_BY_SIDE: usize = 3;
    let denied = |number: usize| -> f64 { rings.iter().map(|ring| ring.denied(number)).sum() };
    let denied: Vec<f64> = (0..PlacesOfRing::COUNT).map(denied).collect();
    let sector = |first: usize| -> f64 { denied.iter().cycle().skip(first).take(SIDE_BY_SIDE).sum() };
    (0..PlacesOfRing::COUNT).map(sector).fold(0.0, f64::max)
}

/// The places of a ring, one beside the other.
#[derive(Debug, Clone, Copy)]
struct PlacesOfRing([Place; Self::COUNT]);

impl Default for PlacesOfRing {
    fn default() -> Self {
        Self([Place::default(); Self::COUNT])
    }
}

impl PlacesOfRing {
    const COUNT: usize = 36;

    /// The place at an angle \[rad\].
    fn at(&mut self, angle: f64) -> &mut Place {
        &mut self.0[((angle / TAU).rem_euclid(1.0) * Self::COUNT as f64) as usize % Self::COUNT]
    }

    /// Contradictions at one of the places, where they are most of what is known.
    fn denied(&self, number: usize) -> f64 {
        let place = &self.0[number];
        if place.is_denied() { place.tally.contradicted } else { 0.0 }
    }
}

/// What is known at some angles of a ring.
#[derive(Debug, Clone, Copy, Default)]
struct Place {
    tally: Tally,
    /// Points that were contradicted.
    points: usize,
    /// The last of them.
    last: Option<usize>,
}

impl Place {
    /// Adds what became of a sample; all outcomes of one sample follow each other.
    fn add(&mut self, sample: usize, outcome: Outcome) {
        self.tally.add(outcome);
        if outcome == Outcome::Contradicted && self.last != Some(sample) {
            self.points += 1;
            self.last = Some(sample);
        }
    }

    /// Whether most of what is known here are contradictions, of several points.
    fn is_denied(&self) -> bool {
        /// Contradictions, at least, and of how many points.
        const LEAST: (f64, usize) = (8.0, 4);
        self.tally.share_against() > 0.5 && self.tally.contradicted >= LEAST.0 && self.points >= LEAST.1
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::symmetry::sweep::tests::sweep;
    use crate::symmetry::sweep::up_to;

    #[test]
    fn a_half_turn_needs_more_evidence_than_other_turns() {
        let all_but = |fraction| -> Vec<(u32, u32)> {
            up_to(6).into_iter().filter(|other| *other != fraction).collect()
        };
        // A share of 0.1 of `samples` contradictions would be expected.
        let holding = |fraction, samples: usize| {
            part_that_holds(&sweep(6, &all_but(fraction)), &vec![0; samples], &[2, 3], 0.1)
        };
        assert_eq!(holding((1, 3), 115), None);
        assert_eq!(holding((1, 3), 140), Some(3));
        assert_eq!(holding((1, 2), 140), None);
        assert_eq!(holding((1, 2), 200), Some(2));
    }

    #[test]
    fn a_place_is_denied_by_several_points_that_agree() {
        let mut ring = PlacesOfRing::default();
        let mut turn_each = |points: usize, angle: f64, outcome| {
            (0..points).for_each(|point| (0..4).for_each(|_| ring.at(angle).add(point, outcome)));
            most_together(&[ring])
        };
        // One point may be a stray, and what has no return may be lost.
        assert_eq!(turn_each(1, 1.0, Outcome::Contradicted), 0.0);
        assert_eq!(turn_each(9, 2.0, Outcome::Missing), 0.0);
        assert_eq!(turn_each(5, 3.0, Outcome::Contradicted), 20.0);
        // As many matches there make it noise.
        assert_eq!(turn_each(5, 3.0, Outcome::Matched), 0.0);
    }

    #[test]
    fn only_a_narrow_sector_counts_as_together() {
        let contradicted_at = |angles: &[f64]| {
            let mut ring = PlacesOfRing::default();
            for angle in angles {
                (0..5).for_each(|point| {
                    (0..4).for_each(|_| ring.at(*angle).add(point, Outcome::Contradicted));
                });
            }
            most_together(&[ring, ring])
        };
        // Side by side, also across the seam of a turn, in both rings.
        assert_eq!(contradicted_at(&[-0.1, 0.1]), 80.0);
        assert_eq!(contradicted_at(&[0.1, 3.0]), 40.0);
        let all_round: Vec<f64> = (0..36).map(|k| TAU * (f64::from(k) + 0.5) / 36.0).collect();
        assert_eq!(contradicted_at(&all_round), 120.0);
    }

    #[test]
    fn places_go_all_the_way_round() {
        let mut ring = PlacesOfRing::default();
        for angle in [0.01, 0.01 + TAU, 0.01 - TAU, -1e-20] {
            (0..2).for_each(|point| (0..2).for_each(|_| ring.at(angle).add(point, Outcome::Matched)));
        }
        assert_eq!(ring.at(0.05).tally.agreeing, 16.0);
        assert_eq!(ring.at(-0.05).tally.agreeing, 0.0);
    }
}

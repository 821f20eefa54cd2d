//! Whether details have no part in a group: a keyway, or a tooth that is missing, and not what noise brings here and there.

use std::collections::{HashMap, HashSet};
use std::f64::consts::TAU;

use rayon::prelude::*;

use crate::symmetry::axis::Turn;
use crate::symmetry::details::SAMPLES;
use crate::symmetry::order::{Order, Turns};
use crate::symmetry::rings::{Ring, Rings};
use crate::symmetry::score::Outcome;
use crate::symmetry::surface::Samples;
use crate::symmetry::sweep::{Tally, Turning};

/// Whether details have no part in the group `order`: what speaks `against` it is much of what is known of their rings, or comes
/// together at places about which little else is known. Noise, missing returns and those that strayed into a hole speak
/// against it here and there.
pub(crate) fn is_misfit(
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

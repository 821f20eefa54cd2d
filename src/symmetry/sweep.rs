//! What rotated points meet at every multiple of every order, and at the angles between.

use std::collections::HashMap;

use nalgebra::Vector3;
use rayon::prelude::*;

use crate::control::Control;
use crate::error::Result;
use crate::symmetry::axis::{Axis, Turn};
use crate::symmetry::order::gcd;
use crate::symmetry::score::{MISSING, Outcome, outcome};
use crate::symmetry::sight::Sight;
use crate::symmetry::surface::{Gate, Samples, Surface};
use crate::symmetry::walls::outcome_of_wall;

/// Evidence gathered at some angles: weights for and against.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Tally {
    pub agreeing: f64,
    pub contradicted: f64,
    pub missing: f64,
}

impl Tally {
    pub(crate) fn add(&mut self, outcome: Outcome) {
        self.add_times(outcome, 1.0);
    }

    /// Adds what stands for so many `times` the same.
    fn add_times(&mut self, outcome: Outcome, times: f64) {
        match outcome {
            Outcome::Matched => self.agreeing += times,
            Outcome::Contradicted => self.contradicted += times,
            Outcome::Missing => self.missing += MISSING * times,
            Outcome::Hidden => {}
        }
    }

    pub(crate) fn merge(&mut self, other: &Self) {
        self.agreeing += other.agreeing;
        self.contradicted += other.contradicted;
        self.missing += other.missing;
    }

    pub(crate) fn against(&self) -> f64 {
        self.contradicted + self.missing
    }

    /// All that says anything.
    pub(crate) fn total(&self) -> f64 {
        self.agreeing + self.against()
    }

    /// Share of the evidence that speaks against; 1 when there is none for it.
    pub(crate) fn share_against(&self) -> f64 {
        let total = self.total();
        if total > 0.0 { self.against() / total } else { 1.0 }
    }
}

/// What speaks for and against one order.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct OrderEvidence {
    /// Over all multiples.
    pub sum: Tally,
    /// Largest share against a multiple.
    pub worst: f64,
    /// Matches at the multiples that no divisor shares, against those at the best multiple: where they fall out of sight
    /// an order has only its divisors to speak for it.
    pub support: f64,
}

/// A surface that is turned about an axis, and what tells where its points come to lie.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Turning<'a> {
    pub surface: &'a Surface,
    pub axis: &'a Axis,
    pub gate: Gate,
    pub sight: Sight<'a>,
    /// What speaks against a point where it comes to lie.
    pub witness: Witness,
    pub control: &'a Control,
}

/// What can speak against points that miss the surface.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Witness {
    /// Cameras that look through where they are.
    Cameras,
    /// The surface itself, where it is flat and a wall should be.
    Flats,
}

impl Turning<'_> {
    /// What becomes of a point with a normal.
    pub(crate) fn outcome(&self, point: &Vector3<f64>, normal: &Vector3<f64>, turn: &Turn) -> Outcome {
        match self.witness {
            Witness::Cameras => outcome(self.surface, point, normal, turn, self.gate, self.sight),
            Witness::Flats => outcome_of_wall(self.surface, point, normal, turn, self.gate),
        }
    }
}

/// Outcomes of the samples at some fractions k/n of a turn, in lowest terms and up to one half; every second one that is
/// turned goes the other way where cameras tell what is empty.
pub(crate) struct Sweep {
    fractions: Vec<(u32, u32)>,
    row_of: HashMap<(u32, u32), usize>,
    /// For each fraction those of the samples; hidden where one was not turned by it.
    outcomes: Vec<Vec<Outcome>>,
    /// For each fraction how many samples one that was turned by it stands for.
    times: Vec<usize>,
}

/// Which samples are turned by a fraction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Turned {
    /// All of them.
    All,
    /// Up to denominators of [`SURVEY_ORDER`] all, beyond that every n-th, others by each fraction: a large order has so
    /// many multiples that there is as much evidence of it as of a small one.
    Enough,
}

/// Largest order of a first look; with smaller ones there are no generic angles.
pub(crate) const SURVEY_ORDER: u32 = 24;

impl Sweep {
    pub(crate) fn new(
        turning: &Turning<'_>,
        samples: &Samples,
        fractions: Vec<(u32, u32)>,
        turned: Turned,
    ) -> Result<Self> {
        let every = |&(_, n): &(u32, u32)| match turned {
            Turned::All => 1,
            Turned::Enough => n.div_ceil(SURVEY_ORDER) as usize,
        };
        let times: Vec<usize> = fractions.iter().map(every).collect();
        let outcomes = fractions
            .par_iter()
            .zip(&times)
            .enumerate()
            .map(|(row, (&(k, n), &times))| {
                turning.control.check()?;
                // What matches turned one way does so turned the other way, but what is seen to be empty is not the same.
                let angle = std::f64::consts::TAU * f64::from(k) / f64::from(n);
                let other = if turning.sight.is_known() { -angle } else { angle };
                let both = [angle, other].map(|angle| turning.axis.turn(angle));
                let outcome = |i: usize| {
                    turning.outcome(&samples.points[i], &samples.normals[i], &both[(i / times + row) % 2])
                };
                let is_turned = |i: usize| (i + row).is_multiple_of(times);
                let all = 0..samples.points.len();
                Ok(all.map(|i| if is_turned(i) { outcome(i) } else { Outcome::Hidden }).collect())
            })
            .collect::<Result<_>>()?;
        let row_of = fractions.iter().enumerate().map(|(row, &fraction)| (fraction, row)).collect();
        Ok(Self { fractions, row_of, outcomes, times })
    }

    /// Evidence at k/n over the chosen samples.
    fn tally(&self, k: u32, n: u32, chosen: &[usize]) -> Tally {
        let mut tally = Tally::default();
        if let Some(&row) = self.row_of.get(&fraction(k, n)) {
            self.add_row(&mut tally, row, chosen);
        }
        tally
    }

    fn add_row(&self, tally: &mut Tally, row: usize, chosen: &[usize]) {
        let times = self.times[row] as f64;
        chosen.iter().for_each(|&i| tally.add_times(self.outcomes[row][i], times));
    }

    /// Evidence at all multiples of 1/n.
    pub(crate) fn order(&self, n: u32, chosen: &[usize]) -> OrderEvidence {
        /// A multiple with less evidence than this decides nothing alone.
        const ENOUGH: f64 = 10.0;
        let mut evidence = OrderEvidence::default();
        let mut most_agreeing = f64::MIN_POSITIVE;
        let mut primitive = (0.0, 0.0);
        for k in 1..=n / 2 {
            let tally = self.tally(k, n, chosen);
            if tally.total() >= ENOUGH {
                evidence.worst = evidence.worst.max(tally.share_against());
            }
            most_agreeing = most_agreeing.max(tally.agreeing);
            if gcd(k, n) == 1 {
                primitive.0 += tally.agreeing;
                primitive.1 += 1.0;
            }
            evidence.sum.merge(&tally);
        }
        evidence.support = primitive.0 / f64::max(primitive.1, 1.0) / most_agreeing;
        evidence
    }

    /// Evidence half-way between the multiples of 1/n, or at generic angles where no sample was turned there.
    pub(crate) fn halfway(&self, n: u32, chosen: &[usize]) -> Tally {
        if 2 * n > self.largest_denominator() {
            return self.generic(chosen);
        }
        let mut sum = Tally::default();
        (0..n.div_ceil(2)).for_each(|k| sum.merge(&self.tally(2 * k + 1, 2 * n, chosen)));
        sum
    }

    /// Evidence at generic angles.
    pub(crate) fn generic(&self, chosen: &[usize]) -> Tally {
        let mut sum = Tally::default();
        self.generic_rows().for_each(|row| self.add_row(&mut sum, row, chosen));
        sum
    }

    /// For each fraction the matches of the chosen samples, and those that the generic angles around it let expect.
    pub(crate) fn peaks(&self, chosen: &[usize]) -> HashMap<(u32, u32), Peak> {
        /// Distance at which an angle is no longer around [turns].
        const AROUND: f64 = 0.05;
        let turn = |(k, n): (u32, u32)| f64::from(k) / f64::from(n);
        let matched = |row: usize| {
            let matches = chosen.iter().filter(|&&i| self.outcomes[row][i] == Outcome::Matched);
            (matches.count() * self.times[row]) as f64
        };
        let generic: Vec<(f64, f64)> =
            self.generic_rows().map(|row| (turn(self.fractions[row]), matched(row))).collect();
        let expected = |at: f64| {
            let weight = |angle: f64| f64::max(1.0 - (angle - at).abs() / AROUND, 0.0);
            let total: f64 = generic.iter().map(|(angle, _)| weight(*angle)).sum();
            generic.iter().map(|(angle, matched)| weight(*angle) * matched).sum::<f64>() / total
        };
        let peak = |(row, &fraction): (usize, &(u32, u32))| {
            (fraction, Peak { matched: matched(row), expected: expected(turn(fraction)) })
        };
        self.fractions.iter().enumerate().map(peak).collect()
    }

    fn largest_denominator(&self) -> u32 {
        self.fractions.iter().map(|&(_, n)| n).max().unwrap_or(2)
    }

    /// Rows of generic angles: fractions of a large denominator, which few orders share.
    fn generic_rows(&self) -> impl Iterator<Item = usize> {
        let largest = self.largest_denominator();
        (0..self.fractions.len()).filter(move |&row| 3 * self.fractions[row].1 > 2 * largest)
    }
}

/// Matches at one angle.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Peak {
    /// Samples that matched \[count\].
    pub matched: f64,
    /// The same at the generic angles around \[count\].
    pub expected: f64,
}

/// All fractions of a turn up to one half, in lowest terms, with denominators up to some largest order.
pub(crate) fn up_to(max_order: u32) -> Vec<(u32, u32)> {
    let of = |n: u32| (1..=n / 2).filter(move |&k| gcd(k, n) == 1).map(move |k| (k, n));
    (2..=max_order).flat_map(of).collect()
}

/// `k / n` of a turn as the fraction up to one half that means the same but for the sense, in lowest terms.
pub(crate) fn fraction(k: u32, n: u32) -> (u32, u32) {
    let k = (k % n).min(n - k % n);
    let divisor = gcd(k, n);
    (k / divisor, n / divisor)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A sample that is contradicted at some fractions of a turn, and matches at all others.
    pub(crate) fn sweep(max_order: u32, contradicted: &[(u32, u32)]) -> Sweep {
        let fractions = up_to(max_order);
        let outcome = |fraction| {
            if contradicted.contains(fraction) { Outcome::Contradicted } else { Outcome::Matched }
        };
        let outcomes = fractions.iter().map(|fraction| vec![outcome(fraction)]).collect();
        let row_of = fractions.iter().enumerate().map(|(row, &fraction)| (fraction, row)).collect();
        let times = vec![1; fractions.len()];
        Sweep { fractions, row_of, outcomes, times }
    }

    #[test]
    fn half_way_lies_between_the_multiples() {
        let against = |n, contradicted: &[(u32, u32)]| sweep(12, contradicted).halfway(n, &[0]).against();
        assert_eq!(against(2, &[(1, 4)]), 1.0);
        assert_eq!(against(2, &[(1, 2)]), 0.0);
        // A half turn lies between multiples of an odd order.
        assert_eq!(against(3, &[(1, 6), (1, 2)]), 2.0);
        assert_eq!(against(3, &[(1, 3)]), 0.0);
        assert_eq!(against(6, &[(1, 12), (1, 4), (5, 12), (1, 6)]), 3.0);
    }

    #[test]
    fn where_no_sample_was_turned_half_way_generic_angles_stand_for_it() {
        let sweep = sweep(12, &[(1, 11)]);
        assert_eq!(sweep.halfway(7, &[0]).against(), sweep.generic(&[0]).against());
        assert_eq!(sweep.generic(&[0]).against(), 1.0);
    }
}

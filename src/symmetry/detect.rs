//! The order of the symmetry about a known axis, from what rotated points meet at every multiple of every order.
//!
//! A surface of revolution matches itself at any angle and says nothing about the order: on a rim the barrel would drown
//! the spokes. So only *structured* points are asked: those that some rotation turns into a place seen to be empty.

use nalgebra::Vector3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::error::Result;
use crate::symmetry::axis::{ASIDE, Axis};
use crate::symmetry::details::Details;
use crate::symmetry::order::Order;
use crate::symmetry::peaks::{Standing, order_from_peaks};
use crate::symmetry::rings::Rings;
use crate::symmetry::sight::Sight;
use crate::symmetry::surface::Samples;
use crate::symmetry::sweep::{OrderEvidence, SURVEY_ORDER, Sweep, Tally, Turned, Turning, up_to};

/// How the order is found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DetectParams {
    /// Largest discrete order that is looked for; finer ones count as continuous.
    pub max_order: u32,
    /// Points that are rotated to find the rings of the surface that have structure \[count\]; at most 250 in the search,
    /// and where several views show a part whose order is given.
    pub samples: usize,
    /// Points of these rings that are rotated to find the order \[count\]; at most as many there.
    pub ring_samples: usize,
    /// Share of the angles at which a point must be contradicted to count as structured; also the contrast between matching and
    /// generic angles that an order needs.
    pub structured: f64,
    /// Share of structured points below which the surface is one of revolution.
    pub continuous: f64,
    /// How much of the contrast between matching and generic angles an order may give away on average.
    pub tolerance: f64,
    /// The same for the worst of its multiples.
    pub worst_tolerance: f64,
    /// Matches that an order must have where its divisors say nothing [share of its best multiple].
    pub support: f64,
    /// Share of the evidence of structured points against a symmetry beyond which it is refused.
    pub refused: f64,
    /// Share of the observed surface that a symmetry must explain.
    pub explained: f64,
    /// The same for a surface of revolution with structure that fits no order: a seam passes, the handle of a mug does not.
    pub explained_seamed: f64,
    /// The same as `refused` where no viewpoint is known.
    pub unseen_refused: f64,
    /// The same for a half turn, which brings many a part without symmetry near itself.
    pub unseen_refused_half: f64,
    /// By how much, at least, the matches at an order exceed those at the angles around, where no viewpoint is known [share
    /// of the latter].
    pub unseen_gain: f64,
    /// Share of normals that do not meet the axis below which a surface is one of revolution, no viewpoint being known.
    pub twisted: f64,
    /// Gain times share of structured points from which on it is not.
    pub unseen_gain_round: f64,
}

impl Default for DetectParams {
    fn default() -> Self {
        Self {
            max_order: 60,
            samples: 600,
            ring_samples: 800,
            structured: 0.1,
            continuous: 0.01,
            tolerance: 0.2,
            worst_tolerance: 0.5,
            support: 0.2,
            refused: 0.09,
            explained: 0.97,
            explained_seamed: 0.985,
            unseen_refused: 0.5,
            unseen_refused_half: 0.25,
            unseen_gain: 0.06,
            twisted: 0.04,
            unseen_gain_round: 0.015,
        }
    }
}

impl DetectParams {
    /// Angles at which orders are judged, generic ones among them.
    pub(crate) fn fractions(&self) -> Vec<(u32, u32)> {
        up_to(self.max_order.max(SURVEY_ORDER))
    }
}

/// What the sweep over all angles says.
#[derive(Debug, Clone)]
pub struct Detection {
    /// The order, or `None` when no rotation maps the part to itself.
    pub order: Option<Order>,
    /// Details that contradict the order of all the rest.
    pub details: Option<Details>,
    /// Beside a discrete order another one that the data supports as well.
    pub rival: Option<u32>,
    /// Whether hardly anything in sight tells the discrete order from others.
    pub faint: bool,
    /// Share of the observed surface that agrees with the order (the best one, when none is accepted), in [0, 1].
    pub explained: f64,
    /// Share of the points that tell one angle from another.
    pub structured: f64,
    /// The largest order that was looked for, 1 where none was.
    pub looked_for: u32,
    /// Evidence against each discrete order from 2 on, on structured points, in [0, 1].
    pub against: Vec<f64>,
    /// Evidence against a generic angle, on structured points, in [0, 1].
    pub generic: f64,
}

impl Detection {
    /// Whether the part may have `order`: what was found is that, or a larger group that holds it, or of an order larger than
    /// those that are looked for as large a part as can be found.
    #[must_use]
    pub fn allows(&self, order: Order) -> bool {
        match (order, self.order) {
            (_, Some(Order::Continuous)) => true,
            (Order::Cyclic(n), Some(Order::Cyclic(found))) => {
                let largest = self.looked_for;
                let is_part = |order: u32| n.is_multiple_of(order);
                let is_largest_part =
                    is_part(found) && !(2..=largest / found).any(|times| is_part(times * found));
                found.is_multiple_of(n) || (n > largest && is_largest_part)
            }
            _ => false,
        }
    }

    /// Whether the discrete order that was found, nothing being as good, rules out a declared one, whose turns explain that much of
    /// the observed surface. A multiple may hold but for a few details, as 10 spokes do about 5 holes, and must explain as much as an
    /// order that is found; the turns of any other order are those of another part.
    #[must_use]
    pub fn contradicts(&self, order: Order, explained: f64, params: &DetectParams) -> bool {
        let is_telling = self.rival.is_none() && !self.faint;
        match (order, self.order) {
            (Order::Cyclic(n), Some(Order::Cyclic(found))) => {
                is_telling
                    && !self.allows(order)
                    && (!n.is_multiple_of(found) || explained < params.explained)
            }
            _ => false,
        }
    }

    /// Whether a half turn was found, and details contradict it: one maps any plate to itself but for what stands on one of its sides.
    #[must_use]
    pub fn is_denied_half_turn(&self) -> bool {
        self.order == Some(Order::Cyclic(2)) && self.details == Some(Details::OfNone)
    }
}

/// Points among which those of the structured rings are chosen, for each of them.
const CANDIDATES: usize = 80;

/// Evidence that there would be against an order that held no better than generic angles, below which of many orders one may hold
/// by chance: few points tell it, and they lie side by side. Of 1360 orders found in one or two views of 221 parts six have less
/// and are wrong, and one is right; the next wrong one has 174.
pub(crate) const BY_CHANCE: f64 = 36.0;

/// Evidence against every order at which an axis needs no closer look [what an order may leave unexplained].
const HOPELESS: f64 = 5.0;

/// Samples that a share of the generic angles contradicts.
fn structured_samples(sweep: &Sweep, count: usize, threshold: f64) -> Vec<usize> {
    let contradicted = |i: usize| {
        let tally = sweep.generic(&[i]);
        tally.against() > 0.0 && tally.share_against() > threshold
    };
    (0..count).into_par_iter().filter(|&i| contradicted(i)).collect()
}

/// Finds the order of a surface about an axis.
///
/// # Errors
/// [`Error::Cancelled`](crate::Error::Cancelled), [`Error::DeadlineExceeded`](crate::Error::DeadlineExceeded).
pub(crate) fn detect_order(turning: &Turning<'_>, params: &DetectParams) -> Result<Detection> {
    let survey = Survey::new(turning, params)?;
    if survey.structured_share() < params.continuous {
        return Ok(survey.revolution(params));
    }
    if let Some(detection) = survey.hopeless(turning.sight, params) {
        return Ok(detection);
    }
    let structure = Structure::new(turning, &survey, params)?;
    Ok(if turning.sight.tells_gaps() {
        structure.seen_order(&survey, params)
    } else {
        let is_round = twisted(turning.axis, &survey.samples) < params.twisted;
        structure.unseen_order(&survey, turning.sight, is_round, params)
    })
}

/// Points of all the surface at all angles: where it has structure.
struct Survey {
    samples: Samples,
    sweep: Sweep,
    structured: Vec<usize>,
    /// Evidence of all points at generic angles.
    generic: Tally,
}

impl Survey {
    fn new(turning: &Turning<'_>, params: &DetectParams) -> Result<Self> {
        let samples = turning.surface.samples.strided(params.samples);
        let sweep = Sweep::new(turning, &samples, up_to(SURVEY_ORDER), Turned::All)?;
        let everything: Vec<usize> = (0..samples.points.len()).collect();
        let generic = sweep.generic(&everything);
        let structured = structured_samples(&sweep, samples.points.len(), params.structured);
        Ok(Self { samples, sweep, structured, generic })
    }

    /// Share of the points that tell one angle from another.
    fn structured_share(&self) -> f64 {
        self.structured.len() as f64 / self.samples.points.len().max(1) as f64
    }

    /// What is known before any order is looked at: nothing speaks against a surface of revolution but the generic angles.
    fn detection(&self) -> Detection {
        Detection {
            order: Some(Order::Continuous),
            details: None,
            rival: None,
            faint: false,
            explained: 1.0 - self.generic.share_against(),
            structured: self.structured_share(),
            looked_for: 1,
            against: Vec::new(),
            generic: 0.0,
        }
    }

    /// A surface without structure.
    fn revolution(&self, params: &DetectParams) -> Detection {
        let mut detection = self.detection();
        // Without any evidence no share of it is explained.
        detection.order = detection.order.filter(|_| detection.explained >= params.explained);
        detection
    }

    /// A surface that no order comes near to, where that shows without a closer look.
    fn hopeless(&self, sight: Sight<'_>, params: &DetectParams) -> Option<Detection> {
        let limit = HOPELESS * (1.0 - params.explained);
        let has_all_orders = params.max_order <= SURVEY_ORDER;
        if !sight.tells_gaps() || !has_all_orders || self.generic.share_against() <= limit {
            return None;
        }
        let everything: Vec<usize> = (0..self.samples.points.len()).collect();
        let against = |n: u32| self.sweep.order(n, &everything).sum.share_against();
        let floor = (2..=params.max_order).into_par_iter().map(against).reduce(|| f64::INFINITY, f64::min);
        (floor > limit).then(|| Detection { order: None, explained: 1.0 - floor, ..self.detection() })
    }
}

/// Points of the rings with structure at the multiples of every order.
struct Structure {
    sweep: Sweep,
    structured: Vec<usize>,
    /// For each order from 2 on.
    evidence: Vec<(u32, OrderEvidence)>,
    /// Share of the evidence of the structured points that speaks against a generic angle.
    generic: f64,
    /// The same against the order that it speaks least against.
    floor: f64,
}

impl Structure {
    fn new(turning: &Turning<'_>, survey: &Survey, params: &DetectParams) -> Result<Self> {
        let Turning { surface, axis, sight, .. } = turning;
        let rings = Rings::about(axis, &survey.samples);
        let with_structure = survey.structured.iter().map(|&i| rings.of(&survey.samples.points[i])).collect();
        // To look at each point of a large surface takes longer than all that follows; where gaps tell nothing peaks are
        // small and need the points that are best spread over the rings.
        let looked_at =
            if sight.tells_gaps() { CANDIDATES.saturating_mul(params.ring_samples) } else { surface.len() };
        let mut samples =
            rings.within(&with_structure, &surface.samples.strided(looked_at), params.ring_samples);
        if samples.points.len() < params.ring_samples {
            samples = rings.within(&with_structure, &surface.samples, params.ring_samples);
        }
        let turned = if sight.tells_gaps() { Turned::Enough } else { Turned::All };
        let sweep = Sweep::new(turning, &samples, params.fractions(), turned)?;
        let structured = structured_samples(&sweep, samples.points.len(), params.structured);
        let orders: Vec<u32> = (2..=params.max_order).collect();
        let evidence: Vec<(u32, OrderEvidence)> =
            orders.into_par_iter().map(|n| (n, sweep.order(n, &structured))).collect();
        let generic = sweep.generic(&structured).share_against();
        let floor = evidence.iter().map(|(_, e)| e.sum.share_against()).fold(f64::INFINITY, f64::min);
        Ok(Self { sweep, structured, evidence, generic, floor })
    }

    /// The evidence for and against one of the orders that are looked for.
    fn of_order(&self, n: u32) -> &OrderEvidence {
        &self.evidence[n as usize - 2].1
    }

    /// The evidence gathered here, beside what the survey says.
    fn detection(&self, survey: &Survey) -> Detection {
        let against = self.evidence.iter().map(|(_, e)| e.sum.share_against()).collect();
        let looked_for = self.evidence.last().map_or(1, |(n, _)| *n);
        Detection { against, looked_for, generic: self.generic, ..survey.detection() }
    }

    /// No order explains what structure there is.
    fn none(&self, survey: &Survey) -> Detection {
        Detection {
            order: None,
            explained: 1.0 - survey.structured_share() * self.floor,
            ..self.detection(survey)
        }
    }

    /// The order where the cameras tell what is empty: the largest one that they hardly contradict and that explains the surface.
    fn seen_order(&self, survey: &Survey, params: &DetectParams) -> Detection {
        let detection = self.detection(survey);
        let contrast = self.generic - self.floor;
        let explained = |against: f64| 1.0 - survey.structured_share() * against;
        let holds = |e: &OrderEvidence| {
            let against = e.sum.share_against();
            e.support >= params.support
                && explained(against) >= params.explained
                && against <= self.floor + params.tolerance * contrast
                && e.worst <= self.floor + params.worst_tolerance * contrast
        };
        let holding: Vec<(u32, f64)> = (self.evidence.iter())
            .filter(|(_, e)| holds(e))
            .map(|(n, e)| (*n, e.sum.share_against()))
            .collect();
        // Beside any order some hold of which hardly anything is known.
        let telling: Vec<(u32, f64)> =
            holding.iter().copied().filter(|(n, _)| !self.is_by_chance(*n)).collect();
        match largest_group(&holding) {
            Some((n, against)) if self.floor < params.refused && contrast > params.structured => Detection {
                order: Some(Order::Cyclic(n)),
                rival: rival(&telling, (n, against), contrast),
                faint: self.is_by_chance(n) || self.is_faint(n),
                explained: explained(against),
                ..detection
            },
            // What structure there is fits no order: a dent or a seam on a surface of revolution, or no symmetry at all.
            _ if detection.explained >= params.explained_seamed => detection,
            _ => self.none(survey),
        }
    }

    /// Whether so little is known at the multiples of order `n` that it may hold by chance.
    fn is_by_chance(&self, n: u32) -> bool {
        self.generic * self.of_order(n).sum.total() < BY_CHANCE
    }

    /// Whether far less speaks against the angles half-way between the multiples of order `n` than against generic ones, and
    /// most of the points that tell angles apart go out of sight at these multiples: the part may be of twice that order, or none.
    fn is_faint(&self, n: u32) -> bool {
        /// Share of the evidence against generic angles, and of these points in sight. In 1627 scans of 446 parts, one to five
        /// views, six wrong orders have less of both, and two right ones, which are doubted for another reason, too.
        const LITTLE: f64 = 1.0 / 3.0;
        let turned = self.structured.len() as f64 * f64::from(n / 2);
        let in_sight = self.of_order(n).sum.total() / turned.max(1.0);
        let against = self.sweep.halfway(n, &self.structured).share_against();
        against < LITTLE * self.generic && in_sight < LITTLE
    }

    /// The order where gaps tell nothing. Anything may be hidden, or lost: no share of misses refuses an order that stands out
    /// from the angles around it, but what a camera saw to be empty does.
    fn unseen_order(
        &self,
        survey: &Survey,
        sight: Sight<'_>,
        is_round: bool,
        params: &DetectParams,
    ) -> Detection {
        let detection = self.detection(survey);
        let share = survey.structured_share();
        let is_refuted = |evidence: &Tally, share: f64| {
            sight.is_known() && share * evidence.contradicted > (1.0 - params.explained) * evidence.total()
        };
        // One view, and gaps that tell nothing, leave too little to tell a half turn by.
        let holds = |found: &Standing| {
            let evidence = &self.of_order(found.order).sum;
            (found.order > 2 || !sight.is_known()) && !is_refuted(evidence, share)
        };
        let found = order_from_peaks(&self.sweep, &self.structured, &detection.against, params)
            .filter(|found| !is_round || found.order > 2 && share * found.gain > params.unseen_gain_round);
        match found {
            Some(found) if holds(&found) => Detection {
                order: Some(Order::Cyclic(found.order)),
                rival: found.rival,
                explained: 1.0 - share * detection.against[found.order as usize - 2],
                ..detection
            },
            None if is_round && !is_refuted(&survey.generic, 1.0) => detection,
            _ => self.none(survey),
        }
    }
}

/// The order of the least evidence against it, or the largest of its multiples that hold, too; each order comes with the
/// share of the evidence against it.
pub(crate) fn largest_group(holding: &[(u32, f64)]) -> Option<(u32, f64)> {
    let mut ranked = holding.to_vec();
    ranked.sort_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)));
    ranked.into_iter().reduce(|best, other| if other.0.is_multiple_of(best.0) { other } else { best })
}

/// The largest order that holds about as well as the best one and does not follow from it: with both, the part would have
/// that of their common multiple, which does not hold. Too little is in sight then to tell them apart.
pub(crate) fn rival(holding: &[(u32, f64)], best: (u32, f64), contrast: f64) -> Option<u32> {
    /// Share of the contrast between matching and generic angles by which the evidence may differ.
    const AS_WELL: f64 = 0.05;
    let others = holding
        .iter()
        .filter(|(n, against)| !best.0.is_multiple_of(*n) && *against <= best.1 + AS_WELL * contrast);
    others.map(|(n, _)| *n).max()
}

/// Share of the points whose normal does not meet the axis; those of a surface of revolution all do.
fn twisted(axis: &Axis, survey: &Samples) -> f64 {
    let aside = |(point, normal): (&Vector3<f64>, &Vector3<f64>)| axis.around(point, normal).abs() > ASIDE;
    let count = survey.points.iter().zip(&survey.normals).filter(|row| aside(*row)).count();
    count as f64 / survey.points.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_larger_group_allows_its_parts() {
        let detection = |order, looked_for| Detection {
            order,
            details: None,
            rival: None,
            faint: false,
            explained: 1.0,
            structured: 0.5,
            looked_for,
            against: Vec::new(),
            generic: 0.5,
        };
        let allowed = |found, declared| detection(Some(found), 60).allows(declared);
        assert!(allowed(Order::Cyclic(6), Order::Cyclic(6)));
        assert!(allowed(Order::Cyclic(6), Order::Cyclic(3)));
        assert!(allowed(Order::Continuous, Order::Cyclic(7)));
        assert!(!allowed(Order::Cyclic(2), Order::Cyclic(4)));
        assert!(!allowed(Order::Cyclic(24), Order::Continuous));
        assert!(!detection(None, 60).allows(Order::Cyclic(2)));
        // Of 72 teeth the largest part among the orders that are looked for is 36.
        assert!(allowed(Order::Cyclic(36), Order::Cyclic(72)));
        assert!(!detection(Some(Order::Cyclic(36)), 80).allows(Order::Cyclic(72)));
        assert!(allowed(Order::Cyclic(24), Order::Cyclic(72)));
        assert!(!allowed(Order::Cyclic(12), Order::Cyclic(72)));
        assert!(!allowed(Order::Cyclic(5), Order::Cyclic(360)));
    }

    #[test]
    fn divisors_give_way_to_the_whole_group() {
        let holding = [(2, 0.010), (3, 0.012), (4, 0.009), (6, 0.013), (12, 0.012)];
        assert_eq!(largest_group(&holding), Some((12, 0.012)));
        assert_eq!(rival(&holding, (12, 0.012), 0.9), None);
    }

    #[test]
    fn an_order_that_does_not_follow_from_the_best_one_is_a_rival() {
        assert_eq!(largest_group(&[(6, 0.0), (7, 0.03)]), Some((6, 0.0)));
        assert_eq!(rival(&[(6, 0.0), (7, 0.03)], (6, 0.0), 0.4), None);
        let little_in_sight = [(2, 0.0), (3, 0.0), (4, 0.0), (8, 0.0), (9, 0.0), (24, 0.0), (31, 0.01)];
        assert_eq!(largest_group(&little_in_sight), Some((24, 0.0)));
        assert_eq!(rival(&little_in_sight, (24, 0.0), 0.13), Some(9));
    }
}

//! The axes that a search or an earlier pose gave, refined one after the other until one holds.

use std::cmp::Ordering;

use nalgebra::{Matrix4, Vector3};

use crate::config::Config;
use crate::control::Control;
use crate::error::Result;
use crate::estimate::Estimator;
use crate::locate::TRACKED;
use crate::prepare::Prepared;
use crate::refusal::Refusal;
use crate::remarks::{
    Answer, LIKE_PIECES, PIECE_APART, Remarks, closer_part_holds, nearly_round, order_warning, remarks,
};
use crate::rivals::{APART, AS_WELL, another_axis, other_orders};
use crate::symmetry::axis::Axis;
use crate::symmetry::closeness::closer_part;
use crate::symmetry::covariance::{CommonErrors, INFLATION};
use crate::symmetry::details::{Details, contradicting_details, contradicting_walls};
use crate::symmetry::detect::{DetectParams, Detection, detect_order};
use crate::symmetry::order::{Order, Turns};
use crate::symmetry::pace::matching_pace;
use crate::symmetry::pieces::exchanges_pieces;
use crate::symmetry::refine::{Aligner, RefineParams, Refined};
use crate::symmetry::score::{MatchScore, match_score};
use crate::symmetry::search::{Found, group_size};
use crate::symmetry::surface::{Gate, Surface};
use crate::symmetry::sweep::{Turning, Witness};
use crate::symmetry::teeth::{Teeth, teeth};

/// Points on which the final axis is judged.
const JUDGED: usize = 4000;

/// Steps of a radian, and of the radius of the part, to which the start of the refinement is rounded.
const START_STEPS: f64 = 512.0;

/// Points on which the axis is aligned before all are used.
const COARSE: usize = 4000;

/// How far a rotated point may be from a measured one and still match it when the order is found, and how far from the plane
/// of that one. The first is wider: along the surface a point may fall into the gap between two measured ones, off the surface
/// it may not [point spacings].
const DETECTION_GATE: [f64; 2] = [1.9, 1.1];

/// The same where no viewpoint is known and the points of a surface lie in several layers.
const UNSEEN_DETECTION_GATE: [f64; 2] = [2.5, 1.5];

/// Points that mostly suffice, where several views show the part, to tell that they allow a declared order.
const REMARKED: usize = 250;

/// An axis with the order that holds about it.
pub(crate) struct Settled {
    pub refined: Refined,
    pub order: Order,
    pub score: MatchScore,
    pub detection: Detection,
    /// Another axis explains the data about as well.
    pub ambiguous: bool,
    pub warnings: Vec<String>,
}

impl Settled {
    /// Share of the observed surface that agrees with the order, in [0, 1]: of one that was found, by all that told it from others;
    /// of another one, as declared, by its own turns.
    pub(crate) fn explained(&self) -> f64 {
        let is_found = self.detection.order == Some(self.order);
        if is_found { self.detection.explained } else { self.score.explained() }
    }

    /// Says that the surface was taken for one of revolution although some of it speaks against that, as if this had been declared.
    pub(crate) fn taken_for_round(&mut self, explained: f64) {
        let declared = order_warning(Order::Continuous, &self.detection);
        self.warnings.retain(|warning| Some(warning) != declared.as_ref());
        self.warnings.insert(0, nearly_round(explained));
        self.ambiguous = true;
    }
}

impl Estimator {
    /// Refines the candidates until one holds: its order is the declared one, or is found again about the refined axis.
    pub(crate) fn settle(
        &self,
        prepared: &Prepared,
        candidates: &[Found],
        control: &Control,
    ) -> Result<Settled> {
        /// Candidates that are refined before the search is given up.
        const TRIED: usize = 3;
        let mut trials = Trials::default();
        for candidate in candidates {
            if trials.count == TRIED {
                break;
            }
            if trials.have_answered(candidate) {
                continue;
            }
            let outcome = self.outcome(prepared, candidate, candidates, control)?;
            if trials.end_with(candidate, outcome) {
                break;
            }
        }
        let Trials { mut held, refusal, .. } = trials;
        // Of equals the first one, which the search liked best.
        held.sort_by(|a, b| b.worth().partial_cmp(&a.worth()).unwrap_or(Ordering::Equal));
        let mut held = held.into_iter();
        let mut best = held.next().ok_or_else(|| self.no_symmetry(prepared, refusal))?;
        best.doubt_beside(held.as_slice());
        let mut settled = best.settled;
        let Settled { refined: Refined { axis, .. }, order, .. } = &settled;
        let surface = &prepared.surface;
        let remark = if exchanges_pieces(surface, axis, *order, self.final_gate(surface))? {
            Some(LIKE_PIECES)
        } else if prepared.has_piece_apart()? {
            Some(PIECE_APART)
        } else {
            None
        };
        settled.ambiguous |= remark.is_some();
        settled.warnings.extend(remark.map(|remark| format!("ambiguous: {remark}")));
        settled.warnings.extend(self.closer(prepared, &settled));
        Ok(settled)
    }

    /// What becomes of one of the `candidates` when it is refined.
    fn outcome(
        &self,
        prepared: &Prepared,
        candidate: &Found,
        candidates: &[Found],
        control: &Control,
    ) -> Result<Outcome> {
        /// Score from which on no other axis is refined where the order is declared.
        const CERTAIN: f64 = 0.9;
        let surface = &prepared.surface;
        let declared = self.config().order;
        let is_open = declared == Order::Auto;
        // Where no order is known yet, the turns that brought the axis here hold it best.
        let start = candidate.order.unwrap_or(candidate.hypothesis);
        let mut refined = self.refine(surface, candidate.proposal.axis, start, control)?;
        if self.is_out_of_reach(prepared, &refined.axis) {
            return Ok(Outcome::OutOfReach);
        }
        let detection = self.detect(prepared, &refined.axis, control)?;
        // One view seldom shows enough to contradict a half turn, and is not trusted with one anyhow.
        let is_denied = detection.is_denied_half_turn() && !prepared.one_view();
        let found = detection.order.filter(|_| !is_denied);
        let Some(order) = (if is_open { found } else { Some(declared) }) else {
            let score = self.score(prepared, &refined.axis, start).value();
            return Ok(Outcome::Refused(Refusal {
                axis: refined.axis,
                explained: detection.explained,
                score,
                is_denied,
            }));
        };
        if order != start {
            refined = self.refine(surface, refined.axis, order, control)?;
            if self.is_out_of_reach(prepared, &refined.axis) {
                return Ok(Outcome::OutOfReach);
            }
        }
        let score = self.score(prepared, &refined.axis, order);
        let detect = &self.config().detect;
        let axis = &refined.axis;
        let trust = prepared.trust(&score);
        // Where details decide the order, those of the search are of the rest.
        let of_all = detection.order.filter(|_| is_open && detection.details.is_none());
        let rival = match of_all {
            Some(found) => self.rival(prepared, (axis, found, trust), candidates, control)?,
            None => None,
        };
        let answer = Answer { declared, axis, score: &score, detection: &detection, rival, detect, prepared };
        let Remarks { warnings, ambiguous, doubted } = remarks(&answer, candidate, candidates);
        // Where an axis is not certain, one in another direction may be better; orders cannot be compared like that, the
        // smaller one hides less, but half turns with half turns.
        let enough = if is_open && order != Order::Cyclic(2) { TRACKED } else { CERTAIN };
        // Turns of an order that the part does not have may hold an axis beside the right one, with little left of the order.
        let kept = !is_open || candidate.order.is_none_or(|order| keeps(&detection, order));
        let group = if is_open && trust >= TRACKED { group_size(order) } else { 0 };
        Ok(Outcome::Held(Box::new(Held {
            settled: Settled { refined, order, score, detection, ambiguous, warnings },
            is_allowed: !doubted,
            group,
            trust,
            is_certain: trust >= enough && !doubted && kept,
        })))
    }

    /// Another order of the search that explains the data about as well as the one that was `found` about an `axis`, with that much
    /// `trust`: a rough axis fits many, so that each is asked about the axis that it leads to.
    fn rival(
        &self,
        prepared: &Prepared,
        (axis, found, trust): (&Axis, Order, f64),
        candidates: &[Found],
        control: &Control,
    ) -> Result<Option<u32>> {
        /// Share of the trust that it keeps. Of 1260 scans of 180 parts the search leaves such an order beside 31 right answers and
        /// seven wrong ones: with 23 and two of these it keeps less, and the two are doubted for another reason.
        const KEPT: f64 = 0.98;
        for (other, start) in other_orders(axis, found, candidates) {
            let order = Order::Cyclic(other);
            let refined = self.refine(&prepared.surface, start, order, control)?;
            if prepared.trust(&self.score(prepared, &refined.axis, order)) >= KEPT * trust {
                return Ok(Some(other));
            }
        }
        Ok(None)
    }

    /// A remark where a part of the group holds more closely than the whole, unless it was found that the whole does not hold.
    fn closer(&self, prepared: &Prepared, settled: &Settled) -> Option<String> {
        let Order::Cyclic(n) = settled.order else { return None };
        if !settled.detection.allows(settled.order) {
            return None;
        }
        let surface = &prepared.surface;
        let part = closer_part(surface, &settled.refined.axis, n, self.final_gate(surface))?;
        Some(closer_part_holds(n, &part, prepared.diameter))
    }

    /// What becomes of the surface under the turns of an order.
    fn score(&self, prepared: &Prepared, axis: &Axis, order: Order) -> MatchScore {
        let surface = &prepared.surface;
        let turns = Turns::half(order, self.config().refine.max_turns);
        let samples = surface.samples.strided(JUDGED);
        match_score(surface, &samples, axis, &turns, self.final_gate(surface), prepared.sight(axis))
    }

    /// The axis that the caller expects, in the frame of the surface.
    pub(crate) fn hint(&self, prepared: &Prepared) -> Option<Vector3<f64>> {
        self.config()
            .axis_hint
            .map(|hint| prepared.world_from_local.inverse() * Vector3::from(hint).normalize())
    }

    /// Whether an axis has left the part, as one that lies in a flat sheet may, where nothing holds it, or the hint.
    fn is_out_of_reach(&self, prepared: &Prepared, axis: &Axis) -> bool {
        let centroid = prepared.surface.centroid;
        let hint = self.hint(prepared).and_then(|hint| Axis::new(hint, centroid));
        axis.distance(&centroid) > prepared.diameter
            || hint.is_some_and(|hint| axis.angle_to(&hint) > self.config().propose.max_hint_angle)
    }

    /// Finds the order about an axis. Where several views show a part whose order is declared, on a few points, and on all where
    /// these do not allow it.
    fn detect(&self, prepared: &Prepared, axis: &Axis, control: &Control) -> Result<Detection> {
        let (declared, params) = (self.config().order, &self.config().detect);
        if declared != Order::Auto && !prepared.one_view() {
            let few = DetectParams {
                samples: params.samples.min(REMARKED),
                ring_samples: params.ring_samples.min(REMARKED),
                ..params.clone()
            };
            let detection = self.detect_on(prepared, axis, &few, control)?;
            if detection.allows(declared) {
                return Ok(detection);
            }
        }
        self.detect_on(prepared, axis, params, control)
    }

    fn detect_on(
        &self,
        prepared: &Prepared,
        axis: &Axis,
        params: &DetectParams,
        control: &Control,
    ) -> Result<Detection> {
        let surface = &prepared.surface;
        let gate = if surface.oriented { DETECTION_GATE } else { UNSEEN_DETECTION_GATE };
        let [distance, off_plane] = gate.map(|spacings| spacings * surface.spacing);
        let widest = self.final_gate(surface);
        let distance = (prepared.sparseness * distance).min(widest.distance);
        let gate = Gate { distance, off_plane, ..widest };
        let sight = prepared.sight(axis);
        let turning = Turning { surface, axis, gate, sight, witness: Witness::Cameras, control };
        let mut detection = detect_order(&turning, params)?;
        if let Some(rest) = detection.order {
            let shows_details = prepared.visibility.as_ref().is_some_and(|v| v.shows_details);
            let (order, details) = self.with_details(&turning, rest, shows_details, params)?;
            detection.details = details;
            if order != rest {
                let faint = matches!(details, Some(Details::OfOrder { faint: true, .. }));
                // What was faint is the order of the rest.
                (detection.order, detection.faint) = (Some(order), faint);
                detection.looked_for = params.max_order;
            }
        }
        Ok(detection)
    }

    /// The order of a surface with small details, being `rest` without them: teeth, where it seems round, what its rings show, and
    /// where these show no order, its walls.
    fn with_details(
        &self,
        turning: &Turning<'_>,
        rest: Order,
        rings_show_them: bool,
        params: &DetectParams,
    ) -> Result<(Order, Option<Details>)> {
        let Turning { surface, axis, .. } = turning;
        // A declared order is none to be doubted for flanks: of few teeth in sight their number may be one off.
        let may_have_teeth =
            self.config().order == Order::Auto && rest == Order::Continuous && surface.oriented;
        let teeth = may_have_teeth.then(|| teeth(surface, axis, params.max_order)).flatten();
        let toothed = if let Some(Teeth::Number(n)) = teeth { Order::Cyclic(n) } else { rest };
        let of_rings = if rings_show_them { contradicting_details(turning, toothed, params)? } else { None };
        let details = match of_rings {
            Some(Details::OfNone) | None if surface.oriented => {
                contradicting_walls(turning, toothed, params)?.or(of_rings)
            }
            _ => of_rings,
        };
        let of_order =
            |order: u32, faint: bool| (Order::Cyclic(order), Some(Details::OfOrder { order, rest, faint }));
        Ok(match (details, teeth) {
            (Some(Details::OfOrder { order, faint, .. }), _) => of_order(order, faint),
            (None, Some(Teeth::Number(n))) => of_order(n, false),
            (None, Some(Teeth::Unclear)) => (rest, Some(Details::OfNone)),
            (details, _) => (toothed, details),
        })
    }

    /// Aligns on a few of the points, then on many, then moves all points too.
    fn refine(&self, surface: &Surface, start: Axis, order: Order, control: &Control) -> Result<Refined> {
        let Config { residual, refine: params, .. } = self.config();
        let residual = *residual;
        let (half, all) = (Turns::half(order, params.max_turns), Turns::all(order, params.max_joint_turns));
        let last_gate = params.gate * surface.spacing;
        // The last digits of the search are noise, and different ones lead to slightly different ends: without them, two
        // clouds that differ by a rounding error almost always go the same way.
        let start = start.rounded(&surface.centroid, surface.radius, START_STEPS);
        let gates = [params.first_gate(surface.spacing), last_gate];
        let few = surface.samples.strided(COARSE);
        let coarse = Aligner { surface, samples: &few, turns: &half, residual, params };
        let from_beside = self.config().propose.search && !surface.oriented;
        let near = if from_beside {
            coarse.align_from_beside(start, gates, control)?
        } else {
            coarse.align(start, gates, control)?
        };
        let many = surface.samples.scattered(params.samples, surface.spacing);
        let full = RefineParams { max_rounds: params.max_full_rounds, ..params.clone() };
        let fine = Aligner { samples: &many, params: &full, ..coarse };
        let aligned = fine.align(near.axis, [last_gate; 2], control)?;
        Aligner { turns: &all, ..fine }.refine_jointly(&aligned, self.config().joint, control)
    }

    /// How fast matching goes about the axis found.
    pub(crate) fn pace(&self, surface: &Surface, axis: &Axis, order: Order) -> Result<Matrix4<f64>> {
        let Config { residual, refine: params, .. } = self.config();
        matching_pace(surface, axis, &Turns::half(order, params.max_turns), *residual, params)
    }

    /// Errors of the axis found that many residuals have in common.
    pub(crate) fn common_errors(&self, prepared: &Prepared, axis: &Axis, order: Order) -> CommonErrors {
        let surface = &prepared.surface;
        let Config { residual, refine: params, .. } = self.config();
        let turns = Turns::half(order, params.max_turns);
        let of_noise = CommonErrors { inflation: INFLATION, added: Matrix4::zeros() };
        let common = prepared.view_errors.as_ref().map_or(of_noise, |errors| CommonErrors {
            inflation: errors.inflation(),
            added: errors.covariance_of_axis(surface, axis, &turns, *residual, params),
        });
        match &prepared.toward_sensors {
            Some(toward_sensors) => common.seen_from(toward_sensors, axis, surface.spacing),
            None => common,
        }
    }

    /// What a match may differ in where an axis is judged.
    pub(crate) fn final_gate(&self, surface: &Surface) -> Gate {
        let params = &self.config().refine;
        Gate::new(3.0 * surface.spacing, params.max_normal_angle.cos())
    }
}

/// Whether what was found about an axis is no smaller than the order of the search, but for details that decide it.
fn keeps(detection: &Detection, order: Order) -> bool {
    let found = match detection.details {
        Some(Details::OfOrder { rest, .. }) => Some(rest),
        _ => detection.order,
    };
    found.is_some_and(|found| group_size(found) >= group_size(order))
}

/// What became of a candidate.
enum Outcome {
    /// Its axis has ended away from the part, or from the hint.
    OutOfReach,
    /// No order holds about it.
    Refused(Refusal),
    /// One does.
    Held(Box<Held>),
}

/// A refined axis with an order that holds.
struct Held {
    settled: Settled,
    /// Whether what the cameras saw allows the declared order about it.
    is_allowed: bool,
    /// Size of the group, where it was found and is to be trusted.
    group: u32,
    /// How far its score is to be trusted.
    trust: f64,
    /// Whether no other axis need be refined.
    is_certain: bool,
}

impl Held {
    /// Of several the one that is worth most is taken. Where much is hidden a wrong axis may be as good, but seldom allows the
    /// declared order, too.
    fn worth(&self) -> (bool, u32, f64) {
        (self.is_allowed, self.group, self.trust)
    }

    /// Says so when one of the `others` explains the data about as well, now that all are refined.
    fn doubt_beside(&mut self, others: &[Self]) {
        let away = |other: &Self| other.settled.refined.axis.angle_to(&self.settled.refined.axis);
        let rival = others.iter().find(|other| {
            (other.is_allowed, other.group) >= (self.is_allowed, self.group)
                && other.trust >= AS_WELL * self.trust
                && away(other) > APART
        });
        if let Some(angle) = rival.map(away).filter(|_| !self.settled.ambiguous) {
            self.settled.ambiguous = true;
            self.settled.warnings.push(another_axis(angle));
        }
    }
}

/// The candidates that were refined so far.
#[derive(Default)]
struct Trials<'a> {
    count: usize,
    /// Those that need not be tried again, with the angle within which they stand for others of their order \[rad\].
    answered: Vec<(&'a Found, f64)>,
    held: Vec<Held>,
    refusal: Option<Refusal>,
}

impl<'a> Trials<'a> {
    /// Whether one of the same order and nearly the same axis has had its answer.
    fn have_answered(&self, candidate: &Found) -> bool {
        let angle = |tried: &Found| tried.proposal.axis.angle_to(&candidate.proposal.axis);
        self.answered.iter().any(|(tried, within)| tried.order == candidate.order && angle(tried) < *within)
    }

    /// Notes what became of a candidate; whether that ends the search.
    fn end_with(&mut self, candidate: &'a Found, outcome: Outcome) -> bool {
        /// Angle within which an axis that was refused, or one that passed, stands for others of its order \[rad\].
        const REFUSED: f64 = 0.02;
        const PASSED: f64 = 0.17;
        self.count += 1;
        match outcome {
            Outcome::OutOfReach => self.answered.push((candidate, REFUSED)),
            Outcome::Refused(refusal) => {
                self.answered.push((candidate, REFUSED));
                if self.refusal.as_ref().is_none_or(|best| refusal.explained > best.explained) {
                    self.refusal = Some(refusal);
                }
            }
            Outcome::Held(held) => {
                if held.trust >= TRACKED {
                    self.answered.push((candidate, PASSED));
                }
                let is_certain = held.is_certain;
                self.held.push(*held);
                return is_certain;
            }
        }
        false
    }
}

//! The axes that a search or an earlier pose gave, refined one after the other until one holds.

use nalgebra::{Matrix4, Point3, Vector3};

use crate::config::Config;
use crate::control::Control;
use crate::error::{Error, Evidence, Result};
use crate::estimate::Estimator;
use crate::locate::TRACKED;
use crate::prepare::Prepared;
use crate::remarks::{LIKE_PIECES, Remarks, closer_part_holds, lost_returns, remarks};
use crate::symmetry::axis::Axis;
use crate::symmetry::closeness::closer_part;
use crate::symmetry::covariance::{CommonErrors, INFLATION};
use crate::symmetry::details::{Details, contradicting_details};
use crate::symmetry::detect::{Detection, detect_order};
use crate::symmetry::order::{Order, Turns};
use crate::symmetry::pace::matching_pace;
use crate::symmetry::pieces::exchanges_pieces;
use crate::symmetry::refine::{Aligner, RefineParams, Refined};
use crate::symmetry::score::{MatchScore, match_score};
use crate::symmetry::search::{Found, group_size};
use crate::symmetry::surface::{Gate, Surface};
use crate::symmetry::sweep::Turning;

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

/// Points that suffice, where several views show the part, to tell whether they allow a declared order: for a remark, and to try
/// the next axis where they do not.
const REMARKED: usize = 250;

/// What is said first where a scan is refused.
const NO_SYMMETRY: &str = "no rotational symmetry explains the data";

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
        /// Angle within which an axis that was refused, or one that passed, stands for others of its order \[rad\].
        const REFUSED: f64 = 0.02;
        const PASSED: f64 = 0.17;
        /// Score from which on no other axis is refined.
        const CERTAIN: f64 = 0.9;
        let surface = &prepared.surface;
        let declared = self.config().order;
        let mut refusal: Option<Refusal> = None;
        // Where much is hidden a wrong axis may be as good, but seldom allows the declared order, too.
        let mut best: Option<((bool, u32, f64), Settled)> = None;
        let mut answered: Vec<(&Found, f64)> = Vec::new();
        let mut tried = 0;
        for candidate in candidates {
            // What has its answer is not tried again a little beside.
            let stands_for_it = |(f, within): &(&Found, f64)| {
                f.order == candidate.order && f.proposal.axis.angle_to(&candidate.proposal.axis) < *within
            };
            if tried == TRIED {
                break;
            }
            if answered.iter().any(stands_for_it) {
                continue;
            }
            tried += 1;
            // Where no order is known yet, the turns that brought the axis here hold it best.
            let start = candidate.order.unwrap_or(candidate.hypothesis);
            let mut refined = self.refine(surface, candidate.proposal.axis, start, control)?;
            if self.is_beyond_hint(prepared, &refined.axis) {
                answered.push((candidate, REFUSED));
                continue;
            }
            let detection = self.detect(prepared, &refined.axis, control)?;
            let order = if declared == Order::Auto { detection.order } else { Some(declared) };
            let Some(order) = order else {
                if refusal.as_ref().is_none_or(|best| detection.explained > best.explained) {
                    let score = self.score(prepared, &refined.axis, start).value();
                    refusal = Some(Refusal { axis: refined.axis, explained: detection.explained, score });
                }
                answered.push((candidate, REFUSED));
                continue;
            };
            if order != start {
                refined = self.refine(surface, refined.axis, order, control)?;
            }
            let score = self.score(prepared, &refined.axis, order);
            let Remarks { warnings, ambiguous, doubted } =
                remarks(declared, candidate, candidates, &refined.axis, &score, &detection, prepared);
            let trust = prepared.trust(&score);
            // Turns of an order that the part does not have may hold an axis beside the right one, with little left of the order.
            let kept =
                declared != Order::Auto || candidate.order.is_none_or(|order| keeps(&detection, order));
            let group = if declared == Order::Auto && trust >= TRACKED { group_size(order) } else { 0 };
            let worth = (!doubted, group, trust);
            if best.as_ref().is_none_or(|(most, _)| worth > *most) {
                best = Some((worth, Settled { refined, order, score, detection, ambiguous, warnings }));
            }
            // Where an axis is not certain, one in another direction may be better; orders cannot be compared like that, the
            // smaller one hides less.
            let enough = if declared == Order::Auto { TRACKED } else { CERTAIN };
            if trust >= enough && !doubted && kept {
                break;
            }
            if trust >= TRACKED {
                answered.push((candidate, PASSED));
            }
        }
        let (_, mut settled) = best.ok_or_else(|| self.no_symmetry(prepared, refusal))?;
        let Settled { refined: Refined { axis, .. }, order, .. } = &settled;
        if exchanges_pieces(surface, axis, *order, self.final_gate(surface))? {
            settled.ambiguous = true;
            settled.warnings.push(LIKE_PIECES.to_owned());
        }
        settled.warnings.extend(self.closer(prepared, &settled));
        Ok(settled)
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

    /// Whether an axis that began near the hint has ended elsewhere.
    fn is_beyond_hint(&self, prepared: &Prepared, axis: &Axis) -> bool {
        let hint = self.hint(prepared).and_then(|hint| Axis::new(hint, prepared.surface.centroid));
        hint.is_some_and(|hint| axis.angle_to(&hint) > self.config().propose.max_hint_angle)
    }

    /// Finds the order about an axis.
    fn detect(&self, prepared: &Prepared, axis: &Axis, control: &Control) -> Result<Detection> {
        let surface = &prepared.surface;
        let gate = if surface.oriented { DETECTION_GATE } else { UNSEEN_DETECTION_GATE };
        let [distance, off_plane] = gate.map(|spacings| spacings * surface.spacing);
        let widest = self.final_gate(surface);
        let distance = (prepared.sparseness * distance).min(widest.distance);
        let gate = Gate { distance, off_plane, ..widest };
        let mut params = self.config().detect.clone();
        if self.config().order != Order::Auto && !prepared.one_view() {
            params.samples = params.samples.min(REMARKED);
            params.ring_samples = params.ring_samples.min(REMARKED);
        }
        let sight = prepared.sight(axis);
        let turning = Turning { surface, axis, gate, sight, control };
        let mut detection = detect_order(&turning, &params)?;
        let shows_details = prepared.visibility.as_ref().is_some_and(|v| v.shows_details);
        if let Some(order) = detection.order.filter(|_| shows_details) {
            detection.details = contradicting_details(&turning, order, &params)?;
            if let Some(Details::OfOrder { order, .. }) = detection.details {
                // What was faint is the order of the rest.
                (detection.order, detection.faint) = (Some(Order::Cyclic(order)), false);
                detection.looked_for = params.max_order;
            }
        }
        Ok(detection)
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
        let Some(errors) = &prepared.view_errors else {
            return CommonErrors { inflation: INFLATION, of_views: Matrix4::zeros() };
        };
        let Config { residual, refine: params, .. } = self.config();
        let turns = Turns::half(order, params.max_turns);
        let of_views = errors.covariance_of_axis(&prepared.surface, axis, &turns, *residual, params);
        CommonErrors { inflation: errors.inflation(), of_views }
    }

    /// What a match may differ in where an axis is judged.
    pub(crate) fn final_gate(&self, surface: &Surface) -> Gate {
        let params = &self.config().refine;
        Gate::new(3.0 * surface.spacing, params.max_normal_angle.cos())
    }

    fn no_symmetry(&self, prepared: &Prepared, refusal: Option<Refusal>) -> Error {
        let world = |p: Vector3<f64>| (prepared.world_from_local * Point3::from(p)).coords.into();
        let mut advice = String::new();
        if self.config().axis_hint.is_some() {
            advice += "; axis_hint keeps other directions out of the search";
        }
        if !prepared.outward {
            advice += "; give the viewpoint or the order, which say more";
        }
        if self.config().roi.is_none() && refusal.is_some() {
            advice += "; if something else is in the scan, such as what holds the part, set roi, or declare the order";
        }
        let lost = prepared.visibility.as_ref().and_then(|visibility| lost_returns(visibility.dropout));
        advice.extend(lost.map(|lost| format!("; {lost}")));
        let evidence = match refusal {
            Some(Refusal { axis, explained, score }) => Evidence {
                axis: (prepared.world_from_local * axis.direction.into_inner()).into(),
                center: world(axis.point),
                explained,
                score,
                reason: format!(
                    "{NO_SYMMETRY}: about the best axis no rotation maps the part to itself{advice}"
                ),
            },
            None => Evidence {
                center: world(prepared.surface.centroid),
                reason: format!("{NO_SYMMETRY}: no direction within reach could be aligned{advice}"),
                ..Evidence::default()
            },
        };
        Error::NoSymmetry { evidence }
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

/// The best axis about which no order holds.
struct Refusal {
    axis: Axis,
    explained: f64,
    score: f64,
}

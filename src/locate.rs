//! Where the axis is: found by the search, or followed from an earlier pose.

use nalgebra::{Isometry3, Vector3};

use crate::candidates::Settled;
use crate::cloud::PointCloud;
use crate::config::{ClusterMode, Config, GroundMode, TrackingParams};
use crate::error::{Error, Result};
use crate::estimate::Estimator;
use crate::prepare::{LeftOut, Prepared, find_plate, has_background, prepare};
use crate::preprocess::Support;
use crate::result::Estimate;
use crate::rivals::APART;
use crate::stages::Stages;
use crate::symmetry::axis::Axis;
use crate::symmetry::order::Order;
use crate::symmetry::propose::Proposal;
use crate::symmetry::score::MatchScore;
use crate::symmetry::search::{
    Found, HYPOTHESES, LARGER_HYPOTHESES, SearchContext, search_known, search_unknown,
};

/// Score below which a pose counts as lost, and the search goes on.
pub(crate) const TRACKED: f64 = Estimate::TRUSTWORTHY;

/// Score below which a pose tracked on fewer points is refined on all of them: thin walls may have come to rest on one
/// another.
const FOLLOWED: f64 = 0.8;

/// Remark where the whole has no symmetry, but what stands on a plate has.
const OFF_PLATE: &str = "the part was taken to stand on a plate, which was left out: nothing fits with it; set ground = \
                         \"off\" if the plate is of the part, or \"on\" to leave it out at once";

/// Advice where a plate was taken for a piece of the part, of which it may be one.
const ON_PLATE: &str =
    "if what stands on the plate is the part, set ground = \"on\", which leaves the plate out";

/// Remark where the whole has no symmetry, but what stands free before a background has.
const BEFORE_BACKGROUND: &str = "the part was taken to stand free before what the border of the view shows, which was left out: \
                                 nothing fits with it; set roi if the part is another thing";

/// A surface with the axis that was found for it, and the axes that a search considered.
pub(crate) struct Aligned {
    pub(crate) prepared: Prepared,
    pub(crate) candidates: Vec<Found>,
    pub(crate) settled: Settled,
}

impl Aligned {
    /// Whether this is no pose to act on.
    fn is_doubtful(&self) -> bool {
        self.settled.ambiguous || self.prepared.trust(&self.settled.score) < TRACKED
    }

    /// Whether an order was declared, but none would have been found.
    fn is_unexplained(&self) -> bool {
        self.settled.detection.order.is_none()
    }
}

impl Estimator {
    /// The part in a cloud, about the best axis that the search finds.
    pub(crate) fn search(&self, cloud: &PointCloud, stages: &mut Stages) -> Result<Aligned> {
        let prepared = self.prepare(cloud, self.support(), None, stages)?;
        self.search_from(prepared, cloud, stages)
    }

    /// The part in what is left of a cloud; where that does not fit, in what stands free before a background.
    fn search_from(&self, prepared: Prepared, cloud: &PointCloud, stages: &mut Stages) -> Result<Aligned> {
        let whole = self.search_despite_gaps(prepared, cloud, stages);
        let may_be_apart = self.config().cluster == ClusterMode::Main;
        if !may_be_apart || !is_unfit(&whole) || !has_background(cloud, self.config())? {
            return whole;
        }
        let left_out = LeftOut { background: true, ..self.support() };
        self.attempt(cloud, left_out, BEFORE_BACKGROUND, stages)?.map_or(whole, Ok)
    }

    /// The part in what is left of a cloud; where no order holds in the only view, as if that had lost returns in patches.
    fn search_despite_gaps(
        &self,
        prepared: Prepared,
        cloud: &PointCloud,
        stages: &mut Stages,
    ) -> Result<Aligned> {
        let may_be_patchy = self.config().order == Order::Auto && prepared.one_view();
        let refusal = match self.search_with_plate(prepared, cloud, stages) {
            Err(refusal @ Error::NoSymmetry { .. }) if may_be_patchy => refusal,
            found => return found,
        };
        let prepared = self.prepare(cloud, self.support(), None, stages)?.patchy();
        match self.search_on(prepared, stages) {
            Err(Error::NoSymmetry { .. }) => Err(refusal),
            found => found,
        }
    }

    /// The part in what is left of a cloud; where that does not fit, without the plate that it may be fixed to.
    fn search_with_plate(
        &self,
        prepared: Prepared,
        cloud: &PointCloud,
        stages: &mut Stages,
    ) -> Result<Aligned> {
        let may_be_fixed = self.may_be_fixed(&prepared);
        let mut whole = self.search_on(prepared, stages);
        if !is_unfit(&whole) || !may_be_fixed {
            return whole;
        }
        let Some(plate) = find_plate(cloud, self.config())? else { return whole };
        let off_plate = LeftOut { support: Some(Support::Plate), background: false };
        // Together with a plate that it is fixed to, hardly a part is symmetric.
        if plate.is_seen_from_above
            && whole.as_ref().map_or(true, Aligned::is_unexplained)
            && let Some(aligned) = self.attempt(cloud, off_plate, OFF_PLATE, stages)?
        {
            return Ok(aligned);
        }
        match &mut whole {
            Ok(aligned) => aligned.settled.warnings.push(ON_PLATE.to_owned()),
            Err(Error::NoSymmetry { evidence }) => evidence.reason += &format!("; {ON_PLATE}"),
            Err(_) => {}
        }
        whole
    }

    /// The part without what is `left_out`, with a remark on that; `None` where this is no certain answer either.
    fn attempt(
        &self,
        cloud: &PointCloud,
        left_out: LeftOut,
        remark: &str,
        stages: &mut Stages,
    ) -> Result<Option<Aligned>> {
        let figures = stages.figures();
        let prepared = self.prepare(cloud, left_out, None, stages);
        let found = match prepared.and_then(|prepared| self.search_on(prepared, stages)) {
            Ok(mut aligned) => {
                // Round bosses and holes of two-fold outline are on many a part without symmetry.
                let is_telling =
                    self.config().order != Order::Auto || matches!(aligned.settled.order, Order::Cyclic(3..));
                aligned.settled.warnings.push(remark.to_owned());
                let holds = is_telling && !aligned.is_doubtful() && !aligned.is_unexplained();
                holds.then_some(aligned)
            }
            Err(Error::NoSymmetry { .. } | Error::InsufficientData { .. }) => None,
            Err(error) => return Err(error),
        };
        if found.is_none() {
            stages.go_back(figures);
        }
        Ok(found)
    }

    /// Whether the part may be fixed to a plate that was taken for a piece of it.
    fn may_be_fixed(&self, prepared: &Prepared) -> bool {
        prepared.ground.is_none() && self.config().ground == GroundMode::Auto
    }

    /// Refines the axis of an earlier pose: on a few points, where that is not certain on all of them, and where that is
    /// lost searches again.
    pub(crate) fn track(
        &self,
        cloud: &PointCloud,
        initial: Isometry3<f64>,
        stages: &mut Stages,
    ) -> Result<Aligned> {
        let prepared = match self.prepare(cloud, self.support(), Some(&self.config().tracking), stages) {
            // What is too little here may be enough without tracking.
            Err(Error::InsufficientData { .. }) => None,
            prepared => Some(prepared?),
        };
        if let Some(prepared) = prepared
            && let Ok(tracked) = self.refine_from(prepared, cloud, initial, FOLLOWED, stages)?
        {
            return Ok(tracked);
        }
        stages.text("tracking", "not certain on fewer points: refined on all");
        let prepared = self.prepare(cloud, self.support(), None, stages)?;
        match self.refine_from(prepared, cloud, initial, TRACKED, stages)? {
            Ok(tracked) => Ok(tracked),
            Err(prepared) => {
                stages.text("tracking", "lost: searched again");
                self.search_from(prepared, cloud, stages)
            }
        }
    }

    /// Refines the axis of an earlier pose, or gives the surface back where the score is below `least`, or where it is the
    /// part together with its plate.
    fn refine_from(
        &self,
        prepared: Prepared,
        cloud: &PointCloud,
        initial: Isometry3<f64>,
        least: f64,
        stages: &mut Stages,
    ) -> Result<std::result::Result<Aligned, Prepared>> {
        stages.begin("refine")?;
        let local_from_object = prepared.world_from_local.inverse() * initial;
        let direction = local_from_object * Vector3::z();
        let Some(axis) = Axis::new(direction, local_from_object.translation.vector) else {
            return Ok(Err(prepared));
        };
        let proposal = Proposal { axis, score: MatchScore::default() };
        let order = Some(self.config().order).filter(|order| *order != Order::Auto);
        let candidates =
            vec![Found { proposal, order, hypothesis: order.unwrap_or(Order::Continuous), explained: 0.0 }];
        match self.settle(&prepared, &candidates, stages.control()) {
            Ok(settled) if prepared.trust(&settled.score) >= least => {
                // Nothing was searched.
                let tracked = Aligned { prepared, candidates: Vec::new(), settled };
                let is_on_plate = tracked.is_unexplained()
                    && self.may_be_fixed(&tracked.prepared)
                    && find_plate(cloud, self.config())?.is_some_and(|plate| plate.is_seen_from_above);
                Ok(if is_on_plate { Err(tracked.prepared) } else { Ok(tracked) })
            }
            Ok(_) | Err(Error::NoSymmetry { .. }) => Ok(Err(prepared)),
            Err(error) => Err(error),
        }
    }

    /// [`Estimator::search`] on what is left of the cloud.
    fn search_on(&self, prepared: Prepared, stages: &mut Stages) -> Result<Aligned> {
        let is_open = self.config().order == Order::Auto;
        let is_patchy = prepared.visibility.as_ref().is_some_and(|v| v.is_patchy);
        let mut found = self.search_under(&HYPOTHESES, &prepared, stages);
        if let Err(Error::NoSymmetry { .. }) = found
            && is_open
            && !is_patchy
        {
            found = match self.search_under(&LARGER_HYPOTHESES, &prepared, stages) {
                Err(Error::NoSymmetry { .. }) => found,
                second => second,
            };
        }
        if is_open && !is_patchy && prepared.one_view() {
            found = self.unless_round(found, &prepared, stages)?;
        }
        let (candidates, settled) = found?;
        Ok(Aligned { prepared, candidates, settled })
    }

    /// What was found in the only view; where that is no more than a half turn, a surface of revolution about another axis, if it
    /// explains nearly all of the view: few real cameras see one so exactly that no return speaks against it.
    fn unless_round(
        &self,
        found: Result<(Vec<Found>, Settled)>,
        prepared: &Prepared,
        stages: &mut Stages,
    ) -> Result<Result<(Vec<Found>, Settled)>> {
        /// Share of the observed surface that it must explain. In 792 views of 132 parts it explains as much of three that were
        /// called two-fold about a wrong axis, whose axis it has, and of none that is not round or has another axis.
        const NEARLY_ALL: f64 = 0.95;
        let half_turn = match &found {
            Ok((_, settled)) if settled.order == Order::Cyclic(2) => Some(settled.refined.axis),
            Err(Error::NoSymmetry { .. }) => None,
            _ => return Ok(found),
        };
        let as_round = Self::new(Config { order: Order::Continuous, ..self.config().clone() })?;
        let (mut candidates, mut settled) = match as_round.search_under(&[], prepared, stages) {
            Err(Error::NoSymmetry { .. }) => return Ok(found),
            round => round?,
        };
        let is_same = half_turn.is_some_and(|axis| axis.angle_to(&settled.refined.axis) < APART);
        let explained = settled.explained();
        if is_same || explained < NEARLY_ALL || prepared.trust(&settled.score) < TRACKED {
            return Ok(found);
        }
        settled.taken_for_round(explained);
        candidates.extend(found.into_iter().flat_map(|(others, _)| others));
        Ok(Ok((candidates, settled)))
    }

    /// The best axis and all candidates; where the order is open, of those that turns of the `hypotheses` lead to.
    fn search_under(
        &self,
        hypotheses: &[Order],
        prepared: &Prepared,
        stages: &mut Stages,
    ) -> Result<(Vec<Found>, Settled)> {
        let config = self.config();
        stages.begin("propose")?;
        let surface = &prepared.surface;
        let hints: Vec<Vector3<f64>> =
            prepared.ground.iter().map(|[x, y, z, _]| Vector3::new(*x, *y, *z)).collect();
        let context = SearchContext {
            diameter: prepared.diameter,
            hints: &hints,
            within: self.hint(prepared),
            visibility: prepared.visibility.as_ref(),
            propose: &config.propose,
            detect: &config.detect,
            gate: self.final_gate(surface),
            control: stages.control(),
        };
        let candidates = match config.order {
            Order::Auto => search_unknown(surface, hypotheses, &context)?,
            order => search_known(surface, order, &context)?,
        };
        stages.begin("refine")?;
        let settled = self.settle(prepared, &candidates, stages.control())?;
        Ok((candidates, settled))
    }

    /// What is left out in the first place: what the part is taken to stand on.
    fn support(&self) -> LeftOut {
        LeftOut { support: Support::sought(self.config().ground), background: false }
    }

    fn prepare(
        &self,
        cloud: &PointCloud,
        left_out: LeftOut,
        tracking: Option<&TrackingParams>,
        stages: &mut Stages,
    ) -> Result<Prepared> {
        stages.begin("input")?;
        prepare(cloud, self.config(), left_out, tracking, stages)
    }
}

/// Whether nothing was found, or nothing to act on.
fn is_unfit(found: &Result<Aligned>) -> bool {
    match found {
        Ok(aligned) => aligned.is_doubtful() || aligned.is_unexplained(),
        Err(error) => matches!(error, Error::NoSymmetry { .. }),
    }
}

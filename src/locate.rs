//! Where the axis is: found by the search, or followed from an earlier pose.

use nalgebra::{Isometry3, Vector3};

use crate::candidates::Settled;
use crate::cloud::PointCloud;
use crate::config::TrackingParams;
use crate::error::{Error, Result};
use crate::estimate::Estimator;
use crate::prepare::{Prepared, is_on_plate, prepare};
use crate::result::Estimate;
use crate::stages::Stages;
use crate::symmetry::axis::Axis;
use crate::symmetry::order::Order;
use crate::symmetry::propose::Proposal;
use crate::symmetry::score::MatchScore;
use crate::symmetry::search::{Found, SearchContext, search_known, search_unknown};

/// Score below which a pose counts as lost, and the search goes on.
pub(crate) const TRACKED: f64 = Estimate::TRUSTWORTHY;

/// Score below which a pose tracked on fewer points is refined on all of them: thin walls may have come to rest on one
/// another.
const FOLLOWED: f64 = 0.8;

/// Advice where a plate was taken for a piece of the part, of which it may be one.
const PLATE: &str =
    "; if what stands on the plate is the part, set ground = \"on\", which leaves the plate out";

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
}

impl Estimator {
    /// The part in a cloud, about the best axis that the search finds.
    pub(crate) fn search(&self, cloud: &PointCloud, stages: &mut Stages) -> Result<Aligned> {
        let prepared = self.prepare(cloud, None, stages)?;
        let has_ground = prepared.ground.is_some();
        // Together with a plate that it is fixed to, hardly a part is symmetric.
        let is_on_plate = || !has_ground && is_on_plate(cloud, self.config()).unwrap_or(false);
        match self.search_on(prepared, stages) {
            Ok(mut aligned) => {
                if aligned.is_doubtful() && is_on_plate() {
                    aligned.settled.warnings.push(PLATE.to_owned());
                }
                Ok(aligned)
            }
            Err(Error::NoSymmetry { mut evidence }) => {
                if is_on_plate() {
                    evidence.reason += &format!("; {PLATE}");
                }
                Err(Error::NoSymmetry { evidence })
            }
            error => error,
        }
    }

    /// Refines the axis of an earlier pose: on a few points, where that is not certain on all of them, and where that is
    /// lost searches again.
    pub(crate) fn track(
        &self,
        cloud: &PointCloud,
        initial: Isometry3<f64>,
        stages: &mut Stages,
    ) -> Result<Aligned> {
        let prepared = match self.prepare(cloud, Some(&self.config().tracking), stages) {
            // What is too little here may be enough without tracking.
            Err(Error::InsufficientData { .. }) => None,
            prepared => Some(prepared?),
        };
        if let Some(prepared) = prepared
            && let Ok(tracked) = self.refine_from(prepared, initial, FOLLOWED, stages)?
        {
            return Ok(tracked);
        }
        stages.text("tracking", "not certain on fewer points: refined on all");
        let prepared = self.prepare(cloud, None, stages)?;
        match self.refine_from(prepared, initial, TRACKED, stages)? {
            Ok(tracked) => Ok(tracked),
            Err(prepared) => {
                stages.text("tracking", "lost: searched again");
                self.search_on(prepared, stages)
            }
        }
    }

    /// Refines the axis of an earlier pose, or gives the surface back where the score is below `least`.
    fn refine_from(
        &self,
        prepared: Prepared,
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
        Ok(match self.settle(&prepared, &candidates, stages.control()) {
            Ok(settled) if prepared.trust(&settled.score) >= least => {
                // Nothing was searched.
                Ok(Aligned { prepared, candidates: Vec::new(), settled })
            }
            Ok(_) | Err(Error::NoSymmetry { .. }) => Err(prepared),
            Err(error) => return Err(error),
        })
    }

    /// [`Estimator::search`] on what is left of the cloud.
    fn search_on(&self, prepared: Prepared, stages: &mut Stages) -> Result<Aligned> {
        let config = self.config();
        stages.begin("propose")?;
        let surface = &prepared.surface;
        let hints: Vec<Vector3<f64>> =
            prepared.ground.iter().map(|[x, y, z, _]| Vector3::new(*x, *y, *z)).collect();
        let context = SearchContext {
            diameter: prepared.diameter,
            hints: &hints,
            within: self.hint(&prepared),
            visibility: prepared.visibility.as_ref(),
            propose: &config.propose,
            detect: &config.detect,
            gate: self.final_gate(surface),
            control: stages.control(),
        };
        let candidates = match config.order {
            Order::Auto => search_unknown(surface, &context)?,
            order => search_known(surface, order, &context)?,
        };
        stages.begin("refine")?;
        let settled = self.settle(&prepared, &candidates, stages.control())?;
        Ok(Aligned { prepared, candidates, settled })
    }

    fn prepare(
        &self,
        cloud: &PointCloud,
        tracking: Option<&TrackingParams>,
        stages: &mut Stages,
    ) -> Result<Prepared> {
        stages.begin("input")?;
        prepare(cloud, self.config(), tracking, stages)
    }
}

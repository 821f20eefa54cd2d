//! What every setting of a [`Config`] may be.

use std::fmt::{Display, LowerExp};
use std::ops::{RangeBounds, RangeInclusive};

use crate::config::{Config, OutlierParams, SEEDS, TrackingParams};
use crate::error::{Error, Result, shown};
use crate::preprocess::{GroundParams, NormalParams, SmoothingParams};
use crate::symmetry::detect::DetectParams;
use crate::symmetry::order::MAX_ORDER;
use crate::symmetry::propose::ProposeParams;
use crate::symmetry::refine::RefineParams;

/// Threads of one estimate, at most: to start many thousands takes longer than the work, and nothing can stop it.
const MAX_THREADS: usize = 1024;

/// Starting directions of a search, at most: 1.4 degrees apart.
const MAX_DIRECTIONS: usize = 10_000;

/// Neighbours of a point, at most: what is kept of them grows with their number times that of the points.
const MAX_NEIGHBORS: usize = 1000;

/// Rotations, rounds and steps, at most: more of them would not be more exact, only slower.
const MAX_REPEATS: usize = 1000;

/// Distance between clusters, at least and at most [diameters]: with more nothing is left out, and no product overflows.
const DISTANCES: RangeInclusive<f64> = 1e-4..=1e6;

impl Config {
    /// Checks every setting.
    ///
    /// # Errors
    /// [`Error::InvalidParameter`] naming the first setting outside its domain.
    pub fn validate(&self) -> Result<()> {
        self.order.validate()?;
        // TOML has no larger number, and a configuration must survive a file.
        within("seed", self.seed, 0..=i64::MAX as u64, SEEDS)?;
        if let Some(threads) = self.threads {
            within("threads", threads, 1..=MAX_THREADS, "1 to 1,024 threads, or none for all cores")?;
        }
        if let Some(size) = self.voxel_size {
            positive("voxel_size", size)?;
        }
        self.check_directions()?;
        self.plane.validate()?;
        self.outliers.validate()?;
        self.normals.validate()?;
        self.smoothing.validate()?;
        self.propose.validate()?;
        self.detect.validate()?;
        self.refine.validate()?;
        self.tracking.validate()
    }

    /// Checks the region of interest and the axis hint.
    fn check_directions(&self) -> Result<()> {
        if let Some([lower, upper]) = self.roi
            && !(0..3).all(|axis| lower[axis] < upper[axis] && (upper[axis] - lower[axis]).is_finite())
        {
            return Err(Error::InvalidParameter {
                name: "roi",
                value: format!("{lower:?} .. {upper:?}"),
                expected: "finite corners, the lower one below the upper one in every coordinate",
            });
        }
        if let Some(hint) = self.axis_hint
            && !hint.iter().map(|x| x * x).sum::<f64>().sqrt().is_normal()
        {
            return Err(Error::InvalidParameter {
                name: "axis_hint",
                value: format!("{hint:?}"),
                expected: "a finite direction other than zero",
            });
        }
        Ok(())
    }
}

impl GroundParams {
    fn validate(&self) -> Result<()> {
        positive("plane.rough_distance", self.rough_distance)?;
        positive("plane.band", self.band)?;
        share("plane.one_sided", self.one_sided)?;
        positive("plane.reach", self.reach)?;
        share("plane.free_directions", self.free_directions)?;
        not_negative("plane.outline", self.outline)?;
        at_least_one("plane.max_planes", self.max_planes)
    }
}

impl OutlierParams {
    fn validate(&self) -> Result<()> {
        positive("outliers.radius", self.radius)?;
        let neighbors = "2 to 1,000 neighbours, the point itself included";
        within("outliers.k", self.k, 2..=MAX_NEIGHBORS, neighbors)?;
        within("outliers.min_neighbors", self.min_neighbors, ..self.k, "fewer neighbours than outliers.k")?;
        positive("outliers.std_ratio", self.std_ratio)?;
        positive_or_off("outliers.scattered", self.scattered)?;
        positive_or_off("outliers.off_surface", self.off_surface)?;
        within(
            "outliers.cluster_distance",
            self.cluster_distance,
            DISTANCES,
            "a share of the diameter from 0.0001 to 1,000,000",
        )?;
        share("outliers.cluster_ratio", self.cluster_ratio)
    }
}

impl NormalParams {
    fn validate(&self) -> Result<()> {
        within("normals.k", self.k, 3..=MAX_NEIGHBORS, "3 to 1,000 neighbours, the point itself included")?;
        positive_or_off("normals.max_radius", self.max_radius)
    }
}

impl SmoothingParams {
    fn validate(&self) -> Result<()> {
        positive("smoothing.ray_noise", self.ray_noise)?;
        positive("smoothing.max_tilt", self.max_tilt)?;
        let neighbors = "0 to 1,000 neighbours";
        within("smoothing.ray_neighbors", self.ray_neighbors, ..=MAX_NEIGHBORS, neighbors)?;
        within("smoothing.max_neighbors", self.max_neighbors, ..=MAX_NEIGHBORS, neighbors)?;
        self.max_angle.map_or(Ok(()), |limit| angle("smoothing.max_angle", limit))
    }
}

impl ProposeParams {
    fn validate(&self) -> Result<()> {
        within("propose.directions", self.directions, 1..=MAX_DIRECTIONS, "1 to 10,000 directions")?;
        self.samples.iter().try_for_each(|&samples| at_least_one("propose.samples", samples))?;
        self.kept.iter().try_for_each(|&kept| at_least_one("propose.kept", kept))?;
        repeats("propose.max_turns", self.max_turns)?;
        gate("propose.gate", self.gate)?;
        positive("propose.distinct_angle", self.distinct_angle)?;
        positive("propose.distinct_offset", self.distinct_offset)?;
        angle("propose.max_hint_angle", self.max_hint_angle)
    }
}

impl DetectParams {
    fn validate(&self) -> Result<()> {
        within("detect.max_order", self.max_order, 2..=MAX_ORDER, "an order from 2 to 360")?;
        at_least_one("detect.samples", self.samples)?;
        at_least_one("detect.ring_samples", self.ring_samples)?;
        share("detect.structured", self.structured)?;
        share("detect.continuous", self.continuous)?;
        not_negative("detect.tolerance", self.tolerance)?;
        not_negative("detect.worst_tolerance", self.worst_tolerance)?;
        share("detect.support", self.support)?;
        share("detect.refused", self.refused)?;
        share("detect.explained", self.explained)?;
        share("detect.explained_seamed", self.explained_seamed)?;
        share("detect.unseen_refused", self.unseen_refused)?;
        share("detect.unseen_refused_half", self.unseen_refused_half)?;
        not_negative("detect.unseen_gain", self.unseen_gain)?;
        share("detect.twisted", self.twisted)?;
        not_negative("detect.unseen_gain_round", self.unseen_gain_round)
    }
}

impl RefineParams {
    fn validate(&self) -> Result<()> {
        at_least_one("refine.samples", self.samples)?;
        repeats("refine.max_turns", self.max_turns)?;
        repeats("refine.max_joint_turns", self.max_joint_turns)?;
        repeats("refine.max_rounds", self.max_rounds)?;
        repeats("refine.max_full_rounds", self.max_full_rounds)?;
        repeats("refine.max_joint_steps", self.max_joint_steps as usize)?;
        gate("refine.gate", self.gate)?;
        angle("refine.max_normal_angle", self.max_normal_angle)?;
        positive("refine.huber_width", self.huber_width)?;
        positive("refine.tolerance", self.tolerance)?;
        positive("refine.anchor", self.anchor)
    }
}

impl TrackingParams {
    fn validate(&self) -> Result<()> {
        at_least_one("tracking.points", self.points)?;
        within("tracking.coarsening", self.coarsening, 1.0..f64::INFINITY, "a finite factor of at least 1")
    }
}

fn within<T: PartialOrd + Display + LowerExp>(
    name: &'static str,
    value: T,
    domain: impl RangeBounds<T>,
    expected: &'static str,
) -> Result<()> {
    if domain.contains(&value) {
        return Ok(());
    }
    Err(Error::InvalidParameter { name, value: shown(value), expected })
}

fn at_least_one(name: &'static str, count: usize) -> Result<()> {
    within(name, count, 1.., "at least 1")
}

fn repeats(name: &'static str, count: usize) -> Result<()> {
    within(name, count, 1..=MAX_REPEATS, "1 to 1,000")
}

fn share(name: &'static str, value: f64) -> Result<()> {
    within(name, value, 0.0..=1.0, "a share from 0 to 1")
}

fn not_negative(name: &'static str, value: f64) -> Result<()> {
    within(name, value, 0.0..f64::INFINITY, "a finite number, zero or more")
}

pub(crate) fn positive(name: &'static str, value: f64) -> Result<()> {
    within(name, value, f64::MIN_POSITIVE..f64::INFINITY, "a positive, finite number")
}

fn gate(name: &'static str, value: f64) -> Result<()> {
    within(name, value, f64::MIN_POSITIVE..=*DISTANCES.end(), "a positive number up to 1,000,000")
}

fn angle(name: &'static str, value: f64) -> Result<()> {
    within(name, value, f64::MIN_POSITIVE..=std::f64::consts::PI, "a positive angle up to pi [rad]")
}

fn positive_or_off(name: &'static str, limit: Option<f64>) -> Result<()> {
    limit.map_or(Ok(()), |limit| positive(name, limit))
}

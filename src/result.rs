//! [`Estimate`]: the pose of a part and everything that was found with it.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use crate::symmetry::order::Order;

/// A motion that leaves the part looking the same, so that the data cannot fix it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum FreeDirection {
    /// Rotation about the axis.
    Yaw,
    /// Translation along the axis.
    Slide,
    /// Rotation of the axis itself.
    Tilt,
    /// Translation across the axis.
    Shift,
}

/// An axis that was considered.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Candidate {
    /// Unit direction, world frame.
    pub axis: [f64; 3],
    /// The point of the axis nearest to the centroid of the part, world frame.
    pub center: [f64; 3],
    /// Order that was tried or found; `Auto` where none was found about it.
    pub order: Order,
    /// Match score in [0, 1].
    pub score: f64,
}

/// The pose of a part, how far to trust it, and what was done to find it.
#[derive(Debug, Clone)]
pub struct Estimate {
    /// Pose: +z the symmetry axis, +x the primary orientation, the origin on the axis.
    pub world_from_object: Isometry3<f64>,
    /// Order of the symmetry: never `Auto`.
    pub order: Order,
    /// Calibrated trust in [0, 1]; from [`Estimate::TRUSTWORTHY`] on it is a pose to act on.
    pub score: f64,
    /// Share of the observed surface that the symmetry explains, in [0, 1].
    pub explained: f64,
    /// Covariance in the object frame: rotation x y z \[rad\], then translation x y z; infinite on the diagonal of a
    /// free direction, with zeros beside it.
    pub covariance: [[f64; 6]; 6],
    /// Motions that the data does not fix.
    pub unobservable: Vec<FreeDirection>,
    /// What the caller should know.
    pub warnings: Vec<String>,
    /// Refined points of the object, world frame.
    pub points: Vec<[f64; 3]>,
    /// Unit normals of `points`, world frame.
    pub normals: Vec<[f64; 3]>,
    /// Input points behind them.
    pub inliers: Vec<u32>,
    /// For each inlier its row in `points`.
    pub point_of_inlier: Vec<u32>,
    /// Union of the rotated copies, world frame.
    pub completed: Vec<[f64; 3]>,
    /// For each completed point the sector it came from; 0: measured.
    pub completed_sector: Vec<u32>,
    /// Support plane: unit normal toward the part, and d, with n . x + d = 0.
    pub ground: Option<[f64; 4]>,
    /// Angle \[rad\] and match score in [0, 1].
    pub match_curve: Vec<[f64; 2]>,
    /// The axes that the search considered, the preferred ones first; the answer began from one of the first. Empty where an
    /// earlier pose was followed.
    pub candidates: Vec<Candidate>,
    /// Seconds spent in each stage.
    pub timings: BTreeMap<String, f64>,
    /// Counts and figures of each stage, by name.
    pub diagnostics: BTreeMap<String, Diagnostic>,
}

impl Estimate {
    /// Score from which on a pose can be acted on: those below are wrong, or one of several that the data allows, far more often.
    pub const TRUSTWORTHY: f64 = 0.5;

    /// Whether the score reaches [`Estimate::TRUSTWORTHY`].
    #[must_use]
    pub fn is_trustworthy(&self) -> bool {
        self.score >= Self::TRUSTWORTHY
    }

    /// In terms of a whole scan, of which the cloud held only these `rows`; `warnings` of how they were chosen come first.
    #[cfg(any(feature = "cli", feature = "python"))]
    #[must_use]
    pub(crate) fn of_scan(mut self, rows: Option<&[u32]>, warnings: Vec<String>) -> Self {
        if let Some(rows) = rows {
            self.inliers.iter_mut().for_each(|inlier| *inlier = rows[*inlier as usize]);
        }
        self.warnings.splice(0..0, warnings);
        self
    }

    /// Turns about +z of the object that leave the part as it looks, the identity first: as many as its order, or `steps` (at
    /// least one) of a continuous symmetry.
    pub fn symmetries(&self, steps: u32) -> impl ExactSizeIterator<Item = UnitQuaternion<f64>> + use<> {
        let count = if let Order::Cyclic(n) = self.order { n } else { steps.max(1) };
        let turn = std::f64::consts::TAU / f64::from(count);
        (0..count).map(move |k| UnitQuaternion::from_axis_angle(&Vector3::z_axis(), turn * f64::from(k)))
    }

    /// Poses that look the same: `world_from_object` turned by each of the [`Estimate::symmetries`], itself first.
    #[must_use]
    pub fn equivalent_poses(&self, steps: u32) -> Vec<Isometry3<f64>> {
        self.symmetries(steps).map(|turn| self.world_from_object * turn).collect()
    }
}

/// One figure or remark of a stage.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
#[non_exhaustive]
pub enum Diagnostic {
    /// A yes or no.
    Flag(bool),
    /// A count or measure; lengths in the unit of the cloud, angles in radians.
    Number(f64),
    /// A choice that was made, and why.
    Text(String),
    /// A series.
    Series(Vec<f64>),
}

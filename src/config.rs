//! [`Config`]: every setting of the pipeline, nested by stage, with defaults that fit any unit.

use serde::de::{Unexpected, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

use crate::preprocess::{GroundParams, NormalParams, SmoothingParams, StatisticalParams};
use crate::symmetry::detect::DetectParams;
use crate::symmetry::order::Order;
use crate::symmetry::propose::ProposeParams;
use crate::symmetry::refine::RefineParams;

/// What to do with points that have a NaN or infinite coordinate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NonFinite {
    /// Leave them out and count them.
    #[default]
    Drop,
    /// Refuse the cloud.
    Error,
}

/// Whether a support plane is looked for and removed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GroundMode {
    /// Remove a plane only when it passes the support test; one with its sides in sight, as a plate has, only where no order
    /// is found together with it.
    #[default]
    Auto,
    /// Remove the largest plane that has the rest of the scene, but for its own sides, on one side.
    On,
    /// Remove nothing.
    Off,
}

/// Which part of the cloud is taken as the object.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ClusterMode {
    /// The main cluster, with the pieces that belong to it.
    #[default]
    Main,
    /// Everything.
    Off,
}

/// The distance that the symmetry minimises.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Residual {
    /// Along the mean of both normals (Rusinkiewicz 2019).
    #[default]
    PointToPlane,
    /// Between the points themselves: the paper's.
    PointToPoint,
    /// Between local Gaussians (GICP; Segal et al. 2009).
    Distribution,
}

/// Where on the axis the origin of the object lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Origin {
    /// Centroid of the completed cloud: the paper's.
    #[default]
    Centroid,
    /// Where the axis meets the support plane; without one, the lower end of the completed cloud.
    Base,
    /// Middle between both ends of the completed cloud.
    Midpoint,
}

/// How the primary orientation about the axis is chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Yaw {
    /// Phase of the n-th angular harmonic of the outline, where it has none of the flanks of blades and spokes, else of the area; on
    /// the mirror plane near it where the part has one.
    #[default]
    Harmonic,
    /// Extreme of the angular histogram of the completed cloud: the paper's.
    Histogram,
}

/// How stray points are told from the part.
///
/// The limits on density (`radius`, `std_ratio`, `scattered`) hold where strays are many. Few strays are far from each
/// other, so where `scattered` finds few, all three are 1.6 times as wide and spare what the part shows of itself at a
/// grazing angle or through a gap.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OutlierParams {
    /// Radius of the radius filter \[voxels\].
    pub radius: f64,
    /// Neighbours that a point must have within that radius \[count\]; less than `k`, and 0 for no such filter.
    pub min_neighbors: usize,
    /// Neighbours of the statistical filter, the point itself included \[count\].
    pub k: usize,
    /// Standard deviations beyond the mean at which the statistical filter cuts.
    pub std_ratio: f64,
    /// Distance of the farthest of `min_neighbors` beyond which a point is stray, unless its neighbours lie in a plane
    /// [median of those that do]; `None` keeps it.
    #[serde(deserialize_with = "limit_or_off")]
    pub scattered: Option<f64>,
    /// Distance from the plane through its neighbours beyond which a point is stray [their standard deviations about it];
    /// `None` keeps it. Counts where viewpoints are known.
    #[serde(deserialize_with = "limit_or_off")]
    pub off_surface: Option<f64>,
    /// Drops what a camera saw through: a ray that went on to something farther met no surface.
    pub seen_through: bool,
    /// Gap that separates clusters \[diameters\].
    pub cluster_distance: f64,
    /// Size at which a cluster is kept beside the main one [share of the main one].
    pub cluster_ratio: f64,
}

impl Default for OutlierParams {
    fn default() -> Self {
        Self {
            radius: 3.0,
            min_neighbors: 4,
            k: 20,
            std_ratio: 5.0,
            scattered: Some(2.0),
            off_surface: Some(6.0),
            seen_through: true,
            cluster_distance: 0.05,
            cluster_ratio: 0.05,
        }
    }
}

impl OutlierParams {
    pub(crate) fn statistical(&self, leniency: f64) -> StatisticalParams {
        StatisticalParams { k: self.k, std_ratio: leniency * self.std_ratio }
    }
}

/// How a pose that is known from before is followed: quickly, on fewer points than a part is searched and measured on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrackingParams {
    /// Edge of a voxel where none is given [edge without tracking]; at least 1.
    pub coarsening: f64,
    /// Input points of the part that are looked at, at most; where there are more, every n-th \[count\].
    pub points: usize,
}

impl Default for TrackingParams {
    fn default() -> Self {
        Self { coarsening: 2.0, points: 100_000 }
    }
}

/// Every setting of an estimate. Lengths left `None` are found from the spacing of the points and the size of the part.
///
/// ```
/// use sympose::{Config, Order};
/// let config = Config { order: Order::Cyclic(5), voxel_size: Some(0.002), ..Config::default() };
/// assert!(config.validate().is_ok());
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Order of the symmetry.
    pub order: Order,
    /// Seed of everything random.
    #[serde(deserialize_with = "seed")]
    pub seed: u64,
    /// Worker threads in a pool of its own; `None`: the pool of the caller. A program that estimates many clouds in parallel
    /// should set it, 1 at best: a worker that waits within one estimate would otherwise begin the next one there.
    pub threads: Option<usize>,
    /// Points with a NaN or infinite coordinate.
    pub non_finite: NonFinite,
    /// Lower and upper corner of the region of interest, world frame \[length\]; points outside are ignored.
    pub roi: Option<[[f64; 3]; 2]>,
    /// Rough direction of the axis, world frame, sign ignored; the search stays within 30 degrees of it.
    pub axis_hint: Option<[f64; 3]>,
    /// Where no viewpoint is given, finds the places of the sensor from the order of the points, if that is the one in which
    /// a depth image is read out.
    pub viewpoints_from_order: bool,
    /// Support plane.
    pub ground: GroundMode,
    /// Edge of a voxel \[length\].
    pub voxel_size: Option<f64>,
    /// Cluster that is kept.
    pub cluster: ClusterMode,
    /// Residual that the refinement minimises.
    pub residual: Residual,
    /// Whether points and axis are optimised together, or the axis alone.
    pub joint: bool,
    /// Origin on the axis.
    pub origin: Origin,
    /// Rule for the primary orientation.
    pub yaw: Yaw,
    /// Details of the search for the support plane.
    pub plane: GroundParams,
    /// Details of the filters.
    pub outliers: OutlierParams,
    /// Details of the normals.
    pub normals: NormalParams,
    /// Details of smoothing.
    pub smoothing: SmoothingParams,
    /// Details of the search for the axis.
    pub propose: ProposeParams,
    /// Details of finding the order.
    pub detect: DetectParams,
    /// Details of the refinement.
    pub refine: RefineParams,
    /// Details of tracking from an initial pose.
    pub tracking: TrackingParams,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            order: Order::default(),
            seed: 0,
            threads: None,
            non_finite: NonFinite::default(),
            roi: None,
            axis_hint: None,
            viewpoints_from_order: true,
            ground: GroundMode::default(),
            voxel_size: None,
            cluster: ClusterMode::default(),
            residual: Residual::default(),
            joint: true,
            origin: Origin::default(),
            yaw: Yaw::default(),
            plane: GroundParams::default(),
            outliers: OutlierParams::default(),
            normals: NormalParams::default(),
            smoothing: SmoothingParams::default(),
            propose: ProposeParams::default(),
            detect: DetectParams::default(),
            refine: RefineParams::default(),
            tracking: TrackingParams::default(),
        }
    }
}

impl Config {
    /// The method of Dai et al. (arXiv 2606.16593): plane fit and centroid as the initial pose, point-to-point residuals, joint
    /// optimisation, yaw from the histogram, origin at the centroid. The foreground and the support plane are found by the rules
    /// of this crate all the same, and its rounds of alignment to planes bring the initial pose near before points are aligned
    /// (ARCHITECTURE.md, where it departs from the paper).
    #[must_use]
    pub fn paper() -> Self {
        Self {
            residual: Residual::PointToPoint,
            yaw: Yaw::Histogram,
            outliers: OutlierParams {
                scattered: None,
                off_surface: None,
                seen_through: false,
                ..OutlierParams::default()
            },
            smoothing: SmoothingParams {
                join_layers: false,
                ray_neighbors: 0,
                max_neighbors: 0,
                max_angle: None,
                ..SmoothingParams::default()
            },
            propose: ProposeParams { search: false, ..ProposeParams::default() },
            ..Self::default()
        }
    }
}

/// A limit that may be off: a number, or `"off"`, which TOML can say, or null, which it cannot.
pub(crate) fn limit_or_off<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> std::result::Result<Option<f64>, D::Error> {
    #[derive(Deserialize)]
    #[serde(rename_all = "snake_case")]
    enum Off {
        Off,
    }
    #[derive(Deserialize)]
    #[serde(untagged, expecting = "expected a number or \"off\"")]
    enum Limit {
        Number(f64),
        Off(Off),
        Null(()),
    }
    Ok(match Limit::deserialize(deserializer)? {
        Limit::Number(limit) => Some(limit),
        Limit::Off(Off::Off) | Limit::Null(()) => None,
    })
}

pub(crate) const SEEDS: &str = "a whole number from 0 to 9,223,372,036,854,775,807 (2^63 - 1)";

/// A seed; what is none is answered with the range.
pub(crate) fn seed<'de, D: Deserializer<'de>>(deserializer: D) -> std::result::Result<u64, D::Error> {
    struct Seed;
    impl Visitor<'_> for Seed {
        type Value = u64;

        fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
            f.write_str(SEEDS)
        }

        fn visit_u64<E: serde::de::Error>(self, seed: u64) -> std::result::Result<u64, E> {
            Ok(seed)
        }

        fn visit_i64<E: serde::de::Error>(self, seed: i64) -> std::result::Result<u64, E> {
            u64::try_from(seed).map_err(|_| E::invalid_value(Unexpected::Signed(seed), &self))
        }
    }
    deserializer.deserialize_u64(Seed)
}

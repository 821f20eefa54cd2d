//! What can be said on the command line.

use std::path::PathBuf;
use std::time::Duration;

use clap::{Args, Parser, Subcommand};
use serde::de::value::{Error as ValueError, StrDeserializer};
use serde::de::{DeserializeOwned, IntoDeserializer};

use crate::config::{ClusterMode, Config, GroundMode, Origin, Residual, Yaw};
use crate::error::{Error, Result};
use crate::symmetry::order::Order;

const EXAMPLES: &str = "\
Examples:
  sympose info scan.ply
  sympose estimate scan.ply
  sympose estimate scan.pcd --order 5 --json pose.json --completed whole.ply
  sympose estimate scan.ply --order auto --viewpoint 0 0 -1.5 --json - | jq .pose
  sympose plane scene.ply --remove part.ply
  sympose filter scan.ply clean.ply --voxel-size 0.5 --radius 2 --min-neighbors 8

Exit codes: 0 done, 1 no trustworthy pose, 2 bad usage or input, 130 cancelled.";

/// Pose of a rotationally symmetric part from a raw point cloud, without a CAD model.
///
/// Scans are PLY, PCD or text files (XYZ, TXT, CSV, PTS); the Python package also reads NPY, NPZ and COLMAP folders.
/// Lengths are in the unit of the file.
#[derive(Debug, Parser)]
#[command(name = "sympose", version, after_help = EXAMPLES, allow_negative_numbers = true)]
pub(super) struct Cli {
    #[command(subcommand)]
    pub(super) command: Command,
}

#[derive(Debug, Subcommand)]
pub(super) enum Command {
    Estimate(EstimateArgs),
    Filter(FilterArgs),
    Plane(PlaneArgs),
    Info(InfoArgs),
}

/// Find the pose of the part in a scan.
///
/// Prints a summary, or with --json the schema that the Python package shares.
#[derive(Debug, Args)]
pub(super) struct EstimateArgs {
    /// PLY, PCD, XYZ, TXT, CSV or PTS file.
    pub(super) scan: PathBuf,
    /// Order of the symmetry: a whole number from 2, "continuous" or "auto".
    #[arg(long, value_name = "N|continuous|auto")]
    order: Option<Order>,
    /// Where the sensor stood; wins over the viewpoint in the file. Without either, it is found from the order of the points
    /// where that is the one of a depth image.
    #[arg(long, num_args = 3, value_names = ["X", "Y", "Z"], allow_hyphen_values = true)]
    viewpoint: Option<Vec<f64>>,
    /// Lower and upper corner of the box that holds the part.
    #[arg(long, num_args = 6, value_names = ["X0", "Y0", "Z0", "X1", "Y1", "Z1"], allow_hyphen_values = true)]
    roi: Option<Vec<f64>>,
    /// Rough direction of the axis, within 30 degrees; the sign does not matter.
    #[arg(long, num_args = 3, value_names = ["X", "Y", "Z"], allow_hyphen_values = true)]
    axis_hint: Option<Vec<f64>>,
    /// Edge of a voxel [default: from the size of the part].
    #[arg(long, value_name = "S", allow_hyphen_values = true)]
    voxel_size: Option<f64>,
    /// Support plane: auto, on or off.
    #[arg(long, value_name = "MODE", value_parser = named::<GroundMode>)]
    ground: Option<GroundMode>,
    /// Part of the cloud that is the object: main or off.
    #[arg(long, value_name = "MODE", value_parser = named::<ClusterMode>)]
    cluster: Option<ClusterMode>,
    /// What is minimised: point_to_plane, point_to_point or distribution.
    #[arg(long, value_name = "KIND", value_parser = named::<Residual>)]
    residual: Option<Residual>,
    /// Where on the axis the origin lies: centroid, base or midpoint.
    #[arg(long, value_name = "RULE", value_parser = named::<Origin>)]
    origin: Option<Origin>,
    /// Rule for the primary orientation: harmonic or histogram.
    #[arg(long, value_name = "RULE", value_parser = named::<Yaw>)]
    yaw: Option<Yaw>,
    /// Optimise the axis alone, not the points with it.
    #[arg(long)]
    no_joint: bool,
    /// The method of Dai et al.: plane fit and centroid, point-to-point, yaw from the histogram.
    #[arg(long, conflicts_with = "config")]
    paper: bool,
    /// Seed of everything random.
    #[arg(long)]
    seed: Option<u64>,
    /// Worker threads [default: all cores].
    #[arg(long, value_name = "T")]
    threads: Option<usize>,
    /// Give up after this time.
    #[arg(long, value_name = "SECONDS", value_parser = seconds, allow_hyphen_values = true)]
    pub(super) timeout: Option<Duration>,
    /// Write the result as JSON to a file, or with - to standard output.
    #[arg(long, value_name = "OUT|-")]
    pub(super) json: Option<PathBuf>,
    /// Write the points and the other long arrays into the JSON too.
    #[arg(long, requires = "json")]
    pub(super) full: bool,
    /// Write the completed cloud.
    #[arg(long, value_name = "OUT.ply")]
    pub(super) completed: Option<PathBuf>,
    /// Settings; options on the command line win.
    #[arg(long, value_name = "FILE.toml")]
    config: Option<PathBuf>,
    /// No progress and no remarks on standard error.
    #[arg(long, short)]
    pub(super) quiet: bool,
}

/// Thin out a scan and remove outliers: voxel grid, radius filter, statistical filter, in this order.
///
/// Only the filters run of which an option is given. Points that are not finite are dropped.
#[derive(Debug, Args)]
pub(super) struct FilterArgs {
    /// PLY, PCD, XYZ, TXT, CSV or PTS file.
    pub(super) scan: PathBuf,
    /// File to write; the suffix says in which format.
    pub(super) out: PathBuf,
    #[command(flatten)]
    pub(super) filters: Filters,
    /// Points within the radius that a point needs to be kept.
    #[arg(long, value_name = "COUNT", requires = "radius")]
    pub(super) min_neighbors: Option<usize>,
    /// No remarks on standard error.
    #[arg(long, short)]
    pub(super) quiet: bool,
}

#[derive(Debug, Args)]
#[group(required = true, multiple = true)]
pub(super) struct Filters {
    /// Voxel grid: edge of a voxel.
    #[arg(long, value_name = "S", allow_hyphen_values = true)]
    pub(super) voxel_size: Option<f64>,
    /// Radius filter: radius of the neighbourhood.
    #[arg(long, value_name = "R", allow_hyphen_values = true)]
    pub(super) radius: Option<f64>,
    /// Statistical filter: neighbours that the mean distance is taken over.
    #[arg(long, value_name = "COUNT")]
    pub(super) k: Option<usize>,
    /// Statistical filter: standard deviations above the mean that are allowed.
    #[arg(long, value_name = "RATIO", allow_hyphen_values = true)]
    pub(super) std_ratio: Option<f64>,
}

/// Find the plane that holds the most points.
#[derive(Debug, Args)]
pub(super) struct PlaneArgs {
    /// PLY, PCD, XYZ, TXT, CSV or PTS file.
    pub(super) scan: PathBuf,
    /// Largest distance of a point from its plane [default: twice the median point spacing].
    #[arg(long, value_name = "D", allow_hyphen_values = true)]
    pub(super) distance: Option<f64>,
    /// Seed of the samples.
    #[arg(long, default_value_t = 0)]
    pub(super) seed: u64,
    /// Write the scan without the plane.
    #[arg(long, value_name = "OUT")]
    pub(super) remove: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    pub(super) json: bool,
}

/// Say what a file holds.
#[derive(Debug, Args)]
pub(super) struct InfoArgs {
    /// PLY, PCD, XYZ, TXT, CSV or PTS file.
    pub(super) scan: PathBuf,
    /// Print JSON.
    #[arg(long)]
    pub(super) json: bool,
}

impl EstimateArgs {
    /// The settings: those of the file or the defaults, and over them what the command line says.
    pub(super) fn config(&self) -> Result<Config> {
        let base = match &self.config {
            Some(path) => read_config(path)?,
            None if self.paper => Config::paper(),
            None => Config::default(),
        };
        let corner = |roi: &[f64], from: usize| std::array::from_fn(|axis| roi[from + axis]);
        Ok(Config {
            order: self.order.unwrap_or(base.order),
            seed: self.seed.unwrap_or(base.seed),
            threads: self.threads.or(base.threads),
            roi: self.roi.as_ref().map(|roi| [corner(roi, 0), corner(roi, 3)]).or(base.roi),
            axis_hint: triple(self.axis_hint.as_deref()).or(base.axis_hint),
            ground: self.ground.unwrap_or(base.ground),
            voxel_size: self.voxel_size.or(base.voxel_size),
            cluster: self.cluster.unwrap_or(base.cluster),
            residual: self.residual.unwrap_or(base.residual),
            joint: base.joint && !self.no_joint,
            origin: self.origin.unwrap_or(base.origin),
            yaw: self.yaw.unwrap_or(base.yaw),
            ..base
        })
    }

    pub(super) fn viewpoint(&self) -> Option<[f64; 3]> {
        triple(self.viewpoint.as_deref())
    }
}

/// clap has seen to it that there are three.
fn triple(values: Option<&[f64]>) -> Option<[f64; 3]> {
    values.and_then(|values| values.try_into().ok())
}

fn read_config(path: &PathBuf) -> Result<Config> {
    let text = std::fs::read_to_string(path).map_err(|source| Error::Io { path: path.clone(), source })?;
    toml::from_str(&text).map_err(|error| Error::Format { path: path.clone(), reason: error.to_string() })
}

/// Parses a setting by the name that it has in the configuration.
fn named<T: DeserializeOwned>(name: &str) -> std::result::Result<T, ValueError> {
    let name = name.replace('-', "_");
    let deserializer: StrDeserializer<'_, ValueError> = name.as_str().into_deserializer();
    T::deserialize(deserializer)
}

fn seconds(text: &str) -> std::result::Result<Duration, String> {
    let seconds: f64 = text.parse().map_err(|_| "expected a number of seconds".to_owned())?;
    let duration = Duration::try_from_secs_f64(seconds).ok().filter(|duration| !duration.is_zero());
    duration.ok_or_else(|| "expected a positive number of seconds".to_owned())
}

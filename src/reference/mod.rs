//! Teach once: the completed surface of one part as the frame in which later scans of such parts are posed.
//!
//! Along the axis and about it a part without a model has no natural frame; what [`crate::Estimator`] returns there is a
//! convention that follows the scan. A [`Reference`] keeps the surface with the frame it was given on the first part, and
//! the next scans are registered to it: axis from the symmetry, then height, turn and flip by search, then all six
//! degrees of freedom together.

mod fit;
mod register;
mod sides;

use std::f64::consts::TAU;
use std::sync::OnceLock;

use nalgebra::{Point3, Rotation3, Vector3};
use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error as _};

use crate::error::{Error, Result, shown};
use crate::estimate::Estimate;
use crate::preprocess::median_spacing;
use crate::result::Diagnostic;
use crate::spatial::KdTree;
use crate::symmetry::order::Order;
use crate::symmetry::surface::Samples;

pub(crate) use register::PartScan;
use sides::SidedSurface;

/// The version of the schema that is written, and the only one that is read.
pub const SCHEMA_VERSION: u32 = 1;

/// Points of the whole surface, at most.
const MAX_POINTS: usize = 60_000;

/// Fewest points that are a surface.
const MIN_POINTS: usize = 50;

/// Name of the diagnostic that tells whether the normals of an estimate point outward.
pub(crate) const ORIENTED: &str = "oriented_normals";

/// A taught part: its completed surface, in the object frame of the estimate that it was taught from.
///
/// Serialising keeps one sector, since the others are its copies.
///
/// ```
/// use std::sync::Arc;
/// use sympose::{Config, Estimator, Order, PointCloud, Reference, Request};
///
/// // A dish with five waves; the next scan shows it elsewhere.
/// let dish: Vec<[f64; 3]> = (0..5000)
///     .map(|i| {
///         let (radius, angle) = (0.5 * (f64::from(i) / 5000.0).sqrt(), 2.399_963 * f64::from(i));
///         [radius * angle.cos(), radius * angle.sin(), 0.1 * radius * (5.0 * angle).cos()]
///     })
///     .collect();
/// let moved: Vec<[f64; 3]> = dish.iter().map(|[x, y, z]| [x + 2.0, *y, *z]).collect();
/// let above = |points, x| PointCloud::from_points(points)?.with_viewpoints([[x, 0.0, 3.0]]);
///
/// let estimator = Estimator::new(Config { order: Order::Cyclic(5), ..Config::default() })?;
/// let taught = estimator.estimate(&above(dish, 0.0)?)?;
/// let reference = Some(Arc::new(Reference::from_estimate(&taught)?));
/// let request = Request { reference, ..Request::default() };
/// let found = estimator.estimate_with(&above(moved, 2.0)?, &request)?;
/// let shift = found.world_from_object.translation.vector - taught.world_from_object.translation.vector;
/// assert!((shift.x - 2.0).abs() < 0.01 && shift.yz().norm() < 0.01);
/// # Ok::<(), sympose::Error>(())
/// ```
#[derive(Debug)]
pub struct Reference {
    sector: Sector,
    surface: SidedSurface,
    /// The same for scans of which nobody knows which way their normals point; made when the first one comes.
    without_sides: OnceLock<SidedSurface>,
    diameter: f64,
}

/// What is stored: everything measured, folded into one sector of the object frame and averaged by cells.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Sector {
    schema_version: u32,
    order: Order,
    /// Whether the normals point outward; otherwise their sign means nothing.
    oriented: bool,
    /// Edge of a cell \[length\].
    cell: f64,
    /// Single precision: the origin lies on the part.
    points: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
}

impl Reference {
    /// Takes the completed surface of an estimate as the reference, its pose as the frame to be found again.
    ///
    /// Teach from a scan that shows the part from all sides that later scans will see: what the reference lacks counts
    /// against them.
    ///
    /// # Errors
    /// [`Error::InsufficientData`] when the estimate was stored without its points, [`Error::NonFinite`] when some of them are
    /// not finite, [`Error::InvalidParameter`] when they are no surface to be taught, say because
    /// most of them coincide, or because the order is open.
    pub fn from_estimate(estimate: &Estimate) -> Result<Self> {
        let found = estimate.points.len().min(estimate.normals.len());
        if found < MIN_POINTS {
            let hint = "a summary of an estimate has no points; keep the estimate itself";
            return Err(Error::InsufficientData { stage: "reference", needed: MIN_POINTS, got: found, hint });
        }
        let object_from_world = estimate.world_from_object.inverse();
        let folded: Vec<(Vector3<f64>, Vector3<f64>)> = estimate
            .points
            .iter()
            .zip(&estimate.normals)
            .map(|(p, n)| {
                let point = (object_from_world * Point3::from(*p)).coords;
                let back = into_sector(&point, estimate.order);
                (back * point, back * (object_from_world * Vector3::from(*n)))
            })
            .collect();
        let oriented = estimate.diagnostics.get(ORIENTED) == Some(&Diagnostic::Flag(true));
        let mut cell = median_spacing(&KdTree::new(&estimate.points)?, &estimate.points);
        let refused = |reason: String| Error::InvalidParameter {
            name: "estimate",
            value: format!("{found} points: {reason}"),
            expected: "the surface of a part, to be taught",
        };
        if cell <= 0.0 {
            return Err(refused("most of them coincide".to_owned()));
        }
        loop {
            let (points, normals) = averaged(&folded, cell, oriented);
            let order = estimate.order;
            let sector = Sector { schema_version: SCHEMA_VERSION, order, oriented, cell, points, normals };
            if sector.copies().sum::<usize>() <= MAX_POINTS {
                return Self::new(sector).map_err(refused);
            }
            cell *= 1.15;
        }
    }

    /// Order of the symmetry: never `Auto`.
    #[must_use]
    pub fn order(&self) -> Order {
        self.sector.order
    }

    /// Size of the part \[length\]: the diagonal of the cylinder about the axis that holds it.
    #[must_use]
    pub fn diameter(&self) -> f64 {
        self.diameter
    }

    /// Edge of the cells over which the surface was averaged \[length\].
    #[must_use]
    pub fn cell(&self) -> f64 {
        self.sector.cell
    }

    /// The completed surface: points and unit normals, object frame.
    #[must_use]
    pub fn samples(&self) -> &Samples {
        &self.surface.samples
    }

    /// Checks and unfolds what was stored.
    fn new(sector: Sector) -> Result<Self, String> {
        sector.check()?;
        let samples = sector.unfolded();
        let [rim, low, high] = reach(&samples.points);
        let diameter = (2.0 * rim).hypot(high - low);
        let surface =
            SidedSurface::new(samples, sector.oriented, sector.cell, register::WIDEST_GATE * diameter);
        Ok(Self { sector, surface, without_sides: OnceLock::new(), diameter })
    }

    /// The surface in which points are looked up by normals that point outward or, where that is not known, either way.
    fn sides(&self, outward: bool) -> &SidedSurface {
        if outward || !self.sector.oriented {
            return &self.surface;
        }
        if let Some(sides) = self.without_sides.get() {
            return sides;
        }
        // Not made while the lock is held: it is work for the thread pool, and what this thread takes on while it waits may
        // be another scan that asks for it.
        let samples = self.surface.samples.clone();
        let sides =
            SidedSurface::new(samples, false, self.sector.cell, register::WIDEST_GATE * self.diameter);
        self.without_sides.get_or_init(|| sides)
    }
}

/// Distance from the z axis, lowest and highest point.
fn reach(points: &[Vector3<f64>]) -> [f64; 3] {
    points.iter().fold([0.0, f64::INFINITY, f64::NEG_INFINITY], |[rim, low, high], p| {
        [p.xy().norm().max(rim), p.z.min(low), p.z.max(high)]
    })
}

/// The turn about z that takes a point into the first sector; of a surface of revolution onto the half plane of +x.
fn into_sector(point: &Vector3<f64>, order: Order) -> Rotation3<f64> {
    let angle = point.y.atan2(point.x);
    let turn = match order {
        Order::Cyclic(n) => {
            let sector = TAU / f64::from(n);
            (angle / sector).floor() * sector
        }
        Order::Continuous | Order::Auto => angle,
    };
    Rotation3::from_axis_angle(&Vector3::z_axis(), -turn)
}

/// Means of points and normals by cell, the two sides of a thin wall apart.
///
/// The mean over all sectors has less noise than any scan, so that a later one is not matched to its noise.
fn averaged(
    folded: &[(Vector3<f64>, Vector3<f64>)],
    cell: f64,
    oriented: bool,
) -> (Vec<[f32; 3]>, Vec<[f32; 3]>) {
    let key = |p: &Vector3<f64>| -> [i64; 3] { p.map(|x| (x / cell).floor() as i64).into() };
    let mut rows: Vec<_> = folded.iter().map(|(p, n)| (key(p), p, n)).collect();
    rows.sort_by_key(|(key, ..)| *key);
    let (mut points, mut normals) = (Vec::new(), Vec::new());
    for members in rows.chunk_by(|a, b| a.0 == b.0) {
        let facing = members[0].2;
        let mut sides = [(Vector3::zeros(), Vector3::zeros(), 0.0); 2];
        for (_, point, normal) in members {
            let away = normal.dot(facing) < 0.0;
            let side = &mut sides[usize::from(away && oriented)];
            side.0 += *point;
            side.1 += if away && !oriented { -*normal } else { **normal };
            side.2 += 1.0;
        }
        for (point, normal, count) in sides {
            if let Some(normal) = normal.try_normalize(1e-9) {
                points.push((point / count).map(|x: f64| x as f32).into());
                normals.push(normal.map(|x: f64| x as f32).into());
            }
        }
    }
    (points, normals)
}

impl Sector {
    /// Number of copies of each point.
    fn copies(&self) -> impl Iterator<Item = usize> + '_ {
        self.points.iter().map(|[x, y, _]| match self.order {
            Order::Cyclic(n) => n as usize,
            _ => (TAU * f64::from(x.hypot(*y)) / self.cell).round().max(1.0) as usize,
        })
    }

    fn unfolded(&self) -> Samples {
        let mut samples = Samples::default();
        for ((point, normal), copies) in self.points.iter().zip(&self.normals).zip(self.copies()) {
            let [point, normal] = [point, normal].map(|row| Vector3::from(row.map(f64::from)));
            for k in 0..copies {
                let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), TAU * k as f64 / copies as f64);
                samples.points.push(turn * point);
                samples.normals.push((turn * normal).normalize());
            }
        }
        samples
    }

    /// What is wrong with a stored sector.
    fn check(&self) -> Result<(), String> {
        if self.points.len() != self.normals.len() {
            return Err(format!("{} points, but {} normals", self.points.len(), self.normals.len()));
        }
        if self.order == Order::Auto {
            return Err("order auto: expected the order of a part".into());
        }
        if !self.points.iter().flatten().all(|x| x.is_finite()) {
            return Err("points that are not finite".into());
        }
        let unit = |n: &[f32; 3]| (Vector3::from(*n).norm() - 1.0).abs() < 1e-3;
        if !self.normals.iter().all(unit) {
            return Err("normals that are not of unit length".into());
        }
        let extent = self.points.iter().flatten().fold(0f32, |m, x| m.max(x.abs()));
        // A tiny cell would ask for any number of copies.
        if !(self.cell.is_finite() && self.cell > 1e-5 * f64::from(extent) && extent > 0.0) {
            return Err(format!("cell = {}: expected the spacing of the points", shown(self.cell)));
        }
        match self.copies().sum::<usize>() {
            MIN_POINTS..=MAX_POINTS => Ok(()),
            count => Err(format!("{count} points: expected {MIN_POINTS} to {MAX_POINTS}")),
        }
    }
}

impl Serialize for Reference {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.sector.serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Reference {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let sector = Sector::deserialize(deserializer)?;
        if sector.schema_version != SCHEMA_VERSION {
            return Err(D::Error::custom(format!(
                "schema_version {}: this version of sympose reads {SCHEMA_VERSION}",
                sector.schema_version
            )));
        }
        Self::new(sector).map_err(D::Error::custom)
    }
}

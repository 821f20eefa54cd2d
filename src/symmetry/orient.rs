//! The frame of the part on its axis: sign, origin, and primary orientation.

use std::f64::consts::TAU;

use nalgebra::{Complex, Vector3};
use serde::{Deserialize, Serialize};

use crate::config::{Origin, Yaw};
use crate::symmetry::axis::Axis;
use crate::symmetry::closure::{Unseen, unseen};
use crate::symmetry::complete::{Completion, FoldedCell};
use crate::symmetry::order::Order;
use crate::symmetry::surface::Samples;

/// Which rule decided the sign of the axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SignRule {
    /// Away from the support plane.
    Ground,
    /// Toward the sensors, which all stand on one side.
    Sensors,
    /// Toward the slender end: the third moment of the completed shape along the axis is positive.
    Shape,
    /// Nothing decides: the part looks the same from both ends. The largest component of the axis is positive.
    Arbitrary,
}

/// Cosine to the axis below which ground or sensors do not decide its sign.
const DECISIVE_COSINE: f64 = 0.3;

/// Skewness along the axis below which the shape does not decide its sign.
const DECISIVE_SKEWNESS: f64 = 0.05;

/// Points the axis away from the ground, toward the sensors, or by the shape; says which rule decided.
///
/// `up` is the unit normal of the support plane toward the part; `toward_sensors` the mean unit direction from the part
/// to the sensors, short when they stand all round.
#[must_use]
pub fn decide_sign(
    axis: &Axis,
    up: Option<Vector3<f64>>,
    toward_sensors: Option<Vector3<f64>>,
    completion: &Completion,
) -> (Axis, SignRule) {
    let direction = axis.direction.into_inner();
    let along = |v: Vector3<f64>| v.dot(&direction);
    let skewness = skewness(&completion.cells);
    let (sign, rule) = match (up.map(along), toward_sensors.map(along)) {
        (Some(cosine), _) if cosine.abs() > DECISIVE_COSINE => (cosine, SignRule::Ground),
        (_, Some(cosine)) if cosine.abs() > DECISIVE_COSINE => (cosine, SignRule::Sensors),
        _ if skewness.abs() > DECISIVE_SKEWNESS => (skewness, SignRule::Shape),
        _ => (direction[direction.iamax()], SignRule::Arbitrary),
    };
    let axis = if sign < 0.0 { Axis { direction: -axis.direction, point: axis.point } } else { *axis };
    (axis, rule)
}

fn skewness(cells: &[FoldedCell]) -> f64 {
    let mean = centroid_height(cells);
    let moment = |power: i32| {
        let sum: f64 = cells.iter().map(|c| c.area * (c.position.z - mean).powi(power)).sum();
        sum / area(cells)
    };
    let deviation = moment(2).sqrt();
    if deviation > 0.0 { moment(3) / deviation.powi(3) } else { 0.0 }
}

fn area(cells: &[FoldedCell]) -> f64 {
    cells.iter().map(|c| c.area).sum::<f64>().max(f64::MIN_POSITIVE)
}

/// Height of the centroid of the completed surface above the point of the axis \[length\].
fn centroid_height(cells: &[FoldedCell]) -> f64 {
    cells.iter().map(|c| c.area * c.position.z).sum::<f64>() / area(cells)
}

/// Where the origin lies on the axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Height {
    /// Above the point of the axis \[length\].
    pub value: f64,
    /// Standard deviation \[length\].
    pub sigma: f64,
}

/// Height of the origin above the point of the axis.
///
/// `base` is the height at which the axis meets the support plane, where there is one. With `outward` normals the centroid
/// takes the surface into account that no camera saw.
#[must_use]
pub fn origin_height(completion: &Completion, origin: Origin, base: Option<f64>, outward: bool) -> Height {
    /// Uncertainty of the unseen surface, as a share of what it changes.
    const TRUST: f64 = 0.7;
    let cells = &completion.cells;
    let [mut lower, mut upper] = ends(cells);
    if let Some(base) = base {
        // The part ends on its support, to whichever side of the axis point that is.
        if base < 0.5 * (lower + upper) { lower = base } else { upper = base }
    }
    let area = area(cells);
    let seen = centroid_height(cells);
    let scatter = cells.iter().map(|c| (c.area * (c.position.z - seen)).powi(2)).sum::<f64>().sqrt() / area;
    match origin {
        Origin::Centroid if outward => {
            let Unseen { area: unseen_area, moment } = unseen(completion, [lower, upper]);
            let value = (seen * area + moment) / (area + unseen_area);
            Height { value, sigma: scatter.hypot(TRUST * (value - seen)) }
        }
        Origin::Centroid => Height { value: seen, sigma: scatter },
        Origin::Base => Height { value: base.unwrap_or(lower), sigma: completion.cell },
        Origin::Midpoint => Height { value: 0.5 * (lower + upper), sigma: completion.cell },
    }
}

/// Lowest and highest part of the surface: where half a percent of it lies beyond, so that no stray point decides.
fn ends(cells: &[FoldedCell]) -> [f64; 2] {
    const BEYOND: f64 = 0.005;
    let mut heights: Vec<(f64, f64)> = cells.iter().map(|c| (c.position.z, c.area)).collect();
    heights.sort_by(|a, b| a.0.total_cmp(&b.0));
    let limit = BEYOND * area(cells);
    let reach = |heights: &mut dyn Iterator<Item = &(f64, f64)>| {
        let mut beyond = 0.0;
        let mut last = 0.0;
        for (height, area) in heights {
            last = *height;
            beyond += area;
            if beyond >= limit {
                break;
            }
        }
        last
    };
    [reach(&mut heights.iter()), reach(&mut heights.iter().rev())]
}

/// Primary orientation about the axis.
#[derive(Debug, Clone)]
pub struct Heading {
    /// Angle of +x from the first tangent of the axis \[rad\], one of n equivalent ones.
    pub angle: f64,
    /// Standard deviation of the angle from the scatter of the cells \[rad\]; infinite when nothing fixes it.
    pub sigma: f64,
    /// Histogram of the completed surface over one full turn, from the first tangent.
    pub histogram: Vec<f64>,
}

/// Bins of the angular histogram over a full turn, about.
const HISTOGRAM_BINS: f64 = 360.0;

/// Finds the primary orientation.
///
/// Among the n equivalent directions the one nearest to the bulk of the *measured* points is returned, which turns with
/// the part and the sensor.
#[must_use]
pub fn find_heading(
    completion: &Completion,
    samples: &Samples,
    axis: &Axis,
    order: Order,
    rule: Yaw,
) -> Heading {
    let [x, y] = axis.tangents();
    let bulk: Vector3<f64> = samples.points.iter().map(|p| p - axis.point).sum();
    let toward_bulk = bulk.dot(&y).atan2(bulk.dot(&x));
    let Order::Cyclic(n) = order else {
        return Heading { angle: toward_bulk, sigma: f64::INFINITY, histogram: Vec::new() };
    };
    let histogram = angular_histogram(&completion.cells, n);
    let harmonic = harmonic_phase(&completion.cells, n);
    let in_sector = match rule {
        Yaw::Harmonic => harmonic.0,
        Yaw::Histogram => histogram_peak(&histogram, n),
    };
    let sector = TAU / f64::from(n);
    let turns = ((toward_bulk - in_sector) / sector).round();
    Heading { angle: in_sector + turns * sector, sigma: harmonic.1, histogram }
}

/// Phase of the n-th angular Fourier coefficient [rad within a sector] and its standard deviation.
///
/// Where the plain coefficient cancels (rows of teeth staggered by half a step), coefficients weighted by height or by
/// radius still have a phase: the one that stands out most from its scatter is taken, the plain one with preference.
fn harmonic_phase(cells: &[FoldedCell], n: u32) -> (f64, f64) {
    const PREFERENCE: f64 = 3.0;
    let mean_height = centroid_height(cells);
    let mean_radius = cells.iter().map(|c| c.area * c.radius()).sum::<f64>() / area(cells);
    let weights: [&dyn Fn(&FoldedCell) -> f64; 3] =
        [&|c| c.radius(), &|c| c.radius() * (c.position.z - mean_height), &|c| {
            c.radius() * (c.radius() - mean_radius)
        }];
    let mut best = (0.0, f64::INFINITY);
    for (i, weight) in weights.iter().enumerate() {
        let mut coefficient = Complex::new(0.0, 0.0);
        let mut scatter = 0.0;
        for cell in cells {
            let w = weight(cell) * cell.area;
            coefficient += Complex::from_polar(w, f64::from(n) * cell.angle());
            scatter += w * w;
        }
        let deviation = (0.5 * scatter).sqrt() / coefficient.norm().max(f64::MIN_POSITIVE) / f64::from(n);
        let penalty = if i == 0 { 1.0 } else { PREFERENCE };
        if deviation * penalty < best.1 {
            best = (coefficient.arg() / f64::from(n), deviation * penalty);
        }
    }
    best
}

fn angular_histogram(cells: &[FoldedCell], n: u32) -> Vec<f64> {
    let per_sector = (HISTOGRAM_BINS / f64::from(n)).round().max(8.0) as usize;
    let mut sector = vec![0.0; per_sector];
    for cell in cells {
        let turn = (cell.angle() * f64::from(n) / TAU).rem_euclid(1.0);
        sector[((turn * per_sector as f64) as usize).min(per_sector - 1)] += cell.area / f64::from(n);
    }
    sector.repeat(n as usize)
}

/// Direction of the largest bin, smoothed over its neighbours and interpolated \[rad\].
fn histogram_peak(histogram: &[f64], n: u32) -> f64 {
    let bins = histogram.len() / n as usize;
    let at = |i: usize| {
        let [left, middle, right] = [bins - 1, 0, 1].map(|shift| histogram[(i + shift) % bins]);
        0.25 * left + 0.5 * middle + 0.25 * right
    };
    let peak = (0..bins).rev().max_by(|&a, &b| at(a).total_cmp(&at(b))).unwrap_or(0);
    let [left, middle, right] = [bins - 1, 0, 1].map(|shift| at((peak + shift) % bins));
    let curvature = left - 2.0 * middle + right;
    let shift = if curvature < 0.0 { 0.5 * (left - right) / curvature } else { 0.0 };
    (peak as f64 + 0.5 + shift) * TAU / histogram.len() as f64
}

//! The frame of the part on its axis: sign, origin, and primary orientation.

use std::f64::consts::TAU;

use nalgebra::{Complex, Vector3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::config::{Origin, Yaw};
use crate::symmetry::axis::Axis;
use crate::symmetry::closure::{Unseen, tail, unseen};
use crate::symmetry::fold::{Folded, FoldedPoint};
use crate::symmetry::mirror::MirrorPlane;
use crate::symmetry::order::Order;

/// Which rule decided the sign of the axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum SignRule {
    /// That of the pose from before: a stream of poses must not turn over.
    Previous,
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

/// Points the axis the way it pointed before, away from the ground, toward the sensors, or by the shape; says which rule
/// decided.
///
/// `previous` is the direction of an earlier pose; `up` is the unit normal of the support plane toward the part;
/// `toward_sensors` the mean unit direction from the part to the sensors, short when they stand all round.
#[must_use]
pub(crate) fn decide_sign(
    axis: &Axis,
    previous: Option<Vector3<f64>>,
    up: Option<Vector3<f64>>,
    toward_sensors: Option<Vector3<f64>>,
    folded: &Folded,
) -> (Axis, SignRule) {
    let direction = axis.direction.into_inner();
    let along = |v: Vector3<f64>| v.dot(&direction);
    let skewness = skewness(folded);
    let decisive = |direction: Option<Vector3<f64>>| {
        direction.map(along).filter(|cosine| cosine.abs() > DECISIVE_COSINE)
    };
    let (sign, rule) = match (decisive(previous), decisive(up), decisive(toward_sensors)) {
        (Some(cosine), ..) => (cosine, SignRule::Previous),
        (_, Some(cosine), _) => (cosine, SignRule::Ground),
        (_, _, Some(cosine)) => (cosine, SignRule::Sensors),
        _ if skewness.abs() > DECISIVE_SKEWNESS => (skewness, SignRule::Shape),
        _ => (direction[direction.iamax()], SignRule::Arbitrary),
    };
    let axis = if sign < 0.0 { Axis { direction: -axis.direction, point: axis.point } } else { *axis };
    (axis, rule)
}

fn skewness(folded: &Folded) -> f64 {
    let mean = folded.mean(|p| p.height);
    let moment = |power: i32| folded.mean(|p| (p.height - mean).powi(power));
    let deviation = moment(2).sqrt();
    if deviation > 0.0 { moment(3) / deviation.powi(3) } else { 0.0 }
}

/// Where the origin lies on the axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Height {
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
pub(crate) fn origin_height(folded: &Folded, origin: Origin, base: Option<f64>, outward: bool) -> Height {
    /// Uncertainty of the unseen surface, as a share of what it changes; a cell remains where all was seen.
    const TRUST: f64 = 0.7;
    let [mut lower, mut upper] = ends(folded);
    if let Some(base) = base {
        // The part ends on its support, to whichever side of the axis point that is.
        if base < 0.5 * (lower + upper) { lower = base } else { upper = base }
    }
    let area = folded.area();
    let seen = folded.mean(|p| p.height);
    let missing = if outward { unseen(folded, [lower, upper]) } else { Unseen { area: 0.0, moment: 0.0 } };
    let closed = (seen * area + missing.moment) / (area + missing.area);
    // An end that no camera saw may lie deeper, the more of the surface is missing.
    let end = if base.is_some() { 0.0 } else { missing.area / (area + missing.area) * (upper - lower) };
    let (value, unsure) = match origin {
        Origin::Centroid => (closed, TRUST * (closed - seen)),
        Origin::Base => (base.unwrap_or(lower), end),
        Origin::Midpoint => (0.5 * (lower + upper), 0.5 * end),
    };
    Height { value, sigma: folded.cell.hypot(unsure) }
}

/// Lowest and highest part of the surface: the mean of the last percent of it, so that no stray point decides.
fn ends(folded: &Folded) -> [f64; 2] {
    const LAST: f64 = 0.01;
    let mut heights: Vec<(f64, f64)> = folded.points.iter().map(|p| (p.height, p.area)).collect();
    heights.par_sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let last = LAST * folded.area();
    let lower = tail(&heights, last);
    heights.reverse();
    [lower, tail(&heights, last)]
}

/// Primary orientation about the axis.
#[derive(Debug, Clone)]
pub(crate) struct Heading {
    /// Angle of +x from the first tangent of the axis \[rad\], one of n equivalent ones.
    pub angle: f64,
    /// Standard deviation of the angle from the scatter of the points \[rad\]; infinite when nothing fixes it.
    pub sigma: f64,
    /// Histogram of the completed surface over one full turn, from the first tangent.
    pub histogram: Vec<f64>,
}

impl Heading {
    /// The heading on a mirror plane that was found near it: the same in each scan, whatever the scan shows. It is unchanged
    /// where chance does not put it so far from the plane, or where the plane is hardly better known.
    #[must_use]
    pub(crate) fn onto(self, plane: MirrorPlane) -> Self {
        /// Largest error [standard deviations]: what is stated of headings is rough. Planes that lay beyond 3 were right.
        const LARGEST: f64 = 6.0;
        /// Largest standard deviation of the plane [that of the heading].
        const BETTER: f64 = 0.5;
        let apart = (plane.angle - self.angle).abs();
        if apart > LARGEST * self.sigma || plane.sigma > BETTER * self.sigma {
            return self;
        }
        // Which of the planes it is depends on the heading, which must not lie nearer to the next.
        let is_certain = LARGEST * self.sigma < 0.5 * plane.between;
        Self { angle: plane.angle, sigma: if is_certain { plane.sigma } else { self.sigma }, ..self }
    }
}

/// Bins of the angular histogram over a full turn, about.
const HISTOGRAM_BINS: f64 = 360.0;

/// Finds the primary orientation.
///
/// Among the n equivalent directions the one nearest to the bulk of the *measured* points is returned, which turns with
/// the part and the sensor.
#[must_use]
pub(crate) fn find_heading(folded: &Folded, order: Order, rule: Yaw) -> Heading {
    let bulk: Complex<f64> = folded.points.iter().map(|p| Complex::from_polar(p.radius, p.angle)).sum();
    let toward_bulk = bulk.arg();
    let Order::Cyclic(n) = order else {
        return Heading { angle: toward_bulk, sigma: f64::INFINITY, histogram: Vec::new() };
    };
    let histogram = angular_histogram(folded, n);
    let (in_sector, sigma) = match rule {
        Yaw::Harmonic => harmonic_phase(folded, n),
        Yaw::Histogram => histogram_peak(&histogram, n),
    };
    let sector = TAU / f64::from(n);
    // A direction chosen at random is off by this much.
    let sigma = if sigma < sector / f64::sqrt(12.0) { sigma } else { f64::INFINITY };
    let turns = ((toward_bulk - in_sector) / sector).round();
    Heading { angle: in_sector + turns * sector, sigma, histogram }
}

/// Phase of the n-th angular Fourier coefficient [rad within a sector] and its standard deviation.
///
/// The outline of the part, seen along the axis, is the same from whichever side a camera looks, and so is its phase.
/// Where it has none (blades on a disk, grooves), the flanks decide, the surface that faces around the axis; rims and disks,
/// of which a camera sees more here and less there, are none. Where too few of them agree (wide windows, rows of teeth
/// staggered by half a step), the area of the surface decides: weighted by radius, or plain or by height where that agrees
/// far better on a phase.
fn harmonic_phase(folded: &Folded, n: u32) -> (f64, f64) {
    /// Share of the outline that must agree on a phase.
    const OUTLINED: f64 = 0.03;
    /// Share of the flanks that must.
    const FLANKED: f64 = 0.2;
    /// How much better others must agree than the one that is preferred, so that chance does not choose.
    const FAR_BETTER: f64 = 2.0;
    /// Another scan may decide otherwise where a decision was closer than this.
    const CLOSE: f64 = 2.0;
    let [mean_height, mean_radius] = [folded.mean(|p| p.height), folded.mean(|p| p.radius)];
    let harmonic = |weight: &dyn Fn(&FoldedPoint) -> f64| Harmonic::new(folded, n, weight);
    let outline = harmonic(&|p| p.radius * p.outline);
    let outlined = outline.agreement / OUTLINED;
    if outlined > CLOSE {
        return (outline.phase, outline.sigma);
    }
    let flanks = harmonic(&|p| p.radius * p.area * p.around.powi(2));
    let flanked = flanks.agreement / FLANKED;
    let by_radius = harmonic(&|p| p.radius * p.area * (p.radius - mean_radius));
    let plain = harmonic(&|p| p.radius * p.area);
    let by_height = harmonic(&|p| p.radius * p.area * (p.height - mean_height));
    let other = if plain.agreement > by_height.agreement { plain } else { by_height };
    let better = other.agreement / (FAR_BETTER * by_radius.agreement);
    let by_area = decided(by_radius, other, better, CLOSE, n);
    let by_surface = decided(by_area, flanks, flanked, CLOSE, n);
    let chosen = decided(by_surface, outline, outlined, CLOSE, n);
    (chosen.phase, chosen.sigma)
}

/// The first of two, or the second one where it is more than once as good as it must be; as uncertain as they differ where it
/// is about that.
fn decided(first: Harmonic, second: Harmonic, how_good: f64, close: f64, n: u32) -> Harmonic {
    let sector = TAU / f64::from(n);
    let apart = (first.phase - second.phase).rem_euclid(sector);
    let apart = apart.min(sector - apart);
    let mut chosen = if how_good > 1.0 { second } else { first };
    if (close.recip()..close).contains(&how_good) {
        chosen.sigma = chosen.sigma.hypot(0.5 * apart);
    }
    chosen
}

/// The n-th Fourier coefficient of a weight.
struct Harmonic {
    /// Angle of its crest [rad within a sector].
    phase: f64,
    /// Standard deviation of the phase from the scatter of the points \[rad\].
    sigma: f64,
    /// Share of all weight that agrees on the phase.
    agreement: f64,
}

impl Harmonic {
    fn new(folded: &Folded, n: u32, weight: &dyn Fn(&FoldedPoint) -> f64) -> Self {
        let mut coefficient = Complex::new(0.0_f64, 0.0);
        let [mut scatter, mut sum] = [0.0, f64::MIN_POSITIVE];
        for point in &folded.points {
            let w = weight(point);
            coefficient += Complex::from_polar(w, f64::from(n) * point.angle);
            scatter += w * w;
            sum += w.abs();
        }
        let size = coefficient.norm().max(f64::MIN_POSITIVE);
        Self {
            phase: coefficient.arg() / f64::from(n),
            sigma: (0.5 * scatter).sqrt() / size / f64::from(n),
            agreement: size / sum,
        }
    }
}

fn angular_histogram(folded: &Folded, n: u32) -> Vec<f64> {
    let per_sector = (HISTOGRAM_BINS / f64::from(n)).round().max(8.0) as usize;
    let mut sector = vec![0.0; per_sector];
    for point in &folded.points {
        let turn = (point.angle * f64::from(n) / TAU).rem_euclid(1.0);
        sector[((turn * per_sector as f64) as usize).min(per_sector - 1)] += point.area / f64::from(n);
    }
    sector.repeat(n as usize)
}

/// Direction of the largest bin, smoothed over its neighbours and interpolated, and how far from it bins about as large
/// lie, which another scan may find the largest \[rad\].
fn histogram_peak(histogram: &[f64], n: u32) -> (f64, f64) {
    /// Bins that are lower than the peak by less than this are about as large [range of the bins].
    const ALIKE: f64 = 0.1;
    let bins = histogram.len() / n as usize;
    let at = |i: usize| {
        let [left, middle, right] = [bins - 1, 0, 1].map(|shift| histogram[(i + shift) % bins]);
        0.25 * left + 0.5 * middle + 0.25 * right
    };
    let peak = (0..bins).rev().max_by(|&a, &b| at(a).total_cmp(&at(b))).unwrap_or(0);
    let [left, middle, right] = [bins - 1, 0, 1].map(|shift| at((peak + shift) % bins));
    let curvature = left - 2.0 * middle + right;
    let shift = if curvature < 0.0 { 0.5 * (left - right) / curvature } else { 0.0 };
    let width = TAU / histogram.len() as f64;
    let lowest = (0..bins).map(at).fold(f64::INFINITY, f64::min);
    let alike = (0..bins).filter(|&i| at(i) >= middle - ALIKE * (middle - lowest));
    let away = |i: usize| i.abs_diff(peak).min(bins - i.abs_diff(peak)) as f64;
    let [count, squares] = alike.fold([0.0, 0.0], |[n, sum], i| [n + 1.0, sum + away(i).powi(2)]);
    // At least what a bin hides.
    let sigma = width * f64::sqrt(squares / count + 1.0 / 12.0);
    ((peak as f64 + 0.5 + shift) * width, sigma)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn heading(sigma: f64) -> Heading {
        Heading { angle: 0.5, sigma, histogram: Vec::new() }
    }

    fn on_plane(sigma: f64, plane: [f64; 2]) -> (f64, f64) {
        let plane = MirrorPlane { angle: plane[0], sigma: plane[1], between: 0.63 };
        let Heading { angle, sigma, .. } = heading(sigma).onto(plane);
        (angle, sigma)
    }

    #[test]
    fn a_heading_takes_the_plane_beside_it() {
        let plane = [0.51, 1e-4];
        assert_eq!(on_plane(0.005, plane), (0.51, 1e-4));
        // Which of the planes it is, is not certain.
        assert_eq!(on_plane(0.2, plane), (0.51, 0.2));
        assert_eq!(on_plane(f64::INFINITY, plane), (0.51, f64::INFINITY));
    }

    #[test]
    fn a_heading_stays_where_chance_does_not_explain_the_plane_or_it_is_not_better_known() {
        assert_eq!(on_plane(0.005, [0.54, 1e-4]), (0.5, 0.005));
        assert_eq!(on_plane(0.005, [0.51, 0.004]), (0.5, 0.005));
    }
}

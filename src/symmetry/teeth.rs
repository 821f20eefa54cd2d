//! Teeth and grooves so fine that no gap is seen between them: the normals of their flanks tell how many there are.
//!
//! The normals of a surface of revolution lie in the planes through its axis, those of flanks stand out of them. How far they do,
//! as a function of the angle about the axis, repeats from tooth to tooth. For each order the teeth that it would have are laid on
//! one another: where it is right all show the same. So the period of a star is found by folding what was seen of it (Stellingwerf
//! 1978, Astrophysical Journal 224, 953).

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use nalgebra::Point3;
use rayon::prelude::*;

use crate::symmetry::axis::{ASIDE, Axis};
use crate::symmetry::rings::{Ring, Rings};
use crate::symmetry::surface::Surface;

/// What the flanks about an axis say.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Teeth {
    /// There are so many teeth, all alike.
    Number(u32),
    /// There are teeth, but their number is not certain, or they are not alike.
    Unclear,
}

/// The teeth about an axis, up to a `largest` number; `None` where there are none. Normals must point to the sensor.
pub(crate) fn teeth(surface: &Surface, axis: &Axis, largest: u32) -> Option<Teeth> {
    /// How alike the teeth of an order must be, and how even they must stand, at least: where there are any, and where their
    /// number is certain.
    const SOMEWHAT: [f64; 2] = [0.3, 0.3];
    const CERTAIN: [f64; 2] = [0.5, 0.5];
    /// Share of what is known of the flanks that more than one tooth must show.
    const COMPARED: f64 = 0.5;
    /// By how much teeth of a part of the group may be more alike.
    const DIFFERENT: f64 = 0.15;
    /// How even one tooth more or less may stand: where few of them are in sight, either fits about as well. Of 40 right numbers
    /// from one view 32 have less, of three wrong ones none.
    const BESIDE: f64 = 0.95;
    let rings = rings_of_flanks(surface, axis);
    let held = |n: u32| {
        let likeness = Likeness::of_teeth(&rings, n);
        let holds = likeness.value() > SOMEWHAT[0] && likeness.compared_share() > COMPARED;
        holds.then(|| (n, likeness.value()))
    };
    // Teeth are alike in twos and threes, too, but those do not stand evenly.
    let held: Vec<(u32, f64)> = (3..=largest).into_par_iter().filter_map(held).collect();
    let even = held.iter().map(|&(n, alike)| (evenness(&rings, n), n, alike));
    let (even, n, alike) = even.max_by(|a, b| a.0.total_cmp(&b.0)).filter(|best| best.0 > SOMEWHAT[1])?;
    let differ = held.iter().any(|(part, of_part)| n.is_multiple_of(*part) && of_part - alike > DIFFERENT);
    let is_rivalled = [n - 1, n + 1].iter().any(|&beside| evenness(&rings, beside) > BESIDE * even);
    let is_clear = !differ && !is_rivalled && many_have_flanks(&rings, n);
    let is_certain = alike > CERTAIN[0] && even > CERTAIN[1] && is_clear;
    Some(if is_certain { Teeth::Number(n) } else { Teeth::Unclear })
}

/// A place of the surface, as seen along the axis.
#[derive(Debug, Clone, Copy)]
struct Place {
    /// Angle about the axis \[turns\].
    turn: f64,
    /// Distance from it \[length\].
    radius: f64,
    /// By how much the sine of the angle between the normal and the plane through the axis exceeds [`ASIDE`]; its sign tells the
    /// side.
    aside: f64,
}

/// A ring about the axis that has flanks.
struct Flanked {
    /// Points that would lie side by side all round.
    around: f64,
    places: Vec<Place>,
}

impl Flanked {
    fn new(places: Vec<Place>, spacing: f64) -> Self {
        let radius = places.iter().map(|place| place.radius).sum::<f64>() / places.len() as f64;
        Self { around: TAU * radius / spacing, places }
    }
}

/// The rings in which flanks are more than stray normals, each with those beside it: what lies between teeth may be there.
fn rings_of_flanks(surface: &Surface, axis: &Axis) -> Vec<Flanked> {
    /// Points of a ring, and the share of them on flanks, at least.
    const LEAST: (usize, f64) = (20, 0.05);
    const BESIDE: [Ring; 5] = [(0, 0), (-1, 0), (1, 0), (0, -1), (0, 1)];
    let samples = &surface.samples;
    let about = Rings::about(axis, samples);
    let object_from_local = axis.frame().inverse();
    let mut rings: BTreeMap<Ring, Vec<Place>> = BTreeMap::new();
    for (point, normal) in samples.points.iter().zip(&samples.normals) {
        let place = object_from_local * Point3::from(*point);
        let radius = place.x.hypot(place.y);
        let sine = axis.around(point, normal);
        let aside = f64::max(sine.abs() - ASIDE, 0.0).copysign(sine);
        let turn = (place.y.atan2(place.x) / TAU).rem_euclid(1.0);
        rings.entry(about.of(point)).or_default().push(Place { turn, radius, aside });
    }
    let has_flanks = |places: &[Place]| {
        let flanks = places.iter().filter(|place| place.aside != 0.0).count();
        places.len() >= LEAST.0 && flanks as f64 > LEAST.1 * places.len() as f64
    };
    let with_beside = |(r, h): Ring| {
        let places = BESIDE.iter().filter_map(|(dr, dh)| rings.get(&(r + dr, h + dh))).flatten();
        Flanked::new(places.copied().collect(), surface.spacing)
    };
    rings.iter().filter(|(_, places)| has_flanks(places)).map(|(ring, _)| with_beside(*ring)).collect()
}

/// How far the teeth of an order show the same.
#[derive(Debug, Default)]
struct Likeness {
    /// Squares of what stands out of the planes through the axis, at places that several teeth show.
    compared: f64,
    /// The same at all places.
    all: f64,
    /// Variance between the teeth, times the points.
    apart: f64,
}

impl Likeness {
    /// Lays the teeth that order `n` would have on one another.
    fn of_teeth(rings: &[Flanked], n: u32) -> Self {
        /// Places of a tooth, each as wide as points are apart, at least.
        const PLACES: usize = 4;
        let mut likeness = Self::default();
        for ring in rings {
            let per_tooth = (ring.around / f64::from(n)).round() as usize;
            if per_tooth < PLACES {
                likeness.all += ring.places.iter().map(|place| place.aside.powi(2)).sum::<f64>();
                continue;
            }
            let mut means = vec![Mean::default(); per_tooth * n as usize];
            let count = means.len();
            for place in &ring.places {
                means[((place.turn * count as f64) as usize).min(count - 1)].add(place.aside);
            }
            for first in 0..per_tooth {
                likeness.add(means.iter().skip(first).step_by(per_tooth).filter(|mean| mean.count > 0.0));
            }
        }
        likeness
    }

    /// Adds what the teeth show at one place of theirs.
    fn add<'a>(&mut self, teeth: impl Iterator<Item = &'a Mean> + Clone) {
        let power: f64 = teeth.clone().map(|tooth| tooth.count * tooth.value().powi(2)).sum();
        let count = teeth.clone().count() as f64;
        self.all += power;
        if count > 1.0 {
            let points: f64 = teeth.clone().map(|tooth| tooth.count).sum();
            let mean = teeth.clone().map(|tooth| tooth.sum).sum::<f64>() / points;
            let squares: f64 = teeth.map(|tooth| tooth.count * (tooth.value() - mean).powi(2)).sum();
            self.apart += count / (count - 1.0) * squares;
            self.compared += power;
        }
    }

    /// 1 where all teeth show the same, 0 and less where they have nothing in common.
    fn value(&self) -> f64 {
        1.0 - self.apart / self.compared.max(f64::MIN_POSITIVE)
    }

    fn compared_share(&self) -> f64 {
        self.compared / self.all.max(f64::MIN_POSITIVE)
    }
}

/// Mean of what some points show.
#[derive(Debug, Clone, Copy, Default)]
struct Mean {
    sum: f64,
    count: f64,
}

impl Mean {
    fn add(&mut self, value: f64) {
        self.sum += value;
        self.count += 1.0;
    }

    fn value(&self) -> f64 {
        self.sum / self.count
    }
}

/// How evenly flanks that face the same way stand as `n` of them do, in [0, 1]: the length of the mean of their phases, squared,
/// each pair of points counted once. A view from one side shows other flanks on its left than on its right, so that those facing
/// one way are not compared with the others.
fn evenness(rings: &[Flanked], n: u32) -> f64 {
    let (mut even, mut all) = (0.0, 0.0);
    for ring in rings {
        for side in [-1.0, 1.0] {
            let (mut along, mut across, mut sum, mut squares) = (0.0, 0.0, 0.0, 0.0);
            for place in &ring.places {
                let weight = side * place.aside;
                if weight > 0.0 {
                    let (sine, cosine) = (TAU * f64::from(n) * place.turn).sin_cos();
                    along += weight * cosine;
                    across += weight * sine;
                    sum += weight;
                    squares += weight * weight;
                }
            }
            let pairs = sum * sum - squares;
            if pairs > 0.0 {
                even += sum * (along * along + across * across - squares) / pairs;
                all += sum;
            }
        }
    }
    even / f64::max(all, f64::MIN_POSITIVE)
}

/// Whether many of `n` teeth have flanks: any two bosses stand evenly as those of some number of teeth.
fn many_have_flanks(rings: &[Flanked], n: u32) -> bool {
    /// Teeth that must have flanks where most of them have none [number, share].
    const MANY: (usize, f64) = (5, 0.3);
    /// Flanks that a tooth must have, at least [those of the mean].
    const FLANKED: f64 = 0.25;
    let mut teeth = vec![0.0; n as usize];
    for place in rings.iter().flat_map(|ring| &ring.places) {
        teeth[(f64::from(n) * place.turn) as usize % n as usize] += place.aside.abs();
    }
    let enough = FLANKED * teeth.iter().sum::<f64>() / f64::from(n);
    let flanked = teeth.iter().filter(|tooth| **tooth > enough).count();
    2 * flanked > n as usize || flanked >= MANY.0 && flanked as f64 >= MANY.1 * f64::from(n)
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::symmetry::surface::Samples;

    const SPACING: f64 = 0.005;

    /// A drum about +z of radius 0.5 whose wall stands in by `depth` of the angle, seen from 0 to `seen` turns.
    fn drum(depth: impl Fn(f64) -> f64, seen: f64) -> Surface {
        const AROUND: u32 = 628;
        const STEP: f64 = 1e-4;
        let mut samples = Samples::default();
        for i in 0..(seen * f64::from(AROUND)) as u32 {
            for k in 0..12 {
                // Rows are staggered, as the points of a scan do not stand over one another.
                let angle = TAU / f64::from(AROUND) * (f64::from(i) + 0.618 * f64::from(k)) % TAU;
                let radius = 0.5 - depth(angle);
                let slope = (depth(angle + STEP) - depth(angle - STEP)) / (2.0 * STEP);
                let [along, around] = [[angle.cos(), angle.sin()], [-angle.sin(), angle.cos()]];
                let height = SPACING * f64::from(k);
                samples.points.push(Vector3::new(radius * along[0], radius * along[1], height));
                let normal = [0, 1].map(|axis| radius * along[axis] + slope * around[axis]);
                samples.normals.push(Vector3::new(normal[0], normal[1], 0.0).normalize());
            }
        }
        Surface::new(samples, true, SPACING, 3.0 * SPACING)
    }

    fn found(depth: impl Fn(f64) -> f64, seen: f64) -> Option<Teeth> {
        let axis = Axis { direction: Vector3::z_axis(), point: Vector3::new(0.0, 0.0, 0.3) };
        teeth(&drum(depth, seen), &axis, 60)
    }

    #[test]
    fn teeth_are_counted_all_round_and_from_one_side() {
        for n in [19_u32, 43, 52, 60] {
            for seen in [1.0, 0.6, 0.4] {
                let wavy = |angle: f64| 0.3 / f64::from(n) * (f64::from(n) * angle).cos();
                assert_eq!(found(wavy, seen), Some(Teeth::Number(n)), "{n} teeth, {seen} of them in sight");
            }
        }
    }

    #[test]
    fn what_fits_two_numbers_as_well_is_unclear() {
        // As teeth come to stand where the axis is a little off.
        let between = |angle: f64| 0.3 / 43.5 * (43.5 * angle).cos();
        assert_eq!(found(between, 0.4), Some(Teeth::Unclear));
    }

    #[test]
    fn what_is_round_has_no_teeth() {
        assert_eq!(found(|_| 0.0, 1.0), None);
    }

    #[test]
    fn bosses_have_no_number_of_teeth() {
        let boss = |angle: f64, at: f64| 0.03 * (-((angle - at) / 0.03).powi(2)).exp();
        assert_eq!(found(|angle| -boss(angle, 2.0), 1.0), None);
        // Two of them a ninth of a turn apart.
        let two = |angle| -boss(angle, 1.0) - boss(angle, 1.0 + TAU / 9.0);
        assert!(!matches!(found(two, 1.0), Some(Teeth::Number(_))));
        assert!(!matches!(found(two, 0.4), Some(Teeth::Number(_))));
    }

    #[test]
    fn teeth_that_differ_or_are_too_many_have_no_number() {
        let of = |n: f64| move |angle: f64| 0.3 / n * (n * angle).cos();
        assert_eq!(found(of(72.0), 1.0), None);
        // Every fourth of 48 is missing: their order is 12.
        let missing = |angle: f64| (angle / TAU * 12.0).fract() < 0.25;
        let gapped = |angle: f64| if missing(angle) { 0.006 } else { 0.006 * (48.0 * angle).cos() };
        assert_eq!(found(gapped, 1.0), Some(Teeth::Unclear));
    }
}

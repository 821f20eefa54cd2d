//! Where a scan lies on the reference: height, turn and flip by search, then all six degrees of freedom.

use std::f64::consts::{PI, TAU};

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use rayon::prelude::*;

use super::fit::{Fit, MIN_COSINE, residual};
use super::sides::SidedSurface;
use super::{Reference, reach};
use crate::control::Control;
use crate::error::Result;
use crate::frames::nearest_turn;
use crate::result::FreeDirection;
use crate::symmetry::axis::Turn;
use crate::symmetry::order::Order;
use crate::symmetry::score::{MatchScore, outcome};
use crate::symmetry::surface::{Gate, Samples, Surface};
use crate::symmetry::view_errors::ViewErrors;
use crate::symmetry::visibility::Visibility;

/// Largest distance of a match [diameters].
pub(super) const WIDEST_GATE: f64 = 0.05;

/// Step of the search, along the axis and at the rim [diameters]; a scan that is off by half of it finds its way.
const STEP: f64 = 0.02;

/// Points of the scan that are tried everywhere, and that the best places are judged by.
const TRIED: usize = 500;
const JUDGED: usize = 3000;

/// Places of either flip that are looked at more closely.
const KEPT: usize = 6;

/// Last gate [cells], and distance from the surface within which a point fits [cells].
const GATE: f64 = 2.0;
const FITS: f64 = 0.6;

/// Share of the scan that must fit the reference.
const MIN_OVERLAP: f64 = 0.8;

/// Share of the reference, of what should be in sight of it, that must be found in the scan.
const MIN_AGREEMENT: f64 = 0.8;

/// Points of the reference that are looked for in the scan, and how close one must come [spacings of the scan].
const PROBES: usize = 2000;
const AGREES: f64 = 3.0;

/// A stride that meets no pattern.
const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// Share of the scan that will do when this share of the reference is confirmed.
const MIN_OVERLAP_ONE_SIDED: f64 = 0.4;
const CONFIRMED: f64 = 0.97;

/// By how much one flip must fit better, for the part not to be the same both ways.
const SAME: f64 = 0.02;

/// By how much another turn or height must fit worse, for it to be known.
const AMBIGUOUS: f64 = 0.01;

/// Ratio of the sizes beyond which parts differ.
const LARGEST_RATIO: f64 = 1.15;

/// Length of a scan along its axis beyond which it shows another part [diameters of the reference]: a reference that was taught
/// from one end may lack much of the rest.
const LONGEST: f64 = 10.0;

/// A scan with the frame that symmetry gave it.
pub(crate) struct PartScan<'a> {
    /// Points and normals.
    pub samples: &'a Samples,
    /// Whether these normals point outward, since viewpoints are known.
    pub outward: bool,
    /// The surface that they were refined from.
    pub surface: &'a Surface,
    /// What the cameras saw to be empty.
    pub visibility: Option<&'a Visibility>,
    /// How far the views are off their places.
    pub view_errors: Option<&'a ViewErrors>,
    /// Pose by symmetry alone.
    pub scan_from_object: Isometry3<f64>,
    /// Order about it.
    pub order: Order,
    /// Among equivalent poses the one nearest to this is wanted.
    pub preferred: Option<Isometry3<f64>>,
}

/// A scan in the frame of the reference.
pub(crate) struct Registered {
    /// The taught frame.
    pub scan_from_object: Isometry3<f64>,
    /// Of the pose, object frame.
    pub covariance: [[f64; 6]; 6],
    /// Motions that the data does not fix.
    pub unobservable: Vec<FreeDirection>,
    /// Share of the scan that fits the reference.
    pub overlap: f64,
    /// Robust standard deviation of the distances \[length\].
    pub sigma: f64,
    /// What the caller should know.
    pub warnings: Vec<String>,
    /// Why this is another part.
    pub misfit: Option<String>,
}

/// A place that was tried and how well it fits, in [0, 1].
#[derive(Clone, Copy)]
struct Place {
    object_from_scan: Isometry3<f64>,
    fit: f64,
}

/// Motions by which the scan fits the reference elsewhere as well.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Freedom {
    /// Any turn about the axis.
    pub(super) turns: bool,
    /// Another height along it.
    pub(super) slides: bool,
}

impl Reference {
    /// Finds the pose of a scan in the taught frame.
    ///
    /// # Errors
    /// [`Error::Cancelled`](crate::Error::Cancelled), [`Error::DeadlineExceeded`](crate::Error::DeadlineExceeded).
    pub(crate) fn register(&self, scan: &PartScan, control: &Control) -> Result<Registered> {
        // A search over a part of another size would take as much longer as that is larger.
        if let Some(reason) = self.difference(scan) {
            return Ok(Registered::misfit(scan, reason));
        }
        let revolves = self.order() == Order::Continuous;
        let judged = scan.samples.strided(JUDGED);
        let mut flips: Vec<Vec<Place>> = Vec::new();
        for flipped in [false, true] {
            let places = self.places(scan, flipped, control)?.into_iter();
            let mut places =
                places.map(|place| self.closer(scan, &judged, place, control)).collect::<Result<Vec<_>>>()?;
            places.sort_by(|a, b| b.fit.total_cmp(&a.fit));
            flips.push(places);
        }
        // A part that is the same both ways is taken as it is preferred, or as it stands.
        let most = flips.iter().flatten().map(|place| place.fit).fold(0.0, f64::max);
        let alike = flips.iter().filter(|places| places.first().is_some_and(|best| best.fit >= most - SAME));
        let posed = alike.filter_map(|places| {
            let best = places.first()?;
            Some((self.nearest(best.object_from_scan.inverse(), scan), self.freedom(places)))
        });
        let chosen = posed.min_by(|a, b| away(&a.0, scan).total_cmp(&away(&b.0, scan)));
        let (near, mut freedom) = chosen.unwrap_or((scan.scan_from_object, Freedom::default()));

        let sides = self.sides(scan.outward);
        let gate = GATE * self.cell();
        let fit = Fit::new(sides, scan.samples, near.inverse(), &[gate], revolves, control)?;
        let measured = &scan.surface.samples;
        let mut known = fit.judged_by(sides, measured, gate);
        if let Some(errors) = scan.view_errors {
            known.consider_views(sides, measured, gate, errors, &scan.surface.centroid);
        }
        let overlap = overlap(sides, &judged, &fit.object_from_scan, self.cell());
        let agreement = self.agreement(scan, &fit.object_from_scan);
        let warnings = warnings(overlap, freedom);
        freedom.turns |= revolves;
        let (covariance, unobservable) = known.covariance(0.5 * self.diameter, freedom);
        Ok(Registered {
            scan_from_object: fit.object_from_scan.inverse(),
            covariance,
            unobservable,
            overlap,
            sigma: fit.sigma,
            misfit: self.misfit(scan, overlap, agreement),
            warnings,
        })
    }

    /// Lays a scan on the surface from a place of the search, and judges it there.
    fn closer(&self, scan: &PartScan, judged: &Samples, place: Place, control: &Control) -> Result<Place> {
        let sides = self.sides(scan.outward);
        let (widest, last) = (WIDEST_GATE * self.diameter, GATE * self.cell());
        let gates = [widest, (0.5 * widest).max(last), last];
        let revolves = self.order() == Order::Continuous;
        let fit = Fit::new(sides, judged, place.object_from_scan, &gates, revolves, control)?;
        let object_from_scan = fit.object_from_scan;
        let close = closeness(sides, judged, &object_from_scan, last);
        Ok(Place { object_from_scan, fit: close * self.agreement(scan, &object_from_scan) })
    }

    /// How places differ that fit as well as the best one, which comes first.
    fn freedom(&self, places: &[Place]) -> Freedom {
        let [rim, ..] = reach(&self.surface.samples.points);
        let far = 0.5 * STEP * self.diameter;
        let mut freedom = Freedom::default();
        let Some(best) = places.first() else { return freedom };
        for other in places.iter().filter(|other| other.fit > best.fit - AMBIGUOUS) {
            let apart = other.object_from_scan * best.object_from_scan.inverse();
            freedom.turns |= self.turned_by(&apart.rotation) * rim > far;
            freedom.slides |= apart.translation.z.abs() > far;
        }
        freedom
    }

    /// The best places of a scan, turned over or not, on a grid of heights and turns within a sector.
    fn places(&self, scan: &PartScan, flipped: bool, control: &Control) -> Result<Vec<Place>> {
        let over = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), if flipped { PI } else { 0.0 });
        let object_from_scan = over * scan.scan_from_object.inverse();
        let (sides, coarse) = (self.sides(scan.outward), &scan.samples.strided(TRIED));
        let [_, low, high] = reach(&moved(&scan.samples.points, &object_from_scan));
        let [rim, bottom, top] = reach(&self.surface.samples.points);
        let step = STEP * self.diameter;
        // A scan that shows less of the part lies somewhere within it, one that shows more sticks out.
        let (first, last) = ((bottom - low).min(top - high), (bottom - low).max(top - high));
        let heights = (((last - first) / step).ceil() as usize) + 5;
        let sector = match self.order() {
            Order::Cyclic(n) => TAU / f64::from(n),
            _ => 0.0,
        };
        let turns = ((sector * rim / step).ceil() as usize).max(if sector > 0.0 { 12 } else { 1 });
        let mut places: Vec<Place> = (0..heights * turns)
            .into_par_iter()
            .map(|i| {
                control.check()?;
                let (height, turn) = (i / turns, i % turns);
                let about = Vector3::z() * (sector * turn as f64 / turns as f64);
                let along = Translation3::new(0.0, 0.0, first + (height as f64 - 2.0) * step);
                let object_from_scan = along * UnitQuaternion::from_scaled_axis(about) * object_from_scan;
                let gate = 2.0 * step;
                Ok(Place { object_from_scan, fit: closeness(sides, coarse, &object_from_scan, gate) })
            })
            .collect::<Result<_>>()?;
        places.sort_by(|a, b| b.fit.total_cmp(&a.fit));
        let mut best: Vec<Place> = Vec::new();
        for place in places {
            let beside = |other: &Place| {
                let apart = place.object_from_scan * other.object_from_scan.inverse();
                let height = apart.translation.z.abs();
                height < 1.5 * step && self.turned_by(&apart.rotation) * rim < 1.5 * step
            };
            if best.len() < KEPT && !best.iter().any(beside) {
                best.push(place);
            }
        }
        Ok(best)
    }

    /// Share of the reference that the scan confirms, of all that it could see: where it shows empty space, there must not
    /// be a surface.
    fn agreement(&self, scan: &PartScan, object_from_scan: &Isometry3<f64>) -> f64 {
        if scan.visibility.is_none() {
            return 1.0;
        }
        let scan_from_object = object_from_scan.inverse();
        let turn = Turn {
            rotation: scan_from_object.rotation.to_rotation_matrix().into_inner(),
            translation: scan_from_object.translation.vector,
        };
        let gate = Gate::new(AGREES * scan.surface.spacing, MIN_COSINE);
        let Samples { points, normals } = &self.surface.samples;
        let seen = (0..PROBES).map(|i| {
            // The copies of a point follow each other: a golden stride takes some of every sector.
            let row = ((i as f64 * GOLDEN).fract() * points.len() as f64) as usize;
            outcome(scan.surface, &points[row], &normals[row], &turn, gate, scan.visibility.into())
        });
        seen.fold(MatchScore::default(), MatchScore::count).explained()
    }

    /// Angle of a turn about z, the symmetry aside \[rad\].
    fn turned_by(&self, rotation: &UnitQuaternion<f64>) -> f64 {
        let Order::Cyclic(n) = self.order() else { return 0.0 };
        let sector = TAU / f64::from(n);
        let x = rotation * Vector3::x();
        let angle = x.y.atan2(x.x).rem_euclid(sector);
        angle.min(sector - angle)
    }

    /// Of the poses that look like this one the nearest to the preferred one, or to the convention of the estimate.
    fn nearest(&self, pose: Isometry3<f64>, scan: &PartScan) -> Isometry3<f64> {
        let angle = nearest_turn(&pose.rotation, &wanted(scan).rotation, self.order());
        pose * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle)
    }

    /// Share of the scan that must lie on the reference: less where the scan confirms all of the reference that it could
    /// see, since a reference that was taught from one side lacks the other.
    fn least_overlap(&self, scan: &PartScan, agreement: f64) -> f64 {
        if scan.visibility.is_some() && agreement >= CONFIRMED { MIN_OVERLAP_ONE_SIDED } else { MIN_OVERLAP }
    }

    /// Why the scan cannot show the part that was taught, wherever it lies: another order or size.
    fn difference(&self, scan: &PartScan) -> Option<String> {
        let [scanned, low, high] = reach(&moved(&scan.samples.points, &scan.scan_from_object.inverse()));
        let [taught, ..] = reach(&self.surface.samples.points);
        let (ratio, longer) = (scanned / taught, (high - low) / self.diameter);
        if scan.order != self.order() {
            return Some(format!("order {}, but the reference has {}", scan.order, self.order()));
        }
        if !(LARGEST_RATIO.recip()..=LARGEST_RATIO).contains(&ratio) {
            return Some(format!(
                "its radius is {ratio:.3} times that of the reference; the unit must be the same"
            ));
        }
        (longer > LONGEST)
            .then(|| format!("along its axis it is {longer:.0} diameters of the reference long"))
    }

    /// Why the scan shows another part where it fits best, if it does.
    fn misfit(&self, scan: &PartScan, overlap: f64, agreement: f64) -> Option<String> {
        let percent = 100.0 * overlap;
        let least = self.least_overlap(scan, agreement);
        if overlap < least {
            return Some(format!("{percent:.0} % of its points lie on it, {:.0} % should", 100.0 * least));
        }
        let percent = 100.0 * agreement;
        (agreement < MIN_AGREEMENT)
            .then(|| format!("it shows only {percent:.0} % of the surface that should be in sight"))
    }
}

impl Registered {
    /// That of another part.
    fn misfit(scan: &PartScan, reason: String) -> Self {
        Self {
            scan_from_object: scan.scan_from_object,
            covariance: [[0.0; 6]; 6],
            unobservable: Vec::new(),
            overlap: 0.0,
            sigma: 0.0,
            warnings: Vec::new(),
            misfit: Some(reason),
        }
    }
}

/// What to know before relying on the pose.
fn warnings(overlap: f64, freedom: Freedom) -> Vec<String> {
    let mut warnings = Vec::new();
    if overlap < MIN_OVERLAP {
        warnings.push(format!(
            "only {:.0} % of the scan lie on the reference: it was taught from a scan that lacks what this one shows",
            100.0 * overlap
        ));
    }
    let mut arbitrary = |is_free, how: &str, what: &str| {
        if is_free {
            warnings.push(format!("the scan shows nothing that tells {how}: {what} is arbitrary"));
        }
    };
    arbitrary(freedom.turns, "how the part is turned about its axis", "the yaw");
    arbitrary(freedom.slides, "where the part lies along its axis", "the height");
    warnings
}

fn moved(points: &[Vector3<f64>], motion: &Isometry3<f64>) -> Vec<Vector3<f64>> {
    points.iter().map(|p| (motion * Point3::from(*p)).coords).collect()
}

/// The pose that equivalent ones are compared with.
fn wanted(scan: &PartScan) -> Isometry3<f64> {
    scan.preferred.unwrap_or(scan.scan_from_object)
}

/// How far a pose is turned from the one that is wanted \[rad\].
fn away(pose: &Isometry3<f64>, scan: &PartScan) -> f64 {
    pose.rotation.angle_to(&wanted(scan).rotation)
}

/// How close a scan comes to the surface, from 0 (beyond the gate everywhere) to 1.
fn closeness(surface: &SidedSurface, samples: &Samples, object_from_scan: &Isometry3<f64>, gate: f64) -> f64 {
    let near = |row| {
        let (.., distance) = residual(surface, object_from_scan, row, gate)?;
        Some(1.0 - (distance.abs() / gate).min(1.0))
    };
    let rows = samples.points.iter().zip(&samples.normals);
    rows.filter_map(near).sum::<f64>() / samples.points.len().max(1) as f64
}

/// Share of a scan that lies on the surface.
fn overlap(surface: &SidedSurface, samples: &Samples, object_from_scan: &Isometry3<f64>, cell: f64) -> f64 {
    let fits = |row: &(_, _)| {
        let found = residual(surface, object_from_scan, *row, GATE * cell);
        found.is_some_and(|(.., distance)| distance.abs() < FITS * cell)
    };
    let rows = samples.points.iter().zip(&samples.normals);
    rows.filter(fits).count() as f64 / samples.points.len().max(1) as f64
}

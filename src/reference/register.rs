//! Where a scan lies on the reference: height, turn and flip by search, then all six degrees of freedom.

use std::f64::consts::{PI, TAU};

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rayon::prelude::*;

use super::fit::{Fit, residual};
use super::sides::Sides;
use super::{Reference, reach};
use crate::control::Control;
use crate::error::Result;
use crate::result::FreeDirection;
use crate::symmetry::order::Order;
use crate::symmetry::surface::Samples;

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

/// By how much one flip must fit better, for the part not to be the same both ways.
const SAME: f64 = 0.02;

/// Ratio of the sizes beyond which parts differ.
const LARGEST_RATIO: f64 = 1.15;

/// A scan with the frame that symmetry gave it.
pub(crate) struct Scan<'a> {
    /// Points and normals.
    pub samples: &'a Samples,
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
    /// Why this is another part.
    pub misfit: Option<String>,
}

/// A place that was tried and how well it fits, in [0, 1].
#[derive(Clone, Copy)]
struct Place {
    object_from_scan: Isometry3<f64>,
    fit: f64,
}

impl Reference {
    /// Finds the pose of a scan in the taught frame.
    ///
    /// # Errors
    /// When the work is cancelled.
    pub(crate) fn register(&self, scan: &Scan, control: &Control) -> Result<Registered> {
        let surface = &self.surface;
        let free_yaw = self.order() == Order::Continuous;
        let widest = WIDEST_GATE * self.diameter;
        let coarse = scan.samples.strided(TRIED);
        let judged = scan.samples.strided(JUDGED);
        let closer = |place: Place| -> Result<Place> {
            let last = GATE * self.cell();
            let gates = [widest, (0.5 * widest).max(last), last];
            let fit = Fit::new(surface, &judged, place.object_from_scan, &gates, free_yaw, control)?;
            let object_from_scan = fit.object_from_scan;
            Ok(Place { object_from_scan, fit: closeness(surface, &judged, &object_from_scan, last) })
        };
        let mut flips = Vec::new();
        for flipped in [false, true] {
            control.check()?;
            let best =
                self.places(scan, &coarse, flipped).into_iter().map(closer).collect::<Result<Vec<_>>>()?;
            flips.extend(best.into_iter().max_by(|a, b| a.fit.total_cmp(&b.fit)));
        }
        // A part that is the same both ways is taken as it is preferred, or as it stands.
        let most = flips.iter().map(|place| place.fit).fold(0.0, f64::max);
        flips.retain(|place| place.fit >= most - SAME);
        let alike = flips.iter().map(|place| self.nearest(place.object_from_scan.inverse(), scan));
        let near = alike.min_by(|a, b| away(a, scan).total_cmp(&away(b, scan)));
        let near = near.unwrap_or(scan.scan_from_object);
        let gates = [GATE * self.cell()];
        let fit = Fit::new(surface, scan.samples, near.inverse(), &gates, free_yaw, control)?;
        let overlap = overlap(surface, &judged, &fit.object_from_scan, self.cell());
        let (covariance, unobservable) = fit.covariance(0.5 * self.diameter, free_yaw);
        Ok(Registered {
            scan_from_object: fit.object_from_scan.inverse(),
            covariance,
            unobservable,
            overlap,
            sigma: fit.sigma,
            misfit: self.misfit(scan, overlap),
        })
    }

    /// The best places of a scan, turned over or not, on a grid of heights and turns within a sector.
    fn places(&self, scan: &Scan, coarse: &Samples, flipped: bool) -> Vec<Place> {
        let over = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), if flipped { PI } else { 0.0 });
        let object_from_scan = over * scan.scan_from_object.inverse();
        let moved: Vec<Vector3<f64>> = scan.samples.strided(JUDGED).points;
        let moved: Vec<Vector3<f64>> =
            moved.iter().map(|p| (object_from_scan * nalgebra::Point3::from(*p)).coords).collect();
        let [_, low, high] = reach(&moved);
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
                let (height, turn) = (i / turns, i % turns);
                let about = Vector3::z() * (sector * turn as f64 / turns as f64);
                let along = Translation3::new(0.0, 0.0, first + (height as f64 - 2.0) * step);
                let object_from_scan = along * UnitQuaternion::from_scaled_axis(about) * object_from_scan;
                let gate = 2.0 * step;
                Place { object_from_scan, fit: closeness(&self.surface, coarse, &object_from_scan, gate) }
            })
            .collect();
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
        best
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
    fn nearest(&self, pose: Isometry3<f64>, scan: &Scan) -> Isometry3<f64> {
        let wanted = wanted(scan);
        // Turning about the axis: of all angles the best is where the x axes come closest.
        let [x, y] = [wanted.rotation * Vector3::x(), wanted.rotation * Vector3::y()];
        let axes = [pose.rotation * Vector3::x(), pose.rotation * Vector3::y()];
        // The trace of wanted' R turn(a) is greatest at this angle.
        let best = (axes[1].dot(&x) - axes[0].dot(&y)).atan2(axes[0].dot(&x) + axes[1].dot(&y));
        let angle = match self.order() {
            Order::Cyclic(n) => {
                let sector = TAU / f64::from(n);
                (best / sector).round() * sector
            }
            _ => best,
        };
        pose * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle)
    }

    /// Why the scan shows another part, if it does.
    fn misfit(&self, scan: &Scan, overlap: f64) -> Option<String> {
        let scan_size = {
            let object_from_scan = scan.scan_from_object.inverse();
            let points =
                scan.samples.points.iter().map(|p| (object_from_scan * nalgebra::Point3::from(*p)).coords);
            reach(&points.collect::<Vec<_>>())[0]
        };
        let ratio = scan_size / reach(&self.surface.samples.points)[0];
        let different = |what: String| Some(format!("the scan does not fit the reference: {what}"));
        if scan.order != self.order() {
            return different(format!("order {}, but the reference has {}", scan.order, self.order()));
        }
        if !(LARGEST_RATIO.recip()..=LARGEST_RATIO).contains(&ratio) {
            return different(format!("its radius is {ratio:.2} times that of the reference"));
        }
        if overlap < MIN_OVERLAP {
            let percent = 100.0 * overlap;
            return different(format!(
                "{percent:.0} % of its points lie on it, at least {:.0} % are needed",
                100.0 * MIN_OVERLAP
            ));
        }
        None
    }
}

/// The pose that equivalent ones are compared with.
fn wanted(scan: &Scan) -> Isometry3<f64> {
    scan.preferred.unwrap_or(scan.scan_from_object)
}

/// How far a pose is turned from the one that is wanted \[rad\].
fn away(pose: &Isometry3<f64>, scan: &Scan) -> f64 {
    pose.rotation.angle_to(&wanted(scan).rotation)
}

/// How close a scan comes to the surface, from 0 (beyond the gate everywhere) to 1.
fn closeness(surface: &Sides, samples: &Samples, object_from_scan: &Isometry3<f64>, gate: f64) -> f64 {
    let near = |row| {
        let (.., distance) = residual(surface, object_from_scan, row, gate)?;
        Some(1.0 - (distance.abs() / gate).min(1.0))
    };
    let rows = samples.points.iter().zip(&samples.normals);
    rows.filter_map(near).sum::<f64>() / samples.points.len().max(1) as f64
}

/// Share of a scan that lies on the surface.
fn overlap(surface: &Sides, samples: &Samples, object_from_scan: &Isometry3<f64>, cell: f64) -> f64 {
    let fits = |row: &(_, _)| {
        let found = residual(surface, object_from_scan, *row, GATE * cell);
        found.is_some_and(|(.., distance)| distance.abs() < FITS * cell)
    };
    let rows = samples.points.iter().zip(&samples.normals);
    rows.filter(fits).count() as f64 / samples.points.len().max(1) as f64
}

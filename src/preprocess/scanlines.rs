//! Where a depth sensor stood, from the order of its points.
//!
//! A depth image is read out row by row, and its noise lies along the rays: however noisy, the points of one row lie in a
//! plane with the sensor. The planes of all rows meet in a line through it, parallel to the rows. Where on that line the
//! sensor stands follows from the pixels of a row, which are equally far apart.

use std::ops::Range;

use nalgebra::Vector3;
use rayon::prelude::*;

use super::sensor::{Row, Sensor};
use super::{CHUNK, finite_bounds};
use crate::error::Result;
use crate::median::median;

/// Least points of a row from which its plane is taken; three lie in one anyway.
const ROW: usize = 6;

/// Rows from which one place is found, and by how many the next such window begins later, at least.
const WINDOW: [usize; 2] = [24, 12];

/// Such windows, at most: several for each of the usual number of views.
const WINDOWS: usize = 128;

/// Rows of one place from which it is found more exactly, at most.
const TOGETHER: usize = 256;

/// Distance of a place, at most [diagonal of the bounding box]: rows of a lattice meet nowhere.
const FARTHEST: f64 = 1000.0;

/// Share of the points that must lie in one row with the next point, as seen from the place found for them. Where narrow
/// parts leave rows of a few points it is lower than elsewhere; seen from elsewhere it is a few in a hundred.
const LEAST_SHARE: f64 = 0.6;

/// The places of a sensor.
#[derive(Debug, Clone, PartialEq)]
pub struct SensorPlaces {
    /// Where the sensor stood \[length\].
    pub places: Vec<[f64; 3]>,
    /// For each point the place that it was seen from.
    pub place_of: Vec<u32>,
    /// Share of the points that lie in one row of a picture with the next one.
    pub share: f64,
}

/// The places from which a depth sensor measured `points`, where these come in the order in which it read them out: row
/// by row (or column by column), one view after the other. `None` for any other order.
///
/// The coordinates must not be rounded to more than a thousandth of the distance between two points.
///
/// ```
/// use sympose::preprocess::viewpoints_from_order;
/// // What a sensor at (0, 0, 5) sees of a bumpy plate, row by row.
/// let ray = |i: u32| [0.01 * f64::from(i % 100) - 0.5, 0.01 * f64::from(i / 100) - 0.5, -1.0];
/// let depth = |i: u32| 5.0 + 0.2 * f64::from(i % 100 * (i / 100) % 7);
/// let seen = |i: u32| { let [x, y, z] = ray(i).map(|x| x * depth(i)); [x, y, z + 5.0] };
/// let points: Vec<[f64; 3]> = (0..10_000).map(seen).collect();
/// let found = viewpoints_from_order(&points)?.expect("rows of a picture");
/// assert_eq!(found.places.len(), 1);
/// assert!(found.places[0].iter().zip([0.0, 0.0, 5.0]).all(|(found, known)| (found - known).abs() < 1e-6));
/// # Ok::<(), sympose::Error>(())
/// ```
///
/// # Errors
/// [`Error::NonFinite`](crate::Error::NonFinite).
pub fn viewpoints_from_order(points: &[[f64; 3]]) -> Result<Option<SensorPlaces>> {
    let [lower, upper] = finite_bounds(points)?.map(Vector3::from);
    let farthest = FARTHEST * (upper - lower).norm();
    let mut rows: Vec<Row> = runs(points).into_par_iter().filter_map(|run| Row::of(points, run)).collect();
    let mut sensors = Vec::new();
    // Of many views, or of near ones, the first round misses some, whose rows are what is left.
    loop {
        let found = sensors_of(&rows, points, farthest);
        let left = rows.len();
        rows.retain(|row| !found.iter().any(|sensor| sensor.has(row)));
        if rows.len() == left {
            break;
        }
        sensors.extend(found);
    }
    if sensors.is_empty() {
        return Ok(None);
    }
    let (place_of, told) = assign(points, &sensors);
    let share = told.len() as f64 / (points.len() - 1) as f64;
    if share < LEAST_SHARE || any_missed(points.len(), &told) {
        return Ok(None);
    }
    // A lens that bends the rows, and rounding, give one sensor several places.
    let mut distinct: Vec<&Sensor> = Vec::new();
    let mut place_of_sensor = Vec::with_capacity(sensors.len());
    for sensor in &sensors {
        let same = distinct.iter().position(|known| sensor.may_be(known));
        place_of_sensor.push(same.unwrap_or(distinct.len()) as u32);
        if same.is_none() {
            distinct.push(sensor);
        }
    }
    Ok(Some(SensorPlaces {
        places: distinct.iter().map(|sensor| sensor.place.into()).collect(),
        place_of: place_of.into_iter().map(|sensor| place_of_sensor[sensor as usize]).collect(),
        share,
    }))
}

/// Whether there are long stretches of points of which few are `told`: views that were not found, or points in no order.
fn any_missed(count: usize, told: &[(usize, u32)]) -> bool {
    /// Points of a stretch.
    const STRETCH: usize = 256;
    /// Share of them that must be told.
    const TOLD: f64 = 1.0 / 3.0;
    /// Share of all points that may be in stretches with less.
    const MISSED: f64 = 0.05;
    let until = |point: usize| told.partition_point(|(i, _)| *i < point);
    let is_missed = |first: &usize| {
        let len = STRETCH.min(count - first);
        ((until(first + len) - until(*first)) as f64) < TOLD * (len - 1) as f64
    };
    let missed = (0..count).step_by(STRETCH).filter(is_missed).count() * STRETCH;
    missed as f64 > MISSED * count as f64
}

/// The sensors that several windows of `rows` agree on, those of most windows first, none `farthest` away or beyond.
fn sensors_of(rows: &[Row], points: &[[f64; 3]], farthest: f64) -> Vec<Sensor> {
    let windows: Vec<&[Row]> = if rows.len() < WINDOW[0] {
        vec![rows]
    } else {
        rows.windows(WINDOW[0]).step_by(rows.len().div_ceil(WINDOWS).max(WINDOW[1])).collect()
    };
    let mut candidates: Vec<Candidate> = windows
        .into_par_iter()
        .filter_map(|rows| Some(Candidate { sensor: Sensor::of(rows, points)?, rows }))
        .filter(|candidate| candidate.sensor.distance < farthest)
        .collect();
    let mut sensors = Vec::new();
    while let Some(agreeing) = most_agreeing(&candidates) {
        let first = agreeing[0].sensor;
        // From all of these rows the place is more exact than from those of one window.
        let together: Vec<&Row> = agreeing.iter().flat_map(|candidate| candidate.rows).collect();
        let some = together.iter().copied().step_by(together.len().div_ceil(TOGETHER));
        let sensor = Sensor::of(some, points).filter(|other| first.is_at(other)).unwrap_or(first);
        candidates.retain(|candidate| !candidate.sensor.is_at(&sensor) && !candidate.sensor.is_at(&first));
        sensors.push(sensor);
    }
    sensors
}

/// Runs of points each of which is near the next one.
fn runs(points: &[[f64; 3]]) -> Vec<Range<usize>> {
    /// Distance to the next point at which a run ends [median].
    const GAP: f64 = 5.0;
    /// Steps from which the median is taken.
    const STEPS: usize = 4096;
    let stride = points.len().div_ceil(STEPS).max(1);
    let mut steps_sq: Vec<f64> = (1..points.len()).step_by(stride).map(|i| step_sq(points, i - 1)).collect();
    let gap_sq = GAP * GAP * median(&mut steps_sq).unwrap_or_default();
    let mut runs = Vec::new();
    let mut first = 0;
    for end in 1..=points.len() {
        if end == points.len() || step_sq(points, end - 1) > gap_sq {
            if end - first >= ROW {
                runs.push(first..end);
            }
            first = end;
        }
    }
    runs
}

/// The sensor that some rows show.
struct Candidate<'a> {
    sensor: Sensor,
    rows: &'a [Row],
}

/// The largest set of candidates that stand where the first of them does; `None` unless some do.
fn most_agreeing<'a, 'b>(candidates: &'b [Candidate<'a>]) -> Option<Vec<&'b Candidate<'a>>> {
    /// Candidates that others are compared with.
    const COMPARED: usize = 200;
    let with = |one: &'b Candidate<'a>| {
        let others = candidates.iter().filter(move |other| other.sensor.is_at(&one.sensor));
        std::iter::once(one).chain(others.filter(move |other| !std::ptr::eq(*other, one)))
    };
    let stride = candidates.len().div_ceil(COMPARED).max(1);
    let best = candidates.iter().step_by(stride).map(|one| (with(one).count(), one));
    let (count, one) = best.fold(None, |best: Option<(usize, _)>, other| match best {
        Some(best) if best.0 >= other.0 => Some(best),
        _ => Some(other),
    })?;
    (count > 1).then(|| with(one).collect())
}

/// For each point its sensor, where its own row does not tell that of the points about it; and the points that lie in one
/// row with the next one, each with its sensor.
fn assign(points: &[[f64; 3]], sensors: &[Sensor]) -> (Vec<u32>, Vec<(usize, u32)>) {
    let count = points.len() - 1;
    let chunk = |start: usize| {
        let mut last = 0;
        let found = (start..(start + CHUNK).min(count)).filter_map(move |i| {
            let tells = |sensor: &usize| sensors[*sensor].in_one_row(&points[i], &points[i + 1]);
            last = std::iter::once(last).chain(0..sensors.len()).find(tells)?;
            Some((i, last as u32))
        });
        found.collect::<Vec<_>>()
    };
    let starts: Vec<usize> = (0..count).step_by(CHUNK).collect();
    let told: Vec<(usize, u32)> = starts.into_par_iter().flat_map_iter(chunk).collect();
    // One alone among those of another sensor is chance.
    let sensor_of = |at: usize| told.get(at).map(|(_, sensor)| *sensor);
    let is_alone = |at: usize| {
        let own = sensor_of(at);
        own != sensor_of(at + 1) && (at == 0 || own != sensor_of(at - 1))
    };
    let mut place_of = Vec::with_capacity(points.len());
    let mut before = None;
    for at in (0..told.len()).filter(|&at| !is_alone(at)) {
        let (point, sensor) = told[at];
        // Between two views there is a leap.
        let first = place_of.len();
        let leap =
            (first.max(1)..=point).max_by(|&i, &k| step_sq(points, i - 1).total_cmp(&step_sq(points, k - 1)));
        place_of.resize(leap.unwrap_or(first).max(first), before.unwrap_or(sensor));
        place_of.resize(point + 2, sensor);
        before = Some(sensor);
    }
    place_of.resize(points.len(), before.unwrap_or_default());
    (place_of, told)
}

/// Squared distance from a point to the next one \[length²\].
fn step_sq(points: &[[f64; 3]], i: usize) -> f64 {
    (Vector3::from(points[i + 1]) - Vector3::from(points[i])).norm_squared()
}

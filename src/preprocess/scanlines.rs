//! Where a depth sensor stood, from the order of its points.
//!
//! A depth image is read out row by row, and its noise lies along the rays: however noisy, the points of one row lie in a
//! plane with the sensor. The planes of all rows meet in a line through it, parallel to the rows. Where on that line the
//! sensor stands follows from the pixels of a row, which are equally far apart.

use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};
use rayon::prelude::*;

use super::CHUNK;
use super::eigen::smallest_eigenvector;
use super::finite_bounds;
use super::moments::Moments;
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

/// Distance between places that pass for one [distance to the surface].
const SAME_PLACE: f64 = 0.05;

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
    let runs = runs(points);
    let row = |&(first, len): &(usize, usize)| Row::of(first, &points[first..first + len]);
    let mut rows: Vec<Row> = runs.par_iter().filter_map(row).collect();
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
    let places = sensors.iter().map(|sensor| sensor.place.into()).collect();
    Ok((share >= LEAST_SHARE && !any_missed(points.len(), &told)).then_some(SensorPlaces {
        places,
        place_of,
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

/// First point and number of the runs of points each of which is near the next one.
fn runs(points: &[[f64; 3]]) -> Vec<(usize, usize)> {
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
                runs.push((first, end - first));
            }
            first = end;
        }
    }
    runs
}

/// Consecutive points of one row of a picture, in a plane with the sensor.
struct Row {
    first: usize,
    len: usize,
    middle: Vector3<f64>,
    /// Of their plane.
    normal: Vector3<f64>,
    /// How far they spread within it across the row \[length²\]: the more, the better the plane is known.
    breadth_sq: f64,
}

impl Row {
    /// Of points that lie in a plane but not on a line.
    fn of(first: usize, points: &[[f64; 3]]) -> Option<Self> {
        /// Thickness of a plane that rounding leaves [breadth].
        const FLAT: f64 = 0.05;
        /// Least breadth [length]; with less the points lie on a line.
        const BROAD: f64 = 1e-9;
        let about = Vector3::from(points[0]);
        let mut moments = Moments::default();
        points.iter().for_each(|p| moments.add((Vector3::from(*p) - about).into()));
        let (normal, [thickness_sq, breadth_sq, length_sq]) = smallest_eigenvector(&moments.scatter());
        let is_flat = thickness_sq < FLAT * FLAT * breadth_sq && breadth_sq > BROAD * BROAD * length_sq;
        let middle = about + moments.sum() / points.len() as f64;
        is_flat.then_some(Self { first, len: points.len(), middle, normal, breadth_sq })
    }
}

/// A sensor and its rows.
#[derive(Debug, Clone, Copy)]
struct Sensor {
    place: Vector3<f64>,
    /// Unit direction of the rows, the way they are read out.
    along: Vector3<f64>,
    /// Between two pixels of a row [rad].
    pitch: f64,
    /// To the points \[length\].
    distance: f64,
}

impl Sensor {
    /// The one that measured all of `rows`; `None` where they do not tell, or most of them are no such rows.
    fn of<'a>(rows: impl IntoIterator<Item = &'a Row, IntoIter: Clone>, points: &[[f64; 3]]) -> Option<Self> {
        /// Width of the interval of places on the line on which a quarter of all pairs of pixels agree, at most [distance].
        const CERTAIN: f64 = 0.02;
        let rows = rows.into_iter();
        let (through, along) = common_line(rows.clone())?;
        // A point at x along the line and r across is seen at x / r, by a sensor at t at (x - t) / r; and from one pixel
        // to the next that changes by as much everywhere, also where noise changes r.
        let mut changes: Vec<[f64; 2]> = Vec::new();
        let mut places: Vec<(f64, f64)> = Vec::new();
        for row in rows.clone() {
            let seen = |p: &[f64; 3]| {
                let from = Vector3::from(*p) - through;
                let x = from.dot(&along);
                let r = (from - along * x).norm();
                [x / r, r.recip()]
            };
            let seen: Vec<[f64; 2]> = points[row.first..row.first + row.len].iter().map(seen).collect();
            let start = changes.len();
            changes.extend(seen.windows(2).map(|pair| [pair[1][0] - pair[0][0], pair[1][1] - pair[0][1]]));
            let half = (changes.len() - start).div_ceil(2);
            for (one, other) in changes[start..].iter().zip(&changes[start + half..]) {
                let weight = (one[1] - other[1]).abs();
                if weight > 0.0 {
                    places.push(((one[0] - other[0]) / (one[1] - other[1]), weight));
                }
            }
        }
        let (at, width) = shortest_quarter(&mut places)?;
        let place = through + along * at;
        let (sum, count) = rows.fold((Vector3::zeros(), 0.0), |(sum, n), row| (sum + row.middle, n + 1.0));
        let distance = (sum / count - place).norm();
        let mut pitches: Vec<f64> = changes.iter().map(|change| change[0] - at * change[1]).collect();
        let pitch = median(&mut pitches)?;
        let is_certain = width <= CERTAIN * distance && pitch != 0.0;
        is_certain.then_some(Self { place, along: along * pitch.signum(), pitch: pitch.abs(), distance })
    }

    /// Whether both stand at one place, as far as that is known.
    fn is_at(&self, other: &Self) -> bool {
        (self.place - other.place).norm() <= SAME_PLACE * self.distance.min(other.distance)
    }

    /// Whether the plane of the row goes through the sensor.
    fn has(&self, row: &Row) -> bool {
        /// How far it may miss [pixels].
        const MISS: f64 = 0.5;
        let from = row.middle - self.place;
        row.normal.dot(&from).abs() <= MISS * self.pitch * from.norm()
    }

    /// Whether `point` and the `next` one lie in one row of the picture, a few pixels apart.
    fn in_one_row(&self, point: &[f64; 3], next: &[f64; 3]) -> bool {
        /// Difference in height [pixels].
        const LEVEL: f64 = 0.15;
        /// Distance [pixels], and how far it is from a whole number.
        const APART: [f64; 2] = [3.5, 0.25];
        let seen = [point, next].map(|p| {
            let from = Vector3::from(*p) - self.place;
            let x = from.dot(&self.along);
            let across = from - self.along * x;
            (x, across, across.norm())
        });
        let [(x, across, r), (next_x, next_across, next_r)] = seen;
        let height = self.along.dot(&across.cross(&next_across)) / (r * next_r);
        let pixels = (next_x / next_r - x / r) / self.pitch;
        height.abs() <= LEVEL * self.pitch
            && (0.5..APART[0]).contains(&pixels)
            && (pixels - pixels.round()).abs() <= APART[1]
    }
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

/// A point and the unit direction of the line in which the planes of most of the `rows` meet; `None` where they do not
/// differ enough to tell.
fn common_line<'a>(rows: impl Iterator<Item = &'a Row> + Clone) -> Option<(Vector3<f64>, Vector3<f64>)> {
    /// Rounds in which planes that miss the line lose their weight.
    const ROUNDS: usize = 4;
    /// Distance from the line at which a plane has half its weight [median].
    const HALF: f64 = 3.0;
    /// Variance of the directions of planes by their errors, at most [of that by which they differ]. Errors draw the line
    /// toward the points by as large a share of its distance.
    const BIAS: f64 = 0.01;
    let count = rows.clone().count() as f64;
    let middle = rows.clone().map(|row| row.middle).sum::<Vector3<f64>>() / count;
    let mut breadths_sq: Vec<f64> = rows.clone().map(|row| row.breadth_sq).collect();
    // The best planes do not outweigh all others, lest a chance one leads.
    let most = 4.0 * median(&mut breadths_sq)?;
    let mut weights: Vec<f64> = rows.clone().map(|row| row.breadth_sq.min(most)).collect();
    let mut line = None;
    for _ in 0..ROUNDS {
        let mut normals = Matrix3::zeros();
        for (row, weight) in rows.clone().zip(&weights) {
            normals += row.normal * row.normal.transpose() * *weight;
        }
        let (along, [_, difference_sq, sum]) = smallest_eigenvector(&normals);
        let u = along.cross(&Vector3::ith(along.iamin(), 1.0)).normalize();
        let v = along.cross(&u);
        let (mut products, mut moment) = (Matrix2::zeros(), Vector2::zeros());
        for (row, weight) in rows.clone().zip(&weights) {
            let normal = Vector2::new(row.normal.dot(&u), row.normal.dot(&v));
            products += normal * normal.transpose() * *weight;
            moment += normal * (row.normal.dot(&(row.middle - middle)) * *weight);
        }
        let at = products.try_inverse()? * moment;
        let through = middle + u * at.x + v * at.y;
        // As an angle at the plane.
        let miss = |row: &Row| {
            let from = through - row.middle;
            row.normal.dot(&from).abs() / from.norm() + row.normal.dot(&along).abs()
        };
        let mut misses: Vec<f64> = rows.clone().map(miss).collect();
        let typical = median(&mut misses)?;
        let half = HALF * typical.max(f64::MIN_POSITIVE);
        for (row, weight) in rows.clone().zip(&mut weights) {
            *weight = row.breadth_sq.min(most) / (1.0 + (miss(row) / half).powi(2));
        }
        line = (typical * typical * sum <= BIAS * difference_sq).then_some((through, along));
    }
    line
}

/// Mean and width of the shortest interval that holds a quarter of the weight of some values: what most of those say that
/// agree, however many do not.
fn shortest_quarter(values: &mut [(f64, f64)]) -> Option<(f64, f64)> {
    let by_value = |a: &(f64, f64), b: &(f64, f64)| a.0.total_cmp(&b.0);
    values.sort_unstable_by(by_value);
    let quarter = 0.25 * values.iter().map(|(_, weight)| weight).sum::<f64>();
    let (mut first, mut within, mut shortest) = (0, 0.0, None);
    for (last, (value, weight)) in values.iter().enumerate() {
        within += weight;
        while within - values[first].1 >= quarter {
            within -= values[first].1;
            first += 1;
        }
        let width = value - values[first].0;
        if within >= quarter && shortest.as_ref().is_none_or(|(shortest, _)| width < *shortest) {
            shortest = Some((width, first..=last));
        }
    }
    let (width, interval) = shortest?;
    let inside = &values[interval];
    let (sum, weight) = inside
        .iter()
        .fold((0.0, 0.0), |(sum, total), (value, weight)| (sum + weight * value, total + weight));
    Some((sum / weight, width))
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

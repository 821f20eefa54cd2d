//! A depth sensor and the rows of its pictures: in a plane with it, however noisy, and pixels equally far apart.

use std::ops::Range;

use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};

use super::eigen::smallest_eigenvector;
use super::moments::Moments;
use crate::directions::tangents;
use crate::median::median;

/// Distance between places that pass for one [distance to the surface].
const SAME_PLACE: f64 = 0.05;

/// Consecutive points of one row of a picture, in a plane with the sensor.
pub(super) struct Row {
    run: Range<usize>,
    middle: Vector3<f64>,
    /// Of their plane.
    normal: Vector3<f64>,
    /// How far they spread within it across the row \[length²\]: the more, the better the plane is known.
    breadth_sq: f64,
}

impl Row {
    /// The `run` of `points`, if they lie in a plane but not on a line.
    pub(super) fn of(points: &[[f64; 3]], run: Range<usize>) -> Option<Self> {
        /// Thickness of a plane that rounding leaves [breadth].
        const FLAT: f64 = 0.05;
        /// Least breadth [length of the row]; with less the points lie on a line.
        const BROAD: f64 = 1e-9;
        let points = &points[run.clone()];
        let about = Vector3::from(points[0]);
        let mut moments = Moments::default();
        points.iter().for_each(|p| moments.add((Vector3::from(*p) - about).into()));
        let (normal, [thickness_sq, breadth_sq, length_sq]) = smallest_eigenvector(&moments.scatter());
        let is_flat = thickness_sq < FLAT * FLAT * breadth_sq && breadth_sq > BROAD * BROAD * length_sq;
        let middle = about + moments.sum() / points.len() as f64;
        is_flat.then_some(Self { run, middle, normal, breadth_sq })
    }
}

/// A sensor and its rows.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sensor {
    pub(super) place: Vector3<f64>,
    /// Unit direction of the rows, the way they are read out.
    along: Vector3<f64>,
    /// Between two pixels of a row [rad].
    pitch: f64,
    /// To the points \[length\].
    pub(super) distance: f64,
    /// By how much a typical row misses it [rad].
    miss: f64,
}

impl Sensor {
    /// The one that measured all of `rows`; `None` where they do not tell, or most of them are no such rows.
    pub(super) fn of<'a>(
        rows: impl IntoIterator<Item = &'a Row, IntoIter: Clone>,
        points: &[[f64; 3]],
    ) -> Option<Self> {
        /// Width of the interval of places on the line on which a quarter of all pairs of pixels agree, at most [distance].
        const CERTAIN: f64 = 0.02;
        let rows = rows.into_iter();
        let Line { through, along, miss } = common_line(rows.clone())?;
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
            let seen: Vec<[f64; 2]> = points[row.run.clone()].iter().map(seen).collect();
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
        is_certain.then_some(Self {
            place,
            along: along * pitch.signum(),
            pitch: pitch.abs(),
            distance,
            miss,
        })
    }

    /// Whether both stand at one place, as far as that is known.
    pub(super) fn is_at(&self, other: &Self) -> bool {
        (self.place - other.place).norm() <= SAME_PLACE * self.distance.min(other.distance)
    }

    /// Whether both may be one sensor whose place is not known exactly.
    pub(super) fn may_be(&self, other: &Self) -> bool {
        /// By how much its rows miss a sensor whose place is known exactly, at most [pixels].
        const EXACT: f64 = 0.02;
        /// Distance between places of one sensor [distance to the surface].
        const NEAR: f64 = 0.1;
        let is_exact = self.miss.max(other.miss) <= EXACT * self.pitch;
        !is_exact && (self.place - other.place).norm() <= NEAR * self.distance
    }

    /// Whether the plane of the row goes through the sensor.
    pub(super) fn has(&self, row: &Row) -> bool {
        /// How far it may miss [pixels].
        const MISS: f64 = 0.5;
        let from = row.middle - self.place;
        row.normal.dot(&from).abs() <= MISS * self.pitch * from.norm()
    }

    /// Whether `point` and the `next` one lie in one row of the picture, a few pixels apart.
    pub(super) fn in_one_row(&self, point: &[f64; 3], next: &[f64; 3]) -> bool {
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

/// The line in which planes meet.
struct Line {
    through: Vector3<f64>,
    along: Vector3<f64>,
    /// By how much a typical plane misses it [rad].
    miss: f64,
}

/// The line in which the planes of most of the `rows` meet; `None` where they do not differ enough to tell.
fn common_line<'a>(rows: impl Iterator<Item = &'a Row> + Clone) -> Option<Line> {
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
        let [u, v] = tangents(&along);
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
        let is_told = typical * typical * sum <= BIAS * difference_sq;
        line = is_told.then_some(Line { through, along, miss: typical });
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
        while first < last && within - values[first].1 >= quarter {
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

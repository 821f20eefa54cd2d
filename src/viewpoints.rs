//! Where the sensor stood, point by point.

use std::collections::HashMap;

use nalgebra::Vector3;

use crate::cloud::LARGEST_COORDINATE;
use crate::error::{Error, Result};

/// Places of the sensor, and which of them each point was seen from: a place that many points share is kept once.
///
/// ```
/// use sympose::{PointCloud, Viewpoints};
/// let cloud = PointCloud::from_points(vec![[0.0; 3], [1.0; 3], [2.0; 3]])?;
/// let viewpoints = Viewpoints::of_rows(&[[0.0, 0.0, 5.0], [0.0, 0.0, 5.0], [9.0, 0.0, 5.0]]);
/// assert_eq!(viewpoints.of_point(3), None);
/// assert!(cloud.with_sensor_at(viewpoints)?.has_viewpoints());
/// # Ok::<(), sympose::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Viewpoints {
    /// Its places, none twice; empty when they are unknown.
    pub(crate) places: Vec<[f64; 3]>,
    /// For each point its place; empty where all points have the first one.
    pub(crate) place_of: Vec<u32>,
}

impl Viewpoints {
    /// Takes one row for each point, or a single row that holds for all points.
    #[must_use]
    pub fn of_rows(rows: &[[f64; 3]]) -> Self {
        if let [one] = rows {
            return Self { places: vec![*one], place_of: Vec::new() };
        }
        let mut known: HashMap<[u64; 3], u32> = HashMap::new();
        let mut found = Self { places: Vec::new(), place_of: Vec::with_capacity(rows.len()) };
        // Scans come view by view, so that the same place mostly follows itself.
        for run in rows.chunk_by(|a, b| a == b) {
            let place = *known.entry(run[0].map(f64::to_bits)).or_insert_with(|| {
                found.places.push(run[0]);
                found.places.len() as u32 - 1
            });
            found.place_of.resize(found.place_of.len() + run.len(), place);
        }
        found
    }

    /// Number of place that point `index` was seen from; 0 where none is known.
    #[inline]
    pub(crate) fn place_of(&self, index: usize) -> usize {
        self.place_of.get(index).map_or(0, |&place| place as usize)
    }

    /// Where point `index` was seen from; `None` where that is not known, or there is no such point.
    #[inline]
    #[must_use]
    pub fn of_point(&self, index: usize) -> Option<[f64; 3]> {
        let place = if self.are_one() { 0 } else { *self.place_of.get(index)? as usize };
        self.places.get(place).copied()
    }

    /// Whether they were given by a single row, for all points.
    fn are_one(&self) -> bool {
        self.places.len() == 1 && self.place_of.is_empty()
    }

    /// Refuses them unless they are those of so many points, or one for all.
    pub(crate) fn check_len(&self, points: usize) -> Result<()> {
        if self.are_one() || self.place_of.len() == points {
            return Ok(());
        }
        Err(Error::LengthMismatch { what: "viewpoints", expected: points, got: self.place_of.len() })
    }

    /// Refuses a place with a coordinate that is NaN, infinite, or too large to be squared safely.
    pub(crate) fn check_finite(&self) -> Result<()> {
        let is_bad = |place: &[f64; 3]| !place.iter().all(|x| x.abs() <= LARGEST_COORDINATE);
        if !self.places.iter().any(is_bad) {
            return Ok(());
        }
        let total = self.place_of.len().max(1);
        let count = (0..total).filter(|&i| is_bad(&self.places[self.place_of(i)])).count();
        Err(Error::InvalidParameter {
            name: "viewpoints",
            value: format!("{count} of {total} rows with a coordinate that is NaN, infinite, or beyond 1e18"),
            expected: "finite positions of the sensor, or none where it is not known",
        })
    }

    /// Those of some of the points, in this order, without places that none of these was seen from.
    pub(crate) fn of_points(self, rows: &[u32]) -> Self {
        if self.are_one() {
            return self;
        }
        let mut renumbered: Vec<Option<u32>> = vec![None; self.places.len()];
        let mut places = Vec::new();
        let mut renumber = |&row: &u32| {
            let place = self.place_of[row as usize] as usize;
            *renumbered[place].get_or_insert_with(|| {
                places.push(self.places[place]);
                places.len() as u32 - 1
            })
        };
        let place_of = rows.iter().map(&mut renumber).collect();
        Self { places, place_of }
    }
}

/// Distance within which places count as one [distance to the part].
pub(crate) const NEAR: f64 = 0.02;

/// Groups that a place is compared with, at most.
const COMPARED: usize = 256;

/// Joins places that lie near each other as seen from `target`: a sensor that moves while it scans, or whose place was
/// recorded with noise, has a place for every line or point, and none of them alone shows what is empty.
///
/// Returns the mean place of each group, and for each place its group. Places that are far from each other stay as they are.
pub(crate) fn join_places(places: &[Vector3<f64>], target: &Vector3<f64>) -> (Vec<Vector3<f64>>, Vec<u32>) {
    let (groups, group_of) = join(places.iter().map(|place| (*place, 1.0)), target);
    // The first place of a group may be an outlier of it, and leave others of the same sensor beyond its reach.
    let mut by_size: Vec<u32> = (0..groups.len() as u32).collect();
    by_size.sort_by(|a, b| groups[*b as usize].1.total_cmp(&groups[*a as usize].1));
    let (joined, joined_of) = join(by_size.iter().map(|&group| groups[group as usize]), target);
    let mut joined_of_group = vec![0; groups.len()];
    by_size.iter().zip(joined_of).for_each(|(&group, joined)| joined_of_group[group as usize] = joined);
    let group_of = group_of.into_iter().map(|group| joined_of_group[group as usize]).collect();
    (joined.into_iter().map(|(place, _)| place).collect(), group_of)
}

/// Means of places with weights, each grouped with the first one that it is near, and their weights; for each its group.
fn join(
    places: impl Iterator<Item = (Vector3<f64>, f64)>,
    target: &Vector3<f64>,
) -> (Vec<(Vector3<f64>, f64)>, Vec<u32>) {
    let mut firsts: Vec<Vector3<f64>> = Vec::new();
    let mut sums: Vec<(Vector3<f64>, f64)> = Vec::new();
    let mut last = 0;
    let mut group = |(place, weight): (Vector3<f64>, f64)| {
        let reach = NEAR * (place - target).norm();
        let is_near = |first: &Vector3<f64>| (place - first).norm() <= reach;
        // Places that follow each other are mostly near each other.
        if !firsts.get(last).is_some_and(is_near) {
            last = firsts.iter().take(COMPARED).position(is_near).unwrap_or(firsts.len());
        }
        if last == firsts.len() {
            firsts.push(place);
            sums.push((Vector3::zeros(), 0.0));
        }
        sums[last].0 += place * weight;
        sums[last].1 += weight;
        last as u32
    };
    let group_of = places.map(&mut group).collect();
    (sums.into_iter().map(|(sum, weight)| (sum / weight, weight)).collect(), group_of)
}

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
    /// Its places; empty when they are unknown.
    pub(crate) places: Vec<[f64; 3]>,
    /// For each point its place; empty where all points have the first one.
    pub(crate) place_of: Vec<u32>,
    /// What else saw each point, where that is known.
    pub(crate) tracks: Option<Tracks>,
}

/// The places that saw each point, that from which it counts as seen first.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Tracks {
    /// For each point the end of its places in the list of all.
    ends: Vec<usize>,
    places: Vec<u32>,
}

impl Tracks {
    fn push(&mut self, places: impl Iterator<Item = u32>) {
        self.places.extend(places);
        self.ends.push(self.places.len());
    }

    fn of(&self, point: usize) -> &[u32] {
        let start = point.checked_sub(1).map_or(0, |last| self.ends[last]);
        &self.places[start..self.ends[point]]
    }
}

impl Viewpoints {
    /// Takes one row for each point, or a single row that holds for all points.
    #[must_use]
    pub fn of_rows(rows: &[[f64; 3]]) -> Self {
        if let [one] = rows {
            return Self { places: vec![*one], ..Self::default() };
        }
        let mut known: HashMap<[u64; 3], u32> = HashMap::new();
        let mut found = Self { place_of: Vec::with_capacity(rows.len()), ..Self::default() };
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

    /// Takes the cameras that saw each point, where points are such as several agree on: those that structure from motion finds
    /// and stereo fuses. The way from each of its cameras to a point is free; where there is no point, nothing is known, since
    /// surfaces without texture leave none.
    ///
    /// The first `counts[0]` of `seen_from` are the numbers of the `places` that saw the first point, and so on. A point counts as
    /// measured from the first of its places: let that be the nearest.
    ///
    /// ```
    /// use sympose::Viewpoints;
    /// let cameras = [[0.0, 0.0, 5.0], [9.0, 0.0, 5.0]];
    /// let viewpoints = Viewpoints::of_tracks(&cameras, &[2, 1], &[1, 0, 0])?;
    /// assert_eq!(viewpoints.of_point(0), Some(cameras[1]));
    /// assert!(Viewpoints::of_tracks(&cameras, &[2, 0], &[1, 0]).is_err());
    /// # Ok::<(), sympose::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::InvalidParameter`] unless the counts add up to the length of `seen_from`, where nothing saw a point, or where the
    /// number of a place is none of theirs.
    pub fn of_tracks(places: &[[f64; 3]], counts: &[u32], seen_from: &[u32]) -> Result<Self> {
        let total: usize = counts.iter().map(|&count| count as usize).sum();
        let invalid = |name, value, expected| Err(Error::InvalidParameter { name, value, expected });
        if total != seen_from.len() {
            let value = format!("{total} in all for {} numbers of places", seen_from.len());
            return invalid("counts", value, "counts that add up to the length of seen_from");
        }
        if counts.contains(&0) {
            return invalid("counts", "0".to_owned(), "at least one camera that saw each point");
        }
        if let Some(&number) = seen_from.iter().find(|&&number| number as usize >= places.len()) {
            return invalid("seen_from", number.to_string(), "numbers of the places, from 0");
        }
        let (mut tracks, mut place_of, mut left) = (Tracks::default(), Vec::new(), seen_from);
        for &count in counts {
            let (track, others) = left.split_at(count as usize);
            place_of.push(track[0]);
            tracks.push(track.iter().copied());
            left = others;
        }
        let all: Vec<u32> = (0..counts.len() as u32).collect();
        // Without cameras that saw nothing.
        Ok(Self { places: places.to_vec(), place_of, tracks: Some(tracks) }.of_points(&all))
    }

    /// Numbers of all places that saw point `index`, that from which it counts as seen first.
    pub(crate) fn places_of(&self, index: usize) -> &[u32] {
        match &self.tracks {
            Some(tracks) => tracks.of(index),
            None => self.place_of.get(index..=index).unwrap_or(&[0]),
        }
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
        self.places.len() == 1 && self.place_of.is_empty() && self.tracks.is_none()
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
        let count = (0..total)
            .filter(|&i| self.places_of(i).iter().any(|&p| is_bad(&self.places[p as usize])))
            .count();
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
        let mut renumber = |place: u32| {
            *renumbered[place as usize].get_or_insert_with(|| {
                places.push(self.places[place as usize]);
                places.len() as u32 - 1
            })
        };
        let place_of = rows.iter().map(|&row| renumber(self.place_of[row as usize])).collect();
        let tracks = self.tracks.map(|tracks| {
            let mut kept = Tracks::default();
            rows.iter()
                .for_each(|&row| kept.push(tracks.of(row as usize).iter().map(|&place| renumber(place))));
            kept
        });
        Self { places, place_of, tracks }
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

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
    seen_from: SeenFrom,
}

/// Which of the places saw a point.
#[derive(Debug, Clone, PartialEq, Default)]
enum SeenFrom {
    /// The first one, whichever point.
    #[default]
    First,
    /// One for each point: its number.
    One(Vec<u32>),
    /// For each point several, of which the first one counts as that which measured it.
    Several(Tracks),
}

/// The numbers of the places that saw each point.
#[derive(Debug, Clone, PartialEq, Default)]
struct Tracks {
    /// For each point the end of its numbers in the list of all.
    ends: Vec<usize>,
    numbers: Vec<u32>,
}

impl Tracks {
    fn push(&mut self, numbers: impl Iterator<Item = u32>) {
        self.numbers.extend(numbers);
        self.ends.push(self.numbers.len());
    }

    /// Those of a point; none where there is no such point.
    fn of(&self, point: usize) -> &[u32] {
        let start = point.checked_sub(1).and_then(|last| self.ends.get(last)).map_or(0, |&end| end);
        self.ends.get(point).map_or(&[], |&end| &self.numbers[start..end])
    }
}

impl Viewpoints {
    /// Takes one row for each point, or a single row that holds for all points.
    #[must_use]
    pub fn of_rows(rows: &[[f64; 3]]) -> Self {
        if let [one] = rows {
            return Self { places: vec![*one], seen_from: SeenFrom::First };
        }
        let mut known: HashMap<[u64; 3], u32> = HashMap::new();
        let (mut places, mut place_of) = (Vec::new(), Vec::with_capacity(rows.len()));
        // Scans come view by view, so that the same place mostly follows itself.
        for run in rows.chunk_by(|a, b| a == b) {
            let place = *known.entry(run[0].map(f64::to_bits)).or_insert_with(|| {
                places.push(run[0]);
                places.len() as u32 - 1
            });
            place_of.resize(place_of.len() + run.len(), place);
        }
        Self::of_places(places, place_of)
    }

    /// Takes the place of each point by its number.
    pub(crate) fn of_places(places: Vec<[f64; 3]>, place_of: Vec<u32>) -> Self {
        Self { places, seen_from: SeenFrom::One(place_of) }
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
        let end_of = |end: &mut usize, &count: &u32| {
            *end += count as usize;
            Some(*end)
        };
        let tracks = Tracks { ends: counts.iter().scan(0, end_of).collect(), numbers: seen_from.to_vec() };
        let all: Vec<u32> = (0..counts.len() as u32).collect();
        // Without cameras that saw nothing.
        Ok(Self { places: places.to_vec(), seen_from: SeenFrom::Several(tracks) }.of_points(&all))
    }

    /// Whether the points are such as several cameras agree on.
    pub(crate) fn are_tracks(&self) -> bool {
        matches!(self.seen_from, SeenFrom::Several(_))
    }

    /// Numbers of all places that saw point `index`, that from which it counts as seen first.
    #[inline]
    pub(crate) fn places_of(&self, index: usize) -> &[u32] {
        match &self.seen_from {
            SeenFrom::First => &[0],
            SeenFrom::One(numbers) => numbers.get(index..=index).unwrap_or(&[]),
            SeenFrom::Several(tracks) => tracks.of(index),
        }
    }

    /// Number of the place that point `index` counts as seen from; 0 where none is known.
    #[inline]
    pub(crate) fn place_of(&self, index: usize) -> usize {
        self.places_of(index).first().map_or(0, |&number| number as usize)
    }

    /// Where point `index` was seen from; `None` where that is not known, or there is no such point.
    #[inline]
    #[must_use]
    pub fn of_point(&self, index: usize) -> Option<[f64; 3]> {
        let number = *self.places_of(index).first()?;
        self.places.get(number as usize).copied()
    }

    /// Number of points that they are for; any where one place is for all.
    fn len(&self) -> Option<usize> {
        match &self.seen_from {
            SeenFrom::First => self.places.is_empty().then_some(0),
            SeenFrom::One(numbers) => Some(numbers.len()),
            SeenFrom::Several(tracks) => Some(tracks.ends.len()),
        }
    }

    /// Refuses them unless they are those of so many points, or one for all.
    pub(crate) fn check_len(&self, points: usize) -> Result<()> {
        match self.len() {
            Some(got) if got != points => {
                Err(Error::LengthMismatch { what: "viewpoints", expected: points, got })
            }
            _ => Ok(()),
        }
    }

    /// Refuses a place with a coordinate that is NaN, infinite, or too large to be squared safely.
    pub(crate) fn check_finite(&self) -> Result<()> {
        let is_bad = |place: &[f64; 3]| !place.iter().all(|x| x.abs() <= LARGEST_COORDINATE);
        if !self.places.iter().any(is_bad) {
            return Ok(());
        }
        let total = self.len().unwrap_or(1);
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
        let mut renumbered: Vec<Option<u32>> = vec![None; self.places.len()];
        let mut places = Vec::new();
        let mut renumber = |number: u32| {
            *renumbered[number as usize].get_or_insert_with(|| {
                places.push(self.places[number as usize]);
                places.len() as u32 - 1
            })
        };
        let seen_from = match &self.seen_from {
            SeenFrom::First => return self,
            SeenFrom::One(numbers) => {
                SeenFrom::One(rows.iter().map(|&row| renumber(numbers[row as usize])).collect())
            }
            SeenFrom::Several(tracks) => {
                let mut kept = Tracks::default();
                for &row in rows {
                    kept.push(tracks.of(row as usize).iter().map(|&number| renumber(number)));
                }
                SeenFrom::Several(kept)
            }
        };
        Self { places, seen_from }
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

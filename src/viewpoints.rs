//! Where the sensor stood, point by point.

use std::collections::HashMap;

use nalgebra::Vector3;

/// Places of the sensor, and which of them each point was seen from.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Viewpoints {
    /// Its places, none twice; empty when they are unknown.
    pub(crate) places: Vec<[f64; 3]>,
    /// For each point its place; empty where all points have the first one.
    pub(crate) place_of: Vec<u32>,
}

impl Viewpoints {
    /// Number of the place that point `index` was seen from; 0 where none is known.
    #[inline]
    pub(crate) fn place_of(&self, index: usize) -> usize {
        self.place_of.get(index).map_or(0, |&place| place as usize)
    }

    /// Those of points that come in `runs` of one viewpoint, each with its length.
    pub(crate) fn of_runs(runs: impl Iterator<Item = ([f64; 3], usize)>) -> Self {
        let mut known: HashMap<[u64; 3], u32> = HashMap::new();
        let mut found = Self::default();
        for (viewpoint, len) in runs {
            let place = *known.entry(viewpoint.map(f64::to_bits)).or_insert_with(|| {
                found.places.push(viewpoint);
                found.places.len() as u32 - 1
            });
            found.place_of.resize(found.place_of.len() + len, place);
        }
        found
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

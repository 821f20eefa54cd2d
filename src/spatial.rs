//! Nearest neighbours: a [`KdTree`] over [`kiddo`], the only file that imports it.

use std::cmp::Ordering;
use std::num::NonZero;

use kiddo::{Eytzinger, FlatVec, SquaredEuclidean};
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::sampling::even_sample;

type Metric = SquaredEuclidean<f64>;
/// Points of a leaf. In the arenas of 32 of kiddo's own alias for immutable trees, the nearest point takes 1.25 times as
/// long to find, on a lattice twice as long.
const LEAF: usize = 24;
/// Points from which on both sides of a split are built side by side.
const PARALLEL: usize = 1 << 14;
type Tree = kiddo::KdTree<f64, u32, Eytzinger, FlatVec<f64, u32, 3, LEAF>, 3, LEAF>;

/// Points that are looked at to tell whether a cloud is full of duplicates.
const DUPLICATE_SAMPLE: usize = 1024;
/// Duplicates among them from which on coinciding points share one place in the tree.
const DUPLICATE_LIMIT: usize = 4;

/// A point of the tree and its squared distance from the query.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Neighbor {
    /// Index into the points that the tree was built on.
    pub index: u32,
    /// Squared Euclidean distance from the query, in the square of the cloud's unit.
    pub distance_sq: f64,
}

impl Neighbor {
    /// Order of distance, then of index.
    pub(crate) fn cmp_distance(&self, other: &Self) -> Ordering {
        self.distance_sq.total_cmp(&other.distance_sq).then(self.index.cmp(&other.index))
    }
}

/// A static k-d tree over 3-D points; building is O(N log N), a nearest-neighbour query O(log N).
///
/// Neighbours come in order of distance, at equal distance in order of index. Which of several points at exactly the
/// same distance is the nearest or the k-th is up to the tree, but always the same one. Queries must be finite; one
/// that is not finds nothing of meaning.
///
/// ```
/// use sympose::spatial::KdTree;
/// let tree = KdTree::new(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])?;
/// let nearest = tree.nearest(&[0.9, 0.0, 0.0]);
/// assert_eq!(nearest.index, 1);
/// # Ok::<(), sympose::Error>(())
/// ```
pub struct KdTree {
    tree: Tree,
    /// Where points coincide: the tree holds every place once.
    places: Option<Places>,
    len: usize,
}

impl KdTree {
    /// Builds the tree.
    ///
    /// # Errors
    /// [`Error::InsufficientData`] for an empty slice, [`Error::NonFinite`] when a coordinate is NaN or infinite,
    /// [`Error::InvalidParameter`] for more than 2^32 - 1 points.
    pub fn new(points: &[[f64; 3]]) -> Result<Self> {
        if points.is_empty() {
            return Err(Error::InsufficientData {
                stage: "k-d tree",
                needed: 1,
                got: 0,
                hint: "build it on at least one point",
            });
        }
        let non_finite = points.iter().filter(|p| p.iter().any(|x| !x.is_finite())).count();
        if non_finite > 0 {
            return Err(Error::NonFinite { count: non_finite, total: points.len() });
        }
        // A leaf cannot be split between coinciding points; with many of them every query would scan them all.
        let places =
            (u32::try_from(points.len()).is_ok() && full_of_duplicates(points)).then(|| Places::new(points));
        let positions = places.as_ref().map(|places| places.positions(points));
        let builder = Tree::builder().with_parallel_construction_threshold(PARALLEL);
        let tree = builder.build_from_slice(positions.as_deref().unwrap_or(points));
        let tree = tree.map_err(|e| Error::InvalidParameter {
            name: "points",
            value: e.to_string(),
            expected: "at most 4,294,967,295 points",
        })?;
        Ok(Self { tree, places, len: points.len() })
    }

    /// Number of points in the tree.
    #[must_use]
    pub fn len(&self) -> usize {
        self.len
    }

    /// Always false: a tree holds at least one point.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// The nearest point of the tree.
    #[must_use]
    pub fn nearest(&self, query: &[f64; 3]) -> Neighbor {
        let found = self.tree.query(query).nearest_one::<Metric>().execute();
        let index = self.places.as_ref().map_or(found.item, |places| places.at(found.item)[0]);
        Neighbor { index, distance_sq: found.distance }
    }

    /// The nearest point within `radius` (inclusive), if there is one.
    #[must_use]
    pub fn nearest_within(&self, query: &[f64; 3], radius: f64) -> Option<Neighbor> {
        let found = self.nearest(query);
        (radius >= 0.0 && found.distance_sq <= radius * radius).then_some(found)
    }

    /// The `k` nearest points, nearest first; fewer when the tree holds fewer. A point of the tree finds itself.
    #[must_use]
    pub fn k_nearest(&self, query: &[f64; 3], k: usize) -> Vec<Neighbor> {
        let Some(places) = NonZero::new(k.min(self.len)) else { return Vec::new() };
        let found = self.tree.query(query).nearest_n::<Metric>(places).execute();
        let mut neighbors = self.expand(found.into_iter().map(|n| (n.item, n.distance)), k);
        neighbors.sort_unstable_by(Neighbor::cmp_distance);
        neighbors.truncate(k);
        neighbors
    }

    /// The nearest point that does not coincide with the query, if there is one.
    #[must_use]
    pub fn nearest_distinct(&self, query: &[f64; 3]) -> Option<Neighbor> {
        if let Some(places) = &self.places {
            const TWO: NonZero<usize> = NonZero::<usize>::MIN.saturating_add(1);
            let found = self.tree.query(query).nearest_n::<Metric>(TWO).execute();
            let beside = found.into_iter().find(|place| place.distance > 0.0)?;
            return Some(Neighbor { index: places.at(beside.item)[0], distance_sq: beside.distance });
        }
        let mut k = 2;
        loop {
            let found = self.k_nearest(query, k);
            let distinct = found.iter().find(|n| n.distance_sq > 0.0).copied();
            if distinct.is_some() || k >= self.len {
                return distinct;
            }
            k = (4 * k).min(self.len);
        }
    }

    /// All points within `radius` (inclusive), in ascending order of index.
    #[must_use]
    pub fn within(&self, query: &[f64; 3], radius: f64) -> Vec<Neighbor> {
        if radius.is_nan() || radius < 0.0 {
            return Vec::new();
        }
        let found = self.tree.query(query).within::<Metric>(radius * radius).unsorted().execute();
        let mut neighbors = self.expand(found.into_iter().map(|n| (n.item, n.distance)), usize::MAX);
        neighbors.sort_unstable_by_key(|n| n.index);
        neighbors
    }

    /// [`KdTree::nearest`] of many queries, in parallel.
    #[must_use]
    pub fn nearest_batch(&self, queries: &[[f64; 3]]) -> Vec<Neighbor> {
        queries.par_iter().with_min_len(256).map(|q| self.nearest(q)).collect()
    }

    /// [`KdTree::k_nearest`] of many queries, in parallel; for `k` from 12 on [`KNeighbors::of_queries`] takes little more
    /// than half the time.
    ///
    /// [`KNeighbors::of_queries`]: crate::preprocess::KNeighbors::of_queries
    #[must_use]
    pub fn k_nearest_batch(&self, queries: &[[f64; 3]], k: usize) -> Vec<Vec<Neighbor>> {
        queries.par_iter().with_min_len(64).map(|q| self.k_nearest(q, k)).collect()
    }

    /// [`KdTree::within`] of many queries, in parallel.
    #[must_use]
    pub fn within_batch(&self, queries: &[[f64; 3]], radius: f64) -> Vec<Vec<Neighbor>> {
        queries.par_iter().with_min_len(64).map(|q| self.within(q, radius)).collect()
    }

    /// The points at the places found: at least `limit` of them, and all at the same distance as the last.
    fn expand(&self, found: impl Iterator<Item = (u32, f64)>, limit: usize) -> Vec<Neighbor> {
        let Some(places) = &self.places else {
            return found.map(|(index, distance_sq)| Neighbor { index, distance_sq }).collect();
        };
        let mut neighbors: Vec<Neighbor> = Vec::new();
        for (place, distance_sq) in found {
            // Another place at the distance of the last one may hold points of lower index.
            if neighbors.len() >= limit && neighbors.last().is_some_and(|last| last.distance_sq < distance_sq)
            {
                break;
            }
            neighbors
                .extend(places.at(place).iter().take(limit).map(|&index| Neighbor { index, distance_sq }));
        }
        neighbors
    }
}

impl std::fmt::Debug for KdTree {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("KdTree").field("len", &self.len).finish_non_exhaustive()
    }
}

/// Points grouped by position.
struct Places {
    /// Those of place `i` are `members[offsets[i]..offsets[i + 1]]`, ascending.
    offsets: Vec<u32>,
    members: Vec<u32>,
}

impl Places {
    fn new(points: &[[f64; 3]]) -> Self {
        let mut members: Vec<u32> = (0..points.len() as u32).collect();
        let position = |i: u32| bits(&points[i as usize]);
        members.par_sort_unstable_by_key(|&i| (position(i), i));
        let starts =
            (0..members.len()).filter(|&i| i == 0 || position(members[i]) != position(members[i - 1]));
        let offsets = starts.chain([members.len()]).map(|i| i as u32).collect();
        Self { offsets, members }
    }

    fn at(&self, place: u32) -> &[u32] {
        &self.members[self.offsets[place as usize] as usize..self.offsets[place as usize + 1] as usize]
    }

    fn positions(&self, points: &[[f64; 3]]) -> Vec<[f64; 3]> {
        (0..self.offsets.len() as u32 - 1).map(|place| points[self.at(place)[0] as usize]).collect()
    }
}

/// A total order of positions in which equal ones are neighbours; adding 0 makes one zero of -0 and 0.
fn bits(point: &[f64; 3]) -> [u64; 3] {
    point.map(|x| (x + 0.0).to_bits())
}

fn full_of_duplicates(points: &[[f64; 3]]) -> bool {
    let chosen = even_sample(points.len(), DUPLICATE_SAMPLE, 0);
    let mut sample: Vec<[u64; 3]> = chosen.into_iter().map(|i| bits(&points[i])).collect();
    let drawn = sample.len();
    sample.sort_unstable();
    sample.dedup();
    drawn - sample.len() >= DUPLICATE_LIMIT
}

//! Nearest neighbours: a [`KdTree`] over [`kiddo`], the only file that imports it.

use std::num::NonZero;

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;

use crate::error::{Error, Result};

type Metric = SquaredEuclidean<f64>;

/// A point of the tree and its squared distance from the query.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Neighbor {
    /// Index into the points that the tree was built on.
    pub index: u32,
    /// Squared Euclidean distance from the query, in the square of the cloud's unit.
    pub distance_sq: f64,
}

/// A static k-d tree over 3-D points; building is O(N log N), a nearest-neighbour query O(log N).
///
/// ```
/// use sympose::spatial::KdTree;
/// let tree = KdTree::new(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])?;
/// let nearest = tree.nearest(&[0.9, 0.0, 0.0]);
/// assert_eq!(nearest.index, 1);
/// # Ok::<(), sympose::Error>(())
/// ```
pub struct KdTree {
    tree: ImmutableKdTree<f64, 3>,
    len: usize,
}

impl KdTree {
    /// Builds the tree.
    ///
    /// # Errors
    /// [`Error::InsufficientData`] for an empty slice, [`Error::NonFinite`] when a coordinate is NaN or infinite.
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
        let tree = ImmutableKdTree::new_from_slice(points).map_err(|e| Error::InvalidParameter {
            name: "points",
            value: e.to_string(),
            expected: "at most 4,294,967,295 points",
        })?;
        Ok(Self { tree, len: points.len() })
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
        Neighbor { index: found.item, distance_sq: found.distance }
    }

    /// The nearest point within `radius` (inclusive), if there is one.
    #[must_use]
    pub fn nearest_within(&self, query: &[f64; 3], radius: f64) -> Option<Neighbor> {
        let found = self.nearest(query);
        (found.distance_sq <= radius * radius).then_some(found)
    }

    /// The `k` nearest points, nearest first; fewer when the tree holds fewer. A point of the tree finds itself.
    #[must_use]
    pub fn k_nearest(&self, query: &[f64; 3], k: usize) -> Vec<Neighbor> {
        let Some(k) = NonZero::new(k.min(self.len)) else { return Vec::new() };
        let found = self.tree.query(query).nearest_n::<Metric>(k).execute();
        found.into_iter().map(|n| Neighbor { index: n.item, distance_sq: n.distance }).collect()
    }

    /// The nearest point that does not coincide with the query, if there is one.
    #[must_use]
    pub fn nearest_distinct(&self, query: &[f64; 3]) -> Option<Neighbor> {
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

    /// Number of points within `radius` (inclusive), but counting no further than `limit`.
    #[must_use]
    pub fn count_within(&self, query: &[f64; 3], radius: f64, limit: usize) -> usize {
        let Some(limit) = NonZero::new(limit.min(self.len)) else { return 0 };
        self.tree.query(query).nearest_n::<Metric>(limit).within(radius * radius).unsorted().execute().len()
    }

    /// All points within `radius` (inclusive), in ascending order of index.
    #[must_use]
    pub fn within(&self, query: &[f64; 3], radius: f64) -> Vec<Neighbor> {
        let found = self.tree.query(query).within::<Metric>(radius * radius).unsorted().execute();
        let mut neighbors: Vec<_> =
            found.into_iter().map(|n| Neighbor { index: n.item, distance_sq: n.distance }).collect();
        neighbors.sort_unstable_by_key(|n| n.index);
        neighbors
    }

    /// [`KdTree::nearest`] of many queries, in parallel.
    #[must_use]
    pub fn nearest_batch(&self, queries: &[[f64; 3]]) -> Vec<Neighbor> {
        queries.par_iter().with_min_len(256).map(|q| self.nearest(q)).collect()
    }

    /// [`KdTree::k_nearest`] of many queries, in parallel.
    #[must_use]
    pub fn k_nearest_batch(&self, queries: &[[f64; 3]], k: usize) -> Vec<Vec<Neighbor>> {
        queries.par_iter().with_min_len(64).map(|q| self.k_nearest(q, k)).collect()
    }

    /// [`KdTree::within`] of many queries, in parallel.
    #[must_use]
    pub fn within_batch(&self, queries: &[[f64; 3]], radius: f64) -> Vec<Vec<Neighbor>> {
        queries.par_iter().with_min_len(64).map(|q| self.within(q, radius)).collect()
    }
}

impl std::fmt::Debug for KdTree {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("KdTree").field("len", &self.len).finish_non_exhaustive()
    }
}

//! The k nearest neighbours of every point, found once and used by several stages.

use rayon::prelude::*;

use super::CHUNK;
use super::search::Search;
use super::selection::Near;
use crate::error::Result;
use crate::median::median;
use crate::spatial::KdTree;

/// Points that [`median_spacing`] looks at.
const SPACING_SAMPLE: usize = 2000;

/// The `k` nearest neighbours of every point or query, nearest first, ties by index; a point is its own neighbour.
///
/// ```
/// use sympose::preprocess::KNeighbors;
/// use sympose::spatial::KdTree;
/// let points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [3.0, 0.0, 0.0]];
/// let neighbors = KNeighbors::new(&KdTree::new(&points)?, &points, 2)?;
/// assert_eq!(neighbors.of(2), (&[2, 1][..], &[0.0, 4.0][..]));
/// # Ok::<(), sympose::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct KNeighbors {
    k: usize,
    /// Number of points that they were searched among.
    among: usize,
    /// For each query its row below.
    slots: Vec<u32>,
    indices: Vec<u32>,
    distances_sq: Vec<f64>,
}

impl KNeighbors {
    /// Searches the neighbours of `points`, which `tree` was built on; `k` is limited to their number.
    ///
    /// # Errors
    /// [`Error::InvalidParameter`](crate::Error::InvalidParameter) when `k` is 0,
    /// [`Error::NonFinite`](crate::Error::NonFinite), [`Error::LengthMismatch`](crate::Error::LengthMismatch) when the
    /// tree holds another number of points.
    pub fn new(tree: &KdTree, points: &[[f64; 3]], k: usize) -> Result<Self> {
        Ok(Self::found(&Search::among(tree, points, k, true)?))
    }

    /// Searches those of `queries` among the `points` that `tree` was built on.
    ///
    /// # Errors
    /// Those of [`KNeighbors::new`].
    pub fn of_queries(tree: &KdTree, points: &[[f64; 3]], queries: &[[f64; 3]], k: usize) -> Result<Self> {
        Ok(Self::found(&Search::of(tree, points, queries, k)?))
    }

    fn found(search: &Search) -> Self {
        let (k, among, slots) = (search.k, search.points.len(), search.slots());
        let mut indices = vec![0; slots.len() * k];
        let mut distances_sq = vec![0.0; slots.len() * k];
        indices.par_chunks_mut(CHUNK * k).zip(distances_sq.par_chunks_mut(CHUNK * k)).enumerate().for_each(
            |(chunk, (indices, distances_sq))| {
                let mut rows = indices.chunks_exact_mut(k).zip(distances_sq.chunks_exact_mut(k));
                search.visit(chunk, |_, found| {
                    if let Some((indices, distances_sq)) = rows.next() {
                        for (slot, neighbor) in found.iter().enumerate() {
                            indices[slot] = neighbor.index;
                            distances_sq[slot] = neighbor.distance_sq();
                        }
                    }
                });
            },
        );
        Self { k, among, slots, indices, distances_sq }
    }

    /// Neighbours of each query.
    #[must_use]
    pub fn k(&self) -> usize {
        self.k
    }

    /// Number of points that the neighbours were searched among, beyond which no index of one lies.
    pub(super) fn among(&self) -> usize {
        self.among
    }

    /// Number of queries.
    #[must_use]
    pub fn len(&self) -> usize {
        self.slots.len()
    }

    /// Whether there was no query.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.slots.is_empty()
    }

    /// Indices of the neighbours of query `index`, and the squared distances to them [length squared].
    #[must_use]
    pub fn of(&self, index: usize) -> (&[u32], &[f64]) {
        let slot = self.slots[index] as usize;
        let range = slot * self.k..(slot + 1) * self.k;
        (&self.indices[range.clone()], &self.distances_sq[range])
    }
}

/// Calls `f` with every point and its `k` nearest neighbours, which come in no certain order, in parallel; the results
/// come in the order of the points.
pub(crate) fn map_neighbors<T: Copy + Send + Sync>(
    tree: &KdTree,
    points: &[[f64; 3]],
    k: usize,
    f: impl Fn(usize, &[Near]) -> T + Sync,
) -> Result<Vec<T>> {
    let search = Search::among(tree, points, k, false)?;
    let by_slot: Vec<Vec<T>> = (0..search.chunks())
        .into_par_iter()
        .map(|chunk| {
            let mut results = Vec::with_capacity(CHUNK);
            search.visit(chunk, |point, found| results.push(f(point, found)));
            results
        })
        .collect();
    let value = |&slot: &u32| by_slot[slot as usize / CHUNK][slot as usize % CHUNK];
    Ok(search.slots().par_iter().with_min_len(CHUNK).map(value).collect())
}

/// Median distance of a point to its nearest neighbour \[length\], over up to 2000 points taken at even steps.
///
/// Exact duplicates are not neighbours. 0 when all points coincide.
///
/// ```
/// use sympose::preprocess::median_spacing;
/// use sympose::spatial::KdTree;
/// let points: Vec<[f64; 3]> = (0..100).map(|i| [0.5 * f64::from(i), 0.0, 0.0]).collect();
/// assert_eq!(median_spacing(&KdTree::new(&points)?, &points), 0.5);
/// # Ok::<(), sympose::Error>(())
/// ```
#[must_use]
pub fn median_spacing(tree: &KdTree, points: &[[f64; 3]]) -> f64 {
    let step = points.len().div_ceil(SPACING_SAMPLE).max(1);
    let mut spacings: Vec<f64> = points
        .par_iter()
        .step_by(step)
        .filter_map(|point| tree.nearest_distinct(point))
        .map(|found| found.distance_sq.sqrt())
        .collect();
    median(&mut spacings).unwrap_or(0.0)
}

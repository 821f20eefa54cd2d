//! The k nearest neighbours of every point, found once and used by several stages.
//!
//! The points of a cell share the points of the 27 cells around it. Where those contain the k-th neighbour for sure,
//! and they do for nearly all points when the edge of a cell is about the distance to it, no tree is needed; the tree
//! answers for the rest, so that the result is exact everywhere.

use std::ops::Range;

use rayon::prelude::*;

use super::cells::CellList;
use super::{CHUNK, check_finite};
use crate::error::{Error, Result};
use crate::median::median;
use crate::spatial::{KdTree, Neighbor};

/// Points that [`median_spacing`] looks at.
const SPACING_SAMPLE: usize = 2000;
/// Points from whose k-th neighbour the edge of a cell is found.
const REACH_SAMPLE: usize = 64;
/// Share of those points whose k-th neighbour lies within an edge.
const REACH_QUANTILE: f64 = 0.97;
/// A neighbourhood with more than this many points for each neighbour sought is left to the tree.
const CROWD: usize = 64;

/// The `k` nearest neighbours of every point, nearest first, ties by index; a point is its own neighbour.
#[derive(Debug, Clone, PartialEq)]
pub struct KNeighbors {
    k: usize,
    /// For each point its rows below.
    slots: Vec<u32>,
    indices: Vec<u32>,
    distances_sq: Vec<f64>,
}

impl KNeighbors {
    /// Searches the neighbours of `points`, which `tree` was built on; `k` is limited to their number.
    ///
    /// # Errors
    /// [`Error::InvalidParameter`] when `k` is 0, [`Error::NonFinite`], [`Error::LengthMismatch`] when the tree holds
    /// another number of points.
    pub fn new(tree: &KdTree, points: &[[f64; 3]], k: usize) -> Result<Self> {
        let search = Search::new(tree, points, k)?;
        let k = search.k;
        let mut indices = vec![0; points.len() * k];
        let mut distances_sq = vec![0.0; points.len() * k];
        indices.par_chunks_mut(CHUNK * k).zip(distances_sq.par_chunks_mut(CHUNK * k)).enumerate().for_each(
            |(chunk, (indices, distances_sq))| {
                let mut rows = indices.chunks_exact_mut(k).zip(distances_sq.chunks_exact_mut(k));
                search.visit(chunk, |_, found| {
                    if let Some((indices, distances_sq)) = rows.next() {
                        for (slot, neighbor) in found.iter().enumerate() {
                            indices[slot] = neighbor.index;
                            distances_sq[slot] = neighbor.distance_sq;
                        }
                    }
                });
            },
        );
        Ok(Self { k, slots: search.slots(), indices, distances_sq })
    }

    /// Neighbours of each point.
    #[must_use]
    pub fn k(&self) -> usize {
        self.k
    }

    /// Number of points.
    #[must_use]
    pub fn len(&self) -> usize {
        self.slots.len()
    }

    /// Always false: there is at least one point.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.slots.is_empty()
    }

    /// Indices of the neighbours of point `index`, and the squared distances to them [length squared].
    #[must_use]
    pub fn of(&self, index: usize) -> (&[u32], &[f64]) {
        let slot = self.slots[index] as usize;
        let range = slot * self.k..(slot + 1) * self.k;
        (&self.indices[range.clone()], &self.distances_sq[range])
    }
}

/// Calls `f` with every point and its `k` nearest neighbours, in parallel; the results come in the order of the points.
pub(crate) fn map_neighbors<T: Copy + Send + Sync>(
    tree: &KdTree,
    points: &[[f64; 3]],
    k: usize,
    f: impl Fn(usize, &[Neighbor]) -> T + Sync,
) -> Result<Vec<T>> {
    let search = Search::new(tree, points, k)?;
    let by_slot: Vec<Vec<T>> = (0..points.len().div_ceil(CHUNK))
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

/// Finds neighbours cell by cell where that is sure to be right, and in the tree where it is not.
struct Search<'a> {
    tree: &'a KdTree,
    points: &'a [[f64; 3]],
    k: usize,
    /// Cells, and the distance up to which the 27 cells around a point hold everything.
    cells: Option<(CellList<'a>, f64)>,
}

impl<'a> Search<'a> {
    fn new(tree: &'a KdTree, points: &'a [[f64; 3]], k: usize) -> Result<Self> {
        if k == 0 {
            return Err(Error::InvalidParameter {
                name: "k",
                value: "0".into(),
                expected: "at least 1 neighbour",
            });
        }
        check_finite(points)?;
        if tree.len() != points.len() {
            return Err(Error::LengthMismatch {
                what: "the k-d tree",
                expected: points.len(),
                got: tree.len(),
            });
        }
        let k = k.min(points.len());
        let step = points.len().div_ceil(REACH_SAMPLE);
        let sample = points.iter().step_by(step).map(|p| tree.k_nearest(p, k));
        let mut reaches: Vec<f64> =
            sample.filter_map(|found| Some(found.last()?.distance_sq.sqrt())).collect();
        let rank = (REACH_QUANTILE * (reaches.len() - 1) as f64) as usize;
        let reach = *reaches.select_nth_unstable_by(rank, f64::total_cmp).1;
        // Where all neighbours coincide, or the cloud is too large for cells of this size, the tree does everything.
        let cells = CellList::new(points, reach, "reach").ok().map(|cells| (cells, reach));
        Ok(Self { tree, points, k, cells })
    }

    /// For each point its place in the order in which [`Search::visit`] comes to it.
    fn slots(&self) -> Vec<u32> {
        let mut slots: Vec<u32> = (0..self.points.len() as u32).collect();
        if let Some((cells, _)) = &self.cells {
            for (slot, &point) in (0..).zip(&cells.members) {
                slots[point as usize] = slot;
            }
        }
        slots
    }

    /// Calls `f` with every point of a chunk of slots and its neighbours.
    fn visit(&self, chunk: usize, mut f: impl FnMut(usize, &[Neighbor])) {
        let slots = chunk * CHUNK..self.points.len().min((chunk + 1) * CHUNK);
        let Some((cells, reach)) = &self.cells else {
            return slots.for_each(|point| f(point, &self.tree.k_nearest(&self.points[point], self.k)));
        };
        let mut block = Block::default();
        let mut found = Vec::with_capacity(self.k);
        let mut cell = None;
        for slot in slots {
            if cell != Some(cells.cell(slot)) {
                cell = Some(cells.cell(slot));
                block.gather(cells, slot, CROWD * self.k);
            }
            let point = cells.members[slot] as usize;
            if block.k_nearest(&self.points[point], self.k, reach * reach, &mut found) {
                f(point, &found);
            } else {
                f(point, &self.tree.k_nearest(&self.points[point], self.k));
            }
        }
    }
}

/// The points of 27 cells, coordinate by coordinate.
#[derive(Default)]
struct Block {
    ranges: Vec<Range<usize>>,
    x: Vec<f64>,
    y: Vec<f64>,
    z: Vec<f64>,
    index: Vec<u32>,
    distances_sq: Vec<f64>,
    /// Candidates as one number each: the bits of a distance (not negative, so in order) above those of an index.
    keys: Vec<u128>,
}

impl Block {
    /// Takes the points around a slot, or none when they are more than `limit`.
    fn gather(&mut self, cells: &CellList, slot: usize, limit: usize) {
        cells.around(slot, &mut self.ranges);
        for values in [&mut self.x, &mut self.y, &mut self.z] {
            values.clear();
        }
        self.index.clear();
        if self.ranges.iter().map(Range::len).sum::<usize>() > limit {
            return;
        }
        for slot in self.ranges.iter().cloned().flatten() {
            let [x, y, z] = *cells.point(slot);
            self.x.push(x);
            self.y.push(y);
            self.z.push(z);
            self.index.push(cells.members[slot]);
        }
    }

    /// The `k` nearest of these points to `query`, if there are as many within the reach.
    fn k_nearest(&mut self, query: &[f64; 3], k: usize, reach_sq: f64, found: &mut Vec<Neighbor>) -> bool {
        self.distances_sq.clear();
        self.distances_sq.extend(self.x.iter().zip(&self.y).zip(&self.z).map(|((x, y), z)| {
            let [x, y, z] = [x - query[0], y - query[1], z - query[2]];
            x * x + y * y + z * z
        }));
        // Every candidate is written and only those within reach are kept: no branch to mispredict.
        self.keys.resize(self.index.len(), 0);
        let mut candidates = 0;
        for (&distance_sq, &index) in self.distances_sq.iter().zip(&self.index) {
            self.keys[candidates] = u128::from(distance_sq.to_bits()) << 32 | u128::from(index);
            candidates += usize::from(distance_sq <= reach_sq);
        }
        if candidates < k {
            return false;
        }
        let keys = &mut self.keys[..candidates];
        if candidates > 2 * k {
            keys.select_nth_unstable(k - 1);
        }
        let keys = if candidates > 2 * k { &mut keys[..k] } else { keys };
        keys.sort_unstable();
        found.clear();
        found.extend(
            keys[..k]
                .iter()
                .map(|key| Neighbor { index: *key as u32, distance_sq: f64::from_bits((key >> 32) as u64) }),
        );
        true
    }
}

/// Median distance of a point to its nearest neighbour \[length\], over up to 2000 points taken at even steps.
///
/// Exact duplicates are not neighbours. 0 when all points coincide.
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

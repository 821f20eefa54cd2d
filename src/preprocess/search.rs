//! The k nearest neighbours of many queries: cell by cell where that is sure to be right, in the tree where it is not.
//!
//! The queries of a cell share the points of the 27 cells around it. Where those contain the k-th neighbour for sure,
//! and they do for nearly all queries when the edge of a cell is about the distance to it, no tree is needed; the tree
//! answers for the rest, so that the result is exact everywhere.

use super::block::{Block, SLACK};
use super::cells::CellList;
use super::{CHUNK, at_least_one, check_finite};
use crate::error::{Error, Result};
use crate::spatial::KdTree;

/// Queries from whose k-th neighbour the edge of a cell is found.
const REACH_SAMPLE: usize = 64;
/// Share of those queries whose k-th neighbour lies within an edge.
const REACH_QUANTILE: f64 = 0.97;
/// Neighbours below which the tree takes less time than cells, of which hardly any point shares one.
const FEW_NEIGHBORS: usize = 6;
/// Points for each query from which on the tree takes less time than to sort them into cells.
const FEW_QUERIES: usize = 8;
/// A neighbourhood with more than this many points for each neighbour sought is left to the tree.
const CROWD: usize = 64;
/// Square of a distance within which the neighbours of the next query probably are [that of the last].
const GENEROUS: f64 = 1.3;

/// A neighbour of a query.
#[derive(Clone, Copy)]
pub(super) struct Found {
    /// Index into the points.
    pub(super) index: u32,
    /// Where it lies from the query \[length\].
    pub(super) offset: [f64; 3],
}

impl Found {
    fn new(index: u32, point: &[f64; 3], query: &[f64; 3]) -> Self {
        Self { index, offset: std::array::from_fn(|axis| point[axis] - query[axis]) }
    }

    /// Squared distance from the query [length squared].
    #[inline]
    pub(super) fn distance_sq(&self) -> f64 {
        let [x, y, z] = self.offset;
        x * x + y * y + z * z
    }
}

/// The neighbours of which queries are to be found, and how.
pub(super) struct Search<'a> {
    tree: &'a KdTree,
    points: &'a [[f64; 3]],
    queries: &'a [[f64; 3]],
    pub(super) k: usize,
    nearest_first: bool,
    cells: Option<CellList>,
    /// Distance up to which the 27 cells around a query hold everything: the edge of a cell.
    reach: f64,
    /// The queries in the order in which they are answered; a place in it is called a slot.
    order: Vec<u32>,
}

impl<'a> Search<'a> {
    /// Neighbours of every point itself; `nearest_first` or, which takes less time, in no certain order.
    pub(super) fn among(
        tree: &'a KdTree,
        points: &'a [[f64; 3]],
        k: usize,
        nearest_first: bool,
    ) -> Result<Self> {
        Self::new(tree, points, points, k, nearest_first, |cells| cells.members.clone())
    }

    /// Neighbours of `queries` among the points, nearest first.
    pub(super) fn of(
        tree: &'a KdTree,
        points: &'a [[f64; 3]],
        queries: &'a [[f64; 3]],
        k: usize,
    ) -> Result<Self> {
        check_finite(queries)?;
        Self::new(tree, points, queries, k, true, |cells| cells.order(queries))
    }

    fn new(
        tree: &'a KdTree,
        points: &'a [[f64; 3]],
        queries: &'a [[f64; 3]],
        k: usize,
        nearest_first: bool,
        order: impl FnOnce(&CellList) -> Vec<u32>,
    ) -> Result<Self> {
        at_least_one(k)?;
        check_finite(points)?;
        if tree.len() != points.len() {
            return Err(Error::LengthMismatch {
                what: "the k-d tree",
                expected: points.len(),
                got: tree.len(),
            });
        }
        let k = k.min(points.len());
        let reach = usual_reach(tree, queries, k);
        let worthwhile = k >= FEW_NEIGHBORS && queries.len() >= points.len() / FEW_QUERIES;
        // Where all neighbours coincide, or the cloud is too large for cells of this size, the tree does everything.
        let cells = worthwhile.then(|| CellList::new(points, reach, "reach").ok()).flatten();
        let order = cells.as_ref().map_or_else(|| (0..queries.len() as u32).collect(), order);
        Ok(Self { tree, points, queries, k, nearest_first, cells, reach, order })
    }

    /// For each query its slot.
    pub(super) fn slots(&self) -> Vec<u32> {
        let mut slots = vec![0; self.order.len()];
        for (slot, &query) in (0..).zip(&self.order) {
            slots[query as usize] = slot;
        }
        slots
    }

    /// Number of chunks of slots.
    pub(super) fn chunks(&self) -> usize {
        self.order.len().div_ceil(CHUNK)
    }

    /// Calls `f` with every query of a chunk of slots and its neighbours.
    pub(super) fn visit(&self, chunk: usize, mut f: impl FnMut(usize, &[Found])) {
        let slots = chunk * CHUNK..self.order.len().min((chunk + 1) * CHUNK);
        let queries = self.order[slots].iter().map(|&query| query as usize);
        let in_tree = |query: usize| nearest(self.tree, self.points, &self.queries[query], self.k);
        let Some(cells) = &self.cells else {
            return queries.for_each(|query| f(query, &in_tree(query)));
        };
        let mut candidates = Candidates::new(self.reach);
        let mut found = Vec::with_capacity(self.k);
        let mut cell = None;
        let reach_sq = self.reach * self.reach;
        let mut guess_sq = reach_sq;
        for query in queries {
            let position = &self.queries[query];
            let own = Some(cells.cell(position));
            if std::mem::replace(&mut cell, own) != own {
                candidates.block.gather(cells, position, CROWD * self.k);
            }
            candidates.measure(position);
            // Neighbours of the last query were hardly nearer or farther; the fewer points come into question, the better.
            let mut within =
                |bound_sq| candidates.k_nearest(position, self.k, bound_sq, self.nearest_first, &mut found);
            let found_sq = match within(guess_sq) {
                None if guess_sq < reach_sq => within(reach_sq),
                found_sq => found_sq,
            };
            match found_sq {
                Some(farthest_sq) => {
                    f(query, &found);
                    guess_sq = reach_sq.min(GENEROUS * farthest_sq);
                }
                None => f(query, &in_tree(query)),
            }
        }
    }
}

/// The `k` nearest of the `points` that the tree was built on.
pub(super) fn nearest(tree: &KdTree, points: &[[f64; 3]], query: &[f64; 3], k: usize) -> Vec<Found> {
    let found = tree.k_nearest(query, k).into_iter();
    found.map(|n| Found::new(n.index, &points[n.index as usize], query)).collect()
}

/// Distance within which most queries have their `k` nearest points; 0 for no queries.
fn usual_reach(tree: &KdTree, queries: &[[f64; 3]], k: usize) -> f64 {
    let sample = queries.iter().step_by(queries.len().div_ceil(REACH_SAMPLE).max(1));
    let farthest = |query| Some(tree.k_nearest(query, k).last()?.distance_sq.sqrt());
    let mut reaches: Vec<f64> = sample.filter_map(farthest).collect();
    reaches.sort_unstable_by(f64::total_cmp);
    let rank = REACH_QUANTILE * reaches.len().saturating_sub(1) as f64;
    // The square of a root may be less than what it is the root of, and on a lattice all neighbours are as far.
    reaches.get(rank as usize).map_or(0.0, |reach| reach * (1.0 + 1e-9))
}

/// The points around a query, from which its neighbours are picked.
struct Candidates {
    block: Block,
    rough_sq: Vec<f32>,
    near: Vec<u32>,
    /// Those near as one number each: the bits of a squared distance in single precision (not negative, so in order) above
    /// the place of the point.
    keys: Vec<u64>,
    /// The same in double precision, with the index of the point between them, for those that are hardly apart.
    exact_keys: Vec<(u64, u32, u32)>,
}

impl Candidates {
    fn new(reach: f64) -> Self {
        Self {
            block: Block::new(reach),
            rough_sq: Vec::new(),
            near: Vec::new(),
            keys: Vec::new(),
            exact_keys: Vec::new(),
        }
    }

    /// Looks how far the points are from `query`, roughly.
    fn measure(&mut self, query: &[f64; 3]) {
        self.block.rough_distances_sq(query, &mut self.rough_sq);
        self.near.resize(self.rough_sq.len(), 0);
    }

    /// The `k` nearest of these points to the `query` measured, if as many lie within a bound that is not beyond the
    /// reach; returns the squared distance to the farthest of them, or hardly more.
    fn k_nearest(
        &mut self,
        query: &[f64; 3],
        k: usize,
        bound_sq: f64,
        nearest_first: bool,
        found: &mut Vec<Found>,
    ) -> Option<f64> {
        let scale_sq = self.block.edge.recip().powi(2);
        let bound = (bound_sq * scale_sq) as f32;
        // Every place is written and only those that pass are kept: no branch to mispredict.
        let mut count = 0;
        for (place, &rough_sq) in (0..).zip(&self.rough_sq) {
            self.near[count] = place;
            count += usize::from(rough_sq <= bound + SLACK);
        }
        if count < k {
            return None;
        }
        let near = &self.near[..count];
        let key = |&place: &u32| u64::from(self.rough_sq[place as usize].to_bits()) << 32 | u64::from(place);
        self.keys.clear();
        self.keys.extend(near.iter().map(key));
        let keys = &mut self.keys[..];
        let rough_sq = |key: u64| f32::from_bits((key >> 32) as u32);
        let are_apart = |less: u64, more: u64| rough_sq(more) - rough_sq(less) > 2.0 * SLACK;
        let (farthest, ordered) = if nearest_first {
            keys.sort_unstable();
            (keys[k - 1], keys.windows(2).take(k).all(|pair| are_apart(pair[0], pair[1])))
        } else if count > k {
            keys.select_nth_unstable(k);
            let farthest = keys[..k].iter().copied().fold(0, u64::max);
            (farthest, are_apart(farthest, keys[k]))
        } else {
            (keys.iter().copied().fold(0, u64::max), true)
        };
        let block = &self.block;
        let neighbor =
            |place: u32| Found::new(block.indices[place as usize], &block.points[place as usize], query);
        found.clear();
        if ordered && rough_sq(farthest) <= bound - SLACK {
            found.extend(keys[..k].iter().map(|&key| neighbor(key as u32)));
            return Some(f64::from(rough_sq(farthest) + SLACK) / scale_sq);
        }
        self.exact_keys.clear();
        self.exact_keys.extend(near.iter().map(|&place| {
            let neighbor = neighbor(place);
            (neighbor.distance_sq().to_bits(), neighbor.index, place)
        }));
        if nearest_first {
            self.exact_keys.sort_unstable();
        } else {
            self.exact_keys.select_nth_unstable(k - 1);
        }
        found.extend(self.exact_keys[..k].iter().map(|&(.., place)| neighbor(place)));
        let farthest_sq = found.iter().map(Found::distance_sq).fold(0.0, f64::max);
        // All that are within the bound passed, and some that are just beyond.
        (farthest_sq <= bound_sq).then_some(farthest_sq)
    }
}

//! The k nearest neighbours of many queries: cell by cell where that is sure to be right, in the tree where it is not.
//!
//! The queries of a cell share the points of the 27 cells around it. Where those contain the k-th neighbour for sure,
//! and they do for nearly all queries when the edge of a cell is about the distance to it, no tree is needed; the tree
//! answers for the rest, so that the result is exact everywhere.

use super::cells::CellList;
use super::selection::{Near, Selection};
use super::{CHUNK, at_least_one, check_finite};
use crate::error::{Error, Result};
use crate::sampling::even_sample;
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

/// The neighbours of which queries are to be found, and how.
pub(super) struct Search<'a> {
    tree: &'a KdTree,
    pub(super) points: &'a [[f64; 3]],
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
    pub(super) fn visit(&self, chunk: usize, mut f: impl FnMut(usize, &[Near])) {
        let slots = chunk * CHUNK..self.order.len().min((chunk + 1) * CHUNK);
        let queries = self.order[slots].iter().map(|&query| query as usize);
        let in_tree = |query: usize| nearest(self.tree, self.points, &self.queries[query], self.k);
        let Some(cells) = &self.cells else {
            return queries.for_each(|query| f(query, &in_tree(query)));
        };
        let mut selection = Selection::new(self.reach);
        let mut gathered = None;
        let reach_sq = self.reach * self.reach;
        let mut guess_sq = reach_sq;
        for query in queries {
            let position = &self.queries[query];
            let cell = cells.cell(position);
            if gathered.replace(cell) != Some(cell) {
                selection.block.gather(cells, position, CROWD * self.k);
            }
            selection.measure(position);
            // Neighbours of the last query were hardly nearer or farther; the fewer points come into question, the better.
            let mut within = |bound_sq| selection.k_nearest(position, self.k, bound_sq, self.nearest_first);
            let farthest_sq = match within(guess_sq) {
                None if guess_sq < reach_sq => within(reach_sq),
                farthest_sq => farthest_sq,
            };
            if let Some(farthest_sq) = farthest_sq {
                guess_sq = reach_sq.min(GENEROUS * farthest_sq);
                f(query, &selection.found);
            } else {
                f(query, &in_tree(query));
            }
        }
    }
}

/// The `k` nearest of the `points` that the tree was built on.
pub(super) fn nearest(tree: &KdTree, points: &[[f64; 3]], query: &[f64; 3], k: usize) -> Vec<Near> {
    let found = tree.k_nearest(query, k).into_iter();
    found.map(|n| Near::new(n.index, &points[n.index as usize], query)).collect()
}

/// Distance within which most queries have their `k` nearest points; 0 for no queries.
fn usual_reach(tree: &KdTree, queries: &[[f64; 3]], k: usize) -> f64 {
    let farthest = |i: usize| Some(tree.k_nearest(&queries[i], k).last()?.distance_sq.sqrt());
    let mut reaches: Vec<f64> =
        even_sample(queries.len(), REACH_SAMPLE, 0).into_iter().filter_map(farthest).collect();
    reaches.sort_unstable_by(f64::total_cmp);
    let rank = REACH_QUANTILE * reaches.len().saturating_sub(1) as f64;
    // The square of a root may be less than what it is the root of, and on a lattice all neighbours are as far.
    reaches.get(rank as usize).map_or(0.0, |reach| reach * (1.0 + 1e-9))
}

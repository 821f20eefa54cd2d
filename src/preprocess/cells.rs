//! The points of a cloud cell by cell, and the cells around a cell.

use std::ops::Range;

use rayon::prelude::*;

use super::CHUNK;
use super::grid::{Grid, members};
use crate::error::Result;
use crate::validate::positive;

/// How much longer the edge of a cell is made than the radius that it must cover: rounding cannot put two points that
/// are within the radius two cells apart.
const MARGIN: f64 = 1.0 + 1e-6;

/// Points ordered by cell; a point in this order is called a slot.
pub(crate) struct CellList {
    /// For each slot its point, so that those of a cell lie side by side in memory.
    pub(crate) points: Vec<[f64; 3]>,
    grid: Grid,
    offsets: Vec<u32>,
    /// For each slot its point; within a cell ascending.
    pub(crate) members: Vec<u32>,
}

impl CellList {
    /// Sorts points into cells such that all points within `radius` of a point lie in the 27 cells around it; `name` is
    /// the parameter that the radius came from.
    pub(crate) fn new(points: &[[f64; 3]], radius: f64, name: &'static str) -> Result<Self> {
        // Here, since the grid would name the edge of its cells.
        positive(name, radius)?;
        let grid = Grid::new(points, radius * MARGIN, name)?;
        let (offsets, members) = members(&grid.cell_of, grid.len);
        let points = members.par_iter().with_min_len(CHUNK).map(|&point| points[point as usize]).collect();
        Ok(Self { points, grid, offsets, members })
    }

    /// Indices of the cell of a position, be it occupied or not.
    pub(crate) fn cell(&self, position: &[f64; 3]) -> [i64; 3] {
        self.grid.indices(position)
    }

    /// Indices of the positions in Morton order of their cells, those of one cell ascending.
    pub(crate) fn order(&self, positions: &[[f64; 3]]) -> Vec<u32> {
        let key = |position| self.grid.key(self.cell(position));
        let mut keys: Vec<(u64, u32)> =
            (0..).zip(positions).map(|(i, position)| (key(position), i)).collect();
        keys.par_sort_unstable();
        keys.into_iter().map(|(_, i)| i).collect()
    }

    /// The slots of the occupied cells around that of a position, its own first.
    pub(crate) fn around(&self, position: &[f64; 3]) -> impl Iterator<Item = Range<usize>> {
        let slots =
            |cell: u32| self.offsets[cell as usize] as usize..self.offsets[cell as usize + 1] as usize;
        self.grid.around(self.cell(position)).map(slots)
    }
}

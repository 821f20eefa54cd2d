//! The points of a cloud cell by cell, and the cells around a cell.

use std::ops::Range;

use super::grid::{Grid, members};
use crate::error::Result;

/// How much longer the edge of a cell is made than the radius that it must cover: rounding cannot put two points that
/// are within the radius two cells apart.
const MARGIN: f64 = 1.0 + 1e-6;

/// Points ordered by cell; a point in this order is called a slot.
pub(crate) struct CellList<'a> {
    points: &'a [[f64; 3]],
    grid: Grid,
    offsets: Vec<u32>,
    /// For each slot its point; within a cell ascending.
    pub(crate) members: Vec<u32>,
    /// The 27 steps to a neighbouring cell, the cell itself first.
    steps: Vec<[i64; 3]>,
}

impl<'a> CellList<'a> {
    /// Sorts points into cells such that all points within `radius` of a point lie in the 27 cells around it; `name` is
    /// the parameter that the radius came from.
    pub(crate) fn new(points: &'a [[f64; 3]], radius: f64, name: &'static str) -> Result<Self> {
        let grid = Grid::new(points, radius * MARGIN, name)?;
        let (offsets, members) = members(&grid.cell_of, grid.len);
        let mut steps: Vec<[i64; 3]> = (0..27).map(|i| [i / 9 - 1, i / 3 % 3 - 1, i % 3 - 1]).collect();
        steps.sort_by_key(|step| step.iter().map(|x| x.abs()).sum::<i64>());
        Ok(Self { points, grid, offsets, members, steps })
    }

    /// Cell of a slot.
    pub(crate) fn cell(&self, slot: usize) -> u32 {
        self.grid.cell_of[self.members[slot] as usize]
    }

    /// Point of a slot.
    pub(crate) fn point(&self, slot: usize) -> &'a [f64; 3] {
        &self.points[self.members[slot] as usize]
    }

    /// Puts the slots of the occupied cells around that of `slot` into `ranges`, its own cell first.
    pub(crate) fn around(&self, slot: usize, ranges: &mut Vec<Range<usize>>) {
        let [x, y, z] = self.grid.indices(self.point(slot));
        ranges.clear();
        ranges.extend(
            self.steps
                .iter()
                .filter_map(|d| self.grid.find([x + d[0], y + d[1], z + d[2]]))
                .map(|cell| self.offsets[cell as usize] as usize..self.offsets[cell as usize + 1] as usize),
        );
    }
}

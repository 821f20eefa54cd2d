//! Nearest points by lookup: a grid whose cells know the point nearest to their centre.
//!
//! Aligning a surface with its own rotated copies asks millions of times for the nearest point within a gate, always of
//! the same points. A k-d tree answers in about a microsecond, a table in a few cache lines. Only a band about the
//! surface is filled, by letting each cell hand its point on to its neighbours.

use nalgebra::Vector3;
use rayon::prelude::*;

/// Edge of a tile \[cells\]: cells that are close in space are close in memory.
const TILE: usize = 8;

/// Slabs that are filled at the same time.
const SLABS: usize = 4;

/// Cells of the table, at most; a finer grid is coarsened to this.
const MAX_CELLS: f64 = 16_777_216.0;

/// A table of nearest points.
#[derive(Debug)]
pub(crate) struct NearestField {
    /// Lower corner of the grid \[length\].
    origin: Vector3<f64>,
    /// Edge of a cell \[length\].
    cell: f64,
    size: [usize; 3],
    /// From a tile to the next one along each axis.
    tile_strides: [usize; 3],
    /// Tile by tile; one more than the index of a point, or 0 where no point is within reach: memory that comes zeroed is
    /// not touched before it is written.
    nearest: Vec<u32>,
}

impl NearestField {
    /// Fills the table about `points` (at least one) out to `reach` \[length\], in cells of edge `cell` \[length\] or larger
    /// ones where the table would grow too large; a cell is at least a seventh of `reach`.
    pub(crate) fn new(points: &[Vector3<f64>], cell: f64, reach: f64) -> Self {
        let empty = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
        let (lower, upper) = points.iter().fold(empty, |(l, u), p| (l.inf(p), u.sup(p)));
        let cells = |cell: f64| (upper - lower).map(|x| ((x + 2.0 * reach) / cell).ceil() + 3.0);
        let mut cell = cell.max(reach / (TILE - 1) as f64);
        while cells(cell).product() > MAX_CELLS {
            cell *= 1.1;
        }
        let origin = lower.add_scalar(-reach - 1.5 * cell);
        let mut field = Self::empty(origin, cell, cells(cell).map(|n| n as usize).into());
        // Slabs of whole tiles, each filled in a table of its own with a tile more at either end: what is farther away is
        // out of reach. Their number is fixed, so that the result does not depend on that of the threads.
        let [layer, ..] = field.tile_strides;
        let layers = (field.nearest.len() / layer).div_ceil(SLABS);
        let size = field.size;
        field.nearest.par_chunks_mut(layers * layer).enumerate().for_each(|(slab, nearest)| {
            let tiles = nearest.len() / layer;
            let start = (slab * layers) as f64 - 1.0;
            let corner = origin + Vector3::x() * (start * TILE as f64 * cell);
            let mut part = Self::empty(corner, cell, [(tiles + 2) * TILE, size[1], size[2]]);
            part.fill(points, reach);
            nearest.copy_from_slice(&part.nearest[layer..][..tiles * layer]);
        });
        field
    }

    fn empty(origin: Vector3<f64>, cell: f64, size: [usize; 3]) -> Self {
        let [x, y, z] = size.map(|n| n.div_ceil(TILE));
        let tile = TILE.pow(3);
        Self {
            origin,
            cell,
            size,
            tile_strides: [tile * y * z, tile * z, tile],
            nearest: vec![0; tile * x * y * z],
        }
    }

    /// Enters those of the points that lie in the table, and lets their cells hand them on.
    fn fill(&mut self, points: &[Vector3<f64>], reach: f64) {
        let mut front = Vec::new();
        for (i, point) in (1_u32..).zip(points) {
            let at = (point - self.origin) / self.cell;
            if (0..3).all(|axis| at[axis] >= 0.0 && at[axis] < self.size[axis] as f64) {
                self.offer(points, at.map(|x| x as u32).into(), i, f64::INFINITY, &mut front);
            }
        }
        // A cell whose centre is farther than this from its point never holds a match.
        let useful = (reach + 0.87 * self.cell).powi(2);
        // Steps through faces only: about sqrt(3) as many along a diagonal as cells within reach.
        for _ in 0..(1.75 * reach / self.cell).ceil() as usize {
            let mut next = Vec::with_capacity(2 * front.len());
            for &at in &front {
                let point = self.nearest[self.index(at)];
                for step in STEPS {
                    let beside: [u32; 3] = std::array::from_fn(|i| at[i].wrapping_add_signed(step[i]));
                    let inside = (0..3).all(|i| (beside[i] as usize) < self.size[i]);
                    if inside {
                        self.offer(points, beside, point, useful, &mut next);
                    }
                }
            }
            front = next;
        }
    }

    /// Puts a point into a cell that is empty, which then joins the front, or holds one farther from its centre; not where
    /// the square of its own distance is `useful` or more.
    #[inline]
    fn offer(
        &mut self,
        points: &[Vector3<f64>],
        at: [u32; 3],
        point: u32,
        useful: f64,
        front: &mut Vec<[u32; 3]>,
    ) {
        let index = self.index(at);
        let held = self.nearest[index];
        if held == point {
            return;
        }
        let center = self.center(at);
        let distance_sq = |i: u32| (points[i as usize - 1] - center).norm_squared();
        let offered_sq = distance_sq(point);
        if offered_sq >= useful {
            return;
        }
        if held == 0 {
            self.nearest[index] = point;
            front.push(at);
        } else if offered_sq < distance_sq(held) {
            self.nearest[index] = point;
        }
    }

    fn center(&self, at: [u32; 3]) -> Vector3<f64> {
        self.origin + Vector3::from(at.map(|x| (f64::from(x) + 0.5) * self.cell))
    }

    fn index(&self, at: [u32; 3]) -> usize {
        (0..3).map(|axis| self.stride(axis, at[axis] as usize)).sum()
    }

    /// What a coordinate adds to the place in the table.
    #[inline]
    fn stride(&self, axis: usize, at: usize) -> usize {
        at / TILE * self.tile_strides[axis] + at % TILE * TILE.pow(axis as u32)
    }

    /// One more than the indices of the points known to the eight cells whose centres surround `query`, 0 for none; the
    /// nearest point is nearly always among them.
    #[inline]
    pub(crate) fn around(&self, query: &Vector3<f64>) -> Option<[u32; 8]> {
        let at = (query - self.origin) / self.cell;
        // NaN fails, too.
        let inside = (0..3).all(|i| at[i] >= 0.5 && at[i] < self.size[i] as f64 - 0.5);
        if !inside {
            return None;
        }
        let [x, y, z]: [[usize; 2]; 3] = std::array::from_fn(|axis| {
            let low = (at[axis] - 0.5) as usize;
            [self.stride(axis, low), self.stride(axis, low + 1)]
        });
        Some(std::array::from_fn(|i| self.nearest[x[i & 1] + y[i >> 1 & 1] + z[i >> 2]]))
    }
}

const STEPS: [[i32; 3]; 6] = [[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]];

//! Nearest points by lookup: a grid whose cells know the point nearest to their centre.
//!
//! Aligning a surface with its own rotated copies asks millions of times for the nearest point within a gate, always of
//! the same points. A k-d tree answers in about a microsecond, a table in a few cache lines. Only a band about the
//! surface is filled, by letting each cell hand its point on to its neighbours.

use nalgebra::Vector3;
use rayon::prelude::*;

/// Edge of a tile \[cells\]: cells that are close in space are close in memory.
const TILE: usize = 8;

/// Cells of a tile.
const TILE_CELLS: usize = TILE.pow(3);

/// Slabs that are filled at the same time.
const SLABS: usize = 3;

/// Cells of the table, at most; a finer grid is coarsened to this.
const MAX_CELLS: f64 = 16_777_216.0;

/// A table of nearest points.
#[derive(Debug)]
pub(crate) struct NearestField {
    tiles: Tiles,
    /// One more than the index of a point, or 0 where no point is within reach: memory that comes zeroed is not touched
    /// before it is written.
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
        let tiles = Tiles::new(origin, cell, cells(cell).map(|n| n as usize).into());
        let mut nearest = vec![0; tiles.len];
        // Slabs of whole tiles, each filled in a table of its own with a tile more at either end: what is farther away is
        // out of reach. Their number is fixed, so that the result does not depend on that of the threads.
        let [layer, ..] = tiles.strides;
        let layers = (tiles.len / layer).div_ceil(SLABS);
        nearest.par_chunks_mut(layers * layer).enumerate().for_each(|(slab, nearest)| {
            let corner = origin + Vector3::x() * (((slab * layers) as f64 - 1.0) * TILE as f64 * cell);
            let width = nearest.len() / layer * TILE + 2 * TILE;
            let mut band = Band::new(Tiles::new(corner, cell, [width, tiles.size[1], tiles.size[2]]));
            band.fill(points, reach / cell);
            for (tile, held) in nearest.chunks_mut(TILE_CELLS).zip(band.tiles_from(layer)) {
                tile.iter_mut()
                    .zip(held)
                    .for_each(|(nearest, held)| *nearest = band.points[*held as u32 as usize]);
            }
        });
        Self { tiles, nearest }
    }

    /// One more than the indices of the points known to the eight cells whose centres surround `query`, 0 for none; the
    /// nearest point is nearly always among them.
    #[inline]
    pub(crate) fn around(&self, query: &Vector3<f64>) -> Option<[u32; 8]> {
        let at = self.tiles.position(query);
        // NaN fails, too.
        let inside = (0..3).all(|i| at[i] >= 0.5 && at[i] < self.tiles.size[i] as f64 - 0.5);
        if !inside {
            return None;
        }
        let [x, y, z]: [[usize; 2]; 3] = std::array::from_fn(|axis| {
            let low = (at[axis] - 0.5) as usize;
            [self.tiles.stride(axis, low), self.tiles.stride(axis, low + 1)]
        });
        Some(std::array::from_fn(|i| self.nearest[x[i & 1] + y[i >> 1 & 1] + z[i >> 2]]))
    }
}

/// A grid of cells that lie tile by tile in memory.
#[derive(Debug, Clone)]
struct Tiles {
    /// Lower corner \[length\].
    origin: Vector3<f64>,
    /// Inverse of the edge of a cell [1 / length].
    cells_per_length: f64,
    /// Cells along each axis.
    size: [usize; 3],
    /// From a tile to the next one along each axis.
    strides: [usize; 3],
    /// Cells in memory.
    len: usize,
}

impl Tiles {
    fn new(origin: Vector3<f64>, cell: f64, size: [usize; 3]) -> Self {
        let [x, y, z] = size.map(|n| n.div_ceil(TILE));
        let strides = [TILE_CELLS * y * z, TILE_CELLS * z, TILE_CELLS];
        Self { origin, cells_per_length: 1.0 / cell, size, strides, len: TILE_CELLS * x * y * z }
    }

    /// Place of a point \[cells\].
    fn position(&self, point: &Vector3<f64>) -> Vector3<f64> {
        (point - self.origin) * self.cells_per_length
    }

    fn index(&self, at: [u32; 3]) -> usize {
        (0..3).map(|axis| self.stride(axis, at[axis] as usize)).sum()
    }

    /// What a coordinate adds to the index of a cell.
    #[inline]
    fn stride(&self, axis: usize, at: usize) -> usize {
        at / TILE * self.strides[axis] + ((at % TILE) << (axis * TILE.ilog2() as usize))
    }
}

/// The cells about a surface, while they are being filled.
struct Band {
    tiles: Tiles,
    /// The point nearest to the centre so far, by its place in `points`, and its distance, as [`held`] packs them; 0 for
    /// none.
    held: Vec<u64>,
    /// Tiles that hold anything.
    touched: Vec<bool>,
    /// Of the points in the grid one more than the index; 0 comes first, for none.
    points: Vec<u32>,
}

/// A point, below the square of its distance: the bits of a float that is not negative are in
/// order.
fn held(distance_sq: f32, point: u32) -> u64 {
    u64::from(distance_sq.to_bits()) << 32 | u64::from(point)
}

impl Band {
    fn new(tiles: Tiles) -> Self {
        Self {
            held: vec![0; tiles.len],
            touched: vec![false; tiles.len / TILE_CELLS],
            points: vec![0],
            tiles,
        }
    }

    /// Enters those of the points that lie in the grid, and lets their cells hand them on as far as `reach` [cells].
    fn fill(&mut self, points: &[Vector3<f64>], reach: f64) {
        // Places in the grid, which the cells that they are handed on to ask for many times.
        let mut places: Vec<[f64; 3]> = Vec::new();
        let mut front = Vec::new();
        for (point, place) in (1_u32..).zip(points) {
            let at = self.tiles.position(place);
            if (0..3).all(|axis| at[axis] >= 0.0 && at[axis] < self.tiles.size[axis] as f64) {
                let distance_sq = at.map(|x| (x.fract() - 0.5).powi(2)).sum() as f32;
                let cell: [u32; 3] = at.map(|x| x as u32).into();
                self.points.push(point);
                places.push(at.into());
                if self.offer(self.tiles.index(cell), held(distance_sq, places.len() as u32)) {
                    front.push(cell);
                }
            }
        }
        // A cell whose centre is farther than this from its point never holds a match.
        let useful = (reach + 0.87).powi(2);
        // Steps through faces only: about sqrt(3) as many along a diagonal as cells within reach.
        for _ in 0..(1.75 * reach).ceil() as usize {
            let mut next = Vec::with_capacity(2 * front.len());
            for &cell in &front {
                let index = self.tiles.index(cell);
                let point = self.held[index] as u32;
                let place = &places[point as usize - 1];
                let off: [f64; 3] = std::array::from_fn(|axis| place[axis] - f64::from(cell[axis]) - 0.5);
                let distance_sq = off[0] * off[0] + off[1] * off[1] + off[2] * off[2];
                for axis in 0..3 {
                    let here = self.tiles.stride(axis, cell[axis] as usize);
                    for step in [-1, 1] {
                        let at = cell[axis].wrapping_add_signed(step);
                        let beside_sq = distance_sq + 1.0 - 2.0 * f64::from(step) * off[axis];
                        if at as usize >= self.tiles.size[axis] || beside_sq >= useful {
                            continue;
                        }
                        let there = index - here + self.tiles.stride(axis, at as usize);
                        if self.offer(there, held(beside_sq.max(0.0) as f32, point)) {
                            let mut beside = cell;
                            beside[axis] = at;
                            next.push(beside);
                        }
                    }
                }
            }
            front = next;
        }
    }

    /// Puts a point into a cell that is empty or holds one farther from its centre; whether it was empty.
    #[inline]
    fn offer(&mut self, index: usize, offered: u64) -> bool {
        let held = &mut self.held[index];
        if *held == 0 {
            *held = offered;
            self.touched[index / TILE_CELLS] = true;
            return true;
        }
        *held = offered.min(*held);
        false
    }

    /// The cells of each tile from the cell `first` on; none for a tile that holds nothing.
    fn tiles_from(&self, first: usize) -> impl Iterator<Item = &[u64]> {
        let tiles = self.held[first..].chunks(TILE_CELLS).zip(&self.touched[first / TILE_CELLS..]);
        tiles.map(|(cells, touched)| if *touched { cells } else { &[] })
    }
}

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

/// Slabs that are filled at the same time. Their number is fixed, so that the result does not depend on that of the threads.
const SLABS: usize = 3;

/// Cells of the table, at most; a finer grid is coarsened to this.
const MAX_CELLS: f64 = 16_777_216.0;

/// Half the diagonal of a cell, and a little: from a place in it to its centre, at most [cells].
const HALF_DIAGONAL: f64 = 0.87;

/// A table of nearest points.
#[derive(Debug)]
pub(crate) struct NearestField {
    grid: Grid,
    /// One more than the index of a point for each cell, tile by tile, or 0 where no point is within reach: memory that comes
    /// zeroed is not touched before it is written.
    nearest: Vec<u32>,
}

impl NearestField {
    /// Fills the table about `points` (at least one) out to `reach` \[length\], in cells of edge `cell` \[length\] or larger
    /// ones where the table would grow too large; a cell is at least a seventh of `reach`.
    pub(crate) fn new(points: &[Vector3<f64>], cell: f64, reach: f64) -> Self {
        let empty = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
        let (lower, upper) = points.iter().fold(empty, |(l, u), p| (l.inf(p), u.sup(p)));
        let cells = |cell: f64| (upper - lower).map(|x| ((x + 2.0 * reach) / cell).ceil() + 3.0);
        // Where both are zero it grows from the smallest number on.
        let mut cell = cell.max(reach / (TILE - 1) as f64).max(f64::MIN_POSITIVE);
        while cells(cell).product() > MAX_CELLS {
            cell *= 1.1;
        }
        let origin = lower.add_scalar(-reach - 1.5 * cell);
        let grid = Grid::new(origin, cell, cells(cell).map(|n| n as usize).into());
        let [x, y, z] = grid.tiles;
        let mut nearest = vec![0; x * y * z * TILE_CELLS];
        let layers = x.div_ceil(SLABS);
        nearest.par_chunks_mut(layers * y * z * TILE_CELLS).enumerate().for_each(|(slab, nearest)| {
            Slab::new(points, &grid, slab * layers, layers, reach / cell).write(nearest);
        });
        Self { grid, nearest }
    }

    /// One more than the indices of the points known to the eight cells whose centres surround `query`, 0 for none; the
    /// nearest point is nearly always among them.
    #[inline]
    pub(crate) fn around(&self, query: &Vector3<f64>) -> Option<[u32; 8]> {
        let at = self.grid.position(query);
        // NaN fails, too.
        let inside = (0..3).all(|i| at[i] >= 0.5 && at[i] < self.grid.size[i] as f64 - 0.5);
        if !inside {
            return None;
        }
        let strides = [self.grid.tiles[1] * self.grid.tiles[2], self.grid.tiles[2], 1];
        let [x, y, z]: [[usize; 2]; 3] = std::array::from_fn(|axis| {
            let low = (at[axis] - 0.5) as usize;
            let place =
                |at: usize| at / TILE * strides[axis] * TILE_CELLS + (at % TILE) * TILE.pow(axis as u32);
            [place(low), place(low + 1)]
        });
        Some(std::array::from_fn(|i| self.nearest[x[i & 1] + y[i >> 1 & 1] + z[i >> 2]]))
    }
}

/// A grid of cells, in tiles.
#[derive(Debug, Clone)]
struct Grid {
    /// Lower corner \[length\].
    origin: Vector3<f64>,
    /// Inverse of the edge of a cell [1 / length].
    cells_per_length: f64,
    /// Cells along each axis.
    size: [usize; 3],
    /// Tiles along each axis.
    tiles: [usize; 3],
}

impl Grid {
    fn new(origin: Vector3<f64>, cell: f64, size: [usize; 3]) -> Self {
        Self { origin, cells_per_length: 1.0 / cell, size, tiles: size.map(|n| n.div_ceil(TILE)) }
    }

    /// Place of a point \[cells\].
    fn position(&self, point: &Vector3<f64>) -> Vector3<f64> {
        (point - self.origin) * self.cells_per_length
    }

    /// Number of a tile.
    #[inline]
    fn tile(&self, [x, y, z]: [usize; 3]) -> usize {
        (x * self.tiles[1] + y) * self.tiles[2] + z
    }
}

/// Layers of tiles of a table, while their cells are being filled, with one more at either end: what is farther away is out of
/// reach.
struct Slab {
    grid: Grid,
    /// For each tile its number among those that have memory; 0 for one that no point reaches.
    slot_of: Vec<u32>,
    /// For each cell of these tiles the point nearest to its centre so far, by its place among `points`, and its distance,
    /// as [`held`] packs them; 0 for none, as everywhere in the first tile.
    held: Vec<u64>,
    /// Of the points in the slab one more than the index; 0 comes first, for none.
    points: Vec<u32>,
}

/// A point, below the square of its distance: the bits of a float that is not negative are in
/// order.
fn held(distance_sq: f32, point: u32) -> u64 {
    u64::from(distance_sq.to_bits()) << 32 | u64::from(point)
}

/// A cell that hands its point on.
struct Cell {
    at: [u32; 3],
    /// Its place in memory.
    index: usize,
}

impl Slab {
    /// Enters those of `points` that matter to `layers` of the table from layer `first` on, and lets their cells hand them on as
    /// far as `reach` [cells].
    fn new(points: &[Vector3<f64>], table: &Grid, first: usize, layers: usize, reach: f64) -> Self {
        let cell = 1.0 / table.cells_per_length;
        let corner = table.origin + Vector3::x() * ((first as f64 - 1.0) * TILE as f64 * cell);
        let grid = Grid::new(corner, cell, [(layers + 2) * TILE, table.size[1], table.size[2]]);
        let margin = reach + HALF_DIAGONAL;
        let [from, to] = [TILE as f64 - margin, ((layers + 1) * TILE) as f64 + margin];
        let mut slab =
            Self { slot_of: vec![0; grid.tiles.iter().product()], grid, held: Vec::new(), points: vec![0] };
        // Places in the grid, which the cells that they are handed on to ask for many times.
        let mut places: Vec<[f64; 3]> = Vec::new();
        for (point, place) in (1_u32..).zip(points) {
            let at = slab.grid.position(place);
            if (from..to).contains(&at.x) {
                slab.points.push(point);
                places.push(at.into());
            }
        }
        slab.reserve(&places, reach);
        slab.fill(&places, reach);
        slab
    }

    /// Takes memory for the tiles within `reach` of the `places`.
    fn reserve(&mut self, places: &[[f64; 3]], reach: f64) {
        let margin = reach + HALF_DIAGONAL + 0.5;
        let mut slots = 1;
        for place in places {
            let [x, y, z]: [_; 3] = std::array::from_fn(|axis| {
                let last = self.grid.tiles[axis] - 1;
                let tile = |at: f64| (at as usize / TILE).min(last);
                tile(place[axis] - margin)..=tile(place[axis] + margin)
            });
            for x in x {
                for y in y.clone() {
                    for z in z.clone() {
                        let slot = &mut self.slot_of[self.grid.tile([x, y, z])];
                        if *slot == 0 {
                            *slot = slots;
                            slots += 1;
                        }
                    }
                }
            }
        }
        self.held = vec![0; slots as usize * TILE_CELLS];
    }

    fn fill(&mut self, places: &[[f64; 3]], reach: f64) {
        let mut front = Vec::new();
        for (place, number) in places.iter().zip(1..) {
            let at = place.map(|x| x as u32);
            let distance_sq: f64 = place.iter().map(|x| (x.fract() - 0.5).powi(2)).sum();
            let index = self.index(at);
            if self.offer(index, held(distance_sq as f32, number)) {
                front.push(Cell { at, index });
            }
        }
        // A cell whose centre is farther than this from its point never holds a match.
        let useful = (reach + HALF_DIAGONAL).powi(2);
        // Steps through faces only: about sqrt(3) as many along a diagonal as cells within reach.
        for _ in 0..(1.75 * reach).ceil() as usize {
            let mut next = Vec::with_capacity(2 * front.len());
            for &Cell { at, index } in &front {
                let number = self.held[index] as u32;
                let place = &places[number as usize - 1];
                let off: [f64; 3] = std::array::from_fn(|axis| place[axis] - f64::from(at[axis]) - 0.5);
                let distance_sq = off[0] * off[0] + off[1] * off[1] + off[2] * off[2];
                for axis in 0..3 {
                    for step in [-1, 1] {
                        let mut beside = at;
                        beside[axis] = at[axis].wrapping_add_signed(step);
                        let beside_sq = distance_sq + 1.0 - 2.0 * f64::from(step) * off[axis];
                        if beside[axis] as usize >= self.grid.size[axis] || beside_sq >= useful {
                            continue;
                        }
                        let is_in_tile = beside[axis] as usize / TILE == at[axis] as usize / TILE;
                        let there = if is_in_tile {
                            index.wrapping_add_signed(step as isize * TILE.pow(axis as u32) as isize)
                        } else {
                            self.index(beside)
                        };
                        if self.offer(there, held(beside_sq.max(0.0) as f32, number)) {
                            next.push(Cell { at: beside, index: there });
                        }
                    }
                }
            }
            front = next;
        }
    }

    /// Place of a cell in memory.
    fn index(&self, at: [u32; 3]) -> usize {
        let at = at.map(|x| x as usize);
        let [x, y, z] = at.map(|x| x % TILE);
        let slot = self.slot_of[self.grid.tile(at.map(|x| x / TILE))] as usize;
        slot * TILE_CELLS + x + TILE * (y + TILE * z)
    }

    /// Puts a point into a cell that is empty or holds one farther from its centre; whether it was empty.
    #[inline]
    fn offer(&mut self, index: usize, offered: u64) -> bool {
        let held = &mut self.held[index];
        if *held == 0 {
            *held = offered;
            return true;
        }
        *held = offered.min(*held);
        false
    }

    /// Writes what the cells of its layers hold to their places in the table.
    fn write(&self, nearest: &mut [u32]) {
        // One layer of tiles comes before the first one.
        let slots = &self.slot_of[self.grid.tile([1, 0, 0])..];
        for (tile, &slot) in nearest.chunks_mut(TILE_CELLS).zip(slots).filter(|(_, slot)| **slot != 0) {
            let held = &self.held[slot as usize * TILE_CELLS..];
            tile.iter_mut()
                .zip(held)
                .for_each(|(nearest, held)| *nearest = self.points[*held as u32 as usize]);
        }
    }
}

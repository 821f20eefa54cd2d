//! Nearest points by lookup: a grid whose cells know the point nearest to their centre.
//!
//! Aligning a surface with its own rotated copies asks millions of times for the nearest point within a gate, always of
//! the same points. A k-d tree answers in about a microsecond, a table in a few cache lines. Only a band about the
//! surface is filled, by letting each cell hand its point on to its neighbours.

use nalgebra::Vector3;

/// Edge of a tile \[cells\]: cells that are close in space are close in memory.
const TILE: usize = 8;

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
    /// ones where the table would grow too large.
    pub(crate) fn new(points: &[Vector3<f64>], cell: f64, reach: f64) -> Self {
        let empty = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
        let (lower, upper) = points.iter().fold(empty, |(l, u), p| (l.inf(p), u.sup(p)));
        let cells = |cell: f64| (upper - lower).map(|x| ((x + 2.0 * reach) / cell).ceil() + 3.0);
        let mut cell = cell;
        while cells(cell).product() > MAX_CELLS {
            cell *= 1.1;
        }
        let size: [usize; 3] = cells(cell).map(|n| n as usize).into();
        let origin = lower.add_scalar(-reach - 1.5 * cell);
        let [x, y, z] = size.map(|n| n.div_ceil(TILE));
        let tile = TILE.pow(3);
        let tile_strides = [tile, tile * x, tile * x * y];
        let mut field = Self { origin, cell, size, tile_strides, nearest: vec![0; tile * x * y * z] };
        let mut front = Vec::new();
        for (i, point) in (1_u32..).zip(points) {
            let [x, y, z] = ((point - origin) / cell).map(|x| x as u32).into();
            field.offer(points, [x, y, z], i, &mut front);
        }
        // A cell whose centre is farther than this from its point never holds a match.
        let useful = (reach + 0.87 * cell).powi(2);
        // Steps through faces only: about sqrt(3) as many along a diagonal as cells within reach.
        for _ in 0..(1.75 * reach / cell).ceil() as usize {
            let mut next = Vec::with_capacity(2 * front.len());
            for &at in &front {
                let point = field.nearest[field.index(at)];
                for step in STEPS {
                    let beside: [u32; 3] = std::array::from_fn(|i| at[i].wrapping_add_signed(step[i]));
                    let inside = (0..3).all(|i| (beside[i] as usize) < field.size[i]);
                    if inside && (points[point as usize - 1] - field.center(beside)).norm_squared() < useful {
                        field.offer(points, beside, point, &mut next);
                    }
                }
            }
            front = next;
        }
        field
    }

    /// Puts a point into a cell that is empty, which then joins the front, or holds one farther from its centre.
    fn offer(&mut self, points: &[Vector3<f64>], at: [u32; 3], point: u32, front: &mut Vec<[u32; 3]>) {
        let index = self.index(at);
        let held = self.nearest[index];
        if held == 0 {
            self.nearest[index] = point;
            front.push(at);
        } else if held != point {
            let center = self.center(at);
            let distance_sq = |i: u32| (points[i as usize - 1] - center).norm_squared();
            if distance_sq(point) < distance_sq(held) {
                self.nearest[index] = point;
            }
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

//! The points of 27 cells side by side, and how far they are from a query.

use super::cells::CellList;
use super::selection::Near;

/// More than what single precision gets wrong in the square of a distance within a block [edge of a cell, squared].
pub(super) const SLACK: f32 = 1e-5;

/// The points of a cell and of those around it: all that lie within an edge of a position in the cell.
pub(super) struct Block {
    /// Edge of a cell \[length\].
    pub(super) edge: f64,
    /// A position in the middle cell.
    center: [f64; 3],
    points: Vec<[f64; 3]>,
    /// For each of them its index in the cloud.
    indices: Vec<u32>,
    /// Their coordinates relative to `center` [edges], in single precision: twice as many at a time.
    rough: [Vec<f32>; 3],
}

impl Block {
    /// An empty block for cells with this edge.
    pub(super) fn new(edge: f64) -> Self {
        Self { edge, center: [0.0; 3], points: Vec::new(), indices: Vec::new(), rough: Default::default() }
    }

    /// Takes the points around the cell of `position`, or none when they are more than `limit`.
    pub(super) fn gather(&mut self, cells: &CellList, position: &[f64; 3], limit: usize) {
        self.center = *position;
        self.points.clear();
        self.indices.clear();
        for slots in cells.around(position) {
            if self.points.len() + slots.len() > limit {
                self.points.clear();
                self.indices.clear();
                break;
            }
            self.points.extend_from_slice(&cells.points[slots.clone()]);
            self.indices.extend_from_slice(&cells.members[slots]);
        }
        let scale = self.edge.recip();
        for (axis, rough) in self.rough.iter_mut().enumerate() {
            rough.clear();
            rough.extend(self.points.iter().map(|p| ((p[axis] - position[axis]) * scale) as f32));
        }
    }

    /// Puts the squares of the distances from a query in the middle cell to the points into `squares`, right to within
    /// [`SLACK`] [edges, squared].
    pub(super) fn rough_distances_sq(&self, query: &[f64; 3], squares: &mut Vec<f32>) {
        let scale = self.edge.recip();
        let [u, v, w]: [f32; 3] =
            std::array::from_fn(|axis| ((query[axis] - self.center[axis]) * scale) as f32);
        let [x, y, z] = &self.rough;
        squares.resize(self.points.len(), 0.0);
        for (((square, x), y), z) in squares.iter_mut().zip(x).zip(y).zip(z) {
            let [x, y, z] = [x - u, y - v, z - w];
            *square = x * x + y * y + z * z;
        }
    }

    /// The point at a place of the block, as a neighbour of a query.
    #[inline]
    pub(super) fn found(&self, place: u32, query: &[f64; 3]) -> Near {
        Near::new(self.indices[place as usize], &self.points[place as usize], query)
    }
}

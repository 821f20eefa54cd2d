//! Voxel grid: the points of a cell are replaced by their mean.

use rayon::prelude::*;

use super::grid::{Grid, members};
use crate::error::Result;

/// A downsampled cloud and the way back to the points it came from.
#[derive(Debug, Clone, PartialEq)]
pub struct VoxelGrid {
    /// Mean of the points of each occupied cell \[length\]; cells in Morton order, so neighbours in space are close in
    /// memory.
    pub points: Vec<[f64; 3]>,
    /// Number of points of each cell.
    pub counts: Vec<u32>,
    /// For each input point its cell.
    pub inverse: Vec<u32>,
}

impl VoxelGrid {
    /// Mean of another attribute over the points of each cell, say normals or viewpoints; one row for each input
    /// point (further rows are ignored, missing ones leave a mean of what is there).
    #[must_use]
    pub fn mean_of(&self, values: &[[f64; 3]]) -> Vec<[f64; 3]> {
        means(values, &self.inverse, self.counts.len()).0
    }

    /// The points of each cell in ascending order, as offsets and indices: those of cell `c` are
    /// `indices[offsets[c]..offsets[c + 1]]`.
    #[must_use]
    pub fn members(&self) -> (Vec<u32>, Vec<u32>) {
        members(&self.inverse, self.counts.len())
    }
}

/// Replaces the points of each cubic cell of edge `voxel_size` \[length\] by their mean.
///
/// The grid starts half a voxel below the lower corner of the bounding box, as in Open3D, and the result is the same
/// set of means. The cells come in Morton order. Sums run over the points in input order, so the result does not
/// depend on the number of threads. An empty cloud gives an empty grid.
///
/// ```
/// use sympose::preprocess::voxel_downsample;
/// let grid = voxel_downsample(&[[0.0, 0.0, 0.0], [0.2, 0.0, 0.0], [5.0, 0.0, 0.0]], 1.0)?;
/// assert_eq!(grid.points, [[0.1, 0.0, 0.0], [5.0, 0.0, 0.0]]);
/// assert_eq!((grid.counts, grid.inverse), (vec![2, 1], vec![0, 0, 1]));
/// # Ok::<(), sympose::Error>(())
/// ```
///
/// # Errors
/// [`Error::NonFinite`](crate::Error::NonFinite); [`Error::InvalidParameter`](crate::Error::InvalidParameter) when
/// `voxel_size` is not positive, or so small that an axis would have 2^21 cells or more (the message names the
/// smallest usable size).
pub fn voxel_downsample(points: &[[f64; 3]], voxel_size: f64) -> Result<VoxelGrid> {
    let Grid { cell_of: inverse, len, .. } = Grid::new(points, voxel_size, "voxel_size")?;
    let (points, counts) = means(points, &inverse, len);
    Ok(VoxelGrid { points, counts, inverse })
}

/// Number of cells that hold a point.
pub(crate) fn occupied_voxels(points: &[[f64; 3]], voxel_size: f64) -> Result<usize> {
    Ok(Grid::new(points, voxel_size, "voxel_size")?.len)
}

/// Mean and number of the values of each cell, summed in input order.
pub(crate) fn means(values: &[[f64; 3]], cell_of: &[u32], cells: usize) -> (Vec<[f64; 3]>, Vec<u32>) {
    // Each task owns a range of cells and passes over all values; that needs neither sorting nor partial sums, and
    // the order of every sum is that of the input.
    let tasks = rayon::current_num_threads().clamp(1, 8);
    let share = cells.div_ceil(tasks).max(1);
    let sums: Vec<Vec<[f64; 4]>> = (0..cells.div_ceil(share))
        .into_par_iter()
        .map(|task| {
            let first = task * share;
            let mut sums = vec![[0.0; 4]; share.min(cells - first)];
            for (value, &cell) in values.iter().zip(cell_of) {
                if let Some(sum) = sums.get_mut((cell as usize).wrapping_sub(first)) {
                    *sum = [sum[0] + value[0], sum[1] + value[1], sum[2] + value[2], sum[3] + 1.0];
                }
            }
            sums
        })
        .collect();
    sums.into_iter().flatten().map(|[x, y, z, n]| ([x / n, y / n, z / n], n as u32)).unzip()
}

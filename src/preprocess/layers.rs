//! One layer of voxels for each surface: noise spreads its points over two or three of them, and a surface oblique to
//! the grid cuts slivers off others.
//!
//! Every voxel joins the fullest of those beside it along that axis of the grid to which the surface is most nearly
//! normal, over and over, so that a column of voxels comes together where most of its points are. Across the surface the
//! voxels stay as fine as they were.

use std::cmp::Reverse;

use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

use super::eigen::smallest_eigenvector;
use super::grid::Grid;
use super::voxel::means;
use super::{CHUNK, VoxelGrid};
use crate::error::Result;

/// Edge of the blocks in whose moments the surface is found [voxels]; each is looked at with its 26 neighbours.
const BLOCK: f64 = 2.0;

/// Voxels to either side that may be joined, for each standard deviation of the points about the surface \[voxels\].
const REACH: f64 = 3.0;

/// The same, at most.
const FARTHEST: f64 = 4.0;

/// [`voxel_downsample`](super::voxel_downsample), with the voxels joined that hold one surface in several layers.
///
/// Opposite faces of a wall as thin as a voxel are joined, too; [`separate_sides`](super::separate_sides) parts them.
///
/// ```
/// use sympose::preprocess::{voxel_downsample, voxel_layers};
/// // A rough plane across a border between voxels.
/// let points: Vec<[f64; 3]> = (0..1600)
///     .map(|i| [0.25 * f64::from(i % 40), 0.25 * f64::from(i / 40), 0.3 * f64::from(i % 3)])
///     .collect();
/// assert_eq!(voxel_downsample(&points, 1.0)?.points.len(), 242);
/// assert_eq!(voxel_layers(&points, 1.0)?.points.len(), 121);
/// # Ok::<(), sympose::Error>(())
/// ```
///
/// # Errors
/// Those of [`voxel_downsample`](super::voxel_downsample).
pub fn voxel_layers(points: &[[f64; 3]], voxel_size: f64) -> Result<VoxelGrid> {
    let grid = Grid::new(points, voxel_size, "voxel_size")?;
    let (centers, counts) = means(points, &grid.cell_of, grid.len);
    let Columns { axis_of, reach } = Columns::new(&centers, &counts, voxel_size)?;
    let fullness = |voxel: u32| (counts[voxel as usize], Reverse(voxel));
    let fullest_beside = |voxel: usize| {
        let at = grid.indices(&centers[voxel]);
        let beside = (1..=reach).flat_map(|step| [-step, step]).filter_map(|step| {
            let mut beside = at;
            beside[axis_of[voxel]] += step;
            grid.find(beside)
        });
        beside.chain([voxel as u32]).max_by_key(|&voxel| fullness(voxel)).unwrap_or(voxel as u32)
    };
    let mut joined: Vec<u32> =
        (0..centers.len()).into_par_iter().with_min_len(CHUNK).map(fullest_beside).collect();
    for voxel in 0..joined.len() {
        // Every step leads to a fuller voxel, so that there is an end.
        while joined[joined[voxel] as usize] != joined[voxel] {
            joined[voxel] = joined[joined[voxel] as usize];
        }
    }
    // The fullest voxels keep their order, which is that of space.
    let mut column_of = vec![0; joined.len()];
    let mut sums: Vec<([f64; 3], u32)> = Vec::with_capacity(joined.len());
    for (voxel, _) in (0_u32..).zip(&joined).filter(|(voxel, root)| voxel == *root) {
        column_of[voxel as usize] = sums.len() as u32;
        sums.push(([0.0; 3], 0));
    }
    for (voxel, &root) in joined.iter().enumerate() {
        column_of[voxel] = column_of[root as usize];
        let (sum, count) = &mut sums[column_of[voxel] as usize];
        *sum = std::array::from_fn(|i| sum[i] + centers[voxel][i] * f64::from(counts[voxel]));
        *count += counts[voxel];
    }
    let mut inverse = grid.cell_of;
    inverse.par_iter_mut().with_min_len(CHUNK).for_each(|cell| *cell = column_of[*cell as usize]);
    let mean = |(sum, count): ([f64; 3], u32)| (sum.map(|x| x / f64::from(count)), count);
    let (points, counts) = sums.into_iter().map(mean).unzip();
    Ok(VoxelGrid { points, counts, inverse })
}

/// Number of points, their sum and that of their products.
#[derive(Clone, Copy, Default)]
struct Moments {
    count: f64,
    sum: Vector3<f64>,
    products: Matrix3<f64>,
}

impl Moments {
    fn add(&mut self, other: &Self) {
        self.count += other.count;
        self.sum += other.sum;
        self.products += other.products;
    }
}

/// The columns in which voxels may be joined.
struct Columns {
    /// For each voxel the axis of the grid to which the surface around it is most nearly normal.
    axis_of: Vec<usize>,
    /// Voxels to either side that may be joined.
    reach: i64,
}

impl Columns {
    fn new(centers: &[[f64; 3]], counts: &[u32], voxel_size: f64) -> Result<Self> {
        let blocks = Grid::new(centers, BLOCK * voxel_size, "voxel_size")?;
        let mut moments = vec![Moments::default(); blocks.len];
        let mut places = vec![[0; 3]; blocks.len];
        // Far from the origin of the cloud the products would lose the digits that matter.
        let origin = centers.first().map_or_else(Vector3::zeros, |center| Vector3::from(*center));
        for ((center, &count), &block) in centers.iter().zip(counts).zip(&blocks.cell_of) {
            let (count, p) = (f64::from(count), Vector3::from(*center) - origin);
            let sum = p * count;
            moments[block as usize].add(&Moments { count, sum, products: sum * p.transpose() });
            places[block as usize] = blocks.indices(center);
        }
        let surface = |&[x, y, z]: &[i64; 3]| {
            let mut around = Moments::default();
            let steps = (0..27).map(|i| [i / 9 - 1, i / 3 % 3 - 1, i % 3 - 1]);
            let found = steps.filter_map(|[dx, dy, dz]| blocks.find([x + dx, y + dy, z + dz]));
            found.for_each(|block| around.add(&moments[block as usize]));
            let Moments { count, sum, products } = around;
            let (normal, [thinnest, ..]) =
                smallest_eigenvector(&((products - sum * (sum / count).transpose()) / count));
            (normal.iamax(), thinnest.max(0.0).sqrt())
        };
        let surfaces: Vec<(usize, f64)> = places.par_iter().with_min_len(CHUNK / 16).map(surface).collect();
        let mut spreads: Vec<f64> = surfaces.iter().map(|(_, spread)| *spread).collect();
        let middle = spreads.len() / 2;
        let spread = if spreads.is_empty() {
            0.0
        } else {
            *spreads.select_nth_unstable_by(middle, f64::total_cmp).1 / voxel_size
        };
        Ok(Self {
            axis_of: blocks.cell_of.iter().map(|&block| surfaces[block as usize].0).collect(),
            reach: (REACH * spread).round().clamp(1.0, FARTHEST) as i64,
        })
    }
}

//! One layer of voxels for each surface: noise spreads its points over two or three of them, and a surface oblique to
//! the grid cuts slivers off others.
//!
//! Every voxel joins the fullest of those beside it along that axis of the grid to which the surface is most nearly
//! normal, over and over, so that a column of voxels comes together where most of its points are. Across the surface the
//! voxels stay as fine as they were.

use std::cmp::Reverse;

use nalgebra::Vector3;
use rayon::prelude::*;

use super::eigen::smallest_eigenvector;
use super::grid::Grid;
use super::moments::Moments;
use super::voxel::means;
use super::{CHUNK, VoxelGrid};
use crate::error::Result;
use crate::median::median;

/// Edge of the blocks in whose moments the surface is found [voxels]; each is looked at with its 26 neighbours.
const BLOCK: f64 = 2.0;

/// Voxels to either side that may be joined, for each standard deviation of the points about the surface \[voxels\].
const REACH: f64 = 3.0;

/// The same, at most.
const FARTHEST: f64 = 4.0;

/// A voxel grid with one layer for each surface.
#[derive(Debug, Clone, PartialEq)]
pub struct Layers {
    /// The grid.
    pub grid: VoxelGrid,
    /// Standard deviation of the points about the surface, by noise and by what is finer than a few voxels \[length\].
    pub noise: f64,
}

/// [`voxel_downsample`](super::voxel_downsample), with the voxels joined that hold one surface in several layers.
///
/// How far apart the layers of one surface lie follows from the noise, which is looked at apart for each side of a wall:
/// `viewpoint_of` gives for each point the position it was seen from \[length\]. Opposite faces of a wall as thin as a
/// voxel are joined, too; [`separate_sides`](super::separate_sides) parts them.
///
/// ```
/// use sympose::preprocess::{voxel_downsample, voxel_layers};
/// // A rough plane across a border between voxels.
/// let points: Vec<[f64; 3]> = (0..1600)
///     .map(|i| [0.25 * f64::from(i % 40), 0.25 * f64::from(i / 40), 0.3 * f64::from(i % 3)])
///     .collect();
/// assert_eq!(voxel_downsample(&points, 1.0)?.points.len(), 242);
/// assert_eq!(voxel_layers(&points, |_| [5.0, 5.0, 50.0], 1.0)?.grid.points.len(), 121);
/// # Ok::<(), sympose::Error>(())
/// ```
///
/// # Errors
/// Those of [`voxel_downsample`](super::voxel_downsample).
pub fn voxel_layers(
    points: &[[f64; 3]],
    viewpoint_of: impl Fn(usize) -> [f64; 3] + Sync,
    voxel_size: f64,
) -> Result<Layers> {
    let grid = Grid::new(points, voxel_size, "voxel_size")?;
    let (centers, counts) = means(points, &grid.cell_of, grid.len);
    let blocks = Blocks::new(&centers, &counts, voxel_size)?;
    let noise = blocks.spread(points, &grid.cell_of, viewpoint_of);
    let reach = (REACH * noise / voxel_size).round().clamp(1.0, FARTHEST) as i64;
    let axes: Vec<usize> = blocks.normals.iter().map(Vector3::iamax).collect();
    let fullness = |voxel: u32| (counts[voxel as usize], Reverse(voxel));
    let fullest_beside = |voxel: usize| {
        let at = grid.indices(&centers[voxel]);
        let beside = (1..=reach).flat_map(|step| [-step, step]).filter_map(|step| {
            let mut beside = at;
            beside[axes[blocks.grid.cell_of[voxel] as usize]] += step;
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
    Ok(Layers { grid: VoxelGrid { points, counts, inverse }, noise })
}

/// Normal of the plane through some points, and their standard deviation about it.
fn plane(moments: &Moments) -> (Vector3<f64>, f64) {
    let (normal, [thinnest, ..]) = smallest_eigenvector(&(moments.scatter() / moments.count));
    (normal, thinnest.max(0.0).sqrt())
}

/// Coarse cells, in which the surface is found.
struct Blocks {
    /// The blocks; its points are the voxels.
    grid: Grid,
    /// Indices of each block.
    places: Vec<[i64; 3]>,
    /// Normal of the surface around each block, of any sign.
    normals: Vec<Vector3<f64>>,
    /// Far from the origin of the cloud products would lose the digits that matter.
    origin: Vector3<f64>,
}

impl Blocks {
    fn new(centers: &[[f64; 3]], counts: &[u32], voxel_size: f64) -> Result<Self> {
        let grid = Grid::new(centers, BLOCK * voxel_size, "voxel_size")?;
        let origin = centers.first().map_or_else(Vector3::zeros, |center| Vector3::from(*center));
        let mut moments = vec![Moments::default(); grid.len];
        let mut places = vec![[0; 3]; grid.len];
        for ((center, &count), &block) in centers.iter().zip(counts).zip(&grid.cell_of) {
            let moments: &mut Moments = &mut moments[block as usize];
            if moments.count == 0.0 {
                places[block as usize] = grid.indices(center);
            }
            moments.add_weighted((Vector3::from(*center) - origin).into(), f64::from(count));
        }
        let mut blocks = Self { grid, places, normals: Vec::new(), origin };
        let normal = |block: usize| {
            let mut around = Moments::default();
            blocks.around(block).for_each(|beside| around.join(&moments[beside]));
            plane(&around).0
        };
        blocks.normals = (0..moments.len()).into_par_iter().with_min_len(CHUNK / 16).map(normal).collect();
        Ok(blocks)
    }

    /// A block and those that touch it.
    fn around(&self, block: usize) -> impl Iterator<Item = usize> {
        self.grid.around(self.places[block]).map(|block| block as usize)
    }

    /// Standard deviation of the points about the surface, of which a thin wall has two \[length\]: the median over
    /// blocks of the points seen from one side.
    fn spread(
        &self,
        points: &[[f64; 3]],
        voxel_of: &[u32],
        viewpoint_of: impl Fn(usize) -> [f64; 3] + Sync,
    ) -> f64 {
        /// Points and blocks that are looked at.
        const POINTS: usize = 50_000;
        const BLOCKS: usize = 1_000;
        /// Points that show a spread about a plane.
        const ENOUGH: f64 = 10.0;
        let look = |i: usize| {
            let block = self.grid.cell_of[voxel_of[i] as usize] as usize;
            let point = Vector3::from(points[i]);
            let behind = self.normals[block].dot(&(Vector3::from(viewpoint_of(i)) - point)) < 0.0;
            (block, behind, point - self.origin)
        };
        let step = points.len().div_ceil(POINTS).max(1);
        let looks: Vec<(usize, bool, Vector3<f64>)> = (0..points.len().div_ceil(step))
            .into_par_iter()
            .with_min_len(CHUNK)
            .map(|i| look(i * step))
            .collect();
        let mut sides = vec![[Moments::default(); 2]; self.places.len()];
        for (block, behind, point) in looks {
            sides[block][usize::from(behind)].add(point.into());
        }
        let step = self.places.len().div_ceil(BLOCKS).max(1);
        let spread_around = |block: usize| {
            let [mut front, mut back] = [Moments::default(); 2];
            for beside in self.around(block) {
                let turned = self.normals[block].dot(&self.normals[beside]) < 0.0;
                front.join(&sides[beside][usize::from(turned)]);
                back.join(&sides[beside][usize::from(!turned)]);
            }
            [front, back].map(|side| (side.count >= ENOUGH).then(|| plane(&side).1))
        };
        let blocks = (0..self.places.len()).into_par_iter().step_by(step).with_min_len(BLOCKS / 16);
        let spreads: Vec<[Option<f64>; 2]> = blocks.map(spread_around).collect();
        let mut spreads: Vec<f64> = spreads.into_iter().flatten().flatten().collect();
        median(&mut spreads).unwrap_or(0.0)
    }
}

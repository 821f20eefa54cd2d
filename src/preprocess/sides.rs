//! Both sides of thin walls: the points of a voxel are averaged apart for the side from which they were seen.
//!
//! A blade thinner than a voxel has points of its front and its back in one cell. Their common mean lies inside the
//! material and has no normal of its own; seen apart, each side stays where it was measured.

use nalgebra::Vector3;
use rayon::prelude::*;

use super::eigen::smallest_eigenvector;
use super::moments::Moments;
use super::{CHUNK, KNeighbors, VoxelGrid};

/// Voxels divided by side; the means of one side of one voxel are called a patch.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Sides {
    /// Mean of the points of each patch \[length\]; in the order of the voxels, so neighbours in space stay close.
    pub points: Vec<[f64; 3]>,
    /// Unit normals, toward the sensors that saw the patch.
    pub normals: Vec<[f64; 3]>,
    /// Mean position of these sensors \[length\].
    pub viewpoints: Vec<[f64; 3]>,
    /// For each patch its voxel.
    pub voxel_of: Vec<u32>,
    /// For each input point its patch.
    pub patch_of_point: Vec<u32>,
    /// Voxels that were seen from both sides.
    pub divided: usize,
}

/// Mean cosine between the normal and the directions to the sensors below which a side is only noise on the other one.
const FACING: f64 = 0.2;

/// Neighbours from which a patch takes its own normal, at least; with fewer it keeps that of its voxel.
const ENOUGH: f64 = 6.0;

/// Cosine between a normal and the direction to the sensor below which it is none: points along one row of a picture lie in
/// a plane with the sensor, whose normal says nothing of the surface, and even less from which side it was seen.
const EDGE_ON: f64 = 1e-3;

/// What the points of one side of a voxel sum to.
#[derive(Debug, Clone, Copy, Default)]
struct Sum {
    position: [f64; 3],
    viewpoint: [f64; 3],
    cosine: f64,
    count: f64,
}

impl Sum {
    #[inline]
    fn add(&mut self, other: &Self) {
        for axis in 0..3 {
            self.position[axis] += other.position[axis];
            self.viewpoint[axis] += other.viewpoint[axis];
        }
        self.cosine += other.cosine;
        self.count += other.count;
    }
}

/// Divides the voxels of `grid` by the side of their local plane from which their points were seen.
///
/// `normals` are those of the voxels, of any sign, `neighbors` the neighbours of each voxel; `viewpoint_of` gives for
/// each of `points` the position it was seen from.
///
/// ```
/// use sympose::preprocess::{KNeighbors, NormalParams, normals_from_neighbors, separate_sides, voxel_downsample};
/// use sympose::spatial::KdTree;
/// // A plate thinner than a voxel, each face seen from its own side.
/// let points: Vec<[f64; 3]> = (0..800)
///     .map(|i| [0.5 * f64::from(i / 2 % 20), 0.5 * f64::from(i / 40), 0.1 * f64::from(i % 2)])
///     .collect();
/// let viewpoint = |i: usize| [5.0, 5.0, if i % 2 == 0 { -50.0 } else { 50.0 }];
/// let grid = voxel_downsample(&points, 1.0)?;
/// let neighbors = KNeighbors::new(&KdTree::new(&grid.points)?, &grid.points, 12)?;
/// let planes = normals_from_neighbors(&grid.points, &neighbors, &NormalParams { k: 12, max_radius: None })?;
/// let sides = separate_sides(&points, viewpoint, &grid, &planes.normals, &neighbors);
/// assert_eq!(sides.points.len(), 2 * grid.points.len());
/// # Ok::<(), sympose::Error>(())
/// ```
#[must_use]
pub fn separate_sides(
    points: &[[f64; 3]],
    viewpoint_of: impl Fn(usize) -> [f64; 3] + Sync,
    grid: &VoxelGrid,
    normals: &[[f64; 3]],
    neighbors: &KNeighbors,
) -> Sides {
    // Of the direction to the sensor and the normal of the voxel; plain numbers, for it is taken for all raw points.
    let cosine = |(i, &voxel): (usize, &u32)| {
        let (position, viewpoint) = (points[i], viewpoint_of(i));
        let toward: [f64; 3] = std::array::from_fn(|axis| viewpoint[axis] - position[axis]);
        let dot = |a: &[f64; 3], b: &[f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let length = dot(&toward, &toward).sqrt();
        if length > 0.0 { dot(&toward, &normals[voxel as usize]) / length } else { 0.0 }
    };
    let cosines: Vec<f64> = grid.inverse.par_iter().enumerate().with_min_len(CHUNK).map(cosine).collect();
    // Each task owns a range of voxels and passes over all points, so that every sum is in their order.
    let voxels = grid.points.len();
    let share = voxels.div_ceil(rayon::current_num_threads().clamp(1, 8)).max(1);
    let ranges: Vec<Vec<[Sum; 2]>> = (0..voxels.div_ceil(share))
        .into_par_iter()
        .map(|task| {
            let first = task * share;
            let mut sums = vec![[Sum::default(); 2]; share.min(voxels - first)];
            for (i, &voxel) in grid.inverse.iter().enumerate() {
                let Some(sum) = sums.get_mut((voxel as usize).wrapping_sub(first)) else { continue };
                let (position, viewpoint, cosine) = (points[i], viewpoint_of(i), cosines[i].abs());
                let seen = Sum { position, viewpoint, cosine, count: 1.0 };
                sum[usize::from(cosines[i] < 0.0)].add(&seen);
            }
            sums
        })
        .collect();
    let mut sides = Sides::with_capacity(voxels + voxels / 8);
    let mut patch_of_face = Vec::with_capacity(voxels);
    for (voxel, [mut front, mut back]) in ranges.into_iter().flatten().enumerate() {
        let seen = |sum: &Sum| sum.cosine > FACING * sum.count && sum.count > 0.0;
        let [normal, opposite] = [normals[voxel], normals[voxel].map(|x| -x)];
        let first = sides.points.len() as u32;
        if seen(&front) && seen(&back) {
            sides.divided += 1;
            patch_of_face.push([first, first + 1]);
            sides.push(voxel, &front, normal);
            sides.push(voxel, &back, opposite);
            continue;
        }
        // One side only: all points belong to it.
        patch_of_face.push([first; 2]);
        if front.cosine - back.cosine >= -EDGE_ON * (front.count + back.count) {
            front.add(&back);
            sides.push(voxel, &front, normal);
        } else {
            back.add(&front);
            sides.push(voxel, &back, opposite);
        }
    }
    let patch = |(&voxel, &cosine): (&u32, &f64)| {
        let [front, back] = patch_of_face[voxel as usize];
        if cosine < 0.0 { back } else { front }
    };
    sides.patch_of_point = grid.inverse.par_iter().zip(&cosines).with_min_len(CHUNK).map(patch).collect();
    // A number for each raw point, no longer needed.
    drop(cosines);
    if sides.divided > 0 {
        sides.normals = sides.own_normals(&patch_of_face, neighbors);
    }
    sides
}

impl Sides {
    fn with_capacity(patches: usize) -> Self {
        let rows = || Vec::with_capacity(patches);
        let voxel_of = Vec::with_capacity(patches);
        Self { points: rows(), normals: rows(), viewpoints: rows(), voxel_of, ..Self::default() }
    }

    fn push(&mut self, voxel: usize, sum: &Sum, normal: [f64; 3]) {
        self.points.push(sum.position.map(|x| x / sum.count));
        self.viewpoints.push(sum.viewpoint.map(|x| x / sum.count));
        self.normals.push(normal);
        self.voxel_of.push(voxel as u32);
    }

    /// Normals from the neighbours on the same side.
    fn own_normals(&self, patch_of_face: &[[u32; 2]], neighbors: &KNeighbors) -> Vec<[f64; 3]> {
        let own = |patch: usize| {
            let (center, normal) = (Vector3::from(self.points[patch]), Vector3::from(self.normals[patch]));
            let (indices, _) = neighbors.of(self.voxel_of[patch] as usize);
            let on_one_side = |&voxel: &u32| {
                let [front, back] = patch_of_face[voxel as usize];
                front == back && Vector3::from(self.normals[front as usize]).dot(&normal) > 0.0
            };
            if indices.iter().all(on_one_side) {
                return self.normals[patch];
            }
            let mut moments = Moments::default();
            for &voxel in indices {
                let [front, back] = patch_of_face[voxel as usize];
                let agrees = |p: u32| Vector3::from(self.normals[p as usize]).dot(&normal) > 0.0;
                let Some(same) = [front, back].into_iter().find(|&p| agrees(p)) else { continue };
                moments.add((Vector3::from(self.points[same as usize]) - center).into());
            }
            if moments.count < ENOUGH {
                return self.normals[patch];
            }
            let (found, _) = smallest_eigenvector(&moments.scatter());
            let toward = Vector3::from(self.viewpoints[patch]) - center;
            let facing = found.dot(&toward);
            let is_seen = facing.abs() > EDGE_ON * toward.norm();
            if is_seen { (found * facing.signum()).into() } else { self.normals[patch] }
        };
        (0..self.points.len()).into_par_iter().with_min_len(CHUNK).map(own).collect()
    }
}

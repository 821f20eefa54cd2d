//! Both sides of thin walls: the points of a voxel are averaged apart for the side from which they were seen.
//!
//! A blade thinner than a voxel has points of its front and its back in one cell. Their common mean lies inside the
//! material and has no normal of its own; seen apart, each side stays where it was measured.

use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

use super::eigen::smallest_eigenvector;
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
const ENOUGH: usize = 6;

#[derive(Debug, Clone, Copy, Default)]
struct Sum {
    position: Vector3<f64>,
    viewpoint: Vector3<f64>,
    cosine: f64,
    count: f64,
}

impl Sum {
    fn add(&mut self, other: &Self) {
        self.position += other.position;
        self.viewpoint += other.viewpoint;
        self.cosine += other.cosine;
        self.count += other.count;
    }
}

/// Divides the voxels of `grid` by the side of their local plane from which their points were seen.
///
/// `normals` are those of the voxels, of any sign, `neighbors` the neighbours of each voxel; `viewpoint_of` gives for
/// each of `points` the position it was seen from.
#[must_use]
pub fn separate_sides(
    points: &[[f64; 3]],
    viewpoint_of: impl Fn(usize) -> [f64; 3] + Sync,
    grid: &VoxelGrid,
    normals: &[[f64; 3]],
    neighbors: &KNeighbors,
) -> Sides {
    let look = |i: usize| {
        let (position, viewpoint) = (Vector3::from(points[i]), Vector3::from(viewpoint_of(i)));
        let toward = (viewpoint - position).try_normalize(0.0).unwrap_or_default();
        (position, viewpoint, toward.dot(&Vector3::from(normals[grid.inverse[i] as usize])))
    };
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
                let (position, viewpoint, cosine) = look(i);
                sum[usize::from(cosine < 0.0)].add(&Sum {
                    position,
                    viewpoint,
                    cosine: cosine.abs(),
                    count: 1.0,
                });
            }
            sums
        })
        .collect();
    let mut sums = ranges.concat();
    let mut sides = Sides::default();
    let mut patch_of_face = vec![[u32::MAX; 2]; sums.len()];
    for (voxel, [front, back]) in sums.iter_mut().enumerate() {
        let seen = |sum: &Sum| sum.cosine > FACING * sum.count && sum.count > 0.0;
        let both = seen(front) && seen(back);
        if !both {
            // One side only: all points belong to it.
            let main = if front.cosine >= back.cosine { 0 } else { 1 };
            let (stray, kept) = if main == 0 { (*back, front) } else { (*front, back) };
            kept.add(&stray);
            patch_of_face[voxel] = [sides.points.len() as u32; 2];
            sides.push(voxel, kept, if main == 0 { normals[voxel] } else { normals[voxel].map(|x| -x) });
            continue;
        }
        sides.divided += 1;
        for (face, sum) in [front, back].into_iter().enumerate() {
            patch_of_face[voxel][face] = sides.points.len() as u32;
            sides.push(voxel, sum, if face == 0 { normals[voxel] } else { normals[voxel].map(|x| -x) });
        }
    }
    let patch = |(i, &voxel): (usize, &u32)| {
        let [front, back] = patch_of_face[voxel as usize];
        if front == back || look(i).2 >= 0.0 { front } else { back }
    };
    sides.patch_of_point = grid.inverse.par_iter().enumerate().with_min_len(CHUNK).map(patch).collect();
    if sides.divided > 0 {
        sides.normals = sides.own_normals(&patch_of_face, neighbors);
    }
    sides
}

impl Sides {
    fn push(&mut self, voxel: usize, sum: &Sum, normal: [f64; 3]) {
        self.points.push((sum.position / sum.count).into());
        self.viewpoints.push((sum.viewpoint / sum.count).into());
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
            let (mut sum, mut products, mut count) = (Vector3::zeros(), Matrix3::zeros(), 0);
            for &voxel in indices {
                let [front, back] = patch_of_face[voxel as usize];
                let agrees = |p: u32| Vector3::from(self.normals[p as usize]).dot(&normal) > 0.0;
                let Some(same) = [front, back].into_iter().find(|&p| agrees(p)) else { continue };
                let d = Vector3::from(self.points[same as usize]) - center;
                sum += d;
                products += d * d.transpose();
                count += 1;
            }
            if count < ENOUGH {
                return self.normals[patch];
            }
            let (found, _) =
                smallest_eigenvector(&(products - sum * sum.transpose() / f64::from(count as u32)));
            let toward = Vector3::from(self.viewpoints[patch]) - center;
            (if found.dot(&toward) < 0.0 { -found } else { found }).into()
        };
        (0..self.points.len()).into_par_iter().with_min_len(CHUNK).map(own).collect()
    }
}

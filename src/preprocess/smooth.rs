//! The surface without its noise: how many neighbours it takes to see where it faces, and their mean height.

use nalgebra::Vector3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::normals::tilt_sq;
use super::{CHUNK, KNeighbors, Sides};
use crate::median::median;
use crate::spatial::{KdTree, Neighbor};

/// How noise is told from shape, where viewpoints are known or assumed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SmoothingParams {
    /// Joins the voxels that hold one surface in several layers. Normals and filters then take 0.6 times the neighbours
    /// that they are set to, and distances between neighbours count 0.75 times: a layer has fewer points than several.
    pub join_layers: bool,
    /// Where no viewpoint is given, assumes one view if all of the surface can be seen from one place. It tells the sides of
    /// walls apart, and that a rotated point which is turned away would not have been seen; nothing else.
    pub assume_view: bool,
    /// Standard deviation of the points along the rays of their sensor from which on they are averaged along these before
    /// all else, where viewpoints are given and layers are joined \[diameters\].
    pub ray_noise: f64,
    /// Rays, its own among them, among which a point is averaged then \[count\]; 0: none is.
    pub ray_neighbors: usize,
    /// Neighbours of a local plane where noise is large, at most \[count\]; where it is small, those of the normals do.
    pub max_neighbors: usize,
    /// Tilt of a typical local plane by noise that calls for more neighbours \[rad\].
    pub max_tilt: f64,
    /// A measured point stands for the mean surface of those of its neighbours whose normals differ from its own by less
    /// than this angle \[rad\]; `None`: for itself.
    #[serde(deserialize_with = "crate::config::limit_or_off")]
    pub max_angle: Option<f64>,
}

impl Default for SmoothingParams {
    fn default() -> Self {
        Self {
            join_layers: true,
            assume_view: true,
            ray_noise: 0.0035,
            ray_neighbors: 13,
            max_neighbors: 90,
            max_tilt: 0.08,
            max_angle: Some(0.15),
        }
    }
}

/// Neighbours whose planes say where the surface faces: `least`, or as many more as keep half of the planes from being
/// tilted by noise more than the limit.
///
/// `tree` must hold `points`; `viewpoint_of` gives for each of them a position that it was seen from.
#[must_use]
pub fn enough_neighbors(
    points: &[[f64; 3]],
    viewpoint_of: impl Fn(usize) -> [f64; 3],
    tree: &KdTree,
    least: usize,
    params: &SmoothingParams,
) -> usize {
    /// Planes that are looked at.
    const LOOKED_AT: usize = 500;
    /// Steps in which more neighbours are tried.
    const STEP: usize = 10;
    let stride = points.len().div_ceil(LOOKED_AT).max(1);
    let places: Vec<usize> = (0..points.len()).step_by(stride).collect();
    let indices = |found: Vec<Neighbor>| found.iter().map(|n| n.index).collect();
    let around = |k: usize| -> Vec<Vec<u32>> {
        places.par_iter().map(|&i| indices(tree.k_nearest(&points[i], k))).collect()
    };
    let is_enough = |k: usize, around: &[Vec<u32>]| {
        let planes = places.iter().zip(around);
        let mut tilts_sq: Vec<f64> = planes
            .map(|(&center, found)| tilt_sq(points, center, &found[..k.min(found.len())], &viewpoint_of))
            .collect();
        median(&mut tilts_sq).is_none_or(|tilt_sq| tilt_sq <= params.max_tilt.powi(2))
    };
    if params.max_neighbors <= least || is_enough(least, &around(least)) {
        return least;
    }
    let most = around(params.max_neighbors);
    let more = (least + STEP..params.max_neighbors).step_by(STEP);
    more.into_iter().find(|&k| is_enough(k, &most)).unwrap_or(params.max_neighbors)
}

/// Mean height over each patch, along its normal, of the patches around it whose normals agree with its own to within
/// `max_angle` \[rad\], itself among them \[length\].
///
/// Patches of another side of the wall, of another face at an edge, and of voxels that are not kept do not count, so that
/// blades keep their thickness and edges stay sharp. Moved by its height, a patch lies on the surface of its neighbours.
#[must_use]
pub fn mean_heights(sides: &Sides, is_kept: &[bool], neighbors: &KNeighbors, max_angle: f64) -> Vec<f64> {
    let least_cosine = max_angle.cos();
    let (points, normals) = (&sides.points, &sides.normals);
    // The patches of a voxel follow each other.
    let mut first_patch = vec![0; is_kept.len() + 1];
    sides.voxel_of.iter().for_each(|&voxel| first_patch[voxel as usize + 1] += 1);
    for voxel in 0..is_kept.len() {
        first_patch[voxel + 1] += first_patch[voxel];
    }
    let height = |patch: usize| {
        let (center, normal) = (Vector3::from(points[patch]), Vector3::from(normals[patch]));
        let (voxels, _) = neighbors.of(sides.voxel_of[patch] as usize);
        let kept = voxels.iter().map(|&voxel| voxel as usize).filter(|&voxel| is_kept[voxel]);
        let heights = kept
            .flat_map(|voxel| first_patch[voxel]..first_patch[voxel + 1])
            .filter(|&other| Vector3::from(normals[other]).dot(&normal) >= least_cosine)
            .map(|other| (Vector3::from(points[other]) - center).dot(&normal));
        let (sum, count) = heights.fold((0.0, 0), |(sum, count), height| (sum + height, count + 1));
        sum / f64::from(count.max(1))
    };
    (0..points.len()).into_par_iter().with_min_len(CHUNK).map(height).collect()
}

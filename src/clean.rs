//! Which voxels belong to the part: stray points are told from it by density, by their distance from the surface around
//! them, by rays that went on behind them, and by what they hang together with.

use std::array;

use nalgebra::Vector3;
use rayon::prelude::*;

use crate::config::{ClusterMode, Config};
use crate::error::Result;
use crate::preprocess::{CHUNK, ClusterParams, KNeighbors, main_cluster, statistical_inliers};
use crate::symmetry::visibility::{Seen, Visibility};

/// Size at which a cluster within reach of the box of the main one is kept beside it [share of the main one].
const ENCLOSED: f64 = 0.005;

/// Radius filter, statistical filter, distance from the local plane, free space, then the main cluster; kept voxels,
/// ascending.
pub(crate) fn clean(
    points: &[[f64; 3]],
    neighbors: &KNeighbors,
    deviation: &[f64],
    visibility: Option<&Visibility>,
    voxel_size: f64,
    diameter: f64,
    config: &Config,
) -> Result<Vec<u32>> {
    let params = &config.outliers;
    let radius_sq = (params.radius * voxel_size).powi(2);
    // A point is its own first neighbour, so the neighbour of rank `min_neighbors` decides.
    let crowded = |i: usize| {
        let (_, distances_sq) = neighbors.of(i);
        distances_sq.get(params.min_neighbors).is_none_or(|&d| d <= radius_sq)
    };
    let regular = statistical_inliers(neighbors, &params.statistical())?;
    // Without viewpoints the fine voxels of a thin wall lie on two surfaces at once, each off the other one.
    let limit = params.off_surface.filter(|_| visibility.is_some()).unwrap_or(f64::INFINITY);
    let looked_through = visibility.filter(|_| params.seen_through);
    let free = |i: usize| {
        let point = Vector3::from(points[i]);
        looked_through.is_some_and(|v| v.seen(&point, params.radius * voxel_size) == Seen::Free)
    };
    let belongs = |&i: &u32| {
        let i = i as usize;
        crowded(i) && deviation[i] <= limit && !free(i)
    };
    let kept: Vec<u32> = regular.into_par_iter().with_min_len(CHUNK).filter(belongs).collect();
    if config.cluster == ClusterMode::Off || kept.is_empty() {
        return Ok(kept);
    }
    let rows: Vec<[f64; 3]> = kept.iter().map(|&i| points[i as usize]).collect();
    let distance = (params.cluster_distance * diameter).max(3.0 * voxel_size);
    let clusters = main_cluster(&rows, &ClusterParams { distance, keep_ratio: params.cluster_ratio })?;
    // A face deep inside, seen through an opening, is a small piece of its own, within or just beside the box of the rest.
    let (lower, upper) = bounds(rows.iter().zip(&clusters.labels).filter(|(_, l)| **l == 0).map(|(p, _)| p));
    let inside = |p: &[f64; 3]| {
        (0..3).all(|axis| lower[axis] - distance <= p[axis] && p[axis] <= upper[axis] + distance)
    };
    let mut kept_labels: Vec<bool> =
        clusters.sizes.iter().map(|&size| size as f64 >= ENCLOSED * clusters.sizes[0] as f64).collect();
    for (point, &label) in rows.iter().zip(&clusters.labels) {
        kept_labels[label as usize] &= inside(point);
    }
    clusters.kept.iter().for_each(|&i| kept_labels[clusters.labels[i as usize] as usize] = true);
    let chosen = kept.iter().zip(&clusters.labels).filter(|(_, label)| kept_labels[**label as usize]);
    Ok(chosen.map(|(&i, _)| i).collect())
}

/// Lower and upper corner of the box about some points.
fn bounds<'a>(points: impl Iterator<Item = &'a [f64; 3]>) -> ([f64; 3], [f64; 3]) {
    points.fold(([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]), |(lower, upper), p| {
        (array::from_fn(|i| lower[i].min(p[i])), array::from_fn(|i| upper[i].max(p[i])))
    })
}

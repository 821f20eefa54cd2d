//! Which voxels belong to the part: stray points are told from it by density, by their distance from the surface around
//! them, by rays that went on behind them, and by what they hang together with.

use std::array;

use nalgebra::Vector3;
use rayon::prelude::*;

use crate::config::{ClusterMode, Config, OutlierParams};
use crate::error::Result;
use crate::median::median;
use crate::preprocess::{CHUNK, ClusterParams, KNeighbors, Normals, main_cluster, statistical_inliers};
use crate::symmetry::visibility::{Seen, Visibility};

/// Surface variation up to which a neighbourhood is flat: noise and curvature stay below.
const FLAT: f64 = 0.03;

/// Size at which a cluster within reach of the box of the main one is kept beside it [share of the main one].
const ENCLOSED: f64 = 0.002;

/// How far beyond that box [gaps between clusters].
const REACH: f64 = 3.0;

/// Voxels that lie on some surface, ascending: those that are not alone, scattered in space or off the plane of their
/// neighbours.
pub(crate) fn on_surfaces(
    neighbors: &KNeighbors,
    Normals { surface_variation, deviation, .. }: &Normals,
    viewpoints: bool,
    voxel_size: f64,
    params: &OutlierParams,
) -> Result<Vec<u32>> {
    let strays = Strays::new(neighbors, surface_variation, params);
    let radius_sq = (strays.leniency * params.radius * voxel_size).powi(2);
    let crowded = |i: usize| reach_sq(neighbors, params, i) <= radius_sq;
    let sparse_plane = |i: usize| params.scattered.is_some() && surface_variation[i] <= FLAT;
    // Without viewpoints the fine voxels of a thin wall lie on two surfaces at once, each off the other one.
    let limit = params.off_surface.filter(|_| viewpoints).unwrap_or(f64::INFINITY);
    let statistical = params.statistical(strays.leniency);
    let mut regular = vec![false; neighbors.len()];
    statistical_inliers(neighbors, &statistical)?.iter().for_each(|&i| regular[i as usize] = true);
    let dense = |i: usize| crowded(i) && !strays.scattered[i] && (regular[i] || sparse_plane(i));
    let kept = (0..neighbors.len()).filter(|&i| dense(i) && deviation[i] <= limit);
    Ok(kept.map(|i| i as u32).collect())
}

/// Those of the voxels `kept` that belong to the part, ascending: no camera saw through them, and they hang together with
/// the main cluster or lie within reach of it.
pub(crate) fn of_part(
    points: &[[f64; 3]],
    kept: Vec<u32>,
    visibility: Option<&Visibility>,
    voxel_size: f64,
    diameter: f64,
    config: &Config,
) -> Result<Vec<u32>> {
    let params = &config.outliers;
    let looked_through = visibility.filter(|_| params.seen_through);
    let solid = |&i: &u32| {
        let point = Vector3::from(points[i as usize]);
        looked_through
            .is_none_or(|v| v.seen(&point, None, params.radius * voxel_size, |_| false) != Seen::Free)
    };
    let kept: Vec<u32> = kept.into_par_iter().with_min_len(CHUNK).filter(solid).collect();
    if config.cluster == ClusterMode::Off || kept.is_empty() {
        return Ok(kept);
    }
    let rows: Vec<[f64; 3]> = kept.iter().map(|&i| points[i as usize]).collect();
    let distance = (params.cluster_distance * diameter).max(3.0 * voxel_size);
    let clusters = main_cluster(&rows, &ClusterParams { distance, keep_ratio: params.cluster_ratio })?;
    let reach = REACH * distance;
    // A face deep inside, seen through an opening, is a small piece of its own, within or just beside the box of the rest.
    let (lower, upper) = bounds(rows.iter().zip(&clusters.labels).filter(|(_, l)| **l == 0).map(|(p, _)| p));
    let inside =
        |p: &[f64; 3]| (0..3).all(|axis| lower[axis] - reach <= p[axis] && p[axis] <= upper[axis] + reach);
    let mut kept_labels: Vec<bool> =
        clusters.sizes.iter().map(|&size| size as f64 >= ENCLOSED * clusters.sizes[0] as f64).collect();
    for (point, &label) in rows.iter().zip(&clusters.labels) {
        kept_labels[label as usize] &= inside(point);
    }
    clusters.kept.iter().for_each(|&i| kept_labels[clusters.labels[i as usize] as usize] = true);
    let chosen = kept.iter().zip(&clusters.labels).filter(|(_, label)| kept_labels[**label as usize]);
    Ok(chosen.map(|(&i, _)| i).collect())
}

/// Squared distance of voxel `i` from the farthest of the neighbours that it must have; 0 where there are no more points.
fn reach_sq(neighbors: &KNeighbors, params: &OutlierParams, i: usize) -> f64 {
    // A point is its own first neighbour.
    neighbors.of(i).1.get(params.min_neighbors).copied().unwrap_or(0.0)
}

/// What the distances to the nearest neighbours say about strays.
struct Strays {
    /// Points whose nearest neighbours are far away and on all sides; far away in one plane they are a sparse surface.
    scattered: Vec<bool>,
    /// What the limits of all filters of density are multiplied by: few strays are far from each other.
    leniency: f64,
}

impl Strays {
    fn new(neighbors: &KNeighbors, surface_variation: &[f64], params: &OutlierParams) -> Self {
        /// Share of scattered points beyond which strays are many, so that they are near each other and near the surface.
        const MANY: f64 = 0.05;
        /// Where they are few.
        const LENIENT: f64 = 1.6;
        let count = surface_variation.len();
        let reach_sq = |i: usize| reach_sq(neighbors, params, i);
        let mut flat: Vec<f64> = (0..count).filter(|&i| surface_variation[i] <= FLAT).map(reach_sq).collect();
        let Some((limit, typical_sq)) = params.scattered.zip(median(&mut flat)) else {
            return Self { scattered: vec![false; count], leniency: 1.0 };
        };
        let beyond = |limit: f64| -> Vec<bool> {
            let widest_sq = limit * limit * typical_sq;
            (0..count).map(|i| surface_variation[i] > FLAT && reach_sq(i) > widest_sq).collect()
        };
        let scattered = beyond(limit);
        let many = scattered.iter().filter(|&&stray| stray).count() as f64 > MANY * count as f64;
        if many {
            Self { scattered, leniency: 1.0 }
        } else {
            Self { scattered: beyond(LENIENT * limit), leniency: LENIENT }
        }
    }
}

/// Lower and upper corner of the box about some points.
fn bounds<'a>(points: impl Iterator<Item = &'a [f64; 3]>) -> ([f64; 3], [f64; 3]) {
    points.fold(([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]), |(lower, upper), p| {
        (array::from_fn(|i| lower[i].min(p[i])), array::from_fn(|i| upper[i].max(p[i])))
    })
}

//! Which voxels belong to the part: stray points are told from it by density, by their distance from the surface around
//! them, by rays that went on behind them, and by what they hang together with.

use std::array;

use nalgebra::Vector3;
use rayon::prelude::*;

use super::gaps::Gaps;
use super::resolution::sparseness;
use super::scene::{Scene, enough};
use super::stacks::PIECE;
use super::voxels::Voxels;
use crate::config::{ClusterMode, Config, OutlierParams};
use crate::error::Result;
use crate::median::median;
use crate::preprocess::{
    CHUNK, ClusterParams, KNeighbors, NormalParams, Normals, enough_neighbors, main_cluster,
    normals_from_neighbors, statistical_inliers,
};
use crate::spatial::KdTree;
use crate::stages::Stages;
use crate::symmetry::visibility::{Seen, Visibility};

/// Surface variation up to which a neighbourhood is flat: noise and curvature stay below.
const FLAT: f64 = 0.03;

/// Size at which a cluster within reach of the box of the main one is kept beside it [share of the main one].
const ENCLOSED: f64 = 0.002;

/// How far beyond that box [gaps between clusters].
const REACH: f64 = 3.0;

/// Mean number of points in a voxel below which, with several views, many voxels of the surface are empty: how the points of
/// different views fall together is chance. Those of a single view lie in even rows and leave few voxels empty.
const SPARSE: f64 = 1.6;

/// What was found while voxels were told from strays.
pub(super) struct Cleaned {
    /// Neighbours of every voxel.
    pub(super) neighbors: KNeighbors,
    /// Normal of the plane through them.
    pub(super) normals: Vec<[f64; 3]>,
    /// Spacing of the points of the surface \[length\]: the edge of a voxel, more where these lie in lines far apart.
    pub(super) spacing: f64,
    /// How far apart the voxels lie, at least 1 [their distance where every voxel of the surface has a point].
    pub(super) sparseness: f64,
    /// Whether noise asks for planes of more neighbours than usual.
    pub(super) noisy: bool,
    /// What the cameras saw to be empty.
    pub(super) visibility: Option<Visibility>,
    /// Voxels of the part, ascending.
    pub(super) kept: Vec<u32>,
}

/// Tells which voxels are of the part; `region` are the rows of the cloud around it, where something was cut off, and
/// `is_isolated` says that what stands apart from it on its support was left out.
pub(super) fn clean(
    part: &Scene,
    region: Option<&[u32]>,
    is_isolated: bool,
    voxels: &Voxels,
    diameter: f64,
    config: &Config,
    stages: &mut Stages,
) -> Result<Cleaned> {
    let Voxels { grid, size: voxel_size, layered, .. } = voxels;
    let oriented = part.is_oriented();
    let tree = KdTree::new(&grid.points)?;
    let (least, params) = if *layered {
        let fullness = part.points.len() as f64 / grid.points.len() as f64;
        let has_gaps = fullness < SPARSE && part.places.len() > 1;
        (in_one_layer(config.normals.k), outliers_in_one_layer(&config.outliers, has_gaps))
    } else {
        (config.normals.k, config.outliers.clone())
    };
    // Without viewpoints nothing contradicts the planes that wide neighbourhoods show in mere noise.
    let k = if oriented {
        let mut seen = vec![0; grid.points.len()];
        (0_u32..).zip(&grid.inverse).for_each(|(i, &voxel)| seen[voxel as usize] = i);
        let viewpoint = |voxel: usize| part.viewpoint(seen[voxel] as usize).unwrap_or_default();
        enough_neighbors(&grid.points, viewpoint, &tree, least, &config.smoothing)
    } else {
        least
    };
    stages.number("plane_neighbors", k as f64);
    let planes_through = |k: usize| -> Result<(KNeighbors, Normals)> {
        let neighbors = KNeighbors::new(&tree, &grid.points, k.max(params.k))?;
        stages.check()?;
        let of_k = NormalParams { k, ..config.normals.clone() };
        let planes = normals_from_neighbors(&grid.points, &neighbors, &of_k)?;
        stages.check()?;
        Ok((neighbors, planes))
    };
    let gaps_by = |planes: &Normals| Gaps::between(&grid.points, &planes.normals, &tree, *voxel_size);
    let (mut neighbors, mut planes) = planes_through(k)?;
    let mut spacing = *voxel_size;
    if let Some(rough) = gaps_by(&planes) {
        // Points of one line have no plane.
        let (wider, across) = planes_through(rough.neighbors_across().max(k))?;
        if let Some(gaps) = gaps_by(&across).filter(|gaps| gaps.are_narrow(diameter)) {
            (neighbors, planes, spacing) = (wider, across, gaps.spacing());
        }
    }
    stages.number("spacing", spacing);
    let on_surface = on_surfaces(&neighbors, &planes, oriented, *voxel_size, &params)?;
    let visibility = part.sight(region, grid, &on_surface, &planes.normals);
    stages.check()?;
    let cluster_ratio = config.outliers.cluster_ratio.min(if is_isolated { PIECE } else { f64::INFINITY });
    let visible = visibility.as_ref();
    let kept = of_part(&grid.points, on_surface, visible, *voxel_size, diameter, cluster_ratio, config)?;
    stages.number("surface_points", kept.len() as f64);
    enough("outliers", kept.len())?;
    let sparseness = sparseness(&neighbors, *voxel_size);
    Ok(Cleaned {
        neighbors,
        normals: planes.normals,
        spacing,
        sparseness,
        noisy: k > least,
        visibility,
        kept,
    })
}

/// Neighbours that reach as far, where the layers of a surface are joined, as `k` of them otherwise.
fn in_one_layer(k: usize) -> usize {
    (3 * k / 5).max(k.min(3))
}

/// Limits that tell as much where the layers of a surface are joined as `params` do otherwise.
fn outliers_in_one_layer(params: &OutlierParams, has_gaps: bool) -> OutlierParams {
    /// Its points are as far from each other as voxels are, but strays in space are as far as ever.
    const CLOSER: f64 = 0.75;
    let closer = if has_gaps { 1.0 } else { CLOSER };
    OutlierParams {
        k: in_one_layer(params.k).max(params.min_neighbors + 1),
        radius: closer * params.radius,
        scattered: params.scattered.map(|limit| closer * limit),
        ..params.clone()
    }
}

/// Voxels that lie on some surface, ascending: those that are not alone, scattered in space or off the plane of their
/// neighbours.
fn on_surfaces(
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
fn of_part(
    points: &[[f64; 3]],
    kept: Vec<u32>,
    visibility: Option<&Visibility>,
    voxel_size: f64,
    diameter: f64,
    cluster_ratio: f64,
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
    let clusters = main_cluster(&rows, &ClusterParams { distance, keep_ratio: cluster_ratio })?;
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
pub(super) fn bounds<'a>(points: impl Iterator<Item = &'a [f64; 3]>) -> ([f64; 3], [f64; 3]) {
    points.fold(([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]), |(lower, upper), p| {
        (array::from_fn(|i| lower[i].min(p[i])), array::from_fn(|i| upper[i].max(p[i])))
    })
}

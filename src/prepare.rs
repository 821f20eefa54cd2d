//! From the raw cloud to the surface of the part: region, frame, ground, voxels, outliers, cluster, normals.

use nalgebra::{Isometry3, Vector3};

use crate::clean::{of_part, on_surfaces};
use crate::cloud::PointCloud;
use crate::config::{ClusterMode, Config, NonFinite, OutlierParams, TrackingParams};
use crate::error::{Error, Result};
use crate::preprocess::{
    Ground, GroundParams, KNeighbors, Layers, NormalParams, Sides, SmoothingParams, enough_neighbors,
    find_ground, mean_heights, means, normals_from_neighbors, separate_sides, single_viewpoint,
    voxel_downsample, voxel_layers,
};
use crate::resolution::{COARSE, FINE, LAYERED, default_voxel, sparseness, width};
use crate::scene::{Scene, enough};
use crate::spatial::KdTree;
use crate::stages::Stages;
use crate::symmetry::axis::Axis;
use crate::symmetry::score::MatchScore;
use crate::symmetry::sight::Sight;
use crate::symmetry::surface::{Samples, Surface};
use crate::symmetry::visibility::Visibility;

/// The surface of the part in a frame that turns with the data, and where it came from.
pub(crate) struct Prepared {
    /// World from the local frame in which everything below is given.
    pub world_from_local: Isometry3<f64>,
    /// The part.
    pub surface: Surface,
    /// Its points as they were measured; those of the surface may be smoothed \[length\].
    pub measured: Vec<Vector3<f64>>,
    /// Size of the part \[length\].
    pub diameter: f64,
    /// Edge of a voxel \[length\].
    pub voxel_size: f64,
    /// How far apart the points of the surface lie, at least 1 [their distance where every voxel has one].
    pub sparseness: f64,
    /// Input rows behind the surface, ascending.
    pub inliers: Vec<u32>,
    /// For each of them its point of the surface.
    pub point_of_inlier: Vec<u32>,
    /// The support plane, local frame.
    pub ground: Option<[f64; 4]>,
    /// What the cameras saw to be empty.
    pub visibility: Option<Visibility>,
    /// Whether normals point outward, since viewpoints are known.
    pub outward: bool,
    /// Mean unit direction from the part to its sensors, short when they stand all round.
    pub toward_sensors: Option<Vector3<f64>>,
}

impl Prepared {
    /// How far to trust an axis about which this became of the rotated points, in [0, 1].
    pub(crate) fn trust(&self, score: &MatchScore) -> f64 {
        score.trust(self.visibility.is_some())
    }

    /// Whether a single view, whose place is known, shows all there is.
    pub(crate) fn one_view(&self) -> bool {
        self.visibility.as_ref().is_some_and(|visibility| visibility.views() == 1)
    }

    /// What the cameras say about places near `axis`.
    pub(crate) fn sight(&self, axis: &Axis) -> Sight<'_> {
        Sight::about(axis, &self.surface, self.visibility.as_ref())
    }
}

/// Runs all stages before the search for the axis; with `tracking` on fewer points.
pub(crate) fn prepare(
    cloud: &PointCloud,
    config: &Config,
    tracking: Option<&TrackingParams>,
    stages: &mut Stages,
) -> Result<Prepared> {
    if config.non_finite == NonFinite::Error && cloud.dropped() > 0 {
        return Err(Error::NonFinite {
            count: cloud.dropped(),
            total: cloud.dropped() + cloud.far() + cloud.len(),
        });
    }
    stages.number("input_points", cloud.len() as f64);
    stages.number("non_finite_points", cloud.dropped() as f64);
    stages.number("far_points", cloud.far() as f64);
    let scene = Scene::new(cloud, config)?;

    stages.begin("ground")?;
    let ground = find_support(&scene, config)?;
    let (part, mut region) = match &ground {
        Some(Ground { kept, reason, removed, .. }) => {
            stages.text("ground", reason);
            stages.number("ground_points", *removed as f64);
            let region = scene.rows.clone();
            let scene = scene.select(kept);
            let part = match config.cluster {
                ClusterMode::Main => scene.isolated(&config.outliers)?,
                ClusterMode::Off => scene,
            };
            (part, Some(region))
        }
        None => (scene, None),
    };
    let mut part = match tracking {
        Some(TrackingParams { points, .. }) => part.thinned(*points, &mut region),
        None => part,
    };
    enough("ground", part.points.len())?;

    stages.begin("downsample")?;
    let diameter = width(&part.points);
    let outward = cloud.has_viewpoints();
    if !outward && config.smoothing.assume_view {
        // Points too far apart for small voxels may suit those that the caller chose.
        let place = single_viewpoint(&part.points, diameter).unwrap_or(None);
        part.places.extend(place.map(Vector3::from));
        stages.flag("one_view_assumed", !part.places.is_empty());
    }
    let oriented = !part.places.is_empty();
    let layered = oriented && config.smoothing.join_layers;
    let resolution = match (oriented, layered) {
        (true, true) => LAYERED,
        (true, false) => COARSE,
        (false, _) => FINE,
    };
    let voxel_size = match config.voxel_size {
        Some(size) => size,
        None => {
            let coarsening = tracking.map_or(1.0, |tracking| tracking.coarsening);
            default_voxel(&part.points, diameter, resolution.coarser(coarsening))?
        }
    };
    // The points as they were measured, where those of the part are averaged along their rays.
    let mut measured = None;
    let SmoothingParams { ray_noise, ray_neighbors, .. } = config.smoothing;
    if layered && outward && ray_neighbors > 0 {
        let noise = part.noise_along_rays(ray_neighbors)?;
        stages.number("ray_noise", noise);
        if noise > ray_noise * diameter {
            stages.check()?;
            let smooth = part.smoothed_along_rays(ray_neighbors)?;
            measured = Some(std::mem::replace(&mut part.points, smooth));
        }
    }
    let grid = if layered {
        let viewpoint = |i| part.viewpoint(i).unwrap_or_default();
        let Layers { grid, noise } = voxel_layers(&part.points, viewpoint, voxel_size)?;
        stages.number("noise", noise);
        grid
    } else {
        voxel_downsample(&part.points, voxel_size)?
    };
    stages.flag("smoothed_along_rays", measured.is_some());
    stages.number("voxel_size", voxel_size);
    stages.number("voxel_points", grid.points.len() as f64);
    enough("downsample", grid.points.len())?;

    stages.begin("outliers")?;
    let tree = KdTree::new(&grid.points)?;
    let (least, outliers) = if layered {
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
    let neighbors = KNeighbors::new(&tree, &grid.points, k.max(outliers.k))?;
    let sparseness = sparseness(&neighbors, voxel_size);
    stages.check()?;
    let planes =
        normals_from_neighbors(&grid.points, &neighbors, &NormalParams { k, ..config.normals.clone() })?;
    stages.check()?;
    let on_surface = on_surfaces(&neighbors, &planes, oriented, voxel_size, &outliers)?;
    let visibility = part.sight(region.as_deref(), &grid, &on_surface);
    stages.check()?;
    let kept = of_part(&grid.points, on_surface, visibility.as_ref(), voxel_size, diameter, config)?;
    let normals = planes.normals;
    stages.number("surface_points", kept.len() as f64);
    enough("outliers", kept.len())?;

    stages.begin("normals")?;
    let voxels = grid.points.len();
    let mut sides = if oriented {
        let viewpoint = |i| part.viewpoint(i).unwrap_or_default();
        let sides = separate_sides(&part.points, viewpoint, &grid, &normals, &neighbors);
        // A number for each raw point, which is no longer needed.
        drop(grid);
        sides
    } else {
        Sides {
            voxel_of: (0..grid.points.len() as u32).collect(),
            points: grid.points,
            normals,
            patch_of_point: grid.inverse,
            ..Sides::default()
        }
    };
    stages.number("voxels_seen_from_both_sides", sides.divided as f64);
    if let Some(given) = &part.normals {
        replace_by_given(&mut sides.normals, given, &sides.patch_of_point);
    }

    let mut is_kept = vec![false; voxels];
    kept.iter().for_each(|&voxel| is_kept[voxel as usize] = true);
    // Without viewpoints nothing tells the sides of a thin wall apart.
    let heights = (config.smoothing.max_angle.filter(|_| oriented))
        .map_or_else(Vec::new, |max_angle| mean_heights(&sides, &is_kept, &neighbors, max_angle));
    let chosen: Vec<u32> = (0_u32..)
        .zip(&sides.voxel_of)
        .filter(|(_, voxel)| is_kept[**voxel as usize])
        .map(|(patch, _)| patch)
        .collect();
    let mut surface_of_patch = vec![u32::MAX; sides.points.len()];
    for (surface, &patch) in (0_u32..).zip(&chosen) {
        surface_of_patch[patch as usize] = surface;
    }
    let mut inliers = Vec::with_capacity(part.rows.len());
    let mut point_of_inlier = Vec::with_capacity(part.rows.len());
    for (&row, &patch) in part.rows.iter().zip(&sides.patch_of_point) {
        let point = surface_of_patch[patch as usize];
        if point != u32::MAX {
            inliers.push(cloud.input_index()[row as usize]);
            point_of_inlier.push(point);
        }
    }
    let pick =
        |rows: &[[f64; 3]]| chosen.iter().map(|&i| Vector3::from(rows[i as usize])).collect::<Vec<_>>();
    let points = pick(&sides.points);
    let measured = match measured {
        Some(measured) => pick(&means(&measured, &sides.patch_of_point, sides.points.len()).0),
        None => points.clone(),
    };
    let mut samples = Samples { points, normals: pick(&sides.normals) };
    let mut heights: Vec<f64> =
        chosen.iter().filter_map(|&patch| heights.get(patch as usize).copied()).collect();
    if k > least {
        // Matches of single points are lost in this much noise.
        let Samples { points, normals } = &mut samples;
        points.iter_mut().zip(normals).zip(heights.drain(..)).for_each(|((p, n), height)| *p += *n * height);
    }
    let toward_sensors = outward.then(|| {
        let directions = pick(&sides.viewpoints)
            .into_iter()
            .zip(&samples.points)
            .filter_map(|(v, p)| (v - p).try_normalize(0.0));
        directions.sum::<Vector3<f64>>() / samples.points.len() as f64
    });
    let mut surface = Surface::new(samples, oriented, voxel_size, config.propose.gate * diameter);
    surface.heights = heights;
    surface.assumed_view = part.places.first().copied().filter(|_| !outward);
    Ok(Prepared {
        world_from_local: nalgebra::Translation3::from(Vector3::from(cloud.origin())) * part.frame,
        surface,
        measured,
        diameter,
        voxel_size,
        sparseness,
        inliers,
        point_of_inlier,
        ground: ground.map(|g| g.plane),
        visibility,
        outward,
        toward_sensors,
    })
}

/// How far around a region of interest its support is looked for [extents of the region].
const WIDER: [f64; 2] = [0.5, 2.0];

/// The plane that the part stands on; its `kept` and `removed` are of the points of `scene`.
fn find_support(scene: &Scene, config: &Config) -> Result<Option<Ground>> {
    let params = GroundParams { seed: config.seed, ..config.plane.clone() };
    let find = |scene: &Scene| find_ground(&scene.points, |i| scene.viewpoint(i), &params, config.ground);
    let within = find(scene)?;
    let Some(roi) = config.roi.filter(|_| within.is_none()) else { return Ok(within) };
    // A box about the part leaves so little of its support that this looks like a face of the part.
    for times in WIDER {
        let around = scene.with_surroundings(roi, times);
        if let Some(ground) = find(&around)? {
            let kept = scene.shared(&around, &ground.kept);
            let removed = scene.points.len() - kept.len();
            return Ok(enough("ground", kept.len()).is_ok().then_some(Ground { kept, removed, ..ground }));
        }
    }
    Ok(None)
}

/// Neighbours that reach as far, where the layers of a surface are joined, as `k` of them otherwise.
fn in_one_layer(k: usize) -> usize {
    (3 * k / 5).max(k.min(3))
}

/// Points in a voxel, on average, below which many voxels of the surface have none where several views fall at random on one
/// another; those of one view lie in even rows.
const SPARSE: f64 = 1.6;

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

/// Normals given by the caller win over estimated ones where there are any; those of a patch are made to agree first.
fn replace_by_given(normals: &mut [[f64; 3]], given: &[[f64; 3]], patch_of_point: &[u32]) {
    let mut sums = vec![Vector3::zeros(); normals.len()];
    for (row, &patch) in given.iter().zip(patch_of_point) {
        let n = Vector3::from(*row);
        let sum: &mut Vector3<f64> = &mut sums[patch as usize];
        *sum += if sum.dot(&n) < 0.0 { -n } else { n };
    }
    for (normal, sum) in normals.iter_mut().zip(sums) {
        if let Some(unit) = sum.try_normalize(1e-9) {
            // Where the sensors are known, the estimated normal points toward them.
            let agrees = unit.dot(&Vector3::from(*normal)) >= 0.0;
            *normal = if agrees { unit } else { -unit }.into();
        }
    }
}

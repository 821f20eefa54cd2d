//! From the raw cloud to the surface of the part: region, frame, ground, voxels, outliers, cluster, normals.

mod clean;
mod cut_out;
mod foreground;
mod gaps;
mod patches;
mod resolution;
mod scene;
mod stacks;
mod voxels;

use nalgebra::{Isometry3, Translation3, Vector3};

use crate::cloud::PointCloud;
use crate::config::{Config, NonFinite, TrackingParams};
use crate::error::{Error, Result};
use crate::preprocess::{Ground, Support};
use crate::stages::Stages;
use crate::symmetry::axis::Axis;
use crate::symmetry::pieces::has_piece_apart;
use crate::symmetry::score::MatchScore;
use crate::symmetry::sight::Sight;
use crate::symmetry::surface::Surface;
use crate::symmetry::view_errors::ViewErrors;
use crate::symmetry::visibility::Visibility;
use clean::{Cleaned, clean};
use cut_out::{Part, cut_out, find_under};
use foreground::foreground;
use patches::Patches;
use resolution::width;
use scene::{Scene, enough};
use voxels::Voxels;

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
    /// Size of the largest other thing on it, which was left out \[share of the part\].
    pub beside: f64,
    /// What the cameras saw to be empty.
    pub visibility: Option<Visibility>,
    /// How far the views are off their places, where there are several.
    pub view_errors: Option<ViewErrors>,
    /// Whether normals point outward, since viewpoints are known.
    pub outward: bool,
    /// Mean unit direction from the part to its sensors, short when they stand all round.
    pub toward_sensors: Option<Vector3<f64>>,
    /// Distance of the nearest and of the farthest sensor from the middle of the part, where they are known [diameters].
    pub sensor_distances: Option<[f64; 2]>,
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

    /// Whether several views, whose places are known, show it.
    pub(crate) fn several_views(&self) -> bool {
        self.visibility.as_ref().is_some_and(|visibility| visibility.views() > 1)
    }

    /// Whether a large piece of what several views show is far from all the rest. In one view the head of a part may hide its
    /// neck, so that its foot seems to be far away.
    pub(crate) fn has_piece_apart(&self) -> Result<bool> {
        Ok(self.several_views() && has_piece_apart(&self.surface, self.diameter)?)
    }

    /// The same, as seen by a view that loses returns in patches.
    pub(crate) fn patchy(self) -> Self {
        Self { visibility: self.visibility.map(Visibility::patchy), ..self }
    }

    /// What the cameras say about places near `axis`.
    pub(crate) fn sight(&self, axis: &Axis) -> Sight<'_> {
        Sight::about(axis, &self.surface, self.visibility.as_ref())
    }
}

/// Depth below the support plane from which on nothing can be of the part [diameters]; rough axes bring right points there.
const SUNK: f64 = 0.03;

/// What is left out of a scene before the part is looked for.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LeftOut {
    /// What the part stands on.
    pub support: Option<Support>,
    /// What the border of the view shows, where something stands free before it.
    pub background: bool,
}

/// Runs all stages before the search for the axis on what is not `left_out`; with `tracking` on fewer points.
pub(crate) fn prepare(
    cloud: &PointCloud,
    config: &Config,
    left_out: LeftOut,
    tracking: Option<&TrackingParams>,
    stages: &mut Stages,
) -> Result<Prepared> {
    count_points(cloud, config, stages)?;
    let scene = Scene::new(cloud, config)?;

    stages.begin("ground")?;
    let Part { scene: mut part, ground, mut region, beside } = cut_out(scene, left_out, config, stages)?;
    if let Some(TrackingParams { points, .. }) = tracking {
        part = part.thinned(*points, &mut region);
    }
    enough("ground", part.points.len())?;

    stages.begin("downsample")?;
    let diameter = width(&part.points);
    let voxels = Voxels::new(&mut part, diameter, config, tracking, stages)?;
    let voxel_size = voxels.size;

    stages.begin("outliers")?;
    let cleaned = clean(&part, region.as_deref(), ground.is_some(), &voxels, diameter, config, stages)?;

    stages.begin("normals")?;
    let patches = Patches::new(&part, voxels, &cleaned, &config.smoothing, stages);
    let widest_gate = f64::max(config.propose.gate * diameter, config.refine.first_gate(cleaned.spacing));
    // None keeps both threads of a small machine busy.
    let (mut surface, (looks, (inliers, point_of_inlier))) = rayon::join(
        || patches.surface(cleaned.spacing, widest_gate),
        || rayon::join(|| patches.looks(&part), || patches.inliers(&part)),
    );
    let view_errors = looks.map(|looks| ViewErrors::measure(looks, &surface));
    surface.assumed_view = part.assumed_view();
    let toward_sensors = part.has_viewpoints().then(|| patches.toward_sensors(&surface.samples.points));
    let sensor_distances = part.has_viewpoints().then(|| {
        let distances = part.places.iter().map(|place| (place - surface.centroid).norm() / diameter);
        distances.fold([f64::INFINITY, 0.0], |[least, most], d| [d.min(least), d.max(most)])
    });
    let measured = patches.measured();
    let Cleaned { sparseness, visibility, .. } = cleaned;
    let supported = |visibility: Visibility| match ground {
        Some(plane) => visibility.supported_by(plane, SUNK * diameter),
        None => visibility,
    };
    Ok(Prepared {
        world_from_local: Translation3::from(Vector3::from(cloud.origin())) * part.frame,
        surface,
        measured,
        diameter,
        voxel_size,
        sparseness,
        inliers,
        point_of_inlier,
        ground,
        beside,
        visibility: visibility.map(supported),
        view_errors,
        outward: part.has_viewpoints(),
        toward_sensors,
        sensor_distances,
    })
}

/// Whether something stands free before a background that fills the border of the view.
pub(crate) fn has_background(cloud: &PointCloud, config: &Config) -> Result<bool> {
    let scene = Scene::new(cloud, config)?;
    Ok(foreground(&scene, config.outliers.cluster_distance)?.is_some())
}

/// The plate, with its sides in sight, that the part may be fixed to.
pub(crate) fn find_plate(cloud: &PointCloud, config: &Config) -> Result<Option<Plate>> {
    let scene = Scene::new(cloud, config)?;
    let plate = find_under(&scene, Support::Plate, config)?;
    Ok(plate.map(|Ground { plane: [x, y, z, d], .. }| {
        let is_above = |place: &Vector3<f64>| Vector3::new(x, y, z).dot(place) + d > 0.0;
        Plate { is_seen_from_above: scene.has_viewpoints() && scene.places.iter().all(is_above) }
    }))
}

/// A plate that a part may be fixed to, or that is a piece of it.
pub(crate) struct Plate {
    /// Whether all sensors stood above it, as where it is fixed itself.
    pub(crate) is_seen_from_above: bool,
}

/// Notes how many points there are, and fails where some are not finite and none may be.
fn count_points(cloud: &PointCloud, config: &Config, stages: &mut Stages) -> Result<()> {
    if config.non_finite == NonFinite::Error && cloud.dropped() > 0 {
        let total = cloud.dropped() + cloud.far() + cloud.coinciding() + cloud.len();
        return Err(Error::NonFinite { count: cloud.dropped(), total });
    }
    stages.number("input_points", cloud.len() as f64);
    stages.number("non_finite_points", cloud.dropped() as f64);
    stages.number("far_points", cloud.far() as f64);
    stages.number("coinciding_points", cloud.coinciding() as f64);
    Ok(())
}

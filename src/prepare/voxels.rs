//! The points of the part, a voxel at a time: where one view must have seen all of it, how large a voxel is, whether noise
//! is averaged along the rays first, and whether the layers that it makes of a surface are joined.

use nalgebra::Vector3;

use super::resolution::{COARSE, FINE, LAYERED, default_voxel};
use super::scene::{Scene, enough};
use crate::config::{Config, TrackingParams};
use crate::error::{Error, Result, shown};
use crate::preprocess::{
    Layers, SmoothingParams, VoxelGrid, single_viewpoint, voxel_downsample, voxel_layers,
};
use crate::stages::Stages;

/// The voxels of the part.
pub(super) struct Voxels {
    /// Their means, and the voxel of each point of the part.
    pub(super) grid: VoxelGrid,
    /// Edge of a voxel \[length\].
    pub(super) size: f64,
    /// Whether there is one layer of voxels to a surface, however much noise spreads it.
    pub(super) layered: bool,
    /// The points of the part as they were measured, where they are averaged along their rays now \[length\].
    pub(super) measured: Option<Vec<[f64; 3]>>,
}

impl Voxels {
    /// The voxels of `part`, which is `diameter` wide; with `tracking` larger ones. The part may get the place of a view that
    /// is assumed, and points that are averaged along their rays.
    pub(super) fn new(
        part: &mut Scene,
        diameter: f64,
        config: &Config,
        tracking: Option<&TrackingParams>,
        stages: &mut Stages,
    ) -> Result<Self> {
        let SmoothingParams { assume_view, join_layers, ray_noise, ray_neighbors, .. } = config.smoothing;
        if !part.has_viewpoints() && assume_view {
            // Points too far apart for small voxels may suit those that the caller chose.
            let place = single_viewpoint(&part.points, diameter).unwrap_or(None);
            part.places.extend(place.map(Vector3::from));
            stages.flag("one_view_assumed", place.is_some());
        }
        let layered = part.is_oriented() && join_layers;
        // A size that the caller did not choose is none to blame: the points are too far apart for it.
        let blame = |error: Error| match error {
            Error::InvalidParameter { .. } if config.voxel_size.is_none() => Error::InvalidParameter {
                name: "points",
                value: format!(
                    "thousands of times as wide as the part, whose diameter is {}",
                    shown(diameter)
                ),
                expected: "points on the part and near it; remove what lies far away, or set roi or voxel_size",
            },
            error => error,
        };
        let size = match config.voxel_size {
            Some(size) => size,
            None => {
                let resolution = match (part.is_oriented(), layered) {
                    (true, true) => LAYERED,
                    (true, false) => COARSE,
                    (false, _) => FINE,
                };
                let coarsening = tracking.map_or(1.0, |tracking| tracking.coarsening);
                default_voxel(&part.points, diameter, resolution.coarser(coarsening)).map_err(blame)?
            }
        };
        let mut measured = None;
        if layered && part.has_viewpoints() && ray_neighbors > 0 {
            let noise = part.noise_along_rays(ray_neighbors)?;
            stages.number("ray_noise", noise);
            if noise > ray_noise * diameter {
                stages.check()?;
                let smooth = part.smoothed_along_rays(ray_neighbors)?;
                measured = Some(std::mem::replace(&mut part.points, smooth));
            }
        }
        stages.flag("smoothed_along_rays", measured.is_some());
        let grid = if layered {
            let viewpoint = |i| part.viewpoint(i).unwrap_or_default();
            let Layers { grid, noise } = voxel_layers(&part.points, viewpoint, size).map_err(blame)?;
            stages.number("noise", noise);
            grid
        } else {
            voxel_downsample(&part.points, size).map_err(blame)?
        };
        stages.number("voxel_size", size);
        stages.number("voxel_points", grid.points.len() as f64);
        enough("downsample", grid.points.len())?;
        Ok(Self { grid, size, layered, measured })
    }
}

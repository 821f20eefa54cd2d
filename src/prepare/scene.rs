//! What is left of a cloud while the part is cut out of it, in a frame that turns with the data.

use std::borrow::Cow;

use nalgebra::{Isometry3, Point3, Translation3, Vector3};
use rayon::prelude::*;

use super::resolution::width;
use super::stacks::{Floor, largest_stack};
use crate::cloud::PointCloud;
use crate::config::{Config, OutlierParams};
use crate::error::{Error, Result};
use crate::frames::principal_frame;
use crate::picture::Picture;
use crate::preprocess::{
    CHUNK, ClusterParams, VoxelGrid, main_cluster, noise_along_rays, smooth_along_rays, sure_cell,
    voxel_downsample,
};

use crate::symmetry::visibility::Visibility;
use crate::viewpoints::join_places;

/// Fewest points of a surface in which an axis is looked for.
const MIN_POINTS: usize = 50;

/// No voxel of the part.
const NONE: u32 = u32::MAX;

/// The points within the region of interest, in a frame that turns with them.
pub(super) struct Scene<'a> {
    cloud: &'a PointCloud,
    /// Frame of the cloud from that of the points, and back.
    pub(super) frame: Isometry3<f64>,
    inverse: Isometry3<f64>,
    /// Where the sensor stood.
    pub(super) places: Vec<Vector3<f64>>,
    /// For each place of the cloud its number among these.
    group_of_place: Vec<u32>,
    pub(super) points: Vec<[f64; 3]>,
    /// Row of each point in the cloud.
    pub(super) rows: Vec<u32>,
    pub(super) normals: Option<Vec<[f64; 3]>>,
}

impl<'a> Scene<'a> {
    /// Crops and turns into the principal frame, so that the result does not depend on how the world frame lies: the
    /// voxel grid and the starting directions turn with the data.
    pub(super) fn new(cloud: &'a PointCloud, config: &Config) -> Result<Self> {
        let all = cloud.local_points();
        let rows = match config.roi {
            None => (0..all.len() as u32).collect(),
            Some(corners) => {
                within(all, corners.map(|corner| Vector3::from(corner) - Vector3::from(cloud.origin())))
            }
        };
        if rows.is_empty() {
            return Err(Error::InsufficientData {
                stage: "region of interest",
                needed: MIN_POINTS,
                got: 0,
                hint: "no point lies inside; check the corners and their unit",
            });
        }
        enough("input", rows.len())?;
        let cropped: Cow<[[f64; 3]]> = match config.roi {
            None => all.into(),
            Some(_) => rows.iter().map(|&i| all[i as usize]).collect(),
        };
        let frame = principal_frame(&cropped)?;
        let turn = frame.rotation.inverse();
        let normals = cloud.normals().map(|normals| {
            rows.iter().map(|&i| (turn * Vector3::from(normals[i as usize])).into()).collect()
        });
        let mut scene = Self {
            cloud,
            frame,
            inverse: frame.inverse(),
            places: Vec::new(),
            group_of_place: Vec::new(),
            points: Vec::new(),
            rows,
            normals,
        };
        scene.points = cropped.par_iter().with_min_len(CHUNK).map(|p| scene.local(*p)).collect();
        let places: Vec<Vector3<f64>> =
            cloud.viewpoints().places.iter().map(|place| scene.local(*place).into()).collect();
        // The frame begins at the centroid of the points.
        (scene.places, scene.group_of_place) = join_places(&places, &Vector3::zeros());
        Ok(scene)
    }

    /// What lies in the region of interest and around it, `times` as far as it is large, in the same frame.
    pub(super) fn with_surroundings(&self, roi: [[f64; 3]; 2], times: f64) -> Self {
        let [lower, upper] = roi.map(|corner| Vector3::from(corner) - Vector3::from(self.cloud.origin()));
        let margin = Vector3::repeat(times * (upper - lower).max());
        let all = self.cloud.local_points();
        let rows = within(all, [lower - margin, upper + margin]);
        Self {
            points: rows.iter().map(|&row| self.local(all[row as usize])).collect(),
            rows,
            normals: None,
            places: self.places.clone(),
            group_of_place: self.group_of_place.clone(),
            ..*self
        }
    }

    /// The points that are also among the points `kept` of another scene of the cloud.
    pub(super) fn shared(&self, other: &Self, kept: &[u32]) -> Vec<u32> {
        let mut is_kept = vec![false; self.cloud.len()];
        kept.iter().for_each(|&i| is_kept[other.rows[i as usize] as usize] = true);
        (0_u32..).zip(&self.rows).filter(|(_, row)| is_kept[**row as usize]).map(|(i, _)| i).collect()
    }

    /// Turns a point of the cloud into the frame of the scene.
    pub(super) fn local(&self, point: [f64; 3]) -> [f64; 3] {
        (self.inverse * Point3::from(point)).coords.into()
    }

    /// Row of the input for each point.
    pub(super) fn input_rows(&self) -> impl Iterator<Item = u32> {
        self.rows.iter().map(|&row| self.cloud.input_index()[row as usize])
    }

    /// Whether the cloud has the places of the sensors, so that normals can point outward.
    pub(super) fn has_viewpoints(&self) -> bool {
        self.cloud.has_viewpoints()
    }

    /// Whether a place of the sensor is known or assumed for every point.
    pub(super) fn is_oriented(&self) -> bool {
        !self.places.is_empty()
    }

    /// The place from which one view is assumed to have seen all, where none is known.
    pub(super) fn assumed_view(&self) -> Option<Vector3<f64>> {
        self.places.first().copied().filter(|_| !self.has_viewpoints())
    }

    /// The position that point `i` was seen from, where the cloud has such.
    pub(super) fn viewpoint(&self, i: usize) -> Option<[f64; 3]> {
        self.places.get(self.place_of(i)).map(|place| (*place).into())
    }

    /// Standard deviation of the points along their rays \[length\], about the planes of `neighbors` rays.
    pub(super) fn noise_along_rays(&self, neighbors: usize) -> Result<f64> {
        noise_along_rays(&self.points, &self.positions(), |i| self.place_of(i), neighbors)
    }

    /// The points, each averaged along its ray with the `neighbors` nearest rays of its view.
    pub(super) fn smoothed_along_rays(&self, neighbors: usize) -> Result<Vec<[f64; 3]>> {
        smooth_along_rays(&self.points, &self.positions(), |i| self.place_of(i), neighbors)
    }

    fn positions(&self) -> Vec<[f64; 3]> {
        self.places.iter().map(|place| (*place).into()).collect()
    }

    /// Number of the place that point `i` was seen from.
    pub(super) fn place_of(&self, i: usize) -> usize {
        self.place_of_row(self.rows[i] as usize)
    }

    fn place_of_row(&self, row: usize) -> usize {
        self.group_of_place.get(self.cloud.viewpoints().place_of(row)).map_or(0, |&group| group as usize)
    }

    /// Numbers of all places that saw a point of the cloud.
    fn places_of_row(&self, row: usize) -> impl Iterator<Item = usize> {
        let places = self.cloud.viewpoints().places_of(row).iter();
        places.map(|&place| self.group_of_place[place as usize] as usize)
    }

    /// What the cameras saw to be empty, by the rays to the points in the rows `region` of the cloud, those of the part
    /// where it is `None`, but not to those of the part whose voxel is none of `on_surface`: strays would hide the empty
    /// space behind them. `normals` are those of the voxels. `None` without viewpoints.
    pub(super) fn sight(
        &self,
        region: Option<&[u32]>,
        grid: &VoxelGrid,
        on_surface: &[u32],
        normals: &[[f64; 3]],
    ) -> Option<Visibility> {
        if !self.cloud.has_viewpoints() {
            return None;
        }
        let mut is_stray = vec![true; grid.points.len()];
        on_surface.iter().for_each(|&voxel| is_stray[voxel as usize] = false);
        // For each row of the cloud its voxel, [`NONE`] where that is not of the part; empty where there is no region beyond it.
        let mut voxel_of_row = Vec::new();
        // Indices of what is left: points of the part, or rows of the cloud; a copy of the points would be the larger half
        // of all memory.
        let left: Vec<u32> = match region {
            None => {
                let own = (0_u32..).zip(&grid.inverse);
                own.filter(|(_, voxel)| !is_stray[**voxel as usize]).map(|(i, _)| i).collect()
            }
            Some(region) => {
                let mut is_left_out = vec![false; self.cloud.len()];
                voxel_of_row = vec![NONE; self.cloud.len()];
                for (&row, &voxel) in self.rows.iter().zip(&grid.inverse) {
                    is_left_out[row as usize] = is_stray[voxel as usize];
                    voxel_of_row[row as usize] = if is_stray[voxel as usize] { NONE } else { voxel };
                }
                region.iter().copied().filter(|&row| !is_left_out[row as usize]).collect()
            }
        };
        let point = |i: usize| match region {
            None => self.points[left[i] as usize].into(),
            Some(_) => self.local(self.cloud.local_points()[left[i] as usize]).into(),
        };
        let row = |i: usize| if region.is_none() { self.rows[left[i] as usize] } else { left[i] };
        let places_of = |i: usize| self.places_of_row(row(i) as usize);
        let normal_of = |i: usize| {
            let voxel = match region {
                None => grid.inverse[left[i] as usize],
                Some(_) => voxel_of_row[left[i] as usize],
            };
            (voxel != NONE).then(|| normals[voxel as usize].into())
        };
        let seen = Visibility::new(left.len(), point, &self.places, places_of, normal_of, &self.pictures())?;
        Some(if self.cloud.viewpoints().are_tracks() { seen.fused() } else { seen })
    }

    /// The fields of view of the cameras, in the frame of the points.
    fn pictures(&self) -> Vec<Picture> {
        let local_from_world = self.inverse * Translation3::from(-Vector3::from(self.cloud.origin()));
        self.cloud.pictures().iter().map(|picture| picture.moved(&local_from_world)).collect()
    }

    /// The largest thing that stands on a `floor`, without what else stands there: pieces far apart beside
    /// the size of that thing itself, which is found by looking again at what the last look has left. Also the size of the
    /// largest of these \[share of what is kept\].
    pub(super) fn isolated(mut self, floor: &Floor, params: &OutlierParams) -> Result<(Self, f64)> {
        const LOOKS: usize = 4;
        /// How far a piece in the air may be from what it holds to [extent of that].
        const ATTACHED: f64 = 0.4;
        let mut left_out: f64 = 0.0;
        for _ in 0..LOOKS {
            if self.points.len() < MIN_POINTS {
                break;
            }
            let diameter = width(&self.points);
            // Where strays are very far away the cells are as small as they may be: no setting is to blame.
            let cell = (0.125 * params.cluster_distance * diameter).max(sure_cell(&self.points)?);
            let distance = 4.0 * cell;
            let standing = floor.standing(&self.points, distance);
            // What hardly rises above the noise of the floor stays as it is.
            if standing.len() < MIN_POINTS {
                break;
            }
            self = self.select(&standing);
            let coarse = voxel_downsample(&self.points, cell)?;
            let clusters = main_cluster(&coarse.points, &ClusterParams { distance, keep_ratio: 1.0 })?;
            let largest = largest_stack(&coarse.points, &clusters, floor, distance, ATTACHED);
            left_out = left_out.max(largest.next);
            let belongs =
                |i: &u32| largest.holds[clusters.labels[coarse.inverse[*i as usize] as usize] as usize];
            let kept: Vec<u32> = (0..self.points.len() as u32).filter(belongs).collect();
            self = self.select(&kept);
            if width(&self.points) > 0.9 * diameter {
                break;
            }
        }
        Ok((self, left_out))
    }

    /// Every n-th point where there are more than `most`, and as thin a `region` around: the depth maps count on
    /// points that are as dense everywhere.
    pub(super) fn thinned(self, most: usize, region: &mut Option<Vec<u32>>) -> Self {
        let step = self.points.len().div_ceil(most);
        if step <= 1 {
            return self;
        }
        if let Some(rows) = region {
            let mut is_kept = vec![None; self.cloud.len()];
            for (i, &row) in self.rows.iter().enumerate() {
                is_kept[row as usize] = Some(i % step == 0);
            }
            let mut others = 0;
            rows.retain(|&row| {
                is_kept[row as usize].unwrap_or_else(|| {
                    others += 1;
                    others % step == 0
                })
            });
        }
        let kept: Vec<u32> = (0..self.points.len() as u32).step_by(step).collect();
        self.select(&kept)
    }

    pub(super) fn select(self, kept: &[u32]) -> Self {
        let pick = |rows: &[[f64; 3]]| kept.iter().map(|&i| rows[i as usize]).collect::<Vec<_>>();
        Self {
            points: pick(&self.points),
            rows: kept.iter().map(|&i| self.rows[i as usize]).collect(),
            normals: self.normals.as_deref().map(pick),
            ..self
        }
    }
}

/// Rows of the points in a box, ascending.
fn within(points: &[[f64; 3]], [lower, upper]: [Vector3<f64>; 2]) -> Vec<u32> {
    let inside = |p: &[f64; 3]| (0..3).all(|i| (lower[i]..=upper[i]).contains(&p[i]));
    (0_u32..).zip(points).filter(|(_, p)| inside(p)).map(|(i, _)| i).collect()
}

/// Fails where a stage has left too few points.
pub(super) fn enough(stage: &'static str, got: usize) -> Result<()> {
    if got >= MIN_POINTS {
        return Ok(());
    }
    let hint = match stage {
        "input" => "scan the part more densely, or widen the region of interest",
        "ground" => {
            "nearly all lies in the plane that was taken for the support; set ground to \"off\" if it is of the part"
        }
        "downsample" => {
            "choose a smaller voxel or leave voxel_size open, and remove what lies far from the part"
        }
        _ => {
            "scan the part more densely, loosen the limits of `outliers`, or enlarge voxel_size where it is set"
        }
    };
    Err(Error::InsufficientData { stage, needed: MIN_POINTS, got, hint })
}

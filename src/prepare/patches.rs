//! The surface of the part, a patch at a time: the points of a voxel that were seen from the same side of it, and where
//! each of them came from.

use nalgebra::Vector3;

use super::clean::Cleaned;
use super::scene::Scene;
use super::voxels::Voxels;
use crate::preprocess::{Sides, SmoothingParams, mean_heights, means, separate_sides};
use crate::stages::Stages;
use crate::symmetry::surface::{Samples, Surface};
use crate::symmetry::view_errors::Looks;

/// No point of the surface.
const NONE: u32 = u32::MAX;

/// Views whose errors are looked for, at most. A sensor that moves has a place for every line or picture, near places are
/// joined, and what is left are too many for a table of all points by all views.
const MAX_VIEWS: usize = 32;

/// The patches of all voxels, and those that belong to the part.
pub(super) struct Patches {
    sides: Sides,
    /// Patches of the part, ascending: the points of its surface.
    chosen: Vec<u32>,
    /// For each patch the mean height of the surface around it over its point \[length\]; empty where it is not known.
    heights: Vec<f64>,
    /// For each patch the mean of its points as they were measured \[length\], where these were averaged along their rays.
    measured: Option<Vec<[f64; 3]>>,
    /// Whether normals point toward the sensors.
    oriented: bool,
    /// Whether there is so much noise that points of the surface are moved to the mean height around them.
    noisy: bool,
}

impl Patches {
    /// Parts the sides of the voxels; where the caller gave normals, these are taken.
    pub(super) fn new(
        part: &Scene,
        voxels: Voxels,
        cleaned: &Cleaned,
        params: &SmoothingParams,
        stages: &mut Stages,
    ) -> Self {
        let Voxels { grid, measured, .. } = voxels;
        let Cleaned { neighbors, normals, kept, noisy, .. } = cleaned;
        let mut is_kept = vec![false; grid.points.len()];
        kept.iter().for_each(|&voxel| is_kept[voxel as usize] = true);
        let oriented = part.is_oriented();
        let mut sides = if oriented {
            let viewpoint = |i| part.viewpoint(i).unwrap_or_default();
            let sides = separate_sides(&part.points, viewpoint, &grid, normals, neighbors);
            // A number for each raw point, which is no longer needed.
            drop(grid);
            sides
        } else {
            Sides {
                voxel_of: (0..grid.points.len() as u32).collect(),
                points: grid.points,
                normals: normals.clone(),
                patch_of_point: grid.inverse,
                ..Sides::default()
            }
        };
        stages.number("voxels_seen_from_both_sides", sides.divided as f64);
        if let Some(given) = &part.normals {
            replace_by_given(&mut sides.normals, given, &sides.patch_of_point);
        }
        // Without viewpoints nothing tells the sides of a thin wall apart.
        let max_angle = params.max_angle.filter(|_| oriented);
        let heights =
            max_angle.map_or_else(Vec::new, |angle| mean_heights(&sides, &is_kept, neighbors, angle));
        let of_part = (0_u32..).zip(&sides.voxel_of).filter(|(_, voxel)| is_kept[**voxel as usize]);
        let chosen = of_part.map(|(patch, _)| patch).collect();
        let measured = measured.map(|points| means(&points, &sides.patch_of_point, sides.points.len()).0);
        Self { sides, chosen, heights, measured, oriented, noisy: *noisy }
    }

    /// For each patch its point of the surface, [`NONE`] where it is not of the part.
    fn point_of_patch(&self) -> Vec<u32> {
        let mut point_of_patch = vec![NONE; self.sides.points.len()];
        for (point, &patch) in (0_u32..).zip(&self.chosen) {
            point_of_patch[patch as usize] = point;
        }
        point_of_patch
    }

    /// Rows of the input behind the surface of `part`, ascending, and for each of them its point of the surface.
    pub(super) fn inliers(&self, part: &Scene) -> (Vec<u32>, Vec<u32>) {
        let point_of_patch = self.point_of_patch();
        let mut inliers = Vec::with_capacity(part.rows.len());
        let mut point_of_inlier = Vec::with_capacity(part.rows.len());
        for (row, &patch) in part.input_rows().zip(&self.sides.patch_of_point) {
            let point = point_of_patch[patch as usize];
            if point != NONE {
                inliers.push(row);
                point_of_inlier.push(point);
            }
        }
        (inliers, point_of_inlier)
    }

    /// What each view measured at the points of the surface; `None` for a single view, and for very many.
    pub(super) fn looks(&self, part: &Scene) -> Option<Looks> {
        if part.places.len() < 2 {
            return None;
        }
        let point_of_patch = self.point_of_patch();
        let seen =
            || self.sides.patch_of_point.iter().map(|&patch| point_of_patch[patch as usize]).enumerate();
        // Places that saw the part, in their order among the points.
        let mut view_of_place = vec![None; part.places.len()];
        let mut views = 0;
        for (i, _) in seen().filter(|(_, point)| *point != NONE) {
            if view_of_place[part.place_of(i)].is_none() {
                view_of_place[part.place_of(i)] = Some(views);
                views += 1;
            }
        }
        if !(2..=MAX_VIEWS).contains(&views) {
            return None;
        }
        let step = Looks::step(self.chosen.len());
        let mut counts = vec![0.0; self.chosen.len() * views];
        let mut heights = vec![0.0; self.chosen.len().div_ceil(step) * views];
        for (i, point) in seen().filter(|(_, point)| *point != NONE) {
            let Some(view) = view_of_place[part.place_of(i)] else { continue };
            let point = point as usize;
            counts[point * views + view] += 1.0;
            if point.is_multiple_of(step) {
                let patch = self.chosen[point] as usize;
                let (position, mean, normal) =
                    (&part.points[i], &self.sides.points[patch], &self.sides.normals[patch]);
                let height: f64 = (0..3).map(|axis| (position[axis] - mean[axis]) * normal[axis]).sum();
                heights[point / step * views + view] += height as f32;
            }
        }
        Some(Looks { views, counts, heights })
    }

    /// The points of the surface as they were measured \[length\].
    pub(super) fn measured(&self) -> Vec<Vector3<f64>> {
        self.pick(self.measured.as_ref().unwrap_or(&self.sides.points))
    }

    /// The surface, whose points are `spacing` apart, with tables that serve gates up to `widest_gate` \[length\].
    pub(super) fn surface(&self, spacing: f64, widest_gate: f64) -> Surface {
        let mut samples =
            Samples { points: self.pick(&self.sides.points), normals: self.pick(&self.sides.normals) };
        let mut heights: Vec<f64> =
            self.chosen.iter().filter_map(|&patch| self.heights.get(patch as usize).copied()).collect();
        if self.noisy {
            // Matches of single points are lost in this much noise.
            let Samples { points, normals } = &mut samples;
            points.iter_mut().zip(normals).zip(heights.drain(..)).for_each(|((p, n), h)| *p += *n * h);
        }
        let mut surface = Surface::new(samples, self.oriented, spacing, widest_gate);
        surface.heights = heights;
        surface
    }

    /// Mean unit direction from the `points` of the surface to the sensors that saw them.
    pub(super) fn toward_sensors(&self, points: &[Vector3<f64>]) -> Vector3<f64> {
        let viewpoints = self.pick(&self.sides.viewpoints);
        let directions = viewpoints.iter().zip(points).filter_map(|(v, p)| (v - p).try_normalize(0.0));
        directions.sum::<Vector3<f64>>() / points.len() as f64
    }

    fn pick(&self, rows: &[[f64; 3]]) -> Vec<Vector3<f64>> {
        self.chosen.iter().map(|&patch| Vector3::from(rows[patch as usize])).collect()
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

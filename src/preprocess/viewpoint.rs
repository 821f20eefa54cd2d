//! One view: the place from which all of a surface could have been seen, where nobody says where the sensor stood.
//!
//! From there no point is behind another one. Which side of a wall was seen follows from it, and so it is known which
//! normals agree. Whether all of them point outward is not: a relief looks alike from behind.

use nalgebra::Vector3;
use rayon::prelude::*;

use super::{KNeighbors, NormalParams, normals_from_neighbors, voxel_downsample};
use crate::directions::{spiral, tangents};
use crate::error::Result;
use crate::median::median;
use crate::spatial::KdTree;

/// Directions from which the surface is looked at first.
const DIRECTIONS: usize = 64;

/// Distance of these places from the middle of the surface [diameters].
const DISTANCE: f64 = 2.5;

/// Voxels across the diameter where places are compared, and where the best one is judged: there both sides of a wall are
/// apart.
const VOXELS: [f64; 2] = [100.0, 280.0];

/// Height at which another surface is told apart beyond which points that fill a volume would pass for one [diameters].
const COARSEST: f64 = 0.04;

/// Share of the points that must be in sight from one of the first places, for others beside it to be tried: of the same
/// scans from one place at least 0.69.
const PROMISING: f64 = 0.6;

/// Share of the points that must be in sight for one view to be possible at all, on coarse voxels, and for it to be
/// believed. Of 224 scans from one place 223 reach it; of 476 from five places around the part two do: a bottle half of
/// which is missing and a propeller as thin as the noise.
const LEAST_SHARE: [f64; 2] = [0.7, 0.88];

/// The place from which one view sees the surface as a whole \[length\]; `None` where it takes several.
///
/// ```
/// use sympose::preprocess::single_viewpoint;
/// // A bump on a plate, all of which is in sight from above; and the same with its underside.
/// let height = |x: f64, y: f64| 0.3 * (1.0 - 4.0 * (x * x + y * y)).max(0.0);
/// let plane = (0..10_000).map(|i| [0.01 * f64::from(i % 100) - 0.5, 0.01 * f64::from(i / 100) - 0.5]);
/// let top: Vec<[f64; 3]> = plane.clone().map(|[x, y]| [x, y, height(x, y)]).collect();
/// assert!(single_viewpoint(&top, 1.0)?.is_some());
/// let both: Vec<[f64; 3]> = top.into_iter().chain(plane.map(|[x, y]| [x, y, -0.1])).collect();
/// assert!(single_viewpoint(&both, 1.0)?.is_none());
/// # Ok::<(), sympose::Error>(())
/// ```
///
/// # Errors
/// Those of [`voxel_downsample`] with a voxel of a hundredth of the `diameter` \[length\].
pub fn single_viewpoint(points: &[[f64; 3]], diameter: f64) -> Result<Option<[f64; 3]>> {
    /// Rounds in which the place is moved, on coarse voxels and on fine ones.
    const ROUNDS: [usize; 2] = [4, 4];
    let mut found: Option<Sighted> = None;
    for level in 0..VOXELS.len() {
        let surface = CoarseSurface::new(points, diameter, diameter / VOXELS[level])?;
        if surface.apart > COARSEST * diameter {
            return Ok(None);
        }
        let start = match found {
            None => surface.best(&surface.all_around(DISTANCE * diameter)),
            Some(Sighted { place, .. }) => surface.best(&[place]),
        };
        if start.share < PROMISING {
            return Ok(None);
        }
        let best = surface.moved(start, ROUNDS[level]);
        if best.share < LEAST_SHARE[level] {
            return Ok(None);
        }
        found = Some(best);
    }
    Ok(found.map(|best| best.place.into()))
}

/// A place, and the share of the points that are in sight from there.
#[derive(Clone, Copy)]
struct Sighted {
    place: Vector3<f64>,
    share: f64,
}

/// Points, one to a voxel, with their normals; without those that are farther from their middle than the part is large.
struct CoarseSurface {
    points: Vec<[f64; 3]>,
    normals: Vec<[f64; 3]>,
    centroid: Vector3<f64>,
    /// Largest distance from the centroid \[length\].
    extent: f64,
    /// Edge of a cell of an image, at the centroid \[length\].
    cell: f64,
    /// Height over the plane of a point at which another one is on another surface \[length\].
    apart: f64,
}

impl CoarseSurface {
    fn new(points: &[[f64; 3]], diameter: f64, voxel_size: f64) -> Result<Self> {
        /// Edge of a cell [voxels].
        const CELL: f64 = 1.5;
        /// Height of another surface [standard deviations of the points about theirs].
        const APART: f64 = 3.0;
        let grid = voxel_downsample(points, voxel_size)?;
        let params = NormalParams::default();
        let neighbors = KNeighbors::new(&KdTree::new(&grid.points)?, &grid.points, params.k)?;
        let planes = normals_from_neighbors(&grid.points, &neighbors, &params)?;
        // Of a disc of points the two variances within its plane make half of its radius squared.
        let scatter_sq = |(i, variation): (usize, &f64)| {
            0.5 * variation * neighbors.of(i).1.last().copied().unwrap_or_default()
        };
        let mut scatters_sq: Vec<f64> = planes.surface_variation.iter().enumerate().map(scatter_sq).collect();
        let scatter = median(&mut scatters_sq).unwrap_or_default().sqrt();
        let count = grid.points.len() as f64;
        let centroid = grid.points.iter().map(|p| Vector3::from(*p)).sum::<Vector3<f64>>() / count;
        let from_centroid = |p: &[f64; 3]| (Vector3::from(*p) - centroid).norm();
        let rows = grid.points.into_iter().zip(planes.normals);
        let (points, normals): (Vec<_>, Vec<_>) = rows.filter(|(p, _)| from_centroid(p) <= diameter).unzip();
        Ok(Self {
            extent: points.iter().map(from_centroid).fold(0.0, f64::max),
            points,
            normals,
            centroid,
            cell: CELL * voxel_size,
            apart: APART * scatter,
        })
    }

    /// Places on a sphere about the centroid, evenly spread.
    fn all_around(&self, distance: f64) -> Vec<Vector3<f64>> {
        let heights = (0..DIRECTIONS).map(|i| 1.0 - (2.0 * i as f64 + 1.0) / DIRECTIONS as f64);
        spiral(heights).map(|direction| self.centroid + direction * distance).collect()
    }

    /// The one of `places` that has most points in sight, the first of several.
    fn best(&self, places: &[Vector3<f64>]) -> Sighted {
        let sighted: Vec<Sighted> =
            places.par_iter().map(|&place| Sighted { place, share: self.share_in_sight(&place) }).collect();
        let better = |best: Sighted, other: Sighted| if other.share > best.share { other } else { best };
        sighted.into_iter().fold(Sighted { place: self.centroid, share: 0.0 }, better)
    }

    /// Moves the place sideways and to and fro, by ever smaller steps, while that brings more points in sight.
    fn moved(&self, start: Sighted, rounds: usize) -> Sighted {
        /// First step [distance from the centroid].
        const STEP: f64 = 0.25;
        /// Directions sideways.
        const SIDEWAYS: usize = 8;
        let mut best = start;
        let mut step = STEP;
        for _ in 0..rounds {
            let from_centroid = best.place - self.centroid;
            let [u, v] = tangents(&from_centroid.normalize());
            let aside = (0..SIDEWAYS).map(|i| {
                let (sin, cos) = (std::f64::consts::TAU * i as f64 / SIDEWAYS as f64).sin_cos();
                let distance = from_centroid.norm();
                (from_centroid + (u * cos + v * sin) * (step * distance)).normalize() * distance
            });
            let to_and_fro = [from_centroid * (1.0 + step), from_centroid / (1.0 + step)];
            let places: Vec<Vector3<f64>> = aside.chain(to_and_fro).map(|d| self.centroid + d).collect();
            let next = self.best(&places);
            if next.share > best.share {
                best = next;
            } else {
                step *= 0.5;
            }
        }
        best
    }

    /// Share of the points that a camera at `place` would see, none of them behind another one or at a grazing angle.
    fn share_in_sight(&self, place: &Vector3<f64>) -> f64 {
        /// Cosine between the normal and the ray below which a camera sees next to nothing of a surface.
        const GRAZING: f64 = 0.17;
        /// Distance of the nearest point, at least [distance of the centroid].
        const NEAREST: f64 = 0.25;
        let distance = (self.centroid - place).norm();
        let nearest = distance - self.extent;
        if nearest <= NEAREST * distance || self.points.is_empty() {
            return 0.0;
        }
        let axis = (self.centroid - place) / distance;
        let [u, v] = tangents(&axis);
        // The image is as wide as a sphere about the centroid looks.
        let half_width = self.extent * distance / nearest;
        let side = (2.0 * half_width / self.cell) as usize + 2;
        let rays: Vec<Ray> = self
            .points
            .iter()
            .map(|p| {
                let ray = Vector3::from(*p) - place;
                let scale = distance / ray.dot(&axis);
                let index = |along: f64| ((along * scale + half_width) / self.cell) as usize;
                Ray { pixel: index(u.dot(&ray)) + side * index(v.dot(&ray)), depth: ray.norm() }
            })
            .collect();
        let mut front = vec![None::<u32>; side * side];
        for (i, ray) in (0_u32..).zip(&rays) {
            let slot = &mut front[ray.pixel];
            if slot.is_none_or(|other| ray.depth < rays[other as usize].depth) {
                *slot = Some(i);
            }
        }
        let is_in_sight = |i: usize| {
            let (point, normal) = (Vector3::from(self.points[i]), Vector3::from(self.normals[i]));
            let toward = (place - point) / rays[i].depth;
            let cosine = normal.dot(&toward);
            let in_front =
                front[rays[i].pixel].map_or(point, |other| Vector3::from(self.points[other as usize]));
            let gap = in_front - point;
            let is_behind = gap.dot(&normal) * cosine.signum() > self.apart && gap.dot(&toward) > self.apart;
            cosine.abs() >= GRAZING && !is_behind
        };
        (0..self.points.len()).filter(|&i| is_in_sight(i)).count() as f64 / self.points.len() as f64
    }
}

/// Where a point is seen.
struct Ray {
    pixel: usize,
    depth: f64,
}

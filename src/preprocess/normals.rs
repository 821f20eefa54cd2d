//! Surface normals from the local plane through the neighbours of a point.

use nalgebra::Vector3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::eigen::smallest_eigenvector;
use super::moments::Moments;
use super::neighbors::map_neighbors;
use super::{CHUNK, KNeighbors};
use crate::error::{Error, Result};
use crate::spatial::KdTree;
use crate::validate::positive;

/// Settings of [`estimate_normals`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct NormalParams {
    /// Neighbours of the local plane, the point itself included \[count\].
    pub k: usize,
    /// Neighbours farther than this are ignored \[length\].
    pub max_radius: Option<f64>,
}

impl Default for NormalParams {
    fn default() -> Self {
        Self { k: 20, max_radius: None }
    }
}

/// The local plane at every point.
#[derive(Debug, Clone, PartialEq)]
pub struct Normals {
    /// Unit normals; the sign means nothing before [`orient_normals`].
    pub normals: Vec<[f64; 3]>,
    /// Share of the smallest of the three variances of the neighbourhood, in [0, 1/3]: 0 on a plane.
    pub surface_variation: Vec<f64>,
    /// Distance of every point from the plane through its neighbours [standard deviations of these about it]; large where a point
    /// lies off the surface that they form.
    pub deviation: Vec<f64>,
}

/// One local plane.
#[derive(Clone, Copy, Default)]
struct Plane {
    normal: [f64; 3],
    surface_variation: f64,
    deviation: f64,
}

impl FromIterator<Plane> for Normals {
    fn from_iter<I: IntoIterator<Item = Plane>>(planes: I) -> Self {
        let mut all = Self { normals: Vec::new(), surface_variation: Vec::new(), deviation: Vec::new() };
        for plane in planes {
            all.normals.push(plane.normal);
            all.surface_variation.push(plane.surface_variation);
            all.deviation.push(plane.deviation);
        }
        all
    }
}

/// Unit normals by principal components of the `k` nearest neighbours; `tree` must hold `points`.
///
/// Where neighbours lie on a line or coincide, the normal is some unit vector normal to the line: never zero or NaN.
///
/// ```
/// use sympose::preprocess::{NormalParams, estimate_normals};
/// use sympose::spatial::KdTree;
/// let points: Vec<[f64; 3]> = (0..400).map(|i| [f64::from(i % 20), f64::from(i / 20), 0.0]).collect();
/// let found = estimate_normals(&points, &KdTree::new(&points)?, &NormalParams::default())?;
/// assert!(found.normals.iter().all(|n| n[2].abs() > 0.999));
/// # Ok::<(), sympose::Error>(())
/// ```
///
/// # Errors
/// [`Error::InvalidParameter`] when `k` is less than 3 or the radius is not positive, [`Error::NonFinite`],
/// [`Error::LengthMismatch`] when the tree holds another number of points.
pub fn estimate_normals(points: &[[f64; 3]], tree: &KdTree, params: &NormalParams) -> Result<Normals> {
    let reach_sq = check(params)?;
    let planes = map_neighbors(tree, points, params.k, |_, found| {
        local_plane(found.iter().filter(|n| n.distance_sq() <= reach_sq).map(|n| n.offset))
    })?;
    Ok(planes.into_iter().collect())
}

/// [`estimate_normals`] with neighbours that are known already; of more than `k`, the first `k` are used.
///
/// ```
/// use sympose::preprocess::{KNeighbors, NormalParams, normals_from_neighbors};
/// use sympose::spatial::KdTree;
/// let points: Vec<[f64; 3]> = (0..400).map(|i| [f64::from(i % 20), f64::from(i / 20), 0.0]).collect();
/// let neighbors = KNeighbors::new(&KdTree::new(&points)?, &points, 20)?;
/// let found = normals_from_neighbors(&points, &neighbors, &NormalParams { k: 12, max_radius: None })?;
/// assert!(found.surface_variation.iter().all(|variation| *variation < 1e-9));
/// # Ok::<(), sympose::Error>(())
/// ```
///
/// # Errors
/// [`Error::InvalidParameter`] when `k` is less than 3 or the radius is not positive, [`Error::LengthMismatch`] unless the
/// neighbours are those of so many points among so many.
pub fn normals_from_neighbors(
    points: &[[f64; 3]],
    neighbors: &KNeighbors,
    params: &NormalParams,
) -> Result<Normals> {
    let reach_sq = check(params)?;
    for (what, got) in [("neighbours", neighbors.len()), ("the cloud of the neighbours", neighbors.among())] {
        if got != points.len() {
            return Err(Error::LengthMismatch { what, expected: points.len(), got });
        }
    }
    let plane = |point| {
        let (indices, distances_sq) = neighbors.of(point);
        let within =
            indices.iter().zip(distances_sq).take(params.k).take_while(|&(_, &square)| square <= reach_sq);
        local_plane(offsets(points, &points[point], within.map(|(&index, _)| index)))
    };
    let planes: Vec<Plane> = (0..points.len()).into_par_iter().with_min_len(CHUNK).map(plane).collect();
    Ok(planes.into_iter().collect())
}

/// Squared tilt that noise gives to the plane through the points with these indices, about \[rad²\]: the plane of those
/// seen from the same side of it as `center`, since a thin wall has two.
pub(super) fn tilt_sq(
    points: &[[f64; 3]],
    center: usize,
    indices: &[u32],
    viewpoint_of: impl Fn(usize) -> [f64; 3],
) -> f64 {
    let plane = |indices: &[u32]| local_plane(offsets(points, &points[center], indices.iter().copied()));
    let normal = Vector3::from(plane(indices).normal);
    let is_before = |i: usize| normal.dot(&(Vector3::from(viewpoint_of(i)) - Vector3::from(points[i]))) > 0.0;
    let side = is_before(center);
    let one_side: Vec<u32> = indices.iter().copied().filter(|&i| is_before(i as usize) == side).collect();
    let variation = plane(&one_side).surface_variation;
    // Variance of a slope: the scatter about the plane against that within it, of which there are two directions.
    let slope_sq = 2.0 * variation / (1.0 - variation);
    slope_sq / f64::max(indices.len() as f64 - 3.0, 1.0)
}

/// Checks the settings; the square of the largest distance.
fn check(params: &NormalParams) -> Result<f64> {
    if params.k < 3 {
        return Err(Error::InvalidParameter {
            name: "k",
            value: params.k.to_string(),
            expected: "at least 3 neighbours",
        });
    }
    match params.max_radius {
        None => Ok(f64::INFINITY),
        Some(radius) => positive("max_radius", radius).map(|()| radius * radius),
    }
}

/// Standard deviation of neighbours about their plane, at least [reach of the neighbourhood]: on a plane without noise
/// rounding is all there is.
const LEAST_SPREAD: f64 = 0.05;

/// Half space that normals point into until they are oriented. Their sign means nothing, but were it left to rounding, so
/// would be what depends on it, say the order of the two sides of a wall. Few surfaces are parallel to a direction like this.
const HEMISPHERE: [f64; 3] = [0.357, 0.569, 0.741];

/// Where the points with these indices lie from `center`.
fn offsets(
    points: &[[f64; 3]],
    center: &[f64; 3],
    indices: impl Iterator<Item = u32>,
) -> impl Iterator<Item = [f64; 3]> {
    indices.map(|index| std::array::from_fn(|axis| points[index as usize][axis] - center[axis]))
}

/// The plane of points at these places from a point, which is one of them.
fn local_plane(offsets: impl Iterator<Item = [f64; 3]>) -> Plane {
    // Relative to the point itself the coordinates are small, so one pass loses nothing.
    let mut moments = Moments::default();
    offsets.for_each(|offset| moments.add(offset));
    let (sum, count) = (moments.sum(), moments.count);
    let (normal, [smallest, middle, largest]) = smallest_eigenvector(&moments.scatter());
    let normal = if normal.dot(&Vector3::from(HEMISPHERE)) < 0.0 { -normal } else { normal };
    let total = smallest.max(0.0) + middle.max(0.0) + largest;
    if total <= 0.0 {
        return Plane { normal: normal.into(), ..Plane::default() };
    }
    // Without the point itself, whose own distance would hide in the scatter.
    let others = f64::max(count - 1.0, 1.0);
    let distance = normal.dot(&sum).abs() / others;
    let spread_sq = (smallest - distance * distance * others / count) / others;
    let least = LEAST_SPREAD * (largest / others).sqrt();
    Plane {
        normal: normal.into(),
        surface_variation: smallest.max(0.0) / total,
        deviation: distance / spread_sq.max(least * least).sqrt(),
    }
}

/// Flips normals toward the sensor: `viewpoint_of` gives for a point the position it was seen from, where known.
///
/// ```
/// use sympose::preprocess::orient_normals;
/// let mut normals = [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]];
/// orient_normals(&mut normals, &[[0.0; 3], [1.0, 0.0, 0.0]], |_| Some([0.0, 0.0, 5.0]));
/// assert_eq!(normals, [[0.0, 0.0, 1.0]; 2]);
/// ```
pub fn orient_normals(
    normals: &mut [[f64; 3]],
    points: &[[f64; 3]],
    viewpoint_of: impl Fn(usize) -> Option<[f64; 3]> + Sync,
) {
    normals.par_iter_mut().zip(points).enumerate().with_min_len(CHUNK).for_each(|(i, (normal, point))| {
        if let Some(viewpoint) = viewpoint_of(i) {
            let toward: f64 = (0..3).map(|axis| normal[axis] * (viewpoint[axis] - point[axis])).sum();
            if toward < 0.0 {
                *normal = normal.map(|x| -x);
            }
        }
    });
}

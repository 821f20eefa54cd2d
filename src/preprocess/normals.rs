//! Surface normals from the local plane through the neighbours of a point.

use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::eigen::smallest_eigenvector;
use super::{CHUNK, KNeighbors};
use crate::config::positive;
use crate::error::{Error, Result};
use crate::spatial::KdTree;

/// Settings of [`estimate_normals`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct NormalParams {
    /// Neighbours of the local plane, the point itself included [count].
    pub k: usize,
    /// Neighbours farther than this are ignored [length].
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
}

/// Unit normals by principal components of the `k` nearest neighbours; `tree` must hold `points`.
///
/// Where neighbours lie on a line or coincide, the normal is some unit vector normal to the line: never zero or NaN.
///
/// # Errors
/// [`Error::InvalidParameter`] when `k` is less than 3 or the radius is not positive, [`Error::NonFinite`],
/// [`Error::LengthMismatch`] when the tree holds another number of points.
pub fn estimate_normals(points: &[[f64; 3]], tree: &KdTree, params: &NormalParams) -> Result<Normals> {
    normals_from_neighbors(points, &KNeighbors::new(tree, points, params.k)?, params)
}

/// [`estimate_normals`] with neighbours that are known already; of more than `k`, the first `k` are used.
///
/// # Errors
/// Those of [`estimate_normals`].
pub fn normals_from_neighbors(
    points: &[[f64; 3]],
    neighbors: &KNeighbors,
    params: &NormalParams,
) -> Result<Normals> {
    if params.k < 3 {
        return Err(Error::InvalidParameter {
            name: "k",
            value: params.k.to_string(),
            expected: "at least 3 neighbours",
        });
    }
    if let Some(radius) = params.max_radius {
        positive("max_radius", radius)?;
    }
    if neighbors.len() != points.len() {
        return Err(Error::LengthMismatch {
            what: "neighbours",
            expected: points.len(),
            got: neighbors.len(),
        });
    }
    let reach_sq = params.max_radius.map_or(f64::INFINITY, |radius| radius * radius);
    let (normals, surface_variation) = neighbors
        .map(|i, indices, squares| {
            let within = squares.iter().take(params.k).take_while(|&&square| square <= reach_sq).count();
            local_plane(points, &points[i], &indices[..within])
        })
        .into_iter()
        .unzip();
    Ok(Normals { normals, surface_variation })
}

/// Normal and surface variation of the points with these indices.
fn local_plane(points: &[[f64; 3]], center: &[f64; 3], indices: &[u32]) -> ([f64; 3], f64) {
    // Relative to the point itself the coordinates are small, so one pass loses nothing.
    let center = Vector3::from(*center);
    let (mut sum, mut products) = (Vector3::zeros(), Matrix3::zeros());
    for &index in indices {
        let d = points.get(index as usize).map_or_else(Vector3::zeros, |p| Vector3::from(*p) - center);
        sum += d;
        products += d * d.transpose();
    }
    let covariance = products - sum * sum.transpose() / indices.len().max(1) as f64;
    let (normal, [smallest, middle, largest]) = smallest_eigenvector(&covariance);
    let total = smallest.max(0.0) + middle.max(0.0) + largest;
    (normal.into(), if total > 0.0 { smallest.max(0.0) / total } else { 0.0 })
}

/// Flips normals toward the sensor: `viewpoint_of` gives for a point the position it was seen from, where known.
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

//! Radius outlier filter: a point needs company.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::check_finite;
use crate::config::positive;
use crate::error::Result;
use crate::spatial::KdTree;

/// Settings of [`remove_radius_outliers`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RadiusParams {
    /// Radius of the neighbourhood, inclusive [length].
    pub radius: f64,
    /// Other points that the neighbourhood must hold [count].
    pub min_neighbors: usize,
}

impl Default for RadiusParams {
    /// A radius of 1, which only fits a cloud of about that spacing: set it.
    fn default() -> Self {
        Self { radius: 1.0, min_neighbors: 3 }
    }
}

/// Indices, ascending, of the points that have at least `min_neighbors` *other* points within `radius`.
///
/// Open3D counts the point itself and keeps more than `nb_points`, which is the same rule for the same number.
///
/// # Errors
/// [`Error::NonFinite`](crate::Error::NonFinite), or [`Error::InvalidParameter`](crate::Error::InvalidParameter) when
/// the radius is not positive.
pub fn remove_radius_outliers(points: &[[f64; 3]], params: &RadiusParams) -> Result<Vec<u32>> {
    positive("radius", params.radius)?;
    check_finite(points)?;
    if points.is_empty() {
        return Ok(Vec::new());
    }
    let tree = KdTree::new(points)?;
    let needed = params.min_neighbors.saturating_add(1);
    Ok((0..points.len() as u32)
        .into_par_iter()
        .with_min_len(256)
        .filter(|&i| tree.count_within(&points[i as usize], params.radius, needed) >= needed)
        .collect())
}

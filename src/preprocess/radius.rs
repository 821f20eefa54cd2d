//! Radius outlier filter: a point needs company.

use std::mem;
use std::ops::Range;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::cells::CellList;
use super::{CHUNK, check_finite};
use crate::error::Result;
use crate::spatial::KdTree;
use crate::validate::positive;

/// Settings of [`remove_radius_outliers`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RadiusParams {
    /// Radius of the neighbourhood, inclusive \[length\].
    pub radius: f64,
    /// Other points that the neighbourhood must hold \[count\].
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
/// The time grows with the number of points, times the number of neighbours that it takes to decide: at most `min_neighbors`
/// and those that lie just beyond the radius. Where both are large, so that neither many points nor few are surely enough,
/// thin the cloud first.
///
/// ```
/// use sympose::preprocess::{RadiusParams, remove_radius_outliers};
/// let points = [[0.0; 3], [0.1, 0.0, 0.0], [0.2, 0.0, 0.0], [5.0, 0.0, 0.0]];
/// let kept = remove_radius_outliers(&points, &RadiusParams { radius: 0.25, min_neighbors: 2 })?;
/// assert_eq!(kept, [0, 1, 2]);
/// # Ok::<(), sympose::Error>(())
/// ```
///
/// # Errors
/// [`Error::NonFinite`](crate::Error::NonFinite); [`Error::InvalidParameter`](crate::Error::InvalidParameter) when the
/// radius is not positive.
pub fn remove_radius_outliers(points: &[[f64; 3]], params: &RadiusParams) -> Result<Vec<u32>> {
    positive("radius", params.radius)?;
    check_finite(points)?;
    let Ok(cells) = CellList::new(points, params.radius, "radius") else {
        return crowded_in_tree(points, params);
    };
    let kept: Vec<Vec<u32>> = (0..points.len())
        .step_by(CHUNK)
        .collect::<Vec<_>>()
        .into_par_iter()
        .map(|first| crowded(&cells, first..points.len().min(first + CHUNK), params))
        .collect();
    let mut keep = vec![false; points.len()];
    kept.into_iter().flatten().for_each(|point| keep[point as usize] = true);
    Ok((0..points.len() as u32).filter(|&point| keep[point as usize]).collect())
}

/// The same where a stray point is so far away that cells of this size would be too many.
fn crowded_in_tree(points: &[[f64; 3]], params: &RadiusParams) -> Result<Vec<u32>> {
    let tree = KdTree::new(points)?;
    // The point finds itself.
    let needed = params.min_neighbors.saturating_add(1);
    let radius_sq = params.radius * params.radius;
    let is_crowded = |&point: &u32| {
        let point = &points[point as usize];
        match needed {
            _ if needed > points.len() => false,
            ..=FEW => tree.k_nearest(point, needed).last().is_some_and(|n| n.distance_sq <= radius_sq),
            _ => tree.within(point, params.radius).len() >= needed,
        }
    };
    Ok((0..points.len() as u32).into_par_iter().with_min_len(CHUNK).filter(is_crowded).collect())
}

/// Neighbours up to which the nearest are asked for; more are counted by the radius, which may hold far fewer.
const FEW: usize = 64;

/// Points that are looked at before the question is whether they are enough.
const CHECKED: usize = 32;

/// The points of these slots that have enough neighbours.
fn crowded(cells: &CellList, slots: Range<usize>, params: &RadiusParams) -> Vec<u32> {
    let radius_sq = params.radius * params.radius;
    // The point finds itself, so one neighbour more than asked for is needed.
    let needed = params.min_neighbors.saturating_add(1);
    let mut around: Vec<Range<usize>> = Vec::new();
    let mut available = 0;
    let mut cell = None;
    let enough = |&slot: &usize| {
        let p = &cells.points[slot];
        let own = Some(cells.cell(p));
        if mem::replace(&mut cell, own) != own {
            around.clear();
            around.extend(cells.around(p));
            available = around.iter().map(Range::len).sum();
        }
        // Once more than this many are too far away, what is left cannot be enough.
        let Some(mut spare) = available.checked_sub(needed) else { return false };
        let is_near = |q: &[f64; 3]| {
            let [x, y, z] = [q[0] - p[0], q[1] - p[1], q[2] - p[2]];
            x * x + y * y + z * z <= radius_sq
        };
        // A few points at a time: fewer branches to mispredict.
        let mut missing = needed;
        for chunk in around.iter().flat_map(|slots| cells.points[slots.clone()].chunks(CHECKED)) {
            let near = chunk.iter().filter(|q| is_near(q)).count();
            if near >= missing {
                return true;
            }
            let far = chunk.len() - near;
            if far > spare {
                return false;
            }
            missing -= near;
            spare -= far;
        }
        false
    };
    slots.filter(enough).map(|slot| cells.members[slot]).collect()
}

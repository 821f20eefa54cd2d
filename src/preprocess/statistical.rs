//! Statistical outlier filter: a point is as close to its neighbours as most points are to theirs.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::neighbors::map_neighbors;
use super::selection::Near;
use super::{CHUNK, KNeighbors, at_least_one, check_finite};
use crate::error::{Error, Result};
use crate::spatial::KdTree;
use crate::validate::positive;

/// Settings of [`remove_statistical_outliers`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StatisticalParams {
    /// Neighbours that the mean distance is taken over, the point itself included \[count\].
    pub k: usize,
    /// How far above the average the mean distance may lie [standard deviations].
    pub std_ratio: f64,
}

impl Default for StatisticalParams {
    fn default() -> Self {
        Self { k: 20, std_ratio: 2.0 }
    }
}

/// Indices, ascending, of the points whose mean distance to their `k` nearest neighbours is below the average of all
/// points plus `std_ratio` standard deviations.
///
/// The conventions are Open3D's: the point is its own first neighbour, the standard deviation is Bessel-corrected, the
/// comparison is strict. Two cases differ, since nothing says that those points are outliers: a point whose
/// neighbours all coincide with it (mean distance 0) is kept, and so are all points when every mean is the same.
///
/// ```
/// use sympose::preprocess::{StatisticalParams, remove_statistical_outliers};
/// let mut points: Vec<[f64; 3]> = (0..100).map(|i| [f64::from(i), 0.0, 0.0]).collect();
/// points.push([50.0, 30.0, 0.0]);
/// let kept = remove_statistical_outliers(&points, &StatisticalParams { k: 5, std_ratio: 3.0 })?;
/// assert_eq!(kept, (0..100).collect::<Vec<u32>>());
/// # Ok::<(), sympose::Error>(())
/// ```
///
/// # Errors
/// [`Error::NonFinite`](crate::Error::NonFinite), or [`Error::InvalidParameter`](crate::Error::InvalidParameter) when
/// `k` is 0 or `std_ratio` is not positive.
pub fn remove_statistical_outliers(points: &[[f64; 3]], params: &StatisticalParams) -> Result<Vec<u32>> {
    check(params)?;
    check_finite(points)?;
    if points.is_empty() {
        return Ok(Vec::new());
    }
    let k = params.k.min(points.len());
    let mean = |_, found: &[Near]| found.iter().map(|n| n.distance_sq().sqrt()).sum::<f64>() / k as f64;
    Ok(usual(&map_neighbors(&KdTree::new(points)?, points, k, mean)?, params.std_ratio))
}

/// [`remove_statistical_outliers`] with neighbours that are known already; of more than `k`, the first `k` are used.
///
/// ```
/// use sympose::preprocess::{KNeighbors, StatisticalParams, remove_statistical_outliers, statistical_inliers};
/// use sympose::spatial::KdTree;
/// let points: Vec<[f64; 3]> = (0..100).map(|i| [f64::from(i * i), 0.0, 0.0]).collect();
/// let neighbors = KNeighbors::new(&KdTree::new(&points)?, &points, 8)?;
/// let params = StatisticalParams { k: 5, std_ratio: 1.0 };
/// assert_eq!(statistical_inliers(&neighbors, &params)?, remove_statistical_outliers(&points, &params)?);
/// # Ok::<(), sympose::Error>(())
/// ```
///
/// # Errors
/// [`Error::InvalidParameter`](crate::Error::InvalidParameter) when `k` is 0 or more than there are, or `std_ratio` is
/// not positive.
pub fn statistical_inliers(neighbors: &KNeighbors, params: &StatisticalParams) -> Result<Vec<u32>> {
    check(params)?;
    let k = params.k.min(neighbors.len());
    if k > neighbors.k() {
        return Err(Error::InvalidParameter {
            name: "k",
            value: params.k.to_string(),
            expected: "at most the number of neighbours that were searched",
        });
    }
    let mean = |point| neighbors.of(point).1[..k].iter().map(|square| square.sqrt()).sum::<f64>() / k as f64;
    let means: Vec<f64> = (0..neighbors.len()).into_par_iter().with_min_len(CHUNK).map(mean).collect();
    Ok(usual(&means, params.std_ratio))
}

/// Points whose mean distance is not unusually large.
fn usual(means: &[f64], std_ratio: f64) -> Vec<u32> {
    // Beyond about 1e154 the square of a distance overflows. Such a point is an outlier, and tells nothing about the others.
    let finite: Vec<f64> = means.iter().copied().filter(|mean| mean.is_finite()).collect();
    let average = chunked_sum(&finite, |mean| mean) / finite.len() as f64;
    let square = chunked_sum(&finite, |mean| (mean - average) * (mean - average));
    let deviation = (square / (finite.len().max(2) - 1) as f64).sqrt();
    let threshold = average + std_ratio * deviation;
    // Rounding aside, equal means have no deviation and lie on the threshold.
    let keep = |mean: f64| mean < threshold || mean <= average * (1.0 + 1e-12);
    (0_u32..).zip(means).filter(|&(_, &mean)| keep(mean)).map(|(point, _)| point).collect()
}

fn chunked_sum(values: &[f64], f: impl Fn(f64) -> f64) -> f64 {
    values.chunks(CHUNK).map(|chunk| chunk.iter().map(|&x| f(x)).sum::<f64>()).sum()
}

fn check(params: &StatisticalParams) -> Result<()> {
    positive("std_ratio", params.std_ratio)?;
    at_least_one(params.k)
}

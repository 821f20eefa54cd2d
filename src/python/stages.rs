//! The stages of the pipeline, each alone.

use pyo3::prelude::*;

use super::{arrays, errors, pool};
use crate::preprocess::{self, NormalParams, PlaneParams, RadiusParams, SensorPlaces, StatisticalParams};
use crate::spatial::KdTree;

type Array<'py> = Bound<'py, PyAny>;

/// Replace the points of each cubic cell by their mean.
///
/// The grid starts half a voxel below the lower corner of the bounding box, as in Open3D, and the means are the same;
/// cells come in Morton order.
///
/// Args:
///     points: (N, 3), finite, at least one.
///     voxel_size: Edge of a cell, in the unit of the points; positive.
///     return_inverse: Return the cell of each input point too.
///
/// Returns:
///     (M, 3) means; with `return_inverse` also the (N,) rows of these that the input points went into.
///
/// Raises:
///     InvalidInputError: Not (N, 3), NaN or infinite coordinates, or a voxel size that is not positive or so small
///         that an axis would have 2^21 cells or more.
///     InsufficientDataError: No point.
///
/// Example:
///     >>> import sympose
///     >>> sympose.voxel_downsample([[0.0, 0.0, 0.0], [0.4, 0.0, 0.0], [5.0, 0.0, 0.0]], 1.0).tolist()
///     [[0.2, 0.0, 0.0], [5.0, 0.0, 0.0]]
#[pyfunction]
#[pyo3(signature = (points, voxel_size, *, return_inverse=false))]
pub(super) fn voxel_downsample<'py>(
    py: Python<'py>,
    points: &Array<'py>,
    voxel_size: f64,
    return_inverse: bool,
) -> PyResult<Array<'py>> {
    let points = &*arrays::cloud(points, "voxel_downsample")?;
    let grid = pool::run(py, || preprocess::voxel_downsample(points, voxel_size))?;
    let means = arrays::rows(py, grid.points)?;
    if return_inverse {
        return Ok((means, arrays::indices(py, &grid.inverse)).into_pyobject(py)?.into_any());
    }
    Ok(means.into_any())
}

/// Keep the points that have company.
///
/// Args:
///     points: (N, 3), finite, at least one.
///     radius: Of the neighbourhood, inclusive, in the unit of the points; positive.
///     min_neighbors: Other points that the neighbourhood must hold. Open3D counts the point itself and keeps more
///         than `nb_points`, which is the same rule for the same number.
///
/// Returns:
///     (M, 3) the points kept and (M,) their ascending indices.
///
/// Raises:
///     InvalidInputError: Not (N, 3), NaN or infinite coordinates, or a parameter outside its domain.
///     InsufficientDataError: No point.
///
/// Example:
///     >>> import sympose
///     >>> line = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [9.0, 0.0, 0.0]]
///     >>> points, indices = sympose.remove_radius_outliers(line, radius=1.0, min_neighbors=1)
///     >>> indices.tolist()
///     [0, 1, 2]
#[pyfunction]
pub(super) fn remove_radius_outliers<'py>(
    py: Python<'py>,
    points: &Array<'py>,
    radius: f64,
    #[pyo3(from_py_with = min_neighbors_of)] min_neighbors: usize,
) -> PyResult<(Array<'py>, Array<'py>)> {
    let points = &*arrays::cloud(points, "remove_radius_outliers")?;
    let params = RadiusParams { radius, min_neighbors };
    let kept = pool::run(py, || preprocess::remove_radius_outliers(points, &params))?;
    selection(py, points, &kept)
}

/// Keep the points that are as close to their neighbours as most points are to theirs.
///
/// A point goes when the mean distance to its neighbours is not below the average of all points plus `std_ratio`
/// standard deviations. Conventions as in Open3D, but that points which coincide with all their neighbours are kept.
///
/// Args:
///     points: (N, 3), finite, at least one.
///     k: Neighbours, the point itself included; at least 1.
///     std_ratio: Positive.
///
/// Returns:
///     (M, 3) the points kept and (M,) their ascending indices.
///
/// Raises:
///     InvalidInputError: Not (N, 3), NaN or infinite coordinates, or a parameter outside its domain.
///     InsufficientDataError: No point.
///
/// Example:
///     >>> import sympose
///     >>> line = [[0.1 * i, 0.0, 0.0] for i in range(20)] + [[9.0, 0.0, 0.0]]
///     >>> points, indices = sympose.remove_statistical_outliers(line, k=3)
///     >>> len(points), int(indices[-1])
///     (20, 19)
#[pyfunction]
#[pyo3(signature = (points, k=20, std_ratio=2.0))]
pub(super) fn remove_statistical_outliers<'py>(
    py: Python<'py>,
    points: &Array<'py>,
    #[pyo3(from_py_with = k_of)] k: usize,
    std_ratio: f64,
) -> PyResult<(Array<'py>, Array<'py>)> {
    let points = &*arrays::cloud(points, "remove_statistical_outliers")?;
    let params = StatisticalParams { k, std_ratio };
    let kept = pool::run(py, || preprocess::remove_statistical_outliers(points, &params))?;
    selection(py, points, &kept)
}

/// Find the plane with the most points: RANSAC (Fischler and Bolles 1981), then total least squares on the inliers.
///
/// Args:
///     points: (N, 3), finite, at least three.
///     distance: Largest distance of an inlier from the plane, in the unit of the points; positive.
///     max_iterations: Hypotheses tried at most, at least 1.
///     probability: Of having drawn three inliers, at which the search stops; in (0, 1].
///     seed: Of the samples, from 0 to 2^63 - 1; the same seed gives the same plane.
///
/// Returns:
///     (4,) unit normal n, its largest component positive, and d with n . x + d = 0; and the ascending indices of
///     the inliers.
///
/// Raises:
///     InvalidInputError: Not (N, 3), NaN or infinite coordinates, or a parameter outside its domain.
///     InsufficientDataError: Fewer than three points, or all on a line.
///
/// Example:
///     >>> import sympose
///     >>> floor = [[float(x), float(y), 2.0] for x in range(5) for y in range(5)]
///     >>> plane, inliers = sympose.segment_plane([*floor, [1.0, 1.0, 7.0]], 0.1)
///     >>> plane.round(6).tolist(), len(inliers)
///     ([0.0, 0.0, 1.0, -2.0], 25)
#[pyfunction]
#[pyo3(signature = (points, distance, *, max_iterations=1000, probability=0.9999, seed=0))]
pub(super) fn segment_plane<'py>(
    py: Python<'py>,
    points: &Array<'py>,
    distance: f64,
    #[pyo3(from_py_with = max_iterations_of)] max_iterations: usize,
    probability: f64,
    #[pyo3(from_py_with = seed_of)] seed: u64,
) -> PyResult<(Array<'py>, Array<'py>)> {
    let points = &*arrays::cloud(points, "segment_plane")?;
    let params = PlaneParams { distance, max_iterations, probability, seed };
    let plane = pool::run(py, || preprocess::segment_plane(points, &params))?;
    let coefficients = arrays::vector(py, plane.coefficients.to_vec());
    Ok((coefficients.into_any(), arrays::indices(py, &plane.inliers).into_any()))
}

/// Fit a plane to the neighbours of each point, and take its normal.
///
/// Args:
///     points: (N, 3), finite, at least one.
///     k: Neighbours, the point itself included; at least 3.
///     viewpoints: (3,) where the sensor stood, or (N, 3) for each point; the normals are turned toward it. Without,
///         their sign means nothing.
///
/// Returns:
///     (N, 3) unit normals. Where the neighbours lie on a line or coincide, some normal of the line.
///
/// Raises:
///     InvalidInputError: Not (N, 3), NaN or infinite coordinates, or k below 3.
///     InsufficientDataError: No point.
///
/// Example:
///     >>> import sympose
///     >>> floor = [[float(x), float(y), 2.0] for x in range(5) for y in range(5)]
///     >>> normals = sympose.estimate_normals(floor, k=8, viewpoints=[0.0, 0.0, 9.0])
///     >>> bool((normals[:, 2] > 0.999).all())
///     True
#[pyfunction]
#[pyo3(signature = (points, k=20, *, viewpoints=None))]
pub(super) fn estimate_normals<'py>(
    py: Python<'py>,
    points: &Array<'py>,
    #[pyo3(from_py_with = k_of)] k: usize,
    viewpoints: Option<&Array<'py>>,
) -> PyResult<Array<'py>> {
    let points = &*arrays::cloud(points, "estimate_normals")?;
    let params = NormalParams { k, ..NormalParams::default() };
    let viewpoints = viewpoints.map(arrays::viewpoints).transpose()?;
    let checked = viewpoints.iter().try_for_each(|viewpoints| {
        viewpoints.check_len(points.len())?;
        viewpoints.check_finite()
    });
    checked.map_err(|error| errors::exception(py, error))?;
    let normals = pool::run(py, || {
        let mut normals = preprocess::estimate_normals(points, &KdTree::new(points)?, &params)?.normals;
        if let Some(viewpoints) = viewpoints {
            preprocess::orient_normals(&mut normals, points, |i| viewpoints.of_point(i));
        }
        Ok(normals)
    })?;
    Ok(arrays::rows(py, normals)?.into_any())
}

/// Find out where a depth sensor stood, from the order in which it read out its points.
///
/// However noisy, the points of one row of a depth image lie in a plane with the sensor, and so its place follows from the
/// rows. `estimate` does the same where no viewpoint is given.
///
/// Args:
///     points: (N, 3), finite, row by row (or column by column) of one depth image after another. The coordinates must not
///         be rounded to more than a thousandth of the distance between two points.
///
/// Returns:
///     (N, 3) the position of the sensor for each point, or None where the order is another one.
///
/// Raises:
///     InvalidInputError: Not (N, 3), or NaN or infinite coordinates.
///
/// Example:
///     >>> import numpy as np, sympose
///     >>> u, v = np.meshgrid(np.linspace(-0.2, 0.2, 60), np.linspace(-0.2, 0.2, 60))
///     >>> depth = 2.0 + 0.1 * np.sin(20 * u) + np.random.default_rng(0).normal(0.0, 0.01, u.shape)
///     >>> points = np.stack([u * depth, v * depth, depth], axis=2).reshape(-1, 3)
///     >>> places = sympose.viewpoints_from_order(points + [1.0, 2.0, 3.0])
///     >>> bool(np.allclose(places, [1.0, 2.0, 3.0]))
///     True
///     >>> sympose.viewpoints_from_order(np.random.default_rng(0).permutation(points)) is None
///     True
#[pyfunction]
pub(super) fn viewpoints_from_order<'py>(
    py: Python<'py>,
    points: &Array<'py>,
) -> PyResult<Option<Array<'py>>> {
    let points = &*arrays::cloud(points, "viewpoints_from_order")?;
    let found = pool::run(py, || preprocess::viewpoints_from_order(points))?;
    let rows = found.map(|SensorPlaces { places, place_of, .. }| {
        arrays::rows(py, place_of.iter().map(|&place| places[place as usize]).collect())
    });
    Ok(rows.transpose()?.map(Bound::into_any))
}

fn k_of(value: &Array<'_>) -> PyResult<usize> {
    arrays::count(value, "k")
}

fn min_neighbors_of(value: &Array<'_>) -> PyResult<usize> {
    arrays::count(value, "min_neighbors")
}

fn max_iterations_of(value: &Array<'_>) -> PyResult<usize> {
    arrays::count(value, "max_iterations")
}

fn seed_of(value: &Array<'_>) -> PyResult<u64> {
    Ok(arrays::count(value, "seed")? as u64)
}

/// The points of these indices, and the indices.
fn selection<'py>(py: Python<'py>, points: &[[f64; 3]], kept: &[u32]) -> PyResult<(Array<'py>, Array<'py>)> {
    let selected = kept.iter().map(|&index| points[index as usize]).collect();
    Ok((arrays::rows(py, selected)?.into_any(), arrays::indices(py, kept).into_any()))
}

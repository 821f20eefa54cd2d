//! `sympose.metrics`.

use pyo3::prelude::*;

use super::{arrays, pool};
use crate::metrics;

/// ADD-S: mean distance from each point at the estimated pose to the nearest one at the true pose.
///
/// Blind to every symmetry of the part, known or not. Its floor is not zero unless the points are as symmetric as the
/// part: draw them from one sector and turn them.
///
/// Args:
///     points: (N, 3) surface of the part, object frame.
///     estimated: (4, 4) world_from_object.
///     truth: (4, 4) world_from_object.
///
/// Returns:
///     A distance in the unit of the points.
///
/// Raises:
///     InvalidInputError: A wrong shape, NaN or infinite coordinates, or a pose that is no rigid motion.
///     InsufficientDataError: No point.
///
/// Source:
///     Xiang et al., PoseCNN, 2018; equation (8) of Dai et al., arXiv 2606.16593.
///
/// Example:
///     >>> import numpy as np
///     >>> from sympose.metrics import adds
///     >>> square = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]
///     >>> quarter_turn = np.array([[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
///     >>> round(adds(square, quarter_turn, np.eye(4)), 12)
///     0.0
#[pyfunction]
pub(super) fn adds(
    py: Python<'_>,
    points: &Bound<'_, PyAny>,
    estimated: &Bound<'_, PyAny>,
    truth: &Bound<'_, PyAny>,
) -> PyResult<f64> {
    let points = &*arrays::cloud(points, "adds")?;
    arrays::check_finite(py, points, "points")?;
    let estimated = arrays::isometry(estimated, "estimated")?;
    let truth = arrays::isometry(truth, "truth")?;
    pool::run(py, || metrics::adds(points, &estimated, &truth))
}

/// MSSD: the largest distance of a point from where it should be, at the symmetry of the part that suits best.
///
/// Args:
///     points: (N, 3) surface of the part, object frame.
///     estimated: (4, 4) world_from_object.
///     truth: (4, 4) world_from_object.
///     symmetries: (S, 4, 4) motions in the object frame that leave the part as it is; the identity is always among
///         them, so that an empty (0, 4, 4) means none.
///
/// Returns:
///     A distance in the unit of the points.
///
/// Raises:
///     InvalidInputError: A wrong shape, NaN or infinite coordinates, or a matrix that is no rigid motion.
///     InsufficientDataError: No point.
///
/// Source:
///     Hodan et al., BOP Challenge 2020.
///
/// Example:
///     >>> import numpy as np
///     >>> from sympose.metrics import mssd
///     >>> square = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]
///     >>> half_turn = np.diag([-1.0, -1.0, 1.0, 1.0])
///     >>> mssd(square, half_turn, np.eye(4), [np.eye(4)]), mssd(square, half_turn, np.eye(4), [half_turn])
///     (2.0, 0.0)
#[pyfunction]
pub(super) fn mssd(
    py: Python<'_>,
    points: &Bound<'_, PyAny>,
    estimated: &Bound<'_, PyAny>,
    truth: &Bound<'_, PyAny>,
    symmetries: &Bound<'_, PyAny>,
) -> PyResult<f64> {
    let points = &*arrays::cloud(points, "mssd")?;
    arrays::check_finite(py, points, "points")?;
    let estimated = arrays::isometry(estimated, "estimated")?;
    let truth = arrays::isometry(truth, "truth")?;
    let symmetries = arrays::isometries(symmetries, "symmetries")?;
    pool::run(py, || metrics::mssd(points, &estimated, &truth, &symmetries))
}

//! `sympose.KdTree`.

use pyo3::exceptions::PyMemoryError;
use pyo3::prelude::*;
use rayon::prelude::*;

use super::{arrays, errors, pool};
use crate::error::shown;
use crate::preprocess::KNeighbors;
use crate::spatial::KdTree;

/// Nearest neighbours among (N, 3) points, by Euclidean distance.
///
/// Args:
///     points: (N, 3), finite, at least one; any real type and memory order. They are copied.
///
/// Raises:
///     InvalidInputError: Not (N, 3), or NaN or infinite coordinates.
///     InsufficientDataError: No point.
///
/// Example:
///     >>> from sympose import KdTree
///     >>> tree = KdTree([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
///     >>> distance, index = tree.query([[0.75, 0.0, 0.0]])
///     >>> distance.tolist(), index.tolist()
///     ([0.25], [1])
#[pyclass(frozen, module = "sympose", name = "KdTree")]
pub(super) struct PyKdTree {
    tree: KdTree,
    points: Vec<[f64; 3]>,
}

/// Rows times columns of a result, at most, where the tree has fewer points than there are columns.
const MAX_FILLED: usize = 1 << 26;

#[pymethods]
impl PyKdTree {
    #[new]
    fn new(py: Python<'_>, points: &Bound<'_, PyAny>) -> PyResult<Self> {
        let points = arrays::points(points, "points")?;
        let tree = pool::run(py, || KdTree::new(&points))?;
        Ok(Self { tree, points })
    }

    /// Find the nearest points of the tree.
    ///
    /// Args:
    ///     points: (N, 3) queries, finite.
    ///     k: Neighbours of each query, at least 1.
    ///
    /// Returns:
    ///     distance and index, nearest first: (N,) for k = 1, else (N, k). The distance is Euclidean, in the unit
    ///     of the points. Where the tree has fewer than k points, the rest is filled with the distance inf and
    ///     the index len(tree), as in SciPy.
    ///
    /// Raises:
    ///     InvalidInputError: Not (N, 3), NaN or infinite coordinates, or k below 1.
    ///     MemoryError: There is no room for so many neighbours.
    ///
    /// Example:
    ///     >>> from sympose import KdTree
    ///     >>> tree = KdTree([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    ///     >>> distance, index = tree.query([[0.75, 0.0, 0.0]], k=3)
    ///     >>> distance.tolist(), index.tolist()
    ///     ([[0.25, 0.75, inf]], [[1, 0, 2]])
    #[pyo3(signature = (points, k=1))]
    fn query<'py>(
        &self,
        py: Python<'py>,
        points: &Bound<'py, PyAny>,
        #[pyo3(from_py_with = k_of)] k: usize,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let queries = &*arrays::rows_of(points, "points")?;
        arrays::check_finite(py, queries, "points")?;
        if k == 0 {
            return Err(errors::invalid_input(py, "k = 0: expected at least 1 neighbour".to_owned()));
        }
        let len = self.tree.len();
        let cells = queries.len().saturating_mul(k);
        let (mut distances, mut indices) = (Vec::new(), Vec::new());
        // The system promises more memory than there is, and ends the process that takes it.
        let is_mostly_filling = k > len && cells > MAX_FILLED;
        if is_mostly_filling
            || distances.try_reserve_exact(cells).and_then(|()| indices.try_reserve_exact(cells)).is_err()
        {
            return Err(PyMemoryError::new_err(format!(
                "no memory for {k} neighbours of {} queries",
                queries.len()
            )));
        }
        let (distances, indices) = pool::run(py, move || {
            distances.resize(cells, f64::INFINITY);
            indices.resize(cells, len as i64);
            let found = match k {
                1 => None,
                _ => Some(KNeighbors::of_queries(&self.tree, &self.points, queries, k)?),
            };
            let rows = distances.par_chunks_mut(k).zip(indices.par_chunks_mut(k)).enumerate();
            rows.with_min_len(256).for_each(|(row, (distances, indices))| {
                let mut set = |column: usize, index: u32, distance_sq: f64| {
                    distances[column] = distance_sq.sqrt();
                    indices[column] = i64::from(index);
                };
                match &found {
                    None => {
                        let nearest = self.tree.nearest(&queries[row]);
                        set(0, nearest.index, nearest.distance_sq);
                    }
                    Some(found) => {
                        let (indices, distances_sq) = found.of(row);
                        for (column, (&index, &distance_sq)) in indices.iter().zip(distances_sq).enumerate() {
                            set(column, index, distance_sq);
                        }
                    }
                }
            });
            Ok((distances, indices))
        })?;
        let columns = (k > 1).then_some(k);
        Ok((arrays::table(py, distances, columns)?, arrays::table(py, indices, columns)?))
    }

    /// Find all points of the tree within a radius.
    ///
    /// Args:
    ///     points: (N, 3) queries, finite.
    ///     radius: Inclusive, in the unit of the points; positive.
    ///
    /// Returns:
    ///     For each query the ascending indices (m,) of the points within the radius.
    ///
    /// Raises:
    ///     InvalidInputError: Not (N, 3), NaN or infinite coordinates, or a radius that is not positive.
    ///
    /// Example:
    ///     >>> from sympose import KdTree
    ///     >>> tree = KdTree([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    ///     >>> [found.tolist() for found in tree.query_radius([[0.0, 0.0, 0.0], [5.0, 0.0, 0.0]], 1.0)]
    ///     [[0, 1], []]
    fn query_radius<'py>(
        &self,
        py: Python<'py>,
        points: &Bound<'py, PyAny>,
        radius: f64,
    ) -> PyResult<Vec<Bound<'py, PyAny>>> {
        let queries = &*arrays::rows_of(points, "points")?;
        arrays::check_finite(py, queries, "points")?;
        if !(radius > 0.0 && radius.is_finite()) {
            return Err(errors::invalid_input(
                py,
                format!("radius = {}: expected a positive, finite number", shown(radius)),
            ));
        }
        let found = pool::run(py, || Ok(self.tree.within_batch(queries, radius)))?;
        let indices = |neighbors: Vec<crate::spatial::Neighbor>| {
            arrays::vector(py, neighbors.into_iter().map(|n| i64::from(n.index)).collect()).into_any()
        };
        Ok(found.into_iter().map(indices).collect())
    }

    fn __len__(&self) -> usize {
        self.tree.len()
    }

    fn __repr__(&self) -> String {
        format!("KdTree({} points)", self.tree.len())
    }
}

fn k_of(value: &Bound<'_, PyAny>) -> PyResult<usize> {
    arrays::count(value, "k")
}

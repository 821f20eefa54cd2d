//! `sympose.Estimate`: the result as NumPy arrays.

use std::path::PathBuf;

use nalgebra::{Isometry3, Translation3, Vector3};
use numpy::PyArrayMethods;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList, PyMappingProxy, PyTuple, PyType};
use serde::Serialize;

use super::reference::PyReference;
use super::{arrays, errors, json, pool};
use crate::error::Error;
use crate::estimate::{Candidate, Estimate};
use crate::reference::Reference;
use crate::symmetry::order::Order;

/// The pose of a part, how far to trust it, and what was done to find it. All arrays are read-only.
///
/// Lengths are in the unit of the input, angles in radians.
///
/// Attributes:
///     pose: (4, 4) world_from_object: +z is the symmetry axis, +x the primary orientation, the origin lies on
///         the axis.
///     axis: (3,) unit direction of the axis, `pose[:3, 2]`.
///     center: (3,) origin of the object, `pose[:3, 3]`.
///     quaternion: (4,) rotation as x, y, z, w.
///     order: Order of the symmetry, or "continuous" for a surface of revolution.
///     score: Calibrated trust in [0, 1]; 0.5 and above is a pose to act on.
///     explained: Share of the observed surface that the symmetry explains, in [0, 1].
///     covariance: (6, 6) in the object frame, rotation x y z [rad], then translation x y z; inf on the diagonal of
///         a free direction, with zeros beside it.
///     unobservable: Motions that the data does not fix: of "yaw", "slide", "tilt", "shift".
///     warnings: What to know before relying on the pose.
///     points: (M, 3) refined points of the object.
///     normals: (M, 3) their unit normals.
///     inliers: (I,) indices of the input points behind them.
///     point_of_inlier: (I,) for each inlier its row in `points`.
///     completed: (K, 3) union of the rotated copies.
///     completed_sector: (K,) the sector that each came from; 0: measured.
///     ground: (4,) support plane, unit normal n toward the part and d with n . x + d = 0; None where there is none.
///     match_curve: (S, 2) angle [rad] and match score in [0, 1].
///     candidates: The axes that the search considered, the preferred ones first; the answer began from one of
///         the first. Empty where an earlier pose was followed.
///     timings: Seconds by stage.
///     diagnostics: Counts and figures of the stages, by name.
#[pyclass(frozen, module = "sympose", name = "Estimate")]
pub(super) struct PyEstimate {
    estimate: Estimate,
    /// Arrays that were asked for, by name.
    arrays: Py<PyDict>,
}

impl PyEstimate {
    pub(super) fn new(py: Python<'_>, estimate: Estimate) -> PyResult<Self> {
        Ok(Self { estimate, arrays: PyDict::new(py).unbind() })
    }

    /// The array `name`: made when first asked for, read-only, then kept.
    fn array<'py, A>(
        &self,
        py: Python<'py>,
        name: &str,
        make: impl FnOnce() -> PyResult<Bound<'py, A>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let arrays = self.arrays.bind(py);
        if let Some(array) = arrays.get_item(name)? {
            return Ok(array);
        }
        let array = make()?.into_any();
        arrays::freeze(&array)?;
        arrays.set_item(name, &array)?;
        Ok(array)
    }
}

/// More turns than anyone needs, few enough for memory.
const MAX_STEPS: u32 = 1_000_000;

/// An order as Python has it: an int or a str.
fn order<'py>(py: Python<'py>, order: Order) -> PyResult<Bound<'py, PyAny>> {
    json::to_python(py, &order)
}

fn read_only<'py>(py: Python<'py>, values: &(impl Serialize + Sync)) -> PyResult<Bound<'py, PyMappingProxy>> {
    Ok(PyMappingProxy::new(py, json::to_python(py, values)?.cast()?))
}

#[pymethods]
impl PyEstimate {
    #[getter]
    fn pose<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.array(py, "pose", || arrays::rows(py, arrays::matrix(&self.estimate.world_from_object)))
    }

    #[getter]
    fn axis<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let pose = arrays::matrix(&self.estimate.world_from_object);
        self.array(py, "axis", || Ok(arrays::vector(py, pose[..3].iter().map(|row| row[2]).collect())))
    }

    #[getter]
    fn center<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let center = self.estimate.world_from_object.translation.vector;
        self.array(py, "center", || Ok(arrays::vector(py, center.as_slice().to_vec())))
    }

    #[getter]
    fn quaternion<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let quaternion = self.estimate.world_from_object.rotation.coords;
        self.array(py, "quaternion", || Ok(arrays::vector(py, quaternion.as_slice().to_vec())))
    }

    #[getter]
    fn order<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        order(py, self.estimate.order)
    }

    #[getter]
    fn score(&self) -> f64 {
        self.estimate.score
    }

    #[getter]
    fn explained(&self) -> f64 {
        self.estimate.explained
    }

    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.array(py, "covariance", || arrays::rows(py, self.estimate.covariance.to_vec()))
    }

    #[getter]
    fn unobservable<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        Ok(json::to_python(py, &self.estimate.unobservable)?.cast::<PyList>()?.to_tuple())
    }

    #[getter]
    fn warnings<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, &self.estimate.warnings)
    }

    #[getter]
    fn points<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.array(py, "points", || arrays::rows(py, self.estimate.points.clone()))
    }

    #[getter]
    fn normals<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.array(py, "normals", || arrays::rows(py, self.estimate.normals.clone()))
    }

    #[getter]
    fn inliers<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.array(py, "inliers", || Ok(arrays::indices(py, &self.estimate.inliers)))
    }

    #[getter]
    fn point_of_inlier<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.array(py, "point_of_inlier", || Ok(arrays::indices(py, &self.estimate.point_of_inlier)))
    }

    #[getter]
    fn completed<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.array(py, "completed", || arrays::rows(py, self.estimate.completed.clone()))
    }

    #[getter]
    fn completed_sector<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.array(py, "completed_sector", || Ok(arrays::indices(py, &self.estimate.completed_sector)))
    }

    #[getter]
    fn ground<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let plane = self.estimate.ground;
        plane.map(|plane| self.array(py, "ground", || Ok(arrays::vector(py, plane.to_vec())))).transpose()
    }

    #[getter]
    fn match_curve<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.array(py, "match_curve", || arrays::rows(py, self.estimate.match_curve.clone()))
    }

    #[getter]
    fn candidates<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, self.estimate.candidates.iter().cloned().map(PyCandidate).collect::<Vec<_>>())
    }

    #[getter]
    fn timings<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyMappingProxy>> {
        read_only(py, &self.estimate.timings)
    }

    #[getter]
    fn diagnostics<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyMappingProxy>> {
        read_only(py, &self.estimate.diagnostics)
    }

    /// Poses that look the same: the pose turned about its axis.
    ///
    /// Args:
    ///     steps: Turns of a continuous symmetry, at least 1; a discrete one has as many as its order.
    ///
    /// Returns:
    ///     (S, 4, 4) world_from_object; the first is `pose`.
    ///
    /// Raises:
    ///     InvalidInputError: `steps` is not from 1 to 1,000,000.
    #[pyo3(signature = (steps=36))]
    fn equivalent_poses<'py>(&self, py: Python<'py>, steps: i64) -> PyResult<Bound<'py, PyAny>> {
        let Ok(steps @ 1..=MAX_STEPS) = u32::try_from(steps) else {
            return Err(errors::invalid_input(py, format!("steps = {steps}: expected 1 to {MAX_STEPS}")));
        };
        let poses = self.estimate.equivalent_poses(steps);
        let shape = [poses.len(), 4, 4];
        Ok(arrays::rows(py, poses.iter().flat_map(arrays::matrix).collect())?.reshape(shape)?.into_any())
    }

    /// The symmetry as an entry of the models_info.json of a BOP data set (object frame, lengths in mm).
    ///
    /// Returns:
    ///     `symmetries_discrete`: the turns other than the identity, each as 16 numbers by rows; and
    ///     `symmetries_continuous`: each with `axis` and `offset`. One of the two is empty. The axis runs through the
    ///     origin, so nothing depends on the unit of the cloud.
    fn bop_symmetries<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let continuous = PyList::empty(py);
        let discrete = PyList::empty(py);
        if self.estimate.order == Order::Continuous {
            let symmetry = PyDict::new(py);
            symmetry.set_item("axis", [0.0, 0.0, 1.0])?;
            symmetry.set_item("offset", [0.0, 0.0, 0.0])?;
            continuous.append(symmetry)?;
        } else {
            for turn in self.estimate.symmetries(1).skip(1) {
                discrete.append(
                    arrays::matrix(&Isometry3::from_parts(Translation3::identity(), turn)).concat(),
                )?;
            }
        }
        let symmetries = PyDict::new(py);
        symmetries.set_item("symmetries_discrete", discrete)?;
        symmetries.set_item("symmetries_continuous", continuous)?;
        Ok(symmetries)
    }

    /// Make the reference of the part: later scans are posed in the frame of this estimate.
    ///
    /// Returns:
    ///     A `Reference` for `sympose.estimate(scan, reference=...)`.
    ///
    /// Raises:
    ///     InsufficientDataError: The estimate was stored without its points.
    ///     InvalidInputError: The points of an estimate from a file are none of a part: not finite, or most at one place.
    ///
    /// Example:
    ///     >>> taught = sympose.estimate("first.ply", order=5).as_reference()  # doctest: +SKIP
    ///     >>> sympose.estimate("next.ply", reference=taught).pose  # doctest: +SKIP
    fn as_reference(&self, py: Python<'_>) -> PyResult<PyReference> {
        pool::run(py, || Reference::from_estimate(&self.estimate)).map(PyReference::new)
    }

    /// Return the estimate as a dict of plain Python values: the JSON schema, with these names.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        json::to_python(py, &self.estimate)
    }

    /// Return the estimate as JSON with a `schema_version`; numbers that are not finite are null.
    fn to_json(&self, py: Python<'_>) -> PyResult<String> {
        json::to_text(py, &self.estimate)
    }

    /// Make an estimate of what `to_json` returned; nothing is lost.
    ///
    /// Raises:
    ///     InvalidInputError: The text is no estimate.
    #[classmethod]
    fn from_json(_class: &Bound<'_, PyType>, py: Python<'_>, text: &str) -> PyResult<Self> {
        let estimate = py
            .detach(|| serde_json::from_str(text))
            .map_err(|error| errors::invalid_input(py, format!("the text is no estimate: {error}")))?;
        Self::new(py, estimate)
    }

    /// Write the estimate to a JSON file.
    ///
    /// Raises:
    ///     OSError: The file cannot be written.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let text = json::to_text(py, &self.estimate)?;
        py.detach(|| std::fs::write(&path, text))
            .map_err(|source| errors::exception(py, Error::Io { path, source }))
    }

    /// Read an estimate from a JSON file that `save`, or the command line, wrote.
    ///
    /// Raises:
    ///     InvalidInputError: The file holds no estimate.
    ///     OSError: The file cannot be read.
    #[classmethod]
    fn load(_class: &Bound<'_, PyType>, py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let read = || {
            let bytes = std::fs::read(&path).map_err(|source| Error::Io { path: path.clone(), source })?;
            serde_json::from_slice(&bytes).map_err(|error| {
                let reason = format!("not an estimate: {error}");
                Error::Format { path: path.clone(), reason }
            })
        };
        let estimate = py.detach(read).map_err(|error| errors::exception(py, error))?;
        Self::new(py, estimate)
    }

    /// Draw the scan, the pose and the evidence for it; needs matplotlib.
    ///
    /// Args:
    ///     path: Where to save the figure; not saved where it is not given.
    ///
    /// Returns:
    ///     A matplotlib Figure.
    #[pyo3(signature = (path=None))]
    fn plot<'py>(slf: &Bound<'py, Self>, path: Option<Bound<'py, PyAny>>) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("sympose.plotting")?.call_method1("plot_estimate", (slf, path))
    }

    /// Show the scan and the pose in a window; needs matplotlib.
    fn show(slf: &Bound<'_, Self>) -> PyResult<()> {
        slf.py().import("sympose.plotting")?.call_method1("show_estimate", (slf,)).map(drop)
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, (String,))> {
        Ok((slf.get_type().getattr("from_json")?, (slf.get().to_json(slf.py())?,)))
    }

    fn __repr__(&self) -> String {
        let Estimate { order, score, points, warnings, .. } = &self.estimate;
        let [x, y, z] = self.estimate.world_from_object.rotation.transform_vector(&Vector3::z()).into();
        let [cx, cy, cz]: [f64; 3] = self.estimate.world_from_object.translation.vector.into();
        let order = serde_json::to_string(order).unwrap_or_default();
        format!(
            "Estimate(order={order}, score={score:.2}, axis=[{x:.4}, {y:.4}, {z:.4}], \
             center=[{cx:.6}, {cy:.6}, {cz:.6}], {} points, {} warnings)",
            points.len(),
            warnings.len()
        )
    }
}

/// An axis that was considered. All arrays are read-only.
///
/// Attributes:
///     axis: (3,) unit direction.
///     center: (3,) point of the axis nearest to the centroid of the part.
///     order: Order of the symmetry, "continuous", or "auto" where none was found about it.
///     score: Match score in [0, 1] under the rotations of that order, so that those of other orders compare badly.
#[pyclass(frozen, module = "sympose", name = "Candidate")]
pub(super) struct PyCandidate(Candidate);

fn frozen<'py>(py: Python<'py>, vector: [f64; 3]) -> PyResult<Bound<'py, PyAny>> {
    let array = arrays::vector(py, vector.to_vec()).into_any();
    arrays::freeze(&array)?;
    Ok(array)
}

#[pymethods]
impl PyCandidate {
    #[getter]
    fn axis<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        frozen(py, self.0.axis)
    }

    #[getter]
    fn center<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        frozen(py, self.0.center)
    }

    #[getter]
    fn order<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        order(py, self.0.order)
    }

    #[getter]
    fn score(&self) -> f64 {
        self.0.score
    }

    /// Make a candidate of its entry in the JSON of an estimate.
    ///
    /// Raises:
    ///     InvalidInputError: The text is no candidate.
    #[classmethod]
    fn from_json(_class: &Bound<'_, PyType>, py: Python<'_>, text: &str) -> PyResult<Self> {
        let candidate = serde_json::from_str(text)
            .map_err(|error| errors::invalid_input(py, format!("the text is no candidate: {error}")))?;
        Ok(Self(candidate))
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, (String,))> {
        Ok((slf.get_type().getattr("from_json")?, (json::to_text(slf.py(), &slf.get().0)?,)))
    }

    fn __repr__(&self) -> String {
        let Candidate { axis: [x, y, z], order, score, .. } = &self.0;
        format!("Candidate(order={order}, score={score:.3}, axis=[{x:.4}, {y:.4}, {z:.4}])")
    }
}

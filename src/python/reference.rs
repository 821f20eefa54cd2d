//! `sympose.Reference`: a taught part.

use std::path::PathBuf;
use std::sync::Arc;

use nalgebra::Vector3;
use pyo3::prelude::*;
use pyo3::types::PyType;

use super::{arrays, errors, json, pool};
use crate::error::Error;
use crate::reference::Reference;

/// A taught part: its completed surface, in the frame in which later scans are posed.
///
/// Made by `Estimate.as_reference`, best of a scan that shows the part from all sides, and handed to
/// `sympose.estimate(scan, reference=...)`. Lengths are in the unit of the scan it was taught from.
///
/// Attributes:
///     order: Order of the symmetry, or "continuous" for a surface of revolution.
///     diameter: Size of the part: the diagonal of the cylinder about the axis that holds it.
///     points: (M, 3) completed surface, object frame.
///     normals: (M, 3) their unit normals.
///
/// Example:
///     >>> taught = sympose.estimate("first.ply", order=5).as_reference()  # doctest: +SKIP
///     >>> taught.save("part.json")  # doctest: +SKIP
///     >>> later = sympose.estimate("next.ply", reference=sympose.Reference.load("part.json"))  # doctest: +SKIP
#[pyclass(frozen, module = "sympose", name = "Reference")]
pub(super) struct PyReference(Arc<Reference>);

impl PyReference {
    pub(super) fn new(reference: Reference) -> Self {
        Self(Arc::new(reference))
    }

    pub(super) fn share(&self) -> Arc<Reference> {
        Arc::clone(&self.0)
    }

    fn parse(py: Python<'_>, path: PathBuf, bytes: &[u8]) -> PyResult<Self> {
        let made = pool::run(py, || {
            serde_json::from_slice(bytes)
                .map_err(|error| Error::Format { path, reason: format!("not a reference: {error}") })
        });
        made.map(Self::new)
    }
}

fn rows<'py>(py: Python<'py>, rows: &[Vector3<f64>]) -> PyResult<Bound<'py, PyAny>> {
    let array = arrays::rows(py, rows.iter().map(|row| (*row).into()).collect::<Vec<[f64; 3]>>())?.into_any();
    arrays::freeze(&array)?;
    Ok(array)
}

#[pymethods]
impl PyReference {
    #[getter]
    fn order<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        json::to_python(py, &self.0.order())
    }

    #[getter]
    fn diameter(&self) -> f64 {
        self.0.diameter()
    }

    #[getter]
    fn points<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        rows(py, &self.0.samples().points)
    }

    #[getter]
    fn normals<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        rows(py, &self.0.samples().normals)
    }

    /// Make a reference of the text that `save` writes.
    ///
    /// Raises:
    ///     InvalidInputError: The text is no reference.
    #[classmethod]
    fn from_json(_class: &Bound<'_, PyType>, py: Python<'_>, text: &str) -> PyResult<Self> {
        Self::parse(py, PathBuf::from("text"), text.as_bytes())
    }

    /// Write the reference to a JSON file; it holds one sector of the surface.
    ///
    /// Raises:
    ///     OSError: The file cannot be written.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let text = json::to_text(py, &*self.0)?;
        std::fs::write(&path, text).map_err(|source| errors::exception(py, Error::Io { path, source }))
    }

    /// Read a reference from a file that `save` wrote; it finds the same poses, to the last bit.
    ///
    /// Raises:
    ///     InvalidInputError: The file holds no reference.
    ///     OSError: The file cannot be read.
    #[classmethod]
    fn load(_class: &Bound<'_, PyType>, py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        match std::fs::read(&path) {
            Ok(bytes) => Self::parse(py, path, &bytes),
            Err(source) => Err(errors::exception(py, Error::Io { path, source })),
        }
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, (String,))> {
        Ok((slf.get_type().getattr("from_json")?, (json::to_text(slf.py(), &*slf.get().0)?,)))
    }

    fn __repr__(&self) -> String {
        let order = serde_json::to_string(&self.0.order()).unwrap_or_default();
        let count = self.0.samples().points.len();
        format!("Reference(order={order}, diameter={:.6}, {count} points)", self.0.diameter())
    }
}

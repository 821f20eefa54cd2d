//! Arrays in and out. What comes in goes through `sympose.arrays`, the one converter of the package.

use std::ops::Deref;

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion};
use numpy::{Element, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::exceptions::PyOverflowError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::errors;
use crate::error::Error;
use crate::viewpoints::Viewpoints;

/// Rows of an (N, 3) array of any real type and memory order.
///
/// A copy, because the work runs without the GIL, when another Python thread may write to the array. NumPy makes it, which
/// converts at the same time; no one else holds it.
pub(super) struct Rows<'py>(PyReadonlyArray2<'py, f64>);

impl Deref for Rows<'_> {
    type Target = [[f64; 3]];

    fn deref(&self) -> &Self::Target {
        // `copy_points` returns C-order: there is a slice.
        self.0.as_slice().unwrap_or_default().as_chunks().0
    }
}

/// The rows of an array.
pub(super) fn rows_of<'py>(value: &Bound<'py, PyAny>, name: &str) -> PyResult<Rows<'py>> {
    let array = value.py().import("sympose.arrays")?.call_method1("copy_points", (value, name))?;
    Ok(Rows(array.cast::<PyArray2<f64>>()?.try_readonly()?))
}

/// [`rows_of`], at least one.
pub(super) fn cloud<'py>(value: &Bound<'py, PyAny>, stage: &'static str) -> PyResult<Rows<'py>> {
    let rows = rows_of(value, "points")?;
    if rows.is_empty() {
        let hint = "the cloud is empty";
        let empty = Error::InsufficientData { stage, needed: 1, got: 0, hint };
        return Err(errors::exception(value.py(), empty));
    }
    Ok(rows)
}

/// Rows of an (N, 3) array, to keep.
pub(super) fn points(value: &Bound<'_, PyAny>, name: &str) -> PyResult<Vec<[f64; 3]>> {
    let array = value.py().import("sympose.arrays")?.call_method1("as_points", (value, name))?;
    let array = array.cast::<PyArray2<f64>>()?.try_readonly()?;
    // `as_points` returns C-order; a slice of a Fortran array would have columns for rows.
    Ok(array.as_slice()?.as_chunks::<3>().0.to_vec())
}

/// Refuses rows with a NaN or infinite coordinate.
pub(super) fn check_finite(py: Python<'_>, rows: &[[f64; 3]], name: &str) -> PyResult<()> {
    // Without an early exit inside a chunk the test is a few vector instructions.
    let finite = |chunk: &[f64]| chunk.iter().fold(true, |all, x| all & x.is_finite());
    if rows.as_flattened().chunks(1024).all(finite) {
        return Ok(());
    }
    let bad = rows.iter().filter(|row| row.iter().any(|x| !x.is_finite())).count();
    let message =
        format!("{bad} of {} rows of {name} have a NaN or infinite coordinate; remove them", rows.len());
    Err(errors::invalid_input(py, message))
}

/// Rows of an (N, 3) array, or the one row of a (3,) array, of which places that points share are kept once; or `Tracks`.
///
/// Read with the GIL held: a copy of all rows takes longer.
pub(super) fn viewpoints(value: &Bound<'_, PyAny>) -> PyResult<Viewpoints> {
    let name = "viewpoints";
    if value.is_instance(&value.py().import("sympose.tracks")?.getattr("Tracks")?)? {
        return tracks(value);
    }
    let arrays = value.py().import("sympose.arrays")?;
    let mut rows = arrays.call_method1("as_floats", (value, name))?;
    if rows.getattr("ndim")?.extract::<usize>()? == 1 {
        rows = rows.call_method1("reshape", (1, -1))?;
    }
    let rows = arrays.call_method1("as_points", (rows, name))?;
    let rows = rows.cast::<PyArray2<f64>>()?.try_readonly()?;
    Ok(Viewpoints::of_rows(rows.as_slice()?.as_chunks().0))
}

/// The `Tracks` of a fused scene.
fn tracks(value: &Bound<'_, PyAny>) -> PyResult<Viewpoints> {
    let places = points(&value.getattr("places")?, "places")?;
    let numbers = |name: &str| -> PyResult<Vec<u32>> {
        let array = value.getattr(name)?;
        Ok(array.cast::<PyArray1<u32>>()?.try_readonly()?.as_slice()?.to_vec())
    };
    let viewpoints = Viewpoints::of_tracks(&places, &numbers("counts")?, &numbers("seen_from")?);
    viewpoints.map_err(|error| errors::exception(value.py(), error))
}

/// Ascending indices of the rows that a (N,) boolean mask selects.
pub(super) fn selected(mask: &Bound<'_, PyAny>, len: usize, name: &'static str) -> PyResult<Vec<u32>> {
    let py = mask.py();
    let mask = mask.cast::<PyArray1<bool>>()?.try_readonly()?;
    let mask = mask.as_array();
    if mask.len() != len {
        return Err(errors::exception(
            py,
            Error::LengthMismatch { what: name, expected: len, got: mask.len() },
        ));
    }
    Ok((0..).zip(mask.iter()).filter(|(_, kept)| **kept).map(|(row, _)| row).collect())
}

/// A rigid transform from a (4, 4) matrix.
pub(super) fn isometry(value: &Bound<'_, PyAny>, name: &str) -> PyResult<Isometry3<f64>> {
    let matrix = value.py().import("sympose.camera")?.call_method1("as_rigid", (value, name))?;
    let matrix = matrix.cast::<PyArray2<f64>>()?.try_readonly()?;
    let matrix = matrix.as_array();
    let rotation = Rotation3::from_matrix_unchecked(Matrix3::from_fn(|row, column| matrix[[row, column]]));
    let translation = Translation3::new(matrix[[0, 3]], matrix[[1, 3]], matrix[[2, 3]]);
    Ok(Isometry3::from_parts(translation, UnitQuaternion::from_rotation_matrix(&rotation)))
}

/// Rigid transforms from an (S, 4, 4) array.
pub(super) fn isometries(value: &Bound<'_, PyAny>, name: &str) -> PyResult<Vec<Isometry3<f64>>> {
    let matrices = value.py().import("sympose.arrays")?.call_method1("as_floats", (value, name))?;
    if matrices.getattr("ndim")?.extract::<usize>()? != 3 {
        let shape = matrices.getattr("shape")?;
        let message = format!("{name} must have shape (S, 4, 4), got {shape}");
        return Err(errors::invalid_input(value.py(), message));
    }
    matrices.try_iter()?.map(|matrix| isometry(&matrix?, name)).collect()
}

/// A new (N,) array.
pub(super) fn vector<T: Element>(py: Python<'_>, values: Vec<T>) -> Bound<'_, PyArray1<T>> {
    PyArray1::from_vec(py, values)
}

/// A new (N, D) array, without a copy.
pub(super) fn rows<const D: usize>(
    py: Python<'_>,
    rows: Vec<[f64; D]>,
) -> PyResult<Bound<'_, PyArray2<f64>>> {
    let shape = [rows.len(), D];
    vector(py, rows.into_flattened()).reshape(shape)
}

/// A new (N,) array, or (N, columns) where a number of columns is given.
pub(super) fn table<T: Element>(
    py: Python<'_>,
    values: Vec<T>,
    columns: Option<usize>,
) -> PyResult<Bound<'_, PyAny>> {
    let Some(columns) = columns else { return Ok(vector(py, values).into_any()) };
    let shape = [values.len() / columns, columns];
    Ok(vector(py, values).reshape(shape)?.into_any())
}

/// A new (N,) array of int64, NumPy's own index type.
pub(super) fn indices<'py>(py: Python<'py>, indices: &[u32]) -> Bound<'py, PyArray1<i64>> {
    vector(py, indices.iter().map(|&index| i64::from(index)).collect())
}

/// The (4, 4) matrix of a rigid transform, by rows.
pub(super) fn matrix(transform: &Isometry3<f64>) -> Vec<[f64; 4]> {
    let matrix = transform.to_homogeneous();
    (0..4).map(|row| std::array::from_fn(|column| matrix[(row, column)])).collect()
}

/// Takes the right to write from an array that a result hands out.
pub(super) fn freeze(array: &Bound<'_, PyAny>) -> PyResult<()> {
    let flags = PyDict::new(array.py());
    flags.set_item("write", false)?;
    array.call_method("setflags", (), Some(&flags)).map(drop)
}

/// A number that counts something. Where it is out of range, an error of pyo3 would tell neither name nor range.
pub(super) fn count(value: &Bound<'_, PyAny>, name: &str) -> PyResult<usize> {
    let py = value.py();
    let refused =
        || errors::invalid_input(py, format!("{name} = {value}: expected a whole number from 0 to 2^63 - 1"));
    match value.extract::<i64>() {
        Ok(number) => usize::try_from(number).map_err(|_| refused()),
        Err(error) if error.is_instance_of::<PyOverflowError>(py) => Err(refused()),
        Err(error) => Err(error),
    }
}

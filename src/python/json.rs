//! Serde values as plain Python objects, by way of JSON.

use pyo3::prelude::*;
use serde::Serialize;

use super::errors;

/// Dicts, lists, numbers and strings, as the JSON of `value` has them.
pub(super) fn to_python<'py>(
    py: Python<'py>,
    value: &(impl Serialize + Sync),
) -> PyResult<Bound<'py, PyAny>> {
    py.import("json")?.call_method1("loads", (to_text(py, value)?,))
}

/// The JSON of `value`, written with the GIL released.
pub(super) fn to_text(py: Python<'_>, value: &(impl Serialize + Sync)) -> PyResult<String> {
    let written = py.detach(|| serde_json::to_string(value));
    written.map_err(|error| errors::invalid_input(py, error.to_string()))
}

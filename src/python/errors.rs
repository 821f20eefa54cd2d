//! Rust errors as the exceptions of `sympose.errors`.

use std::path::PathBuf;

use pyo3::exceptions::PyOSError;
use pyo3::prelude::*;

use super::json;
use crate::error::Error;

/// The exception that stands for `error`.
pub(super) fn exception(py: Python<'_>, error: Error) -> PyErr {
    let message = error.to_string();
    let raised = match error {
        Error::InvalidParameter { .. }
        | Error::LengthMismatch { .. }
        | Error::NonFinite { .. }
        | Error::Format { .. } => named(py, "InvalidInputError", (message,)),
        Error::InsufficientData { .. } | Error::Degenerate { .. } => {
            named(py, "InsufficientDataError", (message,))
        }
        Error::NoSymmetry { evidence } => json::to_python(py, &evidence)
            .and_then(|evidence| named(py, "NoSymmetryError", (message, evidence))),
        Error::Cancelled => named(py, "CancelledError", (message,)),
        Error::DeadlineExceeded { .. } => named(py, "DeadlineExceededError", (message,)),
        Error::Io { path, source } => os_error(py, &source, path),
        _ => named(py, "SymposeError", (message,)),
    };
    raised.unwrap_or_else(|failed| failed)
}

/// An `InvalidInputError` with this message.
pub(super) fn invalid_input(py: Python<'_>, message: String) -> PyErr {
    named(py, "InvalidInputError", (message,)).unwrap_or_else(|failed| failed)
}

/// A `SymposeError` for what should not happen.
pub(super) fn internal(py: Python<'_>, message: &'static str) -> PyErr {
    named(py, "SymposeError", (message,)).unwrap_or_else(|failed| failed)
}

fn named<'py>(py: Python<'py>, class: &str, arguments: impl pyo3::call::PyCallArgs<'py>) -> PyResult<PyErr> {
    // The classes are Python's, so that they can have two bases and be pickled.
    let class = py.import("sympose.errors")?.getattr(class)?;
    Ok(PyErr::from_value(class.call1(arguments)?))
}

/// `OSError` picks its own subclass by the number.
fn os_error(py: Python<'_>, source: &std::io::Error, path: PathBuf) -> PyResult<PyErr> {
    let Some(number) = source.raw_os_error() else {
        return Ok(PyOSError::new_err(format!("{}: {source}", path.display())));
    };
    let reason = py.import("os")?.call_method1("strerror", (number,))?.unbind();
    Ok(PyOSError::new_err((number, reason, path.into_os_string())))
}

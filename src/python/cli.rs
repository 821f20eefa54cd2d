//! The command line of the Rust binary, for the entry point of the Python package.

use std::ffi::OsString;

use pyo3::prelude::*;

use super::interrupt::interruptible;

/// Run the command line on `arguments` (the name of the program first), and return the exit code.
///
/// Raises:
///     KeyboardInterrupt: Ctrl-C was pressed; nothing was said about it yet.
#[pyfunction]
pub(super) fn cli_main(py: Python<'_>, arguments: Vec<OsString>) -> PyResult<u8> {
    interruptible(py, None, move |cancel, _reports| crate::cli::run_in_terminal(arguments, &cancel))
}

//! The command line of the Rust binary, for the entry point of the Python package.

use std::ffi::OsString;

use pyo3::prelude::*;

/// Run the command line on `arguments` (the name of the program first), and return the exit code.
#[pyfunction]
pub(super) fn cli_main(py: Python<'_>, arguments: Vec<OsString>) -> u8 {
    py.detach(|| crate::cli::run_in_terminal(arguments))
}

//! The command line of the Rust binary, for the entry point of the Python package.

use std::ffi::OsString;
use std::path::PathBuf;
use std::time::Duration;

use pyo3::prelude::*;

use super::input::Input;
use super::interrupt::interruptible;
use super::{arrays, errors, pool};
use crate::cli::{self, Given, NamedScan};
use crate::io::Scan;

/// The file with the scan that the arguments of the command line name (the name of the program first).
///
/// Returns:
///     Its path, and for `estimate` the settings as JSON and the timeout in seconds. None where the arguments name none, or not
///     rightly: `cli_main` says so.
#[pyfunction]
pub(super) fn cli_scan(arguments: Vec<OsString>) -> Option<(PathBuf, Option<String>, Option<f64>)> {
    let NamedScan { path, config, timeout } = cli::named_scan(arguments)?;
    let json = config.as_ref().map(serde_json::to_string).transpose().ok()?;
    Some((path, json, timeout.map(|timeout| timeout.as_secs_f64())))
}

/// Run the command line on `arguments` (the name of the program first), and return the exit code.
///
/// Args:
///     scan: What stands for the file with the scan, for commands other than `estimate`, or None.
///     cloud: The same for `estimate`.
///
/// Raises:
///     KeyboardInterrupt: Ctrl-C was pressed; nothing was said about it yet.
#[pyfunction]
#[pyo3(signature = (arguments, *, scan=None, cloud=None))]
pub(super) fn cli_main(
    py: Python<'_>,
    arguments: Vec<OsString>,
    scan: Option<ReadScan<'_>>,
    cloud: Option<ReadCloud<'_>>,
) -> PyResult<u8> {
    let given = match (scan, cloud) {
        (Some(scan), _) => Some(scan.given()?),
        (None, Some(cloud)) => Some(cloud.given(py)?),
        (None, None) => None,
    };
    interruptible(py, None, move |cancel, _reports| {
        // The global pool of rayon does not survive a fork.
        let pool = pool::of(pool::all_cores())?;
        Ok(pool.install(|| cli::run_in_terminal(arguments, given, &cancel)))
    })?
    .map_err(|error| errors::exception(py, error))
}

/// A scan that Python has read.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(super) struct ReadScan<'py> {
    points: Bound<'py, PyAny>,
    normals: Option<Bound<'py, PyAny>>,
    colors: Option<Vec<[u8; 3]>>,
    viewpoint: Option<[f64; 3]>,
}

impl ReadScan<'_> {
    fn given(self) -> PyResult<Given> {
        let Self { points, normals, colors, viewpoint } = self;
        let points = arrays::points(&points, "points")?;
        let normals = normals.map(|normals| arrays::points(&normals, "normals")).transpose()?;
        Ok(Given::Scan(Scan { points, normals, colors, viewpoint, is_mesh: false }))
    }
}

/// What [`super::call::estimate`] takes, of a file that Python has read.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(super) struct ReadCloud<'py> {
    points: Bound<'py, PyAny>,
    viewpoints: Option<Bound<'py, PyAny>>,
    normals: Option<Bound<'py, PyAny>>,
    foreground: Option<Bound<'py, PyAny>>,
    pictures: Vec<(Bound<'py, PyAny>, [[f64; 2]; 2])>,
    warnings: Vec<String>,
    elapsed: f64,
}

impl ReadCloud<'_> {
    fn given(self, py: Python<'_>) -> PyResult<Given> {
        let Self { points, viewpoints, normals, foreground, pictures, warnings, elapsed } = self;
        let input =
            Input::new(&points, viewpoints.as_ref(), normals.as_ref(), foreground.as_ref(), pictures)?;
        let (cloud, rows) = pool::run(py, || input.into_cloud())?;
        let elapsed = Duration::try_from_secs_f64(elapsed).unwrap_or_default();
        Ok(Given::Cloud { cloud, rows, warnings, elapsed })
    }
}

//! The main call.

use std::time::Duration;

use pyo3::prelude::*;

use super::estimate::PyEstimate;
use super::input::Input;
use super::interrupt::interruptible;
use super::reference::PyReference;
use super::{arrays, config, errors, pool};
use crate::control::Control;
use crate::error::shown;
use crate::estimate::{Estimator, Request};

/// Estimate the pose of the part in a cloud; `sympose.estimate` is the call for users.
///
/// Args:
///     points: (N, 3).
///     viewpoints: (3,) or (N, 3), or None.
///     normals: (N, 3), or None.
///     config: Settings as JSON.
///     foreground: (N,) bool, or None: the rest is left out, but `inliers` still index all points.
///     pictures: For each view its pose, (4, 4), and the least and largest x / z and y / z that it shows, (2, 2).
///     initial: (4, 4), or None.
///     prefer: (4, 4), or None.
///     reference: The taught part, or None.
///     timeout: Seconds, or None.
///     progress: Called with the stage and the share that is done, in the calling thread.
///     warnings: Put before those of the estimate.
#[pyfunction]
#[pyo3(signature = (
    points, *, config, viewpoints=None, normals=None, foreground=None, pictures=Vec::new(), initial=None, prefer=None,
    reference=None, timeout=None, progress=None, warnings=Vec::new()
))]
#[expect(clippy::too_many_arguments, reason = "keyword arguments of Python")]
pub(super) fn estimate(
    py: Python<'_>,
    points: &Bound<'_, PyAny>,
    config: &str,
    viewpoints: Option<&Bound<'_, PyAny>>,
    normals: Option<&Bound<'_, PyAny>>,
    foreground: Option<&Bound<'_, PyAny>>,
    pictures: Vec<(Bound<'_, PyAny>, [[f64; 2]; 2])>,
    initial: Option<&Bound<'_, PyAny>>,
    prefer: Option<&Bound<'_, PyAny>>,
    reference: Option<&Bound<'_, PyReference>>,
    timeout: Option<f64>,
    progress: Option<Py<PyAny>>,
    warnings: Vec<String>,
) -> PyResult<PyEstimate> {
    let mut control = Control::new();
    if let Some(seconds) = timeout {
        control = control.with_timeout(duration(py, seconds)?);
    }
    let input = Input::new(points, viewpoints, normals, foreground, pictures)?;
    let initial = initial.map(|value| arrays::isometry(value, "initial")).transpose()?;
    let prefer = prefer.map(|value| arrays::isometry(value, "prefer")).transpose()?;
    let reference = reference.map(|taught| taught.get().share());
    let mut config = config::parse(py, config)?;
    let estimate = interruptible(py, progress.as_ref(), move |cancel, reports| {
        let control = control.with_cancel(cancel).with_progress(move |stage, fraction| {
            // Nobody listens any more once the call is over.
            let _ = reports.send((stage, fraction));
        });
        config.validate()?;
        // The global pool of rayon does not survive a fork, so that every call has one of its own.
        let pool = pool::of(config.threads.take().unwrap_or_else(pool::all_cores))?;
        pool.install(|| {
            let (cloud, rows) = input.into_cloud()?;
            let request = Request { control, initial, prefer, reference };
            let estimate = Estimator::new(config)?.estimate_with(&cloud, &request)?;
            Ok(estimate.of_scan(rows.as_deref(), warnings))
        })
    })?
    .map_err(|error| errors::exception(py, error))?;
    PyEstimate::new(py, estimate)
}

fn duration(py: Python<'_>, seconds: f64) -> PyResult<Duration> {
    if seconds > 0.0 {
        // Beyond 584 billion years there is no deadline.
        return Ok(Duration::try_from_secs_f64(seconds).unwrap_or(Duration::MAX));
    }
    Err(errors::invalid_input(
        py,
        format!("timeout = {}: expected a positive number of seconds, or None", shown(seconds)),
    ))
}

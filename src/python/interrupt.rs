//! Long work on a thread of its own, while the calling thread listens for Ctrl-C and passes progress on.

use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::thread;
use std::time::{Duration, Instant};

use pyo3::prelude::*;

use super::errors;
use crate::control::CancelToken;

/// How often a waiting call looks for signals: Ctrl-C is answered within this time and one step of the work.
const SIGNAL_INTERVAL: Duration = Duration::from_millis(30);
/// How long interrupted work may take to notice. What hangs longer, on a slow disk or a pipe, is left behind.
const GRACE: Duration = Duration::from_secs(2);

/// The stage that begins, and the share of the whole that is done.
pub(super) type Report = (&'static str, f64);

/// Runs `job` on a thread of its own with the GIL released. Ctrl-C, and an exception raised in `progress`, cancel the
/// token that `job` got, and are raised here.
///
/// Progress is sent to the calling thread, so that no worker ever waits for the GIL. The work is over when `job` has
/// dropped its sender.
pub(super) fn interruptible<T: Send + 'static>(
    py: Python<'_>,
    progress: Option<&Py<PyAny>>,
    job: impl FnOnce(CancelToken, Sender<Report>) -> T + Send + 'static,
) -> PyResult<T> {
    let cancel = CancelToken::default();
    let (sender, reports) = mpsc::channel();
    let token = cancel.clone();
    let worker = thread::Builder::new().name("sympose".into()).spawn(move || job(token, sender))?;
    py.detach(move || wait(&reports, &cancel, progress))?;
    py.detach(|| worker.join()).map_err(|_| {
        errors::internal(py, "the work ended with a panic, which is a bug of sympose; please report it")
    })
}

/// Waits until every sender is gone. An interruption is passed on once the work has noticed it, or the grace is over.
fn wait(reports: &Receiver<Report>, cancel: &CancelToken, progress: Option<&Py<PyAny>>) -> PyResult<()> {
    let mut interruption: Option<(PyErr, Instant)> = None;
    loop {
        let report = match reports.recv_timeout(SIGNAL_INTERVAL) {
            Ok(report) => Some(report),
            Err(RecvTimeoutError::Timeout) => None,
            Err(RecvTimeoutError::Disconnected) => break,
        };
        match &interruption {
            Some((_, since)) if since.elapsed() > GRACE => break,
            Some(_) => {}
            None => {
                interruption = Python::attach(|py| listen(py, progress, report))
                    .err()
                    .map(|error| (error, Instant::now()));
                if interruption.is_some() {
                    cancel.cancel();
                }
            }
        }
    }
    interruption.map_or(Ok(()), |(error, _)| Err(error))
}

fn listen(py: Python<'_>, progress: Option<&Py<PyAny>>, report: Option<Report>) -> PyResult<()> {
    py.check_signals()?;
    if let (Some(progress), Some(report)) = (progress, report) {
        progress.call1(py, report)?;
    }
    Ok(())
}

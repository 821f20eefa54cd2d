//! Worker threads for the stage functions.

use std::sync::{Arc, Mutex, PoisonError};
use std::thread;

use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use super::errors;
use crate::error::{Error, Result};

/// The pool and the process that started it.
static POOL: Mutex<Option<(u32, Arc<ThreadPool>)>> = Mutex::new(None);

/// Number of cores that this process may use.
pub(super) fn all_cores() -> usize {
    thread::available_parallelism().map_or(1, usize::from)
}

/// Runs `job` with the GIL released, on all cores.
///
/// Threads do not survive a fork, and rayon's global pool would hang in the child, as with `multiprocessing`. So the
/// pool is ours, and a child starts its own.
pub(super) fn run<T: Send>(py: Python<'_>, job: impl FnOnce() -> Result<T> + Send) -> PyResult<T> {
    py.detach(|| current()?.install(job)).map_err(|error| errors::exception(py, error))
}

/// A new pool.
pub(super) fn of(threads: usize) -> Result<ThreadPool> {
    let built = ThreadPoolBuilder::new().num_threads(threads).build();
    built.map_err(|error| Error::ThreadPool { threads, reason: error.to_string() })
}

fn current() -> Result<Arc<ThreadPool>> {
    let mut slot = POOL.lock().unwrap_or_else(PoisonError::into_inner);
    let process = std::process::id();
    if let Some((owner, pool)) = slot.as_ref()
        && *owner == process
    {
        return Ok(Arc::clone(pool));
    }
    let pool = Arc::new(of(all_cores())?);
    // The threads of the parent's pool are not here: dropping it could wait for them.
    std::mem::forget(slot.replace((process, Arc::clone(&pool))));
    Ok(pool)
}

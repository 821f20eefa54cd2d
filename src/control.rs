//! Cancellation, deadline and progress of a running estimate.

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use crate::error::{Error, Result};

/// A flag that another thread sets to stop a running estimate; clones share the flag.
#[derive(Debug, Clone, Default)]
pub struct CancelToken(Arc<AtomicBool>);

impl CancelToken {
    /// Asks the estimate to stop; it returns [`Error::Cancelled`] at its next [check](Control::check).
    pub fn cancel(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether [`CancelToken::cancel`] has been called.
    #[must_use]
    pub fn is_cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

type Progress = Arc<dyn Fn(&'static str, f64) + Send + Sync>;

/// How a caller watches and stops a running estimate.
///
/// ```
/// use sympose::{CancelToken, Control};
/// let token = CancelToken::default();
/// let control = Control::new()
///     .with_cancel(token.clone())
///     .with_timeout(std::time::Duration::from_secs(5))
///     .with_progress(|stage, fraction| assert!(!stage.is_empty() && fraction <= 1.0));
/// token.cancel();
/// assert!(control.check().is_err());
/// ```
#[derive(Clone)]
pub struct Control {
    cancel: CancelToken,
    started: Instant,
    timeout: Option<Duration>,
    progress: Option<Progress>,
}

impl Control {
    /// Never cancelled, no deadline, silent. The clock starts now.
    #[must_use]
    pub fn new() -> Self {
        Self { cancel: CancelToken::default(), started: Instant::now(), timeout: None, progress: None }
    }

    /// The clock started earlier, by this much: what was done before, such as reading a file, counts toward the deadline.
    ///
    /// ```
    /// use std::time::Duration;
    /// let late = sympose::Control::new().with_timeout(Duration::from_secs(1)).with_elapsed(Duration::from_secs(2));
    /// assert!(matches!(late.check(), Err(sympose::Error::DeadlineExceeded { .. })));
    /// ```
    #[must_use]
    pub fn with_elapsed(mut self, elapsed: Duration) -> Self {
        self.started = self.started.checked_sub(elapsed).unwrap_or(self.started);
        self
    }

    /// Stops when `token` is cancelled.
    #[must_use]
    pub fn with_cancel(mut self, token: CancelToken) -> Self {
        self.cancel = token;
        self
    }

    /// Stops with [`Error::DeadlineExceeded`] once `timeout` has passed since [`Control::new`].
    #[must_use]
    pub fn with_timeout(mut self, timeout: Duration) -> Self {
        self.timeout = Some(timeout);
        self
    }

    /// Calls `progress` with the stage that begins and the fraction of the whole that is done; at the end with "done" and 1.
    ///
    /// The callback may run on a worker thread.
    #[must_use]
    pub fn with_progress(mut self, progress: impl Fn(&'static str, f64) + Send + Sync + 'static) -> Self {
        self.progress = Some(Arc::new(progress));
        self
    }

    /// Fails when cancelled or past the deadline; called between the stages and in the loops of the search and the
    /// refinement. The longest way between two calls is a stage of the preparation: up to 0.7 s for a million points in no order,
    /// and 2 s where these were seen from 300 places.
    ///
    /// # Errors
    /// [`Error::Cancelled`] or [`Error::DeadlineExceeded`].
    pub fn check(&self) -> Result<()> {
        if self.cancel.is_cancelled() {
            return Err(Error::Cancelled);
        }
        let elapsed = self.started.elapsed();
        if self.timeout.is_some_and(|timeout| elapsed >= timeout) {
            return Err(Error::DeadlineExceeded { elapsed: elapsed.as_secs_f64() });
        }
        Ok(())
    }

    /// Reports that `stage` begins, and [checks](Control::check).
    pub(crate) fn report(&self, stage: &'static str, fraction: f64) -> Result<()> {
        self.tell(stage, fraction);
        self.check()
    }

    /// Reports how far the work is.
    pub(crate) fn tell(&self, stage: &'static str, fraction: f64) {
        if let Some(progress) = &self.progress {
            progress(stage, fraction);
        }
    }
}

impl Default for Control {
    fn default() -> Self {
        Self::new()
    }
}

impl fmt::Debug for Control {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Control")
            .field("cancelled", &self.cancel.is_cancelled())
            .field("timeout", &self.timeout)
            .field("progress", &self.progress.is_some())
            .finish()
    }
}

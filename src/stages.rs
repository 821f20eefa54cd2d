//! Time, figures and progress of the stages as they run.

use std::collections::BTreeMap;
use std::time::Instant;

use crate::control::Control;
use crate::error::Result;
use crate::result::Diagnostic;

/// Time and figures of the stages as they run.
pub(crate) struct Stages<'a> {
    control: &'a Control,
    running: Option<(&'static str, Instant)>,
    /// Share of the whole that was reported last.
    done: f64,
    timings: BTreeMap<String, f64>,
    diagnostics: BTreeMap<String, Diagnostic>,
}

impl<'a> Stages<'a> {
    /// The stages in the order in which they run.
    const NAMES: [&'static str; 10] = [
        "input",
        "ground",
        "downsample",
        "outliers",
        "normals",
        "propose",
        "refine",
        "complete",
        "orient",
        "register",
    ];

    pub(crate) fn new(control: &'a Control) -> Self {
        Self { control, running: None, done: 0.0, timings: BTreeMap::new(), diagnostics: BTreeMap::new() }
    }

    /// Ends the running stage, reports that the next one begins, and fails when the work is to stop. A stage that is running
    /// goes on.
    pub(crate) fn begin(&mut self, stage: &'static str) -> Result<()> {
        if self.running.is_some_and(|(running, _)| running == stage) {
            return self.check();
        }
        self.end();
        self.running = Some((stage, Instant::now()));
        let before = Self::NAMES.iter().position(|name| *name == stage).unwrap_or(0);
        // A stage may run again, on all points after some of them, but progress does not go back.
        self.done = self.done.max(before as f64 / Self::NAMES.len() as f64);
        self.control.report(stage, self.done)
    }

    fn end(&mut self) {
        if let Some((stage, started)) = self.running.take() {
            *self.timings.entry(stage.to_owned()).or_default() += started.elapsed().as_secs_f64();
        }
    }

    pub(crate) fn control(&self) -> &'a Control {
        self.control
    }

    /// Stops a long stage between its parts when the work is cancelled.
    pub(crate) fn check(&self) -> Result<()> {
        self.control.check()
    }

    pub(crate) fn number(&mut self, name: &str, value: f64) {
        self.diagnostics.insert(name.to_owned(), Diagnostic::Number(value));
    }

    pub(crate) fn flag(&mut self, name: &str, value: bool) {
        self.diagnostics.insert(name.to_owned(), Diagnostic::Flag(value));
    }

    pub(crate) fn series(&mut self, name: &str, values: &[f64]) {
        self.diagnostics.insert(name.to_owned(), Diagnostic::Series(values.to_vec()));
    }

    /// The figures so far, to go [back](Self::go_back) to where an attempt comes to nothing.
    pub(crate) fn figures(&self) -> BTreeMap<String, Diagnostic> {
        self.diagnostics.clone()
    }

    /// Forgets all figures but these; the time that was spent is kept.
    pub(crate) fn go_back(&mut self, figures: BTreeMap<String, Diagnostic>) {
        self.diagnostics = figures;
    }

    /// Ends the last stage and reports that all is done; gives seconds and figures by name.
    pub(crate) fn finish(mut self) -> Result<(BTreeMap<String, f64>, BTreeMap<String, Diagnostic>)> {
        self.end();
        self.check()?;
        // Whoever was told that all is done gets it.
        self.control.tell("done", 1.0);
        Ok((self.timings, self.diagnostics))
    }

    pub(crate) fn text(&mut self, name: &str, value: &str) {
        self.diagnostics.insert(name.to_owned(), Diagnostic::Text(value.to_owned()));
    }
}

//! The progress bar on standard error.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Steps of the bar.
const STEPS: u64 = 1000;

/// A bar on standard error, or one that shows nothing; `indicatif` itself shows nothing where that is no terminal.
pub(super) fn bar(shown: bool) -> ProgressBar {
    let target = if shown { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
    let bar = ProgressBar::with_draw_target(Some(STEPS), target);
    match ProgressStyle::with_template("{msg:<12} [{bar:40}] {percent:>3} % {elapsed}") {
        Ok(style) => bar.with_style(style.progress_chars("=> ")),
        Err(_) => bar,
    }
}

/// Shows the stage that begins and the fraction that is done.
pub(super) fn show(bar: &ProgressBar, stage: &'static str, fraction: f64) {
    bar.set_message(stage);
    bar.set_position((fraction.clamp(0.0, 1.0) * STEPS as f64) as u64);
}

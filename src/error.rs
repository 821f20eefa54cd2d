//! What can go wrong, with the values that say why and what to do about it.

use std::fmt::{Display, LowerExp};

/// The result of every fallible function of this crate.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Why the pose of a part could not be estimated, or a stage could not run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A parameter lies outside its domain.
    #[error("{name} = {value}: expected {expected}")]
    InvalidParameter {
        /// Name of the parameter as the caller knows it.
        name: &'static str,
        /// The rejected value.
        value: String,
        /// The domain of the parameter.
        expected: &'static str,
    },
    /// Two arrays that describe the same points differ in length.
    #[error("{what} has {got} rows but the cloud has {expected} points; give one row for each point")]
    LengthMismatch {
        /// The array that does not fit.
        what: &'static str,
        /// Number of points of the cloud.
        expected: usize,
        /// Number of rows given.
        got: usize,
    },
    /// Coordinates are NaN or infinite where all must be finite: in a stage alone, in all points of a cloud, or as the
    /// configuration asks.
    #[error("{}", non_finite(*count, *total))]
    NonFinite {
        /// Points with a NaN or infinite coordinate.
        count: usize,
        /// Points in all.
        total: usize,
    },
    /// Too few points for a stage, or points that do not span a surface.
    #[error("{stage}: {got} usable points, at least {needed} are needed; {hint}")]
    InsufficientData {
        /// The stage that ran out of points.
        stage: &'static str,
        /// Points it needs.
        needed: usize,
        /// Points it got.
        got: usize,
        /// What the caller can do.
        hint: &'static str,
    },
    /// The points lie on a line or coincide, so that neither a plane nor an axis can be found.
    #[error("the points are {shape}: they do not span a surface, which a plane or an axis needs")]
    Degenerate {
        /// "identical", "collinear", or what else keeps them from spanning a surface.
        shape: &'static str,
    },
    /// No rotational symmetry explains the data.
    #[error("{evidence}")]
    NoSymmetry {
        /// What was tried and how well it matched.
        evidence: Evidence,
    },
    /// The cancel token was set.
    #[error("cancelled")]
    Cancelled,
    /// The deadline passed.
    #[error("the deadline passed before the pose was found (after {elapsed:.3} s)")]
    DeadlineExceeded {
        /// Time spent, in seconds.
        elapsed: f64,
    },
    /// A pool of worker threads could not be started.
    #[error("cannot start a pool of {threads} threads: {reason}")]
    ThreadPool {
        /// Threads asked for.
        threads: usize,
        /// The operating system's answer.
        reason: String,
    },
    /// A file could not be opened, read or written.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: std::path::PathBuf,
        /// The operating system's answer.
        source: std::io::Error,
    },
    /// A file is not what its name or header says.
    #[error("{path}: {reason}")]
    Format {
        /// The file.
        path: std::path::PathBuf,
        /// What was found and what was expected.
        reason: String,
    },
}

/// A rejected number as a message shows it: no row of hundreds of digits where it is huge or tiny.
pub(crate) fn shown<T: Display + LowerExp>(number: T) -> String {
    /// Digits that any count has.
    const PLAIN: usize = 20;
    let plain = number.to_string();
    if plain.len() > PLAIN { format!("{number:e}") } else { plain }
}

/// What is wrong with these points: where none is left, to remove them is no advice.
fn non_finite(count: usize, total: usize) -> String {
    if count == total {
        return format!("{count} of {total} points have a NaN or infinite coordinate; none is left");
    }
    format!(
        "{count} of {total} points have a NaN or infinite coordinate; remove them (an estimate leaves them out unless \
         non_finite is \"error\")"
    )
}

/// What the best axis looked like when a symmetry was refused.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize)]
pub struct Evidence {
    /// Direction of the best axis, world frame.
    pub axis: [f64; 3],
    /// A point on the best axis, world frame.
    pub center: [f64; 3],
    /// Share of the observed surface that the symmetry explains, in [0, 1].
    pub explained: f64,
    /// Match score of the best axis, in [0, 1].
    pub score: f64,
    /// Why this was not enough.
    pub reason: String,
}

impl std::fmt::Display for Evidence {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{} (best axis explains {:.0} % of the observed surface, score {:.2})",
            self.reason,
            100.0 * self.explained,
            self.score
        )
    }
}

//! The command line, shared by the `sympose` binary and the Python entry point; it uses the public interface, but for what
//! ARCHITECTURE.md names.
//!
//! Results go to standard output, progress and remarks to standard error. Exit codes: 0 done, 1 no trustworthy pose,
//! 2 bad usage or input, 130 cancelled. No signal handler is installed: Ctrl-C ends the binary as it ends any program,
//! and a caller with signals of its own cancels the token.

mod args;
mod output;
mod progress;
mod run;

use std::ffi::OsString;
use std::io::{Write, stderr, stdout};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use crate::cloud::PointCloud;
use crate::config::Config;
use crate::control::CancelToken;
use crate::io::Scan;

/// Runs the command line on `args` (the name of the program first), without a progress bar, and returns the exit code.
///
/// Nothing is printed but to `stdout` and `stderr`, and the process is never ended. A closed pipe on `stdout` is no error.
/// Once `cancel` is set the work stops within milliseconds, or at the end of a file or a filter, and nothing more is
/// written; whoever set it knows, so that no message says so.
///
/// ```
/// use sympose::CancelToken;
/// let (mut out, mut err) = (Vec::new(), Vec::new());
/// let args = ["sympose", "--version"].map(Into::into);
/// let code = sympose::cli::run(args, &mut out, &mut err, &CancelToken::default());
/// assert_eq!(code, 0);
/// assert!(out.starts_with(b"sympose "));
/// ```
pub fn run(
    args: impl IntoIterator<Item = OsString>,
    stdout: &mut dyn Write,
    stderr: &mut dyn Write,
    cancel: &CancelToken,
) -> u8 {
    run::run(args, None, stdout, stderr, cancel, false)
}

/// Runs the command line like [`run`], on the standard streams of the process, with a progress bar where standard error
/// is a terminal; `given` stands for the file with the scan.
pub fn run_in_terminal(
    args: impl IntoIterator<Item = OsString>,
    given: Option<Given>,
    cancel: &CancelToken,
) -> u8 {
    run::run(args, given, &mut stdout(), &mut stderr(), cancel, true)
}

/// What the arguments say of a scan, for a caller who reads it.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedScan {
    /// The file.
    pub path: PathBuf,
    /// The settings for `estimate`.
    pub config: Option<Config>,
    /// Time after which `estimate` gives up, reading included.
    pub timeout: Option<Duration>,
}

/// The file with the scan that the arguments name; `None` where they name none, or not rightly, which is for [`run`] to say.
#[must_use]
pub fn named_scan(args: impl IntoIterator<Item = OsString>) -> Option<NamedScan> {
    let cli: args::Cli = clap::Parser::try_parse_from(args).ok()?;
    let path = match cli.command {
        args::Command::Estimate(args) => {
            run::check_outputs(&args).ok()?;
            let config = Some(args.config().ok()?);
            return Some(NamedScan { path: args.scan, config, timeout: args.timeout });
        }
        args::Command::Filter(args) => args.scan,
        args::Command::Plane(args) => args.scan,
        args::Command::Info(args) => args.scan,
    };
    Some(NamedScan { path, config: None, timeout: None })
}

/// What an estimate says of the vertices of a mesh.
pub(crate) const MESH_WARNING: &str = "the scan is a mesh, and its vertices were taken for measured points: if it is a model, not a \
                                  scan, sample its surface";

/// What a caller has read from a file of a kind that [`crate::io`] does not know.
pub enum Given {
    /// For `filter`, `plane` and `info`.
    Scan(Scan),
    /// For `estimate`.
    Cloud {
        /// Where the part is sought.
        cloud: PointCloud,
        /// For each of its points the row of the file, where that differs.
        rows: Option<Vec<u32>>,
        /// Put before those of the estimate.
        warnings: Vec<String>,
        /// Time that it took to read it, which counts for a timeout.
        elapsed: Duration,
    },
}

/// Runs the command line on the arguments of this process.
#[must_use]
pub fn main() -> ExitCode {
    ExitCode::from(run_in_terminal(std::env::args_os(), None, &CancelToken::default()))
}

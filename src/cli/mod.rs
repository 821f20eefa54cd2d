//! The command line, shared by the `sympose` binary and the Python entry point; it uses the public interface only.
//!
//! Results go to standard output, progress and remarks to standard error. Exit codes: 0 done, 1 no trustworthy pose,
//! 2 bad usage or input.

mod args;
mod output;
mod progress;
mod run;

use std::ffi::OsString;
use std::io::{Write, stderr, stdout};
use std::process::ExitCode;

/// Runs the command line on `args` (the name of the program first), without a progress bar, and returns the exit code.
///
/// Nothing is printed but to `stdout` and `stderr`, and the process is never ended. A closed pipe on `stdout` is no error.
///
/// ```
/// let (mut out, mut err) = (Vec::new(), Vec::new());
/// let code = sympose::cli::run(["sympose", "--version"].map(Into::into), &mut out, &mut err);
/// assert_eq!(code, 0);
/// assert!(out.starts_with(b"sympose "));
/// ```
pub fn run(args: impl IntoIterator<Item = OsString>, stdout: &mut dyn Write, stderr: &mut dyn Write) -> u8 {
    run::run(args, stdout, stderr, false)
}

/// Runs the command line on the standard streams of the process, with a progress bar where standard error is a
/// terminal, and returns the exit code.
pub fn run_in_terminal(args: impl IntoIterator<Item = OsString>) -> u8 {
    run::run(args, &mut stdout(), &mut stderr(), true)
}

/// Runs the command line on the arguments of this process.
#[must_use]
pub fn main() -> ExitCode {
    ExitCode::from(run_in_terminal(std::env::args_os()))
}

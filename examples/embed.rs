//! A service that embeds the crate: one estimator for all clients, and for each request a deadline and a way to cancel.
//!
//! ```sh
//! cargo run --release --features io --example embed -- scan.ply other.pcd
//! ```
#![allow(clippy::print_stdout, reason = "an example shows what it does")]

use std::path::PathBuf;
use std::sync::mpsc;
use std::thread;
use std::time::Duration;

use sympose::{CancelToken, Config, Control, Error, Estimate, Estimator, Order, Request, io};

/// What a client sends: a scan, how long it will wait, and a token by which it withdraws.
struct Job {
    scan: PathBuf,
    timeout: Duration,
    token: CancelToken,
}

/// What every worker does; the estimator is shared, since it holds settings only.
fn serve(estimator: &Estimator, job: &Job) -> Result<Estimate, Error> {
    let cloud = io::read(&job.scan)?.into_cloud()?;
    let control = Control::new().with_timeout(job.timeout).with_cancel(job.token.clone());
    estimator.estimate_with(&cloud, &Request { control, ..Request::default() })
}

fn answer(scan: &str, outcome: Result<Estimate, Error>) -> String {
    match outcome {
        Ok(estimate) if estimate.is_trustworthy() => {
            let center = estimate.world_from_object.translation.vector;
            format!("{scan}: order {}, centre {:.3?}", estimate.order, center.as_slice())
        }
        Ok(estimate) => format!("{scan}: not sure enough (score {:.2})", estimate.score),
        // A service tells apart what the client did, what the scan lacks, and what ran out.
        Err(Error::Cancelled) => format!("{scan}: withdrawn by the client"),
        Err(Error::DeadlineExceeded { elapsed }) => format!("{scan}: gave up after {elapsed:.3} s"),
        Err(Error::NoSymmetry { evidence }) => format!("{scan}: no symmetry: {evidence}"),
        Err(other) => format!("{scan}: {other}"),
    }
}

fn main() -> Result<(), Error> {
    let mut scans: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    if scans.is_empty() {
        scans.push(concat!(env!("CARGO_MANIFEST_DIR"), "/examples/data/hub.ply").into());
    }
    // The parts on this line are five-fold. What is known is declared: these scans say nothing about where the sensor
    // stood, and without viewpoints hidden surface looks like missing surface, so that an open order is often refused.
    let estimator = Estimator::new(Config { order: Order::Cyclic(5), ..Config::default() })?;
    let (inbox, jobs) = mpsc::channel::<Job>();
    let jobs = std::sync::Mutex::new(jobs);
    let (outbox, answers) = mpsc::channel::<String>();

    thread::scope(|scope| {
        // Two workers with a thread each: the pool of rayon is shared, so more would only wait for each other.
        for _ in 0..2 {
            let (outbox, jobs, estimator) = (outbox.clone(), &jobs, &estimator);
            scope.spawn(move || {
                // The lock is held only while a job is taken; the channel closes when no client is left.
                while let Ok(job) = jobs.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).recv() {
                    let reply = answer(&job.scan.display().to_string(), serve(estimator, &job));
                    if outbox.send(reply).is_err() {
                        return;
                    }
                }
            });
        }
        drop(outbox);
        for scan in scans {
            for (timeout, withdraw) in [(60_000, false), (1, false), (60_000, true)] {
                let token = CancelToken::default();
                if withdraw {
                    token.cancel();
                }
                let job = Job { scan: scan.clone(), timeout: Duration::from_millis(timeout), token };
                if inbox.send(job).is_err() {
                    break;
                }
            }
        }
        drop(inbox);
        for reply in answers {
            println!("{reply}");
        }
    });
    Ok(())
}

//! The subcommands.

use std::ffi::OsString;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use clap::Parser;
use serde::Serialize;

use super::args::{Cli, Command, EstimateArgs, FilterArgs, InfoArgs, PlaneArgs};
use super::output::{self, Info, PlaneReport};
use super::{Given, MESH_WARNING, progress};
use crate::control::{CancelToken, Control};
use crate::error::{Error, Result};
use crate::estimate::{Estimate, Estimator, Request};
use crate::io::{self, Format, Scan};
use crate::preprocess::{
    PlaneParams, RadiusParams, StatisticalParams, median_spacing, remove_radius_outliers,
    remove_statistical_outliers, segment_plane, voxel_downsample,
};
use crate::spatial::KdTree;

const DONE: u8 = 0;
const NO_POSE: u8 = 1;
const BAD_INPUT: u8 = 2;
/// What a shell reports for a program that Ctrl-C has ended.
const CANCELLED: u8 = 130;

pub(super) fn run(
    args: impl IntoIterator<Item = OsString>,
    given: Option<Given>,
    stdout: &mut dyn Write,
    stderr: &mut dyn Write,
    cancel: &CancelToken,
    progress: bool,
) -> u8 {
    let control = Control::new().with_cancel(cancel.clone());
    let mut streams = Streams { stdout, stderr };
    let outcome = match Cli::try_parse_from(args) {
        Ok(cli) => match cli.command {
            Command::Estimate(args) => estimate(&args, given, &mut streams, control, progress && !args.quiet),
            Command::Filter(args) => filter(&args, given, &mut streams, &control),
            Command::Plane(args) => plane(&args, given, &mut streams, &control),
            Command::Info(args) => info(&args, given, &mut streams, &control),
        },
        Err(error) if error.use_stderr() => {
            streams.remark(&error.render().to_string());
            return BAD_INPUT;
        }
        // Help and version are what was asked for.
        Err(error) => streams.result(&error.render().to_string()).map(|()| DONE),
    };
    outcome.unwrap_or_else(|error| {
        // Whoever cancelled knows it.
        if !matches!(error, Error::Cancelled) {
            streams.remark(&format!("sympose: {error}\n"));
        }
        exit_code(&error)
    })
}

fn exit_code(error: &Error) -> u8 {
    match error {
        Error::NoSymmetry { .. }
        | Error::InsufficientData { .. }
        | Error::Degenerate { .. }
        | Error::DeadlineExceeded { .. } => NO_POSE,
        Error::Cancelled => CANCELLED,
        _ => BAD_INPUT,
    }
}

/// Results and remarks.
struct Streams<'a> {
    stdout: &'a mut dyn Write,
    stderr: &'a mut dyn Write,
}

impl Streams<'_> {
    /// Writes to standard output. Whoever reads it may stop reading: that is no error.
    fn result(&mut self, text: &str) -> Result<()> {
        match self.stdout.write_all(text.as_bytes()).and_then(|()| self.stdout.flush()) {
            Err(source) if source.kind() != ErrorKind::BrokenPipe => {
                Err(Error::Io { path: "standard output".into(), source })
            }
            _ => Ok(()),
        }
    }

    /// Writes to standard error; where that fails there is no one left to tell.
    fn remark(&mut self, text: &str) {
        let _ = self.stderr.write_all(text.as_bytes());
    }

    /// Writes a line of JSON to a file, or to standard output where the file is `-`.
    fn json(&mut self, path: &Path, value: &impl Serialize) -> Result<()> {
        let io_error = |source| Error::Io { path: path.to_owned(), source };
        let text = serde_json::to_string(value).map_err(|error| io_error(error.into()))? + "\n";
        if path == Path::new("-") { self.result(&text) } else { std::fs::write(path, text).map_err(io_error) }
    }
}

fn estimate(
    args: &EstimateArgs,
    given: Option<Given>,
    streams: &mut Streams,
    control: Control,
    progress: bool,
) -> Result<u8> {
    let estimator = Estimator::new(args.config()?)?;
    // Before the work, not after it.
    check_outputs(args)?;
    match find_pose(args, given, &estimator, control, progress) {
        Ok(estimate) => report(args, &estimate, streams),
        Err(error) => {
            if let Some(path) = args.json.as_deref().filter(|_| exit_code(&error) == NO_POSE) {
                streams.json(path, &output::failure_json(&error))?;
            }
            Err(error)
        }
    }
}

/// Fails where a file could not be written in the end.
pub(super) fn check_outputs(args: &EstimateArgs) -> Result<()> {
    if let Some(path) = &args.completed {
        Format::of(path)?;
    }
    args.completed.iter().chain(&args.json).try_for_each(|path| has_folder(path))?;
    let is_scan = |path: &&PathBuf| is_same_file(path, &args.scan);
    if let Some(path) = args.completed.iter().chain(&args.json).find(is_scan) {
        return Err(overwritten(path, "another file than the scan"));
    }
    match (&args.completed, &args.json) {
        (Some(completed), Some(json)) if is_same_file(completed, json) => {
            Err(overwritten(json, "another file than that of the completed cloud"))
        }
        _ => Ok(()),
    }
}

fn overwritten(path: &Path, expected: &'static str) -> Error {
    Error::InvalidParameter { name: "output", value: path.display().to_string(), expected }
}

/// Whether two paths lead to one file, as they stand where it is not there yet.
fn is_same_file(a: &Path, b: &Path) -> bool {
    match (a.canonicalize(), b.canonicalize()) {
        (Ok(a), Ok(b)) => a == b,
        (Err(_), Err(_)) => a == b,
        _ => false,
    }
}

/// Fails where the folder that a file is to be written to is none.
fn has_folder(path: &Path) -> Result<()> {
    let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) else { return Ok(()) };
    let is_folder = folder.metadata().and_then(|found| match found.is_dir() {
        true => Ok(()),
        false => Err(ErrorKind::NotADirectory.into()),
    });
    is_folder.map_err(|source| Error::Io { path: folder.to_owned(), source })
}

fn find_pose(
    args: &EstimateArgs,
    given: Option<Given>,
    estimator: &Estimator,
    mut control: Control,
    progress: bool,
) -> Result<Estimate> {
    let (mut cloud, rows, warnings) = match given {
        Some(Given::Cloud { cloud, rows, warnings, elapsed }) => {
            control = control.with_elapsed(elapsed);
            (cloud, rows, warnings)
        }
        given => {
            let scan = read(&args.scan, given, &control)?;
            let warnings = scan.is_mesh.then(|| MESH_WARNING.to_owned()).into_iter().collect();
            (scan.into_cloud()?, None, warnings)
        }
    };
    if let Some(viewpoint) = args.viewpoint() {
        cloud = cloud.with_viewpoints([viewpoint])?;
    }
    let bar = progress::bar(progress);
    let shown = bar.clone();
    control = control.with_progress(move |stage, fraction| progress::show(&shown, stage, fraction));
    if let Some(timeout) = args.timeout {
        control = control.with_timeout(timeout);
    }
    let estimate = estimator.estimate_with(&cloud, &Request { control, ..Request::default() });
    bar.finish_and_clear();
    estimate.map(|estimate| estimate.of_scan(rows.as_deref(), warnings))
}

fn report(args: &EstimateArgs, estimate: &Estimate, streams: &mut Streams) -> Result<u8> {
    match &args.json {
        Some(path) if args.full => streams.json(path, estimate)?,
        Some(path) => streams.json(path, &estimate.summary())?,
        None => {}
    }
    if args.json.as_deref() != Some(Path::new("-")) {
        streams.result(&output::estimate_text(estimate))?;
    }
    if let Some(path) = &args.completed {
        io::write(path, &Scan { points: estimate.completed.clone(), ..Scan::default() })?;
    }
    if estimate.is_trustworthy() {
        return Ok(DONE);
    }
    if !args.quiet {
        // Rounded down: one that is below the limit must not look as if it were there.
        let score = (1000.0 * estimate.score).floor() / 1000.0;
        let least = Estimate::TRUSTWORTHY;
        streams.remark(&format!("sympose: the score {score:.3} is below {least}: do not act on this pose\n"));
    }
    Ok(NO_POSE)
}

/// Reads a scan that is not given, before and after a look at the cancel token.
fn read(path: &Path, given: Option<Given>, control: &Control) -> Result<Scan> {
    if let Some(Given::Scan(scan)) = given {
        return Ok(scan);
    }
    control.check()?;
    let scan = io::read(path)?;
    control.check()?;
    Ok(scan)
}

/// Writes a scan, and says what the format does not hold of it.
fn write(path: &Path, scan: &Scan, streams: &mut Streams) -> Result<()> {
    io::write(path, scan)?;
    let format = Format::of(path)?;
    if let Some([x, y, z]) = scan.viewpoint.filter(|viewpoint| !format.holds_viewpoint(*viewpoint)) {
        streams.remark(&format!(
            "warning: {} does not say where the sensor stood: write PCD, or give --viewpoint {x} {y} {z} to estimate\n",
            path.display()
        ));
    }
    Ok(())
}

fn filter(args: &FilterArgs, given: Option<Given>, streams: &mut Streams, control: &Control) -> Result<u8> {
    Format::of(&args.out)?;
    has_folder(&args.out)?;
    let scan = read(&args.scan, given, control)?;
    let mut steps = vec![("read", scan.points.len())];
    let mut scan = finite(&scan);
    steps.push(("finite", scan.points.len()));
    if let Some(size) = args.filters.voxel_size {
        scan = voxel_mean(&scan, size)?;
        steps.push(("voxel grid", scan.points.len()));
        control.check()?;
    }
    if let Some(radius) = args.filters.radius {
        let default = RadiusParams::default();
        let min_neighbors = args.min_neighbors.unwrap_or(default.min_neighbors);
        scan = select(&scan, &remove_radius_outliers(&scan.points, &RadiusParams { radius, min_neighbors })?);
        steps.push(("radius", scan.points.len()));
        control.check()?;
    }
    if args.filters.k.is_some() || args.filters.std_ratio.is_some() {
        let default = StatisticalParams::default();
        let k = args.filters.k.unwrap_or(default.k);
        let std_ratio = args.filters.std_ratio.unwrap_or(default.std_ratio);
        scan =
            select(&scan, &remove_statistical_outliers(&scan.points, &StatisticalParams { k, std_ratio })?);
        steps.push(("statistical", scan.points.len()));
        control.check()?;
    }
    write(&args.out, &scan, streams)?;
    if !args.quiet {
        for (step, points) in steps {
            streams.remark(&format!("{step:<12} {points:>10} points\n"));
        }
    }
    Ok(DONE)
}

fn plane(args: &PlaneArgs, given: Option<Given>, streams: &mut Streams, control: &Control) -> Result<u8> {
    if let Some(path) = &args.remove {
        Format::of(path)?;
        has_folder(path)?;
    }
    let scan = finite(&read(&args.scan, given, control)?);
    let distance = match args.distance {
        Some(distance) => distance,
        None => match median_spacing(&KdTree::new(&scan.points)?, &scan.points) {
            0.0 if scan.points.len() > 1 => return Err(Error::Degenerate { shape: "identical" }),
            spacing => 2.0 * spacing,
        },
    };
    let params = PlaneParams { distance, seed: args.seed, ..PlaneParams::default() };
    let plane = segment_plane(&scan.points, &params)?;
    control.check()?;
    let report = PlaneReport {
        coefficients: plane.coefficients,
        distance,
        inliers: plane.inliers.len(),
        points: scan.points.len(),
        iterations: plane.iterations,
    };
    if args.json {
        streams.json(Path::new("-"), &report)?;
    } else {
        streams.result(&output::plane_text(&report))?;
    }
    if let Some(path) = &args.remove {
        let mut inliers = plane.inliers.iter().copied().peekable();
        let rest: Vec<u32> =
            (0..).take(scan.points.len()).filter(|index| inliers.next_if_eq(index).is_none()).collect();
        write(path, &select(&scan, &rest), streams)?;
    }
    Ok(DONE)
}

fn info(args: &InfoArgs, given: Option<Given>, streams: &mut Streams, control: &Control) -> Result<u8> {
    let scan = read(&args.scan, given, control)?;
    let points = finite(&scan).points;
    let corner = |pick: fn(f64, f64) -> f64| {
        points.iter().copied().reduce(|a, b| std::array::from_fn(|axis| pick(a[axis], b[axis])))
    };
    let info = Info {
        points: scan.points.len(),
        finite: points.len(),
        bounding_box: corner(f64::min).zip(corner(f64::max)).map(|(lower, upper)| [lower, upper]),
        median_spacing: if points.is_empty() {
            None
        } else {
            Some(median_spacing(&KdTree::new(&points)?, &points))
        },
        normals: scan.normals.is_some(),
        colors: scan.colors.is_some(),
        viewpoint: scan.viewpoint,
    };
    if args.json {
        streams.json(Path::new("-"), &info)?;
    } else {
        streams.result(&output::info_text(&info))?;
    }
    Ok(DONE)
}

/// The rows of a scan at ascending indices.
fn select(scan: &Scan, indices: &[u32]) -> Scan {
    fn rows<T: Copy>(rows: &[T], indices: &[u32]) -> Vec<T> {
        indices.iter().filter_map(|index| rows.get(*index as usize).copied()).collect()
    }
    Scan {
        points: rows(&scan.points, indices),
        normals: scan.normals.as_ref().map(|normals| rows(normals, indices)),
        colors: scan.colors.as_ref().map(|colors| rows(colors, indices)),
        viewpoint: scan.viewpoint,
        is_mesh: scan.is_mesh,
    }
}

/// The scan without points that have a NaN or infinite coordinate.
fn finite(scan: &Scan) -> Scan {
    let rows = (0..).zip(&scan.points).filter(|(_, point)| point.iter().all(|x| x.is_finite()));
    select(scan, &rows.map(|(index, _)| index).collect::<Vec<u32>>())
}

/// The means of the points, normals and colours of each voxel.
fn voxel_mean(scan: &Scan, size: f64) -> Result<Scan> {
    let grid = voxel_downsample(&scan.points, size)?;
    let unit = |normal: [f64; 3]| {
        let length = normal.iter().map(|x| x * x).sum::<f64>().sqrt();
        if length.is_normal() { normal.map(|x| x / length) } else { [0.0; 3] }
    };
    let byte = |value: f64| value.round() as u8;
    let wide = |colors: &Vec<[u8; 3]>| colors.iter().map(|color| color.map(f64::from)).collect::<Vec<_>>();
    Ok(Scan {
        normals: scan.normals.as_ref().map(|n| grid.mean_of(n).into_iter().map(unit).collect()),
        colors: scan
            .colors
            .as_ref()
            .map(|c| grid.mean_of(&wide(c)).into_iter().map(|v| v.map(byte)).collect()),
        viewpoint: scan.viewpoint,
        is_mesh: scan.is_mesh,
        points: grid.points,
    })
}

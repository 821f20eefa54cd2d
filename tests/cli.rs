//! The command line, called as a function: exit codes, streams, files.
#![cfg(feature = "cli")]
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test may panic")]

use std::ffi::OsString;
use std::io::{Error, ErrorKind, Write};
use std::path::Path;
use std::time::{Duration, Instant};

use serde_json::Value;
use sympose::io::{self, Scan};
use sympose::{CancelToken, Estimate, Order};

const HUB: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/data/hub.ply");
/// The truth of the hub, from examples/data/README.md.
const AXIS: [f64; 3] = [-0.638916144, 0.167672146, -0.750781068];
const CENTER: [f64; 3] = [449.231705171, 85.429672425, -156.132070895];
const DIAMETER: f64 = 400.0;

fn sympose(args: &[&str]) -> (u8, String, String) {
    sympose_with(&CancelToken::default(), args)
}

fn sympose_with(cancel: &CancelToken, args: &[&str]) -> (u8, String, String) {
    let (mut out, mut err) = (Vec::new(), Vec::new());
    let args = std::iter::once("sympose").chain(args.iter().copied());
    let code = sympose::cli::run(args.map(OsString::from), &mut out, &mut err, cancel);
    (code, String::from_utf8(out).unwrap(), String::from_utf8(err).unwrap())
}

/// The arguments fail with exit code 2, nothing on standard output, and a message that holds `expected`.
fn refused(args: &[&str], expected: &str) {
    let (code, out, err) = sympose(args);
    assert_eq!((code, out.as_str()), (2, ""), "{args:?}: {err}");
    assert!(err.contains(expected), "{args:?}: {err}");
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A plane of 20 x 20 points, 100 points of a hill above it, two points that are not finite, and a stray one.
fn scene(folder: &Path, name: &str) -> String {
    let mut points: Vec<[f64; 3]> = (0..400).map(|i| [f64::from(i % 20), f64::from(i / 20), -2.0]).collect();
    points.extend((0..100).map(|i| {
        let (x, y) = (f64::from(i % 10), f64::from(i / 10));
        [x + 5.0, y + 5.0, 8.0 - 0.05 * (x * x + y * y)]
    }));
    points.extend([[f64::NAN; 3], [0.0, f64::INFINITY, 0.0], [10.0, 10.0, 90.0]]);
    let scan = Scan {
        normals: Some(vec![[0.0, 0.0, 1.0]; points.len()]),
        colors: Some((0..points.len()).map(|i| [(i % 256) as u8, 7, 9]).collect()),
        viewpoint: Some([1.0, 2.0, 30.0]),
        points,
        is_mesh: false,
    };
    let path = folder.join(name);
    io::write(&path, &scan).unwrap();
    text(&path).to_owned()
}

#[test]
fn help_and_version_are_results() {
    for args in [&["--help"][..], &["help", "estimate"], &["estimate", "--help"], &["--version"]] {
        let (code, out, err) = sympose(args);
        assert_eq!((code, err.as_str()), (0, ""), "{args:?}");
        assert!(out.contains("sympose"), "{out}");
    }
    assert!(sympose(&["--help"]).1.contains("Examples:"));
}

#[test]
fn bad_usage_is_refused() {
    refused(&[], "Usage");
    refused(&["polish"], "unrecognized subcommand 'polish'");
    refused(&["estimate"], "<SCAN>");
    refused(&["estimate", HUB, "--order", "1"], "expected a whole number from 2 to 360");
    refused(&["estimate", HUB, "--order", "five"], "\"continuous\"");
    refused(&["estimate", HUB, "--viewpoint", "1", "2"], "--viewpoint");
    refused(&["estimate", HUB, "--viewpoint", "1", "2", "three"], "three");
    refused(&["estimate", HUB, "--ground", "maybe"], "expected one of `auto`, `on`, `off`");
    refused(&["estimate", HUB, "--residual", "plane"], "`point_to_plane`");
    refused(&["estimate", HUB, "--timeout", "0"], "positive number of seconds");
    refused(&["estimate", HUB, "--timeout", "nan"], "positive number of seconds");
    refused(&["estimate", HUB, "--voxel-size", "-0.5"], "voxel_size = -0.5");
    refused(&["estimate", HUB, "--threads", "0"], "threads = 0");
    refused(&["estimate", HUB, "--roi", "1", "1", "1", "0", "2", "2"], "finite corners, the lower one below");
    refused(&["estimate", HUB, "--roi", "0", "0", "0", "1", "1", "inf"], "finite corners");
    refused(&["estimate", HUB, "--axis-hint", "0", "0", "0"], "axis_hint");
    refused(&["estimate", HUB, "--viewpoint", "inf", "0", "0"], "NaN, infinite");
    refused(&["estimate", HUB, "--completed", "whole.stl"], "whole.stl: cannot write \"stl\"");
    refused(&["estimate", "none.ply", "--completed", "no/whole.ply"], "no: ");
    refused(&["estimate", "none.ply", "--json", "no/pose.json"], "no: ");
    refused(&["filter", "none.ply", "no/clean.ply", "--k", "20"], "no: ");
    refused(&["plane", "none.ply", "--remove", "no/rest.ply"], "no: ");
    refused(&["estimate", HUB, "--full"], "--json");
    refused(&["estimate", HUB, "--paper", "--config", "c.toml"], "cannot be used with");
    refused(&["filter", HUB, "out.ply"], "--voxel-size");
    refused(&["filter", HUB, "out.ply", "--k", "20", "--min-neighbors", "3"], "--radius");
    refused(&["filter", HUB, "out.stl", "--k", "20"], "out.stl: cannot write");
    refused(&["filter", HUB, "out.ply", "--voxel-size", "0"], "voxel_size = 0");
    refused(&["plane", HUB, "--distance", "-1"], "distance = -1");
}

#[test]
fn no_output_overwrites_the_scan_or_the_other_output() {
    let folder = tempfile::tempdir().unwrap();
    let copy = folder.path().join("hub.ply");
    std::fs::copy(HUB, &copy).unwrap();
    let roundabout = folder.path().join(".").join("hub.ply");
    refused(&["estimate", text(&copy), "--completed", text(&roundabout)], "another file than the scan");
    refused(&["estimate", text(&copy), "--json", text(&copy)], "another file than the scan");
    let new = folder.path().join("new.ply");
    let both = ["estimate", text(&copy), "--json", text(&new), "--completed", text(&new)];
    refused(&both, "another file than that of the completed cloud");
    assert_eq!(std::fs::read(&copy).unwrap(), std::fs::read(HUB).unwrap());
}

#[test]
fn bad_input_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (missing, foreign) = (folder.path().join("none.ply"), folder.path().join("photo.ply"));
    std::fs::write(&foreign, b"\x89PNG\r\n").unwrap();
    for command in ["estimate", "info", "plane"] {
        refused(&[command, text(&missing)], "none.ply");
        refused(&[command, text(&foreign)], "photo.ply: not a PLY file");
    }
    let settings = folder.path().join("settings.toml");
    let with_settings = ["estimate", HUB, "--config", text(&settings)];
    refused(&with_settings, "settings.toml");
    for (content, expected) in [
        ("order = 1", "expected a whole number from 2"),
        ("colour = 1", "unknown field `colour`"),
        ("ground = \"maybe\"", "unknown variant `maybe`"),
        ("ground", "settings.toml"),
        ("voxel_size = -1.0", "voxel_size = -1"),
    ] {
        std::fs::write(&settings, content).unwrap();
        refused(&with_settings, expected);
    }
    // The command line wins, so that a bad setting that it replaces does not matter.
    std::fs::write(&settings, "voxel_size = -1.0").unwrap();
    refused(&[&with_settings[..], &["--voxel-size", "5", "--threads", "0"]].concat(), "threads = 0");
}

#[test]
fn info_says_what_a_file_holds() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(folder.path(), "scene.pcd");
    let (code, out, err) = sympose(&["info", &scene, "--json"]);
    assert_eq!((code, err.as_str()), (0, ""));
    let info: Value = serde_json::from_str(&out).unwrap();
    assert_eq!((&info["points"], &info["finite"]), (&503.into(), &501.into()));
    assert_eq!(info["bounding_box"], serde_json::json!([[0.0, 0.0, -2.0], [19.0, 19.0, 90.0]]));
    assert_eq!(info["median_spacing"], 1.0);
    assert_eq!((&info["normals"], &info["colors"]), (&true.into(), &true.into()));
    assert_eq!(info["viewpoint"], serde_json::json!([1.0, 2.0, 30.0]));
    let (code, out, _) = sympose(&["info", HUB]);
    assert_eq!(code, 0);
    for (name, value) in
        [("points", "20000"), ("finite", "20000"), ("normals", "no"), ("viewpoint", "unknown")]
    {
        let line = out.lines().find(|line| line.starts_with(name)).unwrap();
        assert!(line.ends_with(value), "{line}");
    }
}

#[test]
fn filter_keeps_what_belongs_to_the_points() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(folder.path(), "scene.pcd");
    let out = folder.path().join("clean.pcd");
    let arguments = ["filter", &scene, text(&out), "--radius", "3", "--min-neighbors", "2"];
    let (code, stdout, stderr) = sympose(&arguments);
    assert_eq!((code, stdout.as_str()), (0, ""));
    assert!(
        stderr.lines().any(|line| line.starts_with("radius") && line.ends_with(" 500 points")),
        "{stderr}"
    );
    let before = io::read(&scene).unwrap();
    let clean = io::read(&out).unwrap();
    // The stray point and those that are not finite stand at the end.
    assert_eq!(clean.points, before.points[..500]);
    assert_eq!(clean.normals.unwrap().len(), 500);
    assert_eq!(clean.colors.unwrap(), before.colors.unwrap()[..500]);
    assert_eq!(clean.viewpoint, Some([1.0, 2.0, 30.0]));

    let quiet = sympose(&["filter", &scene, text(&out), "--voxel-size", "4", "--std-ratio", "2", "--quiet"]);
    assert_eq!(quiet, (0, String::new(), String::new()));
    let clean = io::read(&out).unwrap();
    assert!((30..150).contains(&clean.points.len()), "{}", clean.points.len());
    assert!(clean.points.iter().all(|p| p[2] < 10.0), "the stray point is gone");
    assert!(clean.normals.unwrap().iter().all(|n| *n == [0.0, 0.0, 1.0]));
    assert!(clean.colors.unwrap().iter().all(|c| c[1..] == [7, 9]));
}

#[test]
fn plane_finds_and_removes() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(folder.path(), "scene.ply");
    let rest = folder.path().join("rest.xyz");
    let (code, out, err) =
        sympose(&["plane", &scene, "--distance", "0.01", "--remove", text(&rest), "--json"]);
    let lost =
        "rest.xyz does not say where the sensor stood: write PCD, or give --viewpoint 1 2 30 to estimate\n";
    assert!(code == 0 && err.starts_with("warning: ") && err.ends_with(lost), "{err}");
    let plane: Value = serde_json::from_str(&out).unwrap();
    assert_eq!((&plane["inliers"], &plane["points"]), (&400.into(), &501.into()));
    let [a, b, c, d]: [f64; 4] = serde_json::from_value(plane["coefficients"].clone()).unwrap();
    assert!(a.abs() < 1e-9 && b.abs() < 1e-9 && (c - 1.0).abs() < 1e-9 && (d - 2.0).abs() < 1e-9);
    let rest = io::read(rest).unwrap();
    assert_eq!(rest.points.len(), 101);
    assert!(rest.points.iter().all(|p| p[2] > -1.99));
    let (code, out, _) = sympose(&["plane", &scene]);
    assert_eq!(code, 0);
    assert!(out.contains("within 2.0000000"), "twice the spacing: {out}");
}

#[test]
fn points_without_a_surface_have_no_pose() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("few.xyz");
    std::fs::write(&path, "0 0 0\n1 0 0\n2 0 0\n").unwrap();
    for command in [&["estimate", "--order", "3"][..], &["plane"]] {
        let (code, out, err) = sympose(&[command, &[text(&path)]].concat());
        assert_eq!((code, out.as_str()), (1, ""), "{err}");
        assert!(err.starts_with("sympose: "), "{err}");
    }
    let (code, out, _) = sympose(&["estimate", text(&path), "--order", "3", "--json", "-"]);
    let answer: Value = serde_json::from_str(&out).unwrap();
    assert_eq!((code, &answer["schema_version"]), (1, &1.into()));
    assert!(["insufficient_data", "degenerate"].contains(&answer["error"].as_str().unwrap()), "{out}");
    assert!(!answer["message"].as_str().unwrap().is_empty());
}

#[test]
fn a_deadline_is_kept() {
    // Negative numbers are numbers, also with an exponent.
    let hints =
        ["--viewpoint", "-1e-3", "0", "-500", "--axis-hint", "-1", "-.5", "-2E-1", "--order", "continuous"];
    let deadline = ["estimate", HUB, "--timeout", "0.001", "--json", "-"];
    let (code, out, err) = sympose(&[&deadline[..], &hints].concat());
    assert_eq!(code, 1, "{err}");
    assert!(err.contains("deadline"), "{err}");
    assert_eq!(serde_json::from_str::<Value>(&out).unwrap()["error"], "deadline_exceeded");
}

#[test]
fn a_cancelled_command_ends_at_once_and_writes_nothing() {
    let cancelled = CancelToken::default();
    cancelled.cancel();
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.ply");
    for args in [
        &["estimate", HUB, "--json", text(&out)][..],
        &["filter", HUB, text(&out), "--voxel-size", "5"],
        &["plane", HUB, "--remove", text(&out)],
        &["info", HUB],
    ] {
        let started = Instant::now();
        assert_eq!(sympose_with(&cancelled, args), (130, String::new(), String::new()), "{args:?}");
        assert!(started.elapsed().as_secs_f64() < 0.2, "{args:?}: {:?}", started.elapsed());
        assert!(!out.exists(), "{args:?}");
    }
    // What is asked wrongly, or only asks for help, needs no work that could be cancelled.
    assert_eq!(sympose_with(&cancelled, &["polish"]).0, 2);
    assert_eq!(sympose_with(&cancelled, &["--version"]).0, 0);
}

#[test]
fn a_running_estimate_is_cancelled() {
    let cancel = CancelToken::default();
    let later = cancel.clone();
    let slow = ["estimate", HUB, "--order", "5", "--threads", "1"];
    let alarm = std::thread::spawn(move || {
        std::thread::sleep(Duration::from_millis(20));
        later.cancel();
        Instant::now()
    });
    assert_eq!(sympose_with(&cancel, &slow), (130, String::new(), String::new()));
    let late = alarm.join().unwrap().elapsed();
    assert!(late.as_secs_f64() < 1.0, "{late:?}");
}

/// Standard output whose reader has gone, or a full disk.
struct Broken(ErrorKind);

impl Write for Broken {
    fn write(&mut self, _: &[u8]) -> std::io::Result<usize> {
        Err(Error::from(self.0))
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

#[test]
fn a_closed_pipe_is_no_error_and_a_full_disk_is() {
    for (kind, expected) in [(ErrorKind::BrokenPipe, 0), (ErrorKind::StorageFull, 2)] {
        let (mut err, never) = (Vec::new(), CancelToken::default());
        let info = ["sympose", "info", HUB].map(Into::into);
        let code = sympose::cli::run(info, &mut Broken(kind), &mut err, &never);
        assert_eq!((code, err.is_empty()), (expected, expected == 0));
        assert_eq!(sympose::cli::run(["sympose".into()], &mut Vec::new(), &mut Broken(kind), &never), 2);
    }
}

fn check_hub(estimate: &Estimate) {
    let axis = estimate.world_from_object.rotation * sympose::nalgebra::Vector3::z();
    let cos: f64 = axis.iter().zip(AXIS).map(|(a, b)| a * b).sum();
    let angle_deg = cos.abs().min(1.0).acos().to_degrees();
    assert!(angle_deg < 0.5, "{angle_deg} deg from the true axis");
    let from_axis = sympose::nalgebra::Vector3::from(CENTER) - estimate.world_from_object.translation.vector;
    let offset = from_axis.cross(&axis).norm() / DIAMETER;
    assert!(offset < 0.005, "{offset} diameters from the true centre");
    assert_eq!(estimate.order, Order::Cyclic(5));
    assert!(estimate.score >= 0.5);
}

#[test]
fn the_pose_of_the_bundled_scan() {
    let folder = tempfile::tempdir().unwrap();
    let (json, completed) = (folder.path().join("pose.json"), folder.path().join("whole.ply"));
    let full =
        ["estimate", HUB, "--order", "5", "--full", "--json", text(&json), "--completed", text(&completed)];
    let (code, out, err) = sympose(&full);
    assert_eq!((code, err.as_str()), (0, ""), "{out}");
    let estimate: Estimate = serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
    check_hub(&estimate);
    assert!(!estimate.points.is_empty() && estimate.completed.len() >= estimate.points.len());
    assert_eq!(io::read(&completed).unwrap().points, estimate.completed);
    for word in
        ["pose (world_from_object)", "axis ", "centre ", "order        5", "score ", "explained ", " deg"]
    {
        assert!(out.contains(word), "{word}: {out}");
    }

    // Standard output is JSON alone, without the long arrays, the same at any number of threads.
    let json = |threads| {
        let quiet = ["estimate", HUB, "--order", "5", "--json", "-", "--threads", threads, "--quiet"];
        let (code, out, err) = sympose(&quiet);
        assert_eq!((code, err.as_str()), (0, ""), "{out}");
        assert!(out.len() < 20_000, "{} bytes", out.len());
        let estimate: Estimate = serde_json::from_str(&out).unwrap();
        check_hub(&estimate);
        assert!(estimate.points.is_empty());
        let mut value: Value = serde_json::from_str(&out).unwrap();
        value.as_object_mut().unwrap().remove("timings");
        value.to_string()
    };
    assert_eq!(json("1"), json("2"));
}

#[test]
fn the_order_is_found_without_viewpoints() {
    // The file holds none: what was hidden looks like what is missing.
    let (code, out, err) = sympose(&["estimate", HUB, "--json", "-", "--quiet"]);
    assert_eq!((code, err.as_str()), (0, ""), "{out}");
    let estimate: Estimate = serde_json::from_str(&out).unwrap();
    check_hub(&estimate);
    assert!(estimate.warnings.iter().any(|warning| warning.contains("without viewpoints")));
}

#[test]
fn the_vertices_of_a_mesh_are_remarked_on() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mesh.ply");
    io::write(&path, &io::read(HUB).unwrap()).unwrap();
    let mut file = std::fs::read(&path).unwrap();
    let end = file.windows(11).position(|window| window == b"end_header\n").unwrap();
    file.splice(end..end, *b"element face 1\nproperty list uchar uchar vertex_indices\n");
    file.extend([3, 0, 1, 2]);
    for (content, is_mesh) in [(std::fs::read(&path).unwrap(), false), (file, true)] {
        std::fs::write(&path, content).unwrap();
        let (code, out, err) = sympose(&["estimate", text(&path), "--order", "5", "--json", "-", "--quiet"]);
        assert_eq!((code, err.as_str()), (0, ""), "{out}");
        let estimate: Estimate = serde_json::from_str(&out).unwrap();
        let remarked = estimate.warnings.iter().any(|warning| warning.contains("the scan is a mesh"));
        assert_eq!(remarked, is_mesh, "{out}");
    }
}

/// Exit code, output and messages for points on a box with three different edges, one of its faces sloping, and a plate
/// over one corner; or only on as many of these faces: those that one place sees are the first five.
fn estimate_of_box(faces: usize) -> (u8, String, String) {
    let mut lines = String::new();
    for i in 0..3600 {
        let (u, v) = (f64::from(i % 60) / 59.0, f64::from(i / 60) / 59.0);
        let all = [
            [u, 0.6 * v, 0.0],
            [u, 0.0, 0.25 * v],
            [0.0, 0.6 * u, 0.25 * v],
            [u, 0.6, 0.25 * v * (1.0 - 0.8 * u)],
            [0.7 + 0.2 * u, 0.1 + 0.2 * v, 0.35],
            [1.0, 0.6 * u, 0.25 * v * (1.0 - 0.8 * u)],
            [u, 0.6 * v, 0.25 * (1.0 - 0.8 * u * v)],
        ];
        for [x, y, z] in &all[..faces] {
            lines += &format!("{x} {y} {z}\n");
        }
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("box.xyz");
    std::fs::write(&path, lines).unwrap();
    sympose(&["estimate", text(&path), "--json", "-"])
}

#[test]
fn an_order_that_one_view_may_show_is_not_to_be_acted_on() {
    let (code, out, err) = estimate_of_box(5);
    assert_eq!(code, 1, "{out}");
    assert!(err.contains("below 0.5"), "{err}");
    let estimate: Estimate = serde_json::from_str(&out).unwrap();
    assert!(estimate.warnings.iter().any(|warning| warning.contains("one view shows too little")), "{out}");
}

#[test]
fn an_order_that_the_scan_does_not_show_is_not_made_up() {
    let (code, out, err) = estimate_of_box(7);
    assert_eq!(code, 1, "{out}");
    assert!(err.contains("viewpoint or the order"), "{err}");
    let refusal: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert_eq!(refusal["error"], "no_symmetry");
}

#[test]
fn noise_has_no_trustworthy_pose() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("noise.ply");
    // Golden-ratio sequence: an even filling of a long box.
    let fill = |i: u32, step: f64| (f64::from(i) * step).fract();
    let points =
        (0..3000).map(|i| [3.0 * fill(i, 0.8191725), 2.0 * fill(i, 0.6710436), fill(i, 0.5497005)]).collect();
    io::write(&path, &Scan { points, ..Scan::default() }).unwrap();
    let (code, _, err) = sympose(&["estimate", text(&path), "--order", "7"]);
    assert_eq!(code, 1, "{err}");
    assert!(!err.is_empty());
}

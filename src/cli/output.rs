//! What the subcommands print: readable text, or one line of JSON.

use std::fmt::Write;

use serde::Serialize;
use serde_json::{Value, json};

use crate::error::Error;
use crate::estimate::Estimate;
use crate::schema::SCHEMA_VERSION;

/// What `sympose info` says about a file.
#[derive(Debug, Serialize)]
pub(super) struct Info {
    pub(super) points: usize,
    /// Points without a NaN or infinite coordinate.
    pub(super) finite: usize,
    /// Lower and upper corner of the finite points.
    pub(super) bounding_box: Option<[[f64; 3]; 2]>,
    /// Median distance of a point to its nearest neighbour.
    pub(super) median_spacing: Option<f64>,
    pub(super) normals: bool,
    pub(super) colors: bool,
    pub(super) viewpoint: Option<[f64; 3]>,
}

/// What `sympose plane` found.
#[derive(Debug, Serialize)]
pub(super) struct PlaneReport {
    /// Unit normal n and d: n . x + d = 0.
    pub(super) coefficients: [f64; 4],
    /// Largest distance of an inlier from the plane.
    pub(super) distance: f64,
    pub(super) inliers: usize,
    /// Finite points of the scan.
    pub(super) points: usize,
    pub(super) iterations: usize,
}

pub(super) fn info_text(info: &Info) -> String {
    let mut text = format!("points          {}\nfinite          {}\n", info.points, info.finite);
    if let Some([lower, upper]) = info.bounding_box {
        let _ = writeln!(text, "lower corner    {}", row(&lower));
        let _ = writeln!(text, "upper corner    {}", row(&upper));
        let size: [f64; 3] = std::array::from_fn(|axis| upper[axis] - lower[axis]);
        let _ = writeln!(text, "size            {}", row(&size));
    }
    if let Some(spacing) = info.median_spacing {
        let _ = writeln!(text, "median spacing  {}", number(spacing));
    }
    let yes_no = |yes: bool| if yes { "yes" } else { "no" };
    let _ = writeln!(text, "normals         {}", yes_no(info.normals));
    let _ = writeln!(text, "colours         {}", yes_no(info.colors));
    let viewpoint = info.viewpoint.map_or_else(|| "unknown".to_owned(), |viewpoint| row(&viewpoint));
    let _ = writeln!(text, "viewpoint       {viewpoint}");
    text
}

pub(super) fn plane_text(plane: &PlaneReport) -> String {
    let [a, b, c, d] = plane.coefficients;
    format!(
        "normal    {}\noffset    {}\ninliers   {} of {} within {}\n",
        row(&[a, b, c]),
        number(d),
        plane.inliers,
        plane.points,
        number(plane.distance)
    )
}

pub(super) fn estimate_text(estimate: &Estimate) -> String {
    let pose = estimate.world_from_object.to_homogeneous();
    let column = |column: usize| std::array::from_fn(|row| pose[(row, column)]);
    let mut text = String::from("pose (world_from_object)\n");
    for line in 0..4 {
        let line: [f64; 4] = std::array::from_fn(|column| pose[(line, column)]);
        let _ = writeln!(text, "  {}", row(&line));
    }
    let _ = writeln!(text, "axis         {}", row::<3>(&column(2)));
    let _ = writeln!(text, "centre       {}", row::<3>(&column(3)));
    let _ = writeln!(text, "order        {}", estimate.order);
    let _ = writeln!(text, "score        {:.3}", estimate.score);
    let _ = writeln!(text, "explained    {:.1} %", 100.0 * estimate.explained);
    text += "sigma, object frame\n";
    for (index, name) in
        ["rotation x", "rotation y", "yaw", "shift x", "shift y", "slide"].into_iter().enumerate()
    {
        let sigma = estimate.covariance[index][index].sqrt();
        let shown = match index {
            _ if !sigma.is_finite() => "free".to_owned(),
            0..3 => format!("{} deg", significant(sigma.to_degrees(), 3)),
            _ => significant(sigma, 3),
        };
        let _ = writeln!(text, "  {name:<10} {shown:>16}");
    }
    for warning in &estimate.warnings {
        let _ = writeln!(text, "warning: {warning}");
    }
    text
}

/// JSON of a result without a pose, so that a reader of the output need not parse messages.
pub(super) fn failure_json(error: &Error) -> Value {
    let (kind, evidence) = match error {
        Error::NoSymmetry { evidence } => ("no_symmetry", json!(evidence)),
        Error::InsufficientData { .. } => ("insufficient_data", Value::Null),
        Error::Degenerate { .. } => ("degenerate", Value::Null),
        Error::DeadlineExceeded { .. } => ("deadline_exceeded", Value::Null),
        Error::Cancelled => ("cancelled", Value::Null),
        _ => ("invalid_input", Value::Null),
    };
    json!({
        "schema_version": SCHEMA_VERSION,
        "error": kind,
        "message": error.to_string(),
        "evidence": evidence,
    })
}

fn row<const N: usize>(values: &[f64; N]) -> String {
    values.iter().map(|value| format!("{:>16}", number(*value))).collect()
}

fn number(value: f64) -> String {
    significant(value, 8)
}

/// So many significant digits, without an exponent where the number can do without.
fn significant(value: f64, digits: usize) -> String {
    let magnitude = value.abs();
    if magnitude != 0.0 && !(1e-6..1e9).contains(&magnitude) {
        return format!("{value:.*e}", digits - 1);
    }
    // Zeros after the point are not significant, but at most a few of them are wanted.
    let before = if magnitude == 0.0 { 0 } else { (magnitude.log10().floor() as i32 + 1).max(-3) };
    format!("{value:.*}", usize::try_from(digits as i32 - before).unwrap_or(0))
}

//! The JSON schema of an estimate.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::collections::BTreeMap;

use proptest::prelude::*;
use serde_json::{Value, json};
use sympose::estimate::{Candidate, Diagnostic, FreeDirection};
use sympose::nalgebra::{Isometry3, Translation3, UnitQuaternion};
use sympose::{Estimate, Order};

fn estimate(angles: [f64; 3], shift: [f64; 3], rows: usize) -> Estimate {
    let rotation = UnitQuaternion::from_euler_angles(angles[0], angles[1], angles[2]);
    let mut covariance = [[0.1 / 3.0; 6]; 6];
    covariance[2] = [0.0; 6];
    covariance.iter_mut().for_each(|row| row[2] = 0.0);
    covariance[2][2] = f64::INFINITY;
    let point = |i: usize| [i as f64 / 3.0, -shift[0], 1e-300];
    Estimate {
        world_from_object: Isometry3::from_parts(Translation3::from(shift), rotation),
        order: Order::Continuous,
        score: 0.75,
        explained: 1.0 / 3.0,
        covariance,
        unobservable: vec![FreeDirection::Yaw],
        warnings: vec!["few points".into()],
        points: (0..rows).map(point).collect(),
        normals: vec![[0.0, 0.0, 1.0]; rows],
        inliers: (0..2 * rows as u32).collect(),
        point_of_inlier: (0..2 * rows as u32).map(|i| i / 2).collect(),
        completed: (0..3 * rows).map(point).collect(),
        completed_sector: (0..3 * rows as u32).map(|i| i % 3).collect(),
        ground: Some([0.0, 0.0, 1.0, -0.1]),
        match_curve: vec![[0.0, 1.0], [0.1, 0.7]],
        candidates: vec![Candidate {
            axis: [0.0, 0.0, 1.0],
            center: shift,
            order: Order::Cyclic(7),
            score: 0.3,
        }],
        timings: BTreeMap::from([("refine".into(), 0.25)]),
        diagnostics: BTreeMap::from([
            ("flag".into(), Diagnostic::Flag(true)),
            ("number".into(), Diagnostic::Number(0.1)),
            ("series".into(), Diagnostic::Series(vec![1.0, f64::NAN])),
            ("text".into(), Diagnostic::Text("support plane".into())),
            ("unknown".into(), Diagnostic::Number(f64::NAN)),
        ]),
    }
}

proptest! {
    /// Every bit comes back; of numbers that are not finite, infinite variances do, and others are NaN.
    #[test]
    fn what_is_written_comes_back(
        angles in prop::array::uniform3(-3.0..3.0_f64),
        shift in prop::array::uniform3(-1e7..1e7_f64),
        rows in 0_usize..9,
    ) {
        let before = estimate(angles, shift, rows);
        let text = serde_json::to_string(&before).unwrap();
        let after: Estimate = serde_json::from_str(&text).unwrap();
        prop_assert_eq!(format!("{after:?}"), format!("{before:?}"));
        prop_assert_eq!(serde_json::to_string(&after).unwrap(), text);
    }
}

#[test]
fn the_names_are_those_of_the_python_class() {
    let value = serde_json::to_value(estimate([0.1, 0.2, 0.3], [1.0, 2.0, 3.0], 2)).unwrap();
    let mut names: Vec<_> = value.as_object().unwrap().keys().map(String::as_str).collect();
    names.sort_unstable();
    let mut expected = [
        "schema_version",
        "pose",
        "axis",
        "center",
        "quaternion",
        "order",
        "score",
        "explained",
        "covariance",
        "unobservable",
        "warnings",
        "points",
        "normals",
        "inliers",
        "point_of_inlier",
        "completed",
        "completed_sector",
        "ground",
        "match_curve",
        "candidates",
        "timings",
        "diagnostics",
    ];
    expected.sort_unstable();
    assert_eq!(names, expected);
    assert_eq!(value["schema_version"], 1);
    assert_eq!(value["order"], "continuous");
    assert_eq!(value["unobservable"], json!(["yaw"]));
    assert_eq!(value["covariance"][2], json!([0.0, 0.0, null, 0.0, 0.0, 0.0]));
    assert_eq!(value["center"], json!([1.0, 2.0, 3.0]));
    assert_eq!(value["candidates"][0]["order"], 7);
    for row in 0..3 {
        assert_eq!(value["pose"][row][2], value["axis"][row]);
        assert_eq!(value["pose"][row][3], value["center"][row]);
    }
    assert_eq!(value["pose"][3], json!([0.0, 0.0, 0.0, 1.0]));
    // The quaternion in the order x y z w: half a turn about x.
    let half = serde_json::to_value(estimate([std::f64::consts::PI, 0.0, 0.0], [0.0; 3], 0)).unwrap();
    assert!((half["quaternion"][0].as_f64().unwrap().abs() - 1.0).abs() < 1e-12);
}

#[test]
fn a_summary_has_no_long_arrays_and_can_be_read() {
    let before = estimate([0.1, 0.2, 0.3], [1.0, 2.0, 3.0], 1000);
    let text = serde_json::to_string(&before.summary()).unwrap();
    assert!(text.len() < 3000, "{}", text.len());
    let after: Estimate = serde_json::from_str(&text).unwrap();
    assert_eq!(after.world_from_object, before.world_from_object);
    assert_eq!(after.diagnostics["text"], before.diagnostics["text"]);
    assert!(after.points.is_empty() && after.inliers.is_empty() && after.match_curve.is_empty());
}

#[test]
fn what_is_wrong_is_named() {
    let good = serde_json::to_value(estimate([0.1, 0.2, 0.3], [1.0, 2.0, 3.0], 2)).unwrap();
    let refused = |name: &str, value: Value| {
        let mut document = good.clone();
        document[name] = value;
        serde_json::from_value::<Estimate>(document).unwrap_err().to_string()
    };
    assert_eq!(refused("schema_version", json!(2)), "schema_version 2: this version of sympose reads 1");
    assert!(refused("quaternion", json!([0, 0, 0, 2])).contains("expected unit length, found 2"));
    assert!(refused("quaternion", json!([0, 0, 0, 1])).contains("contradicts quaternion"));
    assert!(refused("order", json!(1)).contains("order = 1"));
    assert!(refused("order", json!(5.0)).contains("order = 5.0: expected a whole number"));
    assert!(refused("order", json!("auto")).contains("order = auto: expected the order that was found"));
    assert!(refused("points", json!([])).contains("points has 0 rows, but normals 2"));
    let mut document = good.clone();
    document.as_object_mut().unwrap().remove("schema_version");
    assert!(serde_json::from_value::<Estimate>(document).unwrap_err().to_string().contains("schema_version"));
    // A later addition does no harm.
    let mut document = good.clone();
    document["added_later"] = json!(1);
    assert!(serde_json::from_value::<Estimate>(document).is_ok());
}

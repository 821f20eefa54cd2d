//! Clouds, poses and settings from which no estimate is made, and what the messages say.

mod scenes;

use scenes::knob::{axis_error_deg, cyclic, estimate, knob};
use serde_json::Value;
use sympose::config::TrackingParams;
use sympose::metrics::{adds, mssd};
use sympose::nalgebra::Isometry3;
use sympose::preprocess::{ClusterParams, main_cluster, voxel_downsample};
use sympose::{Config, Error, Estimator, PointCloud, Request};

#[test]
fn poses_and_viewpoints_that_are_not_finite_are_refused() {
    let cloud = PointCloud::from_points(knob(5, 5_000)).unwrap();
    let nan = Isometry3::translation(0.0, f64::NAN, 0.0);
    let estimator = Estimator::new(cyclic(5)).unwrap();
    for (name, request) in [
        ("initial", Request { initial: Some(nan), ..Request::default() }),
        ("prefer", Request { prefer: Some(nan), ..Request::default() }),
    ] {
        let refused = estimator.estimate_with(&cloud, &request);
        assert!(matches!(refused, Err(Error::InvalidParameter { name: found, .. }) if found == name));
    }
    let here = Isometry3::identity();
    let points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]];
    assert!(matches!(mssd(&points, &nan, &here, &[]), Err(Error::InvalidParameter { .. })));
    assert!(matches!(mssd(&points, &here, &here, &[nan]), Err(Error::InvalidParameter { .. })));
    assert!(matches!(mssd(&[[f64::NAN; 3]], &here, &here, &[]), Err(Error::NonFinite { .. })));
    assert!(matches!(adds(&points, &here, &nan), Err(Error::InvalidParameter { .. })));
    let refused = cloud.with_viewpoints([[0.0, 0.0, f64::NAN]]).unwrap_err().to_string();
    assert!(refused.starts_with("viewpoints = 1 of 1 rows"), "{refused}");
}

#[test]
fn clouds_that_hold_no_part_are_refused_with_a_reason() {
    let line = (0..1000).map(|i| [f64::from(i), 2.0 * f64::from(i), 0.0]).collect();
    assert!(matches!(estimate(line, cyclic(4)), Err(Error::Degenerate { shape: "collinear" })));
    assert!(matches!(
        estimate(vec![[1.0, 2.0, 3.0]; 200_000], cyclic(4)),
        Err(Error::Degenerate { shape: "identical" })
    ));
    assert!(matches!(estimate(knob(5, 20), cyclic(5)), Err(Error::InsufficientData { .. })));
    assert!(matches!(estimate(Vec::new(), cyclic(5)), Err(Error::InsufficientData { .. })));
    assert!(matches!(estimate(knob(5, 1000), cyclic(1)), Err(Error::InvalidParameter { name: "order", .. })));
    let nowhere = Config { roi: Some([[10.0; 3], [11.0; 3]]), ..cyclic(5) };
    assert!(matches!(estimate(knob(5, 1000), nowhere), Err(Error::InsufficientData { .. })));
}

#[test]
fn sizes_whose_squares_single_precision_does_not_hold_are_refused() {
    let scaled = |scale: f64| knob(5, 6000).iter().map(|p| p.map(|x| x * scale)).collect::<Vec<_>>();
    // As long as the squares are there, the unit changes nothing.
    let axis_error =
        |scale| Ok::<_, Error>(axis_error_deg(&estimate(scaled(scale), cyclic(5))?, &Isometry3::identity()));
    assert!((axis_error(1e-17).unwrap() - axis_error(1.0).unwrap()).abs() < 1e-3);
    for scale in [1e-19, 1e-21, 1e-160, 1e-300] {
        let refused = PointCloud::from_points(scaled(scale));
        assert!(
            matches!(refused, Err(Error::InvalidParameter { name: "points", .. })),
            "{scale:e}: {refused:?}"
        );
    }
    // Few digits are left of what is small and far from the origin, but one place is no small extent.
    assert_eq!(PointCloud::from_points(vec![[1e17, 0.0, 1e-30]; 3]).unwrap().len(), 3);
}

#[test]
fn what_lies_far_from_the_part_is_not_blamed_on_a_setting_that_was_not_given() {
    // A part, and further points in the box about it that are far away beside its size but not beside the whole scan.
    let part = knob(5, 20_000).into_iter().map(|p| p.map(|x| 1e-3 * x));
    let beside = knob(5, 60_000).into_iter().map(|[x, y, z]| [2.0 * x, 2.0 * y + 3.0, 2.0 * z]);
    let strays = (0..20).map(|i| [80.0 + 0.1 * f64::from(i), 0.0, 0.0]);
    let points: Vec<[f64; 3]> = part.chain(beside).chain(strays).collect();
    let roi = Some([[-1.0; 3], [90.0, 1.0, 1.0]]);
    let refused = estimate(points.clone(), Config { roi, ..cyclic(5) }).unwrap_err();
    assert!(matches!(refused, Error::InvalidParameter { name: "points", .. }), "{refused}");
    // One that was given is.
    let refused = estimate(points, Config { roi, voxel_size: Some(1e-5), ..cyclic(5) }).unwrap_err();
    assert!(matches!(refused, Error::InvalidParameter { name: "voxel_size", .. }), "{refused}");

    // On a table, where what is not of the part is told from it before its size is known.
    let standing = knob(5, 40_000).into_iter().map(|[x, y, z]| [x, y, z + 0.1]);
    let table = (0..40_000).map(|i| [0.02 * f64::from(i % 200) - 2.0, 0.02 * f64::from(i / 200) - 2.0, 0.0]);
    let strays = (0..50).map(|i| [0.0, 0.0, 90.0 + 0.1 * f64::from(i)]);
    let points: Vec<[f64; 3]> = standing.chain(table).chain(strays).collect();
    for distance in [1e-4, 1e6] {
        let mut config = cyclic(5);
        config.outliers.cluster_distance = distance;
        let found = estimate(points.clone(), config);
        assert!(!matches!(found, Err(Error::InvalidParameter { .. })), "{found:?}");
    }
}

#[test]
fn a_short_hint_is_one_all_the_same() {
    // At right angles to the axis.
    let hinted = |length: f64| {
        let config = Config { axis_hint: Some([length, 0.0, 0.0]), ..cyclic(5) };
        estimate(knob(5, 10_000), config).map(|found| found.world_from_object.to_string())
    };
    let [tiny, usual] = [1e-13, 1.0].map(|length| hinted(length).map_err(|refused| refused.to_string()));
    assert_eq!(tiny, usual);
    assert_ne!(
        usual.ok(),
        estimate(knob(5, 10_000), cyclic(5)).ok().map(|found| found.world_from_object.to_string())
    );
}

#[test]
fn messages_show_no_rows_of_digits() {
    let refused = |change: fn(&mut Config)| {
        let mut config = cyclic(5);
        change(&mut config);
        Estimator::new(config).unwrap_err().to_string()
    };
    let messages = [
        refused(|config| config.voxel_size = Some(5e-324)),
        refused(|config| config.refine.max_normal_angle = 1e300),
        refused(|config| config.roi = Some([[1e300; 3], [-1e300; 3]])),
        refused(|config| config.axis_hint = Some([5e-324; 3])),
        refused(|config| config.propose.gate = 1e308),
        refused(|config| config.refine.gate = 1e308),
        PointCloud::from_points(vec![[1e300; 3]; 3]).unwrap_err().to_string(),
        voxel_downsample(&[[0.0; 3], [1e300; 3]], 1e-300).unwrap_err().to_string(),
        main_cluster(&[[0.0; 3]], &ClusterParams { distance: 1.0, keep_ratio: -1e300 })
            .unwrap_err()
            .to_string(),
        adds(&[[0.0; 3]], &Isometry3::translation(1e300, 0.0, f64::NAN), &Isometry3::identity())
            .unwrap_err()
            .to_string(),
    ];
    for message in messages {
        assert!(message.len() < 250 && !message.contains("00000000"), "{message}");
    }
    // Ordinary numbers are plain.
    assert!(refused(|config| config.detect.support = 1.5).starts_with("detect.support = 1.5: expected"));
    assert!(refused(|config| config.voxel_size = Some(-0.002)).starts_with("voxel_size = -0.002: expected"));
}

#[test]
fn settings_outside_their_domain_are_named() {
    let mut no_samples = cyclic(5);
    no_samples.refine.samples = 0;
    assert!(matches!(no_samples.validate(), Err(Error::InvalidParameter { name: "refine.samples", .. })));
    let trackings =
        [("tracking.points", 2.0, 0), ("tracking.coarsening", 0.5, 1), ("tracking.coarsening", f64::NAN, 1)];
    for (setting, coarsening, points) in trackings {
        let refused = Config { tracking: TrackingParams { coarsening, points }, ..cyclic(5) }.validate();
        assert!(matches!(refused, Err(Error::InvalidParameter { name, .. }) if name == setting));
    }
    let mut below_surface = cyclic(5);
    below_surface.outliers.off_surface = Some(-1.0);
    let refused = below_surface.validate();
    assert!(matches!(refused, Err(Error::InvalidParameter { name: "outliers.off_surface", .. })));
    below_surface.outliers.off_surface = None;
    assert!(below_surface.validate().is_ok());
}

#[test]
fn no_number_of_a_configuration_may_be_negative() {
    fn numbers(value: &Value, path: &str, found: &mut Vec<String>) {
        match value {
            Value::Object(fields) => {
                fields.iter().for_each(|(name, field)| numbers(field, &format!("{path}/{name}"), found));
            }
            Value::Array(items) => {
                items.iter().enumerate().for_each(|(i, item)| numbers(item, &format!("{path}/{i}"), found));
            }
            Value::Number(_) => found.push(path.to_owned()),
            _ => {}
        }
    }
    let mut config = Config { threads: Some(1), voxel_size: Some(1.0), ..Config::default() };
    config.normals.max_radius = Some(1.0);
    let whole = serde_json::to_value(config).unwrap();
    let mut paths = Vec::new();
    numbers(&whole, "", &mut paths);
    assert!(paths.len() > 55, "{}", paths.len());
    for path in paths {
        let mut changed = whole.clone();
        *changed.pointer_mut(&path).unwrap() = Value::from(-1);
        // Counts are refused where they are read.
        let Ok(config) = serde_json::from_value::<Config>(changed) else { continue };
        let setting = path[1..].replace('/', ".");
        match config.validate() {
            Err(Error::InvalidParameter { name, .. }) => assert_eq!(name, setting),
            other => panic!("{setting} = -1: {other:?}"),
        }
    }
}

#[test]
fn counts_that_no_memory_would_hold_are_refused() {
    let huge = Value::from(1_u64 << 60);
    for path in [
        "/normals/k",
        "/outliers/k",
        "/smoothing/ray_neighbors",
        "/smoothing/max_neighbors",
        "/propose/max_turns",
        "/refine/max_turns",
        "/refine/max_joint_turns",
        "/refine/max_joint_steps",
    ] {
        let mut changed = serde_json::to_value(Config::default()).unwrap();
        *changed.pointer_mut(path).unwrap() = huge.clone();
        let config: Config = serde_json::from_value(changed).unwrap();
        let setting = path[1..].replace('/', ".");
        match config.validate() {
            Err(Error::InvalidParameter { name, .. }) => assert_eq!(name, setting),
            other => panic!("{setting}: {other:?}"),
        }
    }
}

#[test]
fn limits_that_leave_nothing_are_refused_by_their_name() {
    let refused = |change: fn(&mut Config)| {
        let mut config = Config::default();
        change(&mut config);
        match config.validate() {
            Err(Error::InvalidParameter { name, .. }) => name,
            other => panic!("{other:?}"),
        }
    };
    assert_eq!(refused(|c| c.outliers.min_neighbors = c.outliers.k), "outliers.min_neighbors");
    assert_eq!(refused(|c| c.outliers.cluster_ratio = 5.0), "outliers.cluster_ratio");
    assert_eq!(refused(|c| c.detect.samples = 0), "detect.samples");
    assert_eq!(refused(|c| c.detect.explained = f64::NAN), "detect.explained");
    assert_eq!(refused(|c| c.propose.kept = [12, 0, 3]), "propose.kept");
    assert_eq!(refused(|c| c.normals.k = 1), "normals.k");
    assert_eq!(refused(|c| c.threads = Some(0)), "threads");
}

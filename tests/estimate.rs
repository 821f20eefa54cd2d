//! The whole pipeline on analytic parts: pose, order, invariance, determinism, and what is refused.

use std::cell::Cell;
use std::f64::consts::TAU;
use std::sync::Arc;
use std::time::Duration;

use rayon::prelude::*;
use serde_json::Value;
use sympose::config::TrackingParams;
use sympose::metrics::{adds, mssd};
use sympose::nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use sympose::preprocess::{ClusterParams, main_cluster, voxel_downsample};
use sympose::result::{Diagnostic, FreeDirection};
use sympose::{
    CancelToken, Config, Control, Error, Estimate, Estimator, Order, PointCloud, Reference, Request,
};

/// A lobed knob with a dished top, seen all round: points about the z axis, lobes of `order` (0: none).
fn knob(order: u32, count: usize) -> Vec<[f64; 3]> {
    let golden = 0.618_033_988_749_894_9;
    let lobed = |angle: f64| if order == 0 { 0.4 } else { 0.4 + 0.05 * (f64::from(order) * angle).cos() };
    (0..count)
        .map(|i| {
            let share = (i as f64 + 0.5) / count as f64;
            let angle = TAU * (i as f64 * golden).fract();
            let rim = lobed(angle);
            // Noise of a thousandth, from a second low-discrepancy sequence.
            let noise = 0.002 * ((i as f64 * 0.754_877_666_2).fract() - 0.5);
            if share < 0.4 {
                let r = rim * (share / 0.4).sqrt();
                [r * angle.cos(), r * angle.sin(), 0.15 + 0.1 * r * r + noise]
            } else if share < 0.7 {
                let z = -0.1 + (0.25 + 0.1 * rim * rim) * (share - 0.4) / 0.3;
                [(rim + noise) * angle.cos(), (rim + noise) * angle.sin(), z]
            } else {
                let r = rim * ((share - 0.7) / 0.3).sqrt();
                [r * angle.cos(), r * angle.sin(), -0.1 + noise]
            }
        })
        .collect()
}

fn moved(points: &[[f64; 3]], pose: &Isometry3<f64>, scale: f64) -> Vec<[f64; 3]> {
    points.iter().map(|p| (pose * Point3::from(p.map(|x| x * scale))).coords.into()).collect()
}

fn tilted() -> Isometry3<f64> {
    Isometry3::from_parts(
        Translation3::new(3.0, -2.0, 1.0),
        UnitQuaternion::from_euler_angles(0.7, -0.4, 1.1),
    )
}

fn estimate(points: Vec<[f64; 3]>, config: Config) -> Result<Estimate, Error> {
    Estimator::new(config)?.estimate(&PointCloud::from_points(points)?)
}

fn cyclic(order: u32) -> Config {
    Config { order: Order::Cyclic(order), ..Config::default() }
}

fn axis_error_deg(estimate: &Estimate, truth: &Isometry3<f64>) -> f64 {
    let (a, b) = (estimate.world_from_object * Vector3::z(), truth * Vector3::z());
    a.cross(&b).norm().atan2(a.dot(&b).abs()).to_degrees()
}

fn offset(estimate: &Estimate, truth: &Isometry3<f64>) -> f64 {
    let axis = estimate.world_from_object * Vector3::z();
    let d = truth.translation.vector - estimate.world_from_object.translation.vector;
    (d - axis * axis.dot(&d)).norm()
}

#[test]
fn a_known_order_gives_the_pose() {
    let truth = tilted();
    let found = estimate(moved(&knob(5, 30_000), &truth, 1.0), cyclic(5)).unwrap();
    assert!(axis_error_deg(&found, &truth) < 0.05, "{}", axis_error_deg(&found, &truth));
    assert!(offset(&found, &truth) < 5e-4);
    assert!(found.score > 0.8 && found.explained > 0.95);
    assert_eq!(found.inliers.len(), found.point_of_inlier.len());
    assert!(found.point_of_inlier.iter().all(|&i| (i as usize) < found.points.len()));
    assert_eq!(found.completed.len(), found.completed_sector.len());
    // +x points at a lobe: the harmonic phase is the direction in which there is most surface.
    let x = truth.inverse() * (found.world_from_object * Vector3::x());
    let off_lobe = (5.0 * x.y.atan2(x.x)).sin().atan2((5.0 * x.y.atan2(x.x)).cos()) / 5.0;
    assert!(off_lobe.abs().to_degrees() < 2.0, "{} deg off the lobe", off_lobe.to_degrees());
}

#[test]
fn the_order_is_found() {
    let truth = tilted();
    for (order, expected) in [(3, Order::Cyclic(3)), (8, Order::Cyclic(8)), (0, Order::Continuous)] {
        let found = estimate(moved(&knob(order, 20_000), &truth, 1.0), Config::default()).unwrap();
        assert_eq!(found.order, expected);
        assert!(axis_error_deg(&found, &truth) < 0.2, "order {order}: {}", axis_error_deg(&found, &truth));
    }
}

#[test]
fn a_small_largest_order_is_found_too() {
    let mut config = Config::default();
    config.detect.max_order = 8;
    let found = estimate(knob(8, 20_000), config).unwrap();
    assert_eq!(found.order, Order::Cyclic(8));
}

#[test]
fn a_wrong_order_is_warned_of() {
    let found = estimate(knob(6, 20_000), cyclic(3)).unwrap();
    assert_eq!(found.order, Order::Cyclic(3));
    assert!(found.warnings.iter().any(|w| w.contains("order 6")), "{:?}", found.warnings);
}

#[test]
fn a_part_without_symmetry_is_refused() {
    // A box with three different edges and a boss in one corner.
    let mut points: Vec<[f64; 3]> = Vec::new();
    for i in 0..60 {
        for j in 0..60 {
            let (u, v) = (f64::from(i) / 59.0, f64::from(j) / 59.0);
            points.push([u, 0.6 * v, 0.0]);
            points.push([u, 0.0, 0.25 * v]);
            points.push([0.0, 0.6 * u, 0.25 * v]);
            points.push([u, 0.6, 0.25 * v * (1.0 - 0.8 * u)]);
            points.push([0.7 + 0.2 * u, 0.1 + 0.2 * v, 0.35]);
        }
    }
    let refused = estimate(points, Config::default());
    assert!(matches!(refused, Err(Error::NoSymmetry { .. })), "{:?}", refused.map(|e| e.order));
}

#[test]
fn the_pose_follows_the_cloud() {
    let points = knob(5, 20_000);
    let reference = estimate(points.clone(), cyclic(5)).unwrap();
    let turn = tilted();
    let far = Isometry3::from_parts(Translation3::new(4e6, -4e6, 4e6), UnitQuaternion::identity());
    for (name, motion, scale) in
        [("turned", turn, 1.0), ("shifted", far, 1.0), ("scaled", Isometry3::identity(), 1e3)]
    {
        let found = estimate(moved(&points, &motion, scale), cyclic(5)).unwrap();
        let axis = motion.inverse() * (found.world_from_object * Vector3::z());
        let center = motion.inverse() * Point3::from(found.world_from_object.translation.vector) / scale;
        let tilt = (axis - reference.world_from_object * Vector3::z()).norm();
        let shift = (center.coords - reference.world_from_object.translation.vector).norm();
        let heading = motion.inverse() * (found.world_from_object * Vector3::x());
        let turn = (heading - reference.world_from_object * Vector3::x()).norm();
        assert!(tilt < 1e-5 && shift < 1e-5 && turn < 1e-5, "{name}: {tilt} {shift} {turn}");
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bytes() {
    let points = moved(&knob(5, 20_000), &tilted(), 1.0);
    let with = |threads| {
        let mut found = estimate(points.clone(), Config { threads: Some(threads), ..cyclic(5) }).unwrap();
        found.timings.clear();
        serde_json::to_string(&found).unwrap()
    };
    let one = with(1);
    assert!(one == with(2) && one == with(4));
}

/// A worker that waits for the pool of an estimate must not begin the next one inside it: many clouds would be held at
/// once, and the stack would overflow.
#[test]
fn estimates_in_parallel_each_with_threads_of_its_own_do_not_nest() {
    thread_local!(static RUNNING: Cell<u32> = const { Cell::new(0) });
    let cloud = PointCloud::from_points(knob(5, 3000)).unwrap();
    let estimator = Estimator::new(Config { threads: Some(2), ..cyclic(5) }).unwrap();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
    let one = |_| {
        let running = RUNNING.replace(RUNNING.get() + 1);
        let found = estimator.estimate(&cloud);
        RUNNING.set(running);
        assert_eq!(found.unwrap().order, Order::Cyclic(5));
        running
    };
    let running: Vec<u32> = pool.install(|| (0..12).into_par_iter().with_max_len(1).map(one).collect());
    assert_eq!(running, [0; 12]);
}

#[test]
fn the_preferred_pose_chooses_among_the_equivalent_ones() {
    let points = knob(5, 20_000);
    let cloud = PointCloud::from_points(points).unwrap();
    let estimator = Estimator::new(cyclic(5)).unwrap();
    let first = estimator.estimate(&cloud).unwrap().world_from_object;
    let turn = |k: f64| {
        first
            * Isometry3::from_parts(
                Translation3::identity(),
                UnitQuaternion::from_axis_angle(&Vector3::z_axis(), k),
            )
    };
    for k in 0..5 {
        let prefer = turn(TAU * f64::from(k) / 5.0 + 0.2);
        let request = Request { prefer: Some(prefer), ..Request::default() };
        let chosen = estimator.estimate_with(&cloud, &request).unwrap().world_from_object;
        assert!((chosen.rotation.angle_to(&prefer.rotation) - 0.2).abs() < 1e-6);
    }
}

#[test]
fn the_taught_frame_is_found_in_the_next_scan() {
    let first = estimate(moved(&knob(5, 20_000), &tilted(), 1.0), cyclic(5)).unwrap();
    let frame = tilted().inverse() * first.world_from_object;
    let reference = Reference::from_estimate(&first).unwrap();
    let stored = serde_json::to_string(&reference).unwrap();
    let read: Reference = serde_json::from_str(&stored).unwrap();
    let request = |reference| Request { reference: Some(Arc::new(reference)), ..Request::default() };
    let [kept, read] = [request(reference), request(read)];

    // Another pose and other points: the frame differs by a multiple of 72 degrees only.
    let truth = tilted().inverse();
    let cloud = PointCloud::from_points(moved(&knob(5, 23_000), &truth, 1.0)).unwrap();
    let estimator = Estimator::new(Config::default()).unwrap();
    let found = estimator.estimate_with(&cloud, &kept).unwrap();
    assert_eq!(found.order, Order::Cyclic(5));
    let apart = frame.inverse() * truth.inverse() * found.world_from_object;
    let x = apart * Vector3::x();
    let turn = (5.0 * x.y.atan2(x.x)).sin().asin() / 5.0;
    assert!(apart.translation.vector.norm() < 5e-4 && turn.abs() < 1e-3, "{apart}");
    assert!((apart * Vector3::z()).z > 0.999_999);
    let again = estimator.estimate_with(&cloud, &read).unwrap();
    assert_eq!(found.world_from_object, again.world_from_object);

    let other = PointCloud::from_points(moved(&knob(7, 20_000), &truth, 1.0)).unwrap();
    assert!(matches!(estimator.estimate_with(&other, &kept), Err(Error::NoSymmetry { .. })));
}

#[test]
fn a_pose_near_the_last_one_is_only_refined() {
    let truth = tilted();
    let cloud = PointCloud::from_points(moved(&knob(5, 20_000), &truth, 1.0)).unwrap();
    let estimator = Estimator::new(cyclic(5)).unwrap();
    let near = truth
        * Isometry3::from_parts(
            Translation3::new(0.01, 0.0, 0.0),
            UnitQuaternion::from_euler_angles(0.02, 0.0, 0.0),
        );
    let lost = Isometry3::from_parts(
        truth.translation,
        UnitQuaternion::from_euler_angles(1.5, 0.3, 0.0) * truth.rotation,
    );
    for (initial, is_lost) in [(near, false), (lost, true)] {
        let request = Request { initial: Some(initial), ..Request::default() };
        let found = estimator.estimate_with(&cloud, &request).unwrap();
        assert!(axis_error_deg(&found, &truth) < 0.1);
        // A search has several candidates, an initial pose is the only one.
        assert_eq!(found.candidates.len() > 1, is_lost, "{:?}", found.candidates);
        assert_eq!(found.diagnostics.contains_key("tracking"), is_lost);
    }
}

#[test]
fn tracking_looks_at_fewer_points_unless_told_otherwise() {
    let truth = tilted();
    let cloud = PointCloud::from_points(moved(&knob(5, 250_000), &truth, 1.0)).unwrap();
    let request = Request { initial: Some(truth), ..Request::default() };
    let found = |tracking: TrackingParams| {
        let config = Config { tracking, ..cyclic(5) };
        Estimator::new(config).unwrap().estimate_with(&cloud, &request).unwrap()
    };
    let whole = found(TrackingParams { coarsening: 1.0, points: 250_000 });
    let quick = found(TrackingParams { coarsening: 2.0, points: 100_000 });
    let coarser = |name: &str| match (&quick.diagnostics[name], &whole.diagnostics[name]) {
        (Diagnostic::Number(quick), Diagnostic::Number(whole)) => quick / whole,
        other => panic!("{name}: {other:?}"),
    };
    assert!((coarser("voxel_size") - 2.0).abs() < 0.05, "{}", coarser("voxel_size"));
    assert!(quick.inliers.len() <= 100_000 && whole.inliers.len() > 200_000);
    for estimate in [&whole, &quick] {
        assert!(axis_error_deg(estimate, &truth) < 0.1);
        assert!(!estimate.diagnostics.contains_key("tracking"));
    }
}

#[test]
fn what_is_too_little_for_tracking_is_looked_at_in_full() {
    let truth = tilted();
    let cloud = PointCloud::from_points(moved(&knob(5, 20_000), &truth, 1.0)).unwrap();
    let tracking = TrackingParams { coarsening: 1.0, points: 40 };
    let (reports, reported) = std::sync::mpsc::channel();
    let control = Control::new().with_progress(move |_, done| reports.send(done).unwrap());
    let request = Request { initial: Some(truth), control, ..Request::default() };
    let found = Estimator::new(Config { tracking, ..cyclic(5) }).unwrap().estimate_with(&cloud, &request);
    let found = found.unwrap();
    assert!(found.inliers.len() > 15_000);
    assert!(found.diagnostics.contains_key("tracking"));
    drop(request);
    let reported: Vec<f64> = reported.iter().collect();
    assert!(reported.len() > 8 && reported.is_sorted() && reported.ends_with(&[1.0]), "{reported:?}");
}

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
fn equivalent_poses_begin_with_the_pose_and_turn_about_the_axis() {
    let found = estimate(knob(5, 5_000), cyclic(5)).unwrap();
    let poses = found.equivalent_poses(36);
    assert_eq!((poses.len(), poses[0]), (5, found.world_from_object));
    let z = Vector3::z();
    assert!(poses.iter().all(|pose| (pose * z - found.world_from_object * z).norm() < 1e-12));
    assert!((poses[1].rotation.angle_to(&poses[0].rotation) - TAU / 5.0).abs() < 1e-9);
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
fn a_sphere_has_no_axis_to_act_on() {
    let golden = TAU * 0.618_033_988_749_894_9;
    let sphere = (0..20_000)
        .map(|i| {
            let z = 1.0 - 2.0 * (f64::from(i) + 0.5) / 20_000.0;
            let r = (1.0 - z * z).sqrt();
            [r * (golden * f64::from(i)).cos(), r * (golden * f64::from(i)).sin(), z]
        })
        .collect();
    match estimate(sphere, Config { order: Order::Continuous, ..Config::default() }) {
        Ok(found) => {
            assert!(found.score < 0.5, "{}", found.score);
            assert!(found.unobservable.contains(&FreeDirection::Tilt), "{:?}", found.unobservable);
        }
        Err(error) => assert!(matches!(error, Error::NoSymmetry { .. })),
    }
}

#[test]
fn work_stops_when_asked() {
    let cloud = PointCloud::from_points(knob(5, 20_000)).unwrap();
    let estimator = Estimator::new(cyclic(5)).unwrap();
    let token = CancelToken::default();
    let from_inside = token.clone();
    let control = Control::new().with_cancel(token).with_progress(move |stage, _| {
        if stage == "propose" {
            from_inside.cancel();
        }
    });
    let cancelled = estimator.estimate_with(&cloud, &Request { control, ..Request::default() });
    assert!(matches!(cancelled, Err(Error::Cancelled)));
    let control = Control::new().with_timeout(Duration::from_millis(1));
    let late = estimator.estimate_with(&cloud, &Request { control, ..Request::default() });
    assert!(matches!(late, Err(Error::DeadlineExceeded { .. })));
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

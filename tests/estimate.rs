//! The whole pipeline on analytic parts: pose, order, invariance, determinism.

mod scenes;

use std::cell::Cell;
use std::f64::consts::TAU;
use std::sync::Arc;
use std::time::Duration;

use rayon::prelude::*;
use scenes::knob::{axis_error_deg, cyclic, estimate, knob};
use sympose::config::TrackingParams;
use sympose::nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use sympose::result::{Diagnostic, FreeDirection};
use sympose::{
    CancelToken, Config, Control, Error, Estimate, Estimator, Order, PointCloud, Reference, Request,
    Viewpoints,
};

fn moved(points: &[[f64; 3]], pose: &Isometry3<f64>, scale: f64) -> Vec<[f64; 3]> {
    points.iter().map(|p| (pose * Point3::from(p.map(|x| x * scale))).coords.into()).collect()
}

fn tilted() -> Isometry3<f64> {
    Isometry3::from_parts(
        Translation3::new(3.0, -2.0, 1.0),
        UnitQuaternion::from_euler_angles(0.7, -0.4, 1.1),
    )
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
fn equivalent_poses_begin_with_the_pose_and_turn_about_the_axis() {
    let found = estimate(knob(5, 5_000), cyclic(5)).unwrap();
    let poses = found.equivalent_poses(36);
    assert_eq!((poses.len(), poses[0]), (5, found.world_from_object));
    let z = Vector3::z();
    assert!(poses.iter().all(|pose| (pose * z - found.world_from_object * z).norm() < 1e-12));
    assert!((poses[1].rotation.angle_to(&poses[0].rotation) - TAU / 5.0).abs() < 1e-9);
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
fn who_was_told_that_all_is_done_gets_it() {
    let cloud = PointCloud::from_points(knob(5, 20_000)).unwrap();
    let token = CancelToken::default();
    let from_inside = token.clone();
    let control = Control::new().with_cancel(token).with_progress(move |stage, _| {
        if stage == "done" {
            from_inside.cancel();
        }
    });
    let found =
        Estimator::new(cyclic(5)).unwrap().estimate_with(&cloud, &Request { control, ..Request::default() });
    assert!(found.is_ok());
}

#[test]
fn the_cameras_that_saw_a_point_follow_it_where_others_are_dropped() {
    let cameras = [[0.0, 0.0, 5.0], [0.0, 0.0, -5.0], [3.0, 0.0, 4.0], [9.0, 9.0, 9.0]];
    let points = knob(5, 20_000);
    let track = |p: &[f64; 3]| if p[2] > 0.0 { vec![0, 2] } else { vec![1] };
    let estimate = |points: Vec<[f64; 3]>, tracks: &[Vec<u32>]| {
        let counts: Vec<u32> = tracks.iter().map(|track| track.len() as u32).collect();
        let seen_by = Viewpoints::of_tracks(&cameras, &counts, &tracks.concat()).unwrap();
        let cloud = PointCloud::from_points(points).unwrap().with_sensor_at(seen_by).unwrap();
        Estimator::new(cyclic(5)).unwrap().estimate(&cloud).unwrap()
    };
    let tracks: Vec<Vec<u32>> = points.iter().map(track).collect();
    let whole = estimate(points.clone(), &tracks);
    let (mut with_others, mut their_tracks) = (points, tracks);
    for at in [0, 7000, 15_000] {
        with_others.insert(at, [f64::NAN; 3]);
        their_tracks.insert(at, vec![3, 1, 0]);
    }
    let found = estimate(with_others, &their_tracks);
    assert_eq!(found.world_from_object, whole.world_from_object);
    assert_eq!((found.score, found.order), (whole.score, whole.order));
}

#[test]
fn tracks_of_no_point_are_refused_and_cameras_that_saw_nothing_do_not_matter() {
    let points = knob(5, 20_000);
    let cloud = || PointCloud::from_points(points.clone()).unwrap();
    let of_none = Viewpoints::of_tracks(&[[0.0, 0.0, 5.0]], &[], &[]).unwrap();
    assert!(matches!(cloud().with_sensor_at(of_none), Err(Error::LengthMismatch { got: 0, .. })));
    let ones = vec![1; points.len()];
    let seen_from =
        |place: u32| Viewpoints::of_tracks(&[[0.0, 0.0, 5.0], [1e19; 3]], &ones, &vec![place; points.len()]);
    assert!(cloud().with_sensor_at(seen_from(0).unwrap()).is_ok());
    let refused = cloud().with_sensor_at(seen_from(1).unwrap()).unwrap_err().to_string();
    assert!(refused.contains("20000 of 20000 rows"), "{refused}");
}

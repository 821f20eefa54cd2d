//! Finding the places of a sensor from the order of its points.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

mod scenes;

use nalgebra::{Rotation3, Vector3};
use proptest::prelude::*;
use sympose::preprocess::{SensorPlaces, viewpoints_from_order};
use sympose::{Error, PointCloud};

use scenes::{Random, with_threads};

/// Pixels of a picture along each side.
const SIZE: usize = 80;

/// What a camera at `eye` measures of the unit ball about the origin, row by row, with noise along its rays. It is turned
/// about its axis by `roll` \[rad\].
fn picture(eye: Vector3<f64>, roll: f64, noise: f64, random: &mut Random) -> Vec<[f64; 3]> {
    let ahead = -eye.normalize();
    let aside = ahead.cross(&Vector3::new(0.3, -0.2, 0.9)).normalize();
    let turn = Rotation3::from_axis_angle(&nalgebra::Unit::new_normalize(ahead), roll);
    let (right, down) = (turn * aside, turn * ahead.cross(&aside));
    let reach = 1.1 / eye.norm();
    let at = |pixel: usize| reach * (2.0 * pixel as f64 / SIZE as f64 - 1.0);
    let mut points = Vec::new();
    for (row, column) in (0..SIZE).flat_map(|row| (0..SIZE).map(move |column| (row, column))) {
        let ray = (ahead + right * at(column) + down * at(row)).normalize();
        let along = -eye.dot(&ray);
        let under_root = 1.0 - eye.norm_squared() + along * along;
        if under_root > 0.0 {
            let distance = along - under_root.sqrt() + noise * random.normal();
            points.push((eye + ray * distance).into());
        }
    }
    points
}

/// Pictures from all around, one after the other; for each point the number of its eye.
fn scan(eyes: &[Vector3<f64>], noise: f64) -> (Vec<[f64; 3]>, Vec<u32>) {
    let mut random = Random(1);
    let (mut points, mut eye_of) = (Vec::new(), Vec::new());
    for (i, eye) in (0_u32..).zip(eyes) {
        let seen = picture(*eye, f64::from(i), noise, &mut random);
        eye_of.resize(eye_of.len() + seen.len(), i);
        points.extend(seen);
    }
    (points, eye_of)
}

fn eyes() -> Vec<Vector3<f64>> {
    vec![Vector3::new(3.0, 1.0, 0.5), Vector3::new(-2.0, 2.0, 2.0), Vector3::new(0.0, -4.0, 1.0)]
}

/// Largest distance from the eye of a point to the place that was found for it, but for one point of `exempt`.
fn farthest_off(found: &SensorPlaces, eyes: &[Vector3<f64>], eye_of: &[u32], exempt: usize) -> f64 {
    let off = |(place, eye): (&u32, &u32)| {
        (Vector3::from(found.places[*place as usize]) - eyes[*eye as usize]).norm()
    };
    let mut off: Vec<f64> = found.place_of.iter().zip(eye_of).map(off).collect();
    off.sort_unstable_by(f64::total_cmp);
    off[off.len() - 1 - off.len() / exempt]
}

/// Those of `points` in another order.
fn shuffled(points: &[[f64; 3]]) -> Vec<[f64; 3]> {
    let mut random = Random(7);
    let mut rows: Vec<(u64, [f64; 3])> = points.iter().map(|p| (random.next(), *p)).collect();
    rows.sort_unstable_by_key(|(key, _)| *key);
    rows.into_iter().map(|(_, p)| p).collect()
}

#[test]
fn each_view_has_its_place_however_noisy() {
    for noise in [0.0, 1e-6, 0.003, 0.02] {
        let (points, eye_of) = scan(&eyes(), noise);
        let found = viewpoints_from_order(&points).unwrap().unwrap();
        assert_eq!(found.places.len(), 3);
        let off = farthest_off(&found, &eyes(), &eye_of, 1000);
        assert!(off < 1e-6, "{off} off with noise of {noise}");
    }
}

#[test]
fn any_number_of_views_is_found() {
    let around = |i: usize| Rotation3::from_euler_angles(0.4 * i as f64, 0.1 * i as f64, 0.0) * eyes()[0];
    let eyes: Vec<Vector3<f64>> = (0..40).map(around).collect();
    let (points, eye_of) = scan(&eyes, 0.003);
    let found = viewpoints_from_order(&points).unwrap().unwrap();
    assert_eq!(found.places.len(), 40);
    assert!(farthest_off(&found, &eyes, &eye_of, 1000) < 1e-6);
}

#[test]
fn rounded_coordinates_tell_it_less_exactly() {
    let (points, eye_of) = scan(&eyes(), 0.003);
    for (rounding, limit) in [(1e-7, 1e-3), (1e-6, 0.01), (1e-5, 0.05)] {
        let rounded: Vec<[f64; 3]> =
            points.iter().map(|p| p.map(|x| (x / rounding).round() * rounding)).collect();
        let found = viewpoints_from_order(&rounded).unwrap().unwrap();
        let off = farthest_off(&found, &eyes(), &eye_of, 100);
        assert!(off < limit, "{off} off when rounded to {rounding}");
    }
}

#[test]
fn lost_pixels_columns_and_the_other_direction_do_not_matter() {
    let (points, _) = scan(&eyes()[..1], 0.003);
    let mut random = Random(3);
    let lossy: Vec<[f64; 3]> = points.iter().copied().filter(|_| random.uniform(0.0, 1.0) < 0.7).collect();
    let reversed = points.iter().rev().copied().collect();
    // The columns of a picture are the rows of one that is turned.
    let mut quarter = picture(eyes()[0], std::f64::consts::FRAC_PI_2, 0.003, &mut Random(1));
    quarter.reverse();
    for points in [lossy, reversed, quarter] {
        let found = viewpoints_from_order(&points).unwrap().unwrap();
        assert_eq!(found.places.len(), 1);
        assert!((Vector3::from(found.places[0]) - eyes()[0]).norm() < 1e-6);
    }
}

#[test]
fn strays_among_the_points_do_not_matter() {
    let (points, eye_of) = scan(&eyes(), 0.003);
    let mut random = Random(5);
    let mut with_strays = Vec::new();
    for (point, eye) in points.iter().zip(&eye_of) {
        if random.uniform(0.0, 1.0) < 0.02 {
            with_strays.push((std::array::from_fn(|_| random.uniform(-2.0, 2.0)), *eye));
        }
        with_strays.push((*point, *eye));
    }
    let (points, eye_of): (Vec<_>, Vec<_>) = with_strays.into_iter().unzip();
    let found = viewpoints_from_order(&points).unwrap().unwrap();
    assert!(farthest_off(&found, &eyes(), &eye_of, 100) < 1e-6);
}

#[test]
fn another_order_tells_nothing() {
    let (points, _) = scan(&eyes(), 0.003);
    let mut by_height = points.clone();
    by_height.sort_unstable_by(|a, b| a[2].total_cmp(&b[2]));
    for points in [shuffled(&points), by_height, Random(1).cube(20_000, 1.0), Random(1).sphere(20_000)] {
        assert!(viewpoints_from_order(&points).unwrap().is_none());
    }
}

/// Rows that no camera made: their planes are parallel, or meet on the axis of the surface.
#[test]
fn the_rows_of_a_lattice_are_not_those_of_a_camera() {
    let mut random = Random(2);
    let lattice = |i: usize| [0.01 * (i % 100) as f64, 0.01 * (i / 100) as f64];
    let flat = (0..10_000).map(|i| [lattice(i)[0], lattice(i)[1], 0.0]).collect();
    let rough = (0..10_000).map(|i| [lattice(i)[0], lattice(i)[1], random.normal() * 0.01]).collect();
    let waves = |i: usize| (7.0 * lattice(i)[0]).sin() * (5.0 * lattice(i)[1]).cos();
    let smooth = (0..10_000).map(|i| [lattice(i)[0], lattice(i)[1], 0.1 * waves(i)]).collect();
    // Meridians of a vase, and its circles of latitude.
    let vase = |u: f64, v: f64| {
        let (sin, cos) = (std::f64::consts::TAU * u).sin_cos();
        let r = 0.5 + 0.2 * (6.0 * v).sin();
        [r * cos, r * sin, 2.0 * v]
    };
    let meridians = (0..10_000).map(|i| vase(lattice(i)[1], lattice(i)[0])).collect();
    let latitudes = (0..10_000).map(|i| vase(lattice(i)[0], lattice(i)[1])).collect();
    // As a laser scans it on a turntable: noise in the planes through its axis.
    let mut turned = |i: usize| {
        let [x, y, z] = vase(lattice(i)[1], lattice(i)[0]);
        let r = 1.0 + 0.01 * random.normal();
        [x * r, y * r, z]
    };
    let turntable = (0..10_000).map(&mut turned).collect();
    let clouds: [Vec<[f64; 3]>; 6] = [flat, rough, smooth, meridians, latitudes, turntable];
    for (i, points) in clouds.iter().enumerate() {
        assert!(viewpoints_from_order(points).unwrap().is_none(), "cloud {i}");
    }
}

#[test]
fn few_equal_or_straight_points_tell_nothing() {
    let straight = (0..5000).map(|i| [f64::from(i), 2.0 * f64::from(i), 0.0]).collect();
    let few = scan(&eyes(), 0.003).0[..20].to_vec();
    for points in [Vec::new(), vec![[1.0; 3]], vec![[1.0; 3]; 2], vec![[0.5; 3]; 5000], straight, few] {
        assert!(viewpoints_from_order(&points).unwrap().is_none());
    }
    assert!(matches!(
        viewpoints_from_order(&[[0.0, f64::NAN, 0.0]]),
        Err(Error::NonFinite { count: 1, total: 1 })
    ));
}

#[test]
fn a_view_whose_place_is_not_found_leaves_all_open() {
    let (points, eye_of) = scan(&eyes(), 0.003);
    let of_eye = |eye| points.iter().zip(&eye_of).filter(move |(_, e)| **e == eye).map(|(p, _)| *p);
    // Its points come in no order, or in rows of a picture that was bent.
    let bent = |p: [f64; 3]| [p[0], p[1] + 0.1 * p[0] * p[2], p[2]];
    for second in [shuffled(&of_eye(1).collect::<Vec<_>>()), of_eye(1).map(bent).collect()] {
        let points: Vec<[f64; 3]> = of_eye(0).chain(second).chain(of_eye(2)).collect();
        assert!(viewpoints_from_order(&points).unwrap().is_none());
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bytes() {
    let (points, _) = scan(&eyes(), 0.003);
    let places = |threads| with_threads(threads, || viewpoints_from_order(&points).unwrap().unwrap());
    assert!(places(1) == places(3));
}

#[test]
fn a_cloud_takes_them_in_its_own_frame() {
    let (mut points, _) = scan(&eyes(), 0.003);
    points.iter_mut().for_each(|p| p[0] += 4e6);
    let cloud = PointCloud::from_points(points).unwrap();
    assert!(!cloud.has_viewpoints());
    assert!(cloud.with_viewpoints_from_order().unwrap().has_viewpoints());
    let cloud = PointCloud::from_points(Random(1).cube(1000, 1.0)).unwrap();
    assert!(cloud.with_viewpoints_from_order().is_none());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    /// Whatever the unit and the pose.
    #[test]
    fn places_move_with_the_points(
        scale in 1e-3..1e3_f64,
        turn in prop::array::uniform3(-3.0..3.0_f64),
        shift in prop::array::uniform3(-10.0..10.0_f64),
        distance in 1.5..12.0_f64,
    ) {
        let turn = Rotation3::from_scaled_axis(Vector3::from(turn));
        let eye = Vector3::new(0.6, -0.3, 0.7).normalize() * distance;
        let moved = |p: Vector3<f64>| (turn * p + Vector3::from(shift)) * scale;
        let points: Vec<[f64; 3]> =
            scan(&[eye], 0.003).0.into_iter().map(|p| moved(p.into()).into()).collect();
        let found = viewpoints_from_order(&points)?.unwrap();
        prop_assert_eq!(found.places.len(), 1);
        prop_assert!((Vector3::from(found.places[0]) - moved(eye)).norm() < 1e-6 * distance * scale);
    }
}

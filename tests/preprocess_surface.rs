//! Normals and planes against surfaces of known shape.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test may panic")]
mod scenes;

use proptest::prelude::*;
use scenes::{Random, with_threads};
use sympose::Error;
use sympose::preprocess::{NormalParams, PlaneParams, estimate_normals, orient_normals, segment_plane};
use sympose::spatial::KdTree;

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

fn normals_of(points: &[[f64; 3]], k: usize) -> sympose::preprocess::Normals {
    let params = NormalParams { k, ..NormalParams::default() };
    estimate_normals(points, &KdTree::new(points).unwrap(), &params).unwrap()
}

#[test]
fn normals_of_a_sphere_are_radial_and_face_the_sensor() {
    let points = Random(1).sphere(20_000);
    let mut found = normals_of(&points, 20);
    orient_normals(&mut found.normals, &points, |i| Some(points[i].map(|x| 3.0 * x)));
    for (normal, point) in found.normals.iter().zip(&points) {
        assert!((dot(normal, normal) - 1.0).abs() < 1e-12);
        assert!(dot(normal, point) > 0.99, "{normal:?} at {point:?}");
    }
    assert!(found.surface_variation.iter().all(|v| (0.0..0.01).contains(v)));
    let before = found.normals.clone();
    orient_normals(&mut found.normals, &points, |_| None);
    assert_eq!(before, found.normals);
}

#[test]
fn normals_of_points_on_a_line_or_in_one_place_are_unit_vectors() {
    let direction = [0.6, 0.0, 0.8];
    let line: Vec<[f64; 3]> = (0..500).map(|i| direction.map(|x| 1e3 + 0.01 * f64::from(i) * x)).collect();
    for normal in normals_of(&line, 10).normals {
        assert!((dot(&normal, &normal) - 1.0).abs() < 1e-12 && dot(&normal, &direction).abs() < 1e-6);
    }
    for points in [vec![[5.0; 3]; 100], vec![[5.0; 3]; 2]] {
        let found = normals_of(&points, 10);
        assert!(found.normals.iter().all(|n| (dot(n, n) - 1.0).abs() < 1e-12));
        assert!(found.surface_variation.iter().all(|&v| v == 0.0));
    }
}

#[test]
fn a_point_off_the_surface_deviates() {
    // A lattice with a wave, and one point that floats three spacings above it.
    let mut points: Vec<[f64; 3]> = (0..40)
        .flat_map(|i| (0..40).map(move |j| [f64::from(i), f64::from(j), 0.2 * f64::from(i).sin()]))
        .collect();
    points.push([20.5, 20.5, 3.0]);
    let deviation = normals_of(&points, 20).deviation;
    let (stray, regular) = deviation.split_last().unwrap();
    assert!(*stray > 6.0, "{stray}");
    assert!(regular.iter().all(|&d| (0.0..6.0).contains(&d)));
}

#[test]
fn a_radius_limits_the_neighbourhood() {
    // Two parallel sheets, closer than the k-th neighbour: only the radius tells them apart.
    let mut random = Random(5);
    let points: Vec<[f64; 3]> = (0..4000)
        .map(|i| [random.uniform(0.0, 1.0), random.uniform(0.0, 1.0), 0.05 * f64::from(i % 2)])
        .collect();
    let tree = KdTree::new(&points).unwrap();
    let limited = estimate_normals(&points, &tree, &NormalParams { k: 60, max_radius: Some(0.049) }).unwrap();
    let inside = |p: &[f64; 3]| p[..2].iter().all(|x| (0.1..0.9).contains(x));
    assert!(points.iter().zip(&limited.normals).all(|(p, n)| !inside(p) || n[2].abs() > 1.0 - 1e-9));
    let free = estimate_normals(&points, &tree, &NormalParams { k: 60, max_radius: None }).unwrap();
    assert!(free.surface_variation.iter().all(|&v| v > 0.01));
}

#[test]
fn bad_input_of_normals_is_named() {
    let points = Random(1).sphere(10);
    let tree = KdTree::new(&points).unwrap();
    let params = |k, max_radius| NormalParams { k, max_radius };
    assert!(matches!(
        estimate_normals(&points, &tree, &params(2, None)),
        Err(Error::InvalidParameter { name: "k", .. })
    ));
    assert!(estimate_normals(&points, &tree, &params(5, Some(0.0))).is_err());
    assert!(matches!(
        estimate_normals(&[[f64::NAN; 3]], &tree, &params(5, None)),
        Err(Error::NonFinite { .. })
    ));
    assert_eq!(estimate_normals(&points, &tree, &params(1000, None)).unwrap().normals.len(), 10);
}

proptest! {
    #[test]
    fn normals_of_a_plane_are_exact(normal in prop::array::uniform3(-1.0..1.0_f64), scale in -6..6_i32, seed in 0_u64..1000) {
        let length = dot(&normal, &normal).sqrt();
        prop_assume!(length > 0.1);
        let normal = normal.map(|x| x / length);
        let scale = 10_f64.powi(scale);
        let mut random = Random(seed);
        let points: Vec<[f64; 3]> = random.cube(60, scale).into_iter().map(|p| {
            let height = dot(&p, &normal);
            std::array::from_fn(|i| p[i] - height * normal[i] + 3.0 * scale)
        }).collect();
        for found in normals_of(&points, 12).normals {
            prop_assert!(dot(&found, &normal).abs() > 1.0 - 1e-9);
        }
    }
}

/// A noisy plane `n . x + d = 0` among uniform clutter.
fn plane_scene(seed: u64, on_plane: usize, clutter: usize, noise: f64) -> (Vec<[f64; 3]>, [f64; 4]) {
    let mut random = Random(seed);
    let normal = random.sphere(1)[0];
    let d = random.uniform(-0.2, 0.2);
    let mut points: Vec<[f64; 3]> = random
        .cube(on_plane, 1.5)
        .into_iter()
        .map(|p| {
            let height = dot(&p, &normal) + d - noise * random.normal();
            std::array::from_fn(|i| p[i] - height * normal[i])
        })
        .collect();
    points.extend(random.cube(clutter, 2.0));
    (points, [normal[0], normal[1], normal[2], d])
}

#[test]
fn the_plane_is_found_among_clutter() {
    for seed in 0..20 {
        let (points, truth) = plane_scene(seed, 4000, 6000, 0.003);
        let params = PlaneParams { distance: 0.01, seed, ..PlaneParams::default() };
        let plane = segment_plane(&points, &params).unwrap();
        let cosine = dot(&plane.coefficients[..3], &truth[..3]);
        assert!(cosine.abs() > 0.3_f64.to_radians().cos(), "seed {seed}: {cosine}");
        assert!((plane.coefficients[3] - truth[3] * cosine.signum()).abs() < 0.002);
        let [x, y, z, d] = plane.coefficients;
        let near = |p: &[f64; 3]| (x * p[0] + y * p[1] + z * p[2] + d).abs() <= 0.01;
        let expected: Vec<u32> = (0_u32..).zip(&points).filter(|(_, p)| near(p)).map(|(i, _)| i).collect();
        assert_eq!(plane.inliers, expected);
        assert!(plane.inliers.len() > 3990);
    }
}

#[test]
fn planes_do_not_depend_on_threads_and_stop_early() {
    let (points, _) = plane_scene(7, 40_000, 10_000, 0.003);
    let run = || segment_plane(&points, &PlaneParams::default()).unwrap();
    let one = with_threads(1, run);
    assert_eq!(with_threads(2, run), one);
    assert_eq!(with_threads(3, run), one);
    assert!(one.iterations < 200);
    let other = segment_plane(&points, &PlaneParams { seed: 1, ..PlaneParams::default() }).unwrap();
    assert!(dot(&other.coefficients[..3], &one.coefficients[..3]) > 0.99999);
}

#[test]
fn a_plane_needs_points_that_span_it() {
    let run = |points: &[[f64; 3]]| segment_plane(points, &PlaneParams::default());
    assert!(matches!(run(&[]), Err(Error::InsufficientData { got: 0, .. })));
    assert!(matches!(run(&[[0.0; 3], [1.0; 3]]), Err(Error::InsufficientData { needed: 3, .. })));
    assert!(matches!(run(&[[1.0; 3]; 50]), Err(Error::Degenerate { shape: "identical" })));
    let line: Vec<[f64; 3]> =
        (0..50).map(|i| [1e6 + 0.3 * f64::from(i), 2e6 + 0.1 * f64::from(i), 7.0]).collect();
    assert!(matches!(run(&line), Err(Error::Degenerate { shape: "collinear" })));
    assert!(matches!(
        run(&[[0.0; 3], [f64::NAN; 3], [1.0; 3]]),
        Err(Error::NonFinite { count: 1, total: 3 })
    ));
    for bad in [
        PlaneParams { distance: 0.0, ..PlaneParams::default() },
        PlaneParams { probability: 0.0, ..PlaneParams::default() },
        PlaneParams { probability: 1.5, ..PlaneParams::default() },
        PlaneParams { max_iterations: 0, ..PlaneParams::default() },
    ] {
        assert!(matches!(segment_plane(&line, &bad), Err(Error::InvalidParameter { .. })));
    }
    // One point off a heap of duplicates and a line is enough.
    let mut points = vec![[0.0; 3]; 5000];
    points.extend([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    let plane = segment_plane(&points, &PlaneParams { distance: 1e-6, ..PlaneParams::default() }).unwrap();
    assert_eq!((plane.coefficients, plane.inliers.len()), ([0.0, 0.0, 1.0, 0.0], 5002));
}

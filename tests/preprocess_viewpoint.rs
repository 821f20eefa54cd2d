//! One view is told from several, whatever frame, unit and strays the points come with.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use nalgebra::{Point3, Rotation3, Translation3, Vector3};
use proptest::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use sympose::preprocess::single_viewpoint;

const CAMERA: [f64; 3] = [0.4, -0.3, 2.0];

fn uniform(random: &mut ChaCha8Rng) -> f64 {
    random.next_u32() as f64 / f64::from(u32::MAX)
}

/// Height of a dish with five waves over the plane.
fn dish([x, y]: [f64; 2]) -> f64 {
    let (radius, angle) = (x.hypot(y), y.atan2(x));
    0.5 * radius * radius + 0.1 * radius * (5.0 * angle).cos()
}

/// Points of a dish of diameter 1, seen from above, with noise.
fn seen_from_above(count: usize) -> Vec<[f64; 3]> {
    let mut random = ChaCha8Rng::seed_from_u64(7);
    (0..count)
        .map(|_| {
            let radius = 0.5 * uniform(&mut random).sqrt();
            let (sin, cos) = (std::f64::consts::TAU * uniform(&mut random)).sin_cos();
            let at = [radius * cos, radius * sin];
            [at[0], at[1], dish(at) + 0.002 * (uniform(&mut random) - 0.5)]
        })
        .collect()
}

/// Upward normal of the dish.
fn normal([x, y, _]: [f64; 3]) -> Vector3<f64> {
    let h = 1e-5;
    let slope = |dx: f64, dy: f64| (dish([x + dx, y + dy]) - dish([x - dx, y - dy])) / (2.0 * h);
    Vector3::new(-slope(h, 0.0), -slope(0.0, h), 1.0)
}

#[test]
fn the_place_sees_every_point_from_the_same_side_as_the_camera_did() {
    let points = seen_from_above(20_000);
    let place = Vector3::from(single_viewpoint(&points, 1.0).unwrap().unwrap());
    let before = |from: Vector3<f64>| {
        points.iter().map(move |p| normal(*p).dot(&(from - Vector3::from(*p))) > 0.0).collect::<Vec<_>>()
    };
    let (supposed, real) = (before(place), before(Vector3::from(CAMERA)));
    assert!(real.iter().all(|&above| above));
    let same = supposed.iter().filter(|&&above| above).count() as f64 / points.len() as f64;
    // Or all of them from the other side: the dish looks alike from below.
    assert!(!(0.01..=0.99).contains(&same), "{same}");
}

#[test]
fn what_has_a_back_takes_several_views() {
    let top = seen_from_above(20_000);
    let plate = |thickness: f64| -> Vec<[f64; 3]> {
        top.iter().flat_map(|&[x, y, z]| [[x, y, z], [x, y, z - thickness]]).collect()
    };
    assert!(single_viewpoint(&plate(0.1), 1.0).unwrap().is_none());
    assert!(single_viewpoint(&plate(0.02), 1.0).unwrap().is_none());
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let ball: Vec<[f64; 3]> =
        std::iter::repeat_with(|| Vector3::from_fn(|_, _| 2.0 * uniform(&mut random) - 1.0))
            .filter(|p| (0.1..1.0).contains(&p.norm()))
            .map(|p| (0.5 * p.normalize()).into())
            .take(20_000)
            .collect();
    assert!(single_viewpoint(&ball, 1.0).unwrap().is_none());
}

#[test]
fn points_that_fill_a_volume_are_no_view() {
    for count in [300, 3000, 30_000] {
        let mut random = ChaCha8Rng::seed_from_u64(11);
        let points: Vec<[f64; 3]> =
            (0..count).map(|_| std::array::from_fn(|_| uniform(&mut random))).collect();
        assert!(single_viewpoint(&points, 1.7).unwrap().is_none(), "{count}");
    }
}

#[test]
fn strays_far_away_cost_neither_the_place_nor_memory() {
    let mut points = seen_from_above(20_000);
    points.extend([[2.4, 0.0, 0.0], [0.0, 50.0, 3.0], [-3e3, 1e3, 0.0]]);
    assert!(single_viewpoint(&points, 1.0).unwrap().is_some());
    // Nothing is left within one diameter of the middle of these.
    let apart: Vec<[f64; 3]> =
        (0..200).map(|i| [if i % 2 == 0 { 5.0 } else { -5.0 }, f64::from(i), 0.0]).collect();
    assert!(single_viewpoint(&apart, 0.05).unwrap().is_none());
}

#[test]
fn the_place_does_not_depend_on_threads() {
    let points = seen_from_above(20_000);
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| single_viewpoint(&points, 1.0).unwrap().unwrap()).map(f64::to_bits)
    };
    assert_eq!(on(1), on(3));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn one_view_is_one_view_in_every_frame_and_unit(
        turn in prop::array::uniform3(-3.0_f64..3.0),
        shift in prop::array::uniform3(-1e3_f64..1e3),
        unit in 1e-3_f64..1e3,
    ) {
        let pose = Translation3::from(Vector3::from(shift)) * Rotation3::new(Vector3::from(turn));
        let moved: Vec<[f64; 3]> =
            seen_from_above(8000).iter().map(|p| (pose * Point3::from(*p)).coords.map(|x| unit * x).into()).collect();
        prop_assert!(single_viewpoint(&moved, unit).unwrap().is_some());
    }
}

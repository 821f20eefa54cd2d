//! The support plane: a table is removed, a face of the part is not.
#![allow(clippy::unwrap_used, reason = "a test may panic")]
mod scenes;

use scenes::Random;
use sympose::config::GroundMode;
use sympose::preprocess::{Ground, GroundParams, find_ground};

const NOISE: f64 = 0.002;
const EYE: [f64; 3] = [1.2, -1.5, 1.8];

/// Points of a disc of radius `outer` with a hole of radius `inner` at height `z`.
fn ring(random: &mut Random, count: usize, inner: f64, outer: f64, z: f64) -> Vec<[f64; 3]> {
    (0..count)
        .map(|_| {
            let radius = random.uniform(inner * inner, outer * outer).sqrt();
            let (sin, cos) = random.uniform(0.0, std::f64::consts::TAU).sin_cos();
            [radius * cos, radius * sin, z + NOISE * random.normal()]
        })
        .collect()
}

/// The wall of a cylinder between two heights.
fn wall(random: &mut Random, count: usize, radius: f64, heights: [f64; 2]) -> Vec<[f64; 3]> {
    (0..count)
        .map(|_| {
            let (sin, cos) = random.uniform(0.0, std::f64::consts::TAU).sin_cos();
            let radius = radius + NOISE * random.normal();
            [radius * cos, radius * sin, random.uniform(heights[0], heights[1])]
        })
        .collect()
}

/// A drum of radius 0.4 and height 0.3 on z = 0.
fn drum(random: &mut Random) -> Vec<[f64; 3]> {
    let mut points = wall(random, 6000, 0.4, [0.0, 0.3]);
    points.extend(ring(random, 4000, 0.0, 0.4, 0.3));
    points
}

/// What an oblique picture shows of a table: a trapezoid, without what the drum stands on.
fn table(random: &mut Random) -> Vec<[f64; 3]> {
    let mut points = Vec::new();
    while points.len() < 20_000 {
        let (x, y) = (random.uniform(-1.6, 1.6), random.uniform(-0.7, 1.3));
        if x.abs() < 0.8 + 0.5 * y && x.hypot(y) > 0.4 {
            points.push([x, y, NOISE * random.normal()]);
        }
    }
    points
}

fn found(points: &[[f64; 3]], eye: Option<[f64; 3]>, mode: GroundMode) -> Option<Ground> {
    find_ground(points, |_| eye, &GroundParams::default(), mode, 0).unwrap()
}

#[test]
fn a_table_is_removed_and_what_stands_on_it_stays() {
    let mut random = Random(1);
    let mut points = drum(&mut random);
    let part = points.len();
    points.extend(table(&mut random));
    for eye in [Some(EYE), None] {
        let ground = found(&points, eye, GroundMode::Auto).unwrap();
        let [x, y, z, d] = ground.plane;
        assert!(z > 0.99999 && x.hypot(y) < 0.002 && d.abs() < 0.001, "{:?}", ground.plane);
        assert_eq!(ground.removed + ground.kept.len(), points.len());
        let kept_of_part = ground.kept.iter().filter(|&&i| (i as usize) < part).count();
        assert!(ground.kept.len() - kept_of_part < 50, "{}", ground.kept.len() - kept_of_part);
        let higher = points[..part].iter().filter(|p| p[2] > 5.0 * NOISE).count();
        assert!(kept_of_part >= higher);
    }
    assert_eq!(found(&points, Some(EYE), GroundMode::Off), None);
}

#[test]
fn a_wall_behind_the_table_goes_with_it() {
    let mut random = Random(2);
    let mut points = drum(&mut random);
    let part = points.len();
    points.extend(table(&mut random));
    points.extend((0..30_000).map(|_| [random.uniform(-4.0, 4.0), 2.4, random.uniform(-2.0, 3.0)]));
    let ground = found(&points, Some(EYE), GroundMode::Auto).unwrap();
    assert!(ground.plane[2] > 0.9999);
    assert!(ground.kept.iter().filter(|&&i| i as usize >= part).count() < 50);
}

#[test]
fn a_table_is_found_among_strays() {
    let mut random = Random(7);
    let mut points = drum(&mut random);
    points.extend(table(&mut random));
    let scanned = points.len();
    for _ in 0..scanned / 10 {
        points.push([random.uniform(-1.6, 1.6), random.uniform(-0.7, 1.3), random.uniform(-0.8, 0.8)]);
    }
    for eye in [Some(EYE), None] {
        let ground = found(&points, eye, GroundMode::Auto).unwrap();
        let [x, y, z, d] = ground.plane;
        assert!(z > 0.9999 && x.hypot(y) < 0.003 && d.abs() < 0.002, "{:?}", ground.plane);
        let strays = ground.kept.iter().filter(|&&i| i as usize >= scanned).count();
        assert!(20 * strays < points.len() - scanned, "{strays}");
        let higher = points[..6000].iter().filter(|p| p[2] > 5.0 * NOISE).count();
        let kept = ground.kept.iter().filter(|&&i| i < 6000).count();
        assert!(100 * kept > 99 * higher, "{kept} of {higher}");
    }
}

#[test]
fn flat_faces_of_a_part_stay() {
    let mut random = Random(3);
    // A drum alone; a thin flange with a boss, seen from above and where nobody knows from where.
    let mut flange = ring(&mut random, 12_000, 0.15, 0.5, 0.0);
    flange.extend(wall(&mut random, 3000, 0.15, [0.0, 0.2]));
    flange.extend(ring(&mut random, 1000, 0.0, 0.15, 0.2));
    for part in [drum(&mut random), flange] {
        for eye in [Some(EYE), None] {
            assert_eq!(found(&part, eye, GroundMode::Auto).map(|ground| ground.reason), None);
        }
    }
}

#[test]
fn a_plate_with_its_sides_in_sight_is_removed_where_it_is_said_to_be_there() {
    let mut random = Random(6);
    let mut points = drum(&mut random);
    let kept = points.len();
    let mut plate = ring(&mut random, 12_000, 0.0, 0.8, 0.0);
    plate.retain(|[x, y, _]| x.hypot(*y) > 0.4);
    plate.extend(wall(&mut random, 3000, 0.8, [-0.3, 0.0]));
    // Off the middle, so that it is no flange.
    points.extend(plate.iter().map(|[x, y, z]| [x + 0.2, y + 0.1, *z]).filter(|[x, y, _]| x.hypot(*y) > 0.4));
    assert!(found(&points, Some(EYE), GroundMode::Auto).is_none());
    let ground = found(&points, Some(EYE), GroundMode::On).unwrap();
    let of_drum = ground.kept.iter().filter(|&&i| (i as usize) < kept).count();
    assert!(ground.plane[2] > 0.999 && of_drum > kept * 9 / 10 && ground.kept.len() < of_drum + 50);
    // A table below both is what they stand on.
    let on_plate = points.len();
    points.extend(table(&mut random).into_iter().map(|[x, y, z]| [x, y, z - 0.3]));
    for mode in [GroundMode::Auto, GroundMode::On] {
        let ground = found(&points, Some(EYE), mode).unwrap();
        assert!((ground.plane[3] - 0.3).abs() < 0.01, "{:?}", ground.plane);
        assert!(ground.kept.iter().filter(|&&i| (i as usize) < on_plate).count() > kept);
    }
}

#[test]
fn nothing_is_a_table_that_is_seen_from_below() {
    let mut random = Random(4);
    let mut points = drum(&mut random);
    points.extend(table(&mut random));
    let below = Some([1.2, -1.5, -1.8]);
    assert_eq!(found(&points, below, GroundMode::Auto).map(|ground| ground.reason), None);
}

#[test]
fn what_holds_no_plane_has_no_ground() {
    let none: [&[[f64; 3]]; 4] =
        [&[], &[[0.0; 3]], &[[1.0; 3]; 200], &[[0.0; 3], [1.0; 3], [2.0; 3], [3.0; 3]]];
    for points in none {
        assert_eq!(found(points, None, GroundMode::Auto), None);
    }
    assert!(find_ground(&[[f64::NAN; 3]], |_| None, &GroundParams::default(), GroundMode::Auto, 0).is_err());
}

#[test]
fn twisted_blades_on_a_rod_are_no_table() {
    let mut random = Random(5);
    // Two blades with a hub on top, held by a rod at one tip, so that the outline has no symmetry of its own.
    let mut points: Vec<[f64; 3]> = (0..16_000)
        .map(|_| {
            let (x, y) = (random.uniform(-1.0, 1.0), random.uniform(-0.12, 0.12));
            let twist = 0.4 * (1.0 - x.abs());
            [x, y, twist * y * x.signum() + NOISE * random.normal()]
        })
        .collect();
    points.extend((0..3000).map(|_| [random.uniform(1.0, 1.6), random.uniform(-0.02, 0.02), 0.0]));
    points.extend(wall(&mut random, 800, 0.08, [0.03, 0.2]));
    points.extend(ring(&mut random, 400, 0.0, 0.08, 0.2));
    for eye in [Some([0.3, -0.2, 2.0]), None] {
        assert_eq!(found(&points, eye, GroundMode::Auto).map(|ground| ground.reason), None);
    }
}

//! Noise told from shape, on surfaces of known shape.
#![allow(clippy::unwrap_used, reason = "a test may panic")]
mod scenes;

use scenes::Random;
use sympose::preprocess::{KNeighbors, Sides, SmoothingParams, enough_neighbors, mean_heights};
use sympose::spatial::KdTree;

/// A lattice with spacing 1 in the plane at height `z`, with noise across it.
fn sheet(random: &mut Random, z: f64, noise: f64) -> Vec<[f64; 3]> {
    let places = (0..50).flat_map(|i| (0..50).map(move |j| [f64::from(i), f64::from(j)]));
    places.map(|[x, y]| [x, y, z + noise * random.normal()]).collect()
}

/// Points with normals after each has moved to the mean surface around it.
fn smoothed(points: &[[f64; 3]], normals: &[[f64; 3]]) -> Vec<[f64; 3]> {
    let neighbors = KNeighbors::new(&KdTree::new(points).unwrap(), points, 40).unwrap();
    let sides = Sides {
        points: points.to_vec(),
        normals: normals.to_vec(),
        voxel_of: (0..points.len() as u32).collect(),
        ..Sides::default()
    };
    let heights = mean_heights(&sides, &vec![true; points.len()], &neighbors, 0.3);
    let moved = |((p, n), h): ((&[f64; 3], &[f64; 3]), f64)| std::array::from_fn(|i| p[i] + h * n[i]);
    points.iter().zip(normals).zip(heights).map(moved).collect()
}

fn scatter(values: impl Iterator<Item = f64> + Clone, about: f64) -> f64 {
    let count = values.clone().count() as f64;
    (values.map(|z| (z - about).powi(2)).sum::<f64>() / count).sqrt()
}

#[test]
fn noise_calls_for_more_neighbors() {
    let params = SmoothingParams::default();
    let enough = |noise: f64| {
        let points = sheet(&mut Random(1), 0.0, noise);
        enough_neighbors(&points, |_| [0.0, 0.0, 1e3], &KdTree::new(&points).unwrap(), 20, &params)
    };
    let found = [0.0, 0.2, 1.0, 5.0].map(enough);
    assert_eq!(found[..2], [20, 20]);
    assert!(20 < found[2] && found[2] < found[3] && found[3] <= params.max_neighbors, "{found:?}");
}

#[test]
fn both_sides_of_a_wall_are_no_noise() {
    let mut random = Random(4);
    let mut points = sheet(&mut random, 0.0, 0.1);
    let count = points.len();
    points.extend(sheet(&mut random, -1.5, 0.1));
    let enough = |points: &[[f64; 3]], viewpoint: fn(bool) -> [f64; 3]| {
        let tree = KdTree::new(points).unwrap();
        enough_neighbors(points, |i| viewpoint(i < count), &tree, 20, &SmoothingParams::default())
    };
    let from_above = |_| [25.0, 25.0, 1e3];
    let from_either = |above| [25.0, 25.0, if above { 1e3 } else { -1e3 }];
    assert_eq!(enough(&points, from_either), 20);
    assert!(enough(&points, from_above) > 20, "layers of one side are noise");
}

#[test]
fn a_thin_wall_keeps_its_thickness() {
    const THICKNESS: f64 = 0.4;
    const NOISE: f64 = 0.1;
    let mut random = Random(2);
    let mut points = sheet(&mut random, 0.0, NOISE);
    let count = points.len();
    points.extend(sheet(&mut random, THICKNESS, NOISE));
    let normals: Vec<[f64; 3]> =
        (0..points.len()).map(|i| [0.0, 0.0, if i < count { -1.0 } else { 1.0 }]).collect();
    let moved = smoothed(&points, &normals);
    for (face, z) in moved.chunks(count).zip([0.0, THICKNESS]) {
        let mean = face.iter().map(|p| p[2]).sum::<f64>() / count as f64;
        assert!((mean - z).abs() < 0.05 * THICKNESS, "{mean} beside {z}");
        assert!(scatter(face.iter().map(|p| p[2]), z) < 0.4 * NOISE);
    }
}

#[test]
fn an_edge_stays_sharp() {
    const NOISE: f64 = 0.1;
    let mut random = Random(3);
    let top = sheet(&mut random, 0.0, NOISE);
    // The other face hangs down from the edge at x = 0.
    let side: Vec<[f64; 3]> = sheet(&mut random, 0.0, NOISE).iter().map(|&[a, b, z]| [z, b, -a]).collect();
    let normals: Vec<[f64; 3]> =
        top.iter().map(|_| [0.0, 0.0, 1.0]).chain(side.iter().map(|_| [-1.0, 0.0, 0.0])).collect();
    let points = [top, side].concat();
    let moved = smoothed(&points, &normals);
    let at_edge = |i: &usize| points[*i][0].max(-points[*i][2]) < 2.0;
    let off = |cloud: &[[f64; 3]], i: usize| if i < 2500 { cloud[i][2] } else { cloud[i][0] };
    let edge: Vec<usize> = (0..points.len()).filter(at_edge).collect();
    let [before, after] = [&points, &moved].map(|cloud| scatter(edge.iter().map(|&i| off(cloud, i)), 0.0));
    assert!(edge.len() > 100 && after < 0.5 * before, "{before} to {after}");
}

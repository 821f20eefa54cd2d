//! Joining the layers of voxels of one surface.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use proptest::prelude::*;
use sympose::Result;
use sympose::preprocess::{VoxelGrid, voxel_downsample, voxel_layers};

/// A number in [-0.5, 0.5) that looks random (the finaliser of SplitMix64, Steele et al. 2014).
fn scatter(i: u32) -> f64 {
    let mixed = u64::from(i).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    (mixed >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
}

/// A square plate of side 1, tilted, with uniform noise along its normal; `z` is its height.
fn plate(noise: f64, z: f64) -> Vec<[f64; 3]> {
    let at = |i: u32| [scatter(3 * i), scatter(3 * i + 1), noise * scatter(3 * i + 2) + z];
    let tilted = |[x, y, z]: [f64; 3]| [x, 0.8 * y - 0.6 * z, 0.6 * y + 0.8 * z];
    (0..20_000).map(at).map(tilted).collect()
}

fn height([_, y, z]: [f64; 3]) -> f64 {
    0.8 * z - 0.6 * y
}

/// Every point is seen from above the plates.
fn above(_: usize) -> [f64; 3] {
    [0.5, -6.0, 8.0]
}

/// The grid of [`voxel_layers`].
fn layers(
    points: &[[f64; 3]],
    viewpoint_of: impl Fn(usize) -> [f64; 3] + Sync,
    edge: f64,
) -> Result<VoxelGrid> {
    Ok(voxel_layers(points, viewpoint_of, edge)?.grid)
}

fn root_mean_square(values: impl Iterator<Item = f64> + Clone) -> f64 {
    (values.clone().map(|x| x * x).sum::<f64>() / values.count() as f64).sqrt()
}

#[test]
fn a_noisy_plate_becomes_one_layer_nearer_to_its_plane() {
    let (edge, points) = (0.02, plate(0.04, 0.0));
    let [voxels, columns] =
        [voxel_downsample(&points, edge), layers(&points, above, edge)].map(Result::unwrap);
    // A column takes in the plate on a square of the grid, which the tilt makes larger.
    let least = 0.8 / (edge * edge);
    assert!((columns.points.len() as f64) < 1.25 * least, "{} columns", columns.points.len());
    assert!(voxels.points.len() as f64 > 2.5 * least, "{} voxels", voxels.points.len());
    let [before, after] =
        [&voxels, &columns].map(|grid| root_mean_square(grid.points.iter().map(|p| height(*p))));
    assert!(after < 0.6 * before, "{after} off the plane, {before} before");
}

#[test]
fn a_plate_far_from_the_origin_becomes_one_layer_too() {
    let edge = 0.02;
    let mut points = plate(0.04, 0.0);
    let near = layers(&points, above, edge).unwrap().points.len() as f64;
    points.iter_mut().flatten().for_each(|x| *x += 4e6);
    let far = layers(&points, |i| above(i).map(|x| x + 4e6), edge).unwrap().points.len() as f64;
    assert!((far / near - 1.0).abs() < 0.05, "{far} columns far away, {near} near by");
}

#[test]
fn the_noise_of_a_plate_is_found() {
    for noise in [0.01, 0.04] {
        // Uniform between -noise / 2 and noise / 2.
        let expected = noise / 12_f64.sqrt();
        let found = voxel_layers(&plate(noise, 0.0), above, 0.02).unwrap().noise;
        assert!((found / expected - 1.0).abs() < 0.1, "{found} instead of {expected}");
    }
}

#[test]
fn plates_that_are_apart_stay_apart() {
    let edge = 0.02;
    let mut points = plate(0.01, 0.0);
    points.extend(plate(0.01, 0.1));
    let columns = layers(&points, above, edge).unwrap();
    for (point, &column) in points.iter().zip(&columns.inverse) {
        let moved = height(columns.points[column as usize]) - height(*point);
        assert!(moved.abs() < 0.02, "a point joined another plate: {moved}");
    }
}

#[test]
fn both_sides_of_a_wall_stay_apart_where_there_is_little_noise() {
    let (edge, thickness) = (0.02, 0.05);
    let mut points = plate(0.005, 0.0);
    let behind = points.len();
    points.extend(plate(0.005, -thickness));
    let viewpoint = |i: usize| if i < behind { above(i) } else { above(i).map(|x| -x) };
    let columns = layers(&points, viewpoint, edge).unwrap();
    let mixed = columns.points.iter().filter(|p| (height(**p) + 0.5 * thickness).abs() < 0.2 * thickness);
    assert_eq!(mixed.count(), 0, "means of both sides");
}

#[test]
fn nothing_becomes_nothing_and_bad_sizes_are_refused() {
    assert!(layers(&[], above, 1.0).unwrap().points.is_empty());
    for size in [0.0, -1.0, f64::NAN] {
        assert!(layers(&[[0.0; 3]], above, size).is_err());
    }
    assert!(layers(&[[f64::NAN; 3]], above, 1.0).is_err());
    let identical = layers(&[[1.0, 2.0, 3.0]; 9], above, 1.0).unwrap();
    assert_eq!((identical.points, identical.counts), (vec![[1.0, 2.0, 3.0]], vec![9]));
}

proptest! {
    #[test]
    fn every_point_is_in_the_mean_of_its_column(
        points in prop::collection::vec(prop::array::uniform3(-1.0f64..1.0), 1..300),
        size in 0.05f64..1.0,
    ) {
        let columns = layers(&points, above, size).unwrap();
        prop_assert!(columns.points.len() <= voxel_downsample(&points, size).unwrap().points.len());
        let mut sums = vec![[0.0; 4]; columns.points.len()];
        for (p, &column) in points.iter().zip(&columns.inverse) {
            let sum = &mut sums[column as usize];
            *sum = [sum[0] + p[0], sum[1] + p[1], sum[2] + p[2], sum[3] + 1.0];
        }
        for ((mean, &count), [x, y, z, n]) in columns.points.iter().zip(&columns.counts).zip(sums) {
            prop_assert_eq!(f64::from(count), n);
            for (mean, sum) in mean.iter().zip([x, y, z]) {
                prop_assert!((mean - sum / n).abs() < 1e-12);
            }
        }
    }
}

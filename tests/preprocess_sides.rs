//! The two sides of thin walls.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use sympose::preprocess::{
    KNeighbors, NormalParams, Sides, normals_from_neighbors, separate_sides, voxel_downsample,
};
use sympose::spatial::KdTree;

/// The sides of a cloud in voxels of edge 0.02, each point seen from the place that `viewpoint` gives.
fn sides(points: &[[f64; 3]], viewpoint: impl Fn(usize) -> [f64; 3] + Sync) -> Sides {
    let grid = voxel_downsample(points, 0.02).unwrap();
    let tree = KdTree::new(&grid.points).unwrap();
    let neighbors = KNeighbors::new(&tree, &grid.points, 12).unwrap();
    let params = NormalParams { k: 12, ..NormalParams::default() };
    let normals = normals_from_neighbors(&grid.points, &neighbors, &params).unwrap().normals;
    separate_sides(points, viewpoint, &grid, &normals, &neighbors)
}

#[test]
fn both_faces_of_a_wall_thinner_than_a_voxel_stay_where_they_are() {
    let height = |i: usize| if i.is_multiple_of(2) { 0.004 } else { -0.004 };
    let place = |i: usize| [0.01 * (i / 2 % 40) as f64, 0.01 * (i / 80) as f64, height(i)];
    let points: Vec<[f64; 3]> = (0..3200).map(place).collect();
    let sides = sides(&points, |i| [0.2, 0.2, 500.0 * height(i)]);
    assert_eq!(sides.divided, sides.voxel_of.len() / 2);
    for (point, patch) in points.iter().zip(&sides.patch_of_point) {
        let [_, _, z] = sides.points[*patch as usize];
        assert!((z - point[2]).abs() < 1e-12, "{z} for {}", point[2]);
        assert!(sides.normals[*patch as usize][2] * point[2] > 0.0);
    }
}

/// One row of a depth image: its rays span a plane, the points lie in it, noise and all, and its normal faces no sensor.
/// From which side the row was seen must not be left to rounding.
#[test]
fn the_side_of_one_row_of_a_picture_does_not_hang_on_rounding() {
    let eye = [0.1, 0.3, 2.0];
    let ray = |i: usize| {
        let across = 0.01 * i as f64 - 0.48;
        [0.617 * across, 0.413 * across, -1.9 - 0.0113 * f64::from(i as u8 % 7)]
    };
    let row: Vec<[f64; 3]> = (0..100).map(|i| std::array::from_fn(|axis| eye[axis] + ray(i)[axis])).collect();
    // There and back: what is left is a rounding error.
    let rounded = |x: f64, by: f64| (x + by) - by;
    let first = sides(&row, |_| eye);
    for far in [1e3, 3e4, 7e5, 4e6] {
        let moved: Vec<[f64; 3]> = row.iter().map(|p| p.map(|x| rounded(x, far))).collect();
        let sides = sides(&moved, |_| eye);
        assert_eq!(sides.patch_of_point, first.patch_of_point);
        for (normal, before) in sides.normals.iter().zip(&first.normals) {
            let cosine: f64 = normal.iter().zip(before).map(|(a, b)| a * b).sum();
            assert!(cosine > 0.999, "{cosine} after a shift by {far}");
        }
    }
}

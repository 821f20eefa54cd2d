//! Voxel grid, outlier filters and clusters against straightforward oracles.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test may panic")]
mod scenes;

use std::collections::BTreeMap;

use proptest::prelude::*;
use scenes::{Random, distance_sq, with_threads};
use sympose::Error;
use sympose::preprocess::{
    ClusterParams, KNeighbors, NormalParams, RadiusParams, StatisticalParams, main_cluster, median_spacing,
    normals_from_neighbors, remove_radius_outliers, remove_statistical_outliers, statistical_inliers,
    voxel_downsample,
};
use sympose::spatial::KdTree;

fn clouds() -> impl Strategy<Value = Vec<[f64; 3]>> {
    // A coarse lattice brings ties and duplicates, the continuous part everything else.
    let lattice = prop::array::uniform3((-4_i32..4).prop_map(|x| 0.25 * f64::from(x)));
    let free = prop::array::uniform3(-1.0..1.0);
    prop::collection::vec(prop_oneof![lattice, free], 1..200)
}

/// Cell indices as Open3D computes them.
fn cell(point: &[f64; 3], points: &[[f64; 3]], size: f64) -> [i64; 3] {
    std::array::from_fn(|axis| {
        let lower = points.iter().map(|p| p[axis]).fold(f64::INFINITY, f64::min) - 0.5 * size;
        ((point[axis] - lower) / size).floor() as i64
    })
}

fn morton(indices: [i64; 3]) -> u128 {
    (0..21)
        .map(|bit| (0..3).map(|axis| ((indices[axis] as u128 >> bit) & 1) << (3 * bit + axis)).sum::<u128>())
        .sum()
}

proptest! {
    #[test]
    fn voxels_are_those_of_a_map(points in clouds(), size in prop_oneof![Just(0.25), 0.001..3.0]) {
        let mut cells: BTreeMap<u128, Vec<usize>> = BTreeMap::new();
        for (i, p) in points.iter().enumerate() {
            cells.entry(morton(cell(p, &points, size))).or_default().push(i);
        }
        let grid = voxel_downsample(&points, size).unwrap();
        prop_assert_eq!(grid.points.len(), cells.len());
        let (offsets, members) = grid.members();
        for (c, of_map) in cells.values().enumerate() {
            let of_grid: Vec<usize> =
                members[offsets[c] as usize..offsets[c + 1] as usize].iter().map(|&i| i as usize).collect();
            prop_assert_eq!(of_map, &of_grid);
            prop_assert_eq!(grid.counts[c] as usize, of_map.len());
            let mean: [f64; 3] =
                std::array::from_fn(|axis| of_map.iter().map(|&i| points[i][axis]).sum::<f64>() / of_map.len() as f64);
            prop_assert_eq!(grid.points[c], mean);
            prop_assert!(of_map.iter().all(|&i| grid.inverse[i] as usize == c));
        }
        prop_assert_eq!(grid.mean_of(&points), grid.points);
    }

    #[test]
    fn radius_filter_counts_the_others(
        points in clouds(),
        radius in prop_oneof![Just(0.25), 0.01..1.0],
        least in prop_oneof![0_usize..9, 0_usize..200],
    ) {
        let kept = remove_radius_outliers(&points, &RadiusParams { radius, min_neighbors: least }).unwrap();
        let others = |i: usize| (0..points.len()).filter(|&j| j != i && distance_sq(&points[i], &points[j]) <= radius * radius).count();
        let expected: Vec<u32> = (0..points.len()).filter(|&i| others(i) >= least).map(|i| i as u32).collect();
        prop_assert_eq!(kept, expected);
    }

    #[test]
    fn statistical_filter_follows_its_definition(points in clouds(), k in 1_usize..25, std_ratio in 0.1..3.0) {
        let means: Vec<f64> = points.iter().map(|p| {
            let mut distances: Vec<f64> = points.iter().map(|q| distance_sq(p, q).sqrt()).collect();
            distances.sort_by(f64::total_cmp);
            distances.truncate(k);
            distances.iter().sum::<f64>() / distances.len() as f64
        }).collect();
        let n = means.len() as f64;
        let average = means.iter().sum::<f64>() / n;
        let deviation = (means.iter().map(|m| (m - average).powi(2)).sum::<f64>() / (n - 1.0).max(1.0)).sqrt();
        let threshold = average + std_ratio * deviation;
        let kept = remove_statistical_outliers(&points, &StatisticalParams { k, std_ratio }).unwrap();
        for (i, &mean) in means.iter().enumerate() {
            // Within rounding of the threshold both answers are right.
            if (mean - threshold).abs() > 1e-9 {
                prop_assert_eq!(kept.binary_search(&(i as u32)).is_ok(), mean < threshold);
            }
        }
    }

    #[test]
    fn clusters_join_the_near_and_part_the_far(points in clouds(), distance in prop_oneof![Just(0.25), 0.02..1.0]) {
        let clusters = main_cluster(&points, &ClusterParams { distance, keep_ratio: 0.5 }).unwrap();
        prop_assert_eq!(clusters.sizes.iter().sum::<usize>(), points.len());
        prop_assert!(clusters.sizes.is_sorted_by(|a, b| a >= b));
        for i in 0..points.len() {
            for j in 0..i {
                if distance_sq(&points[i], &points[j]).sqrt() <= distance {
                    prop_assert_eq!(clusters.labels[i], clusters.labels[j]);
                }
            }
        }
        // A cluster is connected by steps of at most two cells along each axis.
        for label in 0..clusters.sizes.len() as u32 {
            let mut members: Vec<usize> = (0..points.len()).filter(|&i| clusters.labels[i] == label).collect();
            prop_assert_eq!(members.len(), clusters.sizes[label as usize]);
            let mut front = vec![members.swap_remove(0)];
            while let Some(i) = front.pop() {
                let (near, far): (Vec<usize>, Vec<usize>) = members.iter().partition(|&&j| {
                    (0..3).all(|axis| (points[i][axis] - points[j][axis]).abs() <= 2.000_001 * distance)
                });
                front.extend(near);
                members = far;
            }
            prop_assert!(members.is_empty());
        }
        let least = 0.5 * clusters.sizes[0] as f64;
        let expected: Vec<u32> = (0..points.len() as u32)
            .filter(|&i| clusters.labels[i as usize] == 0 || clusters.sizes[clusters.labels[i as usize] as usize] as f64 >= least)
            .collect();
        prop_assert_eq!(clusters.kept, expected);
    }
}

#[test]
fn results_do_not_depend_on_threads() {
    let points = Random(1).sphere(30_000);
    let run = || {
        // With the smaller cells the grid has many levels.
        let grids = [0.03, 1e-5].map(|size| voxel_downsample(&points, size).unwrap());
        let kept =
            remove_radius_outliers(&points, &RadiusParams { radius: 0.05, min_neighbors: 12 }).unwrap();
        let inliers = remove_statistical_outliers(&points, &StatisticalParams::default()).unwrap();
        let clusters = main_cluster(&points, &ClusterParams { distance: 0.02, keep_ratio: 0.1 }).unwrap();
        (grids, kept, inliers, clusters)
    };
    let one = with_threads(1, run);
    assert!(one.1.len() < points.len() && one.2.len() < points.len() && one.3.sizes.len() > 1);
    for threads in [2, 5] {
        assert!(with_threads(threads, run) == one);
    }
}

#[test]
fn many_levels_of_the_grid_still_find_every_cell() {
    // Few points in an enormous grid: keys of more than 60 bits.
    let mut points = Random(2).cube(300, 1.0);
    let near: Vec<[f64; 3]> = points.iter().map(|p| p.map(|x| x + 1e-7)).collect();
    points.extend(near);
    let grid = voxel_downsample(&points, 1e-6).unwrap();
    let mut cells: Vec<[i64; 3]> = points.iter().map(|p| cell(p, &points, 1e-6)).collect();
    cells.sort_unstable();
    cells.dedup();
    assert_eq!(grid.points.len(), cells.len());
    assert!(grid.points.len() < points.len());
}

#[test]
fn a_voxel_too_small_names_the_smallest_that_works() {
    let points = [[0.0; 3], [1000.0, 2.0, 3.0]];
    let Err(Error::InvalidParameter { name, value, .. }) = voxel_downsample(&points, 1e-5) else { panic!() };
    assert_eq!(name, "voxel_size");
    let smallest: f64 = value.split("at least ").nth(1).unwrap().trim_end_matches(')').parse().unwrap();
    assert!(voxel_downsample(&points, smallest).is_ok());
    assert!(voxel_downsample(&points, 0.99 * smallest).is_err());
    assert!(voxel_downsample(&[[-1e308; 3], [1e308; 3]], 1.0).is_err());
}

#[test]
fn bad_input_is_named() {
    let nan = [[0.0, f64::NAN, 0.0], [0.0; 3], [f64::INFINITY, 0.0, 0.0]];
    let non_finite = |e| matches!(e, Error::NonFinite { count: 2, total: 3 });
    assert!(voxel_downsample(&nan, 1.0).is_err_and(non_finite));
    assert!(remove_radius_outliers(&nan, &RadiusParams::default()).is_err_and(non_finite));
    assert!(remove_statistical_outliers(&nan, &StatisticalParams::default()).is_err_and(non_finite));
    assert!(main_cluster(&nan, &ClusterParams::default()).is_err_and(non_finite));
    let one = [[1.0, 2.0, 3.0]];
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let invalid = |e| matches!(e, Error::InvalidParameter { .. });
        assert!(voxel_downsample(&one, bad).is_err_and(invalid));
        assert!(
            remove_radius_outliers(&one, &RadiusParams { radius: bad, min_neighbors: 1 }).is_err_and(invalid)
        );
        assert!(
            remove_statistical_outliers(&one, &StatisticalParams { k: 2, std_ratio: bad })
                .is_err_and(invalid)
        );
        assert!(main_cluster(&one, &ClusterParams { distance: bad, keep_ratio: 0.1 }).is_err_and(invalid));
    }
    assert!(remove_statistical_outliers(&one, &StatisticalParams { k: 0, std_ratio: 1.0 }).is_err());
    assert!(main_cluster(&one, &ClusterParams { distance: 1.0, keep_ratio: 1.5 }).is_err());
}

#[test]
fn empty_single_and_identical_clouds_pass() {
    assert!(voxel_downsample(&[], 1.0).unwrap().points.is_empty());
    assert!(remove_radius_outliers(&[], &RadiusParams::default()).unwrap().is_empty());
    assert!(remove_statistical_outliers(&[], &StatisticalParams::default()).unwrap().is_empty());
    assert!(main_cluster(&[], &ClusterParams::default()).unwrap().kept.is_empty());

    // The square of such a distance is infinite.
    let mut far: Vec<[f64; 3]> = (0..1000).map(|i| [f64::from(i % 30), f64::from(i / 30), 0.0]).collect();
    far.push([1e160, 0.0, 0.0]);
    let kept = remove_statistical_outliers(&far, &StatisticalParams { k: 5, std_ratio: 3.0 }).unwrap();
    assert!(kept.len() > 900 && !kept.contains(&1000));

    let same = vec![[0.1, 0.2, 0.3]; 5000];
    assert_eq!(voxel_downsample(&same, 1e-9).unwrap().counts, [5000]);
    assert_eq!(
        remove_radius_outliers(&same, &RadiusParams { radius: 1e-9, min_neighbors: 4999 }).unwrap().len(),
        5000
    );
    assert_eq!(remove_statistical_outliers(&same, &StatisticalParams::default()).unwrap().len(), 5000);
    assert_eq!(main_cluster(&same, &ClusterParams::default()).unwrap().sizes, [5000]);
    assert_eq!(remove_statistical_outliers(&same[..1], &StatisticalParams::default()).unwrap(), [0]);
}

#[test]
fn duplicates_are_not_statistical_outliers() {
    // Open3D drops points whose neighbours all coincide with them.
    let mut points = Random(3).sphere(2000);
    points.extend(vec![[0.0, 0.0, 1.0]; 30]);
    let kept = remove_statistical_outliers(&points, &StatisticalParams { k: 20, std_ratio: 2.0 }).unwrap();
    assert!((2000..2030).all(|i| kept.contains(&i)));
}

#[test]
fn neighbours_serve_several_filters() {
    let points = Random(4).sphere(3000);
    let neighbors = KNeighbors::new(&KdTree::new(&points).unwrap(), &points, 20).unwrap();
    for k in [5, 20] {
        let params = StatisticalParams { k, std_ratio: 1.0 };
        assert_eq!(
            statistical_inliers(&neighbors, &params).unwrap(),
            remove_statistical_outliers(&points, &params).unwrap()
        );
    }
    assert!(statistical_inliers(&neighbors, &StatisticalParams { k: 21, std_ratio: 1.0 }).is_err());
}

#[test]
fn neighbours_among_other_points_are_refused() {
    let [points, others] = [4, 5].map(|seed| Random(seed).sphere(300));
    let more: Vec<[f64; 3]> = points.iter().chain(&others).copied().collect();
    let among_more = KNeighbors::of_queries(&KdTree::new(&more).unwrap(), &more, &points, 20).unwrap();
    let params = NormalParams { k: 20, max_radius: None };
    let mismatch = |e| matches!(e, Error::LengthMismatch { expected: 300, got: 600, .. });
    assert!(normals_from_neighbors(&points, &among_more, &params).is_err_and(mismatch));
    let of_more = KNeighbors::new(&KdTree::new(&more).unwrap(), &more, 20).unwrap();
    assert!(normals_from_neighbors(&points, &of_more, &params).is_err_and(mismatch));
    // Distances are all that counts here, whatever they lead to.
    assert!(statistical_inliers(&among_more, &StatisticalParams::default()).is_ok());
}

#[test]
fn a_crowd_within_one_radius_takes_no_square_of_its_points() {
    let points = Random(6).sphere(200_000);
    for (radius, min_neighbors) in [(10.0, 200_000), (10.0, usize::MAX), (1.5, 199_999)] {
        let kept = remove_radius_outliers(&points, &RadiusParams { radius, min_neighbors }).unwrap();
        assert!(kept.is_empty());
    }
}

#[test]
fn many_neighbours_are_counted_where_a_stray_lies_far_away() {
    let mut points = Random(7).sphere(2000);
    points.push([1e12, 0.0, 0.0]);
    let radius = 0.5;
    let others = |p: &[f64; 3]| points.iter().filter(|q| distance_sq(p, q) <= radius * radius).count() - 1;
    for least in [3, 63, 64, 100, 130, 2000, 2001] {
        let expected: Vec<u32> =
            (0..points.len()).filter(|&i| others(&points[i]) >= least).map(|i| i as u32).collect();
        let kept = remove_radius_outliers(&points, &RadiusParams { radius, min_neighbors: least }).unwrap();
        assert_eq!(kept, expected);
    }
}

#[test]
fn spacing_of_a_lattice() {
    let mut points: Vec<[f64; 3]> =
        (0..10_000).map(|i| [0.5 * f64::from(i % 100), 0.5 * f64::from(i / 100), 7.0]).collect();
    points.extend_from_within(..);
    assert_eq!(median_spacing(&KdTree::new(&points).unwrap(), &points), 0.5);
    let same = vec![[1.0; 3]; 100];
    assert_eq!(median_spacing(&KdTree::new(&same).unwrap(), &same), 0.0);
}

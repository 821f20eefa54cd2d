//! The tree against brute force, and on the clouds that k-d trees dislike.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test may panic")]
mod scenes;

use std::time::{Duration, Instant};

use proptest::prelude::*;
use scenes::{Random, distance_sq, with_threads};
use sympose::Error;
use sympose::preprocess::KNeighbors;
use sympose::spatial::{KdTree, Neighbor};

/// Every point with its distance, nearest first, ties by index.
fn ranked(points: &[[f64; 3]], query: &[f64; 3]) -> Vec<Neighbor> {
    let mut all: Vec<Neighbor> =
        (0..).zip(points).map(|(index, p)| Neighbor { index, distance_sq: distance_sq(p, query) }).collect();
    all.sort_by(|a, b| a.distance_sq.total_cmp(&b.distance_sq).then(a.index.cmp(&b.index)));
    all
}

fn clouds() -> impl Strategy<Value = Vec<[f64; 3]>> {
    // Lattice points coincide, lie in planes and are at equal distances; the others are in general position.
    let lattice = prop::array::uniform3((-3_i32..4).prop_map(|x| 0.5 * f64::from(x)));
    let free = prop::array::uniform3(-2.0..2.0);
    let mixed = prop_oneof![lattice.clone(), free.clone()];
    prop_oneof![
        prop::collection::vec(mixed, 1..150),
        prop::collection::vec(free, 1..400),
        prop::collection::vec(lattice, 200..600),
    ]
}

proptest! {
    #[test]
    fn queries_agree_with_brute_force(points in clouds(), query in prop::array::uniform3(-2.5..2.5), k in 0_usize..40, radius in 0.0..3.0) {
        let tree = KdTree::new(&points).unwrap();
        for query in [query, points[points.len() / 2]] {
            let expected = ranked(&points, &query);
            let distances = |found: &[Neighbor]| found.iter().map(|n| n.distance_sq).collect::<Vec<_>>();

            let nearest = tree.nearest(&query);
            prop_assert_eq!(nearest.distance_sq, expected[0].distance_sq);
            prop_assert_eq!(distance_sq(&points[nearest.index as usize], &query), nearest.distance_sq);
            prop_assert_eq!(tree.nearest_within(&query, radius).is_some(), expected[0].distance_sq <= radius * radius);

            let found = tree.k_nearest(&query, k);
            prop_assert_eq!(distances(&found), distances(&expected[..k.min(points.len())]));
            let ordered = |a: &Neighbor, b: &Neighbor| (a.distance_sq, a.index) < (b.distance_sq, b.index);
            prop_assert!(found.is_sorted_by(ordered));
            prop_assert!(found.iter().all(|n| distance_sq(&points[n.index as usize], &query) == n.distance_sq));

            let mut inside: Vec<Neighbor> = expected.iter().copied().filter(|n| n.distance_sq <= radius * radius).collect();
            inside.sort_by_key(|n| n.index);
            prop_assert_eq!(tree.within(&query, radius), inside);
            // The farthest point of the ball belongs to it.
            let edge = expected[expected.len() / 2].distance_sq.sqrt();
            let inside = expected.iter().filter(|n| n.distance_sq <= edge * edge).count();
            prop_assert_eq!(tree.within(&query, edge).len(), inside);

            let distinct = expected.iter().find(|n| n.distance_sq > 0.0).map(|n| n.distance_sq);
            prop_assert_eq!(tree.nearest_distinct(&query).map(|n| n.distance_sq), distinct);
        }
    }

    #[test]
    fn neighbours_of_all_points_agree_with_brute_force(points in clouds(), k in 1_usize..40) {
        let neighbors = KNeighbors::new(&KdTree::new(&points).unwrap(), &points, k).unwrap();
        prop_assert_eq!((neighbors.len(), neighbors.k()), (points.len(), k.min(points.len())));
        for (i, point) in points.iter().enumerate() {
            let (indices, distances_sq) = neighbors.of(i);
            let expected: Vec<f64> = ranked(&points, point)[..k.min(points.len())].iter().map(|n| n.distance_sq).collect();
            prop_assert_eq!(distances_sq, &expected[..]);
            prop_assert!(indices.iter().zip(distances_sq).all(|(&j, &d)| distance_sq(&points[j as usize], point) == d));
            prop_assert!((1..indices.len()).all(|j| (distances_sq[j - 1], indices[j - 1]) < (distances_sq[j], indices[j])));
        }
    }

    #[test]
    fn neighbours_of_queries_agree_with_brute_force(
        points in clouds(), near in clouds(), far in prop::array::uniform3(-1e12..1e12_f64), k in 1_usize..40,
    ) {
        // Of few queries the tree takes care, of more the cells.
        for queries in [&near[..1], &[&near[..], &[far, [-0.7; 3]]].concat()] {
            let found = KNeighbors::of_queries(&KdTree::new(&points).unwrap(), &points, queries, k).unwrap();
            prop_assert_eq!((found.len(), found.k()), (queries.len(), k.min(points.len())));
            for (i, query) in queries.iter().enumerate() {
                let (indices, distances_sq) = found.of(i);
                let expected: Vec<f64> = ranked(&points, query)[..found.k()].iter().map(|n| n.distance_sq).collect();
                prop_assert_eq!(distances_sq, &expected[..]);
                prop_assert!(indices.iter().zip(distances_sq).all(|(&j, &d)| distance_sq(&points[j as usize], query) == d));
                let order = |j: usize| (distances_sq[j], indices[j]);
                prop_assert!((1..indices.len()).all(|j| order(j - 1) < order(j)));
            }
        }
    }
}

#[test]
fn neighbours_of_no_query_or_a_bad_one() {
    let points = Random(5).cube(100, 1.0);
    let tree = KdTree::new(&points).unwrap();
    let none = KNeighbors::of_queries(&tree, &points, &[], 3).unwrap();
    assert!(none.is_empty());
    assert!(matches!(
        KNeighbors::of_queries(&tree, &points, &[[f64::NAN; 3]], 3),
        Err(Error::NonFinite { count: 1, total: 1 })
    ));
    assert!(matches!(
        KNeighbors::of_queries(&tree, &points[1..], &points, 3),
        Err(Error::LengthMismatch { .. })
    ));
}

#[test]
fn neighbours_agree_with_the_tree_where_density_varies() {
    let mut random = Random(11);
    let mut points = random.sphere(4000);
    points.extend(random.cube(3000, 0.02));
    points.extend(random.cube(100, 50.0));
    points.extend(vec![[3.0; 3]; 800]);
    let tree = KdTree::new(&points).unwrap();
    let run = || KNeighbors::new(&tree, &points, 12).unwrap();
    let neighbors = run();
    for (i, point) in points.iter().enumerate() {
        let expected = tree.k_nearest(point, 12);
        assert_eq!(neighbors.of(i).1, expected.iter().map(|n| n.distance_sq).collect::<Vec<_>>());
    }
    assert_eq!(with_threads(1, run), neighbors);
    assert_eq!(with_threads(3, run), neighbors);
}

#[test]
fn a_tree_is_the_same_at_any_number_of_threads() {
    // So many that both sides of a split are built at the same time; on a lattice it is the tree that decides ties.
    let lattice = (0..40_000).map(|i| [f64::from(i % 200), f64::from(i / 200), 0.0]);
    let points: Vec<[f64; 3]> = lattice.chain(Random(8).cube(20_000, 150.0)).collect();
    let queries = Random(9).cube(500, 200.0);
    let run = || {
        let tree = KdTree::new(&points).unwrap();
        let on_lattice: Vec<_> = points[..500].iter().map(|p| tree.k_nearest(p, 7)).collect();
        (tree.nearest_batch(&queries), on_lattice)
    };
    let alone = with_threads(1, run);
    assert_eq!(with_threads(2, run), alone);
    assert_eq!(with_threads(3, run), alone);
}

#[test]
fn batches_are_the_single_queries() {
    let mut random = Random(3);
    let (points, queries) = (random.cube(3000, 1.0), random.cube(700, 1.2));
    let tree = KdTree::new(&points).unwrap();
    let batches = || {
        (tree.nearest_batch(&queries), tree.k_nearest_batch(&queries, 7), tree.within_batch(&queries, 0.1))
    };
    let (nearest, k_nearest, within) = with_threads(2, batches);
    for (i, query) in queries.iter().enumerate() {
        assert_eq!(nearest[i], tree.nearest(query));
        assert_eq!(k_nearest[i], tree.k_nearest(query, 7));
        assert_eq!(within[i], tree.within(query, 0.1));
    }
}

#[test]
fn coinciding_points_are_found_lowest_index_first() {
    let mut points = vec![[1.0, 2.0, 3.0]; 5000];
    points.extend(Random(1).cube(5000, 1.0));
    points[7] = [0.0, -0.0, 0.0];
    points[9] = [-0.0, 0.0, 0.0];
    let tree = KdTree::new(&points).unwrap();
    assert_eq!(tree.nearest(&[1.1, 2.0, 3.0]).index, 0);
    let found: Vec<u32> = tree.k_nearest(&[1.0, 2.0, 3.0], 9).iter().map(|n| n.index).collect();
    assert_eq!(found, [0, 1, 2, 3, 4, 5, 6, 8, 10]);
    assert_eq!(tree.within(&[1.0, 2.0, 3.0], 1e-9).len(), 4998);
    assert_eq!(tree.k_nearest(&[0.0; 3], 2).iter().map(|n| n.index).collect::<Vec<_>>(), [7, 9]);
    assert_eq!(tree.k_nearest(&[0.0; 3], usize::MAX).len(), 10_000);
}

/// No query may scan the cloud: that would take minutes here.
fn finishes_within(limit: Duration, points: &[[f64; 3]]) {
    let start = Instant::now();
    let tree = KdTree::new(points).unwrap();
    let neighbors = KNeighbors::new(&tree, points, 20).unwrap();
    assert_eq!(neighbors.len(), points.len());
    let queries: Vec<[f64; 3]> = points.iter().map(|p| p.map(|x| x + 1e-3)).collect();
    let found = tree.nearest_batch(&queries);
    assert!(found.iter().all(|n| n.distance_sq <= 3.1e-6));
    assert!(start.elapsed() < limit, "{:?}", start.elapsed());
}

#[test]
fn identical_flat_and_straight_clouds_are_no_slower_than_others() {
    let limit = Duration::from_secs(20);
    finishes_within(limit, &vec![[0.3, -7.0, 1e3]; 200_000]);
    let mut two = vec![[0.0; 3]; 50_000];
    two.extend(vec![[1.0; 3]; 50_000]);
    finishes_within(limit, &two);
    // An image with a return in its first column only: a stride of as many rows as are looked at meets no other column.
    let mut image = vec![[0.0; 3]; 1024 * 100];
    let column = Random(4).cube(1024, 1.0);
    (0..1024).for_each(|row| image[100 * row] = column[row]);
    finishes_within(limit, &image);
    let cube = Random(5).cube(100_000, 1.0);
    finishes_within(limit, &cube.iter().map(|p| [p[0], p[1], 0.5]).collect::<Vec<_>>());
    finishes_within(limit, &cube.iter().map(|p| [p[0], 0.25, 0.5]).collect::<Vec<_>>());
}

#[test]
fn bad_input_is_named_and_bad_queries_are_harmless() {
    assert!(matches!(KdTree::new(&[]), Err(Error::InsufficientData { needed: 1, got: 0, .. })));
    let points = [[0.0; 3], [f64::NEG_INFINITY; 3], [0.0, f64::NAN, 1.0]];
    assert!(matches!(KdTree::new(&points), Err(Error::NonFinite { count: 2, total: 3 })));

    let points = Random(1).cube(100, 1.0);
    let tree = KdTree::new(&points).unwrap();
    assert_eq!((tree.len(), tree.is_empty()), (100, false));
    assert!(tree.k_nearest(&[0.0; 3], 0).is_empty());
    assert_eq!(tree.k_nearest(&[0.0; 3], 1000).len(), 100);
    assert!(tree.within(&[0.0; 3], -1.0).is_empty() && tree.within(&[0.0; 3], f64::NAN).is_empty());
    assert!(tree.nearest_within(&points[0], -1.0).is_none());
    assert_eq!(tree.within(&points[0], f64::INFINITY).len(), 100);
    for query in [[f64::NAN; 3], [f64::INFINITY, 0.0, 0.0], [1e200; 3]] {
        let _ = (tree.nearest(&query), tree.k_nearest(&query, 5), tree.within(&query, 1.0));
    }
    assert!(matches!(KNeighbors::new(&tree, &points, 0), Err(Error::InvalidParameter { name: "k", .. })));
    assert!(matches!(KNeighbors::new(&tree, &points[1..], 3), Err(Error::LengthMismatch { .. })));
}

//! Time of each kernel alone, on the clouds that tell good from bad: `cargo bench --bench kernels`.
#![allow(missing_docs, clippy::unwrap_used, reason = "criterion's macros write no docs; a bench may panic")]
mod clouds;

use std::hint::black_box;
use std::time::Duration;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use sympose::preprocess::{
    ClusterParams, KNeighbors, NormalParams, PlaneParams, RadiusParams, StatisticalParams, estimate_normals,
    main_cluster, remove_radius_outliers, remove_statistical_outliers, segment_plane, voxel_downsample,
};
use sympose::spatial::KdTree;

type Points = Vec<[f64; 3]>;

/// Neighbours asked for, as in the defaults of the pipeline.
const K: usize = 20;

/// Points enough for a filter or a tree, one cloud of each kind.
fn medium() -> [(&'static str, Points); 3] {
    [
        ("scan", clouds::scan(120_000).points),
        ("lattice", clouds::planar_lattice(120_000)),
        ("noise", clouds::noise(120_000)),
    ]
}

/// Times `work` on every cloud.
fn each<T>(
    criterion: &mut Criterion,
    name: &str,
    clouds: &[(&str, Points)],
    work: impl Fn(&[[f64; 3]]) -> T,
) {
    let mut group = criterion.benchmark_group(name);
    for (cloud, points) in clouds {
        group.throughput(Throughput::Elements(points.len() as u64));
        group.bench_with_input(BenchmarkId::from_parameter(cloud), points, |bencher, points| {
            bencher.iter(|| work(black_box(points)));
        });
    }
    group.finish();
}

fn downsampling(criterion: &mut Criterion) {
    let large = [
        ("scan", clouds::scan(500_000).points),
        ("lattice", clouds::planar_lattice(500_000)),
        ("noise", clouds::noise(500_000)),
    ];
    each(criterion, "voxel_downsample", &large, |points| voxel_downsample(points, 0.01).unwrap());
    each(criterion, "main_cluster", &large, |points| {
        main_cluster(points, &ClusterParams { distance: 0.02, ..ClusterParams::default() }).unwrap()
    });
    let table = [("table", clouds::table(500_000))];
    each(criterion, "segment_plane", &table, |points| {
        segment_plane(points, &PlaneParams { distance: 0.01, ..PlaneParams::default() }).unwrap()
    });
}

fn filters(criterion: &mut Criterion) {
    let clouds = medium();
    each(criterion, "remove_radius_outliers", &clouds, |points| {
        remove_radius_outliers(points, &RadiusParams { radius: 0.02, min_neighbors: 16 }).unwrap()
    });
    each(criterion, "remove_statistical_outliers", &clouds, |points| {
        remove_statistical_outliers(points, &StatisticalParams { k: K, ..StatisticalParams::default() })
            .unwrap()
    });
    each(criterion, "estimate_normals", &clouds, |points| {
        let tree = KdTree::new(points).unwrap();
        estimate_normals(points, &tree, &NormalParams { k: K, ..NormalParams::default() }).unwrap()
    });
}

fn neighbors(criterion: &mut Criterion) {
    let clouds = medium();
    each(criterion, "KdTree/new", &clouds, |points| KdTree::new(points).unwrap());
    // Queries beside the points, in the same order.
    let beside = |points: &[[f64; 3]]| points.iter().map(|p| p.map(|x| x + 0.001)).collect::<Points>();
    let mut group = criterion.benchmark_group("KdTree");
    for (cloud, points) in &clouds {
        let (tree, queries) = (KdTree::new(points).unwrap(), beside(points));
        group.throughput(Throughput::Elements(points.len() as u64));
        group.bench_function(BenchmarkId::new("nearest", cloud), |bencher| {
            bencher.iter(|| tree.nearest_batch(black_box(&queries)));
        });
        group.bench_function(BenchmarkId::new("k_nearest", cloud), |bencher| {
            bencher.iter(|| KNeighbors::of_queries(&tree, points, black_box(&queries), K).unwrap());
        });
        group.bench_function(BenchmarkId::new("all_points", cloud), |bencher| {
            bencher.iter(|| KNeighbors::new(&tree, black_box(points), K).unwrap());
        });
    }
    group.finish();
}

criterion_group! {
    name = kernels;
    config = Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(200))
        .measurement_time(Duration::from_millis(800));
    targets = downsampling, filters, neighbors
}
criterion_main!(kernels);

//! Time of a whole estimate, from raw points to the pose: `cargo bench --bench estimate`.
#![allow(missing_docs, clippy::unwrap_used, reason = "criterion's macros write no docs; a bench may panic")]
mod clouds;

use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use sympose::{Config, Estimator, Order, PointCloud, Request};

fn estimates(criterion: &mut Criterion) {
    let scan = clouds::scan(500_000);
    let cloud =
        PointCloud::from_points(scan.points).and_then(|c| c.with_viewpoints(scan.viewpoints)).unwrap();
    let known = Estimator::new(Config { order: Order::Cyclic(clouds::ORDER), ..Config::default() }).unwrap();
    let unknown = Estimator::new(Config::default()).unwrap();
    let before = known.estimate(&cloud).unwrap().world_from_object;
    let tracking = Request { initial: Some(before), ..Request::default() };

    let mut group = criterion.benchmark_group("estimate");
    group.bench_function("order known", |bencher| bencher.iter(|| known.estimate(&cloud).unwrap()));
    group.bench_function("order unknown", |bencher| bencher.iter(|| unknown.estimate(&cloud).unwrap()));
    group.bench_function("tracking", |bencher| {
        bencher.iter(|| known.estimate_with(&cloud, &tracking).unwrap());
    });
    group.finish();
}

criterion_group! {
    name = estimate;
    config = Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_secs(4));
    targets = estimates
}
criterion_main!(estimate);

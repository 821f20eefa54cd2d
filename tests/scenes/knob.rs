//! A lobed knob, and its pose.

use std::f64::consts::TAU;

use sympose::nalgebra::{Isometry3, Vector3};
use sympose::{Config, Error, Estimate, Estimator, Order, PointCloud};

/// A lobed knob with a dished top, seen all round: points about the z axis, lobes of `order` (0: none).
pub(crate) fn knob(order: u32, count: usize) -> Vec<[f64; 3]> {
    let golden = 0.618_033_988_749_894_9;
    let lobed = |angle: f64| if order == 0 { 0.4 } else { 0.4 + 0.05 * (f64::from(order) * angle).cos() };
    (0..count)
        .map(|i| {
            let share = (i as f64 + 0.5) / count as f64;
            let angle = TAU * (i as f64 * golden).fract();
            let rim = lobed(angle);
            // Noise of a thousandth, from a second low-discrepancy sequence.
            let noise = 0.002 * ((i as f64 * 0.754_877_666_2).fract() - 0.5);
            if share < 0.4 {
                let r = rim * (share / 0.4).sqrt();
                [r * angle.cos(), r * angle.sin(), 0.15 + 0.1 * r * r + noise]
            } else if share < 0.7 {
                let z = -0.1 + (0.25 + 0.1 * rim * rim) * (share - 0.4) / 0.3;
                [(rim + noise) * angle.cos(), (rim + noise) * angle.sin(), z]
            } else {
                let r = rim * ((share - 0.7) / 0.3).sqrt();
                [r * angle.cos(), r * angle.sin(), -0.1 + noise]
            }
        })
        .collect()
}

pub(crate) fn cyclic(order: u32) -> Config {
    Config { order: Order::Cyclic(order), ..Config::default() }
}

pub(crate) fn estimate(points: Vec<[f64; 3]>, config: Config) -> Result<Estimate, Error> {
    Estimator::new(config)?.estimate(&PointCloud::from_points(points)?)
}

pub(crate) fn axis_error_deg(estimate: &Estimate, truth: &Isometry3<f64>) -> f64 {
    let (a, b) = (estimate.world_from_object * Vector3::z(), truth * Vector3::z());
    a.cross(&b).norm().atan2(a.dot(&b).abs()).to_degrees()
}

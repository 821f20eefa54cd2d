//! Small analytic clouds for the tests of the preprocessing stages.
#![allow(dead_code, clippy::unwrap_used, reason = "each test uses its own part, and may panic")]

pub(crate) mod knob;

/// A seeded stream of numbers (SplitMix64).
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in [low, high).
    pub(crate) fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Standard normal (Box and Muller).
    pub(crate) fn normal(&mut self) -> f64 {
        let radius = (-2.0 * self.uniform(1e-300, 1.0).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform(0.0, 1.0)).cos()
    }

    /// `count` points, uniform in a cube of the given edge about the origin.
    pub(crate) fn cube(&mut self, count: usize, edge: f64) -> Vec<[f64; 3]> {
        (0..count).map(|_| std::array::from_fn(|_| self.uniform(-0.5 * edge, 0.5 * edge))).collect()
    }

    /// `count` points on the unit sphere.
    pub(crate) fn sphere(&mut self, count: usize) -> Vec<[f64; 3]> {
        (0..count)
            .map(|_| {
                let p: [f64; 3] = std::array::from_fn(|_| self.normal());
                let length = p.iter().map(|x| x * x).sum::<f64>().sqrt();
                p.map(|x| x / length)
            })
            .collect()
    }
}

/// Squared distance.
pub(crate) fn distance_sq(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    (0..3).map(|i| (a[i] - b[i]).powi(2)).sum()
}

/// Runs `f` in a pool of its own.
pub(crate) fn with_threads<T: Send>(threads: usize, f: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(f)
}

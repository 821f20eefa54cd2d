//! Huber's loss and a robust scale.

use serde::{Deserialize, Serialize};

pub(crate) use crate::median::robust_sigma;

/// Where the loss becomes linear [standard deviation]: with normal errors alone it is 95 % as efficient as
/// least squares.
pub(crate) const HUBER_WIDTH: f64 = 1.345;

/// Huber's loss: quadratic up to `width`, linear beyond (the paper's gamma norm).
///
/// Conventions: `cost` is rho(r) with rho(r) = r^2 / 2 near zero; `weight` is rho'(r) / r, in (0, 1].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct Huber {
    /// Where the loss becomes linear [unit of the residual].
    pub width: f64,
}

impl Huber {
    /// rho(r).
    #[must_use]
    #[inline]
    pub(crate) fn cost(&self, residual: f64) -> f64 {
        let r = residual.abs();
        if r <= self.width { 0.5 * r * r } else { self.width * (r - 0.5 * self.width) }
    }

    /// Weight of a residual in iteratively reweighted least squares.
    #[must_use]
    #[inline]
    pub(crate) fn weight(&self, residual: f64) -> f64 {
        let r = residual.abs();
        if r <= self.width { 1.0 } else { self.width / r }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn huber_weight_is_the_derivative_over_the_residual() {
        let huber = Huber { width: 0.7 };
        for r in [-3.0, -0.71, -0.3, 0.1, 0.69, 2.0] {
            let h = 1e-6;
            let slope = (huber.cost(r + h) - huber.cost(r - h)) / (2.0 * h);
            assert!((slope / r - huber.weight(r)).abs() < 1e-6);
        }
    }

    #[test]
    fn scale_ignores_outliers() {
        let mut residuals: Vec<f64> = (0..1000).map(|i| f64::from(i % 100) / 100.0 - 0.5).collect();
        let clean = robust_sigma(&mut residuals.clone());
        residuals.extend(std::iter::repeat_n(1e6, 100));
        assert!((robust_sigma(&mut residuals) - clean).abs() < 0.15 * clean);
        assert_eq!(robust_sigma(&mut []), 0.0);
    }
}

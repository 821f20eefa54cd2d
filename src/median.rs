//! The middle value of some numbers, and their spread by it.

/// Upper median; reorders `values`. `None` for an empty slice.
#[must_use]
pub(crate) fn median(values: &mut [f64]) -> Option<f64> {
    if values.is_empty() {
        return None;
    }
    let middle = values.len() / 2;
    let (_, m, _) = values.select_nth_unstable_by(middle, f64::total_cmp);
    Some(*m)
}

/// Standard deviation of a Gaussian core, from the median absolute value about zero; `residuals` are left as
/// absolute values in another order.
///
/// Returns 0 for an empty slice.
#[must_use]
pub(crate) fn robust_sigma(residuals: &mut [f64]) -> f64 {
    /// Ratio of standard deviation to median absolute deviation of a Gaussian.
    const SIGMA_OF_MAD: f64 = 1.482_602_218_505_602;
    for r in residuals.iter_mut() {
        *r = r.abs();
    }
    median(residuals).map_or(0.0, |m| SIGMA_OF_MAD * m)
}

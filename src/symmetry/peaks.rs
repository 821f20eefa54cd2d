//! The order where no viewpoint is known, so that hidden surface looks like missing surface, or where the only view may have
//! lost any of it.
//!
//! A rotated point can match only where somebody saw the surface that it comes to lie on. Let v be the share of points for which
//! this is so. At an angle of the symmetry all of these match: their share is v. At angles a little beside it v is about the
//! same, but the share c of points with structure around them miss: what is left is v (1 - c). How much larger the first is than
//! the second does not depend on v, so that an order shows where the matches stand out from those at the angles around.

use crate::symmetry::detect::{DetectParams, rival};
use crate::symmetry::order::gcd;
use crate::symmetry::sweep::{Sweep, fraction};

/// An order that stands out.
pub(crate) struct Standing {
    /// The order.
    pub order: u32,
    /// Another one that stands out as well.
    pub rival: Option<u32>,
    /// By how much the matches at the angles that no divisor shares exceed those around [share of the latter].
    pub gain: f64,
}

/// The order of the `chosen` samples and its rival, if any; `against` has the share of the evidence against each order from 2
/// on. `None` where none stands out.
pub(crate) fn order_from_peaks(
    sweep: &Sweep,
    chosen: &[usize],
    against: &[f64],
    params: &DetectParams,
) -> Option<Standing> {
    /// A single multiple may stand out by this share of what is asked of all.
    const LEAST: f64 = 0.5;
    let peaks = sweep.peaks(chosen);
    let gain = |k: u32, n: u32| {
        let peak = peaks[&fraction(k, n)];
        peak.matched / peak.expected - 1.0
    };
    let own_gain = |n: u32| {
        let own: Vec<f64> = (1..=n / 2).filter(|&k| gcd(k, n) == 1).map(|k| gain(k, n)).collect();
        own.iter().sum::<f64>() / own.len() as f64
    };
    let stands_out = |n: u32| {
        let refused = if n == 2 { params.unseen_refused_half } else { params.unseen_refused };
        against[n as usize - 2] < refused
            && own_gain(n) > params.unseen_gain
            && (1..=n / 2).all(|k| gain(k, n) > LEAST * params.unseen_gain)
    };
    let with_evidence = |n: u32| (n, against[n as usize - 2]);
    let standing: Vec<(u32, f64)> =
        (2..=params.max_order).filter(|&n| stands_out(n)).map(with_evidence).collect();
    let &(mut order, floor) = standing.iter().min_by(|a, b| a.1.total_cmp(&b.1))?;
    // The matches at the multiples of the whole group are those at the order known so far.
    let follows = |n: u32, order: u32| {
        /// Share of the height of the peaks beside that the least of the new ones must have.
        const LOWEST: f64 = 0.5;
        // A half turn alone says little of the height at other angles.
        let mean = if order == 2 { 0.6 } else { 0.8 };
        let heights = (1..=n / 2).filter(|&k| !(k * order).is_multiple_of(n)).map(|k| {
            let beside = [k * order / n, k * order / n + 1].into_iter().filter(|j| j % order != 0);
            let beside: Vec<f64> = beside.map(|j| peaks[&fraction(j, order)].matched).collect();
            let peak = peaks[&fraction(k, n)];
            let full = beside.iter().sum::<f64>() / beside.len() as f64 - peak.expected;
            if full > 0.0 { (peak.matched - peak.expected) / full } else { 1.0 }
        });
        let heights: Vec<f64> = heights.collect();
        heights.iter().sum::<f64>() >= mean * heights.len() as f64
            && heights.iter().all(|height| *height >= LOWEST)
    };
    let multiple = |order: u32| {
        let mut larger = standing.iter().map(|(n, _)| *n).filter(|n| *n > order && n.is_multiple_of(order));
        larger.find(|n| follows(*n, order))
    };
    while let Some(n) = multiple(order) {
        order = n;
    }
    let others: Vec<(u32, f64)> =
        standing.iter().filter(|(n, _)| !n.is_multiple_of(order)).copied().collect();
    let rival = rival(&others, with_evidence(order), params.unseen_gain * floor);
    Some(Standing { order, rival, gain: own_gain(order) })
}

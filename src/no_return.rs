//! Rows of a cloud that stand for no return: many at one place, or as far away as nothing else.

use std::collections::HashMap;

/// Points that are looked at.
const LOOKED_AT: usize = 10_000;

/// Places that so many points share as no surface has at one place: mostly the origin, for pixels without a return.
pub(crate) fn crowded_places(points: &[[f64; 3]]) -> Vec<[f64; 3]> {
    /// Points at one place, of those that are looked at \[count\].
    const MANY: u32 = 100;
    let step = points.len().div_ceil(LOOKED_AT).max(1);
    let mut counts: HashMap<[u64; 3], u32> = HashMap::new();
    for p in points.iter().step_by(step) {
        // Zero has two signs, and -0.0 + 0.0 is 0.0.
        *counts.entry(p.map(|x| (x + 0.0).to_bits())).or_default() += 1;
    }
    counts.into_iter().filter(|(_, count)| *count >= MANY).map(|(bits, _)| bits.map(f64::from_bits)).collect()
}

/// The box beyond which points are far from all others; `None` where there are none such.
pub(crate) fn usual_box(points: &[[f64; 3]], [lower, upper]: [[f64; 3]; 2]) -> Option<[[f64; 3]; 2]> {
    /// Distance from the median [widest interquartile range].
    const FAR: f64 = 100.0;
    let step = points.len().div_ceil(LOOKED_AT).max(1);
    let quartiles: [[f64; 3]; 3] = std::array::from_fn(|axis| {
        let mut values: Vec<f64> = points.iter().step_by(step).map(|p| p[axis]).collect();
        let last = values.len() - 1;
        [0.25, 0.5, 0.75]
            .map(|share| *values.select_nth_unstable_by((share * last as f64) as usize, f64::total_cmp).1)
    });
    let reach = FAR * quartiles.iter().map(|[low, _, high]| high - low).fold(0.0, f64::max);
    let [least, most] = [-reach, reach].map(|reach| quartiles.map(|[_, middle, _]| middle + reach));
    let is_within = (0..3).all(|axis| least[axis] <= lower[axis] && upper[axis] <= most[axis]);
    // Where half of the points coincide nothing can be told.
    (reach > 0.0 && !is_within).then_some([least, most])
}

//! Rows of a cloud that stand for no return: many at one place or at one far value of a coordinate, or as far away as nothing
//! else.

use std::collections::HashMap;

/// Points that are looked at.
const LOOKED_AT: usize = 10_000;

/// Points of these that are many \[count\].
const MANY: usize = 100;

/// Places that so many points share as no surface has at one place: mostly the origin, for pixels without a return.
pub(crate) fn crowded_places(points: &[[f64; 3]]) -> Vec<[f64; 3]> {
    let mut counts: HashMap<[u64; 3], usize> = HashMap::new();
    for p in looked_at(points) {
        // Zero has two signs, and -0.0 + 0.0 is 0.0.
        *counts.entry(p.map(|x| (x + 0.0).to_bits())).or_default() += 1;
    }
    counts.into_iter().filter(|(_, count)| *count >= MANY).map(|(bits, _)| bits.map(f64::from_bits)).collect()
}

/// A coordinate, x, y or z, and its value at many points that lie farther from all others than these are apart: profilers write
/// such a number, -999 say, for the height where they get no return, and the place beside it.
pub(crate) fn far_level(points: &[[f64; 3]], [lower, upper]: [[f64; 3]; 2]) -> Option<(usize, f64)> {
    let extent = |axis: usize| upper[axis] - lower[axis];
    let is_far = |axis: usize, level: f64| {
        let count = looked_at(points).filter(|p| p[axis] == level).count();
        if count < MANY || looked_at(points).len() - count < MANY {
            return false;
        }
        let gap = |p: &[f64; 3]| (p[axis] - level).abs();
        let nearest = points.iter().map(gap).filter(|&gap| gap > 0.0).fold(f64::INFINITY, f64::min);
        let beside = (0..3).filter(|&other| other != axis).map(extent).fold(0.0, f64::max);
        nearest > beside.max(extent(axis) - nearest)
    };
    (0..3)
        .flat_map(|axis| [(axis, lower[axis]), (axis, upper[axis])])
        .find(|&(axis, level)| is_far(axis, level))
}

/// The box beyond which points are far from all others; `None` where there are none such.
pub(crate) fn usual_box(points: &[[f64; 3]], [lower, upper]: [[f64; 3]; 2]) -> Option<[[f64; 3]; 2]> {
    /// Distance from the median [widest interquartile range].
    const FAR: f64 = 100.0;
    let quartiles: [[f64; 3]; 3] = std::array::from_fn(|axis| {
        let mut values: Vec<f64> = looked_at(points).map(|p| p[axis]).collect();
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

/// Every n-th of the points.
fn looked_at(points: &[[f64; 3]]) -> impl ExactSizeIterator<Item = &[f64; 3]> {
    points.iter().step_by(points.len().div_ceil(LOOKED_AT).max(1))
}

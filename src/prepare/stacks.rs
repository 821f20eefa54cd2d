//! Pieces of one thing: what hangs over a gap that no camera saw into is cut off from what stands below it.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use crate::preprocess::{Clusters, DisjointSets};
use crate::symmetry::axis::Axis;

/// Pieces that are looked at, at least so large [the largest piece].
const PIECE: f64 = 0.01;

/// How much of the smaller of two footprints the larger one must cover, for one piece to stand over the other.
const COVERED: f64 = 0.6;

/// Which of the `clusters` of `points` make up the largest thing on a support with this `normal`: pieces over one another are
/// one thing. `cell` is the edge of the cells in which footprints are compared \[length\].
pub(super) fn largest_stack(
    points: &[[f64; 3]],
    clusters: &Clusters,
    normal: Vector3<f64>,
    cell: f64,
) -> Vec<bool> {
    let Clusters { labels, sizes, .. } = clusters;
    let mut is_of_largest: Vec<bool> = (0..sizes.len()).map(|label| label == 0).collect();
    let Some(axis) = Axis::new(normal, Vector3::zeros()) else { return is_of_largest };
    let pieces = sizes.iter().take_while(|&&size| size as f64 >= PIECE * sizes[0] as f64).count();
    let [u, v] = axis.tangents();
    let place = |p: &[f64; 3]| [u, v].map(|along| (along.dot(&Vector3::from(*p)) / cell).floor() as i64);
    let footprints = points.iter().map(place).zip(labels.iter().copied());
    let stack_of = stacks(footprints.filter(|(_, label)| (*label as usize) < pieces).collect(), pieces);
    let mut size_of_stack = vec![0; pieces];
    stack_of.iter().zip(sizes).for_each(|(&stack, size)| size_of_stack[stack as usize] += size);
    // Of equal ones the first.
    let largest = (0..pieces).rev().max_by_key(|&stack| size_of_stack[stack]).unwrap_or_default();
    for (is_of_largest, stack) in is_of_largest.iter_mut().zip(stack_of) {
        *is_of_largest = stack as usize == largest;
    }
    is_of_largest
}

/// For each of so many `pieces` the first of those that it stands over or under, by the cells of their footprints.
fn stacks(mut footprints: Vec<([i64; 2], u32)>, pieces: usize) -> Vec<u32> {
    footprints.sort_unstable();
    footprints.dedup();
    let mut areas = vec![0_u32; pieces];
    footprints.iter().for_each(|(_, piece)| areas[*piece as usize] += 1);
    let mut shared: BTreeMap<[u32; 2], u32> = BTreeMap::new();
    for cell in footprints.chunk_by(|a, b| a.0 == b.0) {
        for (i, (_, one)) in cell.iter().enumerate() {
            for (_, other) in &cell[i + 1..] {
                *shared.entry([*one, *other]).or_default() += 1;
            }
        }
    }
    let mut joined = DisjointSets::new(pieces);
    for ([a, b], area) in shared {
        if f64::from(area) >= COVERED * f64::from(areas[a as usize].min(areas[b as usize])) {
            joined.join(a, b);
        }
    }
    (0..pieces as u32).map(|piece| joined.least(piece)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The cells of a row on the support, for one piece.
    fn row(cells: std::ops::Range<i64>, piece: u32) -> impl Iterator<Item = ([i64; 2], u32)> {
        cells.map(move |x| ([x, 0], piece))
    }

    #[test]
    fn pieces_over_one_another_are_one_stack() {
        // A disc, a stem under it, a thing beside it that is partly under its rim, and what lies on that thing.
        let footprints = row(0..10, 0).chain(row(4..6, 1)).chain(row(8..14, 2)).chain(row(11..13, 3));
        assert_eq!(stacks(footprints.collect(), 4), [0, 0, 2, 2]);
    }
}

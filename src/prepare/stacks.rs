//! Pieces of one thing: what hangs over a gap that no camera saw into is cut off from what stands below it.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use crate::preprocess::{Clusters, root};
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
    let mut footprints: Vec<([i64; 2], u32)> = (points.iter().zip(labels))
        .filter(|(_, label)| (**label as usize) < pieces)
        .map(|(p, &label)| ([u, v].map(|along| (along.dot(&Vector3::from(*p)) / cell).floor() as i64), label))
        .collect();
    footprints.sort_unstable();
    footprints.dedup();
    let mut areas = vec![0_u32; pieces];
    footprints.iter().for_each(|(_, label)| areas[*label as usize] += 1);
    let mut shared: BTreeMap<[u32; 2], u32> = BTreeMap::new();
    for column in footprints.chunk_by(|a, b| a.0 == b.0) {
        for (i, (_, lower)) in column.iter().enumerate() {
            for (_, higher) in &column[i + 1..] {
                *shared.entry([*lower, *higher]).or_default() += 1;
            }
        }
    }
    let mut parents: Vec<u32> = (0..pieces as u32).collect();
    for ([a, b], area) in shared {
        if f64::from(area) >= COVERED * f64::from(areas[a as usize].min(areas[b as usize])) {
            let (a, b) = (root(&mut parents, a), root(&mut parents, b));
            parents[a.max(b) as usize] = a.min(b);
        }
    }
    let mut size_of_stack = vec![0; pieces];
    for piece in 0..pieces {
        size_of_stack[root(&mut parents, piece as u32) as usize] += sizes[piece];
    }
    // Of equal ones the first.
    let largest = (0..pieces).rev().max_by_key(|&stack| size_of_stack[stack]).unwrap_or_default() as u32;
    for (piece, is_of_largest) in (0_u32..).zip(&mut is_of_largest[..pieces]) {
        *is_of_largest = root(&mut parents, piece) == largest;
    }
    is_of_largest
}

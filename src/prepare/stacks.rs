//! Pieces of one thing: what hangs over a gap that no camera saw into is cut off from what stands below it.

use std::cmp::Ordering;
use std::collections::{BTreeMap, BTreeSet};

use nalgebra::Vector3;

use crate::preprocess::{Clusters, DisjointSets};
use crate::spatial::KdTree;
use crate::symmetry::axis::Axis;

/// Pieces that are looked at, at least so large [the largest piece].
pub(super) const PIECE: f64 = 0.01;

/// How much of the smaller of two footprints the larger one must cover, for one piece to stand over the other.
const COVERED: f64 = 0.6;

/// Of eight directions from the cells of a footprint, the share in which another one lies, for this to go all round it.
const SURROUNDED: f64 = 0.85;

/// Of the cells of a footprint the share in which the support is seen, for nothing to stand there.
const BARE: f64 = 0.5;

/// What pieces stand on.
pub(super) struct Floor {
    pub(super) plane: [f64; 4],
    /// Points of the scene that are no candidates for the part: among them those on the plane.
    pub(super) points: Vec<[f64; 3]>,
}

/// Which of the `clusters` of `points` make up the largest thing on a `floor`: pieces over one another are one thing, and so is
/// a piece that does not reach down to the floor with one that goes all round it, as spokes with their rim, or, if nothing can be
/// below it, with what is nearest within `reach`, as a handle with its cup. `cell` is the edge of the cells in which footprints
/// are compared \[length\].
pub(super) fn largest_stack(
    points: &[[f64; 3]],
    clusters: &Clusters,
    floor: &Floor,
    cell: f64,
    reach: f64,
) -> Vec<bool> {
    let Clusters { labels, sizes, .. } = clusters;
    let mut is_of_largest: Vec<bool> = (0..sizes.len()).map(|label| label == 0).collect();
    let [x, y, z, offset] = floor.plane;
    let Some(axis) = Axis::new(Vector3::new(x, y, z), Vector3::zeros()) else { return is_of_largest };
    let pieces = sizes.iter().take_while(|&&size| size as f64 >= PIECE * sizes[0] as f64).count();
    let [u, v] = axis.tangents();
    let place = |p: &[f64; 3]| [u, v].map(|along| (along.dot(&Vector3::from(*p)) / cell).floor() as i64);
    let mut lowest = vec![f64::INFINITY; sizes.len()];
    let height = |p: &[f64; 3]| axis.direction.dot(&Vector3::from(*p)) + offset;
    for (p, &label) in points.iter().zip(labels) {
        lowest[label as usize] = lowest[label as usize].min(height(p));
    }
    let hovers: Vec<bool> = lowest.iter().take(pieces).map(|&height| height > cell).collect();
    let mut footprints: Vec<([i64; 2], u32)> = points
        .iter()
        .map(place)
        .zip(labels.iter().copied())
        .filter(|(_, label)| (*label as usize) < pieces)
        .collect();
    footprints.sort_unstable();
    footprints.dedup();
    let mut joined = stacks(&footprints, &hovers);
    if hovers.contains(&true) && pieces > 1 {
        let bare: BTreeSet<[i64; 2]> =
            floor.points.iter().filter(|p| height(p).abs() < cell).map(place).collect();
        for piece in (0..pieces as u32).filter(|&piece| hovers[piece as usize]) {
            let cells = || footprints.iter().filter(|(_, of)| *of == piece).map(|(cell, _)| cell);
            let seen = cells().filter(|&cell| bare.contains(cell)).count();
            if seen as f64 >= BARE * cells().count() as f64 {
                if let Some(other) = nearest_piece(points, labels, piece, reach, &mut joined, pieces) {
                    joined.join(piece, other);
                }
            }
        }
    }
    let stack_of: Vec<u32> = (0..pieces as u32).map(|piece| joined.least(piece)).collect();
    let mut size_of_stack = vec![0; pieces];
    stack_of.iter().zip(sizes).for_each(|(&stack, size)| size_of_stack[stack as usize] += size);
    // Of equal ones the first.
    let largest = (0..pieces).rev().max_by_key(|&stack| size_of_stack[stack]).unwrap_or_default();
    for (is_of_largest, stack) in is_of_largest.iter_mut().zip(stack_of) {
        *is_of_largest = stack as usize == largest;
    }
    is_of_largest
}

/// Of the pieces that do not yet hang together with `piece` the one nearest to it, within `reach`.
fn nearest_piece(
    points: &[[f64; 3]],
    labels: &[u32],
    piece: u32,
    reach: f64,
    joined: &mut DisjointSets,
    pieces: usize,
) -> Option<u32> {
    let stack = joined.least(piece);
    let is_other: Vec<bool> = (0..pieces as u32).map(|other| joined.least(other) != stack).collect();
    let own: Vec<[f64; 3]> =
        points.iter().zip(labels).filter(|(_, label)| **label == piece).map(|(p, _)| *p).collect();
    let tree = KdTree::new(&own).ok()?;
    let distances =
        points.iter().zip(labels).filter(|(_, label)| is_other.get(**label as usize) == Some(&true));
    let near = distances.filter_map(|(p, label)| Some((tree.nearest_within(p, reach)?.distance_sq, *label)));
    Some(near.min_by(|a, b| a.partial_cmp(b).unwrap_or(Ordering::Equal))?.1)
}

/// Which pieces stand over or under each other, or hover amid one another, by the sorted cells of their footprints.
fn stacks(footprints: &[([i64; 2], u32)], hovers: &[bool]) -> DisjointSets {
    let pieces = hovers.len();
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
    let rows: Vec<Rows> = (0..pieces as u32).map(|piece| Rows::new(footprints, piece)).collect();
    for inner in (0..pieces).filter(|&piece| hovers[piece]) {
        let cells = || footprints.iter().filter(|(_, piece)| *piece as usize == inner).map(|(cell, _)| *cell);
        for outer in (0..pieces).filter(|&outer| outer != inner && areas[outer] > areas[inner]) {
            let met: usize = cells().map(|cell| rows[outer].directions(cell)).sum();
            if met as f64 >= SURROUNDED * 8.0 * f64::from(areas[inner]) {
                joined.join(inner as u32, outer as u32);
            }
        }
    }
    joined
}

/// How far a footprint reaches along rows of cells: across, along and both diagonals.
struct Rows(BTreeMap<(usize, i64), [i64; 2]>);

impl Rows {
    fn new(footprints: &[([i64; 2], u32)], piece: u32) -> Self {
        let mut reach: BTreeMap<(usize, i64), [i64; 2]> = BTreeMap::new();
        for (cell, _) in footprints.iter().filter(|(_, of)| *of == piece) {
            for (kind, (row, at)) in Self::through(*cell).into_iter().enumerate() {
                let [first, last] = reach.entry((kind, row)).or_insert([at, at]);
                (*first, *last) = (at.min(*first), at.max(*last));
            }
        }
        Self(reach)
    }

    /// The rows through a cell, and its place in each. Diagonals are two cells wide, so that none slips through another.
    fn through([x, y]: [i64; 2]) -> [(i64, i64); 4] {
        [(y, x), (x, y), ((x + y).div_euclid(2), x - y), ((x - y).div_euclid(2), x + y)]
    }

    /// In how many of eight directions from a cell the footprint lies.
    fn directions(&self, cell: [i64; 2]) -> usize {
        let met = |(kind, (row, at)): (usize, (i64, i64))| match self.0.get(&(kind, row)) {
            Some([first, last]) => usize::from(*first < at) + usize::from(*last > at),
            None => 0,
        };
        Self::through(cell).into_iter().enumerate().map(met).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The cells of a row on the support, for one piece.
    fn row(cells: std::ops::Range<i64>, piece: u32) -> impl Iterator<Item = ([i64; 2], u32)> {
        cells.map(move |x| ([x, 0], piece))
    }

    fn stack_of(mut footprints: Vec<([i64; 2], u32)>, hovers: &[bool]) -> Vec<u32> {
        footprints.sort_unstable();
        let mut joined = stacks(&footprints, hovers);
        (0..hovers.len() as u32).map(|piece| joined.least(piece)).collect()
    }

    #[test]
    fn pieces_over_one_another_are_one_stack() {
        // A disc, a stem under it, a thing beside it that is partly under its rim, and what lies on that thing.
        let footprints = row(0..10, 0).chain(row(4..6, 1)).chain(row(8..14, 2)).chain(row(11..13, 3));
        assert_eq!(stack_of(footprints.collect(), &[false; 4]), [0, 0, 2, 2]);
    }

    #[test]
    fn a_piece_that_hovers_amid_a_ring_is_of_it() {
        let disc = |radius: i64, piece: u32| {
            let cells = move |x: i64| (-radius..=radius).map(move |y| [x, y]);
            let within = move |[x, y]: &[i64; 2]| x * x + y * y <= radius * radius;
            (-radius..=radius).flat_map(cells).filter(within).map(move |cell| (cell, piece))
        };
        let ring = || disc(10, 0).filter(|([x, y], _)| x * x + y * y > 64);
        let inside = || ring().chain(disc(4, 1)).collect::<Vec<_>>();
        assert_eq!(stack_of(inside(), &[false, true]), [0, 0]);
        assert_eq!(stack_of(inside(), &[false, false]), [0, 1]);
        // A third of the ring is missing.
        let open = ring().filter(|([x, y], _)| *x < y.abs() / 2).chain(disc(4, 1));
        assert_eq!(stack_of(open.collect(), &[false, true]), [0, 1]);
    }
}

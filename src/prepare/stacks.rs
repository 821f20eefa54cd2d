//! Pieces of one thing: what hangs over a gap that no camera saw into is cut off from what stands below it.

use std::array;
use std::cmp::Ordering;
use std::collections::{BTreeMap, BTreeSet, HashMap};

use nalgebra::Vector3;

use crate::directions::tangents;
use crate::preprocess::{Clusters, DisjointSets};
use crate::spatial::KdTree;

/// Pieces that are looked at, at least so large [the largest piece].
pub(super) const PIECE: f64 = 0.01;

/// How much of the smaller of two footprints the larger one must cover, for one piece to stand over the other.
const COVERED: f64 = 0.6;

/// Of eight directions from the cells of a footprint, the share in which another one lies, for this to go all round it.
const SURROUNDED: f64 = 0.85;

/// Of the cells of a footprint the share in which the support is seen, for nothing to stand there.
const BARE: f64 = 0.5;

/// A piece in the air of at least this size may be of another thing, and must be half as far from one that it holds to [the
/// largest piece].
const LARGE: f64 = 0.3;

/// What pieces stand on.
pub(super) struct Floor {
    normal: Vector3<f64>,
    offset: f64,
    axes: [Vector3<f64>; 2],
    /// Half width of the band in which its points lie, but for the tails of their noise \[length\].
    band: f64,
    /// Points of the scene that are no candidates for the part: among them those on the plane.
    points: Vec<[f64; 3]>,
}

impl Floor {
    pub(super) fn new([x, y, z, offset]: [f64; 4], band: f64, points: Vec<[f64; 3]>) -> Self {
        let normal = Vector3::new(x, y, z);
        Self { normal, offset, axes: tangents(&normal), band, points }
    }

    /// Which of the `points` stand on it, ascending: all but the tails of its own noise, by which what stands apart would hang
    /// together. These lie hardly higher than the band, here and there over the floor, which is counted in cells with this `edge`
    /// \[length\]; a thin plate that lies on it hides it.
    pub(super) fn standing(&self, points: &[[f64; 3]], edge: f64) -> Vec<u32> {
        /// Height up to which tails reach [bands].
        const TAILS: f64 = 2.0;
        /// Points of the floor for each that may be one of a tail, in the same cell.
        const MANY: u32 = 10;
        let is_low = |p: &[f64; 3]| self.height(p) <= TAILS * self.band;
        let mut counts: HashMap<Cell, [u32; 2]> = HashMap::new();
        for p in points.iter().filter(|p| is_low(p)) {
            let [low, _] = counts.entry(self.cell(p, edge)).or_default();
            *low += 1;
        }
        for p in self.points.iter().filter(|p| self.height(p).abs() <= self.band) {
            counts.entry(self.cell(p, edge)).and_modify(|[_, floor]| *floor += 1);
        }
        let is_tail = |p: &[f64; 3]| {
            is_low(p) && counts.get(&self.cell(p, edge)).is_some_and(|[low, floor]| MANY * low <= *floor)
        };
        (0_u32..).zip(points).filter(|(_, p)| !is_tail(p)).map(|(i, _)| i).collect()
    }

    fn height(&self, p: &[f64; 3]) -> f64 {
        self.normal.dot(&Vector3::from(*p)) + self.offset
    }

    /// The cell with edges of this length that a point lies over.
    fn cell(&self, p: &[f64; 3], edge: f64) -> Cell {
        self.axes.map(|along| (along.dot(&Vector3::from(*p)) / edge).floor() as i64)
    }
}

/// A square of the floor.
type Cell = [i64; 2];

/// The largest thing on a floor.
pub(super) struct LargestStack {
    /// Which clusters make it up.
    pub(super) holds: Vec<bool>,
    /// Size of the next largest thing \[share of this one\].
    pub(super) next: f64,
}

/// Finds which of the `clusters` of `points` make up the largest thing on a `floor`: pieces over one another are one thing, and so
/// is a piece that does not reach down to the floor with one that goes all round it, as spokes with their rim, or, if nothing is
/// below it, with the nearest larger one within `reach` of it [its own extent], as a handle with its cup. Footprints are compared
/// in cells with this `edge` \[length\].
pub(super) fn largest_stack(
    points: &[[f64; 3]],
    clusters: &Clusters,
    floor: &Floor,
    edge: f64,
    reach: f64,
) -> LargestStack {
    let Clusters { labels, sizes, .. } = clusters;
    let pieces = sizes.iter().take_while(|&&size| size as f64 >= PIECE * sizes[0] as f64).count();
    let mut lowest = vec![f64::INFINITY; sizes.len()];
    for (p, &label) in points.iter().zip(labels) {
        lowest[label as usize] = lowest[label as usize].min(floor.height(p));
    }
    let hovers: Vec<bool> = lowest.iter().take(pieces).map(|&height| height > edge).collect();
    let cells = points.iter().map(|p| floor.cell(p, edge)).zip(labels.iter().copied());
    let mut footprints: Vec<(Cell, u32)> = cells.filter(|(_, label)| (*label as usize) < pieces).collect();
    footprints.sort_unstable();
    footprints.dedup();
    let mut joined = stacks(&footprints, &hovers);
    let extents = extents(points, labels, pieces);
    for piece in in_the_air(&footprints, &hovers, floor, edge) {
        let is_large = sizes[piece as usize] as f64 >= LARGE * sizes[0] as f64;
        let reach = if is_large { 0.5 * reach } else { reach };
        if joined.least(piece) == piece
            && let Some(larger) = nearest_larger(points, labels, piece, |larger| reach * extents[larger])
        {
            joined.join(piece, larger);
        }
    }
    let mut size_of_stack = vec![0; pieces];
    (0..pieces).for_each(|piece| size_of_stack[joined.least(piece as u32) as usize] += sizes[piece]);
    // Of equal ones the first.
    let largest = (0..pieces).rev().max_by_key(|&stack| size_of_stack[stack]).unwrap_or_default();
    let next = (0..pieces).filter(|&stack| stack != largest).map(|stack| size_of_stack[stack]).max();
    let next = next.unwrap_or_default() as f64 / size_of_stack.get(largest).map_or(1.0, |&size| size as f64);
    let holds = |label: usize| label < pieces && joined.least(label as u32) as usize == largest;
    LargestStack { holds: (0..sizes.len()).map(holds).collect(), next }
}

/// The pieces, without the largest, that hover where the floor below them is seen to be bare.
fn in_the_air(footprints: &[(Cell, u32)], hovers: &[bool], floor: &Floor, edge: f64) -> Vec<u32> {
    if !hovers.contains(&true) {
        return Vec::new();
    }
    let on_floor = floor.points.iter().filter(|p| floor.height(p).abs() < edge);
    let seen: BTreeSet<Cell> = on_floor.map(|p| floor.cell(p, edge)).collect();
    let is_bare = |piece: &u32| {
        let cells = || footprints.iter().filter(|(_, of)| of == piece);
        let bare = cells().filter(|(cell, _)| seen.contains(cell)).count();
        bare as f64 >= BARE * cells().count() as f64
    };
    (1..hovers.len() as u32).filter(|&piece| hovers[piece as usize]).filter(is_bare).collect()
}

/// The longest side of the box about each of the first `pieces` clusters \[length\].
fn extents(points: &[[f64; 3]], labels: &[u32], pieces: usize) -> Vec<f64> {
    let mut corners = vec![([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]); pieces];
    for (p, &label) in points.iter().zip(labels) {
        if let Some((lower, upper)) = corners.get_mut(label as usize) {
            (*lower, *upper) =
                (array::from_fn(|i| lower[i].min(p[i])), array::from_fn(|i| upper[i].max(p[i])));
        }
    }
    corners
        .into_iter()
        .map(|(lower, upper)| (0..3).map(|i| upper[i] - lower[i]).fold(0.0, f64::max))
        .collect()
}

/// Of the pieces larger than `piece`, which have the lower labels, the one nearest to it, within the `reach` of that one.
fn nearest_larger(
    points: &[[f64; 3]],
    labels: &[u32],
    piece: u32,
    reach: impl Fn(usize) -> f64,
) -> Option<u32> {
    let own = points.iter().zip(labels).filter(|(_, label)| **label == piece).map(|(p, _)| *p);
    let tree = KdTree::new(&own.collect::<Vec<_>>()).ok()?;
    let larger = points.iter().zip(labels).filter(|(_, label)| **label < piece);
    let near = larger
        .filter_map(|(p, label)| Some((tree.nearest_within(p, reach(*label as usize))?.distance_sq, *label)));
    Some(near.min_by(|a, b| a.partial_cmp(b).unwrap_or(Ordering::Equal))?.1)
}

/// Which pieces stand over or under each other, or hover amid one another, by the sorted cells of their footprints.
fn stacks(footprints: &[(Cell, u32)], hovers: &[bool]) -> DisjointSets {
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
    fn new(footprints: &[(Cell, u32)], piece: u32) -> Self {
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
    fn through([x, y]: Cell) -> [(i64, i64); 4] {
        [(y, x), (x, y), ((x + y).div_euclid(2), x - y), ((x - y).div_euclid(2), x + y)]
    }

    /// In how many of eight directions from a cell the footprint lies.
    fn directions(&self, cell: Cell) -> usize {
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
    use crate::error::{Error, Result};
    use crate::preprocess::{ClusterParams, main_cluster};

    /// The cells of a row on the support, for one piece.
    fn row(cells: std::ops::Range<i64>, piece: u32) -> impl Iterator<Item = (Cell, u32)> {
        cells.map(move |x| ([x, 0], piece))
    }

    fn stack_of(mut footprints: Vec<(Cell, u32)>, hovers: &[bool]) -> Vec<u32> {
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

    /// A slab of points between two corners.
    fn slab([x0, y0, z0]: [f64; 3], [x1, y1, z1]: [f64; 3]) -> Vec<[f64; 3]> {
        let along = |a: f64, b: f64| (0..=((b - a) / 0.5).round() as usize).map(move |i| a + 0.5 * i as f64);
        along(x0, x1)
            .flat_map(|x| along(y0, y1).map(move |y| [x, y]))
            .flat_map(|[x, y]| along(z0, z1).map(move |z| [x, y, z]))
            .collect()
    }

    #[test]
    fn tails_of_the_floor_do_not_stand_on_it() {
        // 400 points of the floor in each cell of its left half; the right half is hidden by what lies on it.
        let floor = Floor::new([0.0, 0.0, 1.0, 0.0], 0.1, slab([0.25, 0.25, 0.0], [9.75, 19.75, 0.0]));
        let tails = [[2.0, 2.0, 0.15], [2.0, 12.0, 0.19], [6.0, 2.0, 0.15]];
        let higher = [[2.0, 2.0, 0.21], [6.0, 2.0, 5.0]];
        let plate = [[12.0, 2.0, 0.15], [12.0, 4.0, 0.15]];
        let points: Vec<[f64; 3]> = tails.into_iter().chain(higher).chain(plate).collect();
        assert_eq!(floor.standing(&points, 10.0), [3, 4, 5, 6]);
        // More than a tenth of the points of the floor are not its noise alone.
        let standing = |count: usize| floor.standing(&vec![[2.0, 2.0, 0.15]; count], 10.0).len();
        assert_eq!([40, 41].map(standing), [0, 41]);
    }

    #[test]
    fn a_piece_in_the_air_holds_to_a_larger_one_nearby() -> Result<()> {
        // A block, and a plate beside it at a height: how many of the two are of the largest thing.
        let kept = |height: f64, reach: f64, bare: f64| {
            let mut points = slab([0.0; 3], [10.0, 10.0, 5.0]);
            points.extend(slab([14.0, 3.0, height], [18.0, 7.0, height + 1.0]));
            let params = ClusterParams { distance: 1.0, keep_ratio: 1.0 };
            let clusters = main_cluster(&points, &params)?;
            assert_eq!(clusters.sizes.len(), 2);
            let floor =
                Floor::new([0.0, 0.0, 1.0, 0.0], 0.1, slab([13.0, 0.0, 0.0], [13.0 + bare, 10.0, 0.0]));
            let LargestStack { holds, .. } = largest_stack(&points, &clusters, &floor, 1.0, reach);
            Ok::<_, Error>(holds.into_iter().filter(|of| *of).count())
        };
        assert_eq!(kept(3.0, 0.5, 6.0)?, 2);
        // It stands, is too far away, or hides the floor under it.
        assert_eq!(kept(0.0, 0.5, 6.0)?, 1);
        assert_eq!(kept(3.0, 0.3, 6.0)?, 1);
        assert_eq!(kept(3.0, 0.5, 1.0)?, 1);
        Ok(())
    }
}

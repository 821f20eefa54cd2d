//! What stands free before a background that fills the border of the view: a room, or clutter behind the part.

use std::f64::consts::TAU;

use nalgebra::Vector3;
use rayon::prelude::*;

use super::clean::bounds;
use super::resolution::width;
use super::scene::Scene;
use crate::directions::tangents;
use crate::error::Result;
use crate::preprocess::outline::{Flat, Outline};
use crate::preprocess::{CHUNK, ClusterParams, Clusters, main_cluster, sure_cell, voxel_downsample};
use crate::spatial::KdTree;

/// Sectors of the border of a field of view.
const SECTORS: usize = 72;

/// Share of the border up to which a piece stands free of it: what holds the part may reach beyond.
const FREE: f64 = 0.2;

/// Share of the border that the background must make up.
const AROUND: f64 = 0.6;

/// Share of the field of view in which something was measured, from which on a background fills it: between the pieces of a part
/// alone nothing was.
const FILLED: f64 = 0.85;

/// Share of the points that a free piece must have.
const LEAST: f64 = 0.01;

/// How far it must be from the background, as far as that reaches around it [longest side of its box].
const APART: f64 = 0.25;

/// How far beside its box other free pieces are of it [longest side of its box].
const BESIDE: f64 = 0.1;

/// The points of a `scene` that belong to the largest piece that stands free before a background, ascending; `None` where no place
/// of a sensor is known or nothing does. Pieces are `gap` apart [width of the scene].
pub(super) fn foreground(scene: &Scene, gap: f64) -> Result<Option<Vec<u32>>> {
    if !scene.is_oriented() {
        return Ok(None);
    }
    let cell = (0.25 * gap * width(&scene.points)).max(sure_cell(&scene.points)?);
    let coarse = voxel_downsample(&scene.points, cell)?;
    let pieces = main_cluster(&coarse.points, &ClusterParams { distance: 4.0 * cell, keep_ratio: 1.0 })?;
    let piece_of = |i: usize| pieces.labels[coarse.inverse[i] as usize] as usize;
    let mut counts = vec![0_usize; pieces.sizes.len()];
    (0..scene.points.len()).for_each(|i| counts[piece_of(i)] += 1);
    let Border { shares, filled } = Border::new(scene, piece_of, counts.len());
    if filled < FILLED {
        return Ok(None);
    }
    let is_free = |piece: usize| shares[piece] <= FREE;
    let around: f64 = shares.iter().filter(|share| **share > FREE).sum();
    let least = LEAST * scene.points.len() as f64;
    let free = (0..counts.len()).filter(|&piece| is_free(piece) && counts[piece] as f64 >= least);
    // Of equal ones the first.
    let Some(largest) = free.rev().max_by_key(|&piece| counts[piece]).filter(|_| around >= AROUND) else {
        return Ok(None);
    };
    let own = (0..scene.points.len()).filter(|&i| piece_of(i) == largest);
    let (lower, upper) = bounds(own.map(|i| &scene.points[i]));
    let longest = (0..3).map(|i| upper[i] - lower[i]).fold(0.0, f64::max);
    if !is_apart(&coarse.points, &pieces, largest, is_free, APART * longest)? {
        return Ok(None);
    }
    let margin = BESIDE * longest;
    let is_near = |p: &[f64; 3]| (0..3).all(|i| lower[i] - margin <= p[i] && p[i] <= upper[i] + margin);
    let kept = (0..scene.points.len()).into_par_iter().with_min_len(CHUNK);
    let kept = kept.filter(|&i| is_free(piece_of(i)) && is_near(&scene.points[i]));
    Ok(Some(kept.map(|i| i as u32).collect()))
}

/// What the fields of view show.
struct Border {
    /// For each piece the share of the border that it makes up.
    shares: Vec<f64>,
    /// Share of the fields in which something was measured.
    filled: f64,
}

impl Border {
    fn new(scene: &Scene, piece_of: impl Fn(usize) -> usize, pieces: usize) -> Self {
        let mut of_place: Vec<Vec<u32>> = vec![Vec::new(); scene.places.len()];
        (0..scene.points.len()).for_each(|i| of_place[scene.place_of(i)].push(i as u32));
        let mut shares = vec![0.0; pieces];
        let [mut sectors, mut cells, mut filled] = [0.0, 0.0, 0.0];
        for (place, members) in scene.places.iter().zip(&of_place) {
            let ray = |i: u32| Vector3::from(scene.points[i as usize]) - place;
            let middle: Vector3<f64> = members.iter().map(|&i| ray(i)).sum();
            let Some(forward) = middle.try_normalize(0.0) else { continue };
            let axes = tangents(&forward);
            let slopes = |i: u32| {
                let ray = ray(i);
                let depth = ray.dot(&forward);
                (depth > 0.05 * ray.norm()).then(|| axes.map(|axis| axis.dot(&ray) / depth))
            };
            let seen: Vec<(Flat, usize)> =
                members.iter().filter_map(|&i| Some((slopes(i)?, piece_of(i as usize)))).collect();
            for piece in outermost(&seen) {
                shares[piece] += 1.0;
                sectors += 1.0;
            }
            let [of_field, with_points] = filled_cells(&seen);
            cells += of_field;
            filled += with_points;
        }
        shares.iter_mut().for_each(|share| *share /= f64::max(sectors, 1.0));
        Self { shares, filled: filled / f64::max(cells, 1.0) }
    }
}

/// For each sector of a field of view the piece that is farthest from its middle.
fn outermost(seen: &[(Flat, usize)]) -> impl Iterator<Item = usize> {
    let mut border = [(0.0_f64, None); SECTORS];
    for &([x, y], piece) in seen {
        let turn = (y.atan2(x) / TAU).rem_euclid(1.0);
        let sector = (turn * SECTORS as f64) as usize % SECTORS;
        if x.hypot(y) > border[sector].0 {
            border[sector] = (x.hypot(y), Some(piece));
        }
    }
    border.into_iter().filter_map(|(_, piece)| piece)
}

/// Cells of a field of view, and of those how many have a point.
fn filled_cells(seen: &[(Flat, usize)]) -> [f64; 2] {
    /// Cells along either side of the box about it.
    const CELLS: usize = 32;
    let flat: Vec<Flat> = seen.iter().map(|(place, _)| *place).collect();
    let Some(outline) = Outline::new(&flat) else { return [0.0; 2] };
    let (lower, upper) =
        flat.iter().fold(([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]), |(lower, upper), p| {
            ([0, 1].map(|i| lower[i].min(p[i])), [0, 1].map(|i| upper[i].max(p[i])))
        });
    let edges = [0, 1].map(|i| (upper[i] - lower[i]) / CELLS as f64);
    let mut has_point = vec![false; CELLS * CELLS];
    for p in &flat {
        let [column, row] = [0, 1].map(|i| (((p[i] - lower[i]) / edges[i]) as usize).min(CELLS - 1));
        has_point[row * CELLS + column] = true;
    }
    let middle = |cell: usize| {
        let at = [cell % CELLS, cell / CELLS];
        [0, 1].map(|i| lower[i] + (at[i] as f64 + 0.5) * edges[i])
    };
    let within = (0..CELLS * CELLS).filter(|&cell| outline.contains(middle(cell), 0.0));
    within.fold([0.0; 2], |[all, filled], cell| [all + 1.0, filled + f64::from(u8::from(has_point[cell]))])
}

/// Whether a `piece` is at least so far from all that is not free.
fn is_apart(
    points: &[[f64; 3]],
    pieces: &Clusters,
    piece: usize,
    is_free: impl Fn(usize) -> bool,
    distance: f64,
) -> Result<bool> {
    let of = |wanted: &dyn Fn(usize) -> bool| -> Vec<[f64; 3]> {
        let rows = points.iter().zip(&pieces.labels);
        rows.filter(|(_, label)| wanted(**label as usize)).map(|(p, _)| *p).collect()
    };
    let tree = KdTree::new(&of(&|label| label == piece))?;
    let background = of(&|label| !is_free(label));
    Ok(!background.par_iter().any(|p| tree.nearest_within(p, distance).is_some()))
}

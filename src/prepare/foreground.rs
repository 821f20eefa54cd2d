//! What stands free before a background that fills the border of the view: a room, or clutter behind the part.

use nalgebra::Vector3;
use rayon::prelude::*;

use super::resolution::width;
use super::scene::Scene;
use crate::directions::tangents;
use crate::error::Result;
use crate::preprocess::{CHUNK, ClusterParams, Clusters, main_cluster, sure_cell, voxel_downsample};
use crate::spatial::KdTree;

/// Sectors of the border of a field of view.
const SECTORS: usize = 72;

/// Share of the border up to which a piece stands free of it: what holds the part may reach beyond.
const FREE: f64 = 0.2;

/// Share of the border that the background must make up.
const AROUND: f64 = 0.6;

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
    let shares = shares_of_border(scene, piece_of, counts.len());
    let is_free = |piece: usize| shares[piece] <= FREE;
    let around: f64 = shares.iter().filter(|share| **share > FREE).sum();
    let least = LEAST * scene.points.len() as f64;
    let free = (0..counts.len()).filter(|&piece| is_free(piece) && counts[piece] as f64 >= least);
    // Of equal ones the first.
    let Some(largest) = free.rev().max_by_key(|&piece| counts[piece]).filter(|_| around >= AROUND) else {
        return Ok(None);
    };
    let own = || (0..scene.points.len()).filter(|&i| piece_of(i) == largest).map(|i| scene.points[i]);
    let corners = own().fold(([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]), |(lower, upper), p| {
        (std::array::from_fn(|i| lower[i].min(p[i])), std::array::from_fn(|i| upper[i].max(p[i])))
    });
    let longest = (0..3).map(|i| corners.1[i] - corners.0[i]).fold(0.0, f64::max);
    if !is_apart(&coarse.points, &pieces, largest, is_free, APART * longest)? {
        return Ok(None);
    }
    let margin = BESIDE * longest;
    let is_near =
        |p: &[f64; 3]| (0..3).all(|i| corners.0[i] - margin <= p[i] && p[i] <= corners.1[i] + margin);
    let kept = (0..scene.points.len()).into_par_iter().with_min_len(CHUNK);
    let kept = kept.filter(|&i| is_free(piece_of(i)) && is_near(&scene.points[i]));
    Ok(Some(kept.map(|i| i as u32).collect()))
}

/// For each of the pieces the share of the border of the fields of view that it makes up.
fn shares_of_border(scene: &Scene, piece_of: impl Fn(usize) -> usize, pieces: usize) -> Vec<f64> {
    let mut of_place: Vec<Vec<u32>> = vec![Vec::new(); scene.places.len()];
    (0..scene.points.len()).for_each(|i| of_place[scene.place_of(i)].push(i as u32));
    let mut shares = vec![0.0; pieces];
    let mut all = 0.0;
    for (place, members) in scene.places.iter().zip(&of_place) {
        let ray = |&i: &u32| Vector3::from(scene.points[i as usize]) - place;
        let Some(forward) = members.iter().map(ray).sum::<Vector3<f64>>().try_normalize(0.0) else {
            continue;
        };
        let axes = tangents(&forward);
        // The farthest from the middle in each sector, and the piece that it is of.
        let mut border = [(0.0_f64, None); SECTORS];
        for i in members {
            let ray = ray(i);
            let depth = ray.dot(&forward);
            if depth <= 0.0 {
                continue;
            }
            let [x, y] = axes.map(|axis| axis.dot(&ray) / depth);
            let sector = (y.atan2(x).rem_euclid(std::f64::consts::TAU) / std::f64::consts::TAU
                * SECTORS as f64) as usize
                % SECTORS;
            if x.hypot(y) > border[sector].0 {
                border[sector] = (x.hypot(y), Some(piece_of(*i as usize)));
            }
        }
        for piece in border.iter().filter_map(|(_, piece)| *piece) {
            shares[piece] += 1.0;
            all += 1.0;
        }
    }
    shares.into_iter().map(|share| share / f64::max(all, 1.0)).collect()
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

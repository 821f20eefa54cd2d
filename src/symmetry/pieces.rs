//! Pieces of the surface that nothing joins: whether they may be several parts. Two like parts beside each other have an axis of
//! order two between them, and another one through both.

use nalgebra::Vector3;
use rayon::prelude::*;

use crate::error::Result;
use crate::preprocess::{ClusterParams, main_cluster};
use crate::symmetry::axis::Axis;
use crate::symmetry::order::{Order, Turns};
use crate::symmetry::surface::{Gate, Surface};

/// Whether one of the pieces is so large, and so far from all the rest, that it is likely another part.
///
/// # Errors
/// Those of [`main_cluster`].
pub(crate) fn has_piece_apart(surface: &Surface, diameter: f64) -> Result<bool> {
    /// Edge of the grid that joins points, and distance from all the rest [diameters of all]. Pieces of one part, its middle hidden,
    /// are up to 0.15 apart.
    const JOINED: f64 = 0.05;
    const APART: f64 = 0.2;
    /// Share of the points.
    const LARGE: f64 = 0.2;
    /// Points that are looked at.
    const LOOKED_AT: usize = 2000;
    let samples = surface.samples.strided(LOOKED_AT).points;
    let points: Vec<[f64; 3]> = samples.iter().map(|&p| p.into()).collect();
    let pieces = main_cluster(&points, &ClusterParams { distance: JOINED * diameter, keep_ratio: 1.0 })?;
    let is_apart = |piece: u32| {
        let (own, others): (Vec<_>, Vec<_>) =
            samples.iter().zip(&pieces.labels).partition(|(_, label)| **label == piece);
        let is_near =
            |p: &Vector3<f64>, q: &Vector3<f64>| (p - q).norm_squared() < (APART * diameter).powi(2);
        !own.iter().any(|(p, _)| others.iter().any(|(q, _)| is_near(p, q)))
    };
    let large = (1..).zip(pieces.sizes.iter().skip(1));
    let mut large = large.filter(|(_, size)| **size as f64 > LARGE * points.len() as f64);
    Ok(large.any(|(piece, _)| is_apart(piece)))
}

/// Whether every turn takes what it takes to a measured place to another piece of the surface.
///
/// A part of which a camera saw several pieces, its middle hidden or black, does the same only if no piece goes about the axis or
/// lies across it.
///
/// # Errors
/// Those of [`main_cluster`].
pub(crate) fn exchanges_pieces(surface: &Surface, axis: &Axis, order: Order, gate: Gate) -> Result<bool> {
    /// Edge of the grid that joins points [point spacings].
    const JOINED: f64 = 2.0;
    /// Points that are turned, turns at most.
    const TURNED: usize = 1000;
    const TURNS: usize = 12;
    /// Share of the matches that may stay within one piece by chance.
    const WITHIN: f64 = 0.02;
    let Order::Cyclic(_) = order else { return Ok(false) };
    let points: Vec<[f64; 3]> = surface.samples.points.iter().map(|&p| p.into()).collect();
    let params = ClusterParams { distance: JOINED * surface.spacing, keep_ratio: 1.0 };
    let piece_of = main_cluster(&points, &params)?.labels;
    let turns: Vec<_> = Turns::half(order, TURNS).iter().map(|(angle, _)| axis.turn(angle)).collect();
    let step = points.len().div_ceil(TURNED);
    let [matches, within] = (0..points.len())
        .into_par_iter()
        .step_by(step)
        .map(|i| {
            let (point, normal) = (&surface.samples.points[i], &surface.samples.normals[i]);
            let met = turns
                .iter()
                .filter_map(|turn| surface.matching(&turn.apply(point), &(turn.rotation * normal), gate));
            met.fold([0_usize; 2], |[matches, within], j| {
                [matches + 1, within + usize::from(piece_of[j as usize] == piece_of[i])]
            })
        })
        .reduce(|| [0; 2], |a, b| [a[0] + b[0], a[1] + b[1]]);
    Ok(matches > 0 && (within as f64) < WITHIN * matches as f64)
}

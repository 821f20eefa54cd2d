//! Whether a part of a group holds more closely than the whole of it.
//!
//! A plate of 60 by 61 mm has order four to within a millimetre, and order two to within the noise. Matches allow for the first;
//! how far they are apart tells the two from each other.

use nalgebra::Vector3;
use rayon::prelude::*;

use crate::config::Residual;
use crate::symmetry::axis::{Axis, Turn};
use crate::symmetry::order::gcd;
use crate::symmetry::surface::{Gate, Surface};

/// A part of a group that holds more closely than the rest of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct CloserPart {
    /// Order of the part.
    pub order: u32,
    /// Distance between the surface and its copy that 19 of 20 points stay below under the turns of the part \[length\].
    pub within: f64,
    /// The same under all other turns of the group.
    pub others_within: f64,
}

/// The largest part of the group of order `n` that holds clearly more closely than the turns that are not of it; `None` where all
/// turns hold alike.
///
/// Distances are taken across the surface ([`Residual::PointToPlane`]): along it, points of a scan are never the same. Only
/// points that meet others under both kinds of turns count: what one view shows well may have its like in sight only
/// under some of them.
pub(crate) fn closer_part(surface: &Surface, axis: &Axis, n: u32, gate: Gate) -> Option<CloserPart> {
    /// Distances that are looked at, about, and points at least \[count\].
    const DISTANCES: usize = 24_000;
    const LEAST_POINTS: usize = 800;
    /// Fewer points that count say nothing.
    const FEW: usize = 200;
    /// How much farther apart points must be. In 453 scans of 28 parts misplaced views and noise bring about 1.21; a plate with
    /// sides of 60 and 60.5 mm and the noise of a good depth camera has 1.6.
    const CLEARLY: f64 = 1.3;
    let parts: Vec<u32> = (2..n).rev().filter(|&part| n.is_multiple_of(part)).collect();
    if parts.is_empty() {
        return None;
    }
    let turns: Vec<(u32, Turn)> =
        (1..=n / 2).map(|k| (k, axis.turn(std::f64::consts::TAU * f64::from(k) / f64::from(n)))).collect();
    let samples = surface.samples.strided((DISTANCES / turns.len()).max(LEAST_POINTS));
    let distances: Vec<Vec<(u32, f64)>> = (samples.points.par_iter().zip(&samples.normals))
        .map(|(point, normal)| {
            let met = |(k, turn): &(u32, Turn)| {
                let distance = distance(surface, &turn.apply(point), &(turn.rotation * normal), gate)?;
                Some((*k, distance))
            };
            turns.iter().filter_map(met).collect()
        })
        .collect();
    parts.into_iter().find_map(|part| {
        let is_of_part = |k: u32| gcd(k, n).is_multiple_of(n / part);
        let (mut own, mut others): (Vec<f64>, Vec<f64>) = (distances.iter())
            .filter_map(|met| {
                let mean = |of_part: bool| {
                    let chosen = met.iter().filter(|(k, _)| is_of_part(*k) == of_part);
                    let (count, sum) =
                        chosen.fold((0, 0.0), |(count, sum), (_, distance)| (count + 1, sum + distance));
                    (count > 0).then(|| sum / f64::from(count))
                };
                mean(true).zip(mean(false))
            })
            .unzip();
        if own.len() < FEW {
            return None;
        }
        let [within, others_within] = [&mut own, &mut others].map(|of_points| nineteen_of_twenty(of_points));
        (others_within > CLEARLY * within).then_some(CloserPart { order: part, within, others_within })
    })
}

/// Distance across the surface between a turned point and the measured one that it meets \[length\].
fn distance(surface: &Surface, point: &Vector3<f64>, normal: &Vector3<f64>, gate: Gate) -> Option<f64> {
    let met = surface.matching(point, normal, gate)? as usize;
    let across = Residual::PointToPlane.rows(normal, &surface.samples.normals[met]);
    Some(across.residual(&(point - surface.samples.points[met])).abs())
}

/// What 95 % of the values stay below; reorders them. There must be one.
fn nineteen_of_twenty(values: &mut [f64]) -> f64 {
    let rank = values.len() * 19 / 20;
    *values.select_nth_unstable_by(rank, f64::total_cmp).1
}

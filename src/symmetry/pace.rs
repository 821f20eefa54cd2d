//! How fast matching goes: the share of an error of the axis that one round of it makes good.

use nalgebra::{Matrix4, Vector4};
use rayon::prelude::*;

use crate::config::Residual;
use crate::error::Result;
use crate::symmetry::axis::Axis;
use crate::symmetry::order::Turns;
use crate::symmetry::refine::{Aligner, RefineParams};
use crate::symmetry::surface::Surface;

/// Points of the surface that are rotated; it is their mean that counts.
const SAMPLES: usize = 1_000;

/// How far the axis is put off, at the rim of the surface \[point spacings\]: about as far as it may be off.
const PROBE: f64 = 0.1;

/// What one round of matching makes good of small errors of `axis`, by tilt about both tangents \[rad\] and shift along
/// both \[length\]: from an axis that is off by `e` it takes the step `-pace * e`.
///
/// The matches of a rotated point change with the axis, and noise lets it always find some neighbour nearby, so that only
/// a share of an error shows in the residuals, along the blade of a propeller less than across it.
///
/// # Errors
/// Those of [`minimize`](crate::symmetry::solver::minimize), which takes the step of each round.
pub(crate) fn matching_pace(
    surface: &Surface,
    axis: &Axis,
    turns: &Turns,
    residual: Residual,
    params: &RefineParams,
) -> Result<Matrix4<f64>> {
    let samples = &surface.samples.strided(SAMPLES);
    let aligner = Aligner { surface, samples, turns, residual, params };
    let gate = aligner.last_gate();
    let off = PROBE * surface.spacing;
    let probe = Vector4::new(off / surface.radius, off / surface.radius, off, off);
    // The few points of a round are too few to share among threads, the rounds are not.
    let ends = (0..8).into_par_iter().map(|k| {
        let (i, sign) = (k / 2, if k % 2 == 0 { 1.0 } else { -1.0 });
        let start = axis.retract(&Vector4::ith(i, sign * probe[i]));
        let end = aligner.round(&start, gate)?;
        Ok(axis.step_to(&end.axis))
    });
    let ends: Vec<Vector4<f64>> = ends.collect::<Result<_>>()?;
    let mut pace = Matrix4::zeros();
    for (i, ends) in ends.chunks_exact(2).enumerate() {
        let left = (ends[0] - ends[1]) / (2.0 * probe[i]);
        pace.set_column(i, &(Vector4::ith(i, 1.0) - left));
    }
    Ok(pace)
}

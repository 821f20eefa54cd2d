//! What the uncertainty of an axis is made of: the curvature of the cost, and the scatter of its gradient over the surface.

use nalgebra::{Matrix4, Vector4};
use rayon::prelude::*;

use crate::median::median;
use crate::symmetry::alignment::{SelfAlignment, Unknowns};
use crate::symmetry::axis::Axis;

/// What the uncertainty of the axis is made of, by tilt about its two tangents and shift along them.
#[derive(Debug, Clone, Copy, Default)]
pub struct Sandwich {
    /// J'WJ.
    pub hessian: Matrix4<f64>,
    /// Sum over patches of the outer product of J'Wr.
    pub scatter: Matrix4<f64>,
    /// What J'WJ would be if the surface left the axis free and only the noise of the normals held it, as on a ball.
    pub noise: Matrix4<f64>,
}

impl Sandwich {
    /// The same for the axis in the opposite direction, whose first tangent is opposite, too.
    #[must_use]
    pub fn reversed(&self) -> Self {
        let turned = Matrix4::from_diagonal(&[-1.0, 1.0, -1.0, 1.0].into());
        let Self { hessian, scatter, noise } = self;
        let [hessian, scatter, noise] = [hessian, scatter, noise].map(|matrix| turned * matrix * turned);
        Self { hessian, scatter, noise }
    }
}

/// Patches of the surface. They must be wider than the neighbourhoods that share their noise, which large noise makes wide.
pub(crate) const PATCHES: usize = 64;

/// What one patch of the surface adds to a [`Sandwich`].
#[derive(Default)]
struct Patch {
    hessian: Matrix4<f64>,
    /// What J'WJ gains for each unit of variance of the normals, in each of the two directions across them.
    aside: Matrix4<f64>,
    /// Weighted sum of the variances of the normals, and of the weights.
    turned: f64,
    weight: f64,
    /// J'Wr of this patch, and of those that its matches lie in.
    gradients: Vec<Vector4<f64>>,
}

impl SelfAlignment<'_> {
    /// J'WJ of the axis with the points held fixed, and the scatter of J'Wr over patches of the surface: the meat of the
    /// sandwich, which holds whatever correlates neighbouring residuals (White 1980; Liang and Zeger 1986).
    ///
    /// A residual carries the noise of two points, so that its gradient is added to the patch of either, in full each time:
    /// residuals that have a point in common share a patch, whichever end of them it is.
    #[must_use]
    pub(crate) fn sandwich(&self, axis: &Axis) -> Sandwich {
        let count = self.samples.points.len();
        let size = count.div_ceil(PATCHES).max(1);
        // The samples are spread evenly over the surface, so that a patch is the same share of both.
        let patch_of_match = |j: usize| j * count / self.surface.len() / size;
        let unknowns = Unknowns { axis: *axis, offsets: Vec::new() };
        let leverages = self.leverages(axis);
        let parts: Vec<Patch> = (0..count.div_ceil(size))
            .into_par_iter()
            .map(|patch| {
                let mut sums = Patch { gradients: vec![Vector4::zeros(); PATCHES], ..Patch::default() };
                for i in patch * size..((patch + 1) * size).min(count) {
                    self.visit(&unknowns, &leverages, i, |term, j| {
                        let jacobian = term.jacobian();
                        let curvature = jacobian * (jacobian * term.weight).transpose();
                        let motion = term.motion();
                        sums.hessian += curvature;
                        sums.aside += motion.tr_mul(&motion) * term.weight - curvature;
                        // The direction halves the angle between the normals, and has half the variance of each.
                        let cosine = term.direction.dot(&self.surface.samples.normals[j]);
                        sums.turned += 0.5 * (1.0 - cosine * cosine) * term.weight;
                        sums.weight += term.weight;
                        let gradient = jacobian * (term.weight * term.residual);
                        sums.gradients[patch] += gradient;
                        sums.gradients[patch_of_match(j)] += gradient;
                    });
                }
                sums
            })
            .collect();
        let mut gradients = vec![Vector4::zeros(); PATCHES];
        for patch in &parts {
            gradients.iter_mut().zip(&patch.gradients).for_each(|(sum, row)| *sum += row);
        }
        // Creases are in few of the patches.
        let noisy = parts.iter().filter(|patch| patch.weight > 0.0);
        let variance = median(&mut noisy.map(|patch| patch.turned / patch.weight).collect::<Vec<f64>>());
        Sandwich {
            hessian: parts.iter().map(|patch| patch.hessian).sum(),
            scatter: gradients.iter().map(|g| g * g.transpose()).sum(),
            noise: parts.iter().map(|patch| patch.aside).sum::<Matrix4<f64>>() * variance.unwrap_or(0.0),
        }
    }
}

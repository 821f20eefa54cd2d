//! The axis that each view alone would have: where views show different sides of a part, only these tell how well they fit each
//! other.

use nalgebra::{Matrix4, Vector4};

use crate::symmetry::alignment::{SelfAlignment, Unknowns};
use crate::symmetry::axis::Axis;
use crate::symmetry::sandwich::PATCHES;
use crate::symmetry::view_errors::{Drawn, ViewErrors, ViewEvidence, draw, uncertain};

/// What the matches within a view say of the axis.
#[derive(Clone)]
struct Alone {
    /// J'WJ.
    hessian: Matrix4<f64>,
    /// J'Wr.
    gradient: Vector4<f64>,
    /// J'WJ and J'Wr of each patch of the surface, and of those that its matches lie in.
    of_patches: Vec<(Matrix4<f64>, Vector4<f64>)>,
}

/// What differences between the axes that the views alone would have mean for the `axis` that they have together: its
/// covariance by tilt about both tangents \[rad\] and shift along both \[length\], about the point of the axis.
///
/// Two views along the axis from opposite sides have hardly a match in common, but each has an axis.
#[must_use]
pub(super) fn covariance_of_view_axes(
    problem: &SelfAlignment,
    axis: &Axis,
    errors: &ViewErrors,
) -> Matrix4<f64> {
    let SelfAlignment { surface, samples, .. } = problem;
    let count = samples.points.len();
    let unknowns = Unknowns { axis: *axis, offsets: Vec::new() };
    let leverages = problem.leverages(axis);
    let main_view = |point: usize| errors.shares(point).iter().position(|&share| share > 0.5);
    let of_patches = vec![(Matrix4::zeros(), Vector4::zeros()); PATCHES];
    let nothing = Alone { hessian: Matrix4::zeros(), gradient: Vector4::zeros(), of_patches };
    let patch = |point: usize, points: usize| point * PATCHES / points;
    let mut alone = vec![nothing; errors.views];
    for i in 0..count {
        let Some(view) = main_view(i * surface.len() / count) else { continue };
        problem.visit(&unknowns, &leverages, i, |term, j| {
            if main_view(j) == Some(view) {
                let jacobian = term.jacobian();
                let curvature = jacobian * (jacobian * term.weight).transpose();
                let gradient = jacobian * (term.weight * term.residual);
                let alone = &mut alone[view];
                alone.hessian += curvature;
                alone.gradient += gradient;
                for patch in [patch(i, count), patch(j, surface.len())] {
                    alone.of_patches[patch].0 += curvature;
                    alone.of_patches[patch].1 += gradient;
                }
            }
        });
    }
    // Tilt as the shift that it is at the radius.
    let turn = surface.radius.recip();
    let scale = Matrix4::from_diagonal(&Vector4::new(turn, turn, 1.0, 1.0));
    let evidence: Vec<Option<ViewEvidence<4>>> = alone.iter().map(|view| view.evidence(&scale)).collect();
    let Some(Drawn { variances, known, .. }) = draw(&evidence, surface.radius) else {
        return Matrix4::zeros();
    };
    // The axis of all lies amid those of the views.
    let beside_all = known as f64 / (known - 1) as f64;
    let few = uncertain(2 * (known - 1));
    let [tilt, shift] = variances.map(|variance| variance * beside_all * few);
    let spread = Matrix4::from_diagonal(&Vector4::new(tilt, tilt, shift, shift));
    let together: Matrix4<f64> = alone.iter().map(|view| scale * view.hessian * scale).sum();
    let Some(inverse) = together.try_inverse() else { return Matrix4::zeros() };
    let of_view = |view: &Alone| {
        let part = inverse * (scale * view.hessian * scale);
        part * spread * part.transpose()
    };
    scale * alone.iter().map(of_view).sum::<Matrix4<f64>>() * scale
}

impl Alone {
    /// How far the axis of the view lies from that of all, with what noise allows it to; `None` where it has none of its own.
    fn evidence(&self, scale: &Matrix4<f64>) -> Option<ViewEvidence<4>> {
        /// Patches from which four numbers and their noise can be known.
        const ENOUGH: usize = 8;
        if self.of_patches.iter().filter(|(_, gradient)| *gradient != Vector4::zeros()).count() < ENOUGH {
            return None;
        }
        let step = self.hessian.cholesky()?.solve(&self.gradient);
        // Noise is what is left about the axis of the view.
        let left = self.of_patches.iter().map(|(hessian, gradient)| scale * (gradient - hessian * step));
        let scatter: Matrix4<f64> = left.map(|gradient| gradient * gradient.transpose()).sum();
        let noise = scatter.cholesky()?.inverse();
        let (hessian, gradient) = (scale * self.hessian * scale, scale * self.gradient);
        Some(ViewEvidence { information: hessian * noise * hessian, weighted: -hessian * noise * gradient })
    }
}

//! The axis that each view alone would have: where views show different sides of a part, only these tell how well they fit each
//! other.

use nalgebra::{Matrix4, Vector4};

use crate::symmetry::alignment::{SelfAlignment, Unknowns};
use crate::symmetry::axis::Axis;
use crate::symmetry::covariance::inflation;
use crate::symmetry::view_errors::{Evidence, ViewErrors, draw, uncertain};

/// What the matches within a view say of the axis.
#[derive(Clone)]
struct Alone {
    /// J'WJ.
    hessian: Matrix4<f64>,
    /// J'Wr of each patch of the surface.
    gradients: Vec<Vector4<f64>>,
}

/// What differences between the axes that the views alone would have mean for the `axis` that they have together: its
/// covariance by tilt about both tangents \[rad\] and shift along both \[length\], about the point of the axis.
///
/// A symmetry brings the front of a part to its front: two views from opposite sides have hardly any match in common, but both
/// have an axis.
#[must_use]
pub(super) fn covariance_of_view_axes(
    problem: &SelfAlignment,
    axis: &Axis,
    errors: &ViewErrors,
) -> Matrix4<f64> {
    const PATCHES: usize = 64;
    let SelfAlignment { surface, samples, .. } = problem;
    let count = samples.points.len();
    let unknowns = Unknowns { axis: *axis, offsets: Vec::new() };
    let leverages = problem.leverages(axis);
    let main_view = |point: usize| errors.shares(point).iter().position(|&share| share > 0.5);
    let nothing = Alone { hessian: Matrix4::zeros(), gradients: vec![Vector4::zeros(); PATCHES] };
    let mut alone = vec![nothing; errors.views];
    for i in 0..count {
        let Some(view) = main_view(i * surface.len() / count) else { continue };
        problem.visit(&unknowns, &leverages, i, |term, j| {
            if main_view(j) == Some(view) {
                let jacobian = term.jacobian();
                alone[view].hessian += jacobian * (jacobian * term.weight).transpose();
                alone[view].gradients[i * PATCHES / count] += jacobian * (term.weight * term.residual);
            }
        });
    }
    // Tilt as the shift that it is at the radius.
    let turn = surface.radius.recip();
    let scale = Matrix4::from_diagonal(&Vector4::new(turn, turn, 1.0, 1.0));
    let evidence: Vec<Option<Evidence<4>>> = alone.iter().map(|view| view.evidence(&scale)).collect();
    let Some((variances, _)) = draw(&evidence, surface.radius) else { return Matrix4::zeros() };
    // The axis of all lies amid those of the views.
    let beside_all = errors.views as f64 / (errors.views - 1) as f64;
    let few = uncertain(2 * (errors.views - 1));
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
    fn evidence(&self, scale: &Matrix4<f64>) -> Option<Evidence<4>> {
        let hessian = scale * self.hessian * scale;
        let scatter: Matrix4<f64> = self.gradients.iter().map(|g| g * g.transpose()).sum();
        let noise = (inflation(None) * scale * scatter * scale).try_inverse()?;
        let gradient = scale * self.gradients.iter().sum::<Vector4<f64>>();
        Some(Evidence { information: hessian * noise * hessian, weighted: -hessian * noise * gradient })
    }
}

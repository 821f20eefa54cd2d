//! Where the axis may be: many starting directions, each aligned on a few points, scored, and the best ones kept.

use nalgebra::{Matrix3, SymmetricEigen, Vector3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::config::Residual;
use crate::directions::spiral;
use crate::error::Result;
use crate::preprocess::outline::enclosing_middle;
use crate::symmetry::axis::Axis;
use crate::symmetry::order::Turns;
use crate::symmetry::refine::{Aligner, RefineParams, Refined};
use crate::symmetry::score::{MatchScore, match_score};
use crate::symmetry::search::SearchContext;
use crate::symmetry::surface::{Gate, Samples, Surface};

/// How axes are proposed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ProposeParams {
    /// Search all directions; otherwise only the paper's start is used: plane normal and centroid.
    pub search: bool,
    /// Starting directions, spread over the half sphere \[count\].
    pub directions: usize,
    /// Points on which the axes of each round are aligned and scored \[count\]; twice as many where there is one turn. At
    /// most 120, 250 and 600 for each of the orders that are tried where none is given.
    pub samples: [usize; 3],
    /// Distinct axes that survive each round \[count\]; at most 12, 5 and 3 for each of these orders.
    pub kept: [usize; 3],
    /// Rotations used, at most \[count\].
    pub max_turns: usize,
    /// First gate on the distance of a match; each round ends at half of it, the last at the spacing \[diameters\].
    pub gate: f64,
    /// Axes closer than this are the same, if they are also close in position; halves with each round \[rad\].
    pub distinct_angle: f64,
    /// Axes closer than this are the same, if they are also close in direction; halves with each round \[diameters\].
    pub distinct_offset: f64,
    /// Largest angle from the hint of the user \[rad\].
    pub max_hint_angle: f64,
}

impl Default for ProposeParams {
    fn default() -> Self {
        Self {
            search: true,
            directions: 60,
            samples: [200, 400, 1000],
            kept: [24, 10, 8],
            max_turns: 5,
            gate: 0.06,
            distinct_angle: 0.1,
            distinct_offset: 0.05,
            max_hint_angle: 30f64.to_radians(),
        }
    }
}

/// A proposed axis with what speaks for it.
#[derive(Debug, Clone)]
pub struct Proposal {
    /// The axis, held near the centroid.
    pub axis: Axis,
    /// How well the rotated surface meets itself.
    pub score: MatchScore,
}

/// The paper's initial axis: normal of the total least-squares plane, through the centroid.
#[must_use]
pub fn plane_fit(surface: &Surface) -> Option<Axis> {
    principal_axes(surface)?.into_iter().next()
}

/// The three principal axes through the centroid, flattest first.
fn principal_axes(surface: &Surface) -> Option<Vec<Axis>> {
    let centroid = surface.centroid;
    let covariance: Matrix3<f64> = surface.samples.points.iter().fold(Matrix3::zeros(), |sum, p| {
        let d = p - centroid;
        sum + d * d.transpose()
    });
    let eigen = SymmetricEigen::try_new(covariance, f64::EPSILON, 100)?;
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
    order.iter().map(|&i| Axis::new(eigen.eigenvectors.column(i).into(), centroid)).collect()
}

/// A point on the line along `axis` about which the smallest cylinder holds all `points`.
pub(crate) fn outline_center(points: &[Vector3<f64>], axis: &Axis) -> Vector3<f64> {
    let [u, v] = axis.tangents();
    let flat: Vec<[f64; 2]> =
        points.iter().map(|p| p - axis.point).map(|arm| [u.dot(&arm), v.dot(&arm)]).collect();
    let [x, y] = enclosing_middle(&flat, [0.0; 2]);
    axis.point + u * x + v * y
}

/// `count` unit vectors spread evenly over the half sphere.
fn half_sphere(count: usize) -> impl Iterator<Item = Vector3<f64>> {
    spiral((0..count).map(move |i| (i as f64 + 0.5) / count as f64))
}

/// Whether an axis passes through the part and near the hint.
pub(crate) fn is_admitted(
    axis: &Axis,
    centroid: &Vector3<f64>,
    diameter: f64,
    within: Option<Vector3<f64>>,
    params: &ProposeParams,
) -> bool {
    let hint = within.and_then(|hint| Axis::new(hint, *centroid));
    let near_hint = hint.is_none_or(|hint| axis.angle_to(&hint) <= params.max_hint_angle);
    near_hint && axis.distance(centroid) < 0.5 * diameter
}

/// Axes of `surface` under the rotations `turns`, best first.
///
/// # Errors
/// [`Error::Cancelled`](crate::Error::Cancelled), [`Error::DeadlineExceeded`](crate::Error::DeadlineExceeded);
/// [`Error::InvalidParameter`](crate::Error::InvalidParameter) where the spacing of the surface is not positive and finite.
pub fn propose(surface: &Surface, turns: &Turns, context: &SearchContext<'_>) -> Result<Vec<Proposal>> {
    let &SearchContext { diameter, hints, within, propose: params, .. } = context;
    let centroid = surface.centroid;
    let admitted = |axis: &Axis| is_admitted(axis, &centroid, diameter, within, params);
    let mut starts: Vec<Axis> = if params.search {
        principal_axes(surface).unwrap_or_default()
    } else {
        plane_fit(surface).into_iter().collect()
    };
    if params.search {
        starts.extend(hints.iter().chain(&within).filter_map(|hint| Axis::new(*hint, centroid)));
        starts.extend(half_sphere(params.directions).filter_map(|d| Axis::new(d, centroid)));
    }
    if params.search {
        // Seen from one side, the centroid lies off the axis, but the outline does not.
        let outline: Vec<Vector3<f64>> = surface.samples.strided(params.samples[0]).points;
        let centers = starts.iter().map(|axis| Axis { point: outline_center(&outline, axis), ..*axis });
        starts = starts.iter().copied().chain(centers).collect();
    }
    starts.retain(admitted);

    let finest = 3.0 * surface.spacing;
    let gate = |halvings: i32| (params.gate * diameter * 0.5f64.powi(halvings)).max(finest);
    // A single turn leaves a point one match to be judged by: twice the points make up for it.
    let more = if turns.len() == 1 { 2 } else { 1 };
    let mut proposals = Vec::new();
    for (round, (&samples, &kept)) in params.samples.iter().zip(&params.kept).enumerate() {
        let last = round + 1 == params.samples.len();
        let gates = [gate(round as i32), if last { finest } else { gate(round as i32 + 1) }];
        let samples = surface.samples.strided(samples.saturating_mul(more));
        let tried = trial(surface, &samples, turns, gates, &starts, context)?;
        let scale = 0.5f64.powi(round as i32);
        let offset = params.distinct_offset * scale * diameter;
        proposals = distinct(tried, kept, params.distinct_angle * scale, offset, &admitted);
        starts = proposals.iter().map(|p| p.axis).collect();
    }
    Ok(proposals)
}

/// Aligns and scores each start on `samples`; whatever residual follows, in a few rounds only planes bring it near.
fn trial(
    surface: &Surface,
    samples: &Samples,
    turns: &Turns,
    gates: [f64; 2],
    starts: &[Axis],
    context: &SearchContext<'_>,
) -> Result<Vec<Proposal>> {
    let &SearchContext { visibility, control, .. } = context;
    let refine = RefineParams { max_rounds: 4, max_normal_angle: 0.8, ..RefineParams::default() };
    let aligner = Aligner { surface, samples, turns, residual: Residual::PointToPlane, params: &refine };
    let gate = Gate::new(gates[1], refine.max_normal_angle.cos());
    starts
        .par_iter()
        .map(|start| {
            let Refined { axis, .. } = aligner.align(*start, gates, control)?;
            Ok(Proposal { axis, score: match_score(surface, samples, &axis, turns, gate, visibility.into()) })
        })
        .collect()
}

/// The best `count` proposals that differ from every better one.
fn distinct(
    mut proposals: Vec<Proposal>,
    count: usize,
    angle: f64,
    offset: f64,
    admitted: &impl Fn(&Axis) -> bool,
) -> Vec<Proposal> {
    proposals.retain(|p| admitted(&p.axis) && p.score.value().is_finite());
    proposals.sort_by(|a, b| b.score.value().total_cmp(&a.score.value()));
    let mut kept: Vec<Proposal> = Vec::new();
    for proposal in proposals {
        if kept.len() == count {
            break;
        }
        let differs = |k: &Proposal| {
            k.axis.angle_to(&proposal.axis) > angle || k.axis.distance(&proposal.axis.point) > offset
        };
        if kept.iter().all(differs) {
            kept.push(proposal);
        }
    }
    kept
}

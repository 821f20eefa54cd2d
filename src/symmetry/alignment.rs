//! The self-alignment problem: rotated points against the measured surface, for fixed correspondences.

use nalgebra::{Const, DimMin, Matrix3, Matrix3x4, SMatrix, SVector, Vector3, Vector4};
use rayon::prelude::*;

use crate::config::Residual;
use crate::error::Result;
use crate::symmetry::axis::{Axis, Turn};
use crate::symmetry::order::Turns;
use crate::symmetry::robust::Huber;
use crate::symmetry::solver::{NormalEquations, RobustProblem};
use crate::symmetry::surface::{Gate, Samples, Surface};

/// Points in a unit of parallel work; fixed, so that sums do not depend on the number of threads.
const CHUNK: usize = 512;

/// No correspondence.
const NONE: u32 = u32::MAX;

/// For each point and each rotation the measured point that it meets.
#[derive(Debug, Clone)]
pub(crate) struct Correspondences {
    turns: usize,
    matched: Vec<u32>,
}

impl Correspondences {
    /// Rotates every point by every turn and looks up its match; O(points x turns) queries, in parallel.
    #[must_use]
    pub(crate) fn find(surface: &Surface, samples: &Samples, axis: &Axis, turns: &Turns, gate: Gate) -> Self {
        let moves: Vec<Turn> = turns.angles().map(|angle| axis.turn(angle)).collect();
        let mut matched = vec![NONE; samples.points.len() * moves.len()];
        if !moves.is_empty() {
            matched.par_chunks_mut(CHUNK * moves.len()).enumerate().for_each(|(chunk, rows)| {
                for (offset, row) in rows.chunks_exact_mut(moves.len()).enumerate() {
                    let i = chunk * CHUNK + offset;
                    for (slot, turn) in row.iter_mut().zip(&moves) {
                        let point = turn.apply(&samples.points[i]);
                        let normal = turn.rotation * samples.normals[i];
                        *slot = surface.matching(&point, &normal, gate).unwrap_or(NONE);
                    }
                }
            });
        }
        Self { turns: moves.len(), matched }
    }

    /// Matches of point `i`: for each turn the index of the measured point, or `None`.
    pub(crate) fn of(&self, i: usize) -> impl Iterator<Item = Option<usize>> + '_ {
        self.matched[i * self.turns..(i + 1) * self.turns].iter().map(|&j| (j != NONE).then_some(j as usize))
    }

    /// Number of rotated points that met the surface.
    #[must_use]
    pub(crate) fn count(&self) -> usize {
        self.matched.iter().filter(|&&j| j != NONE).count()
    }
}

/// The unknowns: the axis, and a displacement of each point when points are optimised too.
#[derive(Debug, Clone)]
pub(crate) struct Unknowns {
    /// The symmetry axis.
    pub axis: Axis,
    /// Displacement of each point \[length\]; empty when the points are held fixed.
    pub offsets: Vec<Vector3<f64>>,
}

/// The equation of the paper for fixed matches: the sum over points i and rotations k of w_k rho(r_ik), plus for each point
/// anchor |t_i|^2 / 2, which holds it at its own measurement.
///
/// r_ik is the distance of the rotated point c + R_k (p_i + t_i - c) from its match p'_ik, as `residual` measures it: all of it,
/// or its part along a normal. c is the point of the axis, t_i the displacement of point i, w_k the weight of rotation k, and
/// rho the robust loss. Points without a match under a rotation add nothing.
///
/// The matches p' are *measured* points, never refined ones: averages of averages would shrink thin blades.
pub(crate) struct SelfAlignment<'a> {
    /// The measured surface.
    pub surface: &'a Surface,
    /// The points that are rotated into it.
    pub samples: &'a Samples,
    /// Rotations of the symmetry and their weights.
    pub turns: &'a Turns,
    /// Matches, fixed while solving.
    pub correspondences: Correspondences,
    /// Distance that is minimised.
    pub residual: Residual,
    /// Robust loss, its width frozen while solving.
    pub loss: Huber,
    /// Weight of a point's own measurement against one match.
    pub anchor: f64,
    /// Largest displacement of a point \[length\].
    pub max_offset: f64,
}

/// A rotation with all that the derivative needs; `lever` holds (R - I) applied to both tangents.
pub(super) struct Leverage {
    turn: Turn,
    lever: [Vector3<f64>; 2],
    weight: f64,
}

/// One row of one match.
pub(super) struct Term<'a> {
    leverage: &'a Leverage,
    /// From the axis to the point.
    arm: Vector3<f64>,
    /// Derivative of the residual by the position of the rotated point.
    pub(super) direction: Vector3<f64>,
    pub(super) residual: f64,
    /// Robust weight, times that of the rotation.
    pub(super) weight: f64,
    /// Robust cost of the whole match, given with its first row.
    cost: f64,
}

impl Term<'_> {
    /// Derivative of the residual by the position of the point.
    #[inline]
    pub(super) fn row(&self) -> Vector3<f64> {
        self.leverage.turn.rotation.tr_mul(&self.direction)
    }

    /// Derivative of the residual by tilt and shift of the axis: with q the rotated point, dq/d(tilt) = [R d]_x (R - I)
    /// and dq/d(shift) = I - R, in the plane normal to the axis.
    #[inline]
    pub(super) fn jacobian(&self) -> Vector4<f64> {
        let [u, v] = &self.leverage.lever;
        let moment = self.direction.cross(&(self.leverage.turn.rotation * self.arm));
        Vector4::new(u.dot(&moment), v.dot(&moment), -u.dot(&self.direction), -v.dot(&self.direction))
    }

    /// How the rotated point moves with the four parameters, whatever the direction.
    pub(super) fn motion(&self) -> Matrix3x4<f64> {
        let [u, v] = &self.leverage.lever;
        let arm = self.leverage.turn.rotation * self.arm;
        Matrix3x4::from_columns(&[arm.cross(u), arm.cross(v), -u, -v])
    }
}

/// Normal equations of one point that may move in `D` directions: axis block, point block, and their coupling.
struct Block<const D: usize> {
    axis: NormalEquations,
    coupling: SMatrix<f64, 4, D>,
    point_hessian: SMatrix<f64, D, D>,
    point_gradient: SVector<f64, D>,
}

impl SelfAlignment<'_> {
    pub(super) fn leverages(&self, axis: &Axis) -> Vec<Leverage> {
        let tangents = axis.tangents();
        self.turns
            .iter()
            .map(|(angle, weight)| {
                let turn = axis.turn(angle);
                Leverage { turn, lever: tangents.map(|t| turn.rotation * t - t), weight }
            })
            .collect()
    }

    fn offset(&self, unknowns: &Unknowns, i: usize) -> Vector3<f64> {
        unknowns.offsets.get(i).copied().unwrap_or_default()
    }

    /// The normal equations of point `i`, which moves along the columns of `directions`.
    #[inline]
    fn block<const D: usize>(
        &self,
        unknowns: &Unknowns,
        leverages: &[Leverage],
        i: usize,
        directions: &SMatrix<f64, 3, D>,
    ) -> Block<D> {
        let offset = self.offset(unknowns, i);
        let mut block = Block {
            axis: NormalEquations { cost: 0.5 * self.anchor * offset.norm_squared(), ..Default::default() },
            coupling: SMatrix::zeros(),
            point_hessian: SMatrix::identity() * self.anchor,
            point_gradient: directions.tr_mul(&offset) * self.anchor,
        };
        self.visit(unknowns, leverages, i, |term, _| {
            let &Term { residual, weight, cost, .. } = term;
            let jacobian = term.jacobian();
            block.axis.hessian += jacobian * (jacobian * weight).transpose();
            block.axis.gradient += jacobian * (weight * residual);
            if D > 0 {
                let s = directions.tr_mul(&term.row());
                block.point_hessian += s * s.transpose() * weight;
                block.point_gradient += s * (weight * residual);
                block.coupling += jacobian * s.transpose() * weight;
            }
            block.axis.cost += cost;
        });
        block
    }

    /// Calls `f` with each row of each match of point `i`, and the point that it was matched to.
    #[inline]
    pub(super) fn visit(
        &self,
        unknowns: &Unknowns,
        leverages: &[Leverage],
        i: usize,
        mut f: impl FnMut(&Term, usize),
    ) {
        let point = self.samples.points[i] + self.offset(unknowns, i);
        let arm = point - unknowns.axis.point;
        for (leverage, matched) in leverages.iter().zip(self.correspondences.of(i)) {
            let Some(j) = matched else { continue };
            let difference = leverage.turn.apply(&point) - self.surface.samples.points[j];
            let normal = leverage.turn.rotation * self.samples.normals[i];
            let rows = self.residual.rows(&normal, &self.surface.samples.normals[j]);
            let norm = rows.residual(&difference);
            let weight = leverage.weight * self.loss.weight(norm);
            let mut cost = leverage.weight * self.loss.cost(norm);
            for &direction in rows.as_slice() {
                f(&Term { leverage, arm, direction, residual: direction.dot(&difference), weight, cost }, j);
                cost = 0.0;
            }
        }
    }
}

impl SelfAlignment<'_> {
    /// Sums the normal equations; each point is eliminated where it is met (Schur complement).
    fn reduced<const D: usize>(
        &self,
        unknowns: &Unknowns,
        directions: impl Fn(usize) -> SMatrix<f64, 3, D> + Sync,
    ) -> NormalEquations
    where
        Const<D>: DimMin<Const<D>, Output = Const<D>>,
    {
        let leverages = self.leverages(&unknowns.axis);
        let indices: Vec<usize> = (0..self.samples.points.len()).step_by(CHUNK).collect();
        let parts: Vec<NormalEquations> = indices
            .par_iter()
            .map(|&start| {
                let mut sum = NormalEquations::default();
                for i in start..(start + CHUNK).min(self.samples.points.len()) {
                    let mut block = self.block(unknowns, &leverages, i, &directions(i));
                    if D > 0
                        && let Some(inverse) = block.point_hessian.try_inverse()
                    {
                        let gain = block.coupling * inverse;
                        block.axis.hessian -= gain * block.coupling.transpose();
                        block.axis.gradient -= gain * block.point_gradient;
                    }
                    sum.add(&block.axis);
                }
                sum
            })
            .collect();
        parts.iter().fold(NormalEquations::default(), |mut sum, part| {
            sum.add(part);
            sum
        })
    }

    /// Moves the points to where they are best once the axis has moved by `step`.
    fn follow<const D: usize>(
        &self,
        unknowns: &Unknowns,
        step: &Vector4<f64>,
        directions: impl Fn(usize) -> SMatrix<f64, 3, D> + Sync,
    ) -> Vec<Vector3<f64>>
    where
        Const<D>: DimMin<Const<D>, Output = Const<D>>,
    {
        let leverages = self.leverages(&unknowns.axis);
        let mut offsets = unknowns.offsets.clone();
        offsets.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, offsets)| {
            for (local, offset) in offsets.iter_mut().enumerate() {
                let i = chunk * CHUNK + local;
                let directions = directions(i);
                let mut hessian = SMatrix::<f64, D, D>::identity() * self.anchor;
                let mut gradient = directions.tr_mul(offset) * self.anchor;
                self.visit(unknowns, &leverages, i, |term, _| {
                    let s = directions.tr_mul(&term.row());
                    hessian += s * s.transpose() * term.weight;
                    gradient += s * (term.weight * (term.residual + term.jacobian().dot(step)));
                });
                if let Some(inverse) = hessian.try_inverse() {
                    *offset -= directions * (inverse * gradient);
                }
                let length = offset.norm();
                if length > self.max_offset {
                    *offset *= self.max_offset / length;
                }
            }
        });
        offsets
    }

    /// The normal of a point, along which it moves where distances are measured to planes.
    fn normal(&self, i: usize) -> SMatrix<f64, 3, 1> {
        self.samples.normals[i]
    }
}

impl RobustProblem for SelfAlignment<'_> {
    type Param = Unknowns;

    fn linearize(&self, unknowns: &Unknowns) -> Result<NormalEquations> {
        Ok(match self.residual {
            _ if unknowns.offsets.is_empty() => self.reduced(unknowns, |_| SMatrix::<f64, 3, 0>::zeros()),
            Residual::PointToPlane => self.reduced(unknowns, |i| self.normal(i)),
            _ => self.reduced(unknowns, |_| Matrix3::identity()),
        })
    }

    fn cost(&self, unknowns: &Unknowns) -> Result<f64> {
        let leverages = self.leverages(&unknowns.axis);
        let indices: Vec<usize> = (0..self.samples.points.len()).step_by(CHUNK).collect();
        let parts: Vec<f64> = indices
            .par_iter()
            .map(|&start| {
                let mut sum = 0.0;
                for i in start..(start + CHUNK).min(self.samples.points.len()) {
                    let offset = self.offset(unknowns, i);
                    let point = self.samples.points[i] + offset;
                    sum += 0.5 * self.anchor * offset.norm_squared();
                    for (leverage, matched) in leverages.iter().zip(self.correspondences.of(i)) {
                        let Some(j) = matched else { continue };
                        let normal = leverage.turn.rotation * self.samples.normals[i];
                        let rows = self.residual.rows(&normal, &self.surface.samples.normals[j]);
                        let difference = leverage.turn.apply(&point) - self.surface.samples.points[j];
                        sum += leverage.weight * self.loss.cost(rows.residual(&difference));
                    }
                }
                sum
            })
            .collect();
        Ok(parts.iter().sum())
    }

    fn step(&self, unknowns: &Unknowns, step: &Vector4<f64>) -> Unknowns {
        let offsets = match self.residual {
            _ if unknowns.offsets.is_empty() => Vec::new(),
            Residual::PointToPlane => self.follow(unknowns, step, |i| self.normal(i)),
            _ => self.follow(unknowns, step, |_| Matrix3::identity()),
        };
        Unknowns { axis: unknowns.axis.retract(step), offsets }
    }
}

/// Residuals of the matches of some of the points at `axis`, enough to know how they scatter.
#[must_use]
pub(crate) fn residuals(
    surface: &Surface,
    samples: &Samples,
    axis: &Axis,
    turns: &Turns,
    correspondences: &Correspondences,
    residual: Residual,
) -> Vec<f64> {
    /// A median of this many is known to a percent or two.
    const ENOUGH: usize = 8192;
    let moves: Vec<Turn> = turns.angles().map(|angle| axis.turn(angle)).collect();
    let step = (samples.points.len() * moves.len()).div_ceil(ENOUGH).max(1);
    let mut found = Vec::with_capacity(ENOUGH);
    for i in (0..samples.points.len()).step_by(step) {
        for (turn, matched) in moves.iter().zip(correspondences.of(i)) {
            let Some(j) = matched else { continue };
            let rows = residual.rows(&(turn.rotation * samples.normals[i]), &surface.samples.normals[j]);
            found.push(rows.residual(&(turn.apply(&samples.points[i]) - surface.samples.points[j])));
        }
    }
    found
}

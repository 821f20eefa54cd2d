//! The points' part of the joint optimisation: each point comes to rest between its own measurement and the points that
//! its rotated copies meet, the axis being known. All of them stand for the mean surface around them where it is known.
//!
//! Once the axis is fixed, and the points that are met stay where they were measured, no equation holds two of the unknown
//! points: each is solved on its own, as soon as its matches are found.

use nalgebra::{Const, DimMin, Matrix3, SMatrix, SVector, Vector3};
use rayon::prelude::*;

use crate::config::Residual;
use crate::control::Control;
use crate::error::Result;
use crate::symmetry::axis::{Axis, Turn};
use crate::symmetry::order::Turns;
use crate::symmetry::robust::Huber;
use crate::symmetry::surface::{Gate, Surface};

/// Points in a unit of parallel work.
const CHUNK: usize = 2048;

/// What holds the points of a surface.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rest<'a> {
    /// Rotations of the symmetry and their weights.
    pub turns: &'a Turns,
    /// What a match may differ in.
    pub gate: Gate,
    /// Distance that is minimised.
    pub residual: Residual,
    /// Robust loss of a match.
    pub loss: Huber,
    /// Weight of a point's own measurement against one match.
    pub anchor: f64,
    /// Largest distance of a point from the mean surface about its own measurement \[length\].
    pub max_offset: f64,
    /// Steps of iteratively reweighted least squares.
    pub steps: u64,
}

/// One match of a point that may move in `D` directions: up to three rows, each the slope and the value of a residual.
struct Match<const D: usize> {
    rows: [(SVector<f64, D>, f64); 3],
    len: usize,
    weight: f64,
}

impl Rest<'_> {
    /// Displacement of each point of `surface` \[length\]: along its normal where distances are measured to planes.
    ///
    /// # Errors
    /// [`Error::Cancelled`](crate::Error::Cancelled), [`Error::DeadlineExceeded`](crate::Error::DeadlineExceeded).
    pub(crate) fn offsets(
        &self,
        surface: &Surface,
        axis: &Axis,
        control: &Control,
    ) -> Result<Vec<Vector3<f64>>> {
        match self.residual {
            Residual::PointToPlane => {
                let normal = |i: usize| SMatrix::<f64, 3, 1>::from(surface.samples.normals[i]);
                self.along(surface, axis, control, normal)
            }
            _ => self.along(surface, axis, control, |_| Matrix3::identity()),
        }
    }

    fn along<const D: usize>(
        &self,
        surface: &Surface,
        axis: &Axis,
        control: &Control,
        directions: impl Fn(usize) -> SMatrix<f64, 3, D> + Sync,
    ) -> Result<Vec<Vector3<f64>>>
    where
        Const<D>: DimMin<Const<D>, Output = Const<D>>,
    {
        let moves: Vec<(Turn, f64)> =
            self.turns.iter().map(|(angle, weight)| (axis.turn(angle), weight)).collect();
        let mut offsets = vec![Vector3::zeros(); surface.len()];
        offsets.par_chunks_mut(CHUNK).enumerate().try_for_each(|(chunk, offsets)| {
            control.check()?;
            let mut matches = Vec::with_capacity(moves.len());
            for (local, offset) in offsets.iter_mut().enumerate() {
                let i = chunk * CHUNK + local;
                let directions = directions(i);
                matches.clear();
                let found = moves.iter().filter_map(|(turn, weight)| {
                    self.meet(surface, i, turn, &directions).map(|found| Match { weight: *weight, ..found })
                });
                matches.extend(found);
                let smoothed = surface.smoothed(i);
                *offset = smoothed - surface.samples.points[i] + directions * self.solve(&matches);
            }
            Ok(())
        })?;
        Ok(offsets)
    }

    /// The match of point `i` under `turn`.
    #[inline]
    fn meet<const D: usize>(
        &self,
        surface: &Surface,
        i: usize,
        turn: &Turn,
        directions: &SMatrix<f64, 3, D>,
    ) -> Option<Match<D>> {
        let point = turn.apply(&surface.smoothed(i));
        let normal = turn.rotation * surface.samples.normals[i];
        let j = surface.matching(&point, &normal, self.gate)? as usize;
        let difference = point - surface.smoothed(j);
        let found = self.residual.rows(&normal, &surface.samples.normals[j]);
        let turned = turn.rotation * directions;
        let mut rows = [(SVector::zeros(), 0.0); 3];
        for (row, m) in rows.iter_mut().zip(found.as_slice()) {
            *row = (turned.tr_mul(m), m.dot(&difference));
        }
        Some(Match { rows, len: found.as_slice().len(), weight: 1.0 })
    }

    /// Robust least squares over the matches and the point's own measurement, in the directions it may move.
    #[inline]
    fn solve<const D: usize>(&self, matches: &[Match<D>]) -> SVector<f64, D>
    where
        Const<D>: DimMin<Const<D>, Output = Const<D>>,
    {
        let mut moved = SVector::<f64, D>::zeros();
        for _ in 0..self.steps {
            let mut hessian = SMatrix::<f64, D, D>::identity() * self.anchor;
            let mut gradient = moved * self.anchor;
            for found in matches {
                let rows = &found.rows[..found.len];
                let now = |(slope, value): &(SVector<f64, D>, f64)| value + slope.dot(&moved);
                let norm = rows.iter().map(|row| now(row).powi(2)).sum::<f64>().sqrt();
                let weight = found.weight * self.loss.weight(norm);
                for row in rows {
                    hessian += row.0 * (row.0 * weight).transpose();
                    gradient += row.0 * (weight * now(row));
                }
            }
            if let Some(inverse) = hessian.try_inverse() {
                moved -= inverse * gradient;
            }
            let length = moved.norm();
            if length > self.max_offset {
                moved *= self.max_offset / length;
            }
        }
        moved
    }
}

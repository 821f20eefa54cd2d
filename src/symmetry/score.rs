//! How well a rotated surface meets itself, and what speaks against it.

use nalgebra::Vector3;
use rayon::prelude::*;

use crate::symmetry::axis::{Axis, Turn};
use crate::symmetry::order::Turns;
use crate::symmetry::surface::{Gate, Samples, Surface};
use crate::symmetry::visibility::{Seen, Visibility};

/// What became of the rotated points.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct MatchScore {
    /// Met the surface with an agreeing normal.
    pub matched: usize,
    /// Missed it where a camera would have seen them (anywhere, when no viewpoint is known).
    pub contradicted: usize,
    /// Fell where no camera can tell.
    pub unseen: usize,
}

/// Weight of a point that was seen to be wrong against one that matched.
const CONTRADICTED: f64 = 2.0;

/// Weight of a point of which nothing is known against one that was seen to be wrong; it keeps an axis that turns the
/// whole part out of sight from scoring well.
const UNSEEN: f64 = 0.1;

impl MatchScore {
    /// Share of the evidence that agrees, in [0, 1].
    #[must_use]
    pub fn value(&self) -> f64 {
        let against = CONTRADICTED * self.contradicted as f64 + UNSEEN * self.unseen as f64;
        let total = self.matched as f64 + against;
        if total > 0.0 { self.matched as f64 / total } else { 0.0 }
    }

    /// Share of the rotated points that met the surface, whatever became of the others.
    #[must_use]
    pub fn overlap(&self) -> f64 {
        let total = self.matched + self.contradicted + self.unseen;
        if total > 0 { self.matched as f64 / total as f64 } else { 0.0 }
    }

    /// Share of the observed surface that agrees, in [0, 1]: what no camera can tell is left out.
    #[must_use]
    pub fn explained(&self) -> f64 {
        let told = self.matched + self.contradicted;
        if told > 0 { self.matched as f64 / told as f64 } else { 0.0 }
    }

    fn add(self, other: Self) -> Self {
        Self {
            matched: self.matched + other.matched,
            contradicted: self.contradicted + other.contradicted,
            unseen: self.unseen + other.unseen,
        }
    }
}

/// Rotates `samples` by every turn and counts what they meet.
#[must_use]
pub fn match_score(
    surface: &Surface,
    samples: &Samples,
    axis: &Axis,
    turns: &Turns,
    gate: Gate,
    visibility: Option<&Visibility>,
) -> MatchScore {
    let moves: Vec<Turn> = turns.angles().map(|angle| axis.turn(angle)).collect();
    let judge = |point: &Vector3<f64>, normal: &Vector3<f64>| {
        if surface.matching(point, normal, gate).is_some() {
            return MatchScore { matched: 1, ..MatchScore::default() };
        }
        let free = visibility.is_none_or(|v| v.seen(point, gate.distance) == Seen::Free);
        MatchScore { contradicted: usize::from(free), unseen: usize::from(!free), ..MatchScore::default() }
    };
    let parts: Vec<MatchScore> = (0..samples.points.len())
        .into_par_iter()
        .with_min_len(64)
        .map(|i| {
            moves.iter().fold(MatchScore::default(), |sum, turn| {
                sum.add(judge(&turn.apply(&samples.points[i]), &(turn.rotation * samples.normals[i])))
            })
        })
        .collect();
    parts.into_iter().fold(MatchScore::default(), MatchScore::add)
}

//! The planes through the axis in which the part is its own mirror image, where it has such planes.
//!
//! Spokes, bolt holes and teeth mostly are: planes run through them and half way between them. One that is found by laying the
//! mirrored surface on the measured one is as exact as the axis, and does not turn with what a camera saw more of on one side.

use std::f64::consts::PI;

use nalgebra::Vector3;
use rayon::prelude::*;

use crate::symmetry::axis::{ASIDE, Axis, Turn};
use crate::symmetry::covariance::INFLATION;
use crate::symmetry::robust::{HUBER_WIDTH, Huber, robust_sigma};
use crate::symmetry::sandwich::PATCHES;
use crate::symmetry::score::{MatchScore, score_of_moves};
use crate::symmetry::sight::Sight;
use crate::symmetry::surface::{Gate, Samples, Surface};

/// Points that are mirrored, at most, and at least: fewer tell nothing.
const MOST: usize = 1000;
const FEWEST: usize = 100;

/// Planes that each point is mirrored in, at most.
const PLANES: u32 = 6;

/// Largest distances of a match, one round each [point spacings].
const GATES: [f64; 6] = [12.0, 6.0, 3.0, 3.0, 3.0, 3.0];

/// Share of the mirrored points that must meet the surface. Of 54 parts from five views, those with mirror planes have 0.92 and
/// more, those without 0.66 and less.
const MIRRORED: f64 = 0.9;

/// How far other planes that are tried are apart at the rim [point spacings], and the points that are mirrored in them.
const STEP: f64 = 2.0;
const FEW: usize = 200;

/// Share of the points that meet the surface which may do so in another plane: in a ring of teeth any tooth serves for any other.
const ALONE: f64 = 0.8;

/// What errors that patches share add to the variance of the angle, beside [`INFLATION`].
const SHARED: f64 = 1.5;

/// A surface that turns about an axis, whose mirror planes are sought.
pub(crate) struct MirrorSearch<'a> {
    /// What mirrored points are laid on.
    pub surface: &'a Surface,
    /// The points of the surface, refined.
    pub refined: &'a Samples,
    /// Where the planes meet.
    pub axis: &'a Axis,
    /// Order of the axis, and number of the planes.
    pub order: u32,
    /// What a mirrored point and the surface that it meets may differ in.
    pub gate: Gate,
    /// What the cameras saw.
    pub sight: Sight<'a>,
}

/// A plane through the axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct MirrorPlane {
    /// Angle from the first tangent of the axis \[rad\].
    pub angle: f64,
    /// Standard deviation of the angle \[rad\].
    pub sigma: f64,
    /// Angle to the next plane \[rad\].
    pub between: f64,
}

/// A mirrored point that met the surface.
struct Meeting {
    /// How far it moves along the normal of the surface when the plane turns [length / rad].
    lever: f64,
    /// Height over the surface \[length\].
    height: f64,
    /// Where it comes from, and what it met [indices of points].
    ends: [usize; 2],
    weight: f64,
}

impl MirrorSearch<'_> {
    /// The mirror plane that the angle `near` \[rad\] leads to; `None` where the part is not its mirror image there, or as much so
    /// elsewhere.
    #[must_use]
    pub(crate) fn plane_near(&self, near: f64) -> Option<MirrorPlane> {
        let flanks = self.flanks();
        if flanks.len() < FEWEST {
            return None;
        }
        let mut angle = near;
        let mut meetings = Vec::new();
        for reach in GATES {
            meetings = self.meetings(&flanks, angle, reach * self.surface.spacing);
            let gradient: f64 = meetings.iter().map(|m| m.weight * m.lever * m.height).sum();
            angle -= gradient / information(&meetings);
        }
        let is_found = self.score(&flanks, angle).explained() >= MIRRORED && self.is_alone(&flanks, angle);
        is_found.then(|| MirrorPlane {
            angle,
            sigma: self.variance(&meetings).sqrt(),
            between: self.between(),
        })
    }

    /// Points whose normals stand out of the planes through the axis; the others fit in any plane.
    fn flanks(&self) -> Vec<usize> {
        let Samples { points, normals } = self.refined;
        let is_flank = |&i: &usize| self.axis.around(&points[i], &normals[i]).abs() > ASIDE;
        let flanks: Vec<usize> = (0..points.len()).filter(is_flank).collect();
        thinned(&flanks, MOST)
    }

    /// The reflections in all planes of the group that holds the one at `angle`, or in some of them, evenly spread.
    fn reflections(&self, angle: f64) -> Vec<Turn> {
        let count = self.order.min(PLANES);
        let nth = |k| f64::from(k * self.order / count);
        (0..count).map(|k| self.axis.mirror(angle + self.between() * nth(k))).collect()
    }

    /// Angle from one plane to the next: half a sector \[rad\].
    fn between(&self) -> f64 {
        PI / f64::from(self.order)
    }

    /// The mirrored points that meet the surface within `reach` \[length\].
    fn meetings(&self, flanks: &[usize], angle: f64, reach: f64) -> Vec<Meeting> {
        let Self { surface, refined, axis, .. } = self;
        let gate = Gate { distance: reach, ..self.gate };
        let reflections = self.reflections(angle);
        let meeting = |from: usize, reflection: &Turn| {
            let point = reflection.apply(&refined.points[from]);
            let met =
                surface.matching(&point, &(reflection.rotation * refined.normals[from]), gate)? as usize;
            let normal = surface.samples.normals[met];
            Some(Meeting {
                // A plane that turns by an angle turns the mirrored point by twice that.
                lever: 2.0 * axis.direction.cross(&(point - axis.point)).dot(&normal),
                height: normal.dot(&(point - surface.smoothed(met))),
                ends: [from, met],
                weight: 1.0,
            })
        };
        let rows = flanks.par_iter().with_min_len(64);
        let mut meetings: Vec<Meeting> =
            rows.flat_map_iter(|&from| reflections.iter().filter_map(move |r| meeting(from, r))).collect();
        let mut heights: Vec<f64> = meetings.iter().map(|m| m.height).collect();
        let loss = Huber { width: HUBER_WIDTH * robust_sigma(&mut heights) };
        meetings.iter_mut().for_each(|m| m.weight = loss.weight(m.height));
        meetings
    }

    /// What becomes of points that are mirrored.
    fn score(&self, flanks: &[usize], angle: f64) -> MatchScore {
        let pick = |of: &[Vector3<f64>]| flanks.iter().map(|&i| of[i]).collect();
        let flanks = Samples { points: pick(&self.refined.points), normals: pick(&self.refined.normals) };
        score_of_moves(self.surface, &flanks, &self.reflections(angle), self.gate, self.sight)
    }

    /// Whether far fewer points meet the surface when they are mirrored in any plane between this one and the next.
    fn is_alone(&self, flanks: &[usize], angle: f64) -> bool {
        let few = thinned(flanks, FEW);
        let rim = flanks.iter().map(|&i| self.axis.distance(&self.refined.points[i])).fold(0.0, f64::max);
        let between = self.between();
        let steps = (between * rim / (STEP * self.surface.spacing)) as usize;
        let meet = |angle| self.meetings(&few, angle, self.gate.distance).len() as f64;
        let most = ALONE * meet(angle);
        let others = (2..steps.saturating_sub(1)).into_par_iter();
        others.map(|i| angle + between * i as f64 / steps as f64).all(|other| meet(other) <= most)
    }

    /// Variance of the angle \[rad^2\], from the scatter of the gradient over patches, as that of the axis
    /// ([`SelfAlignment::sandwich`]).
    ///
    /// [`SelfAlignment::sandwich`]: crate::symmetry::alignment::SelfAlignment::sandwich
    fn variance(&self, meetings: &[Meeting]) -> f64 {
        let points = self.surface.len();
        let mut gradients = [0.0; PATCHES];
        for Meeting { lever, height, ends, weight } in meetings {
            for end in ends {
                gradients[end * PATCHES / points] += weight * lever * height;
            }
        }
        let scatter: f64 = gradients.iter().map(|g| g * g).sum();
        let information = information(meetings);
        SHARED * INFLATION * scatter / information / information
    }
}

/// Curvature of the cost.
fn information(meetings: &[Meeting]) -> f64 {
    meetings.iter().map(|m| m.weight * m.lever * m.lever).sum::<f64>().max(f64::MIN_POSITIVE)
}

/// At most `count` of the rows, at a regular stride.
fn thinned(rows: &[usize], count: usize) -> Vec<usize> {
    rows.iter().copied().step_by(rows.len().div_ceil(count).max(1)).collect()
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

    /// Angle of a plane near 0.01 in the wall of a drum of order 5, whose radius and its derivative are given by the angle.
    fn plane_of(wall: impl Fn(f64) -> [f64; 2]) -> Option<f64> {
        const ROWS: usize = 20;
        const COLUMNS: usize = 900;
        let axis = Axis { direction: Vector3::z_axis(), point: Vector3::zeros() };
        let [u, v] = axis.tangents();
        let mut drum = Samples::default();
        for i in 0..ROWS * COLUMNS {
            let angle = TAU * (i / ROWS) as f64 / COLUMNS as f64;
            let ([radius, slope], (sin, cos)) = (wall(angle), angle.sin_cos());
            let height = 0.005 * (i % ROWS) as f64;
            drum.points.push(u * radius * cos + v * radius * sin + *axis.direction * height);
            let normal = u * (radius * cos + slope * sin) + v * (radius * sin - slope * cos);
            drum.normals.push(normal.normalize());
        }
        let surface = Surface::new(drum.clone(), true, 0.005, 0.06);
        let search = MirrorSearch {
            surface: &surface,
            refined: &drum,
            axis: &axis,
            order: 5,
            gate: Gate::new(0.015, 0.7),
            sight: None.into(),
        };
        search.plane_near(0.01).map(|plane| plane.angle)
    }

    #[test]
    fn a_plane_runs_through_a_lobe() {
        let lobed = |angle: f64| [0.4 + 0.05 * (5.0 * angle).cos(), -0.25 * (5.0 * angle).sin()];
        assert!(plane_of(lobed).is_some_and(|angle| angle.abs() < 1e-3));
    }

    #[test]
    fn lobes_that_lean_have_none() {
        let leaning = |angle: f64| {
            let (once, twice) = (5.0 * angle, 10.0 * angle + 1.0);
            [0.4 + 0.05 * once.cos() + 0.03 * twice.cos(), -0.25 * once.sin() - 0.3 * twice.sin()]
        };
        assert_eq!(plane_of(leaning), None);
    }

    #[test]
    fn one_of_many_teeth_alike_is_none() {
        let toothed = |angle: f64| [0.4 + 0.02 * (40.0 * angle).cos(), -0.8 * (40.0 * angle).sin()];
        assert_eq!(plane_of(toothed), None);
    }

    #[test]
    fn a_wall_that_is_round_has_none() {
        assert_eq!(plane_of(|_| [0.4, 0.0]), None);
    }
}

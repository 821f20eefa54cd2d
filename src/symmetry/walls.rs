//! Walls that a rotation must bring to a wall again: where the surface goes on flat all round, there is none.
//!
//! A slot or a rib three points wide leaves no gap that a camera sees, and where its walls come to lie within a body no camera sees
//! anything. But where they end at the face that they stand in, the face shows whether it is cut there.

use std::f64::consts::TAU;

use nalgebra::Vector3;

use crate::directions::tangents;
use crate::symmetry::axis::{ASIDE, Axis, Turn};
use crate::symmetry::score::Outcome;
use crate::symmetry::surface::{Gate, Samples, Surface};

/// At most `count` points of walls that a turn about the axis moves: their normals stand out of the planes through it, and agree
/// with those of other points beside them.
pub(crate) fn walls(surface: &Surface, axis: &Axis, count: usize) -> Samples {
    /// Directions in which a wall goes on, at least. Alone, points have such normals by noise.
    const ENOUGH: usize = 3;
    const BESIDE: Beside = Beside { reach: 1.5, cosine: 0.85, level: 0.7 };
    let aside = chosen(&surface.samples, |point, normal| axis.around(point, normal).abs() > ASIDE);
    chosen(&aside.strided(count), |point, normal| BESIDE.directions(surface, point, normal) >= ENOUGH)
}

/// Those of some points that are chosen by their place and their normal.
fn chosen(samples: &Samples, is_chosen: impl Fn(&Vector3<f64>, &Vector3<f64>) -> bool) -> Samples {
    let all = samples.points.iter().zip(&samples.normals);
    let (points, normals) = all.filter(|(point, normal)| is_chosen(point, normal)).unzip();
    Samples { points, normals }
}

/// What becomes of a point of a wall: it matches, is contradicted where the surface is flat, or nothing is known of it.
pub(crate) fn outcome_of_wall(
    surface: &Surface,
    point: &Vector3<f64>,
    normal: &Vector3<f64>,
    turn: &Turn,
    gate: Gate,
) -> Outcome {
    /// Largest distance from a measured point, and from its plane [spacings].
    const NEAR: [f64; 2] = [1.0, 0.7];
    /// Cosine between the normals of a wall and of the face that it ends at; the other side of a thin wall faces the other way.
    const ACROSS: [f64; 2] = [-0.5, 0.6];
    const FLAT: Beside = Beside { reach: 2.0, cosine: 0.92, level: 0.5 };
    let point = turn.apply(point);
    let normal = turn.rotation * normal;
    let any_normal = Gate { cosine: -1.0, ..gate };
    let Some(met) = surface.matching(&point, &normal, any_normal) else { return Outcome::Hidden };
    let facing = surface.samples.normals[met as usize];
    let (cosine, height) = (facing.dot(&normal), surface.height_over(met, &point));
    if cosine >= gate.cosine && height.abs() <= gate.off_plane {
        return Outcome::Matched;
    }
    let [distance, off_plane] = NEAR.map(|spacings| spacings * surface.spacing);
    let is_near =
        (point - surface.samples.points[met as usize]).norm() < distance && height.abs() < off_plane;
    let is_across = ACROSS[0] < cosine && cosine < ACROSS[1];
    let foot = point - facing * height;
    if is_near && is_across && FLAT.directions(surface, &foot, &facing) == Beside::DIRECTIONS {
        Outcome::Contradicted
    } else {
        Outcome::Hidden
    }
}

/// Where a surface is looked for that goes on beside a place, and what counts as that.
struct Beside {
    /// How far from the place \[spacings\].
    reach: f64,
    /// Smallest cosine between the normals.
    cosine: f64,
    /// Largest distance from the plane of the place \[spacings\].
    level: f64,
}

impl Beside {
    /// Directions that are looked in.
    const DIRECTIONS: usize = 8;

    /// In how many directions the surface goes on beside a `place` of it that faces along `facing`.
    fn directions(&self, surface: &Surface, place: &Vector3<f64>, facing: &Vector3<f64>) -> usize {
        /// Largest distance of what lies there from a measured point [spacings].
        const NEAR: f64 = 1.2;
        let [reach, near, level] = [self.reach, NEAR, self.level].map(|spacings| spacings * surface.spacing);
        let gate = Gate::new(near, self.cosine);
        let [u, v] = tangents(facing);
        let goes_on = |direction: &usize| {
            let (sin, cos) = (TAU * *direction as f64 / Self::DIRECTIONS as f64).sin_cos();
            let there = surface.matching(&(place + (u * cos + v * sin) * reach), facing, gate);
            there.is_some_and(|met| {
                let above = surface.samples.points[met as usize] - place;
                above.dot(facing).abs() < level
            })
        };
        (0..Self::DIRECTIONS).filter(goes_on).count()
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    const SPACING: f64 = 0.01;

    /// A plate of radius 0.5 about +z with so many slots, two or three points wide and two rows deep.
    pub(crate) fn slotted(slots: u32) -> Surface {
        const HALF_WIDTH: f64 = 0.012;
        let ends = 0.2..0.4;
        let mut samples = Samples::default();
        let mut add = |point: Vector3<f64>, normal| {
            samples.points.push(point);
            samples.normals.push(normal);
        };
        let angle_of = |slot| TAU * f64::from(slot) / f64::from(slots);
        for (i, k) in (-50..=50).flat_map(|i| (-50..=50).map(move |k| (i, k))) {
            let point = Vector3::new(SPACING * f64::from(i), SPACING * f64::from(k), 0.0);
            let is_cut = |slot| {
                let along = Vector3::new(angle_of(slot).cos(), angle_of(slot).sin(), 0.0);
                point.cross(&along).norm() < HALF_WIDTH && ends.contains(&point.dot(&along))
            };
            if point.norm() < 0.5 && !(0..slots).any(is_cut) {
                add(point, Vector3::z());
            }
        }
        for slot in 0..slots {
            let (sin, cos) = angle_of(slot).sin_cos();
            let (along, across) = (Vector3::new(cos, sin, 0.0), Vector3::new(-sin, cos, 0.0));
            for (i, depth) in (20..=40).flat_map(|i| [0.003, 0.013].map(|depth| (i, depth))) {
                for side in [-1.0, 1.0] {
                    let foot = along * (SPACING * f64::from(i)) + across * (side * HALF_WIDTH);
                    add(foot - Vector3::z() * depth, across * -side);
                }
            }
        }
        Surface::new(samples, true, SPACING, 3.0 * SPACING)
    }

    pub(crate) fn axis() -> Axis {
        Axis { direction: Vector3::z_axis(), point: Vector3::zeros() }
    }

    #[test]
    fn what_goes_on_beside_and_stands_aside_is_a_wall() {
        let found = walls(&slotted(4), &axis(), 10_000);
        assert!((4 * 70..=4 * 84).contains(&found.points.len()), "{}", found.points.len());
        assert!(found.normals.iter().all(|normal| normal.z == 0.0));
        assert_eq!(walls(&slotted(4), &axis(), 40).points.len(), 40);
        assert!(walls(&slotted(0), &axis(), 10_000).points.is_empty());
    }

    #[test]
    fn a_wall_is_contradicted_where_the_surface_is_flat() {
        let surface = slotted(4);
        let gate = Gate { distance: 1.3 * SPACING, cosine: 0.8, off_plane: 1.1 * SPACING };
        let outcome = |depth: f64, turns: f64| {
            let point = Vector3::new(0.3, 0.012, -depth);
            outcome_of_wall(&surface, &point, &-Vector3::y(), &axis().turn(TAU * turns), gate)
        };
        assert_eq!(outcome(0.003, 0.25), Outcome::Matched);
        assert_eq!(outcome(0.003, 0.125), Outcome::Contradicted);
        // Within the plate nobody saw anything, and beside a slot it is not flat all round.
        assert_eq!(outcome(0.013, 0.125), Outcome::Hidden);
        assert_eq!(outcome(0.003, 0.243), Outcome::Hidden);
    }
}

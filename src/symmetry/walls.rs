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
    const DIRECTIONS: usize = 3;
    const BESIDE: Beside = Beside { reach: 1.5, cosine: 0.85, level: 0.7 };
    let Samples { points, normals } = &surface.samples;
    let aside: Vec<usize> =
        (0..points.len()).filter(|&i| axis.around(&points[i], &normals[i]).abs() > ASIDE).collect();
    let taken = count.min(aside.len());
    let chosen = (0..taken).map(|i| aside[i * aside.len() / taken]);
    let walls = chosen.map(|i| (points[i], normals[i]));
    let (points, normals) =
        walls.filter(|(point, normal)| BESIDE.goes_on(surface, point, normal).count() >= DIRECTIONS).unzip();
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
    if is_near && is_across && FLAT.goes_on(surface, &foot, &facing).count() == Beside::DIRECTIONS {
        Outcome::Contradicted
    } else {
        Outcome::Hidden
    }
}

/// Where a surface is looked for that goes on beside a place.
struct Beside {
    /// How far from the place \[spacings\].
    reach: f64,
    /// Smallest cosine between the normals.
    cosine: f64,
    /// Largest distance from the plane of the place \[spacings\].
    level: f64,
}

impl Beside {
    const DIRECTIONS: usize = 8;

    /// The directions in which the surface goes on beside a `place` of it that faces along `facing`, of [`Self::DIRECTIONS`].
    fn goes_on(
        &self,
        surface: &Surface,
        place: &Vector3<f64>,
        facing: &Vector3<f64>,
    ) -> impl Iterator<Item = usize> {
        /// Largest distance of what lies there from a measured point [spacings].
        const NEAR: f64 = 1.2;
        let [reach, near, level] = [self.reach, NEAR, self.level].map(|spacings| spacings * surface.spacing);
        let gate = Gate::new(near, self.cosine);
        let [u, v] = tangents(facing);
        (0..Self::DIRECTIONS).filter(move |&direction| {
            let (sin, cos) = (TAU * direction as f64 / Self::DIRECTIONS as f64).sin_cos();
            let there = surface.matching(&(place + (u * cos + v * sin) * reach), facing, gate);
            there.is_some_and(|met| {
                let above = surface.samples.points[met as usize] - place;
                above.dot(facing).abs() < level
            })
        })
    }
}

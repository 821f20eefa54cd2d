//! Clouds for the benches, made here: a part scanned from several views, a planar lattice, noise, and a table.
#![allow(dead_code, reason = "each bench uses its own part")]

use std::f64::consts::TAU;

use sympose::nalgebra::Vector3;

/// Order of the part.
pub(crate) const ORDER: u32 = 5;
/// Cameras around it.
const VIEWS: u32 = 5;
/// Distance of a camera from the middle of the part.
const DISTANCE: f64 = 2.2;

/// Points in the order in which cameras measured them, and for each the position of its camera.
pub(crate) struct Scan {
    pub(crate) points: Vec<[f64; 3]>,
    pub(crate) viewpoints: Vec<[f64; 3]>,
}

/// About `count` points of a knob of diameter 1: view by view, row by row, as depth cameras deliver them.
///
/// That order matters: points that follow each other are neighbours in space, but each part of the surface comes up
/// once for every view that saw it.
pub(crate) fn scan(count: usize) -> Scan {
    // What a few pixels hit tells how many are needed.
    let few = 96;
    let share = (few * few) as f64 / render(few).points.len() as f64;
    render((count as f64 * share).sqrt() as usize)
}

/// The scan by cameras of `width` by `width` pixels.
fn render(width: usize) -> Scan {
    let mut random = Random(7);
    let (mut points, mut viewpoints) = (Vec::new(), Vec::new());
    for view in 0..VIEWS {
        let height = 1.6 * (f64::from(view) + 0.5) / f64::from(VIEWS) - 0.8;
        let (sine, cosine) = (2.399_963 * f64::from(view)).sin_cos();
        let level = (1.0 - height * height).sqrt();
        let eye = DISTANCE * Vector3::new(level * cosine, level * sine, height);
        let forward = -eye / DISTANCE;
        let right = forward.cross(&Vector3::z()).normalize();
        let down = forward.cross(&right);
        let pixel = |i: usize| 0.6 * ((i as f64 + 0.5) / width as f64 - 0.5);
        for row in 0..width {
            for column in 0..width {
                let ray = (forward + pixel(column) * right + pixel(row) * down).normalize();
                if let Some(depth) = cast(&eye, &ray) {
                    points.push((eye + (depth + 0.001 * random.normal()) * ray).into());
                    viewpoints.push(eye.into());
                }
            }
        }
    }
    Scan { points, viewpoints }
}

/// How far a ray goes until it meets the part, by sphere tracing (Hart 1996).
fn cast(eye: &Vector3<f64>, ray: &Vector3<f64>) -> Option<f64> {
    let mut depth = DISTANCE - 0.6;
    while depth < DISTANCE + 0.6 {
        let gap = clearance(&(eye + depth * ray));
        if gap < 1e-5 {
            return Some(depth);
        }
        // The bound on the distance is one only up to the slope of the lobes.
        depth += 0.6 * gap;
    }
    None
}

/// A lower bound of the distance to a lobed disc with a dished top and a bore, negative inside.
fn clearance(p: &Vector3<f64>) -> f64 {
    let radius = p.x.hypot(p.y);
    let rim = 0.44 + 0.05 * (f64::from(ORDER) * p.y.atan2(p.x)).cos();
    let top = p.z - (0.08 + 0.4 * radius * radius);
    (radius - rim).max(top).max(-0.1 - p.z).max(0.12 - radius)
}

/// `count` points of a square lattice in a plane, of edge 1: every coordinate comes up many times.
pub(crate) fn planar_lattice(count: usize) -> Vec<[f64; 3]> {
    let edge = (count as f64).sqrt() as usize;
    let coordinate = |i: usize| i as f64 / edge as f64;
    (0..edge * edge).map(|i| [coordinate(i % edge), coordinate(i / edge), 0.25]).collect()
}

/// `count` points, uniform in a cube of edge 1.
pub(crate) fn noise(count: usize) -> Vec<[f64; 3]> {
    let mut random = Random(3);
    (0..count).map(|_| std::array::from_fn(|_| random.uniform())).collect()
}

/// `count` points of which two in five lie on a table, in random order.
pub(crate) fn table(count: usize) -> Vec<[f64; 3]> {
    let mut random = Random(5);
    let point = |i| {
        let [x, y, z] = std::array::from_fn(|_| random.uniform());
        [x, y, if i % 5 < 2 { 0.2 + 0.002 * random.normal() } else { z }]
    };
    (0..count).map(point).collect()
}

/// A seeded stream of numbers (SplitMix64).
struct Random(u64);

impl Random {
    /// Uniform in [0, 1).
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Standard normal (Box and Muller).
    fn normal(&mut self) -> f64 {
        (-2.0 * (1.0 - self.uniform()).ln()).sqrt() * (TAU * self.uniform()).cos()
    }
}

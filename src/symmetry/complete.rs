//! Completion: the union of the rotated copies, from one folded sector.
//!
//! All points are turned into one sector of a polar grid about the axis, so that the cost does not grow with the order,
//! no copy has a seam, and the grid favours no direction.

use std::f64::consts::TAU;

use nalgebra::Vector3;
use rayon::prelude::*;

use crate::error::{Error, Result, shown};
use crate::symmetry::axis::Axis;
use crate::symmetry::order::Order;
use crate::validate::positive;

/// Points in a unit of parallel work.
const CHUNK: usize = 2048;

/// Points of a completed surface, at most.
const MOST_POINTS: u64 = 50_000_000;

/// The completed part.
#[derive(Debug, Clone, Default)]
pub struct Completion {
    /// All sectors, in the frame of the surface.
    pub points: Vec<Vector3<f64>>,
    /// Sector that each point came from; 0: measured there.
    pub sectors: Vec<u32>,
    /// Share of the completed points that were measured.
    pub coverage: f64,
}

impl Completion {
    /// The same, its sectors counted about the axis in the opposite direction.
    #[must_use]
    pub fn reversed(mut self, order: Order) -> Self {
        if let Order::Cyclic(n) = order {
            self.sectors.iter_mut().for_each(|sector| *sector = (n - *sector) % n);
        }
        self
    }
}

/// One measured point in the polar grid: its cell in the folded sector, and its sector.
struct Celled {
    key: (i32, i32, u32),
    sector: u32,
    position: Vector3<f64>,
}

/// The polar grid of one ring of cells.
struct RingCells {
    sectors: u32,
    cells: u32,
}

impl RingCells {
    fn new(order: Order, ring: i32) -> Self {
        let circumference = TAU * (f64::from(ring) + 0.5);
        match order {
            Order::Cyclic(n) => {
                Self { sectors: n, cells: (circumference / f64::from(n)).round().max(1.0) as u32 }
            }
            Order::Continuous | Order::Auto => {
                Self { sectors: circumference.round().max(1.0) as u32, cells: 1 }
            }
        }
    }
}

/// Completes `points` about `axis` on a grid with edge `cell` \[length\]. Of a surface of revolution there are as many points
/// in a ring as such edges.
///
/// # Errors
/// [`Error::InvalidParameter`] for an order that is no symmetry, or a `cell` that is not positive and finite, or so small that
/// the whole would have more than fifty million points.
pub fn complete(points: &[Vector3<f64>], axis: &Axis, order: Order, cell: f64) -> Result<Completion> {
    let order = order.validate()?;
    positive("cell", cell)?;
    let surface_from_axis = axis.frame();
    let axis_from_surface = surface_from_axis.inverse();
    let mut folded: Vec<Celled> = points
        .par_iter()
        .with_min_len(CHUNK)
        .map(|point| {
            let p = axis_from_surface.rotation * (point - axis.point);
            let ring = (p.xy().norm_squared().sqrt() / cell) as i32;
            let grid = RingCells::new(order, ring);
            let turn = (p.y.atan2(p.x) / TAU).rem_euclid(1.0) * f64::from(grid.sectors);
            let sector = (turn as u32).min(grid.sectors - 1);
            let column = (((turn - f64::from(sector)) * f64::from(grid.cells)) as u32).min(grid.cells - 1);
            let back = -TAU * f64::from(sector) / f64::from(grid.sectors);
            Celled { key: ((p.z / cell).floor() as i32, ring, column), sector, position: turned(&p, back) }
        })
        .collect();
    folded.par_sort_by_key(|f| (f.key, f.sector));

    let cells = folded.chunk_by(|a, b| a.key == b.key);
    let whole: u64 = cells.map(|members| u64::from(RingCells::new(order, members[0].key.1).sectors)).sum();
    if whole > MOST_POINTS {
        let expected = "cells of which fifty million at most make up the whole surface";
        return Err(Error::InvalidParameter { name: "cell", value: shown(cell), expected });
    }
    let mut completion = Completion::default();
    let mut measured = 0usize;
    for members in folded.chunk_by(|a, b| a.key == b.key) {
        let ring = members[0].key.1;
        let grid = RingCells::new(order, ring);
        let mean = mean_position(members);
        let source = members
            .chunk_by(|a, b| a.sector == b.sector)
            .rev()
            .max_by_key(|same| same.len())
            .map_or(0, |same| same[0].sector);
        let mut groups = members.chunk_by(|a, b| a.sector == b.sector).peekable();
        for sector in 0..grid.sectors {
            let here = groups.next_if(|same| same[0].sector == sector);
            let angle = TAU * f64::from(sector) / f64::from(grid.sectors);
            let position = turned(&here.map_or(mean, mean_position), angle);
            completion.points.push((surface_from_axis * nalgebra::Point3::from(position)).coords);
            completion.sectors.push(match (here, order) {
                (Some(_), _) => 0,
                (None, Order::Cyclic(n)) => (sector + n - source) % n,
                (None, _) => 1,
            });
            measured += usize::from(here.is_some());
        }
    }
    completion.coverage = measured as f64 / completion.points.len().max(1) as f64;
    Ok(completion)
}

fn mean_position(members: &[Celled]) -> Vector3<f64> {
    members.iter().map(|f| f.position).sum::<Vector3<f64>>() / members.len() as f64
}

fn turned(p: &Vector3<f64>, angle: f64) -> Vector3<f64> {
    let (sin, cos) = angle.sin_cos();
    Vector3::new(cos * p.x - sin * p.y, sin * p.x + cos * p.y, p.z)
}

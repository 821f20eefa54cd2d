//! The measured points of all sectors turned into one, each with the area of the completed surface that it stands for.
//!
//! A surface is scanned densely here and sparsely there, so a mean over its points says little about the part. The area
//! of a point is the inverse of the density of all points folded onto its place, which is smooth: the pose moves as
//! little as the points do, and no grid line decides to which side a point counts.

use std::f64::consts::TAU;

use rayon::prelude::*;

use crate::symmetry::axis::Axis;
use crate::symmetry::order::Order;
use crate::symmetry::surface::Samples;

/// Cells from the axis to the rim, at most: more would only make the density rougher.
const RINGS: f64 = 128.0;

/// Points in a unit of parallel work.
const CHUNK: usize = 2048;

/// Integral of the square of the quadratic B-spline.
const MEAN_COVERED: f64 = 0.55;

/// Layers along the axis, at most; layers become thicker where a part is longer.
const LAYERS: f64 = 512.0;

/// A measured point in the axis frame.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct FoldedPoint {
    /// Distance from the axis \[length\].
    pub radius: f64,
    /// Angle about the axis from its first tangent, any of the equivalent ones \[rad\].
    pub angle: f64,
    /// Height above the point of the axis \[length\].
    pub height: f64,
    /// Component of the normal along the axis.
    pub slope: f64,
    /// Component of the normal away from the axis.
    pub radial: f64,
    /// Component of the normal around the axis, which no surface of revolution has.
    pub around: f64,
    /// Area of the completed surface that it stands for [squared length].
    pub area: f64,
    /// Area that it stands for in the outline of the part seen along the axis [squared length].
    pub outline: f64,
}

/// A part folded into one sector.
#[derive(Debug, Clone, Default)]
pub(crate) struct Folded {
    /// Each sample of the surface.
    pub points: Vec<FoldedPoint>,
    /// Width of the kernel with which the density was taken \[length\].
    pub cell: f64,
}

impl Folded {
    /// Area of the completed surface [squared length].
    #[must_use]
    pub(crate) fn area(&self) -> f64 {
        self.points.iter().map(|p| p.area).sum::<f64>().max(f64::MIN_POSITIVE)
    }

    /// Mean over the completed surface.
    pub(crate) fn mean(&self, value: impl Fn(&FoldedPoint) -> f64) -> f64 {
        self.points.iter().map(|p| p.area * value(p)).sum::<f64>() / self.area()
    }
}

/// Folds `samples` about `axis`; `spacing` is the typical distance between them \[length\].
#[must_use]
pub(crate) fn fold(samples: &Samples, axis: &Axis, order: Order, spacing: f64) -> Folded {
    let to_axis = axis.frame().rotation.inverse();
    let mut points: Vec<FoldedPoint> = samples
        .points
        .par_iter()
        .zip(&samples.normals)
        .with_min_len(CHUNK)
        .map(|(point, normal)| {
            let p = to_axis * (point - axis.point);
            let n = to_axis * normal;
            let radius = p.xy().norm_squared().sqrt();
            let outward = p.xy() / radius.max(f64::MIN_POSITIVE);
            FoldedPoint {
                radius,
                angle: p.y.atan2(p.x),
                height: p.z,
                slope: n.z,
                radial: n.xy().dot(&outward),
                around: outward.perp(&n.xy()),
                ..FoldedPoint::default()
            }
        })
        .collect();
    let rim = points.iter().fold(0.0_f64, |rim, p| rim.max(p.radius));
    let cell = spacing.max(rim / RINGS);
    if cell > 0.0 {
        let flat: Vec<FoldedPoint> = points
            .iter()
            .map(|p| FoldedPoint { height: 0.0, slope: 1.0, radial: 0.0, around: 0.0, ..*p })
            .collect();
        let (outlines, areas) = rayon::join(|| areas(&flat, order, cell), || areas(&points, order, cell));
        for (point, (area, outline)) in points.iter_mut().zip(areas.into_iter().zip(outlines)) {
            *point = FoldedPoint { area, outline, ..*point };
        }
    }
    Folded { points, cell }
}

/// Area of the completed surface for each point: the inverse of the density at its place.
fn areas(points: &[FoldedPoint], order: Order, cell: f64) -> Vec<f64> {
    let mut grid = PolarGrid::new(points, order, cell);
    points.iter().for_each(|point| grid.add(point));
    let measure = grid.sectors * cell * cell;
    points.par_iter().with_min_len(CHUNK).map(|point| measure / grid.density(point)).collect()
}

/// One ring of cells within a sector.
#[derive(Debug, Clone, Copy)]
struct Ring {
    /// First column among all.
    first: usize,
    columns: usize,
    /// Width of a column [cells].
    width: f64,
}

/// Density of folded points on cells of about equal size: rings about the axis, columns within a sector, layers along it.
struct PolarGrid {
    cell: f64,
    /// Height of a layer \[length\].
    layer: f64,
    /// Lowest point \[length\].
    bottom: f64,
    /// Sectors that lie on one another.
    sectors: f64,
    rings: Vec<Ring>,
    layers: usize,
    /// By column, then by layer.
    density: Vec<f64>,
}

impl PolarGrid {
    fn new(points: &[FoldedPoint], order: Order, cell: f64) -> Self {
        let rim = points.iter().fold(0.0_f64, |rim, p| rim.max(p.radius));
        let bottom = points.iter().fold(f64::INFINITY, |bottom, p| bottom.min(p.height));
        let top = points.iter().fold(f64::NEG_INFINITY, |top, p| top.max(p.height));
        let layer = cell.max((top - bottom) / LAYERS);
        let sectors = if let Order::Cyclic(n) = order { f64::from(n) } else { 1.0 };
        let mut columns = 0;
        let rings = (0..(rim / cell) as usize + 2)
            .map(|ring| {
                let arc = TAU * (ring as f64 + 0.5) / sectors;
                let here = match order {
                    Order::Cyclic(_) => arc.round().max(1.0) as usize,
                    // Every angle lies on every other.
                    Order::Continuous | Order::Auto => 1,
                };
                columns += here;
                Ring { first: columns - here, columns: here, width: arc / here as f64 }
            })
            .collect();
        let layers = ((top - bottom) / layer) as usize + 4;
        Self { cell, layer, bottom, sectors, rings, layers, density: vec![0.0; columns * layers] }
    }

    /// Calls `f` for the three layers of each column near a point: their cells, and the share of the point in each.
    #[inline]
    fn visit(&self, point: &FoldedPoint, mut f: impl FnMut(std::ops::Range<usize>, [f64; 3], f64)) {
        let (layer, layer_shares) = spline(self.layer_position(point));
        let (nearest, ring_shares) = spline(self.ring_position(point));
        let turn = (point.angle / TAU * self.sectors).rem_euclid(1.0);
        for (ring, ring_share) in (nearest - 1..).zip(ring_shares) {
            let ring = self.rings[(ring.max(0) as usize).min(self.rings.len() - 1)];
            let (column, column_shares) = spline(turn * ring.columns as f64 - 0.5);
            for (column, column_share) in (column - 1..).zip(column_shares) {
                let column = ring.first + column.rem_euclid(ring.columns as i64) as usize;
                let first = column * self.layers + (layer - 1) as usize;
                let share = ring_share * column_share;
                f(first..first + 3, layer_shares.map(|s| s * share), ring.width);
            }
        }
    }

    fn add(&mut self, point: &FoldedPoint) {
        let mut density = std::mem::take(&mut self.density);
        self.visit(point, |cells, shares, width| {
            density[cells].iter_mut().zip(shares).for_each(|(sum, share)| *sum += share / width);
        });
        self.density = density;
    }

    /// Points per squared cell of surface at a point that was added.
    ///
    /// How much of a plane the kernel covers depends on where the plane lies between the middles of the cells across it;
    /// that is divided out.
    fn density(&self, point: &FoldedPoint) -> f64 {
        let mut sum = 0.0;
        self.visit(point, |cells, shares, _| {
            sum +=
                self.density[cells].iter().zip(shares).map(|(density, share)| density * share).sum::<f64>();
        });
        let covered = |position: f64| spline(position).1.iter().map(|share| share * share).sum::<f64>();
        let (along, radial) = (point.slope.powi(2), point.radial.powi(2));
        let across = along * covered(self.layer_position(point))
            + radial * covered(self.ring_position(point))
            + (1.0 - along - radial) * MEAN_COVERED;
        sum / across
    }

    fn layer_position(&self, point: &FoldedPoint) -> f64 {
        (point.height - self.bottom) / self.layer + 1.0
    }

    fn ring_position(&self, point: &FoldedPoint) -> f64 {
        point.radius / self.cell - 0.5
    }
}

/// The cell whose middle is nearest, and the quadratic B-spline weights of the one before, of it and of the one after; for
/// positions from -0.5 on.
#[inline]
fn spline(position: f64) -> (i64, [f64; 3]) {
    // Cut off instead of rounded, which is a call of a function.
    let nearest = (position + 0.5) as i64;
    let t = position - nearest as f64;
    (nearest, [0.5 * (0.5 - t).powi(2), 0.75 - t * t, 0.5 * (0.5 + t).powi(2)])
}

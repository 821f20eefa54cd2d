//! The surface of a reference in four overlapping parts, by where it faces.
//!
//! A noisy point of a thin wall is often nearer to the other side of it. Looked up among the points that do not face away,
//! it finds its own side.

use nalgebra::Vector3;

use crate::symmetry::surface::{Gate, Samples, Surface};

/// Corners of a tetrahedron: every direction is within 70.5 degrees of one.
const CORNERS: [[f64; 3]; 4] = [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]];

/// Smallest cosine between the corner and the normals of its part: normals within 37 degrees of a direction nearest to
/// this corner are in, the opposite ones out.
const FACING: f64 = -0.3;

/// A surface that is looked up by point and normal.
#[derive(Debug)]
pub(super) struct SidedSurface {
    /// The whole surface.
    pub samples: Samples,
    /// Edge of a cell \[length\].
    pub spacing: f64,
    /// Root mean square distance of the points from the origin \[length\].
    pub radius: f64,
    parts: Vec<Option<Surface>>,
}

impl SidedSurface {
    /// Indexes the points for gates up to `widest_gate` \[length\]; normals without orientation leave one part.
    pub(super) fn new(samples: Samples, oriented: bool, spacing: f64, widest_gate: f64) -> Self {
        let facing = |corner: Option<[f64; 3]>| {
            let corner = corner.map_or_else(Vector3::zeros, |c| Vector3::from(c).normalize());
            let rows = samples.points.iter().zip(&samples.normals);
            let (points, normals) = rows.filter(|(_, n)| n.dot(&corner) > FACING).unzip();
            let samples = Samples { points, normals };
            (!samples.points.is_empty()).then(|| Surface::new(samples, oriented, spacing, widest_gate))
        };
        let parts =
            if oriented { CORNERS.iter().map(|c| facing(Some(*c))).collect() } else { vec![facing(None)] };
        let reach_sq = samples.points.iter().map(Vector3::norm_squared).sum::<f64>();
        let radius = (reach_sq / samples.points.len().max(1) as f64).sqrt();
        Self { samples, spacing, radius, parts }
    }

    /// Point and normal of the surface that a point with a normal meets within the gate.
    pub(super) fn matching(
        &self,
        point: &Vector3<f64>,
        normal: &Vector3<f64>,
        gate: Gate,
    ) -> Option<(&Vector3<f64>, &Vector3<f64>)> {
        let along = |i: &usize| CORNERS[*i].iter().zip(normal.iter()).map(|(c, n)| c * n).sum::<f64>();
        let nearest = (0..self.parts.len()).max_by(|a, b| along(a).total_cmp(&along(b)))?;
        let part = self.parts[nearest].as_ref()?;
        let met = part.matching(point, normal, gate)? as usize;
        Some((&part.samples.points[met], &part.samples.normals[met]))
    }
}

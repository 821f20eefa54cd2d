//! The measured surface that a symmetry is matched against: points, normals and a table of the nearest point, all in one frame.

use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

use crate::symmetry::field::NearestField;

/// Points with unit normals.
#[derive(Debug, Clone, Default)]
pub struct Samples {
    /// Measured positions \[length\].
    pub points: Vec<Vector3<f64>>,
    /// Unit normals.
    pub normals: Vec<Vector3<f64>>,
}

impl Samples {
    /// At most `count` of them at a regular stride; even over the surface when they are in spatial order.
    #[must_use]
    pub fn strided(&self, count: usize) -> Self {
        let taken = count.min(self.points.len());
        let index = |i: usize| i * self.points.len() / taken;
        Self {
            points: (0..taken).map(|i| self.points[index(i)]).collect(),
            normals: (0..taken).map(|i| self.normals[index(i)]).collect(),
        }
    }

    /// Each of them twice, one after the other.
    pub(crate) fn twice(&self) -> Self {
        let repeated = |all: &[Vector3<f64>]| all.iter().flat_map(|one| [*one; 2]).collect();
        Self { points: repeated(&self.points), normals: repeated(&self.normals) }
    }

    /// About `count` of them, chosen by their place and their number alone: where a point comes or goes, hardly any other
    /// changes. `cell` is the distance between them \[length\].
    #[must_use]
    pub fn scattered(&self, count: usize, cell: f64) -> Self {
        let share = count as f64 / self.points.len().max(1) as f64;
        if share >= 1.0 {
            return self.clone();
        }
        let limit = (share * u64::MAX as f64) as u64;
        let chosen: Vec<usize> =
            (0..self.points.len()).filter(|&i| scramble(&self.points[i], cell) < limit).collect();
        Self {
            points: chosen.iter().map(|&i| self.points[i]).collect(),
            normals: chosen.iter().map(|&i| self.normals[i]).collect(),
        }
    }
}

/// A number that looks random for each cell of a grid with edge `cell` (the finaliser of MurmurHash3, Appleby 2011).
fn scramble(point: &Vector3<f64>, cell: f64) -> u64 {
    point.iter().fold(0, |hash: u64, x| {
        let mixed = hash ^ (x / cell).floor() as i64 as u64;
        let mixed = (mixed ^ (mixed >> 33)).wrapping_mul(0xff51_afd7_ed55_8ccd);
        let mixed = (mixed ^ (mixed >> 33)).wrapping_mul(0xc4ce_b9fe_1a85_ec53);
        mixed ^ (mixed >> 33)
    })
}

/// Points and normals side by side in single precision: what a lookup touches fits in half a cache line.
#[derive(Debug, Clone, Copy)]
struct Packed {
    point: [f32; 3],
    normal: [f32; 3],
    // A power of two.
    _padding: [f32; 2],
}

/// The measured surface; its tables of nearest points are made once and queries are rotated into it.
#[derive(Debug)]
pub struct Surface {
    /// The measured points, in spatial order.
    pub(crate) samples: Samples,
    /// Whether normals point toward the sensor, or all of them away from it where one view is assumed; otherwise their sign
    /// means nothing.
    pub(crate) oriented: bool,
    /// The place from which one view is assumed to have seen all of it \[length\], where no viewpoint is given.
    pub(crate) assumed_view: Option<Vector3<f64>>,
    /// Typical distance between neighbouring points \[length\].
    pub(crate) spacing: f64,
    /// Mean of the points \[length\].
    pub(crate) centroid: Vector3<f64>,
    /// Root mean square distance of the points from it \[length\].
    pub(crate) radius: f64,
    /// Mean height of the surface around each point over that point, along its normal \[length\]; empty where it is not
    /// known, so that every point stands for itself.
    pub(crate) heights: Vec<f64>,
    /// The first one stands for no point and is infinitely far.
    packed: Vec<Packed>,
    /// Tables from fine to coarse, each with the largest gate that it serves \[length\].
    fields: Vec<(f64, NearestField)>,
}

impl Surface {
    /// Indexes the points; there must be at least one, and all must be finite.
    ///
    /// `spacing` is the edge of the voxels that they come from, `widest_gate` the largest distance at which a match will
    /// be asked for \[length\].
    #[must_use]
    pub fn new(samples: Samples, oriented: bool, spacing: f64, widest_gate: f64) -> Self {
        let [near, far] = [3.0 * spacing, 12.0 * spacing];
        // Each table is about as coarse as its gate is wide: what is far need not be known to a hair.
        let mut tables = vec![(near, spacing), (far, 3.0 * spacing)];
        if widest_gate > far {
            tables.push((widest_gate, 0.25 * widest_gate));
        }
        let table = |(gate, cell): (f64, f64)| (gate, NearestField::new(&samples.points, cell, gate));
        let pack = |(p, n): (&Vector3<f64>, &Vector3<f64>)| Packed {
            point: p.map(|x| x as f32).into(),
            normal: n.map(|x| x as f32).into(),
            _padding: [0.0; 2],
        };
        let nowhere = Packed { point: [f32::INFINITY; 3], normal: [0.0; 3], _padding: [0.0; 2] };
        let packed = || {
            std::iter::once(nowhere).chain(samples.points.iter().zip(&samples.normals).map(pack)).collect()
        };
        let (fields, packed) =
            rayon::join(|| tables.into_par_iter().with_max_len(1).map(table).collect(), packed);
        let count = samples.points.len() as f64;
        let centroid = samples.points.iter().sum::<Vector3<f64>>() / count;
        let spread: f64 = samples.points.iter().map(|p| (p - centroid).norm_squared()).sum();
        let radius = (spread / count).sqrt();
        Self {
            samples,
            oriented,
            assumed_view: None,
            spacing,
            centroid,
            radius,
            heights: Vec::new(),
            packed,
            fields,
        }
    }

    /// The measured points, in spatial order.
    #[must_use]
    pub fn samples(&self) -> &Samples {
        &self.samples
    }

    /// Root mean square distance of the points from their mean \[length\].
    #[must_use]
    pub fn radius(&self) -> f64 {
        self.radius
    }

    /// Number of points.
    #[must_use]
    pub fn len(&self) -> usize {
        self.samples.points.len()
    }

    /// Whether all of it lies in one plane, but for a hundredth of its extent.
    #[must_use]
    pub fn is_flat(&self) -> bool {
        /// Standard deviation across the plane [that along it].
        const FLAT: f64 = 0.01;
        let arms = self.samples.points.iter().map(|p| p - self.centroid);
        let scatter: Matrix3<f64> = arms.map(|arm| arm * arm.transpose()).sum();
        let variances = scatter.symmetric_eigenvalues();
        variances.min() < FLAT * FLAT * variances.max()
    }

    /// Always false.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.samples.points.is_empty()
    }

    /// Whether the view that is assumed could not have seen a surface at `point` that faces along `normal`: whether it looked
    /// from in front or, mirrored, from behind, what is turned away from it was out of sight.
    #[must_use]
    pub fn is_turned_away(&self, point: &Vector3<f64>, normal: &Vector3<f64>) -> bool {
        self.assumed_view.is_some_and(|place| normal.dot(&(place - point)) < 0.0)
    }

    /// Distance of `point` from the plane of the measured point `index`, to the side of its normal \[length\].
    #[must_use]
    #[inline]
    pub fn height_over(&self, index: u32, point: &Vector3<f64>) -> f64 {
        let Samples { points, normals } = &self.samples;
        normals[index as usize].dot(&(point - points[index as usize]))
    }

    /// Place of the measured point `index` on the mean surface around it \[length\].
    #[must_use]
    #[inline]
    pub fn smoothed(&self, index: usize) -> Vector3<f64> {
        let Samples { points, normals } = &self.samples;
        self.heights.get(index).map_or(points[index], |height| points[index] + normals[index] * *height)
    }

    /// The nearest measured point within the gate whose normal agrees with `normal`; `None` where there is none.
    ///
    /// Of points at nearly the same distance another one than the nearest may be found.
    #[must_use]
    #[inline]
    pub fn matching(&self, point: &Vector3<f64>, normal: &Vector3<f64>, gate: Gate) -> Option<u32> {
        let (_, field) =
            self.fields.iter().find(|(reach, _)| gate.distance <= *reach).or(self.fields.last())?;
        let query: [f32; 3] = point.map(|x| x as f32).into();
        let normal: [f32; 3] = normal.map(|x| x as f32).into();
        // Neighbouring cells mostly know the same point; looking at it again costs less than finding that out. Distance and
        // index as one number: the bits of a float that is not negative are in order.
        let nearest = field.around(point)?.map(|slot| {
            let known = &self.packed[slot as usize];
            let distance_sq = (0..3).map(|i| (known.point[i] - query[i]).powi(2)).sum::<f32>();
            u64::from(distance_sq.to_bits()) << 32 | u64::from(slot)
        });
        let best = nearest.into_iter().min()?;
        let (distance_sq, slot) = (f32::from_bits((best >> 32) as u32), best as u32);
        if f64::from(distance_sq) >= gate.distance * gate.distance {
            return None;
        }
        let found = &self.packed[slot as usize];
        let cosine = (0..3).map(|i| found.normal[i] * normal[i]).sum::<f32>();
        let agreement = if self.oriented { cosine } else { cosine.abs() };
        (agreement >= gate.cosine as f32).then(|| slot - 1)
    }
}

/// What two points may differ in and still be taken for the same place of the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gate {
    /// Largest distance \[length\].
    pub distance: f64,
    /// Smallest cosine between the normals.
    pub cosine: f64,
    /// Largest distance off the plane of the other point \[length\]; it counts where a match is judged, not where an axis
    /// is still on its way.
    pub off_plane: f64,
}

impl Gate {
    /// A gate that asks for no distance off the plane.
    #[must_use]
    pub fn new(distance: f64, cosine: f64) -> Self {
        Self { distance, cosine, off_plane: f64::INFINITY }
    }
}

//! The measured surface that a symmetry is matched against: points, normals and a tree, all in one frame.

use nalgebra::Vector3;
use rayon::prelude::*;

use crate::error::Result;
use crate::spatial::KdTree;

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
}

/// The measured surface; the tree is built once and queries are rotated into it.
#[derive(Debug)]
pub struct Surface {
    /// The measured points, in spatial order.
    pub samples: Samples,
    /// Whether normals point toward the sensor; otherwise their sign means nothing.
    pub oriented: bool,
    /// Typical distance between neighbouring points \[length\].
    pub spacing: f64,
    tree: KdTree,
}

impl Surface {
    /// Indexes the points.
    ///
    /// # Errors
    /// Those of [`KdTree::new`].
    pub fn new(samples: Samples, oriented: bool, spacing: f64) -> Result<Self> {
        let rows: Vec<[f64; 3]> = samples.points.iter().map(|p| (*p).into()).collect();
        let tree = KdTree::new(&rows)?;
        Ok(Self { samples, oriented, spacing, tree })
    }

    /// Number of points.
    #[must_use]
    pub fn len(&self) -> usize {
        self.samples.points.len()
    }

    /// Always false.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.samples.points.is_empty()
    }

    /// Mean of the points \[length\].
    #[must_use]
    pub fn centroid(&self) -> Vector3<f64> {
        let sums: Vec<Vector3<f64>> = self.samples.points.par_chunks(4096).map(|c| c.iter().sum()).collect();
        sums.iter().sum::<Vector3<f64>>() / self.len() as f64
    }

    /// The nearest measured point within `gate` whose normal agrees with `normal` to within an angle of the given
    /// cosine; `None` where there is none.
    #[must_use]
    pub fn matching(&self, point: &Vector3<f64>, normal: &Vector3<f64>, gate: Gate) -> Option<u32> {
        let found = self.tree.nearest_within(&(*point).into(), gate.distance)?;
        let cosine = self.samples.normals[found.index as usize].dot(normal);
        let agreement = if self.oriented { cosine } else { cosine.abs() };
        (agreement >= gate.cosine).then_some(found.index)
    }

    /// The tree over the points.
    #[must_use]
    pub fn tree(&self) -> &KdTree {
        &self.tree
    }
}

/// What two points may differ in and still be taken for the same place of the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gate {
    /// Largest distance \[length\].
    pub distance: f64,
    /// Smallest cosine between the normals.
    pub cosine: f64,
}

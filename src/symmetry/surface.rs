//! The measured surface that a symmetry is matched against: points, normals and a tree, all in one frame.

use nalgebra::Vector3;
use rayon::prelude::*;

use crate::error::Result;
use crate::spatial::KdTree;

/// Points of a surface with unit normals; the tree is built once and queries are rotated into it.
#[derive(Debug)]
pub struct Surface {
    /// Measured positions [length].
    pub points: Vec<Vector3<f64>>,
    /// Unit normals.
    pub normals: Vec<Vector3<f64>>,
    /// Whether normals point toward the sensor; otherwise their sign means nothing.
    pub oriented: bool,
    /// Typical distance between neighbouring points [length].
    pub spacing: f64,
    tree: KdTree,
}

impl Surface {
    /// Indexes the points.
    ///
    /// # Errors
    /// Those of [`KdTree::new`].
    pub fn new(
        points: Vec<Vector3<f64>>,
        normals: Vec<Vector3<f64>>,
        oriented: bool,
        spacing: f64,
    ) -> Result<Self> {
        let rows: Vec<[f64; 3]> = points.iter().map(|p| (*p).into()).collect();
        let tree = KdTree::new(&rows)?;
        Ok(Self { points, normals, oriented, spacing, tree })
    }

    /// Number of points.
    #[must_use]
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Always false.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// Mean of the points [length].
    #[must_use]
    pub fn centroid(&self) -> Vector3<f64> {
        let sums: Vec<Vector3<f64>> = self.points.par_chunks(4096).map(|c| c.iter().sum()).collect();
        sums.iter().sum::<Vector3<f64>>() / self.len() as f64
    }

    /// The nearest measured point within `gate` whose normal agrees with `normal` to within an angle of the given
    /// cosine; `None` where there is none.
    #[must_use]
    pub fn matching(&self, point: &Vector3<f64>, normal: &Vector3<f64>, gate: Gate) -> Option<u32> {
        let found = self.tree.nearest_within(&(*point).into(), gate.distance)?;
        let cosine = self.normals[found.index as usize].dot(normal);
        let agreement = if self.oriented { cosine } else { cosine.abs() };
        (agreement >= gate.cosine).then_some(found.index)
    }

    /// The tree over [`Surface::points`].
    #[must_use]
    pub fn tree(&self) -> &KdTree {
        &self.tree
    }
}

/// What two points may differ in and still be taken for the same place of the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gate {
    /// Largest distance [length].
    pub distance: f64,
    /// Smallest cosine between the normals.
    pub cosine: f64,
}

//! From a raw cloud to a clean, even one: support plane, voxel grid, outlier filters, clusters, normals.
//!
//! Every function gives the same bytes at any number of threads. Those that take a raw cloud work alone and check it; what
//! goes on with the result of another (`separate_sides`, `mean_heights`) relies on it.
//!
//! ```
//! use sympose::preprocess::{voxel_downsample, remove_radius_outliers, RadiusParams};
//! let points: Vec<[f64; 3]> = (0..100).map(|i| [0.001 * f64::from(i), 0.0, 0.0]).collect();
//! let grid = voxel_downsample(&points, 0.01)?;
//! let kept = remove_radius_outliers(&grid.points, &RadiusParams { radius: 0.02, min_neighbors: 2 })?;
//! assert!(kept.len() <= grid.points.len());
//! # Ok::<(), sympose::Error>(())
//! ```

mod block;
mod cells;
mod cluster;
mod company;
mod disjoint_sets;
mod eigen;
mod fields;
mod flatness;
mod grid;
mod ground;
mod layers;
mod moments;
mod neighbors;
mod normals;
pub(crate) mod outline;
mod plane;
mod radius;
mod rays;
mod scanlines;
mod search;
mod selection;
mod sensor;
mod sides;
mod smooth;
mod statistical;
mod support;
mod viewpoint;
mod voxel;

use rayon::prelude::*;

use crate::error::{Error, Result};

pub use cluster::{ClusterParams, Clusters, main_cluster};
pub(crate) use disjoint_sets::DisjointSets;
pub(crate) use grid::sure_cell;
pub(crate) use ground::find_support;
pub use ground::{Ground, GroundParams, find_ground};
pub use layers::{Layers, voxel_layers};
pub use neighbors::{KNeighbors, median_spacing};
pub use normals::{NormalParams, Normals, estimate_normals, normals_from_neighbors, orient_normals};
pub use plane::{Plane, PlaneParams, segment_plane};
pub use radius::{RadiusParams, remove_radius_outliers};
pub use rays::{noise_along_rays, smooth_along_rays};
pub use scanlines::{SensorPlaces, viewpoints_from_order};
pub use sides::{Sides, separate_sides};
pub use smooth::{SmoothingParams, enough_neighbors, mean_heights};
pub use statistical::{StatisticalParams, remove_statistical_outliers, statistical_inliers};
pub(crate) use support::Support;
pub use viewpoint::single_viewpoint;
pub use voxel::{VoxelGrid, voxel_downsample};
pub(crate) use voxel::{means, occupied_voxels};

/// Points that one task handles; fixed, so that sums do not depend on the number of threads.
pub(crate) const CHUNK: usize = 4096;

/// Fails unless every coordinate is finite.
pub(crate) fn check_finite(points: &[[f64; 3]]) -> Result<()> {
    // A finite number times 0 is 0, infinity and NaN give NaN: one comparison decides for a whole chunk. (A sum of
    // finite coordinates can overflow; then the exact count says that all is well.)
    let suspect = |chunk: &[[f64; 3]]| chunk.iter().map(|p| (p[0] + p[1] + p[2]) * 0.0).sum::<f64>() != 0.0;
    if !points.par_chunks(CHUNK).any(suspect) {
        return Ok(());
    }
    let count = points.iter().filter(|p| p.iter().any(|x| !x.is_finite())).count();
    if count == 0 {
        return Ok(());
    }
    Err(Error::NonFinite { count, total: points.len() })
}

/// Fails where no neighbour is asked for.
fn at_least_one(k: usize) -> Result<()> {
    if k > 0 {
        return Ok(());
    }
    Err(Error::InvalidParameter { name: "k", value: "0".into(), expected: "at least 1 neighbour" })
}

/// Lower and upper corner of the bounding box, zero for no points; fails unless every coordinate is finite.
pub(crate) fn finite_bounds(points: &[[f64; 3]]) -> Result<[[f64; 3]; 2]> {
    let empty = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
    let join = |a: [[f64; 3]; 2], b: [[f64; 3]; 2]| {
        let less = |x: f64, y: f64| if x < y { x } else { y };
        let more = |x: f64, y: f64| if x > y { x } else { y };
        [std::array::from_fn(|i| less(b[0][i], a[0][i])), std::array::from_fn(|i| more(b[1][i], a[1][i]))]
    };
    // Both in one pass. A comparison with NaN is false, so that a bound steps over it, but the sum does not.
    let chunk = |chunk: &[[f64; 3]]| {
        let start = (empty, 0.0);
        chunk.iter().fold(start, |(b, sum), p| (join(b, [*p, *p]), sum + (p[0] + p[1] + p[2]) * 0.0))
    };
    let both = |a: ([[f64; 3]; 2], f64), b: ([[f64; 3]; 2], f64)| (join(a.0, b.0), a.1 + b.1);
    let (bounds, sum) = points.par_chunks(CHUNK).map(chunk).reduce(|| (empty, 0.0), both);
    if sum != 0.0 {
        check_finite(points)?;
    }
    Ok(if points.is_empty() { [[0.0; 3]; 2] } else { bounds })
}

//! Euclidean clusters, linear in the number of points.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::CHUNK;
use super::disjoint_sets::DisjointSets;
use super::grid::Grid;
use crate::error::{Error, Result, shown};

/// Settings of [`main_cluster`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ClusterParams {
    /// Points up to this far apart always belong together \[length\].
    pub distance: f64,
    /// Further clusters are kept when they have at least this share of the points of the largest, in [0, 1].
    pub keep_ratio: f64,
}

impl Default for ClusterParams {
    /// A distance of 1, which only fits a cloud of about that spacing: set it.
    fn default() -> Self {
        Self { distance: 1.0, keep_ratio: 0.1 }
    }
}

/// A cloud divided into connected pieces.
#[derive(Debug, Clone, PartialEq)]
pub struct Clusters {
    /// For each point its cluster; cluster 0 is the largest, equal sizes in order of their first point.
    pub labels: Vec<u32>,
    /// Number of points of each cluster, descending.
    pub sizes: Vec<usize>,
    /// Points of the largest cluster and of those that are kept with it, ascending.
    pub kept: Vec<u32>,
}

/// Divides a cloud into Euclidean clusters and keeps the main one with its larger companions.
///
/// Points are joined through the occupied cells of a grid of edge `distance` and their 26 neighbours. Two points up
/// to `distance` apart are always joined, two points more than `2 sqrt(3) distance` apart never directly; in between
/// it depends on the grid.
///
/// ```
/// use sympose::preprocess::{ClusterParams, main_cluster};
/// let row = |at: f64, count: u32| (0..count).map(move |i| [at + 0.1 * f64::from(i), 0.0, 0.0]);
/// let points: Vec<[f64; 3]> = row(0.0, 3).chain(row(100.0, 20)).collect();
/// let clusters = main_cluster(&points, &ClusterParams { distance: 1.0, keep_ratio: 0.5 })?;
/// assert_eq!(clusters.sizes, [20, 3]);
/// assert_eq!(clusters.kept, (3..23).collect::<Vec<u32>>());
/// # Ok::<(), sympose::Error>(())
/// ```
///
/// # Errors
/// [`Error::NonFinite`]; [`Error::InvalidParameter`] when `distance` is not positive or too small for the extent (see
/// [`voxel_downsample`](super::voxel_downsample)), or `keep_ratio` lies outside [0, 1].
pub fn main_cluster(points: &[[f64; 3]], params: &ClusterParams) -> Result<Clusters> {
    if !(0.0..=1.0).contains(&params.keep_ratio) {
        return Err(Error::InvalidParameter {
            name: "keep_ratio",
            value: shown(params.keep_ratio),
            expected: "a share in [0, 1]",
        });
    }
    let grid = Grid::new(points, params.distance, "distance")?;
    let roots = connect(points, &grid);

    let mut size_of_root = vec![0_usize; grid.len];
    let mut order = Vec::new();
    for &cell in &grid.cell_of {
        let root = roots[cell as usize] as usize;
        if size_of_root[root] == 0 {
            order.push(root);
        }
        size_of_root[root] += 1;
    }
    // Stable: equal sizes stay in order of their first point.
    order.sort_by_key(|&root| std::cmp::Reverse(size_of_root[root]));
    let sizes: Vec<usize> = order.iter().map(|&root| size_of_root[root]).collect();
    let mut label_of_root = vec![0_u32; grid.len];
    for (label, &root) in (0..).zip(&order) {
        label_of_root[root] = label;
    }
    let labels: Vec<u32> =
        grid.cell_of.iter().map(|&cell| label_of_root[roots[cell as usize] as usize]).collect();

    let least = sizes.first().map_or(0.0, |&largest| params.keep_ratio * largest as f64);
    let kept_labels =
        sizes.iter().enumerate().take_while(|&(label, &size)| label == 0 || size as f64 >= least).count();
    let kept = (0_u32..)
        .zip(&labels)
        .filter(|&(_, &label)| (label as usize) < kept_labels)
        .map(|(i, _)| i)
        .collect();
    Ok(Clusters { labels, sizes, kept })
}

/// For each cell the representative of its connected component.
fn connect(points: &[[f64; 3]], grid: &Grid) -> Vec<u32> {
    let mut some_point = vec![0_u32; grid.len];
    for (point, &cell) in (0_u32..).zip(&grid.cell_of) {
        some_point[cell as usize] = point;
    }
    // Half of the 26 neighbours suffices: the relation is symmetric.
    let half: Vec<[i64; 3]> =
        (0..27_i64).map(|i| [i / 9 - 1, i / 3 % 3 - 1, i % 3 - 1]).filter(|d| *d > [0; 3]).collect();
    let links: Vec<Vec<[u32; 2]>> = some_point
        .par_chunks(CHUNK)
        .enumerate()
        .map(|(chunk, representatives)| {
            let mut links = Vec::with_capacity(4 * representatives.len());
            for (cell, &point) in ((chunk * CHUNK) as u32..).zip(representatives) {
                let [x, y, z] = grid.indices(&points[point as usize]);
                links.extend(
                    half.iter()
                        .filter_map(|d| grid.find([x + d[0], y + d[1], z + d[2]]))
                        .map(|other| [cell, other]),
                );
            }
            links
        })
        .collect();
    let mut pieces = DisjointSets::new(grid.len);
    links.into_iter().flatten().for_each(|[a, b]| pieces.join(a, b));
    (0..grid.len as u32).map(|cell| pieces.least(cell)).collect()
}

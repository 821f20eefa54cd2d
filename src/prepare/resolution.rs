//! How finely a part is looked at: its size, and the edge of a voxel that suits it.

use nalgebra::Vector3;
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::median::median;
use crate::preprocess::{KNeighbors, median_spacing, occupied_voxels, voxel_downsample};
use crate::spatial::KdTree;

/// Largest extent over thirteen directions, without the outermost half percent at either end \[length\].
pub(super) fn width(points: &[[f64; 3]]) -> f64 {
    const TRIMMED: f64 = 0.005;
    /// More points than this do not make the quantiles better.
    const LOOKED_AT: usize = 20_000;
    let step = points.len().div_ceil(LOOKED_AT);
    (0..13)
        .into_par_iter()
        .map(|i| {
            let d = Vector3::new(f64::from(i % 3), f64::from(i / 3 % 3), f64::from(i / 9));
            let d = d.add_scalar(-1.0).normalize();
            let mut along: Vec<f64> =
                points.iter().step_by(step).map(|p| d.dot(&Vector3::from(*p))).collect();
            let last = along.len() - 1;
            let low = (TRIMMED * last as f64) as usize;
            let lower = *along.select_nth_unstable_by(low, f64::total_cmp).1;
            *along.select_nth_unstable_by(last - low, f64::total_cmp).1 - lower
        })
        .reduce(|| 0.0, f64::max)
}

/// Voxels across the diameter, and the fewest of a surface; where there are fewer, up to half the size is taken.
#[derive(Clone, Copy)]
pub(super) struct Resolution {
    per_diameter: f64,
    least: f64,
}

impl Resolution {
    /// The same with voxels `times` as large.
    pub(super) fn coarser(self, times: f64) -> Self {
        Self { per_diameter: self.per_diameter / times, least: self.least / times.powi(2) }
    }
}

/// Where the layers of a surface are joined.
pub(super) const LAYERED: Resolution = Resolution { per_diameter: 165.0, least: 20_000.0 };

/// Where they are not.
pub(super) const COARSE: Resolution = Resolution { per_diameter: 200.0, least: 0.0 };

/// The same where both sides of a blade thinner than a voxel would fall into one mean, since without viewpoints nothing
/// tells them apart.
pub(super) const FINE: Resolution = Resolution { per_diameter: 280.0, least: 0.0 };

/// A voxel's share of the diameter, or the spacing of the points where they are sparser.
pub(super) fn default_voxel(points: &[[f64; 3]], diameter: f64, resolution: Resolution) -> Result<f64> {
    /// The size is not reduced further than to this share.
    const FINEST: f64 = 0.5;
    /// Least size \[spacings of the points\].
    const SPARSEST: f64 = 1.2;
    /// Points from which the spacing is known well enough.
    const LOOKED_AT: usize = 200_000;
    /// Points of a quicker look before that: where most of these have another one near enough, the spacing need not be known.
    const GLANCED_AT: usize = 50_000;
    let every = |step: usize| -> Vec<[f64; 3]> { points.iter().step_by(step).copied().collect() };
    let step = points.len().div_ceil(LOOKED_AT);
    let sample = every(step);
    let Resolution { per_diameter, least } = resolution;
    let mut size = diameter / per_diameter;
    if least > 0.0 && size > 0.0 {
        let voxels = occupied_voxels(&sample, size)? as f64;
        size *= (voxels / least).sqrt().clamp(FINEST, 1.0);
    }
    let wide = points.len().div_ceil(GLANCED_AT);
    if size > 0.0 && mostly_within(&every(wide), (wide as f64).sqrt() * size / SPARSEST) {
        return Ok(size);
    }
    let spacing = median_spacing(&KdTree::new(&sample)?, &sample) / (step as f64).sqrt();
    let size = size.max(SPARSEST * spacing);
    if size > 0.0 { Ok(size) } else { Err(Error::Degenerate { shape: "identical" }) }
}

/// How far from each other the points of a surface lie, at least 1 [their distance where every voxel of it has one].
///
/// Where several sparse views fall on one another at random, points lie close together here and far apart there, and the
/// nearest neighbours alone do not show it.
pub(super) fn sparseness(neighbors: &KNeighbors, voxel_size: f64) -> f64 {
    /// Neighbour up to which the points are counted.
    const COUNTED: usize = 6;
    /// Area of a point where every voxel of a surface has one, as its square root \[voxels\].
    const FULL: f64 = 1.15;
    const LOOKED_AT: usize = 10_000;
    let step = neighbors.len().div_ceil(LOOKED_AT).max(1);
    let reach_sq = |i| neighbors.of(i).1.get(COUNTED).copied();
    let mut reaches_sq: Vec<f64> = (0..neighbors.len()).step_by(step).filter_map(reach_sq).collect();
    let Some(typical_sq) = median(&mut reaches_sq) else { return 1.0 };
    let area = std::f64::consts::PI * typical_sq / COUNTED as f64;
    (area.sqrt() / (FULL * voxel_size)).max(1.0)
}

/// Whether most points surely have another one, not at the same place, within `distance`: such as share a cell of that
/// diagonal. It takes less than the tree that would know it of each.
fn mostly_within(points: &[[f64; 3]], distance: f64) -> bool {
    let edge = distance / f64::sqrt(3.0);
    let Ok(cells) = voxel_downsample(points, edge) else { return false };
    // Of points at one place the mean is there, too.
    let off_mean =
        |p: &[f64; 3], mean: &[f64; 3]| p.iter().zip(mean).any(|(x, mean)| (x - mean).abs() > 1e-9 * edge);
    let rows = points.iter().zip(&cells.inverse);
    2 * rows.filter(|(p, cell)| off_mean(p, &cells.points[**cell as usize])).count() > points.len()
}

#[cfg(test)]
mod tests {
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{Rng, SeedableRng};

    use super::*;

    /// That of `count` points at random on a square of 50 x 50 voxels.
    fn sparseness_of(count: u32) -> Result<f64> {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let mut coordinate = || 50.0 * f64::from(random.next_u32()) / f64::from(u32::MAX);
        let points: Vec<[f64; 3]> = (0..count).map(|_| [coordinate(), coordinate(), 0.0]).collect();
        let voxels = voxel_downsample(&points, 1.0)?.points;
        let tree = KdTree::new(&voxels)?;
        Ok(sparseness(&KNeighbors::new(&tree, &voxels, 12)?, 1.0))
    }

    #[test]
    fn voxels_that_stay_empty_make_a_surface_sparse() -> Result<()> {
        let full = sparseness_of(20_000)?;
        assert!(full < 1.01, "{full}");
        // A third of the voxels have a point: 1.7 times as far from each other.
        let third = sparseness_of(1_000)?;
        assert!((1.4..1.8).contains(&third), "{third}");
        Ok(())
    }
}

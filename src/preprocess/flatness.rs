//! Whether a sheet of points is a plane with noise on it, or the twisted blades of a propeller between two planes.

use nalgebra::Vector3;

use super::grid::Grid;
use super::moments::Moments;
use crate::error::Result;

/// Points of a patch that show how far they lie from a plane of its own.
const ENOUGH: f64 = 10.0;

/// How far a sheet is from its plane but for noise \[length\]: the root mean square of the distances that are gone where
/// every patch of it has a plane of its own.
///
/// Points are given by two coordinates in the plane and their height over it \[length\]; `patch` is the edge of a patch.
pub(super) fn unevenness(sheet: &[[f64; 3]], patch: f64) -> Result<f64> {
    let flat: Vec<[f64; 3]> = sheet.iter().map(|[x, y, _]| [*x, *y, 0.0]).collect();
    let grid = Grid::new(&flat, patch, "patch")?;
    let mut patches = vec![Moments::default(); grid.len];
    let origin = sheet.first().map_or_else(Vector3::zeros, |[x, y, _]| Vector3::new(*x, *y, 0.0));
    for (point, &patch) in sheet.iter().zip(&grid.cell_of) {
        patches[patch as usize].add((Vector3::from(*point) - origin).into());
    }
    let (mut about_all, mut about_own, mut count) = (0.0, 0.0, 0.0);
    for moments in patches.iter().filter(|moments| moments.count >= ENOUGH) {
        let scatter = moments.scatter();
        let (in_plane, with_height) = (scatter.fixed_view::<2, 2>(0, 0), scatter.fixed_view::<2, 1>(0, 2));
        // Points in a row have no plane.
        let Some(slope) = in_plane.cholesky().map(|in_plane| in_plane.solve(&with_height)) else { continue };
        let about_plane = scatter.m33 - slope.dot(&with_height);
        // Three numbers of the plane were fitted to the points.
        about_own += about_plane.max(0.0) * moments.count / (moments.count - 3.0);
        about_all += scatter.m33 + moments.sum().z.powi(2) / moments.count;
        count += moments.count;
    }
    Ok(((about_all - about_own).max(0.0) / f64::max(count, 1.0)).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sheet with waves of some amplitude and noise of zero mean.
    fn sheet(amplitude: f64, noise: f64) -> Vec<[f64; 3]> {
        let mut state = 1_u64;
        (0..10_000)
            .map(|i| {
                let [x, y] = [0.02 * f64::from(i % 100), 0.02 * f64::from(i / 100)];
                // Knuth's linear congruential generator.
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                let uniform = (state >> 33) as f64 / f64::from(1_u32 << 31);
                [x, y, amplitude * (4.0 * x).sin() + noise * (uniform - 0.5) * 12_f64.sqrt()]
            })
            .collect()
    }

    #[test]
    fn noise_is_flat_and_waves_are_not() -> Result<()> {
        let noisy = unevenness(&sheet(0.0, 0.02), 0.3)?;
        assert!(noisy < 0.002, "{noisy}");
        assert_eq!(unevenness(&sheet(0.0, 0.0), 0.3)?, 0.0);
        assert!(unevenness(&[], 0.3).is_ok_and(|none| none == 0.0));
        for noise in [0.0, 0.01] {
            let wavy = unevenness(&sheet(0.03, noise), 0.3)?;
            // The mean square of a sine is one half; a patch is not quite straight.
            assert!((wavy - 0.03 * 0.5_f64.sqrt()).abs() < 0.001, "{wavy}");
        }
        Ok(())
    }
}

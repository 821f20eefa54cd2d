//! The support plane under a part: found, told apart from the part's own flat faces, and removed.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::check_finite;
use super::plane::{HalfSpace, PlaneParams, segment_plane};
use crate::config::GroundMode;
use crate::error::Result;

/// Settings of [`find_ground`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GroundParams {
    /// Distance at which a plane is first looked for [share of the extent of the scene].
    pub rough_distance: f64,
    /// Half width of the band that is removed [standard deviations of the noise of the plane].
    pub band: f64,
    /// Share of the rest of the scene that must lie on one side of a support.
    pub one_sided: f64,
    /// How far a support must reach beyond the rest [radii of the footprint of the rest].
    pub reach: f64,
    /// Planes that are looked at, one after the other \[count\].
    pub max_planes: usize,
    /// Seed of the samples.
    pub seed: u64,
}

impl Default for GroundParams {
    fn default() -> Self {
        Self { rough_distance: 0.01, band: 3.5, one_sided: 0.99, reach: 2.0, max_planes: 3, seed: 0 }
    }
}

/// A support plane that was removed.
#[derive(Debug, Clone, PartialEq)]
pub struct Ground {
    /// Unit normal n toward the part, and d, with n . x + d = 0.
    pub plane: [f64; 4],
    /// Points that remain as candidates for the part, ascending.
    pub kept: Vec<u32>,
    /// Number of points removed.
    pub removed: usize,
    /// Why the plane was taken for a support.
    pub reason: String,
}

/// Fewest points that can stand on a support.
const MIN_REST: usize = 50;

/// A sheet reaches at least this share of its largest reach in three quarters of the directions; blades do not.
const EVEN_REACH: f64 = 0.05;

/// Whether the points of the plane were measured from the side of the part: nobody sees a table from below, but the far
/// face of a flat part is seen from its own outer side.
fn seen_from_above(
    points: &[[f64; 3]],
    viewpoint_of: &(impl Fn(usize) -> Option<[f64; 3]> + Sync),
    plane: &HalfSpace,
    band: f64,
) -> bool {
    const NEARLY_ALL: f64 = 0.9;
    let on_plane = (0..points.len()).filter(|&i| plane.distance(&points[i]).abs() <= band);
    let sensors = on_plane.filter_map(viewpoint_of).fold((0usize, 0usize), |(above, all), viewpoint| {
        (above + usize::from(plane.distance(&viewpoint) > 0.0), all + 1)
    });
    sensors.1 == 0 || sensors.0 as f64 >= NEARLY_ALL * sensors.1 as f64
}

/// Angular sectors in which the reach of a plane is judged.
const SECTORS: usize = 16;

/// Looks for the plane that the part stands on, and removes it with everything below.
///
/// `viewpoint_of` gives for a point the position it was seen from, where known.
///
/// # Errors
/// [`Error::NonFinite`](crate::Error::NonFinite). A cloud too small or too degenerate to hold a plane has no ground.
pub fn find_ground(
    points: &[[f64; 3]],
    viewpoint_of: impl Fn(usize) -> Option<[f64; 3]> + Sync,
    params: &GroundParams,
    mode: GroundMode,
) -> Result<Option<Ground>> {
    check_finite(points)?;
    if mode == GroundMode::Off {
        return Ok(None);
    }
    let mut rest: Vec<u32> = (0..points.len() as u32).collect();
    let mut planes = Vec::new();
    for round in 0..params.max_planes {
        let remaining: Vec<[f64; 3]> = rest.iter().map(|&i| points[i as usize]).collect();
        let Some((plane, band)) = dominant_plane(&remaining, params, round) else { break };
        let before = rest.len();
        rest.retain(|&i| plane.distance(&points[i as usize]).abs() > band);
        if before - rest.len() < points.len() / 20 {
            break;
        }
        planes.push((plane, band));
    }
    for (plane, band) in planes {
        let above = rest.iter().filter(|&&i| plane.distance(&points[i as usize]) > 0.0).count();
        let share = above.max(rest.len() - above) as f64 / rest.len().max(1) as f64;
        let plane = if 2 * above < rest.len() { plane.flipped() } else { plane };
        if rest.len() < MIN_REST.max(points.len() / 100)
            || !seen_from_above(points, &viewpoint_of, &plane, band)
        {
            continue;
        }
        let sectors = reaching_sectors(points, &rest, &plane, band, params.reach);
        if share >= params.one_sided && (mode == GroundMode::On || 2 * sectors >= SECTORS) {
            let kept: Vec<u32> =
                (0..points.len() as u32).filter(|&i| plane.distance(&points[i as usize]) > band).collect();
            return Ok(Some(Ground {
                plane: plane.coefficients(),
                removed: points.len() - kept.len(),
                kept,
                reason: format!(
                    "{:.1} % of the rest on one side; reaches beyond it in {sectors} of {SECTORS} directions",
                    100.0 * share
                ),
            }));
        }
    }
    Ok(None)
}

/// The plane with the most points, and the half width of its band of noise.
fn dominant_plane(points: &[[f64; 3]], params: &GroundParams, round: usize) -> Option<(HalfSpace, f64)> {
    let rough = params.rough_distance * extent(points);
    let settings = PlaneParams {
        distance: rough,
        seed: params.seed.wrapping_add(round as u64),
        ..PlaneParams::default()
    };
    let [x, y, z, d] = segment_plane(points, &settings).ok()?.coefficients;
    let mut plane = HalfSpace { normal: Vector3::new(x, y, z), d };
    let mut band = rough;
    for _ in 0..3 {
        let mut residuals: Vec<f64> =
            points.iter().map(|p| plane.distance(p).abs()).filter(|&r| r <= 2.0 * band).collect();
        if residuals.is_empty() {
            return None;
        }
        let middle = residuals.len() / 2;
        let median = *residuals.select_nth_unstable_by(middle, f64::total_cmp).1;
        // 1.4826 times the median absolute deviation is the standard deviation of a Gaussian.
        band = (params.band * 1.4826 * median).clamp(1e-9 * rough, 2.0 * rough);
        plane = plane.refitted(points, band)?;
    }
    Some((plane, band))
}

/// Diagonal of the box between the 5th and the 95th percentile of each coordinate.
fn extent(points: &[[f64; 3]]) -> f64 {
    let span = |axis: usize| {
        let mut values: Vec<f64> = points.iter().map(|p| p[axis]).collect();
        let last = values.len().saturating_sub(1);
        let mut at =
            |share: f64| *values.select_nth_unstable_by((share * last as f64) as usize, f64::total_cmp).1;
        at(0.95) - at(0.05)
    };
    if points.is_empty() { 0.0 } else { (0..3).map(|axis| span(axis).powi(2)).sum::<f64>().sqrt() }
}

/// Number of angular sectors in which the points of the plane reach `reach` times as far as the rest.
fn reaching_sectors(points: &[[f64; 3]], rest: &[u32], plane: &HalfSpace, band: f64, reach: f64) -> usize {
    let n = plane.normal;
    let helper = if n.x.abs() < 0.5 { Vector3::x() } else { Vector3::y() };
    let u = n.cross(&helper).normalize();
    let v = n.cross(&u);
    let project = |i: &u32| {
        let p = Vector3::from(points[*i as usize]);
        [u.dot(&p), v.dot(&p)]
    };
    let median = |mut values: Vec<f64>| {
        let middle = values.len() / 2;
        if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(middle, f64::total_cmp).1 }
    };
    let flat: Vec<[f64; 2]> = rest.iter().map(project).collect();
    let center = [median(flat.iter().map(|p| p[0]).collect()), median(flat.iter().map(|p| p[1]).collect())];
    let mut radii: Vec<f64> = flat.iter().map(|p| (p[0] - center[0]).hypot(p[1] - center[1])).collect();
    if radii.is_empty() {
        return 0;
    }
    let high = (0.95 * (radii.len() - 1) as f64) as usize;
    let footprint = *radii.select_nth_unstable_by(high, f64::total_cmp).1;
    let mut beyond = [0_usize; SECTORS];
    let mut reached = [0_f64; SECTORS];
    for i in (0..points.len() as u32).filter(|&i| plane.distance(&points[i as usize]).abs() <= band) {
        let p = project(&i);
        let (x, y) = (p[0] - center[0], p[1] - center[1]);
        let turn = y.atan2(x) / std::f64::consts::TAU + 0.5;
        let sector = ((turn * SECTORS as f64) as usize).min(SECTORS - 1);
        reached[sector] = reached[sector].max(x.hypot(y));
        beyond[sector] += usize::from(x.hypot(y) > reach * footprint);
    }
    reached.sort_by(f64::total_cmp);
    if reached[SECTORS / 4] < EVEN_REACH * reached[SECTORS - 1] {
        return 0;
    }
    beyond.iter().filter(|&&count| count >= 10).count()
}

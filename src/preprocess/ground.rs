//! The support plane under a part: found, told apart from the part's own flat faces, and removed.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::check_finite;
use super::fields::Fields;
use super::plane::{HalfSpace, PlaneParams, segment_plane};
use super::support::{Found, SeenPoints, Support};
use crate::config::GroundMode;
use crate::error::Result;
use crate::median::robust_sigma;
use crate::sampling::even_sample;

/// Settings of [`find_ground`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GroundParams {
    /// Distance at which a plane is first looked for [share of the extent of the scene].
    pub rough_distance: f64,
    /// Half width of the band that is removed [standard deviations of the noise of the plane].
    pub band: f64,
    /// Share of what lies over the plane that must be on one side of it.
    pub one_sided: f64,
    /// How far the plane must reach beyond what stands on it [reach of what stands on it].
    pub reach: f64,
    /// Share of the directions in which it must reach that far.
    pub free_directions: f64,
    /// Asymmetry of its outline below which a plane with the rest in its middle is a face of the part.
    pub outline: f64,
    /// Planes that are looked at, one after the other \[count\].
    pub max_planes: usize,
}

impl Default for GroundParams {
    fn default() -> Self {
        Self {
            rough_distance: 0.01,
            band: 3.5,
            one_sided: 0.99,
            reach: 1.1,
            free_directions: 0.7,
            outline: 0.06,
            max_planes: 3,
        }
    }
}

/// A support plane that was removed.
#[derive(Debug, Clone, PartialEq)]
pub struct Ground {
    /// Unit normal n toward the part, and d, with n . x + d = 0.
    pub plane: [f64; 4],
    /// Half width of the band about it that was removed \[length\].
    pub band: f64,
    /// Points that remain as candidates for the part, ascending: those over the plane, but for strays, where most of what is below it
    /// are such.
    pub kept: Vec<u32>,
    /// Number of points removed.
    pub removed: usize,
    /// Whether it is a wall or a floor behind all the rest, with a gap between, on which nothing stands.
    pub is_backdrop: bool,
    /// Why the plane was taken for a support.
    pub reason: String,
}

/// Points on which planes are looked for and judged.
const LOOKED_AT: usize = 20_000;

/// Looks for the plane that the part stands on, and removes it with everything below and beside it.
///
/// A support is seen from above only, has nothing below it (but its own sides, with [`GroundMode::On`]), is filled nearly to its
/// outline, reaches beyond what stands on it, and its outline has nothing to do with the symmetry of the part: it is cut off by
/// the picture or an edge. Where it is known from where it was seen, a plane far behind all the rest that is so, too, is a
/// backdrop, and removed like a support. Strays below it, which have fewer points about them than a surface has, do not count.
///
/// `viewpoint_of` gives for a point the position it was seen from, where known; `seed` is that of the samples.
///
/// ```
/// use sympose::config::GroundMode;
/// use sympose::preprocess::{GroundParams, find_ground};
/// // A block in the middle of a table.
/// let grid = |count: u32, step: f64, z: f64| {
///     (0..count * count).map(move |i| {
///         let place = |i: u32| step * (f64::from(i) - 0.5 * f64::from(count - 1));
///         [place(i % count), place(i / count), z]
///     })
/// };
/// let block = (0..10).flat_map(|i| grid(11, 0.1, 0.1 * f64::from(i)));
/// let points: Vec<[f64; 3]> = block.chain(grid(61, 0.1, 0.0)).collect();
/// let ground = find_ground(&points, |_| None, &GroundParams::default(), GroundMode::On, 0)?;
/// assert!(ground.is_some_and(|ground| ground.plane[2] > 0.99 && ground.kept.len() >= 9 * 121));
/// # Ok::<(), sympose::Error>(())
/// ```
///
/// # Errors
/// [`Error::NonFinite`](crate::Error::NonFinite). A cloud too small or too degenerate to hold a plane has no ground.
pub fn find_ground(
    points: &[[f64; 3]],
    viewpoint_of: impl Fn(usize) -> Option<[f64; 3]> + Sync,
    params: &GroundParams,
    mode: GroundMode,
    seed: u64,
) -> Result<Option<Ground>> {
    match Support::sought(mode) {
        Some(kind) => find_support(points, viewpoint_of, params, kind, seed),
        None => check_finite(points).map(|()| None),
    }
}

/// [`find_ground`] for one kind of support.
pub(crate) fn find_support(
    points: &[[f64; 3]],
    viewpoint_of: impl Fn(usize) -> Option<[f64; 3]> + Sync,
    params: &GroundParams,
    kind: Support,
    seed: u64,
) -> Result<Option<Ground>> {
    check_finite(points)?;
    let chosen = even_sample(points.len(), LOOKED_AT, seed);
    let sample: Vec<[f64; 3]> = chosen.iter().map(|&i| points[i]).collect();
    let sensors: Vec<Option<[f64; 3]>> = chosen.iter().map(|&i| viewpoint_of(i)).collect();
    let fields = Fields::new(&sample, &sensors);
    let scene = SeenPoints { points: &sample, sensors: &sensors, fields: &fields };
    let mut remaining = sample.clone();
    let mut found: Option<(Found, f64)> = None;
    for round in 0..params.max_planes {
        let Some((plane, band)) = dominant_plane(&remaining, params, seed.wrapping_add(round as u64)) else {
            break;
        };
        let before = remaining.len();
        remaining.retain(|p| plane.distance(p).abs() > band);
        if before - remaining.len() < sample.len() / 20 {
            break;
        }
        // Each plane is judged against everything else, other planes included.
        let Some(support) = scene.support(plane, band, params, kind) else { continue };
        // A foot in sight tells more than the size of the plane, and so does that nothing is below it: a flange has sides, too.
        let (worth, best) = (support.worth(), Found::BEST);
        if found.as_ref().is_none_or(|(most, _)| worth > most.worth()) {
            found = Some((support, band));
        }
        if worth == best {
            break;
        }
    }
    Ok(found.and_then(|(support, band)| support.cut(points, band)))
}

/// Distance at which a rough plane is looked at again [share of the rough distance].
const FINER: f64 = 0.25;

/// The plane with the most points, and the half width of its band of noise.
fn dominant_plane(points: &[[f64; 3]], params: &GroundParams, seed: u64) -> Option<(HalfSpace, f64)> {
    let rough = params.rough_distance * extent(points);
    let settings = PlaneParams { distance: rough, seed, ..PlaneParams::default() };
    let [x, y, z, d] = segment_plane(points, &settings).ok()?.coefficients;
    let plane = HalfSpace { normal: Vector3::new(x, y, z), d };
    // A table and a thin part on it fit one rough plane; a finer one takes the larger of both.
    let thick: Vec<[f64; 3]> =
        points.iter().filter(|p| plane.distance(p).abs() <= 2.0 * rough).copied().collect();
    let settings = PlaneParams { distance: FINER * rough, ..settings };
    let [x, y, z, d] = segment_plane(&thick, &settings).ok()?.coefficients;
    let mut plane = HalfSpace { normal: Vector3::new(x, y, z), d };
    let mut band = rough;
    for _ in 0..5 {
        let mut residuals: Vec<f64> =
            points.iter().map(|p| plane.distance(p).abs()).filter(|&r| r <= 2.0 * band).collect();
        band = (params.band * robust_sigma(&mut residuals)).clamp(1e-9 * rough, 2.0 * rough);
        plane = plane.refitted(points, band)?;
    }
    Some((plane, band))
}

/// Diagonal of the box between the 5th and the 95th percentile of each coordinate.
pub(super) fn extent(points: &[[f64; 3]]) -> f64 {
    let span = |axis: usize| {
        let mut values: Vec<f64> = points.iter().map(|p| p[axis]).collect();
        let last = values.len().saturating_sub(1);
        let mut at =
            |share: f64| *values.select_nth_unstable_by((share * last as f64) as usize, f64::total_cmp).1;
        at(0.95) - at(0.05)
    };
    if points.is_empty() { 0.0 } else { (0..3).map(|axis| span(axis).powi(2)).sum::<f64>().sqrt() }
}

//! The support plane under a part: found, told apart from the part's own flat faces, and removed.

use std::cmp::Ordering;

use nalgebra::Vector3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::cluster::{ClusterParams, main_cluster};
use super::fields::Fields;
use super::flatness::unevenness;
use super::outline::{Flat, Outline, distance, enclosing_middle};
use super::plane::{HalfSpace, PlaneParams, even_sample, segment_plane};
use super::{CHUNK, check_finite};
use crate::config::GroundMode;
use crate::directions::tangents;
use crate::error::Result;
use crate::median::robust_sigma;

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

/// What a support is taken for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Support {
    /// A table: nothing is below it.
    Sheet,
    /// A plate, whose sides are seen below its rim. A flange of the part itself looks much the same.
    Plate,
    /// Either, and whatever it looks like.
    Any,
}

impl Support {
    /// What is looked for in the first place; `None` where nothing is.
    pub(crate) fn sought(mode: GroundMode) -> Option<Self> {
        match mode {
            GroundMode::Auto => Some(Self::Sheet),
            GroundMode::On => Some(Self::Any),
            GroundMode::Off => None,
        }
    }
}

/// A support plane that was removed.
#[derive(Debug, Clone, PartialEq)]
pub struct Ground {
    /// Unit normal n toward the part, and d, with n . x + d = 0.
    pub plane: [f64; 4],
    /// Points that remain as candidates for the part, ascending: those over the plane.
    pub kept: Vec<u32>,
    /// Number of points removed.
    pub removed: usize,
    /// Why the plane was taken for a support.
    pub reason: String,
}

/// Points on which planes are looked for and judged.
const LOOKED_AT: usize = 20_000;

/// Fewest of them that can stand on a support.
const MIN_REST: usize = 50;

/// Margin about the outline of a plane within which points still lie over it [radii of the outline].
const MARGIN: f64 = 0.03;

/// Share of what is above a plane, in that margin, that must stand on it; the rest may lean over its edge.
const MOSTLY: f64 = 0.8;

/// Height at which what stands on a plane begins, at most [radii of the outline].
const CONTACT: f64 = 0.1;

/// The same where its foot is out of sight, as under a flange [radii of the outline of what stands there].
const OVERHANG: f64 = 1.0;

/// How far a support may be from flat but for noise, and the patches in which that is seen [radii of the outline].
///
/// Captured tables are 0.008 or less; blades and dished discs that were taken for one 0.015 or more.
const UNEVEN: f64 = 0.011;
const PATCH: f64 = 0.3;

/// How far inward from the outline of a plate its sides may be [radii of the outline].
const RIM: f64 = 0.05;

/// Margin about the outline, and depth below it, within which nothing else may be [radii of the outline].
const NEAR: f64 = 0.3;

/// Looks for the plane that the part stands on, and removes it with everything below and beside it.
///
/// A support is seen from above only, has nothing below it (but its own sides, with [`GroundMode::On`]), is filled nearly to its
/// outline, reaches beyond what stands on it, and its outline has nothing to do with the symmetry of the part: it is cut off by
/// the picture or an edge.
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
        let (worth, best) = (support.worth(), (true, true));
        if found.as_ref().is_none_or(|(most, _)| worth > most.worth()) {
            found = Some((support, band));
        }
        if worth == best {
            break;
        }
    }
    Ok(found.and_then(|(support, band)| support.cut(points, band)))
}

/// Points and the positions that they were seen from.
struct SeenPoints<'a> {
    points: &'a [[f64; 3]],
    sensors: &'a [Option<[f64; 3]>],
    fields: &'a Fields,
}

/// A plane that passed as a support.
struct Found {
    /// Toward what stands on it.
    plane: HalfSpace,
    axes: PlaneAxes,
    outline: Outline,
    /// Whether something reaches down to it; otherwise its foot is out of sight.
    is_touched: bool,
    /// Whether sides are seen below its rim.
    has_sides: bool,
    reason: String,
}

impl Found {
    /// The more, the sooner this is what the part stands on.
    fn worth(&self) -> (bool, bool) {
        (self.is_touched, !self.has_sides)
    }

    /// Removes the plane, `band` to either side of it, from `points`.
    fn cut(self, points: &[[f64; 3]], band: f64) -> Option<Ground> {
        let plane = self.plane.refitted(points, band)?;
        let plane = if plane.normal.dot(&self.plane.normal) < 0.0 { plane.flipped() } else { plane };
        let margin = NEAR * self.outline.radius();
        let over =
            |p: &[f64; 3]| plane.distance(p) > band && self.outline.contains(self.axes.flat(p), margin);
        let kept: Vec<u32> = (0_u32..).zip(points).filter(|(_, p)| over(p)).map(|(i, _)| i).collect();
        Some(Ground {
            plane: plane.coefficients(),
            removed: points.len() - kept.len(),
            kept,
            reason: self.reason,
        })
    }
}

/// Two directions that span a plane.
struct PlaneAxes([Vector3<f64>; 2]);

impl PlaneAxes {
    fn new(normal: &Vector3<f64>) -> Self {
        Self(tangents(normal))
    }

    fn flat(&self, p: &[f64; 3]) -> Flat {
        self.0.map(|axis| axis.dot(&Vector3::from(*p)))
    }
}

impl SeenPoints<'_> {
    /// Judges a plane; `None` when it is no support.
    fn support(&self, plane: HalfSpace, band: f64, params: &GroundParams, kind: Support) -> Option<Found> {
        let axes = PlaneAxes::new(&plane.normal);
        let height = |i: usize| plane.distance(&self.points[i]).abs();
        let on = self.connected((0..self.points.len()).filter(|&i| height(i) <= band).collect())?;
        let flat =
            |indices: &[usize]| indices.iter().map(|&i| axes.flat(&self.points[i])).collect::<Vec<_>>();
        let outline = Outline::new(&flat(&on))?;
        // The tails of the noise are on neither side; what is far below is another matter.
        let radius = outline.radius();
        let near: Vec<usize> = (0..self.points.len())
            .into_par_iter()
            .with_min_len(CHUNK)
            .filter(|&i| {
                height(i) > 2.0 * band && outline.contains(axes.flat(&self.points[i]), NEAR * radius)
            })
            .collect();
        let plane = self.toward_the_rest(plane, &on, &near)?;
        let signed = |i: usize| plane.distance(&self.points[i]);
        let over = |i: usize| outline.contains(axes.flat(&self.points[i]), MARGIN * radius);
        // Where no sensor looked the plane may go on.
        let foot = |i: usize| Vector3::from(self.points[i]) - signed(i) * plane.normal;
        let (above, beside): (Vec<usize>, Vec<usize>) = near
            .par_iter()
            .copied()
            .filter(|&i| signed(i) > 0.0)
            .partition(|&i| over(i) || !self.fields.show(&foot(i)));
        let is_side = |i: &usize| !outline.contains(axes.flat(&self.points[*i]), -RIM * radius);
        let is_below = |i: &usize| (-NEAR * radius..0.0).contains(&signed(*i));
        let (sides, below): (Vec<usize>, Vec<usize>) =
            near.iter().copied().filter(is_below).partition(is_side);
        let beside = beside.len();
        if (above.len() as f64) < MOSTLY * (above.len() + beside) as f64 {
            return None;
        }
        let share_above = |others: usize| above.len() as f64 / (above.len() + others).max(1) as f64;
        let share = share_above(below.len());
        let has_sides = share_above(below.len() + sides.len()) < params.one_sided;
        if above.len() < MIN_REST || share < params.one_sided || has_sides && kind == Support::Sheet {
            return None;
        }
        // A wall has a room before it, but what is there does not touch it.
        let mut heights: Vec<f64> = above.iter().map(|&i| signed(i)).collect();
        let lowest = heights.len() / 100;
        let gap = *heights.select_nth_unstable_by(lowest, f64::total_cmp).1;
        let is_touched = gap <= CONTACT * radius;
        let things = flat(&above);
        let is_over_all = above.len() as f64 >= params.one_sided * (above.len() + beside) as f64;
        if !is_touched && (gap > OVERHANG * Outline::new(&things)?.radius() || !is_over_all) {
            return None;
        }
        let seen = on.iter().any(|&i| self.sensors[i].is_some());
        let reach = outline.reach_of(&things);
        let hull = outline.hull_reach();
        // Blades leave most of their hull empty, a table fills it but for shadows and what stands on it.
        let is_filled = |s: usize| outline.reach[s] > 0.5 * hull[s];
        let is_free = |s: &usize| is_filled(*s) && outline.reach[*s] > params.reach * reach[*s];
        let shaded = self.shaded(&axes, &outline, &on);
        let directions = 0..hull.len();
        let hidden = directions.clone().filter(|&s| !is_filled(s) && shaded[s]).count();
        // Of what is out of sight nothing is known: it counts half.
        let free = (directions.filter(is_free).count() as f64 + 0.5 * hidden as f64) / hull.len() as f64;
        let is_of_the_part = || {
            free < params.free_directions
                || is_face(&outline, &things, seen, params)
                || self.is_uneven(&on, &plane, &axes, radius)
        };
        if kind != Support::Any && is_of_the_part() {
            return None;
        }
        let reason = format!(
            "{:.1} % of what lies over it is on one side; it reaches beyond that in {:.0} % of the directions",
            100.0 * share,
            100.0 * free
        );
        Some(Found { plane, axes, outline, is_touched, has_sides, reason })
    }

    /// Whether the points `on` a plane are rather blades, or a dished disc, between two planes.
    fn is_uneven(&self, on: &[usize], plane: &HalfSpace, axes: &PlaneAxes, radius: f64) -> bool {
        let in_plane = |&i: &usize| {
            let [x, y] = axes.flat(&self.points[i]);
            [x, y, plane.distance(&self.points[i])]
        };
        let sheet: Vec<[f64; 3]> = on.iter().map(in_plane).collect();
        unevenness(&sheet, PATCH * radius).is_ok_and(|height| height > UNEVEN * radius)
    }

    /// For each direction of an outline whether it leads away from all sensors that saw the points `on` it: a thing in its middle
    /// keeps what is there out of sight. All false where no sensor is known.
    fn shaded(&self, axes: &PlaneAxes, outline: &Outline, on: &[usize]) -> Vec<bool> {
        let mut sensors: Vec<[f64; 3]> = on.iter().filter_map(|&i| self.sensors[i]).collect();
        sensors.sort_by(|a, b| a.partial_cmp(b).unwrap_or(Ordering::Equal));
        sensors.dedup();
        let sensors: Vec<Flat> = sensors.iter().map(|sensor| axes.flat(sensor)).collect();
        let leads_away = |[x, y]: Flat| {
            let away = |[u, v]: &Flat| x * (outline.middle[0] - u) + y * (outline.middle[1] - v) > 0.0;
            !sensors.is_empty() && sensors.iter().all(away)
        };
        Outline::directions().map(leads_away).collect()
    }

    /// The largest connected piece of a sheet: a wall behind a table crosses the same plane.
    fn connected(&self, sheet: Vec<usize>) -> Option<Vec<usize>> {
        const GAP: f64 = 0.05;
        let rows: Vec<[f64; 3]> = sheet.iter().map(|&i| self.points[i]).collect();
        let settings = ClusterParams { distance: GAP * extent(&rows), keep_ratio: 0.1 };
        Some(main_cluster(&rows, &settings).ok()?.kept.into_iter().map(|i| sheet[i as usize]).collect())
    }

    /// Turns the plane toward its sensors, where they are known: nobody sees a table from below, but the faces of a part
    /// are seen from all sides. Otherwise toward most of the rest.
    fn toward_the_rest(&self, plane: HalfSpace, on: &[usize], near: &[usize]) -> Option<HalfSpace> {
        const NEARLY_ALL: f64 = 0.95;
        let known: Vec<f64> =
            on.iter().filter_map(|&i| self.sensors[i].map(|sensor| plane.distance(&sensor))).collect();
        let share_above = |heights: &mut dyn Iterator<Item = f64>, all: usize| {
            heights.filter(|&h| h > 0.0).count() as f64 / all.max(1) as f64
        };
        if known.is_empty() {
            let above = share_above(&mut near.iter().map(|&i| plane.distance(&self.points[i])), near.len());
            return Some(if above < 0.5 { plane.flipped() } else { plane });
        }
        let above = share_above(&mut known.iter().copied(), known.len());
        if above >= NEARLY_ALL {
            Some(plane)
        } else if above <= 1.0 - NEARLY_ALL {
            Some(plane.flipped())
        } else {
            None
        }
    }
}

/// Whether a sheet is a flange or a disc of the part: its outline then has a symmetry, and the rest stands in its middle.
///
/// A rectangle is more often what the picture shows of a table. Where nobody knows what was seen from where, the visible
/// half of the rest may stand anywhere.
fn is_face(outline: &Outline, things: &[Flat], seen: bool, params: &GroundParams) -> bool {
    const CENTRED: f64 = 0.1;
    const RECTANGLE: f64 = 0.93;
    let off_center =
        distance(enclosing_middle(things, things.first().copied().unwrap_or_default()), outline.middle)
            / outline.radius();
    let centred = off_center < CENTRED || !seen;
    centred && outline.asymmetry() < params.outline && outline.rectangularity() < RECTANGLE
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

//! Whether a plane is one that a part stands on, or one of its own faces.

use std::cmp::Ordering;

use nalgebra::Vector3;
use rayon::prelude::*;

use super::CHUNK;
use super::cluster::{ClusterParams, main_cluster};
use super::company::Company;
use super::fields::Fields;
use super::flatness::unevenness;
use super::ground::{Ground, GroundParams, extent};
use super::outline::{Flat, Outline, distance, enclosing_middle};
use super::plane::HalfSpace;
use crate::config::GroundMode;
use crate::directions::tangents;

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

/// Fewest points that can stand on a support.
const MIN_REST: usize = 50;

/// Margin about the outline of a plane within which points still lie over it [radii of the outline].
const MARGIN: f64 = 0.03;

/// Share of what is above a plane, in that margin, that must stand on it; the rest may lean over its edge.
const MOSTLY: f64 = 0.8;

/// What is below a plane where it, or most of it, may be strays: at most so much [points on the plane] and at least so much [points
/// above it]. Below a face of a part there is more.
const STRAYS: [f64; 2] = [0.1, 0.001];

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

/// Points and the positions that they were seen from.
pub(super) struct SeenPoints<'a> {
    pub(super) points: &'a [[f64; 3]],
    pub(super) sensors: &'a [Option<[f64; 3]>],
    pub(super) fields: &'a Fields,
}

/// A plane that passed as a support.
pub(super) struct Found {
    /// Toward what stands on it.
    plane: HalfSpace,
    axes: PlaneAxes,
    outline: Outline,
    /// Whether something reaches down to it; otherwise its foot is out of sight.
    is_touched: bool,
    /// Whether it is so far behind the rest that nothing stands on it.
    is_backdrop: bool,
    /// Whether sides are seen below its rim.
    has_sides: bool,
    /// What tells points from strays, where most of what is below it were such.
    company: Option<Company>,
    reason: String,
}

impl Found {
    /// The largest [`Found::worth`].
    pub(super) const BEST: [bool; 3] = [true; 3];

    /// The more, the sooner this is what the part stands on.
    pub(super) fn worth(&self) -> [bool; 3] {
        [!self.is_backdrop, self.is_touched, !self.has_sides]
    }

    /// Removes the plane, `band` to either side of it, from `points`.
    pub(super) fn cut(self, points: &[[f64; 3]], band: f64) -> Option<Ground> {
        let plane = self.plane.refitted(points, band)?;
        let plane = if plane.normal.dot(&self.plane.normal) < 0.0 { plane.flipped() } else { plane };
        let margin = NEAR * self.outline.radius();
        let is_stray = |p: &[f64; 3]| self.company.as_ref().is_some_and(|company| !company.would_hold(p));
        let over = |p: &[f64; 3]| {
            plane.distance(p) > band && self.outline.contains(self.axes.flat(p), margin) && !is_stray(p)
        };
        let rows = (0..points.len() as u32).into_par_iter().with_min_len(CHUNK);
        let kept: Vec<u32> = rows.filter(|&i| over(&points[i as usize])).collect();
        Some(Ground {
            plane: plane.coefficients(),
            band,
            removed: points.len() - kept.len(),
            kept,
            is_backdrop: self.is_backdrop,
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

/// What is near a plane, but not on it.
struct Around {
    /// Points that stand over it.
    above: Vec<usize>,
    /// Number of those above it, but beside its outline, where it is known to have ended.
    beside: usize,
    /// Number of those below it, away from its rim.
    below: usize,
    /// Number of those below its rim.
    sides: usize,
}

impl Around {
    /// Share of the points above the plane in these and `others`.
    fn share_above(&self, others: usize) -> f64 {
        self.above.len() as f64 / (self.above.len() + others).max(1) as f64
    }

    /// Number of those below the plane.
    fn beneath(&self) -> usize {
        self.below + self.sides
    }

    /// Whether something is below it, with so many points `on` it that it may be strays.
    fn is_spoilt(&self, on: usize) -> bool {
        let beneath = self.beneath() as f64;
        beneath <= STRAYS[0] * on as f64 && beneath > STRAYS[1] * self.above.len() as f64
    }
}

impl SeenPoints<'_> {
    /// Judges a plane; `None` when it is no support.
    pub(super) fn support(
        &self,
        plane: HalfSpace,
        band: f64,
        params: &GroundParams,
        kind: Support,
    ) -> Option<Found> {
        let axes = PlaneAxes::new(&plane.normal);
        let within = |i: &usize| plane.distance(&self.points[*i]).abs() <= band;
        let on = self.connected((0..self.points.len()).filter(within).collect())?;
        let outline = Outline::new(&self.flat(&axes, &on))?;
        let near = self.near(&plane, band, &axes, &outline);
        let plane = self.toward_the_rest(plane, &on, &near)?;
        let (around, company) = self.around_without_strays(&plane, &axes, &outline, &near, &on);
        if (around.above.len() as f64) < MOSTLY * (around.above.len() + around.beside) as f64 {
            return None;
        }
        let share = around.share_above(around.below);
        let has_sides = around.share_above(around.below + around.sides) < params.one_sided;
        if around.above.len() < MIN_REST || share < params.one_sided || has_sides && kind == Support::Sheet {
            return None;
        }
        let gap = self.gap(&plane, &around.above);
        let is_touched = gap <= CONTACT * outline.radius();
        let things = self.flat(&axes, &around.above);
        // A wall has a room before it, but what is there does not touch it.
        let is_backdrop = !is_touched && gap > OVERHANG * Outline::new(&things)?.radius();
        let is_over_all = around.share_above(around.beside) >= params.one_sided;
        if !is_touched && !is_backdrop && !is_over_all {
            return None;
        }
        let is_seen = on.iter().any(|&i| self.sensors[i].is_some());
        if is_backdrop && (!is_seen || kind == Support::Plate) {
            return None;
        }
        let free = free_directions(&outline, &things, &self.shaded(&axes, &outline, &on), params.reach);
        let is_of_the_part = || {
            free < params.free_directions
                || is_face(&outline, &things, is_seen, params)
                || self.is_uneven(&on, &plane, &axes, outline.radius())
        };
        if (kind != Support::Any || is_backdrop) && is_of_the_part() {
            return None;
        }
        let reason = format!(
            "{:.1} % of what lies over it is on one side; it reaches beyond that in {:.0} % of the directions",
            100.0 * share,
            100.0 * free
        );
        Some(Found { plane, axes, outline, is_touched, is_backdrop, has_sides, company, reason })
    }

    fn flat(&self, axes: &PlaneAxes, indices: &[usize]) -> Vec<Flat> {
        indices.iter().map(|&i| axes.flat(&self.points[i])).collect()
    }

    /// The points in and about the outline of a plane that are not on it. The tails of the noise are on neither side; what is
    /// far below is another matter.
    fn near(&self, plane: &HalfSpace, band: f64, axes: &PlaneAxes, outline: &Outline) -> Vec<usize> {
        let margin = NEAR * outline.radius();
        (0..self.points.len())
            .into_par_iter()
            .with_min_len(CHUNK)
            .filter(|&i| {
                let p = &self.points[i];
                plane.distance(p).abs() > 2.0 * band && outline.contains(axes.flat(p), margin)
            })
            .collect()
    }

    /// On which side of a plane the points `near` it are.
    fn around(&self, plane: &HalfSpace, axes: &PlaneAxes, outline: &Outline, near: &[usize]) -> Around {
        let radius = outline.radius();
        let signed = |i: usize| plane.distance(&self.points[i]);
        let is_over = |i: usize, margin: f64| outline.contains(axes.flat(&self.points[i]), margin * radius);
        // Where no sensor looked the plane may go on.
        let foot = |i: usize| Vector3::from(self.points[i]) - signed(i) * plane.normal;
        let (above, beside): (Vec<usize>, Vec<usize>) = near
            .par_iter()
            .copied()
            .filter(|&i| signed(i) > 0.0)
            .partition(|&i| is_over(i, MARGIN) || !self.fields.show(&foot(i)));
        let is_below = |i: &usize| (-NEAR * radius..0.0).contains(&signed(*i));
        let (below, sides): (Vec<usize>, Vec<usize>) =
            near.iter().copied().filter(is_below).partition(|&i| is_over(i, -RIM));
        Around { above, beside: beside.len(), below: below.len(), sides: sides.len() }
    }

    /// The same for a plane with the points `on` it. Where most of what is below it are strays, these are left out, and what tells
    /// them from points of surfaces is returned, too.
    fn around_without_strays(
        &self,
        plane: &HalfSpace,
        axes: &PlaneAxes,
        outline: &Outline,
        near: &[usize],
        on: &[usize],
    ) -> (Around, Option<Company>) {
        let all = self.around(plane, axes, outline, near);
        if !all.is_spoilt(on.len()) {
            return (all, None);
        }
        let Some(company) = Company::of(self.points, on) else { return (all, None) };
        let near: Vec<usize> = near.par_iter().copied().filter(|&i| company.holds(&self.points[i])).collect();
        let of_surfaces = self.around(plane, axes, outline, &near);
        if of_surfaces.beneath() > all.beneath() / 2 {
            return (all, None);
        }
        (of_surfaces, Some(company))
    }

    /// Height at which what stands `above` a plane begins \[length\].
    fn gap(&self, plane: &HalfSpace, above: &[usize]) -> f64 {
        let mut heights: Vec<f64> = above.iter().map(|&i| plane.distance(&self.points[i])).collect();
        let lowest = heights.len() / 100;
        *heights.select_nth_unstable_by(lowest, f64::total_cmp).1
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

/// Share of the directions in which a plane goes on beyond the `things` that stand on it, `reach` times as far. Where it is in
/// the shade nothing is known of it: that counts half.
fn free_directions(outline: &Outline, things: &[Flat], shaded: &[bool], reach: f64) -> f64 {
    let taken = outline.reach_of(things);
    let hull = outline.hull_reach();
    // Blades leave most of their hull empty, a table fills it but for shadows and what stands on it.
    let is_filled = |s: usize| outline.reach[s] > 0.5 * hull[s];
    let is_free = |s: &usize| is_filled(*s) && outline.reach[*s] > reach * taken[*s];
    let directions = 0..hull.len();
    let hidden = directions.clone().filter(|&s| !is_filled(s) && shaded[s]).count();
    (directions.filter(is_free).count() as f64 + 0.5 * hidden as f64) / hull.len() as f64
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

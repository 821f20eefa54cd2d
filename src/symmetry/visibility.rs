//! Free space: what the cameras saw to be empty.
//!
//! A ray proves that space is free only up to the point that it measured; a direction without a return proves nothing.

use nalgebra::{Matrix2, Matrix3, Rotation2, Rotation3, Vector2, Vector3};
use rayon::prelude::*;

/// Views beyond this number add little evidence and cost time; the ones with most points are kept.
const MAX_VIEWS: usize = 16;

/// Cells along one side of a depth map, at most.
const MAX_CELLS: usize = 512;

/// Points in a cell if the view were filled, so that a cell without return is a true gap; small, so that holes in the part
/// show.
const POINTS_PER_CELL: f64 = 2.0;

/// The same where returns are lost.
const LOSSY_POINTS_PER_CELL: f64 = 4.0;

/// Points of the part that are looked for in every view.
const LOOKED_AT: usize = 2000;

/// Returns missing for each that came, below which the sensor loses none.
const NO_LOSS: f64 = 0.01;

/// The same in coarser maps: as many are missing about the edges of what any sensor sees.
const EDGES: f64 = 0.04;

/// Returns in other views that tell what is missing, at least [points of the part].
const OVERLAP: f64 = 0.3;

/// Distance of views that are strips of one, at most [distance to the part].
const STRIPS: f64 = 0.1;

/// Cosine between the normal of a surface and the direction to a camera below which it is seen at a grazing angle: it
/// leaves few returns there, far from each other, which pass for strays or are lost.
const GRAZING: f64 = 0.26;

/// Directions more than this far from the middle of a view \[rad\] are left out of its map.
const MAX_OFF_AXIS: f64 = 1.2;

/// What a set of depth maps says about a place where no surface was measured; later ones are stronger.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Seen {
    /// No camera can tell: hidden, turned away, or out of the picture.
    Hidden,
    /// A camera that should have seen a surface there got no return: likely empty, but dark or shiny surfaces drop out.
    Missing,
    /// A camera measured something behind it: empty.
    Free,
}

/// Depth maps of the views, rebuilt from the points and their viewpoints.
#[derive(Debug, Clone)]
pub struct Visibility {
    views: Vec<DepthMap>,
    /// Returns that are missing for each that came, where one view measured a surface that another one should have
    /// seen: 0 for a sensor that loses none.
    pub dropout: f64,
    /// Whether a gap of a few points shows: not where returns are lost.
    pub shows_details: bool,
}

impl Visibility {
    /// Bins the points of each view by direction: `count` of them, which `point_of` gives as often as they are asked for,
    /// each seen from the one of `places` that `place_of` numbers. `None` where there is no view with enough points. Whether
    /// returns are lost is judged by the points that `is_of_part` tells: the support reaches beyond the picture of a camera.
    #[must_use]
    pub fn new(
        count: usize,
        point_of: impl Fn(usize) -> Vector3<f64> + Sync,
        places: &[Vector3<f64>],
        place_of: impl Fn(usize) -> usize,
        is_of_part: impl Fn(usize) -> bool,
    ) -> Option<Self> {
        let mut members: Vec<(&Vector3<f64>, Vec<u32>)> = places.iter().map(|p| (p, Vec::new())).collect();
        for i in 0..count {
            members[place_of(i)].1.push(i as u32);
        }
        members.sort_by_key(|(_, indices)| std::cmp::Reverse(indices.len()));
        members.truncate(MAX_VIEWS);
        let maps = |points_per_cell: f64| -> Vec<DepthMap> {
            let map = |(center, indices): &(&Vector3<f64>, Vec<u32>)| {
                DepthMap::new(center, &point_of, indices, points_per_cell)
            };
            members.par_iter().filter_map(map).collect()
        };
        let views = maps(POINTS_PER_CELL);
        if views.is_empty() {
            return None;
        }
        let own = || (0..count).filter(|&i| is_of_part(i));
        let step = own().count().div_ceil(LOOKED_AT).max(1);
        let part: Vec<[Vector3<f64>; 2]> =
            own().step_by(step).map(|i| [point_of(i), places[place_of(i)]]).collect();
        if lost_share(&views, &part) < NO_LOSS {
            return Some(Self { views, dropout: 0.0, shows_details: true });
        }
        let mut views = maps(LOSSY_POINTS_PER_CELL);
        let lost = lost_share(&views, &part);
        let dropout = if lost > EDGES { lost } else { 0.0 };
        if dropout > 0.0 {
            views.par_iter_mut().for_each(|view| view.hide_lost((0..count).map(&point_of)));
        }
        Some(Self { views, dropout, shows_details: false })
    }

    /// Number of views.
    #[must_use]
    pub fn views(&self) -> usize {
        self.views.len()
    }

    /// What the cameras say about a surface at `point` that faces along `normal`, where that is known; a measurement
    /// within `margin` \[length\] in front of it counts as hiding it. A missing return says nothing of a surface at a
    /// grazing angle. Where returns of a camera may be lost, as `is_barred` says given its place, a missing one says
    /// nothing either, and one beside a missing one proves nothing free.
    #[must_use]
    pub fn seen(
        &self,
        point: &Vector3<f64>,
        normal: Option<&Vector3<f64>>,
        margin: f64,
        is_barred: impl Fn(&Vector3<f64>) -> bool,
    ) -> Seen {
        let is_grazed_from = |center: &Vector3<f64>| {
            let toward = center - point;
            normal
                .is_some_and(|normal| normal.dot(&toward).powi(2) < GRAZING * GRAZING * toward.norm_squared())
        };
        let mut strongest = Seen::Hidden;
        for view in &self.views {
            let (seen, beside_missing) = view.seen(point, margin);
            let says_nothing = || {
                beside_missing && is_barred(&view.center)
                    || seen == Seen::Missing && is_grazed_from(&view.center)
            };
            if seen > strongest && !says_nothing() {
                strongest = seen;
            }
            if strongest == Seen::Free {
                break;
            }
        }
        strongest
    }
}

/// Returns that are missing for each that came, over some of the points of the part, each with the place that it was seen
/// from, and all other views.
///
/// Views from nearly the same place are strips of one: what is missing in one of them is in the next.
fn lost_share(views: &[DepthMap], part: &[[Vector3<f64>; 2]]) -> f64 {
    let (mut missing, mut came) = (0.0, 0.0);
    for ([point, place], view) in part.iter().flat_map(|p| views.iter().map(move |v| (p, v))) {
        let range = (point - view.center).norm();
        if (view.center - place).norm() < STRIPS * range {
            continue;
        }
        let margin = 3.0 * range / view.cells_per_slope;
        match view.at(point) {
            Some(cell) if cell.nearest.is_infinite() => missing += 1.0,
            Some(cell) if (f64::from(cell.own) - range).abs() < margin => came += 1.0,
            _ => {}
        }
    }
    // Where views hardly overlap, what is missing lies at their edges.
    let others = f64::max(came, OVERLAP * part.len() as f64);
    if missing > 0.0 { missing / f64::max(others, missing) } else { 0.0 }
}

/// What a depth map holds about one direction.
#[derive(Debug, Clone, Copy)]
struct Cell {
    /// Nearest return \[length\]; infinite where none came.
    own: f32,
    /// Nearest return here and in the cells around: at an edge the ray may have passed beside the surface.
    nearest: f32,
    /// Whether a return is missing here or in one of them.
    beside_missing: bool,
}

/// Nearest range for each cell of a tangent-plane grid about a camera.
#[derive(Debug, Clone)]
struct DepthMap {
    center: Vector3<f64>,
    camera_from_world: Matrix3<f64>,
    /// Cells to a slope of one against the middle of the view.
    cells_per_slope: f64,
    /// Where the picture begins, from the middle of the view \[cells\].
    first: [f64; 2],
    size: [usize; 2],
    cells: Vec<Cell>,
}

impl DepthMap {
    fn new(
        center: &Vector3<f64>,
        point_of: impl Fn(usize) -> Vector3<f64> + Sync,
        indices: &[u32],
        points_per_cell: f64,
    ) -> Option<Self> {
        /// Points in a unit of parallel work.
        const CHUNK: usize = 4096;
        let ray = |i: &u32| point_of(*i as usize) - center;
        let toward = |chunk: &[u32]| -> Vector3<f64> {
            chunk.iter().map(ray).filter_map(|ray| ray.try_normalize(0.0)).sum()
        };
        let middle: Vector3<f64> = indices.par_chunks(CHUNK).map(toward).collect::<Vec<_>>().iter().sum();
        let toward = middle.try_normalize(1e-9)?;
        let up = Vector3::ith(toward.iamin(), 1.0);
        let camera_from_world = Rotation3::look_at_lh(&toward, &up);
        let limit = MAX_OFF_AXIS.tan();
        let project = |ray: Vector3<f64>| -> Option<([f64; 2], f32)> {
            let local = camera_from_world * ray;
            if local.z <= 0.0 {
                return None;
            }
            let uv = [local.x / local.z, local.y / local.z];
            (uv[0].abs() < limit && uv[1].abs() < limit).then(|| (uv, local.norm() as f32))
        };
        let mut projected: Vec<Vec<([f64; 2], f32)>> = indices
            .par_chunks(CHUNK)
            .map(|chunk| chunk.iter().map(ray).filter_map(project).collect())
            .collect();
        let mut camera_from_world = camera_from_world;
        if let Some(roll) = roll_of_strip(projected.iter().flatten().map(|(uv, _)| *uv)) {
            let turn = Rotation2::new(-roll);
            projected.iter_mut().flatten().for_each(|(uv, _)| *uv = (turn * Vector2::from(*uv)).into());
            camera_from_world = Rotation3::from_axis_angle(&Vector3::z_axis(), -roll) * camera_from_world;
        }
        let count: usize = projected.iter().map(Vec::len).sum();
        let mut lower = [f64::INFINITY; 2];
        let mut upper = [f64::NEG_INFINITY; 2];
        for (uv, _) in projected.iter().flatten() {
            for axis in 0..2 {
                lower[axis] = lower[axis].min(uv[axis]);
                upper[axis] = upper[axis].max(uv[axis]);
            }
        }
        let extent = (upper[0] - lower[0]).max(upper[1] - lower[1]);
        if count < 16 || extent <= 0.0 {
            return None;
        }
        let cell = (extent / MAX_CELLS as f64).max(extent * (points_per_cell / count as f64).sqrt());
        let cells_per_slope = 1.0 / cell;
        let first = lower.map(|x| x * cells_per_slope);
        let size = [0, 1].map(|axis| (upper[axis] * cells_per_slope - first[axis]) as usize + 1);
        let mut nearest = vec![f32::INFINITY; size[0] * size[1]];
        for (uv, range) in projected.into_iter().flatten() {
            let [column, row] = [0, 1].map(|axis| (uv[axis] * cells_per_slope - first[axis]) as usize);
            let slot = &mut nearest[row * size[0] + column];
            *slot = slot.min(range);
        }
        let cells = with_neighbors(&nearest, size[0]);
        Some(Self {
            center: *center,
            camera_from_world: camera_from_world.into_inner(),
            cells_per_slope,
            first,
            size,
            cells,
        })
    }

    /// A ray toward a surface that any view measured must have met it, or something before it: where nothing came back,
    /// the sensor lost the return, and nothing is known about any place along the ray.
    fn hide_lost(&mut self, points: impl Iterator<Item = Vector3<f64>>) {
        let mut nearest: Vec<f32> = self.cells.iter().map(|cell| cell.own).collect();
        for point in points {
            if let Some(index) = self.index(&point)
                && nearest[index].is_infinite()
            {
                nearest[index] = 0.0;
            }
        }
        self.cells = with_neighbors(&nearest, self.size[0]);
    }

    /// Index of the cell that shows a point; `None` out of the picture.
    #[inline]
    fn index(&self, point: &Vector3<f64>) -> Option<usize> {
        let local = self.camera_from_world * (point - self.center);
        if local.z <= 0.0 {
            return None;
        }
        let scale = self.cells_per_slope / local.z;
        let column = local.x * scale - self.first[0];
        let row = local.y * scale - self.first[1];
        let inside = |x: f64, size: usize| x >= 0.0 && x < size as f64;
        (inside(column, self.size[0]) && inside(row, self.size[1]))
            .then(|| row as usize * self.size[0] + column as usize)
    }

    /// The cell that shows a point; `None` out of the picture.
    #[inline]
    fn at(&self, point: &Vector3<f64>) -> Option<Cell> {
        self.index(point).map(|index| self.cells[index])
    }

    /// What this camera says about a place, and whether a return is missing there or beside it.
    #[inline]
    fn seen(&self, point: &Vector3<f64>, margin: f64) -> (Seen, bool) {
        let Some(Cell { own, nearest, beside_missing }) = self.at(point) else {
            return (Seen::Hidden, false);
        };
        let farthest = f64::from(nearest) - margin;
        let is_behind = || farthest > 0.0 && farthest * farthest > (point - self.center).norm_squared();
        let seen = if nearest.is_infinite() {
            Seen::Missing
        } else if own.is_finite() && is_behind() {
            Seen::Free
        } else {
            Seen::Hidden
        };
        (seen, beside_missing)
    }
}

/// Angle of a picture that is a strip, as one of a sensor that measures line by line is, from the first axis \[rad\]; `None`
/// for a picture that is wide: only about a strip a box that is askew would be nearly empty.
fn roll_of_strip(places: impl Iterator<Item = [f64; 2]> + Clone) -> Option<f64> {
    /// Length of a strip, at least \[widths\].
    const ELONGATED: f64 = 4.0;
    let count = places.clone().count() as f64;
    let middle = places.clone().map(Vector2::from).sum::<Vector2<f64>>() / count;
    let off = |place: [f64; 2]| Vector2::from(place) - middle;
    let scatter: Matrix2<f64> = places.map(|place| off(place) * off(place).transpose()).sum();
    let (half_difference, mixed) = (0.5 * (scatter[(0, 0)] - scatter[(1, 1)]), scatter[(0, 1)]);
    let (half_trace, root) = (0.5 * scatter.trace(), half_difference.hypot(mixed));
    let is_strip = half_trace + root > ELONGATED * ELONGATED * (half_trace - root);
    is_strip.then(|| 0.5 * mixed.atan2(half_difference))
}

/// Looks around each cell of a map with rows of `width` cells.
fn with_neighbors(nearest: &[f32], width: usize) -> Vec<Cell> {
    // Nearest and farthest of three cells in a row, then of three such in a column.
    let beside = |i: usize| {
        let row = i / width * width;
        let around = &nearest[i.saturating_sub(1).max(row)..(i + 2).min(row + width)];
        around.iter().fold((f32::INFINITY, 0.0_f32), |(near, far), &x| (near.min(x), far.max(x)))
    };
    let rows: Vec<(f32, f32)> = (0..nearest.len()).map(beside).collect();
    let cell = |i: usize| {
        let above = rows[i.checked_sub(width).unwrap_or(i)];
        let below = rows.get(i + width).copied().unwrap_or(rows[i]);
        let near = rows[i].0.min(above.0).min(below.0);
        let far = rows[i].1.max(above.1).max(below.1);
        Cell { own: nearest[i], nearest: near, beside_missing: far.is_infinite() }
    };
    (0..nearest.len()).map(cell).collect()
}

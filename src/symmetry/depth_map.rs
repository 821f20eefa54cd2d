//! What one camera saw, rebuilt from the points that it measured: the nearest return in every direction.

use nalgebra::{Matrix2, Matrix3, Rotation2, Rotation3, Vector2, Vector3};
use rayon::prelude::*;

use crate::picture::Picture;

/// Cells along one side of a depth map, at most.
const MAX_CELLS: usize = 512;

/// Directions more than this far from the middle of a view \[rad\] are left out of its map.
const MAX_OFF_AXIS: f64 = 1.2;

/// Cells beside the points that still belong to their edge.
const EDGE: f64 = 2.0;

/// How far beside its points a camera that was not cut off there is taken to have seen [larger side of what they fill].
const BEYOND: f64 = 0.5;

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

/// What a depth map holds about one direction.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Cell {
    /// Nearest return \[length\]; infinite where none came.
    pub(crate) own: f32,
    /// Nearest return here and in the cells around: at an edge the ray may have passed beside the surface.
    pub(crate) nearest: f32,
    /// Whether a return is missing here or in one of them.
    beside_missing: bool,
}

/// Where beside its points a camera is known to have seen nothing.
#[derive(Debug, Clone)]
pub(crate) enum Surroundings {
    /// Nowhere: the part may go on there.
    Unknown,
    /// As far as can be supposed.
    Near,
    /// All over its field of view.
    Picture(Picture),
}

/// How many points the cells of a grid hold, at most.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PointsPerCell {
    /// On average, if they filled the square about them.
    pub(crate) of_square: f64,
    /// On average over the cells that hold any.
    pub(crate) filled: f64,
}

impl PointsPerCell {
    /// Half as many where a view has few points, evenly spread: its cells would be wider than the gaps of a part, and a few
    /// empty ones side by side are still no accident. `counts` are those of cells that hold any.
    fn adapted_to(self, counts: &[u32]) -> Self {
        /// Points of a view that has enough of them.
        const ENOUGH: f64 = 10_000.0;
        if !are_even(counts) {
            return self;
        }
        let count: f64 = counts.iter().map(|&count| f64::from(count)).sum();
        let share = (count / ENOUGH).clamp(0.5, 1.0);
        Self { of_square: share * self.of_square, filled: share * self.filled }
    }
}

/// Whether the counts of cells vary no more than those of random places do, of which the variance is the mean (Poisson): points that
/// were matched between pictures come in clumps, and what is between these is no gap.
fn are_even(counts: &[u32]) -> bool {
    let cells = counts.len() as f64;
    let mean = counts.iter().map(|&count| f64::from(count)).sum::<f64>() / cells;
    let variance = counts.iter().map(|&count| (f64::from(count) - mean).powi(2)).sum::<f64>() / cells;
    variance <= mean
}

/// Square cells of the slopes against the middle of a view.
#[derive(Debug, Clone)]
pub(crate) struct Grid {
    /// Cells to a slope of one.
    pub(crate) cells_per_slope: f64,
    /// Where the grid begins \[cells\].
    first: [f64; 2],
    size: [usize; 2],
}

impl Grid {
    /// A grid over `count` places; `None` where there are too few.
    fn over<P: Iterator<Item = [f64; 2]>>(
        places: impl Fn() -> P,
        count: usize,
        points_per_cell: PointsPerCell,
    ) -> Option<Self> {
        let mut lower = [f64::INFINITY; 2];
        let mut upper = [f64::NEG_INFINITY; 2];
        for uv in places() {
            for axis in 0..2 {
                lower[axis] = lower[axis].min(uv[axis]);
                upper[axis] = upper[axis].max(uv[axis]);
            }
        }
        let extent = (upper[0] - lower[0]).max(upper[1] - lower[1]);
        if count < 16 || extent <= 0.0 {
            return None;
        }
        let grid = |cell: f64| {
            let cells_per_slope = 1.0 / cell.max(extent / MAX_CELLS as f64);
            let first = lower.map(|x| x * cells_per_slope);
            let size = [0, 1].map(|axis| (upper[axis] * cells_per_slope - first[axis]) as usize + 1);
            Self { cells_per_slope, first, size }
        };
        let cell = |of_square: f64| extent * (of_square / count as f64).sqrt();
        let coarse = grid(cell(points_per_cell.of_square));
        // A propeller leaves most of the square empty, so that a cell is wider than a blade. How much it fills shows in these
        // cells: between irregular points there are no gaps in them.
        let mut counts = vec![0_u32; coarse.len()];
        places().for_each(|uv| counts[coarse.index(uv)] += 1);
        counts.retain(|&count| count > 0);
        let points_per_cell = points_per_cell.adapted_to(&counts);
        let share = f64::min(points_per_cell.filled * counts.len() as f64 / count as f64, 1.0);
        Some(grid(cell(points_per_cell.of_square) * share.sqrt()))
    }

    /// Number of cells.
    fn len(&self) -> usize {
        self.size[0] * self.size[1]
    }

    /// Index of the cell of a place that lies in the grid.
    fn index(&self, uv: [f64; 2]) -> usize {
        let [column, row] = [0, 1].map(|axis| (uv[axis] * self.cells_per_slope - self.first[axis]) as usize);
        row * self.size[0] + column
    }
}

/// Nearest range for each cell of a tangent-plane grid about a camera.
#[derive(Debug, Clone)]
pub(crate) struct DepthMap {
    pub(crate) center: Vector3<f64>,
    camera_from_world: Matrix3<f64>,
    pub(crate) grid: Grid,
    cells: Vec<Cell>,
    /// Where the points lie in a strip, the slab from the first to the last of its lines, as heights over the middle of the view
    /// \[length\]: the sensor moved between them, and the strip is the wider in the map the nearer it is.
    slab: Option<[f64; 2]>,
    /// What is known of directions beside the points.
    pub(crate) surroundings: Surroundings,
}

impl DepthMap {
    pub(crate) fn new(
        center: &Vector3<f64>,
        point_of: impl Fn(usize) -> Vector3<f64> + Sync,
        indices: &[u32],
        points_per_cell: PointsPerCell,
    ) -> Option<Self> {
        let Look { camera_from_world, slab, returns } = Look::from(center, point_of, indices)?;
        let count: usize = returns.iter().map(Vec::len).sum();
        let places = || returns.iter().flatten().map(|(uv, _)| *uv);
        let grid = Grid::over(places, count, points_per_cell)?;
        let mut nearest = vec![f32::INFINITY; grid.len()];
        for (uv, range) in returns.iter().flatten() {
            let slot = &mut nearest[grid.index(*uv)];
            *slot = slot.min(*range);
        }
        let cells = with_neighbors(&nearest, grid.size[0]);
        let surroundings = Surroundings::Unknown;
        Some(Self { center: *center, camera_from_world, grid, cells, slab, surroundings })
    }

    /// Directions that none of the `pictures` from here shows: nothing is known about any place there, where the frame cuts
    /// the part or the map reaches beyond it.
    pub(crate) fn hide_beyond(&mut self, pictures: &[&Picture]) {
        if pictures.is_empty() {
            return;
        }
        let world_from_camera = self.camera_from_world.transpose();
        let is_shown = |column: usize, row: usize| {
            let slope = |axis: usize, cells: usize| {
                (self.grid.first[axis] + cells as f64) / self.grid.cells_per_slope
            };
            let ray = world_from_camera * Vector3::new(slope(0, column), slope(1, row), 1.0);
            pictures.iter().any(|picture| picture.shows(&(picture.center() + ray)))
        };
        let [width, height] = self.grid.size;
        let corners: Vec<bool> = (0..=height)
            .flat_map(|row| (0..=width).map(move |column| (column, row)))
            .map(|(c, r)| is_shown(c, r))
            .collect();
        let is_whole = |index: usize| {
            let corner = index / width * (width + 1) + index % width;
            [0, 1, width + 1, width + 2].iter().all(|step| corners[corner + step])
        };
        let own = self.cells.iter().enumerate();
        let nearest: Vec<f32> = own
            .map(|(index, cell)| if cell.own.is_infinite() && !is_whole(index) { 0.0 } else { cell.own })
            .collect();
        self.cells = with_neighbors(&nearest, width);
    }

    /// A ray toward a surface that any view measured must have met it, or something before it: where nothing came back,
    /// the sensor lost the return, and nothing is known about any place along the ray.
    pub(crate) fn hide_lost(&mut self, points: impl Iterator<Item = Vector3<f64>>) {
        let mut nearest: Vec<f32> = self.cells.iter().map(|cell| cell.own).collect();
        for point in points {
            if let Some(index) = self.index(&point)
                && nearest[index].is_infinite()
            {
                nearest[index] = 0.0;
            }
        }
        self.cells = with_neighbors(&nearest, self.grid.size[0]);
    }

    /// Column and row of a point, also beside the map; `None` behind the camera.
    #[inline]
    fn place(&self, point: &Vector3<f64>) -> Option<[f64; 2]> {
        let local = self.camera_from_world * (point - self.center);
        let scale = self.grid.cells_per_slope / local.z;
        (local.z > 0.0).then(|| [local.x * scale - self.grid.first[0], local.y * scale - self.grid.first[1]])
    }

    /// Whether a place lies in the map, or less than `margin` \[cells\] beside it.
    #[inline]
    fn contains(&self, [column, row]: [f64; 2], margin: f64) -> bool {
        let inside = |x: f64, size: usize| x >= -margin && x < size as f64 + margin;
        inside(column, self.grid.size[0]) && inside(row, self.grid.size[1])
    }

    /// Whether the points lie in a strip, as those of a sensor that measures line by line do.
    pub(crate) fn is_strip(&self) -> bool {
        self.slab.is_some()
    }

    /// Whether a point lies between the first and the last line of a strip, or within a cell of one of them.
    fn is_in_slab(&self, point: &Vector3<f64>) -> bool {
        self.slab.is_none_or(|[lower, upper]| {
            let local = self.camera_from_world * (point - self.center);
            let cell = local.z / self.grid.cells_per_slope;
            (lower - cell..=upper + cell).contains(&local.y)
        })
    }

    /// Index of the cell that shows a point; `None` out of the map.
    #[inline]
    fn index(&self, point: &Vector3<f64>) -> Option<usize> {
        let [column, row] = self.place(point).filter(|place| self.contains(*place, 0.0))?;
        if !self.is_in_slab(point) {
            return None;
        }
        Some(row as usize * self.grid.size[0] + column as usize)
    }

    /// Whether a point lies in empty surroundings.
    fn is_beside(&self, point: &Vector3<f64>) -> bool {
        let reach = BEYOND * self.grid.size[0].max(self.grid.size[1]) as f64;
        let is_shown = |place| match &self.surroundings {
            Surroundings::Unknown => false,
            Surroundings::Near => self.contains(place, reach),
            Surroundings::Picture(picture) => picture.shows(point),
        };
        self.place(point).is_some_and(|place| !self.contains(place, EDGE) && is_shown(place))
    }

    /// Whether a point lies beside the points that were measured, and not just at their edge.
    pub(crate) fn is_outside(&self, point: &Vector3<f64>) -> bool {
        self.place(point).is_none_or(|place| !self.contains(place, EDGE))
    }

    /// The cell that shows a point; `None` out of the map.
    #[inline]
    pub(crate) fn at(&self, point: &Vector3<f64>) -> Option<Cell> {
        self.index(point).map(|index| self.cells[index])
    }

    /// Whether most returns in the cell of a point and in those around are nearer than a `distance` \[length\]: something hides the
    /// point, and not just a stray.
    pub(crate) fn hides(&self, point: &Vector3<f64>, distance: f64) -> bool {
        let Some(index) = self.index(point) else { return false };
        let [width, height] = self.grid.size;
        let around = |place: usize, size: usize| place.saturating_sub(1)..(place + 2).min(size);
        let (mut nearer, mut all) = (0, 0);
        for row in around(index / width, height) {
            for cell in &self.cells[row * width..][around(index % width, width)] {
                all += usize::from(cell.own.is_finite());
                nearer += usize::from(f64::from(cell.own) < distance);
            }
        }
        2 * nearer > all
    }

    /// Width of the narrowest gap at the distance of a place of which a cell says that nothing came back from it and from those
    /// around \[length\].
    pub(crate) fn narrowest_gap(&self, place: &Vector3<f64>) -> f64 {
        3.0 * (place - self.center).norm() / self.grid.cells_per_slope
    }

    /// What this camera says about a place, and whether a return is missing there or beside it.
    #[inline]
    pub(crate) fn seen(&self, point: &Vector3<f64>, margin: f64) -> (Seen, bool) {
        let Some(Cell { own, nearest, beside_missing }) = self.at(point) else {
            return (if self.is_beside(point) { Seen::Missing } else { Seen::Hidden }, true);
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

/// Slopes against the middle of a view in which a return came, and how far away it was \[length\].
type Return = ([f64; 2], f32);

/// What a camera saw, in its own frame: it looks at the middle of the points, with a strip of them along one of its axes.
struct Look {
    camera_from_world: Matrix3<f64>,
    /// Heights of a strip over the middle \[length\].
    slab: Option<[f64; 2]>,
    /// In chunks.
    returns: Vec<Vec<Return>>,
}

impl Look {
    /// Looks from `center` at the points with some indices; `None` where they lie all around it.
    fn from(
        center: &Vector3<f64>,
        point_of: impl Fn(usize) -> Vector3<f64> + Sync,
        indices: &[u32],
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
        let return_of = |ray: Vector3<f64>| -> Option<Return> {
            let local = camera_from_world * ray;
            if local.z <= 0.0 {
                return None;
            }
            let uv = [local.x / local.z, local.y / local.z];
            (uv[0].abs() < limit && uv[1].abs() < limit).then(|| (uv, local.norm() as f32))
        };
        let mut returns: Vec<Vec<Return>> = indices
            .par_chunks(CHUNK)
            .map(|chunk| chunk.iter().map(ray).filter_map(return_of).collect())
            .collect();
        let Some(roll) = roll_of_strip(returns.iter().flatten().map(|(uv, _)| *uv)) else {
            return Some(Self { camera_from_world: camera_from_world.into_inner(), slab: None, returns });
        };
        let turn = Rotation2::new(-roll);
        returns.iter_mut().flatten().for_each(|(uv, _)| *uv = (turn * Vector2::from(*uv)).into());
        let rolled = Rotation3::from_axis_angle(&Vector3::z_axis(), -roll) * camera_from_world;
        let slab = Some(slab(returns.iter().flatten()));
        Some(Self { camera_from_world: rolled.into_inner(), slab, returns })
    }
}

/// Least and greatest height of returns over the middle of a view, along its second axis \[length\].
fn slab<'a>(returns: impl Iterator<Item = &'a Return>) -> [f64; 2] {
    let height = |([u, v], range): &Return| v * f64::from(*range) / (1.0 + u * u + v * v).sqrt();
    returns
        .map(height)
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[lower, upper], h| [lower.min(h), upper.max(h)])
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

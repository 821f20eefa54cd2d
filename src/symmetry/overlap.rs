//! What views say about what others, and they themselves, measured: whether returns are lost, and whether the sensors can have
//! stood where they are said to have stood.

use nalgebra::Vector3;

use crate::symmetry::depth_map::{Cell, DepthMap};

/// Returns in other views that tell what is missing, at least [points of the part].
const OVERLAP: f64 = 0.3;

/// Distance of views that are strips of one, at most [distance to the part].
const STRIPS: f64 = 0.1;

/// Distance that noise, or a view that is a little off, may bring about [extent of the part].
const NOISE: f64 = 0.05;

/// A point of the part.
pub(crate) struct Measured {
    pub(crate) point: Vector3<f64>,
    pub(crate) normal: Vector3<f64>,
    /// That it was seen from.
    pub(crate) place: Vector3<f64>,
}

impl Measured {
    /// Cosine between the normal and the direction to the sensor.
    pub(crate) fn cosine(&self) -> f64 {
        let toward = self.place - self.point;
        self.normal.dot(&toward).abs() / toward.norm().max(f64::MIN_POSITIVE)
    }
}

/// Whether the cosine between a unit normal and the direction `toward` a camera is below that of a `grazing` angle.
pub(crate) fn is_grazed(normal: &Vector3<f64>, toward: &Vector3<f64>, grazing: f64) -> bool {
    normal.dot(toward).powi(2) < grazing * grazing * toward.norm_squared()
}

/// A point of the part in a view that shows the direction in which it lies.
struct Look<'a> {
    seen: &'a Measured,
    view: &'a DepthMap,
    cell: Cell,
    /// Distance to the camera \[length\].
    range: f64,
    /// How far a return may be before or behind the point and still be one of it \[length\].
    margin: f64,
}

impl Look<'_> {
    /// The surface is seen here, too.
    fn is_met(&self) -> bool {
        (f64::from(self.cell.own) - self.range).abs() < self.margin
    }

    /// Only something behind it is seen.
    fn is_looked_through(&self) -> bool {
        self.cell.own.is_finite() && f64::from(self.cell.nearest) > self.range + self.margin
    }

    /// Something before it is seen.
    fn is_hidden(&self) -> bool {
        self.view.hides(&self.seen.point, self.range - self.margin)
    }

    /// Whether the view is the one that measured it, or a strip of the same one: views from nearly the same place are strips of
    /// one, and what is missing in one of them is in the next.
    fn is_by_its_own_view(&self) -> bool {
        (self.view.center - self.seen.place).norm() < STRIPS * self.range
    }
}

/// All points of the part in all views that show where they lie; returns within `margin` \[length\], or three cells, are of the same
/// surface.
fn looks<'a>(views: &'a [DepthMap], part: &'a [Measured], margin: f64) -> impl Iterator<Item = Look<'a>> {
    part.iter().flat_map(move |seen| {
        views.iter().filter_map(move |view| {
            let range = (seen.point - view.center).norm();
            let margin = f64::max(margin, 3.0 * range / view.grid.cells_per_slope);
            Some(Look { seen, view, cell: view.at(&seen.point)?, range, margin })
        })
    })
}

/// Twice the distance of the farthest point from the centroid \[length\].
fn extent(part: &[Measured]) -> f64 {
    let centroid = part.iter().map(|seen| seen.point).sum::<Vector3<f64>>() / part.len().max(1) as f64;
    2.0 * part.iter().map(|seen| (seen.point - centroid).norm()).fold(0.0, f64::max)
}

/// Returns that are missing for each that came, over some of the points of the part and all views that did not measure them.
pub(crate) fn loss_ratio(views: &[DepthMap], part: &[Measured], grazing: f64) -> f64 {
    let (mut missing, mut came) = (0.0, 0.0);
    for look in looks(views, part, 0.0).filter(|look| !look.is_by_its_own_view()) {
        if look.cell.nearest.is_infinite() {
            let toward = look.view.center - look.seen.point;
            missing += f64::from(u8::from(!is_grazed(&look.seen.normal, &toward, grazing)));
        } else if look.is_met() {
            came += 1.0;
        }
    }
    // Where views hardly overlap, what is missing lies at their edges.
    let others = f64::max(came, OVERLAP * part.len() as f64);
    if missing > 0.0 { missing / f64::max(others, missing) } else { 0.0 }
}

/// What sensors cannot have measured from where they are said to have stood. Each sees the nearest surface in any direction, and
/// none looks through what another one measured.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Conflict {
    /// Share of the points of other views where a view saw something behind them, among these and those that it met.
    pub(crate) looked_through: f64,
    /// Share of the points of all views that lie behind others of the same view.
    pub(crate) behind_others: f64,
}

impl Conflict {
    /// That of the points of the part.
    pub(crate) fn of(views: &[DepthMap], part: &[Measured]) -> Self {
        let [mut through, mut met, mut behind, mut own] = [0.0; 4];
        for look in looks(views, part, NOISE * extent(part)) {
            if look.view.center == look.seen.place {
                own += 1.0;
                behind += f64::from(u8::from(look.is_hidden()));
            } else if !look.is_by_its_own_view() {
                through += f64::from(u8::from(look.is_looked_through()));
                met += f64::from(u8::from(look.is_met()));
            }
        }
        // A few points in which views hardly overlap, or that are seen at all, tell nothing.
        let share = |count: f64, of: f64| count / f64::max(of, OVERLAP * part.len() as f64).max(1.0);
        Self { looked_through: share(through, through + met), behind_others: share(behind, own) }
    }
}

//! Free space: what the cameras saw to be empty.
//!
//! A ray proves that space is free up to the point that it measured, and the support that it is below. A direction without a
//! return, among the points of a view or beside them, proves nothing, but makes empty space likely.

use nalgebra::Vector3;
use rayon::prelude::*;

use crate::picture::Picture;
pub use crate::symmetry::depth_map::Seen;
use crate::symmetry::depth_map::{DepthMap, PointsPerCell, Surroundings};
use crate::symmetry::overlap::{Conflict, Measured, is_grazed, loss_ratio};
use crate::viewpoints::NEAR;

/// Views beyond this number add little evidence and cost time, unless they are strips; the ones with most points are kept.
const MAX_VIEWS: usize = 16;

/// Strips that are kept: each shows a piece of the part that no other one does.
const MAX_STRIPS: usize = 256;

/// Points in a cell, so that one without return is a true gap; small, so that holes in the part show.
const POINTS_PER_CELL: PointsPerCell = PointsPerCell { of_square: 2.0, filled: 4.0 };

/// The same where returns are lost.
const LOSSY_POINTS_PER_CELL: PointsPerCell = PointsPerCell { of_square: 4.0, filled: 5.0 };

/// Points of the part that are looked for in every view.
const LOOKED_AT: usize = 2000;

/// Returns missing for each that came, below which the sensor loses none.
const NO_LOSS: f64 = 0.01;

/// The same in coarser maps: as many are missing about the edges of what any sensor sees.
const EDGES: f64 = 0.04;

/// Views in which a return is missing where many are lost, so that there likely is nothing.
const AGREEING: usize = 2;

/// Cosine between the normal of a surface and the direction to a camera below which it is seen at a grazing angle: it
/// leaves few returns there, far from each other, which pass for strays or are lost.
const GRAZING: f64 = 0.26;

/// The same of a sensor that gets no return from less steep surfaces either, at most: from the front a flat part shows hardly any,
/// which says nothing of the sensor.
const STEEPEST: f64 = 0.6;

/// Between that and the cosine below which a tenth of the points was measured, at most: what a sensor cuts off is cut off sharply,
/// while few steep places on a flat part are its details.
const SHARP: f64 = 0.15;

/// Share of the points of the part that may be measured at a grazing angle: those at edges, whose normals are rough.
const GRAZED: f64 = 0.01;

/// Depth maps of the views, rebuilt from the points and their viewpoints.
#[derive(Debug, Clone)]
pub struct Visibility {
    views: Vec<DepthMap>,
    /// Unit normal and offset of the plane below which there is nothing.
    support: Option<(Vector3<f64>, f64)>,
    /// Returns that are missing for each that came, where one view measured a surface that another one should have
    /// seen: 0 for a sensor that loses none, 1 where as many are missing, or more.
    pub dropout: f64,
    /// What speaks against the places of the sensors.
    pub(crate) conflict: Conflict,
    /// Whether a gap of a few points shows: not where returns are lost.
    pub shows_details: bool,
    /// Cosine between the normal of a surface and the direction to a camera below which a missing return says nothing.
    pub grazing: f64,
    /// Whether the only view is taken to lose returns in patches, as from shiny metal, which no other view can tell.
    pub is_patchy: bool,
    /// Whether only what several cameras agree on was measured, so that a missing return says nothing.
    is_fused: bool,
}

impl Visibility {
    /// Bins the points of each view by direction: `count` of them, which `point_of` gives as often as they are asked for,
    /// each seen from those of `places` that `places_of` numbers, at least one, of which the first measured it. `None` where
    /// there is no view with enough points. Whether returns are lost, and at which angles, is judged by the points of the part,
    /// of which `normal_of` gives the normals: the support reaches beyond the picture of a camera. `pictures` are those that
    /// are known.
    #[must_use]
    pub fn new<I: IntoIterator<Item = usize>>(
        count: usize,
        point_of: impl Fn(usize) -> Vector3<f64> + Sync,
        places: &[Vector3<f64>],
        places_of: impl Fn(usize) -> I,
        normal_of: impl Fn(usize) -> Option<Vector3<f64>>,
        pictures: &[Picture],
    ) -> Option<Self> {
        let mut members: Vec<(&Vector3<f64>, Vec<u32>)> = places.iter().map(|p| (p, Vec::new())).collect();
        for i in 0..count as u32 {
            for place in places_of(i as usize) {
                let indices = &mut members[place].1;
                // Of places that were joined a point may have two.
                if indices.last() != Some(&i) {
                    indices.push(i);
                }
            }
        }
        members.sort_by_key(|(_, indices)| std::cmp::Reverse(indices.len()));
        members.truncate(MAX_STRIPS);
        let own = || (0..count).filter_map(|i| Some((i, normal_of(i)?)));
        let step = own().count().div_ceil(LOOKED_AT).max(1);
        let seen = |(i, normal)| {
            let place = places[places_of(i).into_iter().next()?];
            Some(Measured { point: point_of(i), normal, place })
        };
        let part: Vec<Measured> = own().step_by(step).filter_map(seen).collect();
        let maps = |points_per_cell: PointsPerCell| -> Vec<DepthMap> {
            let map = |(rank, (center, indices)): (usize, &(&Vector3<f64>, Vec<u32>))| {
                let mut map = DepthMap::new(center, &point_of, indices, points_per_cell)?;
                map.hide_beyond(&pictures_from(center, &part, pictures));
                (rank < MAX_VIEWS || map.is_strip()).then_some(map)
            };
            members.par_iter().enumerate().filter_map(map).collect()
        };
        let mut views = maps(POINTS_PER_CELL);
        if views.is_empty() {
            return None;
        }
        let grazing = grazing(&part);
        let is_lossy = loss_ratio(&views, &part, grazing) >= NO_LOSS;
        let conflict = Conflict::of(&views, &part);
        let mut dropout = 0.0;
        if is_lossy {
            views = maps(LOSSY_POINTS_PER_CELL);
            let lost = loss_ratio(&views, &part, grazing);
            dropout = if lost > EDGES { lost } else { 0.0 };
        }
        views.par_iter_mut().for_each(|view| {
            if is_lossy {
                view.hide_lost((0..count).map(&point_of));
            }
            view.surroundings = surroundings(view, &part, pictures);
        });
        Some(Self {
            views,
            support: None,
            dropout,
            conflict,
            shows_details: !is_lossy,
            grazing,
            is_patchy: false,
            is_fused: false,
        })
    }

    /// Takes all that lies more than `depth` \[length\] below a plane, which has its normal up, for empty: the part stands
    /// on it.
    #[must_use]
    pub fn supported_by(self, plane: [f64; 4], depth: f64) -> Self {
        let [x, y, z, d] = plane;
        Self { support: Some((Vector3::new(x, y, z), d + depth)), ..self }
    }

    /// Takes the view for one that loses returns in patches.
    #[must_use]
    pub fn patchy(self) -> Self {
        Self { shows_details: false, is_patchy: true, ..self }
    }

    /// Takes the points for those on which several cameras agree.
    #[must_use]
    pub fn fused(self) -> Self {
        Self { is_fused: true, ..self }
    }

    /// Number of views.
    #[must_use]
    pub fn views(&self) -> usize {
        self.views.len()
    }

    /// Width of the narrowest gap at the distance of a `place` that any view shows \[length\].
    #[must_use]
    pub fn narrowest_gap(&self, place: &Vector3<f64>) -> f64 {
        self.views.iter().map(|view| view.narrowest_gap(place)).fold(f64::INFINITY, f64::min)
    }

    /// What the cameras say about a surface at `point` that faces along `normal`, where that is known; a measurement
    /// within `margin` \[length\] in front of it counts as hiding it. A missing return says nothing of a surface at a
    /// grazing angle, where many are lost nothing unless another camera misses it, too, and in a fused cloud nothing. Of
    /// surfaces steeper than all that was measured a return from behind says nothing either. Where returns of a camera may be
    /// lost, as `is_barred` says given its place, a missing one says nothing, and one beside a missing one proves nothing free.
    /// What lies below the support is free.
    #[must_use]
    pub fn seen(
        &self,
        point: &Vector3<f64>,
        normal: Option<&Vector3<f64>>,
        margin: f64,
        is_barred: impl Fn(&Vector3<f64>) -> bool,
    ) -> Seen {
        if self.support.is_some_and(|(up, offset)| up.dot(point) + offset < 0.0) {
            return Seen::Free;
        }
        let is_grazed_from = |center: &Vector3<f64>| {
            normal.is_some_and(|normal| is_grazed(normal, &(center - point), self.grazing))
        };
        // A cell at the edge of a steep surface that gave no return holds only what lies behind it.
        let loses_steep = self.grazing > GRAZING;
        let mut missing = 0;
        for view in &self.views {
            let (seen, beside_missing) = view.seen(point, margin);
            let is_told = || !(beside_missing && is_barred(&view.center));
            match seen {
                Seen::Free if is_told() && !(loses_steep && is_grazed_from(&view.center)) => {
                    return Seen::Free;
                }
                Seen::Missing if is_told() && !is_grazed_from(&view.center) => missing += 1,
                _ => {}
            }
        }
        let agreeing = if self.dropout > 0.0 { AGREEING } else { 1 };
        if missing >= agreeing && !self.is_fused { Seen::Missing } else { Seen::Hidden }
    }
}

/// The cosine below which hardly anything was measured of the part.
fn grazing(part: &[Measured]) -> f64 {
    let mut cosines: Vec<f64> = part.iter().map(Measured::cosine).collect();
    if cosines.is_empty() {
        return GRAZING;
    }
    let mut lowest = |share: f64| {
        let few = (share * cosines.len() as f64) as usize;
        *cosines.select_nth_unstable_by(few, f64::total_cmp).1
    };
    let (least, low) = (lowest(GRAZED), lowest(0.1));
    if least <= STEEPEST && low - least <= SHARP { least.max(GRAZING) } else { GRAZING }
}

/// The pictures that were taken from the place of a view, the nearest one first.
fn pictures_from<'a>(center: &Vector3<f64>, part: &[Measured], pictures: &'a [Picture]) -> Vec<&'a Picture> {
    let away = |picture: &Picture| (picture.center() - center).norm();
    let range = part.first().map_or(0.0, |seen| (seen.point - center).norm());
    let mut from: Vec<&Picture> = pictures.iter().filter(|picture| away(picture) <= NEAR * range).collect();
    from.sort_by(|a, b| away(a).total_cmp(&away(b)));
    from
}

/// What a view says about directions beside its points. Where all that other views measured of the part, and that its
/// picture would have shown, lies among its points, these were not cut off by anything: it saw nothing beside them. With
/// neither another view nor a known picture nothing tells.
fn surroundings(view: &DepthMap, part: &[Measured], pictures: &[Picture]) -> Surroundings {
    /// Share of these points that may be strays: a rim that a view lost at its edge is more.
    const STRAYS: f64 = 0.0005;
    let others: Vec<&Vector3<f64>> =
        part.iter().filter(|seen| seen.place != view.center).map(|seen| &seen.point).collect();
    let picture = pictures_from(&view.center, part, pictures).into_iter().next();
    let is_shown = |point: &Vector3<f64>| picture.is_none_or(|picture| picture.shows(point));
    let beside = others.iter().filter(|point| view.is_outside(point) && is_shown(point)).count();
    if beside as f64 > STRAYS * others.len() as f64 {
        return Surroundings::Unknown;
    }
    match picture {
        Some(picture) => Surroundings::Picture(*picture),
        None if others.is_empty() => Surroundings::Unknown,
        None => Surroundings::Near,
    }
}

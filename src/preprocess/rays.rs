//! Noise of depth lies along the rays of a sensor, and is averaged there: among rays that are neighbours in its picture.
//!
//! Neighbours in space are chosen by their noise as well. Seen obliquely, noise carries points beyond the edge of a blade,
//! and only those that it also raised, so that their mean bends up there. In the picture every point is where its ray is.

use nalgebra::{Matrix2, Vector2, Vector3};
use rayon::prelude::*;

use super::neighbors::map_neighbors;
use super::search::nearest;
use super::selection::Near;
use super::{at_least_one, check_finite};
use crate::directions::tangents;
use crate::error::Result;
use crate::median::{median, robust_sigma};
use crate::spatial::KdTree;

/// Least points of a view; fewer say too little of their noise \[neighbours\].
const ENOUGH: usize = 8;

/// Where Tukey's biweight ends [standard deviations of the noise].
const BIWEIGHT: f64 = 3.5;

/// How far a point is moved at most; one beyond is no noise but something else [standard deviations of the noise].
const FARTHEST: f64 = 4.0;

/// Rounds in which the weights of a plane are found.
const ROUNDS: usize = 3;

/// Standard deviation of the points along the rays of their sensor \[length\], about the planes of the `k` nearest rays:
/// that of the place which saw most of them; 0 where no place saw enough.
///
/// Unlike a spread about the surface in space, it hardly depends on the shape of the part, or on how densely it was scanned.
/// `places` and `place_of` are those of [`smooth_along_rays`].
///
/// ```
/// use sympose::preprocess::noise_along_rays;
/// // A rough plate under a sensor.
/// let at = |i: u32| [0.1 * f64::from(i % 40) - 2.0, 0.1 * f64::from(i / 40) - 2.0, 0.01 * f64::from(i * i % 7)];
/// let points: Vec<[f64; 3]> = (0..1600).map(at).collect();
/// let noise = noise_along_rays(&points, &[[0.0, 0.0, 5.0]], |_| 0, 13)?;
/// assert!((0.01..0.03).contains(&noise), "{noise}");
/// # Ok::<(), sympose::Error>(())
/// ```
///
/// # Errors
/// [`Error::InvalidParameter`](crate::Error::InvalidParameter) when `k` is 0,
/// [`Error::NonFinite`](crate::Error::NonFinite).
pub fn noise_along_rays(
    points: &[[f64; 3]],
    places: &[[f64; 3]],
    place_of: impl Fn(usize) -> usize,
    k: usize,
) -> Result<f64> {
    /// Rays of a picture that shows its noise.
    const PICTURE: usize = 20_000;
    at_least_one(k)?;
    check_finite(points)?;
    let mut counts = vec![0_usize; places.len()];
    for i in 0..points.len() {
        if let Some(count) = counts.get_mut(place_of(i)) {
            *count += 1;
        }
    }
    let Some((fullest, &count)) = counts.iter().enumerate().max_by_key(|(_, count)| **count) else {
        return Ok(0.0);
    };
    let rows = (0..points.len()).filter(|&i| place_of(i) == fullest);
    let (_, seen) = rays_from(&places[fullest], points, rows.step_by(count.div_ceil(PICTURE).max(1)));
    if !shows_noise(&seen, k) {
        return Ok(0.0);
    }
    let mut distances: Vec<f64> = seen.iter().map(|ray| ray.norm()).collect();
    let distance = median(&mut distances).unwrap_or_default();
    Ok(View::new(&seen)?.noise(k) * distance * distance)
}

/// Moves each point along its ray onto the plane of the `k` nearest rays of its view, its own among them, as far as they
/// met one surface: local regression (Cleveland 1979), in which near rays count more.
///
/// `places` are the positions of the sensor \[length\]; `place_of` gives for each point the index of the one it was seen
/// from. Points farther off than noise, those amid rays that met other surfaces, those of views with few points, and those
/// of no place stay where they are.
///
/// ```
/// use sympose::preprocess::smooth_along_rays;
/// // A rough plate under a sensor.
/// let at = |i: u32| [0.1 * f64::from(i % 40) - 2.0, 0.1 * f64::from(i / 40) - 2.0, 0.01 * f64::from(i * i % 7)];
/// let points: Vec<[f64; 3]> = (0..1600).map(at).collect();
/// let smooth = smooth_along_rays(&points, &[[0.0, 0.0, 5.0]], |_| 0, 9)?;
/// let roughness = |points: &[[f64; 3]]| points.iter().map(|[_, _, z]| (z - 0.02).powi(2)).sum::<f64>();
/// assert!(roughness(&smooth) < 0.3 * roughness(&points));
/// # Ok::<(), sympose::Error>(())
/// ```
///
/// # Errors
/// [`Error::InvalidParameter`](crate::Error::InvalidParameter) when `k` is 0 and a view has more points than that,
/// [`Error::NonFinite`](crate::Error::NonFinite).
pub fn smooth_along_rays(
    points: &[[f64; 3]],
    places: &[[f64; 3]],
    place_of: impl Fn(usize) -> usize,
    k: usize,
) -> Result<Vec<[f64; 3]>> {
    check_finite(points)?;
    let mut rows_of_place = vec![Vec::new(); places.len()];
    for i in 0..points.len() {
        if let Some(rows) = rows_of_place.get_mut(place_of(i)) {
            rows.push(i);
        }
    }
    let mut smooth = points.to_vec();
    for (place, rows) in places.iter().zip(rows_of_place) {
        let (rows, seen) = rays_from(place, points, rows.into_iter());
        if !shows_noise(&seen, k) {
            continue;
        }
        let place = Vector3::from(*place);
        let view = View::new(&seen)?;
        let noise = view.noise(k);
        let depths = map_neighbors(&view.tree, &view.rays, k, |i, found| view.smoothed(i, found, noise))?;
        for ((row, ray), depth) in rows.into_iter().zip(&view.rays).zip(depths) {
            if let Some(depth) = depth {
                smooth[row] = (place + Vector3::from(*ray) * depth).into();
            }
        }
    }
    Ok(smooth)
}

/// From a place to the points of these rows, those in the place itself left out.
fn rays_from(
    place: &[f64; 3],
    points: &[[f64; 3]],
    rows: impl Iterator<Item = usize>,
) -> (Vec<usize>, Vec<Vector3<f64>>) {
    rows.map(|i| (i, Vector3::from(points[i]) - Vector3::from(*place)))
        .filter(|(_, seen)| seen.norm().recip().is_finite())
        .unzip()
}

/// Whether a view has points enough to tell their noise.
fn shows_noise(seen: &[Vector3<f64>], k: usize) -> bool {
    seen.len() >= ENOUGH.saturating_mul(k.max(1))
}

/// The points of one view, as a picture.
struct View {
    /// Unit directions in which the points were seen.
    rays: Vec<[f64; 3]>,
    tree: KdTree,
    /// Inverse of the distance of each point, which over a picture is linear where the surface is a plane [1 / length].
    inverse: Vec<f64>,
}

/// A ray beside another one.
struct Beside {
    /// Where it meets the plane at distance 1 that the other ray is normal to.
    at: Vector2<f64>,
    /// Inverse of the depth along the other ray [1 / length].
    inverse: f64,
    /// Weight for being near, from 1 to 0 for the farthest: which of several at one distance is found must not matter.
    nearness: f64,
    /// Weight for being near and for agreeing with the plane.
    weight: f64,
}

impl View {
    fn new(seen: &[Vector3<f64>]) -> Result<Self> {
        let inverse: Vec<f64> = seen.iter().map(|p| p.norm().recip()).collect();
        let rays: Vec<[f64; 3]> =
            seen.iter().zip(&inverse).map(|(p, inverse)| (p * *inverse).into()).collect();
        Ok(Self { tree: KdTree::new(&rays)?, rays, inverse })
    }

    /// Standard deviation of the inverse distances about the planes of `k` rays [1 / length].
    fn noise(&self, k: usize) -> f64 {
        /// Rays that are looked at.
        const LOOKED_AT: usize = 2000;
        let step = self.rays.len().div_ceil(LOOKED_AT).max(1);
        let around: Vec<(usize, Vec<Near>)> = (0..self.rays.len())
            .into_par_iter()
            .step_by(step)
            .map(|i| (i, nearest(&self.tree, &self.rays, &self.rays[i], k)))
            .collect();
        let residual = |&(i, ref found): &(usize, Vec<Near>), noise: f64| {
            let mut beside = self.beside(i, found);
            let (inverse, slope) = plane(&mut beside, self.inverse[i], noise)?;
            let mut off: Vec<f64> =
                beside.iter().map(|ray| (ray.inverse - inverse - slope.dot(&ray.at)).abs()).collect();
            median(&mut off)
        };
        // The plane takes three of the degrees of freedom.
        let freedom = (k as f64 / (k as f64 - 3.0).max(1.0)).sqrt();
        (0..ROUNDS).fold(f64::INFINITY, |noise, _| {
            let mut residuals: Vec<f64> =
                around.par_iter().filter_map(|looked| residual(looked, noise)).collect();
            freedom * robust_sigma(&mut residuals)
        })
    }

    /// Rays beside the ray `i`.
    fn beside(&self, i: usize, found: &[Near]) -> Vec<Beside> {
        let ahead = Vector3::from(self.rays[i]);
        let [right, down] = tangents(&ahead);
        let farthest_sq = found.iter().fold(f64::MIN_POSITIVE, |farthest, n| farthest.max(n.distance_sq()));
        let beside = |neighbor: &Near| {
            let ray = Vector3::from(self.rays[neighbor.index as usize]);
            let cosine = ray.dot(&ahead);
            Beside {
                at: Vector2::new(ray.dot(&right), ray.dot(&down)) / cosine,
                inverse: self.inverse[neighbor.index as usize] / cosine,
                nearness: 1.0 - (neighbor.distance_sq() / farthest_sq).powi(2),
                weight: 0.0,
            }
        };
        let is_ahead = |ray: &Beside| ray.inverse.is_finite() && ray.inverse > 0.0;
        // With room for all: a filter does not say how many there will be, and the list would grow step by step.
        let mut rays = Vec::with_capacity(found.len());
        rays.extend(found.iter().map(beside).filter(is_ahead));
        rays
    }

    /// Distance of the plane of the rays `found` along the ray `i` among them \[length\]; `None` where its own point is not
    /// of that plane.
    fn smoothed(&self, i: usize, found: &[Near], noise: f64) -> Option<f64> {
        let own = self.inverse[i];
        let (inverse, _) = plane(&mut self.beside(i, found), own, noise)?;
        // Never to more than twice the distance, however large the noise seems to be.
        let farthest = (FARTHEST * noise).min(0.5 * own);
        ((inverse - own).abs() <= farthest).then(|| inverse.recip())
    }
}

/// The plane of those rays that agree with `start`, and then with one another: inverse of its depth ahead, and how that
/// changes across the picture. `None` where they lie on a line.
fn plane(rays: &mut [Beside], start: f64, noise: f64) -> Option<(f64, Vector2<f64>)> {
    /// Least area of the ellipse that the rays spread over [that of a circle].
    const FLATTEST: f64 = 0.004;
    let mut plane = (start, Vector2::zeros());
    for _ in 0..ROUNDS {
        let (inverse, slope) = plane;
        let (mut weight, mut at, mut depth) = (0.0, Vector2::zeros(), 0.0);
        for ray in rays.iter_mut() {
            let off = (ray.inverse - inverse - slope.dot(&ray.at)) / (BIWEIGHT * noise);
            ray.weight = ray.nearness * (1.0 - off * off).max(0.0).powi(2);
            weight += ray.weight;
            at += ray.at * ray.weight;
            depth += ray.inverse * ray.weight;
        }
        if weight <= 0.0 {
            return None;
        }
        let (at, depth) = (at / weight, depth / weight);
        let (mut scatter, mut moment) = (Matrix2::zeros(), Vector2::zeros());
        for ray in rays.iter() {
            let off = ray.at - at;
            scatter += off * off.transpose() * ray.weight;
            moment += off * ((ray.inverse - depth) * ray.weight);
        }
        if scatter.determinant() <= FLATTEST * 0.25 * scatter.trace().powi(2) {
            return None;
        }
        let slope = scatter.try_inverse()? * moment;
        plane = (depth - slope.dot(&at), slope);
    }
    Some(plane)
}

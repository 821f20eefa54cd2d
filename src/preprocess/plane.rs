//! The plane with the most points: RANSAC, then total least squares on its inliers.

use std::ops::Range;

use nalgebra::Vector3;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::eigen::smallest_eigenvector;
use super::moments::Moments;
use super::{CHUNK, check_finite};
use crate::error::{Error, Result, shown};
use crate::sampling::{below, even_indices};
use crate::validate::positive;

/// Hypotheses between two looks at the stopping rule; fixed, so that it does not depend on the number of threads.
const BATCH: usize = 64;
/// Points that a hypothesis is judged on before it is fitted to all.
const SAMPLE: usize = 4096;
/// Those of them on which it is judged first.
const FIRST: usize = 512;
/// Hypotheses that are refined on all points.
const FINALISTS: usize = 4;
/// Least-squares fits of a finalist, each on the inliers of the one before.
const REFITS: usize = 2;

/// Settings of [`segment_plane`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PlaneParams {
    /// Largest distance of an inlier from the plane, inclusive \[length\].
    pub distance: f64,
    /// Hypotheses tried at most \[count\].
    pub max_iterations: usize,
    /// Probability of having drawn three inliers at which the search stops, in (0, 1].
    pub probability: f64,
    /// Seed of the samples.
    pub seed: u64,
}

impl Default for PlaneParams {
    /// A distance of 0.01, which only fits a cloud of extent 1 or so: set it.
    fn default() -> Self {
        Self { distance: 0.01, max_iterations: 1000, probability: 0.9999, seed: 0 }
    }
}

/// A plane and the points on it.
#[derive(Debug, Clone, PartialEq)]
pub struct Plane {
    /// Unit normal n, its largest component positive, and d, with n . x + d = 0.
    pub coefficients: [f64; 4],
    /// Points within the distance, ascending.
    pub inliers: Vec<u32>,
    /// Hypotheses that were tried.
    pub iterations: usize,
}

/// Finds the plane that has the most points within `distance`.
///
/// Three-point hypotheses (Fischler and Bolles 1981) are judged on an even sample of the cloud; the best few are fitted
/// to their inliers by total least squares and counted on all points. The same seed gives the same plane at any number
/// of threads.
///
/// ```
/// use sympose::preprocess::{PlaneParams, segment_plane};
/// let mut points: Vec<[f64; 3]> = (0..400).map(|i| [f64::from(i % 20), f64::from(i / 20), 2.0]).collect();
/// points.push([3.0, 4.0, 9.0]);
/// let plane = segment_plane(&points, &PlaneParams { distance: 0.1, ..PlaneParams::default() })?;
/// assert_eq!(plane.inliers.len(), 400);
/// assert!(plane.coefficients[2] > 0.999 && (plane.coefficients[3] + 2.0).abs() < 1e-6);
/// # Ok::<(), sympose::Error>(())
/// ```
///
/// # Errors
/// [`Error::InvalidParameter`] when `distance` is not positive, `probability` lies outside (0, 1] or `max_iterations` is 0;
/// [`Error::NonFinite`]; [`Error::InsufficientData`] for fewer than 3 points, [`Error::Degenerate`] when all points lie on a
/// line or coincide.
pub fn segment_plane(points: &[[f64; 3]], params: &PlaneParams) -> Result<Plane> {
    check(points, params)?;
    let mut random = ChaCha8Rng::seed_from_u64(params.seed);
    let sample = Sample::new(points, &even_indices(points.len(), SAMPLE, &mut random));
    let mut finalists = vec![Candidate { inliers: 0, plane: widest(points)? }];
    let mut iterations = 0;
    let mut wanted = params.max_iterations;
    while iterations < wanted {
        let batch = BATCH.min(wanted - iterations);
        let triples: Vec<[usize; 3]> =
            (0..batch).map(|_| std::array::from_fn(|_| below(&mut random, points.len()))).collect();
        let least = finalists.get(FINALISTS - 1).map_or(0, |last| last.inliers);
        finalists.par_extend(triples.into_par_iter().with_min_len(BATCH / 8).filter_map(|triple| {
            let plane = HalfSpace::through(triple.map(|i| Vector3::from(points[i])))?;
            let inliers = sample.count_unless_below(least, &plane, params.distance)?;
            Some(Candidate { inliers, plane })
        }));
        // Stable: of equal counts the hypothesis drawn first stays in front.
        finalists.sort_by_key(|candidate| std::cmp::Reverse(candidate.inliers));
        finalists.truncate(FINALISTS);
        iterations += batch;
        let share = finalists[0].inliers as f64 / sample.len() as f64;
        wanted = wanted.min(trials(share, params.probability));
    }
    let refined: Vec<Candidate> =
        finalists.par_iter().map(|candidate| refine(points, candidate.plane, params.distance)).collect();
    let best =
        refined.into_iter().reduce(|best, other| if other.inliers > best.inliers { other } else { best });
    let plane = best.map_or(finalists[0].plane, |best| best.plane).with_positive_main_component();
    let inliers = (0_u32..).zip(points).filter(|(_, p)| plane.distance(p).abs() <= params.distance);
    Ok(Plane { coefficients: plane.coefficients(), inliers: inliers.map(|(i, _)| i).collect(), iterations })
}

fn check(points: &[[f64; 3]], params: &PlaneParams) -> Result<()> {
    check_finite(points)?;
    if points.len() < 3 {
        return Err(Error::InsufficientData {
            stage: "plane",
            needed: 3,
            got: points.len(),
            hint: "a plane needs three points that are not on a line",
        });
    }
    positive("distance", params.distance)?;
    if !(params.probability > 0.0 && params.probability <= 1.0) {
        return Err(Error::InvalidParameter {
            name: "probability",
            value: shown(params.probability),
            expected: "a probability in (0, 1]",
        });
    }
    if params.max_iterations == 0 {
        return Err(Error::InvalidParameter {
            name: "max_iterations",
            value: "0".into(),
            expected: "at least 1",
        });
    }
    Ok(())
}

/// Points on which hypotheses are compared, coordinate by coordinate, so that several are judged at a time.
struct Sample([Vec<f64>; 3]);

impl Sample {
    fn new(points: &[[f64; 3]], chosen: &[usize]) -> Self {
        // Any stretch of them is spread over all.
        let step = chosen.len().div_ceil(FIRST).max(1);
        let spread = || (0..step).flat_map(|first| chosen.iter().skip(first).step_by(step));
        Self([0, 1, 2].map(|axis| spread().map(|&i| points[i][axis]).collect()))
    }

    fn len(&self) -> usize {
        self.0[0].len()
    }

    /// Points within `distance` of a plane; `None` where already the first ones say that they are fewer than `least`.
    fn count_unless_below(&self, least: usize, plane: &HalfSpace, distance: f64) -> Option<usize> {
        /// Standard deviations that a first count is given.
        const LUCK: f64 = 3.0;
        let first = FIRST.min(self.len());
        let few = self.count(0..first, plane, distance);
        let hoped = few as f64 + LUCK * (few as f64 + 1.0).sqrt();
        (hoped * self.len() as f64 >= (least * first) as f64)
            .then(|| few + self.count(first..self.len(), plane, distance))
    }

    fn count(&self, range: Range<usize>, plane: &HalfSpace, distance: f64) -> usize {
        let [x, y, z] = self.0.each_ref().map(|values| &values[range.clone()]);
        let near =
            |((x, y), z): ((&f64, &f64), &f64)| u64::from(plane.distance(&[*x, *y, *z]).abs() <= distance);
        x.iter().zip(y).zip(z).map(near).sum::<u64>() as usize
    }
}

#[derive(Debug, Clone, Copy)]
struct Candidate {
    inliers: usize,
    plane: HalfSpace,
}

/// A plane with a side: unit normal n and d, n . x + d is the signed distance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct HalfSpace {
    pub(crate) normal: Vector3<f64>,
    pub(crate) d: f64,
}

impl HalfSpace {
    /// The plane through three points, unless they are on a line.
    fn through([p, q, r]: [Vector3<f64>; 3]) -> Option<Self> {
        let (u, v) = (q - p, r - p);
        let cross = u.cross(&v);
        // The sine of the angle between the edges, below which rounding decides where the plane is.
        let smallest = 1e-9 * u.norm() * v.norm();
        (cross.norm() > smallest).then(|| Self::new(cross.normalize(), &p))
    }

    fn new(normal: Vector3<f64>, point: &Vector3<f64>) -> Self {
        Self { normal, d: -normal.dot(point) }
    }

    /// Signed distance of a point \[length\].
    #[inline]
    pub(crate) fn distance(&self, p: &[f64; 3]) -> f64 {
        self.normal.x * p[0] + self.normal.y * p[1] + self.normal.z * p[2] + self.d
    }

    pub(crate) fn coefficients(&self) -> [f64; 4] {
        // Without the sign of a zero.
        [self.normal.x, self.normal.y, self.normal.z, self.d].map(|x| x + 0.0)
    }

    pub(crate) fn flipped(&self) -> Self {
        Self { normal: -self.normal, d: -self.d }
    }

    fn with_positive_main_component(self) -> Self {
        let main = self.normal[self.normal.iamax()];
        if main < 0.0 { self.flipped() } else { self }
    }

    /// Total least squares on the points within `distance` of this plane; `None` when they do not span a plane.
    pub(crate) fn refitted(&self, points: &[[f64; 3]], distance: f64) -> Option<Self> {
        // Moments about a point of the plane amid the data keep the covariance from cancelling.
        let near = |p: &&[f64; 3]| self.distance(p).abs() <= distance;
        let reference = Vector3::from(*points.iter().find(near)?);
        let moments: Vec<Moments> = points
            .par_chunks(CHUNK)
            .map(|chunk| {
                let mut sum = Moments::default();
                chunk.iter().filter(near).for_each(|p| sum.add((Vector3::from(*p) - reference).into()));
                sum
            })
            .collect();
        let mut all = Moments::default();
        moments.iter().for_each(|part| all.join(part));
        let (normal, values) = smallest_eigenvector(&all.scatter());
        (all.count >= 3.0 && values[1] > 0.0).then(|| Self::new(normal, &(all.sum() / all.count + reference)))
    }
}

/// Fits a hypothesis to its inliers on all points; what is left is the least-squares plane of inliers.
fn refine(points: &[[f64; 3]], hypothesis: HalfSpace, distance: f64) -> Candidate {
    let count = |plane: HalfSpace| {
        let chunk_count =
            |chunk: &[[f64; 3]]| chunk.iter().filter(|p| plane.distance(p).abs() <= distance).count();
        points.par_chunks(CHUNK).map(chunk_count).sum::<usize>()
    };
    let mut best = Candidate { inliers: count(hypothesis), plane: hypothesis };
    for _ in 0..REFITS {
        let Some(plane) = best.plane.refitted(points, distance) else { break };
        let inliers = count(plane);
        // A plane through three points may have some more by chance, but noise tilts it.
        let by_chance = (best.inliers as f64).sqrt();
        if inliers as f64 + by_chance < best.inliers as f64 {
            break;
        }
        best = Candidate { inliers, plane };
    }
    best
}

/// Hypotheses after which three inliers have been drawn with the given probability.
fn trials(share: f64, probability: f64) -> usize {
    let miss = 1.0 - share.powi(3);
    let needed = (1.0 - probability).ln() / miss.ln();
    if needed.is_finite() {
        needed.ceil().max(1.0) as usize
    } else if miss <= 0.0 {
        1
    } else {
        usize::MAX
    }
}

/// The plane through three points far apart: a first hypothesis that no bad luck with samples can miss.
fn widest(points: &[[f64; 3]]) -> Result<HalfSpace> {
    let first = Vector3::from(points[0]);
    let farthest = |measure: &dyn Fn(&Vector3<f64>) -> f64| {
        points.iter().map(|p| Vector3::from(*p)).fold((first, 0.0), |best, p| {
            let value = measure(&p);
            if value > best.1 { (p, value) } else { best }
        })
    };
    let (second, length_sq) = farthest(&|p| (p - first).norm_squared());
    if length_sq == 0.0 {
        return Err(Error::Degenerate { shape: "identical" });
    }
    let direction = (second - first) / length_sq.sqrt();
    let (third, area_sq) = farthest(&|p| (p - first).cross(&direction).norm_squared());
    // What rounding of the coordinates themselves can do to points on a line.
    let noise = 1e-9 * length_sq.sqrt() + 16.0 * f64::EPSILON * first.amax().max(second.amax());
    match HalfSpace::through([first, second, third]) {
        Some(plane) if area_sq.sqrt() > noise => Ok(plane),
        _ => Err(Error::Degenerate { shape: "collinear" }),
    }
}

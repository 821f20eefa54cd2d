//! The pipeline, read top to bottom like the figure of the paper.

use std::sync::Arc;

use nalgebra::{Isometry3, Point3, Vector3};
use rayon::prelude::*;

use crate::cloud::PointCloud;
use crate::config::Config;
use crate::control::Control;
use crate::error::{Error, Evidence, Result};
use crate::frames::{height_over, place, plane_in_world};
use crate::prepare::{Prepared, prepare};
use crate::reference::{ORIENTED, Reference, Scan};
use crate::remarks::{Remarks, remarks};
pub use crate::result::{Candidate, Diagnostic, Estimate, FreeDirection};
use crate::stages::Stages;
use crate::symmetry::axis::Axis;
use crate::symmetry::complete::complete;
use crate::symmetry::covariance::{AlongAxis, pose_covariance};
use crate::symmetry::details::order_of_details;
use crate::symmetry::detect::{Detection, detect_order};
use crate::symmetry::fold::fold;
use crate::symmetry::order::{Order, Turns};
use crate::symmetry::orient::{decide_sign, find_heading, origin_height};
use crate::symmetry::propose::Proposal;
use crate::symmetry::refine::{RefineParams, Refined, align, align_from_beside, refine_jointly};
use crate::symmetry::score::{MatchScore, match_score};
use crate::symmetry::search::{Found, SearchContext, search_known, search_unknown};
use crate::symmetry::surface::{Gate, Samples, Surface};

/// What one call adds to the configuration.
#[derive(Debug, Clone, Default)]
pub struct Request {
    /// Cancellation, deadline and progress.
    pub control: Control,
    /// Refine from this `world_from_object` only; search when that fails.
    pub initial: Option<Isometry3<f64>>,
    /// Among the equivalent poses return the one nearest to this `world_from_object`.
    pub prefer: Option<Isometry3<f64>>,
    /// A taught part: the pose is found in its frame. Its order counts where the configuration leaves it open.
    pub reference: Option<Arc<Reference>>,
}

/// A checked configuration, ready to estimate any number of clouds from any thread.
///
/// ```no_run
/// use sympose::{Config, Estimator, Order, PointCloud};
/// let points: Vec<[f64; 3]> = Vec::new(); // a scan
/// let estimator = Estimator::new(Config { order: Order::Cyclic(5), ..Config::default() })?;
/// let estimate = estimator.estimate(&PointCloud::from_points(points)?)?;
/// println!("{}", estimate.world_from_object);
/// # Ok::<(), sympose::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Estimator {
    config: Config,
}

impl Estimator {
    /// Checks the configuration.
    ///
    /// # Errors
    /// [`Error::InvalidParameter`] naming the first setting outside its domain.
    pub fn new(config: Config) -> Result<Self> {
        config.validate()?;
        Ok(Self { config })
    }

    /// The configuration.
    #[must_use]
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// Finds the pose of the part in `cloud`.
    ///
    /// # Errors
    /// [`Error::InsufficientData`] or [`Error::Degenerate`] when the cloud cannot hold a part,
    /// [`Error::NoSymmetry`] when no axis explains it.
    pub fn estimate(&self, cloud: &PointCloud) -> Result<Estimate> {
        self.estimate_with(cloud, &Request::default())
    }

    /// [`Estimator::estimate`] with cancellation, progress, a pose to start from or to prefer, and a taught part.
    ///
    /// # Errors
    /// Those of [`Estimator::estimate`], and [`Error::Cancelled`] or [`Error::DeadlineExceeded`]. A scan that does not fit
    /// the reference is an [`Error::NoSymmetry`], too.
    pub fn estimate_with(&self, cloud: &PointCloud, request: &Request) -> Result<Estimate> {
        match &request.reference {
            Some(reference) if self.config.order == Order::Auto => {
                let config = Config { order: reference.order(), ..self.config.clone() };
                Self { config }.on_threads(cloud, request)
            }
            _ => self.on_threads(cloud, request),
        }
    }

    fn on_threads(&self, cloud: &PointCloud, request: &Request) -> Result<Estimate> {
        let Some(threads) = self.config.threads else { return self.run(cloud, request) };
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .map_err(|e| Error::ThreadPool { threads, reason: e.to_string() })?;
        pool.install(|| self.run(cloud, request))
    }

    fn run(&self, cloud: &PointCloud, request: &Request) -> Result<Estimate> {
        let config = &self.config;
        let control = &request.control;
        let mut stages = Stages::new(control);
        stages.begin("input")?;
        let prepared = prepare(cloud, config, &mut stages)?;
        let surface = &prepared.surface;

        stages.begin("propose")?;
        let mut candidates = self.candidates(&prepared, request)?;

        stages.begin("refine")?;
        let mut settled = self.settle(&prepared, &candidates, control);
        if request.initial.is_some()
            && !matches!(&settled, Ok(s) if s.score.trust(surface.oriented) >= TRACKED)
        {
            stages.text("tracking", "lost: searched again");
            let searched = Request { initial: None, ..request.clone() };
            candidates = self.candidates(&prepared, &searched)?;
            settled = self.settle(&prepared, &candidates, control);
        }
        let Settled { refined: found, order, score, detection, ambiguous, mut warnings } = settled?;
        let refined = Samples {
            points: if self.config.joint {
                displaced(&surface.samples.points, &found)
            } else {
                prepared.measured.clone()
            },
            normals: surface.samples.normals.clone(),
        };

        stages.begin("complete")?;
        let framing = refined.scattered(FRAMING, prepared.voxel_size);
        let folded = fold(&framing, &found.axis, order, prepared.voxel_size);
        let up = prepared.ground.map(|[x, y, z, _]| Vector3::new(x, y, z));
        let (axis, sign_rule) = decide_sign(&found.axis, up, prepared.toward_sensors, &folded);
        let folded =
            if axis == found.axis { folded } else { fold(&framing, &axis, order, prepared.voxel_size) };
        let completion = complete(&refined.points, &axis, order, prepared.voxel_size);

        stages.begin("orient")?;
        let base = prepared.ground.and_then(|plane| height_over(&axis, plane));
        let origin = origin_height(&folded, config.origin, base, surface.oriented);
        let height = origin.value;
        let heading = find_heading(&folded, order, config.yaw);
        stages.text("sign_rule", &format!("{sign_rule:?}").to_lowercase());
        stages.flag(ORIENTED, surface.oriented);
        stages.number("coverage", completion.coverage);
        stages.series("outcomes", &score.counts());
        if let Some(visibility) = &prepared.visibility {
            stages.number("dropout", visibility.dropout);
        }
        stages.number("sigma", found.sigma);
        stages.number("gain", found.gain);
        stages.number("rounds", found.rounds as f64);
        stages.series("joint_cost", &found.costs);
        stages.number("yaw_angle", heading.angle);
        stages.number("structured", detection.structured);
        stages.number("generic_evidence", detection.generic);
        stages.series("order_evidence", &detection.against);
        stages.series("yaw_histogram", &heading.histogram);

        let preferred = request.prefer.map(|pose| prepared.world_from_local.inverse() * pose);
        let local_from_object = place(&axis, height, heading.angle, order, preferred);
        let along = AlongAxis { slide: origin.sigma, yaw: heading.sigma };
        let (covariance, unobservable) = pose_covariance(
            &found.sandwich,
            found.gain,
            0.5 * prepared.diameter,
            heading.angle,
            height,
            along,
        );
        let mut framed = Framed { local_from_object, covariance, unobservable };
        if let Some(reference) = &request.reference {
            stages.begin("register")?;
            let visibility = prepared.visibility.as_ref();
            let scan = Scan {
                samples: &refined,
                surface,
                visibility,
                scan_from_object: local_from_object,
                order,
                preferred,
            };
            framed = register(reference, &scan, &prepared, &detection, &mut stages, &mut warnings, control)?;
        }
        let Framed { local_from_object, covariance, unobservable } = framed;
        let match_curve = self.match_curve(&prepared, &axis);
        let world = |p: &Vector3<f64>| (prepared.world_from_local * Point3::from(*p)).coords.into();
        let (timings, diagnostics) = stages.finish();
        Ok(Estimate {
            world_from_object: prepared.world_from_local * local_from_object,
            order,
            score: score.trust(surface.oriented) * if ambiguous { AMBIGUOUS } else { 1.0 },
            explained: detection.explained,
            covariance,
            unobservable,
            warnings,
            points: refined.points.iter().map(world).collect(),
            normals: refined.normals.iter().map(|n| (prepared.world_from_local * n).into()).collect(),
            inliers: prepared.inliers,
            point_of_inlier: prepared.point_of_inlier,
            completed: completion.points.iter().map(world).collect(),
            completed_sector: completion.sectors,
            ground: prepared.ground.map(|plane| plane_in_world(plane, &prepared.world_from_local)),
            match_curve,
            candidates: candidates.iter().map(|c| in_world(c, &prepared.world_from_local)).collect(),
            timings,
            diagnostics,
        })
    }

    /// Axes to refine, best first: the pose given by the caller, or the result of the search.
    fn candidates(&self, prepared: &Prepared, request: &Request) -> Result<Vec<Found>> {
        let surface = &prepared.surface;
        let config = &self.config;
        let local_from_world = prepared.world_from_local.inverse();
        let hints: Vec<Vector3<f64>> =
            prepared.ground.iter().map(|[x, y, z, _]| Vector3::new(*x, *y, *z)).collect();
        let context = SearchContext {
            diameter: prepared.diameter,
            hints: &hints,
            within: config.axis_hint.map(|hint| local_from_world * Vector3::from(hint)),
            visibility: prepared.visibility.as_ref(),
            propose: &config.propose,
            detect: &config.detect,
            gate: self.final_gate(surface),
            control: &request.control,
        };
        if let Some(initial) = request.initial {
            let local_from_object = local_from_world * initial;
            let direction = local_from_object * Vector3::z();
            let Some(axis) = Axis::new(direction, local_from_object.translation.vector) else {
                return Ok(Vec::new());
            };
            let proposal = Proposal { axis, score: MatchScore::default() };
            let order = Some(config.order).filter(|order| *order != Order::Auto);
            return Ok(vec![Found { proposal, order, explained: 0.0 }]);
        }
        match config.order {
            Order::Auto => search_unknown(surface, &context),
            order => search_known(surface, order, &context),
        }
    }

    /// Refines the candidates until one holds: its order is the declared one, or is found again about the refined axis.
    fn settle(&self, prepared: &Prepared, candidates: &[Found], control: &Control) -> Result<Settled> {
        /// Candidates that are refined before the search is given up.
        const TRIED: usize = 3;
        /// Angle within which an axis that was refused, or one that passed, stands for others of its order \[rad\].
        const REFUSED: f64 = 0.02;
        const PASSED: f64 = 0.17;
        /// Score from which on no other axis is refined.
        const CERTAIN: f64 = 0.9;
        let surface = &prepared.surface;
        let declared = self.config.order;
        let mut refusal = None;
        let mut best: Option<Settled> = None;
        let mut answered: Vec<(&Found, f64)> = Vec::new();
        let mut tried = 0;
        for candidate in candidates {
            // What has its answer is not tried again a little beside.
            let stands_for_it = |(f, within): &(&Found, f64)| {
                f.order == candidate.order && f.proposal.axis.angle_to(&candidate.proposal.axis) < *within
            };
            if tried == TRIED || answered.iter().any(stands_for_it) {
                continue;
            }
            tried += 1;
            // Where no order is known yet, turns of the continuous group align whatever there is.
            let start = candidate.order.unwrap_or(Order::Continuous);
            let mut refined = self.refine(surface, candidate.proposal.axis, start, control)?;
            let detection = self.detect(prepared, &refined.axis);
            let order = if declared == Order::Auto { detection.order } else { Some(declared) };
            let Some(order) = order else {
                refusal.get_or_insert((refined.axis, detection));
                answered.push((candidate, REFUSED));
                continue;
            };
            if order != start {
                refined = self.refine(surface, refined.axis, order, control)?;
            }
            let turns = Turns::half(order, self.config.refine.max_turns);
            let samples = surface.samples.strided(JUDGED);
            let gate = self.final_gate(surface);
            let sight = prepared.sight(&refined.axis);
            let score = match_score(surface, &samples, &refined.axis, &turns, gate, sight);
            let Remarks { warnings, ambiguous } =
                remarks(declared, candidate, candidates, &refined.axis, &detection, prepared);
            let trust = score.trust(surface.oriented);
            if best.as_ref().is_none_or(|best| trust > best.score.trust(surface.oriented)) {
                best = Some(Settled { refined, order, score, detection, ambiguous, warnings });
            }
            // Where an axis is not certain, one in another direction may be better; orders cannot be compared like that, the
            // smaller one hides less.
            let enough = if declared == Order::Auto { TRACKED } else { CERTAIN };
            if trust >= enough {
                break;
            }
            if trust >= TRACKED {
                answered.push((candidate, PASSED));
            }
        }
        best.ok_or_else(|| no_symmetry(prepared, refusal))
    }

    fn detect(&self, prepared: &Prepared, axis: &Axis) -> Detection {
        let surface = &prepared.surface;
        let gate = if surface.oriented { DETECTION_GATE } else { UNSEEN_DETECTION_GATE };
        let [distance, off_plane] = gate.map(|spacings| spacings * surface.spacing);
        let gate = Gate { distance, off_plane, ..self.final_gate(surface) };
        let mut params = self.config.detect.clone();
        if self.config.order != Order::Auto {
            params.samples = params.samples.min(REMARKED);
            params.ring_samples = params.ring_samples.min(REMARKED);
        }
        let sight = prepared.sight(axis);
        let mut detection = detect_order(surface, axis, gate, sight, &params);
        let shows_details = prepared.visibility.as_ref().is_some_and(|v| v.shows_details);
        if let Some(order) = detection.order.filter(|_| shows_details)
            && let Some(part) = order_of_details(surface, axis, gate, sight, order, &params)
        {
            detection.order = Some(Order::Cyclic(part));
            detection.rest = Some(order);
        }
        detection
    }

    /// Aligns on a few of the points, then on many, then moves all points too.
    fn refine(&self, surface: &Surface, start: Axis, order: Order, control: &Control) -> Result<Refined> {
        let Config { residual, refine: params, .. } = &self.config;
        let turns = Turns::half(order, params.max_turns);
        let last_gate = params.gate * surface.spacing;
        let coarse = surface.samples.strided(COARSE);
        // The last digits of the search are noise, and different ones lead to slightly different ends: without them, two
        // clouds that differ by a rounding error almost always go the same way.
        let start = start.rounded(&surface.centroid, surface.radius, START_STEPS);
        let gates = [6.0 * last_gate, last_gate];
        let from_beside = self.config.propose.search && !surface.oriented;
        let align_coarse = if from_beside { align_from_beside } else { align };
        let near = align_coarse(surface, &coarse, start, &turns, *residual, gates, params, control)?;
        let full = RefineParams { max_rounds: params.max_full_rounds, ..params.clone() };
        let samples = surface.samples.scattered(params.samples, surface.spacing);
        let mut aligned =
            align(surface, &samples, near.axis, &turns, *residual, [last_gate; 2], &full, control)?;
        aligned.gain = aligned.gain.min(near.gain);
        refine_jointly(surface, &samples, &aligned, order, *residual, self.config.joint, params, control)
    }

    fn final_gate(&self, surface: &Surface) -> Gate {
        let params = &self.config.refine;
        Gate::new(3.0 * surface.spacing, params.max_normal_angle.cos())
    }

    /// Match score of rotations by any angle.
    fn match_curve(&self, prepared: &Prepared, axis: &Axis) -> Vec<[f64; 2]> {
        const ANGLES: usize = 180;
        const SAMPLES: usize = 200;
        let surface = &prepared.surface;
        let samples = surface.samples.strided(SAMPLES);
        let gate = self.final_gate(surface);
        let sight = prepared.sight(axis);
        (0..ANGLES)
            .into_par_iter()
            .map(|i| {
                let angle = std::f64::consts::TAU * i as f64 / ANGLES as f64;
                let turns = Turns::single(angle);
                let score = match_score(surface, &samples, axis, &turns, gate, sight);
                [angle, score.value()]
            })
            .collect()
    }
}

/// Points on which the final axis is judged.
const JUDGED: usize = 4000;

/// Steps of a radian, and of the radius of the part, to which the start of the refinement is rounded.
const START_STEPS: f64 = 512.0;

/// Points on which the axis is aligned before all are used.
const COARSE: usize = 4000;

/// Distance of a match when the order is found, and its distance off the plane: it is beside a point that the gaps between
/// the points count [point spacings].
const DETECTION_GATE: [f64; 2] = [1.9, 1.1];

/// The same where no viewpoint is known and the points of a surface lie in several layers.
const UNSEEN_DETECTION_GATE: [f64; 2] = [2.5, 1.5];

/// Points from which sign, origin and heading are taken.
const FRAMING: usize = 60_000;

/// Points that suffice to remark on a declared order, which they do not decide.
const REMARKED: usize = 250;

/// Score below which a pose counts as lost, and the search goes on.
const TRACKED: f64 = 0.5;

/// What is left of the score when another axis explains the data about as well: the answer is one of two.
const AMBIGUOUS: f64 = 0.5;

/// An axis with the order that holds about it.
struct Settled {
    refined: Refined,
    order: Order,
    score: MatchScore,
    detection: Detection,
    /// Another axis explains the data about as well.
    ambiguous: bool,
    warnings: Vec<String>,
}

/// A pose with what is known of it.
struct Framed {
    local_from_object: Isometry3<f64>,
    covariance: [[f64; 6]; 6],
    unobservable: Vec<FreeDirection>,
}

/// The pose in the frame of the reference; refused when the scan shows another part.
fn register(
    reference: &Reference,
    scan: &Scan,
    prepared: &Prepared,
    detection: &Detection,
    stages: &mut Stages,
    warnings: &mut Vec<String>,
    control: &Control,
) -> Result<Framed> {
    let registered = reference.register(scan, control)?;
    stages.number("reference_overlap", registered.overlap);
    stages.number("reference_sigma", registered.sigma);
    let local_from_object = registered.scan_from_object;
    if let Some(reason) = registered.misfit {
        let world_from_object = prepared.world_from_local * local_from_object;
        let evidence = Evidence {
            axis: (world_from_object * Vector3::z()).into(),
            center: world_from_object.translation.vector.into(),
            explained: detection.explained,
            score: registered.overlap,
            reason,
        };
        return Err(Error::NoSymmetry { evidence });
    }
    let (covariance, unobservable) = (registered.covariance, registered.unobservable);
    warnings.extend(registered.warnings);
    Ok(Framed { local_from_object, covariance, unobservable })
}

fn no_symmetry(prepared: &Prepared, refusal: Option<(Axis, Detection)>) -> Error {
    let world = |p: Vector3<f64>| (prepared.world_from_local * Point3::from(p)).coords.into();
    let hint =
        if prepared.surface.oriented { "" } else { "; give the viewpoint or the order, which say more" };
    let evidence = match refusal {
        Some((axis, detection)) => Evidence {
            axis: (prepared.world_from_local * axis.direction.into_inner()).into(),
            center: world(axis.point),
            explained: detection.explained,
            score: 0.0,
            reason: format!("about the best axis no rotation maps the part to itself{hint}"),
        },
        None => Evidence {
            center: world(prepared.surface.centroid),
            reason: "no direction within reach could be aligned".to_owned(),
            ..Evidence::default()
        },
    };
    Error::NoSymmetry { evidence }
}

fn in_world(found: &Found, world_from_local: &Isometry3<f64>) -> Candidate {
    let axis = &found.proposal.axis;
    Candidate {
        axis: (world_from_local * axis.direction.into_inner()).into(),
        center: (world_from_local * Point3::from(axis.point)).coords.into(),
        order: found.order.unwrap_or(Order::Auto),
        score: found.proposal.score.value(),
    }
}

fn displaced(points: &[Vector3<f64>], found: &Refined) -> Vec<Vector3<f64>> {
    if found.offsets.is_empty() {
        return points.to_vec();
    }
    points.iter().zip(&found.offsets).map(|(p, offset)| p + offset).collect()
}

//! The pipeline, read top to bottom like the figure of the paper.

use std::panic::resume_unwind;
use std::sync::Arc;

use nalgebra::{Isometry3, Point3, Vector3};
use rayon::prelude::*;

use crate::candidates::Settled;
use crate::cloud::PointCloud;
use crate::config::{Config, GroundMode, Origin, Yaw};
use crate::control::Control;
use crate::error::{Error, Evidence, Result};
use crate::frames::{check_pose, height_over, place, plane_in_world};
use crate::locate::Aligned;
use crate::prepare::Prepared;
use crate::reference::{ORIENTED, PartScan, Reference};
use crate::remarks::{misplaced_views, odd_sensors, wrong_viewpoints};
pub use crate::result::{Candidate, Diagnostic, Estimate, FreeDirection};
use crate::stages::Stages;
use crate::symmetry::axis::Axis;
use crate::symmetry::complete::{Completion, complete};
use crate::symmetry::covariance::{AlongAxis, pose_covariance};
use crate::symmetry::detect::Detection;
use crate::symmetry::fold::fold;
use crate::symmetry::mirror::{MirrorPlane, MirrorSearch};
use crate::symmetry::order::{Order, Turns};
use crate::symmetry::orient::{Heading, decide_sign, find_heading, origin_height};
use crate::symmetry::refine::Refined;
use crate::symmetry::score::{MatchScore, match_score};
use crate::symmetry::search::Found;
use crate::symmetry::surface::Samples;

/// What one call adds to the configuration.
#[derive(Debug, Clone, Default)]
pub struct Request {
    /// Cancellation, deadline and progress.
    pub control: Control,
    /// Refine from this `world_from_object` only, on fewer points ([`crate::config::TrackingParams`]); on all of them where the
    /// score is low, and search when that fails. The axis keeps its sign, and of the equivalent poses the nearest is
    /// returned, unless another is preferred.
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
    /// [`Error::InsufficientData`] or [`Error::Degenerate`] when the cloud cannot hold a part, [`Error::NoSymmetry`] when no axis
    /// explains it; [`Error::InvalidParameter`] when the voxels that are set, or those of a part that is tiny beside the cloud,
    /// are too small for its extent; [`Error::NonFinite`] when points were dropped and [`Config::non_finite`] forbids it;
    /// [`Error::ThreadPool`] when the threads that are set cannot be started.
    pub fn estimate(&self, cloud: &PointCloud) -> Result<Estimate> {
        self.estimate_with(cloud, &Request::default())
    }

    /// [`Estimator::estimate`] with cancellation, progress, a pose to start from or to prefer, and a taught part.
    ///
    /// # Errors
    /// Those of [`Estimator::estimate`], [`Error::Cancelled`] or [`Error::DeadlineExceeded`], and
    /// [`Error::InvalidParameter`] for a pose that is not finite. A scan that does not fit the reference is an
    /// [`Error::NoSymmetry`], too.
    pub fn estimate_with(&self, cloud: &PointCloud, request: &Request) -> Result<Estimate> {
        for (name, pose) in [("initial", &request.initial), ("prefer", &request.prefer)] {
            pose.iter().try_for_each(|pose| check_pose(name, pose))?;
        }
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
        let run = || pool.install(|| self.run(cloud, request));
        if rayon::current_thread_index().is_none() {
            return run();
        }
        // A worker of another pool that waits for this one would begin the next cloud meanwhile, and in that the next.
        std::thread::scope(|scope| {
            let started = std::thread::Builder::new().spawn_scoped(scope, run);
            let worker = started.map_err(|e| Error::ThreadPool { threads: 1, reason: e.to_string() })?;
            worker.join().unwrap_or_else(|panic| resume_unwind(panic))
        })
    }

    fn run(&self, cloud: &PointCloud, request: &Request) -> Result<Estimate> {
        let mut stages = Stages::new(&request.control);
        stages.begin("input")?;
        let is_sought = self.config.viewpoints_from_order && !cloud.has_viewpoints();
        let placed = is_sought.then(|| cloud.with_viewpoints_from_order()).flatten();
        stages.flag("viewpoints_from_order", placed.is_some());
        let cloud = placed.as_ref().unwrap_or(cloud);
        let Aligned { prepared, candidates, settled } = match request.initial {
            Some(initial) => self.track(cloud, initial, &mut stages)?,
            None => self.search(cloud, &mut stages)?,
        };
        let surface = &prepared.surface;
        let refined = Samples {
            points: if self.config.joint {
                displaced(&surface.samples.points, &settled.refined)
            } else {
                prepared.measured.clone()
            },
            normals: surface.samples.normals.clone(),
        };
        let Framed { axis, mut completion, histogram, mut posed } =
            self.frame(&prepared, &settled, &refined, request, &mut stages)?;
        let explained = settled.explained();
        let Settled { refined: found, order, score, detection, ambiguous, mut warnings } = settled;
        note_evidence(&prepared, &found, &score, &detection, &mut stages);
        warnings.extend(self.warnings(cloud, &prepared));

        if let Some(reference) = &request.reference {
            stages.begin("register")?;
            let scan = PartScan {
                samples: &refined,
                outward: prepared.outward,
                surface,
                visibility: prepared.visibility.as_ref(),
                view_errors: prepared.view_errors.as_ref(),
                scan_from_object: posed.local_from_object,
                order,
                preferred: preferred(request, &prepared),
            };
            posed = register(reference, &scan, &prepared, &detection, &score, &mut stages, &mut warnings)?;
        }
        let Posed { local_from_object, covariance, unobservable } = posed;
        let is_free = unobservable.contains(&FreeDirection::Tilt);
        warnings.extend(is_free.then(|| NO_AXIS.to_owned()));
        // The frame of a reference may be the other way up.
        let z = local_from_object * Vector3::z_axis();
        let is_reversed = z.dot(&axis.direction) < 0.0;
        note_heading(&axis, &local_from_object, histogram, is_reversed, &mut stages);
        completion = if is_reversed { completion.reversed(order) } else { completion };
        let upright = Axis { direction: if is_reversed { -axis.direction } else { axis.direction }, ..axis };
        let match_curve = self.match_curve(&prepared, &upright);
        let world = |p: &Vector3<f64>| (prepared.world_from_local * Point3::from(*p)).coords.into();
        let (timings, diagnostics) = stages.finish()?;
        Ok(Estimate {
            world_from_object: prepared.world_from_local * local_from_object,
            order,
            score: prepared.trust(&score) * if ambiguous || is_free { AMBIGUOUS } else { 1.0 },
            explained,
            covariance,
            unobservable,
            warnings,
            points: refined.points.par_iter().map(world).collect(),
            normals: refined.normals.par_iter().map(|n| (prepared.world_from_local * n).into()).collect(),
            inliers: prepared.inliers,
            point_of_inlier: prepared.point_of_inlier,
            completed: completion.points.par_iter().map(world).collect(),
            completed_sector: completion.sectors,
            ground: prepared.ground.map(|plane| plane_in_world(plane, &prepared.world_from_local)),
            match_curve,
            candidates: candidates.iter().map(|c| in_world(c, &prepared.world_from_local)).collect(),
            timings,
            diagnostics,
        })
    }

    /// The frame of the part on the axis found: which way up, where along it, and turned how; with the completed surface.
    fn frame(
        &self,
        prepared: &Prepared,
        settled: &Settled,
        refined: &Samples,
        request: &Request,
        stages: &mut Stages,
    ) -> Result<Framed> {
        let Settled { refined: found, order, .. } = settled;
        stages.begin("complete")?;
        let framing = refined.scattered(FRAMING, prepared.voxel_size);
        let fold_about = |axis: &Axis| fold(&framing, axis, *order, prepared.voxel_size);
        let mut folded = fold_about(&found.axis);
        let ground_normal = prepared.ground.map(|[x, y, z, _]| Vector3::new(x, y, z));
        let previous = request.initial.map(|pose| in_local(pose, prepared) * Vector3::z());
        let (axis, sign_rule) =
            decide_sign(&found.axis, previous, ground_normal, prepared.toward_sensors, &folded);
        let is_turned_over = axis != found.axis;
        if is_turned_over {
            folded = fold_about(&axis);
        }
        let completion = complete(&refined.points, &axis, *order, prepared.voxel_size).map_err(of_voxels)?;

        stages.begin("orient")?;
        // A part that leans, or hangs over its support, does not end where its axis meets that.
        let stands = ground_normal.is_some_and(|normal| normal.dot(&axis.direction).abs() > UPRIGHT);
        let base = prepared.ground.and_then(|plane| height_over(&axis, plane));
        let base = base.filter(|_| stands || self.config.origin == Origin::Base);
        // Neither keeps both threads of a small machine busy.
        let ((origin, heading, plane), (pace, common)) = rayon::join(
            || {
                let origin = origin_height(&folded, self.config.origin, base, prepared.outward);
                let heading = find_heading(&folded, *order, self.config.yaw);
                let plane = self.mirror_plane(prepared, refined, &axis, *order, &heading);
                (origin, heading, plane)
            },
            || {
                let pace = self.pace(&prepared.surface, &axis, *order);
                (pace, self.common_errors(prepared, &axis, *order))
            },
        );
        let pace = pace?;
        // Views that are turned turn the part about its axis as far as across it.
        let turned = common.tilt_by_views();
        let heading = match plane {
            Some(plane) => heading.onto(MirrorPlane { sigma: plane.sigma.hypot(turned), ..plane }),
            None => heading,
        };
        stages.text("sign_rule", &format!("{sign_rule:?}").to_lowercase());
        stages.flag(ORIENTED, prepared.outward);
        stages.number("coverage", completion.coverage);

        let preferred = preferred(request, prepared);
        let (local_from_object, angle) = place(&axis, origin.value, heading.angle, *order, preferred);
        let along = AlongAxis { slide: origin.sigma, yaw: heading.sigma };
        let radius = 0.5 * prepared.diameter;
        stages.series("pace", pace.as_slice());
        let sandwich = if is_turned_over { found.sandwich.reversed() } else { found.sandwich };
        let (covariance, unobservable) =
            pose_covariance(&sandwich, &pace, &common, radius, angle, origin.value, along);
        let posed = Posed { local_from_object, covariance, unobservable };
        Ok(Framed { axis, completion, histogram: heading.histogram, posed })
    }

    /// The mirror plane of the part that the heading leads to.
    fn mirror_plane(
        &self,
        prepared: &Prepared,
        refined: &Samples,
        axis: &Axis,
        order: Order,
        heading: &Heading,
    ) -> Option<MirrorPlane> {
        let (Order::Cyclic(order), Yaw::Harmonic) = (order, self.config.yaw) else { return None };
        let Prepared { surface, .. } = prepared;
        let (gate, sight) = (self.final_gate(surface), prepared.sight(axis));
        MirrorSearch { surface, refined, axis, order, gate, sight }.plane_near(heading.angle)
    }

    /// What the caller should know about the cloud, whatever was found in it.
    fn warnings(&self, cloud: &PointCloud, prepared: &Prepared) -> Vec<String> {
        let far = (cloud.far() > 0).then(|| {
            format!(
                "far points left out, a hundred interquartile ranges or more from the middle: {}",
                cloud.far()
            )
        });
        let coinciding = (cloud.coinciding() > 0).then(|| {
            format!(
                "points at one place, or at one far value of a coordinate, left out, as where a sensor gets no return: {}",
                cloud.coinciding()
            )
        });
        let no_ground = self.config.ground == GroundMode::On && prepared.ground.is_none();
        let no_ground = no_ground.then(|| NO_GROUND.to_owned());
        let off = wrong_viewpoints(prepared).or_else(|| misplaced_views(prepared));
        let views = odd_sensors(prepared).into_iter().chain(off);
        far.into_iter().chain(coinciding).chain(no_ground).chain(views).collect()
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

/// Cells of the completion are the voxels that the caller set.
fn of_voxels(error: Error) -> Error {
    match error {
        Error::InvalidParameter { name: "cell", value, expected } => {
            Error::InvalidParameter { name: "voxel_size", value, expected }
        }
        error => error,
    }
}

/// Puts the angle of +x from the first tangent of the axis into the diagnostics, and the histogram in which it was sought, both
/// about +z, which points against the axis where it `is_reversed`.
fn note_heading(
    axis: &Axis,
    local_from_object: &Isometry3<f64>,
    mut histogram: Vec<f64>,
    is_reversed: bool,
    stages: &mut Stages,
) {
    let x = local_from_object * Vector3::x();
    let [first, second] = axis.tangents();
    let angle = x.dot(&second).atan2(x.dot(&first));
    if is_reversed {
        histogram.reverse();
    }
    stages.number("yaw_angle", if is_reversed { -angle } else { angle });
    stages.series("yaw_histogram", &histogram);
}

/// Puts what speaks for the axis and its order into the diagnostics.
fn note_evidence(
    prepared: &Prepared,
    found: &Refined,
    score: &MatchScore,
    detection: &Detection,
    stages: &mut Stages,
) {
    stages.number("sigma", found.sigma);
    stages.number("rounds", found.rounds as f64);
    stages.series("joint_cost", &found.costs);
    stages.series("outcomes", &score.counts());
    if let Some(visibility) = &prepared.visibility {
        stages.number("dropout", visibility.dropout);
    }
    if let Some(spread) = prepared.view_errors.as_ref().and_then(|errors| errors.spread) {
        stages.number("view_shift", spread.shift);
        stages.number("view_turn", spread.turn);
    }
    stages.number("structured", detection.structured);
    stages.number("generic_evidence", detection.generic);
    stages.series("order_evidence", &detection.against);
}

/// Where a plane was to be removed in any case.
const NO_GROUND: &str =
    "ground = \"on\", but no plane has what is near it on one side and touching it; none was removed";

/// Where the surface fits itself about any axis near the one that was found.
const NO_AXIS: &str = "ambiguous: the surface leaves the axis free, as a ball does";

/// Cosine between the axis of a part and the normal of its support from which on it stands there: up to 3 degrees.
const UPRIGHT: f64 = 0.9986;

/// Points from which sign, origin and heading are taken.
const FRAMING: usize = 60_000;

/// What is left of the score when another axis explains the data about as well: the answer is one of two. A little less than half,
/// so that not even a perfect match reaches the 0.5 of a pose to act on.
const AMBIGUOUS: f64 = 0.499;

/// The axis the right way up, the completed surface, and the pose.
struct Framed {
    axis: Axis,
    completion: Completion,
    /// Of the completed surface by its angle from the first tangent of the axis.
    histogram: Vec<f64>,
    posed: Posed,
}

/// A pose with what is known of it.
struct Posed {
    local_from_object: Isometry3<f64>,
    covariance: [[f64; 6]; 6],
    unobservable: Vec<FreeDirection>,
}

/// The pose in the frame of the reference; refused when the scan shows another part.
fn register(
    reference: &Reference,
    scan: &PartScan,
    prepared: &Prepared,
    detection: &Detection,
    score: &MatchScore,
    stages: &mut Stages,
    warnings: &mut Vec<String>,
) -> Result<Posed> {
    let registered = reference.register(scan, stages.control())?;
    stages.number("reference_overlap", registered.overlap);
    stages.number("reference_sigma", registered.sigma);
    let local_from_object = registered.scan_from_object;
    if let Some(reason) = registered.misfit {
        let world_from_object = prepared.world_from_local * local_from_object;
        let evidence = Evidence {
            axis: (world_from_object * Vector3::z()).into(),
            center: world_from_object.translation.vector.into(),
            explained: detection.explained,
            score: score.value(),
            reason: format!("the scan does not fit the reference: {reason}"),
        };
        return Err(Error::NoSymmetry { evidence });
    }
    let (covariance, unobservable) = (registered.covariance, registered.unobservable);
    warnings.extend(registered.warnings);
    Ok(Posed { local_from_object, covariance, unobservable })
}

/// A pose of the world in the frame in which the part is looked at.
fn in_local(pose: Isometry3<f64>, prepared: &Prepared) -> Isometry3<f64> {
    prepared.world_from_local.inverse() * pose
}

/// The pose near which the caller wants that of the equivalent ones.
fn preferred(request: &Request, prepared: &Prepared) -> Option<Isometry3<f64>> {
    request.prefer.or(request.initial).map(|pose| in_local(pose, prepared))
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

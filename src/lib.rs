//! 6-DoF pose of rotationally symmetric parts from raw point clouds, without a CAD model.
//!
//! A wheel, an impeller or a flange comes to itself when it is turned by 360/n degrees. In a scan, that is something to
//! measure: the axis about which the cloud meets itself best is the axis of the part, and the rotated copies fill in
//! what no camera saw. The method is that of Dai et al. (arXiv 2606.16593); `ARCHITECTURE.md` says where it departs.
//!
//! ```
//! use sympose::nalgebra::Vector3;
//! use sympose::{Config, Estimator, Order, PointCloud};
//!
//! // A dish with five waves, seen from above; any scan in any unit does.
//! let points: Vec<[f64; 3]> = (0..5000)
//!     .map(|i| {
//!         let (radius, angle) = (0.5 * (f64::from(i) / 5000.0).sqrt(), 2.399_963 * f64::from(i));
//!         [radius * angle.cos(), radius * angle.sin(), 0.1 * radius * (5.0 * angle).cos()]
//!     })
//!     .collect();
//! let cloud = PointCloud::from_points(points)?.with_viewpoints([[0.0, 0.0, 3.0]])?;
//!
//! let config = Config { order: Order::Cyclic(5), ..Config::default() };
//! let estimate = Estimator::new(config)?.estimate(&cloud)?;
//!
//! let axis = estimate.world_from_object * Vector3::z();
//! assert!(axis.z > 0.9999 && estimate.score > 0.5);
//! # Ok::<(), sympose::Error>(())
//! ```
//!
//! # Conventions
//!
//! - Lengths are in the unit of the cloud. Every default length is relative, to the spacing of the points or to the size
//!   of the part, so nothing assumes metres or millimetres.
//! - Angles are radians; a name that ends in `_deg` holds degrees.
//! - A transform is named `target_from_source`: `world_from_object`, `world_from_camera`. Quaternions are x, y, z, w.
//! - The object frame: +z is the symmetry axis, +x the primary orientation, the origin lies on the axis. Along the axis
//!   and about it a part without a model has no natural frame: [`config::Origin`] and [`config::Yaw`] are conventions.
//! - Squared and linear distances never share a name: `distance_sq` and `distance`.
//! - Points are `[f64; 3]`, indices `u32` into the points as they were given, also where some were dropped.
//! - A cloud is shifted to a local origin before any arithmetic: georeferenced coordinates lose nothing.
//! - The same input, configuration and seed give the same bytes at any number of threads, but for [`Estimate::timings`].
//! - Nothing prints, exits or configures the global thread pool, and no input makes an [`Estimator`], a filter or a reader panic:
//!   whatever is wrong comes back as an [`Error`] with the value that was found. Arrays that belong together must have the
//!   same number of rows.
//!
//! # Parts
//!
//! [`Estimator`] runs the whole way from a cloud to an [`Estimate`]; a [`Request`] adds cancellation, a deadline, progress,
//! a pose to start from and one to prefer, and a [`Reference`] in whose frame the pose is wanted. Each stage also works
//! alone: the filters, planes, clusters and normals of [`preprocess`], the nearest neighbours of [`spatial`], the axis and
//! its evidence in [`symmetry`], the errors of a pose in [`metrics`]. An [`Estimate`] serialises to the JSON that [`schema`] describes.
//!
//! # Features
//!
//! None by default: `cargo add sympose` brings neither clap nor pyo3.
//! - `io`: reading and writing PLY, PCD and text files.
//! - `cli`: the `sympose` program.
//! - `python`: the extension module of the Python package; built by maturin only.
mod candidates;
#[cfg(feature = "cli")]
pub mod cli;
pub mod cloud;
pub mod config;
pub mod control;
mod directions;
pub mod error;
pub mod estimate;
mod frames;
#[cfg(feature = "io")]
pub mod io;
mod locate;
mod median;
pub mod metrics;
mod no_return;
pub mod picture;
mod prepare;
pub mod preprocess;
#[cfg(feature = "python")]
mod python;
pub mod reference;
mod refusal;
mod remarks;
pub mod result;
mod rivals;
mod sampling;
pub mod schema;
pub mod spatial;
mod stages;
pub mod symmetry;
mod validate;
mod viewpoints;
pub use cloud::PointCloud;
pub use config::Config;
pub use control::{CancelToken, Control};
pub use error::{Error, Result};
pub use estimate::{Estimate, Estimator, Request};
pub use nalgebra;
pub use picture::Picture;
pub use reference::Reference;
pub use symmetry::order::Order;
pub use viewpoints::Viewpoints;

/// The example of the README, compiled and run with the other ones.
#[cfg(all(doctest, feature = "io"))]
#[doc = include_str!("../README.md")]
struct Readme;

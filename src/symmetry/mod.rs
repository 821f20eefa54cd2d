//! The symmetry part: from a surface to its axis.
//!
//! What is public is each stage of the way: a [`surface::Surface`], axes and orders found in it by [`search`], an axis made exact by
//! [`refine::Aligner`], the part completed by [`complete`](mod@complete). [`Estimator`](crate::Estimator) runs them all, and adds what
//! the cameras saw, the frame, the covariance and the score.
//!
//! ```
//! use sympose::nalgebra::Vector3;
//! use sympose::symmetry::axis::Axis;
//! use sympose::symmetry::complete::complete;
//! use sympose::symmetry::detect::DetectParams;
//! use sympose::symmetry::order::{Order, Turns};
//! use sympose::symmetry::propose::ProposeParams;
//! use sympose::symmetry::refine::{Aligner, RefineParams};
//! use sympose::config::Residual;
//! use sympose::symmetry::search::{SearchContext, search_known};
//! use sympose::symmetry::surface::{Gate, Samples, Surface};
//! use sympose::Control;
//!
//! // A third of a dish with six waves is missing; its normals follow from its gradient.
//! let radius_and_angle = |i: u32| (0.5 * (f64::from(i) / 9000.0).sqrt(), 2.399_963 * f64::from(i));
//! let at = |i: u32| {
//!     let (r, t) = radius_and_angle(i);
//!     Vector3::new(r * t.cos(), r * t.sin(), 0.1 * r * (6.0 * t).cos())
//! };
//! let normal = |i: u32| {
//!     let (_, t) = radius_and_angle(i);
//!     let (along, across) = (0.1 * (6.0 * t).cos(), -0.6 * (6.0 * t).sin());
//!     let [x, y] = [along * t.cos() - across * t.sin(), along * t.sin() + across * t.cos()];
//!     Vector3::new(-x, -y, 1.0).normalize()
//! };
//! let seen = || (0..9000).filter(|&i| radius_and_angle(i).1 % 6.283 > 2.1);
//! let samples = Samples { points: seen().map(at).collect(), normals: seen().map(normal).collect() };
//! let (spacing, diameter) = (0.01, 1.0);
//! let surface = Surface::new(samples, true, spacing, 0.05);
//!
//! let (propose, detect) = (ProposeParams::default(), DetectParams::default());
//! let control = Control::default();
//! let context = SearchContext {
//!     diameter,
//!     hints: &[],
//!     within: None,
//!     visibility: None,
//!     propose: &propose,
//!     detect: &detect,
//!     gate: Gate::new(0.03, 0.8),
//!     control: &control,
//! };
//! let order = Order::Cyclic(6);
//! let found = search_known(&surface, order, &context)?;
//!
//! let (turns, params) = (Turns::half(order, 8), RefineParams::default());
//! let (samples, residual) = (surface.samples(), Residual::default());
//! let aligner = Aligner { surface: &surface, samples, turns: &turns, residual, params: &params };
//! let axis = aligner.align(found[0].proposal.axis, [0.03, 0.01], &control)?.axis;
//! assert!(axis.direction.z.abs() > 0.99999 && axis.distance(&Vector3::zeros()) < 1e-3);
//!
//! let whole = complete(&surface.samples().points, &axis, order, spacing)?;
//! assert!(whole.points.iter().any(|p| p.y.atan2(p.x).abs() < 0.1 && p.x > 0.4));
//! # Ok::<(), sympose::Error>(())
//! ```

pub(crate) mod alignment;
pub mod axis;
pub(crate) mod closeness;
pub(crate) mod closure;
pub mod complete;
pub(crate) mod covariance;
mod depth_map;
pub(crate) mod details;
pub mod detect;
mod field;
pub(crate) mod fold;
pub(crate) mod mirror;
mod misfit;
pub mod order;
pub(crate) mod orient;
pub(crate) mod overlap;
pub(crate) mod pace;
pub(crate) mod peaks;
pub(crate) mod pieces;
pub mod propose;
pub mod refine;
pub mod residual;
pub(crate) mod revolution;
pub(crate) mod rings;
pub(crate) mod robust;
pub(crate) mod sandwich;
pub mod score;
pub mod search;
pub(crate) mod settle;
pub(crate) mod sight;
pub(crate) mod solver;
pub mod surface;
pub(crate) mod sweep;
pub(crate) mod teeth;
mod view_axes;
pub mod view_errors;
pub mod visibility;
mod walls;

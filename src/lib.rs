//! 6-DoF pose of rotationally symmetric parts from raw point clouds, without a CAD model.
#[cfg(feature = "cli")]
pub mod cli;
pub mod cloud;
pub mod config;
pub mod control;
pub mod error;
pub mod estimate;
#[cfg(feature = "io")]
pub mod io;
pub mod metrics;
mod prepare;
pub mod preprocess;
#[cfg(feature = "python")]
mod python;
pub mod result;
pub mod schema;
pub mod spatial;
mod stages;
pub mod symmetry;
pub use cloud::PointCloud;
pub use config::Config;
pub use control::{CancelToken, Control};
pub use error::{Error, Result};
pub use estimate::{Estimate, Estimator, Request};
pub use nalgebra;
pub use symmetry::order::Order;

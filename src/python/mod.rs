//! The extension module `sympose._core`: conversions only, no algorithm.
//!
//! Docstrings are read from Python, so they are written for Python readers.

mod arrays;
mod call;
mod cli;
mod config;
mod errors;
mod estimate;
mod input;
mod interrupt;
mod json;
mod kd_tree;
mod metrics;
mod pool;
mod reference;
mod stages;

use pyo3::prelude::*;

/// The compiled half of sympose; use it through the package.
#[pymodule]
mod _core {
    #[pymodule_export]
    #[expect(non_upper_case_globals, reason = "the name that Python knows")]
    const __version__: &str = env!("CARGO_PKG_VERSION");

    #[pymodule_export]
    const MESH_WARNING: &str = crate::cli::MESH_WARNING;

    #[pymodule_export]
    use super::call::estimate;
    #[pymodule_export]
    use super::cli::{cli_main, cli_scan};
    #[pymodule_export]
    use super::config::{check_config, config_to_toml, default_config, paper_config};
    #[pymodule_export]
    use super::estimate::{PyCandidate, PyEstimate};
    #[pymodule_export]
    use super::kd_tree::PyKdTree;
    #[pymodule_export]
    use super::metrics::{adds, mssd};
    #[pymodule_export]
    use super::reference::PyReference;
    #[pymodule_export]
    use super::stages::{
        estimate_normals, remove_radius_outliers, remove_statistical_outliers, segment_plane,
        viewpoints_from_order, voxel_downsample,
    };
}

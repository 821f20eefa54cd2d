//! The symmetry part: from a surface to its axis.

pub mod alignment;
pub mod axis;
pub mod closure;
pub mod complete;
pub mod covariance;
pub(crate) mod details;
pub mod detect;
mod field;
pub mod fold;
pub mod order;
pub mod orient;
pub mod pace;
pub(crate) mod peaks;
pub mod propose;
pub mod refine;
pub mod residual;
pub mod revolution;
pub(crate) mod rings;
pub mod robust;
pub mod score;
pub mod search;
pub mod settle;
pub mod sight;
pub mod solver;
pub mod surface;
pub(crate) mod sweep;
pub mod visibility;

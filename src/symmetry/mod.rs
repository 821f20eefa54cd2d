//! The symmetry part: from a surface to its axis.

pub mod alignment;
pub mod axis;
pub mod order;
pub mod refine;
pub mod residual;
pub mod robust;
pub mod solver;
pub mod surface;

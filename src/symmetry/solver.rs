//! Damped Gauss-Newton on a manifold, as an [`argmin`] solver; the only file that imports it.
//!
//! argmin's own Gauss-Newton materialises the Jacobian and has no damping. Here a problem sums its normal equations
//! itself (in parallel, in a fixed order), so that nothing grows with the number of residuals.

use argmin::core::{Executor, IterState, KV, Problem, Solver, TerminationReason, TerminationStatus};
use nalgebra::{Matrix4, Vector4};

use crate::error::{Error, Result};

/// Normal equations of a robust least-squares problem in four parameters, linearised at one point.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct NormalEquations {
    /// J' W J.
    pub hessian: Matrix4<f64>,
    /// J' W r.
    pub gradient: Vector4<f64>,
    /// Robust cost rho, not the weighted square.
    pub cost: f64,
}

impl NormalEquations {
    /// Adds the equations of further residuals.
    pub(crate) fn add(&mut self, other: &Self) {
        self.hessian += other.hessian;
        self.gradient += other.gradient;
        self.cost += other.cost;
    }
}

/// A robust least-squares problem; further unknowns may be eliminated inside (Schur complement).
pub(crate) trait RobustProblem {
    /// The unknowns.
    type Param: Clone;

    /// Sums the normal equations at `param`.
    ///
    /// # Errors
    /// Whatever the problem itself reports, which ends the minimisation; a [`SelfAlignment`] always succeeds.
    ///
    /// [`SelfAlignment`]: crate::symmetry::alignment::SelfAlignment
    fn linearize(&self, param: &Self::Param) -> Result<NormalEquations>;

    /// The robust cost at `param`.
    ///
    /// # Errors
    /// Those of [`RobustProblem::linearize`].
    fn cost(&self, param: &Self::Param) -> Result<f64>;

    /// Moves `param` by `step`, and with it the unknowns that were eliminated when it was linearised there.
    fn step(&self, param: &Self::Param, step: &Vector4<f64>) -> Self::Param;
}

/// Levenberg's damping with Marquardt's scaling: a step is taken only when the robust cost falls.
///
/// Reference: Marquardt, J. SIAM 11 (1963) 431; Triggs et al., Bundle Adjustment (2000), section 6, for the robust
/// weights.
#[derive(Debug, Clone)]
pub(crate) struct DampedGaussNewton {
    /// Factor on the diagonal of the normal equations; adapted while solving.
    damping: f64,
    /// Relative fall of the cost below which the solution is accepted.
    tolerance: f64,
    converged: bool,
    /// The cost that the solver came from.
    start_cost: Option<f64>,
}

impl Default for DampedGaussNewton {
    fn default() -> Self {
        Self { damping: 1e-6, tolerance: 1e-6, converged: false, start_cost: None }
    }
}

impl DampedGaussNewton {
    const MAX_DAMPING: f64 = 1e6;
}

impl<O: RobustProblem> Solver<&O, IterState<O::Param, (), (), (), (), f64>> for DampedGaussNewton {
    fn name(&self) -> &str {
        "damped Gauss-Newton"
    }

    fn next_iter(
        &mut self,
        problem: &mut Problem<&O>,
        mut state: IterState<O::Param, (), (), (), (), f64>,
    ) -> std::result::Result<(IterState<O::Param, (), (), (), (), f64>, Option<KV>), argmin::core::Error>
    {
        let param = state.take_param().ok_or_else(|| argmin::core::Error::msg("no initial axis"))?;
        let linear = problem.problem("linearize_count", |p| Ok(p.linearize(&param)?))?;
        self.start_cost.get_or_insert(linear.cost);
        while self.damping <= Self::MAX_DAMPING {
            let mut damped = linear.hessian;
            for i in 0..4 {
                // A direction without any information keeps a unit curvature, and so does not move.
                let curvature = linear.hessian[(i, i)];
                damped[(i, i)] = if curvature > 0.0 { curvature * (1.0 + self.damping) } else { 1.0 };
            }
            if let Some(cholesky) = damped.cholesky() {
                let step = -cholesky.solve(&linear.gradient);
                let moved = problem.problem("step_count", |p| Ok(p.step(&param, &step)))?;
                let cost = problem.problem("cost_count", |p| Ok(p.cost(&moved)?))?;
                if cost <= linear.cost {
                    self.converged = linear.cost - cost <= self.tolerance * linear.cost;
                    self.damping = (0.1 * self.damping).max(1e-12);
                    return Ok((state.param(moved).cost(cost), None));
                }
            }
            self.damping *= 10.0;
        }
        self.converged = true;
        Ok((state.param(param).cost(linear.cost), None))
    }

    fn terminate(&mut self, _: &IterState<O::Param, (), (), (), (), f64>) -> TerminationStatus {
        if self.converged {
            TerminationStatus::Terminated(TerminationReason::SolverConverged)
        } else {
            TerminationStatus::NotTerminated
        }
    }
}

/// Where the solver stopped.
#[derive(Debug, Clone)]
pub(crate) struct Minimum<P> {
    /// The unknowns.
    pub param: P,
    /// Robust cost at the start and at the end.
    pub costs: [f64; 2],
}

/// Minimises `problem` from `start` in at most `max_iterations` accepted steps.
///
/// # Errors
/// Those of the problem, as they are; [`Error::InvalidParameter`] should the solver library fail by itself.
pub(crate) fn minimize<O: RobustProblem>(
    problem: &O,
    start: O::Param,
    max_iterations: u64,
) -> Result<Minimum<O::Param>> {
    let solved = Executor::new(problem, DampedGaussNewton::default())
        .configure(|state| state.param(start).max_iters(max_iterations))
        .run()
        .map_err(|e| e.downcast::<Error>().unwrap_or_else(|other| no_solution(&other.to_string())))?;
    let (mut state, solver) = (solved.state, solved.solver);
    let cost = state.get_cost();
    let param = state.take_param().or_else(|| state.take_best_param()).ok_or_else(|| no_solution("none"))?;
    Ok(Minimum { param, costs: [solver.start_cost.unwrap_or(cost), cost] })
}

fn no_solution(found: &str) -> Error {
    let expected = "a problem that the solver can linearise";
    Error::InvalidParameter { name: "axis", value: found.to_owned(), expected }
}

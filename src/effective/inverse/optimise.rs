//! L-BFGS with the line search of More and Thuente, from argmin, on a problem of one stage.
//!
//! The best connected cell of all evaluations is kept, whatever the optimiser does after it. A run that gained is
//! followed by another from its best point, since a line search fails with a bad quasi-Newton matrix.

use super::InverseError;
use super::medium::Medium;
use super::problem::{Evaluation, Problem};
use argmin::core::{CostFunction, Error, Executor, Gradient};
use argmin::solver::linesearch::MoreThuenteLineSearch;
use argmin::solver::quasinewton::LBFGS;
use druse_geometry::progress::Progress;
use std::cell::RefCell;

/// Steps that the quasi-Newton matrix is made of.
const MEMORY_STEPS: usize = 10;
/// The longest step of the line search, in search directions; the shortest is 1e-6.
const MAX_STEP: f64 = 8.0;
/// Change of the cost at which the optimiser stops.
const COST_TOLERANCE: f64 = 1e-6;
/// Gain of a run, in cost, at or below which the optimiser is not started again.
const RESTART_GAIN: f64 = 1e-3;
/// Cost of a point where nothing can be evaluated: far above that of any cell.
const REFUSED_COST: f64 = 1e6;

/// What an optimisation found.
pub struct Found {
    /// Evaluations that were made.
    pub evaluations: usize,
    /// The best connected cell, and its unknowns.
    pub best: Option<(Vec<f64>, Evaluation)>,
    /// The best cell, connected or not: where later stages go on from if none is.
    pub any: Option<(Vec<f64>, Evaluation)>,
}

/// What evaluations leave behind.
struct Memory {
    media: Vec<Medium>,
    last: Option<(Vec<f64>, Option<Evaluation>)>,
    found: Found,
    failure: Option<InverseError>,
}

/// The problem as argmin sees it.
struct Bridge<'a> {
    problem: &'a Problem<'a>,
    progress: &'a dyn Progress,
    memory: RefCell<Memory>,
    max_evaluations: usize,
}

impl Bridge<'_> {
    /// Gives `part` the evaluation at a point, once for cost and gradient; `None` where there is none or it does not
    /// converge. An error once all evaluations are used, or on one of another kind.
    fn visit<T>(
        &self,
        unknowns: &[f64],
        part: impl Fn(Option<&Evaluation>) -> T,
    ) -> Result<T, Error> {
        let memory = &mut *self.memory.borrow_mut();
        // argmin requests cost and gradient one after the other at a point: the evaluation of the last one serves both.
        let known = memory.last.as_ref().filter(|l| l.0 == unknowns);
        if let Some((_, last)) = known {
            return Ok(part(last.as_ref()));
        }
        if memory.found.evaluations >= self.max_evaluations {
            return Err(Error::msg("all evaluations are used"));
        }
        memory.found.evaluations += 1;
        let evaluated = self
            .problem
            .evaluate(unknowns, &mut memory.media, self.progress);
        let own = match evaluated {
            Ok(own) => own,
            Err(InverseError::Homogenize(crate::homogenize::HomogenizeError::NotConverged {
                ..
            })) => None,
            Err(e) => {
                memory.failure = Some(e);
                return Err(Error::msg("stopped"));
            }
        };
        self.progress.advance(1);
        if let Some(own) = &own {
            let keep = |slot: &mut Option<(Vec<f64>, Evaluation)>| {
                if slot.as_ref().is_none_or(|b| own.cost < b.1.cost) {
                    *slot = Some((unknowns.to_vec(), own.clone()));
                }
            };
            keep(&mut memory.found.any);
            if own.is_connected {
                keep(&mut memory.found.best);
            }
        }
        let value = part(own.as_ref());
        memory.last = Some((unknowns.to_vec(), own));
        Ok(value)
    }
}

impl CostFunction for &Bridge<'_> {
    type Param = Vec<f64>;
    type Output = f64;
    fn cost(&self, unknowns: &Vec<f64>) -> Result<f64, Error> {
        self.visit(unknowns, |e| e.map_or(REFUSED_COST, |e| e.cost))
    }
}

impl Gradient for &Bridge<'_> {
    type Param = Vec<f64>;
    type Gradient = Vec<f64>;
    fn gradient(&self, unknowns: &Vec<f64>) -> Result<Vec<f64>, Error> {
        let none = || vec![0.0; unknowns.len()];
        self.visit(unknowns, |e| e.map_or_else(none, |e| e.gradient.clone()))
    }
}

/// Improves unknowns until the cost no longer changes or the evaluations are used.
///
/// # Errors
/// [`InverseError`] of an evaluation, with what was found before it.
pub fn optimise(
    problem: &Problem,
    unknowns: Vec<f64>,
    media: Vec<Medium>,
    max_evaluations: usize,
    progress: &dyn Progress,
) -> (Found, Option<InverseError>) {
    let bridge = Bridge {
        problem,
        progress,
        memory: RefCell::new(Memory {
            media,
            last: None,
            found: Found {
                evaluations: 0,
                best: None,
                any: None,
            },
            failure: None,
        }),
        max_evaluations,
    };
    // What the solver itself returns is not used: the best evaluation is kept above, and an error is either the
    // end of the evaluations or a line search that found no lower point.
    let run = |unknowns: Vec<f64>| -> Result<(), Error> {
        let search = MoreThuenteLineSearch::new().with_bounds(1e-6, MAX_STEP)?;
        let solver = LBFGS::new(search, MEMORY_STEPS).with_tolerance_cost(COST_TOLERANCE)?;
        Executor::new(&bridge, solver)
            .configure(|state| state.param(unknowns).max_iters(max_evaluations as u64))
            .ctrlc(false)
            .run()?;
        Ok(())
    };
    let best = || {
        let memory = bridge.memory.borrow();
        let found = memory.found.any.as_ref();
        found.map(|(unknowns, own)| (unknowns.clone(), own.cost))
    };
    let mut start = unknowns;
    let mut cost = f64::INFINITY;
    loop {
        let _ = run(start);
        let is_over = {
            let memory = bridge.memory.borrow();
            memory.failure.is_some() || memory.found.evaluations >= max_evaluations
        };
        match best() {
            Some((unknowns, own)) if !is_over && own < cost - RESTART_GAIN => {
                (start, cost) = (unknowns, own);
            }
            _ => break,
        }
    }
    let memory = bridge.memory.into_inner();
    (memory.found, memory.failure)
}

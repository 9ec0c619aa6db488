//! Discrete-time control model of a battery of parallel strings, and what a search for good schedules needs of it:
//! roll-outs, one-step optima, a greedy pass, a local search, reachable sets and step cuts.
//!
//! SI units; requests are magnitudes with a direction for each step (that of the demand).

#[cfg(test)]
extern crate self as bess_control;

mod error;
mod explicit;
mod model;
mod one_step;
mod plan;
mod reach;
mod reactive;
mod search;
mod split;

pub use error::ControlError;
pub use explicit::{ExplicitLaw, Measured, Tables, N_OUTLOOK, N_WEIGHTS};
pub use model::{
    BestShares, CoefficientRanges, Coefficients, CoefficientsFrom, ControlHorizon, ControlModel, Costs,
    CostsOf, Flow, Followed, Interval, Losses, Problem, Range, Rollouts, StateBox, StringModel, StringState,
    MAX_GROUPS,
};
pub use plan::{Plan, PlanEffort, PlanProblem, Prices, Rule};
pub use reach::{Confined, GroupBounds, Planes, StepBound, StepBounds};
pub use search::{Effort, Incumbent, Schedule};
pub use split::Split;

//! Discrete-time control model of a battery of parallel strings, and what a search for good schedules needs of it:
//! roll-outs, one-step optima, a greedy pass, a local search, reachable sets and step cuts.
//!
//! SI units; requests are magnitudes with a direction for each step (that of the demand).

mod error;
mod model;
mod one_step;
mod reach;
mod search;

pub use error::ControlError;
pub use model::{
    direction_of, CoefficientRanges, Coefficients, ControlHorizon, ControlModel, Costs, Flow, Interval,
    LossCosts, Problem, Range, Rollouts, StateBox, StringModel, StringState, MAX_GROUPS,
};
pub use reach::{Confined, Planes, StepBound, StepBounds};
pub use search::Schedule;

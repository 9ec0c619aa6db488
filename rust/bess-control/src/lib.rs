//! Discrete-time control model of a battery of parallel strings, and what a search for good schedules needs of it:
//! roll-outs, one-step optima, a greedy pass, a local search, reachable sets and step cuts.
//!
//! SI units; requests are magnitudes with a direction for each step (that of the demand).

mod bounds;
mod confine;
mod error;
mod greedy;
mod horizon;
mod lagrangian;
mod loss;
mod model;
mod moves;
mod one_step;
mod one_step_curve;
mod planes;
mod ranges;
mod ranking;
mod reach;
mod rollout;
mod search;
mod walker;

pub use bounds::{StepBound, StepBounds};
pub use confine::Confined;
pub use error::ControlError;
pub use horizon::{direction_of, ControlHorizon, ControlModel, Costs, LossCosts, Problem, MAX_GROUPS};
pub use model::{Coefficients, Flow, Interval, StringModel, StringState};
pub use planes::Planes;
pub use ranges::{CoefficientRanges, Range, StateBox};
pub use rollout::Rollouts;
pub use search::Schedule;

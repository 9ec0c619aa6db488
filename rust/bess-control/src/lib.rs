//! Discrete-time control model of a battery of parallel strings, and what is decided on it.
//!
//! `model` is what strings do in a control step. On it stand four ways to share a demand:
//!
//! - [`ControlHorizon::split`], certified, over a few steps: `search` finds a schedule with the help of the best splits of
//!   single steps (`one_step`), `reach` bounds it by the states that can be reached.
//! - [`PlanProblem::plan`], over a day or more and without a certificate (`plan`).
//! - [`ExplicitLaw::split`], the decision of a fitted controller (`explicit`).
//! - [`ControlModel::share_reactive`], for reactive power (`reactive`).
//!
//! SI units; requests are magnitudes with a direction for each step (that of the demand). Arrays over strings and steps are
//! flat and string-major: `(M, T)`.

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
    BestShares, CoefficientRanges, Coefficients, CoefficientsFrom, ControlHorizon, ControlModel, CostsOf,
    Flow, Followed, Interval, Losses, Objectives, Range, Rollout, SplitProblem, StateBox, StringModel,
    StringState, MAX_GROUPS,
};
pub use plan::{Plan, PlanEffort, PlanProblem, Prices, Rule};
pub use reach::{
    Cell, Confined, GroupBounds, LossUnits, NarrowNode, Node, Planes, StepBound, StepBounds, RELAXED_NAMES,
};
pub use search::{Effort, Incumbent, Schedule};
pub use split::Split;

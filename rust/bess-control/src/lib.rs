//! Discrete-time control model of a battery of parallel strings, and the optimisation based on it.
//!
//! `model` computes the response of strings in a control step. Four methods allocate a demand with it:
//!
//! - [`ControlHorizon::split`], certified, over a few steps: `search` finds a schedule with the help of the optima of
//!   single steps (`one_step`), and `reach` computes a lower bound from the reachable states.
//! - [`PlanProblem::plan`], over a day or more and without a certificate (`plan`).
//! - [`ExplicitLaw::split`], an explicit control law (`explicit`), and [`RuleLaw::split`], a rule (`rules`).
//! - [`ControlModel::share_reactive`], for reactive power (`reactive`).
//!
//! [`Store::dispatch`] chooses the demand itself, over prices (`dispatch`).
//!
//! SI units; requests are magnitudes with a direction for each step (that of the demand). Arrays over strings and steps are
//! flat and string-major: `(M, T)`.

// The helpers that tests and benches share name the crate.
#[cfg(test)]
extern crate self as bess_control;

mod cores;
mod dispatch;
mod error;
mod explicit;
mod extremes;
mod model;
mod one_step;
mod plan;
mod reach;
mod reactive;
mod rules;
mod search;
#[cfg(test)]
mod tests;

pub use dispatch::{DispatchBlock, DispatchProblem, Store, StoreGrid, StoreState};
pub use explicit::{ExplicitLaw, Measured, Tables, DECISION, N_FEATURES, N_WEIGHTS};
pub use model::{
    BestShares, Coefficients, CoefficientsFrom, ControlHorizon, ControlModel, CostsOf, Flow, Interval,
    Losses, Objectives, Range, Rollout, SplitProblem, StateBox, StringModel, StringState, TrackedDemand,
    MAX_GROUPS,
};
pub use plan::{Groups, Plan, PlanEffort, PlanProblem, Prices};
pub use reach::{Cell, GroupBounds, LossUnits, Node, StepBound, StepBounds, TightenedBounds};
pub use rules::{water_fill, Rule, RuleLaw};
pub use search::{Effort, Incumbent, Schedule, Split};

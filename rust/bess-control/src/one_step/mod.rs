//! The one-step problem: selection of strings and allocation of the demand of a step at minimum cost.
//!
//! `cost_curve` gives the cost of one string as a function of its request and its response to a price of the demand, for
//! active power; the `reactive` module does so for reactive power. `lagrangian` sums the responses of all strings and
//! maximises the dual over the price; `solve` closes the remaining gap by branch and bound on the inverter states.

mod cost_curve;
mod lagrangian;
mod solve;

pub(crate) use cost_curve::{CostCurve, OperatingTerms, Response, StringCost};
pub(crate) use lagrangian::OneStepSolution;
pub(crate) use solve::solve;

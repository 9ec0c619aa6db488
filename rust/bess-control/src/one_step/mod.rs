//! The one-step problem: which strings run in a step, and how they share its demand, at the least cost.
//!
//! `cost_curve` gives the cost of one string as a function of its request and its answer to a price of the demand;
//! `lagrangian` adds the answers of all strings up and finds the best price, the dual of the problem; `solve` closes
//! what gap is left by branch and bound on which inverters run.

mod cost_curve;
mod lagrangian;
mod solve;

pub(crate) use cost_curve::{CostCurve, OperatingTerms};
pub(crate) use lagrangian::{maximise, Commitment};
pub(crate) use solve::{solve, OneStepSolution};

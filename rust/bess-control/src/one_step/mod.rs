//! The best split of one step: costs of a string as a function of its request, and sets of strings by their price.

mod curve;
mod lagrangian;
mod solve;

pub(crate) use curve::{CostCurve, Terms};
pub(crate) use lagrangian::{maximise, Choice};
pub(crate) use solve::{solve, OneStep};

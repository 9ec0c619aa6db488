//! The search for a good schedule: starts, descents by local moves over incremental roll-outs, and
//! perturbations.

mod descent;
mod greedy;
mod incremental_rollout;
mod incumbent;
mod iterated_local_search;
mod moves;
mod multistart;
mod perturbation;
mod ranking;

pub use incumbent::{Incumbent, Schedule};
pub use multistart::Effort;
pub(crate) use multistart::SearchResult;

#[cfg(test)]
#[path = "../../tests/common/mod.rs"]
pub(crate) mod common;

/// A horizon of identical strings for tests, each half full with a limit of 92 kW.
#[cfg(test)]
pub(crate) fn test_horizon(n_strings: usize, demand_w: &[f64]) -> crate::model::ControlHorizon {
    use crate::model::{ControlHorizon, ControlModel, SplitProblem};
    let system = common::reference(n_strings);
    let costs = vec![1e-5; n_strings * 4];
    let problem = SplitProblem {
        soc: &vec![0.5; n_strings],
        temperature_c: &vec![25.0; n_strings],
        demand_w,
        ambient_c: &vec![25.0; demand_w.len()],
        dt_h: 0.25,
        limit_w: &vec![92e3; n_strings * demand_w.len()],
        costs: &costs,
        search_costs: &costs,
        tolerance_abs: &[1e-6],
        tolerance_rel: &[1e-4],
    };
    ControlHorizon::new(ControlModel::new(&system), &problem).unwrap()
}

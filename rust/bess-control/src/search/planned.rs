//! The start from a plan over the horizon.

use crate::model::{CoefficientsFrom, ControlHorizon, CostsOf, Losses};
use crate::plan::PlanEffort;

/// Price of a group of objectives in the sum of a plan, relative to the next group.
const PRICE_OF_FIRST_GROUP: f64 = 1e3;
/// String-steps of the moves from each of the plan's starts.
const STRING_STEPS_OF_MOVES: usize = 200_000;
/// Iterations of the dual bound, whose schedule is one of these starts.
const BOUND_PASSES: usize = 20;
/// Number of strings above which plans start from rules only: the time for dynamic programs grows with its square.
const MAX_STRINGS_WITH_DYNAMIC_PROGRAMS: usize = 64;

impl ControlHorizon {
    /// Requests `(M, T)` of plans that minimise one sum of all groups: dynamic programs place scarce charge and coolness in
    /// the steps that need them most, where descents from the other starts end in local optima. Empty if it cannot be planned.
    pub(crate) fn planned(&self) -> Vec<Vec<f64>> {
        let n_strings = self.n_strings();
        let mut blended = [0.0; 4];
        for group in 0..self.n_groups() {
            blended = blended.map(|cost| PRICE_OF_FIRST_GROUP * cost);
            for costs in self.group_costs(group, CostsOf::Search) {
                blended.iter_mut().zip(costs.to_array()).for_each(|(sum, c)| *sum += c / n_strings as f64);
            }
        }
        let effort = PlanEffort {
            rollouts: 0,
            fresh_rollouts: STRING_STEPS_OF_MOVES.div_ceil(self.size()),
            bound_passes: if n_strings > MAX_STRINGS_WITH_DYNAMIC_PROGRAMS { 0 } else { BOUND_PASSES },
            proof_cells: 0,
            turn: 0,
        };
        self.plan_problem(Losses::from_array(blended)).map_or(vec![], |problem| {
            problem.with_coefficients_from(CoefficientsFrom::Start).schedules(effort)
        })
    }
}

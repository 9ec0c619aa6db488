//! Iterated local search for steps that share a scarce SOC: descents from plans, then races of descents from perturbations of
//! the best schedule.

use super::incumbent::Schedule;
use super::multistart::Search;
use crate::model::{CoefficientsFrom, ControlHorizon, CostsOf, Losses};
use crate::plan::PlanEffort;

/// String-steps of the perturbations of a kind in a round, and their minimum and maximum number.
const PERTURBED_STRING_STEPS: usize = 480;
const MOVES: (usize, usize) = (12, 48);
/// Stages of successive halving: roll-outs of a descent, and the reduction factor.
const HEATS: [(usize, usize); 3] = [(100, 4), (400, 3), (2000, 1)];
/// Relative difference of objectives below which descents have ended in the same optimum.
const SAME_OPTIMUM: f64 = 1e-5;
/// Minimum relative gain of a round for another one, and the maximum number of rounds.
const MIN_RELATIVE_GAIN: f64 = 1e-6;
const MAX_ROUNDS: usize = 3;
/// String-steps after which no descent of a race starts.
const MAX_STEPS: u64 = 5_000_000;

/// Price of a group of objectives in the sum of a plan, relative to the next group.
const PRICE_OF_FIRST_GROUP: f64 = 1e3;
/// String-steps of the moves from each of the plan's starts.
const STRING_STEPS_OF_MOVES: usize = 200_000;
/// Iterations of the shadow prices, whose schedule is one of these starts.
const PRICE_PASSES: usize = 20;
/// Maximum number of strings for starts from dynamic programs, whose time grows with its square.
const MAX_STRINGS_WITH_DYNAMIC_PROGRAMS: usize = 64;

impl Search<'_> {
    /// Searches from plans and perturbations, even if every step is optimal at its own states, because other states may be
    /// better.
    pub(super) fn search_distant(&mut self) {
        let horizon = self.horizon;
        for planned_w in horizon.planned() {
            self.improve(horizon.fitted(&planned_w));
        }
        let last = self.string_steps + MAX_STEPS;
        let most = (PERTURBED_STRING_STEPS / horizon.size()).clamp(MOVES.0, MOVES.1);
        for _ in 0..MAX_ROUNDS {
            let before = self.incumbent.schedule.objectives;
            let flows = horizon.flows(self.best());
            let mut moved = horizon.with_strings_swapped(self.best(), most);
            moved.extend(horizon.with_steps_exchanged(self.best(), &flows, most));
            for group in 0..horizon.n_groups() {
                self.successive_halving(moved.clone(), group, last);
            }
            let after = self.incumbent.schedule.objectives;
            if (0..horizon.n_groups()).all(|g| after[g] >= before[g] * (1.0 - MIN_RELATIVE_GAIN)) {
                return;
            }
            self.improve(self.best().to_vec());
        }
    }

    /// Descents in one group, under the ceilings of the incumbent: short ones from all starts, longer ones from the best, each
    /// optimum once, and full ones from the best of these.
    fn successive_halving(&mut self, mut starts: Vec<Schedule>, group: usize, last: u64) {
        for (rollouts, one_of) in HEATS {
            for start in &mut starts {
                if self.late() || self.string_steps >= last {
                    return;
                }
                *start = self.descend(&start.request_w, group, rollouts.min(self.effort.rollouts));
            }
            let ranking = self.incumbent.ranking(self.horizon, group);
            starts.sort_by(|a, b| ranking.order(&a.objectives, &b.objectives));
            let equal = |(a, b): (&f64, &f64)| (a - b).abs() <= SAME_OPTIMUM * a.abs().max(b.abs());
            starts.dedup_by(|a, b| a.objectives.iter().zip(&b.objectives).all(equal));
            starts.truncate(starts.len().div_ceil(one_of));
        }
    }
}

impl ControlHorizon {
    /// Requests `(M, T)` of plans that minimise one sum of all groups: dynamic programs use scarce charge and thermal
    /// headroom in the best steps, while descents from other starts end in local optima. Empty if it cannot be planned.
    fn planned(&self) -> Vec<Vec<f64>> {
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
            restart_rollouts: STRING_STEPS_OF_MOVES.div_ceil(self.size()),
            price_passes: if n_strings > MAX_STRINGS_WITH_DYNAMIC_PROGRAMS { 0 } else { PRICE_PASSES },
            proof_cells: None,
            turn: 0,
        };
        self.plan_problem(Losses::from_array(blended)).map_or(vec![], |problem| {
            problem.with_coefficients_from(CoefficientsFrom::Start).schedules(effort)
        })
    }
}

//! Lower bound of a group with shadow prices of the balance, which decouple the strings, and of the ceilings of earlier groups.
//! A value function of each kind of string follows its state, so that the bound does not widen with the ranges of states over
//! long horizons, and many strings of one kind cost little more than one ([`crate::plan::proof`]).
//!
//! With costs `F` of the group, `F_e` of an earlier one and its ceiling `C_e`, every schedule within the ceilings has
//! `F >= F + mu (F_e - C_e)` for all `mu >= 0`. The minimum of `F + mu F_e` is bounded below, less `mu C_e`.

use crate::model::{ControlHorizon, CostsOf, Losses};
use crate::plan::dual::{self, ProofPrices};
use crate::plan::{proof, PlanProblem, Prices};

/// Iterations of the prices.
const PASSES: usize = 40;
/// Cells of SOC.
const SOC_CELLS: usize = 280;
/// Multipliers of earlier groups, relative to the largest costs of both groups. The bound is concave in them, so after the two in
/// the middle only the one next to the better is tried.
const MULTIPLIERS: [f64; 4] = [0.05, 0.1, 0.2, 0.4];
/// Multiplier of groups with a ceiling of zero, for which every multiplier is valid without a deduction.
const ZERO_CEILING_MULTIPLIER: f64 = 1.0;
/// Ceiling that counts as zero.
const NEGLIGIBLE_CEILING: f64 = 1e-9;

impl ControlHorizon {
    /// Lower bound of the objective of the group that follows those with `ceilings`, at most the `objective` of a known
    /// schedule. 0 if there is no such bound. Prices ascend on a sample of at most `sample` strings; the bound is that of all strings.
    pub fn priced_bound(&self, ceilings: &[f64], objective: f64, sample: usize) -> f64 {
        let own = self.min_costs(ceilings.len());
        let earlier: Vec<_> = ceilings.iter().enumerate().map(|(g, &c)| (self.min_costs(g), c)).collect();
        let free = earlier.iter().all(|(_, ceiling)| *ceiling <= NEGLIGIBLE_CEILING);
        let bound = |scale: f64| {
            let (mut costs, mut ceiling_cost) = (own, 0.0);
            for (before, ceiling) in &earlier {
                let multiplier =
                    if largest(before) > 0.0 { scale * largest(&own) / largest(before) } else { 0.0 };
                costs.iter_mut().zip(before).for_each(|(total, cost)| *total += multiplier * cost);
                ceiling_cost += multiplier * ceiling;
            }
            self.priced(costs, objective + ceiling_cost, sample, free)
                .map_or(0.0, |bound| bound - ceiling_cost)
        };
        let best = if free {
            bound(ZERO_CEILING_MULTIPLIER)
        } else {
            let [least, less, more, most] = MULTIPLIERS;
            let (below, above) = (bound(less), bound(more));
            below.max(above).max(bound(if above > below { most } else { least }))
        };
        best.clamp(0.0, objective)
    }

    /// Number of kinds of strings: strings of one kind are equal except for their states.
    pub fn n_kinds(&self) -> usize {
        self.plan_problem(Losses::default()).map_or(0, |problem| problem.kinds().len())
    }

    /// Lower bound of all schedules at costs of the losses [1/W], the same for all strings; if no undelivered energy is deducted,
    /// with the prices of the relaxation where these are useful.
    fn priced(&self, costs: [f64; 4], known_cost: f64, sample: usize, free: bool) -> Option<f64> {
        let problem = self.plan_problem(Losses::from_array(costs.map(|c| c / self.intervals[0].dt_h)))?;
        let (sample, share) = problem.sampled(sample);
        let (start, known_cost) = (vec![0.0; self.n_steps()], share * known_cost);
        let relaxed =
            if free { ProofPrices::of_relaxation(&sample, &start, known_cost, PASSES) } else { None };
        let prices = relaxed.unwrap_or_else(|| {
            let dual = dual::ascend(&sample, start, known_cost, PASSES);
            ProofPrices { price: dual.price, relaxed: false }
        });
        proof::bound(&problem, &prices, SOC_CELLS)
    }

    /// The problem of a plan at prices of the losses, the same for all strings and steps; nothing else has a price.
    pub(crate) fn plan_problem(&self, losses: Losses) -> Option<PlanProblem<'_>> {
        let (n_strings, n_steps) = (self.n_strings(), self.n_steps());
        let prices = Prices {
            losses: vec![losses; n_steps],
            wear: vec![0.0; n_strings],
            start: 0.0,
            balance: 0.0,
            end_charge: 0.0,
        };
        let problem = PlanProblem::new(
            &self.model,
            self.start.clone(),
            vec![false; n_strings],
            &self.demand_w,
            self.intervals.clone(),
            &self.limit_w,
            prices,
        );
        problem.ok()
    }

    /// Minimum costs of the losses of a group over all strings.
    fn min_costs(&self, group: usize) -> [f64; 4] {
        let costs = self.group_costs(group, CostsOf::Report);
        [0, 1, 2, 3].map(|i| costs.iter().map(|c| c.to_array()[i]).fold(f64::INFINITY, f64::min))
    }
}

fn largest(costs: &[f64; 4]) -> f64 {
    costs.iter().copied().fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use crate::model::ControlHorizon;
    use crate::tests::common;

    const SIZE: usize = 12;
    const SCHEDULES: usize = 400;
    const FAR: f64 = 1e9;

    fn schedules(horizon: &ControlHorizon) -> Vec<[f64; 2]> {
        let wanted = |i: usize| common::uniform(i as u64) * common::NOMINAL_W;
        let one = |n: usize| {
            let request_w: Vec<f64> = (0..SIZE).map(|i| wanted(n * SIZE + i)).collect();
            let costs = horizon.objectives(&horizon.fitted(&request_w));
            [costs[0], costs[1]]
        };
        (0..SCHEDULES).map(one).collect()
    }

    #[test]
    fn no_schedule_within_a_ceiling_costs_less_than_its_useful_priced_bound() {
        for soc in [0.06, 0.5, 0.95] {
            let horizon = common::horizon(&common::reference(2), SIZE / 2, soc);
            let all = schedules(&horizon);
            let least = all.iter().map(|c| c[0]).fold(f64::INFINITY, f64::min);
            for ceiling in [least, 1.1 * least + 1e-3] {
                let within =
                    all.iter().filter(|c| c[0] <= ceiling).map(|c| c[1]).fold(f64::INFINITY, f64::min);
                let bound = horizon.priced_bound(&[ceiling], FAR, 2);
                assert!(bound <= within, "{bound} above {within} at {soc}");
                assert!(bound > 0.7 * within, "{bound} of {within} at {soc}");
            }
        }
    }
}

//! Plans over a day or more with one cost function, shifted from step to step and re-optimised.
//!
//! A plan is a schedule of requests on the control model in its midpoint form ([`StringModel::step_midpoint`]). It has no
//! certificate. In the model, its cost never exceeds the cost of the schedule of any rule or of its shifted warm start.
//!
//! `problem` defines the data, `starts` the initial schedules, and `paths` an incremental roll-out, which evaluates a
//! change from its step on, with its co-states. Two strings at a time exchange power (`pair`): over a block of steps
//! (`blocks`), or in one step and back in a later one (`sweep`) if the co-states predict a gain.
//!
//! Large plants are planned in `groups`: similar strings in similar states as one string, whose power is then allocated to them.
//!
//! [`StringModel::step_midpoint`]: crate::StringModel::step_midpoint

mod blocks;
pub(crate) mod dual;
mod groups;
mod look_ahead;
mod nodes;
mod pair;
mod pairs;
mod paths;
mod problem;
pub(crate) mod proof;
mod starts;
mod sweep;

pub use groups::Groups;
pub use problem::{PlanProblem, Prices};

use bess_tables::InputError;

use dual::{Dual, ProofPrices};
use look_ahead::{look_ahead, CostToGo};
use pair::Pair;
use pairs::PairValues;
use paths::Paths;

use crate::cores;
use crate::rules::Rule;

/// Minimum gain of a round of moves, as a share of the cost, for another round.
const MIN_RELATIVE_GAIN: f64 = 2e-4;

/// Distance of the plant's fill level from empty and full above which SOC balancing has its lowest price, and below which its full.
const HARMLESS_MARGIN: f64 = 0.3;
const HARMFUL_MARGIN: f64 = 0.15;
/// Lowest price factor of SOC balancing: equal SOCs simplify planning.
const SLACK: f64 = 0.1;

/// Step of the dynamic program of pairs [h]; shorter steps take more time without a gain, unless there are few of them.
const PAIRS_STEP_H: f64 = 0.5;
const MAX_STEPS_AT_FINE_STEP: usize = 16;

/// Step of the dynamic programs of single strings whose dual is a bound [h].
const BOUND_STEP_H: f64 = 0.25;

/// Effort of a plan, in roll-outs of all strings over all steps, so that results do not depend on the machine.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PlanEffort {
    /// Roll-outs for the shifted warm start, or for the best start of a restart.
    pub rollouts: usize,
    /// Roll-outs for each start of a restart, before the best is chosen; 0 = no restart.
    pub restart_rollouts: usize,
    /// Iterations of the shadow prices in a restart. With 0, it has no starts from dynamic programs.
    pub price_passes: usize,
    /// SOC cells of the proven bound. None = a restart computes no bounds, and its shadow prices on longer steps.
    pub proof_cells: Option<usize>,
    /// Number of the call, which selects the moves.
    pub turn: usize,
}

/// A plan.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Requests `(M, T)`, magnitudes [W].
    pub request_w: Vec<f64>,
    /// Cost in the model.
    pub cost: f64,
    /// Cost of the schedule of the cheapest rule in the model.
    pub rule_cost: f64,
    /// Lower bound of the cost of every schedule, on the grid of [`dual`]: an estimate. None if not computed.
    pub search_bound: Option<f64>,
    /// Lower bound of the cost of every schedule on the control model with the coefficients of the start of each step, proven
    /// ([`proof`]). None if not computed.
    pub bound: Option<f64>,
    /// Number of roll-outs.
    pub rollouts: usize,
    /// Marginal cost of initial charge, averaged over the strings by capacity; negative if charge is scarce [cost/Ah].
    pub start_charge: f64,
}

impl PlanProblem<'_> {
    /// Plans by local search from `previous` `(M, T)` [W] (magnitudes, adapted to changes of demand and limits), or from the schedule
    /// of the best rule if that costs less; in a restart, from several starts.
    pub fn plan(&mut self, previous: Option<&[f64]>, effort: PlanEffort) -> Plan {
        let (mut plan, dual) = self.priced(previous, effort);
        plan.bound = dual
            .zip(effort.proof_cells)
            .and_then(|((_, for_proof), cells)| proof::bound(self, &for_proof, cells));
        plan
    }

    /// Plans groups of strings, each as one string, and allocates their power. Costs and bounds are those of the strings; the plan
    /// costs no more than `previous` and the schedules of the rules. A start of a group costs as much as starts of the mean
    /// number of inverters in a group.
    ///
    /// # Errors
    ///
    /// As [`Self::new`].
    pub fn plan_in_groups(
        &mut self,
        groups: &Groups,
        previous: Option<&[f64]>,
        effort: PlanEffort,
    ) -> Result<Plan, InputError> {
        let warm_start = previous.map(|request_w| starts::fit_to_problem(self, request_w));
        self.set_balancing_reference(warm_start.as_deref());
        let problem: &Self = self;
        let n_steps = problem.n_steps();
        let model = groups.model(problem.model);
        let aggregated_w = warm_start.as_deref().map(|request_w| groups.aggregated(request_w, n_steps));
        let (mut plan, dual) = groups.problem(problem, &model)?.priced(aggregated_w.as_deref(), effort);
        let mut paths = groups.disaggregated(problem, &plan.request_w);
        let rules = cores::map(Rule::ALL.to_vec(), |rule| starts::rule_schedule(rule, problem));
        plan.rule_cost = rules.iter().map(Paths::cost).fold(f64::INFINITY, f64::min);
        paths = rules.into_iter().fold(paths, cheaper);
        if let Some(request_w) = warm_start {
            paths = cheaper(paths, Paths::new(problem, &request_w));
        }
        plan.cost = paths.cost();
        plan.request_w = paths.request_w();
        if let Some(((dual, for_proof), cells)) = dual.zip(effort.proof_cells) {
            plan.search_bound = Some(dual::at_prices(problem, &dual.price));
            plan.bound = proof::bound(problem, &for_proof, cells);
        }
        Ok(plan)
    }

    /// A plan without a proven bound; the dual, and prices for a proof, if bounds are computed.
    fn priced(
        &mut self,
        previous: Option<&[f64]>,
        effort: PlanEffort,
    ) -> (Plan, Option<(Dual, ProofPrices)>) {
        let n_steps = self.n_steps();
        let size = self.n_strings() * n_steps;
        let warm_start = previous.map(|request_w| starts::fit_to_problem(self, request_w));
        self.set_balancing_reference(warm_start.as_deref());
        let problem: &Self = self;
        let mut rules = cores::map(Rule::ALL.to_vec(), |rule| starts::rule_schedule(rule, problem));
        rules.sort_by(|a, b| a.cost().total_cmp(&b.cost()));
        let rule_cost = rules[0].cost();
        let warm_start = warm_start.map(|request_w| Paths::new(problem, &request_w));
        let warm_start = warm_start.filter(|warm_start| warm_start.cost() <= rule_cost);
        let mut starts = vec![warm_start.unwrap_or_else(|| rules.remove(0))];
        let replaced_work: u64 = rules.iter().map(|rule| rule.work).sum();
        let (mut dual, mut cycle) = (None, pair::rounds(self.n_strings()));
        if effort.restart_rollouts > 0 {
            (starts, dual) = problem.restart(starts, effort);
            cycle = problem.rounds_of_all_moves();
        }
        let mut best = starts.into_iter().reduce(cheaper).unwrap_or_else(|| unreachable!("a rule at least"));
        let budget = best.work + (effort.rollouts * size) as u64;
        improve(&mut best, budget, effort.turn, cycle);
        let plan = Plan {
            cost: best.cost(),
            rule_cost,
            search_bound: dual.as_ref().map(|(dual, _)| dual.bound),
            bound: None,
            rollouts: ((replaced_work + best.work) as usize).div_ceil(size.max(1)),
            start_charge: start_charge(&mut best),
            request_w: best.request_w(),
        };
        (plan, dual)
    }

    /// Improved schedules from `starts`, and from the dynamic programs of pairs and of single strings; if bounds are requested, the
    /// dual and prices for a proof, in the steps of the problem.
    fn restart<'p>(
        &'p self,
        starts: Vec<Paths<'p>>,
        effort: PlanEffort,
    ) -> (Vec<Paths<'p>>, Option<(Dual, ProofPrices)>) {
        let (n_steps, size, bounded) =
            (self.n_steps(), self.n_strings() * self.n_steps(), effort.proof_cells.is_some());
        let cycle = self.rounds_of_all_moves();
        let polish = |mut start: Paths<'p>| {
            improve(&mut start, (effort.restart_rollouts * size) as u64, effort.turn, cycle);
            start
        };
        let mut found = cores::map(starts, polish);
        if effort.price_passes == 0 {
            return (found, None);
        }
        let mut per = self.steps_of(PAIRS_STEP_H).min((n_steps / MAX_STEPS_AT_FINE_STEP).max(1));
        let pairs = PairValues::solve(self, per);
        let (ahead, price) = look_ahead(self, &pairs);
        found.push(polish(ahead));
        // A plant of one pair needs no prices for coordination.
        if !bounded && pairs.groups().len() < 2 {
            return (found, None);
        }
        let known = found.iter().map(Paths::cost).fold(f64::INFINITY, f64::min);
        if bounded {
            per = self.steps_of(BOUND_STEP_H);
        }
        let mean = |prices: &[f64]| prices.iter().sum::<f64>() / prices.len() as f64;
        let first_price = price.chunks(per).map(mean).collect();
        let coarse = self.coarsened(per);
        let mut dual = dual::ascend(&coarse, first_price, known, effort.price_passes);
        let blocks = n_steps.div_ceil(per);
        let of_block = |k: usize| dual.request_w[k / n_steps * blocks + k % n_steps / per];
        let request_w: Vec<_> = (0..size).map(of_block).collect();
        found.push(polish(Paths::new(self, &starts::fit_to_problem(self, &request_w))));
        if !bounded {
            return (found, None);
        }
        let known = found.iter().map(Paths::cost).fold(f64::INFINITY, f64::min);
        let passes = effort.price_passes / 2; // from good prices
        let mut for_proof = ProofPrices::of_relaxation(&coarse, &dual.price, known, passes)
            .unwrap_or_else(|| ProofPrices { price: dual.price.clone(), relaxed: false });
        for price in [&mut dual.price, &mut for_proof.price] {
            *price = (0..n_steps).map(|t| price[t / per]).collect();
        }
        (found, Some((dual, for_proof)))
    }

    /// Rounds in which every pair meets and every length of blocks is tried.
    fn rounds_of_all_moves(&self) -> usize {
        pair::rounds(self.n_strings()).max(blocks::LENGTHS.len())
    }

    /// Schedules of several plans, each from another start `(M, T)`.
    pub(crate) fn schedules(&self, effort: PlanEffort) -> Vec<Vec<f64>> {
        let rules = Rule::ALL.iter().map(|&rule| starts::rule_schedule(rule, self)).collect();
        let (found, _) = self.restart(rules, effort);
        let mut found: Vec<Vec<f64>> = found.iter().map(Paths::request_w).collect();
        found.dedup();
        found
    }

    /// Sets the reference of SOC balancing to the fill level of the plant along this plan, and its price by the distance from
    /// empty and full.
    fn set_balancing_reference(&mut self, warm_start: Option<&[f64]>) {
        if self.prices.balance == 0.0 {
            return;
        }
        let paths = match warm_start {
            Some(request_w) => Paths::new(self, request_w),
            None => starts::rule_schedule(Rule::Soc, self),
        };
        let fill = |t: usize| {
            let capacity: f64 = (0..self.n_strings()).map(|m| self.usable_ah(m, t)).sum();
            let charge =
                |m: usize| self.usable_ah(m, t) * self.fill_of(m, paths.strings[m].points[t + 1].state);
            // No string may be in service.
            (0..self.n_strings()).map(charge).sum::<f64>() / capacity.max(f64::MIN_POSITIVE)
        };
        self.fill = (0..self.n_steps()).map(fill).collect();
        let mut tightness = SLACK;
        for t in (0..self.n_steps()).rev() {
            let margin = self.fill[t].min(1.0 - self.fill[t]);
            tightness = tightness
                .max(((HARMLESS_MARGIN - margin) / (HARMLESS_MARGIN - HARMFUL_MARGIN)).clamp(0.0, 1.0));
            for m in 0..self.n_strings() {
                let price = self.prices.balance * tightness * self.usable_ah(m, t);
                let place = m * self.n_steps() + t;
                self.imbalance[place] = price;
            }
        }
    }
}

/// The cheaper of two schedules, with the work of both.
fn cheaper<'a>(best: Paths<'a>, other: Paths<'a>) -> Paths<'a> {
    let work = best.work + other.work;
    let mut cheaper = if other.cost() < best.cost() { other } else { best };
    cheaper.work = work;
    cheaper
}

/// Marginal cost of initial charge in every string, averaged by capacity [cost/Ah].
fn start_charge(paths: &mut Paths<'_>) -> f64 {
    let (mut slope, mut capacity) = (0.0, 0.0);
    for path in &mut paths.strings {
        path.renew_if_changed();
        slope += path.by_soc[0];
        capacity += path.problem.capacity_ah(path.string);
    }
    slope / capacity
}

/// Moves of all pairs of a round, on all cores. Each pair has an equal part of the remaining budget.
fn move_pairs(paths: &mut Paths<'_>, round: usize, budget: u64, moves: impl Fn(&mut Pair<'_, '_>) + Sync) {
    let pairs: Vec<_> = pair::round_robin(paths.strings.len(), round).collect();
    let budget = budget.saturating_sub(paths.work).div_ceil(pairs.len().max(1) as u64);
    if budget == 0 {
        return;
    }
    let mut strings: Vec<_> = paths.strings.iter_mut().map(Some).collect();
    let mut schedule = |m: usize| strings[m].take().unwrap_or_else(|| unreachable!("one pair a round"));
    let pair = |(a, b)| Pair { first: schedule(a), second: schedule(b), work: 0, budget };
    let moved = cores::map(pairs.into_iter().map(pair).collect(), |mut pair| {
        moves(&mut pair);
        pair.work
    });
    paths.work += moved.iter().sum::<u64>();
}

/// Rounds of moves until `cycle` of them gain too little, or the budget is used up. A warm start has been
/// improved by all moves in earlier calls: if one cycle of all pairs gains nothing, further cycles gain little.
fn improve(paths: &mut Paths<'_>, budget: u64, turn: usize, cycle: usize) {
    let mut at_start = paths.cost();
    for round in turn.. {
        let cost = paths.cost();
        move_pairs(paths, round, budget, |pair| sweep::sweep(pair, cost));
        let length = blocks::LENGTHS[round % blocks::LENGTHS.len()];
        move_pairs(paths, round, budget, |pair| blocks::rearrange(pair, length, round));
        if paths.work >= budget || paths.strings.len() < 2 {
            return;
        }
        if (round + 1 - turn) % cycle == 0 {
            let cost = paths.cost();
            if cost > at_start - MIN_RELATIVE_GAIN * at_start.abs() {
                return;
            }
            at_start = cost;
        }
    }
}

//! Foresight: a plan of a day or more under one cost, carried from step to step and improved.
//!
//! A plan is a schedule of requests on the control model in its midpoint form ([`StringModel::step_midpoint`]). Nothing in
//! it is certified; what it promises is that in the model it is never worse than any rule's schedule, nor than the plan it
//! was made from.
//!
//! A `problem` is what a plan is made for, `starts` are the schedules to begin with, `paths` a schedule rolled out, so that a
//! change is costed from where it happens. Two strings at a time then exchange power (`pair`): over a block of steps
//! (`blocks`), or in one step and back in a later one (`sweep`), where `slopes` say that it pays.
//!
//! [`StringModel::step_midpoint`]: crate::StringModel::step_midpoint

mod blocks;
mod dual;
mod look_ahead;
mod pair;
mod pairs;
mod paths;
mod problem;
mod proof;
mod slopes;
mod starts;
mod sweep;

pub use problem::{PlanProblem, Prices};
pub use starts::Rule;

use look_ahead::look_ahead;
use pairs::PairValues;
use paths::Paths;
use slopes::Slopes;

/// A round of moves that gains less than this share of the cost is not worth another one.
const WORTHWHILE: f64 = 2e-4;

/// Distance of the plant's fill from empty and full, above which imbalance does no harm, and below which it counts in full.
const ROOMY: f64 = 0.3;
const TIGHT: f64 = 0.15;
/// What is left of the price of imbalance where it does no harm: strings alike are easier to plan for.
const SLACK: f64 = 0.1;

/// Length of the steps of the program of pairs [h]; shorter ones cost more and find nothing more.
const PAIRS_STEP_H: f64 = 0.5;

/// Length of the steps of the bound, where those of the plan are shorter [h].
const BOUND_STEP_H: f64 = 0.25;

/// How much a plan is worked on. Counted in roll-outs of all strings over all steps, so that answers do not depend on the
/// machine.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PlanEffort {
    /// Roll-outs for the plan that is carried along.
    pub rollouts: usize,
    /// Roll-outs for each fresh start; none are made with 0.
    pub fresh_rollouts: usize,
    /// Passes of the bound by prices. Without any, plans that are made afresh start from the rules alone and have no bound.
    pub bound_passes: usize,
    /// Cells of SOC of the proven bound, which is computed with the bound by prices.
    pub proof_cells: usize,
    /// Where the moves go on: a number that grows from call to call.
    pub turn: usize,
}

/// A plan.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Requests `(M, T)`, magnitudes [W].
    pub request_w: Vec<f64>,
    /// What it costs in the model.
    pub cost: f64,
    /// What the cheapest rule's schedule costs in the model.
    pub rule_cost: f64,
    /// Lower bound of the cost of every schedule, on the grid of [`dual`]: an estimate. None where it was not computed.
    pub search_bound: Option<f64>,
    /// Lower bound of the cost of every schedule on the control model with the coefficients of the start of each step, proven
    /// ([`proof`]). None where it was not computed.
    pub bound: Option<f64>,
    /// Roll-outs made.
    pub rollouts: usize,
    /// What one more Ah at the start would add to the cost, averaged over the strings by capacity; negative, where charge
    /// will be short [cost/Ah].
    pub start_charge: f64,
}

impl PlanProblem<'_> {
    /// Plans: the plan `previous` `(M, T)` [W] (magnitudes; made to fit where demand or limits have changed), or, where it
    /// is missing or costs more, the best rule's schedule, improved by a local search.
    pub fn plan(&mut self, previous: Option<&[f64]>, effort: PlanEffort) -> Plan {
        let size = self.n_strings() * self.n_steps();
        let carried = previous.map(|request_w| starts::carried_on(self, request_w));
        self.aim_for_balance(carried.as_deref());
        let problem: &Self = self;
        let mut rules: Vec<Paths<'_>> = Rule::ALL.iter().map(|rule| rule.paths(problem)).collect();
        rules.sort_by(|a, b| a.cost().total_cmp(&b.cost()));
        let rule_cost = rules[0].cost();
        let mut work: u64 = rules.iter().map(|r| r.work).sum();
        // Of strings that are alike, several rules make the same.
        rules.dedup_by(|a, b| a.request_w == b.request_w);
        let carried = carried.map(|request_w| Paths::new(problem, request_w));
        let mut best = match carried {
            Some(carried) if carried.cost() <= rule_cost => carried,
            _ => rules[0].clone(),
        };
        let every_pair = pair::rounds(self.n_strings());
        improve(&mut best, effort.rollouts * size, effort.turn, every_pair);
        work += best.work;
        let (mut search_bound, mut bound) = (None, None);
        if effort.fresh_rollouts > 0 {
            let every_move = every_pair.max(blocks::LENGTHS.len());
            let mut polish = |request_w: Vec<f64>| {
                let mut fresh = Paths::new(problem, request_w);
                improve(&mut fresh, effort.fresh_rollouts * size, effort.turn, every_move);
                work += fresh.work;
                fresh
            };
            best = rules.into_iter().map(|rule| polish(rule.request_w)).fold(best, cheaper);
            if effort.bound_passes > 0 {
                let pairs = PairValues::solve(&problem.coarsened(problem.steps_of(PAIRS_STEP_H)));
                let ahead = look_ahead(problem, &pairs);
                best = cheaper(best, polish(ahead.request_w));
                let per = problem.steps_of(BOUND_STEP_H);
                let mean = |prices: &[f64]| prices.iter().sum::<f64>() / prices.len() as f64;
                let price = ahead.price.chunks(per).map(mean).collect();
                let dual = dual::ascend(&problem.coarsened(per), price, best.cost(), effort.bound_passes);
                if per == 1 {
                    best = cheaper(best, polish(dual.request_w));
                }
                search_bound = Some(dual.bound);
                let price: Vec<f64> = (0..problem.n_steps()).map(|t| dual.price[t / per]).collect();
                bound = proof::bound(problem, &price, effort.proof_cells);
            }
        }
        Plan {
            cost: best.cost(),
            rule_cost,
            search_bound,
            bound,
            rollouts: (work as usize).div_ceil(size.max(1)),
            start_charge: start_charge(&mut best),
            request_w: best.request_w,
        }
    }

    /// Imbalance is measured from the fill of the plant along the plan at hand, and counts as long as the plant will still come
    /// near empty or full.
    fn aim_for_balance(&mut self, carried: Option<&[f64]>) {
        if self.prices.balance == 0.0 {
            return;
        }
        let paths = match carried {
            Some(request_w) => Paths::new(self, request_w.to_vec()),
            None => Rule::Soc.paths(self),
        };
        let capacity: f64 = (0..self.n_strings()).map(|m| self.usable_ah(m)).sum();
        if capacity <= 0.0 {
            return;
        }
        let fill = |t: usize| {
            let charge = |m: usize| self.usable_ah(m) * self.fill_of(m, paths.at(m, t + 1).state);
            (0..self.n_strings()).map(charge).sum::<f64>() / capacity
        };
        self.fill = (0..self.n_steps()).map(fill).collect();
        let mut tightness = SLACK;
        for t in (0..self.n_steps()).rev() {
            let margin = self.fill[t].min(1.0 - self.fill[t]);
            tightness = tightness.max(((ROOMY - margin) / (ROOMY - TIGHT)).clamp(0.0, 1.0));
            self.tightness[t] = tightness;
        }
    }
}

/// The cheaper of two schedules.
fn cheaper<'a>(best: Paths<'a>, other: Paths<'a>) -> Paths<'a> {
    if other.cost() < best.cost() {
        other
    } else {
        best
    }
}

/// What one more Ah in every string at the start would add to the cost, averaged by capacity [cost/Ah].
fn start_charge(paths: &mut Paths<'_>) -> f64 {
    let (mut slope, mut capacity) = (0.0, 0.0);
    for m in 0..paths.problem.n_strings() {
        slope += Slopes::along(paths, m).soc(0);
        capacity += paths.problem.capacity_ah(m);
    }
    slope / capacity
}

/// Rounds of moves until `cycle` of them gain too little, or the budget is used up. A plan that is carried along was tried
/// with all moves in the steps before: where every pair has met once in vain, little is left to find.
fn improve(paths: &mut Paths<'_>, budget: usize, turn: usize, cycle: usize) {
    let n = paths.problem.n_strings();
    let budget = budget as u64;
    let mut at_start = paths.cost();
    for round in turn.. {
        for pair in pair::tournament(n, round) {
            if paths.work < budget {
                sweep::sweep(paths, pair, budget);
            }
        }
        let length = blocks::LENGTHS[round % blocks::LENGTHS.len()];
        for pair in pair::tournament(n, round) {
            if paths.work < budget {
                blocks::rearrange(paths, pair, length, round, budget);
            }
        }
        if paths.work >= budget || n < 2 {
            return;
        }
        if (round + 1 - turn) % cycle == 0 {
            let cost = paths.cost();
            if cost > at_start - WORTHWHILE * at_start.abs() {
                return;
            }
            at_start = cost;
        }
    }
}

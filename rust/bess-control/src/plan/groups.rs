//! Plans of many strings: a group of similar strings in similar states is planned as one string, whose power is then allocated.

use std::mem;

use bess_tables::{Direction, InputError, System};

use crate::cores;
use crate::error::check_length;
use crate::model::{ControlModel, StringState};
use crate::plan::paths::Paths;
use crate::plan::problem::{PlanProblem, Point, Prices};
use crate::plan::starts::{deliverable_w, ROUNDING_SHARE};
use crate::rules::water_fill;

/// Preference for inverters that are on in the order of a group, as a share of the SOC window.
const SWITCHING_HYSTERESIS: f64 = 0.02;

/// The strings of each group; strings out of service belong to no group.
#[derive(Debug, Clone, PartialEq)]
pub struct Groups {
    members: Vec<Vec<usize>>,
}

impl Groups {
    /// From the group index of each string `(M,)`; None for a string out of service. Strings of a group differ in
    /// state, limit, capacity and resistance only.
    ///
    /// # Errors
    ///
    /// There is no group, a group is empty, or the number of values differs from the number of strings.
    pub fn new(of_string: &[Option<usize>], n_strings: usize) -> Result<Self, InputError> {
        check_length("groups", of_string, n_strings)?;
        let empty = |group: usize| InputError(format!("groups: no string is in group {group}"));
        let n_groups = of_string.iter().flatten().max().map_or(1, |most| most + 1);
        let mut members = vec![vec![]; n_groups.min(n_strings)];
        for (m, group) in of_string.iter().enumerate().filter_map(|(m, group)| group.map(|g| (m, g))) {
            members.get_mut(group).ok_or_else(|| empty(group))?.push(m);
        }
        match members.iter().position(Vec::is_empty) {
            Some(group) => Err(empty(group)),
            None => Ok(Self { members }),
        }
    }

    /// Every group as one string: its inverters and batteries in parallel.
    pub(crate) fn model(&self, model: &ControlModel) -> ControlModel {
        let strings = model.strings();
        let middle = |m: usize| {
            let state = StringState { soc: 0.5, temperature_c: 25.0 };
            strings[m].coefficients(Direction::Discharge, state).resistance_ohm
        };
        let group = |members: &Vec<usize>| {
            let conductance: f64 = members.iter().map(|&m| middle(members[0]) / middle(m)).sum();
            let capacity_ah = members.iter().map(|&m| strings[m].parameters.capacity_ah).sum();
            strings[members[0]].parameters.in_parallel(members.len() as f64, capacity_ah, 1.0 / conductance)
        };
        ControlModel::new(&System { strings: self.members.iter().map(group).collect(), cooling: None })
    }

    /// The problem of the groups, with mean states and summed limits. A start of a group costs as much as starts of the mean
    /// number of inverters in a group.
    ///
    /// # Errors
    ///
    /// As [`PlanProblem::new`].
    pub(crate) fn problem<'a>(
        &self,
        problem: &PlanProblem<'_>,
        model: &'a ControlModel,
    ) -> Result<PlanProblem<'a>, InputError> {
        let mean = |members: &[usize], of: &dyn Fn(usize) -> f64| {
            let capacity: f64 = members.iter().map(|&m| problem.capacity_ah(m)).sum();
            members.iter().map(|&m| problem.capacity_ah(m) * of(m)).sum::<f64>() / capacity
        };
        let state = |g: &Vec<usize>| StringState {
            soc: mean(g, &|m| problem.start[m].soc),
            temperature_c: mean(g, &|m| problem.start[m].temperature_c),
        };
        let start = self.members.iter().map(state).collect();
        let running =
            self.members.iter().map(|g| 2 * g.iter().filter(|&&m| problem.running[m]).count() >= g.len());
        let steps = 0..problem.n_steps();
        let limit_w = |g: &[usize], t: usize| g.iter().map(|&m| problem.limit_w(m, t)).sum();
        let limit_w: Vec<f64> =
            self.members.iter().flat_map(|g| steps.clone().map(move |t| limit_w(g, t))).collect();
        let in_service: usize = self.members.iter().map(Vec::len).sum();
        let prices = Prices {
            wear: self.members.iter().map(|g| mean(g, &|m| problem.prices.wear[m])).collect(),
            start: problem.prices.start * in_service as f64 / self.members.len() as f64,
            ..problem.prices.clone()
        };
        let intervals = problem.intervals.clone();
        let groups = PlanProblem::new(
            model,
            start,
            running.collect(),
            &problem.demand_w,
            intervals,
            &limit_w,
            prices,
        )?;
        if problem.has_reactive() {
            return groups.with_reactive(&problem.reactive_var);
        }
        Ok(groups)
    }

    /// Requests `(G, T)` [W] of the groups in a schedule of the strings `(M, T)`.
    pub(crate) fn aggregated(&self, request_w: &[f64], n_steps: usize) -> Vec<f64> {
        let sum = |(g, t): (usize, usize)| -> f64 {
            self.members[g].iter().map(|m| request_w[m * n_steps + t]).sum()
        };
        (0..self.members.len()).flat_map(|g| (0..n_steps).map(move |t| (g, t))).map(sum).collect()
    }

    /// Allocates the requests of the groups `(G, T)` [W] to strings. Each group uses the cheaper of two ways:
    /// all inverters, or the number of inverters with minimum loss in each step.
    pub(crate) fn disaggregated<'a>(&self, problem: &'a PlanProblem<'a>, request_w: &[f64]) -> Paths<'a> {
        let mut ways = cores::map(vec![false, true], |fewer| self.disaggregate(problem, request_w, fewer));
        let (Some(mut fewer), Some(mut shared)) = (ways.pop(), ways.pop()) else { unreachable!("two ways") };
        for members in &self.members {
            let cost = |paths: &Paths<'_>| members.iter().map(|&m| paths.strings[m].total).sum::<f64>();
            if cost(&fewer) < cost(&shared) {
                members.iter().for_each(|&m| mem::swap(&mut shared.strings[m], &mut fewer.strings[m]));
            }
        }
        shared
    }

    fn disaggregate<'a>(&self, problem: &'a PlanProblem<'a>, request_w: &[f64], fewer: bool) -> Paths<'a> {
        let n_steps = problem.n_steps();
        Paths::from_policy(problem, |t, points| {
            let mut power = vec![0.0; points.len()];
            if problem.demand_w[t] > 0.0 {
                let caps = deliverable_w(problem, t, points);
                let step = Step { problem, t, points, caps: &caps };
                for (g, members) in self.members.iter().enumerate() {
                    let total_w = request_w[g * n_steps + t];
                    if total_w > 0.0 {
                        step.share(members, total_w, fewer, &mut power);
                    }
                }
                problem.model.set_points(&mut power, problem.limits_w(t));
            }
            power
        })
    }
}

struct Step<'s> {
    problem: &'s PlanProblem<'s>,
    t: usize,
    points: &'s [Point],
    /// Deliverable power of each string `(M,)` [W].
    caps: &'s [f64],
}

impl Step<'_> {
    /// Usable share of the SOC window of a string in the direction of power.
    fn left(&self, m: usize) -> f64 {
        let fill = self.problem.fill_of(m, self.points[m].state);
        self.problem.intervals[self.t].direction.pick(1.0 - fill, fill).max(0.0)
    }

    /// Allocates the power of a group to all inverters, or to `fewer`: first those that are on and have the largest usable
    /// share of their window. Powers are in proportion to this share, up to the deliverable power, so that SOCs converge.
    /// Undeliverable power is requested from all strings within their limits.
    fn share(&self, members: &[usize], total_w: f64, fewer: bool, power: &mut [f64]) {
        let mut order = members.to_vec();
        if fewer {
            let rank =
                |m: usize| self.left(m) + if self.points[m].running { SWITCHING_HYSTERESIS } else { 0.0 };
            order.sort_by(|&a, &b| rank(b).total_cmp(&rank(a)));
            order.truncate(self.count_at_min_loss(&order, total_w));
        }
        let weights: Vec<f64> = order.iter().map(|&m| self.problem.capacity_ah(m) * self.left(m)).collect();
        let caps: Vec<f64> = order.iter().map(|&m| self.caps[m]).collect();
        for (&m, share_w) in order.iter().zip(water_fill(total_w, &weights, &caps)) {
            power[m] = share_w;
        }
        let rest = total_w - members.iter().map(|&m| power[m]).sum::<f64>();
        if rest > ROUNDING_SHARE * total_w {
            let limit_w = self.problem.limits_w(self.t);
            let free: Vec<f64> = members.iter().map(|&m| (limit_w[m] - power[m]).max(0.0)).collect();
            for (&m, more) in members.iter().zip(water_fill(rest, &free, &free)) {
                power[m] = (power[m] + more).min(limit_w[m]);
            }
        }
    }

    /// Number of strings with minimum loss at equal powers, large enough to deliver the power.
    fn count_at_min_loss(&self, order: &[usize], total_w: f64) -> usize {
        let (problem, t, first) = (self.problem, self.t, order[0]);
        let mut deliverable_w = 0.0;
        let enough = order.iter().position(|&m| {
            deliverable_w += self.caps[m];
            deliverable_w >= total_w
        });
        let Some(min_count) = enough.map(|index| index + 1) else { return order.len() };
        let mean = |of: &dyn Fn(&StringState) -> f64| {
            order.iter().map(|&m| of(&self.points[m].state)).sum::<f64>() / order.len() as f64
        };
        let state = StringState { soc: mean(&|s| s.soc), temperature_c: mean(&|s| s.temperature_c) };
        let on_already = order.iter().filter(|&&m| self.points[m].running).count();
        let cost = |n: usize| {
            let flow = problem.flow(first, t, state, total_w / n as f64);
            let rate = flow.losses().cost(&problem.prices.losses[t])
                + problem.prices.wear[first] * flow.current_a.abs();
            n as f64 * rate * problem.intervals[t].dt_h
                + problem.prices.start * n.saturating_sub(on_already) as f64
        };
        let mut best = (min_count, cost(min_count));
        for n in min_count + 1..=order.len() {
            let cost = cost(n);
            if cost < best.1 {
                best = (n, cost);
            }
        }
        best.0
    }
}

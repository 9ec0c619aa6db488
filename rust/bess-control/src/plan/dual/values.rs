//! Costs to go of strings at prices of the balance, and the power that is cheapest at these prices.

use super::grid::{along, Grid, Stencil, TEMPERATURE_NODES};
use crate::cores;
use crate::model::StringState;
use crate::plan::look_ahead::{CostToGo, Group};
use crate::plan::problem::{kinds, PlanProblem};

/// The dynamic program of strings of one kind.
struct Values {
    /// Costs to go `(T + 1, off or on, soc, n_temperature)`.
    cost: Vec<f64>,
    /// Best moves `(T, off or on, soc, n_temperature)` in steps of SOC; 0 = off.
    choice: Vec<u16>,
}

/// Dynamic programs of all kinds of strings.
pub(super) struct StringValues<'a> {
    problem: &'a PlanProblem<'a>,
    groups: Vec<Group>,
    kinds: Vec<usize>,
    grids: Vec<Grid>,
    /// One string of each kind.
    members: Vec<usize>,
    values: Vec<Values>,
}

impl<'a> StringValues<'a> {
    pub(super) fn new(problem: &'a PlanProblem<'a>) -> Self {
        let in_service = (0..problem.n_strings()).filter(|&m| problem.is_in_service(m));
        let (kinds, members) = kinds(in_service.clone(), |a, b| problem.alike(a, b));
        let groups = in_service.map(|first| Group { first, second: None }).collect();
        let grids: Vec<Grid> = members.iter().map(|&m| Grid::new(problem, m)).collect();
        let n_steps = problem.n_steps();
        let nodes = |grid: &Grid| Values {
            cost: vec![0.0; (n_steps + 1) * 2 * grid.size()],
            choice: vec![0; n_steps * 2 * grid.size()],
        };
        let values = grids.iter().map(nodes).collect();
        Self { problem, groups, kinds, grids, members, values }
    }

    /// Solves every kind of string backwards at prices `(T,)` [cost/Wh].
    pub(super) fn solve(&mut self, price: &[f64]) {
        let values = std::mem::take(&mut self.values).into_iter().enumerate().collect();
        self.values = cores::map(values, |(kind, values)| self.backwards(kind, price, values));
    }

    /// The request of a string is at most the demand [W].
    fn cap_w(&self, m: usize, t: usize) -> f64 {
        self.problem.demand_w[t].min(self.problem.limit_w(m, t))
    }

    /// Overwrites all values of an earlier solution.
    fn backwards(&self, kind: usize, price: &[f64], mut values: Values) -> Values {
        let (problem, grid, m) = (self.problem, &self.grids[kind], self.members[kind]);
        let (n_steps, size) = (problem.n_steps(), grid.size());
        let string = &problem.model.strings()[m];
        let Values { cost: planes, choice } = &mut values;
        for (node, value) in planes[n_steps * 2 * size..].iter_mut().enumerate() {
            let soc = grid.soc.at((node % size / TEMPERATURE_NODES) as f64);
            *value = problem.end_cost(m, StringState { soc, temperature_c: 25.0 });
        }
        // End temperatures and costs of moves in each direction, shared by identical steps.
        let mut led: [Option<(usize, Vec<Stencil>)>; 2] = [None, None];
        let mut priced: [Option<(usize, Vec<f64>)>; 2] = [None, None];
        for t in (0..n_steps).rev() {
            let interval = &problem.intervals[t];
            let (which, moves) = (interval.direction.pick(0, 1), grid.moves_in(interval.direction));
            let after = |temperature_c: f64, heat_w: f64| {
                grid.stencil(string.warmed(temperature_c, heat_w, interval))
            };
            let all = 0..moves.request_w.len();
            if !led[which].as_ref().is_some_and(|(s, _)| problem.intervals[*s] == *interval) {
                let to = |x: usize| after(grid.temperature_c(x % TEMPERATURE_NODES), moves.losses[x].battery);
                led[which] = Some((t, all.clone().map(to).collect()));
            }
            let same_price = |s: usize| problem.prices.losses[s] == problem.prices.losses[t];
            if !priced[which].as_ref().is_some_and(|(s, _)| same_price(*s)) {
                let rate = |x: usize| moves.losses[x].cost(&problem.prices.losses[t]);
                let cost = |x: usize| interval.dt_h * (rate(x) + problem.prices.wear[m] * moves.current_a[x]);
                priced[which] = Some((t, all.map(cost).collect()));
            }
            let (before, later) = planes.split_at_mut((t + 1) * 2 * size);
            let (next_off, next_on) = later[..2 * size].split_at(size);
            let (now_off, now_on) = before[t * 2 * size..].split_at_mut(size);
            let (choice_off, choice_on) = choice[2 * t * size..2 * (t + 1) * size].split_at_mut(size);
            now_on.fill(f64::INFINITY);
            let cap_w = self.cap_w(m, t);
            let price = price[t] * interval.dt_h;
            if let (true, Some((_, to_c)), Some((_, cost))) = (cap_w > 0.0, &led[which], &priced[which]) {
                let request_w = &moves.request_w;
                let value = |at: usize, to: usize| {
                    let row = &next_on[to * TEMPERATURE_NODES..(to + 1) * TEMPERATURE_NODES];
                    cost[at] - price * request_w[at] + along(row, &to_c[at])
                };
                let ends = |k: usize| {
                    let to = move |i: usize| grid.soc.after(interval.direction, i, k);
                    (0..grid.soc.len).filter_map(move |i| Some((k, i, to(i)?)))
                };
                for (k, i, to) in (1..request_w.len() / size).flat_map(ends) {
                    for node in i * TEMPERATURE_NODES..(i + 1) * TEMPERATURE_NODES {
                        let at = k * size + node;
                        let longer_w = request_w[at];
                        let value = if longer_w <= cap_w {
                            if longer_w <= 0.0 {
                                continue;
                            }
                            value(at, to)
                        } else {
                            // A move between two nodes covers a smaller request.
                            let shorter_w = request_w[at - size];
                            if shorter_w >= cap_w || longer_w == f64::INFINITY {
                                continue;
                            }
                            let shorter = grid.soc.after(interval.direction, i, k - 1);
                            let shorter = shorter.map_or(f64::INFINITY, |to| value(at - size, to));
                            shorter + (cap_w - shorter_w) / (longer_w - shorter_w) * (value(at, to) - shorter)
                        };
                        if value < now_on[node] {
                            (now_on[node], choice_on[node]) = (value, k as u16);
                        }
                    }
                }
            }
            let idle: Vec<Stencil> =
                (0..TEMPERATURE_NODES).map(|j| after(grid.temperature_c(j), 0.0)).collect();
            for node in 0..size {
                let (i, j) = (node / TEMPERATURE_NODES, node % TEMPERATURE_NODES);
                let off = along(&next_off[i * TEMPERATURE_NODES..(i + 1) * TEMPERATURE_NODES], &idle[j]);
                let on = now_on[node];
                now_off[node] = off.min(on + problem.prices.start);
                now_on[node] = off.min(on);
                choice_off[node] = if on + problem.prices.start < off { choice_on[node] } else { 0 };
                choice_on[node] = if on < off { choice_on[node] } else { 0 };
            }
        }
        values
    }

    /// Power of all strings of a kind with their best moves `(T,)` [W]: the weights of their states on the nodes, moved forwards.
    fn forwards(&self, kind: usize) -> Vec<f64> {
        let (problem, grid, m) = (self.problem, &self.grids[kind], self.members[kind]);
        let size = grid.size();
        let string = &problem.model.strings()[m];
        let spread = |row: &mut [f64], (base, weights): Stencil, share: f64| {
            row[base..base + 4].iter_mut().zip(weights).for_each(|(sum, weight)| *sum += share * weight);
        };
        let [mut now, mut next] = [vec![0.0; 2 * size], vec![0.0; 2 * size]];
        for (group, _) in self.groups.iter().zip(&self.kinds).filter(|(_, &of)| of == kind) {
            let start = problem.start[group.first];
            let (i, share) = grid.soc.locate(start.soc);
            let plane = &mut now[usize::from(problem.running[group.first]) * size..];
            for (i, share) in [(i, 1.0 - share), (i + 1, share)] {
                spread(&mut plane[i * TEMPERATURE_NODES..], grid.stencil(start.temperature_c), share);
            }
        }
        let step = |t: usize| {
            let interval = &problem.intervals[t];
            let moves = grid.moves_in(interval.direction);
            let cap_w = self.cap_w(m, t);
            let mut power_w = 0.0;
            next.fill(0.0);
            let (next_off, next_on) = next.split_at_mut(size);
            for (place, &weight) in now.iter().enumerate().filter(|(_, &weight)| weight != 0.0) {
                let (node, (i, j)) =
                    (place % size, (place % size / TEMPERATURE_NODES, place % TEMPERATURE_NODES));
                let after = |heat_w| grid.stencil(string.warmed(grid.temperature_c(j), heat_w, interval));
                let k = usize::from(self.values[kind].choice[2 * t * size + place]);
                if k == 0 {
                    spread(&mut next_off[i * TEMPERATURE_NODES..], after(0.0), weight);
                    continue;
                }
                let [shorter_w, longer_w] = [k - 1, k].map(|k| moves.request_w[k * size + node]);
                let share = if longer_w > cap_w { (cap_w - shorter_w) / (longer_w - shorter_w) } else { 1.0 };
                for (k, weight) in [(k - 1, (1.0 - share) * weight), (k, share * weight)] {
                    let Some(to) = grid.soc.after(interval.direction, i, k).filter(|_| weight != 0.0) else {
                        continue;
                    };
                    let at = k * size + node;
                    power_w += weight * moves.request_w[at];
                    spread(&mut next_on[to * TEMPERATURE_NODES..], after(moves.losses[at].battery), weight);
                }
            }
            std::mem::swap(&mut now, &mut next);
            power_w
        };
        (0..problem.n_steps()).map(step).collect()
    }

    /// Cost to go of a string at the start of a step.
    fn at(&self, group: usize, t: usize, state: StringState, running: bool) -> f64 {
        let grid = &self.grids[self.kinds[group]];
        let (i, share) = grid.soc.locate(state.soc);
        let stencil = grid.stencil(state.temperature_c);
        let plane = &self.values[self.kinds[group]].cost[(2 * t + usize::from(running)) * grid.size()..];
        let row = |i: usize| along(&plane[i * TEMPERATURE_NODES..(i + 1) * TEMPERATURE_NODES], &stencil);
        (1.0 - share) * row(i) + share * row(i + 1)
    }

    /// Bound of the cost of every schedule at prices `(T,)`.
    pub(super) fn bound(&self, price: &[f64]) -> f64 {
        let problem = self.problem;
        let demand = |t: usize| price[t] * problem.demand_w[t] * problem.intervals[t].dt_h;
        let (n, out) = (problem.n_strings(), |m: usize| !problem.is_in_service(m));
        let idle = |m: usize| problem.end_cost(m, problem.start[m]);
        let start = |(index, group): (usize, &Group)| {
            self.at(index, 0, problem.start[group.first], problem.running[group.first])
        };
        (0..problem.n_steps()).map(demand).sum::<f64>()
            + (0..n).filter(|&m| out(m)).map(idle).sum::<f64>()
            + self.groups.iter().enumerate().map(start).sum::<f64>()
    }

    /// Demand minus the optimal power of the strings `(T,)` [Wh]: the supergradient of the bound.
    pub(super) fn slope(&self) -> Vec<f64> {
        let power_w = cores::map((0..self.grids.len()).collect(), |kind| self.forwards(kind));
        let open_w = |t: usize| self.problem.demand_w[t] - power_w.iter().map(|of| of[t]).sum::<f64>();
        (0..self.problem.n_steps()).map(|t| open_w(t) * self.problem.intervals[t].dt_h).collect()
    }
}

impl CostToGo for StringValues<'_> {
    type End = f64;

    fn groups(&self) -> &[Group] {
        &self.groups
    }

    fn end(&self, group: usize, _string: usize, state: StringState, running: bool, hours: f64) -> f64 {
        let t = (hours / self.problem.intervals[0].dt_h).round() as usize;
        self.at(group, t, state, running)
    }

    fn cost(&self, _group: usize, first: f64, _second: Option<f64>, _hours: f64) -> f64 {
        first
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{ControlModel, Losses};
    use crate::plan::problem::Prices;
    use crate::search::common;
    use bess_tables::Direction;

    #[test]
    fn the_slope_is_that_of_the_bound() {
        let model = ControlModel::new(&common::reference(3));
        let demand_w: Vec<f64> = (0..12).map(|t| 1e3 * (20.0 + 17.0 * f64::from(t))).collect();
        let interval = |t| crate::model::Interval {
            direction: if t % 5 < 2 { Direction::Charge } else { Direction::Discharge },
            ambient_c: 30.0,
            dt_h: 0.25,
        };
        let state = |soc, temperature_c| StringState { soc, temperature_c };
        let losses = Losses { availability: 3e-3, derating: 3e-3, inverter: 1e-3, battery: 1e-3 };
        let prices = Prices {
            losses: vec![losses; 12],
            wear: vec![1e-4; 3],
            start: 0.05,
            balance: 0.0,
            end_charge: -1e-3,
        };
        let start = vec![state(0.31, 44.0), state(0.62, 38.5), state(0.55, 47.3)];
        let problem = PlanProblem::new(
            &model,
            start,
            vec![false, true, false],
            &demand_w,
            (0..12).map(interval).collect(),
            &[92e3; 36],
            prices,
        )
        .unwrap();
        let price: Vec<f64> = (0..12).map(|t| 1e-4 * f64::from(t % 4)).collect();
        let mut values = StringValues::new(&problem);
        values.solve(&price);
        for (t, slope) in values.slope().into_iter().enumerate() {
            let mut bound = |change: f64| {
                let price: Vec<f64> = (0..12).map(|s| price[s] + if s == t { change } else { 0.0 }).collect();
                values.solve(&price);
                values.bound(&price)
            };
            let expected = (bound(1e-10) - bound(-1e-10)) / 2e-10;
            assert!((slope - expected).abs() < 1.0, "step {t}: {slope} and {expected}");
        }
    }
}

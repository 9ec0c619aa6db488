//! Costs to go of strings at prices of the balance, and the power that is cheapest at these prices.

use super::grid::{step_back, Grid, Row, Step, PADDED, TEMPERATURE_NODES};
use crate::cores;
use crate::model::StringState;
use crate::plan::look_ahead::{CostToGo, Group};
use crate::plan::problem::{kinds, PlanProblem};

/// Weight of a node, in strings, below which it is neglected.
const NEGLIGIBLE: f32 = 1e-7;

/// The dynamic program of strings of one kind.
struct Values {
    /// Costs to go, rows `(T + 1, off or on, soc)`.
    cost: Vec<Row>,
    /// Best moves in steps of SOC, rows `(T, off or on, soc)`; 0 = off.
    choice: Vec<Row<u16>>,
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
            cost: vec![[0.0; TEMPERATURE_NODES]; (n_steps + 1) * 2 * grid.soc.len],
            choice: vec![[0; TEMPERATURE_NODES]; n_steps * 2 * grid.soc.len],
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
        let (n_steps, n_soc) = (problem.n_steps(), grid.soc.len);
        for (i, row) in values.cost[n_steps * 2 * n_soc..].iter_mut().enumerate() {
            let soc = grid.soc.at((i % n_soc) as f64);
            *row = [problem.end_cost(m, StringState { soc, temperature_c: 25.0 }) as f32; TEMPERATURE_NODES];
        }
        let mut cool = vec![[0.0; PADDED]; n_soc];
        for t in (0..n_steps).rev() {
            let (before, after) = values.cost.split_at_mut((t + 1) * 2 * n_soc);
            let step = Step {
                direction: problem.intervals[t].direction,
                losses: &problem.prices.losses[t],
                wear: problem.prices.wear[m],
                start: problem.prices.start,
                price: price[t],
                cap_w: self.cap_w(m, t),
                cooled: &grid.cooled[t],
            };
            let choice = &mut values.choice[t * 2 * n_soc..][..2 * n_soc];
            step_back(grid, &step, &after[..2 * n_soc], &mut cool, &mut before[t * 2 * n_soc..], choice);
        }
        values
    }

    /// Power of all strings of a kind with their best moves `(T,)` [W]: the weights of their states on the nodes, moved forwards.
    fn forwards(&self, kind: usize) -> Vec<f64> {
        let (problem, grid, m) = (self.problem, &self.grids[kind], self.members[kind]);
        let n_soc = grid.soc.len;
        // Of strings that are off and on, in rows `(off or on, soc)`.
        let mut now = vec![[0.0; TEMPERATURE_NODES]; 2 * n_soc];
        for (group, _) in self.groups.iter().zip(&self.kinds).filter(|(_, &of)| of == kind) {
            let start = problem.start[group.first];
            let (i, share) = grid.soc.locate(start.soc);
            let off_or_on = usize::from(problem.running[group.first]) * n_soc;
            for (j, weight) in grid.nodes(start.temperature_c) {
                now[off_or_on + i][j] += ((1.0 - share) * weight) as f32;
                now[off_or_on + i + 1][j] += (share * weight) as f32;
            }
        }
        let mut next = now.clone();
        let mut heated = vec![[0.0; TEMPERATURE_NODES]; n_soc];
        let step = |t: usize| {
            let direction = problem.intervals[t].direction;
            let moves = grid.moves_in(direction);
            let cap_w = self.cap_w(m, t) as f32;
            let cooled = &grid.cooled[t];
            let mut power_w = 0.0;
            heated.fill([0.0; TEMPERATURE_NODES]);
            next.fill([0.0; TEMPERATURE_NODES]);
            for (place, row) in now.iter().enumerate() {
                let i = place % n_soc;
                for (j, &weight) in
                    row.iter().enumerate().filter(|(_, &weight)| f32::abs(weight) > NEGLIGIBLE)
                {
                    let k = usize::from(self.values[kind].choice[2 * t * n_soc + place][j]);
                    if k == 0 {
                        cooled.spread(j, weight, &mut next[i]);
                        continue;
                    }
                    let [shorter_w, longer_w] = [k - 1, k].map(|k| moves.request_w[k * n_soc + i][j]);
                    let share =
                        if longer_w > cap_w { (cap_w - shorter_w) / (longer_w - shorter_w) } else { 1.0 };
                    for (k, weight) in [(k - 1, (1.0 - share) * weight), (k, share * weight)] {
                        let to = grid.soc.after(direction, i, k).filter(|_| weight != 0.0);
                        let Some(to) = to else { continue };
                        power_w += f64::from(weight * moves.request_w[k * n_soc + i][j]);
                        moves.heated[k * n_soc + i].spread(j, weight, &mut heated[to]);
                    }
                }
            }
            for (row, heated) in next[n_soc..].iter_mut().zip(&heated) {
                let of_row = heated.iter().enumerate().filter(|(_, &weight)| weight != 0.0);
                of_row.for_each(|(j, &weight)| cooled.spread(j, weight, row));
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
        let rows = &self.values[self.kinds[group]].cost[(2 * t + usize::from(running)) * grid.soc.len..];
        let of = |i: usize, j: usize| f64::from(rows[i][j]);
        let at = |(j, weight): (usize, f64)| weight * ((1.0 - share) * of(i, j) + share * of(i + 1, j));
        grid.nodes(state.temperature_c).map(at).iter().sum()
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
    use crate::tests::common;
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
            // The bound is concave, and rounded to single precision: to 20 Wh of up to 39,000.
            let change = 1e-6;
            let [below, at, above] = [-change, 0.0, change].map(&mut bound);
            let (right, left) = ((above - at) / change, (at - below) / change);
            assert!(right - 20.0 < slope && slope < left + 20.0, "step {t}: {right} < {slope} < {left}");
        }
    }
}

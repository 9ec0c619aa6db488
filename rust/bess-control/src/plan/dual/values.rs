//! Costs to go of strings at prices of the balance, and the power that is cheapest at these prices.

use super::grid::{step_back, Grid, Row, PADDED, TEMPERATURE_NODES};
use crate::cores;
use crate::model::StringState;
use crate::plan::look_ahead::{CostToGo, Group};
use crate::plan::problem::{kind_indices, PlanProblem, Point};

/// Number of strings at a node below which it is neglected.
const NEGLIGIBLE: f32 = 1e-7;

/// The dynamic program of strings of one kind.
struct Kind<'a> {
    grid: Grid<'a>,
    members: Vec<usize>,
    /// Costs to go, rows `(T + 1, off or on, soc)`.
    cost: Vec<Row>,
    /// Best moves in steps of SOC, rows `(T, off or on, soc)`; 0 = off.
    choice: Vec<Row<u16>>,
}

/// Dynamic programs of all strings in service.
pub(super) struct StringValues<'a> {
    problem: &'a PlanProblem<'a>,
    groups: Vec<Group>,
    kinds: Vec<Kind<'a>>,
    /// Kind of each string `(M,)`.
    kind_of: Vec<usize>,
}

impl<'a> Kind<'a> {
    fn new(problem: &'a PlanProblem<'a>, members: Vec<usize>) -> Self {
        let grid = Grid::new(problem, members[0]);
        let (n_steps, n_rows) = (problem.n_steps(), 2 * grid.soc.len);
        let cost = vec![[0.0; TEMPERATURE_NODES]; (n_steps + 1) * n_rows];
        let choice = vec![[0; TEMPERATURE_NODES]; n_steps * n_rows];
        Self { grid, members, cost, choice }
    }

    /// Solves backwards at prices `(T,)` [cost/Wh].
    fn backwards(&mut self, price: &[f64]) {
        let (problem, grid) = (self.grid.problem, &self.grid);
        let (n_steps, n_soc) = (problem.n_steps(), grid.soc.len);
        for (i, row) in self.cost[n_steps * 2 * n_soc..].iter_mut().enumerate() {
            let end = StringState { soc: grid.soc.at((i % n_soc) as f64), temperature_c: 25.0 };
            *row = [problem.end_cost(grid.string, end) as f32; TEMPERATURE_NODES];
        }
        let mut cool = vec![[0.0; PADDED]; n_soc];
        for t in (0..n_steps).rev() {
            let (before, after) = self.cost.split_at_mut((t + 1) * 2 * n_soc);
            let choice = &mut self.choice[t * 2 * n_soc..][..2 * n_soc];
            step_back(
                grid,
                t,
                price[t],
                &after[..2 * n_soc],
                &mut cool,
                &mut before[t * 2 * n_soc..],
                choice,
            );
        }
    }

    /// Power of all strings with their best moves `(T,)` [W], from a forward pass of their distribution over the nodes.
    fn forwards(&self) -> Vec<f64> {
        let (problem, grid) = (self.grid.problem, &self.grid);
        let n_soc = grid.soc.len;
        // Number of strings at each node, in rows `(off or on, soc)`.
        let mut now = vec![[0.0; TEMPERATURE_NODES]; 2 * n_soc];
        for &m in &self.members {
            let start = problem.start[m];
            let (i, share) = grid.soc.locate(start.soc);
            let off_or_on = usize::from(problem.running[m]) * n_soc;
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
            let cap_w = problem.cap_w(grid.string, t) as f32;
            let cooled = &grid.cooled[t];
            let mut power_w = 0.0;
            heated.fill([0.0; TEMPERATURE_NODES]);
            next.fill([0.0; TEMPERATURE_NODES]);
            for (place, row) in now.iter().enumerate() {
                let i = place % n_soc;
                for (j, &weight) in
                    row.iter().enumerate().filter(|(_, &weight)| f32::abs(weight) > NEGLIGIBLE)
                {
                    let k = usize::from(self.choice[2 * t * n_soc + place][j]);
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
    fn at(&self, t: usize, state: StringState, running: bool) -> f64 {
        let grid = &self.grid;
        let (i, share) = grid.soc.locate(state.soc);
        let rows = &self.cost[(2 * t + usize::from(running)) * grid.soc.len..];
        let of = |i: usize, j: usize| f64::from(rows[i][j]);
        let at = |(j, weight): (usize, f64)| weight * ((1.0 - share) * of(i, j) + share * of(i + 1, j));
        grid.nodes(state.temperature_c).map(at).iter().sum()
    }
}

impl<'a> StringValues<'a> {
    pub(super) fn new(problem: &'a PlanProblem<'a>) -> Self {
        let in_service = (0..problem.n_strings()).filter(|&m| problem.is_in_service(m));
        let groups = in_service.map(|first| Group { first, second: None }).collect();
        let kinds = problem.kinds();
        let kind_of = kind_indices(&kinds, problem.n_strings());
        let kinds = kinds.into_iter().map(|members| Kind::new(problem, members)).collect();
        Self { problem, groups, kinds, kind_of }
    }

    /// Solves all programs at prices `(T,)` [cost/Wh], and overwrites their earlier solution.
    pub(super) fn solve(&mut self, price: &[f64]) {
        cores::map(self.kinds.iter_mut().collect(), |kind| kind.backwards(price));
    }

    /// Bound of the cost of every schedule at prices `(T,)`.
    pub(super) fn bound(&self, price: &[f64]) -> f64 {
        let problem = self.problem;
        let demand = |t: usize| price[t] * problem.demand_w[t] * problem.intervals[t].dt_h;
        let (n, out) = (problem.n_strings(), |m: usize| !problem.is_in_service(m));
        let idle = |m: usize| problem.end_cost(m, problem.start[m]);
        let start = |group: &Group| {
            let m = group.first;
            self.kinds[self.kind_of[m]].at(0, problem.start[m], problem.running[m])
        };
        (0..problem.n_steps()).map(demand).sum::<f64>()
            + (0..n).filter(|&m| out(m)).map(idle).sum::<f64>()
            + self.groups.iter().map(start).sum::<f64>()
    }

    /// Demand minus the optimal power of the strings `(T,)` [Wh]: the supergradient of the bound.
    pub(super) fn slope(&self) -> Vec<f64> {
        let power_w = cores::map(self.kinds.iter().collect(), Kind::forwards);
        let open_w = |t: usize| self.problem.demand_w[t] - power_w.iter().map(|of| of[t]).sum::<f64>();
        (0..self.problem.n_steps()).map(|t| open_w(t) * self.problem.intervals[t].dt_h).collect()
    }
}

impl CostToGo for StringValues<'_> {
    type End = f64;

    fn groups(&self) -> &[Group] {
        &self.groups
    }

    fn end(&self, string: usize, t: usize, point: &Point) -> f64 {
        self.kinds[self.kind_of[string]].at(t, point.state, point.running)
    }

    fn cost(&self, _group: usize, _t: usize, first: f64, _second: Option<f64>) -> f64 {
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
    fn the_slope_is_a_supergradient_of_the_bound() {
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

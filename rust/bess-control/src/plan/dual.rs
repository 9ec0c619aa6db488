//! Dual bound: only the power balance couples the strings, and its shadow price in each step decouples them.
//!
//! At any prices, the minimum costs of all strings (one dynamic program each) plus the value of the demand are at most
//! the cost of any schedule (Lagrangian relaxation of the balance). Strings move between nodes of SOC, so their cost to go
//! is not interpolated in SOC, only in temperature. The bound of the grid is therefore an estimate of the true bound.

use bess_tables::Direction;

use crate::cores;
use crate::model::{Losses, Range, StringModel, StringState};
use crate::plan::look_ahead::{look_ahead, CostToGo, Group};
use crate::plan::problem::{kinds, PlanProblem, Point};
use crate::plan::soc_nodes::SocNodes;

/// SOC change of a step at full power [nodes].
const NODES_PER_STEP: f64 = 10.0;
/// Minimum and maximum number of SOC nodes.
const SOC_NODES: (usize, usize) = (40, 400);
const TEMPERATURE_NODES: usize = 14;
/// Margin of the grid above the hottest string without derating [K].
const WARMING_K: f64 = 35.0;
/// Share of the iterations that move prices towards the balancing prices of the look-ahead: a fast start,
/// which the ascent then refines.
const CLEARING: f64 = 0.25;
/// Step of the prices in one of these iterations.
const TOWARDS_CLEARING: f64 = 0.5;
/// Iterations without a better bound, after which the ascent returns to the best prices with a smaller step.
const MAX_ITERATIONS_WITHOUT_GAIN: usize = 8;
/// Length of the first ascent steps, as a share of the Polyak step.
const INITIAL_STEP: f64 = 0.5;
/// Reduction factor of the step length.
const STEP_REDUCTION: f64 = 0.6;
/// Weight of the newest direction; earlier directions have the remaining weight, which damps oscillation.
const NEWEST_DIRECTION_WEIGHT: f64 = 0.6;
/// The ascent stops at a gap below this share of the cost.
const MIN_RELATIVE_GAP: f64 = 2e-3;
/// Number of candidate powers of a string at its prices.
const CHOICES: usize = 24;

pub(crate) struct Dual {
    /// Lower bound of the cost of every schedule, on the grid.
    pub bound: f64,
    /// The cheapest look-ahead schedule with the cost to go of one of the iterations `(M, T)` [W].
    pub request_w: Vec<f64>,
    /// The prices of the bound `(T,)` [cost/Wh].
    pub price: Vec<f64>,
}

/// Four successive temperature nodes and their weights (cubic convolution; linear at the ends).
type Stencil = (usize, [f64; 4]);

/// Moves of a string from every node, in one direction; arrays `(steps of SOC, soc, n_temperature)`, from none on.
#[derive(Default)]
struct Moves {
    request_w: Vec<f64>,
    losses: Vec<Losses>,
    current_a: Vec<f64>,
}

/// The grid of identical strings.
struct Grid {
    soc: SocNodes,
    coolest_c: f64,
    temperature_step_k: f64,
    charge: Moves,
    discharge: Moves,
}

impl Grid {
    fn new(problem: &PlanProblem<'_>, m: usize) -> Self {
        let string = &problem.model.strings()[m];
        let p = &string.parameters;
        let dt_h = problem.intervals[0].dt_h;
        let cells = ((p.soc_max - p.soc_min) / problem.soc_of_full_step(m) * NODES_PER_STEP).round() as usize;
        let cells = cells.clamp(SOC_NODES.0, SOC_NODES.1);
        let Range { low: coolest_c, high: warmest } = problem.temperatures_c(0..problem.n_strings());
        let factor = &p.derating.factor;
        let stop = factor.x().last().copied().filter(|&c| factor.at(c) < 1.0).unwrap_or(warmest + WARMING_K);
        let temperature_step_k = (stop.max(warmest + 1.0) - coolest_c) / (TEMPERATURE_NODES - 1) as f64;
        let mut grid = Self {
            soc: SocNodes::of(string, cells),
            coolest_c,
            temperature_step_k,
            charge: Moves::default(),
            discharge: Moves::default(),
        };
        grid.charge = grid.moves(string, Direction::Charge, dt_h);
        grid.discharge = grid.moves(string, Direction::Discharge, dt_h);
        grid
    }

    /// All moves to SOC nodes: request and losses with the mean voltage and resistance of the move. Infeasible moves have an
    /// infinite request. Moves whose internal power is below the no-load loss have a request below 0, straight on from the
    /// table: requests between it and that of the next move exist. The first move from each node above nominal power is kept for
    /// the same reason.
    fn moves(&self, string: &StringModel, direction: Direction, dt_h: f64) -> Moves {
        let p = &string.parameters;
        let curve = string.loss(direction);
        let highest_w = curve.at(string.nominal_w()).1;
        let no_load_w = curve.internal_w(0.0, curve.at(0.0).0);
        let mut out = Moves::default();
        for k in 0.. {
            let current_a = self.soc.step * k as f64 * p.capacity_ah / dt_h;
            let mut any = false;
            for (i, j) in (0..self.soc.len).flat_map(|i| (0..TEMPERATURE_NODES).map(move |j| (i, j))) {
                let mut request_w = f64::INFINITY;
                let mut losses = Losses::default();
                if let Some(to) = self.soc.after(direction, i, k) {
                    let at = |share: f64| {
                        let soc = self.soc.at(i as f64 + share * (to as f64 - i as f64));
                        string.coefficients(
                            direction,
                            StringState { soc, temperature_c: self.temperature_c(j) },
                        )
                    };
                    let (start, middle, end) = (at(0.0), at(0.5), at(1.0));
                    let mean = |a: f64, b: f64, c: f64| (a + 4.0 * b + c) / 6.0;
                    let volt = mean(start.voltage_v, middle.voltage_v, end.voltage_v);
                    let ohm = mean(start.resistance_ohm, middle.resistance_ohm, end.resistance_ohm);
                    let heat_w = ohm * current_a * current_a;
                    let internal_w = volt * current_a - direction.sign() * heat_w;
                    let has_root = direction == Direction::Charge || 2.0 * ohm * current_a <= volt;
                    let allowed = p.voltage_allows(direction, volt, ohm * current_a);
                    if has_root && allowed && middle.derating > 0.0 {
                        let power_w = match internal_w - no_load_w {
                            below_w if below_w < 0.0 => below_w,
                            _ => curve.largest_power(internal_w) + (internal_w - highest_w).max(0.0),
                        };
                        request_w = power_w / middle.derating;
                        any |= request_w <= string.nominal_w();
                        losses = Losses {
                            availability: 0.0,
                            derating: request_w - power_w,
                            inverter: curve.at(power_w.max(0.0)).0,
                            battery: heat_w,
                        };
                    }
                }
                out.request_w.push(request_w);
                out.losses.push(losses);
                out.current_a.push(current_a);
            }
            if !any {
                break;
            }
        }
        out
    }

    fn size(&self) -> usize {
        self.soc.len * TEMPERATURE_NODES
    }

    fn temperature_c(&self, j: usize) -> f64 {
        self.coolest_c + self.temperature_step_k * j as f64
    }

    fn stencil(&self, temperature_c: f64) -> Stencil {
        let last = TEMPERATURE_NODES - 1;
        let y = ((temperature_c - self.coolest_c) / self.temperature_step_k).clamp(0.0, last as f64);
        let j = (y as usize).min(last - 1);
        let b = y - j as f64;
        if j == 0 || j == last - 1 {
            let base = if j == 0 { 0 } else { last - 3 };
            let mut weights = [0.0; 4];
            weights[j - base] = 1.0 - b;
            weights[j - base + 1] = b;
            return (base, weights);
        }
        let (b2, b3) = (b * b, b * b * b);
        let weights = [
            -0.5 * b + b2 - 0.5 * b3,
            1.0 - 2.5 * b2 + 1.5 * b3,
            0.5 * b + 2.0 * b2 - 1.5 * b3,
            -0.5 * b2 + 0.5 * b3,
        ];
        (j - 1, weights)
    }
}

#[inline]
fn along(row: &[f64], (base, w): &Stencil) -> f64 {
    let r = &row[*base..*base + 4];
    w[0] * r[0] + w[1] * r[1] + w[2] * r[2] + w[3] * r[3]
}

/// Costs to go of all strings at prices of the balance.
struct StringValues<'a> {
    problem: &'a PlanProblem<'a>,
    groups: Vec<Group>,
    kinds: Vec<usize>,
    grids: Vec<Grid>,
    /// One string of each kind.
    members: Vec<usize>,
    /// Costs to go of each kind, `(T + 1, off or on, soc, n_temperature)`.
    values: Vec<Vec<f64>>,
}

impl<'a> StringValues<'a> {
    fn new(problem: &'a PlanProblem<'a>) -> Self {
        let in_service = (0..problem.n_strings()).filter(|&m| problem.is_in_service(m));
        let (kinds, members) = kinds(in_service.clone(), |a, b| problem.alike(a, b));
        let groups = in_service.map(|first| Group { first, second: None }).collect();
        let grids = members.iter().map(|&m| Grid::new(problem, m)).collect();
        Self { problem, groups, kinds, grids, members, values: vec![] }
    }

    /// Solves every kind of string backwards at prices `(T,)` [cost/Wh].
    fn solve(&mut self, price: &[f64]) {
        let kinds = (0..self.grids.len()).collect();
        self.values = cores::map(kinds, |kind| self.backwards(kind, price));
    }

    fn backwards(&self, kind: usize, price: &[f64]) -> Vec<f64> {
        let (problem, grid, m) = (self.problem, &self.grids[kind], self.members[kind]);
        let (n_steps, size) = (problem.n_steps(), grid.size());
        let string = &problem.model.strings()[m];
        let mut planes = vec![0.0; (n_steps + 1) * 2 * size];
        for (node, value) in planes[n_steps * 2 * size..].iter_mut().enumerate() {
            let soc = grid.soc.at((node % size / TEMPERATURE_NODES) as f64);
            *value = problem.end_cost(m, StringState { soc, temperature_c: 25.0 });
        }
        // End temperatures and costs of moves in each direction, shared by identical steps.
        let mut led: [Option<(usize, Vec<Stencil>)>; 2] = [None, None];
        let mut priced: [Option<(usize, Vec<f64>)>; 2] = [None, None];
        let mut above = vec![f64::INFINITY; size];
        for t in (0..n_steps).rev() {
            let interval = &problem.intervals[t];
            let (which, moves) = interval.direction.pick((0, &grid.charge), (1, &grid.discharge));
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
            now_on.fill(f64::INFINITY);
            // The request of a string is at most the demand; a move between two nodes covers a smaller request.
            let cap_w = problem.demand_w[t].min(problem.limit_w(m, t));
            let price = price[t] * interval.dt_h;
            if let (true, Some((_, to_c)), Some((_, cost))) = (cap_w > 0.0, &led[which], &priced[which]) {
                above.fill(f64::INFINITY);
                for (move_index, request_w) in moves.request_w.iter().enumerate() {
                    let (k, node) = (move_index / size, move_index % size);
                    let Some(to) = grid.soc.after(interval.direction, node / TEMPERATURE_NODES, k) else {
                        continue;
                    };
                    let shorter_w = if k == 0 { 0.0 } else { moves.request_w[move_index - size] };
                    if *request_w == f64::INFINITY || shorter_w >= cap_w {
                        continue;
                    }
                    let row = &next_on[to * TEMPERATURE_NODES..(to + 1) * TEMPERATURE_NODES];
                    let value = cost[move_index] - price * request_w + along(row, &to_c[move_index]);
                    if *request_w > cap_w {
                        if above[node].is_finite() {
                            let share = (cap_w - shorter_w) / (request_w - shorter_w);
                            now_on[node] = now_on[node].min(above[node] + share * (value - above[node]));
                        }
                    } else if k > 0 && *request_w > 0.0 {
                        now_on[node] = now_on[node].min(value);
                    }
                    above[node] = value;
                }
            }
            let idle: Vec<Stencil> =
                (0..TEMPERATURE_NODES).map(|j| after(grid.temperature_c(j), 0.0)).collect();
            for node in 0..size {
                let (i, j) = (node / TEMPERATURE_NODES, node % TEMPERATURE_NODES);
                let off = along(&next_off[i * TEMPERATURE_NODES..(i + 1) * TEMPERATURE_NODES], &idle[j]);
                now_off[node] = off.min(now_on[node] + problem.prices.start);
                now_on[node] = off.min(now_on[node]);
            }
        }
        planes
    }

    /// Cost to go of a string at the start of a step.
    fn at(&self, group: usize, t: usize, state: StringState, running: bool) -> f64 {
        let grid = &self.grids[self.kinds[group]];
        let (i, share) = grid.soc.locate(state.soc);
        let stencil = grid.stencil(state.temperature_c);
        let plane = &self.values[self.kinds[group]][(2 * t + usize::from(running)) * grid.size()..];
        let row = |i: usize| along(&plane[i * TEMPERATURE_NODES..(i + 1) * TEMPERATURE_NODES], &stencil);
        (1.0 - share) * row(i) + share * row(i + 1)
    }

    /// Bound of the cost of every schedule at prices `(T,)`.
    fn bound(&self, price: &[f64]) -> f64 {
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

    /// Demand minus the optimal power of the strings at these prices `(T,)` [Wh]: the supergradient of the bound.
    fn direction(&self, price: &[f64]) -> Vec<f64> {
        let problem = self.problem;
        let n_steps = problem.n_steps();
        let dt_h = |t: usize| problem.intervals[t].dt_h;
        let mut slope: Vec<f64> = (0..n_steps).map(|t| problem.demand_w[t] * dt_h(t)).collect();
        // Strings of one kind in one state have one path.
        let alike = |a: usize, b: usize| {
            let (m, n) = (self.groups[a].first, self.groups[b].first);
            self.kinds[a] == self.kinds[b]
                && problem.start[m] == problem.start[n]
                && problem.running[m] == problem.running[n]
        };
        let (path_of, distinct) = kinds(0..self.groups.len(), alike);
        let paths = cores::map(distinct, |index| self.best_path(index, price));
        for path in path_of {
            for (t, power_w) in paths[path].iter().enumerate() {
                slope[t] -= power_w * dt_h(t);
            }
        }
        slope
    }

    /// Optimal requests of a string at these prices [W].
    fn best_path(&self, group: usize, price: &[f64]) -> Vec<f64> {
        let (problem, m) = (self.problem, self.groups[group].first);
        let mut from = Point { state: problem.start[m], cost: 0.0, running: problem.running[m] };
        let step = |t: usize| {
            let cap_w = problem.demand_w[t].min(problem.limit_w(m, t));
            let mut best = (f64::INFINITY, 0.0, from);
            for k in 0..=if cap_w > 0.0 { CHOICES } else { 0 } {
                let request_w = cap_w * k as f64 / CHOICES as f64;
                let next = problem.step(m, t, &from, request_w);
                let earned = price[t] * request_w * problem.intervals[t].dt_h;
                let value = next.cost - earned + self.at(group, t + 1, next.state, next.running);
                if value < best.0 {
                    best = (value, request_w, next);
                }
            }
            from = Point { cost: 0.0, ..best.2 };
            best.1
        };
        (0..problem.n_steps()).map(step).collect()
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

/// Bound of the cost of every schedule at prices `(T,)` [cost/Wh].
pub(crate) fn at_prices(problem: &PlanProblem<'_>, price: &[f64]) -> f64 {
    let mut values = StringValues::new(problem);
    values.solve(price);
    values.bound(price)
}

/// Raises the bound in `passes` iterations, from `price` `(T,)` [cost/Wh], towards the cost of the best known schedule.
pub(crate) fn ascend(problem: &PlanProblem<'_>, price: Vec<f64>, known_cost: f64, passes: usize) -> Dual {
    let mut values = StringValues::new(problem);
    let mut price = price;
    let (mut best_price, mut best_bound) = (price.clone(), f64::NEG_INFINITY);
    let (mut request_w, mut cost) = (vec![], f64::INFINITY);
    let (mut length, mut since) = (INITIAL_STEP, 0);
    let mut slope = vec![0.0; problem.n_steps()];
    let clearing = (CLEARING * passes as f64).ceil() as usize;
    for pass in 0..passes {
        values.solve(&price);
        let bound = values.bound(&price);
        let (rolled, clearing_price) = look_ahead(problem, &values);
        if rolled.cost() < cost {
            (cost, request_w) = (rolled.cost(), rolled.request_w());
        }
        since += 1;
        if bound > best_bound {
            (best_bound, since) = (bound, 0);
            best_price.clone_from(&price);
        }
        if pass < clearing {
            price
                .iter_mut()
                .zip(&clearing_price)
                .for_each(|(p, clear)| *p += TOWARDS_CLEARING * (clear - *p));
            continue;
        }
        if pass == clearing || since > MAX_ITERATIONS_WITHOUT_GAIN {
            if since > MAX_ITERATIONS_WITHOUT_GAIN {
                length *= STEP_REDUCTION;
            }
            since = 0;
            price.clone_from(&best_price);
            slope.fill(0.0);
            values.solve(&price);
        }
        let newest = values.direction(&price);
        slope.iter_mut().zip(newest).for_each(|(old, new)| {
            *old = NEWEST_DIRECTION_WEIGHT * new + (1.0 - NEWEST_DIRECTION_WEIGHT) * *old
        });
        let norm: f64 = slope.iter().map(|g| g * g).sum();
        let gap = (known_cost.min(cost) - best_bound).max(MIN_RELATIVE_GAP * known_cost.abs());
        let step = if norm > 0.0 { length * gap / norm } else { 0.0 };
        for (t, price) in price.iter_mut().enumerate() {
            let losses = &problem.prices.losses[t];
            *price = (*price + step * slope[t]).min(losses.availability.max(losses.derating));
        }
    }
    Dual { bound: best_bound, request_w, price: best_price }
}

//! Proven lower bound: shadow prices of the balance, and for each kind of string a lower bound of its value function.
//!
//! The shadow prices `l` of the balance come from [`super::dual`] and do not exceed the price of undelivered energy. If a
//! function `W_t(x)` of the state satisfies the Bellman inequality `W_t(x) <= cost(x, u) - l_t u dt + W_{t+1}(f(x, u))`
//! everywhere, `W_0` is a lower bound for one string and `sum l_t D_t dt + sum W_0(start)` for every schedule
//! (docs/foresight.md, *Bounds*). There are two such functions: for an inverter that ran in the previous step, and for one that
//! did not and pays for a start. Here `W_t` is bilinear between nodes of SOC and temperature, and the inequality holds for
//! every state and request, not for nodes alone:
//!
//! - With such prices undelivered requests never pay, so the current of a string determines its request.
//! - Currents lead from SOC node to SOC node, and triangles between them have edges along lines of constant final SOC: SOC is
//!   exact, kinks of `W` at nodes cause no error, and full and empty are on edges of triangles.
//! - Over a triangle times a cell of temperature, cost and end temperature differ from linear interpolation between the corners
//!   by products of known sign and size, kinks of tables, and kinks of `W` over temperature. [`BoxErrors`] and [`Image`] hold
//!   bounds of these; the values at the corners are lowered by them.
//! - A charging inverter with less power than its no-load loss discharges the battery. It counts as off, with an error that
//!   covers its gain; an inverter that runs may stay on in this way.
//!
//! The minimum value at a node, over all triangles that meet there, is therefore a bound between the nodes too.

mod delivered;
mod errors;
mod images;
mod moves;
mod temperatures;

use bess_tables::{widest, Direction};

use crate::cores;
use crate::extremes::{larger, smaller};
use crate::model::{Range, StringModel, StringState};
use crate::plan::dual::ProofPrices;
use crate::plan::nodes::Nodes;
use crate::plan::problem::PlanProblem;
use errors::{Curvature, Errors, StepPrices};
use images::Images;
use moves::{Corner, Moves};
use temperatures::temperatures;

/// Minimum derating factor considered: below it, undelivered energy costs far more than delivered energy, and a smaller factor
/// would only increase the interpolation errors.
const MIN_FACTOR: f64 = 0.4;
/// Temperature cells during derating, per cell of the normal width.
const DERATING_CELLS: f64 = 2.0;
/// Maximum curvature of the correction of values, relative to the mean curvature of uncorrected values. Half or twice this factor
/// lowers the bound of a day at rated demand by 1 %.
const MAX_RELATIVE_CURVATURE: f64 = 10.0;
/// Number of SOC cells at which temperature cells are 1 K wide; both resolutions are proportional.
const SOC_CELLS_AT_1_K: f64 = 240.0;
/// Maximum share of the SOC cells that a step at full power may pass; long steps have fewer cells.
const MAX_SHARE_OF_CELLS: f64 = 0.1;
/// Limits of the number of SOC cells: fewer give no useful bound, more need gigabytes.
const MIN_CELLS: usize = 20;
const MAX_CELLS: usize = 1000;
/// Minimum number of SOC cells in plants with many kinds of strings.
const MIN_CELLS_OF_A_KIND: f64 = 160.0;
/// Relative margin of the bound for rounding.
const ROUNDING: f64 = 1e-9;

/// Resolution of the grid.
#[derive(Debug, Clone, Copy)]
struct Resolution {
    soc_cells: usize,
    /// Widest cell of temperature [K].
    temperature_k: f64,
}

impl Resolution {
    fn of(problem: &PlanProblem<'_>, m: usize, soc_cells: f64) -> Self {
        let window = problem.soc_window(m);
        let window = window.high - window.low;
        let max = MAX_SHARE_OF_CELLS * soc_cells * window / problem.soc_of_full_step(m).min(window);
        Self { soc_cells: soc_cells.min(max).ceil() as usize, temperature_k: SOC_CELLS_AT_1_K / soc_cells }
    }
}

/// Nodes, cells and moves of identical strings.
struct Kind<'a> {
    problem: &'a PlanProblem<'a>,
    /// One of them.
    member: usize,
    soc: Nodes,
    temperature_c: Vec<f64>,
    /// Reciprocal of the derating factor at each temperature node.
    requests_per_power: Vec<f64>,
    /// Range of the derating factor in each temperature cell.
    factor: Vec<Range>,
    moves: [Option<Moves>; 2],
    /// Share of the errors by which values are lowered: 1 except in tests.
    share: f64,
}

fn direction_index(direction: Direction) -> usize {
    direction.pick(0, 1)
}

impl<'a> Kind<'a> {
    fn new(problem: &'a PlanProblem<'a>, members: &[usize], resolution: Resolution) -> Option<Self> {
        let member = members[0];
        let string = &problem.model.strings()[member];
        let p = &string.parameters;
        let temperature_c = temperatures(problem, members, resolution.temperature_k);
        let factor = &p.derating.factor;
        let factors: Vec<f64> = temperature_c.iter().map(|&c| factor.at(c)).collect();
        let mut kind = Self {
            problem,
            member,
            soc: Nodes::over(problem.soc_window(member), resolution.soc_cells),
            requests_per_power: factors.iter().map(|k| 1.0 / k.max(MIN_FACTOR)).collect(),
            factor: factors.windows(2).map(|k| Range::point(k[0]).union(&Range::point(k[1]))).collect(),
            temperature_c,
            moves: [None, None],
            share: 1.0,
        };
        for direction in [Direction::Charge, Direction::Discharge] {
            let asked = |t: &usize| problem.intervals[*t].direction == direction && kind.cap_w(*t) > 0.0;
            let max_w = (0..problem.n_steps()).filter(asked).map(|t| kind.cap_w(t)).fold(0.0, f64::max);
            if max_w > 0.0 {
                kind.moves[direction_index(direction)] = Some(kind.moves(direction, max_w)?);
            }
        }
        Some(kind)
    }

    fn string(&self) -> &StringModel {
        &self.problem.model.strings()[self.member]
    }

    /// Maximum request of a string in a step [W].
    fn cap_w(&self, t: usize) -> f64 {
        self.problem.cap_w(self.member, t) * (1.0 + ROUNDING)
    }

    fn n_temperatures(&self) -> usize {
        self.temperature_c.len()
    }

    fn n_nodes(&self) -> usize {
        self.soc.len * self.n_temperatures()
    }

    fn n_cells(&self) -> usize {
        (self.soc.len - 1) * (self.n_temperatures() - 1)
    }

    /// Solves backwards at prices `(T,)` [cost/Wh]; `each` is called with the values of each step.
    fn backwards(&self, price: &[f64], mut each: impl FnMut(usize, &Values)) -> Values {
        let problem = self.problem;
        let n_temperatures = self.n_temperatures();
        let end = |x: usize| {
            let soc = self.soc.at((x / n_temperatures) as f64);
            problem.end_cost(self.member, StringState { soc, temperature_c: 25.0 })
        };
        let plain: Vec<f64> = (0..self.n_nodes()).map(end).collect();
        let mut next = Values { modes: [plain.clone(), plain.clone()], plain };
        each(problem.n_steps(), &next);
        let mut images: [Option<Images>; 2] = [None, None];
        for t in (0..problem.n_steps()).rev() {
            let interval = &problem.intervals[t];
            let index = direction_index(interval.direction);
            let cap_w = self.cap_w(t);
            let moves = self.moves[index].as_ref().filter(|_| cap_w > 0.0);
            if !images[index].as_ref().is_some_and(|i| i.interval == *interval) {
                images[index] = Some(self.images(interval, self.moves[index].as_ref()));
            }
            let Some(images) = &images[index] else { unreachable!() };
            let [of_off, of_running] = [0, 1].map(|mode| Curvature::new(self, &next.modes[mode]));
            let step = StepPrices::new(self, t, price[t], moves);
            let mut errors =
                Errors { off: self.idle_errors(&of_off, images, |_| 0.0), drawing: vec![], boxes: vec![] };
            if let Some(moves) = moves.filter(|m| m.direction == Direction::Charge) {
                let gain = |curvature: &Curvature, cell| self.drawn(moves, curvature, images, &step, cell);
                errors.off.iter_mut().enumerate().for_each(|(cell, e)| *e += gain(&of_off, cell).max(0.0));
                errors.drawing = self.idle_errors(&of_running, images, |cell| gain(&of_running, cell));
            }
            if let Some(moves) = moves {
                let boxes = (0..moves.n_boxes_within(cap_w)).collect();
                errors.boxes = cores::map(boxes, |k| self.box_errors((moves, images), &of_running, &step, k));
            }
            let row = |i| self.row(i, &next, (moves, images), &step, &errors);
            let mut now = Values { modes: [vec![], vec![]], plain: vec![] };
            for (rows, plain) in cores::map((0..self.soc.len).collect(), row) {
                now.modes.iter_mut().zip(rows).for_each(|(now, row)| now.extend(row));
                now.plain.extend(plain);
            }
            let max_curvature = MAX_RELATIVE_CURVATURE * self.mean_curvature(&now.plain);
            now.modes.iter_mut().for_each(|values| self.smooth(values, &now.plain, max_curvature));
            let [off, running] = &mut now.modes;
            cap(off, running, problem.prices.start);
            next = now;
            each(t, &next);
        }
        next
    }

    /// Values before a step at the nodes of one SOC, for a string that is off and one that runs; and uncorrected values.
    fn row(
        &self,
        i: usize,
        next: &Values,
        (moves, images): (Option<&Moves>, &Images),
        step: &StepPrices<'_>,
        errors: &Errors,
    ) -> ([Vec<f64>; 2], Vec<f64>) {
        let n_temperatures = self.n_temperatures();
        let (dt_h, wear) = (self.problem.dt_h(), self.problem.prices.wear[self.member]);
        let idle = |next: &[f64], error: &dyn Fn(usize) -> f64| -> Vec<f64> {
            let row = &next[i * n_temperatures..(i + 1) * n_temperatures];
            let at = |j: usize| {
                let (cell, share) = images.idle[j];
                step.cost(&Corner::default(), j) + lerp(row, cell, share) - self.share * error(j)
            };
            (0..n_temperatures).map(at).collect()
        };
        let mut off = idle(next.of(false), &|j| self.largest_around(&errors.off, i, j));
        let mut plain = idle(&next.plain, &|_| 0.0);
        let mut running = off.clone();
        let Some(moves) = moves else { return ([off, running], plain) };
        if !errors.drawing.is_empty() {
            cap(&mut running, &idle(next.of(true), &|j| self.largest_around(&errors.drawing, i, j)), 0.0);
        }
        // Errors of the boxes below and above a current.
        let mut below = vec![f64::NEG_INFINITY; n_temperatures];
        let mut above = below.clone();
        for k in 0..=errors.boxes.len() {
            let Some(to) = self.soc.after(moves.direction, i, k) else { break };
            std::mem::swap(&mut below, &mut above);
            let of_boxes = errors.boxes.get(k);
            let largest = |j| of_boxes.map_or(f64::NEG_INFINITY, |errors| self.largest_around(errors, i, j));
            above.iter_mut().enumerate().for_each(|(j, error)| *error = largest(j));
            let to = to * n_temperatures..(to + 1) * n_temperatures;
            let (next_row, plain_row) = (&next.of(true)[to.clone()], &next.plain[to]);
            let wear = dt_h * wear * moves.current_a * k as f64;
            for j in 0..n_temperatures {
                let error = larger(below[j], above[j]);
                if error == f64::NEG_INFINITY {
                    continue;
                }
                let x = k * self.n_nodes() + i * n_temperatures + j;
                let (cell, share) = images.corners[x];
                let cost = step.cost(&moves.corners[x], j) + wear;
                running[j] = smaller(running[j], cost + lerp(next_row, cell, share) - self.share * error);
                plain[j] = smaller(plain[j], cost + lerp(plain_row, cell, share));
            }
        }
        cap(&mut off, &running, self.problem.prices.start);
        ([off, running], plain)
    }

    /// Mean curvature of values over temperature.
    fn mean_curvature(&self, values: &[f64]) -> f64 {
        let (n, at) = (self.n_temperatures(), &self.temperature_c);
        let bend_at = |row: &[f64], j: usize| {
            let slope = |j: usize| (row[j + 1] - row[j]) / (at[j + 1] - at[j]);
            (slope(j) - slope(j - 1)).abs() / (at[j + 1] - at[j - 1])
        };
        let inner = 1..n - 1;
        let sum: f64 = values.chunks_exact(n).flat_map(|row| inner.clone().map(|j| bend_at(row, j))).sum();
        sum / (self.soc.len * inner.len().max(1)) as f64
    }

    /// Lowers values so that their correction has a limited curvature: kinks cause errors in the previous step and would grow.
    fn smooth(&self, values: &mut [f64], plain: &[f64], max_curvature: f64) {
        let (n, at) = (self.n_temperatures(), &self.temperature_c);
        let (mut below, mut smooth) = (vec![0.0; n], vec![0.0; n]);
        for (values, plain) in values.chunks_exact_mut(n).zip(plain.chunks_exact(n)) {
            below.iter_mut().zip(plain.iter().zip(values.iter())).for_each(|(b, (p, v))| *b = p - v);
            envelope(at, &below, max_curvature, &mut smooth);
            values.iter_mut().zip(plain.iter().zip(&smooth)).for_each(|(v, (p, s))| *v = p - s);
        }
    }

    /// Value at a state, from values at the nodes.
    fn at(&self, values: &[f64], state: StringState) -> f64 {
        let (i, share) = self.soc.locate(state.soc);
        let (cell, of_cell) = self.place(state.temperature_c, 0);
        let row = |i: usize| lerp(&values[i * self.n_temperatures()..], cell, of_cell);
        (1.0 - share) * row(i) + share * row(i + 1)
    }
}

/// Values at the nodes `(n_soc, n_temperature)`.
#[derive(Debug, Clone)]
struct Values {
    /// Of a string that is off, and of a string that runs.
    modes: [Vec<f64>; 2],
    /// Uncorrected: without errors and start costs.
    plain: Vec<f64>,
}

impl Values {
    fn of(&self, running: bool) -> &[f64] {
        &self.modes[usize::from(running)]
    }
}

/// Limits values to others plus a cost.
fn cap(values: &mut [f64], others: &[f64], cost: f64) {
    values.iter_mut().zip(others).for_each(|(value, other)| *value = value.min(other + cost));
}

widest! {
    /// Upper envelope, at the nodes, of concave parabolas with their tops at the values of the nodes.
    fn envelope(at: &[f64], values: &[f64], bend: f64, highest: &mut [f64]) {
        highest.fill(f64::NEG_INFINITY);
        for (top, value) in at.iter().zip(values) {
            for (highest, at) in highest.iter_mut().zip(at) {
                *highest = larger(*highest, value - bend * (top - at) * (top - at));
            }
        }
    }
}

#[inline]
fn lerp(row: &[f64], cell: usize, share: f64) -> f64 {
    row[cell] + share * (row[cell + 1] - row[cell])
}

/// Lower bound of the cost of every schedule on the control model with the coefficients of the start of each step, from
/// prices of the balance. SOC balancing is omitted; it only adds to the cost.
///
/// `soc_cells` is the resolution for identical strings; work grows with its third power. None with reactive power, or if the
/// internal power of an inverter does not increase with its delivered power.
pub(crate) fn bound(problem: &PlanProblem<'_>, prices: &ProofPrices, soc_cells: usize) -> Option<f64> {
    let relaxed = prices.relaxed.then(|| problem.relaxed());
    let problem = relaxed.as_ref().unwrap_or(problem);
    let kinds = problem.kinds();
    let cells = soc_cells.clamp(MIN_CELLS, MAX_CELLS) as f64;
    let cells = cells.min((cells / (kinds.len() as f64).cbrt()).max(MIN_CELLS_OF_A_KIND));
    proven(problem, &prices.price, &kinds, |m| Resolution::of(problem, m, cells))
}

fn proven(
    problem: &PlanProblem<'_>,
    price: &[f64],
    kinds: &[Vec<usize>],
    resolution: impl Fn(usize) -> Resolution,
) -> Option<f64> {
    if problem.has_reactive() {
        return None;
    }
    let new = |members: &Vec<usize>| Kind::new(problem, members, resolution(members[0]));
    let solvers = kinds.iter().map(new).collect::<Option<Vec<_>>>()?;
    let losses = problem.prices.losses.iter();
    let price: Vec<f64> = price.iter().zip(losses).map(|(l, c)| l.min(c.availability)).collect();
    let demand = |t: usize| price[t] * problem.demand_w[t] * problem.dt_h();
    let idle = (0..problem.n_strings()).filter(|&m| !problem.is_in_service(m));
    let mut terms: Vec<f64> = (0..problem.n_steps()).map(demand).collect();
    terms.extend(idle.map(|m| problem.end_cost(m, problem.start[m])));
    for (kind, members) in solvers.iter().zip(kinds) {
        let values = kind.backwards(&price, |_, _| ());
        let of_state = |&m: &usize| kind.at(values.of(problem.running[m]), problem.start[m]);
        terms.extend(members.iter().map(of_state));
    }
    let size: f64 = terms.iter().map(|x| x.abs()).sum();
    Some(terms.iter().sum::<f64>() - ROUNDING * size)
}

#[cfg(test)]
mod tests;

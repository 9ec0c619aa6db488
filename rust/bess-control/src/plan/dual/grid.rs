//! The grid of SOC and temperature of identical strings, and their moves between its nodes.
//!
//! A step first heats a string and then cools it, both in one operation of the control model:
//! `T' = (1 - k2 dt) (T + k1 dt Q / (1 - k2 dt)) + k2 dt T_ambient`. Heating does not depend on the step, and cooling not on the
//! move, so interpolation weights are computed for each move and for each step, not for both together.

use bess_tables::units::SECONDS_PER_HOUR;
use bess_tables::{widest, Direction};

use crate::model::{Interval, Losses, StringModel, StringState};
use crate::plan::nodes::Nodes;
use crate::plan::problem::PlanProblem;

/// SOC change of a step at full power [nodes].
const NODES_PER_STEP: f64 = 10.0;
/// Minimum and maximum number of SOC nodes.
const SOC_NODES: (usize, usize) = (40, 400);
pub(super) const TEMPERATURE_NODES: usize = 32;
/// Minimum share of its excess temperature that a string retains in a step.
const MIN_RETAINED_SHARE: f64 = 0.1;

/// Values at the temperature nodes of one SOC, in single precision: rounding is far below the error of the grid.
pub(super) type Row<T = f32> = [T; TEMPERATURE_NODES];

/// A row with additional nodes below and above the grid, which have the value of its first and last node.
pub(super) type Padded = [f32; PADDED];
pub(super) const PADDED: usize = 3 * TEMPERATURE_NODES + 4;

/// Nodes below the grid in a padded row.
const BELOW: usize = TEMPERATURE_NODES + 1;

/// Interpolation matrix of a row, with a band of weights: the first is `low` nodes after the diagonal, in a padded row.
#[derive(Default)]
pub(super) struct Band {
    low: usize,
    weights: Vec<Row>,
}

/// Moves of a string from every node, in one direction; rows `(steps of SOC from 0, soc)`.
#[derive(Default)]
pub(super) struct Moves {
    pub(super) request_w: Vec<Row>,
    inverter_w: Vec<Row>,
    battery_w: Vec<Row>,
    /// Interpolation after heating by the battery loss.
    pub(super) heated: Vec<Band>,
    /// Current for each number of SOC steps.
    current_a: Vec<f32>,
}

/// The grid of identical strings.
pub(super) struct Grid<'a> {
    pub(super) problem: &'a PlanProblem<'a>,
    /// One of the strings.
    pub(super) string: usize,
    pub(super) soc: Nodes,
    temperature_c: Nodes,
    derating: Row,
    charge: Moves,
    discharge: Moves,
    /// Interpolation after the cooling of each step.
    pub(super) cooled: Vec<Band>,
}

/// Weights of four successive nodes at a position between the second and the third: linear in the first and the last cell of the
/// grid and beyond, otherwise cubic convolution (Keys, IEEE Trans. ASSP 29, 1153, 1981).
fn weights(place: f64) -> [f64; 4] {
    let b = place - place.floor();
    if place < 1.0 || place >= (TEMPERATURE_NODES - 2) as f64 {
        return [0.0, 1.0 - b, b, 0.0];
    }
    let (b2, b3) = (b * b, b * b * b);
    [-0.5 * b + b2 - 0.5 * b3, 1.0 - 2.5 * b2 + 1.5 * b3, 0.5 * b + 2.0 * b2 - 1.5 * b3, -0.5 * b2 + 0.5 * b3]
}

impl Band {
    /// From the shift of each node [nodes]. Shifts beyond the width of the grid are equal.
    fn new(change: Row<f64>) -> Self {
        let width = TEMPERATURE_NODES as f64;
        let shifted = change.map(|nodes| nodes.clamp(-width, width) + BELOW as f64 - 1.0);
        let low = shifted.iter().copied().fold(f64::INFINITY, f64::min) as usize;
        let high = shifted.iter().copied().fold(0.0, f64::max) as usize;
        let mut rows = vec![[0.0; TEMPERATURE_NODES]; high - low + 4];
        for (j, shifted) in shifted.into_iter().enumerate() {
            let place = shifted + (j + 1) as f64 - BELOW as f64;
            for (n, weight) in weights(place).into_iter().enumerate() {
                rows[shifted as usize - low + n][j] = weight as f32;
            }
        }
        Self { low, weights: rows }
    }

    #[inline(always)]
    fn along(&self, padded: &Padded) -> Row {
        let mut sum = [0.0; TEMPERATURE_NODES];
        for (n, weights) in self.weights.iter().enumerate() {
            let from = &padded[self.low + n..][..TEMPERATURE_NODES];
            for j in 0..TEMPERATURE_NODES {
                sum[j] += weights[j] * from[j];
            }
        }
        sum
    }

    /// Adds a share of the node `j` to its target nodes: the transpose of [`Self::along`] a padded row.
    pub(super) fn spread(&self, j: usize, share: f32, row: &mut Row) {
        for (n, weights) in self.weights.iter().enumerate() {
            row[inside(self.low + n + j, BELOW)] += share * weights[j];
        }
    }
}

/// Node of the grid for a node of a padded row, clamped at both ends.
fn inside(node: usize, below: usize) -> usize {
    node.saturating_sub(below).min(TEMPERATURE_NODES - 1)
}

#[inline(always)]
fn pad(row: &Row) -> Padded {
    let mut padded = [row[0]; PADDED];
    padded[BELOW..][..TEMPERATURE_NODES].copy_from_slice(row);
    padded[BELOW + TEMPERATURE_NODES..].fill(row[TEMPERATURE_NODES - 1]);
    padded
}

impl<'a> Grid<'a> {
    pub(super) fn new(problem: &'a PlanProblem<'a>, m: usize) -> Self {
        let string = &problem.model.strings()[m];
        let window = problem.soc_window(m);
        let cells =
            ((window.high - window.low) / problem.soc_of_full_step(m) * NODES_PER_STEP).round() as usize;
        let factor = &string.parameters.derating.factor;
        let stop_c = factor.x().last().copied().filter(|&c| factor.at(c) < 1.0);
        let temperature_c = Nodes::over(problem.temperatures_to_c(stop_c, 1.0), TEMPERATURE_NODES - 1);
        let mut grid = Self {
            problem,
            string: m,
            soc: Nodes::over(window, cells.clamp(SOC_NODES.0, SOC_NODES.1)),
            temperature_c,
            derating: std::array::from_fn(|j| factor.at(temperature_c.at(j as f64)) as f32),
            charge: Moves::default(),
            discharge: Moves::default(),
            cooled: vec![],
        };
        grid.charge = grid.moves(string, Direction::Charge);
        grid.discharge = grid.moves(string, Direction::Discharge);
        grid.cooled = problem.intervals.iter().map(|interval| grid.cooled(string, interval)).collect();
        grid
    }

    /// All moves to SOC nodes: request and losses with the mean voltage and resistance of the move. Infeasible moves have an
    /// infinite request. Moves whose internal power is below the no-load loss have a negative request, by extrapolation of
    /// the table, for interpolation with the next move. For the same reason, the first move of each node above nominal power is kept.
    fn moves(&self, string: &StringModel, direction: Direction) -> Moves {
        let p = &string.parameters;
        let curve = string.loss(direction);
        let highest_w = curve.at(string.nominal_w()).1;
        let no_load_w = curve.internal_w(0.0, curve.at(0.0).0);
        let factors: Row<f64> =
            std::array::from_fn(|j| p.derating.factor.at(self.temperature_c.at(j as f64)));
        let mut out = Moves::default();
        for k in 0.. {
            let current_a = self.soc.step * k as f64 * p.capacity_ah / self.problem.dt_h();
            let mut any = false;
            for i in 0..self.soc.len {
                let mut request_w = [f32::INFINITY; TEMPERATURE_NODES];
                let [mut inverter_w, mut battery_w] = [[0.0; TEMPERATURE_NODES]; 2];
                if let Some(to) = self.soc.after(direction, i, k) {
                    for j in 0..TEMPERATURE_NODES {
                        let at = |share: f64| {
                            let soc = self.soc.at(i as f64 + share * (to as f64 - i as f64));
                            let temperature_c = self.temperature_c.at(j as f64);
                            let state = StringState { soc, temperature_c };
                            string.coefficients(direction, state)
                        };
                        let (start, middle, end) = (at(0.0), at(0.5), at(1.0));
                        let mean = |a: f64, b: f64, c: f64| (a + 4.0 * b + c) / 6.0;
                        let volt = mean(start.voltage_v, middle.voltage_v, end.voltage_v);
                        let ohm = mean(start.resistance_ohm, middle.resistance_ohm, end.resistance_ohm);
                        let heat_w = ohm * current_a * current_a;
                        let internal_w = volt * current_a - direction.sign() * heat_w;
                        let has_root = direction == Direction::Charge || 2.0 * ohm * current_a <= volt;
                        let allowed = p.voltage_allows(direction, volt, ohm * current_a);
                        if has_root && allowed && factors[j] > 0.0 {
                            let power_w = match internal_w - no_load_w {
                                below_w if below_w < 0.0 => below_w,
                                _ => curve.largest_power(internal_w) + (internal_w - highest_w).max(0.0),
                            };
                            let needed_w = power_w / factors[j];
                            request_w[j] = needed_w as f32;
                            any |= needed_w <= string.nominal_w();
                            inverter_w[j] = curve.at(power_w.max(0.0)).0 as f32;
                            battery_w[j] = heat_w as f32;
                        }
                    }
                }
                out.request_w.push(request_w);
                out.inverter_w.push(inverter_w);
                out.heated.push(self.heated(string, &battery_w));
                out.battery_w.push(battery_w);
            }
            out.current_a.push(current_a as f32);
            if !any {
                break;
            }
        }
        out
    }

    /// Interpolation after heating by a row of moves, before cooling.
    fn heated(&self, string: &StringModel, battery_w: &Row) -> Band {
        let lumped = &string.parameters.lumped;
        let dt_s = self.problem.dt_h() * SECONDS_PER_HOUR;
        let kept = (1.0 - dt_s * lumped.k2_per_s).max(MIN_RETAINED_SHARE);
        let nodes_per_w = dt_s * lumped.k1_k_per_j / kept / self.temperature_c.step;
        Band::new(battery_w.map(|heat_w| nodes_per_w * f64::from(heat_w)))
    }

    fn cooled(&self, string: &StringModel, interval: &Interval) -> Band {
        let change_k = |j: usize| {
            let from_c = self.temperature_c.at(j as f64);
            string.warmed(from_c, 0.0, interval) - from_c
        };
        Band::new(std::array::from_fn(|j| change_k(j) / self.temperature_c.step))
    }

    pub(super) fn moves_in(&self, direction: Direction) -> &Moves {
        direction.pick(&self.charge, &self.discharge)
    }

    /// Nodes at a temperature and their weights; beyond the ends of the grid, those of its ends.
    pub(super) fn nodes(&self, temperature_c: f64) -> [(usize, f64); 4] {
        let at = self.temperature_c.position(temperature_c);
        let mut n = at as usize;
        weights(at).map(|weight| {
            n += 1;
            (inside(n - 1, 1), weight)
        })
    }
}

widest! {
    /// Costs to go and best moves of strings that are off, then of those that run, from the costs to go after step `t` at a price of
    /// power [cost/Wh]; rows `(off or on, soc)`. Requests between two moves are interpolated. `cool` is a buffer: the costs to go of running strings before
    /// cooling.
    pub(super) fn step_back(
        grid: &Grid<'_>,
        t: usize,
        price: f64,
        after: &[Row],
        cool: &mut [Padded],
        now: &mut [Row],
        choice: &mut [Row<u16>],
    ) {
        let n_soc = grid.soc.len;
        let (problem, cooled) = (grid.problem, &grid.cooled[t]);
        let direction = problem.intervals[t].direction;
        let moves = grid.moves_in(direction);
        let (after_off, after_on) = after.split_at(n_soc);
        for (cool, after) in cool.iter_mut().zip(after_on) {
            *cool = pad(&cooled.along(&pad(after)));
        }
        let Losses { derating, inverter, battery, .. } = problem.prices.losses[t];
        let [price, derating, inverter, battery, wear] =
            [price, derating, inverter, battery, problem.prices.wear[grid.string]].map(|price| (problem.dt_h() * price) as f32);
        let per_w = grid.derating.map(|factor| derating * (1.0 - factor) - price);
        let [cap_w, start] = [problem.cap_w(grid.string, t), problem.prices.start].map(|value| value as f32);
        let (now_off, now_on) = now.split_at_mut(n_soc);
        let (choice_off, choice_on) = choice.split_at_mut(n_soc);
        for i in 0..n_soc {
            let (mut best, mut steps) = ([f32::INFINITY; TEMPERATURE_NODES], [0.0; TEMPERATURE_NODES]);
            let (mut shorter_w, mut shorter) = (&[f32::NEG_INFINITY; TEMPERATURE_NODES], best);
            for (k, current_a) in moves.current_a.iter().enumerate() {
                if cap_w <= 0.0 || shorter_w.iter().all(|&w| w >= cap_w) {
                    break;
                }
                let Some(to) = grid.soc.after(direction, i, k) else { break };
                let row = k * n_soc + i;
                let (longer_w, inverter_w, battery_w) =
                    (&moves.request_w[row], &moves.inverter_w[row], &moves.battery_w[row]);
                let mut longer = moves.heated[row].along(&cool[to]);
                for j in 0..TEMPERATURE_NODES {
                    longer[j] += per_w[j] * longer_w[j] + inverter * inverter_w[j] + battery * battery_w[j] + wear * current_a;
                }
                let mut value = longer;
                if longer_w.iter().any(|&w| w > cap_w) {
                    for j in 0..TEMPERATURE_NODES {
                        let share = (cap_w - shorter_w[j]) / (longer_w[j] - shorter_w[j]);
                        let between = shorter[j] + share * (longer[j] - shorter[j]);
                        let exists = (shorter_w[j] < cap_w) & (longer_w[j] < f32::INFINITY);
                        let between = if exists { between } else { f32::INFINITY };
                        value[j] = if longer_w[j] <= cap_w { longer[j] } else { between };
                    }
                }
                for j in 0..TEMPERATURE_NODES {
                    let better = (longer_w[j] > 0.0) & (value[j] < best[j]);
                    best[j] = if better { value[j] } else { best[j] };
                    steps[j] = if better { k as f32 } else { steps[j] };
                }
                (shorter_w, shorter) = (longer_w, longer);
            }
            let off = cooled.along(&pad(&after_off[i]));
            for j in 0..TEMPERATURE_NODES {
                let started = best[j] + start;
                now_off[i][j] = off[j].min(started);
                now_on[i][j] = off[j].min(best[j]);
                choice_off[i][j] = if started < off[j] { steps[j] as u16 } else { 0 };
                choice_on[i][j] = if best[j] < off[j] { steps[j] as u16 } else { 0 };
            }
        }
    }
}

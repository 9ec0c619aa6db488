//! Dispatch over prices: a dynamic program of the plant as one store, over stored energy, temperature and depth of the
//! present discharge.
//!
//! `transitions` holds the response of the control model to each of several powers. The value of a state is the best income
//! from there to the end of the horizon. Values after a block are expected over the price levels of the next one. Where
//! cycles are limited, values are computed for several shadow prices of cycling; the dual value at a state is the least of
//! them together with the value of the remaining cycles. Powers in kW, energies in kWh, money in EUR.

#[cfg(test)]
mod tests;
mod transitions;

use std::collections::BTreeMap;
use std::ops::Range;

use bess_tables::{InputError, Lut};

use crate::error::{check_length, check_range};
use crate::model::ControlModel;
use transitions::{around, weights, Transitions};
pub use transitions::{StoreGrid, StoreState};

/// Cycled energy that a resting plant may show by rounding [kWh].
const ROUNDING_KWH: f64 = 1e-6;
/// Rounding of interpolated temperatures [K].
const ROUNDING_K: f64 = 1e-9;

/// Control steps of one price on one day.
#[derive(Debug, Clone, Copy)]
pub struct DispatchBlock {
    /// Number of control steps.
    pub steps: usize,
    /// Period of the cycle limit.
    pub period: usize,
    /// Mean ambient temperature [degC].
    pub ambient_c: f64,
    /// Whether a new price begins: the price level may change.
    pub is_new: bool,
}

/// A horizon of blocks `B` with price levels `L`.
#[derive(Debug, Clone)]
pub struct DispatchProblem {
    /// Blocks in order.
    pub blocks: Vec<DispatchBlock>,
    /// Income of a kWh discharged, of one charged, of one lost by derating, and of holding a kWh for an hour
    /// `(B, L + 1)`; the last level is the expected price.
    pub income_eur: Vec<[f64; 4]>,
    /// Probability of each level in each block `(B, L)`.
    pub share: Vec<f64>,
    /// Probability of each level (column) after each level (row).
    pub chance: Vec<f64>,
    /// Wear cost of a discharge over its depth.
    pub wear_eur: Lut,
    /// Value of a kWh stored at the end.
    pub end_eur_kwh: f64,
    /// Limit of the cycled energy of each period [kWh].
    pub allowed_kwh: Vec<f64>,
    /// Shadow prices of cycling, if a limit binds [EUR/kWh].
    pub ladder_eur_kwh: Vec<f64>,
    /// State at the start.
    pub start: StoreState,
}

/// The plant as one store, with its transitions by the number of steps of a block.
#[derive(Debug)]
pub struct Store {
    model: ControlModel,
    grid: StoreGrid,
    transitions: BTreeMap<usize, Transitions>,
}

impl Store {
    /// A store on a control model.
    ///
    /// # Errors
    ///
    /// As [`StoreGrid::check`].
    pub fn new(model: ControlModel, grid: StoreGrid) -> Result<Self, InputError> {
        grid.check(&model)?;
        Ok(Self { model, grid, transitions: BTreeMap::new() })
    }

    /// Power of each block `(B,)` [kW], signed: the best at a shadow price of zero, or with the ladder if that exceeds a
    /// limit.
    ///
    /// # Errors
    ///
    /// Lengths do not agree.
    pub fn dispatch(&mut self, problem: &DispatchProblem) -> Result<Vec<f64>, InputError> {
        let levels = problem.check()?;
        for block in &problem.blocks {
            let build = || self.grid.transitions(&self.model, block.steps);
            self.transitions.entry(block.steps).or_insert_with(build);
        }
        let no_limit = vec![f64::INFINITY; problem.allowed_kwh.len()];
        let free = Program::new(self, problem, levels, &[0.0], &no_limit).solved();
        if free.1.iter().zip(&problem.allowed_kwh).all(|(cycled, allowed)| cycled <= allowed) {
            return Ok(free.0);
        }
        Ok(Program::new(self, problem, levels, &problem.ladder_eur_kwh, &problem.allowed_kwh).solved().0)
    }

    /// Transitions of a block.
    fn of(&self, block: &DispatchBlock) -> &Transitions {
        &self.transitions[&block.steps]
    }

    /// How much warmer the plant is after a block than by its transition, in its ambient temperature [K].
    fn warmer_k(&self, block: &DispatchBlock) -> f64 {
        self.of(block).cooled * (block.ambient_c - self.grid.ambient_c)
    }
}

/// Temperatures of the grid on which the powers depend, see [`Program::reached`].
///
/// A temperature is a mean of the ends of rows. Values there, and at these ends, are read between two points of the grid.
fn reached(store: &Store, problem: &DispatchProblem) -> Vec<Range<usize>> {
    let points = &store.grid.temperature_c;
    let below = |temperature_c: f64| around(points, temperature_c).0;
    let first = below(problem.start.temperature_c);
    let mut rows = first..first + 2;
    let mut all = vec![rows.clone()];
    for block in &problem.blocks {
        let ends_c = &store.of(block).ends_c[rows.clone()];
        let lowest_c = ends_c.iter().fold(f64::INFINITY, |low, end| low.min(end.0));
        let highest_c = ends_c.iter().fold(f64::NEG_INFINITY, |high, end| high.max(end.1));
        let (lowest, highest) = (below(lowest_c - ROUNDING_K), below(highest_c + ROUNDING_K) + 1);
        rows = rows.start.min(lowest)..rows.end.max(highest + 1);
        // In the ambient temperature of the transitions, values are those of the points themselves.
        let shift_k = store.warmer_k(block);
        if shift_k != 0.0 {
            let [cool, warm] = [points[lowest] - ROUNDING_K, points[highest] + ROUNDING_K];
            rows = rows.start.min(below(cool + shift_k))..rows.end.max(below(warm + shift_k) + 2);
        }
        all.push(rows.clone());
    }
    all
}

impl DispatchProblem {
    /// Wear cost of a discharge by `drawn` from `depth`, without the price of energy.
    fn wear_eur(&self, depth: f64, drawn: f64) -> f64 {
        if drawn == 0.0 {
            return 0.0;
        }
        self.wear_eur.at(depth + drawn) - self.wear_eur.at(depth)
    }

    /// Number of price levels, if all lengths agree.
    fn check(&self) -> Result<usize, InputError> {
        let blocks = self.blocks.len();
        let levels = self.share.len() / blocks.max(1);
        check_length("share", &self.share, levels.max(1) * blocks.max(1))?;
        check_length("chance", &self.chance, levels * levels)?;
        check_length("income", &self.income_eur, blocks * (levels + 1))?;
        check_length("ladder", &self.ladder_eur_kwh, self.ladder_eur_kwh.len().max(1))?;
        let periods = self.blocks.iter().map(|block| block.period as f64).collect::<Vec<_>>();
        check_range("period", &periods, (0.0, self.allowed_kwh.len() as f64 - 1.0), "")?;
        Ok(levels)
    }
}

/// One backward and one forward pass at given shadow prices.
///
/// Values have the order (depth, temperature, energy, level, shadow price).
struct Program<'a> {
    store: &'a Store,
    problem: &'a DispatchProblem,
    levels: usize,
    shadow_eur: &'a [f64],
    allowed_kwh: &'a [f64],
    /// Wear cost of each transition from each depth `(D, rows)`, by the number of steps; empty if there is none.
    wear_eur: BTreeMap<usize, Vec<f64>>,
    /// Temperatures of the grid before each block and at the end `(B + 1,)` on which the powers depend; those of later blocks
    /// include those of earlier ones.
    reached: Vec<Range<usize>>,
}

impl<'a> Program<'a> {
    fn new(
        store: &'a Store,
        problem: &'a DispatchProblem,
        levels: usize,
        shadow_eur: &'a [f64],
        allowed_kwh: &'a [f64],
    ) -> Self {
        let wear = |of: &Transitions| -> Vec<f64> {
            let rows = |&depth: &f64| of.drawn.iter().map(move |&drawn| problem.wear_eur(depth, drawn));
            store.grid.depth.iter().flat_map(rows).collect()
        };
        let used = |steps: &usize| problem.blocks.iter().any(|block| block.steps == *steps);
        let has_wear = problem.wear_eur.y().iter().any(|&eur| eur != 0.0);
        let of_all = store.transitions.iter().filter(|(steps, _)| used(steps));
        let wear_eur = of_all.map(|(&steps, of)| (steps, if has_wear { wear(of) } else { vec![] })).collect();
        let reached = reached(store, problem);
        Self { store, problem, levels, shadow_eur, allowed_kwh, wear_eur, reached }
    }

    /// Power of each block, and cycled energy of each period.
    fn solved(&self) -> (Vec<f64>, Vec<f64>) {
        self.followed(&self.values())
    }

    fn transitions(&self, b: usize) -> &'a Transitions {
        self.store.of(&self.problem.blocks[b])
    }

    /// Income of a level in a block; the level after the last is the expected price.
    fn income(&self, b: usize, level: usize) -> &[f64; 4] {
        &self.problem.income_eur[b * (self.levels + 1) + level]
    }

    /// Values of the states before each block and at the end `(B + 1, states, L, S)`.
    fn values(&self) -> Vec<f64> {
        let (grid, n_blocks) = (&self.store.grid, self.problem.blocks.len());
        let columns = self.levels * self.shadow_eur.len();
        let size = grid.n_states() * columns;
        let mut values = vec![0.0; (n_blocks + 1) * size];
        for (state, value) in values[n_blocks * size..].chunks_exact_mut(columns).enumerate() {
            let energy_kwh = grid.energy_kwh[state % grid.energy_kwh.len()];
            value.fill(self.problem.end_eur_kwh * energy_kwh);
        }
        let (mut after, mut moved) = (vec![0.0; size], vec![0.0; size]);
        let mut income = Vec::new();
        for b in (0..n_blocks).rev() {
            let (before, later) = values[b * size..].split_at_mut(size);
            if self.continues(b) {
                self.in_ambient(b, &later[..size], &mut moved);
            } else {
                let row = grid.energy_kwh.len() * columns;
                let rows = after.chunks_exact_mut(row).zip(later.chunks_exact(row));
                for (_, (out, later)) in self.of_reached(b + 1, rows) {
                    for (out, later) in out.chunks_exact_mut(columns).zip(later.chunks_exact(columns)) {
                        self.after(b, later, out);
                    }
                }
                self.in_ambient(b, &after, &mut moved);
            }
            self.best(b, &moved, &mut income, before);
        }
        values
    }

    /// Whether a block has other transitions or incomes than the next one.
    fn settles_otherwise(&self, b: usize) -> bool {
        if b + 1 == self.problem.blocks.len() {
            return true;
        }
        let here = |b: usize| &self.problem.income_eur[b * (self.levels + 1)..][..self.levels];
        self.problem.blocks[b].steps != self.problem.blocks[b + 1].steps || here(b) != here(b + 1)
    }

    /// Whether values after a block are those before the next one.
    fn continues(&self, b: usize) -> bool {
        let known = |next: &DispatchBlock| !next.is_new || self.levels == 1;
        let next = self.problem.blocks.get(b + 1);
        next.is_none_or(|next| known(next) && next.period == self.problem.blocks[b].period)
    }

    /// Values of a state after a block by its level `(L, S)`: the expectation over the next level. Before another period,
    /// at the shadow price that uses its limit: where the dual value, an upper bound, is least.
    fn after(&self, b: usize, later: &[f64], out: &mut [f64]) {
        let shadows = self.shadow_eur.len();
        out.copy_from_slice(later);
        if self.continues(b) {
            return;
        }
        let next = &self.problem.blocks[b + 1];
        if next.period != self.problem.blocks[b].period {
            let allowed_kwh = self.allowed_kwh[next.period];
            for row in out.chunks_exact_mut(shadows) {
                let bounds = row.iter().zip(self.shadow_eur);
                let least = bounds.map(|(value, shadow)| value + worth(*shadow, allowed_kwh));
                let least = least.fold(f64::INFINITY, f64::min);
                row.fill(least);
            }
        }
        if next.is_new {
            let known = out.to_vec();
            for (out, chance) in
                out.chunks_exact_mut(shadows).zip(self.problem.chance.chunks_exact(self.levels))
            {
                for (s, out) in out.iter_mut().enumerate() {
                    *out = expected(chance, &known, s, shadows);
                }
            }
        }
    }

    /// Values at the temperatures that a block reaches in its ambient temperature instead of that of the transitions.
    fn in_ambient(&self, b: usize, after: &[f64], moved: &mut [f64]) {
        let grid = &self.store.grid;
        let warmer_k = self.warmer_k(b);
        let row = grid.energy_kwh.len() * self.levels * self.shadow_eur.len();
        let depths = row * grid.temperature_c.len();
        for t in self.reached[b + 1].clone() {
            let (low, share) = around(&grid.temperature_c, grid.temperature_c[t] + warmer_k);
            for (after, moved) in after.chunks_exact(depths).zip(moved.chunks_exact_mut(depths)) {
                let (cool, warm) = after[low * row..][..2 * row].split_at(row);
                for ((out, cool), warm) in moved[t * row..][..row].iter_mut().zip(cool).zip(warm) {
                    *out = (1.0 - share) * cool + share * warm;
                }
            }
        }
    }

    fn warmer_k(&self, b: usize) -> f64 {
        self.store.warmer_k(&self.problem.blocks[b])
    }

    /// Those of the items of each depth and temperature `(D, K)` at which the temperature is reached before block `b`.
    fn of_reached<T>(&self, b: usize, items: impl Iterator<Item = T>) -> impl Iterator<Item = (usize, T)> {
        let (rows, temperatures) = (self.reached[b].clone(), self.store.grid.temperature_c.len());
        items.enumerate().filter(move |(i, _)| rows.contains(&(i % temperatures)))
    }

    /// Income of each transition from each depth at each level `(D, L, rows)`, without the shadow price.
    #[inline(always)]
    fn income_of_rows(&self, b: usize, income: &mut Vec<f64>) {
        let wear_eur = &self.wear_eur[&self.problem.blocks[b].steps];
        let (transitions, energies) = (self.transitions(b), self.store.grid.energy_kwh.len());
        let n = transitions.flows.len();
        income.resize(self.store.grid.depth.len() * self.levels * n, 0.0);
        // The income of a block is kept for blocks before it, which reach no other temperature.
        let Range { start, end } = self.reached[b];
        let powers = self.store.grid.power_kw.len();
        for (rows, income) in income.chunks_exact_mut(n).enumerate() {
            let eur = self.income(b, rows % self.levels);
            for power in start * powers..end * powers {
                let has_some = &transitions.has_some[power];
                let from = power * energies;
                let income = &mut income[from..][..energies];
                income.fill(0.0);
                for ((amount, eur), some) in transitions.amounts.iter().zip(eur).zip(has_some) {
                    // Most rows neither sell and buy nor lose by derating: what is zero is not added.
                    if *some && *eur != 0.0 {
                        let amount = &amount[from..][..energies];
                        for i in 0..energies {
                            income[i] += amount[i] * eur;
                        }
                    }
                }
                if !wear_eur.is_empty() {
                    let wear_eur = &wear_eur[rows / self.levels * n + from..][..energies];
                    for i in 0..energies {
                        income[i] -= wear_eur[i];
                    }
                }
            }
        }
    }

    /// Values of the grid before a block: those of the best transition. Keeps the `income` of the block after it where that
    /// is the same.
    #[allow(unsafe_code)]
    fn best(&self, b: usize, moved: &[f64], income: &mut Vec<f64>, before: &mut [f64]) {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has these instructions. They add and multiply as others do, so results are the same.
            return unsafe { self.best_avx2(b, moved, income, before) };
        }
        self.best_anywhere(b, moved, income, before);
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    #[allow(unsafe_code)]
    unsafe fn best_avx2(&self, b: usize, moved: &[f64], income: &mut Vec<f64>, before: &mut [f64]) {
        self.best_anywhere(b, moved, income, before);
    }

    #[inline(always)]
    fn best_anywhere(&self, b: usize, moved: &[f64], income: &mut Vec<f64>, before: &mut [f64]) {
        let (grid, transitions) = (&self.store.grid, self.transitions(b));
        let energies = grid.energy_kwh.len();
        let (all_rows, columns) = (transitions.flows.len(), self.levels * self.shadow_eur.len());
        // Where there is one depth only, no state is deeper.
        let deeper = if grid.depth.len() > 1 { grid.temperature_c.len() * energies * columns } else { 0 };
        if self.settles_otherwise(b) {
            self.income_of_rows(b, income);
        }
        let of_states = before.chunks_exact_mut(energies * columns).zip(&transitions.runs);
        for (i, (best, runs)) in self.of_reached(b, of_states) {
            best.fill(f64::NEG_INFINITY);
            let depth = i / grid.temperature_c.len();
            let income = &income[depth * self.levels * all_rows..][..self.levels * all_rows];
            for run in runs {
                let rows = run.row..run.row + run.rows;
                let best = &mut best[run.row % energies * columns..][..run.rows * columns];
                let cells = Cells {
                    after: &moved[run.place * columns..],
                    warmer: energies * columns,
                    deeper,
                    stride: run.stride,
                    energy: &transitions.energy[rows.clone()],
                    temperature: &transitions.temperature[rows.clone()],
                    depth: &transitions.depth[depth * all_rows..][rows.clone()],
                };
                match (columns, deeper) {
                    (1, 0) => cells.best::<false>(&income[rows], best),
                    (1, _) => cells.best::<true>(&income[rows], best),
                    _ => {
                        let income = |level: usize| &income[level * all_rows..][rows.clone()];
                        let cycled_kwh = &transitions.cycled_kwh[rows.clone()];
                        cells.best_of_columns(income, cycled_kwh, self.shadow_eur, best);
                    }
                }
            }
        }
    }

    /// Powers chosen in order, before the level of the price is known, which every value after a block takes as known.
    fn followed(&self, values: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let (problem, shadows) = (self.problem, self.shadow_eur.len());
        let columns = self.levels * shadows;
        let size = values.len() / (problem.blocks.len() + 1);
        let mut now = problem.start;
        let mut cycled_kwh = vec![0.0; problem.allowed_kwh.len()];
        let mut power_kw = Vec::with_capacity(problem.blocks.len());
        let mut after = vec![0.0; columns];
        for (b, block) in problem.blocks.iter().enumerate() {
            let left_kwh = (self.allowed_kwh[block.period] - cycled_kwh[block.period]).max(0.0);
            let share = &problem.share[b * self.levels..][..self.levels];
            let here = &values[b * size..][..size];
            let later = &values[(b + 1) * size..][..size];
            let dual = |s: usize| {
                self.at(&now, |state| expected(share, &here[state * columns..][..columns], s, shadows))
                    + worth(self.shadow_eur[s], left_kwh)
            };
            let s = first_least((0..shadows).map(dual));
            let mut best: Option<(f64, f64, f64, StoreState)> = None;
            for p in 0..self.store.grid.power_kw.len() {
                let flows = self.transitions(b).between(&self.store.grid, &now, p);
                let settled =
                    self.store.grid.settle(&flows, now.energy_kwh, now.depth, self.transitions(b).hours);
                if settled.cycled_kwh > left_kwh + ROUNDING_KWH {
                    continue;
                }
                let mut end = settled.after;
                end.temperature_c += self.warmer_k(b);
                let value = earned(&settled.amounts, self.income(b, self.levels))
                    - problem.wear_eur(now.depth, settled.drawn)
                    + self.at(&end, |state| {
                        self.after(b, &later[state * columns..][..columns], &mut after);
                        expected(share, &after, s, shadows)
                    })
                    - settled.cycled_kwh * self.shadow_eur[s];
                if best.as_ref().is_none_or(|best| value > best.0) {
                    best = Some((value, flows.request_kw, settled.cycled_kwh, end));
                }
            }
            let (_, request_kw, cycled, end) = best.unwrap_or((0.0, 0.0, 0.0, now));
            power_kw.push(request_kw);
            cycled_kwh[block.period] += cycled;
            now = end;
        }
        (power_kw, cycled_kwh)
    }

    /// Interpolates a value of the grid points at a state.
    fn at(&self, state: &StoreState, mut of: impl FnMut(usize) -> f64) -> f64 {
        let grid = &self.store.grid;
        let (energies, temperatures) = (grid.energy_kwh.len(), grid.temperature_c.len());
        let (e, energy) = around(&grid.energy_kwh, state.energy_kwh);
        let (t, temperature) = around(&grid.temperature_c, state.temperature_c);
        let (d, depth) = around(&grid.depth, state.depth);
        let below = (d * temperatures + t) * energies + e;
        let places = [0, 1, energies, energies + 1];
        let mut value = 0.0;
        let deeper = temperatures * energies;
        for (deeper, share) in [(0, 1.0 - depth), (deeper, depth)].into_iter().take(grid.depth.len().min(2)) {
            for (weight, place) in weights(energy, temperature).into_iter().zip(places) {
                value += weight * share * of(below + place + deeper);
            }
        }
        value
    }
}

/// Grid cells that contain the end states of a run of rows, and the position of each end state in its cell.
struct Cells<'a> {
    /// Values from the lower corner of the first cell on.
    after: &'a [f64],
    /// Distance to the values of the next temperature, and of the next depth.
    warmer: usize,
    deeper: usize,
    /// As in [`Run`](transitions::Run).
    stride: usize,
    energy: &'a [f64],
    temperature: &'a [f64],
    depth: &'a [f64],
}

impl Cells<'_> {
    /// Compares the values of all rows, with one value at each grid point, with the best so far.
    #[inline(always)]
    fn best<const DEPTHS: bool>(&self, income: &[f64], best: &mut [f64]) {
        let n = best.len();
        let (energy, temperature, depth) = (&self.energy[..n], &self.temperature[..n], &self.depth[..n]);
        let income = &income[..n];
        let from = |at: usize| &self.after[at..][..(n - 1) * self.stride + 2];
        let (cool, warm) = (from(0), from(self.warmer));
        let (cool_deep, warm_deep) =
            if DEPTHS { (from(self.deeper), from(self.deeper + self.warmer)) } else { (cool, warm) };
        // Written as loops: a closure would not be compiled for the wider instructions.
        if self.stride == 0 {
            let [cool, warm, cool_deep, warm_deep] =
                [cool, warm, cool_deep, warm_deep].map(|values| (values[0], values[1]));
            for i in 0..n {
                let (e, t) = (energy[i], temperature[i]);
                let mut value = between(e, t, cool, warm);
                if DEPTHS {
                    value = mix(depth[i], value, between(e, t, cool_deep, warm_deep));
                }
                best[i] = best[i].max(value + income[i]);
            }
            return;
        }
        let [cool_up, warm_up, cool_deep_up, warm_deep_up] =
            [cool, warm, cool_deep, warm_deep].map(|values| &values[1..=n]);
        let [cool, warm, cool_deep, warm_deep] =
            [cool, warm, cool_deep, warm_deep].map(|values| &values[..n]);
        for i in 0..n {
            let (e, t) = (energy[i], temperature[i]);
            let mut value = between(e, t, (cool[i], cool_up[i]), (warm[i], warm_up[i]));
            if DEPTHS {
                let (cool, warm) = ((cool_deep[i], cool_deep_up[i]), (warm_deep[i], warm_deep_up[i]));
                value = mix(depth[i], value, between(e, t, cool, warm));
            }
            best[i] = best[i].max(value + income[i]);
        }
    }

    /// The same with values `(L, S)` at each grid point.
    #[inline(always)]
    fn best_of_columns<'i>(
        &self,
        income: impl Fn(usize) -> &'i [f64],
        cycled_kwh: &[f64],
        shadow_eur: &[f64],
        best: &mut [f64],
    ) {
        let (shadows, columns) = (shadow_eur.len(), best.len() / cycled_kwh.len());
        for level in 0..columns / shadows {
            let income = income(level);
            for (i, best) in best.chunks_exact_mut(columns).enumerate() {
                let best = &mut best[level * shadows..][..shadows];
                let (e, t, d) = (self.energy[i], self.temperature[i], self.depth[i]);
                let at = i * self.stride * columns + level * shadows;
                let from = |at: usize| &self.after[at..][..shadows];
                let corners = |at: usize| {
                    let (cool, warm) = (from(at), from(at + self.warmer));
                    (cool, from(at + columns), warm, from(at + self.warmer + columns))
                };
                let (cool, cool_up, warm, warm_up) = corners(at);
                let (cool_deep, cool_deep_up, warm_deep, warm_deep_up) = corners(at + self.deeper);
                for (s, shadow) in shadow_eur.iter().enumerate() {
                    let mut value = between(e, t, (cool[s], cool_up[s]), (warm[s], warm_up[s]));
                    if self.deeper > 0 {
                        let (cool, warm) = ((cool_deep[s], cool_deep_up[s]), (warm_deep[s], warm_deep_up[s]));
                        value = mix(d, value, between(e, t, cool, warm));
                    }
                    best[s] = best[s].max(value + (income[i] - cycled_kwh[i] * shadow));
                }
            }
        }
    }
}

/// Bilinear value in a cell, of which the lower and upper value in energy are given at its lower and upper temperature.
#[inline(always)]
fn between(energy: f64, temperature: f64, cool: (f64, f64), warm: (f64, f64)) -> f64 {
    mix(energy, mix(temperature, cool.0, warm.0), mix(temperature, cool.1, warm.1))
}

#[inline(always)]
fn mix(share: f64, low: f64, high: f64) -> f64 {
    low + share * (high - low)
}

/// Value of the remaining throughput at its shadow price. Zero without a price, even if the throughput is unlimited.
fn worth(shadow_eur: f64, left_kwh: f64) -> f64 {
    if shadow_eur == 0.0 {
        0.0
    } else {
        shadow_eur * left_kwh
    }
}

#[inline]
fn earned(amounts: &[f64; 4], eur: &[f64; 4]) -> f64 {
    amounts[0] * eur[0] + amounts[1] * eur[1] + amounts[2] * eur[2] + amounts[3] * eur[3]
}

/// Expectation over the levels of values `(L, S)` at shadow price `s`.
fn expected(share: &[f64], values: &[f64], s: usize, shadows: usize) -> f64 {
    share.iter().zip(values.iter().skip(s).step_by(shadows)).map(|(p, value)| p * value).sum()
}

/// Position of the least value, the first of equal ones.
fn first_least(values: impl Iterator<Item = f64>) -> usize {
    let mut least = (0, f64::INFINITY);
    for (i, value) in values.enumerate() {
        if value < least.1 {
            least = (i, value);
        }
    }
    least.0
}

//! The dynamic program at given shadow prices: a backward pass for the value function, and a forward pass for the powers.

#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::ops::Range;

use bess_tables::widest;

use super::bellman::Cells;
use super::transitions::{weights, StoreState, Transitions};
use super::{DispatchProblem, Store};

/// Cycled energy of an idle plant due to rounding [kWh].
const ROUNDING_KWH: f64 = 1e-6;
/// Rounding of interpolated temperatures [K].
const ROUNDING_K: f64 = 1e-9;

/// One backward and one forward pass at given shadow prices.
///
/// Values have the order (level, shadow price, depth, temperature, energy).
pub(super) struct DynamicProgram<'a> {
    store: &'a Store,
    problem: &'a DispatchProblem,
    levels: usize,
    shadow_eur: &'a [f64],
    allowed_kwh: &'a [f64],
    /// Wear cost of each transition from each depth `(D, rows)`, by the number of steps; empty if there is none.
    wear_eur: BTreeMap<usize, Vec<f64>>,
    /// Temperatures of the grid before each block and at the end `(B + 1,)` on which the powers depend; those of later blocks
    /// include those of earlier ones.
    reachable_rows: Vec<Range<usize>>,
}

impl<'a> DynamicProgram<'a> {
    pub fn new(
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
        let reachable_rows = reachable_temperatures(store, problem);
        Self { store, problem, levels, shadow_eur, allowed_kwh, wear_eur, reachable_rows }
    }

    /// Power of each block, and cycled energy of each period.
    pub fn solve(&self) -> (Vec<f64>, Vec<f64>) {
        self.forward_pass(&self.value_function())
    }

    fn transitions(&self, b: usize) -> &'a Transitions {
        self.store.of(&self.problem.blocks[b])
    }

    /// Income of a level in a block; the level after the last is the expected price.
    fn income(&self, b: usize, level: usize) -> &[f64; 4] {
        &self.problem.income_eur[b * (self.levels + 1) + level]
    }

    /// Values of the states before the first block and after each block `(B + 1, L, S, states)`.
    fn value_function(&self) -> Vec<f64> {
        let (grid, n_blocks) = (&self.store.grid, self.problem.blocks.len());
        let size = self.levels * self.shadow_eur.len() * grid.n_states();
        let mut values = vec![0.0; (n_blocks + 1) * size];
        for (value, energy_kwh) in values[n_blocks * size..].iter_mut().zip(grid.energy_kwh.iter().cycle()) {
            *value = self.problem.end_eur_kwh * energy_kwh;
        }
        let (mut income, mut moved) = (Vec::new(), vec![0.0; size]);
        for b in (0..n_blocks).rev() {
            let (before, later) = values[b * size..].split_at_mut(size);
            let mut after = &later[..size];
            if self.ambient_shift_k(b) != 0.0 {
                self.at_ambient(b, after, &mut moved);
                after = &moved;
            }
            bellman_step(self, b, after, &mut income, before);
            if b > 0 {
                self.expect(b, before);
            }
        }
        values
    }

    /// Whether a block has other transitions or incomes than the next one.
    fn differs_from_next(&self, b: usize) -> bool {
        if b + 1 == self.problem.blocks.len() {
            return true;
        }
        let here = |b: usize| &self.problem.income_eur[b * (self.levels + 1)..][..self.levels];
        self.problem.blocks[b].steps != self.problem.blocks[b + 1].steps || here(b) != here(b + 1)
    }

    /// Turns values before a block into those after the block before it: the expectation over the level. Before another
    /// period, at the shadow price with the minimum dual value, an upper bound.
    fn expect(&self, b: usize, values: &mut [f64]) {
        let (problem, states) = (self.problem, self.store.grid.n_states());
        let of_level = self.shadow_eur.len() * states;
        let (last, next) = (&problem.blocks[b - 1], &problem.blocks[b]);
        if next.period != last.period {
            let allowed_kwh = self.allowed_kwh[next.period];
            for values in values.chunks_exact_mut(of_level) {
                for state in 0..states {
                    let bounds = values[state..].iter().step_by(states).zip(self.shadow_eur);
                    let least = bounds.map(|(value, shadow)| value + budget_value(*shadow, allowed_kwh));
                    let least = least.fold(f64::INFINITY, f64::min);
                    values[state..].iter_mut().step_by(states).for_each(|value| *value = least);
                }
            }
        }
        if next.is_new && self.levels > 1 {
            let known = values.to_vec();
            let energies = self.store.grid.energy_kwh.len();
            let chances = problem.chance.chunks_exact(self.levels);
            for (values, chances) in values.chunks_exact_mut(of_level).zip(chances) {
                for (_, (row, out)) in self.reachable(b, values.chunks_exact_mut(energies).enumerate()) {
                    out.fill(0.0);
                    for (known, chance) in known.chunks_exact(of_level).zip(chances) {
                        for (out, known) in out.iter_mut().zip(&known[row * energies..]) {
                            *out += chance * known;
                        }
                    }
                }
            }
        }
    }

    /// Values at the temperatures that a block reaches in its ambient temperature instead of that of the transitions.
    fn at_ambient(&self, b: usize, after: &[f64], moved: &mut [f64]) {
        let grid = &self.store.grid;
        let ambient_shift_k = self.ambient_shift_k(b);
        let row = grid.energy_kwh.len();
        let depths = row * grid.temperature_c.len();
        for t in self.reachable_rows[b + 1].clone() {
            let (low, share) = grid.temperature_c.locate(grid.temperature_c[t] + ambient_shift_k);
            for (after, moved) in after.chunks_exact(depths).zip(moved.chunks_exact_mut(depths)) {
                let (cool, warm) = after[low * row..][..2 * row].split_at(row);
                for ((out, cool), warm) in moved[t * row..][..row].iter_mut().zip(cool).zip(warm) {
                    *out = (1.0 - share) * cool + share * warm;
                }
            }
        }
    }

    fn ambient_shift_k(&self, b: usize) -> f64 {
        self.store.ambient_shift_k(&self.problem.blocks[b])
    }

    /// Those of the items of each temperature `(.., K)` at which the temperature is reachable before block `b`.
    fn reachable<T>(&self, b: usize, items: impl Iterator<Item = T>) -> impl Iterator<Item = (usize, T)> {
        let (rows, temperatures) = (self.reachable_rows[b].clone(), self.store.grid.temperature_c.len());
        items.enumerate().filter(move |(i, _)| rows.contains(&(i % temperatures)))
    }

    /// Income of each transition from each depth at each level `(D, L, rows)`, without the shadow price.
    #[inline(always)]
    fn transition_income(&self, b: usize, income: &mut Vec<f64>) {
        let wear_eur = &self.wear_eur[&self.problem.blocks[b].steps];
        let (transitions, energies) = (self.transitions(b), self.store.grid.energy_kwh.len());
        let n = transitions.flows.len();
        income.resize(self.store.grid.depth.len() * self.levels * n, 0.0);
        // The income of a block is kept for blocks before it, which reach no other temperature.
        let Range { start, end } = self.reachable_rows[b];
        let powers = self.store.grid.power_kw.len();
        for (rows, income) in income.chunks_exact_mut(n).enumerate() {
            let eur = self.income(b, rows % self.levels);
            for power in start * powers..end * powers {
                let has_some = &transitions.has_some[power];
                let from = power * energies;
                let income = &mut income[from..][..energies];
                income.fill(0.0);
                for ((amount, eur), some) in transitions.amounts.iter().zip(eur).zip(has_some) {
                    // In most rows several amounts are zero and need not be added.
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

    /// Chooses the powers in order. The price level of a block is unknown when its power is chosen, but known afterwards.
    fn forward_pass(&self, values: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let (problem, shadows) = (self.problem, self.shadow_eur.len());
        let (states, size) = (self.store.grid.n_states(), values.len() / (problem.blocks.len() + 1));
        let mut now = problem.start;
        let mut cycled_kwh = vec![0.0; problem.allowed_kwh.len()];
        let mut power_kw = Vec::with_capacity(problem.blocks.len());
        for (b, block) in problem.blocks.iter().enumerate() {
            let left_kwh = (self.allowed_kwh[block.period] - cycled_kwh[block.period]).max(0.0);
            let share = &problem.share[b * self.levels..][..self.levels];
            let after = &values[(b + 1) * size..][..size];
            let mut best: Option<(f64, f64, f64, StoreState)> = None;
            for p in 0..self.store.grid.power_kw.len() {
                let flows = self.transitions(b).between(&self.store.grid, &now, p);
                let settled =
                    self.store.grid.settle(&flows, now.energy_kwh, now.depth, self.transitions(b).hours);
                if settled.cycled_kwh > left_kwh + ROUNDING_KWH {
                    continue;
                }
                let mut end = settled.after;
                end.temperature_c += self.ambient_shift_k(b);
                // The minimum dual value after this power. With one shadow price for all powers, powers with and without a cycle
                // can be equal, and the choice arbitrary.
                let dual = |s: usize| {
                    let value = self.interpolate(&end, |state| {
                        let levels = after[s * states + state..].iter().step_by(shadows * states);
                        share.iter().zip(levels).map(|(share, value)| share * value).sum()
                    });
                    value + budget_value(self.shadow_eur[s], left_kwh - settled.cycled_kwh)
                };
                let value = income_of(&settled.amounts, self.income(b, self.levels))
                    - problem.wear_eur(now.depth, settled.drawn)
                    + (0..shadows).map(dual).fold(f64::INFINITY, f64::min);
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
    fn interpolate(&self, state: &StoreState, of: impl Fn(usize) -> f64) -> f64 {
        let grid = &self.store.grid;
        let (energies, temperatures) = (grid.energy_kwh.len(), grid.temperature_c.len());
        let (e, energy) = grid.energy_kwh.locate(state.energy_kwh);
        let (t, temperature) = grid.temperature_c.locate(state.temperature_c);
        let (d, depth) = grid.depth.locate(state.depth);
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

widest! {
    /// Values of the grid before a block: those of the best transition. Reuses the `income` of the next block if it is equal.
    fn bellman_step(program: &DynamicProgram<'_>, b: usize, moved: &[f64], income: &mut Vec<f64>, before: &mut [f64]) {
        let (grid, transitions) = (&program.store.grid, program.transitions(b));
        let (energies, temperatures) = (grid.energy_kwh.len(), grid.temperature_c.len());
        let (states, all_rows, shadows) = (grid.n_states(), transitions.flows.len(), program.shadow_eur.len());
        let of_temperature = all_rows / temperatures;
        // Income of one temperature and level less the shadow price, in a buffer that stays in the cache.
        let mut priced = vec![0.0; of_temperature];
        if program.differs_from_next(b) {
            program.transition_income(b, income);
        }
        for (i, runs) in program.reachable(b, transitions.runs.iter()) {
            let (depth, first) = (i / temperatures, i % temperatures * of_temperature);
            for column in 0..program.levels * shadows {
                let (level, shadow_eur) = (column / shadows, program.shadow_eur[column % shadows]);
                let from = (depth * program.levels + level) * all_rows + first;
                let mut income = &income[from..][..of_temperature];
                if shadow_eur != 0.0 {
                    let cycled_kwh = &transitions.cycled_kwh[first..][..of_temperature];
                    for row in 0..of_temperature {
                        priced[row] = income[row] - cycled_kwh[row] * shadow_eur;
                    }
                    income = &priced;
                }
                let after = &moved[column * states..][..states];
                let best = &mut before[column * states + i * energies..][..energies];
                best.fill(f64::NEG_INFINITY);
                for run in runs {
                    let rows = run.row..run.row + run.rows;
                    let income = &income[run.row - first..];
                    let best = &mut best[run.row % energies..][..run.rows];
                    let cells = Cells {
                        after: &after[run.place..],
                        warmer: energies,
                        deeper: temperatures * energies,
                        stride: run.stride,
                        energy: &transitions.energy[rows.clone()],
                        temperature: &transitions.temperature[rows.clone()],
                        depth: &transitions.depth[depth * all_rows..][rows],
                    };
                    // With one depth only, the depth does not change.
                    if grid.depth.len() > 1 {
                        cells.maximise::<true>(income, best);
                    } else {
                        cells.maximise::<false>(income, best);
                    }
                }
            }
        }
    }
}

/// Temperatures of the grid on which the powers depend, see [`DynamicProgram::reachable_rows`].
///
/// A temperature is a mean of the ends of rows. Values there, and at these ends, are read between two points of the grid.
fn reachable_temperatures(store: &Store, problem: &DispatchProblem) -> Vec<Range<usize>> {
    let points = &store.grid.temperature_c;
    let below = |temperature_c: f64| points.locate(temperature_c).0;
    let first = below(problem.start.temperature_c);
    let mut rows = first..first + 2;
    let mut all = vec![rows.clone()];
    for block in &problem.blocks {
        let ends_c = &store.of(block).ends_c[rows.clone()];
        let lowest_c = ends_c.iter().fold(f64::INFINITY, |low, end| low.min(end.0));
        let highest_c = ends_c.iter().fold(f64::NEG_INFINITY, |high, end| high.max(end.1));
        let (lowest, highest) = (below(lowest_c - ROUNDING_K), below(highest_c + ROUNDING_K) + 1);
        rows = rows.start.min(lowest)..rows.end.max(highest + 1);
        // In the ambient temperature of the transitions, no interpolation is needed.
        let shift_k = store.ambient_shift_k(block);
        if shift_k != 0.0 {
            let [cool, warm] = [points[lowest] - ROUNDING_K, points[highest] + ROUNDING_K];
            rows = rows.start.min(below(cool + shift_k))..rows.end.max(below(warm + shift_k) + 2);
        }
        all.push(rows.clone());
    }
    all
}

/// Value of the remaining throughput at its shadow price. Zero without a price, even if the throughput is unlimited.
fn budget_value(shadow_eur: f64, left_kwh: f64) -> f64 {
    if shadow_eur == 0.0 {
        0.0
    } else {
        shadow_eur * left_kwh
    }
}

#[inline]
fn income_of(amounts: &[f64; 4], eur: &[f64; 4]) -> f64 {
    amounts[0] * eur[0] + amounts[1] * eur[1] + amounts[2] * eur[2] + amounts[3] * eur[3]
}

//! Moves of a pair of strings in one step, or in one step and back in a later one, ranked by their predicted gain: the cost of
//! the step plus the co-states of later steps. Only moves with a predicted gain are rolled out.

use crate::plan::pair::{Pair, Room};
use crate::plan::paths::Path;

/// Uniform cells over the range of the first string's request.
const CELLS: usize = 12;
/// Cells with a compensating move in a later step: the ends, the middle, the quarters.
const EXCHANGED: [usize; 5] = [0, CELLS / 4, CELLS / 2, 3 * CELLS / 4, CELLS];
/// Maximum number of exchanges rolled out at each step, by predicted gain.
const MAX_TRIALS: usize = 3;
/// Minimum predicted gain, as a share of the cost of the plan.
const MIN_RELATIVE_GAIN: f64 = 1e-6;
/// Distance from an end, as a share of the cell, within which an exchange switches an inverter off.
const SWITCH_OFF_DISTANCE: f64 = 0.4;

/// A request of the first string in one step, with the remainder in the second: change of the cost of both strings, without
/// the value of their charge, and of their SOC.
#[derive(Debug, Clone, Copy, Default)]
struct Choice {
    first_w: f64,
    cost: f64,
    soc: (f64, f64),
}

/// The choices of a pair at one step, ascending in the request of the first string.
#[derive(Debug, Clone, Copy, Default)]
struct Fork {
    room: Room,
    choices: [Choice; CELLS + 1],
}

/// The schedules of a pair, and the choices at each step of it.
struct Sweep<'s, 'p, 'a> {
    pair: &'s mut Pair<'p, 'a>,
    forks: Vec<Fork>,
}

/// An exchange between two steps with a predicted gain.
#[derive(Debug, Clone, Copy)]
struct Exchange {
    promise: f64,
    /// Part of the gain in the later step.
    to_come: f64,
    first_w: f64,
    later: usize,
    later_first_w: f64,
}

/// One pass over all steps of a plan of this cost.
pub(crate) fn sweep(pair: &mut Pair<'_, '_>, cost: f64) {
    let least = MIN_RELATIVE_GAIN * cost;
    pair.renew_if_changed();
    let n_steps = pair.n_steps();
    let mut sweep = Sweep { pair, forks: vec![] };
    sweep.forks = (0..n_steps).map(|t| sweep.fork(t)).collect();
    let mut stale = false;
    for t in 0..n_steps {
        if sweep.pair.is_spent() {
            return;
        }
        if !sweep.forks[t].room.is_open() {
            continue;
        }
        if stale {
            sweep.forks[t] = sweep.fork(t);
        }
        stale |= sweep.improve(t, least);
    }
}

impl Sweep<'_, '_, '_> {
    /// The choices at a step from the present states.
    fn fork(&mut self, t: usize) -> Fork {
        let room = self.pair.room(t);
        let mut fork = Fork { room, ..Fork::default() };
        if !room.is_open() {
            return fork;
        }
        self.pair.work += 2 * (CELLS as u64 + 1);
        let (first, second) = (&*self.pair.first, &*self.pair.second);
        let (by_first, by_second) = (first.choices(t), second.choices(t));
        let (a_next, b_next) = (first.points[t + 1], second.points[t + 1]);
        for (k, choice) in fork.choices.iter_mut().enumerate() {
            let (u, v) = room.both(room.low_w + (room.high_w - room.low_w) * k as f64 / CELLS as f64);
            let (p, q) = (by_first(u), by_second(v));
            let warmer = first.by_temperature[t + 1] * (p.state.temperature_c - a_next.state.temperature_c)
                + second.by_temperature[t + 1] * (q.state.temperature_c - b_next.state.temperature_c);
            *choice = Choice {
                first_w: u,
                cost: p.cost - a_next.cost + q.cost - b_next.cost + warmer,
                soc: (p.state.soc - a_next.state.soc, q.state.soc - b_next.state.soc),
            };
        }
        fork
    }

    /// Expected cost of a choice, with the value of its charge after step `t`: until then an exchange holds it.
    #[inline]
    fn promise(&self, t: usize, choice: &Choice) -> f64 {
        let (by_first, by_second) = (self.pair.first.by_soc[t + 1], self.pair.second.by_soc[t + 1]);
        choice.cost + by_first * choice.soc.0 + by_second * choice.soc.1
    }

    /// Applies the best move with a predicted gain at a step; returns whether there was one.
    fn improve(&mut self, t: usize, least: f64) -> bool {
        let fork = self.forks[t];
        let here_w = self.pair.first.request_w[t];
        let before = self.pair.cost();
        let mut best = (before, Vec::new());
        let promise = |choice: &Choice| self.promise(t, choice);
        let single = fork.choices.iter().min_by(|x, y| promise(x).total_cmp(&promise(y))).expect("cells");
        if promise(single) < -least {
            // Co-states are valid for small changes: if the full move fails, a half or a quarter may succeed.
            let mut first_w = single.first_w;
            for _ in 0..3 {
                self.attempt(t, vec![fork.room.both(first_w)], 0.0, &mut best);
                first_w = 0.5 * (first_w + here_w);
            }
        }
        for exchange in self.exchanges(t, least).into_iter().flatten() {
            let mut change: Vec<_> = (t..=exchange.later).map(|s| self.pair.requests(s)).collect();
            change[0] = fork.room.both(exchange.first_w);
            change[exchange.later - t] = self.forks[exchange.later].room.both(exchange.later_first_w);
            self.attempt(t, change, exchange.to_come, &mut best);
        }
        let (cost, change) = best;
        if cost >= before {
            return false;
        }
        self.pair.take(t, &change);
        if change.len() > 1 {
            self.pair.renew(t + 1);
            let later = t + change.len() - 1;
            self.forks[later] = self.fork(later);
        }
        true
    }

    fn attempt(
        &mut self,
        t: usize,
        change: Vec<(f64, f64)>,
        to_come: f64,
        best: &mut (f64, Vec<(f64, f64)>),
    ) {
        let cost = self.pair.cost_with(t, &change, to_come, best.0);
        if cost < best.0 - 1e-12 * best.0.abs() {
            *best = (cost, change);
        }
    }

    /// The best predicted exchanges of a step with later steps, with opposite changes of the first string.
    fn exchanges(&self, t: usize, least: f64) -> [Option<Exchange>; MAX_TRIALS] {
        let mut found = [None; MAX_TRIALS];
        // Between the two steps, both SOCs are shifted by the exchange.
        let within = |path: &Path<'_>, later: usize, shift: f64| {
            let (low, high) = path.problem.model.strings()[path.string].soc_window();
            (low - 1e-9..=high + 1e-9).contains(&(path.points[later].state.soc + shift))
        };
        for cell in EXCHANGED {
            let choice = &self.forks[t].choices[cell];
            if choice.soc.0.abs() < 1e-5 {
                continue;
            }
            for later in t + 1..self.forks.len() {
                if !within(self.pair.first, later, choice.soc.0)
                    || !within(self.pair.second, later, choice.soc.1)
                {
                    break;
                }
                let Some(back) = self.forks[later].where_soc_changes_by(-choice.soc.0) else { continue };
                let to_come = self.promise(later, &back);
                let promise = self.promise(later, choice) + to_come;
                if promise < -least {
                    let (first_w, later_first_w) = (choice.first_w, back.first_w);
                    keep(&mut found, Exchange { promise, to_come, first_w, later, later_first_w });
                }
            }
        }
        found
    }
}

/// Keeps the best predicted moves, in order.
fn keep(found: &mut [Option<Exchange>; MAX_TRIALS], mut exchange: Exchange) {
    for place in found {
        match place {
            Some(held) if held.promise <= exchange.promise => (),
            Some(held) => std::mem::swap(held, &mut exchange),
            None => {
                *place = Some(exchange);
                return;
            }
        }
    }
}

impl Fork {
    /// The interpolated choice with this change of the first string's SOC.
    #[inline]
    fn where_soc_changes_by(&self, change: f64) -> Option<Choice> {
        if !self.room.is_open() {
            return None;
        }
        let (low, high) = (self.choices[0].soc.0, self.choices[CELLS].soc.0);
        let share = (change - low) / (high - low);
        if !(-0.05..=1.05).contains(&share) {
            return None;
        }
        let place = (share * CELLS as f64).clamp(0.0, CELLS as f64);
        let cell = (place as usize).min(CELLS - 1);
        let mut part = place - cell as f64;
        if cell == 0 && part < SWITCH_OFF_DISTANCE {
            part = 0.0;
        } else if cell == CELLS - 1 && part > 1.0 - SWITCH_OFF_DISTANCE {
            part = 1.0;
        }
        let (x, y) = (&self.choices[cell], &self.choices[cell + 1]);
        let mix = |p: f64, q: f64| p + part * (q - p);
        Some(Choice {
            first_w: mix(x.first_w, y.first_w),
            cost: mix(x.cost, y.cost),
            soc: (mix(x.soc.0, y.soc.0), mix(x.soc.1, y.soc.1)),
        })
    }
}

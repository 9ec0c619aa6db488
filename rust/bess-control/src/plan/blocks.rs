//! Moves of a pair of strings over a block of steps.

use crate::plan::pair::{Pair, Room};
use crate::plan::paths::Paths;

/// Lengths of blocks [steps], used in turn from call to call.
pub(crate) const LENGTHS: [usize; 5] = [2, 4, 8, 16, 32];

/// Change of a block.
#[derive(Debug, Clone, Copy)]
enum Change {
    /// The strings exchange their requests.
    Swap,
    /// The first string takes its maximum.
    First,
    /// The second string takes its maximum.
    Second,
    /// Each string takes half.
    Halves,
}

impl Change {
    const ALL: [Self; 4] = [Self::Swap, Self::First, Self::Second, Self::Halves];

    fn of(self, room: &Room, second_w: f64) -> (f64, f64) {
        room.both(match self {
            Self::Swap => second_w,
            Self::First => room.high_w,
            Self::Second => room.low_w,
            Self::Halves => 0.5 * room.sum_w,
        })
    }
}

/// Tries all changes on each block in turn; the first block starts at `offset`.
pub(crate) fn rearrange(paths: &mut Paths<'_>, pair: Pair, length: usize, offset: usize, budget: u64) {
    let n_steps = paths.problem.n_steps();
    let mut slopes = pair.slopes(paths);
    for from in (offset % length..n_steps).step_by(length) {
        let to = (from + length).min(n_steps);
        if !(from..to).any(|t| pair.room(paths, t).is_open()) {
            continue;
        }
        for kind in Change::ALL {
            if paths.work >= budget {
                return;
            }
            let change: Vec<_> =
                (from..to).map(|t| kind.of(&pair.room(paths, t), paths.request(pair.second, t))).collect();
            let present =
                |k: usize| (paths.request(pair.first, from + k), paths.request(pair.second, from + k));
            if change.iter().enumerate().all(|(k, both)| *both == present(k)) {
                paths.work += 2 * (n_steps - from) as u64; // counts as a roll-out to the end
                continue;
            }
            let before = pair.cost(paths);
            if pair.cost_with(paths, &slopes, from, &change, f64::NEG_INFINITY, before)
                < before - 1e-12 * before.abs()
            {
                pair.take(paths, from, &change);
                pair.renew(&mut slopes, paths, from);
            }
        }
    }
}

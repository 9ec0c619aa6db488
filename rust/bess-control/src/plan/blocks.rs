//! Moves of a pair of strings over a block of steps.

use crate::plan::pair::{Pair, Room};
use crate::plan::paths::Paths;

/// Lengths of blocks [steps], used in turn from call to call.
pub(crate) const LENGTHS: [usize; 5] = [2, 4, 8, 16, 32];

/// Changes of a block: new requests of the first string, from the range of the pair and the request of the second.
const CHANGES: [fn(&Room, f64) -> f64; 4] = [
    |_, second_w| second_w,     // The strings exchange their requests,
    |room, _| room.high_w,      // the first takes its maximum,
    |room, _| room.low_w,       // the second does,
    |room, _| 0.5 * room.sum_w, // or each takes half.
];

/// Tries all changes on each block in turn; the first block starts at `offset`.
pub(crate) fn rearrange(paths: &mut Paths<'_>, pair: Pair, length: usize, offset: usize, budget: u64) {
    let n_steps = paths.problem.n_steps();
    let mut slopes = pair.slopes(paths);
    for from in (offset % length..n_steps).step_by(length) {
        let to = (from + length).min(n_steps);
        if !(from..to).any(|t| pair.room(paths, t).is_open()) {
            continue;
        }
        for first_w in CHANGES {
            if paths.work >= budget {
                return;
            }
            let both = |t: usize| {
                let room = pair.room(paths, t);
                room.both(first_w(&room, paths.request(pair.second, t)))
            };
            let change: Vec<_> = (from..to).map(both).collect();
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

//! Moves of a pair of strings over a block of steps.

use crate::plan::pair::{Pair, Room};

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
pub(crate) fn rearrange(pair: &mut Pair<'_, '_>, length: usize, offset: usize) {
    let n_steps = pair.n_steps();
    pair.renew_if_changed();
    for from in (offset % length..n_steps).step_by(length) {
        let block = from..(from + length).min(n_steps);
        if !block.clone().any(|t| pair.room(t).is_open()) {
            continue;
        }
        for first_w in CHANGES {
            if pair.is_spent() {
                return;
            }
            let both = |t: usize| {
                let room = pair.room(t);
                room.both(first_w(&room, pair.second.request_w[t]))
            };
            let change: Vec<_> = block.clone().map(both).collect();
            if block.clone().map(|t| pair.requests(t)).eq(change.iter().copied()) {
                pair.work += 2 * (n_steps - from) as u64; // counts as a roll-out to the end
                continue;
            }
            let before = pair.cost();
            if pair.cost_with(from, &change, f64::NEG_INFINITY, before) < before - 1e-12 * before.abs() {
                pair.take(from, &change);
                pair.renew(from);
            }
        }
    }
}

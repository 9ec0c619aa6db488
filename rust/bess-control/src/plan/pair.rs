//! Two strings that exchange power: range of requests of the first string at a constant sum.

use crate::plan::paths::{CoStates, Paths};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Pair {
    pub first: usize,
    pub second: usize,
}

/// Feasible range of a pair in one step; powers of its first string [W].
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Room {
    pub sum_w: f64,
    pub low_w: f64,
    pub high_w: f64,
}

impl Room {
    /// Range for two requests with a constant sum.
    #[inline]
    fn of(sum_w: f64, first_limit_w: f64, second_limit_w: f64) -> Self {
        let high_w = first_limit_w.min(sum_w);
        // If both strings are at their limits, the ends are equal except for rounding.
        Self { sum_w, low_w: (sum_w - second_limit_w).max(0.0).min(high_w), high_w }
    }

    /// Whether the strings can exchange power.
    pub fn is_open(&self) -> bool {
        self.high_w - self.low_w > 1e-6 * self.sum_w
    }

    /// Requests of both strings for a first request within the range.
    #[inline]
    pub fn both(&self, first_w: f64) -> (f64, f64) {
        let first = first_w.clamp(self.low_w, self.high_w);
        (first, (self.sum_w - first).max(0.0))
    }
}

impl Pair {
    pub fn strings(&self) -> [usize; 2] {
        [self.first, self.second]
    }

    pub fn room(&self, paths: &Paths<'_>, t: usize) -> Room {
        let sum_w = paths.request(self.first, t) + paths.request(self.second, t);
        let limits_w = paths.problem.limits_w(t);
        Room::of(sum_w, limits_w[self.first], limits_w[self.second])
    }

    pub fn cost(&self, paths: &Paths<'_>) -> f64 {
        paths.total(self.first) + paths.total(self.second)
    }

    /// Cost of both strings with other requests from step `from` on. The evaluation stops with the expected cost as soon as
    /// this is not below `most`.
    ///
    /// The co-states give the remaining cost from the present states: to first order during the roll-out, exactly at the end. As
    /// long as requests differ, `to_come` is the expected change by later requests; minus infinity if unknown.
    pub fn cost_with(
        &self,
        paths: &mut Paths<'_>,
        slopes: &(CoStates, CoStates),
        from: usize,
        change: &[(f64, f64)],
        to_come: f64,
        most: f64,
    ) -> f64 {
        let (Self { first, second }, problem) = (*self, paths.problem);
        let before = self.cost(paths);
        let (mut a, mut b) = (*paths.at(first, from), *paths.at(second, from));
        let (end, n_steps) = (from + change.len(), problem.n_steps());
        let mut t = from;
        loop {
            let (u, v) =
                if t < end { change[t - from] } else { (paths.request(first, t), paths.request(second, t)) };
            (a, b) = (problem.step(first, t, &a, u), problem.step(second, t, &b, v));
            t += 1;
            let more =
                slopes.0.change(t, paths.at(first, t), &a) + slopes.1.change(t, paths.at(second, t), &b);
            let expected = before + more + if t < end { to_come } else { 0.0 };
            if t == n_steps || expected > most {
                paths.work += 2 * (t - from) as u64;
                return expected;
            }
        }
    }

    pub fn slopes(&self, paths: &mut Paths<'_>) -> (CoStates, CoStates) {
        (CoStates::along(paths, self.first), CoStates::along(paths, self.second))
    }

    /// Co-states along the present paths of both strings, from the start of step `from` on.
    pub fn renew(&self, slopes: &mut (CoStates, CoStates), paths: &mut Paths<'_>, from: usize) {
        slopes.0.renew(paths, self.first, from);
        slopes.1.renew(paths, self.second, from);
    }

    /// Replaces the requests from step `from` on.
    pub fn take(&self, paths: &mut Paths<'_>, from: usize, change: &[(f64, f64)]) {
        for (k, &(u, v)) in change.iter().enumerate() {
            paths.set(self.first, from + k, u);
            paths.set(self.second, from + k, v);
        }
        paths.roll(self.first, from);
        paths.roll(self.second, from);
    }
}

/// Pairs of one round of a round-robin schedule, which covers every pair once in [`rounds`] rounds (circle method).
pub(crate) fn tournament(n: usize, round: usize) -> impl Iterator<Item = Pair> {
    let even = n + n % 2;
    let seat = move |k: usize| if k == 0 { 0 } else { 1 + (k - 1 + round) % (even - 1).max(1) };
    (0..even / 2)
        .map(move |k| (seat(k), seat(even - 1 - k)))
        .filter(move |&(a, b)| a < n && b < n)
        .map(|(a, b)| Pair { first: a.min(b), second: a.max(b) })
}

/// Rounds of a round-robin schedule.
pub(crate) fn rounds(n: usize) -> usize {
    (n + n % 2).saturating_sub(1).max(1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_pair_at_its_limits_has_no_room_and_keeps_its_sum(
            first in 1e3..1e6f64, second in 1e3..1e6f64, scale in 0.999..1.001f64, share in -0.1..1.1f64,
        ) {
            let sum = (scale * (first + second)).min(first + second);
            for sum in [sum, first + second] {
                let room = Room::of(sum, first, second);
                prop_assert!(room.low_w <= room.high_w);
                let (u, v) = room.both(share * sum);
                prop_assert!(u <= first && v <= second * (1.0 + 1e-12));
                prop_assert!((u + v - sum).abs() <= 1e-9 * sum);
            }
        }
    }

    #[test]
    fn everybody_meets_everybody_else_once() {
        for n in 2..=9 {
            let mut met: Vec<_> =
                (0..rounds(n)).flat_map(|r| tournament(n, r)).map(|p| (p.first, p.second)).collect();
            met.sort_unstable();
            let all: Vec<_> = (0..n).flat_map(|a| (a + 1..n).map(move |b| (a, b))).collect();
            assert_eq!(met, all, "{n} strings");
        }
        assert_eq!(tournament(1, 0).count(), 0);
    }
}

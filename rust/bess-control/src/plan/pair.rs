//! Two strings that exchange power: range of requests of the first string at a constant sum.

use crate::plan::paths::Path;

/// The schedules of two strings, and the work on them, in steps of single strings.
pub(crate) struct Pair<'p, 'a> {
    pub first: &'p mut Path<'a>,
    pub second: &'p mut Path<'a>,
    pub work: u64,
    pub budget: u64,
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
    pub fn of(sum_w: f64, first_limit_w: f64, second_limit_w: f64) -> Self {
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

impl Pair<'_, '_> {
    pub fn n_steps(&self) -> usize {
        self.first.request_w.len()
    }

    pub fn is_spent(&self) -> bool {
        self.work >= self.budget
    }

    /// Requests of both strings in a step.
    #[inline]
    pub fn requests(&self, t: usize) -> (f64, f64) {
        (self.first.request_w[t], self.second.request_w[t])
    }

    pub fn room(&self, t: usize) -> Room {
        let limits_w = self.first.problem.limits_w(t);
        let (u, v) = self.requests(t);
        Room::of(u + v, limits_w[self.first.string], limits_w[self.second.string])
    }

    pub fn cost(&self) -> f64 {
        self.first.total + self.second.total
    }

    /// Cost of both strings with other requests from step `from` on. The evaluation stops with the expected cost as soon as
    /// this exceeds `most`.
    ///
    /// The co-states give the remaining cost from the present states: to first order during the roll-out, exactly at the end. As
    /// long as requests differ, `to_come` is the expected change by later requests; minus infinity if unknown.
    pub fn cost_with(&mut self, from: usize, change: &[(f64, f64)], to_come: f64, most: f64) -> f64 {
        let before = self.cost();
        let (mut a, mut b) = (self.first.points[from], self.second.points[from]);
        let (end, n_steps) = (from + change.len(), self.n_steps());
        let mut t = from;
        loop {
            let (u, v) = if t < end { change[t - from] } else { self.requests(t) };
            (a, b) = (self.first.step(t, &a, u), self.second.step(t, &b, v));
            t += 1;
            let more = self.first.change(t, &a) + self.second.change(t, &b);
            let expected = before + more + if t < end { to_come } else { 0.0 };
            if t == n_steps || expected > most {
                self.work += 2 * (t - from) as u64;
                return expected;
            }
        }
    }

    /// Renews the co-states of both schedules; they count as work in any case.
    pub fn renew_if_changed(&mut self) {
        self.first.renew_if_changed();
        self.second.renew_if_changed();
        self.work += 4 * self.n_steps() as u64;
    }

    /// Co-states of both schedules from the start of step `from` on.
    pub fn renew(&mut self, from: usize) {
        self.first.renew(from);
        self.second.renew(from);
        self.work += 4 * (self.n_steps() - from) as u64;
    }

    /// Replaces the requests from step `from` on.
    pub fn take(&mut self, from: usize, change: &[(f64, f64)]) {
        for (k, &both) in change.iter().enumerate() {
            (self.first.request_w[from + k], self.second.request_w[from + k]) = both;
        }
        self.first.roll(from);
        self.second.roll(from);
        self.work += 2 * (self.n_steps() - from) as u64;
    }
}

/// Pairs of one round of a round-robin schedule, which covers every pair once in [`rounds`] rounds (circle method).
pub(crate) fn round_robin(n: usize, round: usize) -> impl Iterator<Item = (usize, usize)> {
    let even = n + n % 2;
    let seat = move |k: usize| if k == 0 { 0 } else { 1 + (k - 1 + round) % (even - 1).max(1) };
    (0..even / 2)
        .map(move |k| (seat(k), seat(even - 1 - k)))
        .filter(move |&(a, b)| a < n && b < n)
        .map(|(a, b)| (a.min(b), a.max(b)))
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
        fn a_pair_at_its_limits_cannot_exchange_power_and_keeps_its_sum(
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
    fn every_pair_meets_once() {
        for n in 2..=9 {
            let mut met: Vec<_> = (0..rounds(n)).flat_map(|r| round_robin(n, r)).collect();
            met.sort_unstable();
            let all: Vec<_> = (0..n).flat_map(|a| (a + 1..n).map(move |b| (a, b))).collect();
            assert_eq!(met, all, "{n} strings");
        }
        assert_eq!(round_robin(1, 0).count(), 0);
    }
}

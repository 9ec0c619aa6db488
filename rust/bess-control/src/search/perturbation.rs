//! Perturbations: schedules far from a given one, which a descent cannot reach with moves of one or two steps.

use super::incumbent::Schedule;
use crate::model::{ControlHorizon, Flow};

/// Minimum difference of exchanged powers, as a share of the largest limit.
const ALIKE: f64 = 1e-3;
/// Maximum number of pairs of strings whose exchanges are drawn from.
const MOST_PAIRS: usize = 512;

impl ControlHorizon {
    /// Two strings exchange their requests from one step onwards; the pairs are neighbours in the order of
    /// total requests.
    ///
    /// Which of two strings is used first is a decision for the whole horizon: schedules with exchanged strings
    /// are all far from each other. Of more than `most` of them, every second, third, ... is returned.
    pub(crate) fn with_strings_swapped(&self, request_w: &[f64], most: usize) -> Vec<Schedule> {
        let (n_strings, n_steps) = (self.n_strings(), self.n_steps());
        let total = |m: usize| request_w[m * n_steps..(m + 1) * n_steps].iter().sum::<f64>();
        let mut order: Vec<usize> = (0..n_strings).collect();
        order.sort_by(|&a, &b| total(b).total_cmp(&total(a)));
        let n_swaps = (n_strings - 1) * n_steps;
        let swap = |index: usize| {
            let (pair, from) = (index / n_steps, index % n_steps);
            let swapped_w = self.swapped(request_w, (order[pair], order[pair + 1]), from..n_steps);
            self.rated(self.fitted(&swapped_w))
        };
        self.map((0..n_swaps).step_by(n_swaps.div_ceil(most).max(1)).collect(), swap)
    }

    /// A string exchanges its delivered powers of two steps; at most `most` exchanges, drawn at random.
    ///
    /// A string that is full or empty for part of the horizon delivers about the same energy in different steps:
    /// distant schedules have almost equal availability loss, and no descent connects them. The undelivered request of a
    /// full or empty string goes to the others.
    pub(crate) fn with_steps_exchanged(
        &self,
        request_w: &[f64],
        flows: &[Flow],
        random: &mut fastrand::Rng,
        most: usize,
    ) -> Vec<Schedule> {
        let (n_strings, n_steps) = (self.n_strings(), self.n_steps());
        let several = |t: usize| (0..n_strings).filter(|&m| self.limit(m, t) > 0.0).count() > 1;
        let largest_w = self.limit_w.iter().copied().fold(0.0, f64::max);
        let delivered = |m: usize, t: usize| flows[m * n_steps + t].delivered_w;
        let mut exchanges = vec![];
        for m in 0..n_strings {
            for first in (0..n_steps).filter(|&t| several(t)) {
                for second in (first + 1..n_steps).filter(|&t| several(t)) {
                    if (delivered(m, first) - delivered(m, second)).abs() > ALIKE * largest_w {
                        exchanges.push((m, first, second));
                    }
                }
            }
        }
        random.shuffle(&mut exchanges);
        exchanges.truncate(most);
        let exchanged = |(m, first, second): (usize, usize, usize)| {
            let mut row: Vec<f64> = (0..n_steps).map(|t| delivered(m, t)).collect();
            row.swap(first, second);
            let others: Vec<usize> = (0..n_strings).filter(|&other| other != m).collect();
            let mut out = vec![0.0; request_w.len()];
            for (t, &wanted) in row.iter().enumerate() {
                let demand_w = self.demand_w[t];
                let room: f64 = others.iter().map(|&other| self.limit(other, t)).sum();
                let most_w = self.limit(m, t).min(demand_w);
                let taken = wanted.max(demand_w - room).clamp(0.0, most_w);
                out[m * n_steps + t] = taken;
                self.share_out(
                    t,
                    &others,
                    demand_w - taken,
                    |other| request_w[other * n_steps + t],
                    &mut out,
                );
            }
            self.rated(out)
        };
        exchanges.into_iter().map(exchanged).collect()
    }

    /// Random schedules: each step is allocated at random, nearly equally, or to one string; in every second
    /// schedule all steps have the same shares.
    pub(crate) fn at_random(&self, random: &mut fastrand::Rng, alike: bool) -> Schedule {
        let (n_strings, n_steps) = (self.n_strings(), self.n_steps());
        let mut wanted = vec![0.0; n_strings * n_steps];
        let mut shares = self.random_shares(random);
        for t in 0..n_steps {
            if !alike {
                shares = self.random_shares(random);
            }
            for (m, share) in shares.iter().enumerate() {
                wanted[m * n_steps + t] = share * self.limit(m, t);
            }
        }
        self.rated(self.fitted(&wanted))
    }

    /// Shares of the strings in one step: one of several random patterns.
    fn random_shares(&self, random: &mut fastrand::Rng) -> Vec<f64> {
        let n = self.n_strings();
        let (n_on, exponent) = (random.usize(1..=n), random.choice([0.0, 0.3, 1.0]).expect("three of them"));
        let mut shares: Vec<f64> =
            (0..n).map(|m| if m < n_on { random.f64().powf(exponent) } else { 0.0 }).collect();
        random.shuffle(&mut shares);
        shares
    }

    /// Two strings exchange their requests between two steps; at most `most` exchanges, drawn at random.
    pub(crate) fn with_windows_swapped(
        &self,
        request_w: &[f64],
        random: &mut fastrand::Rng,
        most: usize,
    ) -> Vec<Schedule> {
        let (n_strings, n_steps) = (self.n_strings(), self.n_steps());
        let mut pairs: Vec<_> =
            (0..n_strings).flat_map(|i| (i + 1..n_strings).map(move |j| (i, j))).collect();
        if pairs.len() > MOST_PAIRS {
            random.shuffle(&mut pairs);
            pairs.truncate(MOST_PAIRS);
        }
        let windows = |(i, j)| (0..n_steps).flat_map(move |a| (a + 1..=n_steps).map(move |b| (i, j, a, b)));
        let mut swaps: Vec<_> = pairs.into_iter().flat_map(windows).collect();
        random.shuffle(&mut swaps);
        let swapped = |(i, j, a, b): (usize, usize, usize, usize)| {
            let swapped_w = self.swapped(request_w, (i, j), a..b);
            (swapped_w != request_w).then(|| self.rated(self.fitted(&swapped_w)))
        };
        swaps.into_iter().filter_map(swapped).take(most).collect()
    }

    /// Requests with those of two strings in some steps exchanged.
    fn swapped(&self, request_w: &[f64], (i, j): (usize, usize), steps: std::ops::Range<usize>) -> Vec<f64> {
        let mut swapped_w = request_w.to_vec();
        steps.for_each(|t| swapped_w.swap(i * self.n_steps() + t, j * self.n_steps() + t));
        swapped_w
    }

    /// `n` schedules, each with a random allocation of one step.
    pub(crate) fn with_a_step_shared_anew(
        &self,
        request_w: &[f64],
        random: &mut fastrand::Rng,
        n: usize,
    ) -> Vec<Schedule> {
        let n_steps = self.n_steps();
        let shared = |_| {
            let (t, shares) = (random.usize(..n_steps), self.random_shares(random));
            let mut wanted = request_w.to_vec();
            for (m, share) in shares.iter().enumerate() {
                wanted[m * n_steps + t] = share * self.limit(m, t);
            }
            self.rated(self.fitted(&wanted))
        };
        (0..n).map(shared).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::StringState;

    fn totals(horizon: &ControlHorizon, request_w: &[f64]) -> Vec<f64> {
        let n_steps = horizon.n_steps();
        (0..n_steps).map(|t| (0..horizon.n_strings()).map(|m| request_w[m * n_steps + t]).sum()).collect()
    }

    fn flow(delivered_w: f64) -> Flow {
        Flow {
            delivered_w,
            availability_w: 0.0,
            derating_w: 0.0,
            inverter_w: 0.0,
            battery_w: 0.0,
            current_a: 0.0,
            end: StringState { soc: 0.5, temperature_c: 25.0 },
        }
    }

    /// Two strings of 92 kW with this total demand.
    fn horizon(demand_w: &[f64]) -> ControlHorizon {
        crate::search::common::one_objective(2, demand_w)
    }

    const DEMAND_W: [f64; 4] = [30e3, 90e3, 80e3, 60e3];
    const REQUEST_W: [f64; 8] = [0.0, 60e3, 5e3, 2e3, 30e3, 30e3, 75e3, 58e3];
    const DELIVERED_W: [f64; 8] = [0.0, 55e3, 1e3, 1e3, 10e3, 1e3, 1e3, 1e3];

    #[test]
    fn a_string_does_in_one_step_what_it_did_in_another_and_the_other_takes_the_rest() {
        let horizon = horizon(&DEMAND_W);
        let flows: Vec<Flow> = DELIVERED_W.map(flow).to_vec();
        let mut random = fastrand::Rng::with_seed(1);
        let found = horizon.with_steps_exchanged(&REQUEST_W, &flows, &mut random, 100);
        // Steps 2 and 3 of the first string are alike, steps 1, 2 and 3 of the second: 5 + 3 pairs are left.
        assert_eq!(found.len(), 8);
        let rows: Vec<&[f64]> = found.iter().map(|s| &s.request_w[..4]).collect();
        assert!(rows.contains(&&[0.0, 1e3, 55e3, 1e3][..]));
        assert!(rows.contains(&&[0.0, 1e3, 1e3, 55e3][..]));
        for schedule in &found {
            assert_eq!(schedule.objectives, horizon.objectives(&schedule.request_w));
            for (total, demand) in totals(&horizon, &schedule.request_w).iter().zip(DEMAND_W) {
                assert!((total - demand).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn a_swap_exchanges_two_strings_from_every_step_on() {
        let horizon = horizon(&DEMAND_W);
        let found = horizon.with_strings_swapped(&REQUEST_W, 100);
        assert_eq!(found.len(), 4);
        assert_eq!(found[0].request_w[..4], REQUEST_W[4..]);
        assert_eq!(found[2].request_w[..4], [0.0, 60e3, 75e3, 58e3]);
        assert_eq!(horizon.with_strings_swapped(&REQUEST_W, 2).len(), 2);
    }

    #[test]
    fn windows_are_swapped_once_each_and_nothing_that_stays_as_it_is() {
        let horizon = horizon(&DEMAND_W);
        let mut random = fastrand::Rng::with_seed(1);
        let mut found = horizon.with_windows_swapped(&REQUEST_W, &mut random, 100);
        assert_eq!(found.len(), 10);
        assert!(found.iter().any(|s| s.request_w[..4] == [0.0, 30e3, 75e3, 2e3]));
        found.retain(|s| s.request_w == REQUEST_W);
        assert!(found.is_empty());
    }

    #[test]
    fn a_step_shared_anew_leaves_the_others_and_meets_the_demand() {
        let horizon = horizon(&DEMAND_W);
        let mut random = fastrand::Rng::with_seed(1);
        let found = horizon.with_a_step_shared_anew(&REQUEST_W, &mut random, 20);
        assert_eq!(found.len(), 20);
        for schedule in &found {
            let changed = (0..4).filter(|&t| (schedule.request_w[t] - REQUEST_W[t]).abs() > 1e-6).count();
            assert!(changed <= 1);
            for (total, demand) in totals(&horizon, &schedule.request_w).iter().zip(DEMAND_W) {
                assert!((total - demand).abs() < 1e-6);
            }
        }
    }
}

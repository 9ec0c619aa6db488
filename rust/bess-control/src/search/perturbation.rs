//! Perturbations: schedules far from a given one, which a descent cannot reach with moves of one or two steps.

use super::incumbent::Schedule;
use crate::model::{ControlHorizon, Flow};

/// Minimum difference of exchanged powers, as a share of the largest limit.
const MIN_POWER_DIFFERENCE: f64 = 1e-3;

impl ControlHorizon {
    /// Two strings exchange their requests between two steps; the pairs are neighbours in the order of total requests. Of more
    /// than `most` of them, every second, third, ... is returned.
    ///
    /// The order in which two strings are used affects many steps: schedules with exchanged strings are far from each other.
    pub(crate) fn with_strings_swapped(&self, request_w: &[f64], most: usize) -> Vec<Schedule> {
        let (n_strings, n_steps) = (self.n_strings(), self.n_steps());
        let total = |m: usize| request_w[m * n_steps..(m + 1) * n_steps].iter().sum::<f64>();
        let mut order: Vec<usize> = (0..n_strings).collect();
        order.sort_by(|&a, &b| total(b).total_cmp(&total(a)));
        let windows: Vec<_> =
            (1..=n_steps).rev().flat_map(|end| (0..end).map(move |from| from..end)).collect();
        let n_swaps = windows.len() * (n_strings - 1);
        let swapped = |index: usize| {
            let (window, pair) = (windows[index / (n_strings - 1)].clone(), index % (n_strings - 1));
            let mut swapped_w = request_w.to_vec();
            window.for_each(|t| swapped_w.swap(order[pair] * n_steps + t, order[pair + 1] * n_steps + t));
            self.rated(self.fitted(&swapped_w))
        };
        self.map((0..n_swaps).step_by(n_swaps.div_ceil(most).max(1)).collect(), swapped)
    }

    /// A string exchanges its delivered powers of two steps; of more than `most` exchanges, every second, third, ...
    ///
    /// A string that is full or empty for part of the horizon delivers about the same energy in different steps:
    /// distant schedules have almost equal availability loss, and no descent connects them. The undelivered request of a
    /// full or empty string goes to the others.
    pub(crate) fn with_steps_exchanged(
        &self,
        request_w: &[f64],
        flows: &[Flow],
        most: usize,
    ) -> Vec<Schedule> {
        let (n_strings, n_steps) = (self.n_strings(), self.n_steps());
        let several = |t: usize| (0..n_strings).filter(|&m| self.limit(m, t) > 0.0).count() > 1;
        let max_w = self.limit_w.iter().copied().fold(0.0, f64::max);
        let delivered = |m: usize, t: usize| flows[m * n_steps + t].delivered_w;
        let mut exchanges = vec![];
        for m in 0..n_strings {
            for first in (0..n_steps).filter(|&t| several(t)) {
                for second in (first + 1..n_steps).filter(|&t| several(t)) {
                    if (delivered(m, first) - delivered(m, second)).abs() > MIN_POWER_DIFFERENCE * max_w {
                        exchanges.push((m, first, second));
                    }
                }
            }
        }
        let exchanged = |(m, first, second): (usize, usize, usize)| {
            let mut row: Vec<f64> = (0..n_steps).map(|t| delivered(m, t)).collect();
            row.swap(first, second);
            let others: Vec<usize> = (0..n_strings).filter(|&other| other != m).collect();
            let mut out = vec![0.0; request_w.len()];
            for (t, &wanted) in row.iter().enumerate() {
                let demand_w = self.demand_w[t];
                let room: f64 = others.iter().map(|&other| self.limit(other, t)).sum();
                let max_w = self.limit(m, t).min(demand_w);
                let taken = wanted.max(demand_w - room).clamp(0.0, max_w);
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
        let every = exchanges.len().div_ceil(most).max(1);
        self.map(exchanges.into_iter().step_by(every).collect(), exchanged)
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
        crate::tests::common::one_objective(2, demand_w)
    }

    const DEMAND_W: [f64; 4] = [30e3, 90e3, 80e3, 60e3];
    const REQUEST_W: [f64; 8] = [0.0, 60e3, 5e3, 2e3, 30e3, 30e3, 75e3, 58e3];
    const DELIVERED_W: [f64; 8] = [0.0, 55e3, 1e3, 1e3, 10e3, 1e3, 1e3, 1e3];

    #[test]
    fn an_exchange_of_two_steps_leaves_the_rest_to_the_other_string() {
        let horizon = horizon(&DEMAND_W);
        let flows: Vec<Flow> = DELIVERED_W.map(flow).to_vec();
        let found = horizon.with_steps_exchanged(&REQUEST_W, &flows, 100);
        // Steps 2 and 3 of the first string are equal, as are steps 1, 2 and 3 of the second: 5 + 3 pairs remain.
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
    fn a_swap_exchanges_two_strings_between_any_two_steps() {
        let horizon = horizon(&DEMAND_W);
        let found = horizon.with_strings_swapped(&REQUEST_W, 100);
        assert_eq!(found.len(), 10);
        assert_eq!(found[0].request_w[..4], REQUEST_W[4..]);
        assert_eq!(found[2].request_w[..4], [0.0, 60e3, 75e3, 58e3]);
        assert!(found.iter().any(|s| s.request_w[..4] == [0.0, 30e3, 75e3, 2e3]));
        assert_eq!(horizon.with_strings_swapped(&REQUEST_W, 3).len(), 3);
    }
}

//! A schedule that keeps the strings level, so that none is full or empty long before the others.

use bess_tables::Direction;

use crate::horizon::ControlHorizon;

impl ControlHorizon {
    /// Requests `(M, T)` in proportion to the charge that each string can still give or take, within what it can
    /// deliver; what is left goes where the limits allow [W].
    pub(crate) fn balanced(&self) -> Vec<f64> {
        let (n_strings, n_steps) = (self.n_strings(), self.n_steps());
        let mut states = self.start.clone();
        let mut request_w = vec![0.0; n_strings * n_steps];
        for (t, interval) in self.intervals.iter().enumerate() {
            let room = |m: usize| {
                let p = &self.string(m).parameters;
                let window = match interval.direction {
                    Direction::Charge => p.soc_max - states[m].soc,
                    Direction::Discharge => states[m].soc - p.soc_min,
                };
                p.capacity_ah * window.max(0.0)
            };
            let rooms: Vec<f64> = (0..n_strings).map(room).collect();
            let caps: Vec<f64> =
                (0..n_strings).map(|m| self.edge(m, t, states[m]).min(self.limit(m, t))).collect();
            let limits: Vec<f64> = (0..n_strings).map(|m| self.limit(m, t)).collect();
            let mut shares = vec![0.0; n_strings];
            fill(&mut shares, &caps, &rooms, self.demand_w[t]);
            let rest = self.demand_w[t] - shares.iter().sum::<f64>();
            let spare: Vec<f64> = limits.iter().zip(&shares).map(|(limit, share)| limit - share).collect();
            fill(&mut shares, &limits, &spare, rest);
            for (m, state) in states.iter_mut().enumerate() {
                request_w[m * n_steps + t] = shares[m];
                *state = self.string(m).step(*state, shares[m], interval).end;
            }
        }
        request_w
    }
}

/// Adds `amount` to the shares in proportion to weights, none above its cap; as much as the caps allow.
fn fill(shares: &mut [f64], caps: &[f64], weights: &[f64], mut amount: f64) {
    for _ in 0..shares.len() {
        let open = |m: usize, shares: &[f64]| shares[m] < caps[m] && weights[m] > 0.0;
        let total: f64 = (0..shares.len()).filter(|&m| open(m, shares)).map(|m| weights[m]).sum();
        if amount <= 0.0 || total <= 0.0 {
            return;
        }
        let per_weight = amount / total;
        for m in 0..shares.len() {
            if open(m, shares) {
                let before = shares[m];
                shares[m] = (before + per_weight * weights[m]).min(caps[m]);
                amount -= shares[m] - before;
            }
        }
    }
}

//! Requests in given proportions that meet the demand within the limits.

use super::horizon::ControlHorizon;

impl ControlHorizon {
    /// Requests `(M, T)` [W] in the proportions of `weight` `(M, T)`, `>= 0` in any unit, that meet the
    /// demand within the limits: power above the limit of a string goes to the others in proportion to their
    /// headroom. A step without weights is allocated in proportion to the limits.
    pub fn fitted(&self, weight: &[f64]) -> Vec<f64> {
        let mut request_w = vec![0.0; weight.len()];
        let strings: Vec<usize> = (0..self.n_strings()).collect();
        for t in 0..self.n_steps() {
            self.share_out(t, &strings, self.demand_w[t], |m| weight[m * self.n_steps() + t], &mut request_w);
        }
        request_w
    }

    /// Makes all requests of a step zero or at least the minimum power of their inverters.
    pub(crate) fn set_points(&self, t: usize, request_w: &mut [f64]) {
        let mut step_w: Vec<f64> = request_w.iter().skip(t).step_by(self.n_steps()).copied().collect();
        self.model.set_points(&mut step_w, &self.limits(t));
        for (request, power_w) in request_w.iter_mut().skip(t).step_by(self.n_steps()).zip(step_w) {
            *request = power_w;
        }
    }

    /// Allocates `power_w` to some strings in one step, as [`Self::fitted`] does.
    pub(crate) fn share_out(
        &self,
        t: usize,
        strings: &[usize],
        power_w: f64,
        weight: impl Fn(usize) -> f64,
        request_w: &mut [f64],
    ) {
        let n_steps = self.n_steps();
        let total: f64 = strings.iter().map(|&m| weight(m)).sum();
        let share = |m: usize| if total > 0.0 { weight(m) } else { self.limit(m, t) };
        let sum: f64 = strings.iter().map(|&m| share(m)).sum();
        let per_share = if sum > 0.0 { power_w / sum } else { 0.0 };
        for &m in strings {
            request_w[m * n_steps + t] = (share(m) * per_share).min(self.limit(m, t));
        }
        let allocated: f64 = strings.iter().map(|&m| request_w[m * n_steps + t]).sum();
        let headroom: f64 = strings.iter().map(|&m| self.limit(m, t) - request_w[m * n_steps + t]).sum();
        let filled = if headroom > 0.0 { (power_w - allocated) / headroom } else { 0.0 };
        for &m in strings {
            let request = &mut request_w[m * n_steps + t];
            *request = (*request + filled * (self.limit(m, t) - *request)).clamp(0.0, self.limit(m, t));
        }
        self.set_points(t, request_w);
    }
}

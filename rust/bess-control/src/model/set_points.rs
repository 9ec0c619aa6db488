//! Set-points: every request is 0 or at least the minimum power of its inverter.

use super::control_model::ControlModel;
use super::horizon::ControlHorizon;

/// Relative rounding remainder of a power.
const ROUNDING: f64 = 1e-12;

impl ControlModel {
    /// Requests `(M,)` [W] (magnitudes) of one step, each 0 or at least the minimum power of its inverter. Smaller
    /// requests are moved to strings that are on, or combined in one string if they are large enough. They are dropped only if
    /// neither is possible.
    pub fn set_points(&self, request_w: &mut [f64], limit_w: &[f64]) {
        let min_w = |m: usize| self.strings()[m].min_power_w();
        let below = |m: usize, power_w: f64| power_w > 0.0 && power_w < min_w(m);
        if !request_w.iter().enumerate().any(|(m, &power_w)| below(m, power_w)) {
            return;
        }
        let total_w: f64 = request_w.iter().sum();
        let mut waiting: Vec<(usize, f64)> = Vec::new();
        for (m, power_w) in request_w.iter_mut().enumerate() {
            if *power_w < min_w(m) {
                waiting.push((m, *power_w));
                *power_w = 0.0;
            }
        }
        let mut left_w: f64 = waiting.iter().map(|(_, power_w)| power_w).sum();
        // The string with the largest request is switched on first, those without a request last.
        waiting.sort_by(|a, b| b.1.total_cmp(&a.1));
        let mut waiting = waiting.into_iter().map(|(m, _)| m);
        loop {
            let headroom_w: f64 =
                request_w.iter().zip(limit_w).filter(|(p, _)| **p > 0.0).map(|(p, l)| l - p).sum();
            if headroom_w > 0.0 {
                let share = (left_w / headroom_w).min(1.0);
                for (power_w, &limit_w) in request_w.iter_mut().zip(limit_w).filter(|(p, _)| **p > 0.0) {
                    *power_w += share * (limit_w - *power_w);
                }
                left_w -= share * headroom_w;
            }
            if left_w <= ROUNDING * total_w {
                return;
            }
            let Some(next) = waiting.find(|&m| limit_w[m] >= min_w(m)) else { return };
            let start_w = left_w.clamp(min_w(next), limit_w[next]);
            if start_w > left_w {
                // The others contribute the power for switching it on.
                let spare = |m: usize| if request_w[m] > 0.0 { request_w[m] - min_w(m) } else { 0.0 };
                let spare_w: Vec<f64> = (0..request_w.len()).map(spare).collect();
                let share = (start_w - left_w) / spare_w.iter().sum::<f64>();
                if share > 1.0 || share.is_nan() {
                    if (min_w(next)..=limit_w[next]).contains(&total_w) {
                        request_w.fill(0.0);
                        request_w[next] = total_w;
                        return;
                    }
                    continue;
                }
                for (power_w, spare_w) in request_w.iter_mut().zip(spare_w) {
                    *power_w -= share * spare_w;
                }
            }
            request_w[next] = start_w;
            left_w = (left_w - start_w).max(0.0);
        }
    }
}

impl ControlHorizon {
    /// Divides a sum of two requests in one step, with about `first_w` for the first string: each request is 0 or at
    /// least the minimum power, if possible.
    #[inline]
    pub(crate) fn pair(&self, t: usize, (i, j): (usize, usize), sum_w: f64, first_w: f64) -> (f64, f64) {
        let min_w = |m: usize| self.string(m).min_power_w();
        let second_w = (sum_w - first_w).max(0.0);
        if first_w > 0.0 && first_w < min_w(i) {
            return if sum_w <= self.limit(j, t) { (0.0, sum_w) } else { (min_w(i), sum_w - min_w(i)) };
        }
        if second_w > 0.0 && second_w < min_w(j) {
            return if sum_w <= self.limit(i, t) { (sum_w, 0.0) } else { (sum_w - min_w(j), min_w(j)) };
        }
        (first_w, second_w)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::common;

    const N_STRINGS: usize = 4;
    const LIMIT_W: f64 = 92e3;

    fn settled(mut request_w: [f64; N_STRINGS], limit_w: [f64; N_STRINGS]) -> [f64; N_STRINGS] {
        ControlModel::new(&common::reference(N_STRINGS)).set_points(&mut request_w, &limit_w);
        request_w
    }

    #[test]
    fn requests_below_the_minimum_power_are_moved_to_running_strings() {
        let given = settled([50e3, 0.4, 0.0, 0.5], [LIMIT_W; N_STRINGS]);
        assert_eq!(given, [50e3 + 0.9, 0.0, 0.0, 0.0]);
        assert_eq!(settled([5.0, 0.0, 1.0, 7.0], [LIMIT_W; N_STRINGS]), [5.0, 0.0, 1.0, 7.0]);
    }

    #[test]
    fn if_all_requests_are_below_the_minimum_power_the_largest_takes_all_or_all_are_dropped() {
        assert_eq!(settled([0.3, 0.5, 0.2, 0.4], [LIMIT_W; N_STRINGS]), [0.0, 1.4, 0.0, 0.0]);
        assert_eq!(settled([0.3, 0.3, 0.0, 0.0], [LIMIT_W; N_STRINGS]), [0.0; N_STRINGS]);
    }

    #[test]
    fn a_request_below_the_minimum_power_is_moved_to_a_string_that_it_can_switch_on() {
        let mut system = common::reference(2);
        system.strings[1].inverter.min_power_w = 170.0;
        let mut request_w = [0.0, 55.6];
        ControlModel::new(&system).set_points(&mut request_w, &[LIMIT_W; 2]);
        assert_eq!(request_w, [55.6, 0.0]);
    }

    #[test]
    fn running_strings_at_their_limits_reduce_their_power_to_start_another() {
        let given = settled([50.0, 0.25, 0.0, 0.0], [50.0, LIMIT_W, 0.0, 0.0]);
        assert_eq!(given, [49.25, 1.0, 0.0, 0.0]);
    }

    #[test]
    fn one_string_takes_a_power_that_is_too_small_for_two() {
        assert_eq!(settled([1.25, 0.5, 0.0, 0.0], [1.25, LIMIT_W, LIMIT_W, 0.0]), [0.0, 1.75, 0.0, 0.0]);
    }

    #[test]
    fn no_request_is_below_the_minimum_power_and_the_sum_is_kept() {
        let model = ControlModel::new(&common::reference(N_STRINGS));
        let mut random = fastrand::Rng::with_seed(3);
        for _ in 0..2000 {
            let mut power = || 10_f64.powf(-6.0 + 11.0 * random.f64());
            let limit_w = [0; N_STRINGS].map(|_| power().clamp(3.0, LIMIT_W));
            let mut request_w = limit_w.map(|limit| if power() < 1e-2 { 0.0 } else { power().min(limit) });
            let total_w: f64 = request_w.iter().sum();
            model.set_points(&mut request_w, &limit_w);
            assert!(request_w.iter().all(|&power_w| power_w == 0.0 || power_w >= 1.0), "{request_w:?}");
            assert!(request_w
                .iter()
                .zip(limit_w)
                .all(|(&power_w, limit_w)| power_w <= limit_w * (1.0 + 1e-12)));
            let missing_w = total_w - request_w.iter().sum::<f64>();
            assert!(missing_w.abs() < 1e-9 * total_w || total_w < 1.0, "{missing_w} of {total_w}");
        }
    }
}

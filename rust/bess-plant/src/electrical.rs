//! One string at one instant: inverter, Rint battery and their limits.
//!
//! Signs: power and current positive in discharge. The battery supplies the AC power `p` and the inverter loss `w`:
//! `V I - R I^2 = p + w`. This file is the scalar form with every limit; the block evaluates the same balance
//! for several strings at once if no limit is active.

use bess_tables::units::SECONDS_PER_HOUR;
use bess_tables::{Direction, StringParameters};

use crate::record::Limits;

#[derive(Debug, Clone, Copy)]
pub(crate) struct Demand {
    pub(crate) direction: Direction,
    /// AC power after derating, magnitude, 0 or at least the minimum power of the inverter [W].
    pub(crate) wanted_w: f64,
    pub(crate) reactive_var: f64,
    pub(crate) soc: f64,
    /// Open-circuit voltage of each direction [V].
    pub(crate) charge_v: f64,
    pub(crate) discharge_v: f64,
    pub(crate) step_s: f64,
    pub(crate) capacity_ah: f64,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct OperatingPoint {
    /// Delivered AC power, magnitude [W].
    pub(crate) delivered_w: f64,
    /// Inverter loss that the battery or the AC side covers while on [W].
    pub(crate) loss_w: f64,
    /// String current [A], positive in discharge.
    pub(crate) current_a: f64,
    /// SOC at the end of the step.
    pub(crate) soc: f64,
    pub(crate) limits: Limits,
}

/// Small root of `V I - R I^2 = P`, in the form that also holds for `R -> 0`. Needs `V^2 >= 4 R P`.
#[inline]
pub(crate) fn rint_current(voltage_v: f64, resistance_ohm: f64, power_w: f64) -> f64 {
    let discriminant = voltage_v * voltage_v - 4.0 * resistance_ohm * power_w;
    2.0 * power_w / (voltage_v + discriminant.max(0.0).sqrt())
}

impl Demand {
    /// Current if nothing limits it.
    fn unlimited(&self, delivered_w: f64, loss_w: f64, resistance_ohm: f64) -> f64 {
        let power_w = self.direction.pick(loss_w - delivered_w, delivered_w + loss_w);
        // When charging with less than the inverter loss, the battery supplies the difference.
        let voltage_v = if power_w > 0.0 { self.discharge_v } else { self.charge_v };
        rint_current(voltage_v, resistance_ohm, power_w)
    }

    /// The operation with the largest delivered power, not above `wanted_w`, that stays within the SOC window at
    /// the end of the step and within the voltage limits, and has a real current.
    pub(crate) fn operating_point(&self, string: &StringParameters, resistance_ohm: f64) -> OperatingPoint {
        let mut limits = Limits::NONE;
        let loss = string.inverter.loss(self.direction);
        let mut delivered_w = self.wanted_w;
        if delivered_w > 0.0 {
            let (target_w, binding) = self.battery_limit(string, resistance_ohm);
            let net = |p: f64| p + self.direction.sign() * loss.at(self.apparent_va(p));
            if net(delivered_w) > target_w {
                limits = binding;
                delivered_w = largest_below(loss.x(), self.reactive_var, net, target_w, delivered_w);
            }
            if self.direction == Direction::Charge && self.empties(string, delivered_w, resistance_ohm) {
                limits = Limits::SOC_EMPTY;
                delivered_w = 0.0;
            }
            if delivered_w < string.inverter.min_power_w {
                delivered_w = 0.0;
            }
        }
        let loss_w = if delivered_w > 0.0 { loss.at(self.apparent_va(delivered_w)) } else { 0.0 };
        let current_a = self.unlimited(delivered_w, loss_w, resistance_ohm);
        // Only rounding is clipped: the power was solved for the window.
        let soc = self.soc_after(current_a).clamp(string.soc_min, string.soc_max);
        OperatingPoint { delivered_w, loss_w, current_a, soc, limits }
    }

    /// Apparent power, exactly the active power where there is no reactive power.
    fn apparent_va(&self, active_w: f64) -> f64 {
        (active_w * active_w + self.reactive_var * self.reactive_var).sqrt()
    }

    fn soc_after(&self, current_a: f64) -> f64 {
        self.soc - current_a * self.step_s / (SECONDS_PER_HOUR * self.capacity_ah)
    }

    /// Largest battery power (magnitude, in the direction of the demand) [W], and the limit that sets it.
    fn battery_limit(&self, string: &StringParameters, resistance_ohm: f64) -> (f64, Limits) {
        let per_soc_a = SECONDS_PER_HOUR * self.capacity_ah / self.step_s;
        let limit =
            |ocv_v: f64| (string.voltage_current_a(self.direction, ocv_v, resistance_ohm), Limits::VOLTAGE);
        let least = |a: (f64, Limits), b: (f64, Limits)| if b.0 < a.0 { b } else { a };
        match self.direction {
            Direction::Charge => {
                let headroom = ((string.soc_max - self.soc) * per_soc_a, Limits::SOC_FULL);
                let (current_a, limits) = least(headroom, limit(self.charge_v));
                (self.charge_v * current_a + resistance_ohm * current_a * current_a, limits)
            }
            Direction::Discharge => {
                let headroom = ((self.soc - string.soc_min) * per_soc_a, Limits::SOC_EMPTY);
                let root = (self.discharge_v / (2.0 * resistance_ohm), Limits::ROOT);
                let (current_a, limits) = least(least(root, headroom), limit(self.discharge_v));
                (self.discharge_v * current_a - resistance_ohm * current_a * current_a, limits)
            }
        }
    }

    fn empties(&self, string: &StringParameters, delivered_w: f64, resistance_ohm: f64) -> bool {
        let loss_w = string.inverter.loss(self.direction).at(self.apparent_va(delivered_w));
        let current_a = self.unlimited(delivered_w, loss_w, resistance_ohm);
        current_a > 0.0 && self.soc_after(current_a) < string.soc_min
    }
}

/// Bisections after which a power between two knots is exact to rounding.
const HALVINGS: usize = 60;

/// Largest `p` in `[0, start]` with `net(p) <= target`, for a `net` above the target at `start`; 0 where there is none.
/// `net` is linear in `p` between knots of apparent power without reactive power, and smooth with.
fn largest_below(knots: &[f64], reactive: f64, net: impl Fn(f64) -> f64, target: f64, start: f64) -> f64 {
    let (mut high, mut net_high) = (start, net(start));
    for &knot in knots.iter().rev() {
        let low = if reactive > 0.0 { (knot * knot - reactive * reactive).max(0.0).sqrt() } else { knot };
        if low >= start {
            continue;
        }
        let net_low = net(low);
        if net_low <= target {
            if reactive > 0.0 {
                let mut holds = low;
                for _ in 0..HALVINGS {
                    let middle = 0.5 * (holds + high);
                    if net(middle) <= target {
                        holds = middle;
                    } else {
                        high = middle;
                    }
                }
                return holds;
            }
            let share = (target - net_low) / (net_high - net_low);
            return (low + share * (high - low)).clamp(low, high);
        }
        (high, net_high) = (low, net_low);
    }
    0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_root_tends_to_p_over_v_for_small_resistance_and_to_half_the_short_circuit_current() {
        assert_eq!(rint_current(700.0, 0.0, 70e3), 100.0);
        assert!((rint_current(700.0, 1e-12, 70e3) - 100.0).abs() < 1e-9);
        let (v, r) = (700.0, 0.12);
        let top = rint_current(v, r, v * v / (4.0 * r));
        assert!((top - v / (2.0 * r)).abs() < 1e-4 * top);
        for power in [-90e3, -1.0, 0.0, 1.0, 90e3] {
            let i = rint_current(v, r, power);
            assert!((v * i - r * i * i - power).abs() <= 1e-10, "{power}");
        }
    }

    #[test]
    fn the_inverse_of_the_inverter_finds_the_largest_power_below_a_target() {
        let net = |p: f64| p + 10.0 + if p > 50.0 { 0.2 * (p - 50.0) } else { 0.0 };
        let knots = [0.0, 50.0, 100.0];
        assert!((largest_below(&knots, 0.0, net, 40.0, 100.0) - 30.0).abs() < 1e-12);
        assert!((largest_below(&knots, 0.0, net, 84.0, 100.0) - 70.0).abs() < 1e-12);
        assert_eq!(largest_below(&knots, 0.0, net, 9.0, 100.0), 0.0);
    }
}

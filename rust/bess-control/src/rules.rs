//! Rules: the demand of one step allocated without forecast, in closed loop and as starts of plans.

use std::sync::Arc;

use bess_tables::units::W_PER_KW;
use bess_tables::{Direction, InputError, System};

use crate::error::check_length;
use crate::explicit::Measured;
use crate::model::ControlModel;

/// Rule for the power of a step without forecast. The first four are the policies of these names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rule {
    /// Equal power in every string.
    Equal,
    /// In proportion to stored charge or headroom.
    Soc,
    /// In proportion to nominal power and the distance from the temperature of full derating.
    Temperature,
    /// Strings in fixed order.
    Priority,
    /// Strings in rotating order, with another first string in every step.
    Rotation,
}

impl Rule {
    /// All rules.
    pub const ALL: [Self; 5] = [Self::Equal, Self::Soc, Self::Temperature, Self::Priority, Self::Rotation];

    /// Powers of `total` within `caps`, in any unit. `usable` (stored energy or headroom, by direction) and `margin`
    /// (nominal power times the distance from full derating) are the weights of a string; rotation begins with `first`.
    /// Power above all caps is added within the `limits`, if it exceeds a share `tolerance` of the total.
    pub(crate) fn allocate(
        self,
        total: f64,
        (caps, limits): (&[f64], &[f64]),
        usable: impl Fn(usize) -> f64,
        margin: impl Fn(usize) -> f64,
        first: usize,
        tolerance: f64,
    ) -> Vec<f64> {
        let n = caps.len();
        let mut power = match self {
            Self::Priority => fill_in_order(total, caps, 0, tolerance),
            Self::Rotation => fill_in_order(total, caps, first, tolerance),
            Self::Equal => water_fill(total, &vec![1.0; n], caps),
            Self::Soc => water_fill(total, &(0..n).map(usable).collect::<Vec<_>>(), caps),
            Self::Temperature => water_fill(total, &(0..n).map(margin).collect::<Vec<_>>(), caps),
        };
        let rest = total - power.iter().sum::<f64>();
        if rest > tolerance * total {
            let free: Vec<f64> = limits.iter().zip(&power).map(|(l, p)| (l - p).max(0.0)).collect();
            for ((power, more), limit) in power.iter_mut().zip(water_fill(rest, &free, &free)).zip(limits) {
                *power = (*power + more).min(*limit);
            }
        }
        power
    }
}

/// Fills the strings in order, starting with `first`; a rest below `tolerance` of the total switches no string on.
fn fill_in_order(total: f64, caps: &[f64], first: usize, tolerance: f64) -> Vec<f64> {
    let n = caps.len();
    let (mut power, mut before) = (vec![0.0; n], 0.0);
    for m in (0..n).map(|k| (first + k) % n) {
        let rest = total - before;
        if rest <= tolerance * total {
            break;
        }
        power[m] = rest.min(caps[m]);
        before += caps[m];
    }
    power
}

/// Allocates `total`, in any unit, in proportion to weights; power above a cap goes to the others. Strings without weight get power
/// only if all others are at their caps.
pub fn water_fill(total: f64, weights: &[f64], caps: &[f64]) -> Vec<f64> {
    let n = caps.len();
    let mut power = vec![0.0; n];
    let mut open: Vec<bool> = caps.iter().map(|&cap| cap > 0.0).collect();
    let mut rest = total;
    while rest > 0.0 && open.contains(&true) {
        let among = |values: &[f64]| -> Vec<f64> {
            values.iter().zip(&open).map(|(&v, &o)| if o { v } else { 0.0 }).collect()
        };
        let mut share = among(weights);
        if share.iter().sum::<f64>() <= 0.0 {
            share = among(caps);
        }
        let whole: f64 = share.iter().sum();
        let wanted: Vec<f64> = (0..n).map(|m| power[m] + rest * (share[m] / whole)).collect();
        let over: Vec<bool> = (0..n).map(|m| open[m] && wanted[m] >= caps[m]).collect();
        if !over.contains(&true) {
            return wanted;
        }
        for m in 0..n {
            if over[m] {
                power[m] = caps[m];
                open[m] = false;
            }
        }
        rest = total - power.iter().sum::<f64>();
    }
    power
}

/// A rule of a plant; arrays have one value for each string.
#[derive(Debug, Clone)]
pub struct RuleLaw {
    rule: Rule,
    dt_h: f64,
    nominal_kw: Vec<f64>,
    nominal_energy_kwh: Vec<f64>,
    full_derating_c: Vec<f64>,
    system: Arc<System>,
    /// Control model of strings without ageing.
    new_model: ControlModel,
}

impl RuleLaw {
    /// A rule for control steps of `dt_h`, with nominal power [kW], energy when new [kWh] and temperature of full derating
    /// [degC] of each string.
    ///
    /// # Errors
    ///
    /// An array does not have one value for each string.
    pub fn new(
        system: Arc<System>,
        rule: Rule,
        dt_h: f64,
        nominal_kw: Vec<f64>,
        nominal_energy_kwh: Vec<f64>,
        full_derating_c: Vec<f64>,
    ) -> Result<Self, InputError> {
        let n = system.strings.len();
        check_length("nominal", &nominal_kw, n)?;
        check_length("nominal energy", &nominal_energy_kwh, n)?;
        check_length("stop", &full_derating_c, n)?;
        let new_model = ControlModel::new(&system);
        Ok(Self { rule, dt_h, nominal_kw, nominal_energy_kwh, full_derating_c, system, new_model })
    }

    /// Number of strings.
    pub fn n_strings(&self) -> usize {
        self.nominal_kw.len()
    }

    /// Set-points `(M,)` [kW], signed as the demand. Demand above the total capability is requested within the free inverter
    /// power, so that the plant records it as availability loss.
    ///
    /// # Errors
    ///
    /// Lengths do not agree, or as [`System::check_health`] and [`ControlModel::states`].
    pub fn split(&self, plant: &Measured<'_>, demand_kw: f64) -> Result<Vec<f64>, InputError> {
        let n = self.n_strings();
        let is_new = plant.soh_capacity.iter().chain(plant.soh_resistance).all(|&factor| factor == 1.0);
        let aged = if is_new {
            None
        } else {
            self.system.check_health(plant.soh_capacity, plant.soh_resistance)?;
            Some(self.new_model.aged(plant.soh_capacity, plant.soh_resistance))
        };
        let model = aged.as_ref().unwrap_or(&self.new_model);
        check_length("limit_kw", plant.limit_kw, n)?;
        check_length("soh_capacity", plant.soh_capacity, n)?;
        if demand_kw == 0.0 {
            return Ok(vec![0.0; n]);
        }
        let states = model.states(plant.soc, plant.temperature_c)?;
        let direction = Direction::of(demand_kw);
        let deliverable_w = model.deliverable_w(&states, direction, self.dt_h);
        let limits = self.nominal_kw.iter().zip(plant.limit_kw);
        let cap = |(power_w, (nominal, limit)): (f64, (&f64, &f64))| {
            (power_w / W_PER_KW).max(0.0).min(*nominal).min(*limit)
        };
        let caps_kw: Vec<f64> = deliverable_w.into_iter().zip(limits).map(cap).collect();
        let total_kw = demand_kw.abs();
        let usable = |m: usize| {
            let (low, high) = model.strings()[m].soc_window();
            let usable = direction.pick(high - plant.soc[m], plant.soc[m] - low).max(0.0);
            usable * self.nominal_energy_kwh[m] * plant.soh_capacity[m]
        };
        let margin =
            |m: usize| self.nominal_kw[m] * (self.full_derating_c[m] - plant.temperature_c[m]).max(0.0);
        let within = (caps_kw.as_slice(), plant.limit_kw);
        let mut power_kw = self.rule.allocate(total_kw, within, usable, margin, 0, 0.0);
        power_kw.iter_mut().for_each(|power| *power *= W_PER_KW);
        let limit_w: Vec<f64> = plant.limit_kw.iter().map(|limit| limit * W_PER_KW).collect();
        model.set_points(&mut power_kw, &limit_w);
        Ok(power_kw.into_iter().map(|power| (power / W_PER_KW).copysign(demand_kw)).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Water filling in closed form: the sum over strings of `min(level * weight, cap)` is the total.
    fn filled(total: f64, weights: &[f64], caps: &[f64]) -> Vec<f64> {
        let at = |level: f64| weights.iter().zip(caps).map(move |(w, c)| (level * w).min(*c));
        let full = weights.iter().zip(caps).map(|(w, c)| c / w).fold(0.0, f64::max);
        let (mut low, mut high) = (0.0, full);
        for _ in 0..200 {
            let middle = 0.5 * (low + high);
            *(if at(middle).sum::<f64>() < total { &mut low } else { &mut high }) = middle;
        }
        at(high).collect()
    }

    proptest! {
        #[test]
        fn every_rule_shares_all_that_its_limits_allow(
            strings in prop::collection::vec((0.0..100.0f64, 0.0..50.0f64, 0.01..5.0f64), 1..9),
            total in 0.0..600.0f64, first in 0..9usize,
        ) {
            let (caps, above, weights): (Vec<_>, Vec<_>, Vec<_>) = strings.into_iter().collect();
            let limits: Vec<f64> = caps.iter().zip(&above).map(|(cap, above)| cap + above).collect();
            for rule in Rule::ALL {
                let weight = |m: usize| weights[m];
                let power = rule.allocate(total, (&caps, &limits), weight, weight, first, 1e-9);
                let sum: f64 = power.iter().sum();
                prop_assert!((sum - total.min(limits.iter().sum())).abs() < 1e-6, "{:?} {:?}", rule, power);
                prop_assert!(power.iter().zip(&limits).all(|(p, limit)| *p >= 0.0 && p <= limit));
                if total <= caps.iter().sum() {
                    prop_assert!(power.iter().zip(&caps).all(|(p, cap)| *p <= cap + 1e-9));
                }
            }
        }

        #[test]
        fn power_is_in_proportion_to_weights_up_to_the_caps(
            strings in prop::collection::vec((0.0..100.0f64, 0.01..5.0f64), 1..9), part in 0.0..1.0f64,
        ) {
            let (caps, weights): (Vec<_>, Vec<_>) = strings.into_iter().collect();
            let total = part * caps.iter().sum::<f64>();
            for (power, exact) in water_fill(total, &weights, &caps).iter().zip(filled(total, &weights, &caps)) {
                prop_assert!((power - exact).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn priority_fills_one_string_after_the_other() {
        assert_eq!(fill_in_order(70.0, &[50.0, 40.0, 30.0], 0, 0.0), [50.0, 20.0, 0.0]);
        assert_eq!(fill_in_order(70.0, &[50.0, 40.0, 30.0], 2, 0.0), [40.0, 0.0, 30.0]);
        assert_eq!(fill_in_order(50.0 + 1e-9, &[50.0, 40.0, 30.0], 0, 1e-9), [50.0, 0.0, 0.0]);
    }

    #[test]
    fn a_string_without_weight_gets_only_the_power_above_the_other_caps() {
        assert_eq!(water_fill(50.0, &[1.0, 0.0], &[40.0, 40.0]), [40.0, 10.0]);
        assert_eq!(water_fill(30.0, &[1.0, 0.0], &[40.0, 40.0]), [30.0, 0.0]);
    }
}

//! Rules of the closed loop: the demand of one step allocated without forecast, in kW.

use bess_tables::{Direction, System};

use crate::error::check_length;
use crate::explicit::Measured;
use crate::model::ControlModel;
use crate::plan::{water_fill, Rule};
use crate::ControlError;

const W_PER_KW: f64 = 1e3;

/// A rule of a plant; arrays have one value for each string.
#[derive(Debug, Clone)]
pub struct RuleLaw {
    /// The rule.
    pub rule: Rule,
    /// Control step [h].
    pub dt_h: f64,
    /// Nominal power [kW].
    pub nominal_kw: Vec<f64>,
    /// Energy when new [kWh].
    pub nominal_energy_kwh: Vec<f64>,
    /// Temperature of full derating [degC].
    pub stop_c: Vec<f64>,
}

impl RuleLaw {
    /// Checks the lengths of the arrays.
    ///
    /// # Errors
    ///
    /// [`ControlError::Length`].
    pub fn check(&self, n_strings: usize) -> Result<(), ControlError> {
        check_length("nominal", &self.nominal_kw, n_strings)?;
        check_length("nominal energy", &self.nominal_energy_kwh, n_strings)?;
        check_length("stop", &self.stop_c, n_strings)
    }

    /// Set-points `(M,)` [kW], signed as the demand. Demand above the total capability is requested within the free inverter
    /// power, so that the plant records it as availability loss.
    ///
    /// # Errors
    ///
    /// Lengths do not agree, or as [`ControlModel::states`].
    pub fn split(
        &self,
        model: &ControlModel,
        plant: &Measured<'_>,
        demand_kw: f64,
    ) -> Result<Vec<f64>, ControlError> {
        let n = self.nominal_kw.len();
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
        let weights = |of: &dyn Fn(usize) -> f64| (0..n).map(of).collect::<Vec<f64>>();
        let left = |m: usize| {
            let (low, high) = model.strings()[m].soc_window();
            match direction {
                Direction::Charge => (high - plant.soc[m]).max(0.0),
                Direction::Discharge => (plant.soc[m] - low).max(0.0),
            }
        };
        let energy = |m: usize| left(m) * self.nominal_energy_kwh[m] * plant.soh_capacity[m];
        let cool = |m: usize| self.nominal_kw[m] * (self.stop_c[m] - plant.temperature_c[m]).max(0.0);
        let mut power_kw = match self.rule {
            Rule::Priority | Rule::Rotation => in_order(total_kw, &caps_kw),
            Rule::Equal => water_fill(total_kw, &vec![1.0; n], &caps_kw),
            Rule::Soc => water_fill(total_kw, &weights(&energy), &caps_kw),
            Rule::Temperature => water_fill(total_kw, &weights(&cool), &caps_kw),
        };
        let rest_kw = total_kw - power_kw.iter().sum::<f64>();
        if rest_kw > 0.0 {
            let free_kw: Vec<f64> = plant.limit_kw.iter().zip(&power_kw).map(|(l, p)| l - p).collect();
            let more = water_fill(rest_kw, &free_kw, &free_kw);
            for ((power, more), limit) in power_kw.iter_mut().zip(more).zip(plant.limit_kw) {
                *power = (*power + more).min(*limit);
            }
        }
        power_kw.iter_mut().for_each(|power| *power *= W_PER_KW);
        let limit_w: Vec<f64> = plant.limit_kw.iter().map(|limit| limit * W_PER_KW).collect();
        model.set_points(&mut power_kw, &limit_w);
        Ok(power_kw.into_iter().map(|power| (power / W_PER_KW).copysign(demand_kw)).collect())
    }

    /// The control model of strings at their present health, if they are not new.
    ///
    /// # Errors
    ///
    /// As [`System::aged`].
    pub fn model_at(
        system: &System,
        plant: &Measured<'_>,
    ) -> Result<Option<ControlModel>, bess_tables::TableError> {
        if plant.soh_capacity.iter().chain(plant.soh_resistance).all(|&factor| factor == 1.0) {
            return Ok(None);
        }
        Ok(Some(ControlModel::new(&system.aged(plant.soh_capacity, plant.soh_resistance)?)))
    }
}

/// Fills the strings in order [kW].
fn in_order(total_kw: f64, caps_kw: &[f64]) -> Vec<f64> {
    let mut before_kw = 0.0;
    let power = |cap: &f64| {
        let power = (total_kw - before_kw).max(0.0).min(*cap);
        before_kw += cap;
        power
    };
    caps_kw.iter().map(power).collect()
}

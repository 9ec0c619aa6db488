//! The control model of a plant: its strings, and checks of their states and requests.

use std::sync::Arc;

use bess_tables::{Direction, InputError, System};

use crate::error::{check_length, check_range, out_of_range};
use crate::model::{StringModel, StringState};

const SOC_SLACK: f64 = 1e-9;
/// Relative tolerance of a power above its limit, for rounding only.
pub(super) const POWER_SLACK: f64 = 1e-9;
/// Valid temperatures of a battery [degC].
pub(crate) const TEMPERATURE_RANGE_C: (f64, f64) = (-100.0, 1000.0);

/// The control model of a plant.
#[derive(Debug, Clone)]
pub struct ControlModel {
    /// Shared, so that problems do not copy the tables of their strings.
    strings: Arc<[StringModel]>,
}

impl ControlModel {
    /// Prepares all strings.
    pub fn new(system: &System) -> Self {
        Self { strings: system.strings.iter().cloned().map(StringModel::new).collect() }
    }

    /// The model of the same strings with factors of capacity and resistance that fit [`System::check_health`].
    pub(crate) fn aged(&self, capacity: &[f64], resistance: &[f64]) -> Self {
        let of_string = |((string, capacity), resistance): ((&StringModel, &f64), &f64)| {
            let mut string = string.clone();
            string.parameters.age(*capacity, *resistance);
            string
        };
        Self { strings: self.strings.iter().zip(capacity).zip(resistance).map(of_string).collect() }
    }

    /// The strings.
    pub fn strings(&self) -> &[StringModel] {
        &self.strings
    }

    /// Checks measured states and pairs them up.
    ///
    /// # Errors
    ///
    /// The number of values differs from the number of strings, an SOC is outside its window by more than rounding,
    /// or a temperature is outside the valid range.
    pub fn states(&self, soc: &[f64], temperature_c: &[f64]) -> Result<Vec<StringState>, InputError> {
        check_length("soc", soc, self.strings.len())?;
        check_length("temperature_c", temperature_c, self.strings.len())?;
        check_range("temperature_c", temperature_c, TEMPERATURE_RANGE_C, " degC")?;
        for (position, (string, &value)) in self.strings.iter().zip(soc).enumerate() {
            let (low, high) = (string.parameters.soc_min, string.parameters.soc_max);
            if !(low - SOC_SLACK..=high + SOC_SLACK).contains(&value) {
                return Err(out_of_range("soc", position, value, (low, high), ""));
            }
        }
        let clamped = self
            .strings
            .iter()
            .zip(soc)
            .map(|(s, soc)| soc.clamp(s.parameters.soc_min, s.parameters.soc_max));
        Ok(clamped
            .zip(temperature_c)
            .map(|(soc, &temperature_c)| StringState { soc, temperature_c })
            .collect())
    }

    /// Directions of the steps of one schedule of signed requests `(M, T)` [W]; all strings of a step share it.
    ///
    /// # Errors
    ///
    /// A request is above the nominal power of its string, or the requests of a step have both signs.
    pub fn directions(&self, request_w: &[f64], n_steps: usize) -> Result<Vec<Direction>, InputError> {
        let mut directions = vec![Direction::Discharge; n_steps];
        for (step, direction) in directions.iter_mut().enumerate() {
            let mut sign = 0.0;
            for (string, model) in self.strings.iter().enumerate() {
                let value = request_w[string * n_steps + step];
                let nominal = model.nominal_w();
                if value.is_nan() || value.abs() > nominal * (1.0 + POWER_SLACK) {
                    let position = string * n_steps + step;
                    return Err(out_of_range("request", position, value, (-nominal, nominal), " W"));
                }
                if value * sign < 0.0 {
                    return Err(InputError(format!(
                        "step {step}: requests of both signs (string {string} asks for {value} W against the others)"
                    )));
                }
                if value != 0.0 {
                    sign = value;
                }
            }
            *direction = Direction::of(sign);
        }
        Ok(directions)
    }

    /// Maximum deliverable AC power of each string over the next interval, before derating [W].
    pub fn deliverable_w(&self, states: &[StringState], direction: Direction, dt_h: f64) -> Vec<f64> {
        let limit = |(string, state): (&StringModel, &StringState)| {
            string.deliverable_w(&string.coefficients(direction, *state), direction, state.soc, dt_h)
        };
        self.strings.iter().zip(states).map(limit).collect()
    }

    /// Constants that normalise the losses: inverter loss at `p_N` in charge, and
    /// `h_N = R(soc 0.5, 25 degC) (p_N / OCV_dch(0.5))^2`, for each string [W].
    pub fn nominal_losses_w(&self) -> (Vec<f64>, Vec<f64>) {
        let heat = |string: &StringModel| {
            let middle = StringState { soc: 0.5, temperature_c: 25.0 };
            let c = string.coefficients(Direction::Discharge, middle);
            c.resistance_ohm * (string.nominal_w() / c.voltage_v).powi(2)
        };
        let inverter = |string: &StringModel| string.loss(Direction::Charge).at(string.nominal_w()).0;
        (self.strings.iter().map(inverter).collect(), self.strings.iter().map(heat).collect())
    }
}

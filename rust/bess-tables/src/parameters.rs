//! Plant parameters at string level.

use serde::Deserialize;

use crate::{Cooling, Direction, Grid, InputError, Lut, Resistance, RestVoltage};

/// Parameters of a plant.
#[derive(Debug, Clone, PartialEq)]
pub struct System {
    /// The strings, in the order of all arrays.
    pub strings: Vec<StringParameters>,
    /// Cooling system; none if ambient air cools the strings at constant flow without auxiliary power.
    pub cooling: Option<Cooling>,
}

/// One string: a battery behind its own inverter, string-level values.
#[derive(Debug, Clone, PartialEq)]
pub struct StringParameters {
    /// Charge capacity `Q` [Ah].
    pub capacity_ah: f64,
    /// Cells in series: string voltage over cell voltage.
    pub cells_series: f64,
    /// Lower end of the usable SOC window.
    pub soc_min: f64,
    /// Upper end of the usable SOC window.
    pub soc_max: f64,
    /// Lowest voltage at the terminals in discharge [V], 0 without a limit.
    pub voltage_min_v: f64,
    /// Highest voltage at the terminals in charge [V], infinite without a limit.
    pub voltage_max_v: f64,
    /// SOC below which the resistance depends on SOC.
    pub low_soc_switch: f64,
    /// Open-circuit voltage over SOC (first axis) and temperature while charging [V].
    pub ocv_charge: Grid,
    /// The same while discharging [V].
    pub ocv_discharge: Grid,
    /// Voltage that defines chemical energy.
    pub rest: RestVoltage,
    /// Whether hysteresis loss heats the string.
    pub hysteresis_heat: bool,
    /// Internal resistance [Ohm].
    pub resistance: Resistance,
    /// Entropy coefficient `dU/dT` over SOC [V/K]; none for a string without reversible heat.
    pub entropy: Option<Lut>,
    /// The inverter.
    pub inverter: Inverter,
    /// Temperature derating.
    pub derating: Derating,
    /// Spatial thermal model of the plant.
    pub spatial: SpatialThermal,
    /// Lumped thermal model of the controller.
    pub lumped: LumpedThermal,
    /// Ageing model.
    pub ageing: Ageing,
}

/// Ageing model of a string.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ageing {
    /// Name of the model; none for a string that does not age.
    pub model: Option<String>,
    /// Share of the initial capacity loss that is due to calendar ageing.
    pub calendar_share: f64,
}

impl Default for Ageing {
    fn default() -> Self {
        Self { model: None, calendar_share: 0.5 }
    }
}

impl System {
    /// Checks factors of the capacity and of the resistance, one for each string.
    ///
    /// # Errors
    ///
    /// [`InputError`] where the factors are not one for each string, or one is not finite and above 0.
    pub fn check_health(&self, capacity: &[f64], resistance: &[f64]) -> Result<(), InputError> {
        for (name, factors) in [("soh_capacity", capacity), ("soh_resistance", resistance)] {
            if factors.len() != self.strings.len() {
                let (found, needed) = (factors.len(), self.strings.len());
                return Err(InputError::document(format!("{name}: {found} values for {needed} strings")));
            }
            if let Some(value) = factors.iter().find(|value| !(value.is_finite() && **value > 0.0)) {
                return Err(InputError::document(format!("{name} {value} is not finite and above 0")));
            }
        }
        Ok(())
    }

    /// The same plant with the capacity and the resistance of each string times a factor.
    ///
    /// # Errors
    ///
    /// As [`Self::check_health`].
    pub fn aged(&self, capacity: &[f64], resistance: &[f64]) -> Result<Self, InputError> {
        self.check_health(capacity, resistance)?;
        let mut strings = self.strings.clone();
        for ((string, capacity), resistance) in strings.iter_mut().zip(capacity).zip(resistance) {
            string.age(*capacity, *resistance);
        }
        Ok(Self { strings, cooling: self.cooling.clone() })
    }
}

/// Inverter of one string. Loss tables take the delivered AC power [W], value [W]; they hold for an inverter
/// that is on, so the value at 0 is the no-load loss.
#[derive(Debug, Clone, PartialEq)]
pub struct Inverter {
    /// Nominal AC power `p_N` [W].
    pub nominal_w: f64,
    /// Loss while charging [W].
    pub loss_charge: Lut,
    /// Loss while discharging [W].
    pub loss_discharge: Lut,
    /// Loss of an inverter that is off [W].
    pub off_loss_w: f64,
    /// Minimum AC power of an inverter that is on [W].
    pub min_power_w: f64,
}

/// Temperature derating.
#[derive(Debug, Clone, PartialEq)]
pub struct Derating {
    /// Derating factor over mean temperature.
    pub factor: Lut,
    /// Temperature at which derating starts [degC].
    pub start_c: f64,
    /// Proportional gain of the PI law [1/K].
    pub kp_per_k: f64,
    /// Integral gain of the PI law [1/K per 15-minute step].
    pub ki_per_k_step: f64,
}

/// One-dimensional thermal model along the air path of a representative pack.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpatialThermal {
    /// Equal packs in a string; string heat is shared between them.
    pub packs_per_string: u32,
    /// Length of the air path [m].
    pub length_m: f64,
    /// Number of nodes.
    pub nodes: usize,
    /// Cross-section of the cell stack [m2].
    pub section_m2: f64,
    /// Width of the surface washed by air [m].
    pub width_m: f64,
    /// Density [kg/m3].
    pub density_kg_m3: f64,
    /// Specific heat [J/(kg K)].
    pub specific_heat_j_kgk: f64,
    /// Conductivity along the path [W/(m K)].
    pub conductivity_w_mk: f64,
    /// Heat transfer to the air along the path [W/(m2 K)].
    pub lateral_u_w_m2k: f64,
    /// Heat transfer at both end faces [W/(m2 K)].
    pub end_u_w_m2k: f64,
    /// Air flow of one pack [kg/s].
    pub air_flow_kg_s: f64,
    /// Specific heat of air [J/(kg K)].
    pub air_cp_j_kgk: f64,
}

/// Lumped thermal model of a string.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LumpedThermal {
    /// Temperature rise per heat [K/J].
    pub k1_k_per_j: f64,
    /// Cooling rate [1/s].
    pub k2_per_s: f64,
}

impl StringParameters {
    /// Multiplies capacity and resistance by a factor each.
    pub fn age(&mut self, capacity: f64, resistance: f64) {
        self.capacity_ah *= capacity;
        self.resistance.scale(resistance);
    }

    /// `count` such strings in parallel, as one string with their total charge capacity [Ah] and `resistance` times the
    /// resistance of one. The spatial thermal model remains that of one string.
    pub fn in_parallel(&self, count: f64, capacity_ah: f64, resistance: f64) -> Self {
        let mut group = self.clone();
        group.capacity_ah = capacity_ah;
        group.resistance.scale(resistance);
        group.lumped.k1_k_per_j /= count;
        group.inverter.nominal_w *= count;
        group.inverter.off_loss_w *= count;
        group.inverter.loss_charge.stretch(count);
        group.inverter.loss_discharge.stretch(count);
        group
    }

    /// Largest current [A] at which the terminals stay within the voltage limits, `>= 0`.
    #[inline]
    pub fn voltage_current_a(&self, direction: Direction, ocv_v: f64, resistance_ohm: f64) -> f64 {
        let room_v = match direction {
            Direction::Charge => self.voltage_max_v - ocv_v,
            Direction::Discharge => ocv_v - self.voltage_min_v,
        };
        room_v.max(0.0) / resistance_ohm
    }

    /// Whether a current that changes the voltage by `drop_v` keeps the terminals within their limits.
    #[inline]
    pub fn voltage_allows(&self, direction: Direction, ocv_v: f64, drop_v: f64) -> bool {
        match direction {
            Direction::Charge => ocv_v + drop_v <= self.voltage_max_v,
            Direction::Discharge => ocv_v - drop_v >= self.voltage_min_v,
        }
    }

    /// Table of the open-circuit voltage [V] of a direction.
    #[inline]
    pub fn ocv_table(&self, direction: Direction) -> &Grid {
        direction.pick(&self.ocv_charge, &self.ocv_discharge)
    }

    /// Open-circuit voltage [V] of the string.
    #[inline]
    pub fn ocv(&self, direction: Direction, soc: f64, temperature_c: f64) -> f64 {
        self.ocv_table(direction).at(soc, temperature_c)
    }
}

impl Inverter {
    /// Loss table of a direction.
    #[inline]
    pub fn loss(&self, direction: Direction) -> &Lut {
        direction.pick(&self.loss_charge, &self.loss_discharge)
    }
}

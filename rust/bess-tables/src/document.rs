//! The system description as the Python side writes it after validating it (cell level, units and field names of the
//! TOML format), turned into string-level tables.

use serde::Deserialize;

use crate::units::W_PER_KW;
use crate::{
    Ageing, Axis, Cooling, Derating, Grid, InputError, Inverter, LumpedThermal, Lut, Resistance, RestVoltage,
    SpatialThermal, StringParameters, System,
};

const OHM_PER_MILLIOHM: f64 = 1e-3;
const REFERENCE_TEMPERATURE_C: f64 = 25.0;

impl System {
    /// Reads the resolved description that the Python side writes after validating it: a list of strings, each
    /// with all its sections, in the units of the TOML format.
    ///
    /// # Errors
    ///
    /// [`InputError`] where the text is not such a description or has no string; a table's own error, with the
    /// index of its string.
    pub fn from_json(text: &str) -> Result<Self, InputError> {
        let document: Document = serde_json::from_str(text).map_err(InputError::document)?;
        let strings = document
            .strings
            .into_iter()
            .enumerate()
            .map(|(index, string)| string.build(index))
            .collect::<Result<Vec<_>, _>>()?;
        if strings.is_empty() {
            return Err(InputError::document("a system needs at least one string"));
        }
        if let Some(cooling) = &document.cooling {
            if cooling.flow_steps.is_empty() {
                return Err(InputError::document("cooling.flow_steps needs at least one share"));
            }
        }
        Ok(Self { strings, cooling: document.cooling })
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    strings: Vec<StringDocument>,
    cooling: Option<Cooling>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct StringDocument {
    battery: BatteryDocument,
    inverter: InverterDocument,
    derating: DeratingDocument,
    thermal: ThermalDocument,
    #[serde(default)]
    ageing: Ageing,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct BatteryDocument {
    cells_series: u32,
    cells_parallel: u32,
    cell_capacity_ah: f64,
    #[serde(rename = "cell_mass_kg")]
    _cell_mass_kg: f64,
    soc_min: f64,
    soc_max: f64,
    cell_voltage_min_v: Option<f64>,
    cell_voltage_max_v: Option<f64>,
    low_soc_switch: f64,
    r_scale: f64,
    #[serde(default)]
    hysteresis_heat: bool,
    ocv_v: OcvDocument,
    resistance_temperature: Option<CurveDocument>,
    resistance_soc: Option<CurveDocument>,
    resistance_table: Option<ResistanceTableDocument>,
    entropy: Option<CurveDocument>,
}

/// Values over one axis, by the names of the quantities.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CurveDocument {
    #[serde(alias = "soc", alias = "temperature_c")]
    knots: Vec<f64>,
    #[serde(alias = "resistance_mohm", alias = "du_dt_mv_k")]
    values: Vec<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct OcvDocument {
    soc: Vec<f64>,
    temperature_c: Vec<f64>,
    /// One row per temperature.
    charge: Vec<Vec<f64>>,
    discharge: Vec<Vec<f64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ResistanceTableDocument {
    soc: Vec<f64>,
    temperature_c: Vec<f64>,
    c_rate: Vec<f64>,
    control_c_rate: f64,
    /// Indexed `[c_rate][temperature][soc]`.
    charge_mohm: Vec<Vec<Vec<f64>>>,
    discharge_mohm: Vec<Vec<Vec<f64>>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct InverterDocument {
    nominal_kw: f64,
    load: Vec<f64>,
    loss_charge: Vec<f64>,
    loss_discharge: Vec<f64>,
    off_loss: f64,
    min_power_kw: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct DeratingDocument {
    start_c: f64,
    #[serde(rename = "stop_c")]
    _stop_c: f64,
    kp_per_k: f64,
    ki_per_k_step: f64,
    temperature_c: Vec<f64>,
    factor: Vec<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ThermalDocument {
    spatial: SpatialThermal,
    lumped: LumpedThermal,
}

impl StringDocument {
    fn build(self, index: usize) -> Result<StringParameters, InputError> {
        let series = f64::from(self.battery.cells_series);
        let parallel = f64::from(self.battery.cells_parallel);
        let ohm = OHM_PER_MILLIOHM * self.battery.r_scale * series / parallel;
        let name = |table: &str| format!("string {index}: {table}");

        let ocv = |label: &str, rows: &[Vec<f64>], document: &OcvDocument| {
            grid(&name(label), &document.soc, &document.temperature_c, rows, series)
        };
        let ocv_charge = ocv("battery.ocv_v.charge", &self.battery.ocv_v.charge, &self.battery.ocv_v)?;
        let ocv_discharge =
            ocv("battery.ocv_v.discharge", &self.battery.ocv_v.discharge, &self.battery.ocv_v)?;

        let resistance = self.battery.resistance(&name, ohm)?;
        let volts_k = |mv_k: f64| 1e-3 * mv_k * series;
        let entropy = self.battery.entropy.map(|table| table.lut(&name("battery.entropy"), volts_k));
        let nominal_w = self.inverter.nominal_kw * W_PER_KW;
        let loss = |label: &str, loss: &[f64]| {
            Lut::new(
                &name(label),
                self.inverter.load.iter().map(|x| x * nominal_w).collect(),
                loss.iter().map(|y| y * nominal_w).collect(),
            )
        };
        Ok(StringParameters {
            capacity_ah: self.battery.cell_capacity_ah * parallel,
            cells_series: series,
            soc_min: self.battery.soc_min,
            soc_max: self.battery.soc_max,
            voltage_min_v: self.battery.cell_voltage_min_v.map_or(0.0, |cell| cell * series),
            voltage_max_v: self.battery.cell_voltage_max_v.map_or(f64::INFINITY, |cell| cell * series),
            low_soc_switch: self.battery.low_soc_switch,
            rest: RestVoltage::new(&ocv_charge, &ocv_discharge),
            hysteresis_heat: self.battery.hysteresis_heat,
            ocv_charge,
            ocv_discharge,
            resistance,
            entropy: entropy.transpose()?,
            inverter: Inverter {
                nominal_w,
                loss_charge: loss("inverter.loss_charge", &self.inverter.loss_charge)?,
                loss_discharge: loss("inverter.loss_discharge", &self.inverter.loss_discharge)?,
                off_loss_w: self.inverter.off_loss * nominal_w,
                min_power_w: self.inverter.min_power_kw * W_PER_KW,
            },
            derating: Derating {
                factor: Lut::new(
                    &name("derating.factor"),
                    self.derating.temperature_c,
                    self.derating.factor,
                )?,
                start_c: self.derating.start_c,
                kp_per_k: self.derating.kp_per_k,
                ki_per_k_step: self.derating.ki_per_k_step,
            },
            spatial: self.thermal.spatial,
            lumped: self.thermal.lumped,
            ageing: self.ageing,
        })
    }
}

impl BatteryDocument {
    fn resistance(&self, name: &impl Fn(&str) -> String, ohm: f64) -> Result<Resistance, InputError> {
        match (&self.resistance_temperature, &self.resistance_soc, &self.resistance_table) {
            (Some(temperature), Some(soc), None) => {
                let of_temperature = name("battery.resistance_temperature");
                let f_t = temperature.lut(&of_temperature, |mohm| mohm)?;
                let factor = 1.0 / f_t.at(REFERENCE_TEMPERATURE_C);
                Ok(Resistance::Switched {
                    temperature: temperature.lut(&of_temperature, |mohm| mohm * ohm)?,
                    soc_factor: soc.lut(&name("battery.resistance_soc"), |mohm| mohm * factor)?,
                    low_soc_switch: self.low_soc_switch,
                })
            }
            (None, None, Some(table)) => {
                let grids = |label: &str, blocks: &[Vec<Vec<f64>>]| {
                    if blocks.len() != table.c_rate.len() {
                        return Err(InputError::table(
                            &name(label),
                            format!("{} C-rates but {} tables", table.c_rate.len(), blocks.len()),
                        ));
                    }
                    blocks
                        .iter()
                        .map(|rows| grid(&name(label), &table.soc, &table.temperature_c, rows, ohm))
                        .collect::<Result<Vec<_>, _>>()
                };
                Ok(Resistance::Measured {
                    c_rate: Axis::new(&name("battery.resistance_table.c_rate"), table.c_rate.clone())?,
                    charge: grids("battery.resistance_table.charge_mohm", &table.charge_mohm)?,
                    discharge: grids("battery.resistance_table.discharge_mohm", &table.discharge_mohm)?,
                    control_c_rate: table.control_c_rate,
                })
            }
            _ => Err(InputError::table(
                &name("battery"),
                "give either resistance_temperature with resistance_soc, or resistance_table",
            )),
        }
    }
}

impl CurveDocument {
    fn lut(&self, name: &str, of_value: impl Fn(f64) -> f64) -> Result<Lut, InputError> {
        Lut::new(name, self.knots.clone(), self.values.iter().map(|&value| of_value(value)).collect())
    }
}

/// Table with SOC as the first axis from rows per temperature, as files have them; values are scaled.
fn grid(
    name: &str,
    soc: &[f64],
    temperature_c: &[f64],
    rows: &[Vec<f64>],
    factor: f64,
) -> Result<Grid, InputError> {
    if rows.len() != temperature_c.len() || rows.iter().any(|row| row.len() != soc.len()) {
        return Err(InputError::table(
            name,
            format!("needs {} rows (temperatures) of {} values (SOC)", temperature_c.len(), soc.len()),
        ));
    }
    let z = (0..soc.len()).flat_map(|i| rows.iter().map(move |row| row[i] * factor)).collect();
    Grid::new(name, soc.to_vec(), temperature_c.to_vec(), z)
}

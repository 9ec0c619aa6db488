//! The system description as the Python side validates it, turned into string-level tables.

use serde::Deserialize;

use crate::{Grid, Lut, TableError};

const WATTS_PER_KW: f64 = 1e3;
const OHM_PER_MILLIOHM: f64 = 1e-3;
const REFERENCE_TEMPERATURE_C: f64 = 25.0;

/// Direction of power of one interval. It is common to all strings and known from the sign of the demand.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Direction {
    /// From the grid.
    Charge,
    /// To the grid.
    Discharge,
}

/// Everything that is known about a plant before it runs.
#[derive(Debug, Clone, PartialEq)]
pub struct System {
    /// The strings, in the order of every array that crosses the boundary.
    pub strings: Vec<StringParameters>,
}

/// One string: a battery behind its own inverter, string-level values.
#[derive(Debug, Clone, PartialEq)]
pub struct StringParameters {
    /// Charge capacity `Q` [Ah].
    pub capacity_ah: f64,
    /// Lower end of the usable SOC window.
    pub soc_min: f64,
    /// Upper end of the usable SOC window.
    pub soc_max: f64,
    /// A string counts as full (empty) within this of its SOC limit.
    pub availability_epsilon: f64,
    /// SOC below which the resistance depends on SOC.
    pub low_soc_switch: f64,
    /// Open-circuit voltage over SOC (first axis) and temperature while charging [V].
    pub ocv_charge: Grid,
    /// The same while discharging [V].
    pub ocv_discharge: Grid,
    /// Internal resistance [Ohm].
    pub resistance: Resistance,
    /// The inverter.
    pub inverter: Inverter,
    /// Temperature derating.
    pub derating: Derating,
    /// Spatial thermal model of the plant.
    pub spatial: SpatialThermal,
    /// Lumped thermal model of the controller.
    pub lumped: LumpedThermal,
}

/// Internal resistance of a string [Ohm].
#[derive(Debug, Clone, PartialEq)]
pub enum Resistance {
    /// `f_T(T)`, and `f_soc(soc) f_T(T) / f_T(25 degC)` below the low-SOC switch (MODEL: eq. R1, R2).
    Switched {
        /// `f_T` [Ohm].
        temperature: Lut,
        /// `f_soc / f_T(25 degC)` (dimensionless).
        soc_factor: Lut,
        /// SOC below which the factor applies.
        switch_soc: f64,
    },
    /// Measured over SOC (first axis), temperature and C-rate, for each direction: one grid per C-rate.
    Measured {
        /// C-rates of the grids, ascending.
        c_rate: Vec<f64>,
        /// Charge, one grid for each C-rate.
        charge: Vec<Grid>,
        /// Discharge, one grid for each C-rate.
        discharge: Vec<Grid>,
        /// C-rate at which the controller, which has no inner iteration, reads the table.
        control_c_rate: f64,
    },
}

impl Resistance {
    /// Resistance [Ohm] at a state and C-rate.
    #[inline]
    pub fn at(&self, direction: Direction, soc: f64, temperature_c: f64, c_rate: f64) -> f64 {
        match self {
            Self::Switched { temperature, soc_factor, switch_soc } => {
                let at_temperature = temperature.at(temperature_c);
                if soc < *switch_soc {
                    soc_factor.at(soc) * at_temperature
                } else {
                    at_temperature
                }
            }
            Self::Measured { c_rate: axis, charge, discharge, .. } => {
                let grids = match direction {
                    Direction::Charge => charge,
                    Direction::Discharge => discharge,
                };
                let (segment, share) = crate::lut::locate(axis, c_rate);
                let low = grids[segment].at(soc, temperature_c);
                if grids.len() == 1 || share == 0.0 {
                    return low;
                }
                low + share * (grids[segment + 1].at(soc, temperature_c) - low)
            }
        }
    }

    /// Resistance [Ohm] as the controller sees it: no dependence on the current of the interval.
    #[inline]
    pub fn control_at(&self, direction: Direction, soc: f64, temperature_c: f64) -> f64 {
        let c_rate = match self {
            Self::Switched { .. } => 0.0,
            Self::Measured { control_c_rate, .. } => *control_c_rate,
        };
        self.at(direction, soc, temperature_c, c_rate)
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
    /// Open-circuit voltage [V] of the string.
    #[inline]
    pub fn ocv(&self, direction: Direction, soc: f64, temperature_c: f64) -> f64 {
        match direction {
            Direction::Charge => self.ocv_charge.at(soc, temperature_c),
            Direction::Discharge => self.ocv_discharge.at(soc, temperature_c),
        }
    }
}

impl Inverter {
    /// Loss table of a direction.
    #[inline]
    pub fn loss(&self, direction: Direction) -> &Lut {
        match direction {
            Direction::Charge => &self.loss_charge,
            Direction::Discharge => &self.loss_discharge,
        }
    }
}

impl System {
    /// Reads the resolved description that the Python side writes after validating it: a list of strings, each
    /// with all its sections, in the units of the TOML format.
    pub fn from_json(text: &str) -> Result<Self, TableError> {
        let document: Document =
            serde_json::from_str(text).map_err(|error| TableError::Document(error.to_string()))?;
        let strings = document
            .strings
            .into_iter()
            .enumerate()
            .map(|(index, string)| string.build(index))
            .collect::<Result<Vec<_>, _>>()?;
        if strings.is_empty() {
            return Err(TableError::Document("a system needs at least one string".to_owned()));
        }
        Ok(Self { strings })
    }
}

// The TOML format, cell level. Field names are those of the file.

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    strings: Vec<StringDocument>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct StringDocument {
    battery: BatteryDocument,
    inverter: InverterDocument,
    derating: DeratingDocument,
    thermal: ThermalDocument,
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
    availability_epsilon: f64,
    low_soc_switch: f64,
    r_scale: f64,
    ocv_v: OcvDocument,
    resistance_temperature: Option<ResistanceTemperatureDocument>,
    resistance_soc: Option<ResistanceSocDocument>,
    resistance_table: Option<ResistanceTableDocument>,
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
struct ResistanceTemperatureDocument {
    temperature_c: Vec<f64>,
    resistance_mohm: Vec<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ResistanceSocDocument {
    soc: Vec<f64>,
    resistance_mohm: Vec<f64>,
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
    fn build(self, index: usize) -> Result<StringParameters, TableError> {
        let series = f64::from(self.battery.cells_series);
        let parallel = f64::from(self.battery.cells_parallel);
        let ohm = OHM_PER_MILLIOHM * self.battery.r_scale * series / parallel;
        let name = |table: &str| format!("string {index}: {table}");

        let ocv = |label: &str, rows: &[Vec<f64>], document: &OcvDocument| {
            let z = by_soc(&name(label), &document.soc, &document.temperature_c, rows, series)?;
            Grid::new(&name(label), document.soc.clone(), document.temperature_c.clone(), z)
        };
        let ocv_charge = ocv("battery.ocv_v.charge", &self.battery.ocv_v.charge, &self.battery.ocv_v)?;
        let ocv_discharge =
            ocv("battery.ocv_v.discharge", &self.battery.ocv_v.discharge, &self.battery.ocv_v)?;

        let resistance = self.battery.resistance(&name, ohm)?;
        let nominal_w = self.inverter.nominal_kw * WATTS_PER_KW;
        let loss = |label: &str, loss: &[f64]| {
            Lut::new(
                &name(label),
                self.inverter.load.iter().map(|x| x * nominal_w).collect(),
                loss.iter().map(|y| y * nominal_w).collect(),
            )
        };
        Ok(StringParameters {
            capacity_ah: self.battery.cell_capacity_ah * parallel,
            soc_min: self.battery.soc_min,
            soc_max: self.battery.soc_max,
            availability_epsilon: self.battery.availability_epsilon,
            low_soc_switch: self.battery.low_soc_switch,
            ocv_charge,
            ocv_discharge,
            resistance,
            inverter: Inverter {
                nominal_w,
                loss_charge: loss("inverter.loss_charge", &self.inverter.loss_charge)?,
                loss_discharge: loss("inverter.loss_discharge", &self.inverter.loss_discharge)?,
                off_loss_w: self.inverter.off_loss * nominal_w,
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
        })
    }
}

impl BatteryDocument {
    fn resistance(&self, name: &impl Fn(&str) -> String, ohm: f64) -> Result<Resistance, TableError> {
        let scaled = |values: &[f64], factor: f64| values.iter().map(|v| v * factor).collect::<Vec<_>>();
        match (&self.resistance_temperature, &self.resistance_soc, &self.resistance_table) {
            (Some(temperature), Some(soc), None) => {
                let f_t = Lut::new(
                    &name("battery.resistance_temperature"),
                    temperature.temperature_c.clone(),
                    temperature.resistance_mohm.clone(),
                )?;
                let factor = 1.0 / f_t.at(REFERENCE_TEMPERATURE_C);
                Ok(Resistance::Switched {
                    temperature: Lut::new(
                        &name("battery.resistance_temperature"),
                        temperature.temperature_c.clone(),
                        scaled(&temperature.resistance_mohm, ohm),
                    )?,
                    soc_factor: Lut::new(
                        &name("battery.resistance_soc"),
                        soc.soc.clone(),
                        scaled(&soc.resistance_mohm, factor),
                    )?,
                    switch_soc: self.low_soc_switch,
                })
            }
            (None, None, Some(table)) => {
                let grids = |label: &str, blocks: &[Vec<Vec<f64>>]| {
                    if blocks.len() != table.c_rate.len() {
                        return Err(TableError::table(
                            &name(label),
                            format!("{} C-rates but {} tables", table.c_rate.len(), blocks.len()),
                        ));
                    }
                    blocks
                        .iter()
                        .map(|rows| {
                            let z = by_soc(&name(label), &table.soc, &table.temperature_c, rows, ohm)?;
                            Grid::new(&name(label), table.soc.clone(), table.temperature_c.clone(), z)
                        })
                        .collect::<Result<Vec<_>, _>>()
                };
                crate::lut::check_axis(&name("battery.resistance_table.c_rate"), &table.c_rate)?;
                Ok(Resistance::Measured {
                    c_rate: table.c_rate.clone(),
                    charge: grids("battery.resistance_table.charge_mohm", &table.charge_mohm)?,
                    discharge: grids("battery.resistance_table.discharge_mohm", &table.discharge_mohm)?,
                    control_c_rate: table.control_c_rate,
                })
            }
            _ => Err(TableError::table(
                &name("battery"),
                "give either resistance_temperature with resistance_soc, or resistance_table",
            )),
        }
    }
}

/// Rows per temperature (as files have them) to row-major values with SOC as the first axis, scaled.
fn by_soc(
    name: &str,
    soc: &[f64],
    temperature_c: &[f64],
    rows: &[Vec<f64>],
    factor: f64,
) -> Result<Vec<f64>, TableError> {
    if rows.len() != temperature_c.len() || rows.iter().any(|row| row.len() != soc.len()) {
        return Err(TableError::table(
            name,
            format!("needs {} rows (temperatures) of {} values (SOC)", temperature_c.len(), soc.len()),
        ));
    }
    Ok((0..soc.len()).flat_map(|i| rows.iter().map(move |row| row[i] * factor)).collect())
}

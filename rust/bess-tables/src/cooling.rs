//! Cooling parameters of a plant, from its system file.

use serde::Deserialize;

/// Coolant, thermostat and source of cooling.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Cooling {
    /// Name of the kind.
    pub kind: String,
    /// Full flow of one pack [kg/s]; that of the string's air if none.
    pub flow_kg_s: Option<f64>,
    /// Specific heat of the coolant [J/(kg K)]; that of the string's air if none.
    pub cp_j_kgk: Option<f64>,
    /// Heat transfer to the coolant [W/(m2 K)]; that to the string's air if none.
    pub u_w_m2k: Option<f64>,
    /// Density of the coolant [kg/m3].
    pub density_kg_m3: f64,
    /// Pressure rise of fan or pump at full flow [Pa].
    pub pressure_pa: f64,
    /// Efficiency of fan or pump with its motor.
    pub mover_efficiency: f64,
    /// Mean temperature of a string at which its flow starts [degC]; none where it always flows.
    pub start_c: Option<f64>,
    /// How far below its start a stage of flow, or the chiller of the hybrid, ends [K].
    pub dead_band_k: f64,
    /// Shares of the full flow, ascending: one for each stage, the next beginning `step_k` above the one before.
    pub flow_steps: Vec<f64>,
    /// Distance of the stages [K].
    pub step_k: f64,
    /// Whether the flow varies between its first share and full, over the dead band and `step_k`.
    pub variable_flow: bool,
    /// Temperature at which the coolant is held [degC]; none if the ambient sets it.
    pub supply_c: Option<f64>,
    /// Hybrid: mean temperature of the warmest string at which the chiller starts [degC].
    pub chill_c: Option<f64>,
    /// Temperature difference of each heat exchanger [K].
    pub approach_k: f64,
    /// Coefficient of performance of the chiller, relative to that of Carnot.
    pub carnot_share: f64,
    /// Maximum coefficient of performance.
    pub cop_max: f64,
    /// Power of the fans of free cooling, per heat.
    pub free_cooling_w_per_w: f64,
    /// Loop between strings and source; none if every string is supplied at the supply temperature.
    #[serde(rename = "loop")]
    pub common: Option<CoolantLoop>,
}

/// The coolant that all strings share: the air of a container, or a circuit of pipes and a tank, fully mixed.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CoolantLoop {
    /// Heat capacity [kJ/K].
    pub heat_capacity_kj_k: f64,
    /// Heat conductance of its walls to the ambient [W/K].
    pub wall_w_k: f64,
    /// Maximum heat flow to the source [kW]; none without a limit.
    pub source_kw: Option<f64>,
    /// Whether the coolant passes the strings in series.
    pub series: bool,
}

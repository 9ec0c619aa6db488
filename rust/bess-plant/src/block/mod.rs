//! Strings stepped side by side: their parameters and state, and the flows of a control step.

mod control_step;
mod derating;
mod step;

pub(crate) use control_step::CoolantTemperatures;
pub use derating::DeratingLaw;

use bess_tables::{Direction, InputError, Resistance, StringParameters};

use crate::ageing::{AgeingState, StringAgeing};
use crate::lanes::{Lanes, WIDTH};
use crate::line::Lines;
use crate::measured_resistance::MeasuredResistance;
use crate::record::Limits;
use crate::thermal::{AirPath, Coefficients};

/// Sums over the plant steps of one control step.
#[derive(Debug, Clone, Copy, Default)]
struct Totals {
    /// Powers and losses as in the record: magnitudes in the direction of the request [W].
    delivered_w: Lanes,
    availability_loss_w: Lanes,
    derating_loss_w: Lanes,
    /// Inverter loss of plant steps with active power.
    loss_on_w: Lanes,
    /// Inverter loss of plant steps with reactive power alone.
    grid_loss_w: Lanes,
    reactive_var: Lanes,
    /// Plant steps with the inverter off.
    off_steps: Lanes,
    heat_w: Lanes,
    reversible_w: Lanes,
    hysteresis_w: Lanes,
    ocv_shift_w: Lanes,
    current_a: Lanes,
    /// Derating factor.
    factor: Lanes,
    /// Off-to-on transitions of the inverter.
    starts: Lanes,
    /// Hottest node so far [degC].
    hottest_c: Lanes,
}

/// A control step: its requests, its initial state, and the flows so far.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ControlStep {
    magnitude_w: Lanes,
    /// Requested reactive power, magnitude [var].
    reactive_var: Lanes,
    sign: Lanes,
    direction: [Direction; WIDTH],
    /// Temperature of the air, or coolant, at the inlet.
    inlet_c: Lanes,
    /// State at its beginning.
    soc: Lanes,
    temperature_c: Lanes,
    totals: Totals,
    limits: [Limits; WIDTH],
}

/// Lanes with the same number of nodes. Lanes beyond `ids` repeat the last one and are not read.
#[derive(Debug)]
pub(crate) struct Block {
    ids: Vec<usize>,
    strings: [StringParameters; WIDTH],
    law: DeratingLaw,
    step_s: f64,
    coefficients: [Coefficients; WIDTH],
    air_path: AirPath,
    measured: MeasuredResistance,
    any_measured: bool,
    /// Whether a lane has uniform heat, equal in all its nodes: of reaction, or of hysteresis.
    any_uniform_heat: bool,
    /// 1 for a lane that hysteresis warms, else 0.
    hysteresis_heat: Lanes,
    k_per_w: Lanes,
    soc_per_a: Lanes,
    nominal_w: Lanes,
    min_power_w: Lanes,
    soc_min: Lanes,
    soc_max: Lanes,
    voltage_min_v: Lanes,
    voltage_max_v: Lanes,
    soc: Lanes,
    integral_k: Lanes,
    /// 1 for an inverter that is on, else 0.
    on: Lanes,
    factor_lines: Lines,
    charge_v_lines: Lines,
    discharge_v_lines: Lines,
    low_soc_lines: Lines,
    loss_lines: Lines,
    ageing: Vec<StringAgeing>,
    /// One for each of `ids`.
    aged: Vec<AgeingState>,
    /// Capacity now [Ah], and resistance now over that of the tables.
    capacity_ah: Lanes,
    growth: Lanes,
}

impl Block {
    /// `members`: lane number and parameters, at most [`WIDTH`], at least one, all with the same number of nodes.
    pub(crate) fn new(
        members: &[(usize, &StringParameters)],
        law: DeratingLaw,
        step_s: f64,
    ) -> Result<Self, InputError> {
        let strings: [StringParameters; WIDTH] =
            std::array::from_fn(|l| members[l.min(members.len() - 1)].1.clone());
        let nodes = strings[0].spatial.nodes;
        let coefficients = std::array::from_fn(|l| Coefficients::new(&strings[l].spatial, step_s));
        let each = |f: &dyn Fn(&StringParameters) -> f64| Lanes::from_fn(|l| f(&strings[l]));
        Ok(Self {
            ids: members.iter().map(|&(id, _)| id).collect(),
            air_path: AirPath::new(&coefficients, nodes),
            measured: MeasuredResistance::new(nodes, strings.iter().map(|s| &s.resistance)),
            any_measured: strings.iter().any(|s| matches!(s.resistance, Resistance::Measured { .. })),
            any_uniform_heat: strings.iter().any(|s| s.entropy.is_some() || s.hysteresis_heat),
            hysteresis_heat: each(&|s| f64::from(u8::from(s.hysteresis_heat))),
            k_per_w: Lanes::from_fn(|l| coefficients[l].k_per_w),
            soc_per_a: Lanes::ZERO,
            nominal_w: each(&|s| s.inverter.nominal_w),
            min_power_w: each(&|s| s.inverter.min_power_w),
            soc_min: each(&|s| s.soc_min),
            soc_max: each(&|s| s.soc_max),
            voltage_min_v: each(&|s| s.voltage_min_v),
            voltage_max_v: each(&|s| s.voltage_max_v),
            soc: Lanes::ZERO,
            integral_k: Lanes::ZERO,
            on: Lanes::ZERO,
            factor_lines: Lines::unknown(),
            charge_v_lines: Lines::unknown(),
            discharge_v_lines: Lines::unknown(),
            low_soc_lines: Lines::unknown(),
            loss_lines: Lines::unknown(),
            ageing: members.iter().map(|(_, string)| StringAgeing::new(string)).collect::<Result<_, _>>()?,
            aged: Vec::new(),
            capacity_ah: Lanes::ZERO,
            growth: Lanes::ZERO,
            coefficients,
            strings,
            law,
            step_s,
        })
    }
}

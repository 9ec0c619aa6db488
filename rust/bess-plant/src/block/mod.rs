//! `W` strings stepped side by side: their parameters and state, and the flows of a control step.

mod any;
mod derating;
mod step;

pub(crate) use any::{AnyBlock, Faces};
pub use derating::DeratingLaw;

use bess_tables::{Direction, InputError, Resistance, StringParameters};

use crate::ageing::{AgeingState, StringAgeing};
use crate::lanes::Lanes;
use crate::line::Lines;
use crate::measured_resistance::MeasuredResistance;
use crate::record::Limits;
use crate::thermal::{AirPath, Coefficients};

/// Sums over the plant steps of one control step.
#[derive(Debug, Clone, Copy, Default)]
struct Totals<const W: usize> {
    /// Powers and losses as in the record: magnitudes in the direction of the request [W].
    delivered_w: Lanes<W>,
    availability_loss_w: Lanes<W>,
    derating_loss_w: Lanes<W>,
    /// Inverter loss of plant steps with active power.
    loss_on_w: Lanes<W>,
    /// Inverter loss of plant steps with reactive power alone.
    grid_loss_w: Lanes<W>,
    reactive_var: Lanes<W>,
    /// Plant steps with the inverter off.
    off_steps: Lanes<W>,
    heat_w: Lanes<W>,
    reversible_w: Lanes<W>,
    hysteresis_w: Lanes<W>,
    ocv_shift_w: Lanes<W>,
    current_a: Lanes<W>,
    /// Derating factor.
    factor: Lanes<W>,
    /// Off-to-on transitions of the inverter.
    starts: Lanes<W>,
    /// Hottest node so far [degC].
    hottest_c: Lanes<W>,
}

/// A control step: its requests, its initial state, and the flows so far.
#[derive(Debug, Clone, Copy)]
struct ControlStep<const W: usize> {
    magnitude_w: Lanes<W>,
    /// Reactive power asked for, magnitude [var].
    reactive_var: Lanes<W>,
    sign: Lanes<W>,
    direction: [Direction; W],
    /// Temperature of the air, or coolant, at the inlet.
    inlet_c: Lanes<W>,
    /// State at its beginning.
    soc: Lanes<W>,
    temperature_c: Lanes<W>,
    totals: Totals<W>,
    limits: [Limits; W],
}

/// Lanes with the same number of nodes. Lanes beyond `ids` repeat the last one and are not read.
#[derive(Debug, Clone)]
pub(crate) struct Block<const W: usize> {
    ids: Vec<usize>,
    strings: [StringParameters; W],
    law: DeratingLaw,
    step_s: f64,
    coefficients: [Coefficients; W],
    air_path: AirPath<W>,
    /// The control step of a plant whose strings share a coolant.
    begun: Option<ControlStep<W>>,
    measured: MeasuredResistance,
    any_measured: bool,
    /// Whether some lane has heat that all its nodes share alike: of reaction, or of hysteresis.
    any_even_heat: bool,
    /// 1 for a lane that hysteresis warms, else 0.
    hysteresis_heat: Lanes<W>,
    k_per_w: Lanes<W>,
    soc_per_a: Lanes<W>,
    nominal_w: Lanes<W>,
    min_power_w: Lanes<W>,
    soc_min: Lanes<W>,
    soc_max: Lanes<W>,
    voltage_min_v: Lanes<W>,
    voltage_max_v: Lanes<W>,
    soc: Lanes<W>,
    integral_k: Lanes<W>,
    /// 1 for an inverter that is on, else 0.
    on: Lanes<W>,
    factor_lines: Lines<W>,
    charge_v_lines: Lines<W>,
    discharge_v_lines: Lines<W>,
    low_soc_lines: Lines<W>,
    loss_lines: Lines<W>,
    ageing: Vec<StringAgeing>,
    /// One for each of `ids`.
    aged: Vec<AgeingState>,
    /// Capacity now [Ah], and resistance now over that of the tables.
    capacity_ah: Lanes<W>,
    growth: Lanes<W>,
}

impl<const W: usize> Block<W> {
    /// `members`: lane number and parameters, at most `W`, at least one, all with the same number of nodes.
    pub(crate) fn new(
        members: &[(usize, &StringParameters)],
        law: DeratingLaw,
        step_s: f64,
    ) -> Result<Self, InputError> {
        let strings: [StringParameters; W] =
            std::array::from_fn(|l| members[l.min(members.len() - 1)].1.clone());
        let nodes = strings[0].spatial.nodes;
        let coefficients = std::array::from_fn(|l| Coefficients::new(&strings[l].spatial, step_s));
        let each = |f: &dyn Fn(&StringParameters) -> f64| Lanes::from_fn(|l| f(&strings[l]));
        Ok(Self {
            ids: members.iter().map(|&(id, _)| id).collect(),
            air_path: AirPath::new(&coefficients, nodes),
            begun: None,
            measured: MeasuredResistance::new(nodes, strings.iter().map(|s| &s.resistance)),
            any_measured: strings.iter().any(|s| matches!(s.resistance, Resistance::Measured { .. })),
            any_even_heat: strings.iter().any(|s| s.entropy.is_some() || s.hysteresis_heat),
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant::{starting_ageing, PlantState, Schedule};
    use crate::record::Record;
    use crate::tests::common;

    /// Eight strings through all regimes: full, empty, hot, idle.
    fn record<const W: usize>(
        reactive_var: Option<&[f64]>,
        plant_steps: impl Fn(&mut Block<W>, &mut ControlStep<W>, usize),
    ) -> Record {
        let system = common::reference(W);
        let members: Vec<_> = system.strings.iter().enumerate().collect();
        let mut block = Block::<W>::new(&members, DeratingLaw::Pi, 10.0).unwrap();
        let node_c = |at: usize| 20.0 + 5.0 * (at / 40) as f64 + 0.1 * (at % 40) as f64;
        let ones = [1.0; W];
        block.set_state(&PlantState {
            soc: (0..W).map(|l| l as f64 / (W - 1) as f64).collect(),
            node_temperature_c: (0..40 * W).map(node_c).collect(),
            derating_integral_k: vec![0.3; W],
            inverter_on: vec![false; W],
            ageing: starting_ageing(&system, &ones, &ones).unwrap(),
            cooling: None,
        });
        let (steps, substeps) = (30, 90);
        let request_w: Vec<f64> = (0..steps * W).map(|at| 92e3 * (0.37 * at as f64).sin()).collect();
        let ambient_c = vec![25.0; steps];
        let schedule = Schedule {
            steps,
            substeps,
            lanes: W,
            strings: W,
            request_w: &request_w,
            ambient_c: &ambient_c,
            reactive_var,
        };
        let mut record = Record::new(steps, (1, W), 40, true, reactive_var.is_some());
        for step in 0..steps {
            block.begin(&schedule, step);
            let mut begun = block.begun.unwrap();
            plant_steps(&mut block, &mut begun, substeps);
            block.begun = Some(begun);
            block.finish(&schedule, step, &mut record);
        }
        record
    }

    #[test]
    fn the_widest_instructions_at_hand_change_no_bit() {
        // As text, because what was not recorded is NaN, which equals nothing.
        let text = |record: Record| format!("{record:?}");
        let asked_var: Vec<f64> = (0..30 * 8).map(|at| 92e3 * (0.11 * f64::from(at)).cos()).collect();
        for reactive_var in [None, Some(&asked_var[..])] {
            let widest = record::<8>(reactive_var, Block::plant_steps);
            assert_eq!(text(widest), text(record::<8>(reactive_var, Block::portable_plant_steps)));
        }
    }

    #[test]
    fn no_reactive_power_changes_no_bit() {
        let without = record::<8>(None, Block::plant_steps);
        let mut with = record::<8>(Some(&[0.0; 30 * 8]), Block::plant_steps);
        assert_eq!(with.reactive_var, vec![0.0; 30 * 8]);
        with.reactive_var.clear();
        assert_eq!(format!("{with:?}"), format!("{without:?}"));
    }
}

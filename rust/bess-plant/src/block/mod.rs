//! `W` strings stepped side by side through a whole schedule: parameters and state, control steps, the record.

mod ageing;
mod any;
mod derating;
mod step;

pub(crate) use any::{AnyBlock, Faces};
pub use derating::DeratingLaw;

use bess_tables::units::SECONDS_PER_HOUR;
use bess_tables::{Direction, InputError, Resistance, StringParameters};

use crate::ageing::{AgeingState, StringAgeing};
use crate::lanes::Lanes;
use crate::line::Lines;
use crate::measured_resistance::MeasuredResistance;
use crate::record::{Limits, Record};
use crate::schedule::Schedule;
use crate::thermal::{AirPath, Coefficients};
use crate::totals::Totals;

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

    fn begin_step(&mut self, schedule: &Schedule, step: usize) -> ControlStep<W> {
        let member = |l: usize| self.ids[l.min(self.ids.len() - 1)];
        let request_w: [f64; W] = std::array::from_fn(|l| schedule.request_w(step, member(l)));
        let inlet_c = Lanes::from_fn(|l| schedule.ambient_c(step, member(l)));
        let (soc, temperature_c) = (self.soc, self.air_path.mean_temperature());
        let magnitude_w = Lanes::from_fn(|l| request_w[l].abs());
        let reactive_var = Lanes::from_fn(|l| schedule.reactive_var(step, member(l)).abs());
        let direction: [Direction; W] = std::array::from_fn(|l| Direction::of(request_w[l]));
        let sign = Lanes::from_fn(|l| direction[l].sign());
        // The loss table in force changes with the direction.
        self.loss_lines = Lines::unknown();
        self.integrate_excess(schedule.substeps);
        ControlStep {
            magnitude_w,
            reactive_var,
            sign,
            direction,
            inlet_c,
            soc,
            temperature_c,
            totals: Totals::new(),
            limits: [Limits::NONE; W],
        }
    }

    fn finish_step(&mut self, begun: &ControlStep<W>, schedule: &Schedule, step: usize, record: &mut Record) {
        self.report(step, begun, schedule.substeps, record);
        if schedule.reactive_var.is_some() {
            for (lane, &id) in self.ids.iter().enumerate() {
                let sign = if schedule.reactive_var(step, id) < 0.0 { -1.0 } else { 1.0 };
                record.reactive_var[step * schedule.lanes + id] =
                    sign * begun.totals.reactive_var.0[lane] / schedule.substeps as f64;
            }
        }
        let duration_s = schedule.substeps as f64 * self.step_s;
        self.age(begun.soc, begun.temperature_c, duration_s, step * schedule.lanes, record);
    }

    /// Chemical energy at a SOC less that at the one now, of one lane [J].
    fn drawn_j(&self, lane: usize, from_soc: f64) -> f64 {
        let rest = &self.strings[lane].rest;
        let volts = rest.integral_v(from_soc) - rest.integral_v(self.soc.0[lane]);
        SECONDS_PER_HOUR * self.capacity_ah.0[lane] * volts
    }

    fn report(&self, step: usize, begun: &ControlStep<W>, substeps: usize, record: &mut Record) {
        let mean_c = self.air_path.mean_temperature();
        for (lane, &id) in self.ids.iter().enumerate() {
            let at = step * record.lanes + id;
            let off_loss_w = self.strings[lane].inverter.off_loss_w;
            let drawn_j = self.drawn_j(lane, begun.soc.0[lane]);
            let per_lane = (off_loss_w, drawn_j);
            begun.totals.write(lane, begun.sign.0[lane], per_lane, (substeps, self.step_s), at, record);
            record.soc[at] = self.soc.0[lane];
            record.temperature_c[at] = mean_c.0[lane];
            record.limits[at] = record.limits[at].with(begun.limits[lane]);
            if !record.node_temperature_c.is_empty() {
                for (node, value) in self.air_path.temperature.iter().enumerate() {
                    record.node_temperature_c[at * record.nodes + node] = value.0[lane];
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::common;
    use crate::plant::{starting_ageing, PlantState};

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
            let mut begun = block.begin_step(&schedule, step);
            plant_steps(&mut block, &mut begun, substeps);
            block.finish_step(&begun, &schedule, step, &mut record);
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

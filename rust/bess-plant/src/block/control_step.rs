//! Interface of a block to plant and cooling: state, control steps, and the record.

use std::array::from_fn;

use bess_tables::units::SECONDS_PER_HOUR;
use bess_tables::Direction;

use super::step::plant_steps;
use super::{Block, ControlStep, Totals};
use crate::lanes::{Lanes, WIDTH};
use crate::line::Lines;
use crate::plant::{PlantState, Schedule};
use crate::record::{Limits, Record};

/// Temperatures along the coolant path in a plant step, by lane [degC].
#[derive(Debug, Clone)]
pub(crate) struct CoolantTemperatures {
    pub(crate) inlet_c: Vec<f64>,
    pub(crate) outlet_c: Vec<f64>,
    /// First and last node before the step.
    pub(crate) front_c: Vec<f64>,
    pub(crate) rear_c: Vec<f64>,
}

impl CoolantTemperatures {
    pub(crate) fn new(lanes: usize) -> Self {
        let [inlet_c, outlet_c, front_c, rear_c] = from_fn(|_| vec![0.0; lanes]);
        Self { inlet_c, outlet_c, front_c, rear_c }
    }
}

/// A plant without a common coolant calls [`Self::run`]. With one, the cooling system advances all blocks in turn: `begin`, then
/// in each plant step the flows and `cooled_step`, then `finish`. Lanes have the numbers of the plant.
impl Block {
    /// Writes the state of the lanes.
    pub(crate) fn write_state(&self, out: &mut PlantState) {
        let nodes = out.nodes();
        for (lane, &id) in self.ids.iter().enumerate() {
            out.soc[id] = self.soc.0[lane];
            for (node, value) in self.air_path.temperature.iter().enumerate() {
                out.node_temperature_c[id * nodes + node] = value.0[lane];
            }
            out.derating_integral_k[id] = self.integral_k.0[lane];
            out.inverter_on[id] = self.on.0[lane] != 0.0;
            out.ageing[id] = self.aged[lane].clone();
        }
    }

    /// Takes the state of the lanes; SOC beyond its window by rounding is put on the limit.
    pub(crate) fn set_state(&mut self, state: &PlantState) {
        let nodes = state.nodes();
        for lane in 0..WIDTH {
            let id = self.ids[lane.min(self.ids.len() - 1)];
            self.soc.0[lane] = state.soc[id].clamp(self.soc_min.0[lane], self.soc_max.0[lane]);
            self.integral_k.0[lane] = state.derating_integral_k[id];
            self.on.0[lane] = f64::from(u8::from(state.inverter_on[id]));
            let node_c = &state.node_temperature_c[id * nodes..];
            for (node, &value) in self.air_path.temperature.iter_mut().zip(node_c) {
                node.0[lane] = value;
            }
        }
        self.air_path.look_up(&from_fn(|l| &self.strings[l].resistance));
        self.aged = self.ids.iter().map(|&id| state.ageing[id].clone()).collect();
        self.follow_ageing();
    }

    pub(crate) fn run(&mut self, schedule: &Schedule, record: &mut Record) {
        for step in 0..schedule.steps {
            let mut control = self.begin(schedule, step);
            plant_steps(self, &mut control, schedule.substeps);
            self.finish(&control, schedule, step, record);
        }
    }

    pub(crate) fn begin(&mut self, schedule: &Schedule, step: usize) -> ControlStep {
        // The loss table depends on the direction.
        self.loss_lines = Lines::unknown();
        self.integrate_excess(schedule.substeps);
        let member = |l: usize| self.ids[l.min(self.ids.len() - 1)];
        let request_w: [f64; WIDTH] = from_fn(|l| schedule.request_w(step, member(l)));
        let direction = request_w.map(Direction::of);
        ControlStep {
            magnitude_w: Lanes::from_fn(|l| request_w[l].abs()),
            reactive_var: Lanes::from_fn(|l| schedule.reactive_var(step, member(l)).abs()),
            sign: Lanes::from_fn(|l| direction[l].sign()),
            direction,
            inlet_c: Lanes::from_fn(|l| schedule.ambient_c(step, member(l))),
            soc: self.soc,
            temperature_c: self.air_path.mean_temperature(),
            totals: Totals { hottest_c: Lanes::splat(f64::NEG_INFINITY), ..Totals::default() },
            limits: from_fn(|l| {
                let below = request_w[l] != 0.0 && request_w[l].abs() < self.min_power_w.0[l];
                if below {
                    Limits::MIN_POWER
                } else {
                    Limits::NONE
                }
            }),
        }
    }

    /// Writes the mean temperature of every lane [degC].
    pub(crate) fn means_c(&self, means_c: &mut [f64]) {
        let mean_c = self.air_path.mean_temperature();
        self.ids.iter().enumerate().for_each(|(lane, &id)| means_c[id] = mean_c.0[lane]);
    }

    /// Changes the flow of a lane, if it is one of these, to a share of the full one.
    pub(crate) fn set_flow(&mut self, id: usize, share: f64) {
        for lane in (0..WIDTH).filter(|&lane| self.ids.get(lane) == Some(&id)) {
            self.air_path.set_flow(lane, &self.coefficients[lane].at_flow(share));
        }
    }

    /// Temperature at which the coolant would leave a lane, if it is one of these [degC].
    pub(crate) fn outlet_c(&self, id: usize, inlet_c: f64) -> Option<f64> {
        let lane = self.ids.iter().position(|&own| own == id)?;
        Some(self.air_path.outlet(Lanes::splat(inlet_c)).0[lane])
    }

    /// One plant step with the inlets of `coolant`; writes the outlets and the surface temperatures that the coolant met.
    pub(crate) fn cooled_step(&mut self, control: &mut ControlStep, coolant: &mut CoolantTemperatures) {
        let nodes = &self.air_path.temperature;
        for (lane, &id) in self.ids.iter().enumerate() {
            control.inlet_c.0[lane] = coolant.inlet_c[id];
            coolant.front_c[id] = nodes[0].0[lane];
            coolant.rear_c[id] = nodes[nodes.len() - 1].0[lane];
        }
        let outlet_c = self.air_path.outlet(control.inlet_c);
        self.ids.iter().enumerate().for_each(|(lane, &id)| coolant.outlet_c[id] = outlet_c.0[lane]);
        plant_steps(self, control, 1);
    }

    pub(crate) fn finish(
        &mut self,
        control: &ControlStep,
        schedule: &Schedule,
        step: usize,
        record: &mut Record,
    ) {
        let mean_c = self.air_path.mean_temperature();
        for (lane, &id) in self.ids.iter().enumerate() {
            let at = step * schedule.lanes + id;
            self.report(control, lane, schedule.substeps as f64, at, record);
            record.temperature_c[at] = mean_c.0[lane];
            let sign = Direction::of(schedule.reactive_var(step, id)).sign();
            record.reactive_var[at] = sign * control.totals.reactive_var.0[lane] / schedule.substeps as f64;
        }
        let duration_s = schedule.substeps as f64 * self.step_s;
        self.age(control.soc, control.temperature_c, duration_s, step * schedule.lanes, record);
    }

    /// Decrease of the chemical energy of one lane from a SOC to the present one [J].
    pub(super) fn drawn_j(&self, lane: usize, from_soc: f64) -> f64 {
        let rest = &self.strings[lane].rest;
        let volts = rest.integral_v(from_soc) - rest.integral_v(self.soc.0[lane]);
        SECONDS_PER_HOUR * self.capacity_ah.0[lane] * volts
    }

    /// Writes the flows of one lane as entry `at`: means over `n` plant steps, and the ledger.
    fn report(&self, control: &ControlStep, lane: usize, n: f64, at: usize, record: &mut Record) {
        let totals = &control.totals;
        let drawn_j = self.drawn_j(lane, control.soc.0[lane]);
        let delivered_w = control.sign.0[lane] * totals.delivered_w.0[lane];
        let standby_w =
            totals.off_steps.0[lane] * self.strings[lane].inverter.off_loss_w + totals.grid_loss_w.0[lane];
        let loss_w = totals.loss_on_w.0[lane] + standby_w;
        let (heat_w, hysteresis_w) = (totals.heat_w.0[lane], totals.hysteresis_w.0[lane]);
        let shift_w = totals.ocv_shift_w.0[lane];
        record.delivered_w[at] = delivered_w / n;
        record.availability_loss_w[at] = totals.availability_loss_w.0[lane] / n;
        record.derating_loss_w[at] = totals.derating_loss_w.0[lane] / n;
        record.inverter_loss_w[at] = loss_w / n;
        record.standby_w[at] = standby_w / n;
        record.battery_loss_w[at] = heat_w / n;
        record.reversible_heat_w[at] = totals.reversible_w.0[lane] / n;
        record.hysteresis_loss_w[at] = hysteresis_w / n;
        record.chemical_w[at] = drawn_j / (n * self.step_s);
        record.ocv_shift_w[at] = shift_w / n;
        record.current_a[at] = totals.current_a.0[lane] / n;
        record.node_max_c[at] = totals.hottest_c.0[lane];
        record.derating_factor[at] = totals.factor.0[lane] / n;
        record.inverter_starts[at] = totals.starts.0[lane];
        record.soc[at] = self.soc.0[lane];
        // An inverter without active power draws its loss from the grid, in addition to the delivered power.
        let ac_w = standby_w - delivered_w;
        record.ledger_residual_j[at] =
            (ac_w - (heat_w + hysteresis_w + loss_w - shift_w)) * self.step_s + drawn_j;
        let derated = if totals.derating_loss_w.0[lane] > 0.0 { Limits::DERATING } else { Limits::NONE };
        record.limits[at] = derated.with(control.limits[lane]);
        if !record.node_temperature_c.is_empty() {
            for (node, value) in self.air_path.temperature.iter().enumerate() {
                record.node_temperature_c[at * record.nodes + node] = value.0[lane];
            }
        }
    }

    /// Updates capacity and resistance to the present state of health.
    fn follow_ageing(&mut self) {
        for lane in 0..WIDTH {
            let loss = self.aged[lane.min(self.aged.len() - 1)].loss();
            let capacity_ah = self.strings[lane].capacity_ah * loss.soh_capacity;
            self.capacity_ah.0[lane] = capacity_ah;
            self.soc_per_a.0[lane] = self.step_s / (SECONDS_PER_HOUR * capacity_ah);
            self.growth.0[lane] = loss.soh_resistance;
        }
    }

    /// Ages the strings by a control step from `soc` and `temperature_c` to the present state, and records the loss.
    #[inline(never)]
    fn age(&mut self, soc: Lanes, temperature_c: Lanes, duration_s: f64, first: usize, record: &mut Record) {
        let now_c = self.air_path.mean_temperature();
        let mut changed = false;
        for (lane, &id) in self.ids.iter().enumerate() {
            let moved = (soc.0[lane], self.soc.0[lane]);
            let mean_c = 0.5 * (temperature_c.0[lane] + now_c.0[lane]);
            changed |= self.ageing[lane].observe(&mut self.aged[lane], moved, mean_c, duration_s);
            let loss = self.aged[lane].loss();
            record.soh_capacity[first + id] = loss.soh_capacity;
            record.soh_resistance[first + id] = loss.soh_resistance;
            record.calendar_loss[first + id] = loss.calendar;
            record.cyclic_loss[first + id] = loss.cyclic;
        }
        if changed {
            let before_ah = self.capacity_ah;
            self.follow_ageing();
            for (lane, &id) in self.ids.iter().enumerate() {
                let lost_ah = before_ah.0[lane] - self.capacity_ah.0[lane];
                record.aged_charge_ah[first + id] = self.soc.0[lane] * lost_ah;
            }
        }
    }
}

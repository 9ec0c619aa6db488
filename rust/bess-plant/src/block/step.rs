//! One plant step of all lanes: derating, electrical balance, heat.

use bess_tables::units::ZERO_C_IN_K;
use bess_tables::{widest, Resistance};

use super::{Block, ControlStep, Totals};
use crate::electrical::{Demand, OperatingPoint};
use crate::lanes::{Lanes, WIDTH};
use crate::line::{Line, Margin};
use crate::measured_resistance;
use crate::record::Limits;

struct LaneFlows {
    delivered_w: Lanes,
    loss_w: Lanes,
    current_a: Lanes,
    /// Electrical resistance of the string [Ohm].
    resistance: Lanes,
    /// Factor from the stored resistance of a node to its present one.
    node_factor: Lanes,
    soc: Lanes,
}

widest! {
    /// Plant steps of a control step.
    pub(super) fn plant_steps(block: &mut Block, control: &mut ControlStep, substeps: usize) {
        let reactive = control.reactive_var.0.iter().any(|&asked_var| asked_var > 0.0);
        // Compiled for each case, so that strings without uniform heat or reactive power do not compute them.
        match (block.any_uniform_heat, reactive) {
            (false, false) => block.repeat::<false, false>(control, substeps),
            (true, false) => block.repeat::<true, false>(control, substeps),
            (false, true) => block.repeat::<false, true>(control, substeps),
            (true, true) => block.repeat::<true, true>(control, substeps),
        }
    }
}

impl Block {
    #[inline(always)]
    fn repeat<const UNIFORM_HEAT: bool, const REACTIVE: bool>(
        &mut self,
        control: &mut ControlStep,
        substeps: usize,
    ) {
        // A local, because the compiler keeps it in registers.
        let mut step = *control;
        for _ in 0..substeps {
            self.plant_step::<UNIFORM_HEAT, REACTIVE>(&mut step);
        }
        *control = step;
    }

    #[inline(always)]
    fn plant_step<const UNIFORM_HEAT: bool, const REACTIVE: bool>(&mut self, control: &mut ControlStep) {
        let ControlStep { magnitude_w, reactive_var: asked_var, sign, direction, inlet_c, .. } = *control;
        let totals = &mut control.totals;
        let zero = Lanes::ZERO;
        let mean_c = self.air_path.mean_temperature();
        let soc = self.soc;

        let factor = self.derating_factor(mean_c);
        let wanted_w = factor * magnitude_w;
        // An inverter that would deliver less than its minimum power stays off.
        let min_power_w = self.min_power_w;
        let started_w =
            Lanes::from_fn(|l| if wanted_w.0[l] < min_power_w.0[l] { 0.0 } else { wanted_w.0[l] });
        let strings = &self.strings;

        let charge_v =
            self.charge_v_lines.at(soc, |l, at| Line::of_grid(&strings[l].ocv_charge, at, mean_c.0[l]));
        let discharge_v =
            self.discharge_v_lines.at(soc, |l, at| Line::of_grid(&strings[l].ocv_discharge, at, mean_c.0[l]));
        let low_soc = self.low_soc_lines.at(soc, |l, at| low_soc_line(&strings[l].resistance, at));
        let node_factor = low_soc * self.growth;
        let resistance = self.air_path.mean_resistance() * node_factor;

        // Active power takes precedence: it limits reactive power to the remaining apparent power of the inverter.
        let (reactive_var, apparent_va) = if REACTIVE {
            let active = started_w * started_w;
            let left = (self.nominal_w * self.nominal_w - active).max(zero);
            let reactive_var = asked_var.min(left.sqrt());
            (reactive_var, (active + reactive_var * reactive_var).sqrt())
        } else {
            (zero, started_w)
        };

        // Without an active limit: V I - R I^2 = sign p + w, small root.
        let loss_at =
            self.loss_lines.at(apparent_va, |l, at| Line::of(strings[l].inverter.loss(direction[l]), at));
        let loss_w = started_w.if_positive(loss_at, zero);
        let power_w = sign * started_w + loss_w;
        let voltage_v = power_w.if_positive(discharge_v, charge_v);
        let discriminant = voltage_v * voltage_v - Lanes::splat(4.0) * resistance * power_w;
        let root = discriminant.max(zero).sqrt();
        let current_a = (power_w + power_w).divided_by(voltage_v + root);
        let soc_end = soc - current_a * self.soc_per_a;

        let mut flows =
            LaneFlows { delivered_w: started_w, loss_w, current_a, resistance, node_factor, soc: soc_end };
        let (soc_min, soc_max) = (self.soc_min, self.soc_max);
        let terminal_v = voltage_v - resistance * current_a;
        let (voltage_min_v, voltage_max_v) = (self.voltage_min_v, self.voltage_max_v);
        let limited = |lane: usize| {
            (discriminant.0[lane] < 0.0)
                | (soc_end.0[lane] < soc_min.0[lane])
                | (soc_end.0[lane] > soc_max.0[lane])
                | (terminal_v.0[lane] < voltage_min_v.0[lane])
                | (terminal_v.0[lane] > voltage_max_v.0[lane])
        };
        if self.any_measured || (0..WIDTH).fold(false, |any, lane| any | limited(lane)) {
            for (lane, direction) in direction.into_iter().enumerate() {
                let demand = Demand {
                    direction,
                    wanted_w: started_w.0[lane],
                    reactive_var: reactive_var.0[lane],
                    soc: soc.0[lane],
                    charge_v: charge_v.0[lane],
                    discharge_v: discharge_v.0[lane],
                    step_s: self.step_s,
                    capacity_ah: self.capacity_ah.0[lane],
                };
                self.limit_lane(lane, limited(lane), &demand, &mut flows, &mut control.limits[lane]);
            }
        }
        self.soc = flows.soc;

        let squared = flows.current_a * flows.current_a;
        let heat_w = squared * flows.resistance;
        let mut on = flows.delivered_w.if_positive(Lanes::splat(1.0), zero);
        if REACTIVE {
            // An inverter without active power draws its loss due to reactive power from the grid.
            let of_grid = Lanes::from_fn(|l| {
                if flows.delivered_w.0[l] > 0.0 || reactive_var.0[l] == 0.0 {
                    0.0
                } else {
                    self.strings[l].inverter.loss(direction[l]).at(reactive_var.0[l])
                }
            });
            on = on.max(reactive_var.if_positive(Lanes::splat(1.0), zero));
            totals.grid_loss_w = totals.grid_loss_w + of_grid;
            totals.reactive_var = totals.reactive_var + reactive_var;
        }
        totals.delivered_w = totals.delivered_w + flows.delivered_w;
        totals.availability_loss_w = totals.availability_loss_w + (wanted_w - flows.delivered_w);
        totals.derating_loss_w = totals.derating_loss_w + (magnitude_w - wanted_w);
        totals.loss_on_w = totals.loss_on_w + flows.loss_w;
        totals.off_steps = totals.off_steps + (Lanes::splat(1.0) - on);
        totals.heat_w = totals.heat_w + heat_w;
        let half = Lanes::splat(0.5);
        let (current_a, moved) = (flows.current_a, flows.soc - soc);
        let hysteresis_w = half * (charge_v - discharge_v) * current_a.max(zero - current_a);
        totals.hysteresis_w = totals.hysteresis_w + hysteresis_w;
        // Midpoint of the mean voltage, which is linear over a segment; lanes that leave their segment follow below.
        let mean_slope = half * (self.charge_v_lines.slope() + self.discharge_v_lines.slope());
        let mut shift_w = zero - half * mean_slope * moved * current_a;
        let margin = self.charge_v_lines.margin(flows.soc);
        if margin.any_outside() {
            let mean_v = half * (charge_v + discharge_v);
            self.shift_beyond(&margin, (mean_v, current_a), soc, &mut shift_w);
        }
        totals.ocv_shift_w = totals.ocv_shift_w + shift_w;
        totals.current_a = totals.current_a + flows.current_a;
        totals.factor = totals.factor + factor;
        totals.starts = totals.starts + on * (Lanes::splat(1.0) - self.on);
        self.on = on;

        let heating = self.k_per_w * squared * flows.node_factor;
        let tables = std::array::from_fn(|l| &self.strings[l].resistance);
        if UNIFORM_HEAT {
            self.advance_with_uniform_heat(heating, flows.current_a, hysteresis_w, soc, inlet_c, totals);
        } else {
            totals.hottest_c = self.air_path.advance(heating, inlet_c, totals.hottest_c, &tables);
        }
    }

    /// Heat along the path plus uniform heat: the heat of reaction, `-I T dU/dT`, and the hysteresis loss of strings that it
    /// heats. All depend on the state before the step, so their order does not matter.
    #[cold]
    #[inline(never)]
    fn advance_with_uniform_heat(
        &mut self,
        heating: Lanes,
        current_a: Lanes,
        hysteresis_w: Lanes,
        soc: Lanes,
        inlet_c: Lanes,
        totals: &mut Totals,
    ) {
        let mean_c = self.air_path.mean_temperature();
        let reversible_w = Lanes::from_fn(|l| {
            let volts_k = self.strings[l].entropy.as_ref().map_or(0.0, |table| table.at(soc.0[l]));
            -current_a.0[l] * (mean_c.0[l] + ZERO_C_IN_K) * volts_k
        });
        totals.reversible_w = totals.reversible_w + reversible_w;
        let tables = std::array::from_fn(|l| &self.strings[l].resistance);
        self.air_path.advance(heating, inlet_c, mean_c, &tables);
        let uniform_w = reversible_w + self.hysteresis_heat * hysteresis_w;
        totals.hottest_c = self.air_path.warm(self.k_per_w * uniform_w, totals.hottest_c, &tables);
    }

    /// OCV shift (see `ocv_shift_w` of the record) of lanes whose table is not linear over the step: they pass a knot, or depend on
    /// temperature.
    #[cold]
    #[inline(never)]
    fn shift_beyond(
        &self,
        margin: &Margin,
        (mean_v, current_a): (Lanes, Lanes),
        before: Lanes,
        shift_w: &mut Lanes,
    ) {
        for lane in (0..WIDTH).filter(|&lane| margin.is_outside(lane)) {
            let drawn_w = self.drawn_j(lane, before.0[lane]) / self.step_s;
            shift_w.0[lane] = mean_v.0[lane] * current_a.0[lane] - drawn_w;
        }
    }

    /// Recomputes the flows of a lane that has an active limit, or a resistance that depends on its current.
    #[cold]
    #[inline(never)]
    fn limit_lane(
        &mut self,
        lane: usize,
        limited: bool,
        demand: &Demand,
        flows: &mut LaneFlows,
        limits: &mut Limits,
    ) {
        let string = &self.strings[lane];
        // A charging string whose inverter loss exceeds its power discharges slightly; the charge table applies to it too.
        if let Some(tables) = measured_resistance::tables(&string.resistance, demand.direction) {
            let temperatures = self.air_path.temperature.iter().map(|node| node.0[lane]);
            flows.resistance.0[lane] = self.measured.solve(
                tables,
                self.growth.0[lane],
                demand.soc,
                temperatures,
                string.capacity_ah,
                |r| demand.operating_point(string, r).current_a,
            );
            flows.node_factor.0[lane] = 1.0;
            for (node, resistance) in self.air_path.resistance.iter_mut().enumerate() {
                resistance.0[lane] = self.measured.node(node);
            }
        } else if !limited {
            return;
        }
        let OperatingPoint { delivered_w, loss_w, current_a, soc, limits: bound } =
            demand.operating_point(string, flows.resistance.0[lane]);
        flows.delivered_w.0[lane] = delivered_w;
        flows.loss_w.0[lane] = loss_w;
        flows.current_a.0[lane] = current_a;
        flows.soc.0[lane] = soc;
        *limits = limits.with(bound);
    }
}

/// Factor on `f_T` below the low-SOC switch, 1 above it.
fn low_soc_line(resistance: &Resistance, soc: f64) -> Line {
    match resistance {
        Resistance::Measured { .. } => Line::constant(f64::NEG_INFINITY, f64::INFINITY, 1.0),
        Resistance::Switched { low_soc_switch, .. } if soc >= *low_soc_switch => {
            Line::constant(*low_soc_switch, f64::INFINITY, 1.0)
        }
        Resistance::Switched { soc_factor, low_soc_switch, .. } => {
            let line = Line::of(soc_factor, soc);
            Line { high: line.high.min(*low_soc_switch), ..line }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::block::DeratingLaw;
    use crate::plant::{starting_ageing, PlantState, Schedule};
    use crate::record::Record;
    use crate::tests::common;

    /// Strings through all regimes: full, empty, hot, idle.
    fn record(
        reactive_var: Option<&[f64]>,
        plant_steps: impl Fn(&mut Block, &mut ControlStep, usize),
    ) -> Record {
        let system = common::reference(WIDTH);
        let members: Vec<_> = system.strings.iter().enumerate().collect();
        let mut block = Block::new(&members, DeratingLaw::Pi, 10.0).unwrap();
        let node_c = |at: usize| 20.0 + 12.0 * (at / 40) as f64 + 0.1 * (at % 40) as f64;
        let ones = [1.0; WIDTH];
        block.set_state(&PlantState {
            soc: (0..WIDTH).map(|l| l as f64 / (WIDTH - 1) as f64).collect(),
            node_temperature_c: (0..40 * WIDTH).map(node_c).collect(),
            derating_integral_k: vec![0.3; WIDTH],
            inverter_on: vec![false; WIDTH],
            ageing: starting_ageing(&system, &ones, &ones).unwrap(),
            cooling: None,
        });
        let (steps, substeps) = (30, 90);
        let request_w: Vec<f64> = (0..steps * WIDTH).map(|at| 92e3 * (0.37 * at as f64).sin()).collect();
        let ambient_c = vec![25.0; steps];
        let schedule = Schedule {
            steps,
            substeps,
            lanes: WIDTH,
            strings: WIDTH,
            request_w: &request_w,
            ambient_c: &ambient_c,
            reactive_var,
        };
        let mut record = Record::new(steps, (1, WIDTH), 40, true);
        for step in 0..steps {
            let mut control = block.begin(&schedule, step);
            plant_steps(&mut block, &mut control, substeps);
            block.finish(&control, &schedule, step, &mut record);
        }
        record
    }

    #[test]
    fn wider_instructions_change_no_bit_of_a_plant_step() {
        // As text, because unrecorded values are NaN, which is not equal to itself.
        let text = |record: Record| format!("{record:?}");
        let asked_var: Vec<f64> = (0..30 * WIDTH).map(|at| 92e3 * (0.11 * at as f64).cos()).collect();
        for reactive_var in [None, Some(&asked_var[..])] {
            let widest = record(reactive_var, plant_steps);
            assert_eq!(text(widest), text(record(reactive_var, plant_steps::portable)));
        }
    }

    #[test]
    fn no_reactive_power_changes_no_bit() {
        let without = record(None, plant_steps);
        let with = record(Some(&[0.0; 30 * WIDTH]), plant_steps);
        assert_eq!(format!("{with:?}"), format!("{without:?}"));
    }
}

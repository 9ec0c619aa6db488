//! One plant step of all lanes: derating, electrical balance, heat.

use bess_tables::units::ZERO_C_IN_K;
use bess_tables::{widest, Resistance};

use super::{Block, ControlStep, Totals};
use crate::electrical::{Demand, Operation};
use crate::lanes::{Lanes, WIDTH};
use crate::line::{Line, Margin};
use crate::measured_resistance;
use crate::record::Limits;

struct Drawn {
    delivered_w: Lanes,
    loss_w: Lanes,
    current_a: Lanes,
    /// Electrical resistance of the string [Ohm].
    resistance: Lanes,
    /// Factor from a node's stored resistance to the one in force.
    node_factor: Lanes,
    soc: Lanes,
}

widest! {
    /// Plant steps of a control step.
    pub(super) fn plant_steps(block: &mut Block, begun: &mut ControlStep, substeps: usize) {
        let reactive = begun.reactive_var.0.iter().any(|&asked_var| asked_var > 0.0);
        // Compiled for each, so that strings without even heat or reactive power do not pay for it.
        match (block.any_even_heat, reactive) {
            (false, false) => block.repeat::<false, false>(begun, substeps),
            (true, false) => block.repeat::<true, false>(begun, substeps),
            (false, true) => block.repeat::<false, true>(begun, substeps),
            (true, true) => block.repeat::<true, true>(begun, substeps),
        }
    }
}

impl Block {
    #[inline(always)]
    fn repeat<const EVEN_HEAT: bool, const REACTIVE: bool>(
        &mut self,
        begun: &mut ControlStep,
        substeps: usize,
    ) {
        // A local, because the compiler keeps it in registers.
        let mut step = *begun;
        for _ in 0..substeps {
            self.plant_step::<EVEN_HEAT, REACTIVE>(&mut step);
        }
        *begun = step;
    }

    #[inline(always)]
    fn plant_step<const EVEN_HEAT: bool, const REACTIVE: bool>(&mut self, begun: &mut ControlStep) {
        let ControlStep { magnitude_w, reactive_var: asked_var, sign, direction, inlet_c, .. } = *begun;
        let totals = &mut begun.totals;
        let zero = Lanes::ZERO;
        let mean_c = self.air_path.mean_temperature();
        let soc = self.soc;

        let factor = self.derating_factor(mean_c);
        let wanted_w = factor * magnitude_w;
        // An inverter that would deliver less than its least power stays off.
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

        // Active power comes first: reactive power gets what it leaves of the inverter's apparent power.
        let (reactive_var, apparent_va) = if REACTIVE {
            let active = started_w * started_w;
            let left = (self.nominal_w * self.nominal_w - active).at_least(zero);
            let reactive_var = asked_var.at_most(left.sqrt());
            (reactive_var, (active + reactive_var * reactive_var).sqrt())
        } else {
            (zero, started_w)
        };

        // Where no limit is near: V I - R I^2 = sign p + w, small root.
        let loss_at =
            self.loss_lines.at(apparent_va, |l, at| Line::of(strings[l].inverter.loss(direction[l]), at));
        let loss_w = started_w.if_positive(loss_at, zero);
        let power_w = sign * started_w + loss_w;
        let voltage_v = power_w.if_positive(discharge_v, charge_v);
        let discriminant = voltage_v * voltage_v - Lanes::splat(4.0) * resistance * power_w;
        let root = discriminant.at_least(zero).sqrt();
        let current_a = (power_w + power_w).divided_by(voltage_v + root);
        let soc_end = soc - current_a * self.soc_per_a;

        let mut drawn =
            Drawn { delivered_w: started_w, loss_w, current_a, resistance, node_factor, soc: soc_end };
        let (soc_min, soc_max) = (self.soc_min, self.soc_max);
        let terminal_v = voltage_v - resistance * current_a;
        let (voltage_min_v, voltage_max_v) = (self.voltage_min_v, self.voltage_max_v);
        let special = |lane: usize| {
            (discriminant.0[lane] < 0.0)
                | (soc_end.0[lane] < soc_min.0[lane])
                | (soc_end.0[lane] > soc_max.0[lane])
                | (terminal_v.0[lane] < voltage_min_v.0[lane])
                | (terminal_v.0[lane] > voltage_max_v.0[lane])
        };
        if self.any_measured || (0..WIDTH).fold(false, |any, lane| any | special(lane)) {
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
                self.special_lane(lane, special(lane), &demand, &mut drawn, &mut begun.limits[lane]);
            }
        }
        self.soc = drawn.soc;

        let squared = drawn.current_a * drawn.current_a;
        let heat_w = squared * drawn.resistance;
        let mut on = drawn.delivered_w.if_positive(Lanes::splat(1.0), zero);
        if REACTIVE {
            // An inverter that delivers no active power draws what reactive power costs it from the grid.
            let of_grid = Lanes::from_fn(|l| {
                if drawn.delivered_w.0[l] > 0.0 || reactive_var.0[l] == 0.0 {
                    0.0
                } else {
                    self.strings[l].inverter.loss(direction[l]).at(reactive_var.0[l])
                }
            });
            on = on.at_least(reactive_var.if_positive(Lanes::splat(1.0), zero));
            totals.grid_loss_w = totals.grid_loss_w + of_grid;
            totals.reactive_var = totals.reactive_var + reactive_var;
        }
        totals.delivered_w = totals.delivered_w + drawn.delivered_w;
        totals.availability_loss_w = totals.availability_loss_w + (wanted_w - drawn.delivered_w);
        totals.derating_loss_w = totals.derating_loss_w + (magnitude_w - wanted_w);
        totals.loss_on_w = totals.loss_on_w + drawn.loss_w;
        totals.off_steps = totals.off_steps + (Lanes::splat(1.0) - on);
        totals.heat_w = totals.heat_w + heat_w;
        let half = Lanes::splat(0.5);
        let (current_a, moved) = (drawn.current_a, drawn.soc - soc);
        let hysteresis_w = half * (charge_v - discharge_v) * current_a.at_least(zero - current_a);
        totals.hysteresis_w = totals.hysteresis_w + hysteresis_w;
        // Half way along the straight mean of both voltages; not where a lane leaves its segment.
        let mean_slope = half * (self.charge_v_lines.slope() + self.discharge_v_lines.slope());
        let mut shift_w = zero - half * mean_slope * moved * current_a;
        let margin = self.charge_v_lines.margin(drawn.soc);
        if margin.any_left() {
            let mean_v = half * (charge_v + discharge_v);
            self.shift_beyond(&margin, (mean_v, current_a), soc, &mut shift_w);
        }
        totals.ocv_shift_w = totals.ocv_shift_w + shift_w;
        totals.current_a = totals.current_a + drawn.current_a;
        totals.factor = totals.factor + factor;
        totals.starts = totals.starts + on * (Lanes::splat(1.0) - self.on);
        self.on = on;

        let heating = self.k_per_w * squared * drawn.node_factor;
        let tables = std::array::from_fn(|l| &self.strings[l].resistance);
        if EVEN_HEAT {
            self.advance_with_even_heat(heating, drawn.current_a, hysteresis_w, soc, inlet_c, totals);
        } else {
            totals.hottest_c = self.air_path.advance(heating, inlet_c, totals.hottest_c, &tables);
        }
    }

    /// Heat along the path plus the heat that is equal in all nodes: `-I T dU/dT`, the heat of reaction, and that of hysteresis in
    /// the lanes that it warms. All are of the state before the step, so their order does not matter.
    #[cold]
    #[inline(never)]
    fn advance_with_even_heat(
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
        let even_w = reversible_w + self.hysteresis_heat * hysteresis_w;
        totals.hottest_c = self.air_path.warm(self.k_per_w * even_w, totals.hottest_c, &tables);
    }

    /// Power of the voltage in use beyond the decrease of chemical energy, for lanes whose table is not linear over the step:
    /// they reach another knot, or depend on temperature.
    #[cold]
    #[inline(never)]
    fn shift_beyond(
        &self,
        margin: &Margin,
        (mean_v, current_a): (Lanes, Lanes),
        before: Lanes,
        shift_w: &mut Lanes,
    ) {
        for lane in (0..WIDTH).filter(|&lane| margin.left(lane)) {
            let drawn_w = self.drawn_j(lane, before.0[lane]) / self.step_s;
            shift_w.0[lane] = mean_v.0[lane] * current_a.0[lane] - drawn_w;
        }
    }

    /// Replaces what was drawn from a lane that has a limit, or a resistance that depends on its own current.
    #[cold]
    #[inline(never)]
    fn special_lane(
        &mut self,
        lane: usize,
        limited: bool,
        demand: &Demand,
        drawn: &mut Drawn,
        limits: &mut Limits,
    ) {
        let string = &self.strings[lane];
        // A string that charges with less than its inverter loses discharges a little; its charge table serves.
        if let Some(tables) = measured_resistance::tables(&string.resistance, demand.direction) {
            let temperatures = self.air_path.temperature.iter().map(|node| node.0[lane]);
            drawn.resistance.0[lane] = self.measured.solve(
                tables,
                self.growth.0[lane],
                demand.soc,
                temperatures,
                string.capacity_ah,
                |r| demand.operate(string, r).current_a,
            );
            drawn.node_factor.0[lane] = 1.0;
            for (node, resistance) in self.air_path.resistance.iter_mut().enumerate() {
                resistance.0[lane] = self.measured.node(node);
            }
        } else if !limited {
            return;
        }
        let Operation { delivered_w, loss_w, current_a, soc, limits: bound } =
            demand.operate(string, drawn.resistance.0[lane]);
        drawn.delivered_w.0[lane] = delivered_w;
        drawn.loss_w.0[lane] = loss_w;
        drawn.current_a.0[lane] = current_a;
        drawn.soc.0[lane] = soc;
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
            let mut begun = block.begin(&schedule, step);
            plant_steps(&mut block, &mut begun, substeps);
            block.finish(&begun, &schedule, step, &mut record);
        }
        record
    }

    #[test]
    fn the_widest_instructions_at_hand_change_no_bit() {
        // As text, because what was not recorded is NaN, which equals nothing.
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

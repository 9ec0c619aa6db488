//! Flows, source and common loop of every scenario of a plant.

use bess_tables::units::W_PER_KW;
use bess_tables::{Cooling, InputError, StringParameters};

use super::kinds::{Kind, Source, Supply};
use super::thermostat::{max_stages, share, stages};
use super::{cop, kind};
use crate::block::{Block, ControlStep, CoolantTemperatures};
use crate::check::check_range;
use crate::plant::Schedule;
use crate::record::Record;
use crate::thermal::Coefficients;

/// Cooling state of a plant.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CoolingState {
    /// Stages of flow that are on in each lane.
    pub stages: Vec<u8>,
    /// Whether the chiller of each scenario may run.
    pub chilling: Vec<bool>,
    /// Temperature of the common loop of each scenario [degC]; without a loop, that of its strings.
    pub loop_c: Vec<f64>,
}

/// Coolant circuit of one string.
#[derive(Debug, Clone, Copy)]
struct CoolantCircuit {
    /// Heat capacity flow of all packs at full flow [W/K].
    flow_w_k: f64,
    /// Conductance of each end face, all packs [W/K].
    end_w_k: f64,
    /// Power of fan or pump at full flow, all packs [W].
    mover_w: f64,
}

/// Cooling of all scenarios. Its state is part of the plant's.
#[derive(Debug, Clone)]
pub(crate) struct CoolingSystem {
    cooling: Cooling,
    kind: &'static Kind,
    circuits: Vec<CoolantCircuit>,
    step_s: f64,
    pub(crate) state: CoolingState,
    // Work space: share of the full flow, and sums over a control step.
    share: Vec<f64>,
    coolant: CoolantTemperatures,
    removed_w: Vec<f64>,
    auxiliary_w: Vec<f64>,
}

impl CoolingSystem {
    pub(crate) fn new(
        cooling: &Cooling,
        strings: &[StringParameters],
        scenarios: usize,
        step_s: f64,
    ) -> Result<Self, InputError> {
        let circuits: Vec<CoolantCircuit> = strings
            .iter()
            .map(|string| {
                let thermal = &string.spatial;
                let packs = f64::from(thermal.packs_per_string);
                let flow_kg_s = packs * thermal.air_flow_kg_s;
                CoolantCircuit {
                    flow_w_k: flow_kg_s * thermal.air_cp_j_kgk,
                    end_w_k: packs * Coefficients::new(thermal, step_s).end_w_k,
                    mover_w: flow_kg_s * cooling.pressure_pa
                        / (cooling.density_kg_m3 * cooling.mover_efficiency),
                }
            })
            .collect();
        if let Some(common) = &cooling.common {
            // The rate at maximum heat transfer of all strings is limited, so the loop cannot overshoot their temperatures.
            let max_w_k: f64 = circuits.iter().map(|circuit| circuit.flow_w_k + 2.0 * circuit.end_w_k).sum();
            let rate = step_s * (max_w_k + common.wall_w_k) / W_PER_KW;
            let place = || format!("cooling.loop, with a plant step of {step_s} s: ");
            check_range("heat_capacity_kj_k", common.heat_capacity_kj_k, " kJ/K", (rate, f64::MAX), place)?;
        }
        let lanes = scenarios * strings.len();
        let zeros = vec![0.0; lanes];
        Ok(Self {
            kind: kind(&cooling.kind)?,
            cooling: cooling.clone(),
            circuits,
            step_s,
            state: CoolingState::default(),
            share: zeros.clone(),
            coolant: CoolantTemperatures::new(lanes),
            removed_w: zeros,
            auxiliary_w: vec![0.0; scenarios],
        })
    }

    pub(crate) fn max_stages(&self) -> usize {
        max_stages(&self.cooling)
    }

    /// Runs a schedule: all blocks one plant step after the other, with the coolant between them.
    pub(crate) fn run(&mut self, blocks: &mut [Block], schedule: &Schedule, record: &mut Record) {
        // NaN differs from every share: each flow is set in the first plant step.
        self.share.fill(f64::NAN);
        for step in 0..schedule.steps {
            let mut control: Vec<_> = blocks.iter_mut().map(|block| block.begin(schedule, step)).collect();
            self.removed_w.fill(0.0);
            self.auxiliary_w.fill(0.0);
            for _ in 0..schedule.substeps {
                self.plant_step(blocks, &mut control, schedule, step);
            }
            for (block, control) in blocks.iter_mut().zip(&control) {
                block.finish(control, schedule, step, record);
            }
            let n = schedule.substeps as f64;
            for (lane, removed_w) in self.removed_w.iter().enumerate() {
                record.cooling_w[step * schedule.lanes + lane] = removed_w / n;
            }
            for (scenario, auxiliary_w) in self.auxiliary_w.iter().enumerate() {
                let at = step * self.state.chilling.len() + scenario;
                record.auxiliary_w[at] = auxiliary_w / n;
                let (_, inlet_c) =
                    self.supply(scenario, schedule.ambient_c(step, scenario * schedule.strings));
                record.coolant_c[at] = inlet_c;
            }
        }
    }

    fn plant_step(
        &mut self,
        blocks: &mut [Block],
        control: &mut [ControlStep],
        schedule: &Schedule,
        step: usize,
    ) {
        let strings = self.circuits.len();
        // `outlet_c` holds the mean temperatures until the coolant has passed.
        for block in blocks.iter() {
            block.means_c(&mut self.coolant.outlet_c);
        }
        for scenario in 0..self.state.chilling.len() {
            let lanes = scenario * strings..(scenario + 1) * strings;
            let ambient_c = schedule.ambient_c(step, lanes.start);
            let means_c = &self.coolant.outlet_c[lanes.clone()];
            let warmest_c = means_c.iter().fold(f64::NEG_INFINITY, |most, &mean| most.max(mean));
            self.state.chilling[scenario] =
                (self.kind.chills)(&self.cooling, warmest_c, self.state.chilling[scenario]);
            let (_, inlet_c) = self.supply(scenario, ambient_c);
            self.coolant.inlet_c[lanes].fill(inlet_c);
        }
        self.set_flows(blocks);
        if self.cooling.common.as_ref().is_some_and(|common| common.series) {
            self.connect_in_series(blocks);
        }
        for (block, control) in blocks.iter_mut().zip(control) {
            block.cooled_step(control, &mut self.coolant);
        }
        for scenario in 0..self.state.chilling.len() {
            self.exchange_heat(scenario, schedule.ambient_c(step, scenario * strings));
        }
    }

    /// Set-point of the coolant, and its temperature at the first string [degC].
    fn supply(&self, scenario: usize, ambient_c: f64) -> (Supply, f64) {
        let supply = (self.kind.supply)(&self.cooling, ambient_c, self.state.chilling[scenario]);
        let inlet_c =
            if self.cooling.common.is_some() { self.state.loop_c[scenario] } else { supply.temperature_c };
        (supply, inlet_c)
    }

    /// Sets the flow of each string by its thermostat or, where one flow passes all strings, by the thermostat with the largest flow.
    fn set_flows(&mut self, blocks: &mut [Block]) {
        let strings = self.circuits.len();
        let one_flow = self.cooling.common.as_ref().is_some_and(|common| common.series);
        for first in (0..self.state.stages.len()).step_by(strings) {
            let mut most = 0.0_f64;
            for lane in first..first + strings {
                let mean_c = self.coolant.outlet_c[lane];
                self.state.stages[lane] = stages(&self.cooling, self.state.stages[lane], mean_c);
                // A thermostat stops coolant that is warmer than the string.
                let warms = self.cooling.start_c.is_some() && self.coolant.inlet_c[lane] > mean_c;
                let wanted = if warms { 0.0 } else { share(&self.cooling, self.state.stages[lane], mean_c) };
                most = wanted.max(most);
                if !one_flow {
                    self.set_flow(blocks, lane, wanted);
                }
            }
            if one_flow {
                (first..first + strings).for_each(|lane| self.set_flow(blocks, lane, most));
            }
        }
    }

    fn set_flow(&mut self, blocks: &mut [Block], lane: usize, share: f64) {
        if share != self.share[lane] {
            self.share[lane] = share;
            blocks.iter_mut().for_each(|block| block.set_flow(lane, share));
        }
    }

    /// The outlet of one string is the inlet of the next.
    fn connect_in_series(&mut self, blocks: &[Block]) {
        let strings = self.circuits.len();
        for lane in (0..self.share.len()).filter(|lane| lane % strings + 1 < strings) {
            let inlet_c = self.coolant.inlet_c[lane];
            let outlet_c = blocks.iter().find_map(|block| block.outlet_c(lane, inlet_c));
            // Without flow, the next inlet keeps its temperature.
            if self.share[lane] > 0.0 {
                self.coolant.inlet_c[lane + 1] = outlet_c.unwrap_or(inlet_c);
            }
        }
    }

    /// Exchanges heat between strings, loop and source; adds the auxiliary power.
    fn exchange_heat(&mut self, scenario: usize, ambient_c: f64) {
        let strings = self.circuits.len();
        let (mut gained_w, mut mover_w) = (0.0, 0.0);
        for (string, circuit) in self.circuits.iter().enumerate() {
            let lane = scenario * strings + string;
            let (share, coolant) = (self.share[lane], &self.coolant);
            let (inlet_c, outlet_c) = (coolant.inlet_c[lane], coolant.outlet_c[lane]);
            let ends_k = (coolant.front_c[lane] - inlet_c) + (coolant.rear_c[lane] - outlet_c);
            let heat_w = share * circuit.flow_w_k * (outlet_c - inlet_c) + circuit.end_w_k * ends_k;
            self.removed_w[lane] += heat_w;
            gained_w += heat_w;
            mover_w += share.powi(3) * circuit.mover_w;
        }
        let (supply, _) = self.supply(scenario, ambient_c);
        let mut taken_w = gained_w + mover_w;
        if let Some(common) = &self.cooling.common {
            let capacity_j_k = W_PER_KW * common.heat_capacity_kj_k;
            let loop_c = self.state.loop_c[scenario];
            let net_w = taken_w + common.wall_w_k * (ambient_c - loop_c);
            taken_w = net_w + capacity_j_k / self.step_s * (loop_c - supply.temperature_c);
            let max_w = common.source_kw.map_or(f64::INFINITY, |kw| W_PER_KW * kw);
            taken_w = if supply.source == Source::Ambient { 0.0 } else { taken_w.clamp(0.0, max_w) };
            self.state.loop_c[scenario] = loop_c + self.step_s / capacity_j_k * (net_w - taken_w);
        }
        let source_w = match supply.source {
            Source::Ambient => 0.0,
            Source::Free => self.cooling.free_cooling_w_per_w * taken_w.max(0.0),
            Source::Chiller => taken_w.max(0.0) / cop(&self.cooling, supply.temperature_c, ambient_c),
        };
        self.auxiliary_w[scenario] += mover_w + source_w;
    }
}

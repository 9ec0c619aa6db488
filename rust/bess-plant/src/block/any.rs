//! Blocks of any width, as plant and cooling see them.

use std::fmt::Debug;

use super::Block;
use crate::ageing::AgeingState;
use crate::lanes::Lanes;
use crate::record::Record;
use crate::schedule::Schedule;

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct LaneState {
    pub(crate) soc: f64,
    /// Of its own nodes [degC].
    pub(crate) node_temperature_c: Vec<f64>,
    /// Integral of the PI law of derating [K x 15 min].
    pub(crate) integral_k: f64,
    pub(crate) inverter_on: bool,
    pub(crate) ageing: AgeingState,
}

/// Temperatures along the coolant path in a plant step, by lane [degC].
#[derive(Debug, Clone, Default)]
pub(crate) struct Faces {
    pub(crate) inlet_c: Vec<f64>,
    pub(crate) outlet_c: Vec<f64>,
    /// First and last node before the step.
    pub(crate) front_c: Vec<f64>,
    pub(crate) rear_c: Vec<f64>,
}

/// Lanes that are stepped side by side, however many. They have the numbers of the plant.
///
/// A plant whose strings share no coolant calls [`Self::run`]. Where they share one, cooling steps all blocks in turn:
/// `begin`, then for each plant step the flows and `cooled_step`, then `finish`.
pub(crate) trait AnyBlock: Debug + Send + Sync {
    /// Lane numbers, in order.
    fn ids(&self) -> &[usize];
    fn states(&self) -> Vec<(usize, LaneState)>;
    /// Replaces the state: one for each lane of `ids`.
    fn set_state(&mut self, states: &[&LaneState]);
    fn run(&mut self, schedule: &Schedule, record: &mut Record);

    fn begin(&mut self, schedule: &Schedule, step: usize);
    /// Writes the mean temperature of every lane [degC].
    fn means_c(&self, means_c: &mut [f64]);
    /// Changes the flow of a lane, if it is one of these, to a share of the full one.
    fn set_flow(&mut self, id: usize, share: f64);
    /// Temperature at which the coolant would leave a lane, if it is one of these [degC].
    fn outlet_c(&self, id: usize, inlet_c: f64) -> Option<f64>;
    /// One plant step with the inlets of `faces`; writes the outlets and the surface temperatures that the coolant met.
    fn cooled_step(&mut self, faces: &mut Faces);
    fn finish(&mut self, schedule: &Schedule, step: usize, record: &mut Record);
}

impl<const W: usize> AnyBlock for Block<W> {
    fn ids(&self) -> &[usize] {
        &self.ids
    }

    fn states(&self) -> Vec<(usize, LaneState)> {
        let state = |lane: usize| LaneState {
            soc: self.soc.0[lane],
            node_temperature_c: self.air_path.temperature.iter().map(|node| node.0[lane]).collect(),
            integral_k: self.integral_k.0[lane],
            inverter_on: self.on.0[lane] != 0.0,
            ageing: self.aged[lane].clone(),
        };
        self.ids.iter().enumerate().map(|(lane, &id)| (id, state(lane))).collect()
    }

    fn set_state(&mut self, states: &[&LaneState]) {
        for lane in 0..W {
            let state = states[lane.min(states.len() - 1)];
            self.soc.0[lane] = state.soc;
            self.integral_k.0[lane] = state.integral_k;
            self.on.0[lane] = f64::from(u8::from(state.inverter_on));
            for (node, &value) in self.air_path.temperature.iter_mut().zip(&state.node_temperature_c) {
                node.0[lane] = value;
            }
        }
        self.air_path.look_up(&std::array::from_fn(|l| &self.strings[l].resistance));
        self.aged = states.iter().map(|state| state.ageing.clone()).collect();
        self.follow_ageing();
    }

    fn run(&mut self, schedule: &Schedule, record: &mut Record) {
        for step in 0..schedule.steps {
            let mut begun = self.begin_step(schedule, step);
            self.plant_steps(&mut begun, schedule.substeps);
            self.finish_step(&begun, schedule, step, record);
        }
    }

    fn begin(&mut self, schedule: &Schedule, step: usize) {
        self.begun = Some(self.begin_step(schedule, step));
    }

    fn means_c(&self, means_c: &mut [f64]) {
        let mean_c = self.air_path.mean_temperature();
        self.ids.iter().enumerate().for_each(|(lane, &id)| means_c[id] = mean_c.0[lane]);
    }

    fn set_flow(&mut self, id: usize, share: f64) {
        for lane in (0..W).filter(|&lane| self.ids.get(lane) == Some(&id)) {
            self.air_path.set_flow(lane, &self.coefficients[lane].at_flow(share));
        }
    }

    fn outlet_c(&self, id: usize, inlet_c: f64) -> Option<f64> {
        let lane = self.ids.iter().position(|&own| own == id)?;
        Some(self.air_path.outlet(Lanes::splat(inlet_c)).0[lane])
    }

    fn cooled_step(&mut self, faces: &mut Faces) {
        let Some(mut begun) = self.begun else { return };
        let last = self.air_path.temperature.len() - 1;
        for (lane, &id) in self.ids.iter().enumerate() {
            begun.inlet_c.0[lane] = faces.inlet_c[id];
            faces.front_c[id] = self.air_path.temperature[0].0[lane];
            faces.rear_c[id] = self.air_path.temperature[last].0[lane];
        }
        let outlet_c = self.air_path.outlet(begun.inlet_c);
        self.ids.iter().enumerate().for_each(|(lane, &id)| faces.outlet_c[id] = outlet_c.0[lane]);
        self.plant_steps(&mut begun, 1);
        self.begun = Some(begun);
    }

    fn finish(&mut self, schedule: &Schedule, step: usize, record: &mut Record) {
        if let Some(begun) = self.begun.take() {
            self.finish_step(&begun, schedule, step, record);
        }
    }
}

//! Blocks of any width, as plant and cooling see them.

use std::fmt::Debug;

use super::Block;
use crate::lanes::Lanes;
use crate::plant::PlantState;
use crate::record::Record;
use crate::schedule::Schedule;

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
    /// Writes the state of the lanes.
    fn write_state(&self, out: &mut PlantState);
    /// Takes the state of the lanes; SOC beyond its window by rounding is put on the limit.
    fn set_state(&mut self, state: &PlantState);
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
    fn write_state(&self, out: &mut PlantState) {
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

    fn set_state(&mut self, state: &PlantState) {
        let nodes = state.nodes();
        for lane in 0..W {
            let id = self.ids[lane.min(self.ids.len() - 1)];
            self.soc.0[lane] = state.soc[id].clamp(self.soc_min.0[lane], self.soc_max.0[lane]);
            self.integral_k.0[lane] = state.derating_integral_k[id];
            self.on.0[lane] = f64::from(u8::from(state.inverter_on[id]));
            let node_c = &state.node_temperature_c[id * nodes..];
            for (node, &value) in self.air_path.temperature.iter_mut().zip(node_c) {
                node.0[lane] = value;
            }
        }
        self.air_path.look_up(&std::array::from_fn(|l| &self.strings[l].resistance));
        self.aged = self.ids.iter().map(|&id| state.ageing[id].clone()).collect();
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

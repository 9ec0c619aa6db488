//! Lanes that share a coolant with others, stepped one plant step at a time.

use super::{Begun, Block};
use crate::cooling::Faces;
use crate::lanes::Lanes;
use crate::plant::Schedule;
use crate::record::{Limits, Record};
use crate::totals::Totals;

/// Lanes that are stepped by a coolant that they share with others, one plant step at a time. Lanes have the numbers
/// of the plant.
pub(crate) trait Cooled {
    /// Begins a control step.
    fn begin(&mut self, schedule: &Schedule, step: usize);
    /// Writes the mean temperature of every lane [degC].
    fn means_c(&self, means_c: &mut [f64]);
    /// Changes the flow of a lane, if it is one of these, to a share of the full one.
    fn set_flow(&mut self, id: usize, share: f64);
    /// Temperature at which the coolant would leave a lane, if it is one of these [degC].
    fn outlet_c(&self, id: usize, inlet_c: f64) -> Option<f64>;
    /// One plant step with the inlets of `faces`; writes what the coolant met.
    fn cooled_step(&mut self, faces: &mut Faces);
    /// Ends the control step.
    fn finish(&mut self, schedule: &Schedule, step: usize, record: &mut Record);
}

impl<const W: usize> Cooled for Block<W> {
    fn begin(&mut self, schedule: &Schedule, step: usize) {
        self.begun = Some((self.begin_step(schedule, step), Totals::new(), [Limits::NONE; W]));
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
        let Some((mut begun, mut totals, mut limits)) = self.begun else { return };
        let last = self.air_path.temperature.len() - 1;
        for (lane, &id) in self.ids.iter().enumerate() {
            begun.inlet_c.0[lane] = faces.inlet_c[id];
            faces.front_c[id] = self.air_path.temperature[0].0[lane];
            faces.rear_c[id] = self.air_path.temperature[last].0[lane];
        }
        let outlet_c = self.air_path.outlet(begun.inlet_c);
        self.ids.iter().enumerate().for_each(|(lane, &id)| faces.outlet_c[id] = outlet_c.0[lane]);
        self.widest_plant_step(&begun, &mut totals, &mut limits);
        self.begun = Some((begun, totals, limits));
    }

    fn finish(&mut self, schedule: &Schedule, step: usize, record: &mut Record) {
        if let Some((begun, totals, limits)) = self.begun.take() {
            self.finish_step(&begun, &totals, &limits, schedule, step, record);
        }
    }
}

impl<const W: usize> Block<W> {
    fn widest_plant_step(&mut self, begun: &Begun<W>, totals: &mut Totals<W>, limits: &mut [Limits; W]) {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has just been asked for AVX2.
            unsafe { self.plant_step_avx2(begun, totals, limits) };
            return;
        }
        self.portable_plant_step(begun, totals, limits);
    }

    #[inline(always)]
    fn portable_plant_step(&mut self, begun: &Begun<W>, totals: &mut Totals<W>, limits: &mut [Limits; W]) {
        let Begun { magnitude_w, reactive_var, sign, direction, inlet_c, .. } = *begun;
        let reactive = (0..W).fold(false, |any, lane| any | (reactive_var.0[lane] > 0.0));
        let step = match (self.any_entropy, reactive) {
            (false, false) => Self::plant_step::<false, false>,
            (true, false) => Self::plant_step::<true, false>,
            (false, true) => Self::plant_step::<false, true>,
            (true, true) => Self::plant_step::<true, true>,
        };
        step(self, magnitude_w, reactive_var, sign, &direction, inlet_c, totals, limits);
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    unsafe fn plant_step_avx2(&mut self, begun: &Begun<W>, totals: &mut Totals<W>, limits: &mut [Limits; W]) {
        self.portable_plant_step(begun, totals, limits);
    }
}

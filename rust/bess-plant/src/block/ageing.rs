//! Capacity and resistance of the lanes as ageing leaves them, after every control step.

use bess_tables::units::SECONDS_PER_HOUR;

use super::Block;
use crate::lanes::Lanes;
use crate::record::Record;

impl<const W: usize> Block<W> {
    /// Capacity and resistance become those that ageing has left.
    pub(super) fn follow_ageing(&mut self) {
        for lane in 0..W {
            let loss = self.aged[lane.min(self.aged.len() - 1)].loss();
            let capacity_ah = self.strings[lane].capacity_ah * loss.soh_capacity;
            self.capacity_ah.0[lane] = capacity_ah;
            self.soc_per_a.0[lane] = self.step_s / (SECONDS_PER_HOUR * capacity_ah);
            self.growth.0[lane] = loss.soh_resistance;
        }
    }

    /// Ages the strings by a control step from `soc` and `temperature_c` to the present state, and records the loss.
    #[inline(never)]
    pub(super) fn age(
        &mut self,
        soc: Lanes<W>,
        temperature_c: Lanes<W>,
        duration_s: f64,
        first: usize,
        record: &mut Record,
    ) {
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

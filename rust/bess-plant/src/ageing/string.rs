//! Ageing of one string along its run.

use bess_tables::units::{SECONDS_PER_DAY, SECONDS_PER_HOUR, ZERO_C_IN_K};
use bess_tables::{Direction, InputError, StringParameters};

use super::law::{CalendarConditions, Cycle, Knee, Model};
use super::models::model;
use super::rainflow::{CountedCycle, Point};
use super::state::{AgeingState, BlockSums, Damage, Loss, PointData};
use crate::check::SOH_CAPACITY;

/// Minimum time between two updates of capacity and resistance, which are at the end of a control step [s].
const BLOCK_S: f64 = 900.0;

/// SOC throughput below which a half cycle causes no ageing: its mean temperature is a difference of lifetime sums, with
/// cancellation.
const MIN_TRAVEL: f64 = 1e-9;

/// Temperature of the cell voltages in ageing models [degC].
const VOLTAGE_C: f64 = 25.0;

/// Ageing of one string: its model and the data of the model.
#[derive(Debug, Clone)]
pub struct StringAgeing {
    model: Option<&'static Model>,
    parameters: StringParameters,
}

impl StringAgeing {
    /// Ageing with the model in the parameters of the string.
    ///
    /// # Errors
    ///
    /// No model has the name.
    pub fn new(parameters: &StringParameters) -> Result<Self, InputError> {
        let model = parameters.ageing.model.as_deref().map(model).transpose()?;
        Ok(Self { model, parameters: parameters.clone() })
    }

    /// A string with initial factors on capacity and resistance; its parameters divide the initial loss between calendar and
    /// cyclic ageing.
    pub fn starting(&self, soh_capacity: f64, soh_resistance: f64) -> AgeingState {
        let share = self.parameters.ageing.calendar_share;
        let lost = (1.0 - soh_capacity).max(0.0);
        let gained = (soh_resistance - 1.0).max(0.0);
        let mut state = AgeingState {
            base_capacity: soh_capacity + lost,
            base_resistance: soh_resistance - gained,
            loss: Loss { calendar: share * lost, cyclic: (1.0 - share) * lost, soh_capacity, soh_resistance },
            ..AgeingState::default()
        };
        if let Some(model) = self.model {
            state.calendar = Damage {
                capacity: model.calendar.damage_of(share * lost),
                resistance: model.calendar_resistance.damage_of(share * gained),
                sites: 0.0,
            };
            state.cyclic = Damage {
                capacity: model.cyclic.damage_of((1.0 - share) * lost),
                resistance: model.cyclic_resistance.damage_of((1.0 - share) * gained),
                sites: 0.0,
            };
            // Without a law for the resistance, its initial increase stays.
            state.base_resistance = soh_resistance - resistance_gain(model, &state.calendar, &state.cyclic);
        }
        state
    }

    /// Adds one control step; returns whether capacity or resistance may have changed.
    #[inline]
    pub(crate) fn observe(
        &self,
        state: &mut AgeingState,
        soc: (f64, f64),
        mean_temperature_c: f64,
        duration_s: f64,
    ) -> bool {
        let Some(model) = self.model else { return false };
        let kelvin = mean_temperature_c + ZERO_C_IN_K;
        let (before, after) = soc;
        if state.rainflow.points.is_empty() {
            state.rainflow.push(before, state.now, |_| ());
        }
        if state.rainflow.turns_at(after) {
            // The half cycle that ends here is complete.
            let [.., from, to] = &mut state.rainflow.points[..] else {
                unreachable!("a turn needs two points")
            };
            to.data.damage = self.damage(model, from, to);
        }
        let travel = (after - before).abs();
        state.now.travel += travel;
        state.now.kelvin_travel += travel * kelvin;
        if travel > 0.0 {
            state.now.moving_h += duration_s / SECONDS_PER_HOUR;
        }
        let cyclic = &mut state.cyclic;
        state.rainflow.push(after, state.now, |CountedCycle { from, to, count }| {
            // Damage is that of a half cycle.
            cyclic.add(2.0 * count, &self.damage(model, &from, &to));
        });
        state.block_sums.elapsed_s += duration_s;
        state.block_sums.soc_s += 0.5 * (before + after) * duration_s;
        state.block_sums.kelvin_s += kelvin * duration_s;
        if state.block_sums.elapsed_s < BLOCK_S * (1.0 - 1e-9) {
            return false;
        }
        self.advance(model, state);
        true
    }

    /// Converts the sums to capacity and resistance.
    fn advance(&self, model: &Model, state: &mut AgeingState) {
        let BlockSums { elapsed_s, soc_s, kelvin_s } = std::mem::take(&mut state.block_sums);
        let soc = soc_s / elapsed_s;
        let conditions =
            CalendarConditions { soc, temperature_k: kelvin_s / elapsed_s, cell_v: self.cell_v(soc) };
        let days = elapsed_s / SECONDS_PER_DAY;
        state.calendar.capacity += model.calendar.damage(&conditions, days);
        state.calendar.resistance += model.calendar_resistance.damage(&conditions, days);

        let mut cyclic = state.cyclic;
        if let [complete @ .., from, to] = &state.rainflow.points[..] {
            // The point that ends a half cycle has its damage; the first point ends none.
            let ended = complete.iter().chain(Some(from)).skip(1).map(|point| point.data.damage);
            for damage in ended.chain(Some(self.damage(model, from, to))) {
                cyclic.add(1.0, &damage);
            }
        }
        let calendar = model.calendar.loss(state.calendar.capacity);
        let mut cycled = model.cyclic.loss(cyclic.capacity);
        if let Some(Knee { capacity, .. }) = model.knee {
            cycled = cycled.max(1.0 - capacity(cyclic.sites) - calendar);
        }
        let left = state.base_capacity - calendar - cycled;
        state.loss = Loss {
            calendar,
            cyclic: cycled,
            soh_capacity: left.max(SOH_CAPACITY.0),
            soh_resistance: state.base_resistance + resistance_gain(model, &state.calendar, &cyclic),
        };
    }

    /// Damage of the half cycle between two points.
    fn damage(&self, model: &Model, from: &Point<PointData>, to: &Point<PointData>) -> Damage {
        let travel = to.data.travel - from.data.travel;
        if travel < MIN_TRAVEL {
            return Damage::default();
        }
        let (low, high) = (from.value.min(to.value), from.value.max(to.value));
        let cycle = self.cycle(
            (low, high),
            travel / (to.data.moving_h - from.data.moving_h),
            (to.data.kelvin_travel - from.data.kelvin_travel) / travel,
        );
        let half = 0.5 * cycle.depth;
        Damage {
            capacity: model.cyclic.damage(&cycle, half),
            resistance: model.cyclic_resistance.damage(&cycle, half),
            sites: model.knee.map_or(0.0, |knee| (knee.rate)(&cycle) * half),
        }
    }

    fn cycle(&self, (low, high): (f64, f64), c_rate: f64, temperature_k: f64) -> Cycle {
        let (soc, half) = (0.5 * (low + high), 0.5 * (high - low));
        // Gauss, three points.
        let square = |at: f64| self.cell_v(soc + at * half).powi(2);
        let node = 0.6f64.sqrt();
        let mean = (5.0 * (square(-node) + square(node)) + 8.0 * square(0.0)) / 18.0;
        Cycle { depth: high - low, soc, c_rate, temperature_k, cell_v: mean.sqrt() }
    }

    /// Open-circuit voltage of one cell [V]: the middle of charge and discharge.
    fn cell_v(&self, soc: f64) -> f64 {
        let string_v: f64 = [Direction::Charge, Direction::Discharge]
            .into_iter()
            .map(|direction| self.parameters.ocv(direction, soc, VOLTAGE_C))
            .sum();
        0.5 * string_v / self.parameters.cells_series
    }

    /// Capacity lost per equivalent full cycle by half cycles of a depth around a SOC at a C-rate and temperature
    /// [degC], for a string with a loss of `cyclic`. The knee is omitted.
    pub fn cyclic_rate(&self, cyclic: f64, depth: f64, soc: f64, c_rate: f64, temperature_c: f64) -> f64 {
        self.model.map_or(0.0, |model| {
            // A cycle that would leave the SOC window is shifted into it.
            let half = 0.5 * depth;
            // Not `clamp`, which panics for a depth that is not a number.
            let middle = soc.max(half).min((1.0 - half).max(half));
            let cycle = self.cycle((middle - half, middle + half), c_rate, temperature_c + ZERO_C_IN_K);
            model.cyclic.marginal(&cycle, cyclic)
        })
    }

    /// Capacity lost per day at a SOC and temperature [degC], for a string with a loss of `calendar`.
    pub fn calendar_rate(&self, calendar: f64, soc: f64, temperature_c: f64) -> f64 {
        self.model.map_or(0.0, |model| {
            let conditions = CalendarConditions {
                soc,
                temperature_k: temperature_c + ZERO_C_IN_K,
                cell_v: self.cell_v(soc),
            };
            model.calendar.marginal(&conditions, calendar)
        })
    }
}

/// Resistance increase, relative to the nameplate, after damages by calendar and cycle ageing.
fn resistance_gain(model: &Model, calendar: &Damage, cyclic: &Damage) -> f64 {
    model.calendar_resistance.loss(calendar.resistance) + model.cyclic_resistance.loss(cyclic.resistance)
}

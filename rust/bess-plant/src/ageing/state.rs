//! Ageing state of a string, and its conversion to numbers.

use bess_tables::InputError;

use super::rainflow::{Point, Rainflow};
use crate::check::check_range;

/// Losses and remaining state of health of a string.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Loss {
    /// Capacity loss by calendar ageing, relative to the nameplate.
    pub calendar: f64,
    /// Capacity lost by cycling; losses and remaining capacity sum to the capacity at the start of life.
    pub cyclic: f64,
    /// Capacity over that of the nameplate.
    pub soh_capacity: f64,
    /// Resistance over that of the nameplate.
    pub soh_resistance: f64,
}

/// Damages, the sums of the power laws: see [`super::Law`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Damage {
    pub(super) capacity: f64,
    pub(super) resistance: f64,
    /// Exposure of the active sites; zero for calendar ageing.
    pub(super) sites: f64,
}

impl Damage {
    pub(super) fn add(&mut self, times: f64, other: &Self) {
        self.capacity += times * other.capacity;
        self.resistance += times * other.resistance;
        self.sites += times * other.sites;
    }

    fn numbers(&mut self) -> impl Iterator<Item = &mut f64> {
        [&mut self.capacity, &mut self.resistance, &mut self.sites].into_iter()
    }
}

/// Data of a rainflow point: sums since the start, and the damage of the half cycle that ends there, if any.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct PointData {
    /// SOC throughput.
    pub(super) travel: f64,
    /// The same, weighted by temperature [K].
    pub(super) kelvin_travel: f64,
    /// Time with a current [h].
    pub(super) moving_h: f64,
    pub(super) damage: Damage,
}

impl PointData {
    fn numbers(&mut self) -> impl Iterator<Item = &mut f64> {
        let Self { travel, kelvin_travel, moving_h, damage } = self;
        [travel, kelvin_travel, moving_h].into_iter().chain(damage.numbers())
    }
}

/// Sums since the last block.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct BlockSums {
    pub(super) elapsed_s: f64,
    pub(super) soc_s: f64,
    pub(super) kelvin_s: f64,
}

/// Complete ageing state of a string.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct AgeingState {
    /// Capacity and resistance at the start of life, as factors on the nameplate.
    pub(super) base_capacity: f64,
    pub(super) base_resistance: f64,
    pub(super) calendar: Damage,
    /// Damage by counted cycles.
    pub(super) cyclic: Damage,
    /// Sums up to now.
    pub(super) now: PointData,
    pub(super) block_sums: BlockSums,
    pub(super) rainflow: Rainflow<PointData>,
    pub(super) loss: Loss,
}

impl AgeingState {
    /// Losses of the string.
    pub fn loss(&self) -> &Loss {
        &self.loss
    }

    /// The whole state as numbers; their count depends on the number of open cycles.
    pub fn to_numbers(&self) -> Vec<f64> {
        let count = self.rainflow.points.len() as f64;
        std::iter::once(count).chain(self.clone().numbers().map(|number| *number)).collect()
    }

    /// Inverse of [`Self::to_numbers`]; numbers beyond the last point are not read.
    ///
    /// # Errors
    ///
    /// There are fewer numbers than the first one announces, or one is not finite.
    pub fn from_numbers(numbers: &[f64]) -> Result<Self, InputError> {
        let count = numbers.first().filter(|&count| (0.0..1e6).contains(count) && count.fract() == 0.0);
        let mut state = Self::default();
        state.rainflow.points = vec![Point::default(); count.map_or(0, |&count| count as usize)];
        let (found, needed) = (numbers.len(), 1 + state.numbers().count());
        if count.is_none() || found < needed {
            return Err(InputError(format!("ageing: {found} values, needs {needed}")));
        }
        for (own, &value) in state.numbers().zip(&numbers[1..]) {
            check_range("ageing state", value, "", (f64::MIN, f64::MAX), String::new)?;
            *own = value;
        }
        Ok(state)
    }

    /// The numbers of [`Self::to_numbers`] in order, without the count of points.
    fn numbers(&mut self) -> impl Iterator<Item = &mut f64> {
        let Self { base_capacity, base_resistance, calendar, cyclic, now, block_sums, rainflow, loss } = self;
        let Loss { calendar: calendar_loss, cyclic: cyclic_loss, soh_capacity, soh_resistance } = loss;
        let BlockSums { elapsed_s, soc_s, kelvin_s } = block_sums;
        [calendar_loss, cyclic_loss, soh_capacity, soh_resistance, base_capacity, base_resistance]
            .into_iter()
            .chain([&mut calendar.capacity, &mut calendar.resistance])
            .chain(cyclic.numbers())
            .chain([elapsed_s, soc_s, kelvin_s])
            .chain(now.numbers())
            .chain(rainflow.points.iter_mut().flat_map(|point| {
                let Point { value, data } = point;
                std::iter::once(value).chain(data.numbers())
            }))
    }
}

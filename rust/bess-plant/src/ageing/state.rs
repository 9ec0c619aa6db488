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
}

/// Data of a rainflow point: sums since the start, and the damage of the half cycle that ended there, if any.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Mark {
    /// SOC travelled.
    pub(super) travel: f64,
    /// The same, weighted by temperature [K].
    pub(super) kelvin_travel: f64,
    /// Time in which it moved [h].
    pub(super) moving_h: f64,
    pub(super) damage: Damage,
}

/// Sums since the last block.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Gathered {
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
    pub(super) now: Mark,
    pub(super) gathered: Gathered,
    pub(super) rainflow: Rainflow<Mark>,
    pub(super) loss: Loss,
}

impl AgeingState {
    /// Losses of the string.
    pub fn loss(&self) -> &Loss {
        &self.loss
    }

    /// All of it as numbers; as many as the count of open cycles takes.
    pub fn to_numbers(&self) -> Vec<f64> {
        let Loss { calendar, cyclic, soh_capacity, soh_resistance } = self.loss;
        let points = self.rainflow.points();
        let mut out = vec![points.len() as f64, self.rainflow.seen() as f64];
        out.extend([calendar, cyclic, soh_capacity, soh_resistance]);
        out.extend([self.base_capacity, self.base_resistance]);
        out.extend([self.calendar.capacity, self.calendar.resistance]);
        out.extend([self.cyclic.capacity, self.cyclic.resistance, self.cyclic.sites]);
        out.extend([self.gathered.elapsed_s, self.gathered.soc_s, self.gathered.kelvin_s]);
        out.extend(self.now.numbers());
        for point in points {
            out.extend([point.value, point.index as f64]);
            out.extend(point.mark.numbers());
        }
        out
    }

    /// Inverse of [`Self::to_numbers`]; numbers beyond the last point are not read.
    ///
    /// # Errors
    ///
    /// There are fewer numbers than the first one announces, or one is not finite.
    pub fn from_numbers(numbers: &[f64]) -> Result<Self, InputError> {
        let mut rest = numbers.iter().copied();
        let count = rest.next().filter(|&count| (0.0..1e6).contains(&count) && count.fract() == 0.0);
        let needed = count.map_or(HEADER, |count| HEADER + count as usize * NUMBERS_OF_A_POINT);
        let found = numbers.len();
        if count.is_none() || found < needed {
            return Err(InputError(format!("ageing: {found} values, needs {needed}")));
        }
        for &value in &numbers[..needed] {
            check_range("ageing state", value, "", (f64::MIN, f64::MAX), String::new)?;
        }
        let mut next = || rest.next().expect("counted above");
        let seen = next() as u64;
        let loss = Loss { calendar: next(), cyclic: next(), soh_capacity: next(), soh_resistance: next() };
        let (base_capacity, base_resistance) = (next(), next());
        let calendar = Damage { capacity: next(), resistance: next(), sites: 0.0 };
        let cyclic = Damage { capacity: next(), resistance: next(), sites: next() };
        let gathered = Gathered { elapsed_s: next(), soc_s: next(), kelvin_s: next() };
        let now = Mark::of(&mut next);
        let points = (0..count.unwrap_or(0.0) as usize)
            .map(|_| Point { value: next(), index: next() as u64, mark: Mark::of(&mut next) })
            .collect();
        let rainflow = Rainflow::resumed(points, seen);
        Ok(Self { base_capacity, base_resistance, calendar, cyclic, now, gathered, rainflow, loss })
    }
}

/// Numbers of a state without open cycles, and of each point.
const HEADER: usize = 2 + 4 + 2 + 2 + 3 + 3 + NUMBERS_OF_A_MARK;
const NUMBERS_OF_A_POINT: usize = 2 + NUMBERS_OF_A_MARK;
const NUMBERS_OF_A_MARK: usize = 6;

impl Mark {
    fn numbers(&self) -> [f64; NUMBERS_OF_A_MARK] {
        let Damage { capacity, resistance, sites } = self.damage;
        [self.travel, self.kelvin_travel, self.moving_h, capacity, resistance, sites]
    }

    fn of(next: &mut impl FnMut() -> f64) -> Self {
        let (travel, kelvin_travel, moving_h) = (next(), next(), next());
        let damage = Damage { capacity: next(), resistance: next(), sites: next() };
        Self { travel, kelvin_travel, moving_h, damage }
    }
}

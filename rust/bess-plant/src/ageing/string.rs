//! Ageing of one string along its run.

use bess_tables::units::{SECONDS_PER_DAY, SECONDS_PER_HOUR, ZERO_C_IN_K};
use bess_tables::{Direction, StringParameters};

use super::law::{Cycle, Knee, Model, Standing};
use super::models::model;
use super::rainflow::{Counted, Point, Rainflow};
use crate::PlantError;

/// Capacity and resistance change once this much time has gathered, at the end of a control step [s].
pub const BLOCK_S: f64 = 900.0;

/// Capacity never falls below this share of the nameplate: a plant needs some.
const LEAST_CAPACITY: f64 = 0.05;

/// Temperature at which cell voltages are read where a model wants them [degC].
const VOLTAGE_C: f64 = 25.0;

/// What a string has lost, and what is left of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Loss {
    /// Capacity lost by standing, as a share of the nameplate.
    pub calendar: f64,
    /// Capacity lost by cycling; with it the losses and what is left sum to the capacity at the start of life.
    pub cyclic: f64,
    /// Capacity over that of the nameplate.
    pub soh_capacity: f64,
    /// Resistance over that of the nameplate.
    pub soh_resistance: f64,
}

/// Damages of cycling: capacity, resistance, and the exposure of sites.
type Damage = [f64; 3];

/// What a point of the rainflow count remembers: sums since the start, and the damage of the half cycle that ended
/// there, once it has.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Mark {
    travel: f64,
    kelvin_travel: f64,
    moving_h: f64,
    damage: Damage,
}

/// Everything that ageing remembers of a string.
#[derive(Debug, Clone, PartialEq)]
pub struct AgeingState {
    /// Capacity and resistance at the start of life, as factors on the nameplate.
    base: [f64; 2],
    /// Damages of standing: capacity and resistance.
    calendar: [f64; 2],
    /// Damages of the cycles that are counted.
    cyclic: Damage,
    /// Now: SOC travelled, weighted by temperature [K], and the time it took [h].
    now: Mark,
    /// Since the last block: time [s], and SOC and temperature [K] times time.
    gathered: [f64; 3],
    rainflow: Rainflow<Mark>,
    loss: Loss,
}

/// Ageing of one string: its model and what the model wants to know of it.
#[derive(Debug, Clone)]
pub struct StringAgeing {
    model: Option<&'static Model>,
    parameters: StringParameters,
}

impl StringAgeing {
    /// The ageing that the string's parameters name.
    ///
    /// # Errors
    ///
    /// [`PlantError::Model`] where no model has the name.
    pub fn new(parameters: &StringParameters) -> Result<Self, PlantError> {
        let model = match parameters.ageing.model.as_deref() {
            None => None,
            Some(name) => Some(model(name).ok_or_else(|| PlantError::Model { name: name.to_owned() })?),
        };
        Ok(Self { model, parameters: parameters.clone() })
    }

    /// Whether anything changes with time.
    pub fn is_on(&self) -> bool {
        self.model.is_some()
    }

    /// A string that starts with these factors on capacity and resistance; what it has lost already is shared
    /// between standing and cycling as its parameters say.
    pub fn starting(&self, soh_capacity: f64, soh_resistance: f64) -> AgeingState {
        let share = self.parameters.ageing.calendar_share;
        let lost = (1.0 - soh_capacity).max(0.0);
        let gained = (soh_resistance - 1.0).max(0.0);
        let mut state = AgeingState {
            base: [soh_capacity + lost, soh_resistance - gained],
            calendar: [0.0; 2],
            cyclic: [0.0; 3],
            now: Mark::default(),
            gathered: [0.0; 3],
            rainflow: Rainflow::new(),
            loss: Loss { calendar: share * lost, cyclic: (1.0 - share) * lost, soh_capacity, soh_resistance },
        };
        if let Some(model) = self.model {
            state.calendar =
                [model.calendar.damage_of(share * lost), model.calendar_resistance.damage_of(share * gained)];
            state.cyclic = [
                model.cyclic.damage_of((1.0 - share) * lost),
                model.cyclic_resistance.damage_of((1.0 - share) * gained),
                0.0,
            ];
            // A model without a law for the resistance keeps what the string has gained before.
            let kept = self.resistance_gain(model, &state);
            state.base[1] = soh_resistance - kept;
        }
        state
    }

    fn resistance_gain(&self, model: &Model, state: &AgeingState) -> f64 {
        model.calendar_resistance.loss(state.calendar[1]) + model.cyclic_resistance.loss(state.cyclic[1])
    }

    /// Takes one control step; whether capacity or resistance may have changed.
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
        if state.rainflow.points().is_empty() {
            state.rainflow.push(before, state.now, |_| ());
        }
        if state.rainflow.turns_at(after) {
            // The half cycle that ends here is complete.
            let [.., from, to] = state.rainflow.points_mut() else { unreachable!("a turn needs two points") };
            to.mark.damage = self.damage(model, from, to);
        }
        let travel = (after - before).abs();
        state.now.travel += travel;
        state.now.kelvin_travel += travel * kelvin;
        if travel > 0.0 {
            state.now.moving_h += duration_s / SECONDS_PER_HOUR;
        }
        let cyclic = &mut state.cyclic;
        state.rainflow.push(after, state.now, |Counted { from, to, count }| {
            let damage = self.damage(model, &from, &to);
            cyclic.iter_mut().zip(damage).for_each(|(sum, d)| *sum += 2.0 * count * d);
        });
        state.gathered[0] += duration_s;
        state.gathered[1] += 0.5 * (before + after) * duration_s;
        state.gathered[2] += kelvin * duration_s;
        if state.gathered[0] < BLOCK_S * (1.0 - 1e-9) {
            return false;
        }
        self.advance(model, state);
        true
    }

    /// Puts what has gathered into capacity and resistance.
    fn advance(&self, model: &Model, state: &mut AgeingState) {
        let [elapsed_s, soc_s, kelvin_s] = std::mem::take(&mut state.gathered);
        let soc = soc_s / elapsed_s;
        let standing = Standing { soc, temperature_k: kelvin_s / elapsed_s, cell_v: self.cell_v(soc) };
        let days = elapsed_s / SECONDS_PER_DAY;
        state.calendar[0] += model.calendar.damage(&standing, days);
        state.calendar[1] += model.calendar_resistance.damage(&standing, days);

        let mut cyclic = state.cyclic;
        if let [complete @ .., from, to] = state.rainflow.points() {
            // The damage of a range is with the point that ends it; the first point ends none that is open.
            let ended = complete.iter().chain(Some(from)).skip(1).map(|point| point.mark.damage);
            for damage in ended.chain(Some(self.damage(model, from, to))) {
                cyclic.iter_mut().zip(damage).for_each(|(sum, d)| *sum += d);
            }
        }
        let calendar = model.calendar.loss(state.calendar[0]);
        let mut cycled = model.cyclic.loss(cyclic[0]);
        if let Some(Knee { capacity, .. }) = model.knee {
            cycled = cycled.max(1.0 - capacity(cyclic[2]) - calendar);
        }
        let capacity = (state.base[0] - calendar - cycled).max(LEAST_CAPACITY * state.base[0]);
        let gained =
            model.calendar_resistance.loss(state.calendar[1]) + model.cyclic_resistance.loss(cyclic[1]);
        state.loss =
            Loss { calendar, cyclic: cycled, soh_capacity: capacity, soh_resistance: state.base[1] + gained };
    }

    /// Damage of the half cycle between two points.
    fn damage(&self, model: &Model, from: &Point<Mark>, to: &Point<Mark>) -> Damage {
        let travel = to.mark.travel - from.mark.travel;
        let (low, high) = (from.value.min(to.value), from.value.max(to.value));
        let cycle = self.cycle(
            (low, high),
            travel / (to.mark.moving_h - from.mark.moving_h),
            (to.mark.kelvin_travel - from.mark.kelvin_travel) / travel,
        );
        let half = 0.5 * cycle.depth;
        [
            model.cyclic.damage(&cycle, half),
            model.cyclic_resistance.damage(&cycle, half),
            model.knee.map_or(0.0, |knee| (knee.rate)(&cycle) * half),
        ]
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
    /// [degC], for a string that has lost `cyclic` so far. The knee is left out.
    pub fn cyclic_rate(&self, cyclic: f64, depth: f64, soc: f64, c_rate: f64, temperature_c: f64) -> f64 {
        self.model.map_or(0.0, |model| {
            // A range that would leave the window is the same range inside it.
            let half = 0.5 * depth;
            let middle = soc.clamp(half, (1.0 - half).max(half));
            let cycle = self.cycle((middle - half, middle + half), c_rate, temperature_c + ZERO_C_IN_K);
            model.cyclic.marginal(&cycle, cyclic)
        })
    }

    /// Capacity lost per day at a SOC and temperature [degC], for a string that has lost `calendar` so far.
    pub fn calendar_rate(&self, calendar: f64, soc: f64, temperature_c: f64) -> f64 {
        self.model.map_or(0.0, |model| {
            let standing =
                Standing { soc, temperature_k: temperature_c + ZERO_C_IN_K, cell_v: self.cell_v(soc) };
            model.calendar.marginal(&standing, calendar)
        })
    }
}

impl AgeingState {
    /// What the string has lost.
    pub fn loss(&self) -> &Loss {
        &self.loss
    }

    /// All of it as numbers; as many as the count of open cycles takes.
    pub fn to_numbers(&self) -> Vec<f64> {
        let Loss { calendar, cyclic, soh_capacity, soh_resistance } = self.loss;
        let points = self.rainflow.points();
        let mut out = vec![points.len() as f64, self.rainflow.seen() as f64];
        out.extend([calendar, cyclic, soh_capacity, soh_resistance]);
        out.extend(self.base.into_iter().chain(self.calendar).chain(self.cyclic).chain(self.gathered));
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
    /// [`PlantError::Shape`] where there are fewer numbers than the first one announces, [`PlantError::Range`] where one is not
    /// finite.
    pub fn from_numbers(numbers: &[f64]) -> Result<Self, PlantError> {
        let mut rest = numbers.iter().copied();
        let count = rest.next().filter(|&count| (0.0..1e6).contains(&count) && count.fract() == 0.0);
        let needed = count.map_or(HEADER, |count| HEADER + count as usize * PER_POINT);
        let found = numbers.len();
        if count.is_none() || found < needed {
            return Err(PlantError::Shape { name: "ageing", found, expected: needed });
        }
        if let Some(&value) = numbers[..needed].iter().find(|value| !value.is_finite()) {
            let (place, name) = (String::new(), "ageing state");
            return Err(PlantError::Range { place, name, value, unit: "", low: f64::MIN, high: f64::MAX });
        }
        let mut next = || rest.next().expect("counted above");
        let seen = next() as u64;
        let loss = Loss { calendar: next(), cyclic: next(), soh_capacity: next(), soh_resistance: next() };
        let (base, calendar) = ([next(), next()], [next(), next()]);
        let (cyclic, gathered) = ([next(), next(), next()], [next(), next(), next()]);
        let now = Mark::of(&mut next);
        let points = (0..count.unwrap_or(0.0) as usize)
            .map(|_| Point { value: next(), index: next() as u64, mark: Mark::of(&mut next) })
            .collect();
        let rainflow = Rainflow::resumed(points, seen);
        Ok(Self { base, calendar, cyclic, now, gathered, rainflow, loss })
    }
}

/// Numbers of a state without open cycles, and of each point.
const HEADER: usize = 2 + 4 + 2 + 2 + 3 + 3 + MARK;
const PER_POINT: usize = 2 + MARK;
const MARK: usize = 6;

impl Mark {
    fn numbers(&self) -> [f64; MARK] {
        let [a, b, c] = self.damage;
        [self.travel, self.kelvin_travel, self.moving_h, a, b, c]
    }

    fn of(next: &mut impl FnMut() -> f64) -> Self {
        Self { travel: next(), kelvin_travel: next(), moving_h: next(), damage: [next(), next(), next()] }
    }
}

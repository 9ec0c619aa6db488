//! The control model of one string over one interval (docs/equations.md, 1 to 6). Magnitudes with a direction, SI units.

use bess_tables::units::SECONDS_PER_HOUR;
use bess_tables::{Direction, StringParameters};

use super::loss_curve::LossCurve;
use super::losses::Losses;

/// Measured or predicted state of a string.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StringState {
    /// State of charge.
    pub soc: f64,
    /// Mean temperature [degC].
    pub temperature_c: f64,
}

/// Coefficients that are constant within an interval, from the state at its start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coefficients {
    /// Derating factor.
    pub derating: f64,
    /// Open-circuit voltage [V].
    pub voltage_v: f64,
    /// Resistance [Ohm].
    pub resistance_ohm: f64,
}

/// Flows of one string in one interval. Powers and current are magnitudes in the interval's direction.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Flow {
    /// Delivered AC power [W].
    pub delivered_w: f64,
    /// Availability loss [W].
    pub availability_w: f64,
    /// Derating loss [W].
    pub derating_w: f64,
    /// Inverter loss [W].
    pub inverter_w: f64,
    /// Battery heat [W].
    pub battery_w: f64,
    /// Current [A]; negative in charge while the no-load loss exceeds the power from the grid.
    pub current_a: f64,
    /// Final state.
    pub end: StringState,
}

impl Flow {
    /// The four losses [W].
    #[inline]
    pub fn losses(&self) -> Losses {
        Losses {
            availability: self.availability_w,
            derating: self.derating_w,
            inverter: self.inverter_w,
            battery: self.battery_w,
        }
    }
}

/// Point of a step at which the coefficients of the control model are evaluated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CoefficientsFrom {
    /// Its start: the model of the certified split ([`StringModel::step`]).
    Start,
    /// Its middle: the model of plans ([`StringModel::step_midpoint`]).
    Middle,
}

/// Direction, ambient temperature and length of an interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interval {
    /// Direction of all strings.
    pub direction: Direction,
    /// Ambient temperature [degC].
    pub ambient_c: f64,
    /// Length [h].
    pub dt_h: f64,
}

/// One string, with data for the inversion of its inverter tables.
#[derive(Debug, Clone)]
pub struct StringModel {
    pub(crate) parameters: StringParameters,
    charge: LossCurve,
    discharge: LossCurve,
}

impl StringModel {
    /// Prepares the inverter tables of a string.
    pub fn new(parameters: StringParameters) -> Self {
        let inverter = &parameters.inverter;
        let charge = LossCurve::new(&inverter.loss_charge, Direction::Charge, inverter.nominal_w);
        let discharge = LossCurve::new(&inverter.loss_discharge, Direction::Discharge, inverter.nominal_w);
        Self { parameters, charge, discharge }
    }

    /// Nominal AC power `p_N` [W].
    #[inline]
    pub fn nominal_w(&self) -> f64 {
        self.parameters.inverter.nominal_w
    }

    #[inline]
    pub(crate) fn soc_window(&self) -> (f64, f64) {
        (self.parameters.soc_min, self.parameters.soc_max)
    }

    #[inline]
    pub(crate) fn min_power_w(&self) -> f64 {
        self.parameters.inverter.min_power_w
    }

    #[inline]
    pub(crate) fn loss(&self, direction: Direction) -> &LossCurve {
        direction.pick(&self.charge, &self.discharge)
    }

    /// `k`, `V`, `R` at a state.
    #[inline(always)]
    pub fn coefficients(&self, direction: Direction, state: StringState) -> Coefficients {
        let StringState { soc, temperature_c } = state;
        Coefficients {
            derating: self.parameters.derating.factor.at(temperature_c),
            voltage_v: self.parameters.ocv(direction, soc, temperature_c),
            resistance_ohm: self.parameters.resistance.control_at(direction, soc, temperature_c),
        }
    }

    /// Largest internal power `V I +- R I^2` that keeps `soc` in its window at the interval's end, and the terminals
    /// within their voltage limits [W].
    #[inline]
    fn internal_limit_w(&self, c: &Coefficients, direction: Direction, soc: f64, dt_h: f64) -> f64 {
        let per_soc = self.parameters.capacity_ah / dt_h;
        let most = self.parameters.voltage_current_a(direction, c.voltage_v, c.resistance_ohm);
        match direction {
            Direction::Charge => {
                let current = ((self.parameters.soc_max - soc).max(0.0) * per_soc).min(most);
                current * (c.voltage_v + c.resistance_ohm * current)
            }
            Direction::Discharge => {
                let root = 0.5 * c.voltage_v / c.resistance_ohm;
                let current = ((soc - self.parameters.soc_min).max(0.0) * per_soc).min(root).min(most);
                current * (c.voltage_v - c.resistance_ohm * current)
            }
        }
    }

    /// Maximum deliverable AC power over the interval, at most `p_N` [W]; 0 if this is below the
    /// minimum power of the inverter.
    pub fn deliverable_w(&self, c: &Coefficients, direction: Direction, soc: f64, dt_h: f64) -> f64 {
        self.deliverable_with(self.loss(direction), c, direction, soc, dt_h)
    }

    /// Like [`Self::deliverable_w`], with another inverter loss curve.
    #[inline]
    pub(crate) fn deliverable_with(
        &self,
        curve: &LossCurve,
        c: &Coefficients,
        direction: Direction,
        soc: f64,
        dt_h: f64,
    ) -> f64 {
        let max_w = curve.largest_power(self.internal_limit_w(c, direction, soc, dt_h));
        if max_w < self.min_power_w() {
            0.0
        } else {
            max_w
        }
    }

    /// Simulates a request `request_w >= 0` from `state`, with the coefficients of its start.
    #[inline]
    pub fn step(&self, state: StringState, request_w: f64, interval: &Interval) -> Flow {
        self.step_from(CoefficientsFrom::Start, state, request_w, interval)
    }

    /// Like [`Self::step`] with the coefficients of the middle of the interval (explicit midpoint rule), and with the
    /// request delivered in full until the string is full or empty, as in a plant. If the string is or falls below its low-SOC
    /// switch, where resistance rises steeply, the interval is divided into parts.
    #[inline]
    pub fn step_midpoint(&self, state: StringState, request_w: f64, interval: &Interval) -> Flow {
        self.step_from(CoefficientsFrom::Middle, state, request_w, interval)
    }

    #[inline]
    pub(super) fn step_from(
        &self,
        from: CoefficientsFrom,
        state: StringState,
        request_w: f64,
        interval: &Interval,
    ) -> Flow {
        let c = || self.coefficients(interval.direction, state);
        self.step_with(from, self.loss(interval.direction), c, state, request_w, interval)
    }

    /// A step with another inverter loss curve and the coefficients of `state`, read where needed.
    #[inline]
    pub(crate) fn step_with(
        &self,
        from: CoefficientsFrom,
        curve: &LossCurve,
        at_start: impl FnOnce() -> Coefficients,
        state: StringState,
        request_w: f64,
        interval: &Interval,
    ) -> Flow {
        if request_w <= 0.0 {
            return self.idle(state, 0.0, 0.0, interval);
        }
        match from {
            CoefficientsFrom::Start => {
                self.carry_out(curve, |power_w| curve.at(power_w), state, request_w, interval, &at_start())
            }
            CoefficientsFrom::Middle => self.midpoint(curve, at_start(), state, request_w, interval),
        }
    }

    /// Simulates a positive request; `loss_at` is [`LossCurve::at`] of `curve`.
    #[inline(always)]
    pub(super) fn carry_out(
        &self,
        curve: &LossCurve,
        loss_at: impl Fn(f64) -> (f64, f64),
        state: StringState,
        request_w: f64,
        interval: &Interval,
        c: &Coefficients,
    ) -> Flow {
        let direction = interval.direction;
        let derating_w = (1.0 - c.derating) * request_w;
        let wanted = request_w - derating_w;
        if wanted < self.min_power_w() {
            return self.idle(state, derating_w, wanted, interval);
        }

        let p = &self.parameters;
        let (mut inverter_w, highest_internal) = loss_at(wanted);
        let mut delivered_w = wanted;
        let (mut current_a, has_root) = small_root(c, direction, highest_internal);
        let mut soc = self.soc_after(state.soc, current_a, interval);
        // Most requests are deliverable; only the others need the limit, which is an inversion.
        let fits = has_root
            && soc <= p.soc_max
            && (direction == Direction::Charge || soc >= p.soc_min)
            && p.voltage_allows(direction, c.voltage_v, c.resistance_ohm * current_a);
        if !fits || curve.internal_w(wanted, inverter_w) != highest_internal {
            let internal_limit = self.internal_limit_w(c, direction, state.soc, interval.dt_h);
            if highest_internal > internal_limit {
                delivered_w = curve.largest_power(internal_limit).min(wanted);
                inverter_w = curve.at(delivered_w).0;
            }
            if delivered_w < self.min_power_w() {
                return self.idle(state, derating_w, wanted, interval);
            }
            (current_a, _) = small_root(c, direction, curve.internal_w(delivered_w, inverter_w));
            soc = self.soc_after(state.soc, current_a, interval);
        }
        if soc < p.soc_min && direction == Direction::Charge {
            // Less grid power than the inverter loss, and an empty battery, which cannot cover the difference.
            return self.idle(state, derating_w, wanted, interval);
        }
        let battery_w = c.resistance_ohm * current_a * current_a;
        Flow {
            delivered_w,
            availability_w: wanted - delivered_w,
            derating_w,
            inverter_w,
            battery_w,
            current_a,
            end: StringState {
                // A string at its limit ends on this limit within rounding.
                soc: soc.clamp(p.soc_min, p.soc_max),
                temperature_c: self.warmed(state.temperature_c, battery_w, interval),
            },
        }
    }

    #[inline]
    pub(super) fn soc_after(&self, soc: f64, current_a: f64, interval: &Interval) -> f64 {
        soc - interval.direction.sign() * (current_a * interval.dt_h / self.parameters.capacity_ah)
    }

    #[inline]
    pub(crate) fn warmed(&self, temperature_c: f64, battery_w: f64, interval: &Interval) -> f64 {
        let lumped = &self.parameters.lumped;
        let rate = lumped.k1_k_per_j * battery_w - lumped.k2_per_s * (temperature_c - interval.ambient_c);
        temperature_c + interval.dt_h * SECONDS_PER_HOUR * rate
    }

    #[inline]
    pub(super) fn idle(
        &self,
        state: StringState,
        derating_w: f64,
        availability_w: f64,
        interval: &Interval,
    ) -> Flow {
        let temperature_c = self.warmed(state.temperature_c, 0.0, interval);
        Flow { availability_w, derating_w, end: StringState { temperature_c, ..state }, ..Flow::default() }
    }
}

/// Current [A] of `V I +- R I^2 = internal_w`, the small root in its stable form, and whether a real root
/// exists. Otherwise (or within rounding of this case) the current of the double root.
#[inline]
pub(super) fn small_root(c: &Coefficients, direction: Direction, internal_w: f64) -> (f64, bool) {
    let (v, product) = (c.voltage_v, 4.0 * c.resistance_ohm * internal_w);
    let square = v * v - direction.sign() * product;
    (2.0 * internal_w / (v + square.max(0.0).sqrt()), square >= 0.0)
}

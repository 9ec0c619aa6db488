//! Operating ranges of one string in one step, over a box of states and a range of requests.

use bess_tables::units::SECONDS_PER_HOUR;
use bess_tables::Direction;

use crate::model::{heat_w, CoefficientRanges, Interval, Range, StateBox, StringModel};

/// Outward rounding, so that a bound also holds for the floating-point numbers of the roll-out.
pub(super) const SOC_ROUNDING: f64 = 1e-12;
const TEMPERATURE_ROUNDING_K: f64 = 1e-9;
/// Boxes are divided at these SOC: voltage and resistance change most at low SOC, and the behaviour of a nearly empty
/// string should not be bounded with values of a higher SOC.
const SOC_BORDERS: [f64; 5] = [0.02, 0.05, 0.1, 0.15, 0.25];

/// Operating ranges of a string in a step.
#[derive(Debug, Clone, Copy)]
pub struct Cell {
    /// Derating factor.
    pub derating: Range,
    /// AC power of an inverter that is on [W]; empty if it cannot be on.
    pub delivered_w: Range,
    /// Whether the inverter may be off.
    pub may_be_off: bool,
    /// [W]; without amounts below the minimum power that are shed because of derating.
    pub shed_w: Range,
    /// `V I` of an inverter that is on [W].
    pub battery_w: Range,
    /// [A].
    pub current_a: Range,
    /// [W].
    pub heat_w: Range,
    /// Final SOC of a string with availability loss.
    pub shed_soc: Range,
    /// Final state.
    pub end: StateBox,
}

impl Cell {
    pub(super) const NONE: Self = Self {
        derating: Range::EMPTY,
        delivered_w: Range::EMPTY,
        may_be_off: false,
        shed_w: Range::EMPTY,
        battery_w: Range::EMPTY,
        current_a: Range::EMPTY,
        heat_w: Range::EMPTY,
        shed_soc: Range::EMPTY,
        end: StateBox { soc: Range::EMPTY, temperature_c: Range::EMPTY },
    };

    /// Ranges that contain both.
    pub(super) fn union(&self, other: &Self) -> Self {
        Self {
            derating: self.derating.union(&other.derating),
            delivered_w: self.delivered_w.union(&other.delivered_w),
            may_be_off: self.may_be_off || other.may_be_off,
            shed_w: self.shed_w.union(&other.shed_w),
            battery_w: self.battery_w.union(&other.battery_w),
            current_a: self.current_a.union(&other.current_a),
            heat_w: self.heat_w.union(&other.heat_w),
            shed_soc: self.shed_soc.union(&other.shed_soc),
            end: self.end.union(&other.end),
        }
    }

    /// Whether the inverter may be on.
    pub fn may_run(&self) -> bool {
        self.delivered_w.high > 0.0
    }

    /// Whether availability loss is possible.
    pub fn may_shed(&self) -> bool {
        self.shed_w.high > 0.0
    }
}

impl StringModel {
    /// Operating ranges of a string from a box of states, for a range of requests.
    pub(crate) fn cell(&self, states: &StateBox, requests_w: &Range, interval: &Interval) -> Cell {
        let of_part = |part: StateBox| {
            self.cell_of_part(&part, &self.ranges(interval.direction, &part), requests_w, interval)
        };
        soc_parts(states).map(of_part).fold(Cell::NONE, |all, cell| all.union(&cell))
    }

    /// [`Self::cell`] of the parts of the box and of the requests that lead to `end` with an availability loss of at most
    /// `max_shed_w`, with these parts. None if there are none.
    pub(super) fn cell_towards(
        &self,
        (states, requests_w): (&StateBox, &Range),
        interval: &Interval,
        end: &StateBox,
        max_shed_w: f64,
    ) -> Option<(Cell, Range, Range)> {
        let slack_w = REQUEST_ROUNDING * self.nominal_w();
        let fits =
            |cell: &Cell| !cell.end.intersection(end).is_empty() && cell.shed_w.low <= max_shed_w + slack_w;
        let (mut all, mut soc, mut requests) = (Cell::NONE, Range::EMPTY, Range::EMPTY);
        for part in soc_parts(states) {
            let ranges = self.ranges(interval.direction, &part);
            let whole = self.cell_of_part(&part, &ranges, requests_w, interval);
            if whole.shed_w.high <= max_shed_w && end.contains(&whole.end) {
                (all, soc, requests) = (all.union(&whole), soc.union(&part.soc), *requests_w);
                continue;
            }
            if !fits(&whole) {
                continue;
            }
            let width = requests_w.width().max(0.0);
            let n = if width > slack_w { SLICES } else { 1 };
            for i in 0..n {
                let at = |i: usize| requests_w.low + width * i as f64 / n as f64;
                let slice = Range { low: at(i), high: if i + 1 == n { requests_w.high } else { at(i + 1) } };
                let cell = self.cell_of_part(&part, &ranges, &slice, interval);
                if fits(&cell) {
                    (all, soc, requests) = (all.union(&cell), soc.union(&part.soc), requests.union(&slice));
                }
            }
        }
        (!soc.is_empty()).then_some((all, soc, requests))
    }

    /// Smallest and largest current that fills (empties) a string within a step [A].
    fn fill_a(&self, states: &StateBox, direction: Direction, dt_h: f64) -> Range {
        let p = &self.parameters;
        let per_soc = p.capacity_ah / dt_h;
        let (low, high) = match direction {
            Direction::Charge => (p.soc_max - states.soc.high, p.soc_max - states.soc.low),
            Direction::Discharge => (states.soc.low - p.soc_min, states.soc.high - p.soc_min),
        };
        Range { low: low.max(0.0) * per_soc, high: high.max(0.0) * per_soc }
    }

    /// Smallest and largest current that voltage limits and, in discharge, the root allow [A].
    fn max_a(&self, c: &CoefficientRanges, direction: Direction) -> Range {
        let (v, r) = (c.voltage_v, c.resistance_ohm);
        let of_voltage = |v: f64, r: f64| self.parameters.voltage_current_a(direction, v, r);
        match direction {
            Direction::Charge => Range { low: of_voltage(v.high, r.high), high: of_voltage(v.low, r.low) },
            Direction::Discharge => Range {
                low: of_voltage(v.low, r.high).min(0.5 * v.low / r.high),
                high: of_voltage(v.high, r.low).min(0.5 * v.high / r.low),
            },
        }
    }

    /// Smallest and largest limit of the AC power over a box [W].
    fn limits(&self, c: &CoefficientRanges, fill_a: &Range, max_a: &Range, direction: Direction) -> Range {
        let (v, r) = (c.voltage_v, c.resistance_ohm);
        let power = |v: f64, r: f64, current: f64| {
            self.loss(direction).largest_power(current * (v - direction.sign() * (r * current)))
        };
        match direction {
            // The limit by the headroom rises with V and R, the voltage limit falls.
            Direction::Charge => Range {
                low: power(v.low, r.low, fill_a.low).min(power(v.high, r.high, max_a.low)),
                high: power(v.high, r.high, fill_a.high).min(power(v.low, r.low, max_a.high)),
            },
            // All rise with V and fall with R.
            Direction::Discharge => Range {
                low: power(v.low, r.high, fill_a.low.min(max_a.low)),
                high: power(v.high, r.low, fill_a.high.min(max_a.high)),
            },
        }
    }

    fn cell_of_part(
        &self,
        states: &StateBox,
        c: &CoefficientRanges,
        requests_w: &Range,
        interval: &Interval,
    ) -> Cell {
        let (p, direction) = (&self.parameters, interval.direction);
        let (v, r, scale) = (c.voltage_v, c.resistance_ohm, c.power_scale_w);
        let curve = self.loss(direction);
        let wanted = Range {
            low: (c.derating.low * requests_w.low).max(0.0),
            high: (c.derating.high * requests_w.high).max(0.0),
        };
        let (fill_a, max_a) = (self.fill_a(states, direction, interval.dt_h), self.max_a(c, direction));
        let limit = self.limits(c, &fill_a, &max_a, direction);
        // Power below the minimum power is zero.
        let is_none = |power_w: f64| power_w <= 0.0 || power_w < self.min_power_w();
        let mut cell = Cell {
            derating: c.derating,
            delivered_w: Range { low: wanted.low.min(limit.low), high: wanted.high.min(limit.high) },
            may_be_off: is_none(wanted.low) || is_none(limit.low),
            shed_w: Range {
                low: if is_none(wanted.low) { 0.0 } else { (wanted.low - limit.high).max(0.0) },
                high: (wanted.high - limit.low).max(0.0),
            },
            current_a: Range::point(0.0),
            heat_w: Range::point(0.0),
            ..Cell::NONE
        };
        if is_none(limit.low) {
            cell.shed_w.high = wanted.high;
        }
        let per_ampere = interval.dt_h / p.capacity_ah;
        let mut certain_end_soc = None;
        if is_none(cell.delivered_w.high) {
            (cell.delivered_w, cell.may_be_off) = (Range::EMPTY, true);
            cell.shed_soc = states.soc;
        } else {
            let Range { low: p_low, high: p_high } = cell.delivered_w;
            let Range { low: g_low, high: g_high } = curve.internal_range(p_low, p_high);
            let sign = direction.sign();
            let root =
                |g: f64, v: f64, r: f64| 2.0 * g / (v + (v * v - sign * (4.0 * r * g)).max(0.0).sqrt());
            let (low, high) = match direction {
                // Current falls with V and R, but for a negative one, whose magnitude rises with R.
                Direction::Charge => {
                    let low =
                        if g_low < 0.0 { root(g_low, v.low, r.high) } else { root(g_low, v.high, r.high) };
                    (low, if g_high < 0.0 { root(g_high, v.high, r.low) } else { root(g_high, v.low, r.low) })
                }
                Direction::Discharge => {
                    // Beyond the root limit of the weakest corner only the largest current of the box is a bound.
                    let has_root = 4.0 * r.high * g_high <= v.low * v.low;
                    let high = if has_root { root(g_high, v.low, r.high) } else { 0.5 * v.high / r.low };
                    (root(g_low.min(0.25 * v.high * v.high / r.low), v.high, r.low), high)
                }
            };
            // Less grid power than the inverter loss, and an empty battery, which cannot cover the difference.
            let drained = low < 0.0 && states.soc.low + per_ampere * low < p.soc_min + SOC_ROUNDING;
            if drained {
                cell.may_be_off = true;
                cell.shed_w.high = cell.shed_w.high.max(wanted.high.min(curve.max_drawing_w()));
                let high = states.soc.high.min(p.soc_min - per_ampere * low);
                cell.shed_soc = Range { low: states.soc.low, high: high.max(states.soc.low) };
            }
            let mut current = Range { low, high: high.min(fill_a.high).max(low) };
            let edge = if direction == Direction::Charge { p.soc_max } else { p.soc_min };
            if cell.shed_w.low > 0.0 && !cell.may_be_off && fill_a.high <= max_a.low {
                // The string becomes full.
                certain_end_soc = Some(edge);
                current = Range { low: current.low.max(fill_a.low).min(current.high), ..current };
            }
            if cell.may_shed() {
                // Charge that a string cannot deliver, because the power is below the minimum power.
                let (_, min_w) = curve.at(self.min_power_w());
                let blocked_soc = 2.0 * per_ampere * min_w.max(0.0) / v.low;
                if fill_a.low <= max_a.high {
                    let toward = if direction == Direction::Charge { -blocked_soc } else { blocked_soc };
                    let end = Range::point(edge).union(&Range::point(edge + toward));
                    cell.shed_soc = cell.shed_soc.union(&end);
                }
            }
            let heat = |g: f64, y: f64| heat_w(g, y, direction);
            // In discharge V^2 / R is at least four times the internal power.
            let root_scale = |g: f64| if direction == Direction::Discharge { 4.0 * g } else { 0.0 };
            let lowest = |g: f64| scale.low.max(root_scale(g)).min(scale.high.max(scale.low));
            let heat_low = if g_low <= 0.0 { 0.0 } else { heat(g_low.min(0.25 * scale.high), scale.high) };
            let heat_high = heat(g_high, lowest(g_high)).max(heat(g_low, lowest(g_low)));
            let by_current = r.high * (current.high * current.high).max(current.low * current.low);
            // At maximum power transfer the roots coincide, and the rounding error is that of a square root.
            let mut heats = Range { low: heat_low, high: heat_high.min(by_current).max(heat_low) };
            let (low, high) = match direction {
                Direction::Charge => (g_low - heat(g_low, scale.low), g_high - heat(g_high, scale.high)),
                Direction::Discharge => (g_low + heats.low, g_high + heats.high),
            };
            let most = current.high * if current.high < 0.0 { v.low } else { v.high };
            cell.battery_w = Range { low, high: high.min(most).max(low) };
            if cell.may_be_off {
                (current, heats.low) = (current.union(&Range::point(0.0)), 0.0);
            }
            (cell.current_a, cell.heat_w) = (current, heats);
        }
        cell.end = self.end(states, &cell, certain_end_soc, interval);
        if cell.may_shed() && max_a.low < fill_a.high {
            // Limited by its voltage, a string can end anywhere.
            cell.shed_soc = cell.shed_soc.union(&cell.end.soc);
        }
        cell
    }

    /// Final states of a step.
    fn end(&self, states: &StateBox, cell: &Cell, certain_soc: Option<f64>, interval: &Interval) -> StateBox {
        let p = &self.parameters;
        let per_ampere = -interval.direction.sign() * (interval.dt_h / p.capacity_ah);
        let gained: Range =
            [cell.current_a.low, cell.current_a.high].map(|a| per_ampere * a).into_iter().collect();
        let (low, high) = match certain_soc {
            Some(soc) => (soc, soc),
            None => (states.soc.low + gained.low, states.soc.high + gained.high),
        };
        let dt_s = interval.dt_h * SECONDS_PER_HOUR;
        let cooled = |t: f64| t - dt_s * p.lumped.k2_per_s * (t - interval.ambient_c);
        // Falls with the temperature before it only if the step is longer than 1 / k2.
        let (a, b) = (cooled(states.temperature_c.low), cooled(states.temperature_c.high));
        let rise = dt_s * p.lumped.k1_k_per_j;
        StateBox {
            soc: Range {
                low: (low - SOC_ROUNDING).clamp(p.soc_min, p.soc_max),
                high: (high + SOC_ROUNDING).clamp(p.soc_min, p.soc_max),
            },
            temperature_c: Range {
                low: a.min(b) + rise * cell.heat_w.low - TEMPERATURE_ROUNDING_K,
                high: a.max(b) + rise * cell.heat_w.high + TEMPERATURE_ROUNDING_K,
            },
        }
    }
}

/// Number of parts of a request range, tested for feasible end states.
const SLICES: usize = 4;
/// Outward rounding of requests, relative to the nominal power.
pub(super) const REQUEST_ROUNDING: f64 = 1e-9;

/// Parts of a box divided at the borders.
fn soc_parts(states: &StateBox) -> impl Iterator<Item = StateBox> + '_ {
    let Range { low, high } = states.soc;
    let inside = SOC_BORDERS.into_iter().filter(move |b| *b > low && *b < high).chain([high]);
    inside.scan(low, move |from, to| {
        let part = StateBox { soc: Range { low: *from, high: to }, ..*states };
        *from = to;
        Some(part)
    })
}

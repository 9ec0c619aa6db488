//! Rigorous bounds of every state that a feasible schedule can reach.

use bess_tables::Direction;

use crate::horizon::ControlHorizon;
use crate::model::{StringModel, SECONDS_PER_HOUR};
use crate::ranges::{Range, StateBox};
use crate::Interval;

/// Outward rounding: a bound must hold for the roll-out's floating-point numbers too.
const SOC_ROUNDING: f64 = 1e-12;
const TEMPERATURE_ROUNDING_K: f64 = 1e-9;

impl ControlHorizon {
    /// Boxes `(M, T + 1)` that contain the state at the start of each step, and at the end of the last, of every
    /// schedule with `sum u = demand` and `0 <= u <= limit`.
    pub fn reachable(&self) -> Vec<StateBox> {
        let n_steps = self.n_steps();
        let total = |t: usize| (0..self.n_strings()).map(|m| self.limit(m, t)).sum::<f64>();
        let totals: Vec<f64> = (0..n_steps).map(total).collect();
        let mut boxes = Vec::with_capacity(self.n_strings() * (n_steps + 1));
        for m in 0..self.n_strings() {
            let start = self.start[m];
            let mut states =
                StateBox { soc: Range::point(start.soc), temperature_c: Range::point(start.temperature_c) };
            boxes.push(states);
            for (t, total) in totals.iter().enumerate() {
                let others = total - self.limit(m, t);
                let slack = 1e-9 * total;
                let requests = Range {
                    low: (self.demand_w[t] - others - slack).max(0.0),
                    high: self.limit(m, t).min(self.demand_w[t]) * (1.0 + 1e-12),
                };
                states = self.string(m).reach(&states, &requests, &self.intervals[t]);
                boxes.push(states);
            }
        }
        boxes
    }
}

impl StringModel {
    /// Box of the states at the end of an interval that starts in a box, for a range of requests.
    fn reach(&self, states: &StateBox, requests_w: &Range, interval: &Interval) -> StateBox {
        let direction = interval.direction;
        let (current_a, heat_w) = if requests_w.high <= 0.0 {
            (Range::point(0.0), Range::point(0.0))
        } else {
            self.current_and_heat(states, requests_w, direction, interval.dt_h)
        };
        let p = &self.parameters;
        let per_ampere = interval.dt_h / p.capacity_ah;
        let (down, up) = match direction {
            Direction::Charge => (current_a.low, current_a.high),
            Direction::Discharge => (-current_a.high, -current_a.low),
        };
        let soc = Range {
            low: (states.soc.low + per_ampere * down - SOC_ROUNDING).clamp(p.soc_min, p.soc_max),
            high: (states.soc.high + per_ampere * up + SOC_ROUNDING).clamp(p.soc_min, p.soc_max),
        };
        let dt_s = interval.dt_h * SECONDS_PER_HOUR;
        let cooled = |t: f64| t - dt_s * p.lumped.k2_per_s * (t - interval.ambient_c);
        // Falls with the temperature before it only if the step is longer than 1 / k2.
        let (a, b) = (cooled(states.temperature_c.low), cooled(states.temperature_c.high));
        let rise = dt_s * p.lumped.k1_k_per_j;
        StateBox {
            soc,
            temperature_c: Range {
                low: a.min(b) + rise * heat_w.low - TEMPERATURE_ROUNDING_K,
                high: a.max(b) + rise * heat_w.high + TEMPERATURE_ROUNDING_K,
            },
        }
    }

    fn current_and_heat(
        &self,
        states: &StateBox,
        requests_w: &Range,
        direction: Direction,
        dt_h: f64,
    ) -> (Range, Range) {
        let p = &self.parameters;
        let c = self.ranges(direction, states);
        let (v, r) = (c.voltage_v, c.resistance_ohm);
        let per_soc = p.capacity_ah / dt_h;
        let room = match direction {
            Direction::Charge => Range { low: p.soc_max - states.soc.high, high: p.soc_max - states.soc.low },
            Direction::Discharge => {
                Range { low: states.soc.low - p.soc_min, high: states.soc.high - p.soc_min }
            }
        };
        let room = Range { low: room.low.max(0.0) * per_soc, high: room.high.max(0.0) * per_soc };

        let curve = self.loss(direction);
        let internal_limit = |v: f64, r: f64, room: f64| match direction {
            Direction::Charge => room * (v + r * room),
            Direction::Discharge => {
                let current = room.min(0.5 * v / r);
                current * (v - r * current)
            }
        };
        let (easy, hard) = match direction {
            Direction::Charge => ((v.high, r.high), (v.low, r.low)),
            Direction::Discharge => ((v.high, r.low), (v.low, r.high)),
        };
        let largest = curve.largest_power(internal_limit(easy.0, easy.1, room.high));
        let smallest = curve.largest_power(internal_limit(hard.0, hard.1, room.low));
        let delivered = Range {
            low: (c.derating.low * requests_w.low).min(smallest),
            high: (c.derating.high * requests_w.high).min(largest),
        };
        if delivered.high <= 0.0 {
            return (Range::point(0.0), Range::point(0.0));
        }
        let (g_low, g_high) = curve.internal_range(delivered.low, delivered.high);
        let may_be_off = delivered.low <= 0.0 || g_low < 0.0;

        let root = |g: f64, v: f64, r: f64| match direction {
            Direction::Charge => 2.0 * g / (v + (v * v + 4.0 * r * g).max(0.0).sqrt()),
            Direction::Discharge => 2.0 * g / (v + (v * v - 4.0 * r * g).max(0.0).sqrt()),
        };
        let (mut low, high) = match direction {
            // Current falls with V and R, but for a negative one, whose magnitude rises with R.
            Direction::Charge if g_low < 0.0 => (root(g_low, v.low, r.high), root(g_high, v.low, r.low)),
            Direction::Charge => (root(g_low, v.high, r.high), root(g_high, v.low, r.low)),
            Direction::Discharge => {
                // Beyond the root limit of the weakest corner only the largest current of the box is a bound.
                let strongest = 0.5 * v.high / r.low;
                let has_root = 4.0 * r.high * g_high <= v.low * v.low;
                let high = if has_root { root(g_high, v.low, r.high) } else { strongest };
                (root(g_low.min(0.25 * v.high * v.high / r.low), v.high, r.low), high)
            }
        };
        if may_be_off {
            low = low.min(0.0);
        }
        // A limited charge may also flow at the negative powers in between: covered by g_low.
        let current = Range { low, high: high.min(room.high).max(low) };

        let scale = c.power_scale_w;
        let heat = |g: f64, y: f64| heat_w(g, y, direction);
        let heat_low = if may_be_off || g_low <= 0.0 { 0.0 } else { heat(g_low, scale.high) };
        let heat_high = heat(g_high, scale.low).max(heat(g_low, scale.low));
        let by_current = r.high * (current.high * current.high).max(current.low * current.low);
        (current, Range { low: heat_low, high: heat_high.min(by_current) })
    }
}

/// Battery heat at an internal power `g` and scale `y = V^2 / R` [W]: `y ((sqrt(1 +- 4 g / y) - 1) / 2)^2`. Convex in
/// `g`, falling with `y`. Beyond the root limit of discharge, its value there.
#[inline]
pub(crate) fn heat_w(internal_w: f64, scale_w: f64, direction: Direction) -> f64 {
    let x = internal_w / scale_w;
    let root = match direction {
        Direction::Charge => (1.0 + 4.0 * x).max(0.0).sqrt(),
        Direction::Discharge => (1.0 - 4.0 * x).max(0.0).sqrt(),
    };
    let share = 2.0 * x / (1.0 + root);
    scale_w * share * share
}

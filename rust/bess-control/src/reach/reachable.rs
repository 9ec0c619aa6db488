//! Rigorous bounds of every state that a feasible schedule can reach.

use bess_tables::units::SECONDS_PER_HOUR;
use bess_tables::Direction;

use crate::model::{heat_w, CoefficientRanges, ControlHorizon, Interval, Range, StateBox, StringModel};

/// Outward rounding: a bound must hold for the roll-out's floating-point numbers too.
const SOC_ROUNDING: f64 = 1e-12;
const TEMPERATURE_ROUNDING_K: f64 = 1e-9;
/// Boxes are cut at these SOC: voltage and resistance change most where little charge is left.
const BORDERS_SOC: [f64; 3] = [0.05, 0.1, 0.25];

impl ControlHorizon {
    /// Boxes `(M, T + 1)` that contain the state at the start of each step, and at the end of the last, of every
    /// schedule with `sum u = demand` and `0 <= u <= limit`.
    pub fn reachable(&self) -> Vec<StateBox> {
        let n_steps = self.n_steps();
        let mut boxes = Vec::with_capacity(self.n_strings() * (n_steps + 1));
        for m in 0..self.n_strings() {
            let start = self.start[m];
            let mut states =
                StateBox { soc: Range::point(start.soc), temperature_c: Range::point(start.temperature_c) };
            boxes.push(states);
            for (t, interval) in self.intervals.iter().enumerate() {
                states = self.string(m).reach(&states, &self.request_range(m, t), interval);
                boxes.push(states);
            }
        }
        boxes
    }

    /// Whether a string may shed something in a step, `(M, T)`, if its states are in these boxes, `(M, T + 1)`.
    pub(crate) fn may_shed(&self, boxes: &[StateBox]) -> Vec<bool> {
        let n_steps = self.n_steps();
        let cells = (0..self.n_strings()).flat_map(|m| (0..n_steps).map(move |t| (m, t)));
        let sheds = |(m, t): (usize, usize)| {
            let (states, interval) = (&boxes[m * (n_steps + 1) + t], &self.intervals[t]);
            let (string, requests) = (self.string(m), self.request_range(m, t));
            let (current, _) = string.current_and_heat(states, &requests, interval);
            let coefficients = string.ranges(interval.direction, states);
            string.may_shed(states, &coefficients, &requests, &current, interval)
        };
        cells.map(sheds).collect()
    }

    /// What a string may be asked for, given what the others can take [W].
    pub(crate) fn request_range(&self, m: usize, t: usize) -> Range {
        let total = self.total_limit_w[t];
        let others = total - self.limit(m, t);
        Range {
            low: (self.demand_w[t] - others - 1e-9 * total).max(0.0),
            high: self.limit(m, t).min(self.demand_w[t]) * (1.0 + 1e-12),
        }
    }
}

impl StringModel {
    /// Box of the states at the end of an interval that starts in a box, for a range of requests.
    pub(crate) fn reach(&self, states: &StateBox, requests_w: &Range, interval: &Interval) -> StateBox {
        let direction = interval.direction;
        let (current_a, heat_w) = if requests_w.high <= 0.0 {
            (Range::point(0.0), Range::point(0.0))
        } else {
            self.current_and_heat(states, requests_w, interval)
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

    /// Whether there is a state in the box, whose coefficients and currents are known, and a request in the range, of
    /// which something is shed.
    pub(crate) fn may_shed(
        &self,
        states: &StateBox,
        c: &CoefficientRanges,
        requests_w: &Range,
        current_a: &Range,
        interval: &Interval,
    ) -> bool {
        if requests_w.high <= 0.0 {
            return false;
        }
        let room = self.room(states, interval.direction, interval.dt_h);
        // An inverter that draws more than it charges may find the battery empty.
        let drained = current_a.low * interval.dt_h / self.parameters.capacity_ah;
        c.derating.high * requests_w.high >= self.limits(c, &room, interval.direction).low
            || states.soc.low + drained.min(0.0) < self.parameters.soc_min + SOC_ROUNDING && drained < 0.0
    }

    /// Smallest and largest current that fills (empties) a string within a step [A].
    fn room(&self, states: &StateBox, direction: Direction, dt_h: f64) -> Range {
        let p = &self.parameters;
        let per_soc = p.capacity_ah / dt_h;
        let (low, high) = match direction {
            Direction::Charge => (p.soc_max - states.soc.high, p.soc_max - states.soc.low),
            Direction::Discharge => (states.soc.low - p.soc_min, states.soc.high - p.soc_min),
        };
        Range { low: low.max(0.0) * per_soc, high: high.max(0.0) * per_soc }
    }

    /// Smallest and largest limit of the AC power over a box [W].
    fn limits(&self, c: &CoefficientRanges, room: &Range, direction: Direction) -> Range {
        let (v, r) = (c.voltage_v, c.resistance_ohm);
        let of_voltage = |v: f64, r: f64| self.parameters.voltage_current_a(direction, v, r);
        let curve = self.loss(direction);
        match direction {
            // What the room allows rises with V and R, what the voltage limit allows falls.
            Direction::Charge => {
                let internal = |v: f64, r: f64, current: f64| current * (v + r * current);
                let by_room = |v, r, room| curve.largest_power(internal(v, r, room));
                let by_voltage = |v, r| curve.largest_power(internal(v, r, of_voltage(v, r)));
                Range {
                    low: by_room(v.low, r.low, room.low).min(by_voltage(v.high, r.high)),
                    high: by_room(v.high, r.high, room.high).min(by_voltage(v.low, r.low)),
                }
            }
            // All rise with V and fall with R.
            Direction::Discharge => {
                let largest = |v: f64, r: f64, room: f64| {
                    let current = room.min(0.5 * v / r).min(of_voltage(v, r));
                    curve.largest_power(current * (v - r * current))
                };
                Range { low: largest(v.low, r.high, room.low), high: largest(v.high, r.low, room.high) }
            }
        }
    }

    /// Current and heat over a box of states and a range of requests: over parts of it, so that what a nearly empty
    /// string could do if it had more charge does not count.
    pub(crate) fn current_and_heat(
        &self,
        states: &StateBox,
        requests_w: &Range,
        interval: &Interval,
    ) -> (Range, Range) {
        let (mut current, mut heat) = (Range::EMPTY, Range::EMPTY);
        let mut low = states.soc.low;
        let borders = BORDERS_SOC.iter().copied().filter(|b| *b > states.soc.low && *b < states.soc.high);
        for high in borders.chain([states.soc.high]) {
            let part = StateBox { soc: Range { low, high }, ..*states };
            let (i, h) = self.current_and_heat_of_part(&part, requests_w, interval);
            (current, heat) = (current.union(&i), heat.union(&h));
            low = high;
        }
        (current, heat)
    }

    fn current_and_heat_of_part(
        &self,
        states: &StateBox,
        requests_w: &Range,
        interval: &Interval,
    ) -> (Range, Range) {
        let direction = interval.direction;
        let c = self.ranges(direction, states);
        let (v, r) = (c.voltage_v, c.resistance_ohm);
        let room = self.room(states, direction, interval.dt_h);
        let curve = self.loss(direction);
        let Range { low: smallest, high: largest } = self.limits(&c, &room, direction);
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
        // Where the battery gives its largest power the roots meet, and rounding grows to that of a square root.
        (current, Range { low: heat_low, high: heat_high.min(by_current).max(heat_low) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::StringState;
    use crate::search::common;

    /// What a state at a corner of the box may be beyond the range by rounding.
    const ABOVE: f64 = 1.0 + 1e-12;

    /// At a power that has to be taken, the least heat is that of the largest `V^2 / R` in the box.
    #[test]
    fn heat_and_current_of_every_state_and_request_are_in_the_ranges_of_their_box() {
        let system = common::reference(1);
        let string = StringModel::new(system.strings[0].clone());
        let within = |low: f64, high: f64, i: u32| low + (high - low) * f64::from(i) / 4.0;
        for direction in [Direction::Charge, Direction::Discharge] {
            let interval = Interval { direction, ambient_c: 25.0, dt_h: common::DT_H };
            for (low, high) in [(0.12, 0.14), (0.3, 0.5), (0.5, 0.75)] {
                let states =
                    StateBox { soc: Range { low, high }, temperature_c: Range { low: 25.0, high: 35.0 } };
                let requests = Range { low: 0.8 * common::NOMINAL_W, high: 0.82 * common::NOMINAL_W };
                let (current, heat) = string.current_and_heat(&states, &requests, &interval);
                let (mut least, mut most) = (f64::INFINITY, 0.0_f64);
                for i in 0..125 {
                    let state = StringState {
                        soc: within(low, high, i % 5),
                        temperature_c: within(25.0, 35.0, i / 5 % 5),
                    };
                    let flow = string.step(state, within(requests.low, requests.high, i / 25), &interval);
                    least = least.min(flow.battery_w);
                    most = most.max(flow.battery_w);
                    assert!(current.low <= flow.current_a * ABOVE && flow.current_a <= current.high * ABOVE);
                }
                assert!(
                    heat.low <= least * ABOVE && most <= heat.high * ABOVE,
                    "{heat:?}: {least} to {most}"
                );
                assert!(heat.low > 0.9 * least, "{heat:?} far below {least}");
            }
        }
    }
}

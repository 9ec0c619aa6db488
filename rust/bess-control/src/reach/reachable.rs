//! Rigorous bounds of every state that a feasible schedule can reach.

use crate::model::{ControlHorizon, Range, StateBox};

impl ControlHorizon {
    /// Boxes `(M, T + 1)` that contain the state at the start of each step, and at the end of the last, of every
    /// schedule with `sum u = demand` and `u = 0` or `minimum power <= u <= limit`.
    pub fn reachable(&self) -> Vec<StateBox> {
        let n_steps = self.n_steps();
        let mut boxes = Vec::with_capacity(self.n_strings() * (n_steps + 1));
        for m in 0..self.n_strings() {
            let mut states = StateBox::from(self.start[m]);
            boxes.push(states);
            for (t, interval) in self.intervals.iter().enumerate() {
                states = self.string(m).cell(&states, &self.request_range(m, t), interval).end;
                boxes.push(states);
            }
        }
        boxes
    }

    /// Whether a string may have availability loss in a step, `(M, T)`, with states in these boxes, `(M, T + 1)`.
    pub fn may_shed(&self, boxes: &[StateBox]) -> Vec<bool> {
        let n_steps = self.n_steps();
        let cells = (0..self.n_strings()).flat_map(|m| (0..n_steps).map(move |t| (m, t)));
        let sheds = |(m, t): (usize, usize)| {
            let states = &boxes[m * (n_steps + 1) + t];
            self.string(m).cell(states, &self.request_range(m, t), &self.intervals[t]).may_shed()
        };
        cells.map(sheds).collect()
    }

    /// Request range of a string, given the limits of the others [W].
    pub(crate) fn request_range(&self, m: usize, t: usize) -> Range {
        let total = self.total_limit_w[t];
        let others = total - self.limit(m, t);
        Range {
            low: (self.demand_w[t] - others - 1e-9 * total).max(0.0),
            high: self.limit(m, t).min(self.demand_w[t]) * (1.0 + 1e-12),
        }
    }
}

#[cfg(test)]
mod tests {
    use bess_tables::Direction;

    use super::*;
    use crate::model::{Interval, StringModel, StringState};
    use crate::tests::common;

    /// Tolerance for rounding.
    const ABOVE: f64 = 1.0 + 1e-12;

    /// At a given power, the minimum heat occurs at the largest `V^2 / R` of the box.
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
                let cell = string.cell(&states, &requests, &interval);
                let (current, heat) = (cell.current_a, cell.heat_w);
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

    /// Random boxes of different widths, and requests from watts to the nominal power.
    #[test]
    fn every_flow_from_a_box_is_in_its_operating_ranges() {
        let system = common::reference(1);
        let string = StringModel::new(system.strings[0].clone());
        let mut random = fastrand::Rng::with_seed(7);
        let (mut sheds_at_all, mut draws_back) = (0, 0);
        for case in 0..4000 {
            let mut between = |low: f64, high: f64| low + (high - low) * random.f64();
            let mut range = |low: f64, high: f64, width: f64| {
                let at = between(low - 0.2 * (high - low), high).clamp(low, high);
                Range { low: at, high: (at + 10_f64.powf(between(-6.0, 0.0)) * width).min(high) }
            };
            let states = StateBox { soc: range(0.0, 1.0, 0.3), temperature_c: range(-10.0, 62.0, 20.0) };
            let largest = 10_f64.powf(between(0.0, common::NOMINAL_W.log10()));
            let requests = Range { low: between(-0.5, 1.0).max(0.0) * largest, high: largest };
            let direction = if case % 2 == 0 { Direction::Charge } else { Direction::Discharge };
            let interval = Interval { direction, ambient_c: between(-10.0, 45.0), dt_h: common::DT_H };
            let cell = string.cell(&states, &requests, &interval);
            let (current, heat, reached) = (cell.current_a, cell.heat_w, cell.end);
            for _ in 0..20 {
                let mut inside = |range: &Range| match random.u8(0..4) {
                    0 => range.low,
                    1 => range.high,
                    _ => range.low + (range.high - range.low) * random.f64(),
                };
                let state =
                    StringState { soc: inside(&states.soc), temperature_c: inside(&states.temperature_c) };
                let flow = string.step(state, inside(&requests), &interval);
                let holds = |range: &Range, value: f64| {
                    let rounding = 1e-9 * (1.0 + value.abs());
                    range.low - rounding <= value && value <= range.high + rounding
                };
                assert!(holds(&current, flow.current_a), "{current:?}: {flow:?} from {state:?}");
                assert!(holds(&heat, flow.battery_w), "{heat:?}: {flow:?} from {state:?}");
                assert!(holds(&reached.soc, flow.end.soc), "{reached:?}: {flow:?} from {state:?}");
                assert!(holds(&reached.temperature_c, flow.end.temperature_c), "{reached:?}: {flow:?}");
                let sheds_little = flow.delivered_w == 0.0 && flow.availability_w < string.min_power_w();
                assert!(sheds_little || holds(&cell.shed_w, flow.availability_w), "{cell:?}: {flow:?}");
                let sheds = flow.availability_w > 0.0 && !sheds_little;
                assert!(cell.may_shed() || !sheds, "{cell:?}: {flow:?} from {state:?}");
                assert!(!sheds || holds(&cell.shed_soc, flow.end.soc), "{cell:?}: {flow:?}");
                if flow.delivered_w > 0.0 {
                    let voltage_v = string.coefficients(direction, state).voltage_v;
                    assert!(holds(&cell.delivered_w, flow.delivered_w), "{cell:?}: {flow:?}");
                    assert!(holds(&cell.battery_w, voltage_v * flow.current_a), "{cell:?}: {flow:?}");
                } else {
                    assert!(cell.may_be_off, "{cell:?}: {flow:?} from {state:?}");
                }
                sheds_at_all += usize::from(flow.availability_w > 0.0);
                draws_back += usize::from(flow.current_a < 0.0);
            }
        }
        assert!(sheds_at_all > 1000 && draws_back > 1000, "{sheds_at_all} {draws_back}");
    }
}

//! The control model of plans: coefficients from the middle of the interval (explicit midpoint rule), and full requests until a
//! string is full or empty.

use super::loss_curve::LossCurve;
use super::string::{small_root, Coefficients, Flow, Interval, StringModel, StringState};

/// Parts of an interval at low SOC in the midpoint rule.
const LOW_SOC_PARTS: u32 = 4;

impl Flow {
    /// Adds a share of the interval, which begins where the last one ended.
    #[inline]
    fn add(&mut self, share: f64, flow: Flow) {
        self.delivered_w += share * flow.delivered_w;
        self.availability_w += share * flow.availability_w;
        self.derating_w += share * flow.derating_w;
        self.inverter_w += share * flow.inverter_w;
        self.battery_w += share * flow.battery_w;
        self.current_a += share * flow.current_a;
        self.end = flow.end;
    }
}

impl StringModel {
    /// [`Self::step_midpoint`] of a positive request, with the coefficients `c` of the start.
    #[inline]
    pub(super) fn midpoint(
        &self,
        curve: &LossCurve,
        c: Coefficients,
        state: StringState,
        request_w: f64,
        interval: &Interval,
    ) -> Flow {
        if state.soc >= self.parameters.low_soc_switch {
            let loss_at = curve.known_at(request_w);
            let (middle, end_soc) = self.middle(curve, &loss_at, &c, state, request_w, interval);
            if end_soc >= self.parameters.low_soc_switch {
                let c = self.coefficients(interval.direction, middle);
                return self.until_limit(curve, loss_at, state, request_w, interval, &c);
            }
        }
        self.step_in_parts(curve, c, state, request_w, interval)
    }

    #[inline(never)]
    fn step_in_parts(
        &self,
        curve: &LossCurve,
        mut c: Coefficients,
        state: StringState,
        request_w: f64,
        interval: &Interval,
    ) -> Flow {
        let share = 1.0 / LOW_SOC_PARTS as f64;
        let part = Interval { dt_h: share * interval.dt_h, ..*interval };
        let loss_at = curve.known_at(request_w);
        let mut whole = Flow { end: state, ..Flow::default() };
        for number in 0..LOW_SOC_PARTS {
            if number > 0 {
                c = self.coefficients(part.direction, whole.end);
            }
            let (middle, _) = self.middle(curve, &loss_at, &c, whole.end, request_w, &part);
            c = self.coefficients(part.direction, middle);
            whole.add(share, self.until_limit(curve, &loss_at, whole.end, request_w, &part, &c));
        }
        whole
    }

    /// A request with known coefficients, delivered in full until the string is full or empty.
    #[inline(always)]
    fn until_limit(
        &self,
        curve: &LossCurve,
        loss_at: impl Fn(f64) -> (f64, f64),
        state: StringState,
        request_w: f64,
        interval: &Interval,
        c: &Coefficients,
    ) -> Flow {
        let flow = self.carry_out(curve, loss_at, state, request_w, interval, c);
        if flow.availability_w > 0.0 {
            self.divided_at_limit(curve, state, request_w, interval, c).unwrap_or(flow)
        } else {
            flow
        }
    }

    /// In two parts, before and after the string is full or empty; None if it becomes neither.
    #[inline(never)]
    fn divided_at_limit(
        &self,
        curve: &LossCurve,
        state: StringState,
        request_w: f64,
        interval: &Interval,
        c: &Coefficients,
    ) -> Option<Flow> {
        let p = &self.parameters;
        let in_share = |share: f64, state: StringState| {
            let interval = Interval { dt_h: share * interval.dt_h, ..*interval };
            self.carry_out(curve, |power_w| curve.at(power_w), state, request_w, &interval, c)
        };
        let room = interval.direction.pick(p.soc_max - state.soc, state.soc - p.soc_min);
        let share = room * p.capacity_ah / (in_share(0.0, state).current_a * interval.dt_h);
        (share > 0.0 && share < 1.0).then(|| {
            let mut whole = Flow::default();
            whole.add(share, in_share(share, state));
            whole.add(1.0 - share, in_share(1.0 - share, whole.end));
            whole
        })
    }

    /// Predicted state in the middle of an interval, and SOC at its end.
    #[inline(always)]
    fn middle(
        &self,
        curve: &LossCurve,
        loss_at: impl Fn(f64) -> (f64, f64),
        c: &Coefficients,
        state: StringState,
        request_w: f64,
        interval: &Interval,
    ) -> (StringState, f64) {
        let wanted = c.derating * request_w;
        let internal = curve.internal_w(wanted, loss_at(wanted).0);
        let (mut current_a, _) = small_root(c, interval.direction, internal);
        let p = &self.parameters;
        if !p.voltage_allows(interval.direction, c.voltage_v, c.resistance_ohm * current_a) {
            current_a = p.voltage_current_a(interval.direction, c.voltage_v, c.resistance_ohm);
        }
        let half = Interval { dt_h: 0.5 * interval.dt_h, ..*interval };
        let soc = self.soc_after(state.soc, current_a, &half).clamp(p.soc_min, p.soc_max);
        let temperature_c = self.warmed(state.temperature_c, c.resistance_ohm * current_a * current_a, &half);
        (StringState { soc, temperature_c }, 2.0 * soc - state.soc)
    }
}

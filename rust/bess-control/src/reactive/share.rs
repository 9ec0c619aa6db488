//! Reactive power at minimum loss (docs/equations.md, R3): the one-step problem, over apparent power.

use bess_tables::{Direction, InputError};

use crate::error::{check_length, check_range};
use crate::model::{ControlModel, LossCurve};
use crate::one_step::{solve, Response, StringCost};

/// Share of the total below which a reactive power is a rounding error.
const ROUNDING_SHARE: f64 = 1e-9;
/// Halvings of an interval between two knots in the search for equal marginal losses.
const BISECTIONS: usize = 40;

/// An inverter in one step: its loss over apparent power, active power, reactive headroom, and the cost of a start [W].
#[derive(Debug, Clone, Copy)]
struct Inverter<'a> {
    curve: &'a LossCurve,
    active_w: f64,
    headroom_var: f64,
    start_w: f64,
}

impl ControlModel {
    /// Allocates reactive power `total_var >= 0` to strings with signed active powers `request_w` `(M,)` at
    /// minimum inverter loss. The limit of a string is the remainder of `limit_va` `(M,)`. Strings without
    /// active power are switched on if they are needed, or if this saves more than `start_w` `(M,)`, the cost
    /// of a start [W]. Reactive power above all limits is not allocated.
    ///
    /// # Errors
    ///
    /// Lengths do not agree, or a number is not finite or negative.
    pub fn share_reactive(
        &self,
        request_w: &[f64],
        total_var: f64,
        limit_va: &[f64],
        start_w: &[f64],
    ) -> Result<Vec<f64>, InputError> {
        let n = self.strings().len();
        for (name, values) in [("request", request_w), ("limit", limit_va), ("start", start_w)] {
            check_length(name, values, n)?;
        }
        check_range("request", request_w, (-f64::MAX, f64::MAX), " W")?;
        check_range("reactive power", &[total_var], (0.0, f64::MAX), " var")?;
        check_range("limit", limit_va, (0.0, f64::MAX), " VA")?;
        check_range("start", start_w, (0.0, f64::MAX), " W")?;
        let inverter = |m: usize| {
            let string = &self.strings()[m];
            let (active_w, max_va) = (request_w[m].abs(), limit_va[m].min(string.nominal_w()));
            let headroom_var = (max_va * max_va - active_w * active_w).max(0.0).sqrt();
            let curve = string.loss(Direction::of(request_w[m]));
            Inverter { curve, active_w, headroom_var, start_w: start_w[m] }
        };
        let inverters: Vec<_> = (0..n).map(inverter).collect();
        let headroom: f64 = inverters.iter().map(|i| i.headroom_var).sum();
        Ok(share(&inverters, total_var.min(headroom)))
    }
}

/// Reactive power of each inverter, in total `total_var`, which is at most their total headroom.
fn share(inverters: &[Inverter<'_>], total_var: f64) -> Vec<f64> {
    if total_var <= 0.0 {
        return vec![0.0; inverters.len()];
    }
    let mut reactive_var = solve(inverters, total_var).request_w;
    // Rounding errors of the combination of two responses must not start an inverter or exceed a limit.
    for (q, inverter) in reactive_var.iter_mut().zip(inverters) {
        let is_rounding = inverter.active_w == 0.0 && *q < ROUNDING_SHARE * total_var;
        *q = if is_rounding { 0.0 } else { q.min(inverter.headroom_var) };
    }
    let mut remainder_var = total_var - reactive_var.iter().sum::<f64>();
    for (q, inverter) in reactive_var.iter_mut().zip(inverters) {
        if inverter.active_w > 0.0 || *q > 0.0 {
            let more = remainder_var.min(inverter.headroom_var - *q).max(0.0);
            *q += more;
            remainder_var -= more;
        }
    }
    if !inverters.iter().all(Inverter::is_convex) {
        exchange(inverters, &mut reactive_var);
    }
    reactive_var
}

impl Inverter<'_> {
    fn loss_w(&self, reactive_var: f64) -> f64 {
        self.curve.at(self.active_w.hypot(reactive_var)).0
    }

    /// Cost of a reactive power [W]: loss and start; 0 if the inverter is off.
    fn cost_w(&self, reactive_var: f64) -> f64 {
        match (self.active_w > 0.0, reactive_var > 0.0) {
            (true, _) => self.loss_w(reactive_var),
            (false, true) => self.loss_w(reactive_var) + self.start_w,
            (false, false) => 0.0,
        }
    }

    /// Reactive power that minimises loss minus `price` times reactive power; the smallest of several minima.
    ///
    /// The curve is linear in apparent power between knots, with slope `b`: the minimum is at a knot, at an
    /// end, or where the marginal loss `b q / S` equals the price.
    fn best_at(&self, price: f64) -> Response {
        let (p, most) = (self.active_w, self.active_w.hypot(self.headroom_var));
        let mut best = (self.loss_w(0.0), 0.0);
        let mut consider = |q: f64, loss: f64| {
            if loss - price * q < best.0 {
                best = (loss - price * q, q);
            }
        };
        let (knots, losses) = (self.curve.power(), self.curve.loss());
        for (s, w) in knots.windows(2).zip(losses.windows(2)) {
            if s[1] <= p || s[0] >= most {
                continue;
            }
            let slope = (w[1] - w[0]) / (s[1] - s[0]);
            if price > 0.0 && price < slope {
                let q = p * price / (slope * slope - price * price).sqrt();
                let apparent = p.hypot(q);
                if q < self.headroom_var && (s[0]..=s[1]).contains(&apparent) {
                    consider(q, w[0] + slope * (apparent - s[0]));
                }
            }
            if s[1] < most {
                consider((s[1] * s[1] - p * p).sqrt(), w[1]);
            }
        }
        consider(self.headroom_var, self.loss_w(self.headroom_var));
        Response { value: best.0, request_w: best.1, shed_w: 0.0 }
    }

    fn slopes(&self) -> impl Iterator<Item = f64> + '_ {
        let (knots, losses) = (self.curve.power(), self.curve.loss());
        knots.windows(2).zip(losses.windows(2)).map(|(s, w)| (w[1] - w[0]) / (s[1] - s[0]))
    }

    /// Whether the loss is convex in reactive power, up to rounding of the curve.
    fn is_convex(&self) -> bool {
        let mut before = 0.0;
        self.slopes().all(|slope| {
            let rises = slope >= before - 1e-9;
            before = slope;
            rises
        })
    }

    /// Zero, the reactive powers at the knots of the curve, and the maximum: the loss is smooth between them.
    fn breakpoints(&self) -> impl Iterator<Item = f64> + '_ {
        let inside = self.curve.power().iter().filter(|&&s| s > self.active_w);
        let at_knots = inside.map(|s| (s * s - self.active_w * self.active_w).sqrt());
        at_knots.filter(|&q| q < self.headroom_var).chain([0.0, self.headroom_var])
    }
}

impl StringCost for Inverter<'_> {
    fn on(&self, price: f64) -> Response {
        let on = self.best_at(price);
        Response { value: on.value + if self.active_w > 0.0 { 0.0 } else { self.start_w }, ..on }
    }

    fn off(&self, _price: f64) -> Response {
        Response { value: 0.0, request_w: 0.0, shed_w: 0.0 }
    }

    fn steepest(&self) -> f64 {
        self.slopes().map(f64::abs).fold(0.0, f64::max)
    }

    fn largest_request(&self, on: bool) -> f64 {
        if on {
            self.headroom_var
        } else {
            0.0
        }
    }

    fn is_on(&self) -> bool {
        self.active_w > 0.0
    }
}

/// Reactive power of the first of two inverters, between two breakpoints, at which both have the same marginal loss.
fn stationary(first: &Inverter<'_>, second: &Inverter<'_>, sum_var: f64, ends: (f64, f64)) -> Option<f64> {
    // Between knots the loss is linear in apparent power, so that two points give its slope.
    let marginal_loss = |inverter: &Inverter<'_>, ends: (f64, f64)| {
        let (from, to) = (inverter.active_w.hypot(ends.0), inverter.active_w.hypot(ends.1));
        let slope = (inverter.loss_w(ends.1) - inverter.loss_w(ends.0)) / (to - from);
        let active_w = inverter.active_w;
        move |q: f64| slope * q / active_w.hypot(q)
    };
    let (of_first, of_second) =
        (marginal_loss(first, ends), marginal_loss(second, (sum_var - ends.0, sum_var - ends.1)));
    let rises = |q: f64| of_first(q) >= of_second(sum_var - q);
    let (mut low, mut high) = ends;
    if rises(low) || !rises(high) {
        return None;
    }
    for _ in 0..BISECTIONS {
        let middle = 0.5 * (low + high);
        if rises(middle) {
            high = middle;
        } else {
            low = middle;
        }
    }
    Some(0.5 * (low + high))
}

/// Exchanges reactive power between pairs of inverters while this saves losses: the one-step problem is exact for convex
/// curves only.
fn exchange(inverters: &[Inverter<'_>], shares_var: &mut [f64]) {
    let pairs = || (0..inverters.len()).flat_map(|a| (0..a).map(move |b| (a, b)));
    let (mut breakpoints, mut saves) = (vec![], true);
    while saves {
        saves = false;
        for (a, b) in pairs() {
            let (first, second, sum) = (&inverters[a], &inverters[b], shares_var[a] + shares_var[b]);
            if sum <= 0.0 {
                continue;
            }
            let cost = |q: f64| first.cost_w(q) + second.cost_w(sum - q);
            let now = cost(shares_var[a]);
            let (low, high) = ((sum - second.headroom_var).max(0.0), first.headroom_var.min(sum));
            breakpoints.clear();
            breakpoints.extend(first.breakpoints().chain(second.breakpoints().map(|q| sum - q)));
            breakpoints.retain(|q| (low..=high).contains(q));
            breakpoints.sort_by(f64::total_cmp);
            let between = breakpoints.windows(2).filter_map(|q| stationary(first, second, sum, (q[0], q[1])));
            let best =
                breakpoints.iter().copied().chain(between).min_by(|x, y| cost(*x).total_cmp(&cost(*y)));
            if let Some(q) = best.filter(|&q| cost(q) < now * (1.0 - 1e-9)) {
                (shares_var[a], shares_var[b]) = (q, sum - q);
                saves = true;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::LossCurve;
    use bess_tables::Lut;
    use proptest::prelude::*;

    const NOMINAL_W: f64 = 100.0;

    /// Convex losses, as of an inverter: constant, linear and squared parts, in percent of nominal power.
    fn curve(constant: f64, linear: f64, squared: f64) -> LossCurve {
        let x: Vec<f64> = (0..=10).map(|k| 10.0 * f64::from(k)).collect();
        let y = x.iter().map(|x| constant + linear * x / 100.0 + squared * (x / 100.0).powi(2)).collect();
        LossCurve::new(&Lut::new("w", x, y).unwrap(), Direction::Discharge, NOMINAL_W)
    }

    fn headroom(active_w: f64) -> f64 {
        (NOMINAL_W * NOMINAL_W - active_w * active_w).sqrt()
    }

    fn inverter(curve: &LossCurve, active_w: f64, start_w: f64) -> Inverter<'_> {
        Inverter { curve, active_w, headroom_var: headroom(active_w), start_w }
    }

    fn best(curves: &[LossCurve], active_w: &[f64], total_var: f64) -> Vec<f64> {
        let inverters: Vec<_> = curves.iter().zip(active_w).map(|(c, &p)| inverter(c, p, 0.0)).collect();
        share(&inverters, total_var)
    }

    proptest! {
        #[test]
        fn two_inverters_have_no_higher_losses_than_with_a_thousand_other_shares(
            (a, b, c) in (0.1..2.0, 0.0..2.0, 0.0..3.0f64),
            like: bool,
            powers in (0.0..100.0f64, prop_oneof![Just(0.0), 0.0..100.0f64]),
            part in 0.0..1.0f64,
        ) {
            let other = if like { curve(a, b, c) } else { curve(0.7, 1.0, 1.0) };
            let (curves, active_w) = ([curve(a, b, c), other], [powers.0, powers.1]);
            let total_var = part * (headroom(powers.0) + headroom(powers.1));
            let found = best(&curves, &active_w, total_var);
            let sum: f64 = found.iter().sum();
            prop_assert!((sum - total_var).abs() <= 1e-9 * (1.0 + total_var));
            for (q, p) in found.iter().zip(active_w) {
                prop_assert!((0.0..=headroom(p)).contains(q));
            }
            let cost = |a: f64, b: f64| -> f64 {
                let one = |curve: &LossCurve, p: f64, q: f64| {
                    if p == 0.0 && q == 0.0 { 0.0 } else { curve.at(p.hypot(q)).0 }
                };
                one(&curves[0], active_w[0], a) + one(&curves[1], active_w[1], b)
            };
            let cost_w = cost(found[0], found[1]);
            for k in 0..=1000 {
                let q = total_var * f64::from(k) / 1000.0;
                if q <= headroom(powers.0) && total_var - q <= headroom(powers.1) {
                    prop_assert!(cost_w <= cost(q, total_var - q) + 1e-9, "{q}: {cost_w}");
                }
            }
        }

        #[test]
        fn inverters_that_run_have_equal_marginal_losses(
            powers in prop::collection::vec(1.0..70.0f64, 2..6), part in 0.05..0.6f64,
        ) {
            // Without knots between: a squared loss, finely tabulated.
            let x: Vec<f64> = (0..=400).map(|k| 0.25 * f64::from(k)).collect();
            let y = x.iter().map(|x| 1.0 + 0.01 * x + 2e-4 * x * x).collect();
            let curve =
                LossCurve::new(&Lut::new("w", x, y).unwrap(), Direction::Discharge, NOMINAL_W);
            let curves = vec![curve; powers.len()];
            let total_var = part * powers.iter().map(|&p| headroom(p)).sum::<f64>();
            let found = best(&curves, &powers, total_var);
            let marginal: Vec<f64> = powers
                .iter()
                .zip(&found)
                .filter(|(&p, &q)| q < headroom(p) - 0.5)
                .map(|(&p, &q)| (0.01 + 4e-4 * p.hypot(q)) * q / p.hypot(q))
                .collect();
            for value in &marginal {
                prop_assert!((value - marginal[0]).abs() < 2.5e-4, "{marginal:?}");
            }
        }
    }

    #[test]
    fn idle_inverters_start_only_if_they_save_losses() {
        let curves = vec![curve(1.0, 1.0, 0.5); 4];
        let on = |total_var| best(&curves, &[0.0; 4], total_var).iter().filter(|&&q| q > 0.0).count();
        assert_eq!([0.0, 60.0, 100.0, 150.0, 390.0].map(on), [0, 1, 1, 2, 4]);
        let steep = vec![curve(0.1, 0.0, 3.0); 4];
        assert!(best(&steep, &[0.0; 4], 100.0).iter().all(|&q| q > 0.0));
    }

    #[test]
    fn additional_idle_inverters_never_raise_the_cost() {
        let curve = curve(1.0, 1.0, 0.5);
        let idle = |n: usize| vec![inverter(&curve, 0.0, 2.0); n];
        let running =
            [38.0, 7.5, 74.0, 60.0, 5.0, 53.0, 51.0].map(|active_w| inverter(&curve, active_w, 2.0));
        let cost_w = |inverters: &[Inverter<'_>]| -> f64 {
            share(inverters, 645.0).into_iter().zip(inverters).map(|(q, inverter)| inverter.cost_w(q)).sum()
        };
        let all_w = cost_w(&[running.to_vec(), idle(9)].concat());
        for n in 2..9 {
            assert!(all_w <= cost_w(&[running.to_vec(), idle(n)].concat()) + 1e-9, "{n}");
        }
    }

    #[test]
    fn no_inverter_starts_if_its_start_costs_more_than_it_saves() {
        let curves = [curve(0.1, 0.0, 3.0), curve(0.1, 0.0, 3.0)];
        let runs = |start_w: f64| {
            share(&[inverter(&curves[0], 50.0, start_w), inverter(&curves[1], 0.0, start_w)], 60.0)[1] > 0.0
        };
        assert!(runs(0.0) && !runs(1.0));
    }
}

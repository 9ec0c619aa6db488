//! Selection of inverters for reactive power, and its allocation (docs/equations.md, R3).

use bess_tables::Direction;

use crate::error::{check_length, check_range};
use crate::model::ControlModel;
use crate::reactive::spread::{spread, Inverter};
use crate::ControlError;

/// Minimum saving of another set of inverters, as a share of the losses.
const WORTHWHILE: f64 = 1e-9;

/// Inverters that are on, their reactive powers, and their cost [W].
#[derive(Debug, Clone)]
struct Share {
    on: Vec<bool>,
    reactive_var: Vec<f64>,
    cost_w: f64,
}

/// Reactive power to be allocated to inverters, with the cost of a start of each [W].
struct Sharing<'a> {
    inverters: Vec<Inverter<'a>>,
    start_w: &'a [f64],
    total_var: f64,
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
    ) -> Result<Vec<f64>, ControlError> {
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
            let (active_w, most_va) = (request_w[m].abs(), limit_va[m].min(string.nominal_w()));
            let room_var = (most_va * most_va - active_w * active_w).max(0.0).sqrt();
            Inverter { curve: string.loss(Direction::of(request_w[m])), active_w, room_var }
        };
        let inverters: Vec<_> = (0..n).map(inverter).collect();
        let room: f64 = inverters.iter().map(|i| i.room_var).sum();
        Ok(Sharing { inverters, start_w, total_var: total_var.min(room) }.best().reactive_var)
    }
}

impl Sharing<'_> {
    /// Starts with the inverters that active power and the reactive headroom require. Then switches one
    /// inverter or exchanges two while this saves.
    fn best(&self) -> Share {
        let n = self.inverters.len();
        let mut on: Vec<bool> = self.inverters.iter().map(|i| i.active_w > 0.0).collect();
        while !self.fits(&on) {
            let off = (0..n).filter(|&m| !on[m] && self.inverters[m].room_var > 0.0);
            // The first of equal inverters.
            let room = |m: usize| self.inverters[m].room_var;
            match off.reduce(|a, b| if room(b) > room(a) { b } else { a }) {
                Some(m) => on[m] = true,
                None => break,
            }
        }
        let mut best = self.share(on);
        loop {
            let free: Vec<usize> = (0..n).filter(|&m| self.inverters[m].active_w == 0.0).collect();
            let mut found: Option<Share> = None;
            for (k, &a) in free.iter().enumerate() {
                for &b in &free[k..] {
                    if a != b && best.on[a] == best.on[b] {
                        continue;
                    }
                    let mut on = best.on.clone();
                    on[a] = !on[a];
                    if a != b {
                        on[b] = !on[b];
                    }
                    if !self.fits(&on) {
                        continue;
                    }
                    let share = self.share(on);
                    let least = found.as_ref().unwrap_or(&best).cost_w;
                    if share.cost_w < least - WORTHWHILE * least {
                        found = Some(share);
                    }
                }
            }
            match found {
                Some(share) => best = share,
                None => return best,
            }
        }
    }

    /// Whether these inverters can carry all reactive power.
    fn fits(&self, on: &[bool]) -> bool {
        let room: f64 = self.inverters.iter().zip(on).map(|(i, &on)| if on { i.room_var } else { 0.0 }).sum();
        room >= self.total_var * (1.0 - 1e-12)
    }

    /// The optimal allocation to the inverters that are on.
    fn share(&self, on: Vec<bool>) -> Share {
        let running: Vec<usize> = (0..on.len()).filter(|&m| on[m]).collect();
        let inverters: Vec<_> = running.iter().map(|&m| self.inverters[m]).collect();
        let (mut reactive_var, mut cost_w) = (vec![0.0; on.len()], 0.0);
        for (&m, q) in running.iter().zip(spread(&inverters, self.total_var)) {
            reactive_var[m] = q;
            let inverter = &self.inverters[m];
            cost_w += inverter.loss_w(q);
            if inverter.active_w == 0.0 {
                cost_w += self.start_w[m];
            }
        }
        Share { on, reactive_var, cost_w }
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

    fn room(active_w: f64) -> f64 {
        (NOMINAL_W * NOMINAL_W - active_w * active_w).sqrt()
    }

    fn best(curves: &[LossCurve], active_w: &[f64], total_var: f64) -> Share {
        let inverters: Vec<_> = curves
            .iter()
            .zip(active_w)
            .map(|(curve, &active_w)| Inverter { curve, active_w, room_var: room(active_w) })
            .collect();
        Sharing { inverters, start_w: &vec![0.0; curves.len()], total_var }.best()
    }

    proptest! {
        #[test]
        fn two_inverters_lose_no_more_than_on_any_of_a_thousand_other_shares(
            (a, b, c) in (0.1..2.0, 0.0..2.0, 0.0..3.0f64),
            like: bool,
            powers in (0.0..100.0f64, prop_oneof![Just(0.0), 0.0..100.0f64]),
            part in 0.0..1.0f64,
        ) {
            let other = if like { curve(a, b, c) } else { curve(0.7, 1.0, 1.0) };
            let (curves, active_w) = ([curve(a, b, c), other], [powers.0, powers.1]);
            let total_var = part * (room(powers.0) + room(powers.1));
            let found = best(&curves, &active_w, total_var);
            let sum: f64 = found.reactive_var.iter().sum();
            prop_assert!((sum - total_var).abs() <= 1e-9 * (1.0 + total_var));
            for (q, p) in found.reactive_var.iter().zip(active_w) {
                prop_assert!((0.0..=room(p)).contains(q));
            }
            let cost = |q: f64| -> f64 {
                let one = |curve: &LossCurve, p: f64, q: f64| {
                    if p == 0.0 && q == 0.0 { 0.0 } else { curve.at(p.hypot(q)).0 }
                };
                one(&curves[0], active_w[0], q) + one(&curves[1], active_w[1], total_var - q)
            };
            for k in 0..=1000 {
                let q = total_var * f64::from(k) / 1000.0;
                if q <= room(powers.0) && total_var - q <= room(powers.1) {
                    prop_assert!(found.cost_w <= cost(q) + 1e-9, "{q}: {} < {}", cost(q), found.cost_w);
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
            let total_var = part * powers.iter().map(|&p| room(p)).sum::<f64>();
            let found = best(&curves, &powers, total_var);
            let marginal: Vec<f64> = powers
                .iter()
                .zip(&found.reactive_var)
                .filter(|(&p, &q)| q < room(p) - 0.5)
                .map(|(&p, &q)| (0.01 + 4e-4 * p.hypot(q)) * q / p.hypot(q))
                .collect();
            for value in &marginal {
                prop_assert!((value - marginal[0]).abs() < 2.5e-4, "{marginal:?}");
            }
        }
    }

    #[test]
    fn only_as_many_idle_inverters_run_as_save_losses() {
        let curves = vec![curve(1.0, 1.0, 0.5); 4];
        let on = |total_var| best(&curves, &[0.0; 4], total_var).on.iter().filter(|&&on| on).count();
        assert_eq!([0.0, 60.0, 100.0, 150.0, 390.0].map(on), [0, 1, 1, 2, 4]);
        let steep = vec![curve(0.1, 0.0, 3.0); 4];
        assert_eq!(best(&steep, &[0.0; 4], 100.0).on, [true; 4]);
    }

    #[test]
    fn a_start_that_costs_more_than_it_saves_is_not_made() {
        let curves = [curve(0.1, 0.0, 3.0), curve(0.1, 0.0, 3.0)];
        let inverters: Vec<_> = curves
            .iter()
            .zip([50.0, 0.0])
            .map(|(curve, active_w)| Inverter { curve, active_w, room_var: room(active_w) })
            .collect();
        let runs = |start: f64| {
            Sharing { inverters: inverters.clone(), start_w: &[0.0, start], total_var: 60.0 }.best().on[1]
        };
        assert!(runs(0.0) && !runs(1.0));
    }
}

//! Reactive power of inverters that are on: equal marginal losses (docs/equations.md, R3).

use crate::model::LossCurve;

/// Halvings of the range of prices.
const HALVINGS: usize = 60;

/// An inverter in one step: its loss over apparent power, its active power, and its reactive headroom.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Inverter<'a> {
    pub curve: &'a LossCurve,
    pub active_w: f64,
    pub room_var: f64,
}

impl Inverter<'_> {
    /// Loss with a reactive power [W].
    pub fn loss_w(&self, reactive_var: f64) -> f64 {
        self.curve.at(self.active_w.hypot(reactive_var)).0
    }

    /// Reactive power that minimises loss minus `price` times reactive power; the smallest of several minima.
    ///
    /// The curve is linear in apparent power between knots, with slope `b`: the minimum is at a knot, at an
    /// end, or where the marginal loss `b q / S` equals the price.
    fn best_at(&self, price: f64) -> f64 {
        let (p, most) = (self.active_w, self.active_w.hypot(self.room_var));
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
                if q < self.room_var && (s[0]..=s[1]).contains(&apparent) {
                    consider(q, w[0] + slope * (apparent - s[0]));
                }
            }
            if s[1] < most {
                consider((s[1] * s[1] - p * p).sqrt(), w[1]);
            }
        }
        consider(self.room_var, self.loss_w(self.room_var));
        best.1
    }

    /// Slopes of the curve.
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

    /// Zero, the reactive powers at the knots of the curve, and the maximum.
    fn corners(&self) -> impl Iterator<Item = f64> + '_ {
        let inside = self.curve.power().iter().filter(|&&s| s > self.active_w);
        let at_knots = inside.map(|s| (s * s - self.active_w * self.active_w).sqrt());
        at_knots.filter(|&q| q < self.room_var).chain([0.0, self.room_var])
    }
}

/// Reactive power of each inverter, all of which are on, at minimum total loss: at one common price they
/// supply `total_var`, which is at most their total headroom. This is exact for convex curves; otherwise
/// pairs then exchange reactive power while this saves.
pub(crate) fn spread(inverters: &[Inverter<'_>], total_var: f64) -> Vec<f64> {
    let at = |price: f64| -> Vec<f64> { inverters.iter().map(|i| i.best_at(price)).collect() };
    let steepest =
        1.0001 * inverters.iter().flat_map(Inverter::slopes).map(f64::abs).fold(f64::MIN_POSITIVE, f64::max);
    let (mut low, mut high) = (-steepest, steepest);
    let (mut less, mut more) = (at(low), at(high));
    for _ in 0..HALVINGS {
        let price = 0.5 * (low + high);
        let here = at(price);
        if here.iter().sum::<f64>() <= total_var {
            (low, less) = (price, here);
        } else {
            (high, more) = (price, here);
        }
    }
    let mut rest = total_var - less.iter().sum::<f64>();
    for ((q, more), inverter) in less.iter_mut().zip(more).zip(inverters) {
        let step = rest.min(more - *q).max(0.0);
        *q = (*q + step).min(inverter.room_var);
        rest -= step;
    }
    if !inverters.iter().all(Inverter::is_convex) {
        exchange(inverters, &mut less);
    }
    less
}

/// Moves reactive power between pairs of inverters, one of each pair to a corner of its curve, while this
/// saves.
fn exchange(inverters: &[Inverter<'_>], shares_var: &mut [f64]) {
    let n = inverters.len();
    let mut saves = true;
    while saves {
        saves = false;
        for (a, b) in (0..n).flat_map(|a| (a + 1..n).map(move |b| (a, b))) {
            let (first, second, sum) = (&inverters[a], &inverters[b], shares_var[a] + shares_var[b]);
            let cost = |q: f64| first.loss_w(q) + second.loss_w(sum - q);
            let now = cost(shares_var[a]);
            let best = first
                .corners()
                .chain(second.corners().map(|q| sum - q))
                .filter(|&q| {
                    (0.0..=first.room_var).contains(&q) && (0.0..=second.room_var).contains(&(sum - q))
                })
                .min_by(|x, y| cost(*x).total_cmp(&cost(*y)));
            if let Some(q) = best.filter(|&q| cost(q) < now * (1.0 - 1e-9)) {
                (shares_var[a], shares_var[b]) = (q, sum - q);
                saves = true;
            }
        }
    }
}

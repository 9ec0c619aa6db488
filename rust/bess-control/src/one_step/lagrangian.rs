//! Lagrangian dual of the one-step problem: one price of the demand balance for all strings, which decouples
//! the strings. Every price gives a lower bound; a [`Commitment`] fixes inverter states.

use super::cost_curve::{Response, StringCost};

const MAX_PRICES: usize = 80;
const GAP: f64 = 1e-12;
/// Relative tolerance within which a total meets the demand: the sum of all limits may round to just below it.
const ROUNDING: f64 = 1e-12;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum InverterMode {
    Free,
    On,
    Off,
}

/// Fixed inverter states, and the total number `count` of inverters that are on, if given.
#[derive(Debug, Clone)]
pub(crate) struct Commitment {
    pub modes: Vec<InverterMode>,
    pub count: Option<usize>,
}

impl Commitment {
    /// Every string may be on or off, except those that must be on.
    pub fn of(curves: &[impl StringCost]) -> Self {
        let mode = |curve: &_| if StringCost::is_on(curve) { InverterMode::On } else { InverterMode::Free };
        Self { modes: curves.iter().map(mode).collect(), count: None }
    }

    pub fn free_to_switch_on(&self) -> Option<usize> {
        let on = self.modes.iter().filter(|m| **m == InverterMode::On).count();
        self.count.map(|count| count.saturating_sub(on))
    }
}

/// The Lagrangian at one price.
#[derive(Debug, Clone, Copy)]
struct DualPoint {
    price: f64,
    /// Lower bound of the one-step optimum.
    bound: f64,
    total_w: f64,
    shed_w: f64,
}

/// A free string with its responses on and off.
type FreeString = (usize, Response, Response);

/// Best bound of the one-step problem, and its requests.
#[derive(Debug, Clone)]
pub(crate) struct OneStepSolution {
    /// Lower bound of the cost (infinite if the demand cannot be met).
    pub bound: f64,
    /// Price of the demand [1/W].
    pub price: f64,
    /// Requests that sum to the demand [W]; optimal if the modes are fixed and the curves convex.
    pub request_w: Vec<f64>,
    /// Availability loss of these requests [W].
    pub shed_w: f64,
    /// Free strings, largest gain from switching on first.
    pub order: Vec<usize>,
    /// Number of these strings that are on.
    pub n_on: usize,
}

/// The Lagrangian at a price. `open` is a buffer: it returns the free strings, largest gain from switching on
/// first. `visit` receives the response of each string.
fn at_price(
    curves: &[impl StringCost],
    commitment: &Commitment,
    demand_w: f64,
    price: f64,
    open: &mut Vec<FreeString>,
    mut visit: impl FnMut(usize, bool, &Response),
) -> DualPoint {
    let (mut value, mut total_w, mut shed_w) = (0.0, 0.0, 0.0);
    let mut take = |m: usize, on: bool, response: &Response| {
        value += response.value;
        total_w += response.request_w;
        shed_w += response.shed_w;
        visit(m, on, response);
    };
    open.clear();
    for (m, (curve, mode)) in curves.iter().zip(&commitment.modes).enumerate() {
        match mode {
            InverterMode::On => take(m, true, &curve.on(price)),
            InverterMode::Off => take(m, false, &curve.off(price)),
            InverterMode::Free => open.push((m, curve.on(price), curve.off(price))),
        }
    }
    open.sort_by(|a, b| (a.1.value - a.2.value).total_cmp(&(b.1.value - b.2.value)));
    let n_on = commitment
        .free_to_switch_on()
        .unwrap_or_else(|| open.iter().take_while(|(_, on, off)| on.value < off.value).count());
    for (rank, (m, on, off)) in open.iter().enumerate() {
        take(*m, rank < n_on, if rank < n_on { on } else { off });
    }
    DualPoint { price, bound: value + price * demand_w, total_w, shed_w }
}

/// Bounds at a price with 0, 1, ... free strings on.
pub(crate) fn bounds_by_count(
    curves: &[impl StringCost],
    commitment: &Commitment,
    demand_w: f64,
    price: f64,
) -> Vec<f64> {
    let (mut open, mut fixed) = (Vec::new(), 0.0);
    at_price(curves, commitment, demand_w, price, &mut open, |m, _, response| {
        if commitment.modes[m] != InverterMode::Free {
            fixed += response.value;
        }
    });
    let off = fixed + open.iter().map(|(_, _, off)| off.value).sum::<f64>();
    let switched_on = open.iter().scan(off, |value, (_, on, off)| {
        *value += on.value - off.value;
        Some(*value)
    });
    std::iter::once(off).chain(switched_on).map(|value| value + price * demand_w).collect()
}

/// Maximum total request of a commitment without shedding [W].
fn capacity_w(curves: &[impl StringCost], commitment: &Commitment) -> f64 {
    let mut free = Vec::new();
    let mut total = 0.0;
    for (curve, mode) in curves.iter().zip(&commitment.modes) {
        match mode {
            InverterMode::On => total += curve.largest_request(true),
            InverterMode::Off => total += curve.largest_request(false),
            InverterMode::Free => {
                // A derated string takes part or all of its request also when off.
                let off = curve.largest_request(false);
                total += off;
                free.push(curve.largest_request(true) - off);
            }
        }
    }
    free.sort_by(|a, b| b.total_cmp(a));
    let n_on = commitment.free_to_switch_on().unwrap_or(free.len());
    total + free.iter().take(n_on).sum::<f64>()
}

/// Maximises the Lagrangian over the price: concave, so bracketed by the sign of `demand - total`. Secant steps on
/// the total (exact for quadratic costs) alternate with intersections of supporting lines (exact for kinks). Every
/// price gives a valid bound, so stopping early loses tightness, not validity.
pub(crate) fn maximise(
    curves: &[impl StringCost],
    commitment: &Commitment,
    demand_w: f64,
    guess: f64,
) -> OneStepSolution {
    let must_serve = !curves.iter().any(StringCost::may_shed);
    let possible = commitment
        .free_to_switch_on()
        .is_none_or(|n| n <= commitment.modes.iter().filter(|m| **m == InverterMode::Free).count());
    if !possible || (must_serve && capacity_w(curves, commitment) < demand_w * (1.0 - ROUNDING)) {
        return OneStepSolution {
            bound: f64::INFINITY,
            price: guess,
            request_w: vec![0.0; curves.len()],
            shed_w: 0.0,
            order: vec![],
            n_on: 0,
        };
    }
    let steepest = curves.iter().map(StringCost::steepest).fold(0.0, f64::max).max(f64::MIN_POSITIVE);
    let mut open = Vec::with_capacity(curves.len());
    let mut at = |price: f64| at_price(curves, commitment, demand_w, price, &mut open, |_, _, _| ());
    let (mut price, mut step) = (guess, 0.1 * steepest);
    // The nearest points whose totals are below the demand, and at or above it.
    let mut sides: [Option<DualPoint>; 2] = [None; 2];
    for used in 1..=MAX_PRICES {
        let point = at(price);
        let is_low = point.total_w < demand_w * (1.0 - ROUNDING);
        sides[usize::from(!is_low)] = Some(point);
        let [Some(low), Some(high)] = sides else {
            price += if is_low { step } else { -step };
            step *= 2.0;
            continue;
        };
        let (miss_low, miss_high) = (demand_w - low.total_w, high.total_w - demand_w);
        if miss_high <= 0.0 {
            break;
        }
        let width = high.price - low.price;
        // Supporting lines meet at this price; their value there bounds the optimum of the Lagrangian.
        let meet = (high.bound - low.bound + miss_high * width) / (miss_low + miss_high);
        let best = low.bound.max(high.bound);
        if low.bound + miss_low * meet - best <= GAP * best.abs() || width <= 1e-15 * steepest {
            break;
        }
        let secant = miss_low / (miss_low + miss_high) * width;
        let share = if used % 2 == 0 { meet } else { secant };
        price = low.price + if share > 0.0 && share < width { share } else { 0.5 * width };
    }
    let [low, high] =
        [sides[0].or(sides[1]), sides[1].or(sides[0])].map(|side| side.expect("one price was tried"));
    combine(curves, commitment, demand_w, low, high)
}

/// The better bound, and the convex combination of both requests that meets the demand.
fn combine(
    curves: &[impl StringCost],
    commitment: &Commitment,
    demand_w: f64,
    low: DualPoint,
    high: DualPoint,
) -> OneStepSolution {
    let gap = high.total_w - low.total_w;
    let share = if gap > 0.0 { ((demand_w - low.total_w) / gap).clamp(0.0, 1.0) } else { 0.0 };
    let best = if high.bound > low.bound { high } else { low };
    let (mut request_w, mut order, mut n_on) = (vec![0.0; curves.len()], vec![], 0);
    let mut open = Vec::with_capacity(curves.len());
    for (point, weight) in [(low, 1.0 - share), (high, share)] {
        let mut n_on_here = 0;
        at_price(curves, commitment, demand_w, point.price, &mut open, |m, on, response| {
            request_w[m] += weight * response.request_w;
            n_on_here += usize::from(on && commitment.modes[m] == InverterMode::Free);
        });
        if point.price == best.price {
            (order, n_on) = (open.iter().map(|(m, _, _)| *m).collect(), n_on_here);
        }
    }
    let shed_w = low.shed_w + share * (high.shed_w - low.shed_w);
    OneStepSolution { bound: best.bound, price: best.price, request_w, shed_w, order, n_on }
}

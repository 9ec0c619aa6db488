//! Lower bounds of the one-step problem: one price of the demand for all strings.

use crate::one_step_curve::CostCurve;

const MAX_PRICES: usize = 80;
const GAP: f64 = 1e-12;

/// Whether a string's inverter runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Mode {
    Free,
    On,
    Off,
}

/// Some strings fixed, and of all strings exactly `count` on, if given.
#[derive(Debug, Clone)]
pub(crate) struct Choice {
    pub modes: Vec<Mode>,
    pub count: Option<usize>,
}

impl Choice {
    pub fn free_to_switch_on(&self) -> Option<usize> {
        let on = self.modes.iter().filter(|m| **m == Mode::On).count();
        self.count.map(|count| count.saturating_sub(on))
    }
}

/// The Lagrangian at one price.
#[derive(Debug, Clone, Default)]
struct AtPrice {
    price: f64,
    /// Lower bound of the one-step optimum.
    bound: f64,
    total_w: f64,
    request_w: Vec<f64>,
    shed_w: f64,
    /// Free strings, most eager to be on first; the first `n_on` of them are on.
    order: Vec<usize>,
    n_on: usize,
}

/// Best Lagrangian bound, with the requests that go with it.
#[derive(Debug, Clone)]
pub(crate) struct Dual {
    pub bound: f64,
    pub price: f64,
    /// Sums to the demand; optimal if the modes are fixed and the curves convex [W].
    pub request_w: Vec<f64>,
    pub shed_w: f64,
    /// Free strings, most eager to be on first.
    pub order: Vec<usize>,
    /// So many of them are on.
    pub n_on: usize,
}

fn at_price(curves: &[CostCurve], choice: &Choice, demand_w: f64, price: f64) -> AtPrice {
    let mut out = AtPrice { price, request_w: vec![0.0; curves.len()], ..AtPrice::default() };
    let mut free = Vec::new();
    let mut value = 0.0;
    for (m, (curve, mode)) in curves.iter().zip(&choice.modes).enumerate() {
        let response = match mode {
            Mode::On => curve.on(price),
            Mode::Off => curve.off(price),
            Mode::Free => {
                free.push((m, curve.on(price), curve.off(price)));
                continue;
            }
        };
        value += response.value;
        out.request_w[m] = response.request_w;
        out.shed_w += response.shed_w;
    }
    free.sort_by(|a, b| (a.1.value - a.2.value).total_cmp(&(b.1.value - b.2.value)));
    out.n_on = choice
        .free_to_switch_on()
        .unwrap_or_else(|| free.iter().take_while(|(_, on, off)| on.value < off.value).count());
    for (rank, (m, on, off)) in free.iter().enumerate() {
        let response = if rank < out.n_on { on } else { off };
        value += response.value;
        out.request_w[*m] = response.request_w;
        out.shed_w += response.shed_w;
        out.order.push(*m);
    }
    out.total_w = out.request_w.iter().sum();
    out.bound = value + price * demand_w;
    out
}

/// Bound at one price only.
pub(crate) fn bound_at(curves: &[CostCurve], choice: &Choice, demand_w: f64, price: f64) -> f64 {
    at_price(curves, choice, demand_w, price).bound
}

/// Largest total request that a choice can take without shedding [W].
fn capacity_w(curves: &[CostCurve], choice: &Choice) -> f64 {
    let mut free = Vec::new();
    let mut total = 0.0;
    for (curve, mode) in curves.iter().zip(&choice.modes) {
        match mode {
            Mode::On => total += curve.largest_request(true),
            Mode::Off => total += curve.largest_request(false),
            Mode::Free => free.push(curve.largest_request(true)),
        }
    }
    free.sort_by(|a, b| b.total_cmp(a));
    // A string that derates everything takes its request also when off; it must not be left out.
    let spare = if curves.iter().any(|c| c.terms.derating.low <= 0.0) { free.len() } else { 0 };
    let n_on = choice.free_to_switch_on().unwrap_or(free.len()).max(spare);
    total + free.iter().take(n_on).sum::<f64>()
}

/// Maximises the Lagrangian over the price: concave, so bracketed by the sign of `demand - total`. Secant steps on
/// the total (exact for quadratic costs) alternate with intersections of supporting lines (exact for kinks). Every
/// price gives a valid bound, so stopping early loses tightness, not validity.
pub(crate) fn maximise(curves: &[CostCurve], choice: &Choice, demand_w: f64, guess: f64) -> Dual {
    let must_serve = curves.iter().all(|c| c.terms.shed_cost.is_infinite());
    let possible = choice
        .free_to_switch_on()
        .map_or(true, |n| n <= choice.modes.iter().filter(|m| **m == Mode::Free).count());
    if !possible || (must_serve && capacity_w(curves, choice) < demand_w * (1.0 - 1e-12)) {
        return Dual {
            bound: f64::INFINITY,
            price: guess,
            request_w: vec![0.0; curves.len()],
            shed_w: 0.0,
            order: vec![],
            n_on: 0,
        };
    }
    let steepest = curves.iter().map(CostCurve::steepest).fold(0.0, f64::max).max(f64::MIN_POSITIVE);
    let at = |price: f64| at_price(curves, choice, demand_w, price);
    let first = at(guess);
    let (mut low, mut high) = (None, None);
    let mut step = 0.1 * steepest;
    let mut price = guess;
    let sort = |point: AtPrice, low: &mut Option<AtPrice>, high: &mut Option<AtPrice>| {
        let side = if point.total_w <= demand_w { low } else { high };
        *side = Some(point);
    };
    sort(first, &mut low, &mut high);
    let mut used = 1;
    while (low.is_none() || high.is_none()) && used < MAX_PRICES {
        price += if high.is_none() { step } else { -step };
        step *= 2.0;
        sort(at(price), &mut low, &mut high);
        used += 1;
    }
    let (mut low, mut high) = match (low, high) {
        (Some(low), Some(high)) => (low, high),
        (Some(only), None) | (None, Some(only)) => return close(only.clone(), only, demand_w),
        (None, None) => unreachable!("one price was tried"),
    };
    while used < MAX_PRICES {
        let (miss_low, miss_high) = (demand_w - low.total_w, high.total_w - demand_w);
        if miss_low <= 0.0 {
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
        let share = if share > 0.0 && share < width { share } else { 0.5 * width };
        let point = at(low.price + share);
        used += 1;
        if point.total_w <= demand_w {
            low = point;
        } else {
            high = point;
        }
    }
    close(low, high, demand_w)
}

/// The better bound, and the mixture of both requests that meets the demand.
fn close(low: AtPrice, high: AtPrice, demand_w: f64) -> Dual {
    let gap = high.total_w - low.total_w;
    let share = if gap > 0.0 { ((demand_w - low.total_w) / gap).clamp(0.0, 1.0) } else { 0.0 };
    let mix = |a: f64, b: f64| a + share * (b - a);
    let request_w = low.request_w.iter().zip(&high.request_w).map(|(a, b)| mix(*a, *b)).collect();
    let shed_w = mix(low.shed_w, high.shed_w);
    let best = if high.bound > low.bound { high } else { low };
    Dual { bound: best.bound, price: best.price, request_w, shed_w, order: best.order, n_on: best.n_on }
}

//! Dual bound: only the power balance couples the strings, and its shadow price in each step decouples them.
//!
//! At any prices, the minimum costs of all strings (one dynamic program each, [`values`]) plus the value of the demand are at most
//! the cost of any schedule (Lagrangian relaxation of the balance). Strings move between nodes of SOC, so their cost to go
//! is not interpolated in SOC, only in temperature ([`grid`]). The bound of the grid is therefore an estimate of the true bound.

mod bundle;
mod grid;
mod values;

use crate::plan::look_ahead::look_ahead;
use crate::plan::problem::PlanProblem;
use bundle::Bundle;
use values::StringValues;

/// Share of the iterations that move prices towards the balancing prices of the look-ahead, which initialises the bundle.
const CLEARING_SHARE: f64 = 0.5;
/// Step of the prices in one of these iterations.
const CLEARING_STEP: f64 = 0.5;

/// Minimum share of the known cost that the bound of a relaxation reaches. If it is lower, undelivered energy is most of the cost.
const RELAXED_SHARE: f64 = 0.5;

pub(crate) struct Dual {
    /// Lower bound of the cost of every schedule, on the grid.
    pub bound: f64,
    /// The cheapest look-ahead schedule with the cost to go of one of the iterations `(M, T)` [W].
    pub request_w: Vec<f64>,
    /// The prices of the bound `(T,)` [cost/Wh].
    pub price: Vec<f64>,
}

/// Prices of the balance `(T,)` [cost/Wh] for a proof of the problem, or of its relaxation.
pub(crate) struct ProofPrices {
    pub price: Vec<f64>,
    pub relaxed: bool,
}

impl ProofPrices {
    /// Prices of the relaxation, starting at `price`; None if undelivered energy is most of the known cost.
    ///
    /// The values of the relaxation have flatter slopes near empty, full and hot, so that the errors of a proof are smaller.
    pub(crate) fn of_relaxation(
        problem: &PlanProblem<'_>,
        price: &[f64],
        known_cost: f64,
        passes: usize,
    ) -> Option<Self> {
        let relaxed = problem.relaxed();
        let start = price.iter().enumerate().map(|(t, price)| price.min(relaxed.shed_price(t))).collect();
        let dual = ascend(&relaxed, start, known_cost, passes);
        (dual.bound >= RELAXED_SHARE * known_cost).then_some(Self { price: dual.price, relaxed: true })
    }
}

/// Bound of the cost of every schedule at prices `(T,)` [cost/Wh].
pub(crate) fn at_prices(problem: &PlanProblem<'_>, price: &[f64]) -> f64 {
    let mut values = StringValues::new(problem);
    values.solve(price);
    values.bound(price)
}

/// Raises the bound in `passes` iterations, from `price` `(T,)` [cost/Wh], towards the cost of the best known schedule.
pub(crate) fn ascend(problem: &PlanProblem<'_>, mut price: Vec<f64>, known_cost: f64, passes: usize) -> Dual {
    let mut values = StringValues::new(problem);
    let (mut request_w, mut cost) = (vec![], f64::INFINITY);
    let mut bundle = Bundle::default();
    let clearing = (CLEARING_SHARE * passes as f64).ceil() as usize;
    for pass in 0..passes {
        values.solve(&price);
        let (rolled, clearing_price) = look_ahead(problem, &values);
        if rolled.cost() < cost {
            (cost, request_w) = (rolled.cost(), rolled.request_w());
        }
        // At the price of undelivered energy, a missing power may be shed: it does not raise the price.
        let open_energy =
            |(t, power): (usize, f64)| if price[t] < problem.shed_price(t) { power } else { power.min(0.0) };
        let slope = values.slope().into_iter().enumerate().map(open_energy).collect();
        bundle.add(price.clone(), values.bound(&price), slope);
        if pass < clearing {
            let towards = |(p, clear): (&mut f64, &f64)| *p += CLEARING_STEP * (clear - *p);
            price.iter_mut().zip(&clearing_price).for_each(towards);
        } else {
            price = bundle.next(known_cost.min(cost));
            price.iter_mut().enumerate().for_each(|(t, price)| *price = price.min(problem.shed_price(t)));
        }
    }
    let (price, bound) = bundle.best();
    Dual { bound, request_w, price }
}

//! Step cuts: lower bounds of the cost of any decision of one step, over boxes of states.

use bess_tables::InputError;

use crate::error::{check_costs, check_length, check_range};
use crate::model::{ControlHorizon, CostsOf, Flow, Losses, StateBox};
use crate::one_step::{solve, CostCurve, OneStepSolution, OperatingTerms, StringCost};
use crate::reach::Node;

/// Safety margin for the rounding of a bound.
const ROUNDING: f64 = 1e-11;
const MAX_SLOPE_ITERATIONS: usize = 12;
/// Relative loss of the bound that is accepted for a smaller slope.
const SLOPE_GAP: f64 = 1e-7;
/// Relative margin of slopes above the required value, so that few iterations are needed.
const SLOPE_MARGIN: f64 = 1e-2;
/// Highest slope, in units of the steepest marginal cost.
const MAX_SLOPE: f64 = 2e3;

/// `sum_m cost + slope * sum_m shed >= phi` for every decision of a step.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StepBound {
    /// Lower bound of the cost of derating, inverter and battery.
    pub phi: f64,
    /// Maximum saving per watt of availability loss [1/W].
    pub shed_slope: f64,
}

/// Step cuts of a horizon.
#[derive(Debug, Clone)]
pub struct StepBounds {
    /// One for each step.
    pub bounds: Vec<StepBound>,
    /// Optimal requests of every single step without availability loss, `(M, T)` [W].
    pub request_w: Vec<f64>,
}

impl ControlHorizon {
    /// Step cuts of one objective, `(T,)`, over boxes of the states at the start of each step, `(M, T)`. `costs` are
    /// those of the losses, `(M,)`; a cut does not include the cost of availability loss.
    ///
    /// Any decision splits the request into delivered, derated and shed power, so the minimum of `cost + slope * shed`
    /// over all such splits, with `k` and `V^2 / R` anywhere in their ranges, is a bound for every slope. The slope
    /// returned gives the best bound if at most `budget_w` `(T,)` is shed: without a limit, the smallest slope at which the optimum
    /// sheds nothing; if nothing may be shed, zero.
    ///
    /// # Errors
    ///
    /// Lengths do not agree, or a cost or a budget is negative or not a number.
    pub fn step_bounds(
        &self,
        boxes: &[StateBox],
        costs: &[Losses],
        budget_w: &[f64],
    ) -> Result<StepBounds, InputError> {
        check_length("boxes", boxes, self.size())?;
        self.check_cuts(costs, budget_w)?;
        let power_limits =
            |m: usize, t: usize| (self.limit(m, t), self.string(m).nominal_w(), self.string(m).min_power_w());
        Ok(self.step_bounds_within(boxes, costs, budget_w, power_limits))
    }

    /// Step cuts of one objective over a tightened node, like [`Self::step_bounds`].
    ///
    /// # Errors
    ///
    /// As [`Self::step_bounds`].
    pub fn step_bounds_of(
        &self,
        of: &Node,
        costs: &[Losses],
        budget_w: &[f64],
    ) -> Result<StepBounds, InputError> {
        self.check_cuts(costs, budget_w)?;
        let n_steps = self.n_steps();
        let boxes: Vec<StateBox> =
            of.boxes.chunks_exact(n_steps + 1).flat_map(|row| row[..n_steps].to_vec()).collect();
        let power_limits = |m: usize, t: usize| {
            let i = m * n_steps + t;
            let max_w = of.requests_w[i].high.max(0.0);
            (max_w, of.cells[i].delivered_w.high.max(0.0), self.string(m).min_power_w())
        };
        Ok(self.step_bounds_within(&boxes, costs, budget_w, power_limits))
    }

    fn check_cuts(&self, costs: &[Losses], budget_w: &[f64]) -> Result<(), InputError> {
        check_costs(costs, self.n_strings())?;
        check_length("budget", budget_w, self.n_steps())?;
        check_range("budget", budget_w, (0.0, f64::INFINITY), " W")
    }

    /// Step cuts at the states along a schedule. As in the search, derated strings shed nothing below their limits.
    pub(crate) fn step_bounds_along(&self, flows: &[Flow], costs: &[Losses], budget_w: &[f64]) -> StepBounds {
        let n_steps = self.n_steps();
        let state = |i: usize| if i % n_steps == 0 { self.start[i / n_steps] } else { flows[i - 1].end };
        let states: Vec<StateBox> = (0..flows.len()).map(|i| state(i).into()).collect();
        let power_limits = |m: usize, t: usize| (self.limit(m, t), self.string(m).nominal_w(), 0.0);
        self.step_bounds_within(&states, costs, budget_w, power_limits)
    }

    /// Optimal requests of every single step along a schedule, without availability loss, with a lower bound of the cost, for
    /// each group in search costs.
    pub(crate) fn one_step_optima(&self, flows: &[Flow]) -> Vec<StepBounds> {
        let nothing = vec![0.0; self.n_steps()];
        let optimum =
            |group| self.step_bounds_along(flows, &self.group_costs(group, CostsOf::Search), &nothing);
        (0..self.n_groups()).map(optimum).collect()
    }

    /// Costs of the strings over their requests in a step, if nothing may be shed: over a box of the states of each, where
    /// `power_limits(m)` is the maximum request, and the maximum and minimum delivered power.
    pub(crate) fn curves(
        &self,
        t: usize,
        states: impl Fn(usize) -> StateBox,
        costs: &[Losses],
        power_limits: impl Fn(usize) -> (f64, f64, f64),
    ) -> Vec<CostCurve> {
        let direction = self.direction(t);
        let curve = |m: usize| {
            let string = self.string(m);
            let ranges = string.ranges(direction, &states(m));
            let (limit_w, deliverable_w, min_power_w) = power_limits(m);
            let terms = OperatingTerms {
                direction,
                limit_w,
                deliverable_w,
                min_power_w,
                derating: ranges.derating,
                power_scale_w: ranges.power_scale_w,
                scale_price: 0.0,
                power_price: 0.0,
                costs: costs[m],
                shed_cost: f64::INFINITY,
            };
            CostCurve::new(string.loss(direction), terms)
        };
        (0..self.n_strings()).map(curve).collect()
    }

    /// Step cuts; `power_limits(m, t)` as in [`Self::curves`].
    fn step_bounds_within(
        &self,
        boxes: &[StateBox],
        costs: &[Losses],
        budget_w: &[f64],
        power_limits: impl Fn(usize, usize) -> (f64, f64, f64) + Sync,
    ) -> StepBounds {
        let (n_strings, n_steps) = (self.n_strings(), self.n_steps());
        let no_losses = !costs.iter().any(Losses::any_while_running);
        let mut out = StepBounds {
            bounds: vec![StepBound::default(); n_steps],
            request_w: vec![0.0; n_strings * n_steps],
        };
        let of_step = |t: usize| {
            let mut curves = self.curves(t, |m| boxes[m * n_steps + t], costs, |m| power_limits(m, t));
            step_bound(&mut curves, self.demand_w[t], budget_w[t])
        };
        let asked: Vec<usize> = (0..n_steps).filter(|&t| self.demand_w[t] > 0.0 && !no_losses).collect();
        for (&t, (bound, solution)) in asked.iter().zip(self.map(asked.clone(), of_step)) {
            out.bounds[t] = bound;
            for (m, request) in solution.request_w.into_iter().enumerate() {
                out.request_w[m * n_steps + t] = request;
            }
        }
        out
    }
}

/// Minimum over `a` of the sum over the steps of `max(phi - shed_slope a, 0) + shed_cost a`, with `a <= max_w` in each step and
/// `sum a <= budget_w`: bound of a horizon from step cuts alone. Steps shed in the order of their slopes, each until its cut
/// is zero.
pub(crate) fn min_cost(bounds: &[StepBound], shed_cost: f64, max_w: &[f64], budget_w: f64) -> f64 {
    let mut order: Vec<usize> = (0..bounds.len()).collect();
    order.sort_by(|&a, &b| bounds[b].shed_slope.total_cmp(&bounds[a].shed_slope));
    let (mut left_w, mut cost) = (budget_w, 0.0);
    for t in order {
        let StepBound { phi, shed_slope } = bounds[t];
        let saved = (shed_slope - shed_cost).max(0.0);
        let used_up_w = if saved > 0.0 { phi / shed_slope } else { 0.0 };
        let shed_w = used_up_w.min(max_w[t]).min(left_w);
        cost += phi - saved * shed_w;
        left_w -= shed_w;
    }
    cost
}

/// Minimum cost per watt of availability loss.
pub(crate) fn cheapest_shed(costs: &[Losses]) -> f64 {
    costs.iter().map(|c| c.availability).fold(f64::INFINITY, f64::min)
}

/// Step cut of curves with infinite shed cost, which is set to the slope of the cut; and the solution without shedding. With a
/// small budget, a slope at which the optimum sheds may be better than the steeper one at which it does not; with a budget of
/// zero the slope is zero.
pub(crate) fn step_bound(
    curves: &mut [CostCurve],
    demand_w: f64,
    budget_w: f64,
) -> (StepBound, OneStepSolution) {
    let solution = solve(curves, demand_w);
    let unshed = solution.bound;
    if budget_w == 0.0 {
        // Infinite if the demand cannot be met; then there is no cut.
        let phi = if unshed.is_finite() { unshed - ROUNDING * unshed.abs() } else { 0.0 };
        return (StepBound { phi, shed_slope: 0.0 }, solution);
    }
    let steepest = curves.iter().map(CostCurve::steepest).fold(0.0, f64::max);
    // Cost that shedding cannot save: the price of `V^2 / R`.
    let idle: f64 = curves.iter().map(|c| c.terms.scale_price * c.terms.power_scale_w.low).sum();
    let saved = if unshed.is_finite() { (unshed - idle) / demand_w } else { 2.0 * steepest };
    // A demand just above the limit of fewer strings would need an unlimited slope, because shedding saves a no-load loss.
    let highest = MAX_SLOPE * steepest.max(saved);
    let mut slope = curves.iter().map(|c| c.terms.costs.derating).fold(0.0, f64::max);
    // Shedding the whole demand saves all cost: no smaller slope is valid.
    slope = slope.max(saved);
    let mut best = StepBound::default();
    // A vanishing demand has no slope.
    let tries = if highest.is_finite() { MAX_SLOPE_ITERATIONS } else { 0 };
    let max_w = if budget_w < demand_w { budget_w } else { 0.0 };
    let value_at_budget = |bound: &StepBound| bound.phi - bound.shed_slope * max_w;
    for attempt in 0..tries {
        for curve in curves.iter_mut() {
            curve.terms.shed_cost = slope;
        }
        let relaxed = solve(curves, demand_w);
        let phi = relaxed.bound;
        let bound = StepBound { phi: phi - ROUNDING * phi.abs(), shed_slope: slope };
        if attempt == 0 || value_at_budget(&bound) > value_at_budget(&best) {
            best = bound;
        }
        let shortfall = unshed - phi;
        if shortfall <= SLOPE_GAP * phi.abs()
            || relaxed.shed_w <= 0.0
            || slope >= highest
            || shortfall.is_infinite()
        {
            break;
        }
        // Dinkelbach: the slope at which the availability loss of this solution no longer pays.
        slope = ((slope + shortfall / relaxed.shed_w) * (1.0 + SLOPE_MARGIN)).min(highest);
    }
    for curve in curves.iter_mut() {
        curve.terms.shed_cost = best.shed_slope;
    }
    (best, solution)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cuts(phi: [f64; 3], shed_slope: [f64; 3]) -> Vec<StepBound> {
        phi.iter().zip(shed_slope).map(|(&phi, shed_slope)| StepBound { phi, shed_slope }).collect()
    }

    /// Minimum over a grid of the shed power in each step.
    fn least_on_a_grid(cuts: &[StepBound], price: f64, max_w: [f64; 3], budget_w: f64) -> f64 {
        let shares = || (0..=40).map(|i| f64::from(i) / 40.0);
        let mut least = f64::INFINITY;
        for a in shares() {
            for b in shares() {
                for c in shares() {
                    let shed = [a * max_w[0], b * max_w[1], c * max_w[2]];
                    if shed.iter().sum::<f64>() <= budget_w {
                        let cost = |(cut, shed): (&StepBound, &f64)| {
                            (cut.phi - cut.shed_slope * shed).max(0.0) + price * shed
                        };
                        least = least.min(cuts.iter().zip(&shed).map(cost).sum());
                    }
                }
            }
        }
        least
    }

    #[test]
    fn the_minimum_cost_is_the_minimum_over_a_grid_of_shed_power() {
        let mut random = fastrand::Rng::with_seed(3);
        for round in 0..12 {
            let mut three = |low: f64, high: f64| [0; 3].map(|_| low + (high - low) * random.f64());
            let (phi, slope, max_w) = (three(0.0, 2.0), three(0.1, 3.0), three(0.0, 1.0));
            let (price, budget_w) = (if round % 2 == 0 { 0.0 } else { 0.7 }, three(0.0, 2.0)[0]);
            let cuts = cuts(phi, slope);
            let least = min_cost(&cuts, price, &max_w, budget_w);
            let on_grid = least_on_a_grid(&cuts, price, max_w, budget_w);
            assert!(least <= on_grid + 1e-12);
            let spacing = max_w.iter().zip(slope).map(|(max_w, slope)| max_w * slope / 40.0).sum::<f64>();
            assert!(least >= on_grid - 2.0 * spacing, "{least} against {on_grid}");
        }
    }

    #[test]
    fn without_shedding_the_cuts_add_up() {
        let least = min_cost(&cuts([1.0, 2.0, 4.0], [5.0, 7.0, 9.0]), 0.0, &[0.0; 3], f64::INFINITY);
        assert_eq!(least, 7.0);
    }
}

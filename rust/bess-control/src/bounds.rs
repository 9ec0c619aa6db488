//! Step cuts: lower bounds of what any decision of one step costs, over boxes of states.

use crate::horizon::ControlHorizon;
use crate::one_step::solve;
use crate::one_step_curve::{CostCurve, Terms};
use crate::planes::Planes;
use crate::ranges::{CoefficientRanges, StateBox};

/// Safety for the rounding in a bound.
const ROUNDING: f64 = 1e-11;
const MAX_SLOPES: usize = 12;
/// Share of the bound that is given up for a smaller slope.
const GAP_OF_SLOPE: f64 = 1e-7;
/// Slopes are this much steeper than they would have to be, so that few are tried.
const MARGIN_OF_SLOPE: f64 = 1e-2;
/// Highest slope, in units of the steepest marginal cost.
const HIGHEST_SLOPE: f64 = 2e3;

/// `sum_m cost + slope * sum_m shed >= phi` for every decision of a step.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StepBound {
    /// Lower bound of the cost of derating, inverter and battery.
    pub phi: f64,
    /// What each shed watt may save [1/W].
    pub shed_slope: f64,
}

impl ControlHorizon {
    /// Ranges of the coefficients over boxes of states `(M, T)`, each in the direction of its step.
    pub fn ranges(&self, boxes: &[StateBox]) -> Vec<CoefficientRanges> {
        let n_steps = self.n_steps();
        let at = |(i, states)| self.string(i / n_steps).ranges(self.direction(i % n_steps), states);
        boxes.iter().enumerate().map(at).collect()
    }

    /// Planes over boxes of states `(M, T)`, each in the direction of its step.
    pub fn planes(&self, boxes: &[StateBox]) -> Vec<Planes> {
        let n_steps = self.n_steps();
        let at = |(i, states)| self.string(i / n_steps).planes(self.direction(i % n_steps), states);
        boxes.iter().enumerate().map(at).collect()
    }

    /// Step cuts for all groups, `(G, T)`, over boxes of the states at the start of each step, `(M, T)`.
    ///
    /// Any decision splits the request into delivered, derated and shed power, so the least of
    /// `cost + slope * shed` over all such splits, with `k` anywhere in its range and `V^2 / R` at its upper end, is a
    /// bound for every slope. The slope returned is the smallest at which nothing is shed.
    pub fn step_bounds(&self, boxes: &[StateBox]) -> Vec<StepBound> {
        let mut out = vec![StepBound::default(); self.n_groups() * self.n_steps()];
        for t in 0..self.n_steps() {
            if self.demand_w[t] <= 0.0 {
                continue;
            }
            let direction = self.direction(t);
            let ranges: Vec<_> = (0..self.n_strings())
                .map(|m| self.string(m).ranges(direction, &boxes[m * self.n_steps() + t]))
                .collect();
            for g in 0..self.n_groups() {
                let terms = (0..self.n_strings()).map(|m| Terms {
                    direction,
                    limit_w: self.limit(m, t),
                    deliverable_w: self.string(m).nominal_w(),
                    derating: ranges[m].derating,
                    power_scale_w: ranges[m].power_scale_w.high,
                    costs: self.costs_of(m)[g],
                    shed_cost: f64::INFINITY,
                });
                let curves: Vec<_> = terms
                    .enumerate()
                    .map(|(m, terms)| CostCurve::new(self.string(m).loss(direction), terms))
                    .collect();
                if curves.iter().any(|c| c.terms.costs[1..].iter().any(|&c| c > 0.0)) {
                    out[g * self.n_steps() + t] = step_bound(curves, self.demand_w[t]);
                }
            }
        }
        out
    }
}

fn step_bound(mut curves: Vec<CostCurve>, demand_w: f64) -> StepBound {
    let nothing_shed = solve(&curves, demand_w).bound;
    let steepest = curves.iter().map(CostCurve::steepest).fold(0.0, f64::max);
    // A demand just above what fewer strings can take would need a slope without end: it saves a no-load loss.
    let highest =
        HIGHEST_SLOPE * steepest.max(if nothing_shed.is_finite() { nothing_shed / demand_w } else { 0.0 });
    if !highest.is_finite() {
        // A demand of next to nothing.
        return StepBound::default();
    }
    let mut slope = curves.iter().map(|c| c.terms.costs[1]).fold(0.0, f64::max);
    // Shedding everything saves all: no smaller slope will do.
    slope = slope.max(if nothing_shed.is_finite() { nothing_shed / demand_w } else { 2.0 * steepest });
    for _ in 0..MAX_SLOPES {
        for curve in &mut curves {
            curve.terms.shed_cost = slope;
        }
        let answer = solve(&curves, demand_w);
        let phi = answer.bound;
        let missing = nothing_shed - phi;
        if missing <= GAP_OF_SLOPE * phi.abs()
            || answer.shed_w <= 0.0
            || slope >= highest
            || missing.is_infinite()
        {
            return StepBound { phi: phi - ROUNDING * phi.abs(), shed_slope: slope };
        }
        // Dinkelbach: the slope at which what this answer sheds no longer pays.
        slope = ((slope + missing / answer.shed_w) * (1.0 + MARGIN_OF_SLOPE)).min(highest);
    }
    for curve in &mut curves {
        curve.terms.shed_cost = slope;
    }
    let phi = solve(&curves, demand_w).bound;
    StepBound { phi: phi - ROUNDING * phi.abs(), shed_slope: slope }
}

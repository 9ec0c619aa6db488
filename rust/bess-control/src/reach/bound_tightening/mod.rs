//! Lower bounds of a horizon, and the reachable states of schedules that cost no more than a known one.
//!
//! One-step problems bound a horizon if their coefficients have the most favourable reachable values. Two
//! methods tighten this bound. The first is a value of the state: a step pays for a high `V^2 / R`, and earlier steps are
//! paid for the charge and the temperature that raise it, so that every gain has a cost in another step. The second is
//! the cutoff: a schedule that costs no more than a known one exceeds the bound by no more than the slack between the
//! two, so the charge of a string cannot deviate far from its optimum; this is a knapsack, bounded by rewarding the
//! deviation of the string. Tighter boxes give a higher bound, and the procedure is repeated.

mod horizon_bound;
mod tightening;

use bess_tables::InputError;

use crate::error::{check_costs, check_range};
use crate::model::{ControlHorizon, Flow, Losses, StateBox, StringState};
use crate::reach::step_bounds::cheapest_shed;
use horizon_bound::{HorizonBound, OperatingRanges};
use tightening::Tightening;

/// Maximum number of rounds of bounding and tightening.
const ROUNDS: usize = 8;
/// If more than this share of the slack remains after a round, the iteration ends.
const MAX_REMAINING_SLACK: f64 = 0.75;
/// A slack below this share of the cost is small enough.
const MIN_RELATIVE_SLACK: f64 = 2e-4;
/// Safety margin for rounding, relative to the cost.
const ROUNDING: f64 = 1e-9;

/// Bounds of every schedule that costs no more than a given one.
#[derive(Debug, Clone)]
pub struct TightenedBounds {
    /// Lower bound of the cost.
    pub bound: f64,
    /// States at the start of each step and at the end of the last, `(M, T + 1)`.
    pub boxes: Vec<StateBox>,
}

/// The reference schedule: its cost, the states at the start of its steps `(M, T)`, and the decrease of its cost with `V^2 / R`
/// there, `-dh/dy = s^2 / (1 +- 2 s)` with `s = R I / V`.
struct ReferenceSchedule {
    cost: f64,
    states: Vec<StringState>,
    scale_price: Vec<f64>,
}

impl ControlHorizon {
    /// Bounds the cost of every schedule without requests below the minimum power, and the states of such schedules that cost
    /// no more than `request_w` `(M, T)`, with a total availability loss of at most `shed_budget_w`. `costs` `(M,)` [1/W] are
    /// those of the losses.
    ///
    /// # Errors
    ///
    /// The number of costs differs from the number of strings, or a cost or the budget is negative or not a number.
    pub fn tighten(
        &self,
        request_w: &[f64],
        costs: &[Losses],
        shed_budget_w: f64,
    ) -> Result<TightenedBounds, InputError> {
        check_costs(costs, self.n_strings())?;
        check_range("shed_budget", &[shed_budget_w], (0.0, f64::INFINITY), " W")?;
        Ok(self.tightened(&self.flows(request_w), costs, shed_budget_w))
    }

    /// [`Self::tighten`] without checks, of a schedule that was rolled out.
    pub(crate) fn tightened(&self, flows: &[Flow], costs: &[Losses], shed_budget_w: f64) -> TightenedBounds {
        let mut best = TightenedBounds { bound: 0.0, boxes: self.reachable() };
        if !costs.iter().any(Losses::any_while_running) {
            // Only availability loss has a cost: all states have the same value.
            return best;
        }
        let reference = self.reference(flows, costs);
        let cutoff = reference.cost;
        let cheapest_shed = cheapest_shed(costs);
        let no_prices = vec![0.0; flows.len()];
        let (mut last, mut priced) = (f64::INFINITY, reference.scale_price == no_prices);
        for _ in 0..ROUNDS {
            let operating = OperatingRanges::new(self, &best.boxes, &reference.states);
            let bounded = |scale_price: &[f64]| {
                let horizon_bound = HorizonBound::new(&operating, costs, scale_price, shed_budget_w);
                (horizon_bound.bound - horizon_bound.max_saving(shed_budget_w, cheapest_shed), horizon_bound)
            };
            // Over wide boxes the planes may be so high that the values of the state loosen the bound.
            let mut held = bounded(&reference.scale_price);
            if !priced {
                let without = bounded(&no_prices);
                priced = held.0 >= without.0;
                if !priced {
                    held = without;
                }
            }
            let (bound, horizon_bound) = held;
            best.bound = best.bound.max(bound - ROUNDING * cutoff).min(cutoff);
            let slack = cutoff - bound + ROUNDING * cutoff;
            if slack <= MIN_RELATIVE_SLACK * cutoff || slack > MAX_REMAINING_SLACK * last {
                break;
            }
            last = slack;
            let Some(boxes) = Tightening::new(&horizon_bound, slack).tightened() else {
                best.bound = cutoff;
                break;
            };
            best.boxes = boxes;
        }
        best
    }

    /// Reference data of a rolled-out schedule.
    fn reference(&self, flows: &[Flow], costs: &[Losses]) -> ReferenceSchedule {
        let n_steps = self.n_steps();
        let mut reference = ReferenceSchedule { cost: 0.0, states: vec![], scale_price: vec![] };
        for (i, flow) in flows.iter().enumerate() {
            let (m, t) = (i / n_steps, i % n_steps);
            let state = if t == 0 { self.start[m] } else { flows[i - 1].end };
            let c = self.string(m).coefficients(self.direction(t), state);
            reference.cost += flow.losses().cost(&costs[m]);
            let share = (flow.current_a * c.resistance_ohm / c.voltage_v).max(0.0);
            let price =
                costs[m].battery * share * share / (1.0 - 2.0 * self.direction(t).sign() * share).max(0.1);
            reference.scale_price.push(price);
            reference.states.push(state);
        }
        reference
    }
}

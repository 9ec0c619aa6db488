//! Lower bounds of every group around the incumbent: for all schedules, and for the convexified program
//! with coefficients frozen along the incumbent.

use super::bound_tightening::TightenedBounds;
use super::step_bounds::{cheapest_shed, min_cost, StepBounds};
use crate::model::{ControlHorizon, CostsOf, Flow, Losses, StateBox};

/// Bounds of one group, with earlier groups limited by their ceilings.
#[derive(Debug, Clone)]
pub struct GroupBounds {
    /// Objective of the schedule, in reported costs.
    pub objective: f64,
    /// Ceiling of this objective while later groups are minimised.
    pub ceiling: f64,
    /// Lower bound of the nonlinear control model.
    pub bound: f64,
    /// Objective of the schedule, in search costs.
    pub search_objective: f64,
    /// Ceiling of the search objective.
    pub search_ceiling: f64,
    /// Lower bound of the convexified program, whose coefficients are frozen along the schedule.
    pub search_bound: f64,
    /// Whether `search_bound` is the optimum of the convexified program.
    pub is_search_optimum: bool,
    /// States of the schedules with at most this cost, at the start of each step and at the end of the last, `(M, T + 1)`; empty
    /// if not required for the bound.
    pub boxes: Vec<StateBox>,
}

/// Rigorous bounds around a schedule, group by group up to the first that leaves more than the requested gap.
#[derive(Debug, Clone)]
pub(crate) struct Proof {
    request_w: Vec<f64>,
    /// None for a group at zero.
    groups: Vec<Option<TightenedBounds>>,
    /// Whether no schedule improves any group by more than the gap.
    pub is_complete: bool,
}

impl ControlHorizon {
    /// Bounds of every group around a rolled-out schedule `(M, T)` (magnitudes), with the one-step optima at its
    /// states, or no optima if there is nothing to decide. A `proof` of the same schedule has some of them.
    pub(crate) fn bounds(
        &self,
        request_w: &[f64],
        flows: &[Flow],
        optima: &[StepBounds],
        proof: Option<Proof>,
    ) -> Vec<GroupBounds> {
        let mut proof = proof.filter(|proof| proof.request_w == request_w);
        let (objectives, searched) = (self.report_objectives(flows), self.objectives(request_w));
        let mut budgets_w = [f64::INFINITY; 2];
        let mut out = Vec::with_capacity(self.n_groups());
        for group in 0..self.n_groups() {
            let values = [objectives[group], searched[group]];
            let costs = [CostsOf::Report, CostsOf::Search].map(|of| self.group_costs(group, of));
            let mut bounds = GroupBounds {
                objective: values[0],
                ceiling: self.ceiling(group, values[0]),
                bound: values[0],
                search_objective: values[1],
                search_ceiling: self.ceiling(group, values[1]),
                search_bound: values[1],
                is_search_optimum: true,
                boxes: vec![],
            };
            // Losses are non-negative, so a group at zero is optimal.
            if !optima.is_empty() && values != [0.0; 2] {
                let proven = proof.as_mut().and_then(|proof| proof.groups.get_mut(group)?.take());
                let tightened = proven.unwrap_or_else(|| self.tightened(flows, &costs[0], budgets_w[0]));
                self.freeze(
                    &mut bounds,
                    &self.may_shed(&tightened.boxes),
                    flows,
                    &optima[group],
                    &costs[1],
                    budgets_w[1],
                );
                (bounds.bound, bounds.boxes) = (tightened.bound, tightened.boxes);
            }
            let ceilings = [bounds.ceiling, bounds.search_ceiling];
            out.push(bounds);
            for ((budget_w, costs), ceiling) in budgets_w.iter_mut().zip(&costs).zip(ceilings) {
                *budget_w = within_ceiling(*budget_w, ceiling, costs);
            }
        }
        out
    }

    /// Tries to prove that no schedule improves a group of `request_w` `(M, T)` by more than a relative `gap`.
    pub(crate) fn proof(&self, request_w: Vec<f64>, gap: f64) -> Proof {
        let flows = self.flows(&request_w);
        let values = self.report_objectives(&flows);
        let (mut groups, mut budget_w) = (vec![], f64::INFINITY);
        let is_complete = (0..self.n_groups()).all(|group| {
            let (value, costs) = (values[group], self.group_costs(group, CostsOf::Report));
            let tightened = (value != 0.0).then(|| self.tightened(&flows, &costs, budget_w));
            let is_proven = tightened.as_ref().is_none_or(|bounds| bounds.bound >= (1.0 - gap) * value);
            groups.push(tightened);
            budget_w = within_ceiling(budget_w, self.ceiling(group, value), &costs);
            is_proven
        });
        Proof { request_w, groups, is_complete }
    }

    /// The bound of the convexified program from its one-step problems; `may_shed` `(M, T)` marks steps in which a schedule of
    /// at most this cost may have availability loss.
    fn freeze(
        &self,
        bounds: &mut GroupBounds,
        may_shed: &[bool],
        flows: &[Flow],
        optimum: &StepBounds,
        costs: &[Losses],
        budget_w: f64,
    ) {
        let n_steps = self.n_steps();
        let sheds = |t: usize| (0..self.n_strings()).any(|m| may_shed[m * n_steps + t]);
        if (0..n_steps).any(sheds) {
            let max_w: Vec<f64> =
                (0..n_steps).map(|t| if sheds(t) { self.demand_w[t] } else { 0.0 }).collect();
            let budgets_w: Vec<f64> = max_w.iter().map(|most| most.min(budget_w)).collect();
            let steps = self.step_bounds_along(flows, costs, &budgets_w);
            bounds.search_bound = min_cost(&steps.bounds, cheapest_shed(costs), &max_w, budget_w);
        } else {
            bounds.search_bound = optimum.bounds.iter().map(|step| step.phi).sum();
        }
        // If the one-step optima have no availability loss, they are the optimum of the horizon.
        let request_w = self.fitted(&optimum.request_w);
        bounds.is_search_optimum = self.flows(&request_w).iter().all(|flow| flow.availability_w <= 0.0);
    }
}

/// Largest availability loss within a budget and the ceiling of a group with these costs.
fn within_ceiling(budget_w: f64, ceiling: f64, costs: &[Losses]) -> f64 {
    let cheapest = cheapest_shed(costs);
    if cheapest > 0.0 {
        budget_w.min(ceiling / cheapest)
    } else {
        budget_w
    }
}

#[cfg(test)]
mod tests {
    use crate::model::{ControlHorizon, ControlModel, SplitProblem};
    use crate::search::Effort;
    use crate::tests::common;

    /// Charge for two of four steps: the first steps shed nothing at their own optima, the last ones do.
    #[test]
    fn one_step_optima_are_not_optimal_together_if_one_of_them_sheds() {
        const N_STEPS: usize = 4;
        for (soc, is_optimum) in [(0.5, true), (0.15, false)] {
            let costs = [1e-5; 8];
            let problem = SplitProblem {
                soc: &[soc; 2],
                temperature_c: &[25.0; 2],
                demand_w: &[1.6 * common::NOMINAL_W; N_STEPS],
                ambient_c: &[25.0; N_STEPS],
                dt_h: common::DT_H,
                limit_w: &[common::NOMINAL_W; 2 * N_STEPS],
                costs: &costs,
                search_costs: &costs,
                tolerance_abs: &[1e-9],
                tolerance_rel: &[0.0],
            };
            let horizon = ControlHorizon::new(ControlModel::new(&common::reference(2)), &problem).unwrap();
            let split = horizon.split(None, &Effort { rollouts: 300, deadline: None, gap: 1e-3 });
            let sheds = |t: usize| (0..2).any(|m| split.flows[m * N_STEPS + t].availability_w > 0.0);
            assert_eq!((sheds(0), sheds(N_STEPS - 1)), (false, !is_optimum));
            assert_eq!(split.groups[0].is_search_optimum, is_optimum);
        }
    }

    #[test]
    fn a_proof_of_the_schedule_replaces_its_bounds_and_one_of_another_does_not() {
        let horizon = common::horizon(&common::reference(2), 4, 0.5);
        let split = horizon.split(None, &Effort { rollouts: 300, deadline: None, gap: 1e-3 });
        let request_w = split.incumbent.schedule.request_w;
        let optima = horizon.one_step_optima(&split.flows);
        let bounds = |proof| format!("{:?}", horizon.bounds(&request_w, &split.flows, &optima, proof));
        let of = |request_w: Vec<f64>| horizon.proof(request_w, 1.0);
        let (proof, other) = (of(request_w.clone()), of(horizon.fitted(&[1.0; 8])));
        assert!(proof.is_complete && other.is_complete);
        assert_ne!(proof.groups[1].as_ref().unwrap().bound, other.groups[1].as_ref().unwrap().bound);
        assert_eq!(bounds(Some(proof)), bounds(None));
        assert_eq!(bounds(Some(other)), bounds(None));
    }
}

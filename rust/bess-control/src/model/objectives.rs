//! Flows and costs of schedules of a split problem in each group of objectives (docs/equations.md, 1 to 8).

use super::horizon::{ControlHorizon, MAX_GROUPS};
use crate::model::{Flow, Losses, StringState};

/// Objective below which only rounding errors remain.
const NEGLIGIBLE: f64 = 1e-14;

/// Strings whose costs are summed first: a change of two strings then costs two blocks, not all strings.
pub(crate) const BLOCK: usize = 32;

/// Objective of each group; unused entries are 0.
pub type Objectives = [f64; MAX_GROUPS];

/// Selection of the costs of a problem.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CostsOf {
    /// Costs of reported objectives and bounds.
    Report,
    /// Costs of the search, with a small weight for losses of zero cost.
    Search,
}

impl ControlHorizon {
    /// Search costs of one string, for each group.
    #[inline]
    pub(crate) fn costs_of(&self, m: usize) -> &[Losses] {
        &self.search_costs[m * self.n_groups..(m + 1) * self.n_groups]
    }

    /// Costs of every string in one group: reported or search costs.
    pub(crate) fn group_costs(&self, group: usize, costs: CostsOf) -> Vec<Losses> {
        match costs {
            CostsOf::Report => {
                self.report_costs[group * self.n_strings()..(group + 1) * self.n_strings()].to_vec()
            }
            CostsOf::Search => (0..self.n_strings()).map(|m| self.costs_of(m)[group]).collect(),
        }
    }

    /// Adds the costs of a flow of one string.
    #[inline]
    pub(crate) fn add_costs(&self, m: usize, flow: &Flow, costs: &mut Objectives) {
        let losses = flow.losses();
        for (total, c) in costs.iter_mut().zip(self.costs_of(m)) {
            *total += losses.cost(c);
        }
    }

    /// Objectives of a schedule of requests `(M, T)` [W]: each string over time, then over the strings of each block,
    /// then over the blocks ([`BLOCK`]). Every other place that sums costs keeps this order, so that results agree to
    /// the last bit.
    pub fn objectives(&self, request_w: &[f64]) -> Objectives {
        let costs_of = |(m, requests): (usize, &[f64])| {
            let mut costs = [0.0; MAX_GROUPS];
            self.flows_of(m, requests).for_each(|flow| self.add_costs(m, &flow, &mut costs));
            costs
        };
        let costs: Vec<Objectives> =
            request_w.chunks_exact(self.n_steps()).enumerate().map(costs_of).collect();
        total(costs.chunks(BLOCK).map(|block| total(block.iter().copied())))
    }

    /// Objectives of flows `(M, T)`, in reported costs.
    pub fn report_objectives(&self, flows: &[Flow]) -> Objectives {
        let mut totals = [0.0; MAX_GROUPS];
        for (m, row) in flows.chunks_exact(self.n_steps()).enumerate() {
            for flow in row {
                for (g, total) in totals[..self.n_groups].iter_mut().enumerate() {
                    *total += flow.losses().cost(&self.report_costs[g * self.n_strings() + m]);
                }
            }
        }
        totals
    }

    /// Ceiling of a group while later groups are minimised,
    /// `F* + max(eps_abs, eps_rel |F*|)`; a group with `F* = 0` stays at 0.
    pub(crate) fn ceiling(&self, group: usize, best: f64) -> f64 {
        if best <= NEGLIGIBLE {
            NEGLIGIBLE
        } else {
            best + self.tolerance_abs[group].max(self.tolerance_rel[group] * best)
        }
    }

    /// Flows of all strings in all steps of a schedule, `(M, T)`.
    pub fn flows(&self, request_w: &[f64]) -> Vec<Flow> {
        let rows = request_w.chunks_exact(self.n_steps()).enumerate();
        rows.flat_map(|(m, requests)| self.flows_of(m, requests)).collect()
    }

    /// Flows of one string with these requests `(T,)` [W].
    fn flows_of<'a>(&'a self, m: usize, request_w: &'a [f64]) -> impl Iterator<Item = Flow> + 'a {
        request_w.iter().zip(&self.intervals).scan(self.start[m], move |state, (&request_w, interval)| {
            let flow = self.string(m).step(*state, request_w, interval);
            *state = flow.end;
            Some(flow)
        })
    }

    /// Flows of single steps, from states `(M, T)` and with requests `(M, T)` [W].
    pub fn flows_from(&self, states: &[StringState], request_w: &[f64]) -> Vec<Flow> {
        let n_steps = self.n_steps();
        let step = |(i, (state, request_w)): (usize, (&StringState, &f64))| {
            self.string(i / n_steps).step(*state, *request_w, &self.intervals[i % n_steps])
        };
        states.iter().zip(request_w).enumerate().map(step).collect()
    }

    /// Objectives of a batch of schedules `(B, M, T)` [W], `(B, G)`.
    pub fn evaluate(&self, requests_w: &[f64]) -> Vec<f64> {
        let size = self.n_strings() * self.n_steps();
        let groups = self.n_groups;
        requests_w
            .chunks_exact(size)
            .flat_map(|request| self.objectives(request).into_iter().take(groups))
            .collect()
    }
}

/// Sum of costs of all groups, in order.
#[inline]
pub(crate) fn total(costs: impl Iterator<Item = Objectives>) -> Objectives {
    costs.fold([0.0; MAX_GROUPS], |mut totals, costs| {
        totals.iter_mut().zip(costs).for_each(|(total, cost)| *total += cost);
        totals
    })
}

//! The split of one horizon: the complete search, with its starts and stopping criteria, then the lower bounds.

use std::time::Instant;

use bess_tables::units::W_PER_KW;

use super::incumbent::{Incumbent, Schedule};
use crate::model::{ControlHorizon, CostsOf, Flow};
use crate::reach::{GroupBounds, Proof, StepBounds};

const MAX_SWAPS: usize = 64;
/// Maximum number of descents after a gain from the one-step optima along the incumbent.
const MAX_FINAL_DESCENTS: usize = 3;
/// Relative gap at which a start is optimal but for rounding: descents gain nothing.
const EXACT: f64 = 1e-8;

/// Maximum number of rounds: rounding to kW can cancel the gain of an optimum repeatedly.
const MAX_ROUNDS: usize = 50;

/// Limits of a search.
#[derive(Debug, Clone, Copy)]
pub struct Effort {
    /// Maximum number of roll-outs of one descent.
    pub rollouts: usize,
    /// Time at which the search stops with its incumbent.
    pub deadline: Option<Instant>,
    /// Relative gap of the rigorous bounds within which a schedule needs no further starts.
    pub gap: f64,
}

/// The best schedule found, and its bounds.
#[derive(Debug, Clone)]
pub struct Split {
    /// The schedule; its requests are bit-identical after conversion to kW and back.
    pub incumbent: Incumbent,
    /// Flows of the strings under this schedule, `(M, T)`.
    pub flows: Vec<Flow>,
    /// Bounds of every group.
    pub groups: Vec<GroupBounds>,
    /// Number of roll-outs.
    pub rollouts: usize,
}

impl ControlHorizon {
    /// Splits the demand: searches, from a greedy pass and, if given, the shifted warm start `warm_start_w` `(M, T)`, and bounds
    /// the result. The search uses more starts if the plant is or will soon be full or empty.
    ///
    /// Steps that share a scarce SOC cause local optima. A closed loop has a good warm start in every step; a
    /// search without warm start uses plans and exchanges, unless the bounds prove its schedule.
    pub fn split(&self, warm_start_w: Option<&[f64]>, effort: &Effort) -> Split {
        let proportional = self.rated(self.fitted(&self.limit_w));
        let incumbent = Incumbent::new(proportional);
        let mut search = Search { horizon: self, effort, incumbent, string_steps: 0, proof: None };
        let n_free = self.n_free_steps();
        if n_free > 0 {
            search.offer(self.greedy());
            if let Some(wanted) = warm_start_w {
                search.offer(self.rated(self.fitted(wanted)));
            }
            if self.heat_costs() || !search.is_proven(EXACT) {
                search.explore(warm_start_w.is_none() && n_free > 1);
            }
        }
        let (flows, optima) = search.settle(n_free > 0);
        let Search { incumbent, string_steps, proof, .. } = search;
        let groups = self.bounds(&incumbent.schedule.request_w, &flows, &optima, proof);
        let rollouts = (string_steps as usize).div_ceil(self.size());
        Split { incumbent, flows, groups, rollouts }
    }

    /// Whether battery losses have a cost: steps then depend on each other even away from limits, and the one-step optima are
    /// rarely optimal for the horizon.
    fn heat_costs(&self) -> bool {
        let costs = |group| self.group_costs(group, CostsOf::Report);
        (0..self.n_groups()).any(|group| costs(group).iter().any(|c| c.battery > 0.0))
    }

    /// Whether steps are coupled so that local optima are likely: there is availability or derating loss, or another step with
    /// the largest SOC change of any string would bring a string to an end of its SOC window.
    pub(crate) fn is_scarce(&self, flows: &[Flow]) -> bool {
        let n_steps = self.n_steps();
        let (mut moved, mut room) = (0.0_f64, f64::INFINITY);
        for (m, row) in flows.chunks_exact(n_steps).enumerate() {
            let p = &self.string(m).parameters;
            let mut soc = self.start[m].soc;
            room = room.min(soc - p.soc_min).min(p.soc_max - soc);
            for flow in row {
                moved = moved.max((flow.end.soc - soc).abs());
                soc = flow.end.soc;
                room = room.min(soc - p.soc_min).min(p.soc_max - soc);
            }
        }
        room < moved || sheds(flows) || flows.iter().any(|flow| flow.derating_w > 0.0)
    }
}

/// Whether there is availability loss.
fn sheds(flows: &[Flow]) -> bool {
    flows.iter().any(|flow| flow.availability_w > 0.0)
}

pub(super) struct Search<'a> {
    pub(super) horizon: &'a ControlHorizon,
    pub(super) effort: &'a Effort,
    pub(super) incumbent: Incumbent,
    /// String-steps rolled out by descents.
    pub(super) string_steps: u64,
    /// The last attempt to prove the incumbent.
    proof: Option<Proof>,
}

impl Search<'_> {
    pub(super) fn best(&self) -> &[f64] {
        &self.incumbent.schedule.request_w
    }

    pub(super) fn offer(&mut self, schedule: Schedule) -> bool {
        self.incumbent.offer(self.horizon, schedule)
    }

    pub(super) fn late(&self) -> bool {
        self.effort.deadline.is_some_and(|deadline| Instant::now() >= deadline)
    }

    /// Descends from a start, group by group; a start that cannot meet a ceiling is discarded.
    pub(super) fn improve(&mut self, mut request_w: Vec<f64>) {
        for group in 0..self.horizon.n_groups() {
            if self.late() {
                return;
            }
            let schedule = self.descend(&request_w, group, self.effort.rollouts);
            let ranking = self.incumbent.ranking(self.horizon, self.horizon.n_groups() - 1);
            if group < ranking.group && schedule.objectives[group] > ranking.ceilings[group] {
                return;
            }
            request_w = schedule.request_w;
        }
    }

    /// Minimises one group under the ceilings of earlier groups.
    pub(super) fn descend(&mut self, start_w: &[f64], group: usize, rollouts: usize) -> Schedule {
        let ranking = self.incumbent.ranking(self.horizon, group);
        let budget = (rollouts * self.horizon.size()) as u64;
        let (schedule, used) = self.horizon.descend(start_w, &ranking, budget);
        self.string_steps += used;
        self.offer(schedule.clone());
        schedule
    }

    /// Descends from the incumbent and, if it `may_go_far` and the plant is or will soon be full or empty, from distant starts.
    fn explore(&mut self, may_go_far: bool) {
        let horizon = self.horizon;
        self.improve(self.best().to_vec());
        self.swap_strings();
        let flows = horizon.flows(self.best());
        if sheds(&flows) {
            self.improve(horizon.fitted(&horizon.limit_w));
        }
        if may_go_far && horizon.is_scarce(&flows) && !self.is_proven(self.effort.gap) {
            self.search_distant();
        }
    }

    fn swap_strings(&mut self) {
        let mut gained = false;
        for schedule in self.horizon.with_strings_swapped(self.best(), MAX_SWAPS) {
            gained |= self.offer(schedule);
        }
        if gained {
            self.improve(self.best().to_vec());
        }
    }

    /// Whether the bounds prove the incumbent within a relative gap.
    fn is_proven(&mut self, gap: f64) -> bool {
        let proof = self.proof.insert(self.horizon.proof(self.rounded(), gap));
        proof.is_complete
    }

    /// Requests of the incumbent, rounded so that their conversion to kW and back, within the limits, gives the same bits.
    fn rounded(&self) -> Vec<f64> {
        let there_and_back = |w: f64| w / W_PER_KW * W_PER_KW;
        let rounded = |(&w, &limit_w): (&f64, &f64)| there_and_back(there_and_back(w)).min(limit_w);
        self.best().iter().zip(&self.horizon.limit_w).map(rounded).collect()
    }

    /// Offers the one-step optima at the states of the incumbent, if there `is_choice`, repeated after every improvement;
    /// returns its flows and these optima.
    fn settle(&mut self, is_choice: bool) -> (Vec<Flow>, Vec<StepBounds>) {
        let horizon = self.horizon;
        let mut round = 1;
        loop {
            self.incumbent.schedule = horizon.rated(self.rounded());
            let flows = horizon.flows(self.best());
            let optima = if is_choice { horizon.one_step_optima(&flows) } else { vec![] };
            let mut gained = false;
            if round <= MAX_ROUNDS {
                for optimum in &optima {
                    gained |= self.offer(horizon.rated(horizon.fitted(&optimum.request_w)));
                }
            }
            if !gained {
                return (flows, optima);
            }
            if round < MAX_FINAL_DESCENTS {
                self.improve(self.best().to_vec());
            }
            round += 1;
        }
    }
}

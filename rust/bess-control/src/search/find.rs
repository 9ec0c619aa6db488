//! The search as a whole: which starts it makes, and when it stops.

use std::time::Instant;

use bess_tables::units::W_PER_KW;

use super::incumbent::{Incumbent, Schedule};
use crate::model::{ControlHorizon, Flow};
use crate::reach::StepBounds;

/// Most swaps of strings that are tried.
const MOST_SWAPS: usize = 64;
/// Times that a gain from the one-step optima along the incumbent is followed by a descent.
const SETTLING_ROUNDS: usize = 3;

/// Rounds after which it is left as it is: where a last digit decides, rounding to kW can take back what an optimum gains,
/// and so on for ever.
const MOST_ROUNDS: usize = 50;

/// How much a search may do.
#[derive(Debug, Clone, Copy)]
pub struct Effort {
    /// Most roll-outs of one descent.
    pub rollouts: usize,
    /// The search stops at this moment, with what it has.
    pub deadline: Option<Instant>,
}

/// What a search found.
#[derive(Debug, Clone)]
pub struct Found {
    /// The best schedule.
    pub incumbent: Incumbent,
    /// Roll-outs used.
    pub rollouts: usize,
    /// What the strings do under it, `(M, T)`.
    pub flows: Vec<Flow>,
    /// What every step by itself would cost at its states, one for each group; none where there is nothing to decide.
    pub(crate) optima: Vec<StepBounds>,
}

impl ControlHorizon {
    /// Searches for the best schedule, from a greedy pass and, if given, a schedule of the step before, `warm_start_w`
    /// `(M, T)`; from more starts where the plant is full or empty or soon is.
    ///
    /// Steps that share a scarce SOC make local optima. A closed loop carries a good schedule along from step to step; a
    /// search without that memory looks for one among samples and exchanges.
    pub fn find(&self, warm_start_w: Option<&[f64]>, effort: &Effort) -> Found {
        let proportional = self.rated(self.fitted(&self.limit_w));
        let mut search = Search::new(self, effort, proportional);
        let n_free = self.n_free_steps();
        if n_free > 0 {
            search.offer(self.greedy());
            if let Some(wanted) = warm_start_w {
                search.offer(self.rated(self.fitted(wanted)));
            }
            search.improve(search.best().to_vec());
            search.swap_strings();
            let flows = self.flows(search.best());
            if sheds(&flows) {
                search.improve(self.fitted(&self.limit_w));
            }
            if warm_start_w.is_none() && n_free > 1 && self.is_scarce(&flows) {
                search.search_far();
            }
        }
        let (flows, optima) = if n_free > 0 { search.settle() } else { search.without_choice() };
        let rollouts = (search.string_steps as usize).div_ceil(self.size());
        Found { incumbent: search.incumbent, rollouts, flows, optima }
    }

    /// Whether steps are coupled so that local optima are likely: something is shed or derated, or a string is so near to
    /// an end of its window that one more step like the largest of any string would take it there.
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

/// Whether anything is shed.
fn sheds(flows: &[Flow]) -> bool {
    flows.iter().any(|flow| flow.availability_w > 0.0)
}

/// A search under way.
pub(super) struct Search<'a> {
    pub(super) horizon: &'a ControlHorizon,
    pub(super) effort: &'a Effort,
    pub(super) incumbent: Incumbent,
    /// Steps of single strings rolled out by descents and samples.
    pub(super) string_steps: u64,
}

impl<'a> Search<'a> {
    pub(super) fn new(horizon: &'a ControlHorizon, effort: &'a Effort, first: Schedule) -> Self {
        Self { horizon, effort, incumbent: Incumbent::new(first), string_steps: 0 }
    }

    pub(super) fn best(&self) -> &[f64] {
        &self.incumbent.schedule.request_w
    }

    pub(super) fn offer(&mut self, schedule: Schedule) -> bool {
        self.incumbent.offer(self.horizon, schedule)
    }

    pub(super) fn late(&self) -> bool {
        self.effort.deadline.is_some_and(|deadline| Instant::now() >= deadline)
    }

    /// Descends from a start, group after group; a start that cannot get under the ceiling of one is given up.
    pub(super) fn improve(&mut self, mut request_w: Vec<f64>) {
        for group in 0..self.horizon.n_groups() {
            if self.late() {
                return;
            }
            let schedule = self.descend(&request_w, group);
            let ranking = self.incumbent.ranking(self.horizon, self.horizon.n_groups() - 1);
            if group < ranking.group && schedule.objectives[group] > ranking.ceilings[group] {
                return;
            }
            request_w = schedule.request_w;
        }
    }

    /// Minimises one group under the ceilings of those before it.
    fn descend(&mut self, start_w: &[f64], group: usize) -> Schedule {
        let ranking = self.incumbent.ranking(self.horizon, group);
        let budget = (self.effort.rollouts * self.horizon.size()) as u64;
        let (schedule, used) = self.horizon.descend(start_w, &ranking, budget, None);
        self.string_steps += used;
        self.offer(schedule.clone());
        schedule
    }

    fn swap_strings(&mut self) {
        let mut gained = false;
        for schedule in self.horizon.with_strings_swapped(self.best(), MOST_SWAPS) {
            gained |= self.offer(schedule);
        }
        if gained {
            self.improve(self.best().to_vec());
        }
    }

    /// Requests as they leave: what is told outside in kW gives the same bits when it comes back.
    fn round(&mut self) {
        let there_and_back = |w: f64| w / W_PER_KW * W_PER_KW;
        let request_w = self.best().iter().map(|&w| there_and_back(there_and_back(w))).collect();
        self.incumbent.schedule = self.horizon.rated(request_w);
    }

    fn without_choice(&mut self) -> (Vec<Flow>, Vec<StepBounds>) {
        self.round();
        (self.horizon.flows(self.best()), vec![])
    }

    /// Offers the one-step optima at the states of the incumbent, again whenever that changed it; returns its flows and
    /// these optima.
    fn settle(&mut self) -> (Vec<Flow>, Vec<StepBounds>) {
        let mut round = 1;
        loop {
            self.round();
            let flows = self.horizon.flows(self.best());
            let optima = self.horizon.one_step_optima(&flows);
            if round > MOST_ROUNDS {
                return (flows, optima);
            }
            let mut gained = false;
            for optimum in &optima {
                gained |= self.offer(self.horizon.rated(self.horizon.fitted(&optimum.request_w)));
            }
            if !gained {
                return (flows, optima);
            }
            if round < SETTLING_ROUNDS {
                self.improve(self.best().to_vec());
            }
            round += 1;
        }
    }
}

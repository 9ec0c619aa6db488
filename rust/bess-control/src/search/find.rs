//! The search as a whole: which starts it makes, and when it stops.

use std::time::Instant;

use bess_tables::units::W_PER_KW;

use super::incumbent::{Incumbent, Schedule};
use crate::model::{ControlHorizon, Flow};
use crate::reach::StepBounds;

/// Steps of strings rolled out for a sample of schedules.
const SAMPLED_STEPS: usize = 50_000;
/// Fewest schedules of a sample.
const LEAST_SAMPLES: usize = 1500;
/// Roll-outs of a quick descent, and how many of a sample get one.
const QUICK_ROLLOUTS: usize = 200;
const QUICK_STARTS: usize = 48;
/// Steps of strings of those that become starts, and how many these are at least and at most.
const STARTED_STEPS: usize = 240;
const SAMPLED_STARTS: (usize, usize) = (6, 24);
/// Objectives of a sample this close, as a share of the largest, count as equal.
const EQUAL: f64 = 1e-4;
/// Far moves of each kind that are looked at in a round.
const FAR_MOVES: usize = 60;
/// Most swaps of strings that are tried.
const MOST_SWAPS: usize = 64;
/// No far move is tried any more after this many times the roll-outs of one descent.
const MOVE_EFFORT: usize = 90;
/// Gain of a round of far moves that asks for another one, relative.
const WORTHWHILE: f64 = 1e-6;
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
        let mut search =
            Search { horizon: self, effort, incumbent: Incumbent::new(proportional), rollouts: 0 };
        let n_free = self.n_free_steps();
        if n_free > 0 {
            search.offer(self.greedy());
            if let Some(warm_start_w) = warm_start_w {
                search.offer(self.rated(self.fitted(warm_start_w)));
            }
            search.improve(search.best().to_vec());
            search.swap_strings();
            let flows = self.flows(search.best());
            if sheds(&flows) {
                search.improve(self.fitted(&self.limit_w));
            }
            if warm_start_w.is_none() && n_free > 1 && self.is_scarce(&flows) {
                let mut random = fastrand::Rng::with_seed(1);
                search.sample(&mut random);
                search.move_far(&mut random);
            }
        }
        let (flows, optima) = if n_free > 0 { search.settle() } else { search.without_choice() };
        Found { incumbent: search.incumbent, rollouts: search.rollouts, flows, optima }
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
struct Search<'a> {
    horizon: &'a ControlHorizon,
    effort: &'a Effort,
    incumbent: Incumbent,
    rollouts: usize,
}

impl Search<'_> {
    fn best(&self) -> &[f64] {
        &self.incumbent.schedule.request_w
    }

    fn offer(&mut self, schedule: Schedule) -> bool {
        self.incumbent.offer(self.horizon, schedule)
    }

    fn late(&self) -> bool {
        self.effort.deadline.is_some_and(|deadline| Instant::now() >= deadline)
    }

    /// Descends from a start, group after group; a start that cannot get under the ceiling of one is given up.
    fn improve(&mut self, mut request_w: Vec<f64>) {
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
        let (schedule, used) = self.horizon.descend(start_w, &ranking, self.effort.rollouts);
        self.rollouts += used;
        self.offer(schedule.clone());
        schedule
    }

    /// How many starts are worth a descent.
    fn n_starts(&self) -> usize {
        let size = self.horizon.n_strings() * self.horizon.n_steps();
        (STARTED_STEPS / size).clamp(SAMPLED_STARTS.0, SAMPLED_STARTS.1)
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

    /// Descends from the best of many random schedules.
    fn sample(&mut self, random: &mut fastrand::Rng) {
        let horizon = self.horizon;
        let size = horizon.n_strings() * horizon.n_steps();
        let n_starts = self.n_starts();
        let n = LEAST_SAMPLES.max(SAMPLED_STEPS / size);
        let mut sample: Vec<Schedule> = (0..n).map(|i| horizon.at_random(random, i % 2 == 0)).collect();
        let largest = |g: usize| sample.iter().map(|s| s.objectives[g]).fold(f64::MIN_POSITIVE, f64::max);
        let units: Vec<f64> = (0..horizon.n_groups()).map(|g| EQUAL * largest(g)).collect();
        let key = |s: &Schedule| -> Vec<i64> {
            units.iter().zip(s.objectives).map(|(unit, value)| (value / unit).round() as i64).collect()
        };
        sample.sort_by_cached_key(key);

        // Of those that run the same strings in every step, the best.
        let mut seen = std::collections::HashSet::new();
        sample.retain(|s| seen.insert(s.request_w.iter().map(|w| *w > 0.0).collect::<Vec<_>>()));
        let quick = Effort { rollouts: QUICK_ROLLOUTS, ..*self.effort };
        let mut starts = vec![];
        for start in sample.into_iter().take(QUICK_STARTS) {
            let mut alone =
                Search { horizon, effort: &quick, incumbent: Incumbent::new(start.clone()), rollouts: 0 };
            alone.improve(start.request_w);
            self.rollouts += alone.rollouts;
            self.offer(alone.incumbent.schedule.clone());
            starts.push(alone.incumbent.schedule);
        }
        let ranking = self.incumbent.ranking(horizon, horizon.n_groups() - 1);
        starts.sort_by(|a, b| ranking.order(&a.objectives, &b.objectives));
        for start in starts.into_iter().take(n_starts) {
            self.improve(start.request_w);
        }
    }

    /// Descents from far moves, for the sake of one group after the other; once more from the first group that they
    /// improve.
    fn move_far(&mut self, random: &mut fastrand::Rng) {
        let horizon = self.horizon;
        let mut group = 0;
        while group < horizon.n_groups() {
            let before = self.incumbent.standing(horizon);
            let flows = horizon.flows(self.best());
            let ranking = self.incumbent.ranking(horizon, group);
            let mut moved = horizon.with_steps_exchanged(self.best(), &flows, random, FAR_MOVES);
            moved.extend(horizon.with_windows_swapped(self.best(), random, FAR_MOVES));
            moved.extend(horizon.with_a_step_shared_anew(self.best(), random, FAR_MOVES));
            random.shuffle(&mut moved);
            // Some at random, and the best of the others.
            let n = self.n_starts().min(moved.len());
            moved[n..].sort_by(|a, b| ranking.order(&a.objectives, &b.objectives));
            moved.truncate(2 * n);
            for schedule in &moved {
                self.offer(schedule.clone());
            }
            for schedule in moved {
                if self.late() || self.rollouts > MOVE_EFFORT * self.effort.rollouts {
                    return;
                }
                self.descend(&schedule.request_w, group);
            }
            let after = self.incumbent.standing(horizon);
            let gained = (0..horizon.n_groups()).find(|&g| after[g] < before[g] * (1.0 - WORTHWHILE));
            group = gained.unwrap_or(group + 1);
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

//! Iterated local search for steps that share a scarce SOC: a race of descents from a sample of random
//! schedules, then races of descents from perturbations of the best.
//!
//! Its work is limited in string-steps, so that the computing time does not grow with the number of strings.

use super::incumbent::Schedule;
use super::multistart::Search;
use super::Effort;

/// String-steps of the roll-outs of a sample of schedules.
const SAMPLED_STEPS: usize = 50_000;
/// Minimum and maximum number of schedules of a sample.
const SAMPLE: (usize, usize) = (200, 5000);
/// String-steps of the starts of a sample, and their minimum and maximum number.
const STARTED_STEPS: usize = 768;
const STARTS: (usize, usize) = (4, 48);
/// String-steps of the perturbations of a round, and their minimum and maximum number.
const MOVED_STEPS: usize = 480;
const MOVES: (usize, usize) = (12, 48);
/// Relative tolerance within which objectives of a sample count as equal.
const EQUAL: f64 = 1e-4;
/// Number of perturbations of each kind in a round.
const FAR_MOVES: usize = 60;
/// Stages of successive halving: roll-outs of a descent, and the reduction factor.
const HEATS: [(usize, usize); 3] = [(100, 4), (400, 3), (2000, 1)];
/// Strings affected by a perturbation: descents from it have the budget of this number of strings.
const STRINGS_OF_A_MOVE: usize = 8;
/// Minimum relative gain of a round of perturbations for a restart of the rounds.
const WORTHWHILE: f64 = 1e-5;
/// String-steps of rounds without such a gain after which a group ends, and the minimum and maximum number of
/// rounds.
const IDLE_STEPS: usize = 72;
const IDLE_ROUNDS: (usize, usize) = (3, 8);
/// String-steps after which no round starts.
const MOST_STEPS: u64 = 10_000_000;

impl Search<'_> {
    /// Searches among random schedules and perturbations, even if every step is optimal at its own states, because
    /// other states may be better.
    pub(super) fn search_far(&mut self) {
        let mut random = fastrand::Rng::with_seed(1);
        let before = self.string_steps;
        self.sample(&mut random);
        self.move_far(&mut random, before + MOST_STEPS);
    }

    /// Successive halving from the best of many random schedules.
    fn sample(&mut self, random: &mut fastrand::Rng) {
        let horizon = self.horizon;
        let size = horizon.size();
        let n = (SAMPLED_STEPS / size).clamp(SAMPLE.0, SAMPLE.1);
        let mut sample: Vec<Schedule> = (0..n).map(|i| horizon.at_random(random, i % 2 == 0)).collect();
        self.string_steps += (n * size) as u64;
        let largest = |g: usize| sample.iter().map(|s| s.objectives[g]).fold(f64::MIN_POSITIVE, f64::max);
        let units: Vec<f64> = (0..horizon.n_groups()).map(|g| EQUAL * largest(g)).collect();
        let key = |s: &Schedule| -> Vec<i64> {
            units.iter().zip(s.objectives).map(|(unit, value)| (value / unit).round() as i64).collect()
        };
        sample.sort_by_cached_key(key);

        // The best schedule of each pattern of strings that are on.
        let mut seen = std::collections::HashSet::new();
        sample.retain(|s| seen.insert(s.request_w.iter().map(|w| *w > 0.0).collect::<Vec<_>>()));
        sample.truncate((STARTED_STEPS / size).clamp(STARTS.0, STARTS.1));
        self.successive_halving(sample, horizon.n_groups() - 1, Self::alone);
    }

    /// Successive halving from perturbations, for each group in order; repeated from the first improved group.
    fn move_far(&mut self, random: &mut fastrand::Rng, most_steps: u64) {
        let horizon = self.horizon;
        let patience = (IDLE_STEPS / horizon.size()).clamp(IDLE_ROUNDS.0, IDLE_ROUNDS.1);
        let (mut group, mut idle_rounds, mut moved) = (0, 0, true);
        while group < horizon.n_groups() && !self.late() && self.string_steps < most_steps {
            let before = self.incumbent.standing(horizon);
            if idle_rounds < patience {
                let starts = self.perturbed(random, group);
                let base_w = self.best().to_vec();
                self.successive_halving(starts, group, |search, start, rollouts| {
                    search.beside(&base_w, start, rollouts, group)
                });
            } else if moved {
                // Rounds do not change strings that their moves do not affect.
                self.improve(self.best().to_vec());
                moved = false;
            }
            let after = self.incumbent.standing(horizon);
            let gained = (0..horizon.n_groups()).find(|&g| after[g] < before[g] * (1.0 - WORTHWHILE));
            if let Some(gained) = gained {
                (group, idle_rounds, moved) = (gained, 0, true);
            } else if idle_rounds < patience {
                idle_rounds += 1;
            } else {
                (group, idle_rounds) = (group + 1, 0);
            }
        }
    }

    /// Perturbations of the best schedule: half at random, half the best of many.
    fn perturbed(&mut self, random: &mut fastrand::Rng, group: usize) -> Vec<Schedule> {
        let horizon = self.horizon;
        let flows = horizon.flows(self.best());
        let ranking = self.incumbent.ranking(horizon, group);
        let mut moved = horizon.with_steps_exchanged(self.best(), &flows, random, FAR_MOVES);
        moved.extend(horizon.with_windows_swapped(self.best(), random, FAR_MOVES));
        moved.extend(horizon.with_a_step_shared_anew(self.best(), random, FAR_MOVES));
        self.string_steps += (moved.len() * horizon.size()) as u64;
        random.shuffle(&mut moved);
        let most = (MOVED_STEPS / horizon.size()).clamp(MOVES.0, MOVES.1).min(moved.len());
        moved[most / 2..].sort_by(|a, b| ranking.order(&a.objectives, &b.objectives));
        moved.truncate(most);
        for schedule in &moved {
            self.offer(schedule.clone());
        }
        moved
    }

    /// Successive halving of descents from many starts: short descents from all starts, longer ones from the best,
    /// and full descents from the best of these. They compare by the ranking for `group`.
    fn successive_halving(
        &mut self,
        mut starts: Vec<Schedule>,
        group: usize,
        descend: impl Fn(&mut Self, &Schedule, usize) -> Schedule,
    ) {
        for (rollouts, one_of) in HEATS {
            for start in &mut starts {
                if self.late() {
                    return;
                }
                *start = descend(self, start, rollouts.min(self.effort.rollouts));
                self.offer(start.clone());
            }
            let ranking = self.incumbent.ranking(self.horizon, group);
            starts.sort_by(|a, b| ranking.order(&a.objectives, &b.objectives));
            starts.truncate(starts.len().div_ceil(one_of));
        }
    }

    /// Minimises all groups from a start, independently of the incumbent.
    fn alone(&mut self, start: &Schedule, rollouts: usize) -> Schedule {
        let effort = Effort { rollouts, ..*self.effort };
        let mut search = Search::new(self.horizon, &effort, start.clone());
        search.improve(start.request_w.clone());
        self.string_steps += search.string_steps;
        search.incumbent.schedule
    }

    /// Minimises one group from a perturbation of a schedule, under the ceilings of the incumbent.
    fn beside(&mut self, base_w: &[f64], start: &Schedule, rollouts: usize, group: usize) -> Schedule {
        let horizon = self.horizon;
        let ranking = self.incumbent.ranking(horizon, group);
        let width = horizon.n_strings().min(STRINGS_OF_A_MOVE);
        let budget = (rollouts * width * horizon.n_steps()) as u64;
        let (schedule, used) = horizon.descend(&start.request_w, &ranking, budget, Some(base_w));
        self.string_steps += used;
        schedule
    }
}

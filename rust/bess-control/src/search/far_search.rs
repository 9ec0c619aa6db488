//! The search far from the first answer, for steps that share a scarce SOC: a race of descents from a sample of random
//! schedules, then races of descents from far moves of the best.
//!
//! Its work is counted in steps of single strings, so that many strings do not cost many times as much as few.

use super::find::Search;
use super::incumbent::Schedule;
use super::Effort;

/// Steps of strings rolled out for a sample of schedules.
const SAMPLED_STEPS: usize = 50_000;
/// Fewest and most schedules of a sample.
const SAMPLE: (usize, usize) = (200, 5000);
/// Steps of strings of the schedules of a sample that start, and how many these are at least and at most.
const STARTED_STEPS: usize = 768;
const STARTS: (usize, usize) = (4, 48);
/// The same for the far moves of a round.
const MOVED_STEPS: usize = 480;
const MOVES: (usize, usize) = (12, 48);
/// Objectives of a sample this close, as a share of the largest, count as equal.
const EQUAL: f64 = 1e-4;
/// Far moves of each kind that are looked at in a round.
const FAR_MOVES: usize = 60;
/// Heats of a race: roll-outs of a descent, and one of how many goes on.
const HEATS: [(usize, usize); 3] = [(100, 4), (400, 3), (2000, 1)];
/// Strings that a far move touches and that answer it: descents from it roll out as if there were no more.
const STRINGS_OF_A_MOVE: usize = 8;
/// Gain of a round of far moves that begins again, relative.
const WORTHWHILE: f64 = 1e-5;
/// Steps of strings of the rounds without one after which a group is left, and how many these are at least and at most.
const IDLE_STEPS: usize = 72;
const IDLE_ROUNDS: (usize, usize) = (3, 8);
/// Steps of strings after which no round begins.
const MOST_STEPS: u64 = 10_000_000;

impl Search<'_> {
    /// Searches among random schedules and far moves. That every step is at the optimum of its own states is no reason not
    /// to: other states may be worth more.
    pub(super) fn search_far(&mut self) {
        let mut random = fastrand::Rng::with_seed(1);
        let before = self.string_steps;
        self.sample(&mut random);
        self.move_far(&mut random, before + MOST_STEPS);
    }

    /// A race from the best of many random schedules.
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

        // Of those that run the same strings in every step, the best.
        let mut seen = std::collections::HashSet::new();
        sample.retain(|s| seen.insert(s.request_w.iter().map(|w| *w > 0.0).collect::<Vec<_>>()));
        sample.truncate((STARTED_STEPS / size).clamp(STARTS.0, STARTS.1));
        self.race(sample, horizon.n_groups() - 1, Self::alone);
    }

    /// Races from far moves, for the sake of one group after the other; once more from the first group that they improve.
    fn move_far(&mut self, random: &mut fastrand::Rng, most_steps: u64) {
        let horizon = self.horizon;
        let patience = (IDLE_STEPS / horizon.size()).clamp(IDLE_ROUNDS.0, IDLE_ROUNDS.1);
        let (mut group, mut idle_rounds, mut moved) = (0, 0, true);
        while group < horizon.n_groups() && !self.late() && self.string_steps < most_steps {
            let before = self.incumbent.standing(horizon);
            if idle_rounds < patience {
                let starts = self.far_moves(random, group);
                let base_w = self.best().to_vec();
                self.race(starts, group, |search, start, rollouts| {
                    search.beside(&base_w, start, rollouts, group)
                });
            } else if moved {
                // Rounds leave the strings alone that their moves do not touch.
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

    /// Far moves of the best schedule: half of them at random, half the best of many.
    fn far_moves(&mut self, random: &mut fastrand::Rng, group: usize) -> Vec<Schedule> {
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

    /// Descents from many starts: all of them a little, the best further, the best of these to the end. One that goes
    /// wrong shows it early. They compare in the order in which `group` is minimised.
    fn race(
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

    /// Minimises all groups from a start, without a look at what is known.
    fn alone(&mut self, start: &Schedule, rollouts: usize) -> Schedule {
        let effort = Effort { rollouts, ..*self.effort };
        let mut search = Search::new(self.horizon, &effort, start.clone());
        search.improve(start.request_w.clone());
        self.string_steps += search.string_steps;
        search.incumbent.schedule
    }

    /// Minimises one group from a far move of a schedule, under the ceilings of the incumbent.
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

//! The best schedule known, and the lexicographic order of schedules by their group objectives.

use crate::model::{ControlHorizon, Objectives, MAX_GROUPS};

/// Descents end on a ceiling; after rounding to kW a schedule may exceed it by this relative amount.
const ROUNDING: f64 = 1e-12;

/// A schedule and its costs.
#[derive(Debug, Clone)]
pub struct Schedule {
    /// Requests `(M, T)`, magnitudes [W].
    pub request_w: Vec<f64>,
    /// Objectives of the groups; unused entries are zero.
    pub objectives: Objectives,
}

impl ControlHorizon {
    /// A schedule of requests `(M, T)` (magnitudes) with its objectives.
    pub fn rated(&self, request_w: Vec<f64>) -> Schedule {
        Schedule { objectives: self.objectives(&request_w), request_w }
    }
}

/// The best schedule offered so far.
///
/// Each group has a ceiling, its smallest value so far plus its tolerance; schedules under all ceilings compare by the
/// last group. The ceilings only fall, so that small steps within a tolerance cannot add up.
#[derive(Debug, Clone)]
pub struct Incumbent {
    /// The best schedule.
    pub schedule: Schedule,
    /// Smallest value of each group except the last.
    lowest: Objectives,
}

impl Incumbent {
    /// Begins with this schedule.
    pub fn new(schedule: Schedule) -> Self {
        Self { lowest: schedule.objectives, schedule }
    }

    /// The ranking for a group under the ceilings of earlier groups.
    pub(crate) fn ranking(&self, horizon: &ControlHorizon, group: usize) -> Ranking {
        Ranking::under(horizon, group, &self.lowest)
    }

    /// Replaces the incumbent by a better schedule; returns whether it did.
    pub fn offer(&mut self, horizon: &ControlHorizon, schedule: Schedule) -> bool {
        let objectives = &schedule.objectives;
        if objectives.iter().any(|value| !value.is_finite()) {
            return false;
        }
        let last = horizon.n_groups() - 1;
        for (group, &objective) in objectives[..last].iter().enumerate() {
            self.lowest[group] = self.lowest[group].min(objective);
            if objective > horizon.ceiling(group, self.lowest[group]) {
                break;
            }
        }
        let mut ranking = self.ranking(horizon, last);
        for ceiling in &mut ranking.ceilings[..last] {
            *ceiling += ROUNDING * ceiling.abs();
        }
        let takes = ranking.better(objectives, &self.schedule.objectives);
        if takes {
            self.schedule = schedule;
        }
        takes
    }
}

/// Lexicographic order with ceilings for earlier groups.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ranking {
    /// The group that is minimised; earlier groups only have to respect their ceilings.
    pub group: usize,
    pub n_groups: usize,
    pub ceilings: Objectives,
}

impl Ranking {
    /// Ranking for the first group, without ceilings.
    pub fn new(n_groups: usize) -> Self {
        Self { group: 0, n_groups, ceilings: [f64::INFINITY; MAX_GROUPS] }
    }

    /// Ranking for `group`, with earlier groups at most a tolerance above `lowest`.
    pub fn under(horizon: &ControlHorizon, group: usize, lowest: &Objectives) -> Self {
        let mut ranking = Self { group, ..Self::new(horizon.n_groups()) };
        for (g, &lowest) in lowest[..group].iter().enumerate() {
            ranking.ceilings[g] = horizon.ceiling(g, lowest);
        }
        ranking
    }

    /// Maximum excess of earlier groups over their ceilings; negative if all are below.
    #[inline]
    pub fn excess(&self, costs: &Objectives) -> f64 {
        (0..self.group).map(|g| costs[g] - self.ceilings[g]).fold(f64::NEG_INFINITY, f64::max)
    }

    /// Whether `a` is better than `b`. Ties go to the next group. Exact, hence transitive: a descent cannot cycle.
    #[inline]
    pub fn better(&self, a: &Objectives, b: &Objectives) -> bool {
        self.better_by(a, b, 0.0)
    }

    /// Orders the better schedule first.
    pub fn order(&self, a: &Objectives, b: &Objectives) -> std::cmp::Ordering {
        self.better(b, a).cmp(&self.better(a, b))
    }

    /// Whether `a` is better than `b` by more than a relative margin.
    #[inline]
    pub fn better_by(&self, a: &Objectives, b: &Objectives, share: f64) -> bool {
        for g in 0..self.n_groups {
            let (x, y) = if g < self.group {
                (a[g].max(self.ceilings[g]), b[g].max(self.ceilings[g]))
            } else {
                (a[g], b[g])
            };
            let slack = share * x.abs().max(y.abs());
            if x < y - slack {
                return true;
            }
            if x > y + slack {
                return false;
            }
        }
        false
    }
}

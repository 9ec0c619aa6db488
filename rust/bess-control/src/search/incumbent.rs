//! The best schedule known.

use super::ranking::Ranking;
use crate::model::{ControlHorizon, Objectives};

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

//! The lexicographic order of schedules by their vectors of group objectives.

use crate::model::{ControlHorizon, Objectives, MAX_GROUPS};

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

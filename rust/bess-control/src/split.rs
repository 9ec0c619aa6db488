//! The split of one horizon: the search for the best schedule, then what is proven about it.

use crate::model::{ControlHorizon, Flow};
use crate::reach::GroupBounds;
use crate::search::{Effort, Incumbent};

/// The best schedule found, and what is known about it.
#[derive(Debug, Clone)]
pub struct Split {
    /// The schedule; its requests survive a conversion to kW and back to the last bit.
    pub incumbent: Incumbent,
    /// What the strings do under it, `(M, T)`.
    pub flows: Vec<Flow>,
    /// Bounds of every group.
    pub groups: Vec<GroupBounds>,
    /// Roll-outs used.
    pub rollouts: usize,
}

impl ControlHorizon {
    /// Splits the demand: searches, from `warm_start_w` `(M, T)` if given, and bounds what it found.
    pub fn split(&self, warm_start_w: Option<&[f64]>, effort: &Effort) -> Split {
        let found = self.find(warm_start_w, effort);
        let groups = self.bounds(&found.incumbent.schedule.request_w, &found.flows, &found.optima);
        Split { incumbent: found.incumbent, flows: found.flows, groups, rollouts: found.rollouts }
    }
}

//! The split of one horizon: search for the best schedule, then its lower bounds.

use crate::model::{ControlHorizon, Flow};
use crate::reach::GroupBounds;
use crate::search::{Effort, Incumbent, SearchResult};

/// The best schedule found, and its bounds.
#[derive(Debug, Clone)]
pub struct Split {
    /// The schedule; its requests survive a conversion to kW and back to the last bit.
    pub incumbent: Incumbent,
    /// Flows of the strings under this schedule, `(M, T)`.
    pub flows: Vec<Flow>,
    /// Bounds of every group.
    pub groups: Vec<GroupBounds>,
    /// Number of roll-outs.
    pub rollouts: usize,
}

impl ControlHorizon {
    /// Splits the demand: searches, from `warm_start_w` `(M, T)` if given, and bounds the result.
    pub fn split(&self, warm_start_w: Option<&[f64]>, effort: &Effort) -> Split {
        let SearchResult { incumbent, rollouts, flows, optima, proof } = self.find(warm_start_w, effort);
        let groups = self.bounds(&incumbent.schedule.request_w, &flows, &optima, proof);
        Split { incumbent, flows, groups, rollouts }
    }
}

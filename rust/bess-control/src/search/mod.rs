//! The search for a good schedule: starts, and descents by local moves over incremental roll-outs.

mod descent;
mod greedy;
mod incremental_rollout;
mod incumbent;
mod iterated_local_search;
mod moves;
mod multistart;
mod perturbation;

pub use incumbent::{Incumbent, Schedule};
pub use multistart::{Effort, Split};

//! Bounds of every schedule: reachable states, bounds of the heat, step cuts, and the states of schedules
//! that cost no more than a known one.

mod bound_tightening;
mod cell;
mod certificate;
mod node;
mod planes;
mod priced;
mod reachable;
mod relaxed;
mod step_bounds;

pub use bound_tightening::TightenedBounds;
pub use cell::Cell;
pub use certificate::GroupBounds;
pub(crate) use certificate::Proof;
pub use node::Node;
pub(crate) use planes::Planes;
pub use relaxed::LossUnits;
pub(crate) use step_bounds::step_bound;
pub use step_bounds::{StepBound, StepBounds};

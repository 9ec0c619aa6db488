//! What every schedule must respect: states that can be reached, bounds of the heat, cuts of a step, and the states
//! that no worse schedule can leave.

mod certificate;
mod confine;
mod planes;
mod reachable;
mod step_bounds;

pub use certificate::GroupBounds;
pub use confine::Confined;
pub use planes::Planes;
pub(crate) use step_bounds::step_bound;
pub use step_bounds::{StepBound, StepBounds};

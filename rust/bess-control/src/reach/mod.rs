//! What every schedule must respect: states that can be reached, bounds of the heat, cuts of a step, and the states
//! that no worse schedule can leave.

mod cell;
mod certificate;
mod confine;
mod node;
mod planes;
mod reachable;
mod relaxed;
mod step_bounds;

pub use cell::Cell;
pub use certificate::GroupBounds;
pub use confine::Confined;
pub use node::{NarrowNode, Node};
pub use planes::Planes;
pub use relaxed::{LossUnits, NAMES as RELAXED_NAMES};
pub(crate) use step_bounds::step_bound;
pub use step_bounds::{StepBound, StepBounds};

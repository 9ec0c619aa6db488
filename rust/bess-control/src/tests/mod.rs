//! Claims about the control model and its bounds, with the helpers of all tests.

mod bounds;
pub(crate) mod common;
mod control;

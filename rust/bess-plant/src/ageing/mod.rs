//! Ageing of strings: what a cell loses by standing and by cycling, and what its resistance gains.
//!
//! A model is one file in `models/` and one line in [`models::MODELS`]: power laws `y = k x^p` of days or of
//! equivalent full cycles, whose rates `k` depend on how the string stands or cycles (`law`). Cycles are counted
//! by rainflow as they happen ([`Rainflow`]); a range that is still open counts as the half cycle that it is so
//! far. Capacity and resistance in force change once in a block of at least 15 minutes, between two
//! control steps.
//!
//! [`StringAgeing`] advances an [`AgeingState`] by one control step after the other; the plant reads its [`Loss`].

mod graphite;
mod law;
pub mod models;
mod rainflow;
mod state;
mod string;

pub use law::{Cycle, Knee, Law, Model, Standing};
pub use rainflow::{Counted, Rainflow};
pub use state::{AgeingState, Loss};
pub use string::StringAgeing;

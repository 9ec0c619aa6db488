//! Ageing of strings: calendar and cycle ageing of capacity and resistance.
//!
//! A model is one file in `models/` and one line in [`models::MODELS`]: power laws `y = k x^p` of days or of equivalent full
//! cycles, whose rates `k` depend on the calendar or cycle conditions (`law`). Cycles are counted online by rainflow
//! ([`Rainflow`]); an open range counts as a half cycle of its present depth. Capacity and resistance are updated once in a block
//! of at least 15 minutes, between two control steps.
//!
//! [`StringAgeing`] advances an [`AgeingState`] by one control step after the other; the plant reads its [`Loss`].

mod law;
pub mod models;
mod rainflow;
mod state;
mod string;

pub use law::{CalendarConditions, Cycle, Knee, Law, Model};
pub use rainflow::{CountedCycle, Rainflow};
pub use state::{AgeingState, Loss};
pub use string::StringAgeing;

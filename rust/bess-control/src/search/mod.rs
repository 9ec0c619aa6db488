//! Good schedules: a greedy pass, and descents by local moves over incremental roll-outs.

mod greedy;
mod moves;
mod ranking;
mod schedule;
mod walker;

pub use schedule::Schedule;

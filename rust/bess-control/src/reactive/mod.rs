//! Reactive power: how inverters share it, and what active power costs beside it.

mod power_factor;
mod share;
mod spread;

pub(crate) use power_factor::curve_at_power_factor;

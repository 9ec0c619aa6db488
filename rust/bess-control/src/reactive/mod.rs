//! Reactive power: how inverters share it (`share` which of them, `spread` among those that run), and what active power
//! costs beside it (`power_factor`); docs/equations.md, R1 to R4.

mod power_factor;
mod share;
mod spread;

pub(crate) use power_factor::curve_at_power_factor;

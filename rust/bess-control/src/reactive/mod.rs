//! Reactive power: allocation at minimum loss (`share`), and the cost of active power at a power factor (`power_factor`);
//! docs/equations.md, R1 to R4.

mod power_factor;
mod share;

pub(crate) use power_factor::curve_at_power_factor;

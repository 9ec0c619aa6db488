//! Reactive power: selection of inverters (`share`), allocation to inverters that are on (`spread`), and the
//! cost of active power at a power factor (`power_factor`); docs/equations.md, R1 to R4.

mod power_factor;
mod share;
mod spread;

pub(crate) use power_factor::curve_at_power_factor;

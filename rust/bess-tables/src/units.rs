//! Conversions of units. The crates compute in SI units, with temperatures in degC and charge in Ah.

/// Watts in a kilowatt.
pub const W_PER_KW: f64 = 1e3;
/// Joules in a kilowatt-hour.
pub const J_PER_KWH: f64 = 3.6e6;
/// Seconds in an hour: coulombs in an ampere-hour.
pub const SECONDS_PER_HOUR: f64 = 3600.0;
/// Seconds in a day.
pub const SECONDS_PER_DAY: f64 = 86_400.0;
/// Kelvin at 0 degC.
pub const ZERO_C_IN_K: f64 = 273.15;

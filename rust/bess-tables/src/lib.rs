//! Parameters and look-up tables of a battery of parallel strings.
//!
//! Plant and controller share these tables and nothing else: each has its own formulas, so that an error in
//! one shows up against the other. Everything here is checked once, at construction, and immutable after it.
//! Units are SI throughout (W, A, V, Ohm, s), temperatures in degC, charge in Ah; cell values have become
//! string values.

mod document;
mod error;
mod grid;
mod lut;
mod parameters;

pub use error::TableError;
pub use grid::Grid;
pub use lut::{locate, Lut};
pub use parameters::{
    Ageing, CoolantLoop, Cooling, Derating, Direction, Inverter, LumpedThermal, Resistance, SpatialThermal,
    StringParameters, System,
};

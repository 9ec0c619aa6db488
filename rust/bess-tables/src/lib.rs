//! Parameters and look-up tables of a battery of parallel strings.
//!
//! Plant and controller share these tables and nothing else: each has its own formulas, so that a comparison of the two reveals
//! an error in either. Everything here is validated once, at construction, and is then immutable. Units are SI throughout (W, A,
//! V, Ohm, s), temperatures in degC, charge in Ah; cell values are converted to string values.
//!
//! [`System::from_json`] reads the description of a plant, validated in Python, and builds one [`StringParameters`] for each
//! string, with its tables ([`Lut`] over one axis, [`Grid`] over two, [`Resistance`] over the state) and its [`Cooling`].
//!
//! [`widest!`] compiles inner loops of both for the widest vectors of the processor.

mod axis;
mod cooling;
mod direction;
mod document;
mod error;
mod grid;
mod lut;
mod parameters;
mod resistance;
mod rest_voltage;
pub mod units;
mod widest;

pub use axis::Axis;
pub use cooling::{CoolantLoop, Cooling};
pub use direction::Direction;
pub use error::InputError;
pub use grid::Grid;
pub use lut::Lut;
pub use parameters::{Ageing, Derating, Inverter, LumpedThermal, SpatialThermal, StringParameters, System};
pub use resistance::Resistance;
pub use rest_voltage::RestVoltage;

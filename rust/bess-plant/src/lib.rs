//! Electro-thermal plant of a battery of parallel strings: the truth of the closed loop.
//!
//! Per plant step (10 s) and string: derating, SOC room and voltage limits, inverter loss at delivered power,
//! Rint current, heat, one step of the air-cooled one-dimensional thermal model, SOC by charge. What is not
//! delivered is reported (derating loss, availability loss) together with the limit that bound, and an energy
//! ledger says whether AC energy = chemical change + heat + inverter loss. Strings may age ([`ageing`]): between
//! control steps their capacity falls and their resistance rises. SOC stays what it is then; the charge that goes
//! with the capacity, `soc * dQ`, is reported as charge lost to ageing.
//!
//! SI units, temperatures in degC, power and current positive in discharge. Many strings, or many scenarios of
//! the same plant, are stepped side by side; nothing is allocated per plant step.

// The helpers that integration tests and benches share name the crate.
#[cfg(test)]
extern crate self as bess_plant;
#[cfg(test)]
#[path = "../tests/common/mod.rs"]
mod common;

pub mod ageing;
mod block;
mod check;
pub mod cooling;
mod electrical;
mod error;
mod lanes;
mod line;
mod measured;
mod plant;
mod record;
mod thermal;
mod totals;

pub use error::PlantError;
pub use plant::{starting_ageing, CoolingState, DeratingLaw, Plant, PlantState, Schedule};
pub use record::{Limits, Record};

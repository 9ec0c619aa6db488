//! Electro-thermal plant of a battery of parallel strings, the simulated system of the closed loop.
//!
//! Per plant step (10 s) and string: derating, SOC and voltage limits, inverter loss at delivered power, Rint current, heat, one
//! step of the air-cooled one-dimensional thermal model, SOC by charge. Undelivered power is reported (derating loss,
//! availability loss) with the active limit, and an energy balance checks that AC energy = chemical change + heat + hysteresis +
//! inverter loss. Chemical energy is a function of state, the capacity times the integral of the rest voltage over SOC. Strings
//! may age ([`ageing`]): between control steps their capacity falls and their resistance rises at constant SOC; the charge lost
//! with the capacity, `soc * dQ`, is reported.
//!
//! SI units, temperatures in degC, power and current positive in discharge. Many strings, or many scenarios of
//! the same plant, are computed together (SIMD); nothing is allocated per plant step.
//!
//! A call of [`Plant::run`] checks its requests (`plant/requests.rs`) into a `Schedule`, which every `Block` of strings
//! runs from control step to control step (`block/control_step.rs`, which also writes the [`Record`]) and, inside these, from plant
//! step to plant step (`block/step.rs`: the electrical balance of all lanes at once, `electrical.rs` for the lanes that
//! have a limit, `thermal.rs` for the heat). Where strings share a
//! coolant, `cooling/system.rs` steps the blocks in turn, with the coolant between them.

// The helpers that tests and benches share name the crate.
#[cfg(test)]
extern crate self as bess_plant;

pub mod ageing;
mod block;
mod check;
pub mod cooling;
mod electrical;
mod lanes;
mod line;
mod measured_resistance;
mod plant;
mod record;
#[cfg(test)]
mod tests;
mod thermal;

pub use block::DeratingLaw;
pub use cooling::CoolingState;
pub use plant::{starting_ageing, Plant, PlantState};
pub use record::{Limits, Record};

//! The cell models, one file each.

mod kokam_75ah;
mod naumann_lfp;
mod nmc_a_75ah;
mod schmalstieg;

use bess_tables::InputError;

use super::law::Model;
use crate::check::named;

/// All models. A new one is a file here and a line below.
pub const MODELS: [&Model; 4] =
    [&kokam_75ah::MODEL, &nmc_a_75ah::MODEL, &schmalstieg::MODEL, &naumann_lfp::MODEL];

/// The model of this name.
///
/// # Errors
///
/// No model has the name.
pub fn model(name: &str) -> Result<&'static Model, InputError> {
    named("ageing model", name, MODELS.into_iter(), |model| model.name)
}

/// Temperature to which the potentials and temperatures of two models are normed [K].
const NORM_K: f64 = 308.15;
/// Anode potential to which they are normed [V].
const NORM_V: f64 = 0.123;

/// `T / 308.15 K` and `U_a / 0.123 V`.
fn normed(temperature_k: f64, soc: f64) -> (f64, f64) {
    (temperature_k / NORM_K, super::graphite::potential_v(soc) / NORM_V)
}

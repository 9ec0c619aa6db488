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

pub(crate) fn model(name: &str) -> Result<&'static Model, InputError> {
    named("ageing model", name, &MODELS.map(|model| model.name)).map(|at| MODELS[at])
}

/// Reference temperature of two models [K].
const NORM_K: f64 = 308.15;
/// Reference anode potential of these models [V].
const NORM_V: f64 = 0.123;

/// `T / 308.15 K` and `U_a / 0.123 V`.
fn normed(temperature_k: f64, soc: f64) -> (f64, f64) {
    (temperature_k / NORM_K, potential_v(soc) / NORM_V)
}

/// Potential of a graphite anode against lithium [V] at a state of charge of the cell, after Safari and Delacourt (J. Electrochem.
/// Soc. 158 (2011) A562); its stoichiometry runs from 0.0085 to 0.78.
fn potential_v(soc: f64) -> f64 {
    let x = 0.0085 + soc * 0.7715;
    0.6379 + 0.5416 * (-305.5309 * x).exp()
        - 0.044 * ((x - 0.1958) / 0.1088).tanh()
        - 0.1978 * ((x - 1.0571) / 0.0854).tanh()
        - 0.6875 * ((x + 0.0117) / 0.0529).tanh()
        - 0.0175 * ((x - 0.5692) / 0.0875).tanh()
}

//! Naumann et al.: Sony / Murata US26650FTC1, 3 Ah LFP. Calendar: J. Energy Storage 17 (2018), doi
//! 10.1016/j.est.2018.01.019; cycling: J. Power Sources 451 (2020), doi 10.1016/j.jpowsour.2019.227666.

use crate::ageing::law::{Cycle, Law, Model, Standing};

/// [J/(mol K)], with the digits that the fit was made with.
const GAS_CONSTANT: f64 = 8.3144598;
const REFERENCE_K: f64 = 298.15;
const SECONDS_PER_DAY: f64 = 86_400.0;

pub(super) const MODEL: Model = Model {
    name: "naumann-lfp",
    about: "LFP / graphite, 3 Ah 26650; 0 to 60 degC standing, 40 degC cycling, up to 1C \
            (10.1016/j.est.2018.01.019, 10.1016/j.jpowsour.2019.227666)",
    calendar: Law { rate: calendar, exponent: 0.5 },
    cyclic: Law { rate: cyclic, exponent: 0.5 },
    calendar_resistance: Law { rate: calendar_resistance, exponent: 1.0 },
    cyclic_resistance: Law { rate: cyclic_resistance, exponent: 1.0 },
    knee: None,
};

fn arrhenius(energy_j_mol: f64, temperature_k: f64) -> f64 {
    (-energy_j_mol / GAS_CONSTANT * (1.0 / temperature_k - 1.0 / REFERENCE_K)).exp()
}

fn calendar(s: &Standing) -> f64 {
    let offset = s.soc - 0.5;
    let of_soc = 2.8575 * offset * offset * offset + 0.60225;
    1.2571e-5 * arrhenius(17_126.0, s.temperature_k) * of_soc * SECONDS_PER_DAY.sqrt()
}

fn calendar_resistance(s: &Standing) -> f64 {
    let offset = s.soc - 0.5;
    let of_soc = -3.3903 * offset * offset + 1.5604;
    3.4194e-10 * arrhenius(71_827.0, s.temperature_k) * of_soc * SECONDS_PER_DAY
}

fn cyclic(c: &Cycle) -> f64 {
    let offset = c.depth - 0.6;
    (0.0630 * c.c_rate + 0.0971) * (4.0253 * offset * offset * offset + 1.0923) / 100.0
}

/// Negative above 1.05C, where the law floors it at 0: cycling does not lower a resistance.
fn cyclic_resistance(c: &Cycle) -> f64 {
    let offset = c.depth - 0.5;
    (-0.0020 * c.c_rate + 0.0021) * (6.8477 * offset * offset * offset + 0.9182) / 100.0
}

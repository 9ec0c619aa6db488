//! NMC 75 Ah "A": BLAST-Lite `nmc_gr_75Ah_A_2019` (doi 10.1016/j.est.2023.109042). Its exponent of cycling is near
//! 1, so its marginal wear hardly depends on past ageing. No resistance increase was published.

use crate::ageing::law::{CalendarConditions, Cycle, Law, Model};

/// The fit changes its sign below this depth.
const SHALLOWEST: f64 = 0.2;

pub(super) const MODEL: Model = Model {
    name: "nmc-a-75ah",
    about: "NMC / graphite, 75 Ah pouch; 10 to 45 degC, depth 0.8 to 1, up to 2C (10.1016/j.est.2023.109042)",
    calendar: Law { rate: calendar, exponent: 0.578 },
    cyclic: Law { rate: cyclic, exponent: 1.11 },
    calendar_resistance: Law::NONE,
    cyclic_resistance: Law::NONE,
    knee: None,
};

fn calendar(s: &CalendarConditions) -> f64 {
    let (t, u) = super::normed(s.temperature_k, s.soc);
    // (t / 1000)^0.578, in days.
    8.71e-7 * (10.0 * t * t * t / u.cbrt()).exp() * 1e3f64.powf(-0.578)
}

fn cyclic(c: &Cycle) -> f64 {
    let (t, depth) = (c.temperature_k / super::NORM_K, c.depth.max(SHALLOWEST));
    let (root_depth, root_c) = (depth.sqrt(), c.c_rate.sqrt());
    let rate = 0.0267 + 1.64 * t * t * t * root_depth + 0.011 * (c.c_rate * c.c_rate / t.sqrt()).exp()
        - 0.44 * (root_depth * t * t * root_c).exp();
    // (EFC / 1e4)^1.11.
    rate.abs() * 1e4f64.powf(-1.11)
}

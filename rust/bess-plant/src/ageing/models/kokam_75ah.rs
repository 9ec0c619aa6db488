//! Kokam 75 Ah: capacity after BLAST-Lite `nmc111_gr_Kokam75Ah_2017` (Smith et al., ACC 2017, IEEE 7963578). Its resistance grows
//! with `t^1.25` and triples in ten years at 25 degC, so the resistance is that of `schmalstieg`, with the cycling share at 0.29:
//! the factor at which that model loses 20 % in the 4,600 full cycles that are quoted for large NMC111 cells.

use super::schmalstieg;
use crate::ageing::law::{CalendarConditions, Cycle, Knee, Law, Model};

const CYCLING_SHARE: f64 = 0.29;

pub(super) const MODEL: Model = Model {
    name: "kokam-75ah",
    about: "NMC111 / graphite, 75 Ah pouch; 0 to 45 degC, depth 0.8 to 1, up to 1C (IEEE 7963578)",
    calendar: Law { rate: calendar, exponent: 0.357 },
    cyclic: Law { rate: cyclic, exponent: 0.778 },
    calendar_resistance: schmalstieg::MODEL.calendar_resistance,
    cyclic_resistance: Law {
        rate: |cycle| CYCLING_SHARE * schmalstieg::cyclic_resistance(cycle),
        exponent: 1.0,
    },
    knee: Some(Knee { rate: site_exposure, capacity: capacity_of_sites }),
};

fn calendar(s: &CalendarConditions) -> f64 {
    let (t, u) = super::normed(s.temperature_k, s.soc);
    2.66e7 * ((-17.8 - 5.21 * u) / t).exp()
}

fn cyclic(c: &Cycle) -> f64 {
    let t = c.temperature_k / super::NORM_K;
    3.80e3 * (-18.4 / t + 1.04 * (c.depth * c.depth).exp()).exp()
}

/// `1 / q5`. Outside the measured range `q5` is kept at a tenth of its largest value or above.
fn site_exposure(c: &Cycle) -> f64 {
    let q5 = 1e4 + 153.0 * (c.temperature_k - 328.15) * c.depth * (c.soc / 0.6);
    1.0 / q5.clamp(1e3, 1e4)
}

fn capacity_of_sites(exposure: f64) -> f64 {
    // The fit begins at 1.01; a fresh cell has 1.
    (1.01 - 2.0 * (0.5 - 1.0 / (1.0 + exposure.powi(10).exp()))).min(1.0)
}

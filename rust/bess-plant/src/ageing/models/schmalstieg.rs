//! Schmalstieg et al., J. Power Sources 257 (2014) 325, doi 10.1016/j.jpowsour.2014.02.012: Sanyo UR18650E,
//! 2.15 Ah. Cycling was measured at 35 degC and 1C only and depends on neither. Voltages are those of the string's
//! own open-circuit table.

use crate::ageing::law::{CalendarConditions, Cycle, Law, Model};

/// Charge [Ah] that one equivalent full cycle moves through a cell of 2.15 Ah.
const AH_PER_CYCLE: f64 = 2.0 * 2.15;

pub(super) const MODEL: Model = Model {
    name: "schmalstieg",
    about:
        "NMC111 / graphite, 2.15 Ah 18650; cycling at 35 degC and 1C only (10.1016/j.jpowsour.2014.02.012)",
    calendar: Law { rate: calendar, exponent: 0.75 },
    cyclic: Law { rate: cyclic, exponent: 0.5 },
    calendar_resistance: Law { rate: calendar_resistance, exponent: 0.75 },
    cyclic_resistance: Law { rate: cyclic_resistance, exponent: 1.0 },
    knee: None,
};

fn calendar(s: &CalendarConditions) -> f64 {
    (7.543 * s.cell_v - 23.75) * 1e6 * (-6976.0 / s.temperature_k).exp()
}

fn calendar_resistance(s: &CalendarConditions) -> f64 {
    (5.270 * s.cell_v - 16.32) * 1e5 * (-5986.0 / s.temperature_k).exp()
}

fn cyclic(c: &Cycle) -> f64 {
    let offset_v = c.cell_v - 3.667;
    (7.348e-3 * offset_v * offset_v + 7.600e-4 + 4.081e-3 * c.depth) * AH_PER_CYCLE.sqrt()
}

pub(super) fn cyclic_resistance(c: &Cycle) -> f64 {
    let offset_v = c.cell_v - 3.725;
    (2.153e-4 * offset_v * offset_v - 1.521e-5 + 2.798e-4 * c.depth) * AH_PER_CYCLE
}

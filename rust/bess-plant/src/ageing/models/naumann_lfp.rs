//! Naumann et al.: Sony / Murata US26650FTC1, 3 Ah LFP. Calendar: J. Energy Storage 17 (2018), doi
//! 10.1016/j.est.2018.01.019; cycling: J. Power Sources 451 (2020), doi 10.1016/j.jpowsour.2019.227666.

use bess_tables::units::SECONDS_PER_DAY;

use crate::ageing::law::{CalendarConditions, Cycle, Law, Model};

/// [J/(mol K)], with the digits that the fit was made with.
const GAS_CONSTANT: f64 = 8.3144598;
const REFERENCE_K: f64 = 298.15;

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

fn calendar(s: &CalendarConditions) -> f64 {
    let offset = s.soc - 0.5;
    let of_soc = 2.8575 * offset * offset * offset + 0.60225;
    1.2571e-5 * arrhenius(17_126.0, s.temperature_k) * of_soc * SECONDS_PER_DAY.sqrt()
}

fn calendar_resistance(s: &CalendarConditions) -> f64 {
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Against SimSES 2.1.1's own classes. In an environment with
    /// `pip install numpy pandas` and `pip install --no-deps --ignore-requires-python simses==2.1.1`:
    ///
    /// ```python
    /// import simses.battery
    /// from types import SimpleNamespace as S
    /// from simses.degradation.cycle_detector import HalfCycle
    /// from simses.model.degradation.sony_lfp_calendar import SonyLFPCalendarDegradation as Cal
    /// from simses.model.degradation.sony_lfp_cyclic import SonyLFPCyclicDegradation as Cyc
    /// cal, cyc, q, r, qc, rc = Cal(), Cyc(), 0.0, 0.0, 0.0, 0.0
    /// for i in range(2000):
    ///     s = S(soc=(i * 0.37) % 1.0, T=5.0 + (i * 7.3) % 50.0)
    ///     q += cal.update_capacity(s, 86400.0, q); r += cal.update_resistance(s, 86400.0)
    ///     d = (i * 0.61) % 1.0
    ///     h = HalfCycle(d, 0.5, (i * 0.29) % 1.0, d / 2.0)
    ///     qc += cyc.update_capacity(s, h, qc); rc += cyc.update_resistance(s, h)
    /// print(repr((q, r, qc, rc)))
    /// ```
    #[test]
    fn losses_are_those_of_simses_for_the_same_days_and_half_cycles() {
        let golden = [0.12369112327498012, 0.2457369147830469, 0.03218645516400389, 0.005896610462216117];
        let mut damage = [0.0; 4];
        for i in (0..2000).map(f64::from) {
            let temperature_k = 5.0 + (i * 7.3) % 50.0 + 273.15;
            let standing = CalendarConditions { soc: (i * 0.37) % 1.0, temperature_k, cell_v: f64::NAN };
            let depth = (i * 0.61) % 1.0;
            let cycle = Cycle { depth, soc: 0.5, c_rate: (i * 0.29) % 1.0, temperature_k, cell_v: f64::NAN };
            damage[0] += MODEL.calendar.damage(&standing, 1.0);
            damage[1] += MODEL.calendar_resistance.damage(&standing, 1.0);
            damage[2] += MODEL.cyclic.damage(&cycle, depth / 2.0);
            damage[3] += MODEL.cyclic_resistance.damage(&cycle, depth / 2.0);
        }
        let losses = [
            MODEL.calendar.loss(damage[0]),
            MODEL.calendar_resistance.loss(damage[1]),
            MODEL.cyclic.loss(damage[2]),
            MODEL.cyclic_resistance.loss(damage[3]),
        ];
        for (ours, theirs) in losses.into_iter().zip(golden) {
            assert!((ours / theirs - 1.0).abs() < 1e-9, "{ours} {theirs}");
        }
    }

    #[test]
    fn fast_cycles_do_not_lower_the_resistance() {
        let fast = Cycle { depth: 0.8, soc: 0.5, c_rate: 1.5, temperature_k: 298.15, cell_v: f64::NAN };
        assert!(cyclic_resistance(&fast) < 0.0);
        assert_eq!(MODEL.cyclic_resistance.damage(&fast, 1.0), 0.0);
    }
}

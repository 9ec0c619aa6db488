//! The reference system at string level, and problems on it.
#![allow(dead_code, missing_docs)]

use bess_control::{ControlHorizon, ControlModel, SplitProblem};
use bess_tables::System;

pub const NOMINAL_W: f64 = 92e3;
pub const DT_H: f64 = 0.25;

pub fn reference(n_strings: usize) -> System {
    let string = include_str!("../../../reference_string.json");
    System::from_json(&format!(r#"{{"strings": [{}]}}"#, vec![string; n_strings].join(","))).unwrap()
}

/// Pseudo-random number in `[0, 1)` from a seed.
pub fn uniform(seed: u64) -> f64 {
    let mut x = seed.wrapping_add(0x9E37_79B9_7F4A_7C15);
    x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((x ^ (x >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

/// Case 1 with weights of 1, a demand of both signs, and slightly different states of the strings.
pub fn horizon(system: &System, n_steps: usize, soc: f64) -> ControlHorizon {
    let n_strings = system.strings.len();
    let model = ControlModel::new(system);
    let total = NOMINAL_W * n_strings as f64;
    let demand: Vec<f64> =
        (0..n_steps).map(|t| 0.9 * total * (2.0 * uniform(1000 + t as u64) - 1.0)).collect();
    let (inverter, battery) = model.nominal_losses_w();
    let n = (n_strings * n_steps) as f64;
    let mut costs = Vec::new();
    for group in 0..2 {
        for m in 0..n_strings {
            let own = [1.0 / NOMINAL_W, 1.0 / NOMINAL_W, 1.0 / inverter[m], 1.0 / battery[m]];
            let counts = |loss: usize| if (loss == 0) == (group == 0) { own[loss] / n } else { 0.0 };
            costs.extend((0..4).map(counts));
        }
    }
    let problem = SplitProblem {
        soc: &(0..n_strings).map(|m| soc + 0.01 * uniform(m as u64)).collect::<Vec<_>>(),
        temperature_c: &(0..n_strings).map(|m| 25.0 + 5.0 * uniform(m as u64)).collect::<Vec<_>>(),
        demand_w: &demand,
        ambient_c: &vec![25.0; n_steps],
        dt_h: DT_H,
        limit_w: &vec![NOMINAL_W; n_strings * n_steps],
        costs: &costs,
        search_costs: &costs,
        tolerance_abs: &[1e-6, 1e-6],
        tolerance_rel: &[1e-4, 1e-4],
    };
    ControlHorizon::new(model, &problem).unwrap()
}

/// Identical strings, each half full with a limit of 92 kW and one objective.
pub fn one_objective(n_strings: usize, demand_w: &[f64]) -> ControlHorizon {
    let costs = vec![1e-5; n_strings * 4];
    let problem = SplitProblem {
        soc: &vec![0.5; n_strings],
        temperature_c: &vec![25.0; n_strings],
        demand_w,
        ambient_c: &vec![25.0; demand_w.len()],
        dt_h: DT_H,
        limit_w: &vec![NOMINAL_W; n_strings * demand_w.len()],
        costs: &costs,
        search_costs: &costs,
        tolerance_abs: &[1e-6],
        tolerance_rel: &[1e-4],
    };
    ControlHorizon::new(ControlModel::new(&reference(n_strings)), &problem).unwrap()
}

//! The reference system at string level, and problems on it.
#![allow(dead_code, missing_docs)]

use bess_control::{ControlHorizon, ControlModel, SplitProblem};
use bess_tables::System;
use serde_json::json;

pub const NOMINAL_W: f64 = 92e3;
pub const DT_H: f64 = 0.25;

pub fn reference(n_strings: usize) -> System {
    let string = json!({
        "battery": {
            "cells_series": 192, "cells_parallel": 4, "cell_capacity_ah": 94.0, "cell_mass_kg": 2.1,
            "soc_min": 0.0, "soc_max": 1.0, "low_soc_switch": 0.1, "r_scale": 1.0,
            "ocv_v": {
                "soc": [0.0, 0.025, 0.05, 0.075, 0.10, 0.15, 0.20, 0.30, 0.40, 0.50, 0.60, 0.70, 0.80, 0.90, 1.0],
                "temperature_c": [25.0],
                "charge": [[3.258, 3.393, 3.458, 3.486, 3.504, 3.534, 3.561, 3.612, 3.657, 3.702, 3.755, 3.826,
                    3.919, 4.028, 4.135]],
                "discharge": [[3.218, 3.356, 3.424, 3.455, 3.476, 3.512, 3.545, 3.596, 3.641, 3.686, 3.739, 3.810,
                    3.903, 4.012, 4.119]],
            },
            "resistance_temperature": {
                "temperature_c": [25.0, 30.0, 35.0, 40.0, 45.0, 50.0, 55.0, 60.0, 70.0, 80.0],
                "resistance_mohm": [2.5, 2.201, 1.945, 1.726, 1.538, 1.375, 1.233, 1.110, 0.907, 0.75],
            },
            "resistance_soc": { "soc": [0.0, 0.02, 0.05, 0.10], "resistance_mohm": [40.0, 22.97, 10.0, 2.5] },
        },
        "inverter": {
            "nominal_kw": NOMINAL_W / 1e3,
            "load": [0.0, 0.05, 0.10, 0.20, 0.30, 0.40, 0.50, 0.60, 0.75, 0.90, 1.0],
            "loss_charge": [0.0120, 0.01221, 0.01243, 0.01293, 0.01350, 0.01413, 0.01482, 0.01559, 0.01686, 0.01827,
                0.0193],
            "loss_discharge": [0.0110, 0.01119, 0.01140, 0.01186, 0.01238, 0.01296, 0.01360, 0.01430, 0.01546,
                0.01676, 0.0177],
            "off_loss": 0.0, "min_power_kw": 0.001,
        },
        "derating": {
            "start_c": 45.0, "stop_c": 60.0, "kp_per_k": 0.035, "ki_per_k_step": 0.0035,
            "temperature_c": [45.0, 46.0, 47.0, 48.0, 49.0, 50.0, 52.0, 54.0, 56.0, 58.0, 60.0],
            "factor": [1.0, 0.963, 0.922, 0.876, 0.826, 0.772, 0.652, 0.514, 0.360, 0.188, 0.0],
        },
        "thermal": {
            "spatial": {
                "packs_per_string": 8, "length_m": 1.60, "nodes": 40, "section_m2": 0.05839, "width_m": 0.96,
                "density_kg_m3": 2158.0, "specific_heat_j_kgk": 1000.0, "conductivity_w_mk": 1.0,
                "lateral_u_w_m2k": 1.9, "end_u_w_m2k": 1.9, "air_flow_kg_s": 0.033, "air_cp_j_kgk": 1006.0,
            },
            "lumped": { "k1_k_per_j": 6.20e-7, "k2_per_s": 1.386e-5 },
        },
    });
    let document = json!({ "strings": vec![string; n_strings] });
    System::from_json(&document.to_string()).unwrap()
}

/// A fixed scramble of a number into `[0, 1)`.
pub fn uniform(seed: u64) -> f64 {
    let mut x = seed.wrapping_add(0x9E37_79B9_7F4A_7C15);
    x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((x ^ (x >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

/// Case 1 with weights of 1 on a demand of both signs, strings that differ a little in their state.
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

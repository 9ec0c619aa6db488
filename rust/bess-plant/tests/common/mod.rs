//! Systems for tests and benches.
#![allow(dead_code, missing_docs)]

use bess_plant::{starting_ageing, PlantState};
use bess_tables::{Cooling, System};
use serde_json::{json, Value};

/// The reference string, in the format that the Python side writes.
pub fn reference_string() -> Value {
    json!({
        "battery": {
            "cells_series": 192, "cells_parallel": 4, "cell_capacity_ah": 94.0, "cell_mass_kg": 2.1,
            "soc_min": 0.0, "soc_max": 1.0, "low_soc_switch": 0.1, "r_scale": 1.0,
            "ocv_v": {
                "soc": [0.0, 0.025, 0.05, 0.075, 0.10, 0.15, 0.20, 0.30, 0.40, 0.50, 0.60, 0.70, 0.80, 0.90, 1.0],
                "temperature_c": [25.0],
                "charge": [[3.258, 3.393, 3.458, 3.486, 3.504, 3.534, 3.561, 3.612, 3.657, 3.702, 3.755, 3.826,
                            3.919, 4.028, 4.135]],
                "discharge": [[3.218, 3.356, 3.424, 3.455, 3.476, 3.512, 3.545, 3.596, 3.641, 3.686, 3.739, 3.810,
                               3.903, 4.012, 4.119]]
            },
            "resistance_temperature": {
                "temperature_c": [25.0, 30.0, 35.0, 40.0, 45.0, 50.0, 55.0, 60.0, 70.0, 80.0],
                "resistance_mohm": [2.5, 2.201, 1.945, 1.726, 1.538, 1.375, 1.233, 1.110, 0.907, 0.75]
            },
            "resistance_soc": {"soc": [0.0, 0.02, 0.05, 0.1], "resistance_mohm": [40.0, 22.97, 10.0, 2.5]},
            "resistance_table": null
        },
        "inverter": {
            "nominal_kw": 92.0,
            "load": [0.0, 0.05, 0.10, 0.20, 0.30, 0.40, 0.50, 0.60, 0.75, 0.90, 1.0],
            "loss_charge": [0.0120, 0.01221, 0.01243, 0.01293, 0.01350, 0.01413, 0.01482, 0.01559, 0.01686, 0.01827,
                            0.0193],
            "loss_discharge": [0.0110, 0.01119, 0.01140, 0.01186, 0.01238, 0.01296, 0.01360, 0.01430, 0.01546,
                               0.01676, 0.0177],
            "off_loss": 0.0, "min_power_kw": 0.001
        },
        "derating": {
            "start_c": 45.0, "stop_c": 60.0, "kp_per_k": 0.035, "ki_per_k_step": 0.0035,
            "temperature_c": [45.0, 46.0, 47.0, 48.0, 49.0, 50.0, 52.0, 54.0, 56.0, 58.0, 60.0],
            "factor": [1.0, 0.963, 0.922, 0.876, 0.826, 0.772, 0.652, 0.514, 0.360, 0.188, 0.0]
        },
        "thermal": {
            "spatial": {
                "packs_per_string": 8, "length_m": 1.6, "nodes": 40, "section_m2": 0.05839, "width_m": 0.96,
                "density_kg_m3": 2158.0, "specific_heat_j_kgk": 1000.0, "conductivity_w_mk": 1.0,
                "lateral_u_w_m2k": 1.9, "end_u_w_m2k": 1.9, "air_flow_kg_s": 0.033, "air_cp_j_kgk": 1006.0
            },
            "lumped": {"k1_k_per_j": 6.20e-7, "k2_per_s": 1.386e-5}
        }
    })
}

/// A plant of these strings.
pub fn system(strings: &[Value]) -> System {
    System::from_json(&json!({ "strings": strings }).to_string()).unwrap()
}

/// A plant of equal reference strings.
pub fn reference(strings: usize) -> System {
    system(&vec![reference_string(); strings])
}

/// The same, with a model of ageing.
pub fn ageing(strings: usize, model: Option<&str>) -> System {
    let mut string = reference_string();
    string["ageing"] = json!({"model": model, "calendar_share": 0.5});
    system(&vec![string; strings])
}

/// Every string of every scenario at the same SOC and temperature.
pub fn uniform_state(system: &System, scenarios: usize, soc: f64, temperature_c: f64) -> PlantState {
    let lanes = system.strings.len() * scenarios;
    let nodes = system.strings.iter().map(|s| s.spatial.nodes).max().unwrap();
    PlantState {
        soc: vec![soc; lanes],
        node_temperature_c: vec![temperature_c; lanes * nodes],
        derating_integral_k: vec![0.0; lanes],
        inverter_on: vec![false; lanes],
        ageing: starting_ageing(system, &vec![1.0; lanes], &vec![1.0; lanes]).unwrap(),
        cooling: None,
    }
}

/// Cooling of a kind as the Python side writes it, cold plates in packs of the reference string.
pub fn cooling(kind: &str) -> Cooling {
    serde_json::from_value(json!({
        "kind": kind, "flow_kg_s": 0.05, "cp_j_kgk": 3330.0, "u_w_m2k": 300.0, "density_kg_m3": 1069.5,
        "pressure_pa": 50e3, "mover_efficiency": 0.5, "start_c": 30.0, "dead_band_k": 5.0, "flow_steps": [1.0],
        "step_k": 5.0, "variable_flow": false, "supply_c": 25.0, "chill_c": 35.0, "approach_k": 5.0,
        "carnot_share": 0.4, "cop_max": 6.0, "free_cooling_w_per_w": 0.03, "loop": null
    }))
    .unwrap()
}

/// Two cycles a day at half power [kW], by 15-minute step.
pub fn two_cycles_kw(step: usize) -> f64 {
    match step % 96 {
        0..=9 => -46.0,
        12..=30 => 46.0,
        33..=53 => -46.0,
        56..=74 => 46.0,
        77..=87 => -46.0,
        _ => 0.0,
    }
}

//! Systems for tests and benches.
#![allow(dead_code, missing_docs)]

use bess_plant::{starting_ageing, PlantState};
use bess_tables::{Cooling, System};
use serde_json::{json, Value};

/// The reference string, in the format that the Python side writes.
pub fn reference_string() -> Value {
    serde_json::from_str(include_str!("../../../reference_string.json")).unwrap()
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

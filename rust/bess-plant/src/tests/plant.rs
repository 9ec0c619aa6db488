//! Claims about the plant that need many cases, or the binary alone.

use crate::tests::common;
use crate::{DeratingLaw, Limits, Plant, PlantState, Record};
use bess_tables::{Direction, System};
use proptest::prelude::*;
use serde_json::json;

const STEP_S: f64 = 10.0;
const CONTROL_S: f64 = 900.0;

/// A run of one scenario for each repetition of the strings in `state`.
fn run(system: &System, state: &PlantState, request_w: &[f64], asked_var: Option<&[f64]>) -> Record {
    let scenarios = state.soc.len() / system.strings.len();
    let mut plant = Plant::new(system, scenarios, STEP_S, DeratingLaw::Table, state).unwrap();
    let steps = request_w.len() / plant.lanes();
    plant.run(request_w, asked_var, &vec![25.0; steps * scenarios], CONTROL_S, true).unwrap()
}

fn spread_state(system: &System, soc: &[f64], temperature_c: &[f64]) -> PlantState {
    let mut state = common::uniform_state(system, 1, 0.5, 25.0);
    let nodes = state.node_temperature_c.len() / soc.len();
    state.soc.copy_from_slice(soc);
    for (own, &value) in state.node_temperature_c.chunks_mut(nodes).zip(temperature_c) {
        own.fill(value);
    }
    state
}

/// Values of one string, whatever ran beside it.
fn lane(record: &Record, id: usize) -> Vec<u64> {
    let pick =
        |values: &[f64]| -> Vec<u64> { values.chunks(record.lanes).map(|step| step[id].to_bits()).collect() };
    [&record.delivered_w, &record.soc, &record.temperature_c, &record.current_a, &record.inverter_loss_w]
        .iter()
        .flat_map(|values| pick(values))
        .collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn with_reactive_power_the_ledger_closes_and_no_inverter_is_overloaded(
        soc in prop::collection::vec(0.0..=1.0, 5),
        temperature_c in prop::collection::vec(-10.0..62.0, 5),
        request in prop::collection::vec(-92e3..=92e3, 15),
        idle in prop::collection::vec(any::<bool>(), 15),
        asked in prop::collection::vec(-92e3..=92e3, 15),
    ) {
        let system = common::reference(5);
        let request: Vec<f64> = request.iter().zip(idle).map(|(&p, idle)| if idle { 0.0 } else { p }).collect();
        let state = spread_state(&system, &soc, &temperature_c);
        let record = run(&system, &state, &request, Some(&asked));
        for (at, (&asked_w, &asked_var)) in request.iter().zip(&asked).enumerate() {
            let (shed_w, derated_w) = (record.availability_loss_w[at], record.derating_loss_w[at]);
            let (delivered_w, carried_var) = (record.delivered_w[at], record.reactive_var[at]);
            prop_assert!((delivered_w.abs() + shed_w + derated_w - asked_w.abs()).abs() < 1e-7);
            prop_assert!(delivered_w.hypot(carried_var) <= 92e3 * (1.0 + 1e-12));
            prop_assert!(carried_var * asked_var >= 0.0 && carried_var.abs() <= asked_var.abs() * (1.0 + 1e-12));
            // In full, if the active request leaves enough apparent power.
            if asked_w.hypot(asked_var) <= 92e3 {
                prop_assert!((carried_var - asked_var).abs() <= 1e-6);
            }
            prop_assert!((0.0..=1.0).contains(&record.soc[at]));
            prop_assert!(record.ledger_residual_j[at].abs() < 1e-4);
            prop_assert!(record.standby_w[at] <= record.inverter_loss_w[at]);
        }
    }

    #[test]
    fn nothing_is_shed_silently_and_the_ledger_closes(
        soc in prop::collection::vec(0.0..=1.0, 5),
        temperature_c in prop::collection::vec(-10.0..62.0, 5),
        // Some are below the minimum power of an inverter, which stays off.
        request in prop::collection::vec(prop_oneof![9 => -92e3..=92e3, 1 => -2.0..=2.0], 15),
    ) {
        let system = common::reference(5);
        let record = run(&system, &spread_state(&system, &soc, &temperature_c), &request, None);
        for (at, &asked_w) in request.iter().enumerate() {
            let (shed_w, derated_w) = (record.availability_loss_w[at], record.derating_loss_w[at]);
            prop_assert!(shed_w >= 0.0 && derated_w >= 0.0);
            prop_assert!(record.inverter_loss_w[at] >= 0.0 && record.battery_loss_w[at] >= 0.0);
            prop_assert!(record.hysteresis_loss_w[at] >= 0.0);
            prop_assert!((record.delivered_w[at].abs() + shed_w + derated_w - asked_w.abs()).abs() < 1e-7);
            prop_assert!((0.0..=1.0).contains(&record.soc[at]));
            prop_assert!(record.ledger_residual_j[at].abs() < 1e-4);
            prop_assert!((shed_w <= 1e-6 && derated_w <= 1e-6) || record.limits[at] != Limits::NONE);
        }
    }

    #[test]
    fn results_of_a_string_do_not_depend_on_the_number_of_strings(
        soc in prop::collection::vec(0.0..=1.0, 11),
        temperature_c in prop::collection::vec(10.0..60.0, 11),
        request in prop::collection::vec(-92e3..=92e3, 22),
    ) {
        let system = common::reference(11);
        let together = run(&system, &spread_state(&system, &soc, &temperature_c), &request, None);
        let one = common::reference(1);
        for id in 0..11 {
            let own: Vec<f64> = request.chunks(11).map(|step| step[id]).collect();
            let alone = run(&one, &spread_state(&one, &soc[id..=id], &temperature_c[id..=id]), &own, None);
            prop_assert_eq!(lane(&together, id), lane(&alone, 0));
        }
    }

    #[test]
    fn scenarios_are_independent(request in prop::collection::vec(-92e3..=92e3, 12)) {
        let system = common::reference(2);
        let fleet = run(&system, &common::uniform_state(&system, 3, 0.5, 40.0), &request, None);
        for scenario in 0..3 {
            let own: Vec<f64> =
                request.chunks(6).flat_map(|step| step[2 * scenario..2 * scenario + 2].to_vec()).collect();
            let alone = run(&system, &common::uniform_state(&system, 1, 0.5, 40.0), &own, None);
            for string in 0..2 {
                prop_assert_eq!(lane(&fleet, 2 * scenario + string), lane(&alone, string));
            }
        }
    }
}

#[test]
fn strings_may_have_different_numbers_of_nodes() {
    let mut coarse = common::reference_string();
    coarse["thermal"]["spatial"]["nodes"] = json!(10);
    let mixed = common::system(&[coarse.clone(), common::reference_string()]);
    let state = common::uniform_state(&mixed, 1, 0.5, 25.0);
    let record = run(&mixed, &state, &[46e3, 46e3], None);
    let own = common::system(&[coarse]);
    let alone = run(&own, &common::uniform_state(&own, 1, 0.5, 25.0), &[46e3], None);
    assert_eq!(lane(&record, 0), lane(&alone, 0));
    assert!(record.node_temperature_c[10..40].iter().all(|value| value.is_nan()));
    assert!(record.node_temperature_c[40..].iter().all(|value| value.is_finite()));
}

#[test]
fn bad_input_is_refused_and_names_place_value_and_range() {
    let system = common::reference(2);
    let state = common::uniform_state(&system, 1, 0.5, 25.0);
    let mut plant = Plant::new(&system, 1, STEP_S, DeratingLaw::Table, &state).unwrap();
    let mut refused = |request: &[f64], ambient: &[f64], duration: f64| {
        plant.run(request, None, ambient, duration, false).unwrap_err().to_string()
    };
    assert_eq!(
        refused(&[0.0, 0.0, 0.0, -95e3], &[25.0; 2], 900.0),
        "step 1, string 1: requested power -95 kW is outside [-92, 92] kW"
    );
    assert!(refused(&[f64::NAN, 0.0], &[25.0], 900.0).contains("requested power NaN kW"));
    assert!(refused(&[0.0; 3], &[25.0], 900.0).contains("request: 3 values, needs 2"));
    assert!(refused(&[0.0; 2], &[f64::INFINITY], 900.0).contains("ambient temperature inf degC"));
    assert!(refused(&[0.0; 2], &[25.0], 905.0).contains("does not divide a control step of 905 s"));

    let unstable = Plant::new(&system, 1, 2000.0, DeratingLaw::Table, &state).unwrap_err().to_string();
    let (_, largest) = unstable.split_once("use at most ").unwrap();
    let largest_s: f64 = largest.split_once(" s,").unwrap().0.parse().unwrap();
    assert!(Plant::new(&system, 1, largest_s, DeratingLaw::Table, &state).is_ok());
}

#[test]
fn losses_follow_apparent_power_and_the_battery_covers_those_of_active_power() {
    let system = common::reference(4);
    let state = common::uniform_state(&system, 1, 0.5, 25.0);
    let (p, q) = ([60e3, -60e3, 0.0, 0.0], [55e3, -55e3, 40e3, 0.0]);
    let record = run(&system, &state, &p, Some(&q));
    let inverter = &system.strings[0].inverter;
    let at = |direction, p: f64, q: f64| inverter.loss(direction).at(p.hypot(q));
    let expected = [
        at(Direction::Discharge, p[0], q[0]),
        at(Direction::Charge, p[1], q[1]),
        at(Direction::Discharge, p[2], q[2]),
        0.0,
    ];
    for (lane, loss_w) in expected.into_iter().enumerate() {
        assert!((record.inverter_loss_w[lane] - loss_w).abs() < 1e-9 * 92e3, "string {lane}");
        assert_eq!(record.delivered_w[lane], p[lane]);
        let from_grid = if p[lane] == 0.0 { loss_w } else { 0.0 };
        assert!((record.standby_w[lane] - from_grid).abs() < 1e-9 * 92e3, "string {lane}");
        let of_cells = record.battery_loss_w[lane] + record.hysteresis_loss_w[lane];
        let of_battery = p[lane] + loss_w - from_grid + of_cells;
        let drawn_w = record.chemical_w[lane] + record.ocv_shift_w[lane];
        assert!((drawn_w - of_battery).abs() < 1e-6, "string {lane}");
    }
    assert_eq!(record.current_a[2], 0.0);
    assert_eq!(record.inverter_starts, [1.0, 1.0, 1.0, 0.0]);
}

#[test]
fn empty_and_full_strings_supply_reactive_power_with_losses_from_the_grid() {
    let system = common::reference(2);
    let state = spread_state(&system, &[0.0, 1.0], &[25.0, 25.0]);
    let record = run(&system, &state, &[50e3, -50e3], Some(&[30e3, 30e3]));
    assert_eq!(record.reactive_var, [30e3, 30e3]);
    assert_eq!(record.soc, state.soc);
    // The empty string delivers nothing; the full string only takes its inverter loss.
    let loss_w = &record.inverter_loss_w;
    assert!(loss_w[0] > 1e3 && loss_w[1] > 1e3);
    assert_eq!((record.delivered_w[0], record.standby_w[0]), (0.0, loss_w[0]));
    assert!((record.delivered_w[1] + loss_w[1]).abs() < 1e-6 && record.standby_w[1] == 0.0);
}

#[test]
fn reactive_power_above_the_inverter_is_refused_with_its_place() {
    let system = common::reference(2);
    let state = common::uniform_state(&system, 1, 0.5, 25.0);
    let mut plant = Plant::new(&system, 1, STEP_S, DeratingLaw::Table, &state).unwrap();
    let mut refused =
        |asked: &[f64]| plant.run(&[0.0, 0.0], Some(asked), &[25.0], 900.0, false).unwrap_err().to_string();
    let said = refused(&[0.0, 93e3]);
    assert_eq!(said, "step 0, string 1: reactive power 93 kvar is outside [-92, 92] kvar");
    assert!(refused(&[0.0]).contains("reactive power: 1 values, needs 2"));
}

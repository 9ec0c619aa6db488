//! Claims about strings that age, beside the laws themselves.

use crate::ageing::models::MODELS;
use crate::ageing::{AgeingState, CalendarConditions, StringAgeing};
use crate::tests::common;
use crate::{DeratingLaw, Plant, PlantState, Record};
use proptest::prelude::*;

const DAYS: usize = 4;

fn requests_w(strings: usize) -> Vec<f64> {
    (0..DAYS * 96 * strings).map(|at| 1.5e3 * common::two_cycles_kw(at / strings)).collect()
}

fn plant(model: Option<&str>, state: Option<PlantState>) -> Plant {
    let system = common::ageing(2, model);
    let state = state.unwrap_or_else(|| common::uniform_state(&system, 1, 0.5, 30.0));
    Plant::new(&system, 1, 10.0, DeratingLaw::Table, &state).unwrap()
}

fn run(plant: &mut Plant, request_w: &[f64], duration_s: f64) -> Record {
    plant.run(request_w, None, &vec![25.0; request_w.len() / 2], duration_s, false).unwrap()
}

#[test]
fn every_model_ages_a_string_and_reports_all_lost_charge() {
    for model in MODELS {
        let request_w = requests_w(2);
        let record = run(&mut plant(Some(model.name), None), &request_w, 900.0);
        let nominal_ah = 376.0;
        let (mut charge_ah, mut before) = (nominal_ah * 0.5, [1.0, 1.0, 0.0, 0.0]);
        for step in 0..request_w.len() / 2 {
            let at = 2 * step;
            let now =
                [&record.soh_capacity, &record.soh_resistance, &record.calendar_loss, &record.cyclic_loss]
                    .map(|values| values[at]);
            assert!(now[0] <= before[0] + 1e-7 && now[1] >= before[1] - 1e-6, "{}: step {step}", model.name);
            assert!(now[2] >= before[2] && now[3] >= before[3] - 1e-7, "{}: step {step}", model.name);
            assert!((now[0] + now[2] + now[3] - 1.0).abs() < 1e-14);
            charge_ah -= record.current_a[at] * 0.25 + record.aged_charge_ah[at];
            assert!((charge_ah - nominal_ah * now[0] * record.soc[at]).abs() < 1e-9);
            assert!(record.ledger_residual_j[at].abs() < 1e-4);
            before = now;
        }
        assert!(before[0] < 1.0 && before[2] > 1e-5 && before[3] > 1e-5, "{}: {before:?}", model.name);
        let warm = CalendarConditions { soc: 0.5, temperature_k: 308.15, cell_v: 3.7 };
        assert_eq!(before[1] > 1.0, (model.calendar_resistance.rate)(&warm) > 0.0, "{}", model.name);
    }
}

#[test]
fn a_restored_plant_continues_bit_by_bit() {
    for model in MODELS.iter().map(|model| Some(model.name)).chain([None]) {
        let request_w = requests_w(2);
        // Steps of a minute: the state includes the sums of an unfinished block, and reversals within it.
        let whole = run(&mut plant(model, None), &request_w, 60.0);
        for cut in [1, 7, 190] {
            let mut first = plant(model, None);
            run(&mut first, &request_w[..2 * cut], 60.0);
            let mut state = first.state();
            for own in &mut state.ageing {
                *own = AgeingState::from_numbers(&own.to_numbers()).unwrap();
            }
            assert_eq!(state, first.state());
            let rest = run(&mut plant(model, Some(state)), &request_w[2 * cut..], 60.0);
            assert_eq!(rest.soh_capacity, whole.soh_capacity[2 * cut..]);
            assert_eq!(rest.soh_resistance, whole.soh_resistance[2 * cut..]);
            assert_eq!(rest.soc, whole.soc[2 * cut..]);
            assert_eq!(rest.temperature_c, whole.temperature_c[2 * cut..]);
            assert_eq!(rest.inverter_starts, whole.inverter_starts[2 * cut..]);
        }
    }
}

#[test]
fn a_string_without_ageing_model_keeps_its_initial_health() {
    let system = common::ageing(2, None);
    let mut state = common::uniform_state(&system, 1, 0.5, 30.0);
    state.ageing = bess_plant::starting_ageing(&system, &[0.8, 1.0], &[1.5, 1.0]).unwrap();
    let record = run(&mut plant(None, Some(state)), &requests_w(2), 900.0);
    assert!(record.soh_capacity.chunks(2).all(|pair| pair == [0.8, 1.0]));
    assert!(record.soh_resistance.chunks(2).all(|pair| pair == [1.5, 1.0]));
    // A quarter more SOC for the same charge, and half as much heat again for the same current.
    let (i, j) = (record.current_a[0], record.current_a[1]);
    let moved = |lane: usize, current: f64| (record.soc[lane] - 0.5) / current;
    assert!((moved(0, i) / moved(1, j) - 1.25).abs() < 1e-9);
    let heat = |lane: usize, current: f64| record.battery_loss_w[lane] / (current * current);
    assert!((heat(0, i) / heat(1, j) - 1.5).abs() < 5e-3);
}

#[test]
fn a_run_with_initial_ageing_continues_from_its_losses() {
    for model in MODELS {
        let ageing = StringAgeing::new(&common::ageing(1, Some(model.name)).strings[0]).unwrap();
        let state = ageing.starting(0.9, 1.2);
        assert!((state.loss().calendar - 0.05).abs() < 1e-15 && (state.loss().cyclic - 0.05).abs() < 1e-15);
        let system = common::ageing(2, Some(model.name));
        let mut start = common::uniform_state(&system, 1, 0.5, 30.0);
        start.ageing = bess_plant::starting_ageing(&system, &[0.9, 1.0], &[1.2, 1.0]).unwrap();
        let record = run(&mut plant(Some(model.name), Some(start)), &requests_w(2), 900.0);
        let last = record.soc.len() - 2;
        assert!(record.soh_capacity[0] <= 0.9 && record.soh_capacity[0] > 0.8999);
        assert!((record.soh_resistance[0] - 1.2).abs() < 1e-3);
        // Power laws with an exponent below 1 slow down with growing loss.
        let lost = [0.9 - record.soh_capacity[last], 1.0 - record.soh_capacity[last + 1]];
        assert!(lost[0] < lost[1], "{}: {lost:?}", model.name);
    }
}

#[test]
fn an_unknown_model_is_refused_with_the_names_that_there_are() {
    let system = common::ageing(1, Some("kokam"));
    let error = StringAgeing::new(&system.strings[0]).unwrap_err().to_string();
    assert_eq!(
        error,
        "ageing model 'kokam' is unknown; there are kokam-75ah, nmc-a-75ah, schmalstieg, naumann-lfp"
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn ageing_does_not_depend_on_other_strings(scale in 0.2..1.8f64) {
        for model in MODELS {
            let request_w: Vec<f64> =
                requests_w(2).iter().enumerate().map(|(i, w)| if i % 2 == 0 { w * scale.min(1.3) } else { w * 0.5 }).collect();
            let together = run(&mut plant(Some(model.name), None), &request_w[..96], 900.0);
            let system = common::ageing(1, Some(model.name));
            let own: Vec<f64> = request_w[..96].chunks(2).map(|pair| pair[0]).collect();
            let state = common::uniform_state(&system, 1, 0.5, 30.0);
            let mut alone = Plant::new(&system, 1, 10.0, DeratingLaw::Table, &state).unwrap();
            let alone = alone.run(&own, None, &vec![25.0; own.len()], 900.0, false).unwrap();
            let first: Vec<f64> = together.soh_capacity.chunks(2).map(|pair| pair[0]).collect();
            prop_assert_eq!(first, alone.soh_capacity);
        }
    }
}

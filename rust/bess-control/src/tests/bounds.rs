//! No schedule undercuts a bound or leaves its bounded states: random schedules near all limits.

use crate::tests::common;
use crate::{ControlHorizon, ControlModel, Effort, Losses, SplitProblem, StateBox};
use bess_tables::System;

const N_STRINGS: usize = 3;
const N_STEPS: usize = 5;
const SIZE: usize = N_STRINGS * N_STEPS;
const EFFORT: Effort = Effort { rollouts: 300, deadline: None, gap: 1e-3 };

/// A plant of strings with different inverter tables, capacities, resistances and voltage limits, near some limits of its states.
struct Case {
    horizon: ControlHorizon,
    costs: Vec<Losses>,
}

fn system() -> System {
    let mut system = common::reference(N_STRINGS);
    let (capacity, resistance) = ([1.0, 0.8, 1.1], [1.0, 1.6, 0.7]);
    system = system.aged(&capacity, &resistance).unwrap();
    let limited = &mut system.strings[1];
    (limited.voltage_min_v, limited.voltage_max_v) =
        (3.35 * limited.cells_series, 4.09 * limited.cells_series);
    system
}

fn case(corner: usize, seed: u64) -> Case {
    let at = |i: u64| common::uniform(7919 * seed + i);
    let (soc, warm) = [(0.45, 25.0), (0.0, 25.0), (0.9, 25.0), (0.45, 45.0)][corner];
    let model = ControlModel::new(&system());
    let (inverter, battery) = model.nominal_losses_w();
    let n = SIZE as f64;
    let weights = [[1.0, 1.0, 1.0], [1.0, 1.0, 0.0], [1.0, 0.0, 1.0]][(seed % 3) as usize];
    let costs: Vec<Losses> = (0..N_STRINGS)
        .map(|m| Losses {
            availability: 0.0,
            derating: weights[0] / common::NOMINAL_W / n,
            inverter: weights[1] / inverter[m] / n,
            battery: weights[2] / battery[m] / n,
        })
        .collect();
    let first = [1.0 / common::NOMINAL_W / n, 0.0, 0.0, 0.0].repeat(N_STRINGS);
    let both: Vec<f64> = first.into_iter().chain(costs.iter().flat_map(|c| c.to_array())).collect();
    let total_w = common::NOMINAL_W * N_STRINGS as f64;
    let turn = |t: u64| if seed % 2 == 0 || at(50 + t) < 0.5 { 1.0 } else { -1.0 };
    let sign = if corner == 2 { -1.0 } else { 1.0 };
    let problem = SplitProblem {
        soc: &(0..N_STRINGS as u64).map(|m| soc + 0.1 * at(m)).collect::<Vec<_>>(),
        temperature_c: &(0..N_STRINGS as u64).map(|m| warm + 9.0 * at(10 + m)).collect::<Vec<_>>(),
        demand_w: &(0..N_STEPS as u64)
            .map(|t| sign * turn(t) * (0.05 + 0.9 * at(20 + t)) * total_w)
            .collect::<Vec<_>>(),
        ambient_c: &[25.0; N_STEPS],
        dt_h: common::DT_H,
        limit_w: &[common::NOMINAL_W; SIZE],
        costs: &both,
        search_costs: &both,
        tolerance_abs: &[1e-9, 1e-9],
        tolerance_rel: &[0.0, 0.0],
    };
    Case { horizon: ControlHorizon::new(model, &problem).unwrap(), costs }
}

/// Random schedules, and schedules close to a good one.
fn schedules(horizon: &ControlHorizon, seed: u64) -> Vec<Vec<f64>> {
    let best = horizon.split(None, &EFFORT).incumbent.schedule.request_w;
    let mut out = vec![best.clone()];
    for k in 0..60 {
        let at = |i: usize| common::uniform(104_729 * seed + 1000 * k + i as u64);
        let sharp = [0.2, 1.0, 20.0][(k % 3) as usize];
        let far: Vec<f64> = (0..SIZE).map(|i| at(i).powf(sharp)).collect();
        let far = horizon.fitted(&far);
        let share = if k % 2 == 0 { 1.0 } else { 0.1 * at(SIZE) };
        let near: Vec<f64> = best.iter().zip(far).map(|(a, b)| (1.0 - share) * a + share * b).collect();
        out.push(horizon.fitted(&near));
    }
    out
}

/// Availability loss [W], second objective, and the flows of a schedule.
fn rolled(case: &Case, request_w: &[f64]) -> (f64, f64, Vec<bess_control::Flow>) {
    let flows = case.horizon.flows(request_w);
    let shed_w = flows.iter().map(|flow| flow.availability_w).sum();
    let cost = flows.iter().enumerate().map(|(i, flow)| flow.losses().cost(&case.costs[i / N_STEPS])).sum();
    (shed_w, cost, flows)
}

fn contains(states: &StateBox, soc: f64, temperature_c: f64) -> bool {
    (states.soc.low..=states.soc.high).contains(&soc)
        && (states.temperature_c.low..=states.temperature_c.high).contains(&temperature_c)
}

fn for_all_cases(check: impl Fn(&Case, &[Vec<f64>])) {
    for corner in 0..4 {
        for seed in 0..9 {
            let case = case(corner, seed);
            check(&case, &schedules(&case.horizon, seed));
        }
    }
}

#[test]
fn every_schedule_stays_in_the_reachable_states() {
    for_all_cases(|case, schedules| {
        let boxes = case.horizon.reachable();
        for request_w in schedules {
            for (i, flow) in case.horizon.flows(request_w).iter().enumerate() {
                let (m, t) = (i / N_STEPS, i % N_STEPS);
                let states = &boxes[m * (N_STEPS + 1) + t + 1];
                assert!(contains(states, flow.end.soc, flow.end.temperature_c));
            }
        }
    });
}

#[test]
fn no_schedule_is_below_the_tightened_bound_and_no_better_one_leaves_the_tightened_states() {
    for_all_cases(|case, schedules| {
        let known: Vec<_> = schedules.iter().map(|request_w| rolled(case, request_w)).collect();
        for reference in [0, 2, 7] {
            let (budget_w, cost, _) = &known[reference];
            let tightened = case.horizon.tighten(&schedules[reference], &case.costs, *budget_w).unwrap();
            assert!(tightened.bound <= *cost);
            for (shed_w, other, flows) in &known {
                if shed_w > budget_w {
                    continue;
                }
                assert!(*other >= tightened.bound, "{other} below {}", tightened.bound);
                if other > cost {
                    continue;
                }
                let may_shed = case.horizon.may_shed(&tightened.boxes);
                for (i, flow) in flows.iter().enumerate() {
                    let states = &tightened.boxes[i / N_STEPS * (N_STEPS + 1) + i % N_STEPS + 1];
                    assert!(contains(states, flow.end.soc, flow.end.temperature_c));
                    assert!(flow.availability_w <= 0.0 || may_shed[i]);
                }
            }
        }
    });
}

#[test]
fn no_step_of_a_schedule_costs_less_than_its_cut() {
    for_all_cases(|case, schedules| {
        let boxes: Vec<StateBox> =
            case.horizon.reachable().chunks(N_STEPS + 1).flat_map(|row| row[..N_STEPS].to_vec()).collect();
        for budget_w in [f64::INFINITY, 5e3, 0.0] {
            let cuts = case.horizon.step_bounds(&boxes, &case.costs, &[budget_w; N_STEPS]).unwrap();
            for request_w in schedules {
                let (_, _, flows) = rolled(case, request_w);
                for (t, cut) in cuts.bounds.iter().enumerate() {
                    let of = |i: &usize| i % N_STEPS == t;
                    let shed_w: f64 = (0..SIZE).filter(of).map(|i| flows[i].availability_w).sum();
                    let cost: f64 =
                        (0..SIZE).filter(of).map(|i| flows[i].losses().cost(&case.costs[i / N_STEPS])).sum();
                    if budget_w > 0.0 || shed_w == 0.0 {
                        let least = cut.phi - 1e-12;
                        assert!(cost + cut.shed_slope * shed_w >= least, "{cost} below {}", cut.phi);
                    }
                }
            }
        }
    });
}

#[test]
fn no_schedule_within_the_ceiling_of_the_first_group_is_below_the_bound_of_the_second() {
    for_all_cases(|case, schedules| {
        let split = case.horizon.split(None, &EFFORT);
        let ceiling = split.groups[0].ceiling;
        for request_w in schedules {
            let objectives = case.horizon.objectives(request_w);
            assert!(objectives[0] >= split.groups[0].bound);
            if objectives[0] <= ceiling {
                assert!(objectives[1] >= split.groups[1].bound);
            }
        }
    });
}

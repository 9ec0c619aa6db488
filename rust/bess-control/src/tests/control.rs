//! Properties of the control model and of the search, on random states and requests.

use crate::tests::common;
use crate::{ControlModel, Effort, Interval, Range, StateBox, StringModel, StringState};
use bess_tables::Direction;
use proptest::prelude::*;

fn string() -> StringModel {
    ControlModel::new(&common::reference(1)).strings()[0].clone()
}

fn interval(charge: bool, dt_h: f64) -> Interval {
    let direction = if charge { Direction::Charge } else { Direction::Discharge };
    Interval { direction, ambient_c: 25.0, dt_h }
}

proptest! {
    #[test]
    fn power_heat_and_loss_balance_for_any_request(
        charge: bool, soc in 0.0..=1.0, temperature_c in 0.0..65.0, request_w in 0.0..92e3, dt_h in 0.01..1.0,
    ) {
        let (string, interval) = (string(), interval(charge, dt_h));
        let state = StringState { soc, temperature_c };
        let flow = string.step(state, request_w, &interval);
        let c = string.coefficients(interval.direction, state);
        prop_assert!(flow.availability_w >= 0.0 && flow.derating_w >= 0.0);
        prop_assert!(flow.inverter_w >= 0.0 && flow.battery_w >= 0.0);
        prop_assert!((0.0..=1.0).contains(&flow.end.soc));
        let total = flow.delivered_w + flow.availability_w + flow.derating_w;
        prop_assert!((total - request_w).abs() <= 1e-9 * request_w);
        let chemical = c.voltage_v * flow.current_a;
        let balance = if charge {
            flow.delivered_w - flow.inverter_w - flow.battery_w - chemical
        } else {
            chemical - flow.delivered_w - flow.inverter_w - flow.battery_w
        };
        // At the double root of a discharge half of the digits of the current are lost.
        prop_assert!(balance.abs() <= 1e-6 * (1.0 + chemical.abs()), "balance {balance} W");
    }

    #[test]
    fn a_larger_request_never_delivers_less(
        charge: bool, soc in 0.0..=1.0, temperature_c in 0.0..65.0, request_w in 3e3..92e3, share in 0.5..1.0,
    ) {
        let (string, interval) = (string(), interval(charge, 0.25));
        let state = StringState { soc, temperature_c };
        let less = string.step(state, share * request_w, &interval);
        let more = string.step(state, request_w, &interval);
        prop_assert!(more.delivered_w >= less.delivered_w - 1e-6);
    }

    #[test]
    fn the_limit_is_the_delivered_power_at_full_request(
        charge: bool, soc in 0.0..=1.0, temperature_c in 0.0..45.0, dt_h in 0.05..4.0,
    ) {
        let (string, interval) = (string(), interval(charge, dt_h));
        let state = StringState { soc, temperature_c };
        let c = string.coefficients(interval.direction, state);
        let limit = string.deliverable_w(&c, interval.direction, soc, dt_h);
        let flow = string.step(state, 92e3, &interval);
        prop_assert!((flow.delivered_w - limit.min(92e3)).abs() < 1e-6);
    }

    #[test]
    fn ranges_of_a_point_are_the_coefficients_there(
        charge: bool, soc in prop_oneof![0.0..=1.0, Just(0.1), Just(0.05)], temperature_c in 0.0..65.0,
    ) {
        let (string, direction) = (string(), interval(charge, 0.25).direction);
        let c = string.coefficients(direction, StringState { soc, temperature_c });
        let point = StateBox { soc: Range::point(soc), temperature_c: Range::point(temperature_c) };
        let ranges = string.ranges(direction, &point);
        prop_assert_eq!(ranges.derating, Range::point(c.derating));
        prop_assert_eq!(ranges.voltage_v, Range::point(c.voltage_v));
        prop_assert_eq!(ranges.resistance_ohm, Range::point(c.resistance_ohm));
    }
}

#[test]
fn a_box_across_the_switch_sees_both_resistances() {
    let string = string();
    let states =
        StateBox { soc: Range { low: 0.05, high: 0.2 }, temperature_c: Range { low: 25.0, high: 30.0 } };
    let range = string.ranges(Direction::Discharge, &states).resistance_ohm;
    assert!((range.high - 4.0 * 0.12).abs() < 1e-12);
    assert!((range.low - 2.201 * 0.048).abs() < 1e-12);
}

#[test]
fn a_split_reports_the_objectives_of_its_schedule_and_is_no_worse_than_the_greedy_pass() {
    let effort = Effort { rollouts: 500, deadline: None, gap: 1e-3 };
    for soc in [0.03, 0.5, 0.97] {
        let horizon = common::horizon(&common::reference(2), 8, soc);
        let greedy = horizon.greedy();
        let split = horizon.split(None, &effort);
        let best = &split.incumbent.schedule;
        assert_eq!(horizon.objectives(&best.request_w), best.objectives);
        assert!(best.objectives[0] <= greedy.objectives[0] * (1.0 + 1e-4) + 1e-6);
        for (group, bounds) in split.groups.iter().enumerate() {
            assert_eq!(bounds.search_objective, best.objectives[group]);
            assert!(bounds.bound <= bounds.objective);
            assert!(bounds.search_bound <= bounds.search_objective * (1.0 + 1e-9));
        }
        // Conversion to kW and back is bit-identical.
        for request_w in &best.request_w {
            let there_and_back = request_w / 1e3 * 1e3;
            assert_eq!(there_and_back, *request_w);
        }
    }
}

#[test]
fn a_search_at_its_time_limit_returns_its_incumbent() {
    let horizon = common::horizon(&common::reference(2), 8, 0.03);
    let late = Effort { rollouts: 2000, deadline: Some(std::time::Instant::now()), gap: 1e-3 };
    let all = Effort { rollouts: 2000, deadline: None, gap: 1e-3 };
    let (late, all) = (horizon.split(None, &late), horizon.split(None, &all));
    assert!(late.rollouts < all.rollouts / 2, "{} of {} roll-outs", late.rollouts, all.rollouts);
    let greedy = horizon.greedy().objectives;
    assert!(late.incumbent.schedule.objectives[0] <= greedy[0] * (1.0 + 1e-4) + 1e-6);
}

proptest! {
    #[test]
    fn fitted_requests_meet_the_demand_within_the_limits(
        wanted in proptest::collection::vec(prop_oneof![Just(0.0), 0.0..2.0], 24),
    ) {
        let horizon = common::horizon(&common::reference(3), 8, 0.5);
        let request_w = horizon.fitted(&wanted);
        let met = horizon.magnitudes(&horizon.signed(&request_w)).unwrap();
        prop_assert_eq!(&met, &request_w);
        for t in 0..8 {
            let asked: f64 = (0..3).map(|m| request_w[m * 8 + t]).sum();
            let alone: f64 = (0..3).map(|m| wanted[m * 8 + t]).sum();
            let whole = horizon.fitted(&[0.0; 24]);
            let demand_w: f64 = (0..3).map(|m| whole[m * 8 + t]).sum();
            prop_assert!((asked - demand_w).abs() <= 1e-9 * demand_w.max(1.0), "{asked} W of {demand_w} W");
            // A string without weight runs only if the others cannot take all power.
            let idle_runs = (0..3).any(|m| alone > 0.0 && wanted[m * 8 + t] == 0.0 && request_w[m * 8 + t] > 1e-6);
            let full = (0..3).any(|m| request_w[m * 8 + t] > 0.999 * common::NOMINAL_W);
            let n_wanted = (0..3).filter(|m| wanted[m * 8 + t] > 0.0).count();
            prop_assert!(!idle_runs || full || demand_w > 0.5 * n_wanted as f64 * common::NOMINAL_W);
        }
    }
}

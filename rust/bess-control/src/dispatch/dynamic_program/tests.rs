//! Claims about the dynamic program, on a grid that is small enough to enumerate.

use bess_tables::{Axis, Lut};

use super::*;
use crate::dispatch::{DispatchBlock, StoreGrid};
use crate::model::ControlModel;
use crate::tests::common;

/// Two strings on a grid of five energies, three temperatures and `depths`, with five powers.
fn store(depths: &[f64]) -> Store {
    let system = common::reference(2);
    let model = ControlModel::new(&system);
    let soc: Vec<f64> = (0..5).map(|e| 0.25 * e as f64).collect();
    let full_kwh = 130.0;
    let grid = StoreGrid {
        energy_kwh: Axis::ascending(soc.iter().map(|soc| 2.0 * full_kwh * soc).collect()),
        temperature_c: Axis::ascending(vec![20.0, 40.0, 50.0]),
        depth: Axis::ascending(depths.to_vec()),
        soc: soc.iter().flat_map(|&soc| [soc, soc]).collect(),
        power_kw: vec![-160.0, -80.0, 0.0, 80.0, 160.0],
        request_w: [-80e3, -40e3, 0.0, 40e3, 80e3].iter().flat_map(|&w| [w, w]).collect(),
        energies: vec![Lut::new("energy", vec![0.0, 1.0], vec![0.0, full_kwh]).unwrap(); 2],
        mass_share: vec![0.5; 2],
        off_kw: vec![0.01; 2],
        capacity_kwh: 2.0 * full_kwh,
        dt_h: 0.5,
        parts: 3,
        ambient_c: 25.0,
        cooling_per_h: 0.05,
        by_throughput: false,
    };
    Store::new(model, grid).unwrap()
}

/// Four blocks of two lengths on two days, with `levels` of price.
fn problem(levels: usize) -> DispatchProblem {
    let block = |steps, period, is_new| DispatchBlock { steps, period, ambient_c: 28.0, is_new };
    let blocks = vec![block(1, 0, true), block(1, 0, false), block(2, 0, true), block(1, 1, true)];
    let price = |b: usize, l: usize| [0.05, 0.05, 0.30, 0.12][b] * (1.0 + 0.5 * l as f64);
    let income = |b: usize, l: usize| [price(b, l) - 0.01, -price(b, l) - 0.005, -price(b, l), -1e-5];
    let all = (0..blocks.len()).flat_map(|b| (0..=levels).map(move |l| (b, l)));
    // A price stays at its level with 0.7 or, if there is one level only, for certain.
    let other = 0.3 * (levels - 1) as f64;
    DispatchProblem {
        income_eur: all.map(|(b, l)| income(b, l)).collect(),
        share: vec![1.0 / levels as f64; levels * blocks.len()],
        chance: (0..levels * levels)
            .map(|i| if i % (levels + 1) == 0 { 1.0 - other } else { other })
            .collect(),
        wear_eur: Lut::new("wear", vec![0.0, 0.5, 2.0], vec![0.0, 2.0, 20.0]).unwrap(),
        end_eur_kwh: 0.08,
        allowed_kwh: vec![150.0, 60.0],
        shadow_prices_eur_kwh: vec![0.0, 0.05],
        start: StoreState { energy_kwh: 100.0, temperature_c: 30.0, depth: 0.2 },
        blocks,
    }
}

/// Value of a state at a level and a shadow price before block `b`, by enumeration of all power sequences.
fn enumerated(program: &DynamicProgram<'_>, b: usize, [d, t, e]: [usize; 3], l: usize, s: usize) -> f64 {
    let (grid, problem) = (&program.store.grid, program.problem);
    let Some(block) = problem.blocks.get(b) else { return problem.end_eur_kwh * grid.energy_kwh[e] };
    let transitions = program.transitions(b);
    let after = |place: [usize; 3], shadow: usize| -> f64 {
        let Some(next) = problem.blocks.get(b + 1) else {
            return enumerated(program, b + 1, place, l, shadow);
        };
        let at = |level: usize, s: usize| enumerated(program, b + 1, place, level, s);
        let dual = |level: usize| {
            if next.period == block.period {
                return at(level, shadow);
            }
            let bound = |s: usize| at(level, s) + program.shadow_eur[s] * program.allowed_kwh[next.period];
            (0..program.shadow_eur.len()).map(bound).fold(f64::INFINITY, f64::min)
        };
        if next.is_new && program.levels > 1 {
            (0..program.levels).map(|to| problem.chance[l * program.levels + to] * dual(to)).sum()
        } else {
            dual(l)
        }
    };
    let value = |p: usize| {
        let flows = &transitions.flows[(t * grid.power_kw.len() + p) * grid.energy_kwh.len() + e];
        let settled = grid.settle(flows, grid.energy_kwh[e], grid.depth[d], transitions.hours);
        let (low, energy) = grid.energy_kwh.locate(settled.after.energy_kwh);
        let (cool, warm) = grid.temperature_c.locate(settled.after.temperature_c);
        let (shallow, deep) = grid.depth.locate(settled.after.depth);
        let mut value = income_of(&settled.amounts, program.income(b, l))
            - problem.wear_eur(grid.depth[d], settled.drawn)
            - settled.cycled_kwh * program.shadow_eur[s];
        for (depth, of_depth) in [(shallow, 1.0 - deep), (shallow + 1, deep)] {
            for (node, of_node) in [(cool, 1.0 - warm), (cool + 1, warm)] {
                // The block ends in its own ambient temperature.
                let (cold, hot) =
                    grid.temperature_c.locate(grid.temperature_c[node] + program.ambient_shift_k(b));
                for (node, of_ambient) in [(cold, 1.0 - hot), (cold + 1, hot)] {
                    for (energy, of_energy) in [(low, 1.0 - energy), (low + 1, energy)] {
                        let weight = of_depth * of_node * of_ambient * of_energy;
                        if weight > 0.0 {
                            value += weight * after([depth, node, energy], s);
                        }
                    }
                }
            }
        }
        value
    };
    (0..grid.power_kw.len()).map(value).fold(f64::NEG_INFINITY, f64::max)
}

#[test]
fn values_equal_those_of_enumerated_schedules() {
    for (depths, levels, ladder) in
        [(vec![0.0], 1, 1), (vec![0.0, 0.5, 1.0], 1, 1), (vec![0.0, 1.0], 2, 1), (vec![0.0], 2, 2)]
    {
        let (mut store, problem) = (store(&depths), problem(levels));
        store.dispatch(&problem).unwrap();
        let shadow_eur = &problem.shadow_prices_eur_kwh[..ladder];
        let mut program = DynamicProgram::new(&store, &problem, levels, shadow_eur, &problem.allowed_kwh);
        program.reachable_rows = vec![0..3; problem.blocks.len() + 1];
        let values = program.value_function();
        // Later blocks are enumerated with the first one.
        for d in 0..depths.len() {
            for (t, e) in (0..3).flat_map(|t| (0..5).map(move |e| (t, e))) {
                if (d + t + e) % 5 == 0 {
                    let (l, s) = (levels - 1, ladder - 1);
                    let found = values[(((l * ladder + s) * depths.len() + d) * 3 + t) * 5 + e];
                    let best = enumerated(&program, 0, [d, t, e], l, s);
                    assert!((found - best).abs() < 1e-9, "{d} {t} {e}: {found}, {best}");
                }
            }
        }
    }
}

#[test]
fn unreachable_temperatures_do_not_change_the_powers() {
    let starts = [(18.0, 1, 1), (30.0, 2, 1), (44.0, 1, 2), (70.0, 1, 1)];
    for ((temperature_c, levels, ladder), ambient_c) in
        starts.into_iter().flat_map(|s| [(s, 28.0), (s, 25.0)])
    {
        let (mut store, mut problem) = (store(&[0.0, 1.0]), problem(levels));
        problem.start.temperature_c = temperature_c;
        problem.blocks.iter_mut().for_each(|block| block.ambient_c = ambient_c);
        store.dispatch(&problem).unwrap();
        let shadow_eur = &problem.shadow_prices_eur_kwh[..ladder];
        let mut program = DynamicProgram::new(&store, &problem, levels, shadow_eur, &problem.allowed_kwh);
        assert!(program.reachable_rows[0].len() < 3, "{temperature_c}");
        let within_reach = program.solve();
        program.reachable_rows = vec![0..3; problem.blocks.len() + 1];
        assert_eq!(within_reach, program.solve(), "{temperature_c}");
    }
}

#[test]
fn wider_instructions_change_no_bit() {
    let (mut store, problem) = (store(&[0.0, 0.5, 1.0]), problem(1));
    store.dispatch(&problem).unwrap();
    let program = DynamicProgram::new(&store, &problem, 1, &[0.0], &problem.allowed_kwh);
    let moved: Vec<f64> = (0..store.grid.n_states()).map(|i| common::uniform(i as u64)).collect();
    let [mut any, mut widest] = [vec![0.0; moved.len()], vec![0.0; moved.len()]];
    bellman_step::portable(&program, 3, &moved, &mut Vec::new(), &mut any);
    bellman_step(&program, 3, &moved, &mut Vec::new(), &mut widest);
    assert_eq!(any, widest);
}

#[test]
fn energy_is_bought_at_low_and_sold_at_high_prices_within_the_cycle_limit() {
    let (mut store, free) = (store(&[0.0]), DispatchProblem { allowed_kwh: vec![1e9; 2], ..problem(1) });
    let power_kw = store.dispatch(&free).unwrap();
    assert!(power_kw[0] + power_kw[1] < -80.0 && power_kw[2] > 80.0, "{power_kw:?}");
    let limited = DispatchProblem { allowed_kwh: vec![30.0, 0.0], ..free };
    let power_kw = store.dispatch(&limited).unwrap();
    let sold_kwh: f64 = power_kw.iter().zip([0.5, 0.5, 1.0, 0.5]).map(|(p, h)| p.max(0.0) * h).sum();
    assert!(sold_kwh <= 30.0 && power_kw[3] <= 0.0, "{power_kw:?}");
}

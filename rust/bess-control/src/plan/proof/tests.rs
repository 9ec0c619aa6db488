//! Claims about the proven bound: on whole problems, on single steps, and box by box.

use super::*;
use crate::model::{ControlModel, Interval, Losses};
use crate::plan::problem::Point;
use crate::plan::{dual, Prices};
use crate::tests::common;

const COARSE: Resolution = Resolution { soc_cells: 40, temperature_k: 4.0 };

/// A plan problem: demand in kW per string, positive in discharge; states; ambient; limits.
struct Case {
    demand_kw: Vec<f64>,
    dt_h: f64,
    soc: Vec<f64>,
    temperature_c: f64,
    ambient_c: f64,
    /// `(M, T)`.
    limit_kw: Vec<f64>,
    derating: f64,
    /// Price of a start, and whether all strings run before the first step.
    start: f64,
    running: bool,
}

impl Case {
    fn new(demand_kw: Vec<f64>, soc: Vec<f64>, temperature_c: f64) -> Self {
        let limit_kw = vec![92.0; soc.len() * demand_kw.len()];
        let (dt_h, ambient_c, derating) = (0.25, temperature_c, 3e-3);
        let (start, running) = (0.1, false);
        Self { demand_kw, dt_h, soc, temperature_c, ambient_c, limit_kw, derating, start, running }
    }

    fn limited(mut self, m: usize, steps: std::ops::Range<usize>, kw: f64) -> Self {
        let row = m * self.demand_kw.len();
        self.limit_kw[row + steps.start..row + steps.end].fill(kw);
        self
    }

    fn problem<'a>(&self, model: &'a ControlModel) -> PlanProblem<'a> {
        let demand_w: Vec<f64> = self.demand_kw.iter().map(|kw| kw * 1e3 * self.soc.len() as f64).collect();
        let interval =
            |&w: &f64| Interval { direction: Direction::of(w), ambient_c: self.ambient_c, dt_h: self.dt_h };
        let losses = |t: usize| Losses {
            availability: 3e-3 * 0.99_f64.powi(t as i32),
            derating: self.derating,
            inverter: 1e-3,
            battery: 1e-3,
        };
        let prices = Prices {
            losses: (0..demand_w.len()).map(losses).collect(),
            wear: vec![1e-4; self.soc.len()],
            start: self.start,
            balance: 0.0,
            end_charge: -1e-3,
        };
        let start = self.soc.iter().map(|&soc| StringState { soc, temperature_c: self.temperature_c });
        let intervals = demand_w.iter().map(interval).collect();
        let demand_w: Vec<f64> = demand_w.iter().map(|w| w.abs()).collect();
        let limit_w: Vec<f64> = self.limit_kw.iter().map(|kw| kw * 1e3).collect();
        let running = vec![self.running; self.soc.len()];
        PlanProblem::new(model, start.collect(), running, &demand_w, intervals, &limit_w, prices).unwrap()
    }
}

/// Hours of charge and discharge [kW].
fn steps(blocks: &[(usize, f64)]) -> Vec<f64> {
    blocks.iter().flat_map(|&(n, kw)| vec![kw; n]).collect()
}

fn prices(problem: &PlanProblem<'_>) -> Vec<f64> {
    let known = problem.n_strings() as f64 * 50.0;
    dual::ascend(problem, vec![5e-5; problem.n_steps()], known, 8).price
}

/// A step of the control model with the coefficients of its start.
fn next(problem: &PlanProblem<'_>, m: usize, t: usize, from: &Point, request_w: f64) -> Point {
    let interval = &problem.intervals[t];
    let flow = problem.model.strings()[m].step(from.state, request_w, interval);
    let p = &problem.prices;
    let rate = flow.losses().cost(&p.losses[t]) + p.wear[m] * flow.current_a.abs();
    let running = flow.delivered_w > 0.0;
    let start = if running && !from.running { p.start } else { 0.0 };
    Point { state: flow.end, cost: from.cost + rate * interval.dt_h + start, running }
}

/// Number of random steps, states and requests that violate the Bellman inequality, with a share of the errors.
fn violations(given: &Case, share: f64, tries: usize) -> usize {
    let model = ControlModel::new(&common::reference(given.soc.len()));
    let problem = given.problem(&model);
    let price: Vec<f64> = prices(&problem).iter().map(|l| l.min(1.5e-3)).collect();
    let mut kind = Kind::new(&problem, &[0, 1], COARSE).unwrap();
    kind.share = share;
    let mut values = vec![None; problem.n_steps() + 1];
    kind.backwards(&price, |t, v| values[t] = Some(v.clone()));
    let at = |t: usize, p: &Point| kind.at(values[t].as_ref().unwrap().of(p.running), p.state);
    let mut random = fastrand::Rng::with_seed(3);
    let (coolest, warmest) = (kind.temperature_c[0], kind.temperature_c[kind.n_temperatures() - 1]);
    let mut found = 0;
    for _ in 0..tries {
        let t = random.usize(0..problem.n_steps());
        let soc = match random.u8(0..8) {
            0 => 0.0,
            1 => 1.0,
            2 => 0.05 * random.f64(),
            _ => random.f64(),
        };
        let state = StringState { soc, temperature_c: coolest + (warmest - coolest) * random.f64() };
        let from = Point { state, cost: 0.0, running: random.bool() };
        let max_w = problem.demand_w[t].min(problem.limit_w(0, t));
        let request_w = match random.u8(0..8) {
            0 => max_w,
            1 => 2e3 * random.f64(),
            _ => max_w * random.f64(),
        };
        let to = next(&problem, 0, t, &from, request_w.min(max_w));
        let reached = to.cost - price[t] * request_w.min(max_w) * given.dt_h + at(t + 1, &to);
        found += usize::from(at(t, &from) > reached + 1e-9);
    }
    found
}

#[test]
fn no_step_violates_the_bellman_inequality_but_with_half_the_errors_some_do() {
    let mild = steps(&[(4, -39.0), (2, -5.0), (2, 0.0), (6, 60.0), (2, 10.0)]);
    let mild = Case::new(mild, vec![0.5; 2], 25.0);
    let often = Case::new([-0.4, -60.0].repeat(6), vec![0.5; 2], 25.0);
    assert_eq!(violations(&Case { start: 10.0, ..often }, 1.0, 150_000), 0);
    let hot = steps(&[(6, 85.0), (1, 0.0), (6, -85.0)]);
    let hot = |derating: f64| Case { derating, ..Case::new(hot.clone(), vec![0.3; 2], 47.0) };
    for given in [mild, hot(3e-3), hot(6e-4), hot(0.0)] {
        assert_eq!(violations(&given, 1.0, 150_000), 0);
        let seen = violations(&given, 0.5, 150_000);
        assert!(seen > 100, "{seen} with derating at {}", given.derating);
    }
}

/// Each demand is allocated at random, with shares constant over time or not; costs are those of a roll-out.
fn cheapest(problem: &PlanProblem<'_>, tries: usize) -> f64 {
    let mut random = fastrand::Rng::with_seed(5);
    let n = problem.n_strings();
    let mut best = f64::INFINITY;
    for try_ in 0..tries {
        let keep = random.f64();
        let mut weights: Vec<f64> = vec![1.0; n];
        let start = |m: usize| Point { state: problem.start[m], cost: 0.0, running: problem.running[m] };
        let mut points: Vec<Point> = (0..n).map(start).collect();
        for t in 0..problem.n_steps() {
            if try_ > 0 && random.f64() > keep {
                let even = random.bool();
                weights.iter_mut().for_each(|w| *w = if even { 1.0 } else { random.f64().powi(6) });
            }
            let mut left_w = problem.demand_w[t];
            let mut order: Vec<usize> = (0..n).collect();
            order.sort_by(|&a, &b| weights[b].total_cmp(&weights[a]));
            for (place, &m) in order.iter().enumerate() {
                let weight: f64 = order[place..].iter().map(|&m| weights[m]).sum();
                let later_w: f64 = order[place + 1..].iter().map(|&m| problem.limit_w(m, t)).sum();
                let share_w = left_w * weights[m] / weight;
                let request_w = share_w
                    .min(problem.limit_w(m, t))
                    .max(left_w - later_w)
                    .clamp(0.0, problem.limit_w(m, t));
                left_w -= request_w;
                points[m] = next(problem, m, t, &points[m], request_w);
            }
            assert!(left_w.abs() < 1e-6 * problem.demand_w[t].max(1.0));
        }
        let of_string = |(m, p): (usize, &Point)| p.cost + problem.end_cost(m, p.state);
        best = best.min(points.iter().enumerate().map(of_string).sum());
    }
    best
}

#[test]
fn no_schedule_costs_less_than_the_bound() {
    let day = steps(&[(6, -39.0), (2, 0.0), (8, 39.0), (2, 12.0), (4, -70.0)]);
    let mut cases = vec![
        Case::new(day.clone(), vec![0.5, 0.5], 25.0),
        Case::new(day.clone(), vec![0.4, 0.6, 0.9], -5.0).limited(2, 0..day.len(), 0.0),
        Case::new(day.clone(), vec![0.5, 0.2], 44.0).limited(0, 0..day.len(), 60.0),
        // A string is out of service for some of the steps, another is limited later.
        Case::new(day.clone(), vec![0.6, 0.4, 0.5], 25.0).limited(0, 8..20, 0.0).limited(1, 15..22, 40.0),
        Case::new(steps(&[(12, 80.0)]), vec![0.05, 0.3], 25.0),
        Case::new(steps(&[(12, -80.0)]), vec![0.99, 0.7], 25.0),
        Case::new(vec![39.0], vec![0.5, 0.5], 25.0),
        Case::new(vec![0.001, -0.001, 0.0005], vec![0.5, 0.5], 25.0),
        Case::new(vec![0.0; 3], vec![0.5, 0.5], 25.0),
        // An inverter with a loss above its request takes the difference from the battery.
        Case { start: 0.0, ..Case::new(vec![-0.45], vec![0.5, 0.5], 25.0) },
    ];
    cases.push(Case { dt_h: 1.0 / 60.0, ..Case::new(day.repeat(3), vec![0.5, 0.5], 25.0) });
    cases.push(Case { ambient_c: 45.0, ..Case::new(day.clone(), vec![0.5, 0.5], 30.0) });
    // Strings continue to run with requests below their inverter losses.
    cases.push(Case {
        start: 10.0,
        running: true,
        ..Case::new(steps(&[(2, -0.4), (4, -39.0)]), vec![0.5, 0.5], 25.0)
    });
    // Derated requests that cost less than the price of the demand.
    for (derating, temperature_c) in [(1e-5, 25.0), (0.0, 44.0), (1e-5, 52.0), (0.0, 57.0)] {
        cases.push(Case { derating, ..Case::new(day.clone(), vec![0.5, 0.2], temperature_c) });
    }
    for (case, given) in cases.iter().enumerate() {
        let mut system = common::reference(given.soc.len());
        if case % 2 == 1 {
            system = system
                .aged(&vec![1.0, 0.8, 0.9][..given.soc.len()], &vec![1.0, 1.5, 1.2][..given.soc.len()])
                .unwrap();
        }
        let model = ControlModel::new(&system);
        let problem = given.problem(&model);
        let price = prices(&problem);
        let cost = cheapest(&problem, 400);
        for factor in [1.0, 0.3, 1.5, 3.0, 20.0, 1e3, -1.0] {
            let price: Vec<f64> = price.iter().map(|l| l * factor).collect();
            for of in [&problem, &problem.relaxed()] {
                let bound = proven(of, &price, &problem.kinds(), |_| COARSE).unwrap();
                assert!(bound <= cost, "case {case}: a bound of {bound}, a schedule of {cost}");
            }
        }
    }
}

#[test]
fn at_rated_demand_the_proven_bound_is_within_a_tenth_of_the_grid_bound() {
    let day = steps(&[(10, -39.0), (2, -15.0), (2, 0.0), (19, 39.0), (3, 15.0), (2, 0.0), (10, -39.0)]);
    let model = ControlModel::new(&common::reference(2));
    let mut problem = Case::new(day, vec![0.5; 2], 25.0).problem(&model);
    (problem.prices.end_charge, problem.prices.wear, problem.prices.start) = (0.0, vec![0.0; 2], 0.0);
    let dual = dual::ascend(&problem, vec![4e-5; problem.n_steps()], 30.0, 40);
    let bound = bound(&problem, &ProofPrices { price: dual.price, relaxed: false }, 160).unwrap();
    assert!(0.9 * dual.bound < bound && bound < dual.bound, "{bound} of {}", dual.bound);
}

/// Position of a point in a box: in its cell of SOC and temperature, and between its currents.
struct Inside {
    soc: f64,
    temperature: f64,
    current: f64,
}

impl Inside {
    /// Corners of the triangle around the point with their weights, as steps over SOC and current: triangles are cut along
    /// the line on which the final SOC is that of a node.
    fn triangle(&self, direction: Direction) -> [(usize, usize, f64); 3] {
        let (a, c) = (self.soc, self.current);
        match direction {
            Direction::Charge if a + c <= 1.0 => [(0, 0, 1.0 - a - c), (1, 0, a), (0, 1, c)],
            Direction::Charge => [(1, 1, a + c - 1.0), (1, 0, 1.0 - c), (0, 1, 1.0 - a)],
            Direction::Discharge if a >= c => [(0, 0, 1.0 - a), (1, 0, a - c), (1, 1, c)],
            Direction::Discharge => [(0, 0, 1.0 - c), (0, 1, c - a), (1, 1, a)],
        }
    }
}

/// Values after a step, each of which stresses one part of the errors.
fn some_values(kind: &Kind<'_>, random: &mut fastrand::Rng) -> Vec<f64> {
    let flat = random.bool();
    let mut uneven = |scale: f64| -> Vec<f64> {
        (0..kind.soc.len).map(|_| if flat { 0.0 } else { scale * (random.f64() - 0.5) }).collect()
    };
    // Steps over SOC, and another slope over temperature at each node of SOC.
    let (level, slope) = (uneven(1e-3), uneven(1e-2));
    let node = |x: usize| {
        let (i, j) = (x / kind.n_temperatures(), x % kind.n_temperatures());
        level[i] + slope[i] * (kind.temperature_c[j] - kind.temperature_c[0])
    };
    (0..kind.n_nodes()).map(node).collect()
}

/// Maximum violation of the error bounds by points of a box, at random prices and values; None if the box is unreachable.
fn excess(problem: &mut PlanProblem<'_>, random: &mut fastrand::Rng) -> Option<f64> {
    let mut maybe = |scale: f64| if random.bool() { scale * random.f64() } else { 0.0 };
    let (battery, inverter, derating, price) = (maybe(1e-3), maybe(1e-3), maybe(3e-3), maybe(3e-3));
    problem.prices.losses[0] = Losses { availability: 3e-3, derating, inverter, battery };
    let problem: &PlanProblem<'_> = problem;
    let interval = &problem.intervals[0];
    let kind = Kind::new(problem, &[0, 1], COARSE)?;
    let moves = kind.moves[direction_index(interval.direction)].as_ref()?;
    let images = kind.images(interval, Some(moves));
    let step = StepPrices::new(&kind, 0, price, Some(moves));
    let values = some_values(&kind, random);
    let curvature = Curvature::new(&kind, &values);
    let cap_w = kind.cap_w(0);
    let string = kind.string();
    let delivered = delivered::Delivered::new(string.loss(interval.direction))?;
    let n = kind.n_temperatures();
    let mut largest = None;
    for k in 0..moves.n_boxes_within(cap_w) {
        let errors = kind.box_errors((moves, &images), &curvature, &step, k);
        for _ in 0..400 {
            let (i, j) = (random.usize(0..kind.soc.len - 1), random.usize(0..n - 1));
            let error = errors[i * (n - 1) + j];
            let inside = Inside { soc: random.f64(), temperature: random.f64(), current: random.f64() };
            let triangle = inside.triangle(interval.direction);
            let leads = |&(di, dk, _): &(usize, usize, f64)| {
                kind.soc.after(interval.direction, i + di, k + dk).is_some()
            };
            let between = |j: usize| {
                kind.temperature_c[j]
                    + inside.temperature * (kind.temperature_c[j + 1] - kind.temperature_c[j])
            };
            let state = StringState { soc: kind.soc.at(i as f64 + inside.soc), temperature_c: between(j) };
            let factor = string.parameters.derating.factor.at(state.temperature_c);
            let current_a = moves.current_a * (k as f64 + inside.current);
            let c = string.coefficients(interval.direction, state);
            let heat_w = c.resistance_ohm * current_a * current_a;
            let internal_w = c.voltage_v * current_a - interval.direction.sign() * heat_w;
            let power_w = delivered.at(internal_w);
            let request_w = power_w / factor;
            if error == f64::NEG_INFINITY
                || !triangle.iter().all(leads)
                || factor < MIN_FACTOR
                || power_w < 0.0
                || request_w > cap_w
            {
                continue;
            }
            let losses = Losses {
                availability: 0.0,
                derating: request_w - power_w,
                inverter: delivered.loss_w(internal_w, power_w),
                battery: heat_w,
            };
            let rate = losses.cost(&problem.prices.losses[0]) - price * request_w
                + problem.prices.wear[0] * current_a;
            let soc = state.soc
                - interval.direction.sign() * current_a * interval.dt_h / string.parameters.capacity_ah;
            let end =
                StringState { soc, temperature_c: string.warmed(state.temperature_c, heat_w, interval) };
            let paid = rate * interval.dt_h + kind.at(&values, end);
            let corner = |&(di, dk, weight): &(usize, usize, f64)| {
                let to = kind.soc.after(interval.direction, i + di, k + dk).expect("leads to a node");
                let wear = interval.dt_h * problem.prices.wear[0] * moves.current_a * (k + dk) as f64;
                let at = |j: usize| {
                    let x = (k + dk) * kind.n_nodes() + (i + di) * n + j;
                    let (cell, share) = images.corners[x];
                    step.cost(&moves.corners[x], j) + wear + lerp(&values[to * n..], cell, share)
                };
                weight * ((1.0 - inside.temperature) * at(j) + inside.temperature * at(j + 1))
            };
            let expected: f64 = triangle.iter().map(corner).sum();
            let excess = expected - error - paid;
            largest = Some(f64::max(largest.unwrap_or(f64::NEG_INFINITY), excess));
        }
    }
    largest
}

#[test]
fn no_point_of_a_box_is_below_the_interpolation_minus_its_errors() {
    let model = ControlModel::new(&common::reference(2));
    let mut random = fastrand::Rng::with_seed(7);
    for demand_kw in [60.0, -60.0, 92.0, -92.0] {
        for temperature_c in [5.0, 25.0, 46.0] {
            let given = Case { derating: 0.0, ..Case::new(vec![demand_kw], vec![0.5; 2], temperature_c) };
            let mut problem = given.problem(&model);
            let mut found = 0;
            for _ in 0..40 {
                let Some(excess) = excess(&mut problem, &mut random) else { continue };
                found += 1;
                assert!(excess <= 1e-9, "{demand_kw} kW at {temperature_c} degC: {excess}");
            }
            assert!(found > 30, "{found}");
        }
    }
}

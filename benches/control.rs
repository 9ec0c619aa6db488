//! Time of one call of the power split by (strings, steps).

use bess_control::{ControlHorizon, Effort, Losses, StateBox};
use criterion::{criterion_group, criterion_main, BenchmarkId, Criterion, Throughput};

#[path = "../rust/bess-control/src/tests/common.rs"]
mod common;

const SIZES: [(usize, usize); 3] = [(2, 8), (8, 8), (2, 32)];
const SCHEDULES: usize = 1000;
const EFFORT: Effort = Effort { rollouts: 2000, deadline: None, gap: 1e-3 };

fn schedules(horizon: &ControlHorizon, count: usize) -> Vec<f64> {
    let size = horizon.n_strings() * horizon.n_steps();
    (0..count * size).map(|i| common::uniform(i as u64) * common::NOMINAL_W).collect()
}

fn control(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("control");
    for (n_strings, n_steps) in SIZES {
        let horizon = common::horizon(&common::reference(n_strings), n_steps, 0.5);
        let name = |what| BenchmarkId::new(what, format!("{n_strings}x{n_steps}"));
        let requests_w = schedules(&horizon, SCHEDULES);
        group.throughput(Throughput::Elements(requests_w.len() as u64));
        group.bench_function(name("evaluate 1000"), |b| b.iter(|| horizon.evaluate(&requests_w)));
        group.throughput(Throughput::Elements(1));
        group.bench_function(name("greedy"), |b| b.iter(|| horizon.greedy()));
        let start = horizon.greedy().request_w;
        group.bench_function(name("split"), |b| b.iter(|| horizon.split(None, &EFFORT)));
        group.bench_function(name("reachable"), |b| b.iter(|| horizon.reachable()));
        let boxes: Vec<StateBox> =
            horizon.reachable().chunks(n_steps + 1).flat_map(|row| row[..n_steps].to_vec()).collect();
        let costs = vec![Losses::from_array([0.0, 1e-5, 1e-5, 1e-5]); n_strings];
        group.bench_function(name("tighten"), |b| b.iter(|| horizon.tighten(&start, &costs, 0.0)));
        let budget_w = vec![f64::INFINITY; n_steps];
        group.bench_function(name("step_bounds"), |b| {
            b.iter(|| horizon.step_bounds(&boxes, &costs, &budget_w))
        });
    }
    group.finish();
}

criterion_group!(benches, control);
criterion_main!(benches);

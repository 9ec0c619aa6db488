//! A day of a plant at 10 s and 40 nodes, two arbitrage cycles. Throughput counts node-steps: 1 / (Gelem/s) is
//! ns per node-step; a string-year is 126 million of them.

use bess_plant::{DeratingLaw, Plant};
use criterion::{criterion_group, criterion_main, BenchmarkId, Criterion, Throughput};

#[path = "../rust/bess-plant/src/tests/common.rs"]
mod common;

const STEPS: usize = 96;
const SUBSTEPS: usize = 90;

fn a_day(criterion: &mut Criterion) {
    measured(criterion, "plant day", None);
}

/// The same, of strings that age.
fn an_ageing_day(criterion: &mut Criterion) {
    measured(criterion, "plant day, ageing", Some("kokam-75ah"));
}

fn measured(criterion: &mut Criterion, name: &str, ageing: Option<&str>) {
    let mut group = criterion.benchmark_group(name);
    for strings in [2, 8, 32] {
        let system = common::ageing(strings, ageing);
        let state = common::uniform_state(&system, 1, 0.5, 25.0);
        let request_w: Vec<f64> = (0..STEPS * strings)
            .map(|at| common::two_cycles_kw(at / strings) * 1e3 * (1.0 - 0.01 * (at % strings) as f64))
            .collect();
        let ambient_c = vec![25.0; STEPS];
        let nodes = system.strings[0].spatial.nodes;
        group.throughput(Throughput::Elements((strings * nodes * STEPS * SUBSTEPS) as u64));
        group.bench_function(BenchmarkId::from_parameter(format!("{strings} strings")), |bencher| {
            let mut plant = Plant::new(&system, 1, 10.0, DeratingLaw::Table, &state).unwrap();
            bencher.iter(|| plant.run(&request_w, None, &ambient_c, 900.0, false).unwrap());
        });
    }
    group.finish();
}

criterion_group!(benches, a_day, an_ageing_day);
criterion_main!(benches);

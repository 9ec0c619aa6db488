//! Temperature nodes.

use bess_tables::Direction;

use super::{DERATING_CELLS, MIN_FACTOR};
use crate::model::{Interval, Range, StateBox};
use crate::plan::problem::PlanProblem;

/// Temperature nodes over the reachable range: knots of the tables, and others so that no cell is wider than `widest_k`.
pub(super) fn temperatures(problem: &PlanProblem<'_>, members: &[usize], widest_k: f64) -> Vec<f64> {
    let string = &problem.model.strings()[members[0]];
    let Range { low, high } = problem.temperatures_c(members.iter().copied());
    let hottest_c = problem.temperatures_c([]).high;
    let factor = &string.parameters.derating.factor;
    let knots = || factor.x().iter().copied();
    // Extends the range by the maximum warming of one more step, in parts with a nearly constant derating factor.
    let soc = problem.soc_window(members[0]);
    let max_w = (0..problem.n_steps()).map(|t| problem.cap_w(members[0], t)).fold(0.0, f64::max);
    let mut reached = (low, high);
    let mut top = high;
    for _ in 0..problem.n_steps() {
        let mut borders: Vec<f64> = knots().filter(|&k| k > reached.0 && k < reached.1).collect();
        borders.insert(0, reached.0);
        borders.push(reached.1);
        let mut warmest = top;
        for border in borders.windows(2) {
            let states = StateBox { soc, temperature_c: Range { low: border[0], high: border[1] } };
            for direction in [Direction::Charge, Direction::Discharge] {
                let interval = Interval { direction, ambient_c: hottest_c, ..problem.intervals[0] };
                let requests = Range { low: 0.0, high: max_w };
                warmest = warmest.max(string.cell(&states, &requests, &interval).end.temperature_c.high);
            }
        }
        if warmest <= top {
            break;
        }
        reached = (top, warmest);
        top = warmest;
    }
    let (low, top) = (low - 1e-6, top.max(low + 1.0) + 1e-6);
    let mut borders = vec![low, top];
    borders.extend(knots().filter(|&k| k > low && k < top));
    borders.sort_unstable_by(f64::total_cmp);
    borders.dedup();
    let mut out = vec![low];
    for border in borders.windows(2) {
        let derates = factor.at(border[1]) < 1.0 && factor.at(border[0]) > MIN_FACTOR;
        let widest_k = if derates { widest_k / DERATING_CELLS } else { widest_k };
        let n = ((border[1] - border[0]) / widest_k).ceil().max(1.0);
        out.extend((1..=n as usize).map(|k| border[0] + (border[1] - border[0]) * k as f64 / n));
    }
    out
}

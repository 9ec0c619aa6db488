//! One-step look-ahead: the power of a step is allocated at minimum cost of the step plus cost to go.

use crate::plan::paths::Paths;
use crate::plan::problem::{PlanProblem, Point};
use crate::plan::starts::allocate_remainder;

/// Power units per limit of the largest inverter.
const PARTS: usize = 24;

/// Strings with a common cost to go: a pair or a single string.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Group {
    pub first: usize,
    pub second: Option<usize>,
}

/// Cost to go at the start of step `t` of a problem, a sum over groups of strings.
pub(crate) trait CostToGo {
    /// Contribution of a string's state, computed once for all states of its partner.
    type End: Copy;

    /// Groups; strings out of service belong to no group.
    fn groups(&self) -> &[Group];

    fn end(&self, string: usize, t: usize, point: &Point) -> Self::End;

    fn cost(&self, group: usize, t: usize, first: Self::End, second: Option<Self::End>) -> f64;
}

/// Minimum cost of a group over its power in units, and the units of the first string.
type Table = Vec<(f64, usize)>;

/// The schedule from successive look-aheads, and the marginal cost of the demand in each step, with convex combinations of
/// groups [cost/Wh].
pub(crate) fn look_ahead<'a, V: CostToGo>(problem: &'a PlanProblem<'a>, values: &V) -> (Paths<'a>, Vec<f64>) {
    let mut price = vec![0.0; problem.n_steps()];
    let paths = Paths::from_policy(problem, |t, points| {
        if problem.demand_w[t] <= 0.0 {
            return vec![0.0; points.len()];
        }
        let (share, marginal) = allocate_step(problem, values, t, points);
        price[t] = marginal;
        share
    });
    (paths, price)
}

/// Requests of a step `(M,)` [W], and its marginal cost. Power is in units; the allocation is a knapsack over the groups.
fn allocate_step<V: CostToGo>(
    problem: &PlanProblem<'_>,
    values: &V,
    t: usize,
    points: &[Point],
) -> (Vec<f64>, f64) {
    let demand_w = problem.demand_w[t];
    let limit_w = problem.limits_w(t);
    let max_w = limit_w.iter().copied().fold(0.0, f64::max);
    let units = ((demand_w / max_w * PARTS as f64).ceil() as usize).max(PARTS);
    let unit_w = demand_w / units as f64;
    let power_w = |m: usize, k: usize| (k as f64 * unit_w).min(limit_w[m]);
    let ends = |m: usize| -> Vec<(f64, V::End)> {
        let most = ((limit_w[m] / unit_w * (1.0 + 1e-9)) as usize).min(units);
        (0..=most)
            .map(|k| {
                let next = problem.step(m, t, &Point { cost: 0.0, ..points[m] }, power_w(m, k));
                (next.cost, values.end(m, t + 1, &next))
            })
            .collect()
    };
    let table = |(index, group): (usize, &Group)| -> Table {
        let first = ends(group.first);
        let second = group.second.map_or(vec![(0.0, None)], |m| {
            ends(m).into_iter().map(|(cost, end)| (cost, Some(end))).collect()
        });
        let mut table = vec![(f64::INFINITY, 0); (first.len() + second.len() - 1).min(units + 1)];
        for (k, &(cost_a, a)) in first.iter().enumerate() {
            for (best, &(cost_b, b)) in table[k..].iter_mut().zip(&second) {
                let cost = cost_a + cost_b + values.cost(index, t + 1, a, b);
                if cost < best.0 {
                    *best = (cost, k);
                }
            }
        }
        table
    };
    let tables: Vec<Table> = values.groups().iter().enumerate().map(table).collect();
    let mut share = vec![0.0; problem.n_strings()];
    for ((group, table), k) in values.groups().iter().zip(&tables).zip(knapsack(&tables, units)) {
        let first = table[k].1;
        share[group.first] = power_w(group.first, first);
        if let Some(second) = group.second {
            share[second] = power_w(second, k - first);
        }
    }
    // Limits are not multiples of a unit.
    allocate_remainder(&mut share, demand_w, limit_w);
    let price = clearing_price(&tables, units) / (unit_w * problem.intervals[t].dt_h);
    (share, price.min(problem.shed_price(t)))
}

/// Units of each table at minimum total cost; in total `units`, or all units of the tables.
fn knapsack(tables: &[Table], units: usize) -> Vec<usize> {
    let mut best = vec![f64::INFINITY; units + 1];
    best[0] = 0.0;
    let mut choices: Vec<Vec<usize>> = vec![];
    for table in tables {
        let mut next = vec![f64::INFINITY; units + 1];
        let mut choice = vec![0; units + 1];
        for (taken, &before) in best.iter().enumerate().filter(|(_, before)| before.is_finite()) {
            for (k, &(cost, _)) in table.iter().enumerate().take(units - taken + 1) {
                if before + cost < next[taken + k] {
                    next[taken + k] = before + cost;
                    choice[taken + k] = k;
                }
            }
        }
        best = next;
        choices.push(choice);
    }
    let mut taken = best.iter().rposition(|cost| cost.is_finite()).unwrap_or(0);
    let mut picked: Vec<usize> = choices
        .iter()
        .rev()
        .map(|choice| {
            let k = choice[taken];
            taken -= k;
            k
        })
        .collect();
    picked.reverse();
    picked
}

/// Slope at `units` of the minimum cost over the convex hulls of the tables: the balancing price [cost/unit].
fn clearing_price(tables: &[Table], units: usize) -> f64 {
    let mut segments: Vec<(f64, usize)> = vec![];
    for table in tables {
        let mut hull: Vec<usize> = vec![];
        let slope = |a: usize, b: usize| (table[b].0 - table[a].0) / (b - a) as f64;
        for k in 0..table.len() {
            while hull.len() >= 2
                && slope(hull[hull.len() - 2], hull[hull.len() - 1]) >= slope(hull[hull.len() - 1], k)
            {
                hull.pop();
            }
            hull.push(k);
        }
        segments.extend(hull.windows(2).map(|ab| (slope(ab[0], ab[1]), ab[1] - ab[0])));
    }
    segments.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut filled = 0;
    for &(slope, width) in &segments {
        filled += width;
        if filled >= units {
            return slope;
        }
    }
    segments.last().map_or(0.0, |s| s.0)
}

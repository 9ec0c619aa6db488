//! Cost to go of string pairs: one dynamic program over SOC and temperature of both strings.
//!
//! The program is solved backwards on a grid. Each step is two sparse products `A V B'`, one for each string, which
//! interpolate the end states of each power share, and a minimum over the shares. A plant is a set of pairs. Each pair
//! covers a part of the demand in proportion to capacity; the one-step look-ahead moves power between pairs.

use bess_tables::widest;

use crate::cores;
use crate::model::StringState;
use crate::plan::look_ahead::{CostToGo, Group};
use crate::plan::nodes::Nodes;
use crate::plan::pair::Room;
use crate::plan::problem::{kind_indices, kinds, PlanProblem, Point};
use crate::rules::water_fill;

/// Number of SOC nodes. A plan for seven days of two reference strings costs 1.5 % more with 25, and the same with 41.
const SOC_NODES: usize = 33;
/// Maximum distance of the temperature nodes [K].
const TEMPERATURE_STEP_K: f64 = 4.9;
/// Number of power shares of two strings in a step.
const SHARES: usize = 12;
/// Derating factor at which the grid ends: plans do not use hotter strings.
const MIN_DERATING: f64 = 0.25;
/// Nodes of SOC and temperature of one string.
#[derive(Debug)]
struct Grid {
    soc: Nodes,
    temperature_c: Nodes,
}

/// Four nodes and their weights: bilinear interpolation at a state.
pub(crate) type Corners = [(u32, f32); 4];

/// The only node of a missing second string.
const NO_STRING: Corners = [(0, 1.0), (0, 0.0), (0, 0.0), (0, 0.0)];

impl Grid {
    fn new(problem: &PlanProblem<'_>, m: usize) -> Self {
        let factor = &problem.model.strings()[m].parameters.derating.factor;
        let stop_c = factor.x().iter().copied().find(|&c| factor.at(c) < MIN_DERATING);
        let range_c = problem.temperatures_to_c(stop_c, TEMPERATURE_STEP_K);
        let cells = ((range_c.high - range_c.low) / TEMPERATURE_STEP_K).ceil() as usize;
        Self {
            soc: Nodes::over(problem.soc_range(m), SOC_NODES - 1),
            temperature_c: Nodes::over(range_c, cells),
        }
    }

    fn len(&self) -> usize {
        self.soc.len * self.temperature_c.len
    }

    fn state(&self, node: usize) -> StringState {
        let (i, j) = (node / self.temperature_c.len, node % self.temperature_c.len);
        StringState { soc: self.soc.at(i as f64), temperature_c: self.temperature_c.at(j as f64) }
    }

    fn corners(&self, state: StringState) -> Corners {
        let (i, s) = self.soc.locate(state.soc);
        let (j, t) = self.temperature_c.locate(state.temperature_c);
        let (s, t) = (s as f32, t as f32);
        let next = self.temperature_c.len;
        let node = i * next + j;
        [
            (node as u32, (1.0 - s) * (1.0 - t)),
            (node as u32 + 1, (1.0 - s) * t),
            ((node + next) as u32, s * (1.0 - t)),
            ((node + next) as u32 + 1, s * t),
        ]
    }
}

/// Cost to go of all pairs.
#[derive(Debug)]
pub(crate) struct PairValues {
    groups: Vec<Group>,
    /// Kind of each group: identical pairs have one value function.
    kind_of: Vec<usize>,
    /// Cost to go of each kind, at each time `(n_first, n_second)`; a string without a partner has one column.
    planes: Vec<Vec<Vec<f32>>>,
    /// Of each string `(M,)`.
    grids: Vec<Grid>,
    /// Steps of the problem in one step of the program.
    step_ratio: usize,
}

impl PairValues {
    /// Solves all pairs in steps `step_ratio` times as long as those of the problem.
    pub fn solve(problem: &PlanProblem<'_>, step_ratio: usize) -> Self {
        let problem = &problem.coarsened(step_ratio);
        let grids: Vec<Grid> = (0..problem.n_strings()).map(|m| Grid::new(problem, m)).collect();
        let pair = |pair: &[usize]| Group { first: pair[0], second: pair.get(1).copied() };
        let groups: Vec<Group> = pairing(problem).chunks(2).map(pair).collect();
        let same_kind = |a: usize, b: usize| {
            let (a, b) = (groups[a], groups[b]);
            problem.same_kind(a.first, b.first)
                && match (a.second, b.second) {
                    (Some(a), Some(b)) => problem.same_kind(a, b),
                    (a, b) => a == b,
                }
        };
        let kinds = kinds(0..groups.len(), same_kind);
        let kind_of = kind_indices(&kinds, groups.len());
        let planes = cores::map(kinds, |kind| solve(problem, &grids, groups[kind[0]]));
        Self { groups, kind_of, planes, grids, step_ratio }
    }
}

impl CostToGo for PairValues {
    type End = Corners;

    fn groups(&self) -> &[Group] {
        &self.groups
    }

    fn end(&self, string: usize, _t: usize, point: &Point) -> Corners {
        self.grids[string].corners(point.state)
    }

    /// Interpolated between the times before and after.
    fn cost(&self, group: usize, t: usize, first: Corners, second: Option<Corners>) -> f64 {
        let planes = &self.planes[self.kind_of[group]];
        let time = (t as f64 / self.step_ratio as f64).min((planes.len() - 1) as f64);
        let index = (time as usize).min(planes.len() - 2);
        let (before, after, late) = (&planes[index], &planes[index + 1], (time - index as f64) as f32);
        let second_nodes = before.len() / self.grids[self.groups[group].first].len();
        let mut cost = 0.0;
        for (x, weight_x) in first {
            for (y, weight_y) in second.unwrap_or(NO_STRING) {
                let node = x as usize * second_nodes + y as usize;
                cost += weight_x * weight_y * (before[node] + late * (after[node] - before[node]));
            }
        }
        f64::from(cost)
    }
}

/// Strings in service in pairs: identical strings, the fullest with the emptiest.
fn pairing(problem: &PlanProblem<'_>) -> Vec<usize> {
    let mut order = vec![];
    for mut kind in problem.kinds() {
        kind.sort_by(|&a, &b| problem.start[a].soc.total_cmp(&problem.start[b].soc));
        let (mut low, mut high) = (0, kind.len());
        while low < high {
            high -= 1;
            order.push(kind[high]);
            if low < high {
                order.push(kind[low]);
                low += 1;
            }
        }
    }
    order
}

/// Share of a group in the demand of a step [W]: by capacity, within its limits.
fn demand_share_w(problem: &PlanProblem<'_>, group: Group, t: usize) -> f64 {
    let capacity: Vec<f64> = (0..problem.n_strings()).map(|m| problem.usable_ah(m, t)).collect();
    let power = water_fill(problem.demand_w[t], &capacity, problem.limits_w(t));
    power[group.first] + group.second.map_or(0.0, |m| power[m])
}

/// A share of a step: cost and end state for each node of a string.
type Moves = Vec<(f32, Corners)>;

/// Minimum cost to go over some shares of a step, with the second string in rows, and intermediate results of a share. Few of
/// these are kept from step to step, so that they stay in the cache.
#[derive(Debug, Clone)]
struct Workspace {
    product: Vec<f32>,
    transposed: Vec<f32>,
    min_cost: Vec<f32>,
}

/// Costs to go of a pair at each time.
fn solve(problem: &PlanProblem<'_>, grids: &[Grid], group: Group) -> Vec<Vec<f32>> {
    let Group { first, second } = group;
    let (n_a, n_b) = (grids[first].len(), second.map_or(1, |m| grids[m].len()));
    let symmetric = second.is_some_and(|m| problem.same_kind(first, m));
    let of_string = |m: usize, node: usize| problem.end_cost(m, grids[m].state(node)) as f32;
    let end = |x: usize| of_string(first, x / n_b) + second.map_or(0.0, |m| of_string(m, x % n_b));
    let mut planes = vec![(0..n_a * n_b).map(end).collect::<Vec<f32>>(); problem.n_steps() + 1];
    let (mut moves_a, mut moves_b): (Moves, Moves) = (vec![], vec![]);
    let nodes = vec![0.0; n_a * n_b];
    let n_parts = cores::threads(SHARES + 1);
    let mut parts =
        vec![Workspace { product: nodes.clone(), transposed: nodes.clone(), min_cost: nodes }; n_parts];
    let mut prepared: Option<usize> = None;
    for t in (0..problem.n_steps()).rev() {
        let sum_w = demand_share_w(problem, group, t);
        let room = Room::of(sum_w, problem.limit_w(first, t), second.map_or(0.0, |m| problem.limit_w(m, t)));
        let shares = if room.is_open() { SHARES } else { 0 };
        // Identical strings are interchangeable, so half of the shares suffice.
        let used = if symmetric { shares / 2 } else { shares };
        if !prepared.is_some_and(|s| problem.same_step(s, t)) {
            prepared = Some(t);
            moves_a.clear();
            moves_b.clear();
            let moves = |m: usize, power_w: f64| {
                let grid = &grids[m];
                (0..grid.len()).map(move |node| {
                    let from = Point { state: grid.state(node), cost: 0.0, running: true };
                    let next = problem.step(m, t, &from, power_w);
                    (next.cost as f32, grid.corners(next.state))
                })
            };
            for k in 0..=used {
                let below = (shares - k) as f64 / shares.max(1) as f64;
                let power_w = room.high_w - (room.high_w - room.low_w) * below;
                moves_a.extend(moves(first, power_w));
                match second {
                    Some(m) => moves_b.extend(moves(m, (sum_w - power_w).max(0.0))),
                    None => moves_b.push((0.0, NO_STRING)),
                }
            }
        }
        let (before, after) = planes.split_at_mut(t + 1);
        let each = parts.iter_mut().enumerate().collect();
        cores::map(each, |(part, shared): (usize, &mut Workspace)| {
            shared.min_cost.fill(f32::INFINITY);
            for k in (part..=used).step_by(n_parts) {
                lower(&after[0], &moves_a[k * n_a..(k + 1) * n_a], &moves_b[k * n_b..(k + 1) * n_b], shared);
            }
        });
        let (min_cost, others) = parts.split_at_mut(1);
        let min_cost = &mut min_cost[0].min_cost;
        for other in others {
            min_cost.iter_mut().zip(&other.min_cost).for_each(|(value, &other)| *value = value.min(other));
        }
        let now = &mut before[t];
        transpose(min_cost, now, n_a);
        if symmetric && shares > 0 {
            now.iter_mut().zip(&*min_cost).for_each(|(value, &other)| *value = value.min(other));
        }
    }
    planes
}

widest! {
    /// Lowers costs to go to those before a share of a step, from those after it `(n_first, n_second)` and the moves of both strings.
    fn lower(after: &[f32], first: &[(f32, Corners)], second: &[(f32, Corners)], shared: &mut Workspace) {
        let Workspace { product, transposed, min_cost } = shared;
        let (n_a, n_b) = (first.len(), second.len());
        for (row, &a) in product.chunks_exact_mut(n_b).zip(first) {
            interpolate(after, a, n_b, |i, value| row[i] = value);
        }
        transpose(product, transposed, n_b);
        for (row, &b) in min_cost.chunks_exact_mut(n_a).zip(second) {
            interpolate(transposed, b, n_a, |i, value| row[i] = row[i].min(value));
        }
    }
}

/// The cost of a move, and the rows of `n` values that it leads to.
#[inline(always)]
fn interpolate(values: &[f32], (cost, corners): (f32, Corners), n: usize, mut to: impl FnMut(usize, f32)) {
    let [a, b, c, d] = corners.map(|(node, _)| &values[node as usize * n..][..n]);
    let [wa, wb, wc, wd] = corners.map(|(_, weight)| weight);
    for i in 0..n {
        to(i, cost + wa * a[i] + wb * b[i] + wc * c[i] + wd * d[i]);
    }
}

/// Transposes a matrix of rows of `columns` values in square tiles. The last ones overlap those before.
#[inline(always)]
fn transpose(from: &[f32], to: &mut [f32], columns: usize) {
    const TILE: usize = 8;
    let rows = from.len() / columns;
    if rows < TILE || columns < TILE {
        for (i, row) in from.chunks_exact(columns).enumerate() {
            row.iter().enumerate().for_each(|(j, &value)| to[j * rows + i] = value);
        }
        return;
    }
    for top in (0..rows).step_by(TILE).map(|top| top.min(rows - TILE)) {
        for left in (0..columns).step_by(TILE).map(|left| left.min(columns - TILE)) {
            let mut tile = [&[0.0; TILE]; TILE];
            for (row, from) in tile.iter_mut().zip(from[top * columns..].chunks_exact(columns)) {
                *row = from[left..].first_chunk().unwrap_or_else(|| unreachable!());
            }
            for j in 0..TILE {
                let column = &mut to[(left + j) * rows + top..][..TILE];
                for i in 0..TILE {
                    column[i] = tile[i][j];
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn matrices_of_any_shape_are_transposed() {
        for (rows, columns) in [(1, 5), (7, 30), (8, 8), (9, 8), (13, 21), (297, 264)] {
            let from: Vec<f32> = (0..rows * columns).map(|x| x as f32).collect();
            let mut to = vec![-1.0; from.len()];
            transpose(&from, &mut to, columns);
            let expected = (0..columns).flat_map(|j| (0..rows).map(move |i| (i * columns + j) as f32));
            assert!(to.into_iter().eq(expected), "{rows} x {columns}");
        }
    }
}

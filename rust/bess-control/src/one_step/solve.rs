//! Solution of the one-step problem by branch and bound on the Lagrangian.

use super::cost_curve::StringCost;
use super::lagrangian::{bounds_by_count, maximise, Commitment, InverterMode, OneStepSolution};

/// Bounds closer than this (relative) count as equal.
const GAP: f64 = 1e-10;

/// Number of strings above which no further nodes are solved: the Lagrangian gap falls with their number.
const MAX_STRINGS_WITH_NODES: usize = 32;

struct Node {
    bound: f64,
    commitment: Commitment,
    /// Branching string of a solved node, at the border between on and off; None before the solution.
    border: Option<usize>,
}

/// Solves the one-step problem; the price of the result is that with every inverter free. Branches first on the number of
/// inverters that are on, which leaves no Lagrangian gap for identical strings, then on the string at the border.
pub(crate) fn solve(curves: &[impl StringCost], demand_w: f64) -> OneStepSolution {
    solve_within(curves, demand_w, 60 + 8 * curves.len().min(MAX_STRINGS_WITH_NODES))
}

/// [`solve`] with at most this many nodes; with fewer nodes the bound is weaker, but valid.
fn solve_within(curves: &[impl StringCost], demand_w: f64, mut n_nodes: usize) -> OneStepSolution {
    let free = Commitment::of(curves);
    let n_on = free.modes.iter().filter(|m| **m == InverterMode::On).count();
    let mut best = maximise(curves, &free, demand_w, 0.0);
    let (least, price) = (best.bound, best.price);
    best.bound = f64::INFINITY;
    if least.is_infinite() {
        return best;
    }
    let mut open = Vec::new();
    for (count, bound) in bounds_by_count(curves, &free, demand_w, price).into_iter().enumerate() {
        let commitment = Commitment { count: Some(n_on + count), ..free.clone() };
        open.push(Node { bound: bound.max(least), commitment, border: None });
    }
    // Bounds of nodes that are not solved: within rounding of the best leaf, or beyond the limit of nodes.
    let mut floor = f64::INFINITY;
    // The lowest bound next, the oldest of equal ones.
    while let Some(next) = (0..open.len()).min_by(|&a, &b| open[a].bound.total_cmp(&open[b].bound)) {
        let node = open.remove(next);
        if node.bound >= best.bound - GAP * best.bound.abs() || n_nodes == 0 {
            floor = floor.min(node.bound);
            break;
        }
        n_nodes -= 1;
        let Some(border) = node.border else {
            let dual = maximise(curves, &node.commitment, demand_w, price);
            let bound = dual.bound.max(node.bound);
            let border = border_of(&node.commitment, &dual);
            let leaf = match border {
                None => dual,
                Some(_) => maximise(curves, &fixed_modes(&node.commitment, &dual), demand_w, dual.price),
            };
            if leaf.bound < best.bound {
                best = OneStepSolution { price, ..leaf };
            }
            if let (Some(_), true) = (border, bound.is_finite()) {
                open.push(Node { bound, commitment: node.commitment, border });
            }
            continue;
        };
        for mode in [InverterMode::On, InverterMode::Off] {
            let mut commitment = node.commitment.clone();
            commitment.modes[border] = mode;
            open.push(Node { bound: node.bound, commitment, border: None });
        }
    }
    best.bound = best.bound.min(floor);
    best
}

/// The last string that the price switches on; None if all modes are determined.
fn border_of(commitment: &Commitment, dual: &OneStepSolution) -> Option<usize> {
    let n_free = commitment.modes.iter().filter(|m| **m == InverterMode::Free).count();
    if dual.n_on == 0 || dual.n_on >= n_free {
        return None;
    }
    dual.order.get(dual.n_on - 1).copied()
}

/// Commitment with the free strings fixed to their modes in the dual solution.
fn fixed_modes(commitment: &Commitment, dual: &OneStepSolution) -> Commitment {
    let mut modes = commitment.modes.clone();
    for (rank, &m) in dual.order.iter().enumerate() {
        modes[m] = if rank < dual.n_on { InverterMode::On } else { InverterMode::Off };
    }
    Commitment { modes, count: None }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{heat_w, LossCurve, Losses, Range};
    use crate::one_step::{CostCurve, OperatingTerms};
    use bess_tables::{Direction, Lut};

    const N_STRINGS: usize = 4;
    const N_GRID: u32 = 48;
    const NOMINAL_W: f64 = 100e3;
    const COSTS: Losses = Losses { availability: 0.0, derating: 1.0, inverter: 1.0, battery: 1.0 };

    /// A string without derating, with a high no-load loss of the inverter.
    struct Inverter {
        loss: LossCurve,
        terms: OperatingTerms,
    }

    impl Inverter {
        fn random(random: &mut fastrand::Rng, direction: Direction) -> Self {
            let mut between = |low: f64, high: f64| low + (high - low) * random.f64();
            let no_load_w = between(500.0, 8e3);
            let full_w = no_load_w + between(500.0, 4e3);
            let table = Lut::new("loss", vec![0.0, NOMINAL_W], vec![no_load_w, full_w]).unwrap();
            let limit_w = between(0.3, 1.0) * NOMINAL_W;
            let terms = OperatingTerms {
                direction,
                limit_w,
                deliverable_w: limit_w,
                min_power_w: 0.0,
                derating: Range::point(1.0),
                power_scale_w: Range::point(between(1e6, 6e6)),
                scale_price: 0.0,
                power_price: 0.0,
                costs: COSTS,
                shed_cost: f64::INFINITY,
            };
            Self { loss: LossCurve::new(&table, direction, NOMINAL_W), terms }
        }

        fn cost(&self, request_w: f64) -> f64 {
            if request_w == 0.0 {
                return 0.0;
            }
            let loss_w = self.loss.at(request_w).0;
            let internal_w = self.loss.internal_w(request_w, loss_w);
            loss_w + heat_w(internal_w, self.terms.power_scale_w.low, self.terms.direction)
        }
    }

    /// Minimum cost over a grid of requests; the first string that has headroom takes the remainder.
    fn least_on_a_grid(inverters: &[Inverter], demand_w: f64) -> f64 {
        let Some((first, others)) = inverters.split_first() else { return f64::INFINITY };
        let limit_w = first.terms.limit_w;
        let all = if demand_w <= limit_w { first.cost(demand_w) } else { f64::INFINITY };
        let on_grid = (0..=N_GRID).map(|k| limit_w * f64::from(k) / f64::from(N_GRID));
        let shared = |taken_w: f64| first.cost(taken_w) + least_on_a_grid(others, demand_w - taken_w);
        on_grid.filter(|taken_w| *taken_w <= demand_w).map(shared).fold(all, f64::min)
    }

    #[test]
    fn however_few_nodes_are_solved_no_decision_costs_less_than_the_bound() {
        let mut random = fastrand::Rng::with_seed(11);
        for round in 0..12 {
            let direction = if round % 2 == 0 { Direction::Charge } else { Direction::Discharge };
            let inverters: Vec<_> =
                (0..N_STRINGS).map(|_| Inverter::random(&mut random, direction)).collect();
            let total_w: f64 = inverters.iter().map(|i| i.terms.limit_w).sum();
            let demand_w = (0.1 + 0.8 * random.f64()) * total_w;
            let curves: Vec<_> = inverters.iter().map(|i| CostCurve::new(&i.loss, i.terms)).collect();
            let least = least_on_a_grid(&inverters, demand_w);
            for n_nodes in 0..12 {
                let bound = solve_within(&curves, demand_w, n_nodes).bound;
                assert!(bound <= least * (1.0 + 1e-9), "{bound} above {least} with {n_nodes} nodes");
            }
            let bound = solve(&curves, demand_w).bound;
            assert!(bound >= 0.98 * least, "{bound} far below {least}");
        }
    }

    #[test]
    fn a_fully_derated_string_takes_its_share_with_its_inverter_off() {
        let mut random = fastrand::Rng::with_seed(5);
        for direction in [Direction::Charge, Direction::Discharge] {
            let cool = Inverter::random(&mut random, direction);
            let mut hot = Inverter::random(&mut random, direction);
            hot.terms.derating = Range::point(0.0);
            let taken_w = cool.terms.limit_w;
            let derated_w = 0.5 * hot.terms.limit_w;
            let curves = [CostCurve::new(&cool.loss, cool.terms), CostCurve::new(&hot.loss, hot.terms)];
            let cost = cool.cost(taken_w) + COSTS.derating * derated_w;
            let one_runs = Commitment { count: Some(1), ..Commitment::of(&curves) };
            let bound = maximise(&curves, &one_runs, taken_w + derated_w, 0.0).bound;
            assert!(bound <= cost * (1.0 + 1e-9), "{bound} above {cost}");
        }
    }
}

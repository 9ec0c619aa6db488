//! The one-step problem: which strings run and how the demand is shared. Branch and bound on the Lagrangian.

use std::collections::BinaryHeap;

use super::curve::CostCurve;
use super::lagrangian::{bound_at, maximise, Choice, Dual, Mode};

/// Bounds closer than this (relative) count as equal.
const GAP: f64 = 1e-10;

/// Answer of the one-step problem.
#[derive(Debug, Clone)]
pub(crate) struct OneStep {
    /// No decision costs less (infinite if the demand cannot be met).
    pub bound: f64,
    /// Requests of the best choice found; they sum to the demand [W].
    pub request_w: Vec<f64>,
    /// What that choice sheds [W].
    pub shed_w: f64,
}

struct Node {
    bound: f64,
    choice: Choice,
    /// Solved already: the string at the border between on and off, to branch on.
    border: Option<usize>,
    order: usize,
}

impl PartialEq for Node {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}
impl Eq for Node {}
impl PartialOrd for Node {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Node {
    /// Lowest bound on top of the heap, then the older node.
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        other.bound.total_cmp(&self.bound).then(other.order.cmp(&self.order))
    }
}

/// Solves the one-step problem. Branches first on how many strings run (like strings are then no trouble, because
/// the Lagrangian of a number has no gap for them), then on the string at the border.
pub(crate) fn solve(curves: &[CostCurve], demand_w: f64) -> OneStep {
    let n = curves.len();
    let free = Choice::free(n);
    let root = maximise(curves, &free, demand_w, 0.0);
    let mut best = OneStep { bound: f64::INFINITY, request_w: root.request_w, shed_w: root.shed_w };
    if root.bound.is_infinite() {
        return best;
    }
    let mut heap = BinaryHeap::new();
    for count in 0..=n {
        let choice = Choice { count: Some(count), ..free.clone() };
        let bound = bound_at(curves, &choice, demand_w, root.price).max(root.bound);
        heap.push(Node { bound, choice, border: None, order: count });
    }
    let mut order = n;
    // Bounds of what was set aside although it might beat the best leaf by a rounding error.
    let mut floor = f64::INFINITY;
    let mut budget = 60 + 8 * n;
    while let Some(node) = heap.pop() {
        if node.bound >= best.bound - GAP * best.bound.abs() || budget == 0 {
            floor = floor.min(node.bound);
            break;
        }
        budget -= 1;
        let Some(border) = node.border else {
            let dual = maximise(curves, &node.choice, demand_w, root.price);
            let bound = dual.bound.max(node.bound);
            let border = border_of(&node.choice, &dual);
            let leaf = match border {
                None => dual,
                Some(_) => maximise(curves, &decided(&node.choice, &dual), demand_w, dual.price),
            };
            if leaf.bound < best.bound {
                best = OneStep { bound: leaf.bound, request_w: leaf.request_w, shed_w: leaf.shed_w };
            }
            if let (Some(_), true) = (border, bound.is_finite()) {
                order += 1;
                heap.push(Node { bound, choice: node.choice, border, order });
            }
            continue;
        };
        for mode in [Mode::On, Mode::Off] {
            let mut choice = node.choice.clone();
            choice.modes[border] = mode;
            order += 1;
            heap.push(Node { bound: node.bound, choice, border: None, order });
        }
    }
    best.bound = best.bound.min(floor);
    best
}

/// The last string that the price switches on, unless nothing is left to decide.
fn border_of(choice: &Choice, dual: &Dual) -> Option<usize> {
    let n_free = choice.modes.iter().filter(|m| **m == Mode::Free).count();
    if dual.n_on == 0 || dual.n_on >= n_free {
        return None;
    }
    dual.order.get(dual.n_on - 1).copied()
}

/// All strings fixed as the price has them.
fn decided(choice: &Choice, dual: &Dual) -> Choice {
    let mut modes = choice.modes.clone();
    for (rank, &m) in dual.order.iter().enumerate() {
        modes[m] = if rank < dual.n_on { Mode::On } else { Mode::Off };
    }
    Choice { modes, count: None }
}

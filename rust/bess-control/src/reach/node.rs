//! Nodes of the branch and bound: sets of schedules, and their tightening before they are bounded.

use super::cell::{Cell, REQUEST_ROUNDING};
use crate::model::{ControlHorizon, Range, StateBox};

/// Maximum number of passes over all strings and steps, alternately forward and backward.
const PASSES: usize = 4;
/// Minimum tightening of a request range (share of nominal power) or an SOC range for another pass.
const MIN_TIGHTENING: f64 = 0.01;
/// Relative safety margin of a limit of the availability loss, for the rounding of sums.
const BUDGET_ROUNDING: f64 = 1e-9;
/// Maximum distance from the SOC limit at the end of a step with availability loss.
pub(super) const SOC_MARGIN: f64 = 1e-9;

/// All schedules with requests in these ranges, `(M, T)` [W], whose states are in these boxes, `(M, T + 1)`.
#[derive(Debug, Clone)]
pub struct Node {
    /// Magnitudes [W].
    pub requests_w: Vec<Range>,
    /// At the start of each step, and at the end of the last.
    pub boxes: Vec<StateBox>,
    /// Whether a string may have availability loss in a step, `(M, T)`.
    pub may_shed: Vec<bool>,
    /// Operating ranges of the strings of a tightened node, `(M, T)`; of others, empty.
    pub cells: Vec<Cell>,
    /// Maximum availability loss of each string in a step of a tightened node, `(M, T)` [W]; of others, empty.
    pub max_shed_w: Vec<f64>,
}

impl ControlHorizon {
    /// Tightens a node to the schedules that meet the demand with a total availability loss of at most `budget_w`; None if empty.
    pub fn tighten_node(&self, node: &Node, budget_w: f64) -> Option<Node> {
        let (n_strings, n_steps) = (self.n_strings(), self.n_steps());
        let budget_w = budget_w * (1.0 + BUDGET_ROUNDING);
        let mut node = node.untightened();
        let mut cells = vec![Cell::NONE; n_strings * n_steps];
        let most = |may_shed: &bool| if *may_shed { budget_w } else { 0.0 };
        let mut max_shed_w: Vec<f64> = node.may_shed.iter().map(most).collect();
        for pass in 0..PASSES {
            let mut gain = 0.0_f64;
            for t in 0..n_steps {
                self.balance(&mut node.requests_w, t)?;
            }
            for m in 0..n_strings {
                let (string, limit_w) = (self.string(m), self.string(m).nominal_w());
                for step in 0..n_steps {
                    let t = if pass % 2 == 0 { step } else { n_steps - 1 - step };
                    let (i, b) = (m * n_steps + t, m * (n_steps + 1) + t);
                    let interval = &self.intervals[t];
                    let from = (&node.boxes[b], &node.requests_w[i]);
                    let (cell, soc, requests_w) =
                        string.cell_towards(from, interval, &node.boxes[b + 1], max_shed_w[i])?;
                    gain = gain.max(node.boxes[b].soc.width() - soc.width());
                    gain = gain.max((node.requests_w[i].width() - requests_w.width()) / limit_w);
                    node.boxes[b].soc = soc;
                    let end = node.boxes[b + 1].intersection(&cell.end);
                    if end.is_empty() {
                        return None;
                    }
                    gain = gain.max(node.boxes[b + 1].soc.width() - end.soc.width());
                    node.boxes[b + 1] = end;
                    node.requests_w[i] = requests_w;
                    cells[i] = cell;
                }
            }
            let min_w: f64 = cells.iter().map(|cell| cell.shed_w.low).sum();
            if min_w > budget_w + REQUEST_ROUNDING * self.string(0).nominal_w() {
                return None;
            }
            for (i, cell) in cells.iter().enumerate() {
                let m = i / n_steps;
                let others_w = min_w - cell.shed_w.low;
                max_shed_w[i] = max_shed_w[i].min(budget_w - others_w).min(cell.shed_w.high).max(0.0);
                // A request is the sum of delivered power, derating loss and availability loss.
                let kept = cell.derating.low;
                if kept > 0.0 {
                    let slack_w = REQUEST_ROUNDING * self.string(m).nominal_w();
                    let little_w = if kept < 1.0 { self.string(m).min_power_w() } else { 0.0 };
                    let max_w =
                        (cell.delivered_w.high.max(0.0) + max_shed_w[i].max(little_w)) / kept + slack_w;
                    let requests = &mut node.requests_w[i];
                    gain = gain.max((requests.high - max_w) / self.string(m).nominal_w());
                    requests.high = requests.high.min(max_w);
                }
            }
            if gain < MIN_TIGHTENING {
                break;
            }
        }
        for t in 0..n_steps {
            self.balance(&mut node.requests_w, t)?;
        }
        Some(Node { cells, max_shed_w, ..node })
    }

    /// Tightens the requests of a step to the demand minus the ranges of the other strings; None if infeasible.
    fn balance(&self, requests_w: &mut [Range], t: usize) -> Option<()> {
        let (n_strings, n_steps) = (self.n_strings(), self.n_steps());
        let total = |of: fn(&Range) -> f64, requests_w: &[Range]| -> f64 {
            (0..n_strings).map(|m| of(&requests_w[m * n_steps + t])).sum()
        };
        let slack_w = REQUEST_ROUNDING * self.total_limit_w[t];
        for m in 0..n_strings {
            let (low, high) = (total(|r| r.low, requests_w), total(|r| r.high, requests_w));
            let own = &mut requests_w[m * n_steps + t];
            let (others_low, others_high) = (low - own.low, high - own.high);
            own.low = own.low.max(self.demand_w[t] - others_high - slack_w);
            own.high = own.high.min(self.demand_w[t] - others_low + slack_w);
            if own.low > own.high {
                if own.low > own.high + 2.0 * slack_w {
                    return None;
                }
                *own = Range { low: own.high, high: own.low };
            }
        }
        Some(())
    }

    /// The node of all schedules with states in these boxes.
    pub fn root(&self, boxes: Vec<StateBox>) -> Node {
        let cells = (0..self.n_strings()).flat_map(|m| (0..self.n_steps()).map(move |t| (m, t)));
        let requests_w: Vec<Range> = cells.map(|(m, t)| self.request_range(m, t)).collect();
        let may_shed = vec![true; requests_w.len()];
        Node { may_shed, requests_w, boxes, cells: vec![], max_shed_w: vec![] }
    }
}

impl Node {
    /// The parts below and above a request of one string in one step [W].
    pub fn branch_on_request(&self, m: usize, t: usize, at_w: f64) -> [Self; 2] {
        let place = m * self.n_steps() + t;
        let mut parts = [self.untightened(), self.untightened()];
        parts[0].requests_w[place].high = at_w;
        parts[1].requests_w[place].low = at_w;
        parts
    }

    /// The parts below and above an SOC of one string at the start of one step.
    pub fn branch_on_soc(&self, m: usize, t: usize, at: f64) -> [Self; 2] {
        let place = m * (self.n_steps() + 1) + t;
        let mut parts = [self.untightened(), self.untightened()];
        parts[0].boxes[place].soc.high = at;
        parts[1].boxes[place].soc.low = at;
        parts
    }

    /// The parts of a tightened node in which a string has no availability loss in a step, and in which it ends full (empty)
    /// enough for one.
    pub fn branch_on_full(&self, m: usize, t: usize) -> [Self; 2] {
        let n_steps = self.n_steps();
        let shed_soc = self.cells[m * n_steps + t].shed_soc;
        let mut parts = [self.untightened(), self.untightened()];
        parts[0].may_shed[m * n_steps + t] = false;
        let end = &mut parts[1].boxes[m * (n_steps + 1) + t + 1].soc;
        *end = Range {
            low: end.low.max(shed_soc.low - SOC_MARGIN).min(end.high),
            high: end.high.min(shed_soc.high + SOC_MARGIN).max(end.low),
        };
        parts
    }

    /// The same schedules, without the ranges that tightening adds.
    fn untightened(&self) -> Self {
        let Self { requests_w, boxes, may_shed, .. } = self.clone();
        Self { requests_w, boxes, may_shed, cells: vec![], max_shed_w: vec![] }
    }

    fn n_steps(&self) -> usize {
        // Each string has one more box than requests.
        self.requests_w.len() / (self.boxes.len() - self.requests_w.len()).max(1)
    }
}

//! Evenly spaced nodes of SOC or temperature.

use bess_tables::Direction;

use crate::model::Range;

/// Nodes at both ends of a range and between its cells.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Nodes {
    low: f64,
    pub step: f64,
    pub len: usize,
}

impl Nodes {
    pub fn over(range: Range, cells: usize) -> Self {
        Self { low: range.low, step: (range.high - range.low) / cells as f64, len: cells + 1 }
    }

    /// Value at a node or at a position between two nodes.
    #[inline]
    pub fn at(&self, node: f64) -> f64 {
        self.low + self.step * node
    }

    /// Position of a value between the nodes; beyond their ends, that of the end.
    #[inline]
    pub fn position(&self, value: f64) -> f64 {
        ((value - self.low) / self.step).clamp(0.0, (self.len - 1) as f64)
    }

    /// Lower node of the cell of a value, and the share of the cell below it.
    #[inline]
    pub fn locate(&self, value: f64) -> (usize, f64) {
        let x = self.position(value);
        let node = (x as usize).min(self.len - 2);
        (node, x - node as f64)
    }

    /// The `k`-th next node in the direction of SOC, if there is one.
    #[inline]
    pub fn after(&self, direction: Direction, from: usize, k: usize) -> Option<usize> {
        match direction {
            Direction::Charge => Some(from + k).filter(|&to| to < self.len),
            Direction::Discharge => from.checked_sub(k),
        }
    }
}

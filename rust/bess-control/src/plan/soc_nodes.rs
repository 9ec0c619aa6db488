//! Evenly spaced nodes of SOC between which strings move without interpolation.

use bess_tables::Direction;

use crate::model::StringModel;

/// Nodes over the SOC window of a string.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SocNodes {
    low: f64,
    pub step: f64,
    pub len: usize,
}

impl SocNodes {
    /// Nodes at both ends of the window and between `cells` cells.
    pub fn of(string: &StringModel, cells: usize) -> Self {
        let p = &string.parameters;
        Self { low: p.soc_min, step: (p.soc_max - p.soc_min) / cells as f64, len: cells + 1 }
    }

    /// SOC of a node or of a position between two nodes.
    #[inline]
    pub fn at(&self, node: f64) -> f64 {
        self.low + self.step * node
    }

    /// Lower node of the cell of a SOC, and the share of the cell below it.
    #[inline]
    pub fn locate(&self, soc: f64) -> (usize, f64) {
        let x = ((soc - self.low) / self.step).clamp(0.0, (self.len - 1) as f64);
        let node = (x as usize).min(self.len - 2);
        (node, x - node as f64)
    }

    /// The `k`-th next node, if it is within the window.
    #[inline]
    pub fn after(&self, direction: Direction, from: usize, k: usize) -> Option<usize> {
        match direction {
            Direction::Charge => Some(from + k).filter(|&to| to < self.len),
            Direction::Discharge => from.checked_sub(k),
        }
    }
}

//! Strings whose resistance was measured over SOC, temperature and C-rate.
//!
//! The table is read at the C-rate that flows, which depends on the resistance: a fixed point, found by four
//! passes from the current without any resistance. Each pass reduces the error by a factor of about
//! `d ln R / d ln I * R I / V`, some 1e-2, so 1e-8 of the effect of the C-rate remains after four. This error does
//! not affect the energy balance: power, heat and node heat use the same resistance.

use bess_tables::{Axis, Direction, Grid, Resistance};

const PASSES: usize = 4;

/// The fixed point of one string at a time, and its work space.
#[derive(Debug, Clone, Default)]
pub(crate) struct MeasuredResistance {
    /// Table segment and share of every node.
    place: Vec<(usize, f64)>,
    /// Mean over the nodes of the hat function of each temperature knot: the mean resistance is their product.
    weight: Vec<f64>,
    /// Resistance over the temperature knots, at one SOC and C-rate.
    row: Vec<f64>,
}

impl MeasuredResistance {
    /// Work space for the largest table of these strings.
    pub(crate) fn new<'a>(nodes: usize, tables: impl Iterator<Item = &'a Resistance>) -> Self {
        let knots = tables
            .filter_map(|table| match table {
                Resistance::Measured { charge, .. } => Some(charge[0].y().len()),
                Resistance::Switched { .. } => None,
            })
            .max()
            .unwrap_or(0);
        Self { place: vec![(0, 0.0); nodes], weight: vec![0.0; knots], row: vec![0.0; knots] }
    }

    /// Mean resistance [Ohm] at the fixed point of `current_a(resistance)`, the tables times `growth`; afterwards
    /// [`Self::node`] gives that of every node.
    pub(crate) fn solve(
        &mut self,
        (c_rate, grids): (&Axis, &[Grid]),
        growth: f64,
        soc: f64,
        node_temperatures_c: impl Iterator<Item = f64>,
        capacity_ah: f64,
        current_a: impl Fn(f64) -> f64,
    ) -> f64 {
        self.place_nodes(grids[0].y(), node_temperatures_c);
        let mut resistance = 0.0;
        for _ in 0..PASSES {
            let c = current_a(resistance).abs() / capacity_ah;
            self.fill_row(c_rate, grids, growth, soc, c);
            resistance = self.row.iter().zip(&self.weight).map(|(r, w)| r * w).sum();
        }
        resistance
    }

    /// Resistance of a string with the temperature of this node throughout [Ohm].
    pub(crate) fn node(&self, node: usize) -> f64 {
        let (segment, share) = self.place[node];
        let low = self.row[segment];
        if share == 0.0 {
            return low;
        }
        low + share * (self.row[segment + 1] - low)
    }

    fn place_nodes(&mut self, knots: &Axis, node_temperatures_c: impl Iterator<Item = f64>) {
        self.weight.fill(0.0);
        let per_node = 1.0 / self.place.len() as f64;
        for (place, temperature_c) in self.place.iter_mut().zip(node_temperatures_c) {
            let (segment, share) = knots.locate(temperature_c);
            *place = (segment, share);
            self.weight[segment] += per_node * (1.0 - share);
            if share > 0.0 {
                self.weight[segment + 1] += per_node * share;
            }
        }
    }

    fn fill_row(&mut self, c_rate: &Axis, grids: &[Grid], growth: f64, soc: f64, c: f64) {
        let (low, share) = c_rate.locate(c);
        let high = (low + 1).min(grids.len() - 1);
        let knots = grids[0].y();
        for (value, &knot) in self.row.iter_mut().zip(knots.iter()) {
            let at_low = grids[low].at(soc, knot);
            *value = growth * (at_low + share * (grids[high].at(soc, knot) - at_low));
        }
    }
}

/// The measured tables of a direction; nothing for strings with switched tables.
pub(crate) fn tables(resistance: &Resistance, direction: Direction) -> Option<(&Axis, &[Grid])> {
    match resistance {
        Resistance::Switched { .. } => None,
        Resistance::Measured { c_rate, charge, discharge, .. } => {
            Some((c_rate, direction.pick(charge, discharge)))
        }
    }
}

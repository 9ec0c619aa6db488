//! The grid of SOC and temperature of identical strings, and their moves between its nodes.

use bess_tables::Direction;

use crate::model::{Losses, Range, StringModel, StringState};
use crate::plan::problem::PlanProblem;
use crate::plan::soc_nodes::SocNodes;

/// SOC change of a step at full power [nodes].
const NODES_PER_STEP: f64 = 10.0;
/// Minimum and maximum number of SOC nodes.
const SOC_NODES: (usize, usize) = (40, 400);
pub(super) const TEMPERATURE_NODES: usize = 28;
/// Margin of the grid above the hottest string without derating [K].
const WARMING_K: f64 = 35.0;

/// Four successive temperature nodes and their weights (cubic convolution; linear at the ends).
pub(super) type Stencil = (usize, [f64; 4]);

/// Moves of a string from every node, in one direction; arrays `(steps of SOC, soc, n_temperature)`, from none on.
#[derive(Default)]
pub(super) struct Moves {
    pub(super) request_w: Vec<f64>,
    pub(super) losses: Vec<Losses>,
    pub(super) current_a: Vec<f64>,
}

/// The grid of identical strings.
pub(super) struct Grid {
    pub(super) soc: SocNodes,
    coolest_c: f64,
    temperature_step_k: f64,
    charge: Moves,
    discharge: Moves,
}

impl Grid {
    pub(super) fn new(problem: &PlanProblem<'_>, m: usize) -> Self {
        let string = &problem.model.strings()[m];
        let p = &string.parameters;
        let dt_h = problem.intervals[0].dt_h;
        let cells = ((p.soc_max - p.soc_min) / problem.soc_of_full_step(m) * NODES_PER_STEP).round() as usize;
        let cells = cells.clamp(SOC_NODES.0, SOC_NODES.1);
        let Range { low: coolest_c, high: warmest } = problem.temperatures_c(0..problem.n_strings());
        let factor = &p.derating.factor;
        let stop = factor.x().last().copied().filter(|&c| factor.at(c) < 1.0).unwrap_or(warmest + WARMING_K);
        let temperature_step_k = (stop.max(warmest + 1.0) - coolest_c) / (TEMPERATURE_NODES - 1) as f64;
        let mut grid = Self {
            soc: SocNodes::of(string, cells),
            coolest_c,
            temperature_step_k,
            charge: Moves::default(),
            discharge: Moves::default(),
        };
        grid.charge = grid.moves(string, Direction::Charge, dt_h);
        grid.discharge = grid.moves(string, Direction::Discharge, dt_h);
        grid
    }

    /// All moves to SOC nodes: request and losses with the mean voltage and resistance of the move. Infeasible moves have an
    /// infinite request. Moves whose internal power is below the no-load loss have a request below 0, straight on from the
    /// table: requests between it and that of the next move exist. The first move from each node above nominal power is kept for
    /// the same reason.
    fn moves(&self, string: &StringModel, direction: Direction, dt_h: f64) -> Moves {
        let p = &string.parameters;
        let curve = string.loss(direction);
        let highest_w = curve.at(string.nominal_w()).1;
        let no_load_w = curve.internal_w(0.0, curve.at(0.0).0);
        let mut out = Moves::default();
        for k in 0.. {
            let current_a = self.soc.step * k as f64 * p.capacity_ah / dt_h;
            let mut any = false;
            for (i, j) in (0..self.soc.len).flat_map(|i| (0..TEMPERATURE_NODES).map(move |j| (i, j))) {
                let mut request_w = f64::INFINITY;
                let mut losses = Losses::default();
                if let Some(to) = self.soc.after(direction, i, k) {
                    let at = |share: f64| {
                        let soc = self.soc.at(i as f64 + share * (to as f64 - i as f64));
                        string.coefficients(
                            direction,
                            StringState { soc, temperature_c: self.temperature_c(j) },
                        )
                    };
                    let (start, middle, end) = (at(0.0), at(0.5), at(1.0));
                    let mean = |a: f64, b: f64, c: f64| (a + 4.0 * b + c) / 6.0;
                    let volt = mean(start.voltage_v, middle.voltage_v, end.voltage_v);
                    let ohm = mean(start.resistance_ohm, middle.resistance_ohm, end.resistance_ohm);
                    let heat_w = ohm * current_a * current_a;
                    let internal_w = volt * current_a - direction.sign() * heat_w;
                    let has_root = direction == Direction::Charge || 2.0 * ohm * current_a <= volt;
                    let allowed = p.voltage_allows(direction, volt, ohm * current_a);
                    if has_root && allowed && middle.derating > 0.0 {
                        let power_w = match internal_w - no_load_w {
                            below_w if below_w < 0.0 => below_w,
                            _ => curve.largest_power(internal_w) + (internal_w - highest_w).max(0.0),
                        };
                        request_w = power_w / middle.derating;
                        any |= request_w <= string.nominal_w();
                        losses = Losses {
                            availability: 0.0,
                            derating: request_w - power_w,
                            inverter: curve.at(power_w.max(0.0)).0,
                            battery: heat_w,
                        };
                    }
                }
                out.request_w.push(request_w);
                out.losses.push(losses);
                out.current_a.push(current_a);
            }
            if !any {
                break;
            }
        }
        out
    }

    pub(super) fn moves_in(&self, direction: Direction) -> &Moves {
        direction.pick(&self.charge, &self.discharge)
    }

    pub(super) fn size(&self) -> usize {
        self.soc.len * TEMPERATURE_NODES
    }

    pub(super) fn temperature_c(&self, j: usize) -> f64 {
        self.coolest_c + self.temperature_step_k * j as f64
    }

    pub(super) fn stencil(&self, temperature_c: f64) -> Stencil {
        let last = TEMPERATURE_NODES - 1;
        let y = ((temperature_c - self.coolest_c) / self.temperature_step_k).clamp(0.0, last as f64);
        let j = (y as usize).min(last - 1);
        let b = y - j as f64;
        if j == 0 || j == last - 1 {
            let base = if j == 0 { 0 } else { last - 3 };
            let mut weights = [0.0; 4];
            weights[j - base] = 1.0 - b;
            weights[j - base + 1] = b;
            return (base, weights);
        }
        let (b2, b3) = (b * b, b * b * b);
        let weights = [
            -0.5 * b + b2 - 0.5 * b3,
            1.0 - 2.5 * b2 + 1.5 * b3,
            0.5 * b + 2.0 * b2 - 1.5 * b3,
            -0.5 * b2 + 0.5 * b3,
        ];
        (j - 1, weights)
    }
}

#[inline]
pub(super) fn along(row: &[f64], (base, w): &Stencil) -> f64 {
    let r = &row[*base..*base + 4];
    w[0] * r[0] + w[1] * r[1] + w[2] * r[2] + w[3] * r[3]
}

//! Moves of strings in one direction between SOC nodes, and bounds of their deviation from linear interpolation.

use bess_tables::Direction;

use super::delivered::Delivered;
use super::Kind;
use crate::model::{Range, StateBox, StringState};

/// Flows of a string at a corner: a state node with the current of a number of SOC steps.
#[derive(Clone, Copy, Default)]
pub(super) struct Corner {
    pub(super) heat_w: f64,
    pub(super) loss_w: f64,
    pub(super) power_w: f64,
}

/// Largest deviations from linear interpolation between the corners of a box of states and currents.
#[derive(Clone, Copy, Default)]
pub(super) struct BoxErrors {
    /// Heat below and above [W].
    pub(super) heat_below_w: f64,
    pub(super) heat_above_w: f64,
    /// Internal power, in either direction [W].
    pub(super) internal_w: f64,
    /// Delivered power over internal power: below and above its chords [W].
    pub(super) convex_w: f64,
    pub(super) concave_w: f64,
    /// Maximum difference of heat at one temperature, and of delivered power over temperature [W].
    pub(super) heat_range_w: f64,
    pub(super) power_range_w: f64,
    /// Minimum request that leads into the box, and maximum delivered power in it [W].
    pub(super) min_request_w: f64,
    pub(super) max_power_w: f64,
}

/// Data of one direction that do not depend on prices. Corners are `(SOC step, node)`, boxes `(SOC step, cell)`.
pub(super) struct Moves {
    pub(super) direction: Direction,
    /// Current of one SOC step [A].
    pub(super) current_a: f64,
    /// Minimum request of each SOC step [W].
    min_requests_w: Vec<f64>,
    pub(super) corners: Vec<Corner>,
    pub(super) errors: Vec<BoxErrors>,
    /// Smallest and largest slope of delivered over internal power.
    pub(super) slopes: Range,
    /// Of an inverter that charges with less than its no-load loss, and thus discharges the battery [W].
    pub(super) max_drawing_w: f64,
    pub(super) min_drawing_loss_w: f64,
    /// Maximum SOC and heat that such an inverter takes from the battery, for each cell.
    pub(super) drawn: Vec<(f64, f64)>,
}

/// Voltage and resistance of a cell: ranges, maximum change over SOC, and error of bilinear interpolation (resistance: below and
/// above).
pub(super) struct CellBounds {
    pub(super) voltage_v: Range,
    pub(super) resistance_ohm: Range,
    pub(super) voltage_change_v: f64,
    pub(super) resistance_change_ohm: f64,
    pub(super) voltage_error_v: f64,
    pub(super) resistance_error_ohm: (f64, f64),
}

impl Moves {
    /// Number of SOC steps up to the last that a request of at most `cap_w` reaches.
    pub(super) fn n_boxes_within(&self, cap_w: f64) -> usize {
        self.min_requests_w.iter().rposition(|min_w| *min_w <= cap_w).map_or(0, |k| k + 1)
    }
}

impl Kind<'_> {
    /// Middle one of the SOC nodes at which a box may end; None if no triangle of it ends within the window.
    pub(super) fn middle(&self, direction: Direction, i: usize, k: usize) -> Option<usize> {
        match direction {
            Direction::Charge => Some(i + k + 1).filter(|&to| to < self.soc.len),
            Direction::Discharge => i.checked_sub(k),
        }
    }

    /// Corners of a box that lead to nodes, as SOC node and SOC steps, for either temperature.
    pub(super) fn used(
        &self,
        direction: Direction,
        i: usize,
        k: usize,
    ) -> impl Iterator<Item = (usize, usize)> + '_ {
        [(i, k), (i + 1, k), (i, k + 1), (i + 1, k + 1)]
            .into_iter()
            .filter(move |&(i, k)| self.soc.after(direction, i, k).is_some())
    }

    pub(super) fn moves(&self, direction: Direction, max_w: f64) -> Option<Moves> {
        let string = self.string();
        let p = &string.parameters;
        let dt_h = self.problem.dt_h();
        let current_a = self.soc.step * p.capacity_ah / dt_h;
        let curve = string.loss(direction);
        let delivered = Delivered::new(curve)?;
        let n_temperatures = self.n_temperatures();
        // Voltage and resistance at each node, and their errors of bilinear interpolation in each cell.
        let node = |i: usize, j: usize| StringState {
            soc: self.soc.at(i as f64),
            temperature_c: self.temperature_c[j],
        };
        let at: Vec<(f64, f64)> = (0..self.n_nodes())
            .map(|x| {
                let c = string.coefficients(direction, node(x / n_temperatures, x % n_temperatures));
                (c.voltage_v, c.resistance_ohm)
            })
            .collect();
        let cells: Vec<(usize, usize)> =
            (0..self.soc.len - 1).flat_map(|i| (0..n_temperatures - 1).map(move |j| (i, j))).collect();
        let bounds: Vec<CellBounds> = cells.iter().map(|&(i, j)| self.bounds(direction, i, j, &at)).collect();
        let max_drawn_w = (-delivered.internal_w[0]).max(0.0);
        let drawn = bounds.iter().map(|bounds| {
            let (v, r) = (bounds.voltage_v.low, bounds.resistance_ohm.high);
            let root = (1.0 - 4.0 * r * max_drawn_w / (v * v)).max(0.0).sqrt();
            let drawn_a = 2.0 * max_drawn_w / (v * (1.0 + root));
            (drawn_a * dt_h / p.capacity_ah, r * drawn_a * drawn_a)
        });
        let sign = -direction.sign();
        let mut out = Moves {
            direction,
            current_a,
            min_requests_w: vec![],
            corners: vec![],
            errors: vec![],
            slopes: delivered.slopes(),
            max_drawing_w: curve.max_drawing_w(),
            min_drawing_loss_w: curve.loss().iter().copied().fold(f64::INFINITY, f64::min).max(0.0),
            drawn: drawn.collect(),
        };
        let internal_w = |(v, r): (f64, f64), current_a: f64| current_a * (v + sign * r * current_a);
        let add_corners = |corners: &mut Vec<Corner>, k: usize| {
            let current_a = current_a * k as f64;
            corners.extend(at.iter().map(|&(v, r)| {
                let internal_w = internal_w((v, r), current_a);
                let power_w = delivered.at(internal_w);
                let loss_w = delivered.loss_w(internal_w, power_w);
                Corner { heat_w: r * current_a * current_a, loss_w, power_w }
            }));
        };
        add_corners(&mut out.corners, 0);
        for k in 0..self.soc.len - 1 {
            let (from_a, to_a) = (current_a * k as f64, current_a * (k + 1) as f64);
            let mut any = false;
            for (&(i, j), bounds) in cells.iter().zip(&bounds) {
                let lowest_v = bounds.voltage_v.low;
                let lowest_r = direction.pick(bounds.resistance_ohm.low, bounds.resistance_ohm.high);
                let min_w = delivered.at(internal_w((lowest_v, lowest_r), from_a)).max(0.0);
                let min_request_w = min_w / self.factor[j].high;
                let possible = min_request_w <= max_w && self.middle(direction, i, k).is_some();
                if !possible {
                    out.errors.push(BoxErrors { min_request_w: f64::INFINITY, ..BoxErrors::default() });
                    continue;
                }
                any = true;
                let mut g = Range::EMPTY;
                let (mut heat_range_w, mut power_range_w) = (0.0_f64, 0.0_f64);
                for j in [j, j + 1] {
                    let mut heat_w = Range::EMPTY;
                    for (i, k) in self.used(direction, i, k) {
                        let (v, r) = at[i * n_temperatures + j];
                        let current_a = current_a * k as f64;
                        g.include(internal_w((v, r), current_a));
                        heat_w.include(r * current_a * current_a);
                    }
                    heat_range_w = heat_range_w.max(heat_w.high - heat_w.low);
                }
                for (i, k) in self.used(direction, i, k) {
                    let power_w =
                        |j: usize| delivered.at(internal_w(at[i * n_temperatures + j], current_a * k as f64));
                    power_range_w = power_range_w.max((power_w(j + 1) - power_w(j)).abs());
                }
                // Errors within a triangle are b (1 - b) or a b times the products of its sides, and these factors at most 1/4.
                let product_w = 0.5 * bounds.resistance_change_ohm * to_a * current_a;
                let square = to_a * to_a;
                let heat_below_w = 0.25 * bounds.resistance_ohm.high * current_a * current_a
                    + product_w
                    + bounds.resistance_error_ohm.0 * square;
                let heat_above_w = product_w + bounds.resistance_error_ohm.1 * square;
                let internal_w = 0.25 * bounds.voltage_change_v * current_a
                    + bounds.voltage_error_v * to_a
                    + heat_below_w.max(heat_above_w);
                let (convex_w, concave_w) = delivered.bends(&g);
                let max_power_w = delivered.at(g.high) + out.slopes.high * internal_w;
                out.errors.push(BoxErrors {
                    heat_below_w,
                    heat_above_w,
                    internal_w,
                    convex_w,
                    concave_w,
                    heat_range_w,
                    power_range_w,
                    min_request_w,
                    max_power_w: max_power_w.max(0.0),
                });
            }
            if !any {
                out.errors.truncate(k * self.n_cells());
                break;
            }
            let min_w = out.errors[k * self.n_cells()..].iter().map(|error| error.min_request_w);
            out.min_requests_w.push(min_w.fold(f64::INFINITY, f64::min));
            add_corners(&mut out.corners, k + 1);
        }
        Some(out)
    }

    /// Ranges and interpolation errors of voltage and resistance in a cell.
    pub(super) fn bounds(&self, direction: Direction, i: usize, j: usize, at: &[(f64, f64)]) -> CellBounds {
        let n_temperatures = self.n_temperatures();
        let soc = Range { low: self.soc.at(i as f64), high: self.soc.at((i + 1) as f64) };
        let temperature_c = Range { low: self.temperature_c[j], high: self.temperature_c[j + 1] };
        let [low_low, low_high] = [at[i * n_temperatures + j], at[i * n_temperatures + j + 1]];
        let [high_low, high_high] = [at[(i + 1) * n_temperatures + j], at[(i + 1) * n_temperatures + j + 1]];
        let mut bounds = CellBounds {
            voltage_v: Range::EMPTY,
            resistance_ohm: Range::EMPTY,
            voltage_change_v: (high_low.0 - low_low.0).abs().max((high_high.0 - low_high.0).abs()),
            resistance_change_ohm: (high_low.1 - low_low.1).abs().max((high_high.1 - low_high.1).abs()),
            voltage_error_v: 0.0,
            resistance_error_ohm: (0.0, 0.0),
        };
        for (v, r) in [low_low, low_high, high_low, high_high] {
            bounds.voltage_v.include(v);
            bounds.resistance_ohm.include(r);
        }
        for piece in self.string().pieces(direction, &StateBox { soc, temperature_c }) {
            for corner in self.string().corners(direction, &piece) {
                let (v, r) = (corner.voltage_v, corner.resistance_ohm);
                bounds.voltage_v.include(v);
                bounds.resistance_ohm.include(r);
                let a = (corner.soc - soc.low) / (soc.high - soc.low);
                let b = (corner.temperature_c - temperature_c.low) / (temperature_c.high - temperature_c.low);
                let between = |of: &dyn Fn((f64, f64)) -> f64| {
                    (1.0 - a) * ((1.0 - b) * of(low_low) + b * of(low_high))
                        + a * ((1.0 - b) * of(high_low) + b * of(high_high))
                };
                bounds.voltage_error_v = bounds.voltage_error_v.max((v - between(&|x| x.0)).abs());
                let resistance = r - between(&|x| x.1);
                bounds.resistance_error_ohm.0 = bounds.resistance_error_ohm.0.max(-resistance);
                bounds.resistance_error_ohm.1 = bounds.resistance_error_ohm.1.max(resistance);
            }
        }
        bounds
    }
}

//! Linear bounds of the coefficients over a box of states, for the convex program.

use bess_tables::Direction;

use crate::model::{Corner, Piece, StateBox, StringModel, StringState};

/// `V^2 / R <= power_scale_w + power_scale_per_soc soc + power_scale_per_k tau` and
/// `1 - k >= derated + derated_per_k tau` for every state of a box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Planes {
    /// [W].
    pub power_scale_w: f64,
    /// [W].
    pub power_scale_per_soc: f64,
    /// [W/K].
    pub power_scale_per_k: f64,
    /// Dimensionless.
    pub derated: f64,
    /// [1/K].
    pub derated_per_k: f64,
}

impl StringModel {
    /// The lowest planes (`1 - k`: the highest) at one state of the box.
    ///
    /// Along each axis through that state the slope is that of the concave (convex) hull; then the plane is moved until it
    /// holds everywhere. Within a piece `V` and `R` are affine along each axis, so `V^2 / R` less a plane is convex along
    /// each axis and largest at a corner; `1 - k` is piecewise linear. Both are exact for a box that is a point.
    pub fn planes(&self, direction: Direction, states: &StateBox, at: StringState) -> Planes {
        let pieces = self.pieces(direction, states);
        let soc = at.soc.clamp(states.soc.low, states.soc.high);
        let temperature_c = at.temperature_c.clamp(states.temperature_c.low, states.temperature_c.high);
        let scale = |c: &Corner| c.voltage_v * c.voltage_v / c.resistance_ohm;
        let (mut over_soc, mut over_temperature) = (vec![], vec![]);
        for piece in &pieces {
            if piece.temperature_c[0] <= temperature_c && temperature_c <= piece.temperature_c[1] {
                let line = Piece { temperature_c: [temperature_c; 2], ..*piece };
                over_soc.extend(self.corners(direction, &line).iter().map(|c| (c.soc, scale(c))));
            }
            if piece.soc[0] <= soc && soc <= piece.soc[1] {
                let line = Piece { soc: [soc; 2], ..*piece };
                over_temperature
                    .extend(self.corners(direction, &line).iter().map(|c| (c.temperature_c, scale(c))));
            }
        }
        let (per_soc, per_k) = (hull_slope(&over_soc, soc), hull_slope(&over_temperature, temperature_c));
        let corners: Vec<Corner> = pieces.iter().flat_map(|piece| self.corners(direction, piece)).collect();
        // Over a wide box the two hulls may be incompatible: then one of them, or a constant, is lower.
        let lifted = |(per_soc, per_k): (f64, f64)| {
            let offset = |c: &Corner| scale(c) - per_soc * c.soc - per_k * c.temperature_c;
            (corners.iter().map(offset).fold(f64::NEG_INFINITY, f64::max), per_soc, per_k)
        };
        let (power_scale_w, power_scale_per_soc, power_scale_per_k) =
            [(per_soc, per_k), (per_soc, 0.0), (0.0, per_k), (0.0, 0.0)]
                .map(lifted)
                .into_iter()
                .min_by(|a, b| {
                    let here = |p: &(f64, f64, f64)| p.0 + p.1 * soc + p.2 * temperature_c;
                    here(a).total_cmp(&here(b))
                })
                .expect("four candidates");

        let factor = &self.parameters.derating.factor;
        let derated = |t: f64| 1.0 - factor.at(t);
        let temperatures: Vec<f64> = states.temperature_c.places(factor.x()).collect();
        let kept: Vec<_> = temperatures.iter().map(|&t| (t, -derated(t))).collect();
        let derated_per_k = -hull_slope(&kept, temperature_c);
        let lowest =
            temperatures.iter().map(|&t| derated(t) - derated_per_k * t).fold(f64::INFINITY, f64::min);
        Planes { power_scale_w, power_scale_per_soc, power_scale_per_k, derated: lowest, derated_per_k }
    }
}

/// Slope of the concave hull of points `(x, y)` at a position; 0 if all `x` are equal.
fn hull_slope(points: &[(f64, f64)], at: f64) -> f64 {
    let (mut highest, mut slope) = (f64::NEG_INFINITY, 0.0);
    for &(x0, y0) in points.iter().filter(|(x, _)| *x <= at) {
        for &(x1, y1) in points.iter().filter(|(x, _)| *x >= at) {
            if x1 > x0 {
                let rise = (y1 - y0) / (x1 - x0);
                let value = y0 + rise * (at - x0);
                if value > highest {
                    (highest, slope) = (value, rise);
                }
            }
        }
    }
    slope
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Range;
    use crate::tests::common;
    use bess_tables::Grid;

    /// The reference string, and one whose open-circuit voltage depends on temperature.
    fn strings() -> [StringModel; 2] {
        let reference = common::reference(1).strings.remove(0);
        let mut differing = reference.clone();
        for table in [&mut differing.ocv_charge, &mut differing.ocv_discharge] {
            let voltage_v = table.z().iter().flat_map(|v| [*v, v + 2.0]).collect();
            *table = Grid::new("ocv", table.x().to_vec(), vec![0.0, 50.0], voltage_v).unwrap();
        }
        [reference, differing].map(StringModel::new)
    }

    #[test]
    fn ranges_and_planes_hold_for_every_state_of_a_box_and_planes_touch_at_a_point() {
        let (strings, mut random) = (strings(), fastrand::Rng::with_seed(9));
        for case in 0..2000 {
            let (string, direction) =
                (&strings[case % 2], [Direction::Charge, Direction::Discharge][case / 2 % 2]);
            let width = [0.0, 0.01, 0.1, 0.5][case / 4 % 4];
            let mut range = |low: f64, high: f64, width: f64| {
                let low = low + (high - low - width) * random.f64();
                Range { low, high: low + width }
            };
            let states =
                StateBox { soc: range(0.0, 1.0, width), temperature_c: range(-10.0, 62.0, 50.0 * width) };
            let mut inside = |range: &Range| range.low + (range.high - range.low) * random.f64();
            let mut state =
                || StringState { soc: inside(&states.soc), temperature_c: inside(&states.temperature_c) };
            let ranges = string.ranges(direction, &states);
            let planes = string.planes(direction, &states, state());
            for state in (0..20).map(|_| state()) {
                let c = string.coefficients(direction, state);
                let scale_w = c.voltage_v * c.voltage_v / c.resistance_ohm;
                for (range, value) in [
                    (ranges.derating, c.derating),
                    (ranges.voltage_v, c.voltage_v),
                    (ranges.resistance_ohm, c.resistance_ohm),
                    (ranges.power_scale_w, scale_w),
                ] {
                    let slack = 1e-12 * value;
                    assert!(range.low <= value + slack && value <= range.high + slack, "{range:?}: {value}");
                }
                let plane_w = |p: &Planes| {
                    p.power_scale_w
                        + p.power_scale_per_soc * state.soc
                        + p.power_scale_per_k * state.temperature_c
                };
                assert!(plane_w(&planes) >= scale_w * (1.0 - 1e-12), "{planes:?} at {state:?}");
                let derated = planes.derated + planes.derated_per_k * state.temperature_c;
                assert!(derated <= 1.0 - c.derating + 1e-12, "{planes:?} at {state:?}");
                let touches_w = plane_w(&string.planes(direction, &state.into(), state));
                assert!((touches_w - scale_w).abs() <= 1e-9 * scale_w, "{touches_w} {scale_w}");
            }
        }
    }
}

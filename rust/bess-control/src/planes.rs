//! Straight lines over a box of states: the coefficients as a convex program may see them.

use bess_tables::Direction;

use crate::ranges::{Corner, StateBox};
use crate::StringModel;

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
    /// Planes with the slopes of the chords over the box, moved until they touch.
    ///
    /// Within a piece `V` and `R` are affine along each axis, so `V^2 / R` less a plane is convex along each axis and
    /// largest at a corner; `1 - k` is piecewise linear. Both planes are exact for a box that is a point.
    pub fn planes(&self, direction: Direction, states: &StateBox) -> Planes {
        let corners: Vec<Corner> =
            self.pieces(direction, states).iter().flat_map(|piece| self.corners(direction, piece)).collect();
        let scale = |c: &Corner| c.voltage_v * c.voltage_v / c.resistance_ohm;
        let per_soc = chord(&corners, |c| c.soc, scale);
        let per_k = chord(&corners, |c| c.temperature_c, scale);
        let offset = |c: &Corner| scale(c) - per_soc * c.soc - per_k * c.temperature_c;
        let power_scale_w = corners.iter().map(offset).fold(f64::NEG_INFINITY, f64::max);

        let factor = &self.parameters.derating.factor;
        let (low, high) = (states.temperature_c.low, states.temperature_c.high);
        let derated = |t: f64| 1.0 - factor.at(t);
        let derated_per_k = if high > low { (derated(high) - derated(low)) / (high - low) } else { 0.0 };
        let knots = factor.x().iter().copied().filter(|&t| t > low && t < high);
        let lowest =
            knots.chain([low, high]).map(|t| derated(t) - derated_per_k * t).fold(f64::INFINITY, f64::min);
        Planes {
            power_scale_w,
            power_scale_per_soc: per_soc,
            power_scale_per_k: per_k,
            derated: lowest,
            derated_per_k,
        }
    }
}

/// Slope between the mean values at both ends of an axis, 0 over a point.
fn chord(corners: &[Corner], axis: impl Fn(&Corner) -> f64, value: impl Fn(&Corner) -> f64) -> f64 {
    let low = corners.iter().map(&axis).fold(f64::INFINITY, f64::min);
    let high = corners.iter().map(&axis).fold(f64::NEG_INFINITY, f64::max);
    if high <= low {
        return 0.0;
    }
    let mean = |end: f64| {
        let (sum, n) = corners
            .iter()
            .filter(|c| axis(c) == end)
            .fold((0.0, 0.0), |(sum, n), c| (sum + value(c), n + 1.0));
        sum / n
    };
    (mean(high) - mean(low)) / (high - low)
}

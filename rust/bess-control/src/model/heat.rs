//! Battery heat as a function of internal power and `V^2 / R` (docs/equations.md, 5 and *Lower bounds*).

use bess_tables::Direction;

/// Voltage drop over the resistance relative to the open-circuit voltage, `R I / V`, at an internal power `x V^2 / R`:
/// `(sqrt(1 +- 4 x) - 1) / 2`, in its stable form. Beyond the root limit of discharge, its value at that
/// limit.
#[inline]
pub(crate) fn heat_share(x: f64, direction: Direction) -> f64 {
    2.0 * x / (1.0 + (1.0 - direction.sign() * (4.0 * x)).max(0.0).sqrt())
}

/// Battery heat at an internal power `g` and scale `y = V^2 / R` [W], `y (R I / V)^2`. Convex in `g` and `y`
/// together, falling with `y`.
#[inline]
pub(crate) fn heat_w(internal_w: f64, scale_w: f64, direction: Direction) -> f64 {
    let share = heat_share(internal_w / scale_w, direction);
    scale_w * share * share
}

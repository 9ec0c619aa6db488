//! Power laws of all models, integrated over changing conditions.

/// Calendar conditions of a string over a block of time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CalendarConditions {
    /// Mean state of charge.
    pub soc: f64,
    /// Mean temperature [K].
    pub temperature_k: f64,
    /// Open-circuit voltage of one cell at that SOC [V].
    pub cell_v: f64,
}

/// A half cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cycle {
    /// Depth, as a share of the capacity at that time.
    pub depth: f64,
    /// Mean of its lowest and highest SOC.
    pub soc: f64,
    /// Mean C-rate while charge moves [1/h].
    pub c_rate: f64,
    /// Mean temperature, weighted by the charge that moves [K].
    pub temperature_k: f64,
    /// Root mean square of the open-circuit voltage of one cell over the cycle [V].
    pub cell_v: f64,
}

/// `y = k(s) x^p`. Where `s` changes along the way, `y+ = k ((y / k)^(1/p) + dx)^p`, which with the damage
/// `D = y^(1/p)` is `D+ = D + k^(1/p) dx`: a sum, so the order of the conditions does not matter.
#[derive(Debug, Clone, Copy)]
pub struct Law<S> {
    /// `k` of the conditions.
    pub rate: fn(&S) -> f64,
    /// `p > 0`.
    pub exponent: f64,
}

impl<S> Law<S> {
    /// No loss.
    pub const NONE: Self = Self { rate: |_| 0.0, exponent: 1.0 };

    /// Damage over `dx` under the conditions `s`.
    #[inline]
    pub fn damage(&self, s: &S, dx: f64) -> f64 {
        power((self.rate)(s).max(0.0), 1.0 / self.exponent) * dx
    }

    /// `y` at a damage.
    #[inline]
    pub fn loss(&self, damage: f64) -> f64 {
        power(damage, self.exponent)
    }

    /// Damage at a `y`.
    #[inline]
    pub fn damage_of(&self, loss: f64) -> f64 {
        power(loss, 1.0 / self.exponent)
    }

    /// `dy / dx = k p (y / k)^((p - 1) / p)` under the conditions `s`, after a loss of `y`, and not before
    /// `x = 1` (one day, or one cycle): at `x = 0` the slope of a law with `p < 1` has no bound.
    pub fn marginal(&self, s: &S, loss: f64) -> f64 {
        let (k, p) = ((self.rate)(s).max(0.0), self.exponent);
        if k == 0.0 {
            return 0.0;
        }
        k * p * power((loss / k).max(1.0), (p - 1.0) / p)
    }
}

#[inline]
fn power(base: f64, exponent: f64) -> f64 {
    if exponent == 1.0 {
        base
    } else if exponent == 2.0 {
        base * base
    } else if exponent == 0.5 {
        base.sqrt()
    } else {
        base.powf(exponent)
    }
}

/// A second limit of the capacity, independent of the losses, over the exposure of active sites to cycling.
#[derive(Debug, Clone, Copy)]
pub struct Knee {
    /// Exposure per equivalent full cycle.
    pub rate: fn(&Cycle) -> f64,
    /// Remaining capacity after an exposure, as a share.
    pub capacity: fn(f64) -> f64,
}

/// A published ageing model of one cell.
#[derive(Debug, Clone, Copy)]
pub struct Model {
    /// Name in system and study files.
    pub name: &'static str,
    /// Cell, source, and where it was measured.
    pub about: &'static str,
    /// Capacity lost over days.
    pub calendar: Law<CalendarConditions>,
    /// Capacity lost over equivalent full cycles.
    pub cyclic: Law<Cycle>,
    /// Resistance gained over days.
    pub calendar_resistance: Law<CalendarConditions>,
    /// Resistance gained over equivalent full cycles.
    pub cyclic_resistance: Law<Cycle>,
    /// Sudden loss of capacity late in life.
    pub knee: Option<Knee>,
}

#[cfg(test)]
mod tests {
    use super::*;

    const LAW: Law<f64> = Law { rate: |k| *k, exponent: 0.357 };

    #[test]
    fn a_power_law_does_not_depend_on_steps_or_order_of_conditions() {
        let whole = LAW.loss(LAW.damage(&2e-3, 3650.0));
        assert!((whole - 2e-3 * 3650f64.powf(0.357)).abs() < 1e-15);
        let parts: f64 = (0..3650).map(|_| LAW.damage(&2e-3, 1.0)).sum();
        assert!((LAW.loss(parts) - whole).abs() < 1e-13);
        // The form of the literature, y+ = k ((y / k)^(1/p) + dx)^p, one condition after the other.
        let advance = |y: f64, k: f64| k * ((y / k).powf(1.0 / 0.357) + 100.0).powf(0.357);
        let literature = advance(advance(0.0, 2e-3), 5e-3);
        let ours = LAW.loss(LAW.damage(&5e-3, 100.0) + LAW.damage(&2e-3, 100.0));
        assert!((ours - literature).abs() < 1e-14);
    }

    #[test]
    fn the_marginal_rate_is_the_slope() {
        let y = 0.03;
        let slope = (LAW.loss(LAW.damage_of(y) + LAW.damage(&4e-3, 1e-3)) - y) / 1e-3;
        assert!((LAW.marginal(&4e-3, y) / slope - 1.0).abs() < 1e-5);
    }
}

//! Inverter loss of the control model, and its inverse (docs/equations.md, 4 and 5).

use bess_tables::{Axis, Direction, Lut};

use super::ranges::Range;

/// Inverter loss of one direction over delivered AC power, with data for its inversion.
///
/// The battery's internal power is `g(p) = p - w(p)` in charge and `p + w(p)` in discharge. If the slope of a table
/// leaves `(-1, 1)`, `g` is not monotone, and the set of powers below a limit is not an interval. The
/// largest deliverable power is then the end of the first interval (inverse of the running maximum of `g`),
/// so that every power below it is deliverable too. On monotone tables both agree.
#[derive(Debug, Clone)]
pub(crate) struct LossCurve {
    direction: Direction,
    power: Axis,
    loss: Vec<f64>,
    /// Running maximum of `g` over the knots.
    internal: Vec<f64>,
    /// Slopes of loss and `internal` between the knots; zero after the last knot.
    slopes: Vec<(f64, f64)>,
}

impl LossCurve {
    pub fn new(table: &Lut, direction: Direction, nominal_w: f64) -> Self {
        let inner = table.x().iter().copied().filter(|&x| x > 0.0 && x < nominal_w);
        let knots: Vec<f64> = std::iter::once(0.0).chain(inner).chain(std::iter::once(nominal_w)).collect();
        let g = |p: f64| internal_w(direction, p, table.at(p));
        let (mut power, mut internal) = (vec![], vec![]);
        let mut highest = f64::NEG_INFINITY;
        for (index, &p) in knots.iter().enumerate() {
            if index > 0 && g(p) > highest {
                let before = knots[index - 1];
                if g(before) < highest {
                    let crossing = before + (highest - g(before)) / (g(p) - g(before)) * (p - before);
                    power.push(crossing);
                    internal.push(highest);
                }
            }
            highest = highest.max(g(p));
            power.push(p);
            internal.push(highest);
        }
        let loss: Vec<f64> = power.iter().map(|&p| table.at(p)).collect();
        let slope = |y: &[f64], index: usize| (y[index] - y[index - 1]) / (power[index] - power[index - 1]);
        let between = (1..power.len()).map(|index| (slope(&loss, index), slope(&internal, index)));
        let slopes = between.chain([(0.0, 0.0)]).collect();
        Self { direction, power: Axis::ascending(power), loss, internal, slopes }
    }

    /// Internal power `g` of the battery for a delivered power and its loss [W].
    #[inline]
    pub fn internal_w(&self, power_w: f64, loss_w: f64) -> f64 {
        internal_w(self.direction, power_w, loss_w)
    }

    pub fn direction(&self) -> Direction {
        self.direction
    }

    /// Knots [W].
    pub fn power(&self) -> &[f64] {
        &self.power
    }

    /// Losses at the knots [W].
    pub fn loss(&self) -> &[f64] {
        &self.loss
    }

    /// Loss and running maximum of `g` at a power [W].
    #[inline(always)]
    pub fn at(&self, power_w: f64) -> (f64, f64) {
        let segment = self.power.below(power_w);
        let beyond = power_w - self.power[segment];
        let (loss_slope, internal_slope) = self.slopes[segment];
        (self.loss[segment] + loss_slope * beyond, self.internal[segment] + internal_slope * beyond)
    }

    /// [`Self::at`] with a cache for repeated reading at one power.
    #[inline(always)]
    pub fn known_at(&self, known_w: f64) -> impl Fn(f64) -> (f64, f64) + '_ {
        let known = self.at(known_w);
        move |power_w| if power_w == known_w { known } else { self.at(power_w) }
    }

    /// Largest AC power up to which the internal power is at most `internal_w` [W].
    #[inline]
    pub fn largest_power(&self, internal_w: f64) -> f64 {
        let above = self.internal.partition_point(|&g| g <= internal_w);
        if above == 0 {
            return 0.0;
        }
        if above == self.internal.len() {
            return self.power[above - 1];
        }
        let (low, high) = (self.internal[above - 1], self.internal[above]);
        let share = (internal_w - low) / (high - low);
        self.power[above - 1] + share * (self.power[above] - self.power[above - 1])
    }

    /// AC power above which `g` is not negative [W]: at such powers, a charging inverter does not discharge the battery.
    pub fn max_drawing_w(&self) -> f64 {
        let g: Vec<f64> = self.power.iter().zip(&self.loss).map(|(&p, &w)| self.internal_w(p, w)).collect();
        let Some(last) = g.iter().rposition(|g| *g < 0.0) else { return 0.0 };
        match g.get(last + 1) {
            Some(next) => {
                let share = -g[last] / (next - g[last]);
                self.power[last] + share * (self.power[last + 1] - self.power[last])
            }
            None => self.power[last],
        }
    }

    /// Smallest and largest `g` over the delivered powers `[low, high]` of an inverter that is on [W].
    pub fn internal_range(&self, low: f64, high: f64) -> Range {
        let g = |p: f64| self.internal_w(p, self.at(p).0);
        Range { low, high }.places(&self.power).map(g).collect()
    }
}

#[inline]
fn internal_w(direction: Direction, power_w: f64, loss_w: f64) -> f64 {
    power_w + direction.sign() * loss_w
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn largest_power_inverts_a_monotone_table_in_both_directions() {
        let table = Lut::new("w", vec![0.0, 50.0, 100.0], vec![2.0, 3.0, 7.0]).unwrap();
        for direction in [Direction::Charge, Direction::Discharge] {
            let curve = LossCurve::new(&table, direction, 100.0);
            for p in [1.0, 49.0, 50.0, 73.5, 100.0] {
                let g = curve.internal_w(p, table.at(p));
                assert!((curve.largest_power(g) - p).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn a_discharge_that_cannot_carry_the_no_load_loss_delivers_nothing() {
        let table = Lut::new("w", vec![0.0, 100.0], vec![2.0, 3.0]).unwrap();
        let curve = LossCurve::new(&table, Direction::Discharge, 100.0);
        assert_eq!(curve.largest_power(1.9), 0.0);
        assert_eq!(curve.largest_power(2.0), 0.0);
        assert!(curve.largest_power(2.1) > 0.0);
    }

    #[test]
    fn every_power_below_the_largest_one_is_deliverable_on_a_table_that_folds_back() {
        // g rises to 60, falls to 40, rises to 90.
        let table = Lut::new("w", vec![0.0, 50.0, 60.0, 100.0], vec![0.0, 10.0, -20.0, -10.0]).unwrap();
        let curve = LossCurve::new(&table, Direction::Discharge, 100.0);
        assert!((curve.largest_power(50.0) - 50.0 * 50.0 / 60.0).abs() < 1e-12);
        assert!(curve.largest_power(60.0) > 60.0);
        for internal in [20.0, 55.0, 61.0, 80.0] {
            let largest = curve.largest_power(internal);
            for step in 1..=100 {
                let p = largest * f64::from(step) / 100.0;
                assert!(p + table.at(p) <= internal + 1e-9);
            }
        }
    }
}

//! Tables over one axis, piecewise linear.

use crate::{Axis, InputError};

/// Piecewise linear table `y(x)` with ascending knots, clamped to its end values outside them.
///
/// Quantities that must not be extrapolated (OCV) are kept inside the knots by their callers: the SOC window is
/// checked against the table at construction.
#[derive(Debug, Clone, PartialEq)]
pub struct Lut {
    x: Axis,
    y: Vec<f64>,
}

impl Lut {
    /// Builds a table from knots; `name` is used in the error.
    ///
    /// # Errors
    ///
    /// [`InputError`] where the knots do not ascend, are not as many as the values, or a number is not finite.
    pub fn new(name: &str, x: Vec<f64>, y: Vec<f64>) -> Result<Self, InputError> {
        let x = Axis::new(name, x)?;
        if x.len() != y.len() {
            return Err(InputError::table(name, format!("{} knots but {} values", x.len(), y.len())));
        }
        if let Some(value) = y.iter().find(|v| !v.is_finite()) {
            return Err(InputError::table(name, format!("value {value} is not finite")));
        }
        Ok(Self { x, y })
    }

    /// Knots, ascending.
    pub fn x(&self) -> &Axis {
        &self.x
    }

    /// Values at the knots.
    pub fn y(&self) -> &[f64] {
        &self.y
    }

    pub(crate) fn scale(&mut self, factor: f64) {
        self.y.iter_mut().for_each(|value| *value *= factor);
    }

    /// Multiplies knots and values by `factor > 0`.
    pub(crate) fn stretch(&mut self, factor: f64) {
        self.x = Axis::ascending(self.x.iter().map(|x| factor * x).collect());
        self.scale(factor);
    }

    /// Value at `x`, clamped outside the knots.
    #[inline(always)]
    pub fn at(&self, x: f64) -> f64 {
        let (segment, share) = self.x.locate(x);
        if self.y.len() == 1 {
            return self.y[0];
        }
        self.y[segment] + share * (self.y[segment + 1] - self.y[segment])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn knots_are_reproduced_and_ends_are_clamped() {
        let lut = Lut::new("t", vec![0.0, 1.0, 3.0], vec![2.0, 4.0, 0.0]).unwrap();
        for (x, y) in [(-5.0, 2.0), (0.0, 2.0), (0.5, 3.0), (1.0, 4.0), (2.0, 2.0), (3.0, 0.0), (9.0, 0.0)] {
            assert_eq!(lut.at(x), y, "at {x}");
        }
    }

    #[test]
    fn a_table_that_is_not_sorted_is_refused_with_the_two_knots() {
        let error = Lut::new("ocv", vec![0.0, 0.5, 0.4], vec![1.0; 3]).unwrap_err();
        assert_eq!(error.to_string(), "ocv: knots must ascend, but 0.4 follows 0.5");
    }
}

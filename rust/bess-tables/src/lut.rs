//! Tables over one axis, piecewise linear.

use crate::TableError;

/// Piecewise linear table `y(x)` with ascending knots, clamped to its end values outside them.
///
/// Quantities that must not be extrapolated (OCV) are kept inside the knots by their callers: the SOC window is
/// checked against the table at construction.
#[derive(Debug, Clone, PartialEq)]
pub struct Lut {
    x: Vec<f64>,
    y: Vec<f64>,
}

impl Lut {
    /// Builds a table from knots; `name` is used in the error.
    ///
    /// # Errors
    ///
    /// [`TableError`] where the knots do not ascend, are not as many as the values, or a number is not finite.
    pub fn new(name: &str, x: Vec<f64>, y: Vec<f64>) -> Result<Self, TableError> {
        check_axis(name, &x)?;
        if x.len() != y.len() {
            return Err(TableError::table(name, format!("{} knots but {} values", x.len(), y.len())));
        }
        if let Some(value) = y.iter().find(|v| !v.is_finite()) {
            return Err(TableError::table(name, format!("value {value} is not finite")));
        }
        Ok(Self { x, y })
    }

    /// Knots, ascending.
    pub fn x(&self) -> &[f64] {
        &self.x
    }

    /// Values at the knots.
    pub fn y(&self) -> &[f64] {
        &self.y
    }

    /// Multiplies every value by `factor`.
    pub(crate) fn scale(&mut self, factor: f64) {
        self.y.iter_mut().for_each(|value| *value *= factor);
    }

    /// Value at `x`, clamped outside the knots.
    #[inline]
    pub fn at(&self, x: f64) -> f64 {
        let (segment, share) = locate(&self.x, x);
        if self.y.len() == 1 {
            return self.y[0];
        }
        self.y[segment] + share * (self.y[segment + 1] - self.y[segment])
    }
}

/// Ascending, finite, not empty.
pub(crate) fn check_axis(name: &str, x: &[f64]) -> Result<(), TableError> {
    if x.is_empty() {
        return Err(TableError::table(name, "is empty"));
    }
    if let Some(value) = x.iter().find(|v| !v.is_finite()) {
        return Err(TableError::table(name, format!("knot {value} is not finite")));
    }
    if let Some(pair) = x.windows(2).find(|pair| pair[1] <= pair[0]) {
        return Err(TableError::table(
            name,
            format!("knots must ascend, but {} follows {}", pair[1], pair[0]),
        ));
    }
    Ok(())
}

/// Segment index and share in `[0, 1]` of `x` on an ascending axis, clamped at both ends.
#[inline]
pub fn locate(axis: &[f64], x: f64) -> (usize, f64) {
    let last = axis.len() - 1;
    if last == 0 || x <= axis[0] {
        return (0, 0.0);
    }
    if x >= axis[last] {
        return (last - 1, 1.0);
    }
    // Tables have ten to twenty knots. Counting all of them has no branch to mispredict and is vectorised, which beats
    // a scan that leaves early and bisection.
    let segment = axis[1..last].iter().map(|&knot| usize::from(x >= knot)).sum::<usize>();
    (segment, (x - axis[segment]) / (axis[segment + 1] - axis[segment]))
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

//! Tables over two axes, bilinear.

use crate::{Axis, InputError};

/// Bilinear table `z(x, y)` on a rectangular grid, clamped outside it. One row per `x`, one column per `y`.
#[derive(Debug, Clone, PartialEq)]
pub struct Grid {
    x: Axis,
    y: Axis,
    z: Vec<f64>,
}

impl Grid {
    /// Builds a grid from its axes and row-major values; `name` is used in the error.
    ///
    /// # Errors
    ///
    /// [`InputError`] where the knots of an axis do not ascend, the values are not as many as the knots of both axes make,
    /// or a number is not finite.
    pub fn new(name: &str, x: Vec<f64>, y: Vec<f64>, z: Vec<f64>) -> Result<Self, InputError> {
        let (x, y) = (Axis::new(name, x)?, Axis::new(name, y)?);
        let (rows, columns) = (x.len(), y.len());
        if z.len() != rows * columns {
            return Err(InputError::table(name, format!("{rows} x {columns} knots but {} values", z.len())));
        }
        if let Some(value) = z.iter().find(|v| !v.is_finite()) {
            return Err(InputError::table(name, format!("value {value} is not finite")));
        }
        Ok(Self { x, y, z })
    }

    /// First axis.
    pub fn x(&self) -> &Axis {
        &self.x
    }

    /// Second axis.
    pub fn y(&self) -> &Axis {
        &self.y
    }

    /// Row-major values.
    pub fn z(&self) -> &[f64] {
        &self.z
    }

    pub(crate) fn scale(&mut self, factor: f64) {
        self.z.iter_mut().for_each(|value| *value *= factor);
    }

    /// Value at `(x, y)`, clamped outside the grid.
    #[inline(always)]
    pub fn at(&self, x: f64, y: f64) -> f64 {
        let (row, share) = self.x.locate(x);
        let columns = self.y.len();
        let upper = (row + 1).min(self.x.len() - 1);
        if columns == 1 {
            return self.z[row] + share * (self.z[upper] - self.z[row]);
        }
        let (column, part) = self.y.locate(y);
        let along = |row: usize| {
            let values = &self.z[row * columns + column..][..2];
            values[0] + part * (values[1] - values[0])
        };
        let low = along(row);
        low + share * (along(upper) - low)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bilinear_function_is_reproduced_inside_and_clamped_outside() {
        let f = |x: f64, y: f64| 1.0 + 2.0 * x - y + 0.5 * x * y;
        let (x, y) = (vec![0.0, 1.0, 4.0], vec![-1.0, 2.0]);
        let z = x.iter().flat_map(|&x| y.iter().map(move |&y| f(x, y))).collect();
        let grid = Grid::new("g", x, y, z).unwrap();
        for (x, y) in [(0.0, -1.0), (0.3, 0.7), (3.0, 2.0), (4.0, -1.0)] {
            assert!((grid.at(x, y) - f(x, y)).abs() < 1e-12);
        }
        assert_eq!(grid.at(9.0, 5.0), f(4.0, 2.0));
    }
}

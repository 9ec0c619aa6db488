//! Knots of a table, and the search for the segment of a value.

use std::ops::Deref;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use crate::InputError;

/// Ascending knots of a table. The search starts with the segment of the last value.
#[derive(Debug, Clone, PartialEq)]
pub struct Axis {
    knots: Vec<f64>,
    /// The knot after each, infinity after the last.
    next: Vec<f64>,
    last: Last,
}

/// The last knot found. Successive values of a simulation are often in one segment, and branch prediction then hides the
/// comparison. Results do not depend on it.
#[derive(Debug, Default)]
struct Last(AtomicU32);

impl Clone for Last {
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl PartialEq for Last {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl Axis {
    /// Checks knots; `name` is used in the error.
    ///
    /// # Errors
    ///
    /// [`InputError`] where there are none, they do not ascend, or one is not finite.
    pub fn new(name: &str, knots: Vec<f64>) -> Result<Self, InputError> {
        if knots.is_empty() {
            return Err(InputError::table(name, "is empty"));
        }
        if let Some(value) = knots.iter().find(|v| !v.is_finite()) {
            return Err(InputError::table(name, format!("knot {value} is not finite")));
        }
        if let Some(pair) = knots.windows(2).find(|pair| pair[1] <= pair[0]) {
            return Err(InputError::table(
                name,
                format!("knots must ascend, but {} follows {}", pair[1], pair[0]),
            ));
        }
        Ok(Self::ascending(knots))
    }

    /// An axis of at least one knot, without checks.
    pub fn ascending(knots: Vec<f64>) -> Self {
        let next = knots[1..].iter().copied().chain([f64::INFINITY]).collect();
        Self { knots, next, last: Last::default() }
    }

    /// The last knot at or below a value; the first one for values below it.
    #[inline(always)]
    pub fn below(&self, x: f64) -> usize {
        let last = self.last.0.load(Relaxed) as usize;
        if x >= self.knots[last] && x < self.next[last] {
            return last;
        }
        self.search(x)
    }

    #[inline(never)]
    fn search(&self, x: f64) -> usize {
        let knot = self.knots[1..].partition_point(|&knot| knot <= x);
        self.last.0.store(knot as u32, Relaxed);
        knot
    }

    /// Segment and share in `[0, 1]` of a value, clamped at both ends.
    #[inline(always)]
    pub fn locate(&self, x: f64) -> (usize, f64) {
        let last = self.knots.len() - 1;
        if last == 0 || x <= self.knots[0] {
            return (0, 0.0);
        }
        if x >= self.knots[last] {
            return (last - 1, 1.0);
        }
        let segment = self.below(x);
        (segment, (x - self.knots[segment]) / (self.next[segment] - self.knots[segment]))
    }
}

impl Deref for Axis {
    type Target = [f64];

    #[inline]
    fn deref(&self) -> &[f64] {
        &self.knots
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_value_lies_in_the_segment_that_begins_at_or_below_it(
            gaps in prop::collection::vec(prop_oneof![1e-9..1e-6f64, 0.01..0.1f64, 1.0..50.0f64], 1..20),
            first in -50.0..50.0f64, shares in prop::collection::vec(0.0..1.0f64, 20),
        ) {
            let knots: Vec<f64> =
                std::iter::once(0.0).chain(gaps).scan(first, |x, gap| { *x += gap; Some(*x) }).collect();
            let axis = Axis::new("a", knots.clone()).unwrap();
            let last = knots.len() - 1;
            let between = shares.iter().map(|share| first + share * (knots[last] - first));
            let close = knots.iter().flat_map(|&knot| [knot - 1e-13, knot, knot + 1e-13]);
            for x in between.chain(close).filter(|&x| x > knots[0] && x < knots[last]) {
                let expected = knots.iter().filter(|&&knot| x >= knot).count() - 1;
                let (segment, share) = axis.locate(x);
                prop_assert_eq!(segment, expected);
                prop_assert_eq!(share, (x - knots[segment]) / (knots[segment + 1] - knots[segment]));
            }
            prop_assert_eq!((axis.below(f64::MIN), axis.below(f64::MAX)), (0, last));
            prop_assert_eq!(axis.locate(knots[0] - 1.0), (0, 0.0));
            prop_assert_eq!(axis.locate(knots[last] + 1.0), (last - 1, 1.0));
        }
    }

    #[test]
    fn an_axis_of_one_knot_is_that_knot_everywhere() {
        let axis = Axis::new("a", vec![3.0]).unwrap();
        assert_eq!([2.0, 3.0, 4.0].map(|x| axis.locate(x)), [(0, 0.0); 3]);
    }
}

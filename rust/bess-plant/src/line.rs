//! Piecewise linear tables with a cache of the current segment.
//!
//! State moves little from one plant step to the next, so the segment found last is nearly always right: a
//! look-up is two comparisons, one product and one sum. The segment is a function of the argument alone
//! (half-open), never of the past, so a restored plant continues bit by bit.

use bess_tables::{Axis, Grid, Lut};

use crate::lanes::{Lanes, WIDTH};

/// `intercept + slope * x` for `low <= x < high`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Line {
    pub(crate) low: f64,
    pub(crate) high: f64,
    pub(crate) intercept: f64,
    pub(crate) slope: f64,
}

impl Line {
    pub(crate) fn constant(low: f64, high: f64, intercept: f64) -> Self {
        Self { low, high, intercept, slope: 0.0 }
    }

    /// A value that is valid for one step only.
    pub(crate) fn once(value: f64) -> Self {
        Self::constant(f64::INFINITY, f64::NEG_INFINITY, value)
    }

    /// The segment of a table that holds `at`; constant beyond both ends.
    pub(crate) fn of_knots(x: &Axis, y: &[f64], at: f64) -> Self {
        let last = x.len() - 1;
        if at < x[0] {
            return Self::constant(f64::NEG_INFINITY, x[0], y[0]);
        }
        if at >= x[last] {
            return Self::constant(x[last], f64::INFINITY, y[last]);
        }
        let segment = x.below(at);
        let slope = (y[segment + 1] - y[segment]) / (x[segment + 1] - x[segment]);
        Self { low: x[segment], high: x[segment + 1], intercept: y[segment] - slope * x[segment], slope }
    }

    pub(crate) fn of(table: &Lut, at: f64) -> Self {
        Self::of_knots(table.x(), table.y(), at)
    }

    /// Along the first axis of a grid. If the grid also depends on the second axis, the value is valid for one step only.
    pub(crate) fn of_grid(grid: &Grid, x: f64, y: f64) -> Self {
        if grid.y().len() == 1 {
            Self::of_knots(grid.x(), grid.z(), x)
        } else {
            Self::once(grid.at(x, y))
        }
    }
}

#[derive(Debug, Clone, Copy)]
pub(crate) struct Lines {
    low: Lanes,
    high: Lanes,
    intercept: Lanes,
    slope: Lanes,
}

impl Lines {
    /// Without segments: every lane is looked up at first use.
    pub(crate) fn unknown() -> Self {
        let mut lines =
            Self { low: Lanes::ZERO, high: Lanes::ZERO, intercept: Lanes::ZERO, slope: Lanes::ZERO };
        (0..WIDTH).for_each(|lane| lines.set(lane, Line::once(0.0)));
        lines
    }

    pub(crate) fn set(&mut self, lane: usize, line: Line) {
        self.low.0[lane] = line.low;
        self.high.0[lane] = line.high;
        self.intercept.0[lane] = line.intercept;
        self.slope.0[lane] = line.slope;
    }

    /// Distance of `x` from both ends of the current segments.
    #[inline(always)]
    pub(crate) fn margin(&self, x: Lanes) -> Margin {
        Margin { low: x - self.low, high: self.high - x }
    }

    #[inline(always)]
    pub(crate) fn slope(&self) -> Lanes {
        self.slope
    }

    #[inline(always)]
    pub(crate) fn value(&self, x: Lanes) -> Lanes {
        self.intercept + self.slope * x
    }

    /// Values at `x`; lanes that have left their segment are looked up again by `find`.
    #[inline(always)]
    pub(crate) fn at(&mut self, x: Lanes, find: impl Fn(usize, f64) -> Line) -> Lanes {
        let margin = self.margin(x);
        if margin.any_outside() {
            for lane in (0..WIDTH).filter(|&lane| margin.is_outside(lane)) {
                self.set(lane, find(lane, x.0[lane]));
            }
        }
        self.value(x)
    }
}

/// Distances from both ends of half-open segments, as numbers: their minimum over many nodes is one instruction for each end.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Margin {
    low: Lanes,
    high: Lanes,
}

impl Margin {
    pub(crate) const UNLIMITED: Self =
        Self { low: Lanes([f64::INFINITY; WIDTH]), high: Lanes([f64::INFINITY; WIDTH]) };

    /// The smaller of both distances.
    #[inline(always)]
    pub(crate) fn min(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.min(other.high) }
    }

    #[inline(always)]
    pub(crate) fn is_outside(&self, lane: usize) -> bool {
        self.low.0[lane] < 0.0 || self.high.0[lane] <= 0.0
    }

    #[inline(always)]
    pub(crate) fn any_outside(&self) -> bool {
        (0..WIDTH).fold(false, |any, lane| any | self.is_outside(lane))
    }
}

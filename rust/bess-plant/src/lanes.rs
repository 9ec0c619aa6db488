//! A vector of numbers, one for each string of a block (single instruction, multiple data).
//!
//! Every operation acts lane by lane and in the order written, without fused or re-associated arithmetic, so a
//! lane's result does not depend on its neighbours or on the instruction set the loops are compiled to.

use std::ops::{Add, Mul, Sub};

/// Strings of a block: one vector of AVX2. Twice as many take a seventh more instructions for each string.
pub(crate) const WIDTH: usize = 4;

#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(align(32))]
pub(crate) struct Lanes(pub(crate) [f64; WIDTH]);

impl Lanes {
    pub(crate) const ZERO: Self = Self([0.0; WIDTH]);

    #[inline(always)]
    pub(crate) fn splat(value: f64) -> Self {
        Self([value; WIDTH])
    }

    #[inline(always)]
    pub(crate) fn from_fn(f: impl Fn(usize) -> f64) -> Self {
        let mut out = [0.0; WIDTH];
        for (lane, value) in out.iter_mut().enumerate() {
            *value = f(lane);
        }
        Self(out)
    }

    #[inline(always)]
    pub(crate) fn sqrt(self) -> Self {
        Self::from_fn(|l| self.0[l].sqrt())
    }

    #[inline(always)]
    pub(crate) fn divided_by(self, other: Self) -> Self {
        Self::from_fn(|l| self.0[l] / other.0[l])
    }

    /// Lane-wise maximum. A comparison is one instruction; `f64::max` also orders NaN.
    #[inline(always)]
    pub(crate) fn max(self, other: Self) -> Self {
        Self::from_fn(|l| if self.0[l] > other.0[l] { self.0[l] } else { other.0[l] })
    }

    /// Lane-wise minimum.
    #[inline(always)]
    pub(crate) fn min(self, other: Self) -> Self {
        Self::from_fn(|l| if self.0[l] < other.0[l] { self.0[l] } else { other.0[l] })
    }

    /// `yes` in the lanes that are positive, `no` in the others.
    #[inline(always)]
    pub(crate) fn if_positive(self, yes: Self, no: Self) -> Self {
        Self::from_fn(|l| if self.0[l] > 0.0 { yes.0[l] } else { no.0[l] })
    }
}

impl Default for Lanes {
    fn default() -> Self {
        Self::ZERO
    }
}

macro_rules! lane_by_lane {
    ($trait:ident, $method:ident, $operator:tt) => {
        impl $trait for Lanes {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self::from_fn(|l| self.0[l] $operator other.0[l])
            }
        }
    };
}
lane_by_lane!(Add, add, +);
lane_by_lane!(Sub, sub, -);
lane_by_lane!(Mul, mul, *);

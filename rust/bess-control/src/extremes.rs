//! Maximum and minimum of two numbers that are not NaN, in one instruction each.

/// The larger number, the first of equal ones.
#[inline]
pub(crate) fn larger(a: f64, b: f64) -> f64 {
    if b > a {
        b
    } else {
        a
    }
}

/// The smaller number, the first of equal ones.
#[inline]
pub(crate) fn smaller(a: f64, b: f64) -> f64 {
    if b < a {
        b
    } else {
        a
    }
}

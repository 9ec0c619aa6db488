//! Delivered power of an inverter over the internal power of its string.

use bess_tables::Direction;

use crate::model::{LossCurve, Range};

/// Delivered power over internal power, from the loss table, extrapolated at both ends.
pub(super) struct Delivered {
    pub(super) internal_w: Vec<f64>,
    pub(super) power_w: Vec<f64>,
    pub(super) direction: Direction,
}

impl Delivered {
    /// None if internal power does not rise with delivered power.
    pub(super) fn new(curve: &LossCurve) -> Option<Self> {
        let at = |(&p, &w): (&f64, &f64)| curve.internal_w(p, w);
        let internal_w: Vec<f64> = curve.power().iter().zip(curve.loss()).map(at).collect();
        let rises = internal_w.windows(2).zip(curve.power().windows(2));
        let steep = |(g, p): (&[f64], &[f64])| g[1] - g[0] > 0.01 * (p[1] - p[0]);
        (internal_w.len() > 1 && rises.into_iter().all(steep)).then(|| Self {
            internal_w,
            power_w: curve.power().to_vec(),
            direction: curve.direction(),
        })
    }

    pub(super) fn slope(&self, segment: usize) -> f64 {
        (self.power_w[segment + 1] - self.power_w[segment])
            / (self.internal_w[segment + 1] - self.internal_w[segment])
    }

    pub(super) fn slopes(&self) -> Range {
        (0..self.power_w.len() - 1).map(|s| self.slope(s)).collect()
    }

    pub(super) fn at(&self, internal_w: f64) -> f64 {
        let last = self.power_w.len() - 2;
        let segment = self.internal_w.partition_point(|&g| g <= internal_w).saturating_sub(1).min(last);
        self.power_w[segment] + self.slope(segment) * (internal_w - self.internal_w[segment])
    }

    pub(super) fn loss_w(&self, internal_w: f64, power_w: f64) -> f64 {
        self.direction.pick(power_w - internal_w, internal_w - power_w)
    }

    /// Maximum distance of the curve below, and above, its chords in a range.
    pub(super) fn bends(&self, range: &Range) -> (f64, f64) {
        let (mut convex, mut concave) = (0.0, 0.0);
        let width = range.high - range.low;
        for knot in 1..self.internal_w.len() - 1 {
            let g = self.internal_w[knot];
            if g > range.low && g < range.high {
                let bend =
                    (self.slope(knot) - self.slope(knot - 1)) * (g - range.low) * (range.high - g) / width;
                if bend > 0.0 {
                    convex += bend;
                } else {
                    concave -= bend;
                }
            }
        }
        (convex, concave)
    }
}

//! The maximum of the Bellman equation over a run of neighbouring transitions, written for wide instructions.

/// Grid cells that contain the end states of a run of rows, and the position of each end state in its cell.
pub(super) struct Cells<'a> {
    /// Values from the lower corner of the first cell on.
    pub after: &'a [f64],
    /// Distance to the values of the next temperature, and of the next depth.
    pub warmer: usize,
    pub deeper: usize,
    /// As in [`Run`](super::transitions::Run).
    pub stride: usize,
    pub energy: &'a [f64],
    pub temperature: &'a [f64],
    pub depth: &'a [f64],
}

impl Cells<'_> {
    /// Compares the values of all rows with the best so far.
    #[inline(always)]
    pub fn maximise<const DEPTHS: bool>(&self, income: &[f64], best: &mut [f64]) {
        let n = best.len();
        let (energy, temperature, depth) = (&self.energy[..n], &self.temperature[..n], &self.depth[..n]);
        let income = &income[..n];
        let from = |at: usize| &self.after[at..][..(n - 1) * self.stride + 2];
        let (cool, warm) = (from(0), from(self.warmer));
        let (cool_deep, warm_deep) =
            if DEPTHS { (from(self.deeper), from(self.deeper + self.warmer)) } else { (cool, warm) };
        // Written as loops: a closure would not be compiled for the wider instructions.
        if self.stride == 0 {
            let [cool, warm, cool_deep, warm_deep] =
                [cool, warm, cool_deep, warm_deep].map(|values| (values[0], values[1]));
            for i in 0..n {
                let (e, t) = (energy[i], temperature[i]);
                let mut value = bilinear(e, t, cool, warm);
                if DEPTHS {
                    value = lerp(depth[i], value, bilinear(e, t, cool_deep, warm_deep));
                }
                best[i] = best[i].max(value + income[i]);
            }
            return;
        }
        let [cool_up, warm_up, cool_deep_up, warm_deep_up] =
            [cool, warm, cool_deep, warm_deep].map(|values| &values[1..=n]);
        let [cool, warm, cool_deep, warm_deep] =
            [cool, warm, cool_deep, warm_deep].map(|values| &values[..n]);
        for i in 0..n {
            let (e, t) = (energy[i], temperature[i]);
            let mut value = bilinear(e, t, (cool[i], cool_up[i]), (warm[i], warm_up[i]));
            if DEPTHS {
                let (cool, warm) = ((cool_deep[i], cool_deep_up[i]), (warm_deep[i], warm_deep_up[i]));
                value = lerp(depth[i], value, bilinear(e, t, cool, warm));
            }
            best[i] = best[i].max(value + income[i]);
        }
    }
}

/// Bilinear value in a cell, of which the lower and upper value in energy are given at its lower and upper temperature.
#[inline(always)]
fn bilinear(energy: f64, temperature: f64, cool: (f64, f64), warm: (f64, f64)) -> f64 {
    lerp(energy, lerp(temperature, cool.0, warm.0), lerp(temperature, cool.1, warm.1))
}

#[inline(always)]
fn lerp(share: f64, low: f64, high: f64) -> f64 {
    low + share * (high - low)
}

//! Flows of a control step, summed over its plant steps.

use crate::lanes::Lanes;
use crate::record::{Limits, Record};

/// Sums over the plant steps of one control step.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Totals<const W: usize> {
    /// Powers and losses as in the record: magnitudes in the direction of the request [W].
    pub(crate) delivered_w: Lanes<W>,
    pub(crate) availability_loss_w: Lanes<W>,
    pub(crate) derating_loss_w: Lanes<W>,
    /// Inverter loss of plant steps with active power.
    pub(crate) loss_on_w: Lanes<W>,
    /// Inverter loss of plant steps with reactive power alone.
    pub(crate) grid_loss_w: Lanes<W>,
    pub(crate) reactive_var: Lanes<W>,
    /// Plant steps with the inverter off.
    pub(crate) off_steps: Lanes<W>,
    pub(crate) heat_w: Lanes<W>,
    pub(crate) reversible_w: Lanes<W>,
    pub(crate) hysteresis_w: Lanes<W>,
    pub(crate) ocv_shift_w: Lanes<W>,
    pub(crate) current_a: Lanes<W>,
    /// Derating factor.
    pub(crate) factor: Lanes<W>,
    /// Off-to-on transitions of the inverter.
    pub(crate) starts: Lanes<W>,
    /// Hottest node so far [degC].
    pub(crate) hottest_c: Lanes<W>,
}

impl<const W: usize> Totals<W> {
    pub(crate) fn new() -> Self {
        Self { hottest_c: Lanes::splat(f64::NEG_INFINITY), ..Self::default() }
    }

    /// Writes the flows of one lane as entry `at`: means over `substeps` plant steps of `step_s`, the ledger with the
    /// decrease of chemical energy, and whether derating was active.
    pub(crate) fn write(
        &self,
        lane: usize,
        sign: f64,
        (off_loss_w, drawn_j): (f64, f64),
        (substeps, step_s): (usize, f64),
        at: usize,
        record: &mut Record,
    ) {
        let n = substeps as f64;
        let delivered_w = sign * self.delivered_w.0[lane];
        let standby_w = self.off_steps.0[lane] * off_loss_w + self.grid_loss_w.0[lane];
        let loss_w = self.loss_on_w.0[lane] + standby_w;
        let (heat_w, hysteresis_w) = (self.heat_w.0[lane], self.hysteresis_w.0[lane]);
        let shift_w = self.ocv_shift_w.0[lane];
        record.delivered_w[at] = delivered_w / n;
        record.availability_loss_w[at] = self.availability_loss_w.0[lane] / n;
        record.derating_loss_w[at] = self.derating_loss_w.0[lane] / n;
        record.inverter_loss_w[at] = loss_w / n;
        record.standby_w[at] = standby_w / n;
        record.battery_loss_w[at] = heat_w / n;
        record.reversible_heat_w[at] = self.reversible_w.0[lane] / n;
        record.hysteresis_loss_w[at] = hysteresis_w / n;
        record.chemical_w[at] = drawn_j / (n * step_s);
        record.ocv_shift_w[at] = shift_w / n;
        record.current_a[at] = self.current_a.0[lane] / n;
        record.node_max_c[at] = self.hottest_c.0[lane];
        record.derating_factor[at] = self.factor.0[lane] / n;
        record.inverter_starts[at] = self.starts.0[lane];
        // An inverter that is off, or has reactive power alone, takes its loss from the grid, beside the delivered power.
        let ac_w = standby_w - delivered_w;
        record.ledger_residual_j[at] = (ac_w - (heat_w + hysteresis_w + loss_w - shift_w)) * step_s + drawn_j;
        if self.derating_loss_w.0[lane] > 0.0 {
            record.limits[at] = Limits::DERATING;
        }
    }
}

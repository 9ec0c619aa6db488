use crate::lanes::Lanes;

/// Sums over the plant steps of one control step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Totals<const W: usize> {
    pub(crate) delivered_w: Lanes<W>,
    pub(crate) availability_loss_w: Lanes<W>,
    pub(crate) derating_loss_w: Lanes<W>,
    pub(crate) loss_on_w: Lanes<W>,
    /// Plant steps with the inverter off.
    pub(crate) off_steps: Lanes<W>,
    pub(crate) heat_w: Lanes<W>,
    pub(crate) chemical_w: Lanes<W>,
    pub(crate) current_a: Lanes<W>,
    pub(crate) factor: Lanes<W>,
    pub(crate) starts: Lanes<W>,
    pub(crate) hottest_c: Lanes<W>,
}

impl<const W: usize> Totals<W> {
    pub(crate) fn new() -> Self {
        Self {
            delivered_w: Lanes::ZERO,
            availability_loss_w: Lanes::ZERO,
            derating_loss_w: Lanes::ZERO,
            loss_on_w: Lanes::ZERO,
            off_steps: Lanes::ZERO,
            heat_w: Lanes::ZERO,
            chemical_w: Lanes::ZERO,
            current_a: Lanes::ZERO,
            factor: Lanes::ZERO,
            starts: Lanes::ZERO,
            hottest_c: Lanes::splat(f64::NEG_INFINITY),
        }
    }
}

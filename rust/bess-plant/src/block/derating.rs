//! Derating: the share of a request that a warm string delivers.

use super::Block;
use crate::lanes::Lanes;
use crate::line::Line;

/// Time base of the integral gain [s].
const INTEGRAL_STEP_S: f64 = 900.0;

/// How the derating factor follows from temperature.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum DeratingLaw {
    /// Table over mean temperature.
    #[default]
    Table,
    /// `k = clip(1 - Kp max(e, 0) - Ki I, 0, 1)`, `e = mean temperature - start`; `I <- max(0, I + e)` once per
    /// control step, scaled by its length over 15 min.
    Pi,
}

impl Block {
    /// Integral of the PI law at the beginning of a control step.
    #[inline(always)]
    pub(super) fn integrate_excess(&mut self, substeps: usize) {
        if self.law == DeratingLaw::Pi {
            let share = substeps as f64 * self.step_s / INTEGRAL_STEP_S;
            let excess_k = self.excess_k();
            self.integral_k = (self.integral_k + excess_k * Lanes::splat(share)).max(Lanes::ZERO);
        }
    }

    #[inline(always)]
    fn excess_k(&self) -> Lanes {
        self.air_path.mean_temperature() - Lanes::from_fn(|l| self.strings[l].derating.start_c)
    }

    /// Derating factor, in `[0, 1]`.
    #[inline(always)]
    pub(super) fn derating_factor(&mut self, mean_c: Lanes) -> Lanes {
        let strings = &self.strings;
        let factor = match self.law {
            DeratingLaw::Table => {
                self.factor_lines.at(mean_c, |l, at| Line::of(&strings[l].derating.factor, at))
            }
            DeratingLaw::Pi => {
                let excess_k = self.excess_k().max(Lanes::ZERO);
                let kp = Lanes::from_fn(|l| strings[l].derating.kp_per_k);
                let ki = Lanes::from_fn(|l| strings[l].derating.ki_per_k_step);
                Lanes::splat(1.0) - kp * excess_k - ki * self.integral_k
            }
        };
        factor.max(Lanes::ZERO).min(Lanes::splat(1.0))
    }
}

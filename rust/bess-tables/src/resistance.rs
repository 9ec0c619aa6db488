//! Internal resistance of a string over its state.

use crate::{Axis, Direction, Grid, Lut};

/// Internal resistance of a string [Ohm].
#[derive(Debug, Clone, PartialEq)]
pub enum Resistance {
    /// `f_T(T)`, and `f_soc(soc) f_T(T) / f_T(25 degC)` below the low-SOC switch (docs/equations.md, 1).
    Switched {
        /// `f_T` [Ohm].
        temperature: Lut,
        /// `f_soc / f_T(25 degC)` (dimensionless).
        soc_factor: Lut,
        /// SOC below which the factor applies.
        low_soc_switch: f64,
    },
    /// Measured over SOC (first axis), temperature and C-rate, for each direction: one grid per C-rate.
    Measured {
        /// C-rates of the grids, ascending.
        c_rate: Axis,
        /// Charge, one grid for each C-rate.
        charge: Vec<Grid>,
        /// Discharge, one grid for each C-rate.
        discharge: Vec<Grid>,
        /// C-rate at which the controller, which has no inner iteration, reads the table.
        control_c_rate: f64,
    },
}

impl Resistance {
    /// Multiplies every value by `factor > 0`.
    pub(crate) fn scale(&mut self, factor: f64) {
        match self {
            Self::Switched { temperature, .. } => temperature.scale(factor),
            Self::Measured { charge, discharge, .. } => {
                charge.iter_mut().chain(discharge).for_each(|grid| grid.scale(factor));
            }
        }
    }

    /// Resistance [Ohm] at a state and C-rate.
    #[inline(always)]
    pub fn at(&self, direction: Direction, soc: f64, temperature_c: f64, c_rate: f64) -> f64 {
        match self {
            Self::Switched { temperature, soc_factor, low_soc_switch } => {
                let at_temperature = temperature.at(temperature_c);
                if soc < *low_soc_switch {
                    soc_factor.at(soc) * at_temperature
                } else {
                    at_temperature
                }
            }
            Self::Measured { c_rate: axis, charge, discharge, .. } => {
                let grids = direction.pick(charge, discharge);
                let (segment, share) = axis.locate(c_rate);
                let low = grids[segment].at(soc, temperature_c);
                if grids.len() == 1 || share == 0.0 {
                    return low;
                }
                low + share * (grids[segment + 1].at(soc, temperature_c) - low)
            }
        }
    }

    /// Resistance [Ohm] as the controller sees it: no dependence on the current of the interval.
    #[inline(always)]
    pub fn control_at(&self, direction: Direction, soc: f64, temperature_c: f64) -> f64 {
        let c_rate = match self {
            Self::Switched { .. } => 0.0,
            Self::Measured { control_c_rate, .. } => *control_c_rate,
        };
        self.at(direction, soc, temperature_c, c_rate)
    }
}

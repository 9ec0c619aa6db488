//! The requests of a plant, checked.

use bess_tables::units::W_PER_KW;
use bess_tables::InputError;

use super::{Plant, ROUNDING};
use crate::check::{check_all, check_range, TEMPERATURE_C};

const CONTROL_STEP_S: f64 = 86_400.0;

/// Maximum plant steps x strings in one call: some minutes of work, a century of eight strings at 10 s.
const MAX_PLANT_STEPS: u128 = 10_000_000_000;

/// Checked requests of one call, read by blocks and cooling.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Schedule<'a> {
    /// Control steps.
    pub(crate) steps: usize,
    /// Plant steps in each of them.
    pub(crate) substeps: usize,
    pub(crate) lanes: usize,
    pub(crate) strings: usize,
    pub(crate) request_w: &'a [f64],
    pub(crate) ambient_c: &'a [f64],
    /// None without reactive power.
    pub(crate) reactive_var: Option<&'a [f64]>,
}

impl Schedule<'_> {
    #[inline]
    pub(crate) fn request_w(&self, step: usize, lane: usize) -> f64 {
        self.request_w[step * self.lanes + lane]
    }

    #[inline]
    pub(crate) fn reactive_var(&self, step: usize, lane: usize) -> f64 {
        self.reactive_var.map_or(0.0, |values| values[step * self.lanes + lane])
    }

    #[inline]
    pub(crate) fn ambient_c(&self, step: usize, lane: usize) -> f64 {
        self.ambient_c[step * (self.lanes / self.strings) + lane / self.strings]
    }
}

impl Plant {
    /// Checks the arguments of [`Self::run`].
    pub(super) fn schedule<'a>(
        &self,
        request_w: &'a [f64],
        reactive_var: Option<&'a [f64]>,
        ambient_c: &'a [f64],
        duration_s: f64,
    ) -> Result<Schedule<'a>, InputError> {
        let lanes = self.lanes();
        let steps = request_w.len() / lanes;
        check_all("request", request_w, steps * lanes)?;
        check_all("ambient temperature", ambient_c, steps * self.scenarios)?;
        self.check_powers("requested power", request_w, " kW")?;
        if let Some(reactive_var) = reactive_var {
            check_all("reactive power", reactive_var, steps * lanes)?;
            self.check_powers("reactive power", reactive_var, " kvar")?;
        }
        for (at, &value) in ambient_c.iter().enumerate() {
            let place = || format!("step {}: ", at / self.scenarios);
            check_range("ambient temperature", value, " degC", TEMPERATURE_C, place)?;
        }
        let substeps = self.substeps(duration_s)?;
        let count = steps as u128 * substeps as u128 * lanes as u128;
        if count > MAX_PLANT_STEPS {
            return Err(InputError(format!(
                "{count} plant steps of strings in one call, at {} s each, are more than {MAX_PLANT_STEPS}; call with \
                 fewer control steps or scenarios at a time, or take a longer plant step",
                self.step_s
            )));
        }
        let strings = self.strings.len();
        Ok(Schedule { steps, substeps, lanes, strings, request_w, ambient_c, reactive_var })
    }

    /// Powers of all lanes, step after step, are within the nominal powers of their strings.
    fn check_powers(&self, name: &str, power_w: &[f64], unit: &str) -> Result<(), InputError> {
        let lanes = self.lanes();
        for (at, &value) in power_w.iter().enumerate() {
            let (step, string) = (at / lanes, at % lanes % self.strings.len());
            let nominal_w = self.strings[string].inverter.nominal_w;
            let limit = nominal_w * (1.0 + ROUNDING);
            if !(-limit..=limit).contains(&value) {
                let place = || format!("{}step {step}, string {string}: ", self.scenario(at % lanes));
                let most = nominal_w / W_PER_KW;
                check_range(name, value / W_PER_KW, unit, (-most, most), place)?;
            }
        }
        Ok(())
    }

    fn substeps(&self, duration_s: f64) -> Result<usize, InputError> {
        let (ratio, step_s) = (duration_s / self.step_s, self.step_s);
        check_range("control step", duration_s, " s", (step_s, CONTROL_STEP_S), String::new)?;
        let whole = ratio.round();
        if (ratio - whole).abs() <= ROUNDING * whole {
            Ok(whole as usize)
        } else {
            Err(InputError(format!(
                "a plant step of {step_s} s does not divide a control step of {duration_s} s into a whole number of steps"
            )))
        }
    }
}

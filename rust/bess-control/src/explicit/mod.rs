//! Explicit control: a control law with a bounded number of operations, from tables and fitted weights.
//!
//! `decision` is the control law, in kW and degC as its translations; this module holds its data.

use bess_tables::InputError;

use crate::error::check_length;

#[allow(
    clippy::assign_op_pattern,
    clippy::manual_memcpy,
    clippy::needless_range_loop,
    clippy::too_many_arguments,
    unused_assignments
)]
mod decision;

/// Source text of the control law, for translations.
pub const DECISION: &str = include_str!("decision.rs");

const MAX_STRINGS: usize = 32;

/// Numbers that [`ExplicitLaw::demand_features`] makes of a schedule.
pub const N_FEATURES: usize = decision::N_FEATURES;
/// Weights of a law.
pub const N_WEIGHTS: usize = decision::N_WEIGHTS;

macro_rules! tables {
    ($(#[$doc:meta])* counts: $($count:ident),*; numbers: $($number:ident),*; arrays of $t:ident: $($array:ident[$length:expr]),* $(,)?) => {
        $(#[$doc])*
        #[derive(Debug, Clone, PartialEq, Default)]
        #[allow(missing_docs)]
        pub struct Tables {
            $(pub $count: usize,)*
            $(pub $number: f64,)*
            $(pub $array: Vec<f64>,)*
        }

        impl Tables {
            /// Tables from three functions of a name, which return counts, numbers and arrays.
            ///
            /// # Errors
            ///
            /// Those of the functions.
            pub fn read<E>(
                count: impl Fn(&str) -> Result<usize, E>,
                number: impl Fn(&str) -> Result<f64, E>,
                array: impl Fn(&str) -> Result<Vec<f64>, E>,
            ) -> Result<Self, E> {
                Ok(Self {
                    $($count: count(stringify!($count))?,)*
                    $($number: number(stringify!($number))?,)*
                    $($array: array(stringify!($array))?,)*
                })
            }

            /// Name of each array, and the lengths that it has and needs.
            fn lengths(&self) -> Vec<(&'static str, usize, usize)> {
                let $t = self;
                vec![$((stringify!($array), $t.$array.len(), $length),)*]
            }
        }
    };
}

tables! {
    /// Constants of the control law; `bess.control.explicit.Tables` documents the fields.
    counts: strings, soc_knots, temperature_knots, derating_knots, power_knots, heat_knots, low_knots, steps, near_steps;
    numbers: step_h, step_share, near_share, shortfall, high_fill, min_power_kw, flattest, shed_slope, crumbs, unbounded;
    arrays of t: soc_axis[t.soc_knots], temperature_axis[t.temperature_knots], ocv_v[t.cells()], resistance_ohm[t.cells()],
        derating_c[t.strings * t.derating_knots], derating_factor[t.strings * t.derating_knots],
        power_kw[t.strings * t.power_knots], loss_kw[2 * t.strings * t.power_knots], idle_loss_kw[t.strings],
        capacity_ah[t.strings], energy_kwh[t.strings], soc_min[t.strings], soc_max[t.strings], voltage_min_v[t.strings],
        voltage_max_v[t.strings], derating_start_c[t.strings], heat_k[t.heat_knots], low_fill[t.low_knots], share[3],
}

impl Tables {
    /// Values of a table over SOC and temperature, in both directions.
    fn cells(&self) -> usize {
        2 * self.strings * self.soc_knots * self.temperature_knots
    }
}

/// Measured state of a plant at the start of a step, one value for each string.
#[derive(Debug, Clone, Copy)]
pub struct Measured<'a> {
    /// State of charge.
    pub soc: &'a [f64],
    /// Mean temperature [degC].
    pub temperature_c: &'a [f64],
    /// Capacity over that of the system file.
    pub soh_capacity: &'a [f64],
    /// Resistance over that of the system file.
    pub soh_resistance: &'a [f64],
    /// Maximum power of each inverter [kW].
    pub limit_kw: &'a [f64],
}

/// An explicit law without its weights.
#[derive(Debug, Clone, PartialEq)]
pub struct ExplicitLaw {
    tables: Tables,
}

impl ExplicitLaw {
    /// A law over tables.
    ///
    /// # Errors
    ///
    /// Lengths do not agree.
    pub fn new(tables: Tables) -> Result<Self, String> {
        let t = &tables;
        let small = [
            ("strings", t.strings, 1, MAX_STRINGS),
            ("soc_knots", t.soc_knots, 2, 10_000),
            ("temperature_knots", t.temperature_knots, 2, 10_000),
            ("derating_knots", t.derating_knots, 2, 10_000),
            ("power_knots", t.power_knots, 2, 10_000),
            ("heat_knots", t.heat_knots, 5, 5),
            ("low_knots", t.low_knots, 3, 3),
            ("steps", t.steps, 1, 10_000),
            ("near_steps", t.near_steps, 1, t.steps),
        ];
        for (name, value, low, high) in small {
            if !(low..=high).contains(&value) {
                return Err(format!("{name} = {value}: must be {low} to {high}"));
            }
        }
        for (name, length, needed) in t.lengths() {
            if length != needed {
                return Err(format!("{name}: {length} values, needs {needed}"));
            }
        }
        Ok(Self { tables })
    }

    /// Number of strings.
    pub fn n_strings(&self) -> usize {
        self.tables.strings
    }

    /// Control steps of the schedule that [`Self::demand_features`] takes.
    pub fn n_steps(&self) -> usize {
        self.tables.steps
    }

    /// Demand features of a forecast `(steps,)` [kW], which starts with the demand of this step.
    ///
    /// # Errors
    ///
    /// The forecast has a wrong length.
    pub fn demand_features(&self, ahead_kw: &[f64]) -> Result<[f64; N_FEATURES], InputError> {
        check_length("demand", ahead_kw, self.tables.steps)?;
        let mut features = [0.0; N_FEATURES];
        decision::demand_features(&self.tables, ahead_kw, &mut features);
        Ok(features)
    }

    /// Set-points `(M,)` [kW], signed as the demand, with [`N_WEIGHTS`] weights and the features that
    /// [`Self::demand_features`] gives.
    ///
    /// # Errors
    ///
    /// An array has not one value for each string, or there are not [`N_WEIGHTS`] weights.
    pub fn split(
        &self,
        weights: &[f64],
        plant: &Measured<'_>,
        demand_kw: f64,
        features: &[f64; N_FEATURES],
    ) -> Result<Vec<f64>, InputError> {
        let n = self.tables.strings;
        check_length("weights", weights, N_WEIGHTS)?;
        check_length("soc", plant.soc, n)?;
        check_length("temperature_c", plant.temperature_c, n)?;
        check_length("soh_capacity", plant.soh_capacity, n)?;
        check_length("soh_resistance", plant.soh_resistance, n)?;
        check_length("limit_kw", plant.limit_kw, n)?;
        let mut request_kw = vec![0.0; n];
        decision::split(
            &self.tables,
            weights,
            plant.soc,
            plant.temperature_c,
            plant.soh_capacity,
            plant.soh_resistance,
            plant.limit_kw,
            demand_kw,
            features,
            &mut request_kw,
        );
        Ok(request_kw)
    }
}

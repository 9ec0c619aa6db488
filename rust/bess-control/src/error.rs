//! Input errors of the control model, and their checks.

use thiserror::Error;

use crate::model::Losses;

/// Invalid input of the control model. The message contains name, value and allowed range.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum ControlError {
    /// An array has the wrong number of values.
    #[error("{name}: needs {expected} values, has {actual}")]
    Length {
        /// Which array.
        name: &'static str,
        /// Required number of values.
        expected: usize,
        /// Actual number of values.
        actual: usize,
    },
    /// A number outside its range.
    #[error("{name}: {value} at position {position} is outside [{low}, {high}]{unit}")]
    Range {
        /// Which array.
        name: &'static str,
        /// Flat position in the array.
        position: usize,
        /// The value.
        value: f64,
        /// Smallest value allowed.
        low: f64,
        /// Largest value allowed.
        high: f64,
        /// Unit, with a leading space.
        unit: &'static str,
    },
    /// Requests of one step with both signs.
    #[error("step {step}: requests of both signs (string {string} asks for {value_w} W against the others)")]
    MixedSigns {
        /// The step.
        step: usize,
        /// The string against the others.
        string: usize,
        /// Its request, positive = discharge [W].
        value_w: f64,
    },
    /// A group of strings without a string.
    #[error("groups: no string is in group {group}")]
    EmptyGroup {
        /// Its number.
        group: usize,
    },
    /// Demand above the limits of the strings.
    #[error("step {step}: demand of {demand_w} W is above the sum of the limits, {limit_w} W")]
    DemandAboveLimits {
        /// The step.
        step: usize,
        /// Demand [W].
        demand_w: f64,
        /// Sum of the limits [W].
        limit_w: f64,
    },
}

/// Checks the length of an array.
pub(crate) fn check_length<T>(name: &'static str, values: &[T], expected: usize) -> Result<(), ControlError> {
    if values.len() == expected {
        return Ok(());
    }
    Err(ControlError::Length { name, expected, actual: values.len() })
}

/// Checks that every value lies in `[low, high]`; NaN does not.
pub(crate) fn check_range(
    name: &'static str,
    values: &[f64],
    (low, high): (f64, f64),
    unit: &'static str,
) -> Result<(), ControlError> {
    match values.iter().position(|v| !(low..=high).contains(v)) {
        None => Ok(()),
        Some(position) => {
            Err(ControlError::Range { name, position, value: values[position], low, high, unit })
        }
    }
}

/// Checks costs of the losses of each string [1/W].
pub(crate) fn check_costs(costs: &[Losses], n_strings: usize) -> Result<(), ControlError> {
    check_length("costs", costs, n_strings)?;
    let flat: Vec<f64> = costs.iter().flat_map(|c| c.to_array()).collect();
    check_range("costs", &flat, (0.0, f64::MAX), " 1/W")
}

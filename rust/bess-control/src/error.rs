//! Checks of the input of the control model.

use bess_tables::InputError;

use crate::model::Losses;

/// A number at a flat position of an array is outside its range; the unit begins with a space.
pub(crate) fn out_of_range(
    name: &str,
    position: usize,
    value: f64,
    (low, high): (f64, f64),
    unit: &str,
) -> InputError {
    InputError(format!("{name}: {value} at position {position} is outside [{low}, {high}]{unit}"))
}

pub(crate) fn check_length<T>(name: &'static str, values: &[T], expected: usize) -> Result<(), InputError> {
    if values.len() == expected {
        return Ok(());
    }
    Err(InputError(format!("{name}: needs {expected} values, has {}", values.len())))
}

/// Checks that every value lies in `[low, high]`; NaN does not.
pub(crate) fn check_range(
    name: &'static str,
    values: &[f64],
    (low, high): (f64, f64),
    unit: &'static str,
) -> Result<(), InputError> {
    match values.iter().position(|v| !(low..=high).contains(v)) {
        None => Ok(()),
        Some(position) => Err(out_of_range(name, position, values[position], (low, high), unit)),
    }
}

pub(crate) fn check_costs(costs: &[Losses], n_strings: usize) -> Result<(), InputError> {
    check_length("costs", costs, n_strings)?;
    let flat: Vec<f64> = costs.iter().flat_map(|c| c.to_array()).collect();
    check_range("costs", &flat, (0.0, f64::MAX), " 1/W")
}

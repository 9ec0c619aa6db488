//! Checks of the arguments of a plant.

use bess_tables::InputError;

/// Temperatures that a plant accepts [degC], and factors on capacity and on resistance.
pub(crate) const TEMPERATURE_C: (f64, f64) = (-60.0, 150.0);
pub(crate) const SOH_CAPACITY: (f64, f64) = (0.01, 1.5);
pub(crate) const SOH_RESISTANCE: (f64, f64) = (0.1, 100.0);

pub(crate) fn check_all<T>(name: &str, values: &[T], expected: usize) -> Result<(), InputError> {
    if values.len() == expected {
        Ok(())
    } else {
        Err(InputError(format!("{name}: {} values, needs {expected}", values.len())))
    }
}

/// Index of `name` among `all`, or an error with the names that there are.
pub(crate) fn named(what: &str, name: &str, all: &[&str]) -> Result<usize, InputError> {
    let unknown = || InputError(format!("{what} '{name}' is unknown; there are {}", all.join(", ")));
    all.iter().position(|entry| *entry == name).ok_or_else(unknown)
}

/// `value` lies in the closed range `limits`; NaN does not.
pub(crate) fn check_range(
    name: &str,
    value: f64,
    unit: &str,
    limits: (f64, f64),
    place: impl Fn() -> String,
) -> Result<(), InputError> {
    if (limits.0..=limits.1).contains(&value) {
        return Ok(());
    }
    let ((low, high), place) = (limits, place());
    Err(InputError(format!("{place}{name} {value}{unit} is outside [{low}, {high}]{unit}")))
}

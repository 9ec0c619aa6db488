//! Checks of the arguments of a plant.

use bess_tables::InputError;

/// Temperatures that a plant accepts [degC].
pub(crate) const TEMPERATURE_C: (f64, f64) = (-60.0, 150.0);

pub(crate) fn check_all<T>(name: &str, values: &[T], expected: usize) -> Result<(), InputError> {
    if values.len() == expected {
        Ok(())
    } else {
        Err(InputError(format!("{name}: {} values, needs {expected}", values.len())))
    }
}

/// The entry called `name`, or an error with the names that there are.
pub(crate) fn named<T>(
    what: &str,
    name: &str,
    all: impl Iterator<Item = T> + Clone,
    name_of: impl Fn(&T) -> &'static str,
) -> Result<T, InputError> {
    all.clone().find(|entry| name_of(entry) == name).ok_or_else(|| {
        let known = all.map(|entry| name_of(&entry)).collect::<Vec<_>>().join(", ");
        InputError(format!("{what} '{name}' is unknown; there are {known}"))
    })
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

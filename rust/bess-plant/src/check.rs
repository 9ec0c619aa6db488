//! Checks of the arguments of a plant.

use crate::PlantError;

/// Temperatures that a plant accepts [degC].
pub(crate) const TEMPERATURE_C: (f64, f64) = (-60.0, 150.0);

/// `values` has `expected` entries.
pub(crate) fn check_all<T>(name: &'static str, values: &[T], expected: usize) -> Result<(), PlantError> {
    if values.len() == expected {
        Ok(())
    } else {
        Err(PlantError::Shape { name, found: values.len(), expected })
    }
}

/// `value` lies in the closed range `limits`; NaN does not.
pub(crate) fn check_range(
    name: &'static str,
    value: f64,
    unit: &'static str,
    limits: (f64, f64),
    place: impl Fn() -> String,
) -> Result<(), PlantError> {
    if (limits.0..=limits.1).contains(&value) {
        return Ok(());
    }
    Err(PlantError::Range { place: place(), name, value, unit, low: limits.0, high: limits.1 })
}

//! Input errors of tables, systems and plants.

use thiserror::Error;

/// Invalid input: a sentence with its name, its value with unit, and the allowed range.
#[derive(Debug, Clone, PartialEq, Error)]
#[error("{0}")]
pub struct InputError(pub String);

impl InputError {
    pub(crate) fn table(name: &str, reason: impl Into<String>) -> Self {
        Self(format!("{name}: {}", reason.into()))
    }

    /// The description of a system does not have the expected structure.
    pub(crate) fn document(reason: impl std::fmt::Display) -> Self {
        Self(format!("system description: {reason}"))
    }
}

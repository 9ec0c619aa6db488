//! Why a table or a description of a plant is refused.

use thiserror::Error;

/// Invalid table or parameter. The message gives its name, its value and the allowed range.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum TableError {
    /// A look-up table with a bad shape or bad values.
    #[error("{name}: {reason}")]
    Table {
        /// Which table.
        name: String,
        /// Description of the problem.
        reason: String,
    },
    /// The document does not have the expected structure.
    #[error("system description: {0}")]
    Document(String),
}

impl TableError {
    pub(crate) fn table(name: &str, reason: impl Into<String>) -> Self {
        Self::Table { name: name.to_owned(), reason: reason.into() }
    }
}

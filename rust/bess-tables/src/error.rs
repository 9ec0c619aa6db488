//! Why a table or a description of a plant is refused.

use thiserror::Error;

/// A table or parameter that cannot be used. The text names the thing, its value and what is allowed.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum TableError {
    /// A look-up table with a bad shape or bad values.
    #[error("{name}: {reason}")]
    Table {
        /// Which table.
        name: String,
        /// What is wrong with it.
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

//! Input errors of a plant.

use thiserror::Error;

/// Invalid input of a plant. The message contains value, unit, place and allowed range.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum PlantError {
    /// The explicit scheme is unstable.
    #[error(
        "string {string}: a plant step of {step_s} s is unstable for {nodes} thermal nodes \
         (2 Fo + lateral = {number:.4} > 1); use at most {largest_s:.4} s, or fewer nodes"
    )]
    Unstable {
        /// Index of the string.
        string: usize,
        /// Plant step asked for [s].
        step_s: f64,
        /// Thermal nodes of the string.
        nodes: usize,
        /// `2 Fo + lateral` at that step.
        number: f64,
        /// Largest stable step [s].
        largest_s: f64,
    },
    /// Anything else.
    #[error("{0}")]
    Invalid(String),
}

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
    /// An array with the wrong number of values.
    #[error("{name}: {found} values, needs {expected}")]
    Shape {
        /// Which array.
        name: &'static str,
        /// Values given.
        found: usize,
        /// Values needed.
        expected: usize,
    },
    /// A value outside its range (NaN included).
    #[error("{place}{name} {value}{unit} is outside [{low}, {high}]{unit}")]
    Range {
        /// Where: `step 3, string 1: `.
        place: String,
        /// Which quantity.
        name: &'static str,
        /// The value.
        value: f64,
        /// Unit, with a leading blank.
        unit: &'static str,
        /// Lowest allowed value.
        low: f64,
        /// Highest allowed value.
        high: f64,
    },
    /// No ageing model, or no kind of cooling, has this name.
    #[error("{what} '{name}' is unknown; there are {known}")]
    Unknown {
        /// What was named.
        what: &'static str,
        /// The name given.
        name: String,
        /// The names that there are.
        known: String,
    },
    /// The plant step does not divide the control step.
    #[error(
        "a plant step of {step_s} s does not divide a control step of {duration_s} s into a whole number \
         of steps"
    )]
    Division {
        /// Plant step [s].
        step_s: f64,
        /// Control step [s].
        duration_s: f64,
    },
    /// More work than is allowed in one call.
    #[error(
        "{count} plant steps of strings in one call, at {step_s} s each, are more than {most}; call with fewer \
         control steps or scenarios at a time, or take a longer plant step"
    )]
    TooMany {
        /// Plant steps of all strings.
        count: u128,
        /// Most of them in one call.
        most: u128,
        /// Plant step [s].
        step_s: f64,
    },
}

//! Errors of the data model.

/// Reason why a cloud, a mesh or a scene was rejected.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ModelError {
    /// Elements of a cloud or mesh break its rules.
    #[error("{what} {index} is invalid: {problem}; {count} of {total} are, {advice}")]
    InvalidElements {
        /// Kind of element: "splat", "point", "vertex" or "triangle".
        what: &'static str,
        /// Index of the first invalid element, counted from 0.
        index: usize,
        /// Problem of that element.
        problem: String,
        /// Number of invalid elements.
        count: usize,
        /// Number of all elements.
        total: usize,
        /// Advice for the user that ends the message.
        advice: &'static str,
    },
    /// Columns have different lengths.
    #[error("column '{column}' has {found} values, expected {expected}: one for each element")]
    ColumnLength {
        /// Name of the column.
        column: &'static str,
        /// Length of the column.
        found: usize,
        /// Number of elements, which the length must equal.
        expected: usize,
    },
    /// A number of a scene, camera, light, material or setting is outside of its accepted range.
    #[error("{field} is {found}, expected {expected}")]
    OutOfRange {
        /// Path of the field, as the scene file writes it.
        field: String,
        /// Value that was found.
        found: String,
        /// Range or condition that the value must satisfy.
        expected: &'static str,
    },
    /// Values that are valid alone contradict each other. The text describes the problem.
    #[error("{0}")]
    Conflict(String),
}

impl ModelError {
    /// Creates a [`ModelError::OutOfRange`].
    pub(crate) fn range(field: impl Into<String>, found: impl std::fmt::Display, expected: &'static str) -> Self {
        Self::OutOfRange { field: field.into(), found: found.to_string(), expected }
    }
}

//! What can be wrong with data.

/// Why a cloud, a mesh or a scene was refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ModelError {
    /// Elements of a cloud or mesh break its rules.
    #[error("{what} {index} is invalid: {problem}; {count} of {total} are, {advice}")]
    InvalidElements {
        /// What kind of element: "splat", "point", "vertex" or "triangle".
        what: &'static str,
        /// The first offender, counted from 0.
        index: usize,
        /// What is wrong with it.
        problem: String,
        /// How many are invalid.
        count: usize,
        /// Out of how many.
        total: usize,
        /// What to do.
        advice: &'static str,
    },
    /// Columns of different lengths.
    #[error("column '{column}' has {found} values, expected {expected}: one for each element")]
    ColumnLength {
        /// The column's name.
        column: &'static str,
        /// Its length.
        found: usize,
        /// The number of elements.
        expected: usize,
    },
    /// A number of a scene, camera, light, material or setting is out of its range.
    #[error("{field} is {found}, expected {expected}")]
    OutOfRange {
        /// Path of the field, as in the scene file.
        field: String,
        /// The value found.
        found: String,
        /// The range or condition expected.
        expected: &'static str,
    },
    /// A combination that isn't allowed.
    #[error("{0}")]
    Conflict(String),
}

impl ModelError {
    /// An [`ModelError::OutOfRange`].
    pub(crate) fn range(field: impl Into<String>, found: impl std::fmt::Display, expected: &'static str) -> Self {
        Self::OutOfRange { field: field.into(), found: found.to_string(), expected }
    }
}

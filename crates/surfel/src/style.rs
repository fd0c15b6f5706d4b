//! Styles: choices for an image that its options leave open.

/// A named set of choices.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Style {
    /// An image for a paper.
    Figure,
}

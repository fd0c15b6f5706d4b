//! Styles: choices for an image that its options leave open.

use surfel_model::{EdgeAa, GroundStyle};
use surfel_stage::NamedLight;

/// Named set of defaults for options that aren't set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Style {
    /// An image for a paper.
    Figure,
}

/// Choices of a style for options that aren't given.
pub(crate) struct Choices {
    pub(crate) size: [u32; 2],
    pub(crate) background: [f64; 4],
    pub(crate) edge_aa: EdgeAa,
    /// Light and ground of objects that can store light.
    pub(crate) light: NamedLight,
    pub(crate) bounce: bool,
    pub(crate) ground: GroundStyle,
}

impl Style {
    /// Returns all choices of the style.
    pub(crate) fn choices(self) -> Choices {
        match self {
            Self::Figure => Choices {
                size: [2048, 2048],
                background: [1.0; 4],
                edge_aa: EdgeAa::Samples,
                light: NamedLight::Studio,
                bounce: true,
                ground: GroundStyle::Shadow,
            },
        }
    }
}

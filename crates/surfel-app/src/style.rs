//! Styles: sets of defaults for the options of an image.

use surfel_model::{EdgeAa, GroundStyle};
use surfel_stage::NamedLight;

/// Named set of defaults for options that the user doesn't set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Style {
    /// Defaults for an image in a paper: white background, studio light and a shadow on the ground.
    Figure,
}

/// Defaults of a style, for options that the user doesn't set.
pub(crate) struct Choices {
    pub(crate) size: [u32; 2],
    pub(crate) background: [f64; 4],
    pub(crate) edge_aa: EdgeAa,
    /// Light for objects that can store light. If an object can't, neither light nor ground is applied.
    pub(crate) light: NamedLight,
    pub(crate) bounce: bool,
    pub(crate) ground: GroundStyle,
}

impl Style {
    /// Returns the defaults of the style.
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

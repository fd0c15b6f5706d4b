//! Fill-rate probes: full-screen triangles whose fragments compute nothing.

/// How many full-screen triangles a probe draws, and so how often each pixel is drawn.
pub(crate) const OVERDRAW: u32 = 16;

/// What a probe measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FillRateProbe {
    /// Clears of the two targets of colour and surface.
    Clear,
    /// Depths from the fragment shader, each nearer than the last: the visibility pass.
    Depth,
    /// Colours that replace the last.
    Fill,
    /// Colours that are added: the attribute pass of an unlit image.
    Blend,
    /// Colours and surfaces that are added: the attribute pass of others.
    BlendTwo,
}

impl FillRateProbe {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Clear, Self::Depth, Self::Fill, Self::Blend, Self::BlendTwo];

    /// Its name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Clear => "clear",
            Self::Depth => "depth",
            Self::Fill => "fill",
            Self::Blend => "blend",
            Self::BlendTwo => "blend two",
        }
    }

    /// Triangles that its pass draws.
    pub(crate) fn triangles(self) -> u32 {
        if self == Self::Clear { 0 } else { OVERDRAW }
    }
}

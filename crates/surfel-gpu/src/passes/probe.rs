//! Fill-rate probes: clears, and full-screen triangles whose fragments compute nothing. Their times give upper bounds
//! of a device's speed.

/// Number of full-screen triangles that a probe draws (or of clears), which is the number of fragments per pixel.
pub(crate) const OVERDRAW: u32 = 16;

/// Fill-rate probe, by the operation that it measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FillRateProbe {
    /// Clears of two targets, colour and surface.
    Clear,
    /// Depths written by the fragment shader, each nearer than the previous one, as in the visibility pass.
    Depth,
    /// Colours that replace the previous colours.
    Fill,
    /// Colours added to a target, as in the attribute pass of an unlit image.
    Blend,
    /// Colours and surfaces added to two targets, as in the attribute pass of a lit image.
    BlendTwo,
}

impl FillRateProbe {
    /// All probes.
    pub const ALL: [Self; 5] = [Self::Clear, Self::Depth, Self::Fill, Self::Blend, Self::BlendTwo];

    /// Returns the name of the probe in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Clear => "clear",
            Self::Depth => "depth",
            Self::Fill => "fill",
            Self::Blend => "blend",
            Self::BlendTwo => "blend two",
        }
    }

    /// Returns the number of triangles that the probe's pass draws.
    pub(crate) fn triangles(self) -> u32 {
        if self == Self::Clear { 0 } else { OVERDRAW }
    }
}

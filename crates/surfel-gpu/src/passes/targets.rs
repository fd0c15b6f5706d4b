//! Textures that passes of a tile draw into (targets), independent of the API. A *record* is a splat as set up for a
//! tile: its projected forms, pixel boxes and colour in a buffer.

/// Texture that passes of a tile write.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Target {
    /// Depth buffer of the depth threshold, which is the smallest z + ε of a pixel, as the reversed depth z_near/z.
    DepthThreshold,
    /// Sums Σw·(colour, 1) over the fragments of the nearest opaque surface, where w is a fragment's weight.
    Color,
    /// Sums Σw·(normal, z) of the nearest opaque surface.
    Surface,
    /// Sums Σw·(ambient, diffuse and specular factor, shininess) of the nearest opaque surface.
    Material,
    /// Number of fragments of the nearest opaque surface, and their coverage of the pixel.
    Counts,
    /// The z + ε and the tolerance ε of the splat that defines the depth threshold; zeros without one.
    ThresholdTolerance,
    /// The depth threshold at edge pixels as a reversed depth; 0 elsewhere.
    EdgeThreshold,
    /// Like `DepthThreshold`, for the edge background: the surface behind the nearest one at edge pixels.
    EdgeBackgroundThreshold,
    /// Depth buffer of the nearest polygon, reversed.
    PolygonDepth,
    /// Depth of the nearest polygon, and the polygon's index plus one; zeros without a polygon.
    Polygons,
    /// Depth buffer of the pass that finds `Facing`: the reversed depth of the nearest fragment of oriented splats.
    FacingDepth,
    /// Side of oriented splats that each pixel shows: the depth of its nearest fragment, negative if that is
    /// back-facing; 0 without a fragment of oriented splats.
    Facing,
    /// Like `Color`, for the edge background.
    EdgeBackgroundColor,
    /// Like `Surface`, for the edge background.
    EdgeBackgroundSurface,
    /// Like `Material`, for the edge background.
    EdgeBackgroundMaterial,
    /// Like `DepthThreshold`, for a transparent layer.
    LayerThreshold,
    /// Like `Color`, for a transparent layer.
    LayerColor,
    /// Like `Surface`, for a transparent layer.
    LayerSurface,
    /// Like `Material`, for a transparent layer.
    LayerMaterial,
    /// Number of fragments of a transparent layer, and Σw·alpha.
    LayerCounts,
    /// Number of fragments, Σw·alpha, and the coverage of the pixel by an A-buffer layer.
    LayerCoverage,
    /// Like `ThresholdTolerance`, for the first (nearest) transparent layer only.
    LayerTolerance,
    /// Depth buffer of the passes that find `Nearest` and `LayerNearest`: the reversed depth of the nearest fragment.
    NearestDepth,
    /// Draw and record of the nearest splat of the opaque image: the index of its draw plus one, and the number of its
    /// record within that draw; zeros without a splat.
    Nearest,
    /// Like `Nearest`, for transparent layers.
    LayerNearest,
    /// Two numbers: 1 if the pixel is antialiased by samples, else 0; and the depth of the surface visible in the
    /// pixel.
    Steps,
}

/// Format of a target's texels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum TargetFormat {
    /// A depth buffer in f32.
    Depth,
    /// Four sums, in the precision of a plan's sums.
    Sums4,
    /// Two sums, in the precision of a plan's sums.
    Sums2,
    /// Two numbers in f32.
    Exact2,
    /// One number in f32.
    Exact1,
}

impl Target {
    /// All targets.
    pub const ALL: [Self; 26] = [
        Self::DepthThreshold,
        Self::Color,
        Self::Surface,
        Self::Material,
        Self::Counts,
        Self::ThresholdTolerance,
        Self::EdgeThreshold,
        Self::PolygonDepth,
        Self::Polygons,
        Self::FacingDepth,
        Self::Facing,
        Self::EdgeBackgroundThreshold,
        Self::EdgeBackgroundColor,
        Self::EdgeBackgroundSurface,
        Self::EdgeBackgroundMaterial,
        Self::LayerThreshold,
        Self::LayerColor,
        Self::LayerSurface,
        Self::LayerMaterial,
        Self::LayerCounts,
        Self::LayerCoverage,
        Self::LayerTolerance,
        Self::NearestDepth,
        Self::Nearest,
        Self::LayerNearest,
        Self::Steps,
    ];

    /// Returns the target's name for messages and debuggers.
    pub fn name(self) -> &'static str {
        match self {
            Self::DepthThreshold => "depth threshold",
            Self::Color => "colour sums",
            Self::Surface => "surface sums",
            Self::Material => "material sums",
            Self::Counts => "fragment counts",
            Self::ThresholdTolerance => "depth threshold and tolerance",
            Self::EdgeThreshold => "edge threshold",
            Self::PolygonDepth => "polygon depth",
            Self::Polygons => "polygons",
            Self::FacingDepth => "depth of the shown side",
            Self::Facing => "shown side",
            Self::EdgeBackgroundThreshold => "depth threshold of the edge background",
            Self::EdgeBackgroundColor => "colour sums of the edge background",
            Self::EdgeBackgroundSurface => "surface sums of the edge background",
            Self::EdgeBackgroundMaterial => "material sums of the edge background",
            Self::LayerThreshold => "depth threshold of a layer",
            Self::LayerColor => "colour sums of a layer",
            Self::LayerSurface => "surface sums of a layer",
            Self::LayerMaterial => "material sums of a layer",
            Self::LayerCounts => "fragment counts of a layer",
            Self::LayerCoverage => "fragment counts and coverage of a layer",
            Self::LayerTolerance => "depth threshold and tolerance of the nearest layer",
            Self::NearestDepth => "depth of the nearest",
            Self::Nearest => "nearest splats",
            Self::LayerNearest => "nearest splats of layers",
            Self::Steps => "steps",
        }
    }

    /// Returns the format of the target's texels.
    pub fn format(self) -> TargetFormat {
        match self {
            Self::DepthThreshold
            | Self::EdgeBackgroundThreshold
            | Self::PolygonDepth
            | Self::FacingDepth
            | Self::LayerThreshold
            | Self::NearestDepth => TargetFormat::Depth,
            Self::Counts | Self::LayerCounts => TargetFormat::Sums2,
            Self::ThresholdTolerance
            | Self::Polygons
            | Self::LayerTolerance
            | Self::Nearest
            | Self::LayerNearest
            | Self::Steps => TargetFormat::Exact2,
            Self::EdgeThreshold | Self::Facing => TargetFormat::Exact1,
            _ => TargetFormat::Sums4,
        }
    }
}

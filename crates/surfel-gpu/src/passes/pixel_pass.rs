//! Compute passes over the pixels of a tile: shading, compositing of layers, storing of shadow maps, means of samples,
//! trained Gaussians.

use crate::passes::targets::Target;
use surfel_render::SAMPLES_SIDE;

/// Compute pass of which each invocation processes one pixel, unless a variant says otherwise.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum PixelPass {
    /// Starts the layer composites, the transparent layers of each pixel: finds the depth of the opaque surface that
    /// occludes transparent splats.
    BeginLayers,
    /// Starts the layer composites like [`PixelPass::BeginLayers`], with the depth buffer of the embedding application
    /// as an additional occluder. No plan contains this pass.
    BeginLayersInHost,
    /// Shades a peeled layer and composites it behind the layers before it.
    PeeledLayer,
    /// Shades a layer of an A-buffer and composites it behind the layers before it, with its alpha times its coverage.
    GatheredLayer,
    /// Ends the layers if no pixel has a fragment in the layer just drawn. It runs once per layer, not per pixel.
    NextLayer,
    /// Composites all transparent splats behind the peeled layers as one last layer.
    RemainingLayer,
    /// Copies a tile of a shadow map into the buffer of all maps.
    StoreShadow,
    /// Writes the draw and record number of the nearest splat, polygon or ball of each pixel.
    Nearest,
    /// Shades an image of any kind without balls.
    Shade,
    /// Shades an image that has only opaque splats, without shadows, the shader `toon`, and passes that read
    /// neighbouring pixels.
    ShadeSplats,
    /// Shades an image that contains balls.
    ShadeBalls,
    /// Shades samples, and replaces the colour of each sampled pixel by the mean of its samples.
    ResolveSamples,
    /// [`PixelPass::ResolveSamples`] for an image that contains balls.
    ResolveSamplesBalls,
    /// Draws trained Gaussians, sorted by their centres.
    Gaussians,
    /// Draws trained Gaussians like [`PixelPass::Gaussians`], except fragments behind the application's depth buffer.
    /// No plan contains this pass.
    GaussiansInHost,
    /// Draws trained Gaussians, sorted in each pixel.
    GaussiansByPixel,
}

/// Name under which the statistics sum the times of all passes that antialias edges by samples.
pub const EDGE_SAMPLES: &str = "edge samples";

/// Textures that pixel passes read, as pairs of binding and target. Each pass reads a subset.
pub const PIXEL_PASS_TEXTURES: [(u32, Target); 21] = [
    (0, Target::Color),
    (1, Target::Surface),
    (2, Target::Material),
    (3, Target::Counts),
    (5, Target::EdgeThreshold),
    (6, Target::ThresholdTolerance),
    (7, Target::EdgeBackgroundColor),
    (8, Target::EdgeBackgroundSurface),
    (9, Target::EdgeBackgroundMaterial),
    (10, Target::DepthThreshold),
    (11, Target::Polygons),
    (16, Target::LayerColor),
    (17, Target::LayerSurface),
    (18, Target::LayerMaterial),
    (19, Target::LayerCounts),
    (20, Target::LayerThreshold),
    (24, Target::LayerTolerance),
    (25, Target::Steps),
    (26, Target::Nearest),
    (27, Target::LayerNearest),
    (30, Target::LayerCoverage),
];

/// Bindings of the buffers that pixel passes read and write, in this order: planes, polygons, texels, layer composites
/// to write, layer composites to read, texels of the shadow map being drawn, indirect draws of layers, balls.
pub const PIXEL_PASS_BUFFERS: [u32; 8] = [4, 12, 13, 14, 15, 21, 22, 31];

/// Bindings of a tile's [`GaussianLists`](crate::GaussianLists): records, then lists. The passes of trained Gaussians
/// read them.
pub const GAUSSIAN_BUFFERS: [u32; 2] = [28, 29];

/// Binding of [`Target::Steps`] in the bind group of splat setup, after the bindings of the group's buffers.
pub const SETUP_STEPS_BINDING: u32 = 7;

/// Binding of the depth buffer of the application that embeds Surfel.
pub const HOST_DEPTH_BINDING: u32 = 23;

/// Binding of the planes that are composited into the application's render target.
pub const HOST_PLANES_BINDING: u32 = 62;

impl PixelPass {
    /// Returns the name of the pass's entry point.
    pub fn entry(self) -> &'static str {
        match self {
            Self::BeginLayers => "begin_layers",
            Self::BeginLayersInHost => "begin_layers_in_host",
            Self::PeeledLayer => "peeled_layer",
            Self::GatheredLayer => "gathered_layer",
            Self::NextLayer => "next_layer",
            Self::RemainingLayer => "remaining_layer",
            Self::StoreShadow => "store_shadow",
            Self::Nearest => "nearest",
            Self::Shade => "shade",
            Self::ShadeSplats => "shade_splats",
            Self::ShadeBalls => "shade_balls",
            Self::ResolveSamples => "resolve_samples",
            Self::ResolveSamplesBalls => "resolve_samples_balls",
            Self::Gaussians => "gaussians",
            Self::GaussiansInHost => "gaussians_in_host",
            Self::GaussiansByPixel => "gaussians_by_pixel",
        }
    }

    /// True if the pass shades the image. It is then the last pass of its tile, and runs only over the tile without its
    /// border.
    pub fn is_shade(self) -> bool {
        matches!(self, Self::Shade | Self::ShadeSplats | Self::ShadeBalls)
    }

    /// Returns the width and height, in pixels, of the area that the pass covers. `targets` is the size of the tile's
    /// textures, and `shaded` the size of the shaded tile. Means of samples cover pixels of the image, each with the
    /// samples of one pixel; all other areas are in pixels of the textures.
    pub fn size(self, targets: [u32; 2], shaded: [u32; 2]) -> [u32; 2] {
        match self {
            Self::Shade
            | Self::ShadeSplats
            | Self::ShadeBalls
            | Self::Nearest
            | Self::Gaussians
            | Self::GaussiansInHost
            | Self::GaussiansByPixel => shaded,
            Self::NextLayer => [1, 1],
            Self::ResolveSamples | Self::ResolveSamplesBalls => targets.map(|side| side / SAMPLES_SIDE),
            Self::BeginLayers
            | Self::BeginLayersInHost
            | Self::PeeledLayer
            | Self::GatheredLayer
            | Self::RemainingLayer
            | Self::StoreShadow => targets,
        }
    }

    /// Returns the name of the pass in the statistics.
    pub fn name(self) -> &'static str {
        match self {
            Self::BeginLayers
            | Self::BeginLayersInHost
            | Self::PeeledLayer
            | Self::GatheredLayer
            | Self::NextLayer
            | Self::RemainingLayer => "layers",
            Self::StoreShadow => "shadow maps",
            Self::Nearest => "nearest",
            Self::Shade | Self::ShadeSplats | Self::ShadeBalls => "shade",
            Self::ResolveSamples | Self::ResolveSamplesBalls => EDGE_SAMPLES,
            Self::Gaussians | Self::GaussiansInHost | Self::GaussiansByPixel => "gaussians",
        }
    }
}

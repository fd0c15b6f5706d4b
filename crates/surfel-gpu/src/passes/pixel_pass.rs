//! Compute passes over the pixels of a tile: shading, compositing of layers, storing of shadow maps, means of samples,
//! trained Gaussians.

use crate::passes::targets::Target;
use surfel_render::SAMPLES_SIDE;

/// A compute pass over pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum PixelPass {
    /// Starts the layer composites: finds the opaque depth that occludes transparent splats.
    BeginLayers,
    /// The same, with a host's depth buffer occluding them, too; no plan needs it.
    BeginLayersInHost,
    /// Shades a peeled layer and composites it under those before it.
    PeeledLayer,
    /// Shades a layer of an A-buffer and composites it so, by its coverage.
    GatheredLayer,
    /// Ends the layers if nothing remains; runs once, not for each pixel.
    NextLayer,
    /// Composites all remaining transparent splats under the layers.
    RemainingLayer,
    /// Writes a part of a shadow map.
    StoreShadow,
    /// Writes what is nearest in each pixel.
    Nearest,
    /// Shades the image.
    Shade,
    /// Shades an image of opaque splats alone, without shadows and screen-space passes.
    ShadeSplats,
    /// Draws what depends on neighbours, after cells.
    CellNeighbours,
    /// Shades samples and writes their means over the colours of sampled pixels.
    ResolveSamples,
    /// Draws trained Gaussians, in the order of their centres.
    Gaussians,
    /// Draws them in the order of each pixel.
    GaussiansByPixel,
}

/// Name in the statistics of all passes that edges by samples add.
pub const EDGE_SAMPLES: &str = "edge samples";

/// The textures that pixel passes read, by binding; each reads some of them.
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
/// to write, layer composites to read, texels of the shadow map that is drawn, indirect draws of layers.
pub const PIXEL_PASS_BUFFERS: [u32; 7] = [4, 12, 13, 14, 15, 21, 22];

/// Bindings of a tile's [`GaussianLists`](crate::GaussianLists), which the passes of trained Gaussians read: records,
/// lists.
pub const GAUSSIAN_BUFFERS: [u32; 2] = [28, 29];

/// Binding of [`Target::Steps`] in the group of splat setup, after its buffers.
pub const SETUP_STEPS_BINDING: u32 = 7;

/// Binding of a host's depth buffer.
pub const HOST_DEPTH_BINDING: u32 = 23;

impl PixelPass {
    /// Its entry point.
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
            Self::CellNeighbours => "cell_neighbours",
            Self::ResolveSamples => "resolve_samples",
            Self::Gaussians => "gaussians",
            Self::GaussiansByPixel => "gaussians_by_pixel",
        }
    }

    /// Whether it shades the image: it is the last, and runs over the tile without its border.
    pub fn is_shade(self) -> bool {
        matches!(self, Self::Shade | Self::ShadeSplats)
    }

    /// Width and height of its invocations, in pixels, for a tile of these targets and this shaded size.
    pub fn size(self, targets: [u32; 2], shaded: [u32; 2]) -> [u32; 2] {
        match self {
            Self::Shade
            | Self::ShadeSplats
            | Self::CellNeighbours
            | Self::Nearest
            | Self::Gaussians
            | Self::GaussiansByPixel => shaded,
            Self::NextLayer => [1, 1],
            Self::ResolveSamples => targets.map(|side| side / SAMPLES_SIDE),
            Self::BeginLayers
            | Self::BeginLayersInHost
            | Self::PeeledLayer
            | Self::GatheredLayer
            | Self::RemainingLayer
            | Self::StoreShadow => targets,
        }
    }

    /// Its name in the statistics.
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
            Self::Shade | Self::ShadeSplats | Self::CellNeighbours => "shade",
            Self::ResolveSamples => EDGE_SAMPLES,
            Self::Gaussians | Self::GaussiansByPixel => "gaussians",
        }
    }
}

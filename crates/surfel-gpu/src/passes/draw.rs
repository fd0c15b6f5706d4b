//! Draws: the render passes of a tile, their entry points, and the targets that they write and read. A *record* is a
//! splat as set up for a tile: its projected forms, pixel boxes and colour in a buffer.

use crate::passes::pixel_pass::EDGE_SAMPLES;
use crate::passes::probe::FillRateProbe;
use crate::passes::targets::Target;
use crate::scene::clip::Variant;
use surfel_render::FramePlan;

/// Set of fragments that a pass accumulates: an opaque surface, or a layer of transparent splats.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Layer {
    /// Nearest opaque surface of splats.
    Front,
    /// Nearest opaque surface of splats blended with polygons.
    MeshBlend,
    /// Nearest opaque surface of splats, if the front and back sides of oriented splats are separated.
    Shown,
    /// Nearest opaque surface of splats blended with polygons, if the front and back sides of oriented splats are
    /// separated.
    ShownMeshBlend,
    /// Surface behind the nearest one, at edge pixels.
    EdgeBackground,
    /// One layer of transparent splats in depth peeling (rendering model §8).
    Peeled,
    /// One surface of transparent splats in an A-buffer (rendering model §8). It is drawn like [`Layer::Peeled`], and
    /// its coverage is summed, too.
    Gathered,
    /// All transparent splats behind the peeled layers; each splat is lit separately.
    Remaining,
}

/// Sums that one pass over the splats accumulates. They take at most 32 bytes per sample, which every adapter supports.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Sums {
    /// Colour and weight.
    Color,
    /// Colour and weight, normal and depth.
    Surface,
    /// Material factors and counts. The counts of the nearest surface are the number of fragments and the coverage. The
    /// counts of a transparent layer are the number of fragments and Σw·alpha, and in an A-buffer also the coverage.
    MaterialCounts,
}

impl Layer {
    /// True if the layer is the nearest opaque surface.
    fn is_front(self) -> bool {
        matches!(self, Self::Front | Self::MeshBlend | Self::Shown | Self::ShownMeshBlend)
    }
}

impl Sums {
    /// Returns the sums that a plan needs for a layer; each is one pass over the splats.
    pub fn of(plan: &FramePlan, layer: Layer) -> Vec<Self> {
        let surface = plan.attributes.normal || plan.attributes.depth;
        let counts = layer.is_front() && (plan.planes.fragments || plan.attributes.coverage);
        if matches!(layer, Layer::Peeled | Layer::Gathered | Layer::Remaining) {
            // Compositing a layer needs its alpha, which is summed in place of coverage. So the counts are always
            // needed.
            return vec![Self::Surface, Self::MaterialCounts];
        }
        let mut sums = vec![if surface { Self::Surface } else { Self::Color }];
        if plan.attributes.material || counts {
            sums.push(Self::MaterialCounts);
        }
        sums
    }
}

/// Render pass of a tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Draw {
    /// Visibility: finds the depth threshold, the smallest z + ε in each pixel.
    Visibility,
    /// Visibility that also writes z + ε and ε of the splat that defines the threshold, for edge detection.
    VisibilityWithTolerance,
    /// Finds which side of oriented splats each pixel shows, front or back, if sides are separated.
    Facing,
    /// [`Draw::Visibility`] if sides are separated. Fragments of the side that a pixel doesn't show limit the depth
    /// threshold to the middle between both sides.
    ShownVisibility,
    /// [`Draw::ShownVisibility`] that also writes z + ε and ε of the splat that defines the threshold, for edge
    /// detection.
    ShownVisibilityWithTolerance,
    /// Visibility of the edge background: the surface behind the nearest one, at edge pixels.
    EdgeBackgroundVisibility,
    /// Visibility of the transparent splats behind the layers drawn so far.
    PeeledVisibility,
    /// [`Draw::PeeledVisibility`] of the first layer, which also writes z + ε and ε of the splat that defines the
    /// threshold, to detect depth steps.
    PeeledVisibilityWithTolerance,
    /// Finds the nearest polygon of each pixel.
    Polygons,
    /// Accumulates attributes of a layer's fragments.
    Sums(Layer, Sums),
    /// Finds the nearest splat in each pixel, either of the nearest opaque surface or of all transparent layers
    /// ([`Layer::Remaining`]).
    Nearest(Layer),
    /// Finds edge pixels for antialiasing by coverage: pixels with a neighbour whose surface lies farther back.
    Edges,
    /// Finds the pixels with a depth step to a neighbour, which are antialiased by samples.
    Steps,
    /// Measures a fill rate; no plan contains this pass.
    Probe(FillRateProbe),
}

impl Draw {
    /// Returns the names of the pass's vertex and fragment entry points, for splats of a clip variant.
    pub fn entries(self, variant: Variant) -> [String; 2] {
        let (vertex, fragment) = match self {
            Self::Visibility => ("visibility", "front_visibility"),
            Self::VisibilityWithTolerance => ("visibility", "front_threshold"),
            Self::Facing => ("visibility", "facing_visibility"),
            Self::ShownVisibility => ("visibility", "shown_visibility"),
            Self::ShownVisibilityWithTolerance => ("visibility", "shown_threshold"),
            Self::EdgeBackgroundVisibility => ("visibility", "edge_background_visibility"),
            Self::PeeledVisibility => ("visibility", "peeled_visibility"),
            Self::PeeledVisibilityWithTolerance => ("visibility", "peeled_threshold"),
            Self::Polygons => return ["polygon_vertex", "polygon_fragment"].map(str::to_owned),
            Self::Edges => return ["fullscreen_vertex", "edges_fragment"].map(str::to_owned),
            Self::Steps => return ["fullscreen_vertex", "steps_fragment"].map(str::to_owned),
            Self::Probe(probe) => {
                let fragment = match probe {
                    FillRateProbe::Depth => "probe_depth_fragment",
                    FillRateProbe::Fill | FillRateProbe::Blend => "probe_color_fragment",
                    FillRateProbe::Clear | FillRateProbe::BlendTwo => "probe_surface_fragment",
                };
                return ["probe_vertex", fragment].map(str::to_owned);
            }
            Self::Nearest(layer) => {
                let fragment = match layer {
                    Layer::MeshBlend => "mesh_blend_nearest",
                    Layer::Shown => "shown_nearest",
                    Layer::ShownMeshBlend => "shown_mesh_blend_nearest",
                    Layer::Peeled | Layer::Gathered | Layer::Remaining => "remaining_nearest",
                    Layer::Front | Layer::EdgeBackground => "front_nearest",
                };
                ("nearest", fragment)
            }
            Self::Sums(layer, sums) => {
                let fragment = match (layer, sums) {
                    (Layer::Front, Sums::Color) => "front_color",
                    (Layer::Front, Sums::Surface) => "front_surface",
                    (Layer::Front, Sums::MaterialCounts) => "front_material_counts",
                    (Layer::MeshBlend, Sums::Color) => "mesh_blend_color",
                    (Layer::MeshBlend, Sums::Surface) => "mesh_blend_surface",
                    (Layer::MeshBlend, Sums::MaterialCounts) => "mesh_blend_material_counts",
                    (Layer::Shown, Sums::Color) => "shown_color",
                    (Layer::Shown, Sums::Surface) => "shown_surface",
                    (Layer::Shown, Sums::MaterialCounts) => "shown_material_counts",
                    (Layer::ShownMeshBlend, Sums::Color) => "shown_mesh_blend_color",
                    (Layer::ShownMeshBlend, Sums::Surface) => "shown_mesh_blend_surface",
                    (Layer::ShownMeshBlend, Sums::MaterialCounts) => "shown_mesh_blend_material_counts",
                    (Layer::EdgeBackground, Sums::Color) => "edge_background_color",
                    (Layer::EdgeBackground, Sums::Surface) => "edge_background_surface",
                    (Layer::EdgeBackground, Sums::MaterialCounts) => "edge_background_material",
                    (Layer::Peeled, Sums::Color | Sums::Surface) => "peeled_surface",
                    (Layer::Peeled, Sums::MaterialCounts) => "peeled_material_counts",
                    (Layer::Gathered, Sums::Color | Sums::Surface) => "gathered_surface",
                    (Layer::Gathered, Sums::MaterialCounts) => "gathered_material_coverage",
                    (Layer::Remaining, Sums::Color | Sums::Surface) => "remaining_surface",
                    (Layer::Remaining, Sums::MaterialCounts) => "remaining_material_counts",
                };
                (if layer == Layer::Remaining { "lit_attribute" } else { "attribute" }, fragment)
            }
        };
        let prefix = variant.prefix();
        [format!("{prefix}{vertex}_vertex"), format!("{prefix}{fragment}_fragment")]
    }

    /// Returns the depth buffer that the pass tests and writes; `None` if it has none. Depths are reversed: the greater
    /// value passes.
    pub fn depth(self) -> Option<Target> {
        match self {
            Self::Visibility
            | Self::VisibilityWithTolerance
            | Self::ShownVisibility
            | Self::ShownVisibilityWithTolerance
            | Self::Probe(FillRateProbe::Depth) => Some(Target::DepthThreshold),
            Self::Facing => Some(Target::FacingDepth),
            Self::EdgeBackgroundVisibility => Some(Target::EdgeBackgroundThreshold),
            Self::Polygons => Some(Target::PolygonDepth),
            Self::Nearest(_) => Some(Target::NearestDepth),
            Self::PeeledVisibility | Self::PeeledVisibilityWithTolerance => Some(Target::LayerThreshold),
            Self::Sums(..) | Self::Edges | Self::Steps | Self::Probe(_) => None,
        }
    }

    /// Returns the colour targets that the pass writes.
    pub fn colors(self) -> &'static [Target] {
        match self {
            Self::Visibility
            | Self::ShownVisibility
            | Self::EdgeBackgroundVisibility
            | Self::PeeledVisibility
            | Self::Probe(FillRateProbe::Depth) => &[],
            Self::Facing => &[Target::Facing],
            Self::Probe(FillRateProbe::Fill | FillRateProbe::Blend) => &[Target::Color],
            Self::Probe(FillRateProbe::Clear | FillRateProbe::BlendTwo) => &[Target::Color, Target::Surface],
            Self::VisibilityWithTolerance | Self::ShownVisibilityWithTolerance => &[Target::ThresholdTolerance],
            Self::PeeledVisibilityWithTolerance => &[Target::LayerTolerance],
            Self::Edges => &[Target::EdgeThreshold],
            Self::Steps => &[Target::Steps],
            Self::Polygons => &[Target::Polygons],
            Self::Nearest(Layer::Peeled | Layer::Gathered | Layer::Remaining) => &[Target::LayerNearest],
            Self::Nearest(_) => &[Target::Nearest],
            Self::Sums(layer, Sums::Color) if layer.is_front() => &[Target::Color],
            Self::Sums(layer, Sums::Surface) if layer.is_front() => &[Target::Color, Target::Surface],
            Self::Sums(layer, Sums::MaterialCounts) if layer.is_front() => &[Target::Material, Target::Counts],
            Self::Sums(Layer::EdgeBackground, Sums::Color) => &[Target::EdgeBackgroundColor],
            Self::Sums(Layer::EdgeBackground, Sums::Surface) => {
                &[Target::EdgeBackgroundColor, Target::EdgeBackgroundSurface]
            }
            Self::Sums(Layer::EdgeBackground, Sums::MaterialCounts) => &[Target::EdgeBackgroundMaterial],
            Self::Sums(Layer::Peeled | Layer::Remaining, Sums::MaterialCounts) => {
                &[Target::LayerMaterial, Target::LayerCounts]
            }
            Self::Sums(Layer::Gathered, Sums::MaterialCounts) => &[Target::LayerMaterial, Target::LayerCoverage],
            Self::Sums(_, _) => &[Target::LayerColor, Target::LayerSurface],
        }
    }

    /// True if the pass adds to its targets instead of replacing their contents.
    pub fn is_additive(self) -> bool {
        matches!(self, Self::Sums(..) | Self::Probe(FillRateProbe::Blend | FillRateProbe::BlendTwo))
    }

    /// True if the pass draws records of splats. The records are then in bind group 1.
    pub fn draws_records(self) -> bool {
        !matches!(self, Self::Edges | Self::Steps | Self::Polygons | Self::Probe(_))
    }

    /// Returns the range of vertices for the draw call with this index: four vertices, which every instance of the call
    /// draws as a quad. `nearest.wgsl` computes the index from the vertex number.
    pub fn quad(index: usize) -> std::ops::Range<u32> {
        let first = 4 * index as u32;
        first..first + 4
    }

    /// Returns the number of full-screen triangles to draw, for passes that draw neither records nor polygons.
    pub fn triangles(self) -> u32 {
        match self {
            Self::Probe(probe) => probe.triangles(),
            _ => 1,
        }
    }

    /// True if the pass draws the splats of transparent layers. All other passes skip these splats.
    pub fn is_transparent(self) -> bool {
        matches!(
            self,
            Self::PeeledVisibility
                | Self::PeeledVisibilityWithTolerance
                | Self::Sums(Layer::Peeled | Layer::Gathered | Layer::Remaining, _)
                | Self::Nearest(Layer::Peeled | Layer::Gathered | Layer::Remaining)
        )
    }

    /// True if the pass lights each splat at its centre, before attributes are summed.
    pub fn is_lit(self) -> bool {
        matches!(self, Self::Sums(Layer::Remaining, _))
    }

    /// Returns the binding of the layer composites, the transparent layers of each pixel so far; `None` for opaque
    /// passes. Depths in the composites decide which fragments are still to be drawn. The binding is in the group of
    /// [`Draw::reads`].
    pub fn layer_composites_binding(self) -> Option<u32> {
        self.is_transparent().then_some(3)
    }

    /// True if the pass binds the same group as a [`PixelPass`](crate::PixelPass), textures and buffers, in place of
    /// [`Draw::reads`].
    pub fn binds_as_pixel_pass(self) -> bool {
        self == Self::Steps
    }

    /// True if the pass reads textures or buffers other than the frame's data and the records.
    pub fn has_reads(self) -> bool {
        !self.reads().is_empty() || self.layer_composites_binding().is_some() || self.binds_as_pixel_pass()
    }

    /// Returns the textures that the pass reads, as pairs of binding and target. The index of their bind group is
    /// [`Draw::reads_group`].
    pub fn reads(self) -> &'static [(u32, Target)] {
        match self {
            Self::Visibility | Self::VisibilityWithTolerance | Self::Facing => &[],
            Self::Polygons => &[(5, Target::Steps)],
            Self::ShownVisibility | Self::ShownVisibilityWithTolerance => &[(4, Target::Facing)],
            Self::PeeledVisibility
            | Self::PeeledVisibilityWithTolerance
            | Self::Steps
            | Self::Probe(_)
            | Self::Sums(Layer::Remaining, _) => &[],
            Self::Nearest(Layer::Peeled | Layer::Gathered | Layer::Remaining) => &[],
            Self::Nearest(layer) => Self::Sums(layer, Sums::Color).reads(),
            Self::Sums(Layer::Peeled | Layer::Gathered, _) => &[(0, Target::LayerThreshold)],
            Self::EdgeBackgroundVisibility => &[(1, Target::EdgeThreshold)],
            Self::Sums(Layer::Front, _) => &[(0, Target::DepthThreshold)],
            Self::Sums(Layer::MeshBlend, _) => &[(0, Target::DepthThreshold), (2, Target::Polygons)],
            Self::Sums(Layer::Shown, _) => &[(0, Target::DepthThreshold), (4, Target::Facing)],
            Self::Sums(Layer::ShownMeshBlend, _) => {
                &[(0, Target::DepthThreshold), (2, Target::Polygons), (4, Target::Facing)]
            }
            Self::Sums(Layer::EdgeBackground, _) => &[(0, Target::EdgeBackgroundThreshold), (1, Target::EdgeThreshold)],
            Self::Edges => &[(1, Target::ThresholdTolerance), (2, Target::Polygons)],
        }
    }

    /// Returns the index of the bind group of [`Draw::reads`].
    pub fn reads_group(self) -> u32 {
        if self.draws_records() || self == Self::Polygons { 2 } else { 1 }
    }

    /// Returns the name of the pass in the statistics.
    pub fn name(self) -> &'static str {
        match self {
            Self::Visibility
            | Self::VisibilityWithTolerance
            | Self::Facing
            | Self::ShownVisibility
            | Self::ShownVisibilityWithTolerance => "visibility",
            Self::Polygons => "polygons",
            Self::Nearest(_) => "nearest",
            Self::Sums(layer, _) if layer.is_front() => "attributes",
            Self::Edges => "edges",
            Self::Steps => EDGE_SAMPLES,
            Self::Probe(probe) => probe.name(),
            Self::EdgeBackgroundVisibility | Self::Sums(Layer::EdgeBackground, _) => "behind edges",
            Self::PeeledVisibility | Self::PeeledVisibilityWithTolerance | Self::Sums(_, _) => "layers",
        }
    }
}

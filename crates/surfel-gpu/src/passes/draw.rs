//! Draws: the render passes of a tile, their entry points, and the targets that they write and read.

use crate::passes::pixel_pass::EDGE_SAMPLES;
use crate::passes::probe::FillRateProbe;
use crate::passes::targets::Target;
use crate::scene::clip::Variant;
use surfel_render::FramePlan;

/// The surface that a pass is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Layer {
    /// The front surface, of splats alone.
    Front,
    /// The front surface, of splats blended with polygons.
    MeshBlend,
    /// The front surface where sides of oriented splats are kept apart: of splats alone.
    Shown,
    /// The same, of splats blended with polygons.
    ShownMeshBlend,
    /// The surface behind the front one at edge pixels.
    EdgeBackground,
    /// A peeled layer of transparent splats.
    Peeled,
    /// A layer of an A-buffer: a peeled one that counts by its coverage, too.
    Gathered,
    /// All transparent splats that remain behind the peeled layers, lit one by one.
    Remaining,
}

/// The sums that one pass over the splats accumulates. None is wider than 32 bytes a sample, which every adapter has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Sums {
    /// Colour and weight.
    Color,
    /// Colour and weight, normal and depth.
    Surface,
    /// Material factors; for the front surface also the number of fragments and coverage, for transparent layers the
    /// number and alpha, and of an A-buffer coverage.
    MaterialCounts,
}

impl Layer {
    /// Whether it is the front surface.
    fn is_front(self) -> bool {
        matches!(self, Self::Front | Self::MeshBlend | Self::Shown | Self::ShownMeshBlend)
    }
}

impl Sums {
    /// The passes over the splats that a plan needs for a layer.
    pub fn of(plan: &FramePlan, layer: Layer) -> Vec<Self> {
        let surface = plan.attributes.normal || plan.attributes.depth;
        let counts = layer.is_front() && (plan.planes.fragments || plan.attributes.coverage);
        if matches!(layer, Layer::Peeled | Layer::Gathered | Layer::Remaining) {
            // A layer needs alpha, which is summed in place of coverage, whatever the attributes.
            return vec![Self::Surface, Self::MaterialCounts];
        }
        let mut sums = vec![if surface { Self::Surface } else { Self::Color }];
        if plan.attributes.material || counts {
            sums.push(Self::MaterialCounts);
        }
        sums
    }
}

/// A render pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Draw {
    /// Visibility: the depth threshold, the least z + ε of each pixel.
    Visibility,
    /// Visibility that also writes the threshold's tolerance, for edge detection.
    VisibilityWithTolerance,
    /// The side of oriented splats that each pixel shows, where sides are kept apart.
    Facing,
    /// [`Draw::Visibility`] of the side that is shown.
    ShownVisibility,
    /// [`Draw::VisibilityWithTolerance`] of the side that is shown.
    ShownVisibilityWithTolerance,
    /// Visibility of the edge background.
    EdgeBackgroundVisibility,
    /// Visibility of the transparent splats behind the layers before.
    PeeledVisibility,
    /// The same of the first layer, with the threshold's tolerance, for steps.
    PeeledVisibilityWithTolerance,
    /// The nearest polygon of each pixel.
    Polygons,
    /// Accumulates attributes.
    Sums(Layer, Sums),
    /// Finds the nearest splat of each pixel: of a front surface, or of the transparent layers together
    /// ([`Layer::Remaining`]).
    Nearest(Layer),
    /// Finds edges.
    Edges,
    /// Finds the pixels at steps, which are drawn by samples.
    Steps,
    /// Measures a fill rate; no plan needs it.
    Probe(FillRateProbe),
}

impl Draw {
    /// Vertex and fragment entry point.
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

    /// The depth buffer that it tests and writes: the greater wins.
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

    /// The colour targets that it writes.
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

    /// Whether it adds to its targets rather than replacing them.
    pub fn is_additive(self) -> bool {
        matches!(self, Self::Sums(..) | Self::Probe(FillRateProbe::Blend | FillRateProbe::BlendTwo))
    }

    /// Whether it draws records, with their group as group 1.
    pub fn draws_records(self) -> bool {
        !matches!(self, Self::Edges | Self::Steps | Self::Polygons | Self::Probe(_))
    }

    /// The vertices of a quad's draw of the records with this number ([`surfel_shaders`]'s `nearest.wgsl` reads it).
    pub fn quad(index: usize) -> std::ops::Range<u32> {
        let first = 4 * index as u32;
        first..first + 4
    }

    /// How many full-screen triangles it draws, where it draws neither records nor polygons.
    pub fn triangles(self) -> u32 {
        match self {
            Self::Probe(probe) => probe.triangles(),
            _ => 1,
        }
    }

    /// Whether it draws the transparent splats of layers, and no others; all other draws leave those out.
    pub fn is_transparent(self) -> bool {
        matches!(
            self,
            Self::PeeledVisibility
                | Self::PeeledVisibilityWithTolerance
                | Self::Sums(Layer::Peeled | Layer::Gathered | Layer::Remaining, _)
                | Self::Nearest(Layer::Peeled | Layer::Gathered | Layer::Remaining)
        )
    }

    /// Whether each splat is lit by itself.
    pub fn is_lit(self) -> bool {
        matches!(self, Self::Sums(Layer::Remaining, _))
    }

    /// The binding of the layer composites, which say what fragments are still to be drawn, beside [`Draw::reads`].
    pub fn layer_composites_binding(self) -> Option<u32> {
        self.is_transparent().then_some(3)
    }

    /// Whether its group is that of a pixel pass, buffers included, in place of [`Draw::reads`].
    pub fn binds_as_pixel_pass(self) -> bool {
        self == Self::Steps
    }

    /// Whether it reads anything but records.
    pub fn has_reads(self) -> bool {
        !self.reads().is_empty() || self.layer_composites_binding().is_some() || self.binds_as_pixel_pass()
    }

    /// The textures that it reads, by binding, in the group after the records' or the frame's.
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

    /// Number of the group of [`Draw::reads`].
    pub fn reads_group(self) -> u32 {
        if self.draws_records() || self == Self::Polygons { 2 } else { 1 }
    }

    /// Its name in the statistics.
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

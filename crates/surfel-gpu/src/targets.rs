//! What passes draw into and read, whatever the API.

use crate::ceilings::Ceiling;
use crate::clip::Variant;
use crate::rounds::{Round, distinct, rounds};
use surfel_render::FramePlan;

/// A texture of a tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Target {
    /// Least z + ε of a pixel, as z_near/z.
    Kept,
    /// Σw·(colour, 1).
    Color,
    /// Σw·(normal, z).
    Surface,
    /// Σw·material factors.
    Material,
    /// Number of fragments, and coverage.
    Counts,
    /// What is kept, and its writer's ε.
    Writers,
    /// What is kept at edge pixels, else 0.
    Limit,
    /// As `Kept`, of what lies behind edges.
    KeptBehind,
    /// The nearest polygon, as z_near/z.
    PolygonDepth,
    /// Its depth, and one more than its index.
    Polygons,
    /// As `Color`, behind edges.
    ColorBehind,
    /// As `Surface`, behind edges.
    SurfaceBehind,
    /// As `Material`, behind edges.
    MaterialBehind,
    /// As `Kept`, of a layer of transparent splats.
    LayerKept,
    /// As `Color`, of a layer.
    LayerColor,
    /// As `Surface`, of a layer.
    LayerSurface,
    /// As `Material`, of a layer.
    LayerMaterial,
    /// Number of fragments, and Σw·alpha.
    LayerCounts,
}

/// What a texel holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum TargetFormat {
    /// A depth buffer in f32.
    Depth,
    /// Four sums, in the precision of the sums.
    Sums4,
    /// Two sums.
    Sums2,
    /// Two numbers in f32.
    Exact2,
    /// One number in f32.
    Exact1,
}

impl Target {
    /// All of them.
    pub const ALL: [Self; 18] = [
        Self::Kept,
        Self::Color,
        Self::Surface,
        Self::Material,
        Self::Counts,
        Self::Writers,
        Self::Limit,
        Self::PolygonDepth,
        Self::Polygons,
        Self::KeptBehind,
        Self::ColorBehind,
        Self::SurfaceBehind,
        Self::MaterialBehind,
        Self::LayerKept,
        Self::LayerColor,
        Self::LayerSurface,
        Self::LayerMaterial,
        Self::LayerCounts,
    ];

    /// A name for messages and debuggers.
    pub fn name(self) -> &'static str {
        match self {
            Self::Kept => "kept depth",
            Self::Color => "colour sums",
            Self::Surface => "surface sums",
            Self::Material => "material sums",
            Self::Counts => "fragment counts",
            Self::Writers => "writers",
            Self::Limit => "edge limit",
            Self::PolygonDepth => "polygon depth",
            Self::Polygons => "polygons",
            Self::KeptBehind => "kept depth behind",
            Self::ColorBehind => "colour sums behind",
            Self::SurfaceBehind => "surface sums behind",
            Self::MaterialBehind => "material sums behind",
            Self::LayerKept => "kept depth of a layer",
            Self::LayerColor => "colour sums of a layer",
            Self::LayerSurface => "surface sums of a layer",
            Self::LayerMaterial => "material sums of a layer",
            Self::LayerCounts => "fragment counts of a layer",
        }
    }

    /// What its texels hold.
    pub fn format(self) -> TargetFormat {
        match self {
            Self::Kept | Self::KeptBehind | Self::PolygonDepth | Self::LayerKept => TargetFormat::Depth,
            Self::Counts | Self::LayerCounts => TargetFormat::Sums2,
            Self::Writers | Self::Polygons => TargetFormat::Exact2,
            Self::Limit => TargetFormat::Exact1,
            _ => TargetFormat::Sums4,
        }
    }
}

/// Which surface a pass is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Layer {
    /// The nearest.
    Front,
    /// The same, among polygons.
    Among,
    /// What lies behind it at edges.
    Behind,
    /// A layer of transparent splats.
    Peeled,
    /// All that remains of them, lit one by one.
    Remaining,
}

/// A set of sums that one pass over the splats adds up. No set is wider than 32 bytes a sample, which every adapter has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Sums {
    /// Colour and weight.
    Color,
    /// Colour and weight, normal and depth.
    Surface,
    /// Material factors; in front the number of fragments and coverage, too.
    Further,
}

impl Sums {
    /// The passes over the splats that a plan needs for a layer.
    pub fn of(plan: &FramePlan, layer: Layer) -> Vec<Self> {
        let surface = plan.attributes.normal || plan.attributes.depth;
        let counts =
            matches!(layer, Layer::Front | Layer::Among) && (plan.planes.fragments || plan.attributes.coverage);
        if matches!(layer, Layer::Peeled | Layer::Remaining) {
            // Alpha is summed in place of coverage, whatever else is.
            return vec![Self::Surface, Self::Further];
        }
        let mut sums = vec![if surface { Self::Surface } else { Self::Color }];
        if plan.attributes.material || counts {
            sums.push(Self::Further);
        }
        sums
    }
}

/// A pass that draws.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Draw {
    /// Keeps the least z + ε.
    Visibility,
    /// The same, and whose it is: for finding edges.
    Writers,
    /// Keeps the least z + ε behind edges.
    VisibilityBehind,
    /// Keeps the least z + ε of transparent splats behind the layers before.
    VisibilityPeeled,
    /// Keeps the nearest polygon.
    Polygons,
    /// Adds up attributes.
    Sums(Layer, Sums),
    /// Finds edges.
    Edges,
    /// Measures what the device does at best; no plan needs it.
    Ceiling(Ceiling),
}

impl Draw {
    /// Vertex and fragment entry point.
    pub fn entries(self, variant: Variant) -> [String; 2] {
        let (vertex, fragment) = match self {
            Self::Visibility => ("visibility", "front_visibility"),
            Self::Writers => ("visibility", "front_writer"),
            Self::VisibilityBehind => ("visibility", "behind_visibility"),
            Self::VisibilityPeeled => ("visibility", "peeled_visibility"),
            Self::Polygons => return ["polygon_vertex", "polygon_fragment"].map(str::to_owned),
            Self::Edges => return ["everywhere_vertex", "edges_fragment"].map(str::to_owned),
            Self::Ceiling(ceiling) => {
                let fragment = match ceiling {
                    Ceiling::Depth => "ceiling_depth_fragment",
                    Ceiling::Fill | Ceiling::Blend => "ceiling_color_fragment",
                    Ceiling::Clear | Ceiling::BlendTwo => "ceiling_surface_fragment",
                };
                return ["ceiling_vertex", fragment].map(str::to_owned);
            }
            Self::Sums(layer, sums) => {
                let fragment = match (layer, sums) {
                    (Layer::Front, Sums::Color) => "front_color",
                    (Layer::Front, Sums::Surface) => "front_surface",
                    (Layer::Front, Sums::Further) => "front_further",
                    (Layer::Among, Sums::Color) => "among_color",
                    (Layer::Among, Sums::Surface) => "among_surface",
                    (Layer::Among, Sums::Further) => "among_further",
                    (Layer::Behind, Sums::Color) => "behind_color",
                    (Layer::Behind, Sums::Surface) => "behind_surface",
                    (Layer::Behind, Sums::Further) => "behind_material",
                    (Layer::Peeled, Sums::Color | Sums::Surface) => "peeled_surface",
                    (Layer::Peeled, Sums::Further) => "peeled_further",
                    (Layer::Remaining, Sums::Color | Sums::Surface) => "remaining_surface",
                    (Layer::Remaining, Sums::Further) => "remaining_further",
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
            Self::Visibility | Self::Writers | Self::Ceiling(Ceiling::Depth) => Some(Target::Kept),
            Self::VisibilityBehind => Some(Target::KeptBehind),
            Self::Polygons => Some(Target::PolygonDepth),
            Self::VisibilityPeeled => Some(Target::LayerKept),
            Self::Sums(..) | Self::Edges | Self::Ceiling(_) => None,
        }
    }

    /// The colour targets that it writes.
    pub fn colors(self) -> &'static [Target] {
        match self {
            Self::Visibility | Self::VisibilityBehind | Self::VisibilityPeeled | Self::Ceiling(Ceiling::Depth) => &[],
            Self::Ceiling(Ceiling::Fill | Ceiling::Blend) => &[Target::Color],
            Self::Ceiling(Ceiling::Clear | Ceiling::BlendTwo) => &[Target::Color, Target::Surface],
            Self::Writers => &[Target::Writers],
            Self::Edges => &[Target::Limit],
            Self::Polygons => &[Target::Polygons],
            Self::Sums(Layer::Front | Layer::Among, Sums::Color) => &[Target::Color],
            Self::Sums(Layer::Front | Layer::Among, Sums::Surface) => &[Target::Color, Target::Surface],
            Self::Sums(Layer::Front | Layer::Among, Sums::Further) => &[Target::Material, Target::Counts],
            Self::Sums(Layer::Behind, Sums::Color) => &[Target::ColorBehind],
            Self::Sums(Layer::Behind, Sums::Surface) => &[Target::ColorBehind, Target::SurfaceBehind],
            Self::Sums(Layer::Behind, Sums::Further) => &[Target::MaterialBehind],
            Self::Sums(Layer::Peeled | Layer::Remaining, Sums::Further) => {
                &[Target::LayerMaterial, Target::LayerCounts]
            }
            Self::Sums(Layer::Peeled | Layer::Remaining, _) => &[Target::LayerColor, Target::LayerSurface],
        }
    }

    /// Whether it adds to its targets rather than replacing them.
    pub fn adds(self) -> bool {
        matches!(self, Self::Sums(..) | Self::Ceiling(Ceiling::Blend | Ceiling::BlendTwo))
    }

    /// Whether it draws records, with their group as group 1.
    pub fn is_of_records(self) -> bool {
        !matches!(self, Self::Edges | Self::Polygons | Self::Ceiling(_))
    }

    /// Triangles over everything that it draws, where it draws neither records nor polygons.
    pub fn triangles(self) -> u32 {
        match self {
            Self::Ceiling(ceiling) => ceiling.triangles(),
            _ => 1,
        }
    }

    /// Whether it draws transparent splats alone; else none that are layers of their own.
    pub fn is_transparent(self) -> bool {
        matches!(self, Self::VisibilityPeeled | Self::Sums(Layer::Peeled | Layer::Remaining, _))
    }

    /// Whether each splat is lit by itself.
    pub fn is_lit(self) -> bool {
        matches!(self, Self::Sums(Layer::Remaining, _))
    }

    /// The binding of the veils, which limit its fragments, beside [`Draw::reads`].
    pub fn veils_binding(self) -> Option<u32> {
        self.is_transparent().then_some(3)
    }

    /// Whether it reads anything but records.
    pub fn has_reads(self) -> bool {
        !self.reads().is_empty() || self.veils_binding().is_some()
    }

    /// The textures that it reads, by binding, in the group after the records' or the frame's.
    pub fn reads(self) -> &'static [(u32, Target)] {
        match self {
            Self::Visibility | Self::Writers | Self::Polygons | Self::VisibilityPeeled | Self::Ceiling(_) => &[],
            Self::Sums(Layer::Remaining, _) => &[],
            Self::Sums(Layer::Peeled, _) => &[(0, Target::LayerKept)],
            Self::VisibilityBehind => &[(1, Target::Limit)],
            Self::Sums(Layer::Front, _) => &[(0, Target::Kept)],
            Self::Sums(Layer::Among, _) => &[(0, Target::Kept), (2, Target::Polygons)],
            Self::Sums(Layer::Behind, _) => &[(0, Target::KeptBehind), (1, Target::Limit)],
            Self::Edges => &[(0, Target::Kept), (1, Target::Writers), (2, Target::Polygons)],
        }
    }

    /// Number of the group of [`Draw::reads`].
    pub fn reads_group(self) -> u32 {
        if self.is_of_records() { 2 } else { 1 }
    }

    /// Its name in the statistics.
    pub fn name(self) -> &'static str {
        match self {
            Self::Visibility | Self::Writers => "visibility",
            Self::Polygons => "polygons",
            Self::Sums(Layer::Front | Layer::Among, _) => "attributes",
            Self::Edges => "edges",
            Self::Ceiling(ceiling) => ceiling.name(),
            Self::VisibilityBehind | Self::Sums(Layer::Behind, _) => "behind edges",
            Self::VisibilityPeeled | Self::Sums(Layer::Peeled | Layer::Remaining, _) => "layers",
        }
    }

    /// The draws that a plan needs, each once.
    pub fn of(plan: &FramePlan) -> Vec<Self> {
        let draws = rounds(plan).into_iter().flat_map(|round| match round {
            Round::Draws(draws) => draws,
            Round::Pixels(_) => Vec::new(),
        });
        distinct(draws)
    }
}

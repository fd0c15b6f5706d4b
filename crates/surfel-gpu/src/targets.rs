//! What passes draw into and read, whatever the API.

use crate::clip::Variant;
use surfel_render::{FramePlan, Pass};

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
    /// As `Color`, behind edges.
    ColorBehind,
    /// As `Surface`, behind edges.
    SurfaceBehind,
    /// As `Material`, behind edges.
    MaterialBehind,
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
    pub const ALL: [Self; 11] = [
        Self::Kept,
        Self::Color,
        Self::Surface,
        Self::Material,
        Self::Counts,
        Self::Writers,
        Self::Limit,
        Self::KeptBehind,
        Self::ColorBehind,
        Self::SurfaceBehind,
        Self::MaterialBehind,
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
            Self::KeptBehind => "kept depth behind",
            Self::ColorBehind => "colour sums behind",
            Self::SurfaceBehind => "surface sums behind",
            Self::MaterialBehind => "material sums behind",
        }
    }

    /// What its texels hold.
    pub fn format(self) -> TargetFormat {
        match self {
            Self::Kept | Self::KeptBehind => TargetFormat::Depth,
            Self::Counts => TargetFormat::Sums2,
            Self::Writers => TargetFormat::Exact2,
            Self::Limit => TargetFormat::Exact1,
            _ => TargetFormat::Sums4,
        }
    }
}

/// What the shading pass reads, by its binding; binding 4 is the planes. Composing into a host's picture reads some of it.
pub const SHADE_READS: [(u32, Target); 9] = [
    (0, Target::Color),
    (1, Target::Surface),
    (2, Target::Material),
    (3, Target::Counts),
    (5, Target::Limit),
    (6, Target::Writers),
    (7, Target::ColorBehind),
    (8, Target::SurfaceBehind),
    (9, Target::MaterialBehind),
];

/// Which surface a pass is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Layer {
    /// The nearest.
    Front,
    /// What lies behind it at edges.
    Behind,
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
        let counts = layer == Layer::Front && (plan.planes.fragments || plan.attributes.coverage);
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
    /// Adds up attributes.
    Sums(Layer, Sums),
    /// Finds edges.
    Edges,
}

impl Draw {
    /// Vertex and fragment entry point.
    pub fn entries(self, variant: Variant) -> [String; 2] {
        let (vertex, fragment) = match self {
            Self::Visibility => ("visibility", "front_visibility"),
            Self::Writers => ("visibility", "front_writer"),
            Self::VisibilityBehind => ("visibility", "behind_visibility"),
            Self::Edges => return ["everywhere_vertex", "edges_fragment"].map(str::to_owned),
            Self::Sums(layer, sums) => {
                let fragment = match (layer, sums) {
                    (Layer::Front, Sums::Color) => "front_color",
                    (Layer::Front, Sums::Surface) => "front_surface",
                    (Layer::Front, Sums::Further) => "front_further",
                    (Layer::Behind, Sums::Color) => "behind_color",
                    (Layer::Behind, Sums::Surface) => "behind_surface",
                    (Layer::Behind, Sums::Further) => "behind_material",
                };
                ("attribute", fragment)
            }
        };
        let prefix = variant.prefix();
        [format!("{prefix}{vertex}_vertex"), format!("{prefix}{fragment}_fragment")]
    }

    /// The depth buffer that it tests and writes: the greater wins.
    pub fn depth(self) -> Option<Target> {
        match self {
            Self::Visibility | Self::Writers => Some(Target::Kept),
            Self::VisibilityBehind => Some(Target::KeptBehind),
            Self::Sums(..) | Self::Edges => None,
        }
    }

    /// The colour targets that it writes.
    pub fn colors(self) -> &'static [Target] {
        match self {
            Self::Visibility | Self::VisibilityBehind => &[],
            Self::Writers => &[Target::Writers],
            Self::Edges => &[Target::Limit],
            Self::Sums(Layer::Front, Sums::Color) => &[Target::Color],
            Self::Sums(Layer::Front, Sums::Surface) => &[Target::Color, Target::Surface],
            Self::Sums(Layer::Front, Sums::Further) => &[Target::Material, Target::Counts],
            Self::Sums(Layer::Behind, Sums::Color) => &[Target::ColorBehind],
            Self::Sums(Layer::Behind, Sums::Surface) => &[Target::ColorBehind, Target::SurfaceBehind],
            Self::Sums(Layer::Behind, Sums::Further) => &[Target::MaterialBehind],
        }
    }

    /// Whether it adds to its targets rather than replacing them.
    pub fn adds(self) -> bool {
        matches!(self, Self::Sums(..))
    }

    /// Whether it draws records, with their group as group 1, or a triangle over everything.
    pub fn is_of_records(self) -> bool {
        self != Self::Edges
    }

    /// The textures that it reads, by binding, in the group after the records' or the frame's.
    pub fn reads(self) -> &'static [(u32, Target)] {
        match self {
            Self::Visibility | Self::Writers => &[],
            Self::VisibilityBehind => &[(1, Target::Limit)],
            Self::Sums(Layer::Front, _) => &[(0, Target::Kept)],
            Self::Sums(Layer::Behind, _) => &[(0, Target::KeptBehind), (1, Target::Limit)],
            Self::Edges => &[(0, Target::Kept), (1, Target::Writers)],
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
            Self::Sums(Layer::Front, _) => "attributes",
            Self::Edges => "edges",
            Self::VisibilityBehind | Self::Sums(Layer::Behind, _) => "behind edges",
        }
    }

    /// The draws that a plan needs.
    pub fn of(plan: &FramePlan) -> Vec<Self> {
        let edges = plan.has(Pass::EdgeAntialiasing);
        let sums = |layer| Sums::of(plan, layer).into_iter().map(move |sums| Self::Sums(layer, sums));
        let mut draws = vec![if edges { Self::Writers } else { Self::Visibility }];
        draws.extend(sums(Layer::Front));
        if edges {
            draws.extend([Self::Edges, Self::VisibilityBehind]);
            draws.extend(sums(Layer::Behind));
        }
        draws
    }
}

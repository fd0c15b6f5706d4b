//! What a plan's passes are made of, in order.

use crate::targets::{Draw, Layer, Sums, Target};
use surfel_model::Shader;
use surfel_render::{FramePlan, Pass};

/// What is computed once a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Pixels {
    /// What hides transparent splats.
    BeginLayers,
    /// The same, and a host's own things hide them, too; no plan needs it.
    BeginLayersInHost,
    /// A peeled layer, shaded and put behind those before it.
    PeeledLayer,
    /// Once a frame rather than a pixel: ends the layers if nothing remains.
    NextLayer,
    /// All that remains of the transparent splats, put behind the layers.
    RemainingLayer,
    /// A part of a shadow map.
    StoreShadow,
    /// The picture.
    Shade,
    /// A picture of opaque splats without antialiased edges, shadows or what else looks at neighbours.
    ShadeSplats,
}

/// The textures that these read, by binding; each of them reads some.
pub const PIXEL_READS: [(u32, Target); 16] = [
    (0, Target::Color),
    (1, Target::Surface),
    (2, Target::Material),
    (3, Target::Counts),
    (5, Target::Limit),
    (6, Target::Writers),
    (7, Target::ColorBehind),
    (8, Target::SurfaceBehind),
    (9, Target::MaterialBehind),
    (10, Target::Kept),
    (11, Target::Polygons),
    (16, Target::LayerColor),
    (17, Target::LayerSurface),
    (18, Target::LayerMaterial),
    (19, Target::LayerCounts),
    (20, Target::LayerKept),
];

/// Bindings of the buffers beside them: planes, polygons, texels, veils (for composing into a host's picture: to be read), texels of the
/// shadow map that is drawn, draws of layers.
pub const PIXEL_BUFFERS: [u32; 7] = [4, 12, 13, 14, 15, 21, 22];

/// Binding of a host's depth buffer.
pub const HOST_DEPTH_BINDING: u32 = 23;

impl Pixels {
    /// Its entry point.
    pub fn entry(self) -> &'static str {
        match self {
            Self::BeginLayers => "begin_layers",
            Self::BeginLayersInHost => "begin_layers_in_host",
            Self::PeeledLayer => "peeled_layer",
            Self::NextLayer => "next_layer",
            Self::RemainingLayer => "remaining_layer",
            Self::StoreShadow => "store_shadow",
            Self::Shade => "shade",
            Self::ShadeSplats => "shade_splats",
        }
    }

    /// Whether it is the last, of the tile without its border.
    pub fn is_shade(self) -> bool {
        matches!(self, Self::Shade | Self::ShadeSplats)
    }

    /// How many it is computed for, of a tile whose targets have a border.
    pub fn size(self, targets: [u32; 2], shaded: [u32; 2]) -> [u32; 2] {
        match self {
            Self::Shade | Self::ShadeSplats => shaded,
            Self::NextLayer => [1, 1],
            Self::BeginLayers
            | Self::BeginLayersInHost
            | Self::PeeledLayer
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
            | Self::NextLayer
            | Self::RemainingLayer => "layers",
            Self::StoreShadow => "shadow maps",
            Self::Shade | Self::ShadeSplats => "shade",
        }
    }

    /// Those that a plan needs, each once.
    pub fn of(plan: &FramePlan) -> Vec<Self> {
        let pixels = rounds(plan).into_iter().filter_map(|round| match round {
            Round::Pixels(pixels) => Some(pixels),
            Round::Draws(_) => None,
        });
        distinct(pixels)
    }
}

/// What is done in one go over the splats or the pixels: all of a round is there before the next begins.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Round {
    Draws(Vec<Draw>),
    Pixels(Pixels),
}

impl Round {
    /// True if it is for transparent splats alone.
    pub(crate) fn is_of_layers(&self) -> bool {
        match self {
            Self::Draws(draws) => draws.iter().any(|draw| draw.is_transparent()),
            Self::Pixels(pixels) => {
                matches!(pixels, Pixels::PeeledLayer | Pixels::NextLayer | Pixels::RemainingLayer)
            }
        }
    }
}

/// True if a plan draws transparent splats.
pub(crate) fn has_layers(plan: &FramePlan) -> bool {
    plan.has(Pass::PeelLayer) || plan.has(Pass::RemainingLayer)
}

/// True if a plan is of a shadow map: nothing is shaded.
pub(crate) fn is_of_map(plan: &FramePlan) -> bool {
    !plan.has(Pass::Shade)
}

/// The rounds of a plan.
pub(crate) fn rounds(plan: &FramePlan) -> Vec<Round> {
    let edges = plan.has(Pass::EdgeAntialiasing);
    let polygons = plan.has(Pass::Polygons);
    let sums = |layer| Round::Draws(Sums::of(plan, layer).into_iter().map(|sums| Draw::Sums(layer, sums)).collect());
    let one = |draw| Round::Draws(vec![draw]);
    let mut rounds = vec![one(if edges { Draw::Writers } else { Draw::Visibility })];
    rounds.extend(polygons.then(|| one(Draw::Polygons)));
    if is_of_map(plan) {
        rounds.push(Round::Pixels(Pixels::StoreShadow));
        return rounds;
    }
    rounds.push(sums(if polygons { Layer::Among } else { Layer::Front }));
    if edges {
        rounds.extend([one(Draw::Edges), one(Draw::VisibilityBehind), sums(Layer::Behind)]);
    }
    rounds.extend(has_layers(plan).then_some(Round::Pixels(Pixels::BeginLayers)));
    let next = |is_first: bool| (!is_first).then_some(Round::Pixels(Pixels::NextLayer));
    for i in 0..plan.peeled_layers() {
        rounds.extend(next(i == 0));
        rounds.extend([one(Draw::VisibilityPeeled), sums(Layer::Peeled), Round::Pixels(Pixels::PeeledLayer)]);
    }
    if plan.has(Pass::RemainingLayer) {
        rounds.extend(next(plan.peeled_layers() == 0));
        rounds.extend([sums(Layer::Remaining), Round::Pixels(Pixels::RemainingLayer)]);
    }
    let more = polygons || has_layers(plan) || plan.reach_px() > 0 || !plan.shadow_maps.is_empty();
    let all = more || plan.shader == Shader::Toon;
    rounds.push(Round::Pixels(if all { Pixels::Shade } else { Pixels::ShadeSplats }));
    rounds
}

/// Each once, in order of appearance.
pub(crate) fn distinct<T: PartialEq>(all: impl Iterator<Item = T>) -> Vec<T> {
    all.fold(Vec::new(), |mut found, one| {
        if !found.contains(&one) {
            found.push(one);
        }
        found
    })
}

//! The passes of a plan, in order.

use crate::passes::draw::{Draw, Layer, Sums};
use crate::passes::pixel_pass::PixelPass;
use surfel_model::{Shader, Sort};
use surfel_render::{FramePlan, Pass};

/// An entry of a pass list. Each is complete, over all splats or pixels, before the next begins.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum PassEntry {
    /// Render passes over the same splats, which don't depend on each other.
    Draws(Vec<Draw>),
    /// A compute pass over pixels.
    Pixels(PixelPass),
}

impl PassEntry {
    /// True if it is left out where no transparent splat is seen. What steps read is cleared even then.
    pub(crate) fn needs_layers(&self) -> bool {
        self.is_of_layers() && *self != Self::Draws(vec![Draw::PeeledVisibilityWithTolerance])
    }

    /// True if it is for transparent splats alone.
    pub(crate) fn is_of_layers(&self) -> bool {
        match self {
            Self::Draws(draws) => draws.iter().any(|draw| draw.is_transparent()),
            Self::Pixels(pass) => {
                use PixelPass::{GatheredLayer, NextLayer, PeeledLayer, RemainingLayer};
                matches!(pass, PeeledLayer | GatheredLayer | NextLayer | RemainingLayer)
            }
        }
    }
}

/// True if a plan draws transparent splats in layers, or finds steps among them.
pub(crate) fn has_layers(plan: &FramePlan) -> bool {
    let has_steps = plan.has(Pass::EdgeSamples) && plan.separates_transparent;
    has_steps || peeled_layers(plan) > 0 || plan.has(Pass::RemainingLayer)
}

/// Layers of an A-buffer that are drawn before it is known whether there are more.
const FIRST_LAYERS: usize = 16;
/// Layers that are counted in 8 bits.
const MOST_LAYERS: usize = 255;

/// How many layers are peeled, those of an A-buffer included: as many as are asked for, or the first ones.
fn peeled_layers(plan: &FramePlan) -> usize {
    let peeled = plan.peeled_layers();
    if plan.has(Pass::ABuffer) { peeled.max(FIRST_LAYERS) } else { peeled }
}

/// The plan that draws more layers of an A-buffer. `least` counts the surfaces that a pixel has at least
/// ([`crate::least_surfaces`]), once a tile.
///
/// # Errors
/// A message that says what is wrong and what to do, if the frame needs more layers than GPUs draw.
pub fn with_more_layers(plan: &FramePlan, least: impl FnOnce() -> usize) -> Result<FramePlan, String> {
    let layers = peeled_layers(plan);
    if layers >= MOST_LAYERS || (layers == FIRST_LAYERS && least() > MOST_LAYERS) {
        return Err(format!(
            "a pixel has more transparent surfaces than the {MOST_LAYERS} that a GPU draws: choose --backend cpu, or \
             --transparency peel:4"
        ));
    }
    let more = (4 * layers).min(MOST_LAYERS) - plan.peeled_layers();
    let mut plan = plan.clone();
    plan.passes.extend(std::iter::repeat_n(Pass::PeelLayer, more));
    Ok(plan)
}

/// True if a plan is of a shadow map: nothing is shaded.
pub(crate) fn is_of_shadow_map(plan: &FramePlan) -> bool {
    !plan.has(Pass::Shade)
}

/// The passes of a plan.
pub(crate) fn pass_list(plan: &FramePlan) -> Vec<PassEntry> {
    if plan.has(Pass::Gaussians) {
        let by_pixel = plan.sort == Sort::Pixel;
        return vec![PassEntry::Pixels(if by_pixel { PixelPass::GaussiansByPixel } else { PixelPass::Gaussians })];
    }
    let edges = plan.has(Pass::EdgeAntialiasing);
    let polygons = plan.has(Pass::Polygons);
    let sums =
        |layer| PassEntry::Draws(Sums::of(plan, layer).into_iter().map(|sums| Draw::Sums(layer, sums)).collect());
    let one = |draw| PassEntry::Draws(vec![draw]);
    let facings = plan.keeps_facings;
    let samples = plan.has(Pass::EdgeSamples);
    let visibility = match (facings, edges || samples) {
        (false, false) => Draw::Visibility,
        (false, true) => Draw::VisibilityWithTolerance,
        (true, false) => Draw::ShownVisibility,
        (true, true) => Draw::ShownVisibilityWithTolerance,
    };
    let mut list: Vec<PassEntry> = facings.then(|| one(Draw::Facing)).into_iter().collect();
    list.push(one(visibility));
    list.extend(polygons.then(|| one(Draw::Polygons)));
    if is_of_shadow_map(plan) {
        list.push(PassEntry::Pixels(PixelPass::StoreShadow));
        return list;
    }
    let front = match (facings, polygons) {
        (false, false) => Layer::Front,
        (false, true) => Layer::MeshBlend,
        (true, false) => Layer::Shown,
        (true, true) => Layer::ShownMeshBlend,
    };
    let nearest = plan.has(Pass::Nearest);
    list.push(sums(front));
    list.extend(nearest.then(|| one(Draw::Nearest(front))));
    if edges {
        list.extend([one(Draw::Edges), one(Draw::EdgeBackgroundVisibility), sums(Layer::EdgeBackground)]);
    }
    list.extend(has_layers(plan).then_some(PassEntry::Pixels(PixelPass::BeginLayers)));
    list.extend((nearest && has_layers(plan)).then(|| one(Draw::Nearest(Layer::Remaining))));
    let next = |is_first: bool| (!is_first).then_some(PassEntry::Pixels(PixelPass::NextLayer));
    // Steps are those of the nearest transparent splats, too, peeled or not.
    let first_layer = if samples { Draw::PeeledVisibilityWithTolerance } else { Draw::PeeledVisibility };
    list.extend((samples && has_layers(plan) && peeled_layers(plan) == 0).then(|| one(first_layer)));
    let (layer, composite) = match plan.has(Pass::ABuffer) {
        true => (Layer::Gathered, PixelPass::GatheredLayer),
        false => (Layer::Peeled, PixelPass::PeeledLayer),
    };
    for i in 0..peeled_layers(plan) {
        list.extend(next(i == 0));
        let visibility = if i == 0 { first_layer } else { Draw::PeeledVisibility };
        list.extend([one(visibility), sums(layer), PassEntry::Pixels(composite)]);
    }
    if plan.has(Pass::RemainingLayer) {
        list.extend(next(peeled_layers(plan) == 0));
        list.extend([sums(Layer::Remaining), PassEntry::Pixels(PixelPass::RemainingLayer)]);
    }
    let more = polygons || has_layers(plan) || plan.reach_px() > 0 || !plan.shadow_maps.is_empty();
    let full = more || plan.shader == Shader::Toon;
    list.extend(plan.has(Pass::Nearest).then_some(PassEntry::Pixels(PixelPass::Nearest)));
    list.extend(samples.then(|| one(Draw::Steps)));
    list.push(PassEntry::Pixels(if full { PixelPass::Shade } else { PixelPass::ShadeSplats }));
    list
}

/// The passes of samples at a plan's edges, in place of shading with their means; none where there are no samples.
pub(crate) fn sample_pass_list(plan: &FramePlan) -> Vec<PassEntry> {
    if !plan.has(Pass::EdgeSamples) {
        return Vec::new();
    }
    let mut list = pass_list(&plan.of_samples());
    list.pop();
    list.push(PassEntry::Pixels(PixelPass::ResolveSamples));
    list
}

impl Draw {
    /// The draws that a plan needs, each once, those of samples included.
    pub fn of(plan: &FramePlan) -> Vec<Self> {
        let draws = pass_list(plan).into_iter().chain(sample_pass_list(plan)).flat_map(|entry| match entry {
            PassEntry::Draws(draws) => draws,
            PassEntry::Pixels(_) => Vec::new(),
        });
        distinct(draws)
    }
}

impl PixelPass {
    /// The pixel passes that a plan needs, each once, those of samples included.
    pub fn of(plan: &FramePlan) -> Vec<Self> {
        let passes = pass_list(plan).into_iter().chain(sample_pass_list(plan)).filter_map(|entry| match entry {
            PassEntry::Pixels(pass) => Some(pass),
            PassEntry::Draws(_) => None,
        });
        distinct(passes)
    }
}

/// Each item once, in order of appearance.
pub(crate) fn distinct<T: PartialEq>(all: impl Iterator<Item = T>) -> Vec<T> {
    all.fold(Vec::new(), |mut found, one| {
        if !found.contains(&one) {
            found.push(one);
        }
        found
    })
}

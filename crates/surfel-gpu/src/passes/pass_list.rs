//! Passes that draw a plan by raster hardware, in the order in which they run.

use crate::passes::draw::{Draw, Layer, Sums};
use crate::passes::pixel_pass::PixelPass;
use surfel_model::{Shader, Sort};
use surfel_render::{FramePlan, Pass};

/// Entry of a pass list. Each entry processes all splats or pixels before the next one begins.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum PassEntry {
    /// Render passes over the same splats, independent of each other.
    Draws(Vec<Draw>),
    /// Compute pass over pixels.
    Pixels(PixelPass),
}

impl PassEntry {
    /// True if the entry is skipped in tiles without visible transparent splats. The pass that finds depth steps is
    /// never skipped, since it clears its targets.
    pub(crate) fn needs_layers(&self) -> bool {
        self.is_of_layers() && *self != Self::Draws(vec![Draw::PeeledVisibilityWithTolerance])
    }

    /// True if the entry is only for transparent splats.
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

/// True if a plan draws transparent splats in layers, or finds depth steps among them.
pub(crate) fn has_layers(plan: &FramePlan) -> bool {
    let has_steps = plan.has(Pass::EdgeSamples) && plan.separates_transparent;
    has_steps || peeled_layers(plan) > 0 || plan.has(Pass::RemainingLayer)
}

/// Number of layers of an A-buffer that are drawn before the host reads back whether more layers remain.
const FIRST_LAYERS: usize = 16;
/// Maximum number of transparent layers. Shaders count layers in 8 bits.
const MAX_LAYERS: usize = 255;

/// Returns the number of layers to peel. It is the plan's number, and in an A-buffer at least [`FIRST_LAYERS`].
pub(crate) fn peeled_layers(plan: &FramePlan) -> usize {
    let peeled = plan.peeled_layers();
    if plan.has(Pass::ABuffer) { peeled.max(FIRST_LAYERS) } else { peeled }
}

/// Returns a copy of the plan that draws four times as many layers of an A-buffer, at most 255. `least` returns a lower
/// bound of the number of surfaces in a pixel ([`crate::min_surface_count`]) and is called at most once.
///
/// # Errors
/// A message that states the cause and a remedy, if the frame needs more layers than GPUs draw.
pub fn with_more_layers(plan: &FramePlan, least: impl FnOnce() -> usize) -> Result<FramePlan, String> {
    let layers = peeled_layers(plan);
    if layers >= MAX_LAYERS || (layers == FIRST_LAYERS && least() > MAX_LAYERS) {
        return Err(format!(
            "a pixel has more transparent surfaces than the {MAX_LAYERS} that a GPU draws: choose `backend=cpu`, or \
             `transparency=peel:4`"
        ));
    }
    let more = (4 * layers).min(MAX_LAYERS) - plan.peeled_layers();
    let mut plan = plan.clone();
    plan.passes.extend(std::iter::repeat_n(Pass::PeelLayer, more));
    Ok(plan)
}

/// True if the plan draws a shadow map. Such a plan has no shading.
pub(crate) fn is_of_shadow_map(plan: &FramePlan) -> bool {
    !plan.has(Pass::Shade)
}

/// Returns the passes that draw a tile of a plan by raster hardware, in the order in which they run.
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
    // Depth steps are also found among the nearest transparent splats, even if no layer is peeled.
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
    list.push(PassEntry::Pixels(match (plan.has(Pass::Balls), full) {
        (true, _) => PixelPass::ShadeBalls,
        (false, true) => PixelPass::Shade,
        (false, false) => PixelPass::ShadeSplats,
    }));
    list
}

/// Returns the passes that draw the samples of a plan's edge pixels by raster hardware, in order. Shading isn't among
/// them, because the pass that averages samples shades them. The list is empty for plans without samples.
pub(crate) fn sample_pass_list(plan: &FramePlan) -> Vec<PassEntry> {
    if !plan.has(Pass::EdgeSamples) {
        return Vec::new();
    }
    let mut list = pass_list(&plan.of_samples());
    list.pop();
    let has_balls = plan.has(Pass::Balls);
    list.push(PassEntry::Pixels(if has_balls { PixelPass::ResolveSamplesBalls } else { PixelPass::ResolveSamples }));
    list
}

impl Draw {
    /// Returns the draws that a plan needs, each once, including the draws of samples.
    pub fn of(plan: &FramePlan) -> Vec<Self> {
        let draws = pass_list(plan).into_iter().chain(sample_pass_list(plan)).flat_map(|entry| match entry {
            PassEntry::Draws(draws) => draws,
            PassEntry::Pixels(_) => Vec::new(),
        });
        distinct(draws)
    }
}

impl PixelPass {
    /// Returns the pixel passes that a plan needs, each once, including the passes of samples.
    pub fn of(plan: &FramePlan) -> Vec<Self> {
        let passes = pass_list(plan).into_iter().chain(sample_pass_list(plan)).filter_map(|entry| match entry {
            PassEntry::Pixels(pass) => Some(pass),
            PassEntry::Draws(_) => None,
        });
        distinct(passes)
    }
}

/// Returns each item once, in order of first appearance.
pub(crate) fn distinct<T: PartialEq>(all: impl Iterator<Item = T>) -> Vec<T> {
    all.fold(Vec::new(), |mut found, one| {
        if !found.contains(&one) {
            found.push(one);
        }
        found
    })
}

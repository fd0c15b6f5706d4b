//! Cost of a plan on a GPU, counted instead of measured. It doesn't depend on the API or the size of the image.

use crate::passes::draw::Draw;
use crate::passes::memory::Precision;
use crate::passes::pass_list::{distinct, has_layers};
use crate::passes::pixel_pass::PixelPass;
use crate::passes::targets::Target;
use crate::scene::clip::Variant;
use surfel_model::ClipPolicy;
use surfel_render::FramePlan;
use surfel_shaders::layout;

/// GPU resources that a plan uses if raster hardware draws it on a device that can blend f32 targets.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PlanCost {
    /// Names of the shaders that run, each once: the fragment or compute entry point of each pipeline.
    pub shaders: Vec<String>,
    /// Textures that render passes of the frame write.
    pub targets: Vec<Target>,
    /// Size of the targets and layer composites, in bytes per pixel. Planes that are read back and shadow maps don't
    /// count.
    pub bytes_per_pixel: usize,
}

impl PlanCost {
    /// Counts the cost of a plan.
    pub fn of(plan: &FramePlan) -> Self {
        let (mut draws, mut pixels) = (Draw::of(plan), PixelPass::of(plan));
        let frame_draws = draws.clone();
        if !plan.shadow_maps.is_empty() {
            // A shadow map has only a visibility pass; its depths are copied to a buffer.
            draws.push(Draw::Visibility);
            pixels.push(PixelPass::StoreShadow);
        }
        let mut variants = vec![Variant::Whole];
        variants.extend((plan.clip != ClipPolicy::Off).then_some(Variant::Clipped));
        variants.retain(|_| draws.iter().any(|draw| draw.draws_records()));
        let of_splats = variants.iter().flat_map(|&variant| {
            let drawn = draws.iter().filter(|draw| draw.draws_records());
            let fragments = drawn.map(move |draw| fragment(*draw, variant));
            std::iter::once(variant.setup()).chain(fragments)
        });
        let others = draws.iter().filter(|draw| !draw.draws_records()).map(|draw| fragment(*draw, Variant::Whole));
        let of_pixels = pixels.iter().map(|pass| pass.entry().to_owned());
        let shaders = distinct(of_splats.chain(others).chain(of_pixels));
        let targets =
            distinct(frame_draws.iter().flat_map(|d| d.depth().into_iter().chain(d.colors().iter().copied())));
        let sums = Precision::of(plan, true);
        let layer_composites = if has_layers(plan) { layout::layer_composite::SIZE } else { 0 };
        let bytes_per_pixel = targets.iter().map(|t| t.format().bytes(sums) as usize).sum::<usize>() + layer_composites;
        Self { shaders, targets, bytes_per_pixel }
    }
}

/// Returns the name of a draw's fragment entry point.
fn fragment(draw: Draw, variant: Variant) -> String {
    let [_, fragment] = draw.entries(variant);
    fragment
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_model::{Accumulate, Camera, EdgeAa, Projection, Settings, Sort, Transparency};
    use surfel_render::{Capabilities, GaussianColors, Planes, SceneSummary, View, plan};

    fn cost(summary: &SceneSummary, change: impl FnOnce(&mut Settings)) -> PlanCost {
        let projection = Projection::Perspective { fov_y_deg: 45.0 };
        let (eye, up, size) = ([0.0, 0.0, 5.0], [0.0, 1.0, 0.0], [8, 8]);
        let view = View::new(&Camera { eye, target: [0.0; 3], up, projection, near: 0.1, far: None, size }).unwrap();
        let mut settings = Settings::default();
        change(&mut settings);
        let capabilities = Capabilities::everything("test");
        PlanCost::of(&plan(summary, &view, &settings, Planes::COLOR, &capabilities).unwrap())
    }

    #[test]
    fn plan_of_white_splats_needs_depth_and_one_set_of_sums() {
        let plain = cost(&SceneSummary::default(), |_| ());
        assert_eq!(plain.targets, [Target::DepthThreshold, Target::Color]);
        assert_eq!(plain.bytes_per_pixel, 4 + 16);
        assert_eq!(plain.shaders.len(), 4, "{:?}", plain.shaders);
        let half = cost(&SceneSummary::default(), |s| s.accumulate = Accumulate::F16);
        assert_eq!(half.bytes_per_pixel, 4 + 8);
    }

    #[test]
    fn features_cost_what_they_need_and_nothing_where_they_are_absent() {
        let plain = cost(&SceneSummary::default(), |_| ());
        let peel = |s: &mut Settings| s.transparency = Transparency::Peel { layers: 3, drop_last: false };
        assert_eq!(cost(&SceneSummary::default(), peel), plain);
        let clips = SceneSummary { clips: true, ..SceneSummary::default() };
        assert_eq!(cost(&clips, |s| s.clip = ClipPolicy::Off), plain);
        let clipped = cost(&clips, |_| ());
        // Clipped splats need setup, visibility and sums of their own.
        assert_eq!((clipped.shaders.len(), &clipped.targets), (plain.shaders.len() + 3, &plain.targets));
        let glass = SceneSummary { transparent: true, ..SceneSummary::default() };
        let layers = cost(&glass, peel);
        assert!(layers.bytes_per_pixel > plain.bytes_per_pixel + layout::layer_composite::SIZE);
        assert!(layers.shaders.iter().any(|s| s == "peeled_layer"));
        let edges = cost(&SceneSummary::default(), |s| s.edge_aa = EdgeAa::Coverage);
        assert!(
            edges.targets.contains(&Target::EdgeBackgroundColor) && edges.targets.contains(&Target::ThresholdTolerance)
        );
        // Samples are drawn into the same targets. They add steps, tolerances and three shaders.
        let samples = cost(&SceneSummary::default(), |s| s.edge_aa = EdgeAa::Samples);
        assert_eq!(samples.bytes_per_pixel, plain.bytes_per_pixel + 8 + 8);
        let of_samples = ["front_threshold_fragment", "steps_fragment", "resolve_samples"];
        assert!(of_samples.iter().all(|name| samples.shaders.iter().any(|s| s == name)), "{:?}", samples.shaders);
        assert_eq!(samples.shaders.len(), plain.shaders.len() + of_samples.len(), "{:?}", samples.shaders);
        // Gaussians use one shader, which writes planes directly.
        let gaussians = SceneSummary { gaussians: Some(GaussianColors::Displayed), ..SceneSummary::default() };
        for (sort, shader) in [(Sort::Center, "gaussians"), (Sort::Pixel, "gaussians_by_pixel")] {
            let own = cost(&gaussians, |s| s.sort = sort);
            assert_eq!((own.shaders, own.targets, own.bytes_per_pixel), (vec![shader.to_owned()], Vec::new(), 0));
        }
        assert!(!plain.shaders.iter().any(|s| s.starts_with("gaussians")));
        // The sums of an A-buffer's layers include coverage.
        let abuffer = |s: &mut Settings| s.transparency = Transparency::ABuffer { layers: 4 };
        let gathered = cost(&glass, abuffer);
        assert!(gathered.targets.contains(&Target::LayerCoverage) && !layers.targets.contains(&Target::LayerCoverage));
        assert!(gathered.shaders.iter().any(|s| s == "gathered_layer"));
        assert_eq!(cost(&SceneSummary::default(), abuffer), plain);
    }
}

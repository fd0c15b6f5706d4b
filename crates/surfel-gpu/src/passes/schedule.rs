//! Order of the steps that draw a tile, independent of the API. A *segment* is the part of an object's splats that
//! shares a buffer ([`Segment`](crate::Segment)). A *record* is a splat as set up for a tile: its projected forms,
//! pixel boxes and colour in a buffer.

use crate::passes::draw::Draw;
use crate::passes::pass_list::{PassEntry, pass_list, sample_pass_list};
use crate::passes::pixel_pass::PixelPass;
use surfel_render::{Feature, FramePlan};

/// Features that no GPU backend supports.
pub const UNSUPPORTED: &[Feature] = &[Feature::Margin, Feature::Sky];

/// Segments of a scene that may touch a tile, as indices into the scene's segments.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct VisibleSegments {
    /// Segments whose splats are drawn as opaque.
    pub opaque: Vec<usize>,
    /// Segments whose splats are drawn in transparent layers.
    pub transparent: Vec<usize>,
    /// True if some splats that reach the near plane are drawn in transparent layers.
    pub near_transparent: bool,
}

impl VisibleSegments {
    /// True if any splat is drawn in transparent layers.
    pub fn has_transparent(&self) -> bool {
        self.near_transparent || !self.transparent.is_empty()
    }
}

/// Step of a tile. Segments are given by their indices in the scene.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Step {
    /// Projects splats to records.
    Setup {
        /// Segments whose splats are set up.
        segments: Vec<usize>,
        /// True if the splats have not been set up in this tile before. They are then counted as drawn in the
        /// statistics.
        first: bool,
    },
    /// Runs a render pass.
    Draw {
        /// Render pass to run.
        draw: Draw,
        /// Segments whose records are drawn.
        segments: Vec<usize>,
        /// True for the first step of this pass in the tile. The step then clears the targets, and also draws the
        /// splats that reach the near plane.
        first: bool,
    },
    /// Runs a compute pass over pixels.
    PixelPass(PixelPass),
}

impl Step {
    /// Returns the name of the step in the statistics.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Setup { .. } => "setup",
            Self::Draw { draw, .. } => draw.name(),
            Self::PixelPass(pass) => pass.name(),
        }
    }
}

/// Returns the steps that draw a tile by raster hardware, in order. `visible` are the segments that may touch the tile.
///
/// Records that fit into memory together are set up once per tile. If all segments share one buffer of records
/// (`shared_records`), and more than one is visible, records are set up again for each pass over the splats.
pub fn schedule(plan: &FramePlan, visible: &VisibleSegments, shared_records: bool) -> Vec<Step> {
    steps(pass_list(plan), visible, shared_records)
}

/// Returns the steps that draw a part of a tile's samples, as [`schedule()`] does for a tile. They run after the tile's
/// own steps.
pub(crate) fn sample_schedule(plan: &FramePlan, visible: &VisibleSegments, shared_records: bool) -> Vec<Step> {
    steps(sample_pass_list(plan), visible, shared_records)
}

/// Returns the steps of a list of passes. Entries for transparent splats are skipped if none are visible.
fn steps(list: Vec<PassEntry>, visible: &VisibleSegments, shared_records: bool) -> Vec<Step> {
    let again = shared_records && visible.opaque.len() + visible.transparent.len() > 1;
    // Groups of segments that are set up and drawn together.
    let batches = |segments: &[usize]| -> Vec<Vec<usize>> {
        if again && segments.len() > 1 {
            segments.iter().map(|&segment| vec![segment]).collect()
        } else {
            vec![segments.to_vec()]
        }
    };
    let (opaque, transparent) = (batches(&visible.opaque), batches(&visible.transparent));
    let mut is_set_up = [false; 2];
    let mut steps = Vec::new();
    for entry in list {
        if entry.needs_layers() && !visible.has_transparent() {
            continue;
        }
        let batches = if entry.is_of_layers() { &transparent } else { &opaque };
        let was_set_up = &mut is_set_up[usize::from(entry.is_of_layers())];
        match entry {
            PassEntry::Pixels(pass) => steps.push(Step::PixelPass(pass)),
            PassEntry::Draws(draws) if draws.iter().any(|draw| !draw.draws_records()) => {
                let without_records = |&draw: &Draw| Step::Draw { draw, segments: Vec::new(), first: true };
                steps.extend(draws.iter().map(without_records));
            }
            PassEntry::Draws(draws) => {
                for (i, segments) in batches.iter().enumerate() {
                    if !segments.is_empty() && (again || !*was_set_up) {
                        steps.push(Step::Setup { segments: segments.clone(), first: !*was_set_up });
                    }
                    let draw = |&draw: &Draw| Step::Draw { draw, segments: segments.clone(), first: i == 0 };
                    steps.extend(draws.iter().map(draw));
                }
                *was_set_up = true;
            }
        }
    }
    steps
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::passes::draw::{Layer, Sums};
    use crate::passes::targets::TargetFormat;
    use surfel_model::{Camera, EdgeAa, Projection, Settings};
    use surfel_render::{Capabilities, Planes, SceneSummary, View, plan};

    fn view() -> View {
        let projection = Projection::Perspective { fov_y_deg: 45.0 };
        let (eye, up, size) = ([0.0, 0.0, 5.0], [0.0, 1.0, 0.0], [8, 8]);
        View::new(&Camera { eye, target: [0.0; 3], up, projection, near: 0.1, far: None, size }).unwrap()
    }

    fn planned(planes: Planes, edge_aa: EdgeAa) -> FramePlan {
        let capabilities = Capabilities::everything("test");
        let settings = Settings::default().with_edge_aa(edge_aa);
        plan(&SceneSummary::default(), &view(), &settings, planes, &capabilities).unwrap()
    }

    fn opaque(segments: &[usize]) -> VisibleSegments {
        VisibleSegments { opaque: segments.to_vec(), ..VisibleSegments::default() }
    }

    fn draws(steps: &[Step]) -> Vec<Draw> {
        let draw = |step: &Step| if let Step::Draw { draw, .. } = step { Some(*draw) } else { None };
        steps.iter().filter_map(draw).collect()
    }

    fn setups(steps: &[Step]) -> usize {
        steps.iter().filter(|s| matches!(s, Step::Setup { .. })).count()
    }

    #[test]
    fn unlit_image_needs_one_pass_of_one_target() {
        let front = |planes| Sums::of(&planned(planes, EdgeAa::Off), Layer::Front);
        assert_eq!(front(Planes::COLOR), [Sums::Color]);
        assert_eq!(front(Planes::ALL), [Sums::Surface]);
        assert_eq!(front(Planes::COLOR.with_fragments(true)), [Sums::Color, Sums::MaterialCounts]);
    }

    #[test]
    fn records_of_their_own_are_set_up_once_and_shared_ones_for_each_pass() {
        let plan = planned(Planes::COLOR, EdgeAa::Off);
        let own = schedule(&plan, &opaque(&[0, 2, 5]), false);
        assert_eq!((own.len(), setups(&own)), (4, 1));
        let shared = schedule(&plan, &opaque(&[0, 2, 5]), true);
        assert_eq!(setups(&shared), 6);
        // The visibility of all segments is complete before the first sum.
        let first_sum = draws(&shared).iter().position(|d| d.is_additive()).unwrap();
        assert!(!draws(&shared)[first_sum..].contains(&Draw::Visibility));
        assert_eq!(setups(&schedule(&plan, &opaque(&[3]), true)), 1);
        // A tile that no splat touches is still cleared and shaded.
        let empty = schedule(&plan, &opaque(&[]), false);
        assert_eq!(empty.iter().map(Step::name).collect::<Vec<_>>(), ["visibility", "attributes", "shade"]);
    }

    #[test]
    fn edges_alone_draw_a_background_behind_the_front_surface() {
        let (front, behind) = (|s| Draw::Sums(Layer::Front, s), |s| Draw::Sums(Layer::EdgeBackground, s));
        let plan = planned(Planes::COLOR, EdgeAa::Coverage);
        let expected = [
            Draw::VisibilityWithTolerance,
            front(Sums::Color),
            front(Sums::MaterialCounts),
            Draw::Edges,
            Draw::EdgeBackgroundVisibility,
            behind(Sums::Color),
        ];
        assert_eq!(draws(&schedule(&plan, &opaque(&[0]), false)), expected);
        assert_eq!(Draw::of(&plan), expected);
        assert_eq!(setups(&schedule(&plan, &opaque(&[0, 1]), true)), 8);
        assert_eq!(Draw::of(&planned(Planes::COLOR, EdgeAa::Off)), [Draw::Visibility, front(Sums::Color)]);
    }

    #[test]
    fn edges_by_samples_find_steps_and_draw_the_frame_again_in_place_of_shading() {
        let summary = SceneSummary { transparent: true, ..SceneSummary::default() };
        let planned = |edge_aa, transparency: &str| {
            let settings = Settings::default().with_edge_aa(edge_aa).with_transparency(transparency.parse().unwrap());
            plan(&summary, &view(), &settings, Planes::COLOR, &Capabilities::everything("test")).unwrap()
        };
        let front = Draw::Sums(Layer::Front, Sums::Color);
        let (plain, samples) = (planned(EdgeAa::Off, "off"), planned(EdgeAa::Samples, "off"));
        let names = |steps: &[Step]| -> Vec<&str> { steps.iter().map(Step::name).collect() };
        let own = schedule(&samples, &opaque(&[0]), false);
        assert_eq!(draws(&own), [Draw::VisibilityWithTolerance, front, Draw::Steps]);
        assert_eq!(names(&own)[3..], ["edge samples", "shade"]);
        let again = sample_schedule(&samples, &opaque(&[0]), false);
        assert_eq!(draws(&again), draws(&schedule(&plain, &opaque(&[0]), false)));
        assert_eq!(again.last(), Some(&Step::PixelPass(PixelPass::ResolveSamples)));
        assert_eq!(Draw::of(&samples), [Draw::VisibilityWithTolerance, front, Draw::Steps, Draw::Visibility]);
        // A plan without edge samples has none of these passes.
        assert!(sample_schedule(&plain, &opaque(&[0]), false).is_empty());
        assert!(
            !Draw::of(&plain).contains(&Draw::Steps) && !PixelPass::of(&plain).contains(&PixelPass::ResolveSamples)
        );
        // The steps pass reads the target of the nearest transparent splats even if there are none, so the target is
        // cleared.
        for (transparency, count) in [("peel:1", 1), ("peel:3", 3)] {
            let plan = planned(EdgeAa::Samples, transparency);
            let clear = draws(&schedule(&plan, &opaque(&[0]), false));
            let nearest = Draw::PeeledVisibilityWithTolerance;
            assert_eq!(clear.iter().filter(|draw| draw.is_transparent()).collect::<Vec<_>>(), [&nearest]);
            let visible = VisibleSegments { opaque: vec![0], transparent: vec![1], near_transparent: false };
            let layers = draws(&schedule(&plan, &visible, false));
            let visibilities = layers.iter().filter(|draw| matches!(draw, Draw::PeeledVisibility) || **draw == nearest);
            assert_eq!(visibilities.clone().next(), Some(&nearest));
            assert_eq!(visibilities.count(), if count == 1 { 1 } else { count - 1 });
            assert!(!draws(&sample_schedule(&plan, &visible, false)).contains(&nearest));
        }
    }

    #[test]
    fn no_pass_reads_what_it_draws_into_and_none_is_wider_than_32_bytes() {
        for draw in Draw::of(&planned(Planes::ALL, EdgeAa::Coverage)) {
            let drawn = draw.colors().iter().copied().chain(draw.depth());
            for target in drawn {
                assert!(draw.reads().iter().all(|read| read.1 != target), "{draw:?}");
            }
            let four = |target: &&crate::Target| target.format() == TargetFormat::Sums4;
            assert!(draw.colors().len() <= 2 && draw.colors().iter().filter(four).count() <= 2);
        }
    }

    #[test]
    fn layers_are_drawn_only_where_transparent_splats_are_seen() {
        use PixelPass::{BeginLayers, NextLayer, PeeledLayer, RemainingLayer, Shade};
        let capabilities = Capabilities::everything("test");
        let summary = SceneSummary { transparent: true, ..SceneSummary::default() };
        let settings = Settings::default().with_transparency("peel:3".parse().unwrap());
        let plan = plan(&summary, &view(), &settings, Planes::COLOR, &capabilities).unwrap();
        let pixels = |steps: &[Step]| -> Vec<PixelPass> {
            steps.iter().filter_map(|s| if let Step::PixelPass(pixels) = s { Some(*pixels) } else { None }).collect()
        };
        let clear = schedule(&plan, &opaque(&[0, 1]), false);
        assert_eq!(pixels(&clear), [BeginLayers, Shade]);
        assert!(draws(&clear).iter().all(|draw| !draw.is_transparent()));
        let visible = VisibleSegments { opaque: vec![0], transparent: vec![1], near_transparent: false };
        for shared in [false, true] {
            let steps = schedule(&plan, &visible, shared);

            let expected = [BeginLayers, PeeledLayer, NextLayer, PeeledLayer, NextLayer, RemainingLayer, Shade];
            assert_eq!(pixels(&steps), expected);
            for step in &steps {
                if let Step::Draw { draw, segments, .. } = step {
                    assert_eq!(segments, if draw.is_transparent() { &visible.transparent } else { &visible.opaque });
                }
            }
            let first = steps.iter().filter(|s| matches!(s, Step::Setup { first: true, .. })).count();
            assert_eq!((first, setups(&steps)), (2, if shared { 2 + 5 } else { 2 }));
        }
        let settings = Settings::default().with_transparency("abuffer:3".parse().unwrap());
        let gathered = surfel_render::plan(&summary, &view(), &settings, Planes::COLOR, &capabilities).unwrap();
        let layers = |plan: &FramePlan| {
            let steps = pixels(&schedule(plan, &visible, false));
            assert!(!steps.contains(&PeeledLayer) && !steps.contains(&RemainingLayer));
            steps.iter().filter(|pass| **pass == PixelPass::GatheredLayer).count()
        };
        let more = crate::with_more_layers(&gathered, || 255).unwrap();
        let most = crate::with_more_layers(&more, || 255).unwrap();
        assert_eq!([&gathered, &more, &most].map(layers), [16, 64, 255]);
        assert!(crate::with_more_layers(&most, || 0).unwrap_err().contains("255"));
        assert!(crate::with_more_layers(&gathered, || 256).unwrap_err().contains("255"));
        assert_eq!(Draw::of(&gathered), Draw::of(&most));
        let splats = [EdgeAa::Off, EdgeAa::Coverage].map(|edges| PixelPass::of(&planned(Planes::COLOR, edges)));
        assert_eq!(splats, [[PixelPass::ShadeSplats], [Shade]]);
        assert_eq!(
            Draw::of(&planned(Planes::COLOR, EdgeAa::Off)).iter().filter(|draw| draw.is_transparent()).count(),
            0
        );
    }
}

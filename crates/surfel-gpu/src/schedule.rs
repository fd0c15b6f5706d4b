//! The steps of a tile, in order, whatever API executes them.

use crate::rounds::{Pixels, Round, rounds};
use crate::targets::Draw;
use crate::tile::Visible;
use surfel_render::{Feature, FramePlan};

/// What no GPU backend draws.
pub const LACKS: &[Feature] = &[Feature::ABuffer, Feature::Margin];

/// A step of a tile. Numbers are indices of the scene's segments.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Step {
    /// Set up records.
    Setup {
        /// Of these segments.
        segments: Vec<usize>,
        /// Their splats have not been set up in this tile before, and count as drawn.
        first: bool,
    },
    /// Draw.
    Draw {
        /// What.
        draw: Draw,
        /// These segments' records.
        segments: Vec<usize>,
        /// It is the tile's first of its kind: it clears, and draws the near splats, too.
        first: bool,
    },
    /// Once a pixel.
    Pixels(Pixels),
}

impl Step {
    /// Its name in the statistics.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Setup { .. } => "setup",
            Self::Draw { draw, .. } => draw.name(),
            Self::Pixels(pixels) => pixels.name(),
        }
    }
}

/// The steps of a tile that these segments may touch. Records that fit into memory together are set up once; where one
/// buffer serves all segments in turn (`shared_records`) they are set up again for each pass over the splats.
pub fn schedule(plan: &FramePlan, visible: &Visible, shared_records: bool) -> Vec<Step> {
    let again = shared_records && visible.opaque.len() + visible.transparent.len() > 1;
    let groups = |segments: &[usize]| -> Vec<Vec<usize>> {
        if again && segments.len() > 1 {
            segments.iter().map(|&segment| vec![segment]).collect()
        } else {
            vec![segments.to_vec()]
        }
    };
    let (opaque, transparent) = (groups(&visible.opaque), groups(&visible.transparent));
    let mut is_set_up = [false; 2];
    let mut steps = Vec::new();
    for round in rounds(plan) {
        if round.is_of_layers() && !visible.has_transparent() {
            continue;
        }
        let groups = if round.is_of_layers() { &transparent } else { &opaque };
        let was_set_up = &mut is_set_up[usize::from(round.is_of_layers())];
        match round {
            Round::Pixels(pixels) => steps.push(Step::Pixels(pixels)),
            Round::Draws(draws) if draws.iter().any(|draw| !draw.is_of_records()) => {
                let everywhere = |&draw: &Draw| Step::Draw { draw, segments: Vec::new(), first: true };
                steps.extend(draws.iter().map(everywhere));
            }
            Round::Draws(draws) => {
                for (i, segments) in groups.iter().enumerate() {
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
    use crate::targets::{Layer, Sums};
    use surfel_model::{Camera, Projection, Settings};
    use surfel_render::{Capabilities, Planes, SceneSummary, View, plan};

    fn view() -> View {
        let projection = Projection::Perspective { fov_y_deg: 45.0 };
        let (eye, up, size) = ([0.0, 0.0, 5.0], [0.0, 1.0, 0.0], [8, 8]);
        View::new(&Camera { eye, target: [0.0; 3], up, projection, near: 0.1, far: None, size }).unwrap()
    }

    fn planned(planes: Planes, edge_aa: bool) -> FramePlan {
        let capabilities = Capabilities::everything("test");
        let settings = Settings { edge_aa, ..Settings::default() };
        plan(&SceneSummary::default(), &view(), &settings, planes, &capabilities).unwrap()
    }

    fn opaque(segments: &[usize]) -> Visible {
        Visible { opaque: segments.to_vec(), ..Visible::default() }
    }

    fn draws(steps: &[Step]) -> Vec<Draw> {
        let draw = |step: &Step| if let Step::Draw { draw, .. } = step { Some(*draw) } else { None };
        steps.iter().filter_map(draw).collect()
    }

    fn setups(steps: &[Step]) -> usize {
        steps.iter().filter(|s| matches!(s, Step::Setup { .. })).count()
    }

    #[test]
    fn an_unlit_picture_needs_one_pass_of_one_target() {
        let front = |planes| Sums::of(&planned(planes, false), Layer::Front);
        assert_eq!(front(Planes::COLOR), [Sums::Color]);
        assert_eq!(front(Planes::ALL), [Sums::Surface]);
        assert_eq!(front(Planes { fragments: true, ..Planes::COLOR }), [Sums::Color, Sums::Further]);
    }

    #[test]
    fn records_of_their_own_are_set_up_once_and_shared_ones_for_each_pass() {
        let plan = planned(Planes::COLOR, false);
        let own = schedule(&plan, &opaque(&[0, 2, 5]), false);
        assert_eq!((own.len(), setups(&own)), (4, 1));
        let shared = schedule(&plan, &opaque(&[0, 2, 5]), true);
        assert_eq!(setups(&shared), 6);
        // Visibility of all comes before the first sum.
        let first_sum = draws(&shared).iter().position(|d| d.adds()).unwrap();
        assert!(!draws(&shared)[first_sum..].contains(&Draw::Visibility));
        assert_eq!(setups(&schedule(&plan, &opaque(&[3]), true)), 1);
        // A tile that nothing touches is cleared and shaded all the same.
        let empty = schedule(&plan, &opaque(&[]), false);
        assert_eq!(empty.iter().map(Step::name).collect::<Vec<_>>(), ["visibility", "attributes", "shade"]);
    }

    #[test]
    fn edges_take_a_second_look_behind_the_first_and_nothing_else_does() {
        let (front, behind) = (|s| Draw::Sums(Layer::Front, s), |s| Draw::Sums(Layer::Behind, s));
        let plan = planned(Planes::COLOR, true);
        let expected = [
            Draw::Writers,
            front(Sums::Color),
            front(Sums::Further),
            Draw::Edges,
            Draw::VisibilityBehind,
            behind(Sums::Color),
        ];
        assert_eq!(draws(&schedule(&plan, &opaque(&[0]), false)), expected);
        assert_eq!(Draw::of(&plan), expected);
        assert_eq!(setups(&schedule(&plan, &opaque(&[0, 1]), true)), 8);
        assert_eq!(Draw::of(&planned(Planes::COLOR, false)), [Draw::Visibility, front(Sums::Color)]);
    }

    #[test]
    fn no_pass_reads_what_it_draws_into_and_none_is_wider_than_32_bytes() {
        for draw in Draw::of(&planned(Planes::ALL, true)) {
            let drawn = draw.colors().iter().copied().chain(draw.depth());
            for target in drawn {
                assert!(draw.reads().iter().all(|read| read.1 != target), "{draw:?}");
            }
            let four = |target: &&crate::Target| target.format() == crate::TargetFormat::Sums4;
            assert!(draw.colors().len() <= 2 && draw.colors().iter().filter(four).count() <= 2);
        }
    }

    #[test]
    fn layers_are_drawn_only_where_transparent_splats_are_seen() {
        use Pixels::{BeginLayers, NextLayer, PeeledLayer, RemainingLayer, Shade};
        let capabilities = Capabilities::everything("test");
        let summary = SceneSummary { transparent: true, ..SceneSummary::default() };
        let settings = Settings { transparency: "peel:3".parse().unwrap(), ..Settings::default() };
        let plan = plan(&summary, &view(), &settings, Planes::COLOR, &capabilities).unwrap();
        let pixels = |steps: &[Step]| -> Vec<Pixels> {
            steps.iter().filter_map(|s| if let Step::Pixels(pixels) = s { Some(*pixels) } else { None }).collect()
        };
        let clear = schedule(&plan, &opaque(&[0, 1]), false);
        assert_eq!(pixels(&clear), [BeginLayers, Shade]);
        assert!(draws(&clear).iter().all(|draw| !draw.is_transparent()));
        let visible = Visible { opaque: vec![0], transparent: vec![1], near_transparent: false };
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
        let splats = [false, true].map(|edges| Pixels::of(&planned(Planes::COLOR, edges)));
        assert_eq!(splats, [[Pixels::ShadeSplats], [Shade]]);
        assert_eq!(Draw::of(&planned(Planes::COLOR, false)).iter().filter(|draw| draw.is_transparent()).count(), 0);
    }
}

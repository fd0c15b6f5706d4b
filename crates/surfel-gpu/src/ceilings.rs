//! What a device does at best: triangles over the whole target, by shaders that compute nothing. Passes over splats are
//! judged by it.

use crate::schedule::Step;
use crate::targets::Draw;
use surfel_model::{Camera, Projection, Settings};
use surfel_render::{Capabilities, FramePlan, Planes, RenderError, SceneSummary, Stats, View, plan};

/// How often each pixel is drawn.
const LAYERS: u32 = 16;

/// How often all of it is measured.
pub const CEILING_RUNS: usize = 4;

/// What is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Ceiling {
    /// Clearing the two targets of colour and surface.
    Clear,
    /// A depth from the fragment shader, nearer than the last: the visibility pass.
    Depth,
    /// A colour in place of the last.
    Fill,
    /// A colour added: the attribute pass of an unlit picture.
    Blend,
    /// Colour and surface added: the attribute pass of others.
    BlendTwo,
}

impl Ceiling {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Clear, Self::Depth, Self::Fill, Self::Blend, Self::BlendTwo];

    /// Its name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Clear => "clear",
            Self::Depth => "depth",
            Self::Fill => "fill",
            Self::Blend => "blend",
            Self::BlendTwo => "blend two",
        }
    }

    /// Triangles that a pass draws.
    pub(crate) fn triangles(self) -> u32 {
        if self == Self::Clear { 0 } else { LAYERS }
    }
}

/// A measured rate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FillRate {
    /// Of what.
    pub ceiling: Ceiling,
    /// Pixels that were cleared, or fragments that were drawn, a second.
    pub fragments_per_s: f64,
}

/// A frame that measures the ceilings.
pub struct CeilingFrame {
    /// The target's size is all that matters of it.
    pub view: View,
    /// Nothing is drawn of it.
    pub plan: FramePlan,
    /// What is drawn instead.
    pub draws: Vec<Draw>,
    /// And how.
    pub steps: Vec<Step>,
}

impl CeilingFrame {
    /// Of a square target.
    ///
    /// # Errors
    /// [`RenderError`] if there is no picture of that size.
    pub fn new(side_px: u32) -> Result<Self, RenderError> {
        let projection = Projection::Perspective { fov_y_deg: 45.0 };
        let (eye, up, size) = ([0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [side_px; 2]);
        let view = View::new(&Camera { eye, target: [0.0; 3], up, projection, near: 0.1, far: None, size })?;
        let capabilities = Capabilities::everything("ceilings");
        let plan = plan(&SceneSummary::default(), &view, &Settings::default(), Planes::COLOR, &capabilities)?;
        let draws: Vec<Draw> = Ceiling::ALL.map(Draw::Ceiling).to_vec();
        let passes = |ceiling| if ceiling == Ceiling::Clear { LAYERS as usize } else { 1 };
        let step = |ceiling| Step::Draw { draw: Draw::Ceiling(ceiling), segments: Vec::new(), first: true };
        let steps = Ceiling::ALL.into_iter().flat_map(|c| std::iter::repeat_n(step(c), passes(c))).collect();
        Ok(Self { view, plan, draws, steps })
    }

    /// The best of several runs; nothing of what the device gave no time for.
    pub fn rates(&self, runs: &[Stats]) -> Vec<FillRate> {
        let [width, height] = self.view.size.map(f64::from);
        let fragments = width * height * f64::from(LAYERS);
        let ms = |ceiling: Ceiling| {
            let times = runs.iter().flat_map(|run| &run.passes).filter(|pass| pass.name == ceiling.name());
            times.map(|pass| pass.ms).fold(f64::INFINITY, f64::min)
        };
        let rate = |ceiling| FillRate { ceiling, fragments_per_s: fragments / (ms(ceiling) * 1e-3) };
        let is_known = |rate: &FillRate| rate.fragments_per_s > 0.0 && rate.fragments_per_s.is_finite();
        Ceiling::ALL.into_iter().map(rate).filter(is_known).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_render::PassTime;

    #[test]
    fn rates_are_of_the_best_run_and_none_without_a_time() {
        let frame = CeilingFrame::new(100).unwrap();
        assert_eq!(frame.steps.len(), 16 + 4);
        let run = |ms| Stats { passes: vec![PassTime { name: "blend", ms }], ..Stats::default() };
        let rates = frame.rates(&[run(4.0), run(2.0)]);
        // 160,000 fragments in 2 ms.
        assert_eq!(rates, [FillRate { ceiling: Ceiling::Blend, fragments_per_s: 80e6 }]);
    }
}

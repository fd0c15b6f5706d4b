//! Measurement of a device's fill rates, which are upper bounds of the speed of passes over splats.

use crate::passes::draw::Draw;
use crate::passes::probe::{FillRateProbe, OVERDRAW};
use crate::passes::schedule::Step;
use surfel_model::{Camera, Projection, Settings};
use surfel_render::{Capabilities, FramePlan, Planes, RenderError, SceneSummary, Stats, View, plan};

/// Number of runs of each fill-rate probe, of which the fastest counts.
pub const FILL_RATE_RUNS: usize = 4;

/// Fill rate that a probe measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FillRate {
    /// Probe that measured the rate.
    pub probe: FillRateProbe,
    /// Pixels cleared or fragments drawn per second.
    pub fragments_per_s: f64,
}

/// Frame that runs all fill-rate probes.
pub struct FillRateFrame {
    /// View with the size of the textures that the probes draw into; its camera is arbitrary.
    pub view: View,
    /// Plan of the view. The plan's own passes are not executed.
    pub plan: FramePlan,
    /// Render passes of the probes.
    pub draws: Vec<Draw>,
    /// Steps that run the probes.
    pub steps: Vec<Step>,
}

impl FillRateFrame {
    /// Creates a frame whose probes draw into square textures of side `side_px`, in pixels.
    ///
    /// # Errors
    /// [`RenderError::Model`] if an image can't have this size.
    pub fn new(side_px: u32) -> Result<Self, RenderError> {
        let projection = Projection::Perspective { fov_y_deg: 45.0 };
        let (eye, up, size) = ([0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [side_px; 2]);
        let view = View::new(&Camera { eye, target: [0.0; 3], up, projection, near: 0.1, far: None, size })?;
        let capabilities = Capabilities::everything("fill rates");
        let plan = plan(&SceneSummary::default(), &view, &Settings::default(), Planes::COLOR, &capabilities)?;
        let draws: Vec<Draw> = FillRateProbe::ALL.map(Draw::Probe).to_vec();
        let passes = |probe| if probe == FillRateProbe::Clear { OVERDRAW as usize } else { 1 };
        let step = |probe| Step::Draw { draw: Draw::Probe(probe), segments: Vec::new(), first: true };
        let steps = FillRateProbe::ALL.into_iter().flat_map(|p| std::iter::repeat_n(step(p), passes(p))).collect();
        Ok(Self { view, plan, draws, steps })
    }

    /// Returns the best rate of several runs for each probe, from the statistics of the runs. Probes without a time in
    /// the statistics are omitted.
    pub fn rates(&self, runs: &[Stats]) -> Vec<FillRate> {
        let [width, height] = self.view.size.map(f64::from);
        let fragments = width * height * f64::from(OVERDRAW);
        let ms = |probe: FillRateProbe| {
            let times = runs.iter().flat_map(|run| &run.passes).filter(|pass| pass.name == probe.name());
            times.map(|pass| pass.ms).fold(f64::INFINITY, f64::min)
        };
        let rate = |probe| FillRate { probe, fragments_per_s: fragments / (ms(probe) * 1e-3) };
        let is_known = |rate: &FillRate| rate.fragments_per_s > 0.0 && rate.fragments_per_s.is_finite();
        FillRateProbe::ALL.into_iter().map(rate).filter(is_known).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_render::PassTime;

    #[test]
    fn rates_are_of_the_best_run_and_none_without_a_time() {
        let frame = FillRateFrame::new(100).unwrap();
        assert_eq!(frame.steps.len(), 16 + 4);
        let run = |ms| Stats::default().with_passes(vec![PassTime { name: "blend", ms }]);
        let rates = frame.rates(&[run(4.0), run(2.0)]);
        // 160,000 fragments in 2 ms.
        assert_eq!(rates, [FillRate { probe: FillRateProbe::Blend, fragments_per_s: 80e6 }]);
    }
}

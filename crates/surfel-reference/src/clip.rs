//! Clips of splats (rendering model §7), evaluated per pixel in the splat's own (u, v).

use surfel_math::V2;
use surfel_math::clip::{Clip, Turn};
use surfel_math::clip_paper::PaperCurve;
use surfel_math::mapping::Footprint;
use surfel_model::{ClipPolicy, SplatCloud};

/// Clip of a splat, with the maps from the (u, v) of its footprints to the splat's own (u, v).
#[derive(Clone)]
pub(crate) struct SplatClip {
    clip: Clip<f64>,
    /// Curve that replaces the clip's curve under [`ClipPolicy::Paper`], evaluated by C12 eq. 7. `None` under other
    /// policies, and for a clip that consists of lines only.
    paper: Option<PaperCurve<f64>>,
    /// True if the clipped filtered footprint also contains what the clip leaves of the unfiltered splat, as far as the
    /// filtered footprint reaches. This is a rule for oriented clouds (rendering model §7): a widened footprint's own
    /// clip may cut these pixels off.
    pub includes_visible: bool,
    /// Map from the (u, v) of the unfiltered footprint to the splat's own (u, v).
    pub visible_turn: Turn<f64>,
    /// Map from the (u, v) of the filtered footprint to the splat's own (u, v).
    pub filtered_turn: Turn<f64>,
}

impl SplatClip {
    /// Creates the clip of splat `i` under a policy; `None` if the splat has no clip or the policy is
    /// [`ClipPolicy::Off`]. Both maps are identities, until a filter that turns half-axes sets them. `oriented` is true
    /// for a splat of an oriented cloud.
    pub(crate) fn new(cloud: &SplatCloud, i: usize, policy: ClipPolicy, oriented: bool) -> Option<Self> {
        let clips = cloud.data().clips.as_ref()?;
        let clip = clips.clip(i, policy)?;
        let paper = (policy == ClipPolicy::Paper).then(|| clips.curve(i)).flatten().map(|c| PaperCurve::new(&c));
        let own = Turn::none(1.0);
        Some(Self { clip, paper, includes_visible: oriented, visible_turn: own, filtered_turn: own })
    }

    /// True if the clip leaves a point in the splat's own (u, v) visible.
    fn keeps(&self, uv: V2<f64>) -> bool {
        match &self.paper {
            Some(curve) => curve.keeps(uv) && self.clip.lines_keep(uv),
            None => self.clip.keeps(uv),
        }
    }

    /// True if the clip leaves the pixel at offset `d` visible. `footprint` gives the pixel's (u, v), and `turn` maps
    /// it to the splat's own (u, v).
    pub(crate) fn keeps_at(&self, footprint: &Footprint<f64>, turn: &Turn<f64>, d: V2<f64>) -> bool {
        self.keeps(own_coordinates(footprint, turn, d))
    }

    /// True if the result of [`Self::keeps_at`] at offset `d` differs from that at one of 16 points around it,
    /// `reach_px` pixels away. Also true for 16 points around it in the splat's own (u, v), at the distance `reach_uv`.
    pub(crate) fn is_marginal_at(
        &self,
        footprint: &Footprint<f64>,
        turn: &Turn<f64>,
        d: V2<f64>,
        [reach_px, reach_uv]: [f64; 2],
    ) -> bool {
        let uv = own_coordinates(footprint, turn, d);
        let kept = self.keeps(uv);
        (0..16).any(|i| {
            let (sin, cos) = (f64::from(i) * std::f64::consts::FRAC_PI_8).sin_cos();
            let direction = V2::new(cos, sin);
            self.keeps(uv + direction * reach_uv) != kept
                || self.keeps_at(footprint, turn, d + direction * reach_px) != kept
        })
    }
}

/// Returns the splat's own (u, v) at the pixel offset `d` of a footprint. It is (0, 0) if the footprint's homogeneous
/// coordinate w is at most 0 there, which only occurs with the filter `clamp`.
fn own_coordinates(footprint: &Footprint<f64>, turn: &Turn<f64>, d: V2<f64>) -> V2<f64> {
    let (u, v, w) = footprint.at(d);
    if w > 0.0 { turn.apply(V2::new(u / w, v / w)) } else { V2::new(0.0, 0.0) }
}

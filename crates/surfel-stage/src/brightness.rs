//! Brightness statistics of loaded objects, from which the exposure of their materials and the background are derived.

use surfel_framing::patches::Patches;
use surfel_model::Shader;

/// Largest linear light that a white surface reflects in an automatic scene if its exposure is 1. The value includes
/// the highlight, and holds for coloured objects' material between key light and fill light.
const BRIGHTEST: f64 = 1.04;
/// Linear light to which the exposure reduces the brightest surfaces, so that they don't saturate and the shape of
/// white objects is visible.
const HEADROOM: f64 = 0.9;
/// Fraction of the surface, the brightest part of it, that counts as stray highlights. These are ignored when the
/// brightest colour is estimated.
const HIGHLIGHTS: f64 = 0.02;
/// Two limits for a grey background. The first is the smallest linear albedo, in every channel, of a white surface. The
/// second is the fraction of white surface above which the background is grey. Unlit white surfaces would blend into a
/// white background.
const WHITE: (f64, f64) = (0.75, 1.0 / 3.0);
/// Linear light of a grey background, perceptually halfway between black and white.
const GREY: f64 = 0.18;

/// Brightness statistics of objects.
#[derive(Debug)]
pub(crate) struct BrightnessStats {
    /// Largest linear albedo of the surfaces, over all colour channels and without stray highlights ([`HIGHLIGHTS`]).
    brightest: f64,
    /// Fraction of the surface that is white ([`WHITE`]). Surfaces without colours count as white.
    share: f64,
}

impl BrightnessStats {
    pub(crate) fn of(patches: Option<&Patches>) -> Self {
        let Some(patches) = patches else {
            return Self { brightest: 1.0, share: 0.0 };
        };
        let max = |c: [f32; 3]| c.into_iter().map(f64::from).fold(0.0, f64::max);
        let min = |c: [f32; 3]| c.into_iter().map(f64::from).fold(f64::INFINITY, f64::min);
        let white = patches.all.iter().filter(|p| min(p.color) >= WHITE.0).map(|p| p.area).sum::<f64>();
        let mut albedos: Vec<(f64, f64)> = patches.all.iter().map(|p| (max(p.color), p.area)).collect();
        albedos.sort_unstable_by(|a, b| b.0.total_cmp(&a.0));
        let mut left = HIGHLIGHTS * patches.area;
        let brightest = albedos.into_iter().find(|(_, area)| {
            left -= area;
            left < 0.0
        });
        Self { brightest: brightest.map_or(1.0, |(albedo, _)| albedo), share: white / patches.area }
    }

    /// Returns the exposure, at most 1: a factor on ambient, diffuse and specular light of coloured objects' materials.
    /// All objects share it, so that their colours remain comparable.
    pub(crate) fn exposure(&self) -> f64 {
        (HEADROOM / (BRIGHTEST * self.brightest.max(f64::MIN_POSITIVE))).min(1.0)
    }

    /// Returns the background for a shader, as linear RGBA: white, or grey for scenes with much white surface under
    /// `unlit` and `edl`. Lit white surfaces are darker at their outlines, which face away from the lights, and stand
    /// out against white. Unlit surfaces don't, and `edl` darkens only edges next to nearer surfaces.
    pub(crate) fn background(&self, shader: Shader) -> [f64; 4] {
        let grey = matches!(shader, Shader::Unlit | Shader::Edl) && self.share > WHITE.1;
        if grey { [GREY, GREY, GREY, 1.0] } else { [1.0; 4] }
    }
}

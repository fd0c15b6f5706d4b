//! Brightness of loaded objects, and the exposure and background that follow from it.

use surfel_framing::patches::Patches;
use surfel_load::LoadedObjects;
use surfel_model::Shader;

/// Largest linear light that a white surface of [`material`]'s factors reflects in an automatic scene, before exposure:
/// between key light and fill, including the highlight.
const BRIGHTEST: f64 = 1.04;
/// Linear light that exposure reduces the brightest surfaces to, so that white objects show their shape.
const HEADROOM: f64 = 0.9;
/// Fraction of the surface that counts as stray highlights and is ignored when estimating the brightest colour.
const HIGHLIGHTS: f64 = 0.02;
/// White surfaces: the linear albedo from which they blend into a white background, and the fraction of the surface
/// from which the background becomes grey.
const WHITE: (f64, f64) = (0.75, 1.0 / 3.0);
/// Linear grey, perceptually halfway between black and white.
const GREY: f64 = 0.18;

/// Brightness statistics of objects.
#[derive(Debug)]
pub(crate) struct Whites {
    /// Largest albedo of the coloured surfaces, in their largest channel and without stray highlights.
    brightest: f64,
    /// Fraction of all surface that is white; surfaces without colours are white.
    share: f64,
}

impl Whites {
    pub(crate) fn of(loaded: &LoadedObjects) -> Self {
        let Some(patches) = Patches::of(&loaded.objects) else {
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

    /// Returns the factor for the materials of coloured objects, at most 1. All objects share it, so that their colours
    /// stay comparable.
    pub(crate) fn exposure(&self) -> f64 {
        (HEADROOM / (BRIGHTEST * self.brightest.max(f64::MIN_POSITIVE))).min(1.0)
    }

    /// Returns the background for a shader. A lit white surface is darker than a white background along its outline,
    /// which faces away from the lights. Unlit surfaces aren't, and with `edl` only edges beside something nearer are.
    pub(crate) fn background(&self, shader: Shader) -> [f64; 4] {
        let grey = matches!(shader, Shader::Unlit | Shader::Edl) && self.share > WHITE.1;
        if grey { [GREY, GREY, GREY, 1.0] } else { [1.0; 4] }
    }
}

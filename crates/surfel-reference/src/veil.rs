//! Layers of transparent surfaces over a pixel, composited as they are found, front to back.

use crate::shade::Surface;
use glam::DVec3;

/// What transparent splats add to a pixel.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Veil {
    /// Colour of the layers, premultiplied.
    pub color: DVec3,
    /// Share of what lies behind that shows through.
    pub transmittance: f64,
    /// The nearest layer.
    pub nearest: Option<Surface>,
    /// Fragments that contributed.
    pub fragments: u32,
    /// A decision of this pixel is within its margin.
    pub marginal: bool,
}

impl Default for Veil {
    fn default() -> Self {
        Self { color: DVec3::ZERO, transmittance: 1.0, nearest: None, fragments: 0, marginal: false }
    }
}

impl Veil {
    /// Puts a surface of opacity `alpha` behind the layers there are: the same as blending back to front (Z01 eq. 12).
    pub(crate) fn add_behind(&mut self, surface: &Surface, alpha: f64) {
        self.add_premultiplied(surface, surface.color * alpha, alpha);
    }

    /// The same with a colour of its own, premultiplied.
    pub(crate) fn add_premultiplied(&mut self, surface: &Surface, color: DVec3, alpha: f64) {
        self.color += color * self.transmittance;
        self.transmittance *= 1.0 - alpha;
        self.nearest = self.nearest.or(Some(*surface));
        self.marginal |= surface.marginal;
    }

    /// A premultiplied colour seen through the layers.
    pub(crate) fn over(&self, [r, g, b, a]: [f64; 4]) -> [f64; 4] {
        let t = self.transmittance;
        let c = self.color + DVec3::new(r, g, b) * t;
        [c.x, c.y, c.z, 1.0 - t + a * t]
    }
}

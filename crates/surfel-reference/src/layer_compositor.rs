//! Compositing of transparent layers over a pixel, front to back in the order in which layers are found.

use crate::shade::Surface;
use glam::DVec3;

/// The transparent layers of a pixel, composited so far.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LayerCompositor {
    /// Colour of the layers, premultiplied.
    pub color: DVec3,
    /// Fraction of the background that shows through the layers.
    pub transmittance: f64,
    /// The nearest layer.
    pub nearest: Option<Surface>,
    /// Number of layers that aren't empty.
    pub count: u32,
    /// Number of fragments that were accumulated.
    pub fragments: u32,
    /// True if a decision of this pixel is within its margin.
    pub marginal: bool,
}

impl Default for LayerCompositor {
    fn default() -> Self {
        Self { color: DVec3::ZERO, transmittance: 1.0, nearest: None, count: 0, fragments: 0, marginal: false }
    }
}

impl LayerCompositor {
    /// Adds a surface of opacity `alpha` behind the layers so far, which equals blending back to front (Z01 eq. 12).
    pub(crate) fn add_behind(&mut self, surface: &Surface, alpha: f64) {
        self.count += 1;
        self.add_premultiplied(surface, surface.color * alpha, alpha);
    }

    /// Adds a surface of premultiplied `color` and opacity `alpha` behind the layers so far.
    pub(crate) fn add_premultiplied(&mut self, surface: &Surface, color: DVec3, alpha: f64) {
        self.color += color * self.transmittance;
        self.transmittance *= 1.0 - alpha;
        self.nearest = self.nearest.or(Some(*surface));
        self.marginal |= surface.marginal;
    }

    /// Composites the layers over a premultiplied colour.
    pub(crate) fn over(&self, [r, g, b, a]: [f64; 4]) -> [f64; 4] {
        let t = self.transmittance;
        let c = self.color + DVec3::new(r, g, b) * t;
        [c.x, c.y, c.z, 1.0 - t + a * t]
    }
}

//! Shader `edl` (eye-dome lighting, §5), which darkens a pixel the farther it is behind its neighbours.

use crate::shade::Surface;
use surfel_math::V2;
use surfel_math::eye_dome::{NEIGHBOURS, brightness, rise_weight};
use surfel_render::{Region, View};

/// Eye-dome lighting of a rectangle of pixels. Each entry of `depths` is the depth of a pixel's nearest surface (+∞
/// without one), and true if rounding could change it.
pub(crate) struct EyeDome<'a> {
    depths: Vec<(f64, bool)>,
    rect: Region,
    view: &'a View,
}

impl<'a> EyeDome<'a> {
    pub(crate) fn new(pixels: &[(Option<Surface>, bool)], rect: Region, view: &'a View) -> Self {
        let depths = pixels.iter().map(|p| (p.0.map_or(f64::INFINITY, |s| s.depth), p.1)).collect();
        Self { depths, rect, view }
    }

    /// Returns the brightness factor of a surface at depth `z` in pixel `at`, and true if rounding could change it.
    pub(crate) fn brightness(&self, at: usize, z: f64) -> (f64, bool) {
        let (width, height) = (self.rect.width as usize, self.rect.height as usize);
        let (mut rise, mut marginal) = (0.0, false);
        for [dx, dy] in NEIGHBOURS {
            let column = (at % width).checked_add_signed(dx as isize).filter(|x| *x < width);
            let row = (at / width).checked_add_signed(dy as isize).filter(|y| *y < height);
            let (Some(x), Some(y)) = (column, row) else { continue };
            let (depth, open) = self.depths[y * width + x];
            let weight = rise_weight(V2::new(f64::from(dx), f64::from(dy)), &self.view.projection);
            rise += weight * (z - depth).max(0.0);
            marginal |= open;
        }
        (brightness(z, rise, &self.view.projection), marginal)
    }
}

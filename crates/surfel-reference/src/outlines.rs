//! Outlines of the shader `toon`, drawn at depth steps (rendering model §5).

use crate::shade::Surface;
use crate::{margin, pixels};
use glam::DVec3;
use surfel_math::depth::plane_gradient;
use surfel_math::toon::step_back_limit;
use surfel_math::{V2, V3};
use surfel_render::{Region, View};

/// Nearest surfaces of a rectangle of pixels, between which outlines are detected. Each entry of `depths` is the depth
/// of a pixel's surface (+∞ without one), and true if rounding could change it.
pub(crate) struct Outlines<'a> {
    depths: Vec<(f64, bool)>,
    rect: Region,
    view: &'a View,
}

impl<'a> Outlines<'a> {
    pub(crate) fn new(pixels: &[(Option<Surface>, bool)], rect: Region, view: &'a View) -> Self {
        let depths = pixels.iter().map(|p| (p.0.map_or(f64::INFINITY, |s| s.depth), p.1)).collect();
        Self { depths, rect, view }
    }

    /// True if a surface at position `place` in pixel `at` is part of an outline, because a neighbour's surface is
    /// farther back or absent. The second value is true if rounding could change the first.
    pub(crate) fn has(&self, at: usize, surface: &Surface, place: V2<f64>) -> (bool, bool) {
        let limit = limit(surface, place, self.view);
        let (mut line, mut sure, mut open) = (false, false, false);
        for (depth, other_marginal) in pixels::neighbours(self.rect, at).map(|neighbour| self.depths[neighbour]) {
            let near = other_marginal || margin::on_depth(limit, depth);
            line |= depth > limit;
            sure |= depth > limit && !near;
            open |= near;
        }
        // A neighbour with a certain result decides, even if others are uncertain.
        (line, open && !sure)
    }

    /// Returns the surface, black if it is part of an outline. The second value is true if rounding could change the
    /// result.
    pub(crate) fn draw(&self, at: usize, surface: Surface, place: V2<f64>) -> (Surface, bool) {
        let (line, open) = self.has(at, &surface, place);
        (Surface { color: if line { DVec3::ZERO } else { surface.color }, ..surface }, open)
    }
}

/// Returns the depth beyond which a neighbouring pixel's surface makes this surface part of an outline.
fn limit(surface: &Surface, pixel: V2<f64>, view: &View) -> f64 {
    let projection = &view.projection;
    let (origin, direction) = projection.ray(pixel);
    let normal = V3::from(view.view_from_world * surface.normal);
    let gradient = match surface.normal == DVec3::ZERO {
        true => V2::new(0.0, 0.0),
        false => plane_gradient(origin + direction * surface.depth, normal, projection),
    };
    step_back_limit(surface.depth, gradient, projection)
}

//! Lines of the shader `toon` where depth steps back (§5).

use crate::margin;
use crate::shade::Surface;
use glam::DVec3;
use surfel_math::depth::plane_gradient;
use surfel_math::toon::step_back_limit;
use surfel_math::{V2, V3};
use surfel_render::{Region, View};

/// Blackens every pixel of `rect` beside which another surface, or nothing, lies farther back.
pub(crate) fn draw(pixels: &mut [(Option<Surface>, bool)], rect: Region, view: &View) {
    let depths: Vec<(f64, bool)> = pixels.iter().map(|p| (p.0.map_or(f64::INFINITY, |s| s.depth), p.1)).collect();
    let (width, height) = (rect.width as usize, rect.height as usize);
    for (at, (surface, marginal)) in pixels.iter_mut().enumerate() {
        let Some(surface) = surface else { continue };
        let (x, y) = (at % width, at / width);
        let limit = limit(surface, crate::frame::center(rect, at), view);
        let columns = x.saturating_sub(1)..=(x + 1).min(width - 1);
        let neighbours = (y.saturating_sub(1)..=(y + 1).min(height - 1))
            .flat_map(|ny| columns.clone().map(move |nx| ny * width + nx))
            .map(|neighbour| depths[neighbour]);
        let (mut line, mut sure, mut open) = (false, false, false);
        for (depth, other_marginal) in neighbours {
            let near = other_marginal || margin::on_depth(limit, depth);
            line |= depth > limit;
            sure |= depth > limit && !near;
            open |= near;
        }
        // Another neighbour may decide what rounding leaves open.
        *marginal |= open && !sure;
        if line {
            surface.color = DVec3::ZERO;
        }
    }
}

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

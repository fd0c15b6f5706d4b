//! Shader `matcap` (rendering model §5), which samples an image of a lit sphere by the normal.

use glam::DVec3;
use surfel_math::V3;
use surfel_math::matcap::coordinates;
use surfel_model::Matcap;
use surfel_render::View;

/// Returns the matcap's colour for a world-space normal; `to_eye` is the unit direction to the eye in view space.
pub(crate) fn color(matcap: &Matcap, normal: DVec3, to_eye: DVec3, view: &View) -> DVec3 {
    let at = coordinates(V3::from(view.view_from_world * normal), V3::from(to_eye), V3::new(0.0, 1.0, 0.0));
    let [width, height] = matcap.size().map(f64::from);
    // The sphere's outline coincides with the centres of the outermost texels.
    let texel = |c: f64, side: f64| ((c + 1.0) * 0.5 * (side - 1.0)).clamp(0.0, side - 1.0);
    let (x, y) = (texel(at.x, width), texel(at.y, height));
    let fetch = |column: f64, row: f64| {
        let i = row.min(height - 1.0) * width + column.min(width - 1.0);
        matcap.texels().get(i as usize).map_or(DVec3::ZERO, |t| glam::Vec3::from(*t).as_dvec3())
    };
    let (x0, y0) = (x.floor(), y.floor());
    let row = |row: f64| fetch(x0, row).lerp(fetch(x0 + 1.0, row), x - x0);
    row(y0).lerp(row(y0 + 1.0), y - y0)
}

//! Culling of chunks against a region's frustum and the near plane.

use crate::frame::object_transform::ObjectTransform;
use crate::scene::chunk::Chunk;
use glam::DVec3;
use surfel_math::projection::ProjectionKind;
use surfel_model::Filter;
use surfel_render::{FramePlan, Region, View};

/// True if no splat of the chunk can touch the region. `center` is the chunk's origin in view space.
pub(crate) fn is_outside(
    chunk: &Chunk,
    center: DVec3,
    transform: &ObjectTransform,
    region: Region,
    view: &View,
    plan: &FramePlan,
) -> bool {
    let bounding_radius = chunk.bounding_radius * transform.stretch;
    let projection = &view.projection;
    if center.z + bounding_radius < projection.near || center.z - bounding_radius > projection.far() {
        return true;
    }
    // If the bounding sphere contains the eye, it intersects every side of the frustum.
    if projection.is_perspective() && center.z < 4.0 * bounding_radius {
        return false;
    }
    // An affine footprint exceeds the splat's exact outline by less than half of the outline's distance from the centre
    // (p_z/z < 3/2 on its far side). Three times the bounding radius is a safe bound.
    let affine = !plan.splat_filter.projective || plan.splat_filter.filter == Filter::Ewa;
    let bounding_radius = if affine && projection.is_perspective() { 3.0 * bounding_radius } else { bounding_radius };
    let margin = plan.splat_filter.reach_px();
    let side = |limit: f64, axis: usize, sign: f64| {
        let f = projection.focal_px[axis];
        let slope = (limit - projection.principal_px[axis]) / f;
        let along = if axis == 0 { center.x } else { center.y };
        match projection.kind {
            // Signed distance beyond the plane through the eye and the image's side.
            ProjectionKind::Perspective => sign * (along - slope * center.z) > bounding_radius * slope.hypot(1.0),
            ProjectionKind::Orthographic { .. } => sign * (along - slope) > bounding_radius,
        }
    };
    let span = |start: u32, length: u32| {
        let (start, length) = (f64::from(start), f64::from(length));
        (start - margin, start + length + margin)
    };
    let (left, right) = span(region.x, region.width);
    let (top, bottom) = span(region.y, region.height);
    side(left, 0, -1.0) || side(right, 0, 1.0) || side(top, 1, -1.0) || side(bottom, 1, 1.0)
}

/// True if the chunk may contain a near splat: one whose centre is nearer than the near plane or, in perspective, whose
/// radius exceeds half of its depth. The CPU sets up near splats in f64 (rendering model §3, "Near splats"). The test
/// is conservative.
pub(crate) fn may_reach_near(chunk: &Chunk, center: DVec3, transform: &ObjectTransform, view: &View) -> bool {
    let nearest = center.z - chunk.bounding_radius * transform.stretch;
    let widest = 2.0 * chunk.largest_radius * transform.stretch;
    nearest < view.projection.near || (view.projection.is_perspective() && nearest < widest)
}

//! Culling of chunks against a region's frustum, by their normals, and against the near plane.

use crate::frame::object_transform::ObjectTransform;
use crate::scene::chunk::Chunk;
use glam::DVec3;
use surfel_math::projection::ProjectionKind;
use surfel_model::Filter;
use surfel_render::{FramePlan, Region, View};

/// Part of a view that a region of pixels shows, with a margin for the filter.
pub(crate) struct RegionFrustum {
    /// Smallest and largest planar depth that is drawn, in world units.
    depths: [f64; 2],
    /// True for a perspective projection, false for an orthographic one.
    is_perspective: bool,
    /// Upper bound of the ratio of a drawn footprint's extent to the radius of its splat's bounding sphere.
    extent_ratio: f64,
    /// Left, right, upper and lower side of the frustum.
    sides: [Side; 4],
}

/// Side of a frustum: in perspective a plane through the eye, otherwise a plane along the viewing direction.
struct Side {
    /// Axis that the side limits: 0 is x, 1 is y.
    axis: usize,
    /// 1 for an upper limit of the coordinate, −1 for a lower one.
    sign: f64,
    /// Limit of the coordinate, x or y in view space, at depth 1 (in an orthographic view, at every depth).
    slope: f64,
    /// Length of the normal (1, slope) of a plane through the eye; otherwise 1.
    length: f64,
}

impl RegionFrustum {
    pub(crate) fn new(region: Region, view: &View, plan: &FramePlan) -> Self {
        let projection = &view.projection;
        let is_perspective = projection.is_perspective();
        // An affine footprint exceeds the splat's exact outline by less than half of the outline's distance from the
        // centre (p_z/z < 3/2 on its far side). Three times the bounding radius is a safe bound.
        let affine = !plan.splat_filter.projective || plan.splat_filter.filter == Filter::Ewa;
        let extent_ratio = if affine && is_perspective { 3.0 } else { 1.0 };
        let margin = plan.splat_filter.reach_px();
        let side = |limit_px: f64, axis: usize, sign: f64| {
            let slope = (limit_px - projection.principal_px[axis]) / projection.focal_px[axis];
            Side { axis, sign, slope, length: if is_perspective { slope.hypot(1.0) } else { 1.0 } }
        };
        let start = |at: u32| f64::from(at) - margin;
        let end = |at: u32, length: u32| f64::from(at) + f64::from(length) + margin;
        let sides = [
            side(start(region.x), 0, -1.0),
            side(end(region.x, region.width), 0, 1.0),
            side(start(region.y), 1, -1.0),
            side(end(region.y, region.height), 1, 1.0),
        ];
        Self { depths: [projection.near, projection.far()], is_perspective, extent_ratio, sides }
    }

    /// True if no splat inside a sphere can touch the region. The sphere's centre is in view space, and its radius in
    /// world units.
    pub(crate) fn is_outside(&self, center: DVec3, bounding_radius: f64) -> bool {
        let [near, far] = self.depths;
        if center.z + bounding_radius < near || center.z - bounding_radius > far {
            return true;
        }
        // A sphere that contains the eye intersects every side of the frustum. Spheres as near as this are never culled
        // by sides.
        if self.is_perspective && center.z < 4.0 * bounding_radius {
            return false;
        }
        let depth = if self.is_perspective { center.z } else { 1.0 };
        let reach = self.extent_ratio * bounding_radius;
        let is_beyond = |Side { axis, sign, slope, length }: &Side| {
            let along = if *axis == 0 { center.x } else { center.y };
            sign * (along - slope * depth) > reach * length
        };
        self.sides.iter().any(is_beyond)
    }
}

/// True if every splat of the chunk is surely back-facing, by the cone of its normals. False if the chunk has no cone
/// or, in perspective, if its bounding sphere contains the eye.
pub(crate) fn is_back_facing(chunk: &Chunk, transform: &ObjectTransform, view: &View) -> bool {
    let Some(cone) = &chunk.cone else { return false };
    match view.projection.kind {
        ProjectionKind::Orthographic { .. } => cone.is_back_facing(transform.eye_in_object, 0.0),
        ProjectionKind::Perspective => {
            let ray = chunk.space.origin - transform.eye_in_object;
            let distance = ray.length();
            distance > chunk.bounding_radius && cone.is_back_facing(ray / distance, chunk.bounding_radius / distance)
        }
    }
}

/// True if the chunk may contain a splat that reaches the near plane: one whose centre is nearer than the near plane
/// or, in perspective, whose depth range is at least its centre's depth. The CPU sets up such splats in f64 (rendering
/// model §3, "Near splats"). `center` is the view position of the chunk's origin. The chunk's bounds are tested in
/// place of its splats, so the result may be true for a chunk without such a splat.
pub(crate) fn may_reach_near(chunk: &Chunk, center: DVec3, transform: &ObjectTransform, view: &View) -> bool {
    let nearest = center.z - chunk.bounding_radius * transform.stretch;
    let widest = 2.0 * chunk.largest_radius * transform.stretch;
    nearest < view.projection.near || (view.projection.is_perspective() && nearest < widest)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::UNSUPPORTED;
    use glam::DAffine3;
    use surfel_model::{Camera, Projection, Settings, SplatCloud, Storage, chunks};
    use surfel_render::{Capabilities, Planes, SceneSummary, plan};

    const SIZE: [u32; 2] = [64, 48];

    fn views() -> Vec<View> {
        let camera = |projection| Camera {
            eye: [0.0; 3],
            target: [0.0, 0.0, -1.0],
            up: [0.0, 1.0, 0.0],
            projection,
            near: 0.1,
            far: Some(20.0),
            size: SIZE,
        };
        let projections = [Projection::Perspective { fov_y_deg: 45.0 }, Projection::Orthographic { height: 6.0 }];
        projections.into_iter().map(|projection| View::new(&camera(projection)).unwrap()).collect()
    }

    fn planned(view: &View) -> FramePlan {
        let capabilities = Capabilities { backend: "test", lacks: UNSUPPORTED };
        plan(&SceneSummary::default(), view, &Settings::default(), Planes::COLOR, &capabilities).unwrap()
    }

    /// Returns a generator of pseudo-random numbers from −1 to 1.
    fn numbers() -> impl FnMut() -> f64 {
        let mut state = 7u64;
        move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        }
    }

    #[test]
    fn spheres_outside_contain_no_visible_point() {
        let mut next = numbers();
        for view in views() {
            let region = Region { x: 8, y: 4, width: 40, height: 30 };
            let frustum = RegionFrustum::new(region, &view, &planned(&view));
            let (mut outside, mut inside) = (0, 0);
            for _ in 0..4000 {
                let center = DVec3::new(8.0 * next(), 8.0 * next(), 12.0 + 14.0 * next());
                let radius = 2.0 * next().abs();
                let is_outside = frustum.is_outside(center, radius);
                for _ in 0..20 {
                    let p = center + radius * DVec3::new(next(), next(), next()).clamp_length_max(1.0);
                    if p.z < 0.1 || p.z > 20.0 {
                        continue;
                    }
                    let pixel = view.projection.pixel(p.into());
                    let is_in = (8.0..48.0).contains(&pixel.x) && (4.0..34.0).contains(&pixel.y);
                    assert!(!(is_outside && is_in), "{center} {radius} {p}");
                }
                outside += usize::from(is_outside);
                inside += usize::from(!is_outside);
            }
            assert!(outside > 500 && inside > 500, "{outside} {inside}");
        }
    }

    /// Culls chunks of a sphere that is stretched, rotated and moved: none that has a front-facing splat, and at least
    /// a fifth of all.
    #[test]
    fn culled_chunks_have_no_front_facing_splat() {
        let golden = std::f64::consts::PI * (3.0 - 5.0f64.sqrt());
        let directions: Vec<[f32; 3]> = (0..20_000)
            .map(|i| {
                let z = 1.0 - (2.0 * f64::from(i) + 1.0) / 20_000.0;
                let (sin, cos) = (golden * f64::from(i)).sin_cos();
                let across = (1.0 - z * z).sqrt();
                [across * cos, across * sin, z].map(|v| v as f32)
            })
            .collect();
        let cloud = SplatCloud::disks(&directions, &directions, &[0.01; 20_000]).unwrap();
        let order = cloud.morton_order();
        let place = DAffine3::from_translation(DVec3::new(0.3, -0.2, -6.0))
            * DAffine3::from_rotation_y(0.7)
            * DAffine3::from_scale(DVec3::new(-1.0, 0.6, 1.4));
        for view in views() {
            let transform = ObjectTransform::new(&place, &view);
            let (mut culled, mut all) = (0, 0);
            for (space, members) in chunks(&cloud, &order, Storage::F32) {
                let chunk = Chunk::new(&cloud, members, space, 0);
                let is_front = |&i: &u32| {
                    let (p, n) = (transform.point(cloud.center(i as usize)), cloud.normal(i as usize));
                    let n = view.view_from_world * (transform.normals * n);
                    (if view.projection.is_perspective() { n.dot(p) } else { n.z }) < 0.0
                };
                all += 1;
                if is_back_facing(&chunk, &transform, &view) {
                    culled += 1;
                    assert!(!members.iter().any(is_front));
                }
            }
            assert!(5 * culled > all, "{culled} of {all}");
        }
    }
}

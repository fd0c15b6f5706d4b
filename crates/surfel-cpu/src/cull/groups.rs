//! Which groups of a chunk's splats a region may see: all sixteen are tested at once.

use crate::cull::object::{ObjectView, RegionSides};
use crate::scene::cloud::Chunk;
use crate::scene::groups::Groups;
use crate::simd::lanes::{LANES, Lanes};
use crate::simd::math::{Bits, transform};
use fearless_simd::{Simd, mask32x16};
use glam::DVec3;
use surfel_math::{Real, V3};
use surfel_model::Cull;

/// Groups that may be seen, as bits, given the chunk's centre in view space.
#[inline(always)]
pub(crate) fn visible<S: Simd>(
    simd: S,
    groups: &Groups,
    view: &ObjectView<'_>,
    chunk: &Chunk,
    center: DVec3,
    sides: &RegionSides,
) -> u64 {
    let k = |v: f64| Lanes::splat(simd, v as f32);
    let group = groups.decode(simd, chunk);
    let p = transform(&view.linear.as_mat3(), group.center) + V3::new(k(center.x), k(center.y), k(center.z));
    let mut culled = beyond(sides, &p, group.radius);
    if view.material.cull == Cull::Back {
        // As `ObjectView::is_back_facing`, with cosines taken for 1.
        let eye = view.eye_in_object;
        let back_facing = if view.view.projection.is_perspective() {
            let ray = chunk.space.origin - eye;
            let ray = group.center + V3::new(k(ray.x), k(ray.y), k(ray.z));
            group.sine.mul_add(ray.length(), group.radius).lt(group.axis.dot(ray))
        } else {
            group.sine.lt(group.axis.dot(V3::new(k(eye.x), k(eye.y), k(eye.z))))
        };
        culled |= back_facing;
    }
    !culled.bits() & (u64::MAX >> (64 - chunk.count.div_ceil(LANES)))
}

/// Which of sixteen spheres lie beyond a region's sides, given in view space and in the object's lengths.
#[inline(always)]
fn beyond<S: Simd>(sides: &RegionSides, p: &V3<Lanes<S>>, radius: Lanes<S>) -> mask32x16<S> {
    let k = |v: f64| radius.constant(v);
    let radius = radius * k(sides.reach);
    let depth = if sides.perspective { p.z } else { radius.one() };
    let [[left, right], [top, bottom]] = sides.slopes;
    let [[left_length, right_length], [top_length, bottom_length]] = sides.lengths;
    let beyond = (radius * k(left_length)).lt(depth * k(left) - p.x)
        | (radius * k(right_length)).lt(p.x - depth * k(right))
        | (radius * k(top_length)).lt(depth * k(top) - p.y)
        | (radius * k(bottom_length)).lt(p.y - depth * k(bottom));
    if sides.perspective { beyond & (radius * k(4.0)).le(p.z) } else { beyond }
}

//! Visibility test of a chunk's groups of splats for a region, sixteen groups at a time.
//!
//! A *block* is 4×4 pixels ([`BLOCK`](crate::tiles::grid::BLOCK)).

use crate::cull::object::{ObjectView, RegionSides, pixels_of_box};
use crate::scene::cloud::Chunk;
use crate::scene::groups::Groups;
use crate::simd::compress::ones;
use crate::simd::lanes::{LANES, Lanes};
use crate::simd::math::{Bits, transform};
use crate::tiles::drawn::{BlockSet, DrawnBlocks};
use fearless_simd::{Simd, mask32x16};
use glam::DVec3;
use surfel_math::{Real, V3};
use surfel_model::Cull;

/// Returns the groups (of 16 splats) of a chunk that may be visible in a region, one bit per group. `center` is the
/// chunk's origin in view space, and `sides` are the region's side planes. Groups that touch none of the `drawn` blocks
/// are excluded.
#[inline(always)]
pub(crate) fn visible<S: Simd>(
    simd: S,
    groups: &Groups,
    view: &ObjectView<'_>,
    chunk: &Chunk,
    center: DVec3,
    sides: &RegionSides,
    drawn: DrawnBlocks<'_>,
) -> u64 {
    let k = |v: f64| Lanes::splat(simd, v as f32);
    let group = groups.decode(simd, chunk);
    let p = transform(&view.linear.as_mat3(), group.center) + V3::new(k(center.x), k(center.y), k(center.z));
    let mut culled = beyond(sides, &p, group.radius);
    if view.material.cull == Cull::Back {
        // The same test as `ObjectView::is_back_facing`, with cosines rounded up to 1.
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
    let visible = !culled.bits() & (u64::MAX >> (64 - chunk.count.div_ceil(LANES)));
    match drawn.set() {
        Some(set) => touching(set, view, &p, group.radius * k(sides.reach), visible),
        None => visible,
    }
}

/// Returns the groups that may touch a block of `set`, one bit per group. `p` and `radius` are the groups' bounding
/// spheres in view space, and `groups` the bits of the groups to test.
#[inline(never)]
fn touching<S: Simd>(set: &BlockSet, view: &ObjectView<'_>, p: &V3<Lanes<S>>, radius: Lanes<S>, groups: u64) -> u64 {
    let [x, y, z, radius] = [p.x, p.y, p.z, radius].map(Lanes::to_array);
    let margin = view.plan.splat_filter.reach_px();
    let mut touching = 0;
    for i in ones(groups) {
        let center = DVec3::new(x[i].into(), y[i].into(), z[i].into());
        // The slack is far above the rounding of the f32 lanes.
        let half = DVec3::splat(f64::from(radius[i]) * (1.0 + 1e-5) + 1e-6 * center.length());
        let pixels = pixels_of_box(&view.view.projection, center, half, margin);
        touching |= u64::from(set.touches(pixels)) << i;
    }
    touching
}

/// Returns a mask of the bounding spheres that are outside a region's side planes. In perspective, a sphere never
/// counts as outside if its radius times `sides.reach` is more than a quarter of its centre's depth. Centres `p` are in
/// view space, radii in the object's units.
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

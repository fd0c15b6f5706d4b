//! Near splats (rendering model §3, "Near splats"), which are mapped exactly, without filter, in f64. The centre of a
//! near splat is nearer than z_near, or its disk's depth extent is at least half of its depth (in perspective only), or
//! it is vast ([`is_vast`](surfel_math::project::is_vast)).
//!
//! A *record* is a splat projected to the screen ([`Record`]).

use crate::cull::object::ObjectView;
use crate::scene::cloud::{Chunk, StoredShape};
use crate::setup::mask::MaskForm;
use crate::setup::project::SetupOutput;
use crate::setup::record::{BlockBox, Facing, Record};
use crate::simd::lanes::{LANES, Lanes};
use crate::tiles::grid::{BLOCK, Rect};
use fearless_simd::Simd;
use glam::DVec3;
use surfel_math::V3;
use surfel_math::clip::{Clip, Turn};
use surfel_math::depth::{DepthForm, DepthPlane, tolerance};
use surfel_math::facing::back_normal;
use surfel_math::mapping::{Footprint, through_near};
use surfel_math::project::{EDGE_ON, Placement, Projected, ViewSplat, radius_max};
use surfel_math::{V2, bounds};
use surfel_model::Cull;
use surfel_render::View;

/// A near splat (see the module) projected to the screen in f64, by the exact mapping and without a filter.
pub(crate) struct NearSplat {
    anchor: V2<f64>,
    footprint: Footprint<f64>,
    depth: DepthPlane<f64>,
    depth_form: DepthForm,
    limits: [f64; 2],
    pub epsilon: f32,
    pub color: [f32; 3],
    pub normal: [f32; 3],
    pub object: u32,
    facing: Facing,
    clip: Option<Clip<f64>>,
}

impl NearSplat {
    /// Projects a splat, and returns it with its box of pixels, clipped to `place`: first column, first row, end
    /// column, end row. `None` if the splat is edge-on, culled as back-facing, outside the range of depths, or dropped
    /// by the affine mapping, or if it touches no pixel of `place`.
    pub(crate) fn new(
        splat: &ViewSplat<f64>,
        shading: DVec3,
        color: DVec3,
        object: &ObjectView<'_>,
        (view, place): (&View, Rect),
    ) -> Option<(Self, [i32; 4])> {
        let (plan, material) = (object.plan, &object.material);
        let projection = &view.projection;
        let perspective = projection.is_perspective();
        let (p, n) = (splat.p, splat.n);
        let facing = if perspective { n.dot(p) } else { n.z };
        let cosine = if perspective { facing / p.length() } else { facing };
        let back_facing = facing >= 0.0;
        let extent = splat.s.z.hypot(splat.t.z);
        let placement = Placement::of(p.z, extent, projection);
        let dropped = placement == Placement::CenterBeforeNear && plan.splat_filter.drop_before_near;
        // A centre at the eye itself has no cosine (NaN), and is edge-on like any plane through the eye.
        let edge_on = cosine.is_nan() || cosine.abs() <= EDGE_ON;
        if edge_on || dropped || placement == Placement::Outside || (back_facing && material.cull == Cull::Back) {
            return None;
        }
        let (z_min, z_max) = (p.z - extent, p.z + extent);
        let (anchor, footprint, depth, depth_form, extent_px) = if perspective {
            let mapped = through_near(splat, projection);
            let w = mapped.footprint.w;
            let gradient = V2::new(w.x, w.y);
            let depth = DepthPlane { scale: mapped.depth_scale, gradient, at_anchor: w.c, z_min, z_max };
            let extent_px = bounds::through_near(splat, projection)?;
            (mapped.anchor_px, mapped.footprint, depth, DepthForm::Reciprocal, extent_px)
        } else {
            let projected = Projected::new(splat, projection);
            let anchor = projection.pixel(p);
            let depth = DepthPlane { scale: p.z, gradient: projected.depth_gradient, at_anchor: 1.0, z_min, z_max };
            let e = bounds::unfiltered(&projected, false);
            let extent_px = bounds::Extent { min: e.min + anchor, max: e.max + anchor };
            (anchor, Footprint::unfiltered(&projected, false), depth, DepthForm::Linear, extent_px)
        };
        let range = |min: f64, max: f64, start: i32, end: i32| {
            let (lo, hi) = (f64::from(start), f64::from(end));
            let slack = 1e-6;
            [(min - 0.5 - slack).ceil().clamp(lo, hi) as i32, ((max + 0.5 + slack).floor()).clamp(lo, hi) as i32]
        };
        let columns = range(extent_px.min.x, extent_px.max.x, place.x, place.end_x);
        let rows = range(extent_px.min.y, extent_px.max.y, place.y, place.end_y);
        if columns[0] >= columns[1] || rows[0] >= rows[1] {
            return None;
        }
        let epsilon = tolerance(splat, radius_max(splat.s, splat.t), 0.0, plan.splat_filter.tolerance, projection);
        let normal = match (back_facing && material.two_sided, object.object.oriented) {
            (false, _) => shading,
            (true, false) => -shading,
            (true, true) => {
                let to_eye = if perspective { -DVec3::new(p.x, p.y, p.z) / p.length() } else { DVec3::NEG_Z };
                let to_eye = V3::from(view.view_from_world.transpose() * to_eye);
                let V3 { x, y, z } = back_normal(V3::from(shading), cosine, to_eye);
                DVec3::new(x, y, z)
            }
        };
        let near = Self {
            anchor,
            footprint,
            depth,
            depth_form,
            limits: [projection.near, projection.far()],
            epsilon: epsilon as f32,
            color: color.as_vec3().to_array(),
            normal: normal.as_vec3().to_array(),
            object: object.index,
            facing: if object.keeps_facings() { Facing::of(back_facing) } else { Facing::Undeclared },
            clip: None,
        };
        Some((near, [columns[0], rows[0], columns[1], rows[1]]))
    }

    /// Returns the record that represents the splat in the tiles' lists; `index` is the splat's index among the near
    /// splats.
    pub(crate) fn record(&self, index: usize) -> Record {
        let index = self.facing.with_object(index as u32);
        Record::near(index, self.limits[0] as f32 * (1.0 - 1e-6), self.color, self.normal, self.epsilon)
    }

    /// Returns ρ² = u² + v² and the depth, in world units, at the centre of a pixel. `None` if the pixel is outside the
    /// clipped footprint, or the depth isn't between z_near and z_far.
    pub(crate) fn hit(&self, x: i32, y: i32) -> Option<(f32, f32)> {
        let d = V2::new(f64::from(x) + 0.5, f64::from(y) + 0.5) - self.anchor;
        let (u, v, w) = self.footprint.at(d);
        let square = u.mul_add(u, v * v);
        if !(w > 0.0 && square <= w * w) || self.clip.is_some_and(|clip| !clip.keeps(d)) {
            return None;
        }
        let z = self.depth.at(d, self.depth_form);
        (z >= self.limits[0] && z <= self.limits[1]).then_some(((square / (w * w)) as f32, z as f32))
    }
}

impl ObjectView<'_> {
    /// Sets up the near splats of a group, one by one in f64. `bits` has their bits, and `at` is the slot of the
    /// group's first splat.
    #[cold]
    pub(crate) fn push_near<S: Simd>(
        &self,
        simd: S,
        chunk: &Chunk,
        at: usize,
        mut bits: u64,
        out: &mut SetupOutput<'_>,
    ) {
        while bits != 0 {
            let i = at + bits.trailing_zeros() as usize;
            bits &= bits - 1;
            // The same values as in lanes; slots of a chunk begin at whole lanes.
            let (lanes, lane) = (i - i % LANES, i % LANES);
            let get = |v: V3<Lanes<S>>| DVec3::from([v.x, v.y, v.z].map(|c| f64::from(c.to_array()[lane])));
            let scales = &chunk.space;
            let object = self.object;
            let p =
                self.origin + self.linear * (chunk.space.origin + get(object.centers.load(simd, lanes, scales.center)));
            let (s, t, n) = match &object.shape {
                StoredShape::Disks { normals, radii } => {
                    let n = get(normals.load(simd, lanes));
                    let (s, t) = surfel_math::basis::orthonormal(n);
                    let r = f64::from(radii.load(simd, lanes, scales.radius).to_array()[lane]);
                    (s * r, t * r, n)
                }
                StoredShape::Ellipses { s, t } => {
                    let (s, t) = (get(s.load(simd, lanes, 1.0)), get(t.load(simd, lanes, 1.0)));
                    (s, t, surfel_math::basis::unit(s).cross(surfel_math::basis::unit(t)))
                }
            };
            let unit = surfel_math::basis::unit;
            let world_normal = unit(self.normals * n);
            let view_normal = self.view.view_from_world * world_normal;
            let splat = ViewSplat {
                p: V3::from(p),
                s: V3::from(self.linear * s),
                t: V3::from(self.linear * t),
                n: V3::from(view_normal),
            };
            let shading =
                object.shading_normals.as_ref().map_or(world_normal, |c| unit(self.normals * get(c.load(simd, lanes))));
            let color = object.colors.as_ref().map_or(DVec3::ONE, |c| get(c.load(simd, lanes, scales.color)));
            let (view, part) = (Rect::of(self.view.region), Rect::of(out.grid.region));
            let place = (self.view, view.with(&part));
            let near = NearSplat::new(&splat, shading, color, self, place);
            let Some((mut near, pixels)) = near else { continue };
            near.object = self.first_number.map_or(near.object, |first| first + i as u32);
            if self.keeps_facings() {
                out.segment.largest_epsilon = out.segment.largest_epsilon.max(near.epsilon);
            }
            let [x0, y0, x1, y1] = pixels;
            // A cell counts the splats whose first pixel, clamped to the view, is in the cell.
            let (x, y) = (x0.min(view.end_x - 1).max(view.x), y0.min(view.end_y - 1).max(view.y));
            out.segment.drawn += u64::from(Rect::of(out.counted).has(x, y));
            let (x0, y0, x1, y1) = (x0.max(part.x), y0.max(part.y), x1.min(part.end_x), y1.min(part.end_y));
            if x0 < x1 && y0 < y1 {
                // Without filter or turn, the footprint's (u, v) are the splat's own.
                let clip = object.clips.as_ref().and_then(|clips| clips.get(i, self.plan.clip));
                near.clip = clip.map(|clip| clip.whole().through(&near.footprint, &Turn::none(1.0)));
                let [x, y] = out.grid.origin.map(|v| v as i32);
                let block = |v: i32| (v / BLOCK as i32) as u32;
                let past = BLOCK as i32 - 1;
                let blocks = BlockBox([block(x0 - x), block(y0 - y), block(x1 - x + past), block(y1 - y + past)]);
                let form = MaskForm { drawn: out.drawn, linear_depth: false, whole_box: true };
                let mut out = out.part(self.transparent(i, || p.as_vec3().to_array()));
                out.push_box(simd, &near.record(out.segment.near.len()), blocks, form);
                out.segment.near.push(near);
            }
        }
    }
}

//! Setup in f64 of splats that reach the near plane. These are splats whose centre is nearer than the near plane,
//! splats in perspective whose depth range is at least their centre's depth, and splats more than 10⁷ times as large as
//! their distance from the eye (orthographic: as the height of the view). They are drawn with the exact mapping and
//! without a filter (rendering model §3, "Near splats"), from records that the CPU uploads. A *record* is a splat as
//! set up for a tile: its projected forms, pixel boxes and colour in a buffer.

use crate::frame::object_transform::ObjectTransform;
use crate::frame::pixel_range::pixel_range;
use crate::passes::pass_list::is_of_shadow_map;
use crate::scene::clip::{Variant, clip_words};
use crate::scene::segment::UploadedObject;
use crate::struct_writer::StructWriter;
use glam::{DVec2, DVec3};
use surfel_math::basis::unit;
use surfel_math::bounds::{self, Extent};
use surfel_math::clip::{Clip, Turn};
use surfel_math::depth::tolerance;
use surfel_math::facing::back_normal;
use surfel_math::mapping::{Footprint, Linear, through_near};
use surfel_math::project::{EDGE_ON, Placement, Projected, ViewSplat, is_vast, radius_max};
use surfel_math::{V2, V3};
use surfel_model::Cull;
use surfel_model::{ChunkSpace, Storage, StoredSplat};
use surfel_render::{FramePlan, Pass, Region, View};
use surfel_shaders::layout;

/// Records of the splats of a segment that reach the near plane.
#[derive(Clone, Debug, Default)]
pub(crate) struct NearPlaneRecords {
    /// Words of the shaders' `Record`s.
    pub records: Vec<u32>,
    /// Copies of `records` for layers in which each splat is lit separately: they store the splat's centre in place of
    /// the unfiltered footprint. Empty if the plan has no such layer, and for opaque splats.
    pub lit: Vec<u32>,
    /// Words of the records' `RecordClip`s; empty unless the splats are clipped.
    pub clips: Vec<u32>,
    /// Identity of each splat: the index of its object, and the splat's index in the object's cloud.
    pub splats: Vec<[u32; 2]>,
}

/// View, plan and image region (of the tile's textures) for which splats are set up.
#[derive(Clone, Copy)]
pub(crate) struct NearPlaneSetup<'a> {
    pub view: &'a View,
    pub plan: &'a FramePlan,
    pub tile: Region,
}

/// Chunk in which some splats may reach the near plane.
pub(crate) struct NearPlaneChunk<'a> {
    pub object: &'a UploadedObject,
    /// Index of the object among the scene's objects of splats.
    pub object_index: u32,
    pub transform: &'a ObjectTransform,
    /// Indices of the chunk's splats in the object's cloud.
    pub members: &'a [u32],
    pub space: &'a ChunkSpace,
    pub storage: Storage,
    pub variant: Variant,
    pub is_transparent: bool,
}

/// Footprint and depth of a splat that reaches the near plane, as linear forms of the pixel offset from an anchor.
struct NearPlaneForms {
    anchor: V2<f64>,
    footprint: Footprint<f64>,
    /// Scale of the depth form. The depth at offset d from the anchor is `scale`/W(d) if `is_reciprocal`, where W is
    /// the footprint's third form. Otherwise it is `scale` + `gradient`·d.
    scale: f64,
    /// Change of the depth form per pixel to the right and down: of W if `is_reciprocal`, otherwise of the depth.
    gradient: V2<f64>,
    /// True if 1/z is linear over the pixels (perspective projection), false if z is (orthographic projection).
    is_reciprocal: bool,
    /// Bounding box of the splat on the screen, in image coordinates in pixels.
    extent_px: Extent<f64>,
}

/// Box of the tile's pixels that a splat may touch: the first column and row, and one past the last.
struct PixelBox {
    columns: [u32; 2],
    rows: [u32; 2],
}

impl NearPlaneSetup<'_> {
    /// Sets up the splats of a chunk that reach the near plane, and appends their records to `out`. Returns one bit per
    /// splat of the chunk, splat k in bit k % 32 of word k / 32: 1 if the GPU skips the splat. Returns `None` if the
    /// GPU skips none. A splat that isn't drawn in the tile has a bit but no record.
    pub(crate) fn chunk(
        &self,
        chunk: &NearPlaneChunk<'_>,
        out: &mut NearPlaneRecords,
    ) -> Option<[u32; layout::CHUNK_SPLATS as usize / 32]> {
        let NearPlaneChunk { object, object_index, transform, is_transparent, .. } = *chunk;
        let mut bits = [0u32; layout::CHUNK_SPLATS as usize / 32];
        let mut any = false;
        for (k, &i) in chunk.members.iter().enumerate() {
            let i = i as usize;
            // The splat is rounded as in the GPU's buffers.
            let stored = StoredSplat::of(&object.cloud, i, chunk.space, chunk.storage);
            let (s, t) = stored.axes;
            let p = transform.point(stored.center);
            let (s, t) = (transform.linear * s, transform.linear * t);
            let placement = Placement::of(p.z, s.z.hypot(t.z), &self.view.projection);
            let size = s.abs().max(t.abs()).max_element();
            let is_ordinary = placement == Placement::Ordinary && !is_vast(size, p.z, &self.view.projection);
            if is_ordinary || placement == Placement::Outside {
                continue;
            }
            any = true;
            if let Some(word) = bits.get_mut(k / 32) {
                *word |= 1 << (k % 32);
            }
            if placement == Placement::CenterBeforeNear && self.plan.splat_filter.drop_before_near {
                continue;
            }
            let n = self.view.view_from_world * unit(transform.normals * stored.normal);
            let splat = ViewSplat { p: V3::from(p), s: V3::from(s), t: V3::from(t), n: V3::from(n) };
            let shading = unit(transform.normals * stored.shading_normal);
            let clip = object.cloud.data().clips.as_ref().filter(|_| chunk.variant == Variant::Clipped);
            let clip = clip.map(|clips| clips.clip(i, self.plan.clip).unwrap_or_else(Clip::nothing));
            if let Some((mut record, seen)) = self.record(&splat, shading, stored.color, chunk) {
                if is_transparent {
                    record.f32(layout::record::COVERAGE, object.cloud.alpha(i));
                }
                if is_transparent && self.plan.has(Pass::RemainingLayer) {
                    out.lit.extend(centered(record.clone(), p, object_index).into_words());
                }
                out.records.extend(record.into_words());
                out.splats.push([object_index, i as u32]);
                if let Some(clip) = clip {
                    // The unfiltered and the filtered footprint are the same.
                    let words = clip_words(&clip.through(&seen, &Turn::none(1.0)));
                    out.clips.extend(words.repeat(2));
                }
            }
        }
        any.then_some(bits)
    }

    /// Returns a splat's record, and its footprint relative to the record's anchor. `shading` is the shading normal in
    /// world space, and `color` the linear albedo. `None` if the splat isn't drawn in the tile: it is edge-on, faces
    /// away and is culled, or touches no pixel.
    fn record(
        &self,
        splat: &ViewSplat<f64>,
        shading: DVec3,
        color: [f32; 3],
        chunk: &NearPlaneChunk<'_>,
    ) -> Option<(StructWriter, Footprint<f64>)> {
        let (projection, object) = (&self.view.projection, chunk.object);
        let (p, n) = (splat.p, splat.n);
        let facing = if projection.is_perspective() { n.dot(p) } else { n.z };
        let cosine = if projection.is_perspective() { facing / p.length() } else { facing };
        let back_facing = facing >= 0.0;
        // A centre at the eye itself has no cosine (NaN), and is edge-on like any plane through the eye.
        let edge_on = cosine.is_nan() || cosine.abs() <= EDGE_ON;
        if edge_on || (back_facing && object.material.cull == Cull::Back && !is_of_shadow_map(self.plan)) {
            return None;
        }
        let forms = self.forms(splat)?;
        let columns = pixel_range(forms.extent_px.min.x, forms.extent_px.max.x, self.tile.x, self.tile.width)?;
        let rows = pixel_range(forms.extent_px.min.y, forms.extent_px.max.y, self.tile.y, self.tile.height)?;
        let setting = self.plan.splat_filter.tolerance;
        let epsilon = tolerance(splat, radius_max(splat.s, splat.t), 0.0, setting, projection);
        let normal = match (back_facing && object.material.two_sided, object.is_oriented()) {
            (false, _) => shading,
            (true, false) => -shading,
            (true, true) => {
                let to_eye =
                    if projection.is_perspective() { -DVec3::new(p.x, p.y, p.z) / p.length() } else { DVec3::NEG_Z };
                let to_eye = V3::from(self.view.view_from_world.transpose() * to_eye);
                let V3 { x, y, z } = back_normal(V3::from(shading), cosine, to_eye);
                DVec3::new(x, y, z)
            }
        };
        let facing = match (self.plan.keeps_facings && object.is_oriented(), back_facing) {
            (false, _) => 0,
            (true, false) => layout::RECORD_FRONT,
            (true, true) => layout::RECORD_BACK,
        };
        let extent = splat.s.z.hypot(splat.t.z);
        let pixels = PixelBox { columns, rows };
        let flags = facing | chunk.object_index << layout::RECORD_OBJECT;
        let (mut words, seen) = self.forms_words(&forms, p.z, extent, pixels, flags);
        use layout::record as at;
        words.f64(at::EPSILON, epsilon).f32(at::WEIGHT_SCALE, 1.0).vec3(at::NORMAL, normal);
        words.f64(at::COVERAGE, object.coverage(self.plan));
        for (i, c) in color.into_iter().enumerate() {
            words.f32(at::COLOR + 4 * i, c);
        }
        Some((words, seen))
    }

    /// Returns the footprint and depth of a splat; `None` if, in perspective, no part of the splat is at or beyond the
    /// near plane.
    fn forms(&self, splat: &ViewSplat<f64>) -> Option<NearPlaneForms> {
        let projection = &self.view.projection;
        if projection.is_perspective() {
            let mapped = through_near(splat, projection);
            let w = mapped.footprint.w;
            return Some(NearPlaneForms {
                anchor: mapped.anchor_px,
                footprint: mapped.footprint,
                scale: mapped.depth_scale,
                gradient: V2::new(w.x, w.y),
                is_reciprocal: true,
                extent_px: bounds::through_near(splat, projection)?,
            });
        }
        let projected = Projected::new(splat, projection);
        let anchor = projection.pixel(splat.p);
        let e = bounds::unfiltered(&projected, false);
        Some(NearPlaneForms {
            anchor,
            footprint: Footprint::unfiltered(&projected, false),
            scale: splat.p.z,
            gradient: projected.depth_gradient,
            is_reciprocal: false,
            extent_px: Extent { min: e.min + anchor, max: e.max + anchor },
        })
    }

    /// Writes a new record of a splat: its footprint and depth as linear forms of the pixel offset from the middle of
    /// the pixel box, where rounding to f32 has the least effect, and its depth range (reciprocal in perspective). `z`
    /// is the depth of the splat's centre, `extent` is half the depth range of its disk, and `flags` has the side that
    /// is seen and the object's index. Returns the record, and the footprint about the middle of the box.
    fn forms_words(
        &self,
        forms: &NearPlaneForms,
        z: f64,
        extent: f64,
        PixelBox { columns, rows }: PixelBox,
        flags: u32,
    ) -> (StructWriter, Footprint<f64>) {
        use layout::record as at;
        let middle = |[first, end]: [u32; 2]| first + (end - first) / 2;
        let base = [self.tile.x + middle(columns), self.tile.y + middle(rows)];
        let d = V2::new(f64::from(base[0]) + 0.5, f64::from(base[1]) + 0.5) - forms.anchor;
        let (u, v, w) = forms.footprint.at(d);
        let f = &forms.footprint;
        let gradients = [f.u, f.v, f.w].map(|l| DVec2::new(l.x, l.y));
        // Scaling by a power of two that brings the largest value to about 1 changes no quotient.
        let half = DVec2::new(f64::from(columns[1] - columns[0]), f64::from(rows[1] - rows[0]));
        let largest = [u, v, w].iter().zip(&gradients).map(|(c, g)| c.abs() + g.abs().dot(half)).fold(0.0, f64::max);
        let k = if forms.is_reciprocal && largest > 0.0 && largest.is_finite() {
            (-largest.log2().floor()).exp2()
        } else {
            1.0
        };
        let mut words = StructWriter::new(at::SIZE);
        words.i32x2(at::BASE, base.map(u32::cast_signed)).vec2(at::FRACTION, DVec2::splat(0.5));
        let [gu, gv, gw] = gradients.map(|g| g * k);
        words.vec2(at::VISIBLE_U, gu).vec2(at::VISIBLE_V, gv).vec2(at::U, gu).vec2(at::V, gv).vec2(at::W, gw);
        words.f64s(at::AT_ANCHOR, [u * k, v * k]).f64(at::W_AT_ANCHOR, w * k);
        let gradient = DVec2::new(forms.gradient.x, forms.gradient.y);
        if forms.is_reciprocal {
            let scale = forms.scale * k;
            let nearest = if z > extent { scale / (z - extent) } else { f64::INFINITY };
            words.vec2(at::DEPTH, gradient * k).f64(at::SCALE, scale);
            words.f64s(at::RANGE, [scale / (z + extent), nearest.min(f64::from(f32::MAX))]);
        } else {
            words.vec2(at::DEPTH, gradient).f64(at::SCALE, forms.scale + gradient.dot(DVec2::new(d.x, d.y)));
            words.f64s(at::RANGE, [z - extent, z + extent]);
        }
        let reciprocal = if forms.is_reciprocal { layout::RECORD_RECIPROCAL } else { 0 };
        words.u32(at::FLAGS, reciprocal | flags);
        for offset in [at::VISIBLE_BOX, at::FILTERED_BOX] {
            words.u32(offset, columns[0] | rows[0] << 16).u32(offset + 4, columns[1] | rows[1] << 16);
        }
        let linear = |c: f64, g: DVec2| Linear::new(c * k, V2::new(g.x, g.y));
        (words, Footprint { u: linear(u, gu), v: linear(v, gv), w: linear(w, gw) })
    }
}

/// Replaces the unfiltered footprint of a record by the view position of the splat's centre, which lighting needs.
/// `index` is that of the splat's object.
fn centered(mut record: StructWriter, center: DVec3, index: u32) -> StructWriter {
    use layout::record as at;
    let reciprocal = record.get(at::FLAGS) & layout::RECORD_RECIPROCAL;
    record.vec2(at::VISIBLE_U, center.truncate()).vec2(at::VISIBLE_V, DVec2::new(center.z, 0.0));
    record.u32(at::FLAGS, reciprocal | layout::RECORD_CENTERED | index << layout::RECORD_OBJECT);
    record
}

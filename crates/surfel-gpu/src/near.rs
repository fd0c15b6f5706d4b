//! Splats that reach the near plane or span much of their distance: exact and unfiltered (§3, last paragraph), set up in
//! f64 and handed to the GPU as records.

use crate::clip::{Variant, clip_words};
use crate::placement::Placement;
use crate::rounds::is_of_map;
use crate::segment::UploadedObject;
use crate::uniforms::coverage;
use crate::words::Words;
use glam::{DVec2, DVec3};
use surfel_math::basis::unit;
use surfel_math::bounds::{self, Extent};
use surfel_math::clip::{Clip, Turn};
use surfel_math::depth::tolerance;
use surfel_math::mapping::{Footprint, Linear, through_near};
use surfel_math::project::{EDGE_ON, Placement as Standing, Projected, ViewSplat, radius_max};
use surfel_math::{V2, V3};
use surfel_model::Cull;
use surfel_render::{ChunkSpace, FramePlan, Pass, Region, Storage, StoredSplat, View};
use surfel_shaders::layout;

/// Slack of pixel boxes, as in the shaders.
const BOX_SLACK_PX: f64 = layout::BOX_SLACK_PX as f64;

/// Records of near splats of a segment.
#[derive(Clone, Debug, Default)]
pub(crate) struct NearSplats {
    /// Words of the shaders' `Record`s.
    pub records: Vec<u32>,
    /// The same with their centres, where each is lit by itself.
    pub lit: Vec<u32>,
    /// Words of their `RecordClip`s, where they are clipped.
    pub clips: Vec<u32>,
}

/// The picture that near splats are set up for.
#[derive(Clone, Copy)]
pub(crate) struct NearJob<'a> {
    pub view: &'a View,
    pub plan: &'a FramePlan,
    pub tile: Region,
}

/// A near splat's forms about some anchor.
struct NearForms {
    anchor: V2<f64>,
    footprint: Footprint<f64>,
    /// Depth form: scale, gradient, and whether it is that of 1/z.
    scale: f64,
    gradient: V2<f64>,
    is_reciprocal: bool,
    extent_px: Extent<f64>,
}

impl NearJob<'_> {
    /// Sets up the near splats of a chunk. Returns a bit for each splat that the GPU is to leave out, or `None` where it
    /// draws them all.
    pub(crate) fn chunk(
        &self,
        (object, index): (&UploadedObject, u32),
        placement: &Placement,
        (members, space, storage): (&[u32], &ChunkSpace, Storage),
        (variant, is_transparent): (Variant, bool),
        out: &mut NearSplats,
    ) -> Option<[u32; layout::CHUNK_SPLATS as usize / 32]> {
        let mut bits = [0u32; layout::CHUNK_SPLATS as usize / 32];
        let mut any = false;
        for (k, &i) in members.iter().enumerate() {
            let i = i as usize;
            // As the GPU has them.
            let stored = StoredSplat::of(&object.cloud, i, space, storage);
            let (s, t) = stored.axes;
            let p = placement.point(stored.center);
            let (s, t) = (placement.linear * s, placement.linear * t);
            let standing = Standing::of(p.z, s.z.hypot(t.z), &self.view.projection);
            if matches!(standing, Standing::Ordinary | Standing::Outside) {
                continue;
            }
            any = true;
            if let Some(word) = bits.get_mut(k / 32) {
                *word |= 1 << (k % 32);
            }
            if standing == Standing::CenterBeforeNear && self.plan.splat_filter.drop_before_near {
                continue;
            }
            let n = self.view.view_from_world * unit(placement.normals * stored.normal);
            let splat = ViewSplat { p: V3::from(p), s: V3::from(s), t: V3::from(t), n: V3::from(n) };
            let shading = unit(placement.normals * stored.shading_normal);
            let clip = object.cloud.data().clips.as_ref().filter(|_| variant == Variant::Clipped);
            let clip = clip.map(|clips| clips.clip(i, self.plan.clip).unwrap_or_else(Clip::nothing));
            if let Some((mut record, seen)) = self.record(&splat, shading, object, index, stored.color) {
                if is_transparent {
                    record.f32(layout::record::COVERAGE, object.cloud.alpha(i));
                }
                if is_transparent && self.plan.has(Pass::RemainingLayer) {
                    out.lit.extend(centered(record.clone(), p, index).into_vec());
                }
                out.records.extend(record.into_vec());
                if let Some(clip) = clip {
                    // Both footprints are the same.
                    let words = clip_words(&clip.through(&seen, &Turn::none(1.0)));
                    out.clips.extend(words.repeat(2));
                }
            }
        }
        any.then_some(bits)
    }

    /// The record of a near splat, and its footprint about the record's anchor; `None` if it takes part in no pass.
    fn record(
        &self,
        splat: &ViewSplat<f64>,
        shading: DVec3,
        object: &UploadedObject,
        index: u32,
        color: [f32; 3],
    ) -> Option<(Words, Footprint<f64>)> {
        let projection = &self.view.projection;
        let (p, n) = (splat.p, splat.n);
        let facing = if projection.is_perspective() { n.dot(p) } else { n.z };
        let cosine = if projection.is_perspective() { facing / p.length() } else { facing };
        let back_facing = facing >= 0.0;
        // A centre at the eye itself has no cosine (NaN), and is edge-on like any plane through the eye.
        let edge_on = cosine.is_nan() || cosine.abs() <= EDGE_ON;
        if edge_on || (back_facing && object.material.cull == Cull::Back && !is_of_map(self.plan)) {
            return None;
        }
        let forms = self.forms(splat)?;
        let columns = range(forms.extent_px.min.x, forms.extent_px.max.x, self.tile.x, self.tile.width)?;
        let rows = range(forms.extent_px.min.y, forms.extent_px.max.y, self.tile.y, self.tile.height)?;
        let setting = self.plan.splat_filter.tolerance;
        let epsilon = tolerance(splat, radius_max(splat.s, splat.t), 0.0, setting, projection);
        let normal = if back_facing && object.material.two_sided { -shading } else { shading };
        let extent = splat.s.z.hypot(splat.t.z);
        let (mut words, seen) = self.forms_words(&forms, p.z, extent, columns, rows, index);
        use layout::record as at;
        words.f64(at::EPSILON, epsilon).f32(at::WEIGHT_SCALE, 1.0).vec3(at::NORMAL, normal);
        words.f64(at::COVERAGE, coverage(object, self.plan));
        for (i, c) in color.into_iter().enumerate() {
            words.f32(at::COLOR + 4 * i, c);
        }
        Some((words, seen))
    }

    fn forms(&self, splat: &ViewSplat<f64>) -> Option<NearForms> {
        let projection = &self.view.projection;
        if projection.is_perspective() {
            let mapped = through_near(splat, projection);
            let w = mapped.footprint.w;
            return Some(NearForms {
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
        Some(NearForms {
            anchor,
            footprint: Footprint::unfiltered(&projected, false),
            scale: splat.p.z,
            gradient: projected.depth_gradient,
            is_reciprocal: false,
            extent_px: Extent { min: e.min + anchor, max: e.max + anchor },
        })
    }

    /// Moves the forms' anchor into the middle of the pixels that they are read at, where f32 does them least harm.
    fn forms_words(
        &self,
        forms: &NearForms,
        z: f64,
        extent: f64,
        columns: [u32; 2],
        rows: [u32; 2],
        index: u32,
    ) -> (Words, Footprint<f64>) {
        use layout::record as at;
        let middle = |[first, end]: [u32; 2]| first + (end - first) / 2;
        let base = [self.tile.x + middle(columns), self.tile.y + middle(rows)];
        let d = V2::new(f64::from(base[0]) + 0.5, f64::from(base[1]) + 0.5) - forms.anchor;
        let (u, v, w) = forms.footprint.at(d);
        let f = &forms.footprint;
        let gradients = [f.u, f.v, f.w].map(|l| DVec2::new(l.x, l.y));
        // A power of two that brings the largest value to about 1 leaves every quotient as it is.
        let half = DVec2::new(f64::from(columns[1] - columns[0]), f64::from(rows[1] - rows[0]));
        let largest = [u, v, w].iter().zip(&gradients).map(|(c, g)| c.abs() + g.abs().dot(half)).fold(0.0, f64::max);
        let k = if forms.is_reciprocal && largest > 0.0 && largest.is_finite() {
            (-largest.log2().floor()).exp2()
        } else {
            1.0
        };
        let mut words = Words::new(at::SIZE);
        words.i32x2(at::BASE, base.map(u32::cast_signed)).vec2(at::FRACTION, DVec2::splat(0.5));
        let [gu, gv, gw] = gradients.map(|g| g * k);
        words.vec2(at::VISIBLE_U, gu).vec2(at::VISIBLE_V, gv).vec2(at::U, gu).vec2(at::V, gv).vec2(at::W, gw);
        words.all(at::AT_ANCHOR, [u * k, v * k]).f64(at::W_AT_ANCHOR, w * k);
        let gradient = DVec2::new(forms.gradient.x, forms.gradient.y);
        if forms.is_reciprocal {
            let scale = forms.scale * k;
            let nearest = if z > extent { scale / (z - extent) } else { f64::INFINITY };
            words.vec2(at::DEPTH, gradient * k).f64(at::SCALE, scale);
            words.all(at::RANGE, [scale / (z + extent), nearest.min(f64::from(f32::MAX))]);
        } else {
            words.vec2(at::DEPTH, gradient).f64(at::SCALE, forms.scale + gradient.dot(DVec2::new(d.x, d.y)));
            words.all(at::RANGE, [z - extent, z + extent]);
        }
        let flags = if forms.is_reciprocal { layout::RECORD_RECIPROCAL } else { 0 };
        words.u32(at::FLAGS, flags | index << layout::RECORD_OBJECT);
        for offset in [at::VISIBLE_BOX, at::FILTERED_BOX] {
            words.u32(offset, columns[0] | rows[0] << 16).u32(offset + 4, columns[1] | rows[1] << 16);
        }
        let linear = |c: f64, g: DVec2| Linear::new(c * k, V2::new(g.x, g.y));
        (words, Footprint { u: linear(u, gu), v: linear(v, gv), w: linear(w, gw) })
    }
}

/// A record with the centre in place of the unfiltered footprint, for lighting it there.
fn centered(mut record: Words, center: DVec3, index: u32) -> Words {
    use layout::record as at;
    let reciprocal = record.get(at::FLAGS) & layout::RECORD_RECIPROCAL;
    record.vec2(at::VISIBLE_U, center.truncate()).vec2(at::VISIBLE_V, DVec2::new(center.z, 0.0));
    record.u32(at::FLAGS, reciprocal | layout::RECORD_CENTERED | index << layout::RECORD_OBJECT);
    record
}

/// Pixels of the tile whose centres lie between two pixel coordinates: the first and the one past the last, counted from
/// `start`; `None` if there are none.
pub(crate) fn range(min: f64, max: f64, start: u32, length: u32) -> Option<[u32; 2]> {
    let limit = f64::from(length);
    let first = (min - f64::from(start) - 0.5 - BOX_SLACK_PX).ceil().clamp(0.0, limit);
    let end = ((max - f64::from(start) - 0.5 + BOX_SLACK_PX).floor() + 1.0).clamp(0.0, limit);
    (first < end).then_some([first as u32, end as u32])
}

//! From stored splats to records, sixteen at a time.

use crate::bins::{Entries, Grid, Segment};
use crate::clip::{StoredClips, Turns};
use crate::lane_math::{Bits, adjust_axes, gradient_of, orthonormal, pixel_range, transform, unit};
use crate::lanes::{LANES, Lanes};
use crate::mask::{self, MaskForm, Masks};
use crate::placed::{ObjectSetup, Sides};
use crate::record::{BlockBox, Class, Record, RecordLanes};
use crate::renderer::Evaluation;
use crate::rows::MaskForms;
use crate::store::{Chunk, StoredShape};
use crate::veil::VeilSplat;
use fearless_simd::prelude::SimdFloat;
use fearless_simd::{Simd, mask32x16};
use glam::DVec3;
use surfel_math::bounds::{self, Extent};
use surfel_math::clip::Turn;
use surfel_math::depth::projected_tolerance;
use surfel_math::filter::{self, Filtered};
use surfel_math::mapping::Footprint;
use surfel_math::project::{Area, Projected, ViewSplat, radius_max};
use surfel_math::{Real, V2, V3};
use surfel_model::{ClipPolicy, Cull, Filter};
use surfel_render::Region;

/// Relative slack of a fragment's depth: several roundings.
const RANGE_SLACK: f64 = 1e-6;

/// Slack of a record's pixel box: f32 rounding of box and anchor, many times over, and still far below a pixel.
const BOX_SLACK_PX: f64 = 2e-3;

/// Widest filter, in pixels, of a splat that may be [`Class::Soft`].
const SOFT_RADIUS_PX: f64 = 2.0;

/// Where setup puts records and rarer shapes of some chunks.
pub(crate) struct SetupOutput<'a> {
    /// What is drawn: the view's region or a part of it.
    pub grid: Grid,
    /// Where centres of splats count as drawn: parts that overlap share them out.
    pub counted: Region,
    pub segment: &'a mut Segment,
    /// In splat order.
    pub entries: &'a mut Entries,
    /// Where transparent splats go, if the plan draws them by themselves.
    pub veil: Option<&'a mut VeilOutput>,
}

/// Transparent splats of some chunks.
#[derive(Default)]
pub(crate) struct VeilOutput {
    pub segment: Segment,
    pub entries: Entries,
    /// One a record.
    pub splats: Vec<VeilSplat>,
}

impl SetupOutput<'_> {
    /// Where the record of a splat goes: by itself if it is transparent.
    #[inline(always)]
    pub(crate) fn part(&mut self, transparent: Option<VeilSplat>) -> SetupOutput<'_> {
        match (transparent, &mut self.veil) {
            (Some(splat), Some(veil)) => {
                veil.splats.push(splat);
                SetupOutput {
                    grid: self.grid,
                    counted: self.counted,
                    segment: &mut veil.segment,
                    entries: &mut veil.entries,
                    veil: None,
                }
            }
            _ => SetupOutput {
                grid: self.grid,
                counted: self.counted,
                segment: self.segment,
                entries: self.entries,
                veil: None,
            },
        }
    }

    /// Appends splat `i` of sixteen: the index of its record.
    #[inline(always)]
    fn push<S: Simd>(&mut self, simd: S, record: &Record, (masks, i): (&Masks, usize), form: MaskForm) -> usize {
        let index = self.segment.records.len();
        self.segment.records.push(*record);
        let visit = |entry| self.entries.push(entry);
        masks.for_tiles(simd, i, (record, index as u32), &self.grid, form, visit);
        index
    }

    /// Appends a splat of which every block of its box counts.
    pub(crate) fn push_box<S: Simd>(&mut self, simd: S, record: &Record, blocks: BlockBox, form: MaskForm) {
        let index = self.segment.records.len() as u32;
        self.segment.records.push(*record);
        mask::for_tiles(simd, (record, index), blocks, &self.grid, form, |entry| {
            self.entries.push(entry);
        });
    }
}

impl ObjectSetup<'_> {
    /// Appends the records of a chunk.
    #[inline(always)]
    pub(crate) fn chunk<S: Simd>(&self, simd: S, index: usize, sides: &Sides, out: &mut SetupOutput<'_>) {
        let (chunk, sixteens) = (&self.object.chunks[index], &self.object.sixteens[index]);
        let center = self.center(chunk);
        if self.is_outside(center, chunk, out.grid.region) {
            return;
        }
        out.segment.set_up += chunk.count as u64;
        let mut seen = sixteens.seen(simd, self, (chunk, center), sides);
        if seen == 0 {
            return;
        }
        out.segment.records.make_room(chunk.count);
        if self.dots.is_some() {
            out.segment.small_dots.make_room(chunk.count);
        }
        while seen != 0 {
            let first = LANES * seen.trailing_zeros() as usize;
            seen &= seen - 1;
            self.sixteen(simd, (chunk, center), chunk.first + first, (chunk.count - first).min(LANES), out);
        }
    }

    #[inline(always)]
    fn sixteen<S: Simd>(
        &self,
        simd: S,
        (chunk, center): (&Chunk, DVec3),
        at: usize,
        active: usize,
        out: &mut SetupOutput<'_>,
    ) {
        let object = self.object;
        let linear = self.linear.as_mat3();
        let k = |v: f64| Lanes::splat(simd, v as f32);
        let c = V3::new(k(center.x), k(center.y), k(center.z));
        let p = transform(&linear, object.centers.load(simd, at, chunk.space.center)) + c;
        let normals = self.normals.as_mat3();
        let (normal, area) = match &object.shape {
            StoredShape::Disks { normals, .. } => (normals.load(simd, at), None),
            StoredShape::Ellipses { s, t } => {
                let (s, t) = (s.load(simd, at, 1.0), t.load(simd, at, 1.0));
                let (a, b) = (s.max_abs().scale_to_one(), t.max_abs().scale_to_one());
                let cross = (s * a).cross(t * b);
                let square = cross.dot(cross);
                let inverse = square.inverse_sqrt();
                let (sine, scale) = (square * inverse * k(self.handedness), k(self.scale.unwrap_or(1.0)));
                (cross * inverse, Some(Area { sine, k_s: a.scale_to_one() * scale, k_t: b.scale_to_one() * scale }))
            }
        };
        // A rotated unit normal is one.
        let (world_normal, n) = if self.scale.is_some() {
            (transform(&normals, normal), transform(&self.view_normals.as_mat3(), normal))
        } else {
            let world_normal = unit(transform(&normals, normal));
            (world_normal, transform(&self.view.view_from_world.as_mat3(), world_normal))
        };
        let (s, t, radius) = match (&object.shape, self.scale) {
            // Any pair of half-axes serves a disk, unless a clip is given in them.
            (StoredShape::Disks { radii, .. }, Some(scale)) if object.clips.is_none() => {
                let r = radii.load(simd, at, chunk.space.radius) * k(scale);
                let (s, t) = orthonormal(n);
                (s * r, t * r, Some(r))
            }
            (StoredShape::Disks { radii, .. }, _) => {
                let r = radii.load(simd, at, chunk.space.radius);
                let (s, t) = orthonormal(normal);
                (transform(&linear, s * r), transform(&linear, t * r), None)
            }
            (StoredShape::Ellipses { s, t }, _) => {
                (transform(&linear, s.load(simd, at, 1.0)), transform(&linear, t.load(simd, at, 1.0)), None)
            }
        };
        let splat = ViewSplat { p, s, t, n };
        // Turning a pair of half-axes keeps its product.
        let area = radius.map(Area::of_disk).or(area.filter(|_| self.scale.is_some()));
        let shading = match &object.shading_normals {
            Some(c) => unit(transform(&normals, c.load(simd, at))),
            None => world_normal,
        };
        let white = k(1.0);
        let color = match &object.colors {
            Some(colors) => colors.load(simd, at, chunk.space.color),
            None => V3::new(white, white, white),
        };
        self.project(simd, &splat, (radius, area), (shading, color), (chunk, at, active), out);
    }

    #[inline(always)]
    fn project<S: Simd>(
        &self,
        simd: S,
        splat: &ViewSplat<Lanes<S>>,
        (radius, area): (Option<Lanes<S>>, Option<Area<Lanes<S>>>),
        (shading, color): (V3<Lanes<S>>, V3<Lanes<S>>),
        (chunk, at, active): (&Chunk, usize, usize),
        out: &mut SetupOutput<'_>,
    ) {
        let projection = &self.view.projection;
        let settings = &self.plan.splat_filter;
        let material = &self.material;
        let k = |v: f64| Lanes::splat(simd, v as f32);
        let (zero, one) = (k(0.0), k(1.0));
        let perspective = projection.is_perspective();
        let near = k(projection.near);
        let z = splat.p.z;
        let extent = splat.s.z.mul_add(splat.s.z, splat.t.z * splat.t.z).sqrt();
        let inside = near.le(z + extent) & (z - extent).le(k(projection.far().min(f64::from(f32::MAX))));
        let before_near = z.lt(near);
        let close = if perspective { before_near | (z * k(0.5)).le(extent) } else { before_near };
        let live = (1u64 << active) - 1;
        let to_near = (inside & close).bits() & live;
        if to_near != 0 {
            self.push_near(simd, chunk, at, to_near, out);
        }
        let ordinary = (inside & !close).bits() & live;
        if ordinary == 0 {
            return;
        }
        // Lanes that aren't ordinary go on with a harmless depth; their results are never read.
        let z = Lanes::select(inside & !close, z, k(projection.near * 4.0));
        let splat = &ViewSplat { p: V3::new(splat.p.x, splat.p.y, z), ..*splat };
        let h = k(settings.radius_px);
        let (adjusted, visible_turn) =
            if settings.filter == Filter::Adjust { adjust_axes(splat, perspective) } else { (*splat, Turn::none(one)) };
        let area = match area {
            Some(area) => area,
            None => Area::of(&adjusted),
        };
        let projected = Projected::with_area(&adjusted, area, projection);
        let back_facing = zero.le(projected.facing);
        let mut keep = !projected.is_edge_on();
        if material.cull == Cull::Back {
            keep &= !back_facing;
        }
        if keep.bits() & ordinary == 0 {
            return;
        }
        let radius = match radius {
            Some(radius) => radius,
            None => radius_max(splat.s, splat.t),
        };
        let epsilon = projected_tolerance(z, &projected, radius, h, settings.tolerance, projection);
        let visible = Footprint::unfiltered(&projected, settings.projective);
        let mut extent_px = bounds::unfiltered(&projected, settings.projective);
        let clips = self.object.clips.as_ref().filter(|_| self.plan.clip != ClipPolicy::Off);
        // Where no splat of the sixteen is small, nothing is found out about how small.
        let acts = match settings.filter {
            Filter::Principal => !filter::is_surely_wide(&projected, h) & keep,
            _ => keep,
        };
        let mut filtered = match settings.filter {
            _ if acts.bits() & ordinary == 0 => Filtered::plain(visible),
            Filter::None => Filtered::plain(visible),
            Filter::Clamp => {
                extent_px = extent_px.union(Extent::symmetric(V2::new(h, h)));
                Filtered::plain(visible)
            }
            Filter::Adjust => filter::adjust(&projected, h, settings.projective),
            Filter::Principal => filter::principal_or_unturned(&projected, h, settings.projective, clips.is_some()),
            Filter::Ewa => filter::ewa(&projected, h),
        };
        if clips.is_none() {
            filtered.turn = Turn::none(one);
        }
        if matches!(settings.filter, Filter::Adjust | Filter::Principal | Filter::Ewa) && acts.bits() & ordinary != 0 {
            extent_px = extent_px.union(bounds::footprint(&filtered.footprint));
        }
        let extent_px = extent_px.grow(k(BOX_SLACK_PX));
        let inverse_z = if perspective { one / z } else { one };
        let base = V2::new(
            pixel_of(splat.p.x * inverse_z, projection.focal_px[0], projection.principal_px[0]),
            pixel_of(splat.p.y * inverse_z, projection.focal_px[1], projection.principal_px[1]),
        );
        let fraction = projection.offset_from(splat.p, base);
        let region = out.grid.region;
        let columns =
            pixel_range(base.x, fraction.x + extent_px.min.x, fraction.x + extent_px.max.x, region.x, region.width);
        let rows =
            pixel_range(base.y, fraction.y + extent_px.min.y, fraction.y + extent_px.max.y, region.y, region.height);
        let keep = (keep & columns.0.lt(columns.1) & rows.0.lt(rows.1)).bits() & ordinary;
        if keep == 0 {
            return;
        }
        // A splat that several parts of the view draw counts in the one where its centre is, or would be were it moved in.
        let (whole, counted) = (self.view.region, out.counted);
        let here = moved_inside(base.x, (whole.x, whole.width), (counted.x, counted.width))
            & moved_inside(base.y, (whole.y, whole.height), (counted.y, counted.height));
        out.segment.drawn += u64::from((here.bits() & keep).count_ones());
        let (gradient, range) = if settings.projective {
            // 1/(1 + e) and 1/(1 − e).
            let e = extent * inverse_z;
            let q = one / ((one - e) * (one + e));
            (-projected.depth_gradient, [(one - e) * q, (one + e) * q])
        } else if perspective {
            (projected.depth_gradient * z, [z - extent, z + extent])
        } else {
            (projected.depth_gradient, [z - extent, z + extent])
        };
        let turn = if material.two_sided { Lanes::select(back_facing, -one, one) } else { one };
        let f = &filtered.footprint;
        let (z_min, z_max) = (z - extent, z + extent);
        let unclipped = near.lt(z_min * k(1.0 - RANGE_SLACK))
            & (z_max * k(1.0 + RANGE_SLACK)).lt(k(projection.far().min(f64::from(f32::MAX))));
        let one_footprint = match settings.filter {
            Filter::None => one.le(one),
            // Both axes keep their length: the same ellipse, turned within the disk, with the same w.
            Filter::Principal => one.le(filtered.weight_scale),
            _ => one.lt(one),
        };
        let plain = one_footprint & unclipped;
        let plain = if self.evaluation == Evaluation::General { one.lt(one) } else { plain };
        // Over the disk; and over all of its blocks, which reach at most 12 pixels beyond.
        let steepness = gradient.x.abs() + gradient.y.abs();
        let shallow =
            if settings.projective { extent.le(z * k(1.0 / 64.0)) & steepness.le(k(1.0 / 200.0)) } else { one.lt(one) };
        let (u, v, w) = (
            V2::select(plain, gradient_of(&visible.u), gradient_of(&f.u)),
            V2::select(plain, gradient_of(&visible.v), gradient_of(&f.v)),
            V2::select(plain, gradient_of(&visible.w), gradient_of(&f.w)),
        );
        // The filtered disk reaches h beyond the other at most, and its w changes as slowly.
        let is_clamp = settings.filter == Filter::Clamp;
        let slow = (w.x.abs() + w.y.abs()).le(k(1.0 / 200.0)) & h.le(k(SOFT_RADIUS_PX));
        let soft =
            if is_clamp || self.evaluation == Evaluation::General { one.lt(one) } else { shallow & slow & unclipped };
        // What is drawn together finds the range in the same form: of e, and none where the footprint is the disk.
        let unlimited = k(f64::from(f32::MAX));
        let bits = |value: u32| Lanes::splat(simd, f32::from_bits(value));
        let half = k(0.5);
        let records = RecordLanes {
            base_x: base.x,
            base_y: base.y,
            offset_x: half - fraction.x,
            offset_y: half - fraction.y,
            u_x: u.x,
            u_y: u.y,
            v_x: v.x,
            v_y: v.y,
            depth_x: gradient.x,
            depth_y: gradient.y,
            z,
            range_min: Lanes::select(plain & shallow, -unlimited, Lanes::select(soft, range[0] - one, range[0])),
            range_max: Lanes::select(plain & shallow, unlimited, Lanes::select(soft, range[1] - one, range[1])),
            epsilon,
            z_min: z_min - z_max.abs() * k(RANGE_SLACK),
            class_bits: Lanes::select(
                plain,
                Lanes::select(shallow, bits(0), bits(2)),
                Lanes::select(soft, bits(1), bits(4)),
            ),
            red: color.x,
            green: color.y,
            blue: color.z,
            normal_x: shading.x * turn,
            normal_y: shading.y * turn,
            normal_z: shading.z * turn,
            visible_u_x: visible.u.x,
            visible_u_y: visible.u.y,
            visible_v_x: visible.v.x,
            visible_v_y: visible.v.y,
            w_x: w.x,
            w_y: w.y,
            weight_scale: filtered.weight_scale,
            coverage_scale: if settings.filter == Filter::Clamp {
                filter::area_ratio(&projected, h)
            } else {
                filtered.coverage_scale
            },
            object_bits: bits(self.index),
            clip_bits: bits(0),
        };
        let form = MaskForm { linear_depth: !settings.projective, whole_box: settings.filter == Filter::Clamp };
        let wide = MaskForms {
            offset: V2::new(half - fraction.x, half - fraction.y),
            base,
            u,
            v,
            // Every filter's footprint holds the unfiltered one, and its w changes no more.
            w: if settings.projective { range[1] } else { one },
        };
        let mut masks = mask::masks(&wide, [columns.0, columns.1, rows.0, rows.1], keep, &out.grid, form);
        let veils = self.object.alphas.as_ref().filter(|_| self.plan.separates_transparent);
        let clips = clips.map(|clips| (clips, clips.clipped(at) & keep)).filter(|(_, clipped)| *clipped != 0).map(
            |(clips, clipped)| Clips {
                clips,
                at,
                clipped,
                policy: self.plan.clip,
                projective: settings.projective,
                visible: Turns::new(&visible_turn),
                filtered: Turns::new(&visible_turn.after(&filtered.turn)),
            },
        );
        if veils.is_none() {
            let clipped = clips.as_ref().map_or(0, |clips| clips.clipped);
            let keep = keep & masks.touching();
            let dots = match &self.dots {
                Some(dots) if clipped == 0 => dots.find(&records, keep, [columns.0, columns.1, rows.0, rows.1]),
                _ => None,
            };
            let SetupOutput { grid, segment, entries, .. } = out;
            let small = dots.as_ref().and_then(|dots| dots.small(&records, keep));
            if let Some(dots) = &dots {
                masks.set_dots(dots.bits(), small.is_some());
            }
            let first = match small {
                Some(fields) => segment.small_dots.push_sixteen(fields, keep),
                None => segment.records.push_sixteen(records, dots.as_ref(), keep),
            };
            masks.entries(simd, keep, (&segment.records, first), grid, form, entries);
            if let Some(clips) = &clips {
                for i in lanes_of(clips.clipped & keep) {
                    let before = keep & ((1 << i) - 1);
                    clips.clip(i, first as usize + before.count_ones() as usize, segment);
                }
            }
            return;
        }
        let records = records.transposed();
        let [x, y, z] = [splat.p.x.to_array(), splat.p.y.to_array(), splat.p.z.to_array()];
        for i in lanes_of(keep) {
            let mut part = out.part(self.transparent(at + i, || [x[i], y[i], z[i]]));
            let index = part.push(simd, &records[i], (&masks, i), form);
            if let Some(clips) = &clips {
                clips.clip(i, index, part.segment);
            }
        }
    }
}

/// What clips sixteen splats.
struct Clips<'a> {
    clips: &'a StoredClips,
    /// The first one's slot.
    at: usize,
    /// Which of them have a clip, as bits.
    clipped: u64,
    policy: ClipPolicy,
    projective: bool,
    visible: Turns,
    filtered: Turns,
}

impl Clips<'_> {
    /// Clips splat `i` of the sixteen, of which the record is there, if it has a clip.
    #[inline(always)]
    fn clip(&self, i: usize, index: usize, segment: &mut Segment) {
        let Some(clip) = self.clips.get(self.at + i, self.policy) else { return };
        let Some(record) = segment.records.get_mut(index) else { return };
        let visible = record.visible_footprint(self.projective);
        let filtered = record.filtered_footprint();
        let filtered_turn = self.filtered.of(i);
        let other = matches!(record.class(), Class::Soft | Class::General).then_some((&filtered, &filtered_turn));
        record.set_clip(segment.clips.push(&clip, (&visible, &self.visible.of(i)), other));
    }
}

/// Whether pixels, moved into the first range if they are outside, lie in the second: starts and lengths.
#[inline(always)]
fn moved_inside<S: Simd>(at: Lanes<S>, (first, length): (u32, u32), (start, count): (u32, u32)) -> mask32x16<S> {
    let k = |v: u32| at.constant(f64::from(v));
    let at = at.max(k(first)).min(k((first + length).saturating_sub(1)));
    k(start).le(at) & at.lt(k(start + count))
}

/// Indices of set bits.
fn lanes_of(bits: u64) -> impl Iterator<Item = usize> {
    (0..LANES).filter(move |i| bits >> i & 1 == 1)
}

/// The pixel that holds a point of this slope (orthographic: coordinate) along one axis.
#[inline(always)]
fn pixel_of<S: Simd>(slope: Lanes<S>, focal_px: f64, principal_px: f64) -> Lanes<S> {
    Lanes(slope.mul_add(slope.constant(focal_px), slope.constant(principal_px)).0.floor())
}

//! Projection of stored splats to records, in groups of 16.
//!
//! A *block* is 4×4 pixels ([`BLOCK`](crate::tiles::grid::BLOCK)). A *cell* is a part of the view that one thread draws
//! alone ([`Cell`](crate::cull::cells::Cell)). A *record* is a splat projected to the screen ([`Record`]). A *slot* is
//! the index of a stored splat in the columns of its object ([`StoredObject`](crate::scene::cloud::StoredObject)). A
//! *tile* is a square of blocks ([`Grid`](crate::tiles::grid::Grid)). A *lane* is one of the 16 numbers that SIMD
//! instructions compute at once.

use crate::cull::groups;
use crate::cull::object::{ObjectView, RegionSides};
use crate::scene::clips::StoredClips;
use crate::scene::cloud::{Chunk, StoredShape};
use crate::setup::clips::{Mapping, turns};
use crate::setup::evaluate::{CHEAP_DEPTH, CHEAP_FILTERED_DEPTH, CHEAP_RADIUS_PX, CHEAP_STEEPNESS};
use crate::setup::footprint::{adjust_axes, gradient_of, pixel_range};
use crate::setup::mask::{self, MaskForm, Masks};
use crate::setup::record::{BlockBox, FILTERED, Facing, GENERAL, Record, RecordLanes, UNFILTERED};
use crate::setup::rows::MaskForms;
use crate::setup::segment::{Segment, TransparentSplat};
use crate::setup::tiny::TinyFinder;
use crate::simd::lanes::{LANES, Lanes};
use crate::simd::math::{Bits, largest, orthonormal, transform, unit, vector};
use crate::tiles::bins::Entries;
use crate::tiles::drawn::DrawnBlocks;
use crate::tiles::grid::Grid;
use fearless_simd::prelude::{SimdFloat, SimdMask};
use fearless_simd::{Simd, mask32x16};
use glam::{DVec3, Vec3};
use surfel_math::bounds::{self, Extent};
use surfel_math::clip::Turn;
use surfel_math::depth::projected_tolerance;
use surfel_math::facing::back_normal;
use surfel_math::filter::{self, Filtered};
use surfel_math::mapping::Footprint;
use surfel_math::project::{Area, Projected, ViewSplat, is_vast, radius_max};
use surfel_math::{Real, V2, V3};
use surfel_model::{ClipPolicy, Cull, Filter};
use surfel_render::Region;

/// Amount by which a fragment's depth is widened in tests against z_near and z_far, relative to the depth. It exceeds
/// the several roundings of a depth.
const RANGE_SLACK: f64 = 1e-6;

/// Amount by which a record's box of pixels is widened on every side, in pixels. It is far above the f32 rounding of
/// box and projected centre, and still far below a pixel.
const BOX_SLACK_PX: f64 = 2e-3;

/// Destination of the records, clips and near splats of the chunks that are set up.
pub(crate) struct SetupOutput<'a> {
    /// Grid over the part of the view that is drawn.
    pub grid: Grid,
    /// Region in which splats, by their centres, are counted as drawn. Regions of different cells don't overlap,
    /// although their grids may.
    pub counted: Region,
    /// Finder of tiny splats, whose fragments setup computes itself ([`tiny`](crate::setup::tiny)). `None` if all
    /// splats are evaluated block by block.
    pub tiny: Option<&'a TinyFinder>,
    pub segment: &'a mut Segment,
    /// Entries, which assign records to tiles, in splat order.
    pub entries: &'a mut Entries,
    /// Blocks that are drawn; splats need no entries for others.
    pub drawn: DrawnBlocks<'a>,
    /// Destination of transparent splats, if the plan draws them in layers of their own.
    pub transparent: Option<&'a mut TransparentOutput>,
}

/// Destination of the transparent splats of the chunks that are set up.
#[derive(Default)]
pub(crate) struct TransparentOutput {
    pub segment: Segment,
    pub entries: Entries,
    /// Opacity and position of each splat, which records don't contain, in the order of the records.
    pub splats: Vec<TransparentSplat>,
}

impl SetupOutput<'_> {
    /// Returns the destination of a splat's record: a separate one if the splat is transparent.
    #[inline(always)]
    pub(crate) fn part(&mut self, transparent: Option<TransparentSplat>) -> SetupOutput<'_> {
        match (transparent, &mut self.transparent) {
            (Some(splat), Some(output)) => {
                output.splats.push(splat);
                SetupOutput {
                    grid: self.grid,
                    counted: self.counted,
                    tiny: None,
                    segment: &mut output.segment,
                    entries: &mut output.entries,
                    drawn: self.drawn,
                    transparent: None,
                }
            }
            _ => SetupOutput {
                grid: self.grid,
                counted: self.counted,
                tiny: None,
                segment: self.segment,
                entries: self.entries,
                drawn: self.drawn,
                transparent: None,
            },
        }
    }

    /// Appends the record of splat `i` of a group, and its entries. Returns the index of the record.
    #[inline(always)]
    fn push<S: Simd>(&mut self, simd: S, record: &Record, (masks, i): (&Masks, usize), form: MaskForm<'_>) -> usize {
        let index = self.segment.records.len();
        self.segment.records.push(*record);
        masks.list_tiles(simd, i, (record, index as u32), &self.grid, form, self.entries);
        index
    }

    /// Appends the record of a splat that is listed in every block of its box.
    pub(crate) fn push_box<S: Simd>(&mut self, simd: S, record: &Record, blocks: BlockBox, form: MaskForm<'_>) {
        let index = self.segment.records.len() as u32;
        self.segment.records.push(*record);
        mask::list_tiles(simd, (record, index), blocks, &self.grid, form, self.entries);
    }
}

impl ObjectView<'_> {
    /// Returns the data that a transparent splat has besides its record; `None` for an opaque splat. `center` computes
    /// its position in view space.
    #[inline(always)]
    pub(crate) fn transparent(&self, slot: usize, center: impl FnOnce() -> [f32; 3]) -> Option<TransparentSplat> {
        let alphas = self.object.alphas.as_ref().filter(|_| self.is_transparent())?;
        let alpha = alphas.get(slot).copied().filter(|&alpha| alpha < 1.0)?;
        Some(TransparentSplat { alpha, center: center(), lit: [0.0; 3] })
    }

    /// Projects a chunk's splats and appends their records. `index` is the chunk's index in the object.
    #[inline(always)]
    pub(crate) fn project_chunk<S: Simd>(&self, simd: S, index: usize, sides: &RegionSides, out: &mut SetupOutput<'_>) {
        let (chunk, bounds) = (&self.object.chunks[index], &self.object.groups[index]);
        let center = self.center(chunk);
        if self.is_outside(center, chunk, out.grid.region) {
            return;
        }
        out.segment.set_up += chunk.count as u64;
        let mut visible = groups::visible(simd, bounds, self, chunk, center, sides, out.drawn);
        if visible == 0 {
            return;
        }
        out.segment.records.make_room(chunk.count + LANES);
        while visible != 0 {
            let first = LANES * visible.trailing_zeros() as usize;
            visible &= visible - 1;
            let group = Group { chunk, at: chunk.first + first, active: (chunk.count - first).min(LANES) };
            self.group(simd, group, center, out);
        }
    }

    #[inline(always)]
    fn group<S: Simd>(&self, simd: S, group: Group<'_>, center: DVec3, out: &mut SetupOutput<'_>) {
        let Group { chunk, at, .. } = group;
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
        // A rotated unit normal is a unit normal.
        let (world_normal, n) = if self.scale.is_some() {
            (transform(&normals, normal), transform(&self.view_normals.as_mat3(), normal))
        } else {
            let world_normal = unit(transform(&normals, normal));
            (world_normal, transform(&self.view.view_from_world.as_mat3(), world_normal))
        };
        let (s, t, radius) = match (&object.shape, self.scale) {
            // Any pair of half-axes serves a disk, unless its clip is given relative to them.
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
        // Turning a pair of half-axes preserves their product.
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
        let splats = GroupLanes { splat, radius, area, shading, color };
        self.project(simd, &splats, group, out);
    }

    /// Projects a group's splats, which are in view space, and appends their records.
    #[inline(always)]
    fn project<S: Simd>(&self, simd: S, splats: &GroupLanes<S>, group: Group<'_>, out: &mut SetupOutput<'_>) {
        let classes = self.classify(simd, splats, group.active);
        if classes.near != 0 {
            self.push_near(simd, group.chunk, group.at, classes.near, out);
        }
        if classes.ordinary == 0 {
            return;
        }
        let Some(footprints) = self.filter(simd, splats.area, &classes) else { return };
        let Some(bounds) = self.bounds(simd, &classes, &footprints, out) else { return };
        let depths = self.depth_lanes(simd, &classes, &footprints, bounds.inverse_z);
        let evaluation = self.evaluation(simd, &classes, &footprints, &depths, bounds.inverse_z);
        let stages = Stages { classes, footprints, bounds, depths, evaluation };
        let records = self.records(simd, splats, group.at, &stages, out.segment);
        self.emit(simd, records, group.at, &stages, out);
    }

    /// Classifies a group's splats by their depth range and size: outside, near ([`near`](crate::setup::near)), or
    /// ordinary.
    #[inline(always)]
    fn classify<S: Simd>(&self, simd: S, splats: &GroupLanes<S>, active: usize) -> DepthClasses<S> {
        let GroupLanes { splat, radius, .. } = *splats;
        let projection = &self.view.projection;
        let k = |v: f64| Lanes::splat(simd, v as f32);
        let near = k(projection.near);
        let z = splat.p.z;
        let extent = splat.s.z.mul_add(splat.s.z, splat.t.z * splat.t.z).sqrt();
        let inside = near.le(z + extent) & (z - extent).le(k(projection.far().min(f64::from(f32::MAX))));
        let before_near = z.lt(near);
        let close = if projection.is_perspective() { before_near | (z * k(0.5)).le(extent) } else { before_near };
        let size = match radius {
            Some(radius) => radius,
            None => splat.s.max_abs().max(splat.t.max_abs()),
        };
        let close = close | is_vast(size, z, projection);
        let live = (1u64 << active) - 1;
        // Lanes of splats that aren't ordinary continue with a harmless depth; their results are never read.
        let z = Lanes::select(inside & !close, z, k(projection.near * 4.0));
        DepthClasses {
            near: (inside & close).bits() & live,
            ordinary: (inside & !close).bits() & live,
            splat: ViewSplat { p: V3::new(splat.p.x, splat.p.y, z), ..splat },
            radius,
            extent,
        }
    }

    /// Projects and filters a group's ordinary splats. Returns `None` if none is left after the culling of back-facing
    /// and edge-on splats.
    #[inline(always)]
    fn filter<S: Simd>(
        &self,
        simd: S,
        area: Option<Area<Lanes<S>>>,
        classes: &DepthClasses<S>,
    ) -> Option<FootprintLanes<S>> {
        let DepthClasses { splat, radius, ordinary, .. } = classes;
        let projection = &self.view.projection;
        let settings = &self.plan.splat_filter;
        let k = |v: f64| Lanes::splat(simd, v as f32);
        let (zero, one) = (k(0.0), k(1.0));
        let h = k(settings.radius_px);
        let (adjusted, visible_turn) = if settings.filter == Filter::Adjust {
            adjust_axes(splat, projection.is_perspective())
        } else {
            (*splat, Turn::none(one))
        };
        let area = match area {
            Some(area) => area,
            None => Area::of(&adjusted),
        };
        let projected = Projected::with_area(&adjusted, area, projection);
        let back_facing = zero.le(projected.facing);
        let mut keep = !projected.is_edge_on();
        if self.material.cull == Cull::Back {
            keep &= !back_facing;
        }
        if keep.bits() & ordinary == 0 {
            return None;
        }
        let radius = match radius {
            Some(radius) => *radius,
            None => radius_max(splat.s, splat.t),
        };
        let epsilon = projected_tolerance(splat.p.z, &projected, radius, h, settings.tolerance, projection);
        let visible = Footprint::unfiltered(&projected, settings.projective);
        let mut extent_px = bounds::unfiltered(&projected, settings.projective);
        let is_clipped = self.clips().is_some();
        // If no splat of the group is small, the filter isn't computed.
        let acts = match settings.filter {
            Filter::Principal => !filter::is_unaffected_by_principal(&projected, h) & keep,
            _ => keep,
        };
        let mut filtered = match settings.filter {
            _ if acts.bits() & ordinary == 0 => Filtered::unfiltered(visible),
            Filter::None => Filtered::unfiltered(visible),
            Filter::Clamp => {
                extent_px = extent_px.union(Extent::symmetric(V2::new(h, h)));
                Filtered::unfiltered(visible)
            }
            Filter::Adjust => filter::adjust(&projected, h, settings.projective),
            Filter::Ewa => filter::ewa(&projected, h),
            // `Filter::Principal`, the default, also serves filters that may be added to the enum.
            _ => filter::principal_or_unturned(&projected, h, settings.projective, is_clipped),
        };
        if !is_clipped {
            filtered.turn = Turn::none(one);
        }
        if !matches!(settings.filter, Filter::None | Filter::Clamp) && acts.bits() & ordinary != 0 {
            extent_px = extent_px.union(bounds::footprint(&filtered.footprint));
        }
        Some(FootprintLanes { projected, back_facing, keep, epsilon, visible, visible_turn, filtered, extent_px })
    }

    /// Computes the pixels that a group's splats may touch, and counts the splats that are drawn. Returns `None` if
    /// none touches the region.
    #[inline(always)]
    fn bounds<S: Simd>(
        &self,
        simd: S,
        classes: &DepthClasses<S>,
        footprints: &FootprintLanes<S>,
        out: &mut SetupOutput<'_>,
    ) -> Option<PixelBounds<S>> {
        let splat = &classes.splat;
        let projection = &self.view.projection;
        let one = Lanes::splat(simd, 1.0);
        let extent_px = footprints.extent_px.grow(Lanes::splat(simd, BOX_SLACK_PX as f32));
        let inverse_z = if projection.is_perspective() { one / splat.p.z } else { one };
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
        let keep = (footprints.keep & columns.0.lt(columns.1) & rows.0.lt(rows.1)).bits() & classes.ordinary;
        if keep == 0 {
            return None;
        }
        // A splat that several cells draw counts in the cell that contains its centre, clamped to the view.
        let (whole, counted) = (self.view.region, out.counted);
        let here = is_inside_clamped(base.x, (whole.x, whole.width), (counted.x, counted.width))
            & is_inside_clamped(base.y, (whole.y, whole.height), (counted.y, counted.height));
        out.segment.drawn += u64::from((here.bits() & keep).count_ones());
        Some(PixelBounds { inverse_z, base, fraction, ranges: [columns.0, columns.1, rows.0, rows.1], keep })
    }

    /// Computes the depth of each splat of a group as a linear form over pixels, and the range of the depths.
    #[inline(always)]
    fn depth_lanes<S: Simd>(
        &self,
        simd: S,
        classes: &DepthClasses<S>,
        footprints: &FootprintLanes<S>,
        inverse_z: Lanes<S>,
    ) -> DepthLanes<S> {
        let (z, extent, slope) = (classes.splat.p.z, classes.extent, footprints.projected.depth_gradient);
        let one = Lanes::splat(simd, 1.0);
        let (gradient, range) = if self.plan.splat_filter.projective {
            // The range of p_z/z is 1/(1 + e) to 1/(1 − e), computed by one division.
            let e = extent * inverse_z;
            let q = one / ((one - e) * (one + e));
            (-slope, [(one - e) * q, (one + e) * q])
        } else if self.view.projection.is_perspective() {
            (slope * z, [z - extent, z + extent])
        } else {
            (slope, [z - extent, z + extent])
        };
        DepthLanes { gradient, range, z_min: z - extent, z_max: z + extent }
    }

    /// Chooses the evaluator of each splat of a group, and the gradients of the footprint to evaluate.
    #[inline(always)]
    fn evaluation<S: Simd>(
        &self,
        simd: S,
        classes: &DepthClasses<S>,
        footprints: &FootprintLanes<S>,
        depths: &DepthLanes<S>,
        inverse_z: Lanes<S>,
    ) -> Evaluation<S> {
        let FootprintLanes { visible, filtered, .. } = footprints;
        let (projection, settings) = (&self.view.projection, &self.plan.splat_filter);
        let k = |v: f64| Lanes::splat(simd, v as f32);
        let (one, h) = (k(1.0), k(settings.radius_px));
        let (z, extent) = (classes.splat.p.z, classes.extent);
        let f = &filtered.footprint;
        let unclipped = k(projection.near).lt(depths.z_min * k(1.0 - RANGE_SLACK))
            & (depths.z_max * k(1.0 + RANGE_SLACK)).lt(k(projection.far().min(f64::from(f32::MAX))));
        let one_footprint = match settings.filter {
            Filter::None => one.le(one),
            // If both axes keep their length, the footprint is the same ellipse, turned within the disk, with the same
            // w.
            Filter::Principal => one.le(filtered.weight_scale),
            _ => one.lt(one),
        };
        let steepness = depths.gradient.x.abs() + depths.gradient.y.abs();
        let constant_depth = match settings.projective {
            true => extent.le(z * k(CHEAP_DEPTH)) & steepness.le(k(CHEAP_STEEPNESS)),
            false => one.lt(one),
        };
        let unfiltered = one_footprint & unclipped & constant_depth;
        let (u, v, w) = (
            V2::select(unfiltered, gradient_of(&visible.u), gradient_of(&f.u)),
            V2::select(unfiltered, gradient_of(&visible.v), gradient_of(&f.v)),
            V2::select(unfiltered, gradient_of(&visible.w), gradient_of(&f.w)),
        );
        // The filtered disk reaches at most h beyond the unfiltered one.
        let filtered_steepness = w.x.abs() + w.y.abs();
        let slow = h.mul_add(filtered_steepness, extent * inverse_z).le(k(CHEAP_FILTERED_DEPTH))
            & filtered_steepness.le(k(CHEAP_STEEPNESS))
            & h.le(k(CHEAP_RADIUS_PX));
        let is_clamp = settings.filter == Filter::Clamp;
        let cheap = if is_clamp { one.lt(one) } else { constant_depth & slow & unclipped };
        Evaluation { unfiltered, cheap, u, v, w }
    }

    /// Assembles the records of a group from the results of the other stages.
    #[inline(always)]
    fn records<S: Simd>(
        &self,
        simd: S,
        splats: &GroupLanes<S>,
        at: usize,
        stages: &Stages<S>,
        segment: &mut Segment,
    ) -> RecordLanes<S> {
        let Stages { classes, footprints, bounds, depths, evaluation } = stages;
        let FootprintLanes { projected, back_facing, epsilon, visible, filtered, .. } = footprints;
        let PixelBounds { base, fraction, keep, .. } = bounds;
        let Evaluation { unfiltered, cheap, u, v, w } = *evaluation;
        let (splat, color) = (&classes.splat, splats.color);
        let settings = &self.plan.splat_filter;
        let k = |v: f64| Lanes::splat(simd, v as f32);
        let (zero, one, half) = (k(0.0), k(1.0), k(0.5));
        if self.keeps_facings() {
            let kept = Lanes::select(mask32x16::from_bitmask(simd, *keep), *epsilon, zero);
            segment.largest_epsilon = segment.largest_epsilon.max(largest(kept));
        }
        let shown = self.shown_normal(simd, splat.p, splats.shading, (*back_facing, projected.facing_cosine), *keep);
        // Splats evaluated in one batch need their range in the same form: of e, and unlimited if the footprint is the
        // disk.
        let unlimited = k(f64::from(f32::MAX));
        let range = depths.range;
        let bits = |value: u32| Lanes::splat(simd, f32::from_bits(value));
        RecordLanes {
            base_x: base.x,
            base_y: base.y,
            offset_x: half - fraction.x,
            offset_y: half - fraction.y,
            u_x: u.x,
            u_y: u.y,
            v_x: v.x,
            v_y: v.y,
            depth_x: depths.gradient.x,
            depth_y: depths.gradient.y,
            z: splat.p.z,
            range_min: Lanes::select(unfiltered, -unlimited, Lanes::select(cheap, range[0] - one, range[0])),
            range_max: Lanes::select(unfiltered, unlimited, Lanes::select(cheap, range[1] - one, range[1])),
            epsilon: *epsilon,
            nearest: depths.z_min - depths.z_max.abs() * k(RANGE_SLACK),
            class_bits: Lanes::select(
                unfiltered,
                bits(UNFILTERED),
                Lanes::select(cheap, bits(FILTERED), bits(GENERAL)),
            ),
            red: color.x,
            green: color.y,
            blue: color.z,
            normal_x: shown.x,
            normal_y: shown.y,
            normal_z: shown.z,
            visible_u_x: visible.u.x,
            visible_u_y: visible.u.y,
            visible_v_x: visible.v.x,
            visible_v_y: visible.v.y,
            w_x: w.x,
            w_y: w.y,
            weight_scale: filtered.weight_scale,
            coverage_scale: if settings.filter == Filter::Clamp {
                filter::area_ratio(projected, k(settings.radius_px))
            } else {
                filtered.coverage_scale
            },
            object_bits: self.object_bits(simd, at, *back_facing),
            clip_bits: bits(0),
        }
    }

    /// Returns the field of records that stores the object's index, or the slot's number if slots are numbered,
    /// together with the facing.
    #[inline(always)]
    fn object_bits<S: Simd>(&self, simd: S, at: usize, back_facing: mask32x16<S>) -> Lanes<S> {
        let bits = |value: u32| Lanes::splat(simd, f32::from_bits(value));
        match (self.first_number, self.keeps_facings()) {
            (Some(first), keeps_facings) => {
                let with = |facing: Facing| {
                    let number = |lane: usize| f32::from_bits(facing.with_object(first + (at + lane) as u32));
                    Lanes::load(simd, &std::array::from_fn::<f32, LANES, _>(number))
                };
                let [none, front, back] = [Facing::Undeclared, Facing::Front, Facing::Back].map(with);
                if keeps_facings { Lanes::select(back_facing, back, front) } else { none }
            }
            (None, true) => {
                let [front, back] = [false, true].map(|back| Facing::of(back).with_object(self.index));
                Lanes::select(back_facing, bits(back), bits(front))
            }
            (None, false) => bits(self.index),
        }
    }

    /// Appends the records of a group, their clips, and their entries in tiles' lists.
    #[inline(always)]
    fn emit<S: Simd>(
        &self,
        simd: S,
        records: RecordLanes<S>,
        at: usize,
        stages: &Stages<S>,
        out: &mut SetupOutput<'_>,
    ) {
        let Stages { classes, footprints, bounds, depths, evaluation } = stages;
        let PixelBounds { base, fraction, ranges, keep, .. } = *bounds;
        let settings = &self.plan.splat_filter;
        let half = Lanes::splat(simd, 0.5);
        let whole_box = settings.filter == Filter::Clamp;
        let form = MaskForm { drawn: out.drawn, linear_depth: !settings.projective, whole_box };
        let wide = MaskForms {
            offset: V2::new(half - fraction.x, half - fraction.y),
            base,
            u: evaluation.u,
            v: evaluation.v,
            // Every filter's footprint contains the unfiltered one, and its w changes no more.
            w: if settings.projective { depths.range[1] } else { Lanes::splat(simd, 1.0) },
        };
        let mut masks = mask::masks(&wide, ranges, keep, &out.grid, form);
        let clips = self.clips().map(|clips| (clips, clips.clipped(at) & keep)).filter(|(_, clipped)| *clipped != 0);
        let clips = clips.map(|(clips, clipped)| Clips {
            clips,
            at,
            clipped,
            policy: self.plan.clip,
            projective: settings.projective,
            oriented: self.object.oriented,
            visible: turns(&footprints.visible_turn),
            filtered: turns(&footprints.visible_turn.after(&footprints.filtered.turn)),
        });
        if !self.is_transparent() {
            let clipped = clips.as_ref().map_or(0, |clips| clips.clipped);
            let keep = keep & masks.touching() & masks.drawn(form.drawn, &out.grid);
            let SetupOutput { grid, tiny, segment, entries, .. } = out;
            let tiny = match tiny {
                Some(tiny) if clipped == 0 => tiny.find(&records, keep, ranges),
                _ => None,
            };
            if let Some(tiny) = &tiny {
                masks.set_tiny(tiny.bits());
            }
            let first = segment.records.push_group(records, tiny.as_ref(), keep);
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
        let p = classes.splat.p;
        let [x, y, z] = [p.x.to_array(), p.y.to_array(), p.z.to_array()];
        for i in lanes_of(keep) {
            let mut part = out.part(self.transparent(at + i, || [x[i], y[i], z[i]]));
            let index = part.push(simd, &records[i], (&masks, i), form);
            if let Some(clips) = &clips {
                clips.clip(i, index, part.segment);
            }
        }
    }

    /// Returns the object's clips; `None` if it has none or the plan ignores them.
    #[inline(always)]
    fn clips(&self) -> Option<&StoredClips> {
        self.object.clips.as_ref().filter(|_| self.plan.clip != ClipPolicy::Off)
    }
}

impl ObjectView<'_> {
    /// Returns the shading normals as they are drawn. If the material is two-sided, normals of back-facing splats are
    /// turned to the eye. Splats that reach past the contour of an oriented surface are an exception (rendering model
    /// §2).
    #[inline(always)]
    fn shown_normal<S: Simd>(
        &self,
        simd: S,
        p: V3<Lanes<S>>,
        shading: V3<Lanes<S>>,
        (back_facing, cosine): (mask32x16<S>, Lanes<S>),
        keep: u64,
    ) -> V3<Lanes<S>> {
        let one = Lanes::splat(simd, 1.0);
        if !self.material.two_sided {
            return shading;
        }
        if self.object.oriented && back_facing.bits() & keep != 0 {
            let to_world = self.view.view_from_world.transpose().as_mat3();
            let to_eye = match self.view.projection.is_perspective() {
                true => -unit(p),
                false => vector(simd, Vec3::NEG_Z),
            };
            let turned = back_normal(shading, cosine, transform(&to_world, to_eye));
            return V3::select(back_facing, turned, shading);
        }
        shading * Lanes::select(back_facing, -one, one)
    }
}

/// A group of up to 16 splats of a chunk, which are set up together in lanes.
#[derive(Clone, Copy)]
struct Group<'a> {
    chunk: &'a Chunk,
    /// Slot of the group's first splat, an index into the object's columns.
    at: usize,
    /// Number of splats in the group. Further lanes repeat one of them and are ignored.
    active: usize,
}

/// The splats of a group in view space, with their attributes.
struct GroupLanes<S: Simd> {
    splat: ViewSplat<Lanes<S>>,
    /// Radii in world units, if the splats are disks and the object's matrix scales all directions alike.
    radius: Option<Lanes<S>>,
    /// Area vectors s × t in factors ([`Area`]), if they can be computed without the half-axes.
    area: Option<Area<Lanes<S>>>,
    /// Shading normals in world space.
    shading: V3<Lanes<S>>,
    color: V3<Lanes<S>>,
}

/// A group's splats in view space, with their classes by depth range and size.
struct DepthClasses<S: Simd> {
    /// Bits of the near splats ([`near`](crate::setup::near)), which are projected one by one in f64.
    near: u64,
    /// Bits of the splats that are projected in lanes, in f32.
    ordinary: u64,
    /// The splats in view space. Those that aren't ordinary have a harmless depth in place of their own.
    splat: ViewSplat<Lanes<S>>,
    /// Radii in world units, if the splats are disks and the object's matrix scales all directions alike.
    radius: Option<Lanes<S>>,
    /// Half the depth range of each splat's disk, in world units.
    extent: Lanes<S>,
}

/// A group's splats projected to the image, with and without the filter.
struct FootprintLanes<S: Simd> {
    projected: Projected<Lanes<S>>,
    back_facing: mask32x16<S>,
    /// Mask of the splats that are neither edge-on nor culled as back-facing.
    keep: mask32x16<S>,
    /// Depth tolerance ε of each splat, in world units.
    epsilon: Lanes<S>,
    /// Footprints of the splats without the filter, by which visibility is decided.
    visible: Footprint<Lanes<S>>,
    /// Maps from the (u, v) of `visible` to the (u, v) of the stored half-axes, in which clips are stated.
    visible_turn: Turn<Lanes<S>>,
    /// Footprints of the splats with the filter, and the factors of their weights.
    filtered: Filtered<Lanes<S>>,
    /// Bounding boxes of the footprints, in pixels from the projected centres.
    extent_px: Extent<Lanes<S>>,
}

/// Pixels that the splats of a group may touch, one lane per splat.
struct PixelBounds<S: Simd> {
    /// Reciprocals of the centres' depths; 1 in orthographic views.
    inverse_z: Lanes<S>,
    /// Column and row of the pixel that contains each splat's projected centre.
    base: V2<Lanes<S>>,
    /// Projected centre of each splat, in pixels from the upper left corner of pixel `base`.
    fraction: V2<Lanes<S>>,
    /// Range of pixels that each splat may touch, clipped to the region: first column, end column, first row, end row.
    ranges: [Lanes<S>; 4],
    /// Bits of the splats that may touch the region.
    keep: u64,
}

/// Depths of a group's splats as linear forms over pixels: of p_z/z, with p_z the depth of the splat's centre, or of z
/// if depth is linear.
struct DepthLanes<S: Simd> {
    /// Change of the depth form per pixel to the right and down.
    gradient: V2<Lanes<S>>,
    /// Smallest and largest value of the form over each splat's disk.
    range: [Lanes<S>; 2],
    /// Smallest planar depth of each splat, in world units.
    z_min: Lanes<S>,
    /// Largest planar depth of each splat, in world units.
    z_max: Lanes<S>,
}

/// Classes by which a group's splats are evaluated, and the gradients of the footprints that are evaluated.
struct Evaluation<S: Simd> {
    /// Mask of the splats that get the class bits [`UNFILTERED`]: the filter doesn't change their footprint, and their
    /// depth is nearly constant over the disk and between z_near and z_far.
    unfiltered: mask32x16<S>,
    /// Mask of the cheap splats ([`Class::Cheap`](crate::setup::record::Class::Cheap)), whose depth is nearly constant
    /// over the disk.
    cheap: mask32x16<S>,
    /// Change of the filtered footprint's form u·w' ([`Record`]) per pixel to the right and down.
    u: V2<Lanes<S>>,
    /// Change of the filtered footprint's form v·w' ([`Record`]) per pixel to the right and down.
    v: V2<Lanes<S>>,
    /// Change of the filtered footprint's form w' ([`Record`]) per pixel to the right and down.
    w: V2<Lanes<S>>,
}

/// Results of the stages of setup from which a group's records are assembled.
struct Stages<S: Simd> {
    classes: DepthClasses<S>,
    footprints: FootprintLanes<S>,
    bounds: PixelBounds<S>,
    depths: DepthLanes<S>,
    evaluation: Evaluation<S>,
}

/// Clips of a group's splats, and the data to convert them to forms over pixels.
struct Clips<'a> {
    clips: &'a StoredClips,
    /// Slot of the group's first splat, an index into the object's columns.
    at: usize,
    /// Bits of the group's splats that have a clip.
    clipped: u64,
    policy: ClipPolicy,
    projective: bool,
    oriented: bool,
    visible: [Turn<f32>; LANES],
    filtered: [Turn<f32>; LANES],
}

impl Clips<'_> {
    /// Converts the clip of splat `i` of the group, if it has one, and stores the clip's number in the record with
    /// index `index`.
    #[inline(always)]
    fn clip(&self, i: usize, index: usize, segment: &mut Segment) {
        let Some(clip) = self.clips.get(self.at + i, self.policy) else { return };
        let Some(record) = segment.records.get_mut(index) else { return };
        let unfiltered = record.visible_footprint(self.projective);
        let filtered = record.filtered_footprint();
        let unfiltered = Mapping { footprint: &unfiltered, turn: &self.visible[i] };
        let filtered = Mapping { footprint: &filtered, turn: &self.filtered[i] };
        let other = record.is_filtered().then_some(filtered);
        record.set_clip(segment.clips.push(&clip, unfiltered, other, self.oriented));
    }
}

/// Returns a mask of the pixels that are in the second range after they are clamped to the first. Ranges are (start,
/// length), along one axis.
#[inline(always)]
fn is_inside_clamped<S: Simd>(at: Lanes<S>, (first, length): (u32, u32), (start, count): (u32, u32)) -> mask32x16<S> {
    let k = |v: u32| at.constant(f64::from(v));
    let at = at.max(k(first)).min(k((first + length).saturating_sub(1)));
    k(start).le(at) & at.lt(k(start + count))
}

/// Returns the indices of the set bits, from the lowest.
fn lanes_of(bits: u64) -> impl Iterator<Item = usize> {
    (0..LANES).filter(move |i| bits >> i & 1 == 1)
}

/// Returns the column (or row) of the pixel that contains a point. `slope` is the point's x/z (or y/z), in an
/// orthographic view its coordinate.
#[inline(always)]
fn pixel_of<S: Simd>(slope: Lanes<S>, focal_px: f64, principal_px: f64) -> Lanes<S> {
    Lanes(slope.mul_add(slope.constant(focal_px), slope.constant(principal_px)).0.floor())
}

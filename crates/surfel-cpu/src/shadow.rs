//! Shadow maps (§5): visibility from the lights, by the same setup and tiles, and the share of a light that reaches a point.

use crate::bins::Grid;
use crate::composite::list_triangles;
use crate::frame::each_tile;
use crate::lane_math::transform;
use crate::lanes::{LANES, Lanes};
use crate::level::with_instructions;
use crate::mesh::{self, ScreenTriangle, TriangleSegment};
use crate::polygon::{self, Nearest, center, pixel_of};
use crate::prepare::{Preparation, Prepared};
use crate::raster::{Shared, Wants};
use crate::renderer::ResidentScene;
use crate::target::{Rows, cut, put_plane};
use crate::tile::{Counters, Listing, TileScratch};
use crate::visibility::visibility;
use fearless_simd::prelude::{SimdFloat, SimdMask};
use fearless_simd::{Simd, mask32x16};
use glam::{DVec3, Mat3, Vec3};
use surfel_math::depth::{plane_gradient, slope_allowance};
use surfel_math::projection::Projection;
use surfel_math::shadow::{TAPS, lookup_bias, tap_weights};
use surfel_math::{Real, V2, V3};
use surfel_model::Cull;
use surfel_render::{Attributes, FramePlan, ShadowMap, View};

/// A drawn shadow map.
pub(crate) struct Shadow {
    /// Index of its light.
    pub light: usize,
    projection: Projection,
    map_from_world: Mat3,
    /// From the light to the eye of the picture, world space.
    to_eye: Vec3,
    side: usize,
    /// Depth, bias included, up to which each texel is lit.
    kept: Vec<f32>,
}

/// Draws the plan's maps for a picture seen from `eye`. Everything opaque casts, whichever side of it the light or the eye sees.
pub(crate) fn draw(preparation: &Preparation<'_>, scene: &ResidentScene, eye: DVec3) -> Vec<Shadow> {
    let plan = preparation.plan;
    plan.shadow_maps.iter().map(|map| draw_map(preparation, scene, map, eye)).collect()
}

fn draw_map(preparation: &Preparation<'_>, scene: &ResidentScene, map: &ShadowMap, eye: DVec3) -> Shadow {
    let plan = FramePlan {
        splat_filter: map.splat_filter,
        attributes: Attributes::default(),
        passes: Vec::new(),
        shadow_maps: Vec::new(),
        ..preparation.plan.clone()
    };
    let preparation = Preparation { view: &map.view, plan: &plan, cull: Cull::None, finds_dots: false, ..*preparation };
    let [width, height] = map.view.size.map(|size| size as usize);
    let mut kept = vec![f32::INFINITY; width * height];
    let setups = preparation.setups();
    let (seen, _) = preparation.seen(&setups);
    for rows in preparation.batches(&setups, &seen, &scene.meshes) {
        let grid = preparation.grid(rows);
        let prepared = preparation.set_up(&setups, &seen, &grid, rows);
        let view = View { region: rows, ..map.view.clone() };
        let triangles = mesh::project_all(preparation.instructions, &scene.meshes, &view, &grid, Cull::None);
        let first = rows.y as usize * width;
        let targets = cut(&mut kept, &grid, rows, first, width);
        draw_rows(&preparation, &prepared, &triangles, grid, targets);
        preparation.recycled.give_back(prepared.segments);
    }
    Shadow {
        light: map.light,
        projection: map.view.projection,
        map_from_world: map.view.view_from_world.as_mat3(),
        to_eye: (eye - map.view.eye).as_vec3(),
        side: width,
        kept,
    }
}

/// Draws a batch of a map's rows.
fn draw_rows(
    preparation: &Preparation<'_>,
    prepared: &Prepared,
    triangles: &[TriangleSegment],
    grid: Grid,
    targets: Vec<Rows<'_, f32>>,
) {
    let (view, projection) = (preparation.view, &preparation.view.projection);
    let shared = Shared {
        wants: Wants::new(preparation.plan, view),
        near: &prepared.near,
        clips: &prepared.clips,
        factors: &[],
        coverage: &[],
        coverage_of_weight: None,
    };
    let job = MapJob { listing: Listing { segments: &prepared.segments, grid }, triangles, projection, shared };
    each_tile(
        (preparation.instructions, preparation.recycled),
        targets.into_iter().enumerate().collect(),
        |level, (tile, target), scratch| with_instructions!(level, simd => simd.vectorize(#[inline(always)] || job.draw(simd, *tile, target, scratch))),
    );
}

/// All tiles of some rows of a map.
struct MapJob<'a> {
    listing: Listing<'a>,
    triangles: &'a [TriangleSegment],
    projection: &'a Projection,
    shared: Shared<'a>,
}

impl<'a> MapJob<'a> {
    #[inline(always)]
    fn draw<S: Simd>(
        &self,
        simd: S,
        tile: usize,
        target: &mut Rows<'_, f32>,
        scratch: &mut TileScratch<'a>,
    ) -> Counters {
        let all = self.listing.blocks(tile);
        list_triangles(self.triangles, tile, all, &mut scratch.composite.triangles);
        self.listing.list(tile, all, &mut scratch.lists);
        let mut left = all;
        while left != 0 {
            let block = left.trailing_zeros();
            left &= left - 1;
            let at = self.listing.block_px(tile, block);
            let (splats, triangles) = (scratch.lists.of(simd, block), scratch.composite.triangles.of(block));
            if splats.is_empty() && triangles.is_empty() {
                continue;
            }
            let mut kept = visibility(simd, splats, at, &self.shared);
            if !triangles.is_empty() {
                let nearest = polygon::nearest(simd, triangles, at, self.shared.wants.exists());
                kept = kept.min(self.allowed(simd, &nearest, triangles, at));
            }
            put_plane(target, at, kept);
        }
        Counters::default()
    }

    /// Depths of a block's polygons, bias included.
    #[inline(always)]
    fn allowed<S: Simd>(&self, simd: S, nearest: &Nearest<S>, list: &[&ScreenTriangle], at: (i32, i32)) -> Lanes<S> {
        let (mut z, which) = (nearest.z.to_array(), nearest.indices());
        for (lane, z) in z.iter_mut().enumerate().filter(|(_, z)| z.is_finite()) {
            let Some(t) = list.get(which[lane]) else { continue };
            let own = f64::from(*z);
            let gradient = t.triangle.gradient(t.triangle.z, own, center(pixel_of(at, lane)));
            *z = (own + slope_allowance(own, gradient, self.projection)) as f32;
        }
        Lanes::load(simd, &z)
    }
}

/// Share of a light that reaches points, through all of its maps: of several the one along whose axis a point lies farthest.
/// `position` is relative to the eye, `normal` a unit vector, both in world space; other lanes than those of `wanted` mean nothing.
#[inline(always)]
pub(crate) fn reaching<S: Simd>(
    simd: S,
    maps: &[Shadow],
    position: V3<Lanes<S>>,
    normal: V3<Lanes<S>>,
    wanted: mask32x16<S>,
) -> Lanes<S> {
    let k = |v: f32| Lanes::splat(simd, v);
    let mut farthest = k(f32::NEG_INFINITY);
    for shadow in maps {
        farthest = farthest.max(shadow.in_map(simd, position).z);
    }
    let mut share = k(1.0);
    for shadow in maps {
        let p = shadow.in_map(simd, position);
        let own = wanted & farthest.le(p.z);
        if own.to_bitmask() != 0 {
            let n = transform(&shadow.map_from_world, normal);
            share = Lanes::select(own, shadow.share(simd, p, n), share);
        }
    }
    share
}

impl Shadow {
    /// Bytes of heap memory in use.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(self.kept.as_slice())
    }

    /// A position relative to the eye, in the map's view.
    #[inline(always)]
    fn in_map<S: Simd>(&self, simd: S, position: V3<Lanes<S>>) -> V3<Lanes<S>> {
        let k = |v: f32| Lanes::splat(simd, v);
        let o = self.to_eye;
        transform(&self.map_from_world, position + V3::new(k(o.x), k(o.y), k(o.z)))
    }

    /// The same for points and normals in the map's view.
    #[inline(never)]
    fn share<S: Simd>(&self, simd: S, p: V3<Lanes<S>>, normal: V3<Lanes<S>>) -> Lanes<S> {
        simd.vectorize(
            #[inline(always)]
            || self.filtered(simd, p, normal),
        )
    }

    #[inline(always)]
    fn filtered<S: Simd>(&self, simd: S, p: V3<Lanes<S>>, normal: V3<Lanes<S>>) -> Lanes<S> {
        let k = |v: f32| Lanes::splat(simd, v);
        let (projection, one) = (&self.projection, k(1.0));
        let before = p.z.lt(k(projection.near as f32));
        let depth = if projection.is_perspective() { Lanes::select(before, one, p.z) } else { one };
        let [fx, fy] = projection.focal_px.map(|f| k(f as f32));
        let [cx, cy] = projection.principal_px.map(|c| k(c as f32));
        let at = V2::new((p.x / depth).mul_add(fx, cx), (p.y / depth).mul_add(fy, cy));
        let gradient = plane_gradient(p, normal, projection);
        let nearer = p.z - lookup_bias(p.z, projection);
        let (columns, rows) = (taps(at.x), taps(at.y));
        let (left, top) = (columns.0.to_array().map(|v| v as i32), rows.0.to_array().map(|v| v as i32));
        let mut share = k(0.0);
        for (j, row_weight) in (0u8..).zip(rows.1) {
            let row_z = (rows.0 + k(f32::from(j) + 0.5) - at.y).mul_add(gradient.y, nearer);
            for (i, column_weight) in (0u8..).zip(columns.1) {
                let mut kept = [0.0; LANES];
                for (kept, (x, y)) in kept.iter_mut().zip(left.iter().zip(&top)) {
                    *kept = self.texel(x.wrapping_add(i.into()), y.wrapping_add(j.into()));
                }
                let z = (columns.0 + k(f32::from(i) + 0.5) - at.x).mul_add(gradient.x, row_z);
                let lit = z.le(Lanes::load(simd, &kept));
                share = share + Lanes::select(lit, column_weight * row_weight, k(0.0));
            }
        }
        Lanes::select(before, one, share)
    }

    /// What is kept in this column and row; +∞ outside of the map, where nothing casts.
    #[inline(always)]
    fn texel(&self, x: i32, y: i32) -> f32 {
        let (x, y) = (x as u32 as usize, y as u32 as usize);
        if x < self.side && y < self.side { self.kept[y * self.side + x] } else { f32::INFINITY }
    }
}

/// First column (or row) and the weights of a lookup.
#[inline(always)]
fn taps<S: Simd>(texel: Lanes<S>) -> (Lanes<S>, [Lanes<S>; TAPS]) {
    let from_center = texel - texel.constant(0.5);
    let whole = Lanes(from_center.0.floor());
    (whole - texel.one(), tap_weights(from_center - whole))
}

//! Tests of the evaluators against the rendering model's formulas in f64, up to the limits of their classes and beyond.

use crate::cull::chunks::visible_chunks;
use crate::cull::object::ObjectView;
use crate::raster::fragment::{cheap_batch, fragment};
use crate::raster::inputs::{RasterFrame, RasterInputs};
use crate::renderer::CAPABILITIES;
use crate::scene::resident::ResidentScene;
use crate::setup::evaluate::Fragment;
use crate::setup::prepare::{CellSetup, CellSplats, SetupPool};
use crate::setup::record::{Batch, Class, Record};
use crate::setup::tiny::TinyFinder;
use crate::simd::lanes::Lanes;
use crate::simd::level::{Instructions, SimdLevel, with_instructions};
use crate::tiles::grid::Grid;
use fearless_simd::Simd;
use fearless_simd::prelude::*;
use glam::{DAffine3, DVec3, Vec3};
use std::sync::Arc;
use surfel_math::depth::{DepthForm, DepthPlane};
use surfel_math::filter::{self, Filtered};
use surfel_math::kernel;
use surfel_math::mapping::Footprint;
use surfel_math::project::{Projected, ViewSplat};
use surfel_math::{V2, V3};
use surfel_model::{
    Camera, CloudData, Column3, Cull, Filter, Geometry, Material, Object, OnInvalid, Scene, Settings, Shape,
    SplatCloud, Storage,
};
use surfel_render::{FramePlan, Planes, View, plan};

const FOCAL_PX: f64 = 300.0;
const SIZE_PX: u32 = 96;
/// Distance of the splat from the eye.
const Z: f64 = 4.0;

/// Largest depth difference between centre and rim of a splat that isn't of [`Class::Near`], as a fraction of its
/// distance.
const NEAR: f64 = 0.5;

/// Largest relative error, e⁴, of the cheap evaluator's reciprocal of 1 + e. A splat may be cheap only if |e| stays
/// below 1/38.6 over its filtered disk; over the disk itself it stays below 1/63.
const RECIPROCAL: f64 = 4.5e-7;
/// Largest |dW/d ln w| of the weight W = e^(−2ρ²) if ρ² ∝ w⁻²: 4ρ²·e^(−2ρ²) at ρ² = ½.
const WEIGHT_PER_RECIPROCAL: f64 = 0.736;
/// Error of the kernel's polynomial at cutoff 2, as bounded by its own test.
const KERNEL: f64 = 1.2e-6;
/// Half an ulp of 1 in f32.
const ROUNDING: f64 = 1.0 / (1u32 << 24) as f64;
/// Number of roundings, of half an ulp each, from a centre and half-axes to w or to a coordinate (u, v).
const STEPS: f64 = 16.0;

/// A splat whose depth varies, as fractions of its distance, by `extent` from centre to rim and by `steepness` per
/// pixel along its slope. `across_px` is the length in pixels of the half-axis across the slope; `None` if both
/// half-axes are equally long.
#[derive(Clone, Copy, Debug)]
struct Tilted {
    extent: f64,
    steepness: f64,
    across_px: Option<f64>,
    center: [f64; 2],
}

impl Tilted {
    /// Returns a splat in the middle of the image. The gradients along both coordinates add up to `steepness`, since
    /// their sum is the quantity with a limit.
    fn new(extent: f64, steepness: f64, across_px: Option<f64>) -> Self {
        Self { extent, steepness: steepness / (0.8 + 0.6), across_px, center: [0.003, -0.002] }
    }

    /// Returns the centre and half-axes, in f32 as in scenes.
    fn vectors(&self) -> [Vec3; 3] {
        let tilt = (self.steepness * FOCAL_PX).atan();
        let radius = self.extent * Z / tilt.sin();
        // Turned a little, so that no coordinate is zero.
        let turn = |v: DVec3| DVec3::new(v.x * 0.8 - v.y * 0.6, v.x * 0.6 + v.y * 0.8, v.z);
        let across = self.across_px.map_or(radius, |px| px * Z / FOCAL_PX);
        let [x, y] = self.center;
        [DVec3::new(x, y, 0.0), turn(DVec3::new(tilt.cos(), 0.0, tilt.sin()) * radius), turn(DVec3::Y * across)]
            .map(DVec3::as_vec3)
    }

    fn scene(&self) -> Scene {
        let [center, s, t] = self.vectors().map(|v| Column3::from_f32(vec![v]));
        let data = CloudData::new(DVec3::ZERO, center, Shape::Ellipses { s, t });
        let cloud = SplatCloud::new(data, OnInvalid::Refuse).unwrap().0;
        let material = Material { interior_weight: Some(1.5), ..Material::default() };
        let geometry = Geometry::Splats(Arc::new(cloud));
        Scene {
            objects: vec![Object { geometry, world_from_object: DAffine3::IDENTITY, material }],
            ..Scene::default()
        }
    }

    /// Returns the half-lengths in pixels of the projected ellipse, the longer first. A filter lengthens the shorter
    /// one to about half a pixel.
    fn lengths_px(&self, filter: Filter) -> [f64; 2] {
        let tilt = (self.steepness * FOCAL_PX).atan();
        let along = self.extent / self.steepness;
        let across = self.across_px.unwrap_or(along / tilt.cos());
        let least = if filter == Filter::None { 0.0 } else { 0.5 };
        [along.max(across).max(least), along.min(across).max(least)]
    }
}

fn view() -> View {
    let principal = [0.5 * f64::from(SIZE_PX); 2];
    let camera = Camera::intrinsics([0.0, 0.0, Z], [0.0; 3], [FOCAL_PX; 2], principal, [SIZE_PX; 2]);
    View::new(&camera.with_near(0.1)).unwrap()
}

/// A splat evaluated at a pixel.
#[derive(Clone, Copy, Debug)]
struct Hit {
    px: (i32, i32),
    visible: bool,
    inside: bool,
    z: f64,
    weight: f64,
}

/// The backend's evaluation of a single splat, at all pixels of the blocks that list it.
struct Drawn {
    class: Class,
    /// Method that evaluates a batch of four splats of this class.
    batch: Batch,
    hits: Vec<Hit>,
    /// The same evaluation by the evaluator of batches, if the splat has one.
    in_batch: Vec<Hit>,
}

/// Draws a splat; `None` if it touches no pixel.
fn drawn(splat: &Tilted, view: &View, filter: Filter, finds_tiny: bool) -> Option<Drawn> {
    let scene = splat.scene();
    let resident = ResidentScene::new(&scene, Storage::default()).unwrap();
    let plan = plan_of(&resident, view, filter);
    let instructions = Instructions::new(SimdLevel::Best).unwrap();
    let objects = ObjectView::all(&resident.clouds, view, &plan, Cull::Back);
    let (tiny, pool) = (TinyFinder::new(&plan, view), SetupPool::default());
    let setup = CellSetup { instructions, objects: &objects, tiny: finds_tiny.then_some(&tiny), pool: &pool };
    let (grid, mut splats) = (Grid::new(view.region, 8), CellSplats::default());
    setup.add(&visible_chunks(&objects).chunks, &grid, view.region, &mut splats);
    let frame = RasterFrame::depth_only(&plan, view);
    let inputs = RasterInputs { frame: &frame, near: &splats.near, clips: &splats.clips, largest_epsilon: 0.0 };
    let segment = &splats.segments[0];
    let record = segment.records.first()?;
    let mut drawn =
        Drawn { class: record.class(), batch: Batch::of(&[record; 4]), hits: Vec::new(), in_batch: Vec::new() };
    for tile in 0..grid.tiles() {
        for entry in segment.lists.of(tile) {
            for block in (0..64).filter(|block| entry.blocks >> block & 1 == 1) {
                let px = grid.block_px(tile, block);
                with_instructions!(instructions, simd => draw_block(simd, record, px, &inputs, &mut drawn));
            }
        }
    }
    Some(drawn)
}

fn plan_of(resident: &ResidentScene, view: &View, filter: Filter) -> FramePlan {
    let settings = Settings::default().with_filter(filter);
    plan(&resident.summary, view, &settings, Planes::ALL, &CAPABILITIES).unwrap()
}

fn draw_block<S: Simd>(simd: S, record: &Record, px: (i32, i32), inputs: &RasterInputs<'_>, drawn: &mut Drawn) {
    let k = |v: i32| Lanes::splat(simd, v as f32);
    let at = (Lanes::block_columns(simd) + k(px.0), Lanes::block_rows(simd) + k(px.1));
    let hits = |fragment: &Fragment<S>| {
        let (visible, inside) = (fragment.visible.to_bitmask(), fragment.inside.to_bitmask());
        let (z, weight) = (fragment.z.to_array(), fragment.weight.to_array());
        std::array::from_fn::<Hit, 16, _>(|i| Hit {
            px: (px.0 + (i % 4) as i32, px.1 + (i / 4) as i32),
            visible: visible >> i & 1 == 1,
            inside: inside >> i & 1 == 1,
            z: z[i].into(),
            weight: weight[i].into(),
        })
    };
    drawn.hits.extend(hits(&fragment(simd, record, at, px, inputs)));
    let batch = match drawn.batch {
        Batch::Unfiltered => cheap_batch::<S, false>(simd, [record; 4], [at; 4], inputs),
        Batch::Filtered => cheap_batch::<S, true>(simd, [record; 4], [at; 4], inputs),
        Batch::Scalar => return,
    };
    batch.iter().for_each(|fragment| drawn.in_batch.extend(hits(fragment)));
}

/// A splat projected in f64 by the formulas of `surfel-math`, as the truth for comparisons.
struct Exact {
    center_px: V2<f64>,
    unfiltered: Footprint<f64>,
    filtered: Filtered<f64>,
    depth: DepthPlane<f64>,
    form: DepthForm,
    cutoff: f64,
}

impl Exact {
    fn new(splat: &Tilted, view: &View, filter: Filter) -> Self {
        let resident = ResidentScene::new(&splat.scene(), Storage::default()).unwrap();
        let settings = plan_of(&resident, view, filter).splat_filter;
        let [p, s, t] = splat.vectors().map(Vec3::as_dvec3);
        let in_view = |v: DVec3| V3::from(view.view_from_world * v);
        let n = surfel_math::basis::unit(s).cross(surfel_math::basis::unit(t)).normalize();
        let mut splat = ViewSplat { p: in_view(p - view.eye), s: in_view(s), t: in_view(t), n: in_view(n) };
        let extent = splat.s.z.hypot(splat.t.z);
        if filter == Filter::Adjust {
            (splat.s, splat.t) = filter::adjust_axes(&splat, true);
        }
        let projected = Projected::new(&splat, &view.projection);
        let (h, projective) = (settings.radius_px, settings.projective);
        let unfiltered = Footprint::unfiltered(&projected, projective);
        let filtered = match filter {
            Filter::Principal => filter::principal(&projected, h, projective),
            Filter::Adjust => filter::adjust(&projected, h, projective),
            Filter::Ewa => filter::ewa(&projected, h),
            _ => Filtered::unfiltered(unfiltered),
        };
        let (gradient, form) = match projective {
            true => (-projected.depth_gradient, DepthForm::Reciprocal),
            false => (projected.depth_gradient * splat.p.z, DepthForm::Linear),
        };
        let (z_min, z_max) = (splat.p.z - extent, splat.p.z + extent);
        let depth = DepthPlane { scale: splat.p.z, gradient, at_anchor: 1.0, z_min, z_max };
        Self { center_px: view.projection.pixel(splat.p), unfiltered, filtered, depth, form, cutoff: settings.cutoff }
    }

    /// Evaluates the splat at a pixel; `None` near the edge of a footprint, where rounding decides.
    fn at(&self, px: (i32, i32)) -> Option<Hit> {
        let d = V2::new(f64::from(px.0) + 0.5, f64::from(px.1) + 0.5) - self.center_px;
        let rho_squared = |footprint: &Footprint<f64>| {
            let (u, v, w) = footprint.at(d);
            if w > 0.0 { (u * u + v * v) / (w * w) } else { f64::INFINITY }
        };
        let squares = [&self.unfiltered, &self.filtered.footprint].map(rho_squared);
        let weight = kernel::weight(squares[1], self.cutoff) * self.filtered.weight_scale;
        let [visible, inside] = squares.map(|square| square <= 1.0);
        let hit = Hit { px, visible, inside, z: self.depth.at(d, self.form), weight };
        squares.iter().all(|square| (square - 1.0).abs() > 2e-3).then_some(hit)
    }
}

/// Compares hits with the exact splat and returns the number of pixels inside. `reciprocal` is the relative error of
/// 1/w.
fn compare(hits: &[Hit], splat: &Tilted, exact: &Exact, filter: Filter, reciprocal: f64, what: &str) -> usize {
    let [major_px, minor_px] = splat.lengths_px(filter);
    // A coordinate u or v is rounded relative to the largest value of its terms over the block, along the shorter axis.
    // ρ changes by at most √2 times the larger of both errors. The weight changes by at most √(2c/e) = 1.213 times the
    // change of ρ, at cutoff c = 2.
    let coordinate = STEPS * (major_px + 1.0) / minor_px * ROUNDING;
    let weight_bound = 1.213 * 2f64.sqrt() * coordinate + WEIGHT_PER_RECIPROCAL * reciprocal + KERNEL;
    // The gradient of w times an offset of up to the ellipse's length, rounded as often.
    let depth_bound = reciprocal + STEPS * ROUNDING * (1.0 + splat.steepness * (major_px + 1.0));
    let mut inside = 0;
    for hit in hits {
        let Some(want) = exact.at(hit.px) else { continue };
        let at = format!("{what}: {splat:?} {filter:?} at {:?}", hit.px);
        assert_eq!((hit.visible, hit.inside), (want.visible, want.inside), "{at}");
        if want.inside {
            inside += 1;
            let weight = (hit.weight - want.weight).abs();
            assert!(weight <= weight_bound, "{at}: weight off by {weight:e}, bound {weight_bound:e}");
            let depth = (hit.z / want.z - 1.0).abs();
            assert!(depth <= depth_bound, "{at}: depth off by {depth:e}, bound {depth_bound:e}");
        }
    }
    // Blocks that don't list the splat have none of its pixels.
    let listed: std::collections::BTreeSet<(i32, i32)> = hits.iter().map(|hit| hit.px).collect();
    let size = SIZE_PX as i32;
    for px in (0..size * size).map(|i| (i % size, i / size)).filter(|px| !listed.contains(px)) {
        assert!(exact.at(px).is_none_or(|hit| !hit.inside), "{what}: {splat:?} {filter:?} isn't listed at {px:?}");
    }
    inside
}

const FILTERS: [Filter; 4] = [Filter::Principal, Filter::None, Filter::Adjust, Filter::Ewa];

/// Values of the steepness, summed over both axes, that splats are tested with: from nearly parallel to the image to
/// nearly edge-on, at a cosine of about 1/214.
const STEEPNESS: [f64; 8] = [0.0005, 0.002, 0.0049, 0.0051, 0.015, 0.031, 0.05, 1.0];

/// Returns the largest extent of a cheap splat ([`Class::Cheap`]) of some shape, and an extent just beyond it. `None`
/// if even an extent of 1e-3 isn't cheap.
fn limit(of_extent: impl Fn(f64) -> Tilted, view: &View, filter: Filter) -> Option<[f64; 2]> {
    let is_cheap = |extent| drawn(&of_extent(extent), view, filter, false).is_some_and(|d| d.class == Class::Cheap);
    let (mut cheap, mut other) = (1e-3, 0.98 * NEAR);
    if !is_cheap(cheap) {
        return None;
    }
    assert!(!is_cheap(other), "{:?} {filter:?}", of_extent(other));
    for _ in 0..12 {
        let middle = 0.5 * (cheap + other);
        if is_cheap(middle) {
            cheap = middle;
        } else {
            other = middle;
        }
    }
    Some([cheap, other])
}

#[test]
fn class_is_the_cheapest_one_that_serves() {
    let gentle = 0.0005;
    for (splat, class, batch) in [
        (Tilted::new(1.0 / 66.0, gentle, None), Class::Cheap, Batch::Unfiltered),
        (Tilted::new(1.0 / 38.0, gentle, None), Class::General, Batch::Scalar),
        // Thinner than h, and therefore filtered.
        (Tilted::new(1.0 / 66.0, gentle, Some(0.3)), Class::Cheap, Batch::Filtered),
        (Tilted::new(1.0 / 38.0, gentle, Some(0.3)), Class::General, Batch::Scalar),
        (Tilted::new(1.0 / 66.0, 1.0, None), Class::General, Batch::Scalar),
        (Tilted::new(0.98 * NEAR, 0.03, None), Class::General, Batch::Scalar),
        (Tilted::new(1.02 * NEAR, 0.03, None), Class::Near, Batch::Scalar),
    ] {
        let found = drawn(&splat, &view(), Filter::Principal, false).map(|drawn| (drawn.class, drawn.batch));
        assert_eq!(found, Some((class, batch)), "{splat:?}");
    }
}

#[test]
fn evaluators_err_by_no_more_than_their_bounds() {
    let (view, mut compared, mut limits) = (view(), [0; 3], 0);
    for steepness in STEEPNESS {
        for across_px in [None, Some(0.3), Some(1.2), Some(40.0)] {
            for filter in FILTERS {
                let of_extent = |extent| Tilted::new(extent, steepness, across_px);
                let limit = limit(of_extent, &view, filter);
                limits += usize::from(limit.is_some());
                let [cheap, other] = limit.unwrap_or([1.0 / 64.0; 2]);
                for splat in [0.5 * cheap, cheap, other, 0.25 * NEAR, 0.98 * NEAR].map(of_extent) {
                    // Without a filter such a splat touches no pixel, or its fragments are dominated by rounding.
                    if filter == Filter::None && splat.lengths_px(filter)[1] < 0.25 {
                        continue;
                    }
                    let Some(found) = drawn(&splat, &view, filter, false) else { continue };
                    let exact = Exact::new(&splat, &view, filter);
                    let reciprocal = if found.class == Class::Cheap { RECIPROCAL } else { 0.0 };
                    let inside = compare(&found.hits, &splat, &exact, filter, reciprocal, "alone");
                    match found.batch {
                        Batch::Unfiltered => compared[0] += inside,
                        Batch::Filtered => compared[1] += inside,
                        Batch::Scalar => compared[2] += inside,
                    }
                    if found.batch != Batch::Scalar {
                        compare(&found.in_batch, &splat, &exact, filter, reciprocal, "in a batch");
                    }
                }
            }
        }
    }
    assert!(compared.iter().all(|&pixels| pixels > 2000), "unfiltered, filtered, general: {compared:?} pixels");
    assert!(limits > 20, "{limits} shapes may be cheap");
}

#[test]
fn tiny_splats_err_by_no_more_than_the_evaluators_that_setup_takes() {
    let (view, mut compared) = (view(), [0; 2]);
    for radius_px in [0.2, 0.5, 0.8] {
        for steepness in STEEPNESS {
            for center in [[0.003, -0.002], [0.0066, 0.0001], [-0.0031, 0.0065]] {
                let extent = radius_px * steepness / (0.8 + 0.6);
                let splat = Tilted { center, ..Tilted::new(extent, steepness, Some(radius_px)) };
                for filter in FILTERS.into_iter().filter(|&filter| splat.lengths_px(filter)[1] > 0.15) {
                    let tiny = drawn(&splat, &view, filter, true).filter(|drawn| drawn.class == Class::Tiny);
                    let Some(tiny) = tiny else { continue };
                    let alone = drawn(&splat, &view, filter, false).map(|drawn| drawn.class);
                    let is_cheap = alone == Some(Class::Cheap);
                    let reciprocal = if is_cheap { RECIPROCAL } else { 0.0 };
                    let exact = Exact::new(&splat, &view, filter);
                    compared[usize::from(is_cheap)] += compare(&tiny.hits, &splat, &exact, filter, reciprocal, "tiny");
                }
            }
        }
    }
    assert!(compared.iter().all(|&pixels| pixels > 100), "general, cheap: {compared:?} pixels");
}

//! Tests of the GPU backends' compute path: it draws the raster path's image, and sums in a fixed order on any device.

use crate::drawing::{counter, drawn_once};
use crate::validated_gpu;
use glam::{DAffine3, DVec3};
use std::sync::Arc;
use surfel_ash::Limits;
use surfel_conformance::build::{Clipped, Splat, camera, clipped_cloud, cloud, object, scene, with_alpha};
use surfel_conformance::expectations::Extent;
use surfel_conformance::harness::{Truth, check_all};
use surfel_conformance::scenes::{self, Case};
use surfel_gpu::{CELL_PAIRS, GpuPath};
use surfel_model::{ClipCurve, ClipLine, ClipMode, Cull, EdgeAa, Geometry, Shader, SplatCloud, Storage};
use surfel_render::{Frame, Planes, Renderer, SceneSummary, Stats, plan};

fn planes() -> Planes {
    Planes::ALL.with_fragments(true)
}

fn is_by_cells(stats: &Stats) -> bool {
    counter(stats, CELL_PAIRS).is_some()
}

/// True if [`GpuPath::Auto`] selects the compute path for a case.
fn is_for_cells(case: &Case, renderer: &impl Renderer) -> bool {
    let summary = SceneSummary::of(&case.scene);
    let plan = plan(&summary, &case.view(), &case.settings, planes(), &renderer.info().capabilities);
    plan.is_ok_and(|plan| GpuPath::Auto.draws_cells(&plan))
}

/// Returns `count` disks that face the eye, spread evenly over a circle of radius `spread`, at five depths.
fn wall_splats(count: usize, radius: f64, spread: f64) -> Vec<Splat> {
    let disk = |i: usize| {
        let angle = i as f64 * 2.399_963;
        let at = DVec3::new(angle.cos(), angle.sin(), 0.0) * (spread * (i as f64 / count as f64).sqrt());
        let color = [0.1 + 0.8 * (i % 7) as f32 / 7.0, 0.5, 0.9 - 0.8 * (i % 3) as f32 / 3.0];
        Splat::disk(at - DVec3::Z * (0.001 * (i % 5) as f64), DVec3::Z, radius, color)
    };
    (0..count).map(disk).collect()
}

fn wall(count: usize, radius: f64, spread: f64, size: [u32; 2]) -> Case {
    let mut case = Case::new("wall", scene(&wall_splats(count, radius, spread)), camera(4.0, 30.0, size));
    case.scene.objects[0].material.interior_weight = Some(2.0);
    case
}

/// Returns a wall of `count / 10` whole splats, and `count` splats that are halved by a clip line, except for every
/// third. Every fourth of these has a clip curve, too.
fn clipped_wall(count: usize, radius: f64, spread: f64, size: [u32; 2]) -> Case {
    let clipped = |(i, splat): (usize, Splat)| {
        let (sin, cos) = (i as f32).sin_cos();
        Clipped {
            splat,
            curve: (i % 4 == 0).then_some(ClipCurve { theta1: 0.3, theta3: 2.5, u: 0.2, v: 0.1, w: 0.8 }),
            lines: if i % 3 == 0 { Vec::new() } else { vec![ClipLine { a: cos, b: sin, c: 0.1 }] },
            mode: ClipMode::And,
        }
    };
    let splats: Vec<Clipped> = wall_splats(count, radius, spread).into_iter().enumerate().map(clipped).collect();
    let mut clipped = object(clipped_cloud(&splats));
    clipped.material.interior_weight = Some(2.0);
    let mut case = wall(count / 10, radius, spread, size);
    case.name = "clipped wall".into();
    case.scene.objects.push(clipped);
    case
}

/// Returns a wall of an oriented cloud. Every third splat faces away.
fn sided_wall(count: usize, radius: f64, spread: f64, size: [u32; 2]) -> Case {
    let mut splats = wall_splats(count, radius, spread);
    splats.iter_mut().step_by(3).for_each(|splat| std::mem::swap(&mut splat.s, &mut splat.t));
    let mut case = wall(count, radius, spread, size);
    let mut sides = object(cloud(&splats));
    (sides.material.interior_weight, sides.material.oriented) = (Some(2.0), Some(true));
    sides.material.cull = Cull::None;
    case.name = "wall of two sides".into();
    case.scene.objects = vec![sides];
    case
}

/// Returns a wall whose farthest splats are opaque, and all others transparent. No opaque and transparent splats have
/// the same depth, where rounding would decide which is nearer.
fn glass_wall(count: usize, radius: f64, spread: f64, size: [u32; 2], transparency: &str) -> Case {
    let alpha = |i: usize| if i % 5 == 4 { 1.0 } else { 0.2 + 0.1 * (i % 6) as f32 };
    let mut glass = object(with_alpha(cloud(&wall_splats(count, radius, spread)), alpha));
    glass.material.interior_weight = Some(2.0);
    let mut case = wall(count, radius, spread, size);
    case.scene.objects = vec![glass];
    case.with(transparency, |s| s.transparency = transparency.parse().unwrap())
}

fn values(frame: &Frame) -> [&[f32]; 4] {
    [frame.color().as_flattened(), frame.normal().as_flattened(), frame.depth(), frame.weight()]
}

/// Asserts that two frames are equal except for a different order of sums. Values may differ by 2e-5, and those above 1
/// by 2e-5 of the value. The numbers of fragments must be equal.
fn are_alike(a: &Frame, b: &Frame, name: &str) {
    for (a, b) in values(a).iter().zip(values(b)).flat_map(|(a, b)| a.iter().zip(b)).filter(|(a, b)| a != b) {
        assert!((a - b).abs() <= 2e-5 * b.abs().max(1.0), "{name}: {a} {b}");
    }
    assert_eq!(a.fragments(), b.fragments(), "{name}");
}

/// Asserts that two frames of a case have the same bits, and names the first planes that differ.
fn are_equal(a: &Frame, b: &Frame, case: &Case) {
    let name = format!("{}, {:?}", case.name, case.settings.edge_aa);
    for (plane, (a, b)) in ["color", "normal", "depth", "weight"].iter().zip(values(a).iter().zip(values(b))) {
        let unlike: Vec<usize> = (0..a.len()).filter(|&k| a[k].to_bits() != b[k].to_bits()).collect();
        let first = unlike.first().map(|&k| (k, a[k], b[k]));
        assert!(unlike.is_empty(), "{name}: {} of {} values of {plane}, first {first:?}", unlike.len(), a.len());
    }
    assert_eq!(a.fragments(), b.fragments(), "{name}");
    assert!(a == b, "{name}: planes of indices");
}

/// Calls a test with both backends on a path, as far as they are available.
macro_rules! with_each {
    ($path:expr, $run:expr) => {
        if let Some(mut ash) = validated_gpu::ash_by($path) {
            $run(&mut ash);
        }
        if let Some(mut wgpu) = validated_gpu::wgpu_by($path) {
            $run(&mut wgpu);
            validated_gpu::no_messages();
        }
    };
}

fn agrees_by_raster_hardware(renderer: &mut impl Renderer) {
    let checked = check_all(renderer, Truth::of_every_scene().unwrap(), Extent::EveryScene);
    let failed: Vec<String> = checked.iter().filter(|c| !c.report.is_ok()).map(|c| c.report.to_string()).collect();
    assert!(failed.is_empty(), "{}", failed.join("\n"));
}

/// Compares the raster path with the reference in every scene; `gpu_backends` compares the path that is selected by
/// default.
#[test]
#[ignore = "118 s on lavapipe with two cores: cargo xtask test --full"]
fn raster_hardware_agrees_with_the_reference_on_every_scene() {
    if let Some(mut ash) = validated_gpu::ash_by(GpuPath::Raster) {
        agrees_by_raster_hardware(&mut ash);
    }
    if let Some(mut wgpu) = validated_gpu::wgpu_by(GpuPath::Raster) {
        agrees_by_raster_hardware(&mut wgpu);
        validated_gpu::no_messages();
    }
}

#[test]
fn rule_decides_which_path_draws() {
    let follows = |renderer: &mut dyn FnMut(&Case) -> (bool, Stats)| {
        let mut drawn = [0; 2];
        for case in scenes::all().iter().step_by(9) {
            let (is_for_cells, stats) = renderer(case);
            assert_eq!(is_by_cells(&stats), is_for_cells, "{}", case.name);
            drawn[usize::from(is_for_cells)] += 1;
        }
        assert!(drawn.iter().all(|&count| count > 3), "{drawn:?}");
    };
    let Some(mut ash) = validated_gpu::ash() else { return };
    follows(&mut |case| (is_for_cells(case, &ash), drawn_once(&mut ash, case, planes()).1));
    let Some(mut raster) = validated_gpu::ash_by(GpuPath::Raster) else { return };
    assert!(!is_by_cells(&drawn_once(&mut raster, &scenes::closed_sphere(), planes()).1));
}

#[test]
fn both_paths_draw_the_same_image() {
    let (Some(mut cells), Some(mut raster)) =
        (validated_gpu::ash_by(GpuPath::Compute), validated_gpu::ash_by(GpuPath::Raster))
    else {
        return;
    };
    let cases = scenes::all();
    let some = cases.iter().filter(|case| is_for_cells(case, &cells)).step_by(4);
    for case in some.collect::<Vec<_>>() {
        let (ours, stats) = drawn_once(&mut cells, case, planes());
        let (theirs, of_raster) = drawn_once(&mut raster, case, planes());
        assert!(is_by_cells(&stats) && !is_by_cells(&of_raster), "{}", case.name);
        assert_eq!(stats.drawn, of_raster.drawn, "{}", case.name);
        // Raster hardware also counts fragments behind edges and those of samples.
        let is_plain = case.settings.edge_aa == EdgeAa::Off;
        assert!(!is_plain || stats.fragments == of_raster.fragments, "{}", case.name);
        are_alike(&ours, &theirs, &case.name);
    }
}

/// Returns a case whose splats have the rows that a plane of indices needs.
fn with_rows(mut case: Case) -> Case {
    for object in &mut case.scene.objects {
        if let Geometry::Splats(cloud) = &mut object.geometry {
            let rows: Vec<u32> = (0..cloud.len() as u32).collect();
            *cloud = Arc::new(SplatCloud::clone(cloud).with_rows(&rows).unwrap());
        }
    }
    case
}

/// Returns the case with each kind of edge antialiasing: off, by coverage, and by samples.
fn by_every_edge(case: &Case) -> [Case; 3] {
    [EdgeAa::Off, EdgeAa::Coverage, EdgeAa::Samples].map(|edge_aa| case.with("edges", |s| s.edge_aa = edge_aa))
}

/// Compares the compute path with the raster path for four shaders and both kinds of edge antialiasing. Shaders that
/// read neighbours (toon, edl) must run before edges are blended, and once per sample.
fn draws_edges_of_every_shader(renderer: &mut impl Renderer) {
    let Some(mut raster) = validated_gpu::ash_by(GpuPath::Raster) else { return };
    let plain = scenes::sphere_before_plane();
    for shader in [Shader::Unlit, Shader::Phong, Shader::Toon, Shader::Edl] {
        let [off, edges @ ..] = by_every_edge(&plain.with("shader", |s| s.shader = shader));
        let without = drawn_once(renderer, &off, planes()).0;
        for case in edges {
            let name = format!("{shader:?} {:?}", case.settings.edge_aa);
            let (ours, stats) = drawn_once(renderer, &case, planes());
            assert!(is_by_cells(&stats) && ours.color() != without.color(), "{name}");
            are_alike(&ours, &drawn_once(&mut raster, &case, planes()).0, &name);
        }
    }
}

#[test]
fn edges_of_every_shader_are_antialiased() {
    with_each!(GpuPath::Compute, draws_edges_of_every_shader);
}

/// Draws a case with samples twice, and returns the statistics. Asserts that both frames are equal, and that all but 20
/// pixels agree with the CPU's.
fn agrees_with_the_cpu(renderer: &mut impl Renderer, case: &Case) -> Stats {
    let case = case.with("samples", |s| s.edge_aa = EdgeAa::Samples);
    let (first, stats) = drawn_once(renderer, &case, Planes::COLOR);
    assert!(is_by_cells(&stats));
    assert_eq!(first, drawn_once(renderer, &case, Planes::COLOR).0);
    let mut cpu = surfel_cpu::Renderer::new(Default::default()).unwrap();
    let theirs = drawn_once(&mut cpu, &case, Planes::COLOR).0;
    let is_soft = |color: &&[f32; 4]| color[3] > 0.1 && color[3] < 0.9;
    assert!(theirs.color().iter().filter(is_soft).count() > 1000);
    // Rounding may decide otherwise about a sample, a sixteenth of a pixel.
    let are_unlike = |(a, b): &(&[f32; 4], &[f32; 4])| a.iter().zip(*b).any(|(a, b)| (a - b).abs() > 0.07);
    let unlike = first.color().iter().zip(theirs.color()).filter(are_unlike).count();
    assert!(unlike <= 20, "{unlike} pixels");
    stats
}

/// Draws a cell of samples with more pairs than the compute path draws, which raster hardware then draws.
fn leaves_crowded_samples_to_raster_hardware(renderer: &mut impl Renderer) {
    let Some(mut raster) = validated_gpu::ash_by(GpuPath::Raster) else { return };
    let case = sided_wall(120_000, 0.02, 0.1, [40, 40]).with("samples", |s| s.edge_aa = EdgeAa::Samples);
    let (ours, stats) = drawn_once(renderer, &case, planes());
    assert!(is_for_cells(&case, renderer) && !is_by_cells(&stats));
    are_alike(&ours, &drawn_once(&mut raster, &case, planes()).0, &case.name);
}

#[test]
fn crowded_cells_of_samples_are_drawn_by_raster_hardware() {
    with_each!(GpuPath::Compute, leaves_crowded_samples_to_raster_hardware);
}

/// Draws 140×140 cells of samples. Nearly all of them are active, which are more than the first capacity for active
/// cells.
fn draws_again_where_active_cells_do_not_fit(renderer: &mut impl Renderer) {
    let stats = agrees_with_the_cpu(renderer, &wall(40_000, 0.003, 1.5, [560, 560]));
    assert!(counter(&stats, "sample_cells").unwrap() > f64::from(1 << 14), "{stats:?}");
}

#[test]
#[ignore = "48 s on lavapipe with two cores: cargo xtask test --full"]
fn tile_whose_active_cells_do_not_fit_is_drawn_again() {
    with_each!(GpuPath::Compute, draws_again_where_active_cells_do_not_fit);
}

/// Draws a tile with 260×260 cells of samples, which are drawn in two parts.
fn draws_samples_in_parts(renderer: &mut impl Renderer) {
    agrees_with_the_cpu(renderer, &wall(60, 0.06, 1.5, [1040, 1040]));
}

#[test]
#[ignore = "44 s on lavapipe with two cores: cargo xtask test --full"]
fn samples_of_a_large_tile_are_drawn_in_parts() {
    with_each!(GpuPath::Compute, draws_samples_in_parts);
}

#[test]
fn every_run_and_both_backends_have_the_same_bits() {
    let (Some(mut ash), Some(mut wgpu)) =
        (validated_gpu::ash_by(GpuPath::Compute), validated_gpu::wgpu_by(GpuPath::Compute))
    else {
        return;
    };
    let is_same_device = ash.info().adapter == wgpu.info().adapter;
    // An oriented cloud, whose sides are separated.
    let mut sides = scenes::closed_sphere().with("sides", |_| ());
    sides.scene.objects[0].material.oriented = Some(true);
    sides.scene.objects[0].material.cull = Cull::None;
    // Four cases have dense cells.
    let cases = [
        scenes::closed_sphere(),
        sides,
        wall(300, 0.4, 1.2, [70, 50]),
        wall(9000, 0.02, 0.1, [40, 40]),
        clipped_wall(9000, 0.02, 0.1, [40, 40]),
        sided_wall(9000, 0.02, 0.1, [40, 40]),
        glass_wall(9000, 0.02, 0.1, [40, 40], "peel:2"),
        glass_wall(300, 0.4, 1.2, [70, 50], "abuffer:4"),
    ];
    for case in cases.map(with_rows).iter().flat_map(by_every_edge) {
        let (first, stats) = drawn_once(&mut ash, &case, planes().with_index(true));
        assert_eq!(is_by_cells(&stats), is_for_cells(&case, &ash), "{}", case.name);
        assert_eq!(first, drawn_once(&mut ash, &case, planes().with_index(true)).0, "{}", case.name);
        if !is_by_cells(&stats) {
            continue;
        }
        let (other, stats) = drawn_once(&mut wgpu, &case, planes().with_index(true));
        assert!(is_by_cells(&stats), "{}", case.name);
        assert_eq!(other, drawn_once(&mut wgpu, &case, planes().with_index(true)).0, "{}", case.name);
        if is_same_device && first != other {
            // Software drivers draw by threads of their own, which inherit the state of floating-point units. So
            // devices that two tests made may round differently. Devices that one test makes don't.
            let (Some(mut ash), Some(mut wgpu)) =
                (validated_gpu::unpooled_ash_by(GpuPath::Compute), validated_gpu::unpooled_wgpu_by(GpuPath::Compute))
            else {
                return;
            };
            let planes = planes().with_index(true);
            are_equal(&drawn_once(&mut ash, &case, planes).0, &drawn_once(&mut wgpu, &case, planes).0, &case);
        }
    }
    validated_gpu::no_messages();
}

/// Draws an image of 5×3 bins, of which the last column and row are cut off. Most splats are small, some touch more
/// cells than one invocation marks, and two cover all bins.
fn draws_splats_of_every_size(renderer: &mut impl Renderer) {
    let Some(mut raster) = validated_gpu::ash_by(GpuPath::Raster) else { return };
    let size = [1200, 540];
    let mut case = wall(6000, 0.01, 1.8, size);
    for (count, radius, z) in [(90, 0.12, -0.1), (9, 0.5, -0.2), (2, 4.0, -0.3)] {
        let mut behind = wall(count, radius, 1.6, size).scene.objects.remove(0);
        behind.world_from_object = DAffine3::from_translation(DVec3::Z * z);
        case.scene.objects.push(behind);
    }
    let (ours, stats) = drawn_once(renderer, &case, planes());
    assert!(is_by_cells(&stats));
    are_alike(&ours, &drawn_once(&mut raster, &case, planes()).0, &case.name);
}

#[test]
fn splats_of_every_size_are_listed_in_every_bin() {
    with_each!(GpuPath::Compute, draws_splats_of_every_size);
}

/// Draws cells with more pairs of a splat and a cell than one workgroup draws, so that these cells are drawn in parts.
fn draws_dense_cells(renderer: &mut impl Renderer) {
    let Some(mut raster) = validated_gpu::ash_by(GpuPath::Raster) else { return };
    let size = [40, 40];
    let walls = [
        wall(4000, 0.02, 0.1, size),
        wall(9000, 0.02, 0.1, size),
        wall(5000, 0.4, 0.1, size),
        clipped_wall(9000, 0.02, 0.1, size),
        sided_wall(9000, 0.02, 0.1, size),
        glass_wall(9000, 0.02, 0.1, size, "peel:3"),
        glass_wall(5000, 0.4, 0.1, size, "abuffer:4"),
    ];
    // Drawn whole, these cells would take more iterations than a software driver runs.
    let many = sided_wall(120_000, 0.02, 0.1, size);
    for case in walls.iter().flat_map(by_every_edge).chain([many]) {
        let (ours, stats) = drawn_once(renderer, &case, planes());
        let name = format!("{} of {} splats, {:?}", case.name, stats.splats, case.settings.edge_aa);
        assert_eq!(is_by_cells(&stats), is_for_cells(&case, renderer), "{name}");
        are_alike(&ours, &drawn_once(&mut raster, &case, planes()).0, &name);
    }
}

#[test]
fn dense_cells_are_drawn_in_parts() {
    with_each!(GpuPath::Compute, draws_dense_cells);
}

/// Draws few splats of which each touches every cell. There are more pairs of a splat and a cell than estimated, so
/// that the tile is drawn again.
fn draws_again_where_pairs_do_not_fit(renderer: &mut impl Renderer) {
    let Some(mut raster) = validated_gpu::ash_by(GpuPath::Raster) else { return };
    let case = wall(100, 3.0, 0.1, [200, 150]);
    let (ours, stats) = drawn_once(renderer, &case, planes());
    let pairs = counter(&stats, CELL_PAIRS).unwrap();
    // 13 × 10 cells.
    assert_eq!((stats.drawn, pairs), (100, 100.0 * 130.0));
    assert!(pairs > 2.0 * 100.0 + 4.0 * 130.0);
    are_alike(&ours, &drawn_once(&mut raster, &case, planes()).0, &case.name);
}

#[test]
fn tile_whose_pairs_do_not_fit_is_drawn_again() {
    with_each!(GpuPath::Compute, draws_again_where_pairs_do_not_fit);
}

fn falls_back_to_raster_hardware(renderer: &mut impl Renderer, whole: &mut impl Renderer) {
    let case = wall(100, 3.0, 0.1, [200, 150]);
    let (ours, stats) = drawn_once(renderer, &case, planes());
    assert!(!is_by_cells(&stats) && stats.drawn == 100);
    are_alike(&ours, &drawn_once(whole, &case, planes()).0, &case.name);
    // An image that fits is drawn by cells.
    let small = wall(20, 0.1, 0.5, [40, 40]);
    assert!(is_by_cells(&drawn_once(renderer, &small, planes()).1));
}

#[test]
fn tile_beyond_the_limits_is_drawn_by_raster_hardware() {
    // Records and the estimate of pairs fit, but the pairs don't.
    let limits = Limits { cell_bytes: 60_000, ..Limits::default() };
    let parts = validated_gpu::ash_with(limits, Storage::F32);
    if let (Some(mut parts), Some(mut whole)) = (parts, validated_gpu::ash()) {
        falls_back_to_raster_hardware(&mut parts, &mut whole);
    }
    let parts = validated_gpu::wgpu_with(limits, Storage::F32);
    if let (Some(mut parts), Some(mut whole)) = (parts, validated_gpu::wgpu()) {
        falls_back_to_raster_hardware(&mut parts, &mut whole);
        validated_gpu::no_messages();
    }
}

//! Tests that the CPU backend draws the reference's image, with the same bits for all options.

use glam::DVec3;
use surfel_conformance::harness::{Verdict, check_backend, check_case, render};
use surfel_conformance::polygons::{mesh_object, quad};
use surfel_conformance::{build, scenes};
use surfel_cpu::{Options, Renderer as Cpu, SimdLevel, Storage};
use surfel_model::{Accumulate, Cull, EdgeAa, Light, OnInvalid, Scene, Settings, Shader, SplatCloud, Transparency};
use surfel_reference::Renderer as Reference;
use surfel_render::{Frame, Planes, Region, RenderError, Renderer, View};

fn renderer(threads: usize, simd: SimdLevel) -> Cpu {
    Cpu::new(Options::default().with_threads(threads).with_simd(simd)).unwrap()
}

/// Returns the bits of a frame, so that NaN and the sign of zero count too.
fn bits(frame: &Frame) -> Vec<u32> {
    let floats = frame.color().as_flattened().iter().chain(frame.normal().as_flattened());
    floats
        .chain(frame.depth())
        .chain(frame.weight())
        .map(|v| v.to_bits())
        .chain(frame.fragments().iter().copied())
        .collect()
}

/// Returns every scene, all of which the CPU backend draws, and some that combine features as no other scene does.
fn drawn() -> Vec<scenes::Case> {
    let mut cases = scenes::all();
    let peel = |s: &mut Settings| s.transparency = Transparency::Peel { layers: 2, drop_last: false };
    let both = |s: &mut Settings| {
        peel(s);
        (s.shader, s.edge_aa) = (Shader::Toon, EdgeAa::Coverage);
    };
    cases.push(scenes::mesh_through_sphere().with("toon, edges, layers", both));
    cases.push(scenes::panes().with("toon, edges, layers", both));
    // Polygons and splats through the near plane, also with lines around the cuts.
    for (name, shader) in [("near", Shader::Phong), ("near, toon", Shader::Toon)] {
        let mut case = scenes::sphere_before_mesh().with(name, |s| s.shader = shader);
        case.camera.near = 2.1;
        cases.push(case);
    }
    cases.extend(rarer_polygons());
    let capabilities = renderer(1, SimdLevel::Best).info().capabilities;
    let refused: Vec<&str> = cases.iter().filter(|c| !c.is_drawn_by(&capabilities)).map(|c| c.name.as_str()).collect();
    assert!(refused.is_empty(), "{refused:?}");
    cases
}

/// Returns cases that no other scene has: equally near polygons; insides of meshes, cut open by the near plane and lit
/// on both sides; shadows of culled polygons. The eye or the light sees the culled polygons from behind.
fn rarer_polygons() -> Vec<scenes::Case> {
    let mut open = scenes::mesh_ball().with("cut open", |_| ());
    open.camera.near = 3.0;
    open.scene.objects[1].material.two_sided = true;
    let mut twice = scenes::mesh_ball().with("twice", |_| ());
    let pane = |color: [f32; 3]| {
        let mut pane = quad(DVec3::Z * 1.2, [DVec3::X * 0.8, DVec3::Y * 0.8], 1.0);
        pane.colors = Some(vec![color; 4]);
        mesh_object(pane)
    };
    twice.scene.objects.extend([pane([0.9, 0.1, 0.1]), pane([0.1, 0.9, 0.1])]);
    let from_below = Light::Directional { direction: [0.4, 1.0, 0.3], color: [1.0; 3], shadow: true };
    let culled = |parts| {
        let mut case = scenes::ball_over_floor(parts, from_below.clone()).with("from below, culled", |_| ());
        case.scene.objects.iter_mut().for_each(|o| o.material.cull = Cull::Back);
        case
    };
    vec![open, twice, culled(scenes::Parts::Splats), culled(scenes::Parts::SplatsOverMesh)]
}

#[test]
fn cpu_agrees_with_the_reference_on_every_scene() {
    let reports = check_backend(&mut renderer(0, SimdLevel::Best));
    let failed: Vec<String> =
        reports.iter().filter(|r| r.verdict != Verdict::Passed).map(|r| format!("{r:?}")).collect();
    assert!(failed.is_empty(), "{failed:#?}");
    let mut reference = Reference::new(Default::default()).unwrap();
    for case in &drawn()[reports.len()..] {
        let report = check_case(&mut renderer(0, SimdLevel::Best), &mut reference, case);
        assert_eq!(report.verdict, Verdict::Passed, "{report}");
    }
}

#[test]
fn cpu_gives_the_same_bits_for_any_threads_and_simd_level() {
    for storage in [Storage::F32, Storage::Quantised] {
        let renderer = |threads, simd| {
            Cpu::new(Options::default().with_threads(threads).with_simd(simd).with_storage(storage)).unwrap()
        };
        // More threads divide a frame into more cells: with 16, every tile of the small images is a cell.
        let mut variants: Vec<Cpu> = [1, 3, 16].map(|threads| renderer(threads, SimdLevel::Best)).into();
        variants.extend(SimdLevel::ALL.iter().map(|&level| renderer(2, level)));
        let planes = Planes::ALL.with_fragments(true);
        for case in drawn() {
            let frames: Vec<Vec<u32>> = variants.iter_mut().map(|v| bits(&render(v, &case, planes).unwrap())).collect();
            assert!(frames.windows(2).all(|f| f[0] == f[1]), "{}, {storage:?}", case.name);
        }
    }
}

#[test]
fn cpu_counts_no_fragment_that_it_did_not_look_at_and_every_splat_once_however_a_frame_is_cut() {
    let planes = Planes::ALL.with_fragments(true);
    let mut renderers = [1, 2, 16].map(|threads| renderer(threads, SimdLevel::Best));
    for case in drawn() {
        let drawn = renderers.each_mut().map(|renderer| {
            let resident = renderer.upload(&case.scene).unwrap();
            let mut frame = Frame::default();
            let stats = renderer.render_into(&resident, &case.view(), &case.settings, planes, &mut frame).unwrap();
            let counter = |wanted| stats.counters.iter().find(|(name, _)| *name == wanted).unwrap().1 as u64;
            let [tested, inside] = [counter("fragments_tested"), counter("fragments_inside")];
            let counts = format!("{}: {} of {inside} of {tested} fragments", case.name, stats.fragments);
            assert!(stats.fragments <= inside && inside <= tested, "{counts}");
            let counted: u64 = frame.fragments().iter().map(|&count| u64::from(count)).sum();
            assert_eq!(stats.fragments, counted, "{}", case.name);
            assert_eq!(stats.drawn + counter("culled"), stats.splats, "{}", case.name);
            if counter("cells") == 1 {
                let looked_at = counter("culled_outside") + counter("culled_back_facing") + counter("set_up");
                assert_eq!(looked_at, stats.splats, "{}", case.name);
            }
            stats.drawn
        });
        assert_eq!(drawn, [drawn[0]; 3], "{}", case.name);
    }
}

#[test]
fn cpu_refuses_what_it_does_not_draw() {
    let planes = Planes::COLOR.with_margin(true);
    let error = render(&mut renderer(1, SimdLevel::Best), &scenes::all().remove(0), planes).unwrap_err();
    assert!(matches!(error, RenderError::Unsupported { backend: "cpu", .. }), "{error}");
}

#[test]
fn cpu_sums_in_f32_where_f16_would_do() {
    let case = scenes::closed_sphere();
    let halves = case.with("half precision", |s| s.accumulate = Accumulate::F16);
    let [a, b] =
        [case, halves].map(|case| bits(&render(&mut renderer(1, SimdLevel::Best), &case, Planes::ALL).unwrap()));
    assert_eq!(a, b);
}

#[test]
fn cpu_region_is_the_same_bits_as_that_part_of_the_whole() {
    let mut cpu = renderer(2, SimdLevel::Best);
    for case in drawn().iter().filter(|case| case.region.is_none()) {
        let [width, height] = case.camera.size;
        // An odd corner, so that tiles and runs start elsewhere than in the whole image.
        let region = Region { x: width / 3, y: height / 4, width: width.div_ceil(2), height: height.div_ceil(2) };
        let whole = render(&mut cpu, case, Planes::ALL).unwrap();
        let view = View::of_region(&case.camera, Some(region)).unwrap();
        let resident = cpu.upload(&case.scene).unwrap();
        let mut part = Frame::default();
        cpu.render_into(&resident, &view, &case.settings, Planes::ALL, &mut part).unwrap();
        for (i, pixel) in part.color().iter().enumerate() {
            let (x, y) = (region.x + i as u32 % region.width, region.y + i as u32 / region.width);
            let same = whole.color()[(y * width + x) as usize];
            assert_eq!(pixel.map(f32::to_bits), same.map(f32::to_bits), "{} at {x},{y}", case.name);
            let depth = whole.depth()[(y * width + x) as usize];
            assert_eq!(part.depth()[i].to_bits(), depth.to_bits(), "{} at {x},{y}", case.name);
        }
    }
}

#[test]
fn cpu_quantised_storage_halves_memory_and_is_nearly_the_same_image() {
    let n = 20_000;
    let normal = |i: usize| {
        let (z, angle) = (1.0 - (2 * i + 1) as f64 / n as f64, i as f64 * 2.399_963);
        let r = (1.0 - z * z).sqrt();
        DVec3::new(r * angle.cos(), r * angle.sin(), z)
    };
    let normals: Vec<_> = (0..n).map(normal).collect();
    let disks: Vec<_> = normals.iter().map(|&v| (v, v, 0.03)).collect();
    let mut data = build::disk_cloud(&disks, [1.0; 3]).data().clone();
    data.colors = Some(normals.iter().map(|v| (v.as_vec3() * 0.5 + 0.5).to_array()).collect());
    let cloud = SplatCloud::new(data, OnInvalid::Refuse).unwrap().0;
    let case = scenes::all().remove(0);
    let scene = Scene { objects: vec![build::object(cloud)], ..case.scene.clone() };
    let view = View::new(&build::camera(3.5, 45.0, [96, 96])).unwrap();
    let draw = |storage| {
        let mut cpu = Cpu::new(Options::default().with_storage(storage)).unwrap();
        let resident = cpu.upload(&scene).unwrap();
        let mut frame = Frame::default();
        cpu.render_into(&resident, &view, &case.settings, Planes::ALL, &mut frame).unwrap();
        (resident.bytes() as f64 / n as f64, frame)
    };
    let (wide, exact) = draw(Storage::F32);
    let (narrow, quantised) = draw(Storage::Quantised);
    // 48 and 18 bytes, plus a share of a chunk's 130 each.
    assert!(wide < 52.0 && narrow < 20.0, "{wide} {narrow}");
    let pairs = exact.color().as_flattened().iter().zip(quantised.color().as_flattened());
    let differences: Vec<f64> = pairs.map(|(a, b)| f64::from((a - b).abs())).collect();
    let squares: f64 = differences.iter().map(|d| d * d).sum();
    let rms = (squares / differences.len() as f64).sqrt();
    // Centres move by 1.5e-5 of a chunk, some 2e-4 of a radius here: measured 2e-5, without losing a pixel at the rim.
    assert!(rms < 1e-4 && rms > 0.0, "{rms:e}");
}

#[test]
fn cpu_quantised_storage_errs_little_in_every_scene() {
    let [mut wide, mut narrow] =
        [Storage::F32, Storage::Quantised].map(|storage| Cpu::new(Options::default().with_storage(storage)).unwrap());
    let mut worst: Vec<(f64, String)> = Vec::new();
    for case in drawn() {
        let [exact, quantised] = [&mut wide, &mut narrow].map(|cpu| render(cpu, &case, Planes::COLOR).unwrap());
        let pairs = exact.color().as_flattened().iter().zip(quantised.color().as_flattened());
        let squares: f64 = pairs.map(|(a, b)| f64::from(a.min(1.0) - b.min(1.0)).powi(2)).sum();
        worst.push(((squares / exact.color().as_flattened().len() as f64).sqrt(), case.name));
    }
    worst.sort_by(|a, b| b.0.total_cmp(&a.0));
    // Measured: 0.019 (34 dB) if all splats are seen edge-on, so that the least turn decides pixels. At most 0.011 in
    // eighteen more, if clips or edges of few large splats move, and in four, if a pixel of a thin plate shows its
    // other side. 8e-4 in all others.
    assert!(worst[0].0 < 0.025, "{:?}", worst[0]);
    assert!(worst[1].0 < 0.015, "{:?}", worst[1]);
    assert!(worst[23].0 < 1e-3, "{:?}", &worst[..24]);
}

/// Returns small splats in front of and behind each other, some steep, among larger ones.
fn specks(radius_px: f64, size: [u32; 2]) -> scenes::Case {
    let camera = build::camera(4.0, 40.0, size);
    let pixel = 4.0 * (20f64.to_radians()).tan() * 2.0 / f64::from(size[1]);
    let ball = build::sphere(1200, 1.0, 5).into_iter().enumerate().map(|(i, splat)| {
        // From half to one and a half times the radius; every fiftieth is ten times as large.
        let scale = (0.5 + (i % 11) as f64 * 0.1) * if i % 50 == 7 { 10.0 } else { 1.0 };
        let [s, t] = [splat.s, splat.t].map(|axis| axis.normalize() * radius_px * pixel * scale);
        build::Splat { s, t, ..splat }
    });
    let ball: Vec<build::Splat> = ball.collect();
    let behind = ball.iter().map(|splat| build::Splat { p: splat.p * 0.9, ..*splat });
    let splats: Vec<build::Splat> = ball.iter().copied().chain(behind).collect();
    scenes::Case::new(&format!("specks {radius_px}"), build::scene(&splats), camera)
}

#[test]
fn cpu_agrees_with_the_reference_on_tiny_splats() {
    let mut reference = Reference::new(Default::default()).unwrap();
    for radius_px in [0.1, 0.6, 0.9] {
        let case = specks(radius_px, [60, 50]).with("lit", |s| s.shader = Shader::Phong);
        let report = check_case(&mut renderer(1, SimdLevel::Best), &mut reference, &case);
        assert_eq!(report.verdict, Verdict::Passed, "{report}");
    }
}

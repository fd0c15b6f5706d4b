//! Tests of edges by samples (§5): pixels beside a step are means of samples, all others are unchanged.

use crate::drawing::{counter, drawn_once};
use crate::validated_gpu;
use glam::{DAffine3, DVec3};
use std::sync::Arc;
use surfel_conformance::harness::{Verdict, check_case, render};
use surfel_conformance::polygons::{mesh_object, quad};
use surfel_conformance::scenes::{self, Case};
use surfel_conformance::{build, random_scenes, test_data};
use surfel_cpu::{Options, Renderer as Cpu};
use surfel_io::{Content, LoadOptions, load};
use surfel_model::{EdgeAa, Filter, Geometry, Material, Object, Scene, Shader, SplatCloud};
use surfel_reference::Renderer as Reference;
use surfel_render::{Frame, Planes, Region, Renderer, View};
use surfel_sample::{MeshOptions, NoProgress, PointOptions, splats_from_mesh, splats_from_points};

fn cpu() -> Cpu {
    Cpu::new(Options::default()).unwrap()
}

fn reference() -> Reference {
    Reference::new(Default::default()).unwrap()
}

/// Returns all scenes whose edges are antialiased by samples.
fn sampled() -> Vec<Case> {
    scenes::all().into_iter().filter(|case| case.settings.edge_aa == EdgeAa::Samples).collect()
}

/// Returns panes of which no layer is drawn: their steps are sampled all the same, and show what is behind.
fn panes_that_are_left_out() -> Case {
    scenes::pane_through_sphere().with("peel-1-drop", |s| s.transparency = "peel:1:drop".parse().unwrap()).sampled()
}

/// Returns, per pixel, the mean of 4×4 pixels of an image without antialiasing that is four times as wide and high.
fn means(renderer: &mut impl Renderer, case: &Case) -> Vec<[f32; 4]> {
    let mut settings = case.settings.with_edge_aa(EdgeAa::Off);
    // The octree's nodes are selected for the image's pixels.
    settings.lod_error_px *= 4.0;
    let (resident, view) = (renderer.upload(&case.scene).unwrap(), case.view().of_samples());
    let mut fine = Frame::default();
    renderer.render_into(&resident, &view, &settings, Planes::COLOR, &mut fine).unwrap();
    let width = case.view().region.width as usize;
    let mean = |at: usize| {
        let sample = |i: usize| fine.color()[(at / width * 4 + i / 4) * width * 4 + at % width * 4 + i % 4];
        (0..16).map(sample).fold([0.0; 4], |sum, color| std::array::from_fn(|c| sum[c] + color[c] / 16.0))
    };
    (0..case.view().pixels()).map(mean).collect()
}

fn distance(a: [f32; 4], b: [f32; 4]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

/// Checks an image by samples: each pixel is either unchanged, or the mean of a finer image's pixels. Up to 2 % of the
/// changed pixels may differ by less than 0.2, where a sample is on a rim. Depths and normals must be unchanged.
/// Returns the number of changed pixels.
fn check_means(renderer: &mut impl Renderer, case: &Case) -> usize {
    let of = |renderer: &mut _, case: &Case| render(renderer, case, Planes::ALL).unwrap();
    let (image, plain) = (of(renderer, case), of(renderer, &case.with("off", |s| s.edge_aa = EdgeAa::Off)));
    let means = means(renderer, case);
    assert_eq!(image.depth(), plain.depth(), "{}: Z is the centre's", case.name);
    assert_eq!(image.normal(), plain.normal(), "{}: the normal is the centre's", case.name);
    let (mut changed, mut off, mut worst) = (0, 0, 0.0f32);
    for ((color, plain), mean) in image.color().iter().zip(plain.color()).zip(&means) {
        if color == plain {
            continue;
        }
        changed += 1;
        let error = distance(*color, *mean);
        off += usize::from(error > 1e-3);
        worst = worst.max(error);
    }
    assert!(off * 50 <= changed, "{}: {off} of {changed} pixels are no mean, worst {worst}", case.name);
    assert!(worst < 0.2, "{}: a pixel is off by {worst}", case.name);
    changed
}

#[test]
fn sampled_pixels_are_means_of_an_image_four_times_as_fine() {
    for case in sampled() {
        // These shaders read neighbours, and samples have other ones.
        if matches!(case.settings.shader, Shader::Toon | Shader::Edl) {
            continue;
        }
        check_means(&mut reference(), &case);
        let changed = check_means(&mut cpu(), &case);
        // A single pixel has no neighbours.
        assert!(changed > 0 || case.view().pixels() == 1, "{}", case.name);
    }
}

#[test]
fn cpu_draws_every_scene_of_samples_as_the_reference_does() {
    let mut reference = reference();
    let failed: Vec<String> = sampled()
        .iter()
        .chain([&panes_that_are_left_out()])
        .map(|case| check_case(&mut cpu(), &mut reference, case))
        .filter(|report| report.verdict != Verdict::Passed)
        .map(|report| report.to_string())
        .collect();
    assert!(failed.is_empty(), "{}", failed.join("\n"));
}

fn draws_every_scene_of_samples(backend: &mut impl Renderer) {
    let (mut reference, capabilities) = (reference(), backend.info().capabilities);
    let cases: Vec<Case> = sampled().into_iter().filter(|case| case.is_drawn_by(&capabilities)).collect();
    assert_eq!(cases.len(), sampled().len());
    let mut failed = Vec::new();
    // `gpu_backends` compares all of them with the reference. Means are drawn for some only, since their images are
    // sixteen times as large.
    for case in cases.iter().step_by(3) {
        if !matches!(case.settings.shader, Shader::Toon | Shader::Edl) {
            let changed = check_means(backend, case);
            assert!(changed > 0 || case.view().pixels() == 1, "{}", case.name);
        }
    }
    let random = (0..12).map(|seed| random_scenes::case(seed).sampled());
    for case in random.chain([panes_that_are_left_out()]).filter(|case| case.is_drawn_by(&capabilities)) {
        let report = check_case(backend, &mut reference, &case);
        if report.verdict != Verdict::Passed {
            failed.push(report.to_string());
        }
    }
    assert!(failed.is_empty(), "{}", failed.join("\n"));
    let plane = without_a_step();
    let plain = plane.with("off", |s| s.edge_aa = EdgeAa::Off);
    let [image, without] = [&plane, &plain].map(|case| drawn_once(backend, case, Planes::ALL).0);
    assert!(image == without, "samples without a step");
}

#[test]
#[ignore = "118 s on lavapipe with two cores: cargo xtask test --full"]
fn gpus_draw_every_scene_of_samples_as_the_reference_does() {
    if let Some(mut ash) = validated_gpu::ash() {
        draws_every_scene_of_samples(&mut ash);
    }
    if let Some(mut wgpu) = validated_gpu::wgpu() {
        draws_every_scene_of_samples(&mut wgpu);
        validated_gpu::no_messages();
    }
}

/// Returns an unlit, white quad that faces the eye, in an image of 32×32 pixels. The numbers are the quad's sides in
/// pixels: left, top, right, bottom.
fn quad_at([x0, y0, x1, y1]: [f64; 4]) -> Case {
    let (half, of_px) = (16.0, |px: f64| (px - 16.0) / 16.0);
    let center = DVec3::new(0.5 * (of_px(x0) + of_px(x1)), -0.5 * (of_px(y0) + of_px(y1)), 0.0);
    let axes = [DVec3::X * (0.5 * (x1 - x0) / half), DVec3::Y * (0.5 * (y1 - y0) / half)];
    let scene =
        Scene { objects: vec![mesh_object(quad(center, axes, 1.0))], background: [0.0; 4], ..build::scene(&[]) };
    let camera = build::camera(1.0, 90.0, [32, 32]);
    Case::new("quad", scene, camera).sampled()
}

#[test]
fn edges_of_a_rectangle_have_the_share_of_samples_that_it_covers() {
    // Samples are at odd eighths of a pixel. If a pixel is covered from ⅓ on, three of four columns of samples are
    // inside; if it is covered up to ⅗, two are.
    let case = quad_at([8.0 + 1.0 / 3.0, 10.0, 20.6, 23.0]);
    for image in [render(&mut reference(), &case, Planes::COLOR), render(&mut cpu(), &case, Planes::COLOR)] {
        let image = image.unwrap();
        let alpha = |x: usize, y: usize| image.color()[y * 32 + x][3];
        assert_eq!([7, 8, 9, 19, 20, 21].map(|x| alpha(x, 15)), [0.0, 0.75, 1.0, 1.0, 0.5, 0.0]);
        // The upper and lower sides are between pixels.
        assert_eq!([9, 10, 22, 23].map(|y| alpha(15, y)), [0.0, 1.0, 1.0, 0.0]);
        assert_eq!(alpha(8, 10), 0.75);
    }
}

#[test]
fn edges_of_a_slanted_quad_are_as_smooth_as_sixteen_samples_make_them() {
    let mut case = quad_at([6.0, 7.0, 25.0, 26.0]);
    case.scene.objects[0].world_from_object = DAffine3::from_rotation_z(0.31);
    let image = render(&mut cpu(), &case, Planes::COLOR).unwrap();
    let fine = View::supersampled(&case.view(), 16).unwrap();
    let plain = case.settings.with_edge_aa(EdgeAa::Off);
    let mut reference = reference();
    let resident = reference.upload(&case.scene).unwrap();
    let mut exact = Frame::default();
    reference.render_into(&resident, &fine, &plain, Planes::COLOR, &mut exact).unwrap();
    let (mut squares, mut edges) = (0.0, 0);
    for (i, color) in image.color().iter().enumerate() {
        let (x, y) = (i % 32 * 16, i / 32 * 16);
        let samples = (0..256).map(|k| exact.color()[(y + k / 16) * 512 + x + k % 16][3]);
        let area = samples.sum::<f32>() / 256.0;
        if area > 0.0 && area < 1.0 {
            squares += (color[3] - area).powi(2);
            edges += 1;
        } else {
            assert_eq!(color[3], area, "pixel {i} is no edge");
        }
    }
    // A regular grid of 16: at most two columns of four are wrong. One sample has an error of .29 here.
    let rmse = (squares / edges as f32).sqrt();
    assert!(edges > 60 && rmse < 0.06, "{rmse} of {edges} pixels");
}

/// Returns a region inside a plane, in which no pixel has a depth step to a neighbour.
fn without_a_step() -> Case {
    let mut case = scenes::facing_plane().sampled();
    case.region = Some(Region { x: 20, y: 20, width: 16, height: 16 });
    case
}

#[test]
fn images_without_a_step_have_no_sample() {
    let case = without_a_step();
    let plain = case.with("off", |s| s.edge_aa = EdgeAa::Off);
    let (image, stats) = drawn_once(&mut cpu(), &case, Planes::ALL);
    let (without, _) = drawn_once(&mut cpu(), &plain, Planes::ALL);
    assert!(image.color().iter().all(|c| c[3] == 1.0), "the plane fills the region");
    assert_eq!(counter(&stats, "edge_pixels"), Some(0.0));
    assert_eq!(image.color(), without.color());
    let steps = drawn_once(&mut cpu(), &scenes::closed_sphere().sampled(), Planes::ALL).1;
    assert!(counter(&steps, "edge_pixels") > Some(100.0));
}

#[test]
fn random_scenes_by_samples_agree_with_the_reference() {
    let mut reference = reference();
    let mut sampled = 0;
    for seed in 0..60 {
        let case = random_scenes::case(seed).sampled();
        let report = check_case(&mut cpu(), &mut reference, &case);
        assert_eq!(report.verdict, Verdict::Passed, "{report}");
        let stats = drawn_once(&mut cpu(), &case, Planes::COLOR).1;
        sampled += usize::from(counter(&stats, "edge_pixels") > Some(0.0));
    }
    assert!(sampled > 40, "{sampled} of 60 scenes have steps");
}

/// Returns RMSE of RGBA at the outer edges of a scene's image, without antialiasing and by samples. Edges are pixels
/// that the exact splats cover in part; the truth is 8×8 samples of these splats.
fn errors_at_edges(case: &Case) -> [f64; 2] {
    const SIDE: usize = 8;
    let mut exact = case.settings.with_filter(Filter::None);
    exact.edge_aa = EdgeAa::Off;
    let mut renderer = cpu();
    let fine = View::supersampled(&case.view(), SIDE as u32).unwrap();
    let resident = renderer.upload(&case.scene).unwrap();
    let mut samples = Frame::default();
    renderer.render_into(&resident, &fine, &exact, Planes::COLOR, &mut samples).unwrap();
    let width = case.view().region.width as usize;
    let truth = |i: usize| {
        let at = |k: usize| (i / width * SIDE + k / SIDE) * width * SIDE + i % width * SIDE + k % SIDE;
        let of_pixel = (0..SIDE * SIDE).map(|k| samples.color()[at(k)]);
        of_pixel.fold([0.0; 4], |sum: [f32; 4], c| std::array::from_fn(|i| sum[i] + c[i] / (SIDE * SIDE) as f32))
    };
    [EdgeAa::Off, EdgeAa::Samples].map(|edge_aa| {
        let image = render(&mut cpu(), &case.with("edges", |s| s.edge_aa = edge_aa), Planes::COLOR).unwrap();
        let edges = image.color().iter().enumerate().map(|(i, color)| (*color, truth(i)));
        let (mut squares, mut count) = (0.0, 0);
        for (color, truth) in edges.filter(|(_, truth)| truth[3] > 1e-3 && truth[3] < 1.0 - 1e-3) {
            squares += color.iter().zip(truth).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / 4.0;
            count += 1;
        }
        assert!(count > 100, "{}: {count} pixels are edges", case.name);
        (squares / f64::from(count)).sqrt()
    })
}

/// Returns a lit case of a cloud in the middle of a square image.
fn framed(name: &str, cloud: SplatCloud) -> Case {
    let centers: Vec<DVec3> = (0..cloud.len()).map(|i| cloud.center(i)).collect();
    let (min, max) = centers.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(a, b), c| (a.min(*c), b.max(*c)));
    let mut scene = Scene { background: [0.0; 4], ..build::scene(&[]) };
    let world_from_object = DAffine3::from_scale(DVec3::splat(2.0 / (max - min).max_element()))
        * DAffine3::from_translation(-0.5 * (min + max));
    scene.objects =
        vec![Object { geometry: Geometry::Splats(Arc::new(cloud)), world_from_object, material: Material::default() }];
    Case::new(name, scene, build::camera(4.0, 40.0, [192, 192])).with("lit", |s| s.shader = Shader::Phong)
}

#[test]
fn edges_by_samples_err_little_against_exact_splats() {
    let scene = Scene { background: [0.0; 4], ..build::scene(&build::sphere(6000, 1.3, 5)) };
    let ball = Case::new("ball", scene, build::camera(3.0, 45.0, [128, 128]));
    let [off, samples] = errors_at_edges(&ball);
    println!("ball: {off:.3} without, {samples:.3} by samples");
    // Measured .413 and .048.
    assert!(off > 0.2 && samples < 0.1, "{off} {samples}");
}

#[test]
fn edges_of_models_err_little_against_exact_splats() {
    let Some(folder) = test_data::folder("models") else { return };
    for (name, most) in
        [("igea.ply", 0.10), ("lion_takanawa.ply", 0.10), ("stanford-bunny.obj", 0.12), ("spot/spot.obj", 0.12)]
    {
        let path = folder.join(name);
        if !path.is_file() {
            println!("skipped: {} isn't there", path.display());
            continue;
        }
        let cloud = match load(&path, &LoadOptions::default()).unwrap().content {
            Content::Mesh(mesh) => splats_from_mesh(&mesh, &MeshOptions::auto(&mesh), &NoProgress).unwrap().0,
            Content::Points(points) => splats_from_points(&points, &PointOptions::default(), &NoProgress).unwrap().0,
            _ => panic!("{name} is a mesh or a scan"),
        };
        let [off, samples] = errors_at_edges(&framed(name, cloud));
        println!("{name}: {off:.3} without, {samples:.3} by samples");
        assert!(samples < most && samples < 0.5 * off, "{name}: {off} {samples}");
    }
}

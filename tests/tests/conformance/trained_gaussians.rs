//! Tests of trained Gaussians (docs/gaussians.md): the reference against the published formulas, other backends against
//! the reference, and their plans.

use crate::validated_gpu::{ash, no_messages, wgpu};
use glam::{DAffine3, DMat3, DQuat, DVec3, dvec2, dvec3};
use surfel_conformance::build::{camera, cloud, object, sphere};
use surfel_conformance::random::Random;
use surfel_conformance::scenes::{
    Case, gaussian_extremes, gaussian_field, gaussian_object, gaussian_scene, gaussians_of, no_gaussians,
    random_gaussians, two_gaussian_objects,
};
use surfel_model::{Column3, EdgeAa, Filter, GaussianData, GaussianKind, Projection, Shader, Sort, Storage};
use surfel_reference::Renderer as Reference;
use surfel_render::{
    Capabilities, Feature, Frame, Pass, Planes, Region, Renderer, SceneSummary, View, plan, unsupported,
};

/// Returns all planes that Gaussians have.
fn planes() -> Planes {
    let planes = Planes::ALL.with_alpha(true).with_median_depth(true).with_distortion(true).with_position(true);
    planes.with_fragments(true)
}

fn drawn(renderer: &mut impl Renderer, case: &Case, planes: Planes) -> Frame {
    let resident = renderer.upload(&case.scene).unwrap();
    let mut frame = Frame::default();
    renderer.render_into(&resident, &case.view(), &case.settings, planes, &mut frame).unwrap();
    frame
}

fn by_pixel(case: &Case) -> Case {
    case.with(&format!("{} by pixel", case.name), |s| s.sort = Sort::Pixel)
}

fn by_principal(case: &Case) -> Case {
    case.with("principal", |s| s.gaussian_filter = Filter::Principal)
}

fn reference() -> Reference {
    Reference::new(Default::default()).unwrap()
}

fn cpu(threads: usize) -> surfel_cpu::Renderer {
    surfel_cpu::Renderer::new(surfel_cpu::Options::default().with_threads(threads)).unwrap()
}

/// Values of a pixel: red, green, blue, alpha; expected depth, median depth, distortion, Σw·n.
type Values = [f64; 10];

fn values(frame: &Frame) -> Vec<Values> {
    let of = |i: usize| -> Values {
        let [r, g, b, _] = frame.color()[i];
        let [x, y, z] = frame.normal()[i];
        let (depth, median) = (frame.depth()[i], frame.median_depth()[i]);
        [r, g, b, frame.alpha()[i], depth, median, frame.distortion()[i], x, y, z].map(f64::from)
    };
    (0..frame.color().len()).map(of).collect()
}

/// Draws a flat cloud without a background by the formulas of the 2DGS paper and its renderer, pixel by pixel:
/// homogeneous planes of the pixel and their intersection with the splat's plane.
fn published(data: &GaussianData, view: &View, sort: Sort) -> Vec<Values> {
    let [[fx, fy], [cx, cy]] = [view.projection.focal_px, view.projection.principal_px];
    let mut splats = Vec::new();
    for i in 0..data.opacities.len() {
        let [x, y, z, w] = DQuat::from_array(data.rotations[i].map(f64::from)).normalize().to_array();
        let columns = [
            dvec3(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)),
            dvec3(2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)),
            dvec3(2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)),
        ];
        let (center, sigma) = (data.centers.get(i), data.sigmas[i].map(f64::from));
        let p = view.view_from_world * (center - view.eye);
        let tangents = [columns[0] * sigma[0], columns[1] * sigma[1]].map(|t| view.view_from_world * t);
        let normal = if columns[2].dot(center - view.eye) > 0.0 { -columns[2] } else { columns[2] };
        let to_pixels = |v: DVec3| dvec3(fx * v.x + cx * v.z, fy * v.y + cy * v.z, v.z);
        // Rows of the splat-to-pixel matrix: T_u, T_v and T_w.
        let rows = DMat3::from_cols(to_pixels(tangents[0]), to_pixels(tangents[1]), to_pixels(p)).transpose();
        let d = (center - view.eye).normalize();
        let (xx, yy, zz) = (d.x * d.x, d.y * d.y, d.z * d.z);
        #[rustfmt::skip]
        let basis = [
            0.28209479177387814,
            -0.4886025119029199 * d.y, 0.4886025119029199 * d.z, -0.4886025119029199 * d.x,
            1.0925484305920792 * d.x * d.y, -1.0925484305920792 * d.y * d.z,
            0.31539156525252005 * (2.0 * zz - xx - yy), -1.0925484305920792 * d.x * d.z, 0.5462742152960396 * (xx - yy),
            -0.5900435899266435 * d.y * (3.0 * xx - yy), 2.890611442640554 * d.x * d.y * d.z,
            -0.4570457994644658 * d.y * (4.0 * zz - xx - yy),
            0.3731763325901154 * d.z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
            -0.4570457994644658 * d.x * (4.0 * zz - xx - yy), 1.445305721320277 * d.z * (xx - yy),
            -0.5900435899266435 * d.x * (xx - 3.0 * yy),
        ];
        let each = data.coefficients();
        let own = &data.harmonics[i * each..(i + 1) * each];
        let color =
            own.iter().zip(basis).fold(DVec3::splat(0.5), |sum, (c, y)| sum + DVec3::from(c.map(f64::from)) * y);
        splats.push((p.z, rows, color.max(DVec3::ZERO), normal, f64::from(data.opacities[i]), i));
    }
    splats.retain(|s| s.0 > 0.2);
    splats.sort_by(|a, b| a.0.total_cmp(&b.0));
    let pixel = |at: usize| -> Values {
        let (x, y) = ((at % view.size[0] as usize) as f64 + 0.5, (at / view.size[0] as usize) as f64 + 0.5);
        let (mut t, mut c, mut n, mut depth, mut median) = (1.0, DVec3::ZERO, DVec3::ZERO, 0.0, f64::INFINITY);
        let (mut m1, mut m2, mut distortion) = (0.0, 0.0, 0.0);
        let mut fragments = Vec::new();
        for (z, rows, color, normal, opacity, number) in &splats {
            let [tu, tv, tw] = [rows.x_axis, rows.y_axis, rows.z_axis];
            let (k, l) = (tw * x - tu, tw * y - tv);
            let cross = k.cross(l);
            if cross.z == 0.0 {
                continue;
            }
            let s = dvec2(cross.x, cross.y) / cross.z;
            let center = dvec2(tu.z, tv.z) / z;
            let rho = s.length_squared().min(2.0 * (dvec2(x, y) - center).length_squared());
            let z = tw.dot(dvec3(s.x, s.y, 1.0));
            let alpha = (opacity * (-0.5 * rho).exp()).min(0.99);
            if z < 0.2 || alpha < 1.0 / 255.0 {
                continue;
            }
            // The order: of each pixel's fragments by 17 bits of z, or of the centres.
            let unit = (z.log2().floor() - 16.0).exp2();
            let step = if sort == Sort::Pixel { (z / unit).round() * unit } else { 0.0 };
            fragments.push((step, *number, z, alpha, color, normal));
        }
        if sort == Sort::Pixel {
            fragments.sort_by(|a, b| (a.0, a.1).partial_cmp(&(b.0, b.1)).unwrap());
        }
        for (_, _, z, alpha, color, normal) in fragments {
            if t * (1.0 - alpha) < 1e-4 {
                break;
            }
            let w = alpha * t;
            let m = 100.0 / 99.8 * (1.0 - 0.2 / z);
            distortion += (m * m * (1.0 - t) + m2 - 2.0 * m * m1) * w;
            (depth, m1, m2) = (depth + z * w, m1 + m * w, m2 + m * m * w);
            median = if t > 0.5 { z } else { median };
            (n, c) = (n + *normal * w, c + *color * w);
            t *= 1.0 - alpha;
        }
        let alpha = 1.0 - t;
        let linear = |c: f64| match c / alpha {
            _ if alpha == 0.0 => 0.0,
            c if c <= 0.04045 => alpha * c / 12.92,
            c => alpha * ((c + 0.055) / 1.055).powf(2.4),
        };
        let expected = if alpha > 0.0 { depth / alpha } else { f64::INFINITY };
        [linear(c.x), linear(c.y), linear(c.z), alpha, expected, median, distortion, n.x, n.y, n.z]
    };
    (0..view.pixels()).map(pixel).collect()
}

/// Returns the largest difference outside the margin, relative for numbers above 1. Asserts that at most one pixel in
/// 40 is within the margin.
fn worst(got: &[Values], want: &[Values], margin: &[f32]) -> f64 {
    let open = margin.iter().filter(|m| **m != 0.0).count();
    assert!(open * 40 <= margin.len(), "{open} of {} pixels are within the margin", margin.len());
    let mut worst: f64 = 0.0;
    for ((got, want), _) in got.iter().zip(want).zip(margin).filter(|(_, margin)| **margin == 0.0) {
        for (got, want) in got.iter().zip(want) {
            let off = if got == want { 0.0 } else { (got - want).abs() / want.abs().max(1.0) };
            assert!(!off.is_nan(), "{got} {want}");
            worst = worst.max(off);
        }
    }
    worst
}

#[test]
fn reference_draws_flat_gaussians_by_the_published_formulas() {
    let mut field = gaussian_field(GaussianKind::Flat);
    let mut extremes = gaussian_extremes();
    let mut near = field.clone();
    near.camera.eye = [0.1, 0.0, 1.05];
    for case in [&mut field, &mut extremes, &mut near] {
        case.scene.background = [0.0; 4];
        for case in [case.clone(), by_pixel(case)] {
            let frame = drawn(&mut reference(), &case, planes().with_margin(true));
            let want = published(gaussians_of(&case).unwrap().data(), &case.view(), case.settings.sort);
            // f32 planes of f64 sums.
            let worst = worst(&values(&frame), &want, frame.margin());
            println!("{}: {worst:.1e}", case.name);
            assert!(worst < 1e-5, "{}: {worst}", case.name);
            assert!(want.iter().filter(|v| v[3] > 0.05).count() > 500, "{}: nothing is seen", case.name);
        }
    }
}

/// Returns the cases that backends are tested with: each by the defaults, in the order of pixels, and with the filter
/// `principal`.
fn cases() -> Vec<Case> {
    let mut linear = gaussian_field(GaussianKind::Flat);
    linear.scene = gaussian_scene(GaussianData { linear_colors: true, ..random_gaussians(100, GaussianKind::Flat, 5) });
    let field = gaussian_field(GaussianKind::Flat);
    let mut orthographic = field.clone();
    orthographic.camera.projection = Projection::Orthographic { height: 2.0 };
    orthographic.camera.far = Some(20.0);
    let solid = gaussian_field(GaussianKind::Solid);
    let far = |mut case: Case| {
        // Few Gaussians are larger than a pixel.
        case.camera.eye[2] = 60.0;
        case.camera.projection = Projection::Perspective { fov_y_deg: 8.0 };
        case
    };
    let mut cases = vec![field, linear, orthographic, solid, gaussian_extremes(), two_gaussian_objects()];
    cases.extend([far(gaussian_field(GaussianKind::Flat)), far(gaussian_field(GaussianKind::Solid))]);
    let principal: Vec<Case> = cases.iter().map(by_principal).collect();
    let by_pixel: Vec<Case> = cases.iter().map(by_pixel).collect();
    [cases, by_pixel, principal].concat()
}

/// Compares a backend with the reference.
fn agrees(renderer: &mut impl Renderer) {
    for case in cases() {
        let want = drawn(&mut reference(), &case, planes().with_margin(true));
        let got = drawn(renderer, &case, planes());
        let worst = worst(&values(&got), &values(&want), want.margin());
        println!("{}: {worst:.1e}", case.name);
        assert!(worst < 1e-3, "{}: {worst}", case.name);
        assert_eq!(got.weight(), got.alpha());
        let sure = want.margin().iter().zip(got.fragments().iter().zip(want.fragments())).filter(|(m, _)| **m == 0.0);
        assert!(sure.clone().all(|(_, (got, want))| got == want), "{}: other fragments", case.name);
    }
}

#[test]
fn cpu_draws_gaussians_as_the_reference_does() {
    agrees(&mut cpu(2));
}

#[test]
fn wgpu_draws_gaussians_as_the_reference_does() {
    if let Some(mut renderer) = wgpu() {
        agrees(&mut renderer);
        no_messages();
    }
}

#[test]
fn ash_draws_gaussians_as_the_reference_does() {
    if let Some(mut renderer) = ash() {
        agrees(&mut renderer);
    }
}

/// Returns the bits of all planes except weight and position.
fn bits(frame: &Frame) -> Vec<u32> {
    let colors = frame.color().as_flattened().iter().chain(frame.normal().as_flattened());
    let others = [frame.depth(), frame.alpha(), frame.median_depth(), frame.distortion()].concat();
    colors.copied().chain(others).map(f32::to_bits).chain(frame.fragments().iter().copied()).collect()
}

/// Returns a tall heap in which more Gaussians wait than fit into a GPU's pixel, most of them almost invisible.
fn heap() -> Case {
    let mut data = random_gaussians(400, GaussianKind::Flat, 31);
    data.sigmas.iter_mut().for_each(|sigmas| *sigmas = [0.5, 0.4, 0.0]);
    data.opacities.iter_mut().for_each(|opacity| *opacity *= 0.04);
    by_pixel(&Case::new("heap", gaussian_scene(data), camera(3.0, 40.0, [40, 24])))
}

#[test]
fn gpus_draw_every_fragment_of_a_heap_in_the_order_of_pixels() {
    let (case, others) = (heap(), planes().with_margin(true));
    let want = drawn(&mut reference(), &case, others);
    assert!(*want.fragments().iter().max().unwrap() > 64, "{:?}", want.fragments());
    let check = |got: &Frame| {
        let (mut worst, mut pixels) = (0.0_f64, 0);
        for (i, (got, want_values)) in values(got).iter().zip(values(&want)).enumerate() {
            if want.margin()[i] == 0.0 {
                pixels += 1;
                let off = got.iter().zip(want_values).map(|(got, want)| (got - want).abs() / want.abs().max(1.0));
                worst = off.fold(worst, f64::max);
            }
        }
        println!("{worst:.1e} in {pixels} pixels");
        assert!(worst < 1e-3 && pixels > 50, "{worst} {pixels}");
    };
    check(&drawn(&mut cpu(2), &case, planes()));
    if let Some(mut renderer) = wgpu() {
        check(&drawn(&mut renderer, &case, planes()));
        no_messages();
    }
    if let Some(mut renderer) = ash() {
        check(&drawn(&mut renderer, &case, planes()));
    }
}

/// Asserts that a backend with limits draws the same bits in parts, regions and without other planes. `limited` starts
/// the backend; `None` skips a case. Returns the bits of each case's image.
fn draws_the_same_bits<R: Renderer>(mut limited: impl FnMut(surfel_wgpu::Limits) -> Option<R>) -> Vec<Vec<u32>> {
    let mut all = Vec::new();
    let plain = surfel_wgpu::Limits::default();
    for case in [gaussian_field(GaussianKind::Solid), by_pixel(&gaussian_extremes()), heap()] {
        let Some(mut renderer) = limited(plain) else { continue };
        let whole = drawn(&mut renderer, &case, planes());
        assert_eq!(drawn(&mut renderer, &case, Planes::COLOR).color(), whole.color(), "{}", case.name);
        let region = Region { x: 5, y: 9, width: 21, height: 14 };
        let part = drawn(&mut renderer, &Case { region: Some(region), ..case.clone() }, planes());
        let [width, _] = case.camera.size;
        for (i, pixel) in part.color().iter().enumerate() {
            let (x, y) = (region.x + i as u32 % region.width, region.y + i as u32 / region.width);
            let at = (y * width + x) as usize;
            assert_eq!((pixel, part.depth()[i]), (&whole.color()[at], whole.depth()[at]), "{} {x} {y}", case.name);
        }
        // A tenth of the records at once, textures of 33 pixels, and planes of few pixels.
        for limits in [
            surfel_wgpu::Limits { record_bytes: 2000, ..plain },
            surfel_wgpu::Limits { texture_side: 33, ..plain },
            surfel_wgpu::Limits { buffer_bytes: 48 << 10, ..plain },
        ] {
            let mut renderer = limited(limits).unwrap();
            assert!(bits(&drawn(&mut renderer, &case, planes())) == bits(&whole), "{} {limits:?}", case.name);
        }
        // Memory too small for any cell's Gaussians.
        let mut renderer = limited(surfel_wgpu::Limits { memory_bytes: 1 << 10, ..plain }).unwrap();
        let resident = renderer.upload(&case.scene).unwrap();
        let mut frame = Frame::default();
        let refused = renderer.render_into(&resident, &case.view(), &case.settings, planes(), &mut frame);
        let message = refused.unwrap_err().to_string();
        assert!(message.contains("Gaussians before 16x16 pixels") && message.contains("`backend=cpu`"), "{message}");
        all.push(bits(&whole));
    }
    all
}

#[test]
fn gpus_draw_the_same_bits_in_parts_and_in_regions() {
    let by_wgpu = draws_the_same_bits(|limits| crate::validated_gpu::wgpu_with(limits, Storage::F32));
    no_messages();
    let by_ash = draws_the_same_bits(|limits| crate::validated_gpu::ash_with(limits, Storage::F32));
    assert!(by_wgpu.is_empty() || by_ash.is_empty() || by_wgpu.len() == by_ash.len());
}

#[test]
fn cpu_draws_the_same_bits_for_any_threads_regions_planes_and_levels() {
    let cases = [gaussian_field(GaussianKind::Flat), gaussian_extremes(), two_gaussian_objects()];
    let both = cases.iter().map(by_pixel).map(|case| by_principal(&case));
    for case in cases.iter().cloned().chain(cases.iter().map(by_pixel)).chain(both) {
        let whole = drawn(&mut cpu(1), &case, planes());
        for threads in [2, 7] {
            assert!(bits(&drawn(&mut cpu(threads), &case, planes())) == bits(&whole), "{}", case.name);
        }
        for level in surfel_cpu::SimdLevel::ALL {
            let options = surfel_cpu::Options::default().with_threads(2).with_simd(*level);
            let mut renderer = surfel_cpu::Renderer::new(options).unwrap();
            assert!(bits(&drawn(&mut renderer, &case, planes())) == bits(&whole), "{} {level:?}", case.name);
        }
        assert_eq!(drawn(&mut cpu(2), &case, Planes::COLOR).color(), whole.color());
        let region = Region { x: 5, y: 9, width: 21, height: 30 };
        let part = drawn(&mut cpu(2), &Case { region: Some(region), ..case.clone() }, planes());
        let [width, _] = case.camera.size;
        for (i, pixel) in part.color().iter().enumerate() {
            let (x, y) = (region.x + i as u32 % region.width, region.y + i as u32 / region.width);
            let at = (y * width + x) as usize;
            assert_eq!((pixel, part.depth()[i]), (&whole.color()[at], whole.depth()[at]), "{} {x} {y}", case.name);
        }
    }
}

/// Returns one face-on Gaussian in the middle, σ = 0.1 in both directions.
fn one(opacity: f32) -> GaussianData {
    let mut data = no_gaussians(GaussianKind::Flat);
    data.centers = Column3::from_f64(&[DVec3::ZERO]);
    data.sigmas = vec![[0.1, 0.1, 0.0]];
    data.rotations = vec![[0.0, 0.0, 0.0, 1.0]];
    data.opacities = vec![opacity];
    data.harmonics = vec![[1.0, 0.0, -1.0]];
    data
}

#[test]
fn one_gaussian_has_the_values_of_its_closed_form() {
    for opacity in [0.0, 0.0039, 0.5, 1.0] {
        let mut case = Case::new("one", gaussian_scene(one(opacity)), camera(2.0, 45.0, [33, 33]));
        case.scene.background = [0.0; 4];
        for frame in [drawn(&mut reference(), &case, planes()), drawn(&mut cpu(1), &case, planes())] {
            let focal = case.view().projection.focal_px[0];
            for (i, got) in values(&frame).iter().enumerate() {
                let d = dvec2((i % 33) as f64 - 16.0, (i / 33) as f64 - 16.0);
                // One standard deviation is 0.1·f/2 pixels.
                let rho = (d.length() / (0.05 * focal)).powi(2).min(2.0 * d.length_squared());
                let alpha = (f64::from(opacity) * (-0.5 * rho).exp()).min(0.99);
                let alpha = if alpha < 1.0 / 255.0 { 0.0 } else { alpha };
                assert!((got[3] - alpha).abs() < 1e-6, "{i}: {got:?} {alpha}");
                if alpha > 0.0 {
                    assert!((got[4] - 2.0).abs() < 1e-5 && (got[9] - alpha).abs() < 1e-5, "{got:?}");
                }
            }
        }
    }
}

#[test]
fn scenes_of_nothing_show_the_background() {
    let case = Case::new("none", gaussian_scene(no_gaussians(GaussianKind::Flat)), camera(2.0, 45.0, [20, 9]));
    for frame in [drawn(&mut reference(), &case, planes()), drawn(&mut cpu(2), &case, planes())] {
        let [r, g, b, a] = case.scene.background;
        for (i, got) in frame.color().iter().enumerate() {
            let off = [r * a, g * a, b * a, a].into_iter().zip(got).map(|(want, got)| (want - f64::from(*got)).abs());
            assert!(off.fold(0.0, f64::max) < 1e-6, "{got:?}");
            let rest = (frame.alpha()[i], frame.depth()[i], frame.median_depth()[i], frame.distortion()[i]);
            assert_eq!(rest, (0.0, f32::INFINITY, f32::INFINITY, 0.0));
        }
    }
}

#[test]
fn colors_stay_with_the_object_where_it_is_turned() {
    let still = gaussian_field(GaussianKind::Flat);
    let turn = DAffine3::from_rotation_y(1.1) * DAffine3::from_translation(dvec3(0.3, -0.2, 0.5));
    let mut turned = still.clone();
    turned.scene.objects[0].world_from_object = turn;
    let along = |v: [f64; 3]| turn.transform_point3(v.into()).to_array();
    turned.camera.eye = along(still.camera.eye);
    turned.camera.target = along(still.camera.target);
    turned.camera.up = turn.transform_vector3(still.camera.up.into()).to_array();
    let [a, b] = [&still, &turned].map(|case| drawn(&mut reference(), case, planes().with_margin(true)));
    let (mut a_values, mut b_values) = (values(&a), values(&b));
    // Normals turn, too.
    a_values.iter_mut().chain(&mut b_values).for_each(|v| v[7..].fill(0.0));
    assert!(worst(&b_values, &a_values, a.margin()) < 1e-5);
}

#[test]
fn plan_of_gaussians_has_one_pass_and_surfaces_have_none_of_it() {
    let everything = Capabilities::everything("test");
    let planned =
        |case: &Case, planes| plan(&SceneSummary::of(&case.scene), &case.view(), &case.settings, planes, &everything);
    let field = gaussian_field(GaussianKind::Flat);
    let plain = planned(&field, Planes::COLOR).unwrap();
    assert_eq!((plain.passes.as_slice(), plain.attributes.sums(), plain.reach_px()), (&[Pass::Gaussians][..], 1, 0));
    // Settings of surfaces have no effect.
    let other = field.with("other", |s| *s = s.with_edge_aa(EdgeAa::Samples).with_shader(Shader::Toon));
    assert_eq!(planned(&other, Planes::COLOR).unwrap(), plain);
    assert_ne!(planned(&by_pixel(&field), Planes::COLOR).unwrap(), plain);
    assert_ne!(planned(&by_principal(&field), Planes::COLOR).unwrap(), plain);
    let without = Capabilities { backend: "gpu", lacks: &[Feature::Gaussians, Feature::Toon, Feature::EdgeSamples] };
    let refused = |case: &Case| {
        let summary = SceneSummary::of(&case.scene);
        unsupported(&summary, &case.settings, Planes::COLOR, &without).map(|e| e.to_string())
    };
    assert!(refused(&other).unwrap().contains("`composite=surface`"));
    let ball = Case::new("ball", surfel_model::Scene::from(cloud(&sphere(50, 1.2, 1))), camera(3.0, 45.0, [16; 2]));
    assert!(!planned(&ball, Planes::ALL).unwrap().has(Pass::Gaussians) && refused(&ball).is_none());
    // Planes of one kind of scene, requested of the other.
    for planes in
        [Planes::COLOR.with_alpha(true), Planes::COLOR.with_median_depth(true), Planes::COLOR.with_distortion(true)]
    {
        assert!(planned(&field, planes).is_ok());
        assert!(planned(&ball, planes).unwrap_err().to_string().contains("`composite=over`"));
    }
    assert!(planned(&field, Planes::COLOR.with_index(true)).unwrap_err().to_string().contains("index"));
    // A scene has either Gaussians or surfaces.
    let mut mixed = field.clone();
    mixed.scene.objects.push(object(cloud(&sphere(50, 1.2, 1))));
    assert!(planned(&mixed, Planes::COLOR).unwrap_err().to_string().contains("surfaces"));
    let mut spaces = field.clone();
    spaces.scene.objects.push(gaussian_object(GaussianData { linear_colors: true, ..one(0.5) }));
    assert!(planned(&spaces, Planes::COLOR).unwrap_err().to_string().contains("linear"));
}

#[test]
fn frame_without_planes_of_gaussians_holds_none() {
    let case = gaussian_field(GaussianKind::Flat);
    for frame in [drawn(&mut reference(), &case, Planes::COLOR), drawn(&mut cpu(1), &case, Planes::COLOR)] {
        assert!(frame.alpha().is_empty() && frame.median_depth().is_empty() && frame.distortion().is_empty());
        assert!(frame.depth().is_empty() && frame.normal().is_empty() && frame.weight().is_empty());
    }
}

#[test]
fn what_is_in_one_order_everywhere_is_drawn_alike_in_both() {
    // Sheets behind one another, which every ray meets in the order of their centres.
    let mut data = no_gaussians(GaussianKind::Flat);
    let centers: Vec<DVec3> =
        (0..40).map(|i| dvec3(0.02 * f64::from(i), 0.0, -0.05 * f64::from((i * 7) % 40))).collect();
    data.centers = Column3::from_f64(&centers);
    for i in 0..40 {
        data.sigmas.push([0.3, 0.1, 0.0]);
        data.rotations.push([0.0, 0.0, 0.0, 1.0]);
        data.opacities.push(0.4);
        data.harmonics.push([0.1 * i as f32 - 1.7, 1.0, 0.0]);
    }
    let case = Case::new("sheets", gaussian_scene(data), camera(2.0, 45.0, [40, 30]));
    let [center, pixel] = [case.clone(), by_pixel(&case)].map(|case| drawn(&mut cpu(2), &case, planes()));
    assert_eq!(values(&center), values(&pixel));
    let tilted = case.with("tilted", |_| ());
    let tilted = Case { camera: surfel_model::Camera { eye: [1.5, 0.0, 1.5], ..tilted.camera }, ..tilted };
    let [center, pixel] = [tilted.clone(), by_pixel(&tilted)].map(|case| drawn(&mut cpu(2), &case, planes()));
    assert_ne!(center.color(), pixel.color());
}

#[test]
fn turning_camera_makes_gaussians_pop_in_the_order_of_centers_alone() {
    for kind in [GaussianKind::Flat, GaussianKind::Solid] {
        let mut random = Random::new(5);
        let mut data = random_gaussians(150, kind, 11);
        for i in 0..150 {
            // The Gaussians intersect, and are so large and little tilted that pixels resolve them.
            data.sigmas[i] = [(); 3].map(|()| random.range(0.2, 0.4) as f32);
            let [x, y] = [(); 2].map(|()| random.range(-0.8, 0.8));
            data.rotations[i] = (DQuat::from_rotation_x(x) * DQuat::from_rotation_y(y)).as_quat().to_array();
        }
        let case = Case::new("turning", gaussian_scene(data), camera(3.2, 45.0, [64, 64]));
        let [center, pixel] = [case.clone(), by_pixel(&case)].map(|case| Turning::of(&case, 40));
        println!("{kind:?}: {center:.4?} {pixel:.4?}");
        assert!(center.largest_over_median > 1.8 && center.beyond_motion > 0.03, "{kind:?}: {center:?}");
        // Between two edges less than a quarter of a pixel apart, there may be no sample.
        assert!(pixel.largest_over_median < 1.2 && pixel.beyond_motion < 0.012, "{kind:?}: {pixel:?}");
    }
}

/// Changes of images while the camera turns by 0.1° per step, which is less than half a pixel.
#[derive(Debug)]
struct Turning {
    /// Largest mean change of an image over all steps, divided by their median.
    largest_over_median: f64,
    /// Largest distance of a pixel's channel from the range of its 4×4 samples of the step before.
    beyond_motion: f64,
}

impl Turning {
    fn of(case: &Case, steps: u32) -> Self {
        let mut renderer = cpu(2);
        let mut image = |step: u32, fine: u32| {
            let mut case = case.clone();
            let (sin, cos) = (0.1 * f64::from(step)).to_radians().sin_cos();
            case.camera.target = [3.2 * sin, 0.0, 3.2 * (1.0 - cos)];
            case.camera.size = case.camera.size.map(|side| side * fine);
            drawn(&mut renderer, &case, Planes::COLOR).color().to_vec()
        };
        let (mut means, mut beyond_motion) = (Vec::new(), 0.0_f32);
        let width = case.camera.size[0] as usize;
        for step in 1..steps {
            let (before, samples, after) = (image(step - 1, 1), image(step - 1, 4), image(step, 1));
            let mut sum = 0.0;
            for (at, value) in after.iter().enumerate() {
                let corner = at / width * 16 * width + at % width * 4;
                let of_pixel = (0..16).map(|k| samples[corner + k / 4 * 4 * width + k % 4]);
                let range = of_pixel.fold([[f32::MAX; 4], [f32::MIN; 4]], |[least, most], v| {
                    [std::array::from_fn(|c| least[c].min(v[c])), std::array::from_fn(|c| most[c].max(v[c]))]
                });
                for c in 0..3 {
                    beyond_motion = beyond_motion.max(range[0][c] - value[c]).max(value[c] - range[1][c]);
                    sum += f64::from((value[c] - before[at][c]).abs());
                }
            }
            means.push(sum / (3 * after.len()) as f64);
        }
        means.sort_by(f64::total_cmp);
        let largest_over_median = means[means.len() - 1] / means[means.len() / 2];
        Self { largest_over_median, beyond_motion: beyond_motion.into() }
    }
}

/// Returns the RMSE of a case's image in linear light. The truth is the mean of 8×8 samples per pixel, with the filter
/// `principal` and a filter radius of 0. The CPU backend draws both.
fn error(case: &Case) -> f64 {
    let mut samples = by_principal(case);
    samples.settings.prefilter_radius_px = 0.0;
    samples.camera.size = samples.camera.size.map(|side| 8 * side);
    let width = case.camera.size[0] as usize;
    let (image, samples) = (drawn(&mut cpu(2), case, Planes::COLOR), drawn(&mut cpu(2), &samples, Planes::COLOR));
    let mut sum = 0.0;
    for (at, pixel) in image.color().iter().enumerate() {
        let corner = at / width * 64 * width + at % width * 8;
        for (c, value) in pixel[..3].iter().enumerate() {
            let of_pixel = (0..64).map(|k| f64::from(samples.color()[corner + k / 8 * 8 * width + k % 8][c]));
            sum += (f64::from(*value) - of_pixel.sum::<f64>() / 64.0).powi(2);
        }
    }
    (sum / (3 * image.color().len()) as f64).sqrt()
}

#[test]
fn principal_is_nearer_to_supersampled_gaussians_than_what_they_were_trained_with() {
    for kind in [GaussianKind::Flat, GaussianKind::Solid] {
        // A ball with squares of two colours; Gaussians are as far apart as they are wide.
        let mut random = Random::new(3);
        let mut data = no_gaussians(kind);
        let spacing = (4.0 * std::f64::consts::PI / 20_000.0_f64).sqrt();
        let mut centers = Vec::new();
        for _ in 0..20_000 {
            let n = random.direction();
            centers.push(n);
            let [a, b] = [(); 2].map(|()| (random.factor(0.4, 1.0) * spacing) as f32);
            data.sigmas.push([a, b, 0.05 * spacing as f32]);
            data.rotations.push(DQuat::from_rotation_arc(DVec3::Z, n).as_quat().to_array());
            data.opacities.push(random.range(0.3, 1.0) as f32);
            let is_dark = ((n.x * 6.0).floor() + (n.y * 6.0).floor()) % 2.0 == 0.0;
            data.harmonics.push(if is_dark { [-1.4, -1.2, -0.8] } else { [1.5, 1.2, 0.6] });
        }
        data.centers = Column3::from_f64(&centers);
        let mut case = Case::new("ball", gaussian_scene(data), camera(40.0, 3.2, [48, 48]));
        for (zoom, gain) in [(0.25, 2.3), (0.5, 3.5), (1.0, 3.5), (4.0, 0.99), (16.0, 0.99)] {
            // Angles are small: the image's height in units is proportional to them.
            case.camera.projection = Projection::Perspective { fov_y_deg: 3.2 / zoom };
            let focal = case.view().projection.focal_px[0];
            let [trained, principal] = [error(&case), error(&by_principal(&case))];
            let sigma_px = 0.65 * spacing * focal / 39.0;
            println!("{kind:?}: sigma {sigma_px:.2} px: {trained:.4} as trained, {principal:.4} principal");
            assert!(principal * gain < trained, "{kind:?} {zoom}: {trained} {principal}");
        }
    }
}

#[test]
fn tiny_gaussian_covers_by_its_area_where_it_is_filtered() {
    let mut case = by_principal(&Case::new("one", gaussian_scene(one(0.8)), camera(400.0, 45.0, [33, 33])));
    case.scene.background = [0.0; 4];
    let focal = case.view().projection.focal_px[0];
    let sigma = 0.1 / 400.0 * focal;
    // Half of the filter's half-width is one standard deviation.
    let least = 0.5 * std::f64::consts::FRAC_1_SQRT_2;
    for frame in [drawn(&mut reference(), &case, planes()), drawn(&mut cpu(1), &case, planes())] {
        for (i, got) in values(&frame).iter().enumerate() {
            let d = dvec2((i % 33) as f64 - 16.0, (i / 33) as f64 - 16.0).length() / least;
            let alpha = 0.8 * (-0.5 * d * d).exp();
            let alpha = if alpha < 1.0 / 255.0 { 0.0 } else { alpha * (sigma / least).powi(2) };
            assert!((got[3] - alpha).abs() < 1e-7, "{i}: {got:?} {alpha}");
        }
    }
}

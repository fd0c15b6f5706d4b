//! Closed forms at extremes, on every backend: disks larger than f32's squares, colours beyond its range, hundreds of
//! faint surfaces, thousands of Gaussians in a pixel, and solid Gaussians that a matrix shears.

use crate::drawing::{drawn_once, reference_image};
use crate::validated_gpu::{ash, no_messages, wgpu};
use glam::{DAffine3, DMat3, DQuat, DVec3, dvec3};
use surfel_conformance::build::{Splat, camera, cloud, object, ray, scene, with_alpha};
use surfel_conformance::random::Random;
use surfel_conformance::scenes::{Case, gaussian_object, gaussian_scene, no_gaussians};
use surfel_model::{
    CloudData, Column3, Filter, GaussianData, GaussianKind, Light, Mapping, OnInvalid, Projection, Shader, Shape, Sort,
    SplatCloud, Transparency,
};
use surfel_reference::Renderer as Reference;
use surfel_render::{Frame, Planes, Renderer};

/// Calls `check` with a backend's name and its image of each case, for the reference, `cpu` and available GPUs.
fn on_every_backend(cases: &[Case], planes: Planes, check: impl Fn(&str, &Case, &Frame)) {
    fn draw(renderer: &mut impl Renderer, cases: &[Case], planes: Planes, check: impl Fn(&str, &Case, &Frame)) {
        let name = renderer.info().backend;
        cases.iter().for_each(|case| check(name, case, &drawn_once(renderer, case, planes).0));
    }
    draw(&mut Reference::new(Default::default()).unwrap(), cases, planes, &check);
    draw(&mut surfel_cpu::Renderer::new(Default::default()).unwrap(), cases, planes, &check);
    if let Some(mut renderer) = wgpu() {
        draw(&mut renderer, cases, planes, &check);
        no_messages();
    }
    if let Some(mut renderer) = ash() {
        draw(&mut renderer, cases, planes, &check);
    }
}

fn assert_near(got: f32, want: f64, tolerance: f64, what: &str) {
    assert!((f64::from(got) - want).abs() <= tolerance, "{what}: {got}, expected {want} within {tolerance}");
}

/// Returns a cloud of one disk with the normal `n`, centred at the origin.
fn disk(n: DVec3, radius: f32) -> SplatCloud {
    let (z, normals) = (Column3::from_f64(&[DVec3::ZERO]), Column3::from_f64(&[n]));
    let mut data = CloudData::new(DVec3::ZERO, z, Shape::Disks { normals, radii: vec![radius] });
    data.colors = Some(vec![[0.8, 0.4, 0.1]]);
    SplatCloud::new(data, OnInvalid::Refuse).unwrap().0
}

#[test]
fn disks_of_any_size_and_tilt_cover_what_their_plane_does() {
    let tilts = [[0.0, 0.0], [0.3, 0.0], [-2.0, 0.0], [0.0, 0.3], [0.0, -4.0], [0.2, -0.3], [1e-12, 0.0]];
    let settings = [
        (Filter::None, Mapping::Exact),
        (Filter::Principal, Mapping::Exact),
        (Filter::Ewa, Mapping::Exact),
        (Filter::Adjust, Mapping::Exact),
        (Filter::Clamp, Mapping::Exact),
        (Filter::Principal, Mapping::Affine),
    ];
    let mut cases = Vec::new();
    for (k, [x, y]) in tilts.into_iter().enumerate() {
        for (i, radius) in [1e8, 3e15, 1e19, 1e30].into_iter().enumerate() {
            let n = dvec3(x, y, 1.0);
            let ellipse = cloud(&[Splat::disk(DVec3::ZERO, n, f64::from(radius), [0.8, 0.4, 0.1])]);
            // The settings alternate over tilts and radii.
            let (filter, mapping) = settings[(k + i) % settings.len()];
            for (shape, cloud) in [("disk", disk(n, radius)), ("ellipse", ellipse)] {
                let mut scene = scene(&[]);
                (scene.background, scene.objects) = ([0.0; 4], vec![object(cloud)]);
                let mut case = Case::new(&format!("{shape} {radius:e} ({x}, {y})"), scene, camera(5.0, 50.0, [7, 6]));
                case.camera.near = 0.1;
                case = case.with(filter.name(), |s| (s.filter, s.mapping) = (filter, mapping));
                let mut flat = case.with("orthographic", |_| ());
                (flat.camera.projection, flat.camera.far) = (Projection::Orthographic { height: 1.0 }, Some(1e3));
                cases.extend([case, flat]);
            }
        }
    }
    on_every_backend(&cases, Planes::ALL, |backend, case, frame| {
        let perspective = matches!(case.camera.projection, Projection::Perspective { .. });
        let n = {
            let at = case.name.split(['(', ')']).nth(1).unwrap();
            let tilt: Vec<f64> = at.split(", ").map(|v| v.parse().unwrap()).collect();
            dvec3(tilt[0], tilt[1], 1.0)
        };
        let what = format!("{backend}, {}", case.name);
        for y in 0..6 {
            for x in 0..7 {
                let at = (y * 7 + x) as usize;
                // Solves for z so that eye + z·d is on the plane.
                let z = if perspective {
                    -n.dot(case.camera.eye.into()) / n.dot(ray(&case.camera, x, y))
                } else {
                    let world = dvec3((f64::from(x) - 3.0) / 6.0, (2.5 - f64::from(y)) / 6.0, 0.0);
                    5.0 + n.dot(world)
                };
                let is_hit = z >= 0.1;
                let want = if is_hit { [0.8, 0.4, 0.1, 1.0] } else { [0.0; 4] };
                for (got, want) in frame.color()[at].into_iter().zip(want) {
                    assert_near(got, want, 1e-6, &what);
                }
                assert_near(frame.weight()[at], f64::from(u8::from(is_hit)), 1e-5, &what);
                if is_hit {
                    assert_near(frame.depth()[at], z, 1e-5 * z, &what);
                }
            }
        }
    });
}

/// Returns `count` facing disks of opacity `alpha` that cover the image, from z = 1 to −1, drawn with an A-buffer.
fn stack(count: usize, alpha: f32, layers: u32) -> Case {
    let place = |i: usize| dvec3(0.0, 0.0, 1.0 - 2.0 * i as f64 / count as f64);
    let splats: Vec<Splat> = (0..count).map(|i| Splat::disk(place(i), DVec3::Z, 60.0, [0.8, 0.4, 0.1])).collect();
    let mut scene = scene(&[]);
    (scene.background, scene.objects) = ([0.0; 4], vec![object(with_alpha(cloud(&splats), |_| alpha))]);
    scene.objects[0].material.interior_weight = Some(0.5);
    Case::new(&format!("{count} surfaces of {alpha}"), scene, camera(5.0, 45.0, [6, 5])).with("abuffer", |s| {
        s.transparency = Transparency::ABuffer { layers };
        s.depth_tolerance = surfel_model::DepthTolerance::Absolute(1e-6);
        s.filter = Filter::None;
    })
}

/// Asserts that every pixel has the alpha 1 − (1 − α)ⁿ and the disks' colour, where α is `alpha` and n is `count`.
fn is_whole_stack(frame: &Frame, count: usize, alpha: f32, what: &str) {
    let covered = 1.0 - (1.0 - f64::from(alpha)).powf(count as f64);
    for color in frame.color() {
        for (got, want) in color.iter().zip([0.8, 0.4, 0.1, 1.0]) {
            assert_near(*got, want * covered, 3e-5, what);
        }
    }
}

#[test]
fn abuffer_of_many_faint_surfaces_keeps_their_alpha() {
    // Sixteen bits would have an error of 2 % in the first, and lose the second wholly.
    let stacks = [(60, 5e-4), (60, 7e-6), (40, 1.2e-2)];
    let cases = stacks.map(|(count, alpha)| stack(count, alpha, 64));
    on_every_backend(&cases, Planes::COLOR, |backend, case, frame| {
        let &(count, alpha) = stacks.iter().zip(&cases).find(|(_, own)| own.name == case.name).unwrap().0;
        is_whole_stack(frame, count, alpha, &format!("{backend}, {}", case.name));
    });
}

#[test]
fn abuffer_of_thousands_of_surfaces_is_whole_on_the_cpu_and_refused_by_gpus() {
    fn try_draw<R: Renderer>(renderer: &mut R, case: &Case) -> Result<(), String> {
        let resident = renderer.upload(&case.scene).unwrap();
        let mut frame = Frame::default();
        let drawn = renderer.render_into(&resident, &case.view(), &case.settings, Planes::COLOR, &mut frame);
        drawn.map(|_| ()).map_err(|error| error.to_string())
    }
    let case = stack(3000, 1e-3, 8);
    let (mut reference, mut cpu) =
        (Reference::new(Default::default()).unwrap(), surfel_cpu::Renderer::new(Default::default()).unwrap());
    is_whole_stack(&drawn_once(&mut reference, &case, Planes::COLOR).0, 3000, 1e-3, "reference");
    is_whole_stack(&drawn_once(&mut cpu, &case, Planes::COLOR).0, 3000, 1e-3, "cpu");
    // A few more surfaces than GPUs draw.
    let case = stack(300, 1e-3, 8);
    let is_refused = |drawn: Result<(), String>| {
        let message = drawn.unwrap_err();
        assert!(message.contains("255") && message.contains("`backend=cpu`"), "{message}");
    };
    if let Some(mut renderer) = wgpu() {
        is_refused(try_draw(&mut renderer, &case));
        no_messages();
    }
    if let Some(mut renderer) = ash() {
        is_refused(try_draw(&mut renderer, &case));
    }
}

#[test]
fn abuffer_whose_pixels_have_many_surfaces_each_of_its_own_is_the_references() {
    let mut random = Random::new(11);
    let splats: Vec<Splat> = (0..900)
        .map(|_| {
            let p = dvec3(random.range(-2.0, 2.0), random.range(-2.0, 2.0), random.range(-3.0, 1.0));
            let n = dvec3(random.range(-0.2, 0.2), random.range(-0.2, 0.2), 1.0);
            Splat::disk(p, n, random.range(0.3, 1.5), random.color())
        })
        .collect();
    let mut case = stack(1, 1e-3, 8);
    case.scene.objects = vec![object(with_alpha(cloud(&splats), |i| [0.01, 0.05, 0.3][i % 3]))];
    case.scene.objects[0].material.interior_weight = Some(0.5);
    case.camera.size = [24, 20];
    let want = reference_image(&case);
    let got = drawn_once(&mut surfel_cpu::Renderer::new(Default::default()).unwrap(), &case, Planes::ALL).0;
    let mut compared = 0;
    for (i, (got, want)) in got.color().iter().zip(want.color()).enumerate().filter(|(i, _)| want.margin()[*i] == 0.0) {
        got.iter().zip(want).for_each(|(got, want)| assert_near(*got, f64::from(*want), 2e-5, &format!("{i}")));
        compared += 1;
    }
    assert!(compared > 50, "{compared}");
}

/// Returns the largest relative error of depth, and the largest error of a colour channel, of `count` coincident
/// splats. They are compared with one such splat, on the CPU.
fn depth_error_of_coincident(count: usize) -> [f64; 2] {
    let splat = Splat::disk(dvec3(0.1, -0.2, 2.3), dvec3(0.2, 0.1, 1.0), 1.5, [0.3, 0.7, 0.1]);
    let case = Case::new("coincident", scene(&vec![splat; count]), camera(5.0, 20.0, [8, 8]));
    let mut cpu = surfel_cpu::Renderer::new(Default::default()).unwrap();
    let [got, one] = [case, Case::new("one", scene(&[splat]), camera(5.0, 20.0, [8, 8]))]
        .map(|case| drawn_once(&mut cpu, &case, Planes::ALL).0);
    let depths = got.depth().iter().zip(one.depth());
    let depth = depths.map(|(got, want)| f64::from((got - want).abs() / want)).fold(0.0, f64::max);
    let colors = got.color().as_flattened().iter().zip(one.color().as_flattened());
    [depth, colors.map(|(got, want)| f64::from((got - want).abs())).fold(0.0, f64::max)]
}

#[test]
fn depth_of_coincident_splats_errs_as_stated() {
    // For a million: 2.4 and 1.6 %.
    for (count, most) in [(10_000, [3e-4, 3e-4]), (100_000, [3e-3, 2e-3])] {
        let error = depth_error_of_coincident(count);
        println!("{count}: depth {:.1e}, colour {:.1e}", error[0], error[1]);
        assert!(error[0] <= most[0] && error[1] <= most[1], "{count}: {error:?}");
    }
}

#[test]
fn colors_beyond_the_range_of_f32_are_finite() {
    let largest = surfel_math::srgb::MAX_COLOR as f32;
    let mut splats = surfel_conformance::build::sphere(300, 1.5, 5);
    splats.iter_mut().for_each(|splat| splat.color = [3e38, -3e38, 0.5]);
    let mut ball = scene(&splats);
    let mut cases = vec![Case::new("unlit", ball.clone(), camera(3.0, 45.0, [16, 16]))];
    ball.objects[0].material.interior_weight = Some(2.0);
    ball.lights = Some(vec![Light::Directional { direction: [0.0, 0.0, -1.0], color: [1e300; 3], shadow: false }; 3]);
    ball.ambient = [1e200, 1e39, 0.0];
    let lit = Case::new("lit", ball.clone(), camera(3.0, 45.0, [16, 16]));
    cases.extend([Shader::Phong, Shader::Toon].map(|shader| lit.with(shader.name(), |s| s.shader = shader)));
    cases.push(lit.with("samples", |s| s.edge_aa = surfel_model::EdgeAa::Samples));
    let mut glass = lit.with("peeled", |s| s.transparency = "peel:2".parse().unwrap());
    glass.scene.objects = vec![object(with_alpha(cloud(&splats), |_| 0.3))];
    glass.scene.objects[0].material.interior_weight = Some(2.0);
    glass.scene.background = [1e300, 1.0, 1.0, 1.0];
    cases.push(glass);
    on_every_backend(&cases, Planes::COLOR, |backend, case, frame| {
        let what = format!("{backend}, {}", case.name);
        assert!(frame.color().as_flattened().iter().all(|c| c.is_finite() && c.abs() <= f32::MAX), "{what}");
        if case.name == "unlit" {
            let [r, g, b, a] = frame.color()[8 * 16 + 8];
            assert!((2.9e38..=largest).contains(&r) && (-largest..=-2.9e38).contains(&g), "{what}: {r} {g}");
            assert!((b - 0.5).abs() < 1e-4 && a == 1.0, "{what}: {b} {a}");
        }
    });
    // For Gaussians, decoding alone may exceed the range.
    let gaussians = |f_dc: f32| {
        let mut data = no_gaussians(GaussianKind::Flat);
        (data.centers, data.sigmas) = (Column3::from_f64(&[DVec3::ZERO]), vec![[0.3, 0.3, 0.0]]);
        (data.rotations, data.opacities) = (vec![[0.0, 0.0, 0.0, 1.0]], vec![1.0]);
        data.harmonics = vec![[f_dc, 0.0, 0.1]];
        let mut scene = gaussian_scene(data);
        scene.background = [0.0; 4];
        Case::new(&format!("gaussian {f_dc:e}"), scene, camera(2.0, 45.0, [9, 9]))
    };
    on_every_backend(&[1e17, 3e38, -3e38].map(gaussians), Planes::COLOR, |backend, case, frame| {
        let [r, _, b, a] = frame.color()[4 * 9 + 4];
        let what = format!("{backend}, {}: {r} {b} {a}", case.name);
        let want = if case.name.contains('-') { 0.0 } else { largest };
        assert!(r == want && b > 0.0 && b < 1.0 && a > 0.9, "{what}");
        assert!(frame.color().as_flattened().iter().all(|c| c.is_finite()), "{what}");
    });
}

/// Returns Gaussians at these positions, equal except for their colours and rotations. `turn` returns the rotation of
/// each.
fn gaussians(centers: &[DVec3], sigma: f32, turn: impl Fn(usize) -> DQuat, opacity: f32) -> GaussianData {
    let mut data = no_gaussians(GaussianKind::Flat);
    let mut random = Random::new(3);
    data.centers = Column3::from_f64(centers);
    for i in 0..centers.len() {
        data.sigmas.push([sigma, sigma, 0.0]);
        data.rotations.push(turn(i).as_quat().to_array());
        data.opacities.push(opacity);
        data.harmonics.push([(); 3].map(|()| random.range(-1.7, 1.7) as f32));
    }
    data
}

#[test]
fn gaussians_by_pixel_are_all_there_however_many_wait() {
    let mut random = Random::new(7);
    let mut case = |name: &str, count: usize, sigma: f32, tilt: f64| {
        let centers: Vec<DVec3> = (0..count).map(|_| DVec3::Z * random.range(-0.5, 0.5)).collect();
        let turns: Vec<DQuat> =
            (0..count).map(|_| DQuat::from_rotation_z(random.range(0.0, 6.0)) * DQuat::from_rotation_x(tilt)).collect();
        let mut scene = gaussian_scene(gaussians(&centers, sigma, |i| turns[i], 1.0 / 149.0));
        scene.background = [0.0; 4];
        Case::new(name, scene, camera(5.0, 45.0, [8, 8])).with("by pixel", |s| s.sort = Sort::Pixel)
    };
    // All their depths overlap, so that each fragment waits for all listed Gaussians.
    let cases = [case("tilted", 1000, 400.0, 0.8), case("facing", 1200, 40.0, 0.0), case("steep", 700, 2e3, 1.0)];
    on_every_backend(&cases, Planes::COLOR.with_alpha(true), |backend, case, frame| {
        let count = case.scene.objects.iter().map(|o| match &o.geometry {
            surfel_model::Geometry::Gaussians(cloud) => cloud.len(),
            _ => 0,
        });
        let want = 1.0 - (1.0 - 1.0 / 149.0_f64).powf(count.sum::<usize>() as f64);
        for (i, got) in frame.alpha().iter().enumerate() {
            // A standard deviation is far wider than the image.
            assert_near(*got, want, 1e-3, &format!("{backend}, {} at {i}", case.name));
        }
    });
}

#[test]
fn long_lists_of_gaussians_are_read_to_their_end() {
    // Far away, and so small that each covers 1e-5 of a pixel: none ends the pixel, and the last counts like the first.
    let count = 70_000;
    let centers = vec![DVec3::ZERO; count];
    let mut case = Case::new(
        "far",
        gaussian_scene(gaussians(&centers, 2.35e-3, |_| DQuat::IDENTITY, 1.0)),
        camera(1.0, 1.0, [3, 3]),
    );
    case.camera.eye = [0.0, 0.0, 1000.0];
    case.camera.projection = Projection::Perspective { fov_y_deg: 0.3 };
    case.scene.background = [0.0; 4];
    let focal = case.view().projection.focal_px[0];
    let (sigma_px, least) = (2.35e-3 / 1000.0 * focal, 0.5 * std::f64::consts::FRAC_1_SQRT_2);
    let alpha = 0.99 * (sigma_px / least).powi(2);
    let case = case.with("principal", |s| s.gaussian_filter = Filter::Principal);
    on_every_backend(&[case], Planes::COLOR.with_alpha(true), |backend, case, frame| {
        let want = 1.0 - (1.0 - alpha).powf(count as f64);
        assert!(want > 0.05 && want < 0.9, "{want}");
        // 1 − α has an error of up to 6e-8, or 0.4 % of α.
        assert_near(frame.alpha()[4], want, 3e-3, &format!("{backend}, {}", case.name));
    });
}

#[test]
fn normal_of_a_solid_gaussian_is_the_shortest_axis_of_what_is_drawn() {
    let mut cases = Vec::new();
    let mut want = Vec::new();
    let mut random = Random::new(5);
    for i in 0..6 {
        let sigmas = [[0.4, 0.2, 0.32], [0.1, 0.3, 0.2], [0.3, 0.1, 0.05]][i % 3].map(|s: f32| s);
        let rotation = match i {
            0 => DQuat::from_rotation_z(std::f64::consts::FRAC_PI_4),
            _ => DQuat::from_axis_angle(random.direction(), random.range(0.0, 6.0)),
        };
        let matrix = match i {
            0 => DMat3::from_diagonal(dvec3(3.0, 1.0, 1.0)),
            1 => DMat3::from_diagonal(dvec3(-2.0, 0.5, 1.0)),
            _ => DMat3::from_cols(random.direction(), random.direction() * 2.0, random.direction()),
        };
        let mut data = no_gaussians(GaussianKind::Solid);
        (data.centers, data.sigmas) = (Column3::from_f64(&[DVec3::ZERO]), vec![sigmas]);
        (data.rotations, data.opacities) = (vec![rotation.as_quat().to_array()], vec![0.95]);
        data.harmonics = vec![[0.0; 3]];
        let mut object = gaussian_object(data);
        object.world_from_object = DAffine3::from_mat3(matrix);
        let mut scene = gaussian_scene(no_gaussians(GaussianKind::Solid));
        (scene.background, scene.objects) = ([0.0; 4], vec![object]);
        let mut case = Case::new(&format!("{i}"), scene, camera(5.0, 30.0, [9, 9]));
        case.camera.eye = [3.0, 1.0, 4.0];
        cases.push(case);
        // Repeated application of the inverse covariance converges to its shortest axis.
        let half = matrix * DMat3::from_quat(rotation) * DMat3::from_diagonal(DVec3::from(sigmas.map(f64::from)));
        let inverse = (half * half.transpose()).inverse();
        let axis = (0..2000).fold(dvec3(0.3, 0.5, 0.7), |v, _| (inverse * v).normalize());
        want.push(if axis.dot(dvec3(3.0, 1.0, 4.0)) < 0.0 { -axis } else { axis });
    }
    // The exact eigenvalues: .4776 and .1024 of half of [[9, 3], [3, 1]]·.16 + [[9, −3], [−3, 1]]·.04.
    assert!((want[0] - dvec3(-0.210, 0.978, 0.0)).length().min((want[0] + dvec3(-0.210, 0.978, 0.0)).length()) < 1e-3);
    on_every_backend(&cases, Planes::ALL, |backend, case, frame| {
        let got = DVec3::from(frame.normal()[4 * 9 + 4].map(f64::from)).normalize();
        let want = want[case.name.parse::<usize>().unwrap()];
        assert!((got - want).length() < 1e-5, "{backend}, {}: {got} {want}", case.name);
    });
}

//! Images against closed forms that are independent of any renderer.

use crate::drawing::{F32, reference_image};
use glam::{DMat3, DVec3};
use std::f64::consts::FRAC_1_SQRT_2;
use surfel_conformance::build::{Splat, camera, ray, scene};
use surfel_conformance::scenes::{self, Case};
use surfel_model::{Filter, Geometry, Light, Shader};
use surfel_render::Frame;

fn pixels(frame: &Frame) -> impl Iterator<Item = (u32, u32, usize)> + use<> {
    let (width, height) = (frame.width(), frame.height());
    (0..height).flat_map(move |y| (0..width).map(move |x| (x, y, (y * width + x) as usize)))
}

#[test]
fn orientation_right_is_right_up_is_up_and_near_is_large() {
    let frame = reference_image(&scenes::orientation());
    let color = |x: usize, y: usize| frame.color()[y * 80 + x];
    // f = 28/tan 25° = 60.05 px; red at x = 0.8, green at y = 0.6, both at distance 3; blue nearer, down left.
    assert!(color(55, 27)[0] > 0.8, "{:?}", color(55, 27));
    assert!(color(40, 15)[1] > 0.7, "{:?}", color(40, 15));
    assert!(color(32, 35)[2] > 0.8, "{:?}", color(32, 35));
    let blue = frame.color().iter().filter(|c| c[2] > 0.8).count() as f64;
    // π·(0.1·60.05/2.5)² = 18.1 px; the rim adds or removes a few.
    assert!((blue - 18.1).abs() < 5.0, "{blue}");
}

#[test]
fn kernel_of_a_facing_disk_is_a_gaussian_about_its_centre() {
    let case = scenes::facing_splat();
    let frame = reference_image(&case);
    for (x, y, at) in pixels(&frame) {
        // 12 px per unit, radius 1.5, centre a quarter and an eighth of a pixel off.
        let d = DVec3::new(f64::from(x) + 0.5 - 24.25, f64::from(y) + 0.5 - 24.125, 0.0) / 18.0;
        let rho_squared = d.length_squared();
        let want = if rho_squared <= 1.0 { (-2.0 * rho_squared).exp() } else { 0.0 };
        assert!((f64::from(frame.weight()[at]) - want).abs() < F32, "{x},{y}: {} {want}", frame.weight()[at]);
        if want > 0.0 {
            assert_eq!((frame.depth()[at], frame.normal()[at]), (2.0, [0.0, 0.0, 1.0]));
        }
    }
}

#[test]
fn mapping_of_a_tilted_disk_is_the_rays_own_hit() {
    let case = scenes::tilted_splat();
    let frame = reference_image(&case);
    let Geometry::Splats(cloud) = &case.scene.objects[0].geometry else { panic!("splats") };
    let ((s, t), p) = (cloud.axes(0), cloud.center(0));
    let mut hits = 0;
    for (x, y, at) in pixels(&frame) {
        let d = ray(&case.camera, x, y);
        // Solves eye + z·d = p + u·s + v·t for (z, u, v).
        let solved = DMat3::from_cols(d, -s, -t).inverse() * (p - DVec3::from(case.camera.eye));
        let rho_squared = solved.y * solved.y + solved.z * solved.z;
        if (rho_squared - 1.0).abs() < 1e-9 {
            continue;
        }
        if rho_squared > 1.0 {
            assert_eq!((frame.weight()[at], frame.depth()[at]), (0.0, f32::INFINITY));
            continue;
        }
        hits += 1;
        assert!((f64::from(frame.depth()[at]) - solved.x).abs() < F32 * solved.x);
        assert!((f64::from(frame.weight()[at]) - (-2.0 * rho_squared).exp()).abs() < F32);
    }
    assert!(hits > 500, "{hits}");
}

#[test]
fn filters_of_a_small_facing_disk_have_their_closed_forms() {
    let (h, l) = (FRAC_1_SQRT_2, 0.3);
    // 12 px per unit, centre 0.2 px right of and 0.1 px below the centre of pixel (24, 24).
    let splat = Splat::disk(DVec3::new(0.7 / 12.0, -0.6 / 12.0, 0.0), DVec3::Z, l / 12.0, [1.0; 3]);
    let case = Case::new("small", scene(&[splat]), camera(2.0, 90.0, [48, 48]));
    let squared = 0.2f64 * 0.2 + 0.1 * 0.1;
    let widened = l * l + h * h;
    let wanted = [
        (Filter::None, (-2.0 * squared / (l * l)).exp()),
        (Filter::Clamp, (-2.0 * squared / (h * h)).exp()),
        (Filter::Adjust, (-2.0 * squared / (h * h)).exp()),
        (Filter::Principal, (l / h).powi(2) * (-2.0 * squared / (h * h)).exp()),
        (Filter::Ewa, l * l / widened * (-2.0 * squared / widened).exp()),
    ];
    for (filter, want) in wanted {
        let frame = reference_image(&case.with(filter.name(), |s| s.filter = filter));
        let got = f64::from(frame.weight()[24 * 48 + 24]);
        assert!((got - want).abs() < F32, "{filter:?}: {got} {want}");
    }
}

#[test]
fn phong_of_a_facing_plane_is_ambient_diffuse_and_specular() {
    let case = scenes::facing_plane();
    let frame = reference_image(&case);
    let albedo = DVec3::new(0.5, 0.25, 1.0);
    let (ambient, light) = (DVec3::new(0.1, 0.2, 0.3), DVec3::new(0.9, 0.8, 0.7));
    let to_light = DVec3::new(0.3, 0.2, 1.0).normalize();
    let (mut brightest, mut darkest) = (0.0f64, f64::INFINITY);
    for (x, y, at) in pixels(&frame) {
        let d = ray(&case.camera, x, y);
        let cosine = to_light.z;
        let reflected = DVec3::new(-to_light.x, -to_light.y, to_light.z);
        let gloss = 0.5 * reflected.dot(-d.normalize()).max(0.0).powf(6.0);
        let want = albedo * (ambient * 0.7 + light * (0.6 * cosine)) + light * gloss;
        let [r, g, b, a] = frame.color()[at].map(f64::from);
        // Depth is 3 up to a few 1e-16; colours are f32.
        assert!((DVec3::new(r, g, b) - want).abs().max_element() < F32 && a == 1.0, "{x},{y}: {want}");
        (brightest, darkest) = (brightest.max(gloss), darkest.min(gloss));
    }
    assert!(brightest > 2.0 * darkest, "the highlight must vary for the test to say anything");
}

#[test]
fn spot_light_fades_between_its_half_angles() {
    let case = scenes::spot_light();
    let frame = reference_image(&case);
    let Some([Light::Spot { position, color, .. }]) = case.scene.lights.as_deref() else { panic!("one spot") };
    let (position, color) = (DVec3::from(*position), DVec3::from(*color));
    let mut seen = [0; 3];
    for (x, y, at) in pixels(&frame) {
        let hit = DVec3::from(case.camera.eye) + ray(&case.camera, x, y) * 3.0;
        let to_light = (position - hit).normalize();
        let angle = to_light.z.acos().to_degrees();
        let share = ((26.0 - angle) / 14.0).clamp(0.0, 1.0);
        let fade = share * share * (3.0 - 2.0 * share);
        seen[if fade == 0.0 {
            0
        } else if fade == 1.0 {
            2
        } else {
            1
        }] += 1;
        let want = DVec3::new(0.5, 0.25, 1.0) * color * (to_light.z * fade);
        let [r, g, b, _] = frame.color()[at].map(f64::from);
        assert!((DVec3::new(r, g, b) - want).abs().max_element() < F32, "{x},{y}: {want}");
    }
    assert!(seen.iter().all(|n| *n > 40), "{seen:?}");
}

#[test]
fn depth_shader_is_z_near_over_z() {
    let case = scenes::closed_sphere().with("depth", |s| s.shader = Shader::Depth);
    let frame = reference_image(&case);
    for (.., at) in pixels(&frame).filter(|p| frame.depth()[p.2].is_finite()) {
        let want = case.camera.near / f64::from(frame.depth()[at]);
        assert!((f64::from(frame.color()[at][0]) - want).abs() < F32 * want);
    }
}

#[test]
fn normals_of_a_mirrored_ellipsoid_go_by_the_inverse_transpose() {
    let case = scenes::mirrored_object();
    let frame = reference_image(&case);
    let world_from_object = case.scene.objects[0].world_from_object;
    let (mut worst, mut count) = (1.0f64, 0);
    for (x, y, at) in pixels(&frame).filter(|p| frame.depth()[p.2].is_finite()) {
        let hit = DVec3::from(case.camera.eye) + ray(&case.camera, x, y) * f64::from(frame.depth()[at]);
        let on_sphere = world_from_object.inverse().transform_point3(hit);
        let want = (world_from_object.matrix3.inverse().transpose() * on_sphere).normalize();
        let [nx, ny, nz] = frame.normal()[at].map(f64::from);
        let facing = want.dot((DVec3::from(case.camera.eye) - hit).normalize());
        if facing > 0.3 {
            (worst, count) = (worst.min(want.dot(DVec3::new(nx, ny, nz))), count + 1);
        }
    }
    // Averages of normals over splats 0.14 of the sphere's radius wide: a few degrees.
    assert!(worst > 0.99 && count > 400, "{worst} {count}");
}

#[test]
fn edge_pixel_without_filtered_fragments_shows_what_lies_behind() {
    let case = scenes::beyond_its_filter();
    let (frame, whole) =
        (reference_image(&case), reference_image(&case.with("no filter", |s| s.filter = Filter::None)));
    // The disk covers these pixels by its exact ellipse, but its filtered footprint doesn't: they are empty, and the
    // blue wall shows.
    let empty = |&(_, _, i): &(u32, u32, usize)| frame.weight()[i] == 0.0 && whole.depth()[i] < 5.0;
    let blue = pixels(&frame).filter(empty).filter(|&(_, _, i)| frame.color()[i] == [0.1, 0.2, 0.9, 1.0]).count();
    assert!(blue > 20, "{blue}");
    assert!(pixels(&frame).filter(empty).all(|(_, _, i)| frame.depth()[i] == f32::INFINITY));
}

#[test]
fn rims_of_an_oriented_ball_are_lit_as_its_front_goes_on() {
    // Lit from the left and below, so that a normal on the other side of the surface shows.
    let case = |oriented| {
        let mut case = scenes::closed_sphere().with("lit", |s| s.shader = Shader::Phong);
        let direction = [0.8, 0.6, -0.1];
        case.scene.lights = Some(vec![Light::Directional { direction, color: [1.0; 3], shadow: false }]);
        case.scene.objects[0].material.oriented = Some(oriented);
        case
    };
    // Degrees from each pixel's normal to the ball's, at the ball's nearest point to the ray.
    let worst = |case: Case| {
        let frame = reference_image(&case);
        let eye = DVec3::from(case.camera.eye);
        let off = |(x, y, at): (u32, u32, usize)| {
            let direction = ray(&case.camera, x, y).normalize();
            let closest = eye - direction * eye.dot(direction);
            let inside = (1.0 - closest.length_squared()).max(0.0).sqrt();
            let outward = (closest - direction * inside).normalize();
            (frame.weight()[at] > 0.0).then(|| outward.angle_between(DVec3::from(frame.normal()[at].map(f64::from))))
        };
        pixels(&frame).filter_map(off).fold(0.0, f64::max).to_degrees()
    };
    let [oriented, undeclared] = [true, false].map(|oriented| worst(case(oriented)));
    println!("{oriented} {undeclared}");
    assert!(oriented < 20.0 && undeclared > 90.0, "{oriented} {undeclared}");
}

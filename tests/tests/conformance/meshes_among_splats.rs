//! Tests of polygons among splats: closed forms, watertightness, the transition.

use crate::drawing::{F32, reference_image};
use glam::DVec3;
use surfel_conformance::build::{Splat, camera, object, ray, scene};
use surfel_conformance::polygons::{mesh_object, mesh_sphere, quad};
use surfel_conformance::scenes::{self, Case};
use surfel_model::{EdgeAa, Filter, Geometry, Shader, Transparency};
use surfel_render::Frame;

#[test]
fn mesh_interpolation_is_the_rays_own_hit() {
    // Albedo is the vertex's world position: interpolated in perspective it is that of the point hit.
    let [across, along] = [DVec3::new(0.9, 0.1, 0.7), DVec3::new(0.0, 0.8, -0.3)];
    let mut mesh = quad(DVec3::ZERO, [across, along], 1.0);
    mesh.colors = Some((0..4).map(|i| (mesh.positions.get(i) + 2.0).as_vec3().to_array()).collect());
    let mut scene = scene(&[]);
    scene.objects = vec![mesh_object(mesh)];
    let case = Case::new("position", scene, camera(3.0, 45.0, [64, 64]));
    let frame = reference_image(&case);
    let (eye, normal) = (DVec3::from(case.camera.eye), across.cross(along));
    let mut hits = 0;
    for at in 0..64 * 64u32 {
        let direction = ray(&case.camera, at % 64, at / 64);
        let z = -eye.dot(normal) / direction.dot(normal);
        let point = eye + direction * z;
        let (a, b) = (coordinate(point, across, along), coordinate(point, along, across));
        let inside = a.abs() < 1.0 - 1e-6 && b.abs() < 1.0 - 1e-6;
        let outside = a.abs() > 1.0 + 1e-6 || b.abs() > 1.0 + 1e-6;
        let at = at as usize;
        if inside {
            assert!((f64::from(frame.depth()[at]) - z).abs() < F32 * z, "{z}");
            for (got, want) in frame.color()[at].iter().zip((point + 2.0).to_array()) {
                // The vertices' colours are f32 themselves.
                assert!((f64::from(*got) - want).abs() < 3.0 * F32, "{got} {want}");
            }
            hits += 1;
        } else if outside {
            assert_eq!(frame.depth()[at], f32::INFINITY);
        }
    }
    assert!(hits > 600, "{hits}");
}

/// Returns the coordinate u of a point u·a + v·b.
fn coordinate(point: DVec3, a: DVec3, b: DVec3) -> f64 {
    let n = a.cross(b);
    point.cross(b).dot(n) / n.length_squared()
}

/// With its back culled, a closed ball covers each inner pixel with one polygon, and no pixel beside the ball.
#[test]
fn mesh_ball_is_watertight() {
    for (times, z) in [(2, 3.0), (5, 3.0), (4, 1.05)] {
        let mut scene = scene(&[]);
        let mut ball = mesh_object(mesh_sphere(times));
        ball.material.cull = surfel_model::Cull::Back;
        scene.objects = vec![ball];
        let case = Case::new("ball", scene, camera(z, 45.0, [96, 96]));
        let frame = reference_image(&case);
        let mut inside = 0;
        for at in 0..96 * 96u32 {
            let direction = ray(&case.camera, at % 96, at / 96).normalize();
            let distance = DVec3::from(case.camera.eye).cross(direction).length();
            // Flat faces are inside the sphere: a face of an octahedron divided k times sags by less than 0.9·4⁻ᵏ.
            let least = 1.0 - 0.9 * 0.25f64.powi(times as i32);
            if distance < least {
                assert!(frame.depth()[at as usize].is_finite(), "a hole in the ball at {at}, {distance}");
                inside += 1;
            } else if distance > 1.0 {
                assert!(frame.depth()[at as usize].is_infinite(), "a spill at {at}, {distance}");
            }
        }
        assert!(inside > 3000, "{inside}");
    }
}

#[test]
fn mesh_normals_are_smooth_or_flat_and_turned_to_the_eye() {
    let mut ball = mesh_object(mesh_sphere(4));
    let mut scene = scene(&[]);
    scene.objects = vec![ball.clone()];
    let case = Case::new("normals", scene.clone(), camera(3.0, 40.0, [48, 48]));
    let frame = reference_image(&case);
    for at in (0..48 * 48u32).filter(|at| frame.depth()[*at as usize].is_finite()) {
        let z = f64::from(frame.depth()[at as usize]);
        let point = DVec3::from(case.camera.eye) + ray(&case.camera, at % 48, at / 48) * z;
        let normal = DVec3::from(frame.normal()[at as usize].map(f64::from));
        // On a sphere the normal is the position; interpolation has an error of the square of the faces' angle, 0.1².
        assert!((normal - point.normalize()).length() < 0.01, "{normal} {point}");
    }
    // Inside out: the image is the same, with the triangles and normals of the far side turned to the eye.
    let Geometry::Mesh(mesh) = &mut ball.geometry else { unreachable!() };
    let mesh = std::sync::Arc::make_mut(mesh);
    mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    mesh.normals.iter_mut().flatten().for_each(|n| *n = n.map(|c| -c));
    scene.objects = vec![ball];
    let inverted = reference_image(&Case::new("inverted", scene, case.camera.clone()));
    assert_eq!(inverted.normal(), frame.normal());
}

fn disk_and_quad(disk_z: f64, quad_z: f64, interior_weight: f64) -> Case {
    let mut scene = scene(&[Splat::disk(DVec3::Z * disk_z, DVec3::Z, 0.5, [0.8, 0.1, 0.2])]);
    scene.objects[0].material.interior_weight = Some(interior_weight);
    let mut wall = quad(DVec3::Z * quad_z, [DVec3::X, DVec3::Y], 1.0);
    wall.colors = Some(vec![[0.1, 0.5, 0.9]; 4]);
    scene.objects.push(mesh_object(wall));
    let mut case = Case::new("disk-quad", scene, camera(2.0, 60.0, [33, 33]));
    case.settings.filter = Filter::None;
    case.settings.depth_tolerance = surfel_model::DepthTolerance::Absolute(0.1);
    case
}

const MIDDLE: usize = 16 * 33 + 16;
const DISK: [f64; 3] = [0.8, 0.1, 0.2];
const QUAD: [f64; 3] = [0.1, 0.5, 0.9];

fn assert_middle(frame: &Frame, share: f64, depths: [f64; 2]) {
    for c in 0..3 {
        let want = share * DISK[c] + (1.0 - share) * QUAD[c];
        assert!((f64::from(frame.color()[MIDDLE][c]) - want).abs() < F32, "{:?} {share}", frame.color()[MIDDLE]);
    }
    let want = share * depths[0] + (1.0 - share) * depths[1];
    assert!((f64::from(frame.depth()[MIDDLE]) - want).abs() < F32 * want, "{} {want}", frame.depth()[MIDDLE]);
}

#[test]
fn mesh_and_splat_blend_by_coverage_within_the_tolerance() {
    // The disk's centre has w = 1, q = 1/W0; ε = 0.1 (facing: no slope). The polygon's distance from the disk is less.
    for (disk, quad) in [(0.0, 0.05), (0.05, 0.0), (0.0, 0.0)] {
        let depths = [2.0 - disk, 2.0 - quad];
        assert_middle(&reference_image(&disk_and_quad(disk, quad, 4.0)), 0.25 / 0.633, depths);
        assert_middle(&reference_image(&disk_and_quad(disk, quad, 1.2)), 1.0, depths);
    }
    // At a distance above ε only the nearer surface shows, however thin the coverage.
    assert_middle(&reference_image(&disk_and_quad(0.15, 0.0, 4.0)), 1.0, [1.85, 2.0]);
    assert_middle(&reference_image(&disk_and_quad(0.0, 0.15, 4.0)), 0.0, [2.0, 1.85]);
}

/// Returns the largest step of a channel between neighbouring columns. Only the middle third of the rows and the middle
/// half of the columns count.
fn largest_step(frame: &Frame) -> f64 {
    let width = frame.width();
    let pixel = |x: u32, y: u32| frame.color()[(y * width + x) as usize];
    let step = |x: u32, y: u32| {
        let (a, b) = (pixel(x, y), pixel(x + 1, y));
        (0..3).map(|c| f64::from(a[c] - b[c]).abs()).fold(0.0, f64::max)
    };
    let rows = frame.height() / 3..2 * frame.height() / 3;
    rows.flat_map(|y| (width / 4..3 * width / 4).map(move |x| step(x, y))).fold(0.0, f64::max)
}

/// G06 figure 5: splats end on a polygon that they overlap. Blending makes the steps across the seam smaller.
#[test]
fn mesh_hand_over_smooths_the_seam() {
    let smoothed = scenes::half_mesh_wall();
    let mut naive = smoothed.clone();
    // So low that every splat covers the polygon fully up to its rim.
    naive.scene.objects[0].material.interior_weight = Some(1e-6);
    let step = |case: &Case| largest_step(&reference_image(&case.with("unlit", |s| s.shader = Shader::Unlit)));
    let (rough, smooth) = (step(&naive), step(&smoothed));
    println!("largest step across the seam: {rough} naive, {smooth} smoothed");
    // In the naive image the whole difference of colours is at a splat's rim. In the smoothed image it is spread over
    // the 3 px by which splats reach over the polygon's edge: a third per pixel, and a rim's own weight (two splats at
    // e⁻² of 3.05, over 0.633: 0.14).
    assert!(rough > 0.4 && smooth < 0.5 * rough, "{smooth} {rough}");
}

/// Splats that end on a polygon make no edge there, and no line through which the background shows.
#[test]
fn mesh_that_goes_on_where_splats_end_makes_no_edge() {
    let case = scenes::half_mesh_wall();
    let [plain, smooth] =
        [EdgeAa::Off, EdgeAa::Coverage].map(|edge_aa| reference_image(&case.with("edges", |s| s.edge_aa = edge_aa)));
    let (w, h) = (plain.width() as usize, plain.height() as usize);
    let there = |at: usize| plain.depth()[at].is_finite();
    let (mut inside, mut rim) = (0, 0);
    for (x, y) in (1..h - 1).flat_map(|y| (1..w - 1).map(move |x| (x, y))) {
        let same = plain.color()[y * w + x] == smooth.color()[y * w + x];
        if (y - 1..=y + 1).all(|j| (x - 1..=x + 1).all(|i| there(j * w + i))) {
            assert!(same, "{x},{y}: {:?} {:?}", plain.color()[y * w + x], smooth.color()[y * w + x]);
            inside += 1;
        } else {
            rim += usize::from(!same);
        }
    }
    // 2 by 1.8 units at 30 px per unit.
    assert!(inside > 2500 && rim > 50, "{inside} {rim}");
}

#[test]
fn mesh_hides_and_is_hidden_by_transparent_splats() {
    let mut case = disk_and_quad(0.5, 0.0, 1.0);
    let Geometry::Splats(cloud) = &case.scene.objects[0].geometry else { unreachable!() };
    let glass = surfel_conformance::build::with_alpha((**cloud).clone(), |_| 0.4);
    case.scene.objects[0] = object(glass.clone());
    case.scene.objects[0].material.interior_weight = Some(1.0);
    case.settings.transparency = Transparency::Peel { layers: 2, drop_last: false };
    let frame = reference_image(&case);
    for c in 0..3 {
        let want = f64::from(0.4f32) * DISK[c] + (1.0 - f64::from(0.4f32)) * QUAD[c];
        assert!((f64::from(frame.color()[MIDDLE][c]) - want).abs() < F32);
    }
    assert_eq!(frame.depth()[MIDDLE], 1.5);
    case.scene.objects[0].world_from_object = glam::DAffine3::from_translation(DVec3::Z * -1.0);
    assert_middle(&reference_image(&case), 0.0, [1.5, 2.0]);
}

/// Far away a chequered floor is its mean; nearby it is black and white.
#[test]
fn mesh_texture_is_filtered_where_it_is_small() {
    let case = scenes::textured_floor();
    let frame = reference_image(&case);
    let row = |y: usize| (8..56).map(move |x| y * 64 + x);
    // The horizon is at row 24; the floor begins 20 units ahead.
    let far: Vec<f32> = row(26).filter(|at| frame.depth()[*at].is_finite()).map(|at| frame.color()[at][0]).collect();
    assert!(far.len() > 40 && far.iter().all(|c| (c - 0.5).abs() < 0.02), "{far:?}");
    let near: Vec<f32> = (34..47).flat_map(row).map(|at| frame.color()[at][0]).collect();
    assert!(near.iter().any(|c| *c < 0.05) && near.iter().any(|c| *c > 0.95), "{near:?}");
    // z_near is 0.5: the floor 0.3 below the eye is visible from there on, never nearer.
    let nearest = frame.depth().iter().copied().fold(f32::INFINITY, f32::min);
    assert!((0.5..0.55).contains(&nearest), "{nearest}");
}

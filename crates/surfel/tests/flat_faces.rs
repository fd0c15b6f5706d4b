//! Meshes of few large faces are drawn without holes by default, at any image size.

use std::collections::BTreeSet;
use std::fmt::Write;
use surfel_backend::Backend;
use surfel_model::glam::{DVec2, DVec3};
use surfel_model::{Camera, Projection};

const SIZES: [[u32; 2]; 5] = [[256, 256], [640, 480], [800, 800], [1024, 1024], [1920, 1080]];
/// Width of the rim along the outline, in pixels, in which the background may show.
const RIM_PX: f64 = 3.0;

/// Returns the corners of a regular polygon with `n` corners about the y axis, at the height `y` and with the radius
/// `r`.
fn ring(n: usize, y: f64, r: f64) -> impl Iterator<Item = DVec3> {
    (0..n).map(move |i| {
        let (sin, cos) = (std::f64::consts::TAU * i as f64 / n as f64).sin_cos();
        DVec3::new(r * cos, y, r * sin)
    })
}

/// Returns the corners of convex solids, by name.
fn solids() -> Vec<(&'static str, Vec<DVec3>)> {
    let signs = |n: usize| (0..1 << n).map(|i| [0, 1, 2].map(|k| if i >> k & 1 == 1 { -1.0 } else { 1.0 }));
    let turned = |p: DVec3| [p, DVec3::new(p.y, p.z, p.x), DVec3::new(p.z, p.x, p.y)];
    let golden = 0.5 * (1.0 + 5.0_f64.sqrt());
    let cube: Vec<DVec3> = signs(3).map(DVec3::from).collect();
    let octahedron = [DVec3::X, DVec3::Y, DVec3::Z].iter().flat_map(|p| [*p, -*p]).collect();
    let icosahedron = signs(2).flat_map(|[a, b, _]| turned(DVec3::new(0.0, a, golden * b))).collect();
    let pentagons = signs(2).flat_map(|[a, b, _]| turned(DVec3::new(0.0, a / golden, golden * b)));
    vec![
        ("tetrahedron", cube.iter().filter(|p| p.x * p.y * p.z > 0.0).copied().collect()),
        ("cube", cube.iter().map(|p| 0.5 * (*p + 1.0)).collect()),
        ("octahedron", octahedron),
        ("dodecahedron", cube.iter().copied().chain(pentagons).collect()),
        ("icosahedron", icosahedron),
        ("prism", ring(3, -1.0, 1.0).chain(ring(3, 1.5, 1.0)).collect()),
        ("pyramid", ring(4, 0.0, 1.0).chain([1.2 * DVec3::Y]).collect()),
        ("frustum", ring(8, 0.0, 1.0).chain(ring(8, 1.0, 0.4)).collect()),
        ("slab", cube.iter().map(|p| *p * DVec3::new(5.0, 4.0, 0.3)).collect()),
    ]
}

/// Returns the faces of the convex hull of points as an OBJ file of triangles.
fn obj(corners: &[DVec3]) -> String {
    let mut text = String::new();
    corners.iter().for_each(|p| writeln!(text, "v {} {} {}", p.x, p.y, p.z).unwrap());
    let mut known = BTreeSet::new();
    let count = corners.len();
    for (i, j, k) in (0..count).flat_map(|i| (0..count).flat_map(move |j| (0..count).map(move |k| (i, j, k)))) {
        let normal = (corners[j] - corners[i]).cross(corners[k] - corners[i]).normalize_or_zero();
        let height = |p: &DVec3| (*p - corners[i]).dot(normal);
        if normal == DVec3::ZERO || corners.iter().any(|p| height(p) > 1e-9) {
            continue;
        }
        let mut face: Vec<usize> = (0..count).filter(|l| height(&corners[*l]) > -1e-9).collect();
        if !known.insert(face.clone()) {
            continue;
        }
        let middle = face.iter().map(|l| corners[*l]).sum::<DVec3>() / face.len() as f64;
        let (u, v) = normal.any_orthonormal_pair();
        let v = if u.cross(v).dot(normal) > 0.0 { v } else { -v };
        let angle = |l: &usize| (corners[*l] - middle).dot(v).atan2((corners[*l] - middle).dot(u));
        face.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
        face.windows(2).skip(1).for_each(|w| writeln!(text, "f {} {} {}", face[0] + 1, w[0] + 1, w[1] + 1).unwrap());
    }
    text
}

/// Projects a point to pixels.
fn pixel(camera: &Camera, p: DVec3) -> DVec2 {
    let Projection::Perspective { fov_y_deg } = camera.projection else { panic!("a perspective camera") };
    let [eye, target, up] = [camera.eye, camera.target, camera.up].map(DVec3::from);
    let forward = (target - eye).normalize();
    let right = forward.cross(up).normalize();
    let [w, h] = camera.size.map(f64::from);
    let focal = 0.5 * h / (0.5 * fov_y_deg.to_radians()).tan();
    let q = p - eye;
    let at = DVec2::new(q.dot(right), -q.dot(right.cross(forward))) * (focal / q.dot(forward));
    at + DVec2::new(0.5 * w, 0.5 * h)
}

/// Checks that no pixel inside a solid's outline shows the background.
fn check(name: &str, corners: &[DVec3], sizes: &[[u32; 2]]) {
    let path = std::env::temp_dir().join(format!("surfel-flat-{name}-{}.obj", std::process::id()));
    std::fs::write(&path, obj(corners)).unwrap();
    let opened = surfel_stage::open(&[&path], &surfel_sample::NoProgress);
    std::fs::remove_file(&path).unwrap();
    let mut opened = opened.unwrap();
    opened.scene.background = [0.0; 4];
    let mut backend = Backend::auto().unwrap();
    let resident = backend.upload(&opened.scene).unwrap();
    for size in sizes {
        opened.file.camera.size = *size;
        let camera = &opened.file.camera;
        let frame = backend.render(&resident, camera, &opened.file.settings).unwrap();
        let seen: Vec<DVec2> = corners.iter().map(|p| pixel(camera, *p)).collect();
        // The outline consists of the lines through two corners that have all others on one side.
        let pairs = seen.iter().flat_map(|a| seen.iter().map(move |b| (*a, (*b - *a).normalize_or_zero())));
        let is_outline =
            |(a, d): &(DVec2, DVec2)| *d != DVec2::ZERO && seen.iter().all(|c| d.perp_dot(*c - *a) > -1e-6);
        let outline: Vec<_> = pairs.filter(is_outline).collect();
        assert!(outline.len() >= 3);
        let (mut inside, mut holes) = (0, Vec::new());
        for (i, color) in frame.color().iter().enumerate() {
            let (x, y) = (i % size[0] as usize, i / size[0] as usize);
            let p = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
            if outline.iter().all(|(a, d)| d.perp_dot(p - *a) > RIM_PX) {
                inside += 1;
                if color[3] < 254.5 / 255.0 {
                    holes.push((x, y, color[3]));
                }
            }
        }
        assert!(inside > (size[0] * size[1] / 16) as usize, "{name} {size:?}: {inside} pixels");
        assert!(
            holes.is_empty(),
            "{name} {size:?}: {} pixels, such as {:?}",
            holes.len(),
            &holes[..holes.len().min(5)]
        );
    }
}

#[test]
fn a_cube_has_no_pinholes() {
    // At these sizes the cube once had holes, from candidates that coincide along the diagonals.
    let (name, corners) = solids().swap_remove(1);
    check(name, &corners, &[SIZES[1], SIZES[3]]);
}

#[test]
fn a_column_of_long_facets_has_no_pinholes() {
    // Some facets, 80 times as long as wide, once had a fifth fewer splats than the others.
    let corners: Vec<DVec3> = ring(64, 0.0, 1.0).chain(ring(64, 8.0, 1.0)).collect();
    check("column", &corners, &[[1024, 1024]]);
}

#[test]
fn nine_solids_have_no_pinholes_at_three_sizes() {
    for (name, corners) in solids() {
        check(name, &corners, &SIZES[..3]);
    }
}

#[test]
#[ignore = "25 s: cargo xtask test --full"]
fn nine_solids_have_no_pinholes_at_large_sizes() {
    for (name, corners) in solids() {
        check(name, &corners, &SIZES[3..]);
    }
}

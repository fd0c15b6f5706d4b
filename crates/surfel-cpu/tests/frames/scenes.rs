//! Scenes of all kinds of geometry.

use crate::xorshift::Xorshift;
use glam::{DAffine3, DVec3, Vec3};
use std::sync::Arc;
use surfel_model::{
    Camera, ClipColumns, ClipCurve, ClipLine, ClipMode, CloudData, Column3, Geometry, Light, Material, Mesh, NO_LINE,
    Object, OnInvalid, Projection, Scene, Shape, SplatCloud, Texture,
};
use surfel_render::View;

/// Number of splats along the side of a wall.
const SIDE: usize = 60;

fn object(geometry: Geometry) -> Object {
    let material = Material { interior_weight: Some(1.5), ..Material::default() };
    Object { geometry, world_from_object: DAffine3::IDENTITY, material }
}

fn cloud(centers: Vec<Vec3>, normals: Vec<Vec3>, radii: Vec<f32>, alpha: f32) -> Object {
    let count = centers.len();
    let colors = centers.iter().map(|p| (0.5 + 0.2 * p.map(f32::sin)).to_array()).collect();
    let shape = Shape::Disks { normals: Column3::from_f32(normals), radii };
    let data = CloudData {
        colors: Some(colors),
        alphas: (alpha < 1.0).then(|| vec![alpha; count]),
        ..CloudData::new(DVec3::ZERO, Column3::from_f32(centers), shape)
    };
    object(Geometry::Splats(Arc::new(SplatCloud::new(data, OnInvalid::Refuse).unwrap().0)))
}

/// Returns a wall of disks across the view, tilted by `slope`, with or without a hole in its middle.
fn wall(z: f32, slope: f32, alpha: f32, hole: bool) -> Object {
    let at = |i: usize| 4.0 * ((i as f32 + 0.5) / SIDE as f32 - 0.5);
    let places = (0..SIDE * SIDE).map(|i| (at(i % SIDE), at(i / SIDE)));
    let centers: Vec<Vec3> =
        places.filter(|(x, y)| !hole || x.hypot(*y) > 0.4).map(|(x, y)| Vec3::new(x, y, slope.mul_add(x, z))).collect();
    let count = centers.len();
    cloud(centers, vec![Vec3::new(-slope, 0.0, 1.0).normalize(); count], vec![0.08; count], alpha)
}

/// Returns walls behind each other, the first with a hole, some tilted. The last two are transparent, one in front of
/// all others.
pub(crate) fn walls() -> Scene {
    let objects = vec![
        wall(0.0, 0.0, 1.0, true),
        wall(-1.0, 0.2, 1.0, false),
        wall(-3.0, -0.3, 1.0, false),
        wall(-5.0, 0.0, 1.0, false),
        wall(-7.0, 0.0, 0.5, false),
        wall(0.2, 0.1, 0.5, false),
    ];
    Scene { objects, ..Scene::default() }
}

/// Returns a wall of disks, transparent disks in front of it, and a textured mesh that intersects both, lit by a sun
/// that casts shadows.
pub(crate) fn everything() -> Scene {
    let side = 40;
    let at = |i: usize| Vec3::new((i % side) as f32, (i / side) as f32, 0.0) * 0.05 - 1.0;
    let bent = |p: Vec3| p + Vec3::Z * (1.0 + 0.5 * (3.0 * p.x).sin());
    let vertices: Vec<Vec3> = (0..side * side).map(at).map(bent).collect();
    let quads = (0..side * (side - 1)).filter(|i| i % side != side - 1);
    let mesh = Mesh {
        triangles: quads
            .flat_map(|i| [[i, i + 1, i + side], [i + side, i + 1, i + side + 1]])
            .map(|t| t.map(|i| i as u32))
            .collect(),
        uvs: Some(vertices.iter().map(|c| [c.x, c.y]).collect()),
        positions: Column3::from_f32(vertices),
        texture: Some(Arc::new(Texture {
            width: 2,
            height: 2,
            srgba8: [[200, 100, 50, 255], [20, 90, 200, 255]].repeat(2),
        })),
        ..Mesh::default()
    };
    let sun = Light::Directional { direction: [0.2, -0.3, -1.0], color: [1.0; 3], shadow: true };
    let objects = vec![wall(-0.2, 0.3, 1.0, true), wall(0.5, 0.0, 0.4, false), object(Geometry::Mesh(Arc::new(mesh)))];
    Scene { objects, lights: Some(vec![sun]), ..Scene::default() }
}

/// Returns unordered small disks, some steep, every fiftieth ten times as large. Most are tiny splats.
pub(crate) fn specks(radius: f32) -> Scene {
    let mut numbers = Xorshift::new();
    let mut random = move || 2.0 * numbers.share() as f32 - 1.0;
    let (mut centers, mut normals, mut radii) = (Vec::new(), Vec::new(), Vec::new());
    for i in 0..3000u16 {
        let direction = Vec3::new(random(), random(), random() + 1e-3).normalize();
        centers.push(direction * if i % 2 == 0 { 1.0 } else { 0.9 });
        normals.push(direction);
        let scale = if i % 50 == 7 { 10.0 } else { 1.0 };
        radii.push(radius * scale * (1.0 + 0.5 * random()));
    }
    Scene { objects: vec![cloud(centers, normals, radii, 1.0)], ..Scene::default() }
}

/// Returns unordered ellipses of every shape, from needles to disks, some edge-on and some as large as half the view.
/// With `clips`, most have lines, a curve, or both.
pub(crate) fn ellipses(clips: bool) -> Scene {
    const COUNT: usize = 600;
    let mut numbers = Xorshift::new();
    let mut random = move || 2.0 * numbers.share() as f32 - 1.0;
    let [mut centers, mut s, mut t] = [const { Vec::new() }; 3];
    let (mut lines, mut curves, mut modes) = (Vec::new(), Vec::new(), Vec::new());
    for i in 0..COUNT {
        let n = Vec3::new(random(), random(), if i % 7 == 0 { 0.01 } else { 1.1 + random() }).normalize();
        let (first, second) = n.any_orthonormal_pair();
        let long = if i % 40 == 3 { 1.0 } else { 0.1 * (1.2 + random()) };
        centers.push(Vec3::new(1.5 * random(), 1.5 * random(), random()));
        s.push(first * long);
        t.push(second * long * [0.02, 0.3, 1.0][i % 3]);
        let mut line = |there: bool| match there {
            true => ClipLine { a: random(), b: random(), c: 0.3 },
            false => NO_LINE,
        };
        lines.push([line(i % 2 == 0), line(i % 6 == 0), line(i % 12 == 0), line(i % 24 == 0)]);
        let (u, v) = (random(), random());
        let w = if i % 5 < 2 { 0.6 + 0.5 * random() } else { f32::NAN };
        curves.push(ClipCurve { theta1: 3.0 * random(), theta3: 3.0 * random(), u, v, w });
        modes.push(if i % 4 == 0 { ClipMode::Or } else { ClipMode::And });
    }
    let clips = clips.then_some(ClipColumns { lines: Some(lines), curves: Some(curves), modes: Some(modes) });
    let [centers, s, t] = [centers, s, t].map(Column3::from_f32);
    let data = CloudData { clips, ..CloudData::new(DVec3::ZERO, centers, Shape::Ellipses { s, t }) };
    let cloud = SplatCloud::new(data, OnInvalid::Refuse).unwrap().0;
    Scene { objects: vec![object(Geometry::Splats(Arc::new(cloud)))], ..Scene::default() }
}

/// Returns transparent disks of a few pixels each around opaque ones.
pub(crate) fn haze() -> Scene {
    let mut numbers = Xorshift::new();
    let mut random = move || 2.0 * numbers.share() as f32 - 1.0;
    let mut speck = |_| Vec3::new(1.2 * random(), 1.2 * random(), 0.8 * random());
    let centers: Vec<Vec3> = (0..1500).map(&mut speck).collect();
    let normals = centers.iter().map(|c| (*c + Vec3::Z * 1.5).normalize()).collect();
    let haze = cloud(centers, normals, vec![0.05; 1500], 0.4);
    let mut scene = specks(0.05);
    scene.objects.push(haze);
    scene
}

pub(crate) fn view(size: [u32; 2], near: f64) -> View {
    let projection = Projection::Perspective { fov_y_deg: 45.0 };
    let (eye, up) = ([0.1, 0.2, 4.0], [0.0, 1.0, 0.0]);
    View::new(&Camera { eye, target: [0.0; 3], up, projection, near, far: None, size }).unwrap()
}

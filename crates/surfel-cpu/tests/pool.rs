//! Test that the renderer uses only its own threads. It is a test binary of its own, since the global pool is shared by
//! all tests of a process.

use glam::{DAffine3, DVec3, Vec3};
use std::sync::Arc;
use surfel_cpu::{Options, Renderer};
use surfel_model::{
    Camera, CloudData, Column3, EdgeAa, Geometry, Light, Material, Mesh, Object, OnInvalid, Projection, Scene,
    Settings, Shader, Shape, SplatCloud, Texture, Transparency,
};
use surfel_render::{Frame, Planes, Renderer as _, View};

const UP: Vec3 = Vec3::new(0.3, 0.5, 0.8);

/// Returns a sheet of disks in several chunks, half of the disks transparent, and textured triangles behind it.
fn scene() -> Scene {
    let side = 40;
    let at = |i: usize| Vec3::new((i % side) as f32, (i / side) as f32, 0.0) * 0.05 - 1.0;
    let centers: Vec<Vec3> = (0..side * side).map(at).collect();
    let shape = Shape::Disks { normals: Column3::from_f32(vec![UP; side * side]), radii: vec![0.05; side * side] };
    let data = CloudData {
        alphas: Some((0..side * side).map(|i| if i % 2 == 0 { 0.5 } else { 1.0 }).collect()),
        interior_weight: Some(2.0),
        ..CloudData::new(DVec3::ZERO, Column3::from_f32(centers.clone()), shape)
    };
    let triangles = (0..side * (side - 1) - 1).map(|i| [i, i + 1, i + side].map(|i| i as u32)).collect();
    let mesh = Mesh {
        positions: Column3::from_f32(centers.iter().map(|c| *c - Vec3::Z).collect()),
        triangles,
        uvs: Some(centers.iter().map(|c| [c.x, c.y]).collect()),
        texture: Some(Arc::new(Texture { width: 4, height: 4, srgba8: vec![[200, 100, 50, 255]; 16] })),
        ..Mesh::default()
    };
    let object = |geometry| Object { geometry, world_from_object: DAffine3::IDENTITY, material: Material::default() };
    let cloud = SplatCloud::new(data, OnInvalid::Refuse).unwrap().0;
    let sun = Light::Directional { direction: [0.2, -0.3, -1.0], color: [1.0; 3], shadow: true };
    let objects = vec![object(Geometry::Splats(Arc::new(cloud))), object(Geometry::Mesh(Arc::new(mesh)))];
    Scene { objects, lights: Some(vec![sun]), ..Scene::default() }
}

/// Stack of the thread that calls the renderer, in bytes: the least that systems give.
const MIN_STACK: usize = 512 << 10;

#[test]
fn a_buffer_is_drawn_for_a_caller_with_little_stack() {
    let drawn = || {
        let mut renderer = Renderer::new(Options::default().with_threads(1)).unwrap();
        let projection = Projection::Perspective { fov_y_deg: 45.0 };
        let (eye, up, size) = ([0.0, 0.0, 4.0], [0.0, 1.0, 0.0], [96, 96]);
        let view = View::new(&Camera { eye, target: [0.0; 3], up, projection, near: 0.1, far: None, size }).unwrap();
        let resident = renderer.upload(&scene()).unwrap();
        let settings = Settings::default()
            .with_shader(Shader::Phong)
            .with_edge_aa(EdgeAa::Coverage)
            .with_transparency(Transparency::ABuffer { layers: 8 });
        let mut frame = Frame::default();
        let planes = Planes::ALL.with_fragments(true);
        renderer.render_into(&resident, &view, &settings, planes, &mut frame).unwrap();
        frame.color().iter().filter(|pixel| pixel[3] > 0.0).count()
    };
    let thread = std::thread::Builder::new().stack_size(MIN_STACK).spawn(drawn).unwrap();
    assert!(thread.join().unwrap() > 1000);
}

#[test]
fn renderer_has_its_own_threads_and_starts_no_others() {
    let mut renderer = Renderer::new(Options::default().with_threads(2)).unwrap();
    let projection = Projection::Perspective { fov_y_deg: 45.0 };
    let (eye, up, size) = ([0.0, 0.0, 4.0], [0.0, 1.0, 0.0], [96, 96]);
    let view = View::new(&Camera { eye, target: [0.0; 3], up, projection, near: 0.1, far: None, size }).unwrap();
    let resident = renderer.upload(&scene()).unwrap();
    let transparency = Transparency::Peel { layers: 2, drop_last: false };
    let settings =
        Settings::default().with_shader(Shader::Toon).with_edge_aa(EdgeAa::Coverage).with_transparency(transparency);
    let mut frame = Frame::default();
    let planes = Planes::ALL.with_fragments(true);
    let stats = renderer.render_into(&resident, &view, &settings, planes, &mut frame).unwrap();
    assert_eq!((stats.threads, renderer.info().threads), (2, 2));
    assert!(stats.fragments > 0);
    // Only the first caller may configure the global pool, so this fails if any code above has started it.
    rayon::ThreadPoolBuilder::new().num_threads(1).build_global().expect("the global pool is the caller's");
}

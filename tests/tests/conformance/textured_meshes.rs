//! Tests of splats of meshes with several materials, against their polygons and against rays that pass through cut or
//! blended surfaces. The scenes are glTF files written by the test; each tests the feature of a Khronos sample model.

use glam::{DVec2, DVec3};
use std::path::Path;
use std::sync::Arc;
use surfel_conformance::build::{axes, object};
use surfel_io::{Content, Format, LoadOptions, PlanesView, PngOptions, load_bytes, write_png};
use surfel_metrics::{CompareOptions, Image, compare};
use surfel_model::{AlphaMode, Camera, Geometry, Mesh, Object, Projection, Scene, Settings, Transparency};
use surfel_render::{Frame, Planes, Preset, Renderer, View};
use surfel_sample::{MeshOptions, NoProgress, splats_from_mesh};

const SIZE: u32 = 256;
/// Maximum FLIP between splats and the surface that they represent.
const MOST: f64 = 0.03;
/// Number of rays per pixel along either axis.
const RAYS: u32 = 4;
const SKY: [f32; 3] = [0.8, 0.85, 0.9];

/// A glTF document under construction: a primitive, a mesh and a node for each quad.
#[derive(Default)]
struct Document {
    data: Vec<u8>,
    views: Vec<String>,
    accessors: Vec<String>,
    meshes: Vec<String>,
    nodes: Vec<String>,
    images: Vec<String>,
    materials: Vec<String>,
}

impl Document {
    fn column(&mut self, values: &[f32], kind: &str, count: usize) -> usize {
        let (start, length) = (self.data.len(), 4 * values.len());
        self.data.extend(values.iter().flat_map(|v| v.to_le_bytes()));
        self.views.push(format!(r#"{{"buffer": 0, "byteOffset": {start}, "byteLength": {length}}}"#));
        let view = self.views.len() - 1;
        let rest = format!(r#""componentType": 5126, "type": "{kind}", "count": {count}"#);
        self.accessors.push(format!(r#"{{"bufferView": {view}, {rest}}}"#));
        self.accessors.len() - 1
    }

    /// Adds a texture of 128² texels; `texel` returns the linear RGB and straight alpha at (u, v). Returns the
    /// texture's index.
    fn texture(&mut self, texel: impl Fn(f32, f32) -> [f32; 4]) -> usize {
        let at = |i: u32| texel((i % 128) as f32 / 128.0, (i / 128) as f32 / 128.0);
        let premultiplied = |[r, g, b, a]: [f32; 4]| [r * a, g * a, b * a, a];
        let color: Vec<[f32; 4]> = (0..128 * 128).map(|i| premultiplied(at(i))).collect();
        let planes = PlanesView { width: 128, height: 128, color: Some(&color), ..PlanesView::default() };
        let mut png = Vec::new();
        write_png(&mut png, &planes, &PngOptions::default()).unwrap();
        self.images.push(format!(r#"{{"uri": "data:image/png,{}"}}"#, hex(&png)));
        self.images.len() - 1
    }

    fn material(&mut self, json: impl Into<String>) -> usize {
        self.materials.push(json.into());
        self.materials.len() - 1
    }

    /// Adds a material with a base-colour texture; `more` is the JSON of further members. Returns the material's index.
    fn textured(&mut self, texture: usize, more: &str) -> usize {
        let pbr = format!(r#"{{"baseColorTexture": {{"index": {texture}}}}}"#);
        self.material(format!(r#"{{"pbrMetallicRoughness": {pbr}{more}}}"#))
    }

    /// Adds a parallelogram from a corner along two edges. `more` has further attributes, as accessors by name; `node`
    /// is the JSON of further members of the node.
    fn quad(&mut self, [corner, e, f]: [DVec3; 3], material: usize, more: &[(&str, usize)], node: &str) {
        let corners = [corner, corner + e, corner + e + f, corner + f];
        let list = [0, 1, 2, 0, 2, 3];
        let positions: Vec<f32> = list.iter().flat_map(|&i| corners[i].as_vec3().to_array()).collect();
        let uvs: Vec<f32> = list.iter().flat_map(|&i| [[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]][i]).collect();
        let position = self.column(&positions, "VEC3", 6);
        let uv = self.column(&uvs, "VEC2", 6);
        let more: String = more.iter().map(|(name, accessor)| format!(r#", "{name}": {accessor}"#)).collect();
        let attributes = format!(r#"{{"POSITION": {position}, "TEXCOORD_0": {uv}{more}}}"#);
        self.meshes.push(format!(r#"{{"primitives": [{{"attributes": {attributes}, "material": {material}}}]}}"#));
        self.nodes.push(format!(r#"{{"mesh": {}{node}}}"#, self.meshes.len() - 1));
    }

    fn load(&self) -> Mesh {
        let textures: Vec<String> = (0..self.images.len()).map(|i| format!(r#"{{"source": {i}}}"#)).collect();
        let lists = [
            ("bufferViews", &self.views),
            ("accessors", &self.accessors),
            ("meshes", &self.meshes),
            ("nodes", &self.nodes),
            ("images", &self.images),
            ("materials", &self.materials),
            ("textures", &textures),
        ];
        let lists: String = lists.map(|(name, items)| format!(r#", "{name}": [{}]"#, items.join(", "))).concat();
        let uri = format!("data:application/octet-stream,{}", hex(&self.data));
        let buffer = format!(r#"{{"uri": "{uri}", "byteLength": {}}}"#, self.data.len());
        let text = format!(r#"{{"asset": {{"version": "2.0"}}, "buffers": [{buffer}]{lists}}}"#);
        let loaded = load_bytes(text.as_bytes(), Some(Format::Gltf), Path::new("t"), &LoadOptions::default()).unwrap();
        assert!(loaded.notes.is_empty(), "{:?}", loaded.notes);
        let Content::Mesh(mesh) = loaded.content else { panic!("{:?}", loaded.content) };
        mesh
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("%{b:02x}")).collect()
}

/// Returns the colour at (u, v) of a texture with a zigzag disc on white. The pattern is lost if splats have the
/// colours of the quad's corners.
fn logo(u: f32, v: f32) -> [f32; 4] {
    let (x, y) = (u - 0.5, v - 0.5);
    let zigzag = y > 0.12 * (12.0 * x).sin();
    match x.hypot(y) < 0.4 {
        true if zigzag => [0.1, 0.4, 0.05, 1.0],
        true => [0.1, 0.3, 0.7, 1.0],
        false => [0.9, 0.9, 0.9, 1.0],
    }
}

fn checkers(u: f32, v: f32) -> [f32; 4] {
    let dark = ((u * 4.0) as i32 + (v * 4.0) as i32) % 2 == 0;
    if dark { [0.5, 0.08, 0.05, 1.0] } else { [0.9, 0.75, 0.3, 1.0] }
}

/// Returns the colour and alpha at (u, v) of a texture with stripes that fade towards the top.
fn fading(u: f32, v: f32) -> [f32; 4] {
    let [r, g, b] = if ((u + 0.5 * v) * 8.0) as i32 % 2 == 0 { [0.7, 0.75, 0.05] } else { [0.05, 0.3, 0.75] };
    [r, g, b, (1.1 * v - 0.05).clamp(0.0, 1.0)]
}

/// Returns the colour and alpha at (u, v) of a texture with three rounded leaves.
fn leaves(u: f32, v: f32) -> [f32; 4] {
    let at = DVec2::new(f64::from(u) - 0.5, f64::from(v) - 0.5);
    let angle = at.y.atan2(at.x);
    let inside = at.length() < 0.28 + 0.18 * (3.0 * angle).cos();
    [0.05, 0.2 + 0.4 * u, 0.05, f32::from(inside)]
}

/// Returns the corner and the sides of a quad in a plane of constant z. The corner at (x, y) is the lower left one.
fn upright(x: f64, y: f64, z: f64, width: f64, height: f64) -> [DVec3; 3] {
    [DVec3::new(x, y, z), DVec3::X * width, DVec3::Y * height]
}

/// Returns the mesh of a van: two textures, and parts with a colour alone (as Khronos' CesiumMilkTruck).
fn van() -> Mesh {
    let mut d = Document::default();
    let (logo, checkers) = (d.texture(logo), d.texture(checkers));
    let (side, floor) = (d.textured(logo, ""), d.textured(checkers, ""));
    let glass = d.material(r#"{"pbrMetallicRoughness": {"baseColorFactor": [0.02, 0.1, 0.08, 1]}}"#);
    let corner = DVec3::new(-1.0, 0.0, 0.6);
    d.quad([corner, DVec3::X * 1.6, DVec3::Y], side, &[], "");
    d.quad([corner + DVec3::Y, DVec3::X * 1.6, DVec3::Z * -1.2], side, &[], "");
    d.quad([corner + DVec3::X * 1.6, DVec3::Z * -1.2, DVec3::Y], glass, &[], "");
    d.quad([corner - DVec3::new(0.5, 0.1, -0.5), DVec3::X * 2.6, DVec3::Z * -2.2], floor, &[], "");
    d.load()
}

/// Returns quads with vertex colours beside a texture, and over one (as Khronos' VertexColorTest).
fn vertex_colors() -> Mesh {
    let mut d = Document::default();
    let checkers = d.texture(checkers);
    let (plain, textured) = (d.material("{}"), d.textured(checkers, ""));
    let corners = [[1.0, 0.1, 0.1], [0.1, 1.0, 0.1], [0.1, 0.1, 1.0], [1.0, 1.0, 0.1_f32]];
    let values: Vec<f32> = [0, 1, 2, 0, 2, 3].iter().flat_map(|&i| corners[i]).collect();
    let colors = d.column(&values, "VEC3", 6);
    d.quad(upright(-1.1, -0.5, 0.0, 1.0, 1.0), plain, &[("COLOR_0", colors)], "");
    d.quad(upright(0.1, -0.5, 0.0, 1.0, 1.0), textured, &[("COLOR_0", colors)], "");
    d.quad(upright(-0.5, 0.6, 0.0, 1.0, 1.0), textured, &[], "");
    d.load()
}

/// Returns quads with a texture moved, turned and scaled, and with one by other coordinates (as Khronos'
/// TextureTransformTest and MultiUVTest).
fn transforms() -> Mesh {
    let mut d = Document::default();
    let logo = d.texture(logo);
    let transformed = |d: &mut Document, transform: &str| {
        let extensions = format!(r#"{{"KHR_texture_transform": {{{transform}}}}}"#);
        let info = format!(r#"{{"index": {logo}, "extensions": {extensions}}}"#);
        d.material(format!(r#"{{"pbrMetallicRoughness": {{"baseColorTexture": {info}}}}}"#))
    };
    let other: Vec<f32> = [[0.0, 0.0], [0.0, 1.0], [0.5, 1.0], [0.0, 0.0], [0.5, 1.0], [0.5, 0.0]].concat();
    let other = d.column(&other, "VEC2", 6);
    let moved = transformed(&mut d, r#""offset": [0.3, 0.1]"#);
    let turned = transformed(&mut d, r#""rotation": 0.6"#);
    let scaled = transformed(&mut d, r#""scale": [2.5, 1.5]"#);
    let by_other = transformed(&mut d, r#""texCoord": 1"#);
    for (i, material) in [moved, turned, scaled, by_other].into_iter().enumerate() {
        let (x, y) = (1.1 * (i % 2) as f64 - 1.05, 1.1 * (i / 2) as f64 - 1.05);
        d.quad(upright(x, y, 0.0, 1.0, 1.0), material, &[("TEXCOORD_1", other)], "");
    }
    d.load()
}

/// Returns instances of quads, each with its own position, rotation and size (as Khronos' SimpleInstancing).
fn instances() -> Mesh {
    let mut d = Document::default();
    let (logo, checkers) = (d.texture(logo), d.texture(checkers));
    let (first, second) = (d.textured(logo, ""), d.textured(checkers, ""));
    let places: Vec<[f32; 3]> = (0..9).map(|i| [0.8 * (i % 3) as f32, 0.8 * (i / 3) as f32, 0.0]).collect();
    let half = (0..9).map(|i| 0.07 * i as f32);
    let turns: Vec<[f32; 4]> = half.map(|a| [0.0, a.sin(), 0.0, a.cos()]).collect();
    let sizes: Vec<[f32; 3]> = (0..9).map(|i| [0.5 + 0.03 * i as f32; 3]).collect();
    let translation = d.column(places.as_flattened(), "VEC3", 9);
    let rotation = d.column(turns.as_flattened(), "VEC4", 9);
    let scale = d.column(sizes.as_flattened(), "VEC3", 9);
    let attributes = format!(r#"{{"TRANSLATION": {translation}, "ROTATION": {rotation}, "SCALE": {scale}}}"#);
    let extensions = format!(r#""extensions": {{"EXT_mesh_gpu_instancing": {{"attributes": {attributes}}}}}"#);
    let node = format!(r#", "translation": [-0.8, -0.8, 0], {extensions}"#);
    d.quad(upright(-0.5, -0.5, 0.0, 1.0, 1.0), first, &[], &node);
    d.quad([DVec3::new(-0.5, 0.55, 0.0), DVec3::X, DVec3::new(0.0, 0.2, -0.3)], second, &[], &node);
    d.load()
}

/// Returns a wall, opaque, cut and blended surfaces in front of it (AlphaBlendModeTest), and leaves.
fn alpha_modes() -> Mesh {
    let mut d = Document::default();
    let (wall, fading, leaves) = (d.texture(checkers), d.texture(fading), d.texture(leaves));
    let wall = d.textured(wall, "");
    d.quad(upright(-1.6, -1.1, -0.4, 3.2, 2.2), wall, &[], "");
    let modes = ["", r#", "alphaMode": "MASK", "alphaCutoff": 0.25"#, r#", "alphaMode": "MASK""#];
    let more = [r#", "alphaMode": "MASK", "alphaCutoff": 0.75"#, r#", "alphaMode": "BLEND""#];
    for (i, mode) in modes.into_iter().chain(more).enumerate() {
        let material = d.textured(fading, mode);
        d.quad(upright(0.62 * i as f64 - 1.5, -0.9, 0.0, 0.55, 0.8), material, &[], "");
    }
    for (i, mode) in [r#", "alphaMode": "MASK""#, r#", "alphaMode": "BLEND""#].into_iter().enumerate() {
        let material = d.textured(leaves, mode);
        d.quad(upright(1.4 * i as f64 - 1.2, 0.05, 0.1, 0.9, 0.9), material, &[], "");
    }
    d.load()
}

fn camera() -> Camera {
    Camera {
        eye: [1.1, 0.7, 4.0],
        target: [0.0, 0.0, 0.0],
        up: [0.0, 1.0, 0.0],
        projection: Projection::Perspective { fov_y_deg: 40.0 },
        near: 0.01,
        far: None,
        size: [SIZE; 2],
    }
}

fn drawn(what: Object) -> Vec<[f32; 4]> {
    let [r, g, b] = SKY.map(f64::from);
    let scene = Scene { background: [r, g, b, 1.0], objects: vec![what], ..Scene::default() };
    let mut cpu = surfel_cpu::Renderer::new(Default::default()).unwrap();
    let resident = cpu.upload(&scene).unwrap();
    let peeled = Transparency::Peel { layers: 4, drop_last: false };
    let settings = Preset::Balanced.apply(Settings::default()).with_transparency(peeled);
    let mut frame = Frame::default();
    cpu.render_into(&resident, &View::new(&camera()).unwrap(), &settings, Planes::COLOR, &mut frame).unwrap();
    frame.color().to_vec()
}

fn splats(mesh: &Mesh) -> Vec<[f32; 4]> {
    drawn(object(splats_from_mesh(mesh, &MeshOptions::auto(mesh), &NoProgress).unwrap().0))
}

fn polygons(mesh: &Mesh) -> Vec<[f32; 4]> {
    drawn(Object { geometry: Geometry::Mesh(Arc::new(mesh.clone())), ..object(no_splat()) })
}

fn no_splat() -> surfel_model::SplatCloud {
    surfel_conformance::build::cloud(&[])
}

/// Casts rays through all triangles that they meet and blends these back to front, by glTF's alpha modes.
fn rays(mesh: &Mesh) -> Vec<[f32; 4]> {
    let camera = camera();
    let [right, down, forward] = axes(&camera);
    let Projection::Perspective { fov_y_deg } = camera.projection else { panic!("perspective") };
    let f = f64::from(SIZE) / (2.0 * (0.5 * fov_y_deg).to_radians().tan());
    let across = |i: u32| ((f64::from(i) + 0.5) / f64::from(RAYS) - 0.5 * f64::from(SIZE)) / f;
    let pixel = |i: u32| {
        let mut sum = [0.0; 4];
        for ray in 0..RAYS * RAYS {
            let (x, y) = (i % SIZE * RAYS + ray % RAYS, i / SIZE * RAYS + ray / RAYS);
            let direction = forward + right * across(x) + down * across(y);
            let color = seen(mesh, DVec3::from(camera.eye), direction);
            sum.iter_mut().zip(color).for_each(|(s, c)| *s += c / (RAYS * RAYS) as f32);
        }
        sum
    };
    (0..SIZE * SIZE).map(pixel).collect()
}

fn seen(mesh: &Mesh, eye: DVec3, direction: DVec3) -> [f32; 4] {
    let mut hits: Vec<(f64, [f32; 4])> = Vec::new();
    for (i, t) in mesh.triangles.iter().enumerate() {
        let [a, b, c] = t.map(|i| mesh.origin + mesh.positions.get(i as usize));
        // Möller and Trumbore 1997.
        let (e, f, s) = (b - a, c - a, eye - a);
        let (p, q) = (direction.cross(f), s.cross(e));
        let det = e.dot(p);
        let (u, v, depth) = (s.dot(p) / det, direction.dot(q) / det, f.dot(q) / det);
        if !(u >= 0.0 && v >= 0.0 && u + v <= 1.0 && depth > 0.0) {
            continue;
        }
        let shares = [1.0 - u - v, u, v].map(|share| share as f32);
        let mix = |value: &dyn Fn(usize) -> f32| (0..3).map(|k| shares[k] * value(t[k] as usize)).sum::<f32>();
        let material = mesh.material(i);
        let uvs = mesh.uvs.as_ref().unwrap();
        let texture = material.texture.map_or([1.0; 4], |t| t.sample([mix(&|i| uvs[i][0]), mix(&|i| uvs[i][1])]));
        let own = mesh.colors.as_ref().map_or([1.0; 3], |c| [0, 1, 2].map(|channel| mix(&|i| c[i][channel])));
        let opacity = match material.alpha {
            AlphaMode::Opaque => 1.0,
            AlphaMode::Mask { cutoff } => f32::from(texture[3] >= cutoff),
            AlphaMode::Blend => texture[3],
        };
        hits.push((depth, [own[0] * texture[0], own[1] * texture[1], own[2] * texture[2], opacity]));
    }
    hits.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut color = SKY;
    for (_, [r, g, b, a]) in hits {
        color.iter_mut().zip([r, g, b]).for_each(|(below, own)| *below += (own - *below) * a);
    }
    [color[0], color[1], color[2], 1.0]
}

fn flip(reference: &[[f32; 4]], test: &[[f32; 4]], name: &str) -> f64 {
    let image = |pixels: &[[f32; 4]]| pixels.as_flattened().to_vec();
    let (a, b) = (image(reference), image(test));
    let (a, b) = (Image::new(SIZE, SIZE, &a).unwrap(), Image::new(SIZE, SIZE, &b).unwrap());
    let flip = compare(&a, &b, &CompareOptions::default()).unwrap().flip_mean.unwrap();
    println!("{name}: FLIP {flip:.4}");
    if let Ok(folder) = std::env::var("SURFEL_TEST_OUT") {
        for (pixels, kind) in [(reference, "truth"), (test, "test")] {
            let planes = PlanesView { width: SIZE, height: SIZE, color: Some(pixels), ..PlanesView::default() };
            let path = Path::new(&folder).join(format!("{name}-{kind}.png"));
            surfel_io::save_png(&path, true, &planes, &PngOptions::default()).unwrap();
        }
    }
    flip
}

#[test]
fn splats_of_several_materials_look_like_their_polygons() {
    let scenes = [("van", van()), ("vertex-colours", vertex_colors()), ("instances", instances())];
    for (name, mesh) in scenes.into_iter().chain([("transforms", transforms())]) {
        assert!(mesh.textures().count() > 0, "{name}");
        let (polygons, rays) = (polygons(&mesh), rays(&mesh));
        // The rays evaluate textures and materials independently.
        assert!(flip(&rays, &polygons, &format!("{name}-polygons")) < MOST, "{name}");
        assert!(flip(&polygons, &splats(&mesh), name) < MOST, "{name}");
    }
}

#[test]
fn what_is_cut_or_blended_looks_like_rays_through_it() {
    let mesh = alpha_modes();
    assert!(mesh.is_see_through());
    let rays = rays(&mesh);
    assert!(flip(&rays, &splats(&mesh), "alpha-modes") < MOST);
    // A check of the measure: polygons are opaque and whole, so they must differ.
    assert!(flip(&rays, &polygons(&mesh), "alpha-modes-polygons") > 2.0 * MOST);
}

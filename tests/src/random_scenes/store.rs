//! Storage of random scenes as scene files, which any program that reads scene files can draw.

use crate::scenes::Case;
use std::fmt::Write as _;
use std::io;
use std::path::{Path, PathBuf};
use surfel_io::{IoError, PlanesView, PlyEncoding, PngOptions, atomic, save_octree, save_png, save_splat_ply};
use surfel_math::srgb;
use surfel_model::{Geometry, Matcap, Mesh, ObjectFile, SceneFile, Texture};

/// Writes a case to an existing folder, as `NAME.json` and the files of its objects. Returns the path of the scene
/// file. The region is dropped, because scene files have none.
///
/// # Errors
/// [`IoError`] if a file can't be written.
pub fn store(case: &Case, folder: &Path) -> Result<PathBuf, IoError> {
    let mut objects = Vec::new();
    for (i, object) in case.scene.objects.iter().enumerate() {
        let name = PathBuf::from(format!("{}-{i}.ply", case.name));
        let path = folder.join(&name);
        let mut file = ObjectFile {
            splats: None,
            mesh: None,
            matrix: glam::DMat4::from(object.world_from_object).to_cols_array(),
            material: object.material,
            convert: surfel_model::ConvertOptions::default(),
        };
        match &object.geometry {
            Geometry::Splats(cloud) => {
                save_splat_ply(&path, true, cloud, PlyEncoding::BinaryLittleEndian)?;
                file.splats = Some(name);
            }
            Geometry::Octree(octree) => {
                save_octree(&path, true, octree)?;
                file.splats = Some(name);
            }
            // Random scenes have no Gaussians.
            Geometry::Gaussians(_) => {}
            Geometry::Mesh(mesh) => {
                let texture = path.with_extension("png");
                if let Some(image) = &mesh.texture {
                    save_texture(image, &texture)?;
                }
                let text = mesh_text(mesh, texture.file_name().map(|n| n.to_string_lossy()).as_deref());
                write_text(&path, &text)?;
                file.mesh = Some(name);
            }
        }
        objects.push(file);
    }
    let scene = &case.scene;
    let ball = PathBuf::from(format!("{}-ball.png", case.name));
    if let Some(image) = &scene.matcap {
        save_ball(image, &folder.join(&ball))?;
    }
    let file = SceneFile {
        up: scene.up,
        camera: case.camera.clone(),
        background: scene.background,
        ambient: scene.ambient,
        lights: scene.lights.clone(),
        sky: None,
        ground: None,
        matcap: scene.matcap.is_some().then_some(ball),
        objects,
        settings: case.settings,
    };
    let path = folder.join(format!("{}.json", case.name));
    write_text(&path, &surfel_io::scene_file::to_json_pretty(&file))?;
    Ok(path)
}

fn write_text(path: &Path, text: &str) -> Result<(), IoError> {
    atomic::write(path, true, |out| out.write_all(text.as_bytes()))
}

fn save_texture(texture: &Texture, path: &Path) -> Result<(), IoError> {
    let linear = |t: &[u8; 4]| {
        let [r, g, b] = [t[0], t[1], t[2]].map(|level| srgb::decode(f64::from(level) / 255.0) as f32);
        [r, g, b, 1.0]
    };
    let color: Vec<[f32; 4]> = texture.srgba8.iter().map(linear).collect();
    let planes =
        PlanesView { width: texture.width, height: texture.height, color: Some(&color), ..PlanesView::default() };
    save_png(path, true, &planes, &PngOptions::default())
}

fn save_ball(image: &Matcap, path: &Path) -> Result<(), IoError> {
    let [width, height] = image.size();
    let color: Vec<[f32; 4]> = image.texels().iter().map(|&[r, g, b]| [r, g, b, 1.0]).collect();
    let planes = PlanesView { width, height, color: Some(&color), ..PlanesView::default() };
    save_png(path, true, &planes, &PngOptions::default())
}

/// Returns a mesh as ASCII PLY. Numbers are written in the shortest form that parses to the same value.
fn mesh_text(mesh: &Mesh, texture: Option<&str>) -> String {
    let mut text = String::from("ply\nformat ascii 1.0\n");
    let mut line = |words: std::fmt::Arguments<'_>| {
        // Writing to a string can't fail.
        let _ = writeln!(text, "{words}");
    };
    if let (Some(name), true) = (texture, mesh.texture.is_some()) {
        line(format_args!("comment TextureFile {name}"));
    }
    if mesh.colors.is_some() {
        line(format_args!("comment colors linear"));
    }
    line(format_args!("element vertex {}", mesh.positions.len()));
    let mut properties = |kind: &str, names: &[&str]| {
        names.iter().for_each(|name| line(format_args!("property {kind} {name}")));
    };
    properties("double", &["x", "y", "z"]);
    if mesh.normals.is_some() {
        properties("float", &["nx", "ny", "nz"]);
    }
    if mesh.colors.is_some() {
        properties("float", &["red", "green", "blue"]);
    }
    if mesh.uvs.is_some() {
        properties("float", &["s", "t"]);
    }
    line(format_args!("element face {}", mesh.triangles.len()));
    line(format_args!("property list uchar int vertex_indices\nend_header"));
    for i in 0..mesh.positions.len() {
        let mut row: Vec<String> = (mesh.origin + mesh.positions.get(i)).to_array().map(|x| x.to_string()).to_vec();
        let mut column = |values: &[f32]| row.extend(values.iter().map(ToString::to_string));
        mesh.normals.iter().for_each(|n| column(&n[i]));
        mesh.colors.iter().for_each(|c| column(&c[i]));
        // In PLY files, v points up.
        mesh.uvs.iter().for_each(|uv| column(&[uv[i][0], 1.0 - uv[i][1]]));
        line(format_args!("{}", row.join(" ")));
    }
    for [a, b, c] in &mesh.triangles {
        line(format_args!("3 {a} {b} {c}"));
    }
    text
}

/// Creates a folder if it doesn't exist, and returns its path.
///
/// # Errors
/// The system's [`io::Error`].
pub fn folder(path: &Path) -> io::Result<&Path> {
    std::fs::create_dir_all(path)?;
    Ok(path)
}

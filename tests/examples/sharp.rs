//! Prints the difference between clipped splats and an exact ray cast of the mesh that they were made from: `cargo run
//! --release -p surfel-conformance --example sharp -- MESH [--splats N,N] [--zooms S,S] [--view X,Y,Z]
//! [--depth-tolerance K] [--crease-angle DEG] [--size PIXELS] [--images FOLDER]`.
//!
//! With `--points N [--noise SHARE]` splats are made from N points on the mesh instead. `--cull none|back` overrides
//! whether back faces are drawn, which otherwise depends on whether the mesh is closed. `--oriented true|false`
//! overrides whether they are separated from front faces.
//!
//! A pixel differs if only one of the two images has a surface, or if the normals are more than 20° apart. The share
//! printed is relative to the pixels that the mesh covers.

use glam::DVec3;
use std::path::{Path, PathBuf};
use std::time::Instant;
use surfel_conformance::build::object;
use surfel_conformance::polygons::sampled;
use surfel_conformance::raycast::{Difference, Pixel, RayCaster, compare};
use surfel_model::{Camera, ClipPolicy, Cull, DepthTolerance, Light, Scene, Settings, Shader, SplatCloud};
use surfel_reference::Renderer as Reference;
use surfel_render::{Frame, Planes, Renderer, View};
use surfel_sample::{
    NoProgress, PointOptions, SharpOptions, sharp_splats_from_mesh, sharpen_points, splats_from_points,
};

type Error = Box<dyn std::error::Error>;

struct Arguments {
    mesh: PathBuf,
    splats: Vec<usize>,
    zooms: Vec<f64>,
    view: DVec3,
    images: Option<PathBuf>,
    crease_angle_deg: f64,
    depth_tolerance: f64,
    size: u32,
    points: Option<usize>,
    noise: f64,
    cull: Option<Cull>,
    oriented: Option<bool>,
}

fn arguments() -> Result<Arguments, Error> {
    let mut all = std::env::args().skip(1);
    let mut found = Arguments {
        mesh: all.next().ok_or("give a mesh file")?.into(),
        splats: vec![2500, 5000, 12_946, 52_000],
        // These are the fractions of the image covered in the paper.
        zooms: vec![0.031, 0.375, 0.807],
        view: DVec3::new(0.62, 0.52, 0.9),
        images: None,
        crease_angle_deg: 40.0,
        depth_tolerance: 1.0,
        size: 800,
        points: None,
        noise: 0.0,
        cull: None,
        oriented: None,
    };
    while let Some(flag) = all.next() {
        let value = all.next().ok_or("a flag needs a value")?;
        let numbers = || value.split(',').map(str::parse).collect::<Result<Vec<f64>, _>>();
        match flag.as_str() {
            "--splats" => found.splats = numbers()?.into_iter().map(|n| n as usize).collect(),
            "--zooms" => found.zooms = numbers()?,
            "--view" => {
                found.view = DVec3::from_array(numbers()?.try_into().map_err(|_| "--view takes three numbers")?);
            }
            "--images" => found.images = Some(value.into()),
            "--crease-angle" => found.crease_angle_deg = value.parse()?,
            "--depth-tolerance" => found.depth_tolerance = value.parse()?,
            "--size" => found.size = value.parse()?,
            "--points" => found.points = Some(value.parse()?),
            "--noise" => found.noise = value.parse()?,
            "--cull" => found.cull = Some(if value == "back" { Cull::Back } else { Cull::None }),
            "--oriented" => found.oriented = Some(value.parse()?),
            _ => return Err(format!("{flag}: unknown").into()),
        }
    }
    Ok(found)
}

fn scene(cloud: SplatCloud, cull: Cull, oriented: Option<bool>) -> Scene {
    let mut object = object(cloud);
    (object.material.cull, object.material.oriented) = (cull, oriented);
    (object.material.ambient, object.material.specular) = (0.25, 0.2);
    let light = |direction, strength| Light::Directional { direction, color: [strength; 3], shadow: false };
    Scene {
        up: None,
        background: [1.0; 4],
        ambient: [1.0; 3],
        sky: None,
        ground: None,
        matcap: None,
        lights: Some(vec![light([-0.3, -0.8, -0.5], 0.45), light([0.7, -0.2, -0.5], 0.25)]),
        objects: vec![object],
    }
}

fn render(scene: &Scene, camera: &Camera, settings: &Settings) -> Result<Frame, Error> {
    let mut renderer = Reference::new(Default::default())?;
    let resident = renderer.upload(scene)?;
    let mut frame = Frame::default();
    renderer.render_into(&resident, &View::new(camera)?, settings, Planes::ALL, &mut frame)?;
    Ok(frame)
}

fn save(path: &Path, size: u32, color: &[[f32; 4]]) -> Result<(), Error> {
    let planes = surfel_io::PlanesView { width: size, height: size, color: Some(color), ..Default::default() };
    Ok(surfel_io::save_png(path, true, &planes, &surfel_io::PngOptions::default())?)
}

/// Returns an image of the differing pixels: red is missing, blue is superfluous, orange has another normal.
fn marks(pixels: &[Pixel]) -> Vec<[f32; 4]> {
    let color = |p: &Pixel| match p {
        Pixel::Empty => [1.0; 4],
        Pixel::Same => [0.7, 0.7, 0.7, 1.0],
        Pixel::Missing => [1.0, 0.0, 0.0, 1.0],
        Pixel::Extra => [0.0, 0.0, 1.0, 1.0],
        Pixel::Normal => [1.0, 0.5, 0.0, 1.0],
    };
    pixels.iter().map(color).collect()
}

fn main() -> Result<(), Error> {
    let a = arguments()?;
    let surfel_io::Content::Mesh(mesh) = surfel_io::load(&a.mesh, &Default::default())?.content else {
        return Err("expected a mesh".into());
    };
    let cast = RayCaster::new(&mesh);
    let closed = surfel_sample::is_closed(&mesh);
    println!("{} triangles, closed: {closed}", mesh.triangles.len());
    let counts = a.points.map_or(a.splats.clone(), |points| vec![points]);
    for count in &counts {
        let start = Instant::now();
        let cloud = if a.points.is_some() {
            let points = sampled(&mesh, *count, a.noise, 1);
            let (cloud, _) = splats_from_points(&points, &PointOptions::default(), &NoProgress)?;
            let (cloud, report) = sharpen_points(&cloud, a.crease_angle_deg, &NoProgress)?;
            println!("\n{:.2} s: {report:?}", start.elapsed().as_secs_f64());
            cloud
        } else {
            let options =
                SharpOptions { splats: Some(*count), crease_angle_deg: a.crease_angle_deg, ..SharpOptions::default() };
            let (cloud, report) = sharp_splats_from_mesh(&mesh, &options, &NoProgress)?;
            println!("\n{:.2} s: {report:#?}", start.elapsed().as_secs_f64());
            cloud
        };
        let splats = cloud.len();
        let cull = a.cull.unwrap_or(if closed { Cull::Back } else { Cull::None });
        let scene = scene(cloud, cull, a.oriented);
        for share in &a.zooms {
            let camera = cast.camera_covering(a.view, *share, a.size);
            let truth = cast.image(&camera);
            for policy in [ClipPolicy::Exact, ClipPolicy::Line, ClipPolicy::Off] {
                let settings = Settings::default()
                    .with_clip(policy)
                    .with_shader(Shader::Phong)
                    .with_depth_tolerance(DepthTolerance::Relative(a.depth_tolerance));
                let frame = render(&scene, &camera, &settings)?;
                let pixels = compare(&truth, &frame);
                let d = Difference::of(&pixels, a.size as usize);
                let covered = 100.0 * d.covered as f64 / truth.len() as f64;
                println!(
                    "{splats:6} splats, {covered:4.1} % covered, {policy:?}: {:.3} % differ, {} in coverage, {} in \
                     normals, {} holes",
                    100.0 * d.share(),
                    d.coverage,
                    d.normals,
                    d.holes
                );
                if let Some(folder) = &a.images {
                    let name = format!("{count}-{share}-{policy:?}").to_lowercase();
                    save(&folder.join(format!("{name}.png")), a.size, frame.color())?;
                    save(&folder.join(format!("{name}-differ.png")), a.size, &marks(&pixels))?;
                }
            }
        }
    }
    Ok(())
}

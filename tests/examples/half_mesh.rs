//! Draws a model half as splats, half as polygons, and measures the seam:
//! `cargo run -p surfel-conformance --example half_mesh -- assets/spot/spot.obj out` writes `out-naive.png`,
//! `out-smooth.png` and `out-polygons.png`, and prints how far the first two are from the third along the seam.

use glam::{DAffine3, DVec3};
use std::path::Path;
use std::sync::Arc;
use surfel_conformance::build::{camera, cloud, object, scene};
use surfel_conformance::harness::render;
use surfel_conformance::polygons::mesh_object;
use surfel_conformance::scenes::Case;
use surfel_io::{Content, LoadOptions, PlanesView, PngOptions};
use surfel_model::{Camera, Cull, Geometry, Hybrid, Light, Scene, Shader};
use surfel_render::{Frame, Planes};
use surfel_sample::{HybridOptions, NoProgress, hybrid_from_mesh};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [input, out] = arguments.as_slice() else { return Err("expected a mesh and a name for pictures".into()) };
    let Content::Mesh(mesh) = surfel_io::load(Path::new(input), &LoadOptions::default())?.content else {
        return Err(format!("{input} holds no mesh").into());
    };
    let hybrid = hybrid_from_mesh(&mesh, &HybridOptions::default(), &NoProgress)?;
    let root = &hybrid.nodes()[0];
    let place =
        DAffine3::from_scale(DVec3::splat(1.0 / root.radius)) * DAffine3::from_translation(-hybrid.center_of(root));
    let mut camera = camera(2.2, 40.0, [512, 512]);
    camera.eye = [0.7, 0.4, 2.0];
    let mut reference = surfel_reference::Renderer::new(0)?;
    let mut draw = |half: bool, weight: Option<f64>| -> Result<Frame, Box<dyn std::error::Error>> {
        let case = case(&hybrid, place, &camera, half, weight)?;
        Ok(render(&mut reference, &case, Planes::ALL)?)
    };
    let truth = draw(false, None)?;
    // So low that a splat hides the polygon to its very rim.
    let naive = draw(true, Some(1e-6))?;
    let smooth = draw(true, None)?;
    for (name, frame) in [("naive", &naive), ("smooth", &smooth), ("polygons", &truth)] {
        let planes =
            PlanesView { width: frame.width, height: frame.height, color: Some(&frame.color), ..PlanesView::default() };
        surfel_io::save_png(Path::new(&format!("{out}-{name}.png")), true, &planes, &PngOptions::default())?;
    }
    for (name, frame) in [("naive", &naive), ("smooth", &smooth)] {
        let (worst, rmse, count) = seam(frame, &truth);
        println!("{name}: largest step {worst:.4}, RMSE {rmse:.5} over {count} pixels where splats meet polygons");
    }
    Ok(())
}

/// Leaves left of the middle as splats with their transitions, the others as polygons; or all as polygons.
fn case(
    hybrid: &Hybrid,
    place: DAffine3,
    camera: &Camera,
    half: bool,
    weight: Option<f64>,
) -> Result<Case, Box<dyn std::error::Error>> {
    let is_splats = |i: u32| half && hybrid.nodes()[i as usize].center[0] < hybrid.nodes()[0].center[0];
    let leaves = || (0u32..).zip(hybrid.nodes()).filter(|(_, n)| n.is_leaf());
    let own = leaves().filter(|(i, _)| is_splats(*i)).map(|(_, n)| n.splats.clone());
    let edges = hybrid.transitions().iter().filter(|t| t.leaves.iter().any(|l| is_splats(*l)));
    let splats: Vec<_> = own.chain(edges.map(|t| t.splats.clone())).collect();
    let triangles: Vec<_> = leaves().filter(|(i, _)| !is_splats(*i)).map(|(_, n)| n.triangles.clone()).collect();
    let mut cloud_object = object(cloud(&[]));
    cloud_object.geometry = Geometry::Splats(Arc::new(hybrid.cloud_of(&splats)?));
    let mut objects = vec![cloud_object, mesh_object(hybrid.mesh_of(&triangles))];
    for object in &mut objects {
        object.world_from_object = place;
        object.material.cull = Cull::Back;
        object.material.interior_weight = weight;
    }
    let lights = vec![Light::Directional { direction: [-0.6, -0.8, -1.0], color: [0.9; 3], shadow: false }];
    let scene = Scene { objects, lights: Some(lights), ..scene(&[]) };
    Ok(Case::new("half-mesh", scene, camera.clone()).with("lit", |s| s.shader = Shader::Phong))
}

/// Over pixels with splats, at most 6 px from polygons alone and on the truth's own surface: the largest difference between neighbours that is not in the
/// truth, and the root mean square difference.
fn seam(frame: &Frame, truth: &Frame) -> (f64, f64, usize) {
    let (w, h) = (frame.width as usize, frame.height as usize);
    let polygon_alone = |at: usize| frame.weight[at] == 0.0 && frame.depth[at].is_finite();
    let is_seam = |x: usize, y: usize| {
        let mut row = (x.saturating_sub(6)..(x + 7).min(w)).map(|k| y * w + k);
        let same_surface = |at: usize| (frame.depth[at] - truth.depth[at]).abs() < 0.003 * truth.depth[at];
        let at = y * w + x;
        frame.weight[at] > 0.0
            && same_surface(at)
            && same_surface(at.saturating_sub(1))
            && row.clone().any(polygon_alone)
            && row.all(|at| frame.depth[at].is_finite())
    };
    let error = |at: usize, c: usize| f64::from(frame.color[at][c] - truth.color[at][c]);
    let (mut worst, mut sum, mut count) = (0.0f64, 0.0, 0);
    for y in 0..h {
        for x in 1..w {
            if !is_seam(x, y) {
                continue;
            }
            let at = y * w + x;
            for c in 0..3 {
                worst = worst.max((error(at, c) - error(at - 1, c)).abs());
                sum += error(at, c).powi(2);
            }
            count += 1;
        }
    }
    (worst, (sum / (3 * count.max(1)) as f64).sqrt(), count)
}

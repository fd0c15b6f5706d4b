//! Draws a model half as splats, half as polygons, and measures the seam (docs/accuracy.md).
//!
//! `cargo run -p surfel-conformance --example half_mesh -- assets/spot/spot.obj out` writes `out-naive.png`,
//! `out-smooth.png`, `out-attributes.png` and `out-polygons.png`, and prints the largest steps from pixel to pixel
//! across the seam.

use glam::{DAffine3, DVec3, Vec3};
use std::path::Path;
use std::sync::Arc;
use surfel_conformance::build::{camera, cloud, object, scene};
use surfel_conformance::harness::render;
use surfel_conformance::polygons::mesh_object;
use surfel_conformance::scenes::Case;
use surfel_io::{Content, LoadOptions, PlanesView, PngOptions};
use surfel_model::{Camera, Cull, Geometry, Light, Material, Mesh, Octree, Scene, Shader};
use surfel_render::{Frame, Planes};
use surfel_sample::{NoProgress, OctreeOptions, octree_from_mesh};

type Failure = Box<dyn std::error::Error>;

/// Maximum distance of the measured pixels from the seam, in pixels.
const REACH: usize = 6;
const LIGHT: [f64; 3] = [-0.6, -0.8, -1.0];
const LIGHT_COLOR: f64 = 0.9;

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [input, out] = arguments.as_slice() else { return Err("expected a mesh and a name for images".into()) };
    let Content::Mesh(mesh) = surfel_io::load(Path::new(input), &LoadOptions::default())?.content else {
        return Err(format!("{input} holds no mesh").into());
    };
    if mesh.texture.is_some() || mesh.colors.is_some() {
        // The seam is also measured without the texture, because splats are too coarse for fine patterns.
        measure(&Mesh { texture: None, colors: None, ..mesh.clone() }, "white", None)?;
    }
    measure(&mesh, "as it is", Some(out))
}

/// Draws the images, prints the measures, and writes the images if `out` is given.
fn measure(mesh: &Mesh, what: &str, out: Option<&str>) -> Result<(), Failure> {
    let octree = octree_from_mesh(mesh, &OctreeOptions::default(), &NoProgress)?;
    let root = &octree.nodes()[0];
    let place =
        DAffine3::from_scale(DVec3::splat(1.0 / root.radius)) * DAffine3::from_translation(-octree.center_of(root));
    let mut camera = camera(2.2, 40.0, [512, 512]);
    camera.eye = [0.7, 0.4, 2.0];
    let mut reference = surfel_reference::Renderer::new(Default::default())?;
    let mut draw = |half: bool, weight: Option<f64>, shader: Shader| -> Result<Frame, Failure> {
        let case = case(&octree, place, &camera, half, weight)?.with("", |s| s.shader = shader);
        Ok(render(&mut reference, &case, Planes::ALL)?)
    };
    let truth = draw(false, None, Shader::Phong)?;
    // With such a small interior weight, coverage is 1 up to a splat's rim, so that the splat hides the polygon there.
    let naive = draw(true, Some(1e-6), Shader::Phong)?;
    let smooth = draw(true, None, Shader::Phong)?;
    // Albedo, normals and depths are blended, and then lit once. This is the deferred shading of G06, applied to
    // polygons, too.
    let attributes = lit(draw(true, None, Shader::Unlit)?, &camera);
    for (name, frame) in [("naive", &naive), ("smooth", &smooth), ("attributes", &attributes), ("polygons", &truth)] {
        let planes = PlanesView {
            width: frame.width(),
            height: frame.height(),
            color: Some(frame.color()),
            ..PlanesView::default()
        };
        if let Some(out) = out {
            surfel_io::save_png(Path::new(&format!("{out}-{name}.png")), true, &planes, &PngOptions::default())?;
        }
    }
    let pairs = pairs(&naive, &truth);
    println!("{what}: {} pairs of pixels along the seam", pairs.len());
    for (name, frame) in
        [("all polygons", &truth), ("naive", &naive), ("colours blended", &smooth), ("attributes blended", &attributes)]
    {
        println!("  {name}: {}", Steps::of(frame, &truth, &pairs));
    }
    Ok(())
}

/// Returns a case in which the leaves left of the middle are drawn as splats with their transitions, and the others as
/// polygons. If `half` is false, all leaves are polygons. `weight` is the interior weight of the splats; `None` uses
/// the stored one.
fn case(octree: &Octree, place: DAffine3, camera: &Camera, half: bool, weight: Option<f64>) -> Result<Case, Failure> {
    let is_splats = |i: u32| half && octree.nodes()[i as usize].center[0] < octree.nodes()[0].center[0];
    let leaves = || (0u32..).zip(octree.nodes()).filter(|(_, n)| n.is_leaf());
    let own = leaves().filter(|(i, _)| is_splats(*i)).map(|(_, n)| n.splats.clone());
    let edges = octree.transitions().iter().filter(|t| t.leaves.iter().any(|l| is_splats(*l)));
    let splats: Vec<_> = own.chain(edges.map(|t| t.splats.clone())).collect();
    let triangles: Vec<_> = leaves().filter(|(i, _)| !is_splats(*i)).map(|(_, n)| n.triangles.clone()).collect();
    let mut cloud_object = object(cloud(&[]));
    cloud_object.geometry = Geometry::Splats(Arc::new(octree.cloud_of(&splats)?));
    let mut objects = vec![cloud_object, mesh_object(octree.mesh_of(&triangles))];
    for object in &mut objects {
        object.world_from_object = place;
        object.material.cull = Cull::Back;
        object.material.interior_weight = weight;
    }
    let lights = vec![Light::Directional { direction: LIGHT, color: [LIGHT_COLOR; 3], shadow: false }];
    let scene = Scene { objects, lights: Some(lights), ..scene(&[]) };
    Ok(Case::new("half-mesh", scene, camera.clone()))
}

/// Applies Phong's light to an image's planes, with its colour as albedo (rendering model §5).
fn lit(mut frame: Frame, camera: &Camera) -> Frame {
    let Material { ambient, diffuse, specular, shininess, .. } = Material::default();
    let to_light = -DVec3::from(LIGHT).normalize();
    let [right, down, forward] = surfel_conformance::build::axes(camera);
    let focal = 0.5 * f64::from(frame.height()) / 20f64.to_radians().tan();
    for at in 0..frame.color().len() {
        if frame.depth()[at].is_infinite() {
            continue;
        }
        let middle = |i: usize, side: u32| i as f64 + 0.5 - 0.5 * f64::from(side);
        let width = frame.width() as usize;
        let [x, y] = [middle(at % width, frame.width()), middle(at / width, frame.height())].map(|c| c / focal);
        let to_eye = -(right * x + down * y + forward).normalize();
        let normal = Vec3::from(frame.normal()[at]).as_dvec3();
        let cosine = normal.dot(to_light);
        let shine = (normal * (2.0 * cosine) - to_light).dot(to_eye).max(0.0).powf(shininess);
        let matte = 0.1 * ambient + diffuse * cosine.max(0.0) * LIGHT_COLOR;
        let gloss = if cosine > 0.0 { specular * shine * LIGHT_COLOR } else { 0.0 };
        for c in &mut frame.color_mut()[at][..3] {
            *c = (f64::from(*c) * matte + gloss) as f32;
        }
    }
    frame
}

/// Returns pairs of neighbouring pixels, at most [`REACH`] pixels from the border between splats and polygons. Both
/// pixels show the surface, which is continuous between them in the ideal image `truth`.
fn pairs(frame: &Frame, truth: &Frame) -> Vec<[usize; 2]> {
    let (w, h) = (frame.width() as usize, frame.height() as usize);
    let has_splats = |at: usize| frame.weight()[at] > 0.0;
    let alike = |a: f32, b: f32| (a - b).abs() < 0.003 * b;
    let on_surface = |at: usize| frame.depth()[at].is_finite() && alike(frame.depth()[at], truth.depth()[at]);
    // Both kinds have to be on one surface. A silhouette of splats in front of polygons isn't a seam.
    let near_seam = |x: usize, y: usize| {
        let own = truth.depth()[y * w + x];
        let rows = y.saturating_sub(REACH)..(y + REACH + 1).min(h);
        let around = || {
            let columns = x.saturating_sub(REACH)..(x + REACH + 1).min(w);
            rows.clone().flat_map(move |j| columns.clone().map(move |i| j * w + i))
        };
        let near = |at: usize| on_surface(at) && (truth.depth()[at] - own).abs() < 0.03 * own;
        around().any(|at| near(at) && has_splats(at)) && around().any(|at| near(at) && !has_splats(at))
    };
    let mut zone = vec![false; w * h];
    for y in 0..h {
        for x in 0..w {
            zone[y * w + x] = on_surface(y * w + x) && near_seam(x, y);
        }
    }
    let mut pairs = Vec::new();
    for y in 0..h {
        for x in 0..w {
            let at = y * w + x;
            let others = [(x + 1 < w).then_some(at + 1), (y + 1 < h).then_some(at + w)];
            let joined = |other: &usize| zone[at] && zone[*other] && alike(truth.depth()[at], truth.depth()[*other]);
            pairs.extend(others.into_iter().flatten().filter(joined).map(|other| [at, other]));
        }
    }
    pairs
}

/// Differences of an image from the ideal image in pairs of neighbouring pixels at the seam. A step is the difference
/// within a pair. `value` is the largest step of a colour channel. `value_beyond` (colour) and `degrees_beyond`
/// (normals) are steps beyond those of the ideal image: the largest, and the 99.9 % quantile. `rmse` is that of the
/// green channel.
struct Steps {
    value: f64,
    value_beyond: [f64; 2],
    degrees_beyond: [f64; 2],
    rmse: f64,
}

impl Steps {
    fn of(frame: &Frame, truth: &Frame, pairs: &[[usize; 2]]) -> Self {
        let step = |f: &Frame, [a, b]: [usize; 2], c: usize| f64::from(f.color()[a][c] - f.color()[b][c]);
        let degrees = |f: &Frame, [a, b]: [usize; 2]| {
            let [a, b] = [a, b].map(|at| Vec3::from(f.normal()[at]).as_dvec3());
            (2.0 * (a - b).length().atan2((a + b).length())).to_degrees()
        };
        let largest = |each: &dyn Fn(usize) -> f64| (0..3).map(each).fold(0.0, f64::max);
        let value = pairs.iter().map(|&p| largest(&|c| step(frame, p, c).abs())).fold(0.0, f64::max);
        let beyond = |p: &[usize; 2]| largest(&|c| (step(frame, *p, c) - step(truth, *p, c)).abs());
        let turned = |p: &[usize; 2]| (degrees(frame, *p) - degrees(truth, *p)).max(0.0);
        let square = |p: &[usize; 2]| f64::from(frame.color()[p[0]][1] - truth.color()[p[0]][1]).powi(2);
        let rmse = (pairs.iter().map(square).sum::<f64>() / pairs.len().max(1) as f64).sqrt();
        let upper = |mut values: Vec<f64>| {
            values.sort_by(f64::total_cmp);
            let from_top = |n: usize| values.iter().rev().nth(n).copied().unwrap_or(0.0);
            [from_top(0), from_top(values.len() / 1000)]
        };
        let [value_beyond, degrees_beyond] =
            [upper(pairs.iter().map(beyond).collect()), upper(pairs.iter().map(turned).collect())];
        Self { value, value_beyond, degrees_beyond, rmse }
    }
}

impl std::fmt::Display for Steps {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { value, value_beyond: [most, few], degrees_beyond: [turned, little], rmse } = self;
        write!(f, "largest step {value:.4}; beyond the mesh's own {most:.4}, {few:.4} for one in a thousand; ")?;
        write!(f, "normals {turned:.2}°, {little:.2}°; RMSE {rmse:.5}")
    }
}

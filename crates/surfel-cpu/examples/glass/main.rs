//! Times layers of transparent splats: `glass SPLATS LAYERS FRAMES [abuffer]`, 27 glass spheres (G06's figure 6), 1024×1024, one
//! thread.
//!
//! Draws frames whose layers come from one traversal of each block's splats, and from a traversal a layer, in turn, and says how
//! long the tiles take either way. The pictures must be the same to the bit.

use glam::{DVec3, Vec3};
use surfel_cpu::{Options, Peeling, Renderer, Work};
use surfel_model::{Camera, CloudData, Column3, OnInvalid, Projection, Scene, Settings, Shader, Shape, SplatCloud};
use surfel_render::{Frame, Planes, Renderer as _, Stats, View};

/// Spheres in rows of three, `splats` disks each.
fn spheres(splats: usize) -> Result<(Scene, View), surfel_model::ModelError> {
    let radius = 0.4;
    let (mut centers, mut normals, mut colors) = (Vec::new(), Vec::new(), Vec::new());
    for ball in 0..27u16 {
        let place = DVec3::new(f64::from(ball % 3), f64::from(ball / 3 % 3), f64::from(ball / 9)) - 1.0;
        for i in 0..splats {
            let (z, angle) = (1.0 - (2 * i + 1) as f64 / splats as f64, 2.399_963 * i as f64);
            let r = (1.0 - z * z).sqrt();
            let n = DVec3::new(r * angle.cos(), r * angle.sin(), z);
            centers.push((place + n * radius).as_vec3());
            normals.push(n.as_vec3());
            colors.push((Vec3::splat(0.55) + 0.4 * place.as_vec3()).to_array());
        }
    }
    let count = centers.len();
    // Three times the area of a share of the sphere: about nine disks over every point, counting overlap.
    let disk = radius * (12.0 / splats as f64).sqrt();
    let shape = Shape::Disks { normals: Column3::from_f32(normals), radii: vec![disk as f32; count] };
    let data = CloudData {
        colors: Some(colors),
        alphas: Some(vec![0.35; count]),
        interior_weight: Some(1.3),
        ..CloudData::new(DVec3::ZERO, Column3::from_f32(centers), shape)
    };
    let scene = Scene::of_cloud(SplatCloud::new(data, OnInvalid::Refuse)?.0);
    let camera = Camera {
        eye: [2.0, 1.4, 4.5],
        target: [0.0; 3],
        up: [0.0, 1.0, 0.0],
        projection: Projection::Perspective { fov_y_deg: 36.0 },
        near: 0.1,
        far: None,
        size: [1024; 2],
    };
    Ok((scene, View::new(&camera)?))
}

fn tiles_ms(stats: &Stats) -> f64 {
    stats.passes.iter().filter(|pass| pass.name == "tiles").map(|pass| pass.ms).sum()
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let (numbers, abuffer) = match words.split_last() {
        Some((last, numbers)) if last == "abuffer" => (numbers, true),
        _ => (words.as_slice(), false),
    };
    let numbers: Vec<usize> = numbers.iter().map(|word| word.parse()).collect::<Result<_, _>>()?;
    let [splats, layers, frames] = numbers[..] else { return Err("expected SPLATS LAYERS FRAMES [abuffer]".into()) };
    let (scene, view) = spheres(splats.max(1))?;
    let transparency = if abuffer { format!("abuffer:{layers}") } else { format!("peel:{layers}") };
    let settings = Settings { shader: Shader::Phong, transparency: transparency.parse()?, ..Settings::default() };
    let mut pictures = [Frame::default(), Frame::default()];
    let mut times = [Vec::new(), Vec::new()];
    let mut pairs = [0.0; 2];
    let renderer = |peeling| {
        let work = Work { peeling, ..Work::default() };
        Renderer::with_options(&Options { threads: 1, work, ..Options::default() })
    };
    let mut renderers = [renderer(Peeling::Once)?, renderer(Peeling::Anew)?];
    let resident = renderers[0].upload(&scene)?;
    for _ in 0..frames.max(1) {
        for i in 0..2 {
            let stats = renderers[i].render(&resident, &view, &settings, Planes::COLOR, &mut pictures[i])?;
            times[i].push((tiles_ms(&stats), stats.frame_ms));
            pairs[i] = stats.counters.iter().filter(|c| c.0 == "block_pairs").map(|c| c.1).sum();
        }
    }
    if pictures[0].color != pictures[1].color {
        return Err("the pictures differ".into());
    }
    for ((name, times), pairs) in ["one traversal", "one a layer"].iter().zip(&mut times).zip(pairs) {
        times.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (middle, least) = (times[times.len() / 2], times[0]);
        println!("{name}: tiles {:.1} ms (least {:.1}), frame {:.1} ms, {pairs} pairs", middle.0, least.0, middle.1);
    }
    Ok(())
}

//! Times the CPU backend on synthetic trained Gaussians: N flat ones with harmonics of degree 3 on twenty spheres.
//!
//! `cargo run --release -p surfel-conformance --example gaussian_timing -- [N] [THREADS]` prints medians of five frames
//! at 1024².

use glam::{DQuat, DVec3};
use surfel_conformance::build::camera;
use surfel_conformance::random::Random;
use surfel_conformance::scenes::{gaussian_scene, no_gaussians};
use surfel_model::{Column3, GaussianKind, Settings};
use surfel_render::{Frame, Planes, Renderer, View};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let count: usize = arguments.next().map_or(Ok(1_000_000), |n| n.parse())?;
    let threads: usize = arguments.next().map_or(Ok(2), |n| n.parse())?;
    let mut random = Random::new(1);
    let mut data = no_gaussians(GaussianKind::Flat);
    data.degree = 3;
    let mut centers = Vec::new();
    // Spheres of all sizes in a box, so that many surfaces overlap, as in rooms.
    let spheres: Vec<(DVec3, f64)> =
        (0..20).map(|_| (DVec3::from([(); 3].map(|()| random.range(-2.0, 2.0))), random.factor(0.3, 1.2))).collect();
    let area: f64 = spheres.iter().map(|(_, r)| r * r).sum::<f64>() * 4.0 * std::f64::consts::PI;
    let spacing = (area / count as f64).sqrt();
    for (center, radius) in &spheres {
        let share = (radius * radius * 4.0 * std::f64::consts::PI / area * count as f64) as usize;
        for _ in 0..share {
            let n = random.direction();
            centers.push(*center + n * *radius);
            data.sigmas
                .push([random.factor(0.4, 1.6) * spacing, random.factor(0.4, 1.6) * spacing, 0.0].map(|s| s as f32));
            data.rotations.push(DQuat::from_rotation_arc(DVec3::Z, n).as_quat().to_array());
            // Opacities like those of trained Gaussians: many nearly opaque, many nearly invisible.
            data.opacities.push(random.range(0.02, 1.0) as f32);
            data.harmonics.extend(
                (0..16).map(|k| [(); 3].map(|()| random.range(-1.0, 1.0) as f32 * if k == 0 { 1.0 } else { 0.1 })),
            );
        }
    }
    data.centers = Column3::from_f64(&centers);
    println!("{} Gaussians, {threads} threads", centers.len());
    let scene = gaussian_scene(data);
    let mut renderer = surfel_cpu::Renderer::new(surfel_cpu::Options::default().with_threads(threads))?;
    let resident = renderer.upload(&scene)?;
    let view = View::new(&camera(6.0, 50.0, [1024, 1024]))?;
    for (name, planes) in [("colour", Planes::COLOR), ("all planes", Planes::ALL.with_fragments(true))] {
        let mut frame = Frame::default();
        let mut runs = Vec::new();
        for _ in 0..6 {
            runs.push(renderer.render_into(&resident, &view, &Settings::default(), planes, &mut frame)?);
        }
        runs.remove(0);
        runs.sort_by(|a, b| a.frame_ms.total_cmp(&b.frame_ms));
        let median = &runs[runs.len() / 2];
        let passes: Vec<String> = median.passes.iter().map(|p| format!("{} {:.0}", p.name, p.ms)).collect();
        println!(
            "{name}: {:.0} ms ({}), {} drawn, {} blended",
            median.frame_ms,
            passes.join(", "),
            median.drawn,
            median.fragments
        );
        frame.save_png(std::env::temp_dir().join(format!("gaussians-{}.png", name.replace(' ', "-"))))?;
    }
    Ok(())
}

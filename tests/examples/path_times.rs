//! Prints the times of each pass by compute shaders and by raster hardware, on the first adapter of `ash`. docs/gpu.md
//! has the times of lavapipe.

use glam::DVec3;
use std::collections::BTreeMap;
use surfel_conformance::build::{Splat, camera, cloud, object, scene, with_alpha};
use surfel_conformance::scenes::Case;
use surfel_gpu::GpuPath;
use surfel_model::{EdgeAa, Shader};
use surfel_render::{Frame, Planes, Renderer, Stats};

/// Number of timed frames per case.
const FRAMES: usize = 5;

/// Returns `count` disks on the unit sphere, with radii of 1.4 times the mean distance of neighbours.
fn sphere(count: usize) -> Vec<Splat> {
    let radius = 2.0 * (4.0 * std::f64::consts::PI / count as f64).sqrt() * 0.7;
    let disk = |i: usize| {
        let z = 1.0 - (2 * i + 1) as f64 / count as f64;
        let (sin, cos) = (i as f64 * 2.399_963).sin_cos();
        let n = DVec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z);
        Splat::disk(n, n, radius, [0.7, 0.5 + 0.3 * n.x as f32, 0.4])
    };
    (0..count).map(disk).collect()
}

/// Returns the median of each pass and of the whole frame, in milliseconds.
fn medians(all: &[Stats]) -> BTreeMap<String, f64> {
    let mut times: BTreeMap<String, Vec<f64>> = BTreeMap::new();
    for stats in all {
        let passes = stats.passes.iter().map(|pass| (pass.name.to_owned(), pass.ms));
        let passes: Vec<(String, f64)> = passes.collect();
        let sum = passes.iter().map(|(_, ms)| ms).sum();
        for (name, ms) in passes.into_iter().chain([("all passes".into(), sum), ("frame".into(), stats.frame_ms)]) {
            times.entry(name).or_default().push(ms);
        }
    }
    let median = |mut times: Vec<f64>| {
        times.sort_by(f64::total_cmp);
        times[times.len() / 2]
    };
    times.into_iter().map(|(name, times)| (name, median(times))).collect()
}

fn main() {
    for count in [20_000, 134_345] {
        let splats = sphere(count);
        let mut plain = Case::new("plain", scene(&splats), camera(4.0, 40.0, [512, 384]));
        plain.settings.shader = Shader::Phong;
        plain.scene.objects[0].material.interior_weight = Some(2.0);
        let by = |name: &str, edge_aa| plain.with(name, |s| s.edge_aa = edge_aa);
        let mut glass = plain.with("layers", |s| s.transparency = "peel:2".parse().unwrap());
        let mut object = object(with_alpha(cloud(&splats), |_| 0.5));
        object.material.interior_weight = Some(2.0);
        glass.scene.objects = vec![object];
        let (coverage, samples) = (by("edges by coverage", EdgeAa::Coverage), by("edges by samples", EdgeAa::Samples));
        glass.settings.edge_aa = EdgeAa::Off;
        for case in [by("no edges", EdgeAa::Off), coverage, samples, glass] {
            for path in [GpuPath::Raster, GpuPath::Compute] {
                let options = surfel_ash::Options::default().with_path(path);
                let mut renderer = surfel_ash::Renderer::new(options).unwrap();
                let resident = renderer.upload(&case.scene).unwrap();
                let mut frame = Frame::default();
                let mut draw = || {
                    renderer.render_into(&resident, &case.view(), &case.settings, Planes::COLOR, &mut frame).unwrap()
                };
                draw();
                draw();
                let all: Vec<Stats> = (0..FRAMES).map(|_| draw()).collect();
                let times = medians(&all);
                let passes: Vec<String> = times.iter().map(|(name, ms)| format!("{name} {ms:.2}")).collect();
                println!("{count} {} {path:?}: {}", case.name, passes.join(", "));
            }
        }
    }
}

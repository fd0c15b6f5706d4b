//! Set-up, binning and the tile loops, by size of splat: `cargo bench -p surfel-cpu`.
//!
//! One thread, 512×512 pixels that a plane of tilted disks covers 3.8 times, seen in perspective: only so most splats are drawn by the
//! cheapest evaluators. Each stage's time is the renderer's own, so that a
//! stage is measured as a frame runs it, with the caches as the stage before leaves them.

use std::time::Duration;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use surfel_cpu::{Options, Renderer};
use surfel_model::Settings;
use surfel_render::{Frame, Planes, Renderer as _, Stats};

#[path = "../examples/plane/scene.rs"]
mod scene;

/// Radii of the splats, pixels: below a pixel, the common case, large, huge.
const RADII_PX: [f64; 4] = [0.5, 2.0, 8.0, 32.0];

fn stages(criterion: &mut Criterion) {
    for stage in ["setup", "binning", "tiles"] {
        let mut group = criterion.benchmark_group(stage);
        for radius_px in RADII_PX {
            let (scene, view) = scene::plane(radius_px).expect("the scene is valid");
            let options = Options { threads: 1, ..Options::default() };
            let mut renderer = Renderer::with_options(&options).expect("there is a thread");
            let resident = renderer.upload(&scene).expect("the scene is uploaded");
            let (settings, mut frame) = (Settings::default(), Frame::default());
            let mut draw = || {
                let drawn = renderer.render(&resident, &view, &settings, Planes::COLOR, &mut frame);
                drawn.expect("the frame is drawn")
            };
            let splats = draw().splats;
            group.throughput(Throughput::Elements(splats));
            group.bench_function(BenchmarkId::from_parameter(format!("{radius_px} px")), |bencher| {
                bencher.iter_custom(|frames| {
                    let stage_ms =
                        |stats: Stats| stats.passes.iter().filter(|p| p.name == stage).map(|p| p.ms).sum::<f64>();
                    Duration::from_secs_f64((0..frames).map(|_| stage_ms(draw())).sum::<f64>() * 1e-3)
                });
            });
        }
        group.finish();
    }
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(20).warm_up_time(Duration::from_millis(500)).measurement_time(Duration::from_secs(2));
    targets = stages
}
criterion_main!(benches);

//! Benchmark of setup, binning and the tile loops for several sizes of splats, and of pixels for several shaders. Run
//! it as `cargo bench -p surfel-benches --bench stages`.
//!
//! It uses one thread and an image of 512×512 pixels, which a plane of tilted disks covers 3.8 times. The view is in
//! perspective, since otherwise the cheapest evaluators draw most splats. The time of each stage is measured by the
//! renderer within a frame, so that caches contain the data of the previous stage.

use std::time::Duration;

use criterion::measurement::WallTime;
use criterion::{BenchmarkGroup, BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use surfel_cpu::{Options, Renderer};
use surfel_model::{Light, Scene, Settings, Shader};
use surfel_render::{Frame, Planes, Renderer as _, SceneSummary, Stats, View};

#[path = "../../crates/surfel-cpu/examples/plane/scene.rs"]
mod scene;

/// Radii of the splats in pixels: below a pixel, common, large, and huge.
const RADII_PX: [f64; 4] = [0.5, 2.0, 8.0, 32.0];

fn stages(criterion: &mut Criterion) {
    for stage in ["setup", "binning", "tiles"] {
        let mut group = criterion.benchmark_group(stage);
        for radius_px in RADII_PX {
            let (scene, view) = scene::plane(radius_px).expect("the scene is valid");
            group.throughput(Throughput::Elements(SceneSummary::of(&scene).splats));
            let id = BenchmarkId::from_parameter(format!("{radius_px} px"));
            measure(&mut group, id, stage, (&scene, &view), &Settings::default());
        }
        group.finish();
    }
}

/// Times tiles with few large splats, in which the work per pixel dominates, for several shaders.
fn pixels(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("pixels");
    let (mut scene, view) = scene::plane(128.0).expect("the scene is valid");
    let light = |direction, color| Light::Directional { direction, color, shadow: false };
    scene.lights = Some(vec![
        light([0.5, -0.6, -0.7], [0.8, 0.8, 0.7]),
        light([-0.7, -0.1, -0.7], [0.2; 3]),
        light([-0.4, -0.5, 0.8], [0.2; 3]),
    ]);
    group.throughput(Throughput::Elements(view.size.iter().map(|&px| u64::from(px)).product()));
    for shader in [Shader::Unlit, Shader::Normal, Shader::Phong] {
        let settings = Settings::default().with_shader(shader);
        let id = BenchmarkId::from_parameter(format!("{shader:?}").to_lowercase());
        measure(&mut group, id, "tiles", (&scene, &view), &settings);
    }
    group.finish();
}

/// Draws frames repeatedly and times one stage of them, as the renderer reports its time.
fn measure(
    group: &mut BenchmarkGroup<'_, WallTime>,
    id: BenchmarkId,
    stage: &str,
    (scene, view): (&Scene, &View),
    settings: &Settings,
) {
    let options = Options::default().with_threads(1);
    let mut renderer = Renderer::new(options).expect("there is a thread");
    let resident = renderer.upload(scene).expect("the scene is uploaded");
    let mut frame = Frame::default();
    let mut draw = || {
        let drawn = renderer.render_into(&resident, view, settings, Planes::COLOR, &mut frame);
        drawn.expect("the frame is drawn")
    };
    draw();
    group.bench_function(id, |bencher| {
        bencher.iter_custom(|frames| {
            let stage_ms = |stats: Stats| stats.passes.iter().filter(|p| p.name == stage).map(|p| p.ms).sum::<f64>();
            Duration::from_secs_f64((0..frames).map(|_| stage_ms(draw())).sum::<f64>() * 1e-3)
        });
    });
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(20)
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_secs(2));
    targets = stages, pixels
}
criterion_main!(benches);

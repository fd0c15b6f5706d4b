//! Times the CPU's work for a frame on a GPU: tests chunks of 256 splats against the view, and lists the chunks that
//! may be visible. Run it as `cargo bench -p surfel-benches --bench gpu_tiles`. It needs no GPU.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use std::f64::consts::PI;
use std::hint::black_box;
use surfel_gpu::{FrameScene, FrameTiles, GpuPath, Limits, UNSUPPORTED, Upload};
use surfel_model::{Camera, Cull, Scene, Settings, SplatCloud, Storage};
use surfel_render::{Capabilities, Planes, SceneSummary, View, plan};

/// Number of splats: 4096 chunks, which fill one segment of an uploaded scene.
const SPLATS: u32 = 1 << 20;

/// Returns a cloud of [`SPLATS`] disks on the unit sphere.
fn sphere() -> SplatCloud {
    let golden = PI * (3.0 - 5.0f64.sqrt());
    let directions: Vec<[f32; 3]> = (0..SPLATS)
        .map(|i| {
            let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(SPLATS);
            let (sin, cos) = (golden * f64::from(i)).sin_cos();
            let across = (1.0 - z * z).sqrt();
            [across * cos, across * sin, z].map(|v| v as f32)
        })
        .collect();
    SplatCloud::disks(&directions, &directions, &vec![0.002; directions.len()])
        .expect("unit normals and a radius above 0")
}

fn tiles(c: &mut Criterion) {
    let mut group = c.benchmark_group("gpu tiles");
    let cloud = sphere();
    let eyes = [("whole", [0.0, 0.0, 3.0]), ("a part", [0.0, 0.0, 1.2])];
    for (what, eye) in eyes {
        for (cull, culling) in [(Cull::None, "both sides"), (Cull::Back, "front sides")] {
            let mut scene = Scene::from(cloud.clone());
            scene.objects.iter_mut().for_each(|object| object.material.cull = cull);
            let limits = Limits { buffer_bytes: 1 << 30, memory_bytes: 1 << 40, ..Limits::default() };
            let mut upload = Upload::new(&scene, Storage::F32, limits, "bench").expect("a scene within the limits");
            while upload.next_segment().is_some() {}
            let scene_data = upload.finish();
            let view = View::new(&Camera::perspective(eye, [0.0; 3], 45.0, [1024, 768])).expect("a valid camera");
            let capabilities = Capabilities { backend: "bench", lacks: UNSUPPORTED };
            let summary = SceneSummary::of(&scene);
            let plan =
                plan(&summary, &view, &Settings::default(), Planes::COLOR, &capabilities).expect("a plan of splats");
            group.throughput(Throughput::Elements(u64::from(SPLATS / 256)));
            group.bench_function(BenchmarkId::new(what, culling), |b| {
                b.iter(|| {
                    let frame = FrameScene::new(&scene_data, &view, &plan);
                    let tiles = FrameTiles::new(&scene_data, &frame, &view, &plan, limits, GpuPath::Compute);
                    black_box(tiles.count())
                });
            });
        }
    }
    group.finish();
}

criterion_group!(benches, tiles);
criterion_main!(benches);

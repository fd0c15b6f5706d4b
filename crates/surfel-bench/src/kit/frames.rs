//! Step `frames` of the kit: times frames of the kit's scenes with one backend.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::{Duration, Instant};

use surfel_backend::{Backend, BackendOptions, BackendScene};
use surfel_gpu::CELL_PAIRS;
use surfel_model::Camera;
use surfel_render::{Frame, Planes, Renderer, View};
use surfel_render::{SceneSummary, plan};

use super::On;
use super::record::{self, Record, Writer, plane_hashes};
use super::work::{Counts, Work};
use crate::report::{Row, Samples, Subject};
use crate::scenes::{Case, Loaded, kit};
use crate::{Failure, machine};

/// Sizes of the images, in pixels.
const SIZES: [[u32; 2]; 2] = [[1024, 1024], [1920, 1080]];
/// Divisor of the sides of images with `--small`.
const SMALL_SIDE: u32 = 8;
/// Divisor of the numbers of splats of scenes with `--small`.
const SMALL_SPLATS: usize = 100;

/// Smallest and largest number of timed frames per scene and size. Between them, frames are timed until [`TIME`] has
/// passed.
const FRAMES: std::ops::RangeInclusive<usize> = 5..=30;
/// Smallest and largest number of timed frames per scene and size with `--small`.
const SMALL_FRAMES: std::ops::RangeInclusive<usize> = 3..=5;
/// Time after which no further frames of a scene are timed, once the smallest number of [`FRAMES`] is reached.
const TIME: Duration = Duration::from_millis(500);

/// Shortest time of drawing before frames are timed. A GPU that idled while a scene was loaded needs tens of
/// milliseconds to raise its clock rate. Without this warm-up, times of equal frames on an H100 differed by a factor of
/// 2 to 3.
const WARM_UP: Duration = Duration::from_millis(150);

/// Number of frames per scene and size whose planes are hashed, to find out whether repeated frames are identical.
const HASHED: usize = 5;
/// Number of frames per scene and size whose planes are hashed with `--small`.
const SMALL_HASHED: usize = 2;

/// Times frames of every scene of the kit.
pub(super) fn run(backend: crate::Backend, on: &On) -> Result<(), Failure> {
    let mut writer = Writer::open(&on.out)?;
    let is_on_gpu = matches!(backend, crate::Backend::Wgpu | crate::Backend::Ash);
    let options = BackendOptions::default().with_adapter(on.adapter.clone().filter(|_| is_on_gpu));
    let mut backend = Backend::by_name(backend.name(), &options)?;
    let info = backend.info().clone();
    println!("{}: {} ({})", info.backend, info.adapter, info.driver);
    let cases = kit(if on.small { SMALL_SPLATS } else { 1 });
    let mut failures = 0;
    let mut at = 0;
    while let Some(first) = cases.get(at) {
        // Scenes with the same source are consecutive, and share one upload.
        let of_source = cases[at..].iter().take_while(|case| case.source == first.source).count();
        let start = Instant::now();
        let loaded = first.source.load(Path::new("models"))?;
        let load_ms = milliseconds(start);
        let start = Instant::now();
        let resident = backend.upload(&loaded.scene)?;
        let upload_ms = milliseconds(start);
        for case in &cases[at..at + of_source] {
            for size in SIZES.map(|size| if on.small { size.map(|side| side / SMALL_SIDE) } else { size }) {
                let subject = Drawn { case, loaded: &loaded, resident: &resident, size, small: on.small };
                match measured(&mut backend, &subject) {
                    Ok(frame) => {
                        println!("{} {size:?}: {:.2} ms", case.name, frame.row.median_ms);
                        writer.write(&Record::Frame(Box::new(record::Frame { load_ms, upload_ms, ..frame })))?;
                    }
                    Err(error) => {
                        println!("FAILED: {} {size:?} on {}: {error}", case.name, info.backend);
                        failures += 1;
                    }
                }
            }
        }
        at += of_source;
    }
    if failures > 0 { Err(format!("{failures} scenes failed on {}", info.backend).into()) } else { Ok(()) }
}

/// Scene to be drawn at one size.
struct Drawn<'a> {
    case: &'a Case,
    loaded: &'a Loaded,
    resident: &'a BackendScene,
    size: [u32; 2],
    small: bool,
}

/// Draws a scene repeatedly. The times of loading and uploading remain 0 in the result.
fn measured(backend: &mut Backend, drawn: &Drawn<'_>) -> Result<record::Frame, Failure> {
    let Drawn { case, loaded, resident, size, small } = *drawn;
    let view = View::new(&Camera { size, ..case.camera(loaded) })?;
    let settings = case.settings(loaded);
    let mut frame = Frame::default();
    // The first frame compiles pipelines and counts fragments. Some backends count fragments only on request.
    let counted = Planes::COLOR.with_weight(true).with_fragments(true);
    let start = Instant::now();
    let stats = backend.render_into(resident, &view, &settings, counted, &mut frame)?;
    let first_ms = milliseconds(start);
    let covered_px = frame.weight().iter().filter(|&&weight| weight > 0.0).count() as u64;
    let mut samples = Samples { covered_px, fragments: stats.fragments, ..Samples::default() };
    // Without the counts, the frame has other passes, so these frames compile further pipelines.
    let begin = Instant::now();
    loop {
        backend.render_into(resident, &view, &settings, case.planes, &mut frame)?;
        if small || begin.elapsed() >= WARM_UP {
            break;
        }
    }
    let bounds = if small { SMALL_FRAMES } else { FRAMES };
    let begin = Instant::now();
    while samples.stats.len() < *bounds.start() || (samples.stats.len() < *bounds.end() && begin.elapsed() < TIME) {
        let (start, busy) = (Instant::now(), machine::busy_ms());
        let stats = backend.render_into(resident, &view, &settings, case.planes, &mut frame)?;
        samples.frames_ms.push(milliseconds(start));
        samples.busy_ms.extend(machine::busy_ms().zip(busy).map(|(end, start)| end - start));
        samples.stats.push(stats);
    }
    let mut hashes: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for _ in 0..if small { SMALL_HASHED } else { HASHED } {
        backend.render_into(resident, &view, &settings, Planes::ALL, &mut frame)?;
        for (plane, hash) in plane_hashes(&frame) {
            hashes.entry(plane.to_owned()).or_default().push(hash);
        }
    }
    let info = backend.info().clone();
    let is_on_gpu = matches!(info.backend, "wgpu" | "ash");
    let work = if is_on_gpu {
        let plan = plan(&SceneSummary::of(&loaded.scene), &view, &settings, case.planes, &info.capabilities)?;
        let last = samples.stats.last().cloned().unwrap_or_default();
        Work::of(
            &plan,
            Counts {
                splats: last.splats as f64,
                drawn: last.drawn as f64,
                fragments: samples.fragments as f64,
                pixels: f64::from(size[0]) * f64::from(size[1]),
                bytes_per_splat: last.bytes_per_splat,
                pairs: last.counters.iter().find(|counter| counter.0 == CELL_PAIRS).map_or(0.0, |counter| counter.1),
            },
        )
    } else {
        Vec::new()
    };
    let subject = Subject {
        scene: case.name.to_owned(),
        about: case.about.to_owned(),
        shader: format!("{:?}", case.shader).to_lowercase(),
        threads: info.threads,
        size,
    };
    Ok(record::Frame {
        backend: info.backend.to_owned(),
        adapter: info.adapter,
        is_software: backend.is_software(),
        load_ms: 0.0,
        upload_ms: 0.0,
        first_ms,
        hashes,
        work,
        row: Row::new(subject, samples),
    })
}

fn milliseconds(since: Instant) -> f64 {
    since.elapsed().as_secs_f64() * 1e3
}

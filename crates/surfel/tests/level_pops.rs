//! Points by levels, chosen for every picture anew, on a flight: what a change of levels changes.
#![cfg(feature = "cpu")]

use std::path::{Path, PathBuf};
use std::sync::Arc;
use surfel::model::Camera;
use surfel::request::{Pictures, RenderOptions, Request, Resolved, Source};
use surfel::{Backend, BackendOptions, LevelStore, NoProgress, levels};

/// Hills of `side`² points 0.1 apart, in millimetres, with fields of 5 m and grain in colour, as LAS of format 7.
fn las(side: u32) -> Vec<u8> {
    let mut bytes = vec![0; 375];
    bytes[..4].copy_from_slice(b"LASF");
    bytes[24..26].copy_from_slice(&[1, 4]);
    bytes[94..96].copy_from_slice(&375_u16.to_le_bytes());
    bytes[96..100].copy_from_slice(&375_u32.to_le_bytes());
    bytes[104] = 7;
    bytes[105..107].copy_from_slice(&36_u16.to_le_bytes());
    for k in 0..3 {
        let mut put = |at: usize, v: f64| bytes[at..at + 8].copy_from_slice(&v.to_le_bytes());
        put(131 + 8 * k, 0.001);
        put(179 + 16 * k, if k == 2 { 3.0 } else { f64::from(side) * 0.1 + 0.05 });
        put(187 + 16 * k, if k == 2 { -3.0 } else { 0.0 });
    }
    bytes[247..255].copy_from_slice(&u64::from(side * side).to_le_bytes());
    let mut random = 1_u64;
    let mut next = || {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (random >> 40) as f64 / f64::from(1 << 24)
    };
    for i in 0..side * side {
        let [x, y] = [i % side, i / side].map(|v| f64::from(v) * 0.1 + 0.05 * next());
        let z = 3.0 * (x * 0.2).sin() * (y * 0.17).cos();
        [x, y, z].iter().for_each(|v| bytes.extend_from_slice(&((v * 1000.0).round() as i32).to_le_bytes()));
        bytes.extend_from_slice(&[0, 0, 0x11, 0, 2, 0, 0, 0, 0, 0]);
        bytes.extend_from_slice(&[0; 8]);
        let field = (x / 5.0).floor() as i64 + (y / 5.0).floor() as i64;
        let grain = 0.8 + 0.4 * next();
        let tone = |on: bool| (if on { 45_000.0 } else { 12_000.0 } * grain) as u16;
        let color = [tone(field % 2 == 0), (30_000.0 * grain) as u16, tone(field % 3 == 0)];
        color.iter().for_each(|v| bytes.extend_from_slice(&v.to_le_bytes()));
    }
    bytes
}

/// Steps of the flight.
const STEPS: u32 = 24;

/// Most that a change of levels may change a picture, root mean square: as of the octree of a mesh.
const POP_RMSE: f64 = 0.005;

/// Toward the middle of the land, and about it: each step as large a share of the distance as the last.
fn flown(step: f64, size: u32, side: u32) -> Camera {
    let (share, width) = (step / f64::from(STEPS), f64::from(side) * 0.1);
    let distance = 1.2 * width * 0.5_f64.powf(share);
    let (turn, rise) = (0.3 * share, 0.7_f64);
    let target = [0.5 * width, 0.5 * width, 0.0];
    let away = [rise.cos() * turn.cos(), rise.cos() * turn.sin(), rise.sin()];
    let eye = [0, 1, 2].map(|k| target[k] + distance * away[k]);
    Camera::perspective(eye, target, 40.0, [size, size]).with_up([0.0, 0.0, 1.0])
}

fn chosen(
    path: &Path,
    camera: &Camera,
    store: &Arc<LevelStore>,
    error_px: Option<f64>,
    views: usize,
) -> (Resolved, bool) {
    let mut options = RenderOptions::default();
    match error_px {
        Some(error_px) => options.set("lod-error", &error_px.to_string()).unwrap(),
        None => options.set("all-levels", "on").unwrap(),
    }
    let source = Source::of(&[path.to_path_buf()], None).unwrap();
    let request = Request::new(source, &Pictures::One, &options).unwrap().with_level_store(store.clone());
    let loaded = request.load(None, &NoProgress).unwrap();
    let asked = request.with_pictures(Pictures::Cameras(vec![camera.clone(); views]));
    let mut by_levels = false;
    let mut note = |note: String| by_levels |= note.contains("drawn by levels");
    (asked.resolve(loaded, &NoProgress, &mut note).unwrap(), by_levels)
}

/// Largest difference of colour in pixels that are covered in both, and the root mean square.
fn difference(a: &[[f32; 4]], b: &[[f32; 4]]) -> (f64, f64) {
    let (mut most, mut sum, mut pixels) = (0.0_f64, 0.0, 0);
    for (a, b) in a.iter().zip(b).filter(|(a, b)| a[3] > 0.999 && b[3] > 0.999) {
        for k in 0..3 {
            let apart = f64::from((a[k] - b[k]).abs());
            (most, sum) = (most.max(apart), sum + apart * apart);
        }
        pixels += 3;
    }
    (most, (sum / f64::from(pixels.max(1))).sqrt())
}

/// The largest of a flight.
#[derive(Debug, Default)]
struct Flight {
    /// Pictures that are drawn by levels.
    by_levels: u32,
    /// What the choice alone changes: a picture beside the same view of the points chosen for the step before; of a
    /// pixel, and root mean square.
    pop: [f64; 2],
    /// From a picture to the next.
    step: [f64; 2],
    /// The same of all points.
    step_of_all: [f64; 2],
    /// By how much a step is larger than that of all points.
    excess: [f64; 2],
    /// Root mean square beside all points.
    error: f64,
    /// Pixels that all points cover and levels don't.
    bare: usize,
    /// Splats drawn, of all pictures.
    splats: u64,
}

fn fly(path: &Path, size: u32, side: u32, error_px: f64, views: usize) -> Flight {
    let store = Arc::new(LevelStore::keeping_nodes());
    let mut backend = Backend::by_name("cpu", &BackendOptions::default()).unwrap();
    let mut draw = |resolved: &Resolved, camera: &Camera| -> Vec<[f32; 4]> {
        let scene = backend.upload(&resolved.scene).unwrap();
        backend.render(&scene, camera, &resolved.file.settings).unwrap().color().to_vec()
    };
    let camera = |step| flown(f64::from(step), size, side);
    let all = chosen(path, &camera(0), &store, None, 1).0;
    let mut before = chosen(path, &camera(0), &store, Some(error_px), views).0;
    let mut shown = [draw(&before, &camera(0)), draw(&all, &camera(0))];
    let mut flight = Flight::default();
    let most = |of: &mut [f64; 2], (most, rmse): (f64, f64)| *of = [of[0].max(most), of[1].max(rmse)];
    for step in 1..=STEPS {
        let camera = camera(step);
        let (after, by_levels) = chosen(path, &camera, &store, Some(error_px), views);
        let next = [draw(&after, &camera), draw(&all, &camera)];
        flight.by_levels += u32::from(by_levels);
        most(&mut flight.pop, difference(&next[0], &draw(&before, &camera)));
        let [own, of_all] = [0, 1].map(|i| difference(&shown[i], &next[i]));
        most(&mut flight.step, own);
        most(&mut flight.step_of_all, of_all);
        most(&mut flight.excess, (own.0 - of_all.0, own.1 - of_all.1));
        flight.error = flight.error.max(difference(&next[0], &next[1]).1);
        let inside = |i: usize| {
            let near = [0, 1, size as usize];
            near.iter().all(|d| i >= *d && next[1][i - d][3] == 1.0 && next[1].get(i + d).is_none_or(|c| c[3] == 1.0))
        };
        flight.bare += (0..next[0].len()).filter(|i| inside(*i) && next[0][*i][3] < 0.99).count();
        flight.splats += surfel::render::SceneSummary::of(&after.scene).splats;
        (before, shown) = (after, next);
    }
    flight
}

struct Folder(PathBuf);

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Hills by levels.
fn hills(side: u32) -> (Folder, PathBuf) {
    let folder = Folder(std::env::temp_dir().join(format!("surfel-level-pops-{}", std::process::id())));
    std::fs::create_dir_all(&folder.0).unwrap();
    let (input, path) = (folder.0.join("in.las"), folder.0.join("out.copc.laz"));
    std::fs::write(&input, las(side)).unwrap();
    levels::save_copc(&[input], &path, &levels::CopcRequest::default(), &NoProgress).unwrap();
    (folder, path)
}

#[test]
fn levels_chosen_for_every_picture_do_not_pop() {
    let var = |name: &str, other: u32| std::env::var(name).map_or(other, |v| v.parse().unwrap());
    let (side, size) = (var("SIDE", 400), var("SIZE", 96));
    let (_folder, path) = hills(side);
    let fading = fly(&path, size, side, 1.0, 1);
    println!("{fading:?}");
    assert!(fading.by_levels == STEPS && fading.bare == 0 && fading.pop[1] < POP_RMSE, "{fading:?}");
    // What would pop does: pictures that share a choice don't fade, not even two of the same.
    let popping = fly(&path, size, side, 1.0, 2);
    println!("without: {popping:?}");
    assert!(popping.pop[1] > POP_RMSE, "{popping:?}");
}

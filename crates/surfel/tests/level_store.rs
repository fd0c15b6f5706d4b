//! Tests of files drawn by levels of detail: converted first, and cached.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use surfel_app::request::{Pictures, RenderOptions, Request, Resolved, Source};
use surfel_load::levels::{self, CopcRequest};
use surfel_load::{Error, LevelStore, LoadOptions, memory};
use surfel_model::{Camera, Geometry, SplatCloud};
use surfel_sample::NoProgress;

/// Returns a LAS file of format 6: hills of `side`² points, 0.1 apart, in millimetres.
fn las(side: u32) -> Vec<u8> {
    let mut bytes = vec![0; 375];
    bytes[..4].copy_from_slice(b"LASF");
    bytes[24..26].copy_from_slice(&[1, 4]);
    bytes[94..96].copy_from_slice(&375_u16.to_le_bytes());
    bytes[96..100].copy_from_slice(&375_u32.to_le_bytes());
    bytes[104] = 6;
    bytes[105..107].copy_from_slice(&30_u16.to_le_bytes());
    for k in 0..3 {
        let mut put = |at: usize, v: f64| bytes[at..at + 8].copy_from_slice(&v.to_le_bytes());
        put(131 + 8 * k, 0.001);
        put(179 + 16 * k, if k == 2 { 3.0 } else { f64::from(side) * 0.1 });
        put(187 + 16 * k, if k == 2 { -3.0 } else { 0.0 });
    }
    bytes[247..255].copy_from_slice(&u64::from(side * side).to_le_bytes());
    for i in 0..side * side {
        let [x, y] = [i % side, i / side].map(|v| f64::from(v) * 0.1);
        let z = 3.0 * (x * 0.2).sin() * (y * 0.17).cos();
        [x, y, z].iter().for_each(|v| bytes.extend_from_slice(&((v * 1000.0).round() as i32).to_le_bytes()));
        bytes.extend_from_slice(&[0; 18]);
    }
    bytes
}

const SIDE: u32 = 400;

/// Creates a folder with `in.las`.
fn folder(name: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("surfel-{name}-{}", std::process::id()));
    fs::create_dir_all(&folder).unwrap();
    fs::write(folder.join("in.las"), las(SIDE)).unwrap();
    folder
}

fn camera(eye: [f64; 3]) -> Camera {
    Camera::perspective(eye, [eye[0], 20.0, 0.0], 30.0, [160, 120]).with_up([0.0, 0.0, 1.0])
}

fn request(path: &Path, memory: &str, store: &Arc<LevelStore>) -> Request {
    let mut options = RenderOptions::default();
    options.set("memory", memory).unwrap();
    let source = Source::of(&[path.to_path_buf()], None).unwrap();
    Request::new(source, &Pictures::One, &options).unwrap().with_level_store(store.clone())
}

fn resolved(request: &Request, eye: [f64; 3]) -> Result<(Resolved, Vec<String>), Error> {
    let loaded = request.load(&NoProgress)?;
    let mut notes = Vec::new();
    let asked = request.clone().with_pictures(Pictures::Cameras(vec![camera(eye)]));
    Ok((asked.resolve(loaded, &NoProgress, &mut |note| notes.push(note))?, notes))
}

fn cloud(resolved: &Resolved) -> &SplatCloud {
    match &resolved.scene.objects[0].geometry {
        Geometry::Splats(cloud) => cloud,
        _ => panic!("no splats"),
    }
}

#[test]
fn file_that_does_not_fit_is_drawn_as_if_it_had_been_converted_first() {
    let folder = folder("store-converts");
    let (input, converted) = (folder.join("in.las"), folder.join("out.copc.laz"));
    levels::save_copc(std::slice::from_ref(&input), &converted, &CopcRequest::default(), &NoProgress).unwrap();
    // Less than the some 75 bytes per point that all points need.
    let (memory, eye) = ("10M", [20.0, -150.0, 80.0]);
    let store = Arc::new(LevelStore::default().with_least_memory(0));
    let (found, notes) = resolved(&request(&input, memory, &store), eye).unwrap();
    assert!(notes.iter().any(|note| note.contains("written by levels first")), "{notes:?}");
    let (expected, notes) = resolved(&request(&converted, memory, &Arc::default()), eye).unwrap();
    assert!(!notes.iter().any(|note| note.contains("written by levels first")), "{notes:?}");
    assert_eq!(found.file.camera, expected.file.camera);
    assert!(cloud(&found).len() < (SIDE * SIDE) as usize && cloud(&found) == cloud(&expected));
    // The file is written once, and deleted with its last user.
    let kept = || store.converted(&input).unwrap();
    let temporary = kept();
    let (again, _) = resolved(&request(&input, memory, &store), [30.0, -150.0, 80.0]).unwrap();
    assert!(!cloud(&again).is_empty());
    assert!(temporary.exists() && kept() == temporary);
    // A replaced file is converted again.
    fs::write(&input, las(SIDE - 1)).unwrap();
    let (other, _) = resolved(&request(&input, memory, &store), eye).unwrap();
    assert!(!temporary.exists() && cloud(&other) != cloud(&found));
    let temporary = kept();
    drop(store);
    assert!(!temporary.exists());
    // A file is refused if even its conversion needs too much memory.
    let error = resolved(&request(&input, memory, &Arc::default()), eye).unwrap_err().to_string();
    assert!(error.contains("surfel convert"), "{error}");
    fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn columns_that_do_not_fit_are_drawn_as_their_conversion_and_seen_as_what_they_are() {
    let folder = folder("store-columns");
    let (input, converted) = (folder.join("in.ply"), folder.join("out.copc.laz"));
    let count = SIDE * SIDE;
    let properties = "property float x\nproperty float y\nproperty float z";
    let head = format!("ply\nformat binary_little_endian 1.0\ncomment up -y\nelement vertex {count}\n{properties}\n");
    let mut bytes = (head + "end_header\n").into_bytes();
    for i in 0..count {
        let [x, y] = [i % SIDE, i / SIDE].map(|v| v as f32 * 0.1);
        [x, y, 3.0 * (x * 0.2).sin() * (y * 0.17).cos()].iter().for_each(|v| bytes.extend(v.to_le_bytes()));
    }
    fs::write(&input, bytes).unwrap();
    levels::save_copc(std::slice::from_ref(&input), &converted, &CopcRequest::default(), &NoProgress).unwrap();
    let (memory, eye) = ("9M", [20.0, -150.0, 80.0]);
    let store = Arc::new(LevelStore::default().with_least_memory(0));
    let (found, notes) = resolved(&request(&input, memory, &store), eye).unwrap();
    assert!(notes.iter().any(|note| note.contains("written by levels first")), "{notes:?}");
    let (expected, _) = resolved(&request(&converted, memory, &Arc::default()), eye).unwrap();
    assert!(cloud(&found).len() < count as usize);
    // Equal except for the up axis that the file states, which COPC can't store.
    let [found, expected] = [&found, &expected].map(|resolved| cloud(resolved).data());
    assert!((&found.centers, &found.shape) == (&expected.centers, &expected.shape));
    let options = LoadOptions::default().with_memory(Some(9 << 20)).with_levels(Some(levels::Levels::Overview));
    let loaded = surfel_load::load(&input, &options.with_level_store(Some(store)), &NoProgress).unwrap();
    assert_eq!((loaded.format, loaded.up), (surfel_io::Format::Ply, surfel_model::Up::MinusY));
    assert_eq!(loaded.up_reason, Some(surfel_framing::UpReason::Stated));
    fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn views_that_come_back_read_nothing() {
    let folder = folder("store-keeps");
    let converted = folder.join("out.copc.laz");
    levels::save_copc(&[folder.join("in.las")], &converted, &CopcRequest::default(), &NoProgress).unwrap();
    let eyes = [[8.0, 2.0, 4.0], [32.0, 2.0, 4.0], [20.0, -20.0, 10.0]];
    let plain: Vec<_> =
        eyes.iter().map(|eye| resolved(&request(&converted, "100M", &Arc::default()), *eye).unwrap()).collect();
    let drawn = |store: &Arc<LevelStore>, memory: &str, eye: usize| {
        let (found, _) = resolved(&request(&converted, memory, store), eyes[eye]).unwrap();
        assert!(cloud(&found) == cloud(&plain[eye].0), "{eye}");
        store.read_bytes()
    };
    let store = Arc::new(LevelStore::caching_nodes());
    let read = [0, 1, 2].map(|eye| drawn(&store, "100M", eye));
    assert!(0 < read[0] && read[0] < read[1] && read[1] <= read[2], "{read:?}");
    assert_eq!([0, 1, 2, 0].map(|eye| drawn(&store, "100M", eye)), [read[2]; 4]);
    // The cache is limited to the memory that an image's points don't need. Without any, all nodes are read again.
    let needs = plain.iter().map(|(resolved, _)| cloud(resolved).len() as u64 * memory::KNOWN_BYTES).max().unwrap();
    let store = Arc::new(LevelStore::caching_nodes());
    let first = drawn(&store, &needs.to_string(), 0);
    assert!(store.cached_bytes() <= needs);
    let second = drawn(&store, &needs.to_string(), 1);
    assert!(second > first && drawn(&store, &needs.to_string(), 0) > second);
    fs::remove_dir_all(&folder).unwrap();
}

//! Objects whose COPC files are first read in part, and then as far as a view needs.

use std::path::{Path, PathBuf};
use surfel_io::copc::{CopcOptions, save_copc};
use surfel_load::LoadOptions;
use surfel_load::levels::{Levels, ViewSelection};
use surfel_load::{
    LoadedObjects, ObjectNote,
    scene::{load_objects, refine_objects},
};
use surfel_model::{Camera, ConvertOptions, Geometry, ObjectFile};
use surfel_render::View;
use surfel_sample::NoProgress;

/// Number of points along a side of a square of points that are 0.1 apart.
const SIDE: u32 = 450;

/// Writes a COPC file of a wavy square, with normals and radii, and returns its path.
fn land(folder: &Path, name: &str) -> PathBuf {
    let (text, copc) = (folder.join("in.xyz"), folder.join(name));
    let line = |i: u32| {
        let [x, y] = [i % SIDE, i / SIDE].map(|v| 0.1 * f64::from(v));
        format!("{x:.1} {y:.1} {:.3} {}\n", (0.2 * x).sin(), i % 251)
    };
    std::fs::write(&text, (0..SIDE * SIDE).map(line).collect::<String>()).unwrap();
    let options = CopcOptions { overwrite: true, ..CopcOptions::default() };
    save_copc(&[text], &copc, &options, None, &|_, _, _| ()).unwrap();
    copc
}

fn object(path: &Path, x: f64, convert: ConvertOptions) -> ObjectFile {
    let mut matrix = [0.0; 16];
    (0..4).for_each(|k| matrix[5 * k] = 1.0);
    matrix[12] = x;
    ObjectFile { splats: Some(path.to_path_buf()), mesh: None, matrix, material: Default::default(), convert }
}

fn splats(loaded: &LoadedObjects) -> Vec<usize> {
    let count = |geometry: &Geometry| match geometry {
        Geometry::Splats(cloud) => cloud.len(),
        _ => 0,
    };
    loaded.objects.iter().map(|object| count(&object.geometry)).collect()
}

fn notes_on<'a>(loaded: &'a LoadedObjects, path: &'a Path) -> Vec<&'a str> {
    loaded.notes.iter().filter(|note| note.path == path).map(|note| note.text.as_str()).collect()
}

#[test]
fn refined_objects_have_their_view_s_points_and_one_set_of_notes_a_file() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("refined");
    std::fs::create_dir_all(&folder).unwrap();
    let near = land(&folder, "near.copc.laz");
    let far = folder.join("far.copc.laz");
    std::fs::copy(&near, &far).unwrap();
    let disks = folder.join("disk.ply");
    let properties: String = "x y z nx ny nz radius".split(' ').map(|p| format!("property float {p}\n")).collect();
    let header = format!("ply\nformat ascii 1.0\nelement vertex 1\n{properties}end_header\n");
    std::fs::write(&disks, header + "0 0 5 0 0 1 1\n").unwrap();
    let by_intensity = ConvertOptions { color_by: Some("intensity".into()), ..ConvertOptions::default() };
    // Of one file twice: where the camera looks, and far beside it.
    let files = [
        object(&near, 0.0, by_intensity.clone()),
        object(&disks, 0.0, ConvertOptions::default()),
        object(&near, 3000.0, by_intensity.clone()),
        object(&far, 0.0, by_intensity),
    ];
    let options = LoadOptions::default().with_levels(Some(Levels::Overview));
    let mut loaded = load_objects(&files, &folder, &options, &NoProgress).unwrap();
    let overview = splats(&loaded);
    let partial: Vec<bool> = loaded.facts.iter().map(|facts| facts.partial).collect();
    assert_eq!((partial, overview[0]), (vec![true, false, true, true], overview[3]));
    assert!(overview[0] < (SIDE * SIDE) as usize);
    // The disk's file is refined by nobody, and keeps its notes.
    loaded.notes.push(ObjectNote { path: disks.clone(), text: "stays".into() });

    // Close to a corner, so that what is far away stays coarse.
    let camera = Camera::perspective([5.0, 5.0, 6.0], [12.0, 12.0, 0.0], 50.0, [300, 300]);
    let views = [View::new(&camera.with_up([0.0, 0.0, 1.0])).unwrap()];
    let selection = ViewSelection { views: &views, error_px: 1.0, margin_px: None };
    refine_objects(&mut loaded, &files, &folder, &options, &selection, &NoProgress).unwrap();
    let refined = splats(&loaded);
    assert!(refined[0] != overview[0] && refined[0] < (SIDE * SIDE) as usize, "{overview:?} {refined:?}");
    assert!(refined[0] == refined[3] && refined[2] < refined[0] && refined[1] == 1, "{refined:?}");
    assert!(loaded.facts.iter().all(|facts| !facts.partial));
    assert!([0, 2, 3].iter().all(|i| loaded.facts[*i].colored), "{:?}", loaded.facts);

    // What was read last of a file is noted, once, as if it alone had been read so.
    let levels = |x: f64| Levels::Views {
        views: views.clone().into(),
        world_from_object: files[if x > 0.0 { 2 } else { 0 }].world_from_object().unwrap(),
        error_px: 1.0,
        margin_px: None,
    };
    for (path, file, x) in [(&near, &files[2], 3000.0), (&far, &files[3], 0.0)] {
        let options = options.clone().with_levels(Some(levels(x)));
        let alone = load_objects(std::slice::from_ref(file), &folder, &options, &NoProgress).unwrap();
        let of_levels = |of: &LoadedObjects| -> Vec<String> {
            let notes = notes_on(of, path).into_iter().filter(|note| note.starts_with("drawn by levels"));
            notes.map(str::to_owned).collect()
        };
        assert_eq!(of_levels(&loaded), of_levels(&alone), "{path:?}");
        let all = notes_on(&loaded, path);
        assert_eq!(of_levels(&loaded).len(), 1, "{all:?}");
        let distinct: std::collections::BTreeSet<&str> = all.iter().copied().collect();
        assert_eq!(distinct.len(), all.len(), "{all:?}");
    }
    assert_eq!(notes_on(&loaded, &disks).last(), Some(&"stays"));
    std::fs::remove_dir_all(&folder).unwrap();
}

//! Tests that a COPC file doesn't depend on how its parts are made.

use super::super::build::LEAF_POINTS;
use super::super::{Copc, LEVEL_COLORS, LEVEL_NORMALS, LevelValues, NodeColumns, RADIUS};
use super::*;
use glam::DVec3;
use std::fs::File;
use std::sync::atomic::{AtomicUsize, Ordering};
use surfel_model::PointCloud;

const OVER: CopcOptions = CopcOptions { overwrite: true, memory: 0, resume: false, shard: None, columns: None };

/// Builds a LAS file of format 6 whose GPS times are the indices of its points.
fn las_of(points: &[[i32; 3]]) -> Vec<u8> {
    let mut bytes = vec![0; 375];
    bytes[..4].copy_from_slice(b"LASF");
    bytes[24..26].copy_from_slice(&[1, 4]);
    bytes[94..96].copy_from_slice(&375_u16.to_le_bytes());
    bytes[96..100].copy_from_slice(&375_u32.to_le_bytes());
    bytes[104] = 6;
    bytes[105..107].copy_from_slice(&30_u16.to_le_bytes());
    (0..3).for_each(|k| bytes[131 + 8 * k..139 + 8 * k].copy_from_slice(&0.01_f64.to_le_bytes()));
    (0..3).for_each(|k| bytes[179 + 16 * k..187 + 16 * k].copy_from_slice(&1000_f64.to_le_bytes()));
    bytes[247..255].copy_from_slice(&(points.len() as u64).to_le_bytes());
    for (i, at) in points.iter().enumerate() {
        at.iter().for_each(|v| bytes.extend_from_slice(&v.to_le_bytes()));
        bytes.extend_from_slice(&[0; 10]);
        bytes.extend_from_slice(&(i as f64).to_le_bytes());
    }
    bytes
}

/// Converts a LAS file of [`las_of`] to point format 7. Each point gets a colour of its own.
fn colored(las: &[u8]) -> Vec<u8> {
    let mut bytes = las[..375].to_vec();
    bytes[104] = 7;
    bytes[105..107].copy_from_slice(&36_u16.to_le_bytes());
    for record in las[375..].chunks_exact(30) {
        bytes.extend_from_slice(record);
        bytes.extend(record[..6].iter().map(|v| v | 1));
    }
    bytes
}

fn random(seed: u64) -> impl FnMut() -> u64 {
    let mut random = seed;
    move || {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        random
    }
}

/// Builds a LAS file of a sheet of `count` points. Half of the points are in one hundredth of the sheet's area.
fn las(count: u64) -> Vec<u8> {
    let mut next = random(3);
    let point = |i: u64| {
        let (random, within) = (next(), if i.is_multiple_of(2) { 100_000 } else { 10_000 });
        [(random >> 16) % within, (random >> 36) % within, (random >> 50) % 500].map(|v| v as i32)
    };
    las_of(&(0..count).map(point).collect::<Vec<_>>())
}

#[test]
fn file_does_not_depend_on_how_many_parts_are_made_at_once() {
    let folder = std::env::temp_dir().join(format!("surfel-copc-held-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let input = folder.join("in.las");
    std::fs::write(&input, las(200_000)).unwrap();
    let prepare = |cloud: &PointCloud| {
        let splat = |i: usize| PointSplat { normal: [0.0, 0.0, 1.0], radius: cloud.len() as f32 + i as f32 };
        Ok((0..cloud.len()).map(splat).collect())
    };
    let written = |held_points: u64| {
        let output = folder.join(format!("{held_points}.copc.laz"));
        let limits = Limits {
            cell_points: 20_000,
            most_cells: 1 << 18,
            most_points: 30_000,
            held_points,
            kept_bytes: 0,
            most_in_place: u64::MAX,
        };
        save(std::slice::from_ref(&input), &output, &OVER, Some(&prepare), &|_, _, _| (), limits).unwrap();
        std::fs::read(output).unwrap()
    };
    let one_by_one = written(0);
    assert!(written(60_000) == one_by_one && written(u64::MAX) == one_by_one);
    std::fs::remove_dir_all(&folder).unwrap();
    assert_eq!(Limits::new(0).held_points, 1_000_000);
    assert!(Limits::new(1 << 40).held_points >= 1_000_000);
}

/// Returns normal and radius of each point, by index, of hills of `side`² points half a metre apart and at least 100 m
/// wide.
fn hill_splats(side: u64, limits: Limits) -> Vec<(DVec3, f64)> {
    let folder = std::env::temp_dir().join(format!("surfel-copc-borders-{}-{side}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let mut next = random(9);
    let point = |i: u64| {
        let mut jittered = |cell: u64| (cell * 50 + (next() >> 40) % 40) as f64;
        let (x, y) = (jittered(i % side), jittered(i / side));
        let z = 300.0 * (x / 900.0).sin() * (y / 1100.0).cos();
        [x, y, z].map(|v| v.round() as i32)
    };
    let points: Vec<[i32; 3]> = (0..side * side).map(point).collect();
    let mut bytes = las_of(&points);
    for (k, high) in [side as f64 * 0.5, side as f64 * 0.5, 10.0].into_iter().enumerate() {
        bytes[179 + 16 * k..187 + 16 * k].copy_from_slice(&high.to_le_bytes());
        bytes[187 + 16 * k..195 + 16 * k].copy_from_slice(&0_f64.to_le_bytes());
    }
    let (input, output) = (folder.join("in.las"), folder.join("out.copc.laz"));
    std::fs::write(&input, bytes).unwrap();
    let prepare = |cloud: &PointCloud| {
        let options = surfel_sample::PointOptions { ellipses: false, ..Default::default() };
        let made = surfel_sample::splats_from_points(cloud, &options, &surfel_sample::NoProgress);
        let (splats, _) = made.map_err(|e| e.to_string())?;
        let splat = |i: usize| {
            let normal = surfel_math::basis::unit(splats.normal(i)).as_vec3().to_array();
            PointSplat { normal, radius: splats.radius_max(i) as f32 }
        };
        Ok((0..splats.len()).map(splat).collect())
    };
    save(&[input], &output, &OVER, Some(&prepare), &|_, _, _| (), limits).unwrap();
    let loaded = crate::load(&output, &crate::LoadOptions::default()).unwrap();
    std::fs::remove_dir_all(&folder).unwrap();
    let crate::Content::Points(points) = loaded.content else { panic!("no points") };
    let column = |name: &str| &points.extras.iter().find(|e| e.name == name).unwrap().values;
    let (numbers, radii) = (column("gps_time"), column(RADIUS));
    let mut splats = vec![(DVec3::ZERO, 0.0); points.len()];
    for i in 0..points.len() {
        let normal = points.normals.as_ref().unwrap().get(i).normalize();
        splats[numbers.get(i) as usize] = (normal, radii.get(i));
    }
    splats
}

#[test]
fn splats_at_borders_of_parts_are_those_of_the_whole_cloud() {
    let side = 512;
    let whole = hill_splats(
        side,
        Limits {
            cell_points: 1_000_000,
            most_cells: 1 << 18,
            most_points: 1_000_000,
            held_points: 0,
            kept_bytes: 0,
            most_in_place: u64::MAX,
        },
    );
    // The grid has cells of 128² points, or a single cell of 512² points that is divided once or twice. Margins are at
    // least two points wide; those of real files are at least eight. Two are enough for all normals and 99 % of radii,
    // four for all radii. Radii are selected in f32 within a run of points, and runs differ between parts: two of
    // 262,144 radii differed by 4 %.
    for (cell_points, most_points, most_grown_share) in
        [(16_384, 100_000, 0.01), (262_144, 100_000, 1e-5), (262_144, 20_000, 0.01)]
    {
        let parts = hill_splats(
            side,
            Limits {
                cell_points,
                most_cells: 1 << 18,
                most_points,
                held_points: 0,
                kept_bytes: 0,
                most_in_place: u64::MAX,
            },
        );
        let (mut turned, mut grown) = (0, 0);
        let (mut most_turned, mut most_grown) = (0.0_f64, 0.0_f64);
        for ((normal, radius), (n, r)) in whole.iter().zip(&parts) {
            let degrees = normal.dot(*n).abs().min(1.0).acos().to_degrees();
            let ratio = (r / radius).ln().abs();
            turned += u32::from(degrees > 1.0);
            grown += u32::from(ratio > 0.01);
            (most_turned, most_grown) = (most_turned.max(degrees), most_grown.max(ratio));
        }
        let found = format!("{turned} turned by {most_turned:.4} at most, {grown} grown by e^{most_grown:.4}");
        let name = format!("cells of {cell_points}, parts of {most_points}");
        assert!(turned == 0 && f64::from(grown) <= most_grown_share * whole.len() as f64, "{name}: {found}");
    }
}

#[test]
fn levels_do_not_depend_on_how_many_points_are_in_memory() {
    let folder = std::env::temp_dir().join(format!("surfel-copc-limits-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let input = folder.join("in.las");
    std::fs::write(&input, las(300_000)).unwrap();
    let nodes = |most_points: u64| {
        let output = folder.join(format!("{most_points}.copc.laz"));
        let limits = Limits {
            cell_points: 100_000,
            most_cells: 1 << 18,
            most_points,
            held_points: most_points,
            kept_bytes: 0,
            most_in_place: u64::MAX,
        };
        save(std::slice::from_ref(&input), &output, &OVER, None, &|_, _, _| (), limits).unwrap();
        let copc = Copc::open(&output).unwrap().unwrap();
        copc.nodes().iter().map(|n| (n.level, n.cell, n.points)).collect::<Vec<_>>()
    };
    let at_once = nodes(1_000_000);
    assert!(at_once.len() > 8 && at_once.iter().map(|n| n.2).sum::<u64>() == 300_000);
    // A limit of 60,000 points divides cells, and one of 45,000 also divides their octants. The limit must exceed
    // `LEAF_POINTS`.
    assert_eq!(nodes(60_000), at_once);
    assert_eq!(nodes(45_000), at_once);
    std::fs::remove_dir_all(&folder).unwrap();
}

/// Writes `count` LAS files of tiles side by side, each 2048 steps wide, with correct bounds in their headers. For 12
/// tiles, cells of the grid are 512 steps wide. Tiles end 3 steps before a cell does, so that margins reach into the
/// next tile.
fn tiles(folder: &Path, count: u64, points: u64) -> Vec<PathBuf> {
    let mut next = random(11);
    let tile = |tile: u64| {
        let mut point = |i: u64| {
            // Dense in one place, sparse in others: octants above the parts have few points.
            let (x, y) = match i % 8 {
                0 => (next() >> 33, next() >> 33),
                _ => (next() >> 33 & 511, next() >> 33 & 511),
            };
            let low = [tile % 4 * 2048 + x % 2045, tile / 4 * 2048 + y % 2045, (next() >> 40) % 300];
            low.map(|v| v as i32)
        };
        let points: Vec<[i32; 3]> = (0..if tile % 3 == 1 { points / 50 } else { points }).map(&mut point).collect();
        let mut bytes = las_of(&points);
        for k in 0..3 {
            let end = |fold: fn(i32, i32) -> i32| points.iter().map(|p| p[k]).reduce(fold).unwrap();
            let mut put = |at: usize, v: i32| {
                bytes[at + 16 * k..at + 16 * k + 8].copy_from_slice(&(f64::from(v) * 0.01).to_le_bytes());
            };
            put(179, end(i32::max));
            put(187, end(i32::min));
        }
        let path = folder.join(format!("{tile}.las"));
        std::fs::write(&path, bytes).unwrap();
        path
    };
    (0..count).map(tile).collect()
}

/// Returns splats that depend on all points of `cloud` and on their order, so that a test detects any difference in
/// them.
fn of_neighbours(cloud: &PointCloud) -> Result<Vec<PointSplat>, String> {
    let middle = (0..cloud.len()).map(|i| cloud.positions.get(i)).sum::<DVec3>() / cloud.len() as f64;
    let splat = |i: usize| PointSplat { normal: [0.6, 0.0, 0.8], radius: (middle.length() + i as f64) as f32 };
    Ok((0..cloud.len()).map(splat).collect())
}

const TILE_LIMITS: Limits = Limits {
    cell_points: 5_000,
    most_cells: 1 << 18,
    most_points: 45_000,
    held_points: 50_000,
    kept_bytes: 0,
    most_in_place: u64::MAX,
};

fn folder_of_test(name: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("surfel-copc-{name}-{}", std::process::id()));
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    let mut names: Vec<String> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn shards_put_together_are_the_file_whatever_their_number() {
    let folder = folder_of_test("shards");
    let inputs = tiles(&folder, 12, 50_000);
    let make = |output: &Path, shard: Option<[u32; 2]>, prepare: Prepare<'_>| {
        let options = CopcOptions { shard, ..OVER };
        save(&inputs, output, &options, Some(prepare), &|_, _, _| (), TILE_LIMITS).unwrap()
    };
    for (kind, prepare) in
        [("own", &of_neighbours as Prepare<'_>), ("none", &|c| Ok(vec![PointSplat::default(); c.len()]))]
    {
        let whole = folder.join(format!("{kind}.copc.laz"));
        let report = make(&whole, None, prepare);
        assert!(report.levels >= 5 && report.points > 300_000, "{report:?}");
        for count in if kind == "own" { &[1, 2, 3, 7, 40][..] } else { &[2] } {
            let count = *count;
            let shard = |i: u32| {
                let path = folder.join(format!("{kind}-{count}-{i:02}.shard"));
                (make(&path, Some([i, count]), prepare).points, path)
            };
            let (points, mut paths): (Vec<u64>, Vec<PathBuf>) = (0..count).map(shard).unzip();
            if count == 3 {
                // Shards have similar sizes if bounds are good estimates; these tiles are dense in corners.
                assert!(points.iter().all(|points| points * 10 > report.points), "{points:?}");
            }
            paths.reverse();
            let merged = folder.join("merged.copc.laz");
            let made = save_copc(&paths, &merged, &OVER, None, &|_, _, _| ()).unwrap();
            assert_eq!((made.points, made.nodes, made.levels), (report.points, report.nodes, report.levels));
            assert!(std::fs::read(&merged).unwrap() == std::fs::read(&whole).unwrap(), "{kind}, {count} shards");
        }
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn shards_of_points_in_all_of_a_cube_are_put_together() {
    let folder = folder_of_test("cube");
    let mut next = random(13);
    let mut point = |i: u64| match i {
        0 => [0; 3],
        1 => [4_095; 3],
        _ => [next() >> 40, next() >> 40, next() >> 40].map(|v| (v % 4_096) as i32),
    };
    let mut bytes = las_of(&(0..60_000).map(&mut point).collect::<Vec<_>>());
    let bounds = |bytes: &mut [u8], [low, high]: [f64; 2]| {
        for k in 0..3 {
            bytes[179 + 16 * k..187 + 16 * k].copy_from_slice(&(high * 0.01).to_le_bytes());
            bytes[187 + 16 * k..195 + 16 * k].copy_from_slice(&(low * 0.01).to_le_bytes());
        }
    };
    let input = folder.join("in.las");
    // If these points formed a surface, this cube would have 4096 of their cells.
    let limits = Limits { cell_points: 300, most_cells: 1_000, ..TILE_LIMITS };
    let make = |output: &Path, shard: Option<[u32; 2]>| {
        let options = CopcOptions { shard, ..OVER };
        save(std::slice::from_ref(&input), output, &options, Some(&of_neighbours), &|_, _, _| (), limits)
    };
    let (whole, merged) = (folder.join("whole.copc.laz"), folder.join("merged.copc.laz"));
    let paths: Vec<PathBuf> = (0..3).map(|i| folder.join(format!("{i}.shard"))).collect();
    let mut both = |low_and_high: [f64; 2]| {
        bounds(&mut bytes, low_and_high);
        std::fs::write(&input, &bytes).unwrap();
        make(&whole, None).unwrap();
        (0..3).for_each(|i| drop(make(&paths[i as usize], Some([i, 3])).unwrap()));
        save_copc(&paths, &merged, &OVER, None, &|_, _, _| ()).unwrap()
    };
    let made = both([0.0, 4_095.0]);
    assert!(std::fs::read(&merged).unwrap() == std::fs::read(&whole).unwrap() && made.notes.is_empty());
    // Wider bounds give a note.
    let made = both([-9_000.0, 9_000.0]);
    assert!(made.points == 60_000 && made.notes[0].contains("wider bounds than their points"), "{made:?}");
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn shard_of_the_same_inputs_is_left_as_it_is() {
    let folder = folder_of_test("done");
    let inputs = tiles(&folder, 3, 3_000);
    let path = folder.join("a.shard");
    let run = |inputs: &[PathBuf], shard: [u32; 2], overwrite: bool| {
        let options = CopcOptions { shard: Some(shard), resume: true, overwrite, memory: 0, columns: None };
        save(inputs, &path, &options, None, &|_, _, _| (), TILE_LIMITS).map_err(|error| error.to_string())
    };
    let report = run(&inputs, [1, 2], false).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    assert_eq!(run(&inputs, [1, 2], false).unwrap(), report);
    for (inputs, shard, says) in [
        (&inputs[..], [0, 2], "is shard 1 of 2\n  expected: shard 0 of 2"),
        (&inputs[..], [1, 3], "is shard 1 of 2\n  expected: shard 1 of 3"),
        (&inputs[1..], [1, 2], "is a shard of other inputs"),
    ] {
        let told = run(inputs, shard, false).unwrap_err();
        assert!(told.contains(says) && told.contains("delete it"), "{told}");
    }
    let later = std::time::SystemTime::now() + std::time::Duration::from_secs(3600);
    File::options().write(true).open(&inputs[2]).unwrap().set_modified(later).unwrap();
    let told = run(&inputs, [1, 2], false).unwrap_err();
    assert!(told.contains("is older than") && told.contains("2.las"), "{told}");
    assert!(std::fs::read(&path).unwrap() == bytes);
    assert_eq!(run(&inputs, [1, 2], true).unwrap(), report);
    std::fs::write(&path, "x").unwrap();
    assert!(run(&inputs, [1, 2], false).unwrap_err().contains("is no shard of a conversion"));
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn shares_that_are_not_one_conversion_are_refused() {
    let folder = folder_of_test("unlike");
    let inputs = tiles(&folder, 4, 3_000);
    let shard = |inputs: &[PathBuf], i: u32, count: u32| {
        let path = folder.join(format!("{}-{i}-{count}.shard", inputs.len()));
        let options = CopcOptions { shard: Some([i, count]), ..OVER };
        save(inputs, &path, &options, None, &|_, _, _| (), TILE_LIMITS).unwrap();
        path
    };
    let [a, b, c, d] = [shard(&inputs, 0, 2), shard(&inputs, 1, 2), shard(&inputs[1..], 1, 2), shard(&inputs, 2, 3)];
    let output = folder.join("out.copc.laz");
    let refused = |paths: &[&PathBuf]| {
        let paths: Vec<PathBuf> = paths.iter().map(|path| (*path).clone()).collect();
        let told = save_copc(&paths, &output, &OVER, None, &|_, _, _| ()).unwrap_err().to_string();
        assert!(!output.exists() && told.lines().count() <= 4, "{told}");
        told
    };
    assert!(refused(&[&a]).contains("expected 2"));
    assert!(refused(&[&a, &a]).contains("is shard 0 of 2, and 1 is not there once"));
    assert!(refused(&[&a, &c]).contains("of another conversion"));
    assert!(refused(&[&a, &d]).contains("of another conversion"));
    assert!(refused(&[&a, &inputs[0]]).contains("is no shard of a conversion"));
    // Cut off or changed anywhere: an error, or the points of all shards.
    let whole = std::fs::read(&b).unwrap();
    for at in [8, 12, 20, 300, whole.len() / 2, whole.len() - 1] {
        std::fs::write(&b, &whole[..at]).unwrap();
        refused(&[&a, &b]);
    }
    let mut next = random(5);
    for _ in 0..300 {
        let mut changed = whole.clone();
        let at = 8 + (next() >> 33) as usize % (whole.len() - 8);
        changed[at] = (next() >> 33) as u8;
        std::fs::write(&b, changed).unwrap();
        let _ = save_copc(&[a.clone(), b.clone()], &output, &OVER, None, &|_, _, _| ());
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn point_outside_of_its_header_is_refused_in_a_share() {
    let folder = folder_of_test("outside");
    let inputs = tiles(&folder, 4, 3_000);
    let mut bytes = std::fs::read(&inputs[1]).unwrap();
    bytes[375..379].copy_from_slice(&100_i32.to_le_bytes());
    std::fs::write(&inputs[1], bytes).unwrap();
    let output = folder.join("out");
    let told = (0..3).filter_map(|i| {
        let options = CopcOptions { shard: Some([i, 3]), ..OVER };
        let made = save(&inputs, &output, &options, None, &|_, _, _| (), TILE_LIMITS);
        made.err().map(|error| error.to_string())
    });
    let told: Vec<String> = told.collect();
    assert!(
        !told.is_empty() && told.iter().all(|told| told.contains("outside of the bounds in its header")),
        "{told:?}"
    );
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn interrupted_conversions_go_on_and_give_the_same_file() {
    let folder = folder_of_test("resume");
    let inputs = tiles(&folder, 6, 40_000);
    let before = names(&folder);
    for shard in [None, Some([1, 2])] {
        let output = folder.join("out");
        let prepared = AtomicUsize::new(0);
        let run = |resume: bool, progress: &dyn Fn(&'static str, u64, u64)| {
            let options = CopcOptions { overwrite: false, memory: 0, resume, shard, columns: None };
            let prepare = |cloud: &PointCloud| {
                prepared.fetch_add(1, Ordering::Relaxed);
                of_neighbours(cloud)
            };
            save(&inputs, &output, &options, Some(&prepare), progress, TILE_LIMITS)
        };
        let counted = std::cell::Cell::new(0);
        // Counts the progress reports of all stages but the last, for which two interruptions are enough.
        let count = |name: &'static str, _: u64, _: u64| {
            counted.set(counted.get() + if name == "writing the file" { 0 } else { 1 });
        };
        let report = run(false, &count).unwrap();
        let (moments, parts) = (counted.get(), prepared.load(Ordering::Relaxed));
        let whole = std::fs::read(&output).unwrap();
        std::fs::remove_file(&output).unwrap();
        let mut after = Vec::new();
        for moment in 0..moments + 2 {
            let until = |most: i32| {
                let steps = std::cell::Cell::new(0);
                let progress = |_: &'static str, _: u64, _: u64| {
                    steps.set(steps.get() + 1);
                    assert!(steps.get() <= most, "interrupted");
                };
                std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| run(true, &progress)))
            };
            assert!(until(moment).is_err(), "{moment}");
            assert!(!output.exists());
            // Appends bytes that a killed run wrote after the last state, and a half-written state file.
            let kept = resume_folder(&output);
            for name in [resume::POINTS, resume::MARGINS, resume::CHUNKS, resume::UPPER] {
                let file = std::fs::OpenOptions::new().append(true).open(kept.join(name));
                file.and_then(|mut file| file.write_all(&[7; 1000])).unwrap();
            }
            std::fs::write(kept.join("built.json.new"), "{").unwrap();
            // A second interruption, then the rest.
            prepared.store(0, Ordering::Relaxed);
            let second = until(2);
            let resumed = if second.is_err() { until(i32::MAX) } else { second };
            assert_eq!(resumed.unwrap().unwrap(), report);
            after.push(prepared.load(Ordering::Relaxed));
            assert!(std::fs::read(&output).unwrap() == whole, "{shard:?}, interrupted at {moment} of {moments}");
            std::fs::remove_file(&output).unwrap();
            assert_eq!(names(&folder), before);
        }
        // After the first moment all parts are made again, after some later ones only some parts, after the last none.
        assert!(after.first().is_some_and(|made| *made >= parts) && after.last() == Some(&0), "{after:?} of {parts}");
        assert!(after.iter().any(|made| (1..parts).contains(made)), "{after:?} of {parts}");
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn progress_of_a_resumed_shard_ends_at_its_total() {
    let folder = folder_of_test("progress");
    let inputs = tiles(&folder, 12, 20_000);
    let output = folder.join("last.shard");
    // The last shard needs only some inputs. By these limits, the state is saved after each input.
    let options = CopcOptions { shard: Some([2, 3]), resume: true, ..CopcOptions::default() };
    let sorted = std::cell::Cell::new((0, 0));
    let run = |interrupts: bool| {
        let progress = |name: &'static str, done: u64, all: u64| {
            if name == "sorting points" {
                assert!(done <= all, "{done} of {all}");
                assert!(!interrupts || 2 * done < all, "interrupted");
                sorted.set((done, all));
            }
        };
        let run = || save(&inputs, &output, &options, None, &progress, TILE_LIMITS);
        std::panic::catch_unwind(std::panic::AssertUnwindSafe(run))
    };
    assert!(run(true).is_err());
    let (done, all) = sorted.get();
    assert!(0 < done && done < all, "{done} of {all}");
    run(false).unwrap().unwrap();
    let (done, all) = sorted.get();
    assert_eq!(done, all);
    std::fs::remove_dir_all(&folder).unwrap();
}

/// Returns the error of a resumed conversion: the first run is interrupted at `stage`, then `change` edits its folder.
fn refused_after((test, points): (&str, u64), stage: &str, change: impl FnOnce(&Path)) -> IoError {
    let folder = folder_of_test(test);
    let inputs = tiles(&folder, 3, points);
    let output = folder.join("out.copc.laz");
    let resume = CopcOptions { resume: true, ..CopcOptions::default() };
    let interrupt = |name: &'static str, _: u64, _: u64| assert!(name != stage, "interrupted");
    let first = || save(&inputs, &output, &resume, None, &interrupt, TILE_LIMITS);
    std::panic::catch_unwind(std::panic::AssertUnwindSafe(first)).unwrap_err();
    change(&resume_folder(&output));
    let error = save(&inputs, &output, &resume, None, &|_, _, _| (), TILE_LIMITS).unwrap_err();
    assert!(!output.exists() && error.is_bad_input(), "{error}");
    std::fs::remove_dir_all(&folder).unwrap();
    error
}

#[test]
fn changed_state_of_an_interrupted_conversion_is_refused() {
    let flip = |name: &'static str, at: usize| {
        move |folder: &Path| {
            let mut bytes = std::fs::read(folder.join(name)).unwrap();
            bytes[at] ^= 4;
            std::fs::write(folder.join(name), bytes).unwrap();
        }
    };
    // All points are in a node above the parts. Chunks written after the last state are written again.
    for (stage, name, at, part) in [
        ("building the octree", resume::POINTS, 12_345, "has changed: bytes from"),
        ("writing the file", resume::UPPER, 1_000, "has changed: bytes from"),
        ("writing the file", resume::SORTED, 40, "has a changed or damaged sorted.json"),
        ("writing the file", resume::BUILT, 11, "has a changed or damaged built.json"),
    ] {
        let error = refused_after(("changed", 3_000), stage, flip(name, at)).to_string();
        assert!(error.contains(part) && error.contains("delete this folder to start anew"), "{name}: {error}");
    }
}

#[cfg(unix)]
#[test]
fn links_in_the_folder_of_an_interrupted_conversion_are_refused() {
    use std::os::unix::fs::{PermissionsExt, symlink};
    let precious = std::env::temp_dir().join(format!("surfel-precious-{}", std::process::id()));
    std::fs::write(&precious, "precious").unwrap();
    let replace = |name: &'static str, link: fn(&Path, &Path)| {
        let precious = precious.clone();
        move |folder: &Path| {
            let _ = std::fs::remove_file(folder.join(name));
            link(&precious, &folder.join(name));
        }
    };
    let stage = "writing the file";
    for name in [resume::POINTS, resume::BUILT, "lock", "built.json.new"] {
        let soft =
            refused_after(("soft", 3_000), stage, replace(name, |to, from| symlink(to, from).unwrap())).to_string();
        let hard =
            refused_after(("hard", 3_000), stage, replace(name, |to, from| std::fs::hard_link(to, from).unwrap()));
        for error in [soft, hard.to_string()] {
            assert!(error.contains(&format!("holds {name}, which is a link or no file")), "{error}");
        }
    }
    let error = refused_after(("elsewhere", 3_000), stage, |folder| {
        let other = folder.with_extension("elsewhere");
        std::fs::rename(folder, &other).unwrap();
        symlink(&other, folder).unwrap();
    });
    assert!(error.to_string().contains("is a link or a file, expected a folder"), "{error}");
    let error = refused_after(("shared", 3_000), stage, |folder| {
        std::fs::set_permissions(folder, std::fs::Permissions::from_mode(0o777)).unwrap();
    });
    assert!(error.to_string().contains("can be written to by other users"), "{error}");
    assert_eq!(std::fs::read(&precious).unwrap(), b"precious");
    std::fs::remove_file(&precious).unwrap();
}

#[test]
fn what_an_interrupted_conversion_left_is_of_that_conversion_only() {
    let folder = folder_of_test("manifest");
    let inputs = tiles(&folder, 3, 3_000);
    let output = folder.join("out.copc.laz");
    let run = |inputs: &[PathBuf], options: &CopcOptions, fails: bool| {
        let progress =
            |name: &'static str, _: u64, _: u64| assert!(!fails || name != "writing the file", "interrupted");
        let run = || save(inputs, &output, options, None, &progress, TILE_LIMITS);
        std::panic::catch_unwind(std::panic::AssertUnwindSafe(run)).map_err(drop)
    };
    let resume = CopcOptions { resume: true, ..CopcOptions::default() };
    let refused = |inputs: &[PathBuf], options: &CopcOptions| {
        let told = run(inputs, options, false).unwrap().unwrap_err().to_string();
        assert!(told.lines().count() <= 4 && !output.exists(), "{told}");
        told
    };
    assert!(run(&inputs, &resume, true).is_err());
    let told = refused(&inputs[..2], &resume);
    assert!(told.contains("3 inputs") && told.contains("2 inputs") && told.contains("delete this folder"), "{told}");
    assert!(refused(&inputs, &CopcOptions { shard: Some([0, 2]), ..resume.clone() }).contains("`shard=0/2`"));
    let bytes = std::fs::read(&inputs[1]).unwrap();
    std::fs::write(&inputs[1], &bytes).unwrap();
    let time = std::time::SystemTime::UNIX_EPOCH + std::time::Duration::from_secs(77);
    File::options().write(true).open(&inputs[1]).unwrap().set_modified(time).unwrap();
    assert!(refused(&inputs, &resume).contains("changed at 77.000000000"));
    // Without the flag the folder stays unchanged and valid.
    let kept = names(&resume_folder(&output));
    run(&inputs, &CopcOptions::default(), false).unwrap().unwrap();
    assert_eq!(names(&resume_folder(&output)), kept);
    std::fs::remove_file(&output).unwrap();
    std::fs::remove_dir_all(resume_folder(&output)).unwrap();
    // Damage is reported, another conversion's folder isn't touched, and two runs don't share a folder.
    assert!(run(&inputs, &resume, true).is_err());
    std::fs::write(resume_folder(&output).join(resume::SORTED), "{\"inputs\":").unwrap();
    assert!(refused(&inputs, &resume).contains("has a changed or damaged sorted.json"));
    std::fs::remove_dir_all(resume_folder(&output)).unwrap();
    assert!(run(&inputs, &resume, true).is_err());
    std::fs::write(resume_folder(&output).join(resume::POINTS), "").unwrap();
    assert!(refused(&inputs, &resume).contains("has 0 bytes in its file points"));
    std::fs::remove_dir_all(resume_folder(&output)).unwrap();
    std::fs::create_dir(resume_folder(&output)).unwrap();
    std::fs::write(resume_folder(&output).join("thesis.txt"), "x").unwrap();
    assert!(refused(&inputs, &resume).contains("holds thesis.txt"));
    std::fs::remove_dir_all(resume_folder(&output)).unwrap();
    let held = ResumeFolder::open(&output, &Manifest::new(&inputs, false, &CopcOptions::default()).unwrap()).unwrap();
    assert!(refused(&inputs, &resume).contains("another run with `resume` is writing it"));
    // A run that was killed after the output appeared but before its folder was removed counts as done.
    let report = run(&inputs, &CopcOptions::default(), false).unwrap().unwrap();
    held.written(std::fs::metadata(&output).unwrap().len(), &report).unwrap();
    drop(held);
    assert_eq!(run(&inputs, &resume, false).unwrap().unwrap(), report);
    assert!(!resume_folder(&output).exists());
    assert!(matches!(run(&inputs, &resume, false).unwrap(), Err(IoError::Exists { .. })));
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn octants_are_divided_however_few_steps_points_are_apart() {
    let folder = std::env::temp_dir().join(format!("surfel-copc-steps-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let (input, output) = (folder.join("in.las"), folder.join("out.copc.laz"));
    for apart in [1, 3, 1000] {
        let points: Vec<[i32; 3]> = (0..1 << 18).map(|i| [i % 512 * apart, i / 512 * apart, 0]).collect();
        let mut bytes = las_of(&points);
        for k in 0..3 {
            let high = if k == 2 { 0.0 } else { 512.0 * 0.01 * f64::from(apart) };
            bytes[179 + 16 * k..187 + 16 * k].copy_from_slice(&high.to_le_bytes());
            bytes[187 + 16 * k..195 + 16 * k].copy_from_slice(&0_f64.to_le_bytes());
        }
        std::fs::write(&input, bytes).unwrap();
        let limits = Limits {
            cell_points: 100_000,
            most_cells: 1 << 18,
            most_points: 300_000,
            held_points: 0,
            kept_bytes: 0,
            most_in_place: u64::MAX,
        };
        save(std::slice::from_ref(&input), &output, &OVER, None, &|_, _, _| (), limits).unwrap();
        let copc = Copc::open(&output).unwrap().unwrap();
        let most = copc.nodes().iter().map(|node| node.points).max();
        assert!(most.is_some_and(|most| most <= LEAF_POINTS), "{apart} steps apart: {most:?}");
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn values_of_levels_are_read_of_the_nodes_that_want_them() {
    let folder = std::env::temp_dir().join(format!("surfel-copc-level-values-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let (input, output) = (folder.join("in.las"), folder.join("out.copc.laz"));
    std::fs::write(&input, colored(&las(150_000))).unwrap();
    let prepare = |cloud: &PointCloud| {
        let splat = |i: usize| {
            let at = cloud.positions.get(i);
            let normal = DVec3::new(at.x.sin(), at.y.cos(), 1.0).normalize().as_vec3().to_array();
            PointSplat { normal, radius: 0.1 + at.x.abs() as f32 }
        };
        Ok((0..cloud.len()).map(splat).collect())
    };
    let limits = Limits {
        cell_points: 50_000,
        most_cells: 1 << 18,
        most_points: 100_000,
        held_points: 0,
        kept_bytes: 0,
        most_in_place: u64::MAX,
    };
    save(&[input], &output, &OVER, Some(&prepare), &|_, _, _| (), limits).unwrap();
    let copc = Copc::open(&output).unwrap().unwrap();
    let nodes: Vec<u32> = (0..copc.nodes().len() as u32).collect();
    let read = |values: &[LevelValues]| {
        let found = copc.points_of(&nodes, NodeColumns::Splats(values), &crate::LoadOptions::default()).unwrap();
        let crate::Content::Points(points) = found.loaded.content else { panic!("no points") };
        (points, found.ends)
    };
    let values = |points: &PointCloud, name: &str, i: usize| {
        points.extras.iter().find(|e| e.name == name).map_or(0.0, |e| e.values.get(i))
    };
    let marked = 3;
    let one = |value: LevelValues| {
        let values = nodes.iter().map(|i| if *i == marked { value } else { LevelValues::Without });
        read(&values.collect::<Vec<_>>()).0
    };
    let (whole, ends) = read(&vec![LevelValues::With; nodes.len()]);
    let of_marked = ends[marked as usize - 1]..ends[marked as usize];
    assert!(nodes.len() > 5 && !of_marked.is_empty());
    for value in [LevelValues::With, LevelValues::Alone, LevelValues::Without] {
        let points = one(value);
        assert!(points.positions == whole.positions);
        let mut seen = 0;
        for i in 0..whole.len() {
            let is_left_out = value == LevelValues::Alone && of_marked.contains(&i);
            let own =
                |points: &PointCloud| (points.normals.as_ref().unwrap().get(i), points.colors.as_ref().unwrap()[i]);
            let expected = if is_left_out { (DVec3::ZERO, [0.0; 3]) } else { own(&whole) };
            assert_eq!(own(&points), expected, "{value:?} of {i}");
            assert_eq!(values(&points, RADIUS, i), values(&whole, RADIUS, i));
            for name in LEVEL_NORMALS.iter().chain(&LEVEL_COLORS) {
                let wanted = value != LevelValues::Without && of_marked.contains(&i);
                let expected = if wanted { values(&whole, name, i) } else { 0.0 };
                assert_eq!(values(&points, name, i), expected, "{name} of {i}");
                seen += u32::from(wanted && expected != 0.0);
            }
        }
        assert_eq!(seen > 0, value != LevelValues::Without);
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

//! COPC files: written from LAS and LAZ, read back without loss, and read node by node.

#![cfg(all(feature = "las", feature = "laz"))]

use crate::support;

use ::las::{Point, Reader};
use glam::DVec3;
use std::path::{Path, PathBuf};
use support::{OFFSET, STEP, las_file, vlr};
use surfel_io::copc::{Copc, CopcOptions, NodeColumns, PointFilter, PointSplat, Prepare, save_copc};
use surfel_io::{Content, LoadOptions, load};
use surfel_model::PointCloud;

/// Number of points of a test file. They are on a bent sheet, so that LOD levels resemble those of scans.
const COUNT: usize = 120_000;
const OVER: CopcOptions = CopcOptions { overwrite: true, memory: 1 << 30, resume: false, shard: None, columns: None };

fn sheet(p: &mut Point, i: usize) {
    let (x, y) = ((i % 400) as f64, (i / 400) as f64);
    p.x = OFFSET[0] + x * 0.1;
    p.y = OFFSET[1] + y * 0.1;
    p.z = OFFSET[2] + ((x * 0.02).sin() * 2.0 / STEP).round() * STEP;
}

fn las_bytes(minor: u8, format: u8, extra: u16, packed: bool, range: std::ops::Range<usize>) -> Vec<u8> {
    // The time identifies the point.
    let place = |p: &mut Point| {
        let i = ((p.gps_time.unwrap() - 1e8) * 1e6).round() as usize;
        sheet(p, i);
    };
    let crs = vlr("LASF_Projection", 2112, b"PROJCS[\"t\",AUTHORITY[\"EPSG\",\"26910\"]]\0".to_vec());
    las_file((minor, format, extra, packed), vec![crs], range, place)
}

fn points_of(path: &Path) -> Vec<Point> {
    let mut reader = Reader::from_path(path).unwrap();
    let mut points: Vec<Point> = reader.read_all().unwrap().points().map(Result::unwrap).collect();
    points.sort_by(|a, b| a.gps_time.partial_cmp(&b.gps_time).unwrap());
    points
}

fn written(folder: &Path, files: &[Vec<u8>], prepare: bool) -> PathBuf {
    let inputs: Vec<PathBuf> = (0..files.len()).map(|i| folder.join(format!("{i}.las"))).collect();
    inputs.iter().zip(files).for_each(|(path, bytes)| std::fs::write(path, bytes).unwrap());
    let output = folder.join("out.copc.laz");
    let splats = |points: &PointCloud| -> Result<Vec<PointSplat>, String> {
        assert!(points.bounds().is_some_and(|(low, _)| low.x > 6e5));
        Ok(vec![PointSplat { normal: [0.0, 0.6, 0.8], radius: 0.123 }; points.len()])
    };
    let report = save_copc(&inputs, &output, &OVER, prepare.then_some(&splats as Prepare<'_>), &|_, _, _| ()).unwrap();
    assert!(report.nodes > 1 && report.levels > 1, "{report:?}");
    output
}

#[test]
fn every_point_comes_back_once_with_all_its_columns() {
    for (minor, format, extra, prepare) in
        [(4, 7, 0, true), (4, 7, 3, true), (2, 3, 0, false), (1, 1, 2, true), (4, 6, 0, false)]
    {
        let folder = tempfile::tempdir().unwrap();
        let half = COUNT / 3;
        let files =
            [las_bytes(minor, format, extra, false, 0..half), las_bytes(minor, format, extra, true, half..COUNT)];
        let output = written(folder.path(), &files, prepare);
        let truth: Vec<Point> = (0..2).flat_map(|i| points_of(&folder.path().join(format!("{i}.las")))).collect();
        let found = points_of(&output);
        assert_eq!(found.len(), truth.len());
        for (a, b) in found.iter().zip(&truth) {
            let own: Vec<u8> = a.extra_bytes.iter().copied().take(usize::from(extra)).collect();
            // Positions are whole steps, so equal positions are equal numbers in the files.
            let mut same = Point { extra_bytes: own, ..a.clone() };
            if format < 6 {
                assert!((same.scan_angle - b.scan_angle).abs() <= 0.003);
                same.scan_angle = b.scan_angle;
            }
            assert_eq!(&same, b);
            if prepare && !a.is_withheld {
                let radius = f32::from_le_bytes(a.extra_bytes[usize::from(extra)..][..4].try_into().unwrap());
                assert!((0.123..0.1245).contains(&radius), "{radius}");
                assert_eq!(&a.extra_bytes[usize::from(extra) + 4..][..3], &[0, 76, 102]);
            }
        }
        let loaded = load(&output, &LoadOptions::default()).unwrap();
        assert!(loaded.notes.iter().any(|note| note.contains("EPSG:26910")), "{:?}", loaded.notes);
    }
}

#[test]
fn nodes_hold_what_is_in_their_cubes_and_the_file_is_the_same_for_any_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let files = [las_bytes(4, 7, 0, true, 0..COUNT)];
    let bytes = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        std::fs::read(pool.install(|| written(folder.path(), &files, true))).unwrap()
    };
    let first = bytes(1);
    assert_eq!(first, bytes(4));
    let output = folder.path().join("out.copc.laz");
    let copc = Copc::open(&output).unwrap().unwrap();
    assert_eq!((copc.points(), copc.header_points()), (COUNT as u64, COUNT as u64));
    let all: Vec<u32> = (0..copc.nodes().len() as u32).collect();
    let mut seen = 0;
    for i in &all {
        let node = &copc.nodes()[*i as usize];
        let (center, half) = copc.cube(node);
        let found = copc.points_of(&[*i], NodeColumns::All, &LoadOptions::default());
        if node.points == 0 {
            continue;
        }
        let found = found.unwrap();
        let Content::Points(points) = found.loaded.content else { panic!() };
        seen += points.len();
        for k in 0..points.len() {
            let p = points.origin + points.positions.get(k);
            // The cube itself may be rounded by a step.
            assert!(((p - center).abs() - half).max_element() <= STEP, "{p} {center} {half}");
            assert_eq!(Copc::cell_above(copc.cell_of(p + DVec3::splat(1e-4)), node.level), node.cell);
        }
    }
    // All nodes read at once give the same points as one by one, and as the plain LAZ reader.
    let whole = copc.points_of(&all, NodeColumns::All, &LoadOptions::default()).unwrap();
    let Content::Points(points) = &whole.loaded.content else { panic!() };
    assert_eq!((points.len(), whole.ends.last()), (seen, Some(&seen)));
    let plain = load(&output, &LoadOptions::default()).unwrap();
    assert_eq!(plain.content, whole.loaded.content);
}

#[test]
fn points_that_are_not_kept_change_nothing_of_those_that_are() {
    let folder = tempfile::tempdir().unwrap();
    let output = written(folder.path(), &[las_bytes(4, 7, 0, true, 0..COUNT)], true);
    let copc = Copc::open(&output).unwrap().unwrap();
    assert!(copc.has_splats());
    let all: Vec<u32> = (0..copc.nodes().len() as u32).collect();
    let read = |keeps: Option<PointFilter<'_>>| {
        let columns = NodeColumns::Splats(&[]);
        let found = copc.kept_points_of(&all, (columns, keeps), &LoadOptions::default()).unwrap();
        let Content::Points(points) = found.loaded.content else { panic!() };
        (points, found.ends)
    };
    let (whole, ends) = read(None);
    let is_kept = |at: DVec3| at.x < OFFSET[0] + 7.02;
    let (some, some_ends) = read(Some(&|level, at, radius| {
        // The filter isn't called for withheld points.
        assert!((radius == 0.0 || (0.123..0.1245).contains(&radius)) && level < 20, "{radius} {level}");
        is_kept(at)
    }));
    let at = |points: &PointCloud, i: usize| points.origin + points.positions.get(i);
    let kept: Vec<usize> = (0..whole.len()).filter(|i| is_kept(at(&whole, *i))).collect();
    assert!(some.len() == kept.len() && some.len() < COUNT / 4, "{}", some.len());
    for (i, j) in kept.iter().enumerate() {
        assert!((at(&some, i) - at(&whole, *j)).length() < 0.1 * STEP);
        assert_eq!(some.colors.as_ref().unwrap()[i], whole.colors.as_ref().unwrap()[*j]);
        assert_eq!(some.normals.as_ref().unwrap().get(i), whole.normals.as_ref().unwrap().get(*j));
    }
    let expected: Vec<usize> = ends.iter().map(|end| kept.partition_point(|i| i < end)).collect();
    assert_eq!(some_ends, expected);
    // The result is never empty.
    let first = ends.iter().find(|end| **end > 0).unwrap();
    assert_eq!(read(Some(&|_, _, _| false)).0.len(), *first);
}

#[test]
fn inputs_that_do_not_go_together_or_are_damaged_leave_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let (a, b, output) = (folder.path().join("a.las"), folder.path().join("b.laz"), folder.path().join("o.copc.laz"));
    std::fs::write(&a, las_bytes(4, 7, 0, false, 0..3000)).unwrap();
    let good = las_bytes(4, 7, 0, true, 3000..6000);
    let refused = |bytes: &[u8], what: &str| {
        std::fs::write(&b, bytes).unwrap();
        let error = save_copc(&[a.clone(), b.clone()], &output, &CopcOptions::default(), None, &|_, _, _| ())
            .unwrap_err()
            .to_string();
        assert!(error.contains("b.laz") && error.contains(what) && error.lines().count() <= 4, "{error}");
        let left: Vec<_> = std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
        assert_eq!(left.len(), 2, "{left:?}");
    };
    refused(&las_bytes(4, 6, 0, true, 0..9), "points of format 6");
    refused(&las_bytes(4, 7, 2, true, 0..9), "extra bytes");
    refused(&good[..good.len() / 2], "cut off");
    refused(b"ply\n", "does not end");
    refused(b"solid\n", "holds nothing that can be written as COPC");
    let mut scaled = good.clone();
    scaled[131..139].copy_from_slice(&0.01_f64.to_le_bytes());
    refused(&scaled, "coordinate scale");
    let mut moved = good.clone();
    moved[155..163].copy_from_slice(&(OFFSET[0] + 0.0004).to_le_bytes());
    refused(&moved, "whole number of steps");
    // Whole steps between offsets are accepted, and so is a header with wrong bounds.
    let mut moved = good;
    moved[155..163].copy_from_slice(&(OFFSET[0] - 700.0).to_le_bytes());
    moved[179..227].fill(0);
    std::fs::write(&b, &moved).unwrap();
    let report = save_copc(&[a.clone(), b.clone()], &output, &CopcOptions::default(), None, &|_, _, _| ()).unwrap();
    assert_eq!(report.points, 6000);
    let (low, high) = match load(&output, &LoadOptions::default()).unwrap().content {
        Content::Points(points) => points.bounds().unwrap(),
        _ => panic!(),
    };
    assert!(high.x - low.x > 690.0 && low.x < OFFSET[0] - 650.0);
}

#[test]
fn hostile_hierarchies_are_one_clear_error() {
    let folder = tempfile::tempdir().unwrap();
    let good = std::fs::read(written(folder.path(), &[las_bytes(4, 7, 0, true, 0..COUNT)], false)).unwrap();
    let path = folder.path().join("hostile.copc.laz");
    let number = |at: usize| u64::from_le_bytes(good[at..at + 8].try_into().unwrap()) as usize;
    let (root, length) = (number(429 + 40), number(429 + 48));
    assert!(length >= 96);
    let refused = |change: &dyn Fn(&mut Vec<u8>), what: &str| {
        let mut bytes = good.clone();
        change(&mut bytes);
        std::fs::write(&path, &bytes).unwrap();
        let error = Copc::open(&path).unwrap_err().to_string();
        assert!(error.contains("hostile.copc.laz: ") && error.contains(what), "{what}: {error}");
        assert!(error.lines().count() <= 4, "{error}");
    };
    let put = |bytes: &mut Vec<u8>, at: usize, new: &[u8]| bytes[at..at + new.len()].copy_from_slice(new);
    // Layout of an entry: level, x, y, z, offset, bytes and points.
    let entry = root + 32;
    refused(&|b| put(b, entry + 28, &i32::MAX.to_le_bytes()), "hold");
    refused(&|b| put(b, entry + 28, &i32::MIN.to_le_bytes()), "points in");
    refused(&|b| put(b, entry + 24, &(-5_i32).to_le_bytes()), "points in -5 bytes");
    refused(&|b| put(b, entry + 24, &i32::MAX.to_le_bytes()), "in 2147483647 bytes");
    refused(&|b| put(b, entry + 16, &u64::MAX.to_le_bytes()), "at byte 18446744073709551615");
    refused(&|b| put(b, entry + 16, &1_u64.to_le_bytes()), "at byte 1");
    refused(&|b| put(b, entry, &31_i32.to_le_bytes()), "no octant");
    refused(&|b| put(b, entry, &(-1_i32).to_le_bytes()), "no octant");
    refused(&|b| put(b, entry + 4, &9_i32.to_le_bytes()), "no octant");
    refused(&|b| put(b, entry, &5_i32.to_le_bytes()), "none above it");
    refused(&|b| put(b, root, &good[entry..entry + 16]), "twice");
    // A page that refers to itself, and one that is almost the whole file.
    let page = |b: &mut Vec<u8>, at: u64, bytes: i32| {
        put(b, entry + 16, &at.to_le_bytes());
        put(b, entry + 24, &bytes.to_le_bytes());
        put(b, entry + 28, &(-1_i32).to_le_bytes());
    };
    refused(&|b| page(b, root as u64, length as i32), "lead back");
    refused(&|b| page(b, root as u64 - 32, length as i32 + 33), "says that a page");
    refused(&|b| page(b, u64::MAX - 8, 32), "says that a page");
    refused(&|b| put(b, 429 + 40, &u64::MAX.to_le_bytes()), "says that a page");
    refused(&|b| put(b, 429 + 48, &(u64::MAX / 32 * 32).to_le_bytes()), "says that a page");
    refused(&|b| put(b, 429 + 48, &0_u64.to_le_bytes()), "without nodes");
    refused(&|b| put(b, 429 + 24, &f64::NAN.to_le_bytes()), "expected: finite");
    refused(&|b| put(b, 429 + 32, &0_f64.to_le_bytes()), "expected: finite");
    refused(&|b| b.truncate(root + 40), "says that a page");
    // A count that contradicts the chunk is detected when the node is read.
    let mut bytes = good.clone();
    let points = i32::from_le_bytes(good[entry + 28..entry + 32].try_into().unwrap());
    put(&mut bytes, entry + 28, &(points + 1).to_le_bytes());
    std::fs::write(&path, &bytes).unwrap();
    let copc = Copc::open(&path).unwrap().unwrap();
    let nodes: Vec<u32> = (0..copc.nodes().len() as u32).collect();
    let error = copc.points_of(&nodes, NodeColumns::All, &LoadOptions::default()).unwrap_err().to_string();
    assert!(error.contains("in a node that its hierarchy says"), "{error}");
    // Any damaged byte of the hierarchy gives an error or points, never a panic.
    for at in root..root + length.min(160) {
        let mut bytes = good.clone();
        bytes[at] ^= 0x41;
        std::fs::write(&path, &bytes).unwrap();
        if let Ok(Some(copc)) = Copc::open(&path) {
            let _ = copc.points_of(&[0, 1], NodeColumns::All, &LoadOptions::default());
        }
    }
}

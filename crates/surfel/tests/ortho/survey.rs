//! Surface models of aerial surveys: noise, birds, water, strays, degrees, gaps, and the same points in other files.

use super::truth::{Folder, NO_DATA, draw, normal, numbers, random};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use surfel_load::LoadOptions;
use surfel_load::levels::{CopcRequest, save_copc};
use surfel_model::{ConvertOptions, Outliers};
use surfel_ortho::{Ortho, OrthoFiles, OrthoOptions, OrthoStats};
use surfel_sample::NoProgress;

/// Side of a square of ground in metres.
const SIDE_M: f64 = 48.0;
/// Coordinates of the square's corner.
const CORNER: [f64; 2] = [500_000.0, 5_400_000.0];
/// Points per square metre.
const DENSITY: f64 = 8.0;

/// A point of a survey: its position, class, and withheld flag.
#[derive(Clone, Copy)]
struct Return {
    at: [f64; 3],
    class: u8,
    is_withheld: bool,
}

/// Returns height and class of the surface relative to the corner: hills with a gable roof, a bridge and a lake.
fn surface(u: f64, v: f64) -> (f64, u8) {
    if (10.0..20.0).contains(&u) && (8.0..22.0).contains(&v) {
        return (132.0 - 4.0 * ((u - 15.0) / 5.0).abs(), 6);
    }
    if (30.0..34.0).contains(&u) && (2.0..46.0).contains(&v) {
        return (135.0, 17);
    }
    if (u - 15.0).hypot(v - 36.0) < 7.0 {
        return (118.0, 9);
    }
    (120.0 + 3.0 * (u / 17.0).sin() * (v / 13.0).cos(), 2)
}

/// Returns points of the surface, rounded to millimetres, with 3 cm of noise and only 2 % of the points on water. Adds
/// `spikes` points far below and far above the surface, alternately, with the two classes in `spike_class` (default 1).
fn survey(spikes: u64, spike_class: Option<[u8; 2]>) -> Vec<Return> {
    let count = (SIDE_M * SIDE_M * DENSITY) as u64;
    let place = |u: f64, v: f64, z: f64| [CORNER[0] + u, CORNER[1] + v, z].map(|c| (c * 1000.0).round() / 1000.0);
    let mut all = Vec::new();
    for i in 0..count {
        let (u, v) = (SIDE_M * random(3 * i), SIDE_M * random(3 * i + 1));
        let (z, class) = surface(u, v);
        if class != 9 || random(3 * i + 2) < 0.02 {
            all.push(Return { at: place(u, v, z + 0.03 * normal(i)), class, is_withheld: false });
        }
    }
    for i in 0..spikes {
        let k = 1_000_000 + 4 * i;
        let (u, v) = (SIDE_M * random(k), SIDE_M * random(k + 1));
        let is_low = i % 2 == 0;
        let off = if is_low { -5.0 - 55.0 * random(k + 2) } else { 30.0 + 170.0 * random(k + 2) };
        let class = spike_class.map_or(1, |[low, high]| if is_low { low } else { high });
        all.push(Return { at: place(u, v, surface(u, v).0 + off), class, is_withheld: false });
    }
    all
}

/// Encodes a LAS 1.4 file of format 6 in millimetres.
fn las(returns: &[Return]) -> Vec<u8> {
    let mut bytes = vec![0; 375];
    bytes[..4].copy_from_slice(b"LASF");
    bytes[24..26].copy_from_slice(&[1, 4]);
    bytes[94..96].copy_from_slice(&375_u16.to_le_bytes());
    bytes[96..100].copy_from_slice(&375_u32.to_le_bytes());
    bytes[104] = 6;
    bytes[105..107].copy_from_slice(&30_u16.to_le_bytes());
    let offset = [CORNER[0], CORNER[1], 0.0];
    for (k, offset) in offset.into_iter().enumerate() {
        let mut put = |at: usize, v: f64| bytes[at..at + 8].copy_from_slice(&v.to_le_bytes());
        put(131 + 8 * k, 0.001);
        put(155 + 8 * k, offset);
        put(179 + 16 * k, returns.iter().map(|p| p.at[k]).fold(f64::NEG_INFINITY, f64::max));
        put(187 + 16 * k, returns.iter().map(|p| p.at[k]).fold(f64::INFINITY, f64::min));
    }
    bytes[247..255].copy_from_slice(&(returns.len() as u64).to_le_bytes());
    for p in returns {
        for (at, offset) in p.at.into_iter().zip(offset) {
            bytes.extend((((at - offset) * 1000.0).round() as i32).to_le_bytes());
        }
        // Intensity; return 1 of 1; flags; class.
        bytes.extend([0, 0, 0x11, if p.is_withheld { 4 } else { 0 }, p.class]);
        bytes.extend([0; 13]);
    }
    bytes
}

fn write(folder: &Folder, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
    let path = folder.0.join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

/// Returns output files with heights only.
fn dsm(folder: &Folder, name: &str) -> OrthoFiles {
    OrthoFiles { dsm: Some(folder.0.join(name)), overwrite: true, ..OrthoFiles::default() }
}

fn model(input: &Path, options: &OrthoOptions, folder: &Folder) -> (OrthoStats, usize, Vec<f32>) {
    let files = dsm(folder, "model.tif");
    let (_, stats) = draw(input, options, &files);
    let (width, heights) = numbers(files.dsm.as_ref().unwrap());
    (stats, width, heights)
}

fn message(input: &Path, options: &OrthoOptions) -> String {
    Ortho::open(&[input], options, &NoProgress).err().map(|e| e.to_string()).unwrap_or_default()
}

const GSD: f64 = 0.25;

/// Returns the root mean square error of heights, in metres, over all pixels farther than 1.5 m from walls, shores and
/// the border.
fn rmse(width: usize, heights: &[f32]) -> f64 {
    let rows = heights.len() / width;
    let (mut sum, mut count) = (0.0, 0.0);
    for (i, z) in heights.iter().enumerate() {
        let (u, v) = ((i % width) as f64 * GSD + GSD / 2.0, (rows - 1 - i / width) as f64 * GSD + GSD / 2.0);
        let near = [-1.5, 0.0, 1.5].map(|d| [[u + d, v], [u, v + d]]);
        let class = surface(u, v).1;
        let is_inside = near
            .as_flattened()
            .iter()
            .all(|[u, v]| surface(*u, *v).1 == class && (0.0..SIDE_M).contains(u) && (0.0..SIDE_M).contains(v));
        if is_inside && *z != NO_DATA {
            sum += (f64::from(*z) - surface(u, v).0).powi(2);
            count += 1.0;
        }
    }
    assert!(count > 0.5 * heights.len() as f64, "{count} of {}", heights.len());
    f64::sqrt(sum / count)
}

fn options() -> OrthoOptions {
    let [x, y] = CORNER;
    OrthoOptions::new(GSD).with_bounds(Some([x, y, x + SIDE_M, y + SIDE_M]))
}

#[test]
fn noise_and_birds_are_no_surface() {
    let folder = Folder::new("noise");
    let classified = write(&folder, "noise.las", las(&survey(40, Some([7, 18]))));
    let (_, width, heights) = model(&classified, &options(), &folder);
    let found = rmse(width, &heights);
    assert!(found <= 0.10, "{found}");
    // The same noise without classes.
    let plain = write(&folder, "plain.las", las(&survey(40, None)));
    let (stats, width, of_plain) = model(&plain, &options(), &folder);
    assert!(rmse(width, &of_plain) <= 0.10 && (36..=40).contains(&stats.lone), "{} {stats:?}", rmse(width, &of_plain));
    // Both kinds of noise can be included.
    let (stats, width, kept) = model(&plain, &options().with_lone(true), &folder);
    assert!(rmse(width, &kept) > 0.5 && stats.lone == 0);
    let all = options().with_lone(true).with_load(load_all());
    let (_, width, kept) = model(&classified, &all, &folder);
    assert!(rmse(width, &kept) > 0.5);
    // A note states their number.
    let ortho = Ortho::open(&[&classified], &options(), &NoProgress).unwrap();
    let said = |text: &str| ortho.notes.iter().any(|(_, note)| note.contains(text));
    assert!(said("left out 40 points of noise (classes 7 and 18)") && said("`classes=all`"), "{:?}", ortho.notes);
    // Neither surface points nor the sparse returns of the lake were classified as birds.
    let clean = write(&folder, "clean.las", las(&survey(0, None)));
    let (stats, _, of_clean) = model(&clean, &options(), &folder);
    assert!(stats.lone == 0 && of_clean == heights);
}

/// Returns conversion options that drop isolated points.
fn drop_outliers() -> ConvertOptions {
    ConvertOptions { outliers: Some(Outliers::Drop), ..ConvertOptions::default() }
}

fn load_all() -> LoadOptions {
    LoadOptions::default().with_withheld(true)
}

#[test]
fn withheld_points_are_no_surface_and_come_back_with_all_classes() {
    let folder = Folder::new("withheld");
    let mut returns = survey(0, None);
    let count = returns.len();
    for p in returns.iter_mut().step_by(50) {
        (p.at[2], p.is_withheld) = (p.at[2] + 60.0, true);
    }
    let file = write(&folder, "withheld.las", las(&returns));
    let (_, width, heights) = model(&file, &options(), &folder);
    assert!(rmse(width, &heights) <= 0.10, "{}", rmse(width, &heights));
    let all = options().with_lone(true).with_load(load_all());
    let (_, width, heights) = model(&file, &all, &folder);
    assert!(rmse(width, &heights) > 1.0);
    // A withheld column of a table has the same effect.
    let mut text = String::from("x y z withheld classification\n");
    for p in &returns {
        let [x, y, z] = p.at;
        writeln!(text, "{x} {y} {z} {} {}", u8::from(p.is_withheld), p.class).unwrap();
    }
    let table = write(&folder, "withheld.txt", text);
    let ortho = Ortho::open(&[&table], &options(), &NoProgress).unwrap();
    let expected = format!("left out {} points flagged as withheld", count.div_ceil(50));
    assert!(ortho.notes.iter().any(|(_, note)| note.contains(&expected)), "{:?}", ortho.notes);
}

#[test]
fn water_is_no_outlier() {
    let folder = Folder::new("water");
    let file = write(&folder, "water.las", las(&survey(12, None)));
    let load = LoadOptions::default().with_surface(true).with_convert(&drop_outliers(), Path::new(""));
    let (stats, width, heights) = model(&file, &options().with_load(load), &folder);
    let water = |heights: &[f32]| heights.iter().filter(|z| (117.5..118.5).contains(*z)).count();
    let (_, _, kept) = model(&file, &options(), &folder);
    assert!(water(&heights) > 20 && water(&heights) == water(&kept), "{} {}", water(&heights), water(&kept));
    assert!(rmse(width, &heights) < 0.10 && stats.lone == 0);
}

#[test]
fn same_points_give_the_same_bits_in_any_file_and_order() {
    let folder = Folder::new("containers");
    let mut returns = survey(0, None);
    let table = |returns: &[Return]| {
        returns.iter().fold(String::from("x,y,z,classification\n"), |mut text, p| {
            writeln!(text, "{:.3},{:.3},{:.3},{}", p.at[0], p.at[1], p.at[2], p.class).unwrap();
            text
        })
    };
    let plys = |returns: &[Return]| {
        let count = returns.len();
        let mut bytes = format!(
            "ply\nformat binary_little_endian 1.0\nelement vertex {count}\nproperty double x\nproperty double y\n\
             property double z\nproperty uchar classification\nend_header\n"
        )
        .into_bytes();
        for p in returns {
            p.at.iter().for_each(|v| bytes.extend(v.to_le_bytes()));
            bytes.push(p.class);
        }
        bytes
    };
    let first = write(&folder, "a.las", las(&returns));
    let mut files = vec![write(&folder, "a.csv", table(&returns)), write(&folder, "a.ply", plys(&returns))];
    let by_levels = folder.0.join("a.copc.laz");
    save_copc(std::slice::from_ref(&first), &by_levels, &CopcRequest::default(), &NoProgress).unwrap();
    files.push(by_levels);
    let of_columns = folder.0.join("columns.copc.laz");
    save_copc(&files[1..2], &of_columns, &CopcRequest::default(), &NoProgress).unwrap();
    files.push(of_columns);
    for i in (1..returns.len()).rev() {
        returns.swap(i, (random(7_000_000 + i as u64) * (i + 1) as f64) as usize);
    }
    files.push(write(&folder, "b.las", las(&returns)));
    files.push(write(&folder, "b.csv", table(&returns)));
    returns.sort_by(|a, b| b.at[2].total_cmp(&a.at[2]));
    files.push(write(&folder, "c.ply", plys(&returns)));
    // The points determine the bounds, so that these are compared, too.
    let options = OrthoOptions::new(GSD);
    let bits = |path: &Path| {
        let (_, width, heights) = model(path, &options, &folder);
        (width, heights.into_iter().map(f32::to_bits).collect::<Vec<_>>())
    };
    let expected = bits(&first);
    for file in &files {
        let found = bits(file);
        let off = found.1.iter().zip(&expected.1).filter(|(a, b)| a != b).count();
        assert!(found == expected, "{}: {off} of {} pixels", file.display(), expected.1.len());
    }
}

#[test]
fn degrees_are_refused_however_they_are_told() {
    let folder = Folder::new("degrees");
    let open = |path: &Path| message(path, &OrthoOptions::new(1.0));
    let rows = |head: &str, digits: usize, of: fn(u64) -> [f64; 3]| {
        (0..200).fold(head.to_owned(), |mut text, i| {
            let [x, y, z] = of(i);
            writeln!(text, "{x:.digits$} {y:.digits$} {z:.2}").unwrap();
            text
        })
    };
    let alps = |i: u64| [8.54 + 0.01 * random(i), 46.37 + 0.01 * random(i + 500), 1400.0 + 90.0 * random(i + 900)];
    let coast = |i: u64| [-122.4 + 0.002 * random(i), 37.8 + 0.002 * random(i + 500), 3.0 * random(i + 900)];
    for (name, text) in [
        ("names.txt", rows("lon lat height\n", 7, alps)),
        ("long-names.txt", rows("Longitude Latitude Altitude\n", 4, alps)),
        ("numbers.xyz", rows("", 7, alps)),
        ("coast.xyz", rows("", 8, coast)),
        ("many-digits.xyz", rows("", 15, alps)),
    ] {
        let found = open(&write(&folder, name, text));
        assert!(found.contains("degrees") && found.contains("project it first"), "{name}: {found:?}");
    }
    // An explicit reference system overrides the check, and other numbers are lengths.
    let path = folder.0.join("numbers.xyz");
    assert_eq!(message(&path, &OrthoOptions::new(1.0).with_epsg(Some(25_832))), "");
    let room = |i: u64| [4.0 * random(i), 3.0 * random(i + 500), 2.5 * random(i + 900)];
    let pole = |i: u64| [8.5 + 0.05 * random(i), 46.3 + 0.05 * random(i + 500), 12.0 * random(i + 900)];
    let site = |i: u64| [100.0 * random(i), 80.0 * random(i + 500), 30.0 * random(i + 900)];
    for (name, text) in [
        ("room.xyz", rows("", 7, room)),
        ("pole.xyz", rows("", 3, pole)),
        ("site.xyz", rows("", 7, site)),
        (
            "named.txt",
            rows("easting northing height\n", 3, |i| [5e5 + 90.0 * random(i), 5e6 + 90.0 * random(i + 7), 2.0]),
        ),
    ] {
        assert_eq!(open(&write(&folder, name, text)), "", "{name}");
    }
}

#[test]
fn strays_that_make_an_image_absurdly_large_are_named() {
    let folder = Folder::new("stray");
    let cloud = |strays: &[[f64; 3]]| {
        let ground = (0..900).map(|i| [500_000.0 + f64::from(i % 30), 4e6 + f64::from(i / 30), 300.0]);
        ground.chain(strays.iter().copied()).fold(String::from("x y z\n"), |mut text, [x, y, z]| {
            writeln!(text, "{x} {y} {z}").unwrap();
            text
        })
    };
    // Strays that make the image too large, or possible but excessively large.
    for (k, stray) in
        [[0.0, 0.0, 0.0], [520_015.0, 4_020_000.5, 280.0], [503_000.0, 4_002_000.0, 10.0]].iter().enumerate()
    {
        let path = write(&folder, &format!("stray-{k}.xyz"), cloud(&[*stray]));
        let found = message(&path, &OrthoOptions::new(1.0));
        let [x, y, z] = stray;
        assert!(found.contains("a stray point lies") && found.contains(&format!("at {x},{y},{z}")), "{found}");
        assert!(
            found.contains("`outliers=drop`") && found.contains("`bounds=500000,4000000,500029,4000029`"),
            "{found}"
        );
        // The suggested remedies work.
        let load = LoadOptions::default().with_surface(true).with_convert(&drop_outliers(), Path::new(""));
        let ortho = Ortho::open(&[&path], &OrthoOptions::new(1.0).with_load(load), &NoProgress).unwrap();
        assert_eq!(ortho.size(), [29, 29]);
        let bounds = Some([500_000.0, 4_000_000.0, 500_029.0, 4_000_029.0]);
        assert_eq!(message(&path, &OrthoOptions::new(1.0).with_bounds(bounds)), "");
    }
    // Three strays, and separate ground that isn't stray.
    let few = [[0.0, 0.0, 0.0], [0.0, 0.0, 5.0], [9.0, 1.0, 0.0]];
    let found = message(&write(&folder, "few.xyz", cloud(&few)), &OrthoOptions::new(1.0));
    assert!(found.contains("3 stray points lie"), "{found}");
    let part: Vec<[f64; 3]> =
        (0..100).map(|i| [502_500.0 + f64::from(i % 10), 4_001_500.0 + f64::from(i / 10), 5.0]).collect();
    assert_eq!(message(&write(&folder, "part.xyz", cloud(&part)), &OrthoOptions::new(1.0)), "");
    // An error names only options that were given.
    let clean = write(&folder, "clean.xyz", cloud(&[]));
    let found = message(&clean, &OrthoOptions::new(1e-7));
    assert!(found.starts_with("gsd 1e-7") || found.starts_with("gsd: 1e-7") || found.contains("gsd"), "{found}");
    assert!(!found.contains("bounds is"), "{found}");
    let found = message(&clean, &OrthoOptions::new(1.0).with_size(Some([20_000_000, 10])).with_origin([5e5, 4e6]));
    assert!(found.contains("size") && !found.contains("bounds is"), "{found}");
}

#[test]
fn gaps_are_closed_and_marked_and_nothing_else_changes() {
    let folder = Folder::new("fill");
    // Ground with a hole of 6 m and one of 20 m.
    let is_hole = |p: &Return| {
        let [u, v] = [p.at[0] - CORNER[0], p.at[1] - CORNER[1]];
        (u - 40.0).abs() < 3.0 && (v - 10.0).abs() < 3.0 || (u - 24.0).abs() < 10.0 && (v - 33.0).abs() < 10.0
    };
    let plane = |p: Return| Return { at: [p.at[0], p.at[1], 50.0 + 0.1 * (p.at[0] - CORNER[0])], ..p };
    let returns: Vec<Return> = survey(0, None).into_iter().map(plane).filter(|p| !is_hole(p)).collect();
    let file = write(&folder, "holes.las", las(&returns));
    let (of_plain, of_filled) = (folder.files("plain"), folder.files("filled"));
    draw(&file, &options(), &of_plain);
    let (_, stats) = draw(&file, &options().with_fill(Some(4.0)), &of_filled);
    let (width, plain) = numbers(of_plain.dsm.as_ref().unwrap());
    let (_, filled) = numbers(of_filled.dsm.as_ref().unwrap());
    assert_eq!(filled.len(), 2 * plain.len());
    let mut marked = 0;
    for (i, z) in plain.iter().enumerate() {
        let (height, mark) = (filled[2 * i], filled[2 * i + 1]);
        let (u, v) = ((i % width) as f64 * GSD, SIDE_M - (i / width) as f64 * GSD);
        let is_middle = (u - 24.0).abs() < 5.0 && (v - 33.0).abs() < 5.0;
        if *z != NO_DATA {
            assert_eq!((height.to_bits(), mark), (z.to_bits(), 0.0), "{u} {v}");
        } else if mark == 1.0 {
            let exact = (50.0 + 0.1 * (u + GSD / 2.0)) as f32;
            assert!((height - exact).abs() < 0.05 && !is_middle, "{u} {v}: {height} {exact}");
            marked += 1;
        } else {
            assert_eq!((height, mark), (NO_DATA, NO_DATA));
        }
        let is_small = (u - 40.0).abs() < 2.5 && (v - 10.0).abs() < 2.5;
        assert!(!is_small || height != NO_DATA, "{u} {v}");
    }
    assert!(marked > 300 && stats.filled == marked, "{marked} {stats:?}");
    // Colours and normals have one more band, too.
    let (_, normals) = numbers(of_filled.normals.as_ref().unwrap());
    assert_eq!(normals.len(), 4 * plain.len());
    assert_eq!(normals.chunks_exact(4).filter(|n| n[3] == 1.0).count() as u64, marked);
    // An image of a part has the same pixels.
    let [x, y] = CORNER;
    let part = OrthoOptions::new(GSD).with_bounds(Some([x + 36.0, y + 6.0, x + 44.0, y + 14.0])).with_fill(Some(4.0));
    let (_, _, of_part) = model(&file, &part, &folder);
    let whole = |i: usize| {
        let (column, row) = (144 + i % 32, width - 56 + i / 32);
        [0, 1].map(|band| filled[2 * (row * width + column) + band].to_bits())
    };
    for (i, pair) in of_part.chunks_exact(2).enumerate() {
        assert_eq!([pair[0].to_bits(), pair[1].to_bits()], whole(i), "{i}");
    }
    let refused = message(&file, &options().with_fill(Some(1000.0)));
    assert!(refused.contains("fill") && refused.contains("512 pixels"), "{refused}");
}

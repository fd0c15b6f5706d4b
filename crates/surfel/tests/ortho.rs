//! Orthoimages and surface models: how near they are to an exact surface, beside means and a triangulation of the same
//! points; that any two images of the same points agree; and what their files say.
#![cfg(feature = "ortho")]

use std::fmt::Write as _;
use std::fs::File;
use std::path::{Path, PathBuf};
use surfel::ortho::{Ortho, OrthoFiles, OrthoOptions, OrthoStats};
use surfel::{Backend, BackendOptions, NoProgress};
use tiff::decoder::{Decoder, DecodingResult};
use tiff::tags::Tag;

const NO_DATA: f32 = -9999.0;

/// A folder that is removed afterwards.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("surfel-ortho-{}-{name}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    /// Points as PLY with f64 positions, of one colour.
    fn write(&self, name: &str, points: &[[f64; 3]], comment: &str) -> PathBuf {
        let mut text = format!("ply\nformat ascii 1.0\n{comment}element vertex {}\n", points.len());
        text += "property double x\nproperty double y\nproperty double z\n";
        text += "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n";
        for [x, y, z] in points {
            writeln!(text, "{x} {y} {z} 200 100 50").unwrap();
        }
        let path = self.0.join(name);
        std::fs::write(&path, text).unwrap();
        path
    }

    fn files(&self, name: &str) -> OrthoFiles {
        let file = |what: &str| self.0.join(format!("{name}-{what}.tif"));
        OrthoFiles { color: file("rgb"), dsm: Some(file("dsm")), normals: Some(file("n")), overwrite: true }
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn draw(input: &Path, options: &OrthoOptions, files: &OrthoFiles) -> (Ortho, OrthoStats) {
    let mut ortho = Ortho::open(&[input], options, &NoProgress).unwrap();
    let mut backend = Backend::by_name("cpu", &BackendOptions::default()).unwrap();
    let stats = ortho.draw(files, "surfel test", &mut backend, &NoProgress).unwrap();
    (ortho, stats)
}

fn decoder(path: &Path) -> Decoder<File> {
    Decoder::new(File::open(path).unwrap()).unwrap()
}

fn numbers(path: &Path) -> (usize, Vec<f32>) {
    let mut decoder = decoder(path);
    let width = decoder.dimensions().unwrap().0 as usize;
    let DecodingResult::F32(numbers) = decoder.read_image().unwrap() else { panic!("not f32") };
    (width, numbers)
}

fn levels(path: &Path) -> (usize, Vec<[u8; 4]>) {
    let mut decoder = decoder(path);
    let width = decoder.dimensions().unwrap().0 as usize;
    let DecodingResult::U8(levels) = decoder.read_image().unwrap() else { panic!("not u8") };
    (width, levels.chunks_exact(4).map(|c| [c[0], c[1], c[2], c[3]]).collect())
}

/// Terrain with a gabled roof, turned.
fn surface(x: f64, y: f64) -> (f64, bool) {
    let terrain = 100.0 + 0.03 * x + 0.6 * (x / 7.0).sin() * (y / 5.0).cos();
    let (sin, cos) = 0.4_f64.sin_cos();
    let (u, v) = ((x - 14.0) * cos + (y - 15.0) * sin, (y - 15.0) * cos - (x - 14.0) * sin);
    let roof = u.abs() <= 5.0 && v.abs() <= 7.0;
    (if roof { 104.0 + 2.5 * (1.0 - u.abs() / 5.0) } else { terrain }, roof)
}

/// A number from 0 to 1 for each i (SplitMix64).
fn random(i: u64) -> f64 {
    let mut z = i.wrapping_mul(0x9E37_79B9_7F4A_7C15);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}

/// Side of the square that points lie in, and how many there are along it: 8 a square metre.
const SIDE_M: f64 = 30.0;
const ALONG: usize = 85;
/// Standard deviation of a point's height.
const NOISE_M: f64 = 0.03;

/// Points of the surface in rows, each away from its place at random, by a fifth of the spacing (standard deviation);
/// or anywhere.
fn scan(anywhere: bool) -> Vec<[f64; 3]> {
    let spacing = SIDE_M / ALONG as f64;
    // The sum of twelve, less 6, is normal enough.
    let normal = |i: u64| (0..12).map(|k| random(12 * i + k)).sum::<f64>() - 6.0;
    (0..ALONG * ALONG)
        .map(|i| {
            let k = 3 * i as u64;
            let [column, row] = [i % ALONG, i / ALONG].map(|i| i as f64 + 0.5);
            let [x, y] = match anywhere {
                true => [random(12 * k), random(12 * k + 12)].map(|v| v * SIDE_M),
                false => [(column + 0.2 * normal(k)) * spacing, (row + 0.2 * normal(k + 1)) * spacing],
            };
            [x, y, surface(x, y).0 + NOISE_M * normal(k + 2)]
        })
        .collect()
}

/// How far heights are from the surface.
#[derive(Debug)]
struct Errors {
    /// Root mean square, of what isn't a gap: of all, and of what is a metre away from the roof's edge.
    rmse: f64,
    flat_rmse: f64,
    /// Share of pixels without a height.
    gaps: f64,
    /// Mean distance between the edge and that of the heights: pixels on its wrong side by its length.
    edge_m: f64,
}

const GSD: f64 = 0.2;
/// Pixels within so many metres of the square's border don't count: all methods miss points beyond it.
const BORDER_M: f64 = 2.0;

fn errors(height: impl Fn(f64, f64) -> Option<f64>) -> Errors {
    errors_of(&surface, 102.3, height)
}

/// Those against a surface whose parts above and below `middle` meet at an edge.
fn errors_of(
    surface: &dyn Fn(f64, f64) -> (f64, bool),
    middle: f64,
    height: impl Fn(f64, f64) -> Option<f64>,
) -> Errors {
    let pixels = (SIDE_M / GSD) as usize;
    let (mut all, mut flat, mut gaps, mut wrong) = ((0.0, 0.0), (0.0, 0.0), 0.0, 0.0);
    let mut total = 0.0;
    for i in 0..pixels * pixels {
        let (x, y) = (((i % pixels) as f64 + 0.5) * GSD, ((i / pixels) as f64 + 0.5) * GSD);
        if [x, y].iter().any(|v| *v < BORDER_M || *v > SIDE_M - BORDER_M) {
            continue;
        }
        total += 1.0;
        let (exact, roof) = surface(x, y);
        let around = (0..16).map(|k| f64::from(k) * std::f64::consts::TAU / 16.0);
        let near = around.clone().any(|a| surface(x + a.cos(), y + a.sin()).1 != roof);
        let Some(found) = height(x, y) else {
            gaps += 1.0;
            continue;
        };
        all = (all.0 + (found - exact).powi(2), all.1 + 1.0);
        if near {
            // Half as high as the roof's eaves are above the ground, or nearly.
            wrong += f64::from(u8::from((found > middle) != roof));
        } else {
            flat = (flat.0 + (found - exact).powi(2), flat.1 + 1.0);
        }
    }
    let rms = |(sum, n): (f64, f64)| (sum / n).sqrt();
    Errors { rmse: rms(all), flat_rmse: rms(flat), gaps: gaps / total, edge_m: wrong * GSD * GSD / 48.0 }
}

/// PDAL's `writers.gdal` with `output_type=mean`: the mean of the points within a radius of the pixel's centre.
fn mean_of(points: &[[f64; 3]], radius: f64, x: f64, y: f64) -> Option<f64> {
    let near = points.iter().filter(|p| (p[0] - x).powi(2) + (p[1] - y).powi(2) < radius * radius);
    let (sum, count) = near.fold((0.0, 0.0), |(sum, count), p| (sum + p[2], count + 1.0));
    (count > 0.0).then(|| sum / count)
}

/// The same with `output_type=max`.
fn largest_of(points: &[[f64; 3]], radius: f64, x: f64, y: f64) -> Option<f64> {
    let near = points.iter().filter(|p| (p[0] - x).powi(2) + (p[1] - y).powi(2) < radius * radius);
    near.map(|p| p[2]).reduce(f64::max)
}

/// Delaunay's triangulation: of all triangles around a place, its own is the lowest there once every point is lifted by
/// its squared distance. A far one is exchanged, point by point, for lower ones.
fn triangulated(points: &[[f64; 3]], x: f64, y: f64) -> Option<f64> {
    const FAR: f64 = 1e4;
    let from_here = points.iter().map(|p| [p[0] - x, p[1] - y, p[2]]);
    let near: Vec<[f64; 3]> = from_here.filter(|p| p[0].hypot(p[1]) < 2.0).collect();
    let mut corners = [[-FAR, -FAR, 0.0], [FAR, -FAR, 0.0], [0.0, FAR, 0.0]];
    let cross = |a: [f64; 3], b: [f64; 3]| a[0] * b[1] - a[1] * b[0];
    // Barycentric coordinates of the place, which is the origin.
    let shares = |[a, b, c]: [[f64; 3]; 3]| {
        let parts = [cross(b, c), cross(c, a), cross(a, b)];
        parts.map(|part| part / parts.iter().sum::<f64>())
    };
    let lifted = |p: [f64; 3]| p[0] * p[0] + p[1] * p[1];
    loop {
        let [a, b, c] = corners;
        // Height over the plane through the lifted corners.
        let [ab, ac] = [b, c].map(|p| [p[0] - a[0], p[1] - a[1], lifted(p) - lifted(a)]);
        let area = cross(ab, ac);
        let slopes = [(ab[2] * ac[1] - ac[2] * ab[1]) / area, (ab[0] * ac[2] - ac[0] * ab[2]) / area];
        let over = |p: &[f64; 3]| lifted(*p) - lifted(a) - slopes[0] * (p[0] - a[0]) - slopes[1] * (p[1] - a[1]);
        let lowest = near.iter().copied().min_by(|p, q| over(p).total_cmp(&over(q)))?;
        let around = |k: usize| {
            let mut corners = corners;
            corners[k] = lowest;
            Some(corners).filter(|corners| shares(*corners).iter().all(|share| *share >= 0.0))
        };
        match (0..3).find_map(around).filter(|_| over(&lowest) < -1e-9) {
            Some(lower) => corners = lower,
            None => break,
        }
    }
    let is_whole = corners.iter().all(|p| p[0].hypot(p[1]) < 2.0);
    is_whole.then(|| shares(corners).iter().zip(corners).map(|(share, p)| share * p[2]).sum())
}

#[test]
fn surface_model_is_nearer_than_means_and_a_triangulation() {
    for anywhere in [false, true] {
        accuracy(anywhere);
    }
}

fn accuracy(anywhere: bool) {
    let folder = Folder::new(if anywhere { "accuracy-anywhere" } else { "accuracy" });
    let points = scan(anywhere);
    let files = folder.files("a");
    let options = OrthoOptions::new(GSD).with_bounds(Some([0.0, 0.0, SIDE_M, SIDE_M]));
    let (_, stats) = draw(&folder.write("scan.ply", &points, ""), &options, &files);
    assert!(stats.covered as f64 > 0.99 * stats.pixels as f64, "{stats:?}");
    let (width, heights) = numbers(files.dsm.as_ref().unwrap());
    let at = |x: f64, y: f64| {
        let row = heights.len() / width - 1 - (y / GSD) as usize;
        Some(f64::from(heights[row * width + (x / GSD) as usize])).filter(|z| *z > f64::from(NO_DATA))
    };
    let ours = errors(at);
    assert_eq!(ours.gaps, 0.0);
    for radius in [0.15, 0.25, 0.35, 0.5, 0.7] {
        let means = errors(|x, y| mean_of(&points, radius, x, y));
        // Means within small radii leave most pixels out, among them the ones that are hard.
        let complete = means.gaps < 0.01;
        assert!(ours.gaps <= means.gaps, "{radius}: {ours:?} {means:?}");
        assert!(ours.rmse < means.rmse || !complete, "{radius}: {ours:?} {means:?}");
        assert!(ours.edge_m < means.edge_m || !complete, "{radius}: {ours:?} {means:?}");
    }
    let tin = errors(|x, y| triangulated(&points, x, y));
    // Noise: a triangle's height is the mean of three points, ours of those within a splat's radius.
    assert!(ours.flat_rmse < 0.8 * tin.flat_rmse && ours.flat_rmse < 0.6 * NOISE_M, "{ours:?} {tin:?}");
    // No triangle is on both sides of an edge, and many points know it better than three: of larger scenes the model
    // has four fifths of the error; of an edge of 48 m, a few pixels go either way by chance.
    println!("{ours:?} {tin:?}");
    assert!(ours.rmse <= 0.95 * tin.rmse && ours.edge_m <= 0.9 * tin.edge_m, "{ours:?} {tin:?}");
}

/// The heights that are drawn of points.
fn heights_of(folder: &Folder, points: &[[f64; 3]]) -> impl Fn(f64, f64) -> Option<f64> {
    let files = folder.files("heights");
    let options = OrthoOptions::new(GSD).with_bounds(Some([0.0, 0.0, SIDE_M, SIDE_M]));
    draw(&folder.write("points.ply", points, ""), &options, &files);
    let (width, heights) = numbers(files.dsm.as_ref().unwrap());
    move |x: f64, y: f64| {
        let row = heights.len() / width - 1 - (y / GSD) as usize;
        Some(f64::from(heights[row * width + (x / GSD) as usize])).filter(|z| *z > f64::from(NO_DATA))
    }
}

/// Points of a complete ground, 8 a square metre, and as many of what is above it, at heights that stray by `stray_m`
/// (standard deviation); and those of them that are the first ones from above.
fn two_surfaces(anywhere: bool, above: &dyn Fn(f64, f64) -> (f64, bool), stray_m: f64) -> [Vec<[f64; 3]>; 2] {
    let normal = |i: u64| (0..12).map(|k| random(1_000_000 + 12 * i + k)).sum::<f64>() - 6.0;
    let ground: Vec<[f64; 3]> = scan(anywhere).iter().map(|p| [p[0], p[1], p[2] - surface(p[0], p[1]).0]).collect();
    let place = |p: &[f64; 3]| [SIDE_M - p[0], SIDE_M - p[1]];
    let upper: Vec<[f64; 3]> = (0_u64..)
        .zip(&ground)
        .map(|(i, p)| (i, place(p)))
        .filter(|(_, [x, y])| above(*x, *y).1)
        .map(|(i, [x, y])| [x, y, above(x, y).0 + stray_m * normal(i)])
        .collect();
    let open = ground.iter().filter(|p| !above(p[0], p[1]).1);
    let first = upper.iter().chain(open).copied().collect();
    [[upper.clone(), ground.clone()].concat(), first]
}

#[test]
fn upper_one_of_two_complete_surfaces_is_the_model() {
    // A deck 6 m above flat ground.
    let deck = |x: f64, y: f64| {
        let is_deck = surface(x, y).1;
        (if is_deck { 6.0 } else { 0.0 }, is_deck)
    };
    // A canopy 8 m above it with holes and lanes some 3 m wide: what is right is the canopy where it is.
    let canopy = |x: f64, y: f64| {
        let is_leaf = (1.3 * x + 0.4 * y).sin() * (1.1 * y - 0.3 * x).cos() > -0.1;
        (if is_leaf { 8.0 } else { 0.0 }, is_leaf)
    };
    let mut all_found = Vec::new();
    for (name, anywhere, stray_m) in [
        ("deck in rows", false, NOISE_M),
        ("deck", true, NOISE_M),
        ("canopy", true, NOISE_M),
        ("straying canopy", true, 0.15),
        ("far straying canopy", true, 0.4),
    ] {
        let folder = Folder::new(&name.replace(' ', "-"));
        let above: &dyn Fn(f64, f64) -> (f64, bool) = if name.starts_with("deck") { &deck } else { &canopy };
        let [all, first] = two_surfaces(anywhere, above, stray_m);
        let ours = errors_of(above, 3.0, heights_of(&folder, &all));
        let of_first = errors_of(above, 3.0, heights_of(&folder, &first));
        let means = errors_of(above, 3.0, |x, y| mean_of(&all, 0.5, x, y));
        let largest = errors_of(above, 3.0, |x, y| largest_of(&all, 0.35, x, y));
        let tin = errors_of(above, 3.0, |x, y| triangulated(&first, x, y));
        let found = [ours, of_first, means, largest, tin];
        println!("{name}: {found:#?}");
        all_found.push((name, found));
    }
    for (name, [ours, of_first, means, largest, tin]) in all_found {
        assert!(ours.gaps == 0.0 && ours.flat_rmse < means.flat_rmse, "{name}");
        // Points that stray by more than their spacing are no surface.
        if name != "far straying canopy" {
            assert!(ours.rmse < means.rmse && ours.rmse < largest.rmse && ours.rmse < 1.25 * of_first.rmse, "{name}");
            // The triangulation is told which of the lower points are seen, which says where holes are; some 5 %.
            assert!(ours.rmse < 1.08 * tin.rmse && of_first.rmse < 1.12 * tin.rmse, "{name}");
        }
        if name.starts_with("deck") {
            assert!(ours.rmse < 0.95 * tin.rmse && ours.edge_m < tin.edge_m, "{name}");
        }
    }
}

#[test]
fn images_of_the_same_points_have_the_same_pixels_where_they_overlap() {
    let folder = Folder::new("overlap");
    let input = folder.write("scan.ply", &scan(false), "");
    // At this distance a block ends at 20.48, in the middle of both images.
    let options = |bounds| OrthoOptions::new(0.01).with_bounds(Some(bounds));
    let (a, b) = (folder.files("a"), folder.files("b"));
    draw(&input, &options([20.0, 20.2, 20.9, 20.8]), &a);
    draw(&input, &options([20.3, 20.0, 21.3, 20.6]), &b);
    // 60 x 40 pixels: of a 90 x 60 from column 30, row 20 on; of b 100 x 60 from column 0, row 0 on.
    let [of_a, of_b] = [&a, &b].map(|files| {
        let (width, colors) = levels(&files.color);
        let (_, heights) = numbers(files.dsm.as_ref().unwrap());
        let (_, normals) = numbers(files.normals.as_ref().unwrap());
        (width, colors, heights, normals)
    });
    assert_eq!((of_a.0, of_b.0, of_a.1.len(), of_b.1.len()), (90, 100, 5400, 6000));
    for (x, y) in (0..40).flat_map(|y| (0..60).map(move |x| (x, y))) {
        let (i, j) = ((y + 20) * 90 + x + 30, y * 100 + x);
        assert_eq!((of_a.1[i], of_a.2[i].to_bits()), (of_b.1[j], of_b.2[j].to_bits()), "{x} {y}");
        assert_eq!(of_a.3[3 * i..3 * i + 3], of_b.3[3 * j..3 * j + 3], "{x} {y}");
        assert!(of_a.1[i][3] == 255 && of_a.3[3 * i + 2] > 0.0);
    }
    // Another origin on the same grid moves the blocks' edges, and hardly a height: no seam shows.
    let moved = folder.files("moved");
    draw(&input, &options([20.0, 20.2, 20.9, 20.8]).with_origin([5.0, 5.0]), &moved);
    let (_, heights) = numbers(moved.dsm.as_ref().unwrap());
    let largest = of_a.2.iter().zip(&heights).map(|(p, q)| (p - q).abs()).fold(0.0, f32::max);
    // f32 holds 100 m to 8 µm.
    assert!(heights.len() == 5400 && largest < 1e-4, "{largest}");
}

#[test]
fn georeferenced_points_keep_their_millimetres_and_their_system() {
    let folder = Folder::new("crs");
    let points = scan(false);
    let far: Vec<[f64; 3]> = points.iter().map(|[x, y, z]| [x + 637_000.0, y + 4_851_000.0, *z]).collect();
    let (near_files, far_files) = (folder.files("near"), folder.files("far"));
    let bounds = |x: f64, y: f64| Some([x + 5.05, y + 6.0, x + 25.0, y + 20.0]);
    let comment = "comment crs EPSG:25832\n";
    draw(&folder.write("near.ply", &points, ""), &OrthoOptions::new(0.1).with_bounds(bounds(0.0, 0.0)), &near_files);
    let options =
        OrthoOptions::new(0.1).with_bounds(bounds(637_000.0, 4_851_000.0)).with_origin([637_000.0, 4_851_000.0]);
    let (ortho, _) = draw(&folder.write("far.ply", &far, comment), &options, &far_files);
    assert_eq!(ortho.crs.as_ref().and_then(surfel::io::Crs::epsg), Some(25_832));
    let ((_, near), (_, far)) = (numbers(near_files.dsm.as_ref().unwrap()), numbers(far_files.dsm.as_ref().unwrap()));
    let mut off: Vec<f32> = near.iter().zip(&far).map(|(p, q)| (p - q).abs()).collect();
    off.sort_by(f32::total_cmp);
    // Positions in text lose 1e-9; at edges the choice between two surfaces may turn on less.
    assert!(off[off.len() * 999 / 1000] < 1e-3, "{}", off[off.len() * 999 / 1000]);
    for (path, samples) in [(&far_files.color, 4), (far_files.dsm.as_ref().unwrap(), 1)] {
        let mut decoder = decoder(path);
        assert_eq!(decoder.dimensions().unwrap(), (200, 140));
        let mut tag = |tag| decoder.get_tag(tag).unwrap();
        assert_eq!(tag(Tag::ModelPixelScaleTag).into_f64_vec().unwrap(), [0.1, 0.1, 0.0]);
        let tie = tag(Tag::ModelTiepointTag).into_f64_vec().unwrap();
        assert!((tie[3] - 637_005.0).abs() < 1e-6 && (tie[4] - 4_851_020.0).abs() < 1e-6, "{tie:?}");
        // Version, then projected, pixels are areas, and the code.
        let keys = [1, 1, 0, 3, 1024, 0, 1, 1, 1025, 0, 1, 1, 3072, 0, 1, 25_832];
        assert_eq!(tag(Tag::GeoKeyDirectoryTag).into_u16_vec().unwrap(), keys);
        assert_eq!(tag(Tag::SamplesPerPixel).into_u32().unwrap(), samples);
        if samples == 1 {
            assert_eq!(tag(Tag::GdalNodata).into_string().unwrap(), "-9999");
        }
    }
    let (_, colors) = levels(&far_files.color);
    assert!(colors.iter().all(|c| *c == [200, 100, 50, 255]), "a mean of one colour is that colour");
    // A code that is given wins.
    let options = options.with_epsg(Some(32_632));
    let (ortho, _) = draw(&folder.0.join("far.ply"), &options, &far_files);
    assert_eq!(ortho.crs.and_then(|crs| crs.epsg()), Some(32_632));
}

#[test]
fn what_no_splat_covers_is_no_data() {
    let folder = Folder::new("gap");
    // A hole of 8 m by 8 m: far wider than a splat.
    let hole = |p: &[f64; 3]| (20.0..28.0).contains(&p[0]) && (2.0..10.0).contains(&p[1]);
    let points: Vec<[f64; 3]> = scan(false).into_iter().filter(|p| !hole(p)).collect();
    let files = folder.files("a");
    let (_, stats) = draw(&folder.write("scan.ply", &points, ""), &OrthoOptions::new(0.25), &files);
    let (width, colors) = levels(&files.color);
    let (_, heights) = numbers(files.dsm.as_ref().unwrap());
    let (_, normals) = numbers(files.normals.as_ref().unwrap());
    for (i, (color, height)) in colors.iter().zip(&heights).enumerate() {
        let empty = color[3] == 0;
        assert_eq!((empty, empty), (*height == NO_DATA, normals[3 * i] == NO_DATA), "pixel {i}");
        assert!(color[3] == 0 || color[3] == 255);
    }
    let rows = heights.len() / width;
    let at = |x: f64, y: f64| heights[(rows - 1 - (y / 0.25) as usize) * width + (x / 0.25) as usize];
    // Splats reach into it by their radius, some 0.6 m.
    assert!([[24.0, 6.0], [21.2, 3.2], [26.8, 8.8]].iter().all(|[x, y]| at(*x, *y) == NO_DATA));
    assert!([[19.8, 6.0], [28.2, 6.0], [10.0, 5.0]].iter().all(|[x, y]| at(*x, *y) > 90.0));
    assert_eq!(stats.covered as usize, heights.iter().filter(|z| **z != NO_DATA).count());
}

#[test]
fn what_cannot_be_drawn_is_one_clear_error() {
    let folder = Folder::new("errors");
    let path = folder.write("scan.ply", &scan(false), "");
    let message = |path: &Path, options: &OrthoOptions| {
        let opened = Ortho::open(&[path], options, &NoProgress);
        opened.err().map(|e| e.to_string()).unwrap_or_default()
    };
    let of = |options: OrthoOptions| message(&path, &options);
    assert!(of(OrthoOptions::new(0.0)).contains("greater than 0"));
    assert!(of(OrthoOptions::new(f64::NAN)).contains("greater than 0"));
    assert!(of(OrthoOptions::new(1e-6)).contains("larger gsd"));
    assert!(of(OrthoOptions::new(0.1).with_bounds(Some([1.0, 0.0, 0.0, 1.0]))).contains("X0 < X1"));
    assert!(of(OrthoOptions::new(0.1).with_bounds(Some([100.0, 0.0, 110.0, 1.0]))).contains("nothing lies within"));
    assert!(of(OrthoOptions::new(0.1).with_epsg(Some(4326))).contains("degrees"));
    let degrees = folder.write("degrees.ply", &[[7.0, 50.0, 100.0], [7.1, 50.1, 101.0]], "comment crs EPSG:4326\n");
    assert!(message(&degrees, &OrthoOptions::new(0.1)).contains("project it first"));
    let other = folder.write("other.ply", &scan(false), "comment crs EPSG:32633\n");
    let first = folder.write("first.ply", &scan(false), "comment crs EPSG:32632\n");
    let opened = Ortho::open(&[&first, &other], &OrthoOptions::new(0.5), &NoProgress);
    assert!(opened.err().unwrap().to_string().contains("--crs"));
}

#[test]
fn files_side_by_side_are_one() {
    let folder = Folder::new("files");
    let points = scan(false);
    let (west, east): (Vec<_>, Vec<_>) = points.iter().partition(|p| p[0] < 15.0);
    let paths = [folder.write("west.ply", &west, ""), folder.write("east.ply", &east, "")];
    let options = OrthoOptions::new(0.2).with_bounds(Some([10.0, 5.0, 20.0, 25.0]));
    let (one, two) = (folder.files("one"), folder.files("two"));
    draw(&folder.write("all.ply", &points, ""), &options, &one);
    let paths: Vec<&Path> = paths.iter().map(PathBuf::as_path).collect();
    let mut ortho = Ortho::open(&paths, &options, &NoProgress).unwrap();
    let mut backend = Backend::by_name("cpu", &BackendOptions::default()).unwrap();
    ortho.draw(&two, "surfel test", &mut backend, &NoProgress).unwrap();
    let ((_, of_one), (_, of_two)) = (numbers(one.dsm.as_ref().unwrap()), numbers(two.dsm.as_ref().unwrap()));
    // The points are the same, and so are the splats, whichever file they come from.
    assert!(of_one == of_two);
}

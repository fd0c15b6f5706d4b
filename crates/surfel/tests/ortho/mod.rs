//! Tests of orthoimages and surface models:
//! - accuracy against an exact surface, compared with means and a triangulation of the same points;
//! - equality of overlapping images of the same points;
//! - metadata of the files.
#![cfg(feature = "ortho")]

mod survey;
mod truth;

use std::path::{Path, PathBuf};
use surfel_backend::{Backend, BackendOptions};
use surfel_ortho::{Ortho, OrthoOptions};
use surfel_sample::NoProgress;
use tiff::decoder::DecodingResult;
use tiff::tags::Tag;
use truth::{
    Cells, Exact, Folder, NO_DATA, NOISE_M, Scan, canopy, compared, deck, decoder, draw, errors_of, heights_of,
    numbers, roof,
};

fn levels(path: &Path) -> (usize, Vec<[u8; 4]>) {
    let mut decoder = decoder(path);
    let width = decoder.dimensions().unwrap().0 as usize;
    let DecodingResult::U8(levels) = decoder.read_image().unwrap() else { panic!("not u8") };
    (width, levels.chunks_exact(4).map(|c| [c[0], c[1], c[2], c[3]]).collect())
}

/// Returns a scan with 8 points per square metre, at random positions if `anywhere` is true.
fn scan(anywhere: bool) -> Scan {
    Scan { density: 8.0, anywhere, seed: 0 }
}

/// Returns points of the surface [`roof`], scanned in rows.
fn points() -> Vec<[f64; 3]> {
    scan(false).points(|x, y| roof(x, y).0, NOISE_M)
}

#[test]
fn surface_model_is_nearer_than_means_and_a_triangulation() {
    for anywhere in [false, true] {
        let folder = Folder::new(if anywhere { "accuracy-anywhere" } else { "accuracy" });
        let points = scan(anywhere).points(|x, y| roof(x, y).0, NOISE_M);
        let [ours, means, tin] = compared(&folder, roof, 102.3, [&points, &points]);
        println!("{ours:?} {means:?} {tin:?}");
        assert!(ours.gaps == 0.0 && ours.rmse < means.rmse && ours.edge_m < means.edge_m, "{ours:?} {means:?}");
        // Noise: a triangle's height is the mean of three points, ours of all points within a splat's radius.
        assert!(ours.flat_rmse < 0.8 * tin.flat_rmse && ours.flat_rmse < 0.6 * NOISE_M, "{ours:?} {tin:?}");
        // No triangle respects the edge, and many points locate it better than three. On larger scenes the model has
        // four fifths of the triangulation's error; on an edge of 48 m a few pixels vary by chance.
        assert!(ours.rmse <= 0.95 * tin.rmse && ours.edge_m <= 0.9 * tin.edge_m, "{ours:?} {tin:?}");
    }
}

#[test]
fn upper_one_of_two_complete_surfaces_is_the_model() {
    let mut all_found = Vec::new();
    for (name, anywhere, stray_m) in [
        ("deck in rows", false, NOISE_M),
        ("deck", true, NOISE_M),
        ("canopy", true, NOISE_M),
        ("straying canopy", true, 0.15),
        ("far straying canopy", true, 0.4),
    ] {
        let folder = Folder::new(&name.replace(' ', "-"));
        let above: Exact = if name.starts_with("deck") { deck } else { canopy };
        let [all, first] = scan(anywhere).two_surfaces(above, stray_m);
        let [ours, means, tin] = compared(&folder, above, 3.0, [&all, &first]);
        let of_first = errors_of(above, 3.0, heights_of(&folder, &first));
        let cells = Cells::new(&all);
        let largest = errors_of(above, 3.0, |x, y| cells.largest(0.35, x, y));
        let found = [ours, of_first, means, largest, tin];
        println!("{name}: {found:#?}");
        all_found.push((name, found));
    }
    for (name, [ours, of_first, means, largest, tin]) in all_found {
        assert!(ours.gaps == 0.0 && ours.flat_rmse < means.flat_rmse, "{name}");
        assert!(ours.rmse < means.rmse && ours.rmse < largest.rmse && ours.rmse < 1.25 * of_first.rmse, "{name}");
        // The triangulation gets only the visible lower points, which reveals holes; this is worth about 5 %.
        assert!(ours.rmse < 1.05 * tin.rmse && of_first.rmse < 1.12 * tin.rmse, "{name}");
        if name.starts_with("deck") {
            assert!(ours.rmse < 0.95 * tin.rmse && ours.edge_m < tin.edge_m, "{name}");
        }
    }
}

#[test]
fn images_of_the_same_points_have_the_same_pixels_where_they_overlap() {
    let folder = Folder::new("overlap");
    let input = folder.write("scan.ply", &points(), "");
    // At this pixel size a block ends at 20.48, in the middle of both images.
    let options = |bounds| OrthoOptions::new(0.01).with_bounds(Some(bounds));
    let (a, b) = (folder.files("a"), folder.files("b"));
    draw(&input, &options([20.0, 20.2, 20.9, 20.8]), &a);
    draw(&input, &options([20.3, 20.0, 21.3, 20.6]), &b);
    // 60 × 40 common pixels: of a (90 × 60) from column 30, row 20 on; of b (100 × 60) from column 0, row 0 on.
    let [of_a, of_b] = [&a, &b].map(|files| {
        let (width, colors) = levels(files.color.as_ref().unwrap());
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
    // Another origin on the same grid moves the blocks' edges but hardly any height, so no seam shows.
    let moved = folder.files("moved");
    draw(&input, &options([20.0, 20.2, 20.9, 20.8]).with_origin([5.0, 5.0]), &moved);
    let (_, heights) = numbers(moved.dsm.as_ref().unwrap());
    let largest = of_a.2.iter().zip(&heights).map(|(p, q)| (p - q).abs()).fold(0.0, f32::max);
    // f32 represents 100 m to 8 µm.
    assert!(heights.len() == 5400 && largest < 1e-4, "{largest}");
}

#[test]
fn georeferenced_points_keep_their_millimetres_and_their_system() {
    let folder = Folder::new("crs");
    let points = points();
    let far: Vec<[f64; 3]> = points.iter().map(|[x, y, z]| [x + 637_000.0, y + 4_851_000.0, *z]).collect();
    let (near_files, far_files) = (folder.files("near"), folder.files("far"));
    let bounds = |x: f64, y: f64| Some([x + 5.05, y + 6.0, x + 25.0, y + 20.0]);
    let comment = "comment crs EPSG:25832\n";
    draw(&folder.write("near.ply", &points, ""), &OrthoOptions::new(0.1).with_bounds(bounds(0.0, 0.0)), &near_files);
    let options =
        OrthoOptions::new(0.1).with_bounds(bounds(637_000.0, 4_851_000.0)).with_origin([637_000.0, 4_851_000.0]);
    let (ortho, _) = draw(&folder.write("far.ply", &far, comment), &options, &far_files);
    assert_eq!(ortho.crs.as_ref().and_then(surfel_io::Crs::epsg), Some(25_832));
    let ((_, near), (_, far)) = (numbers(near_files.dsm.as_ref().unwrap()), numbers(far_files.dsm.as_ref().unwrap()));
    let mut off: Vec<f32> = near.iter().zip(&far).map(|(p, q)| (p - q).abs()).collect();
    off.sort_by(f32::total_cmp);
    // Positions in text lose 1e-9; at edges even less may decide between two surfaces.
    assert!(off[off.len() * 999 / 1000] < 1e-3, "{}", off[off.len() * 999 / 1000]);
    for (path, samples) in [(&far_files.color, 4), (&far_files.dsm, 1)] {
        let path = path.as_ref().unwrap();
        let mut decoder = decoder(path);
        assert_eq!(decoder.dimensions().unwrap(), (200, 140));
        let mut tag = |tag| decoder.get_tag(tag).unwrap();
        assert_eq!(tag(Tag::ModelPixelScaleTag).into_f64_vec().unwrap(), [0.1, 0.1, 0.0]);
        let tie = tag(Tag::ModelTiepointTag).into_f64_vec().unwrap();
        assert!((tie[3] - 637_005.0).abs() < 1e-6 && (tie[4] - 4_851_020.0).abs() < 1e-6, "{tie:?}");
        // Keys: version, projected, pixels are areas, EPSG code.
        let keys = [1, 1, 0, 3, 1024, 0, 1, 1, 1025, 0, 1, 1, 3072, 0, 1, 25_832];
        assert_eq!(tag(Tag::GeoKeyDirectoryTag).into_u16_vec().unwrap(), keys);
        assert_eq!(tag(Tag::SamplesPerPixel).into_u32().unwrap(), samples);
        if samples == 1 {
            assert_eq!(tag(Tag::GdalNodata).into_string().unwrap(), "-9999");
        }
    }
    let (_, colors) = levels(far_files.color.as_ref().unwrap());
    assert!(colors.iter().all(|c| *c == [200, 100, 50, 255]), "a mean of one colour is that colour");
    // A given code takes precedence.
    let options = options.with_epsg(Some(32_632));
    let (ortho, _) = draw(&folder.0.join("far.ply"), &options, &far_files);
    assert_eq!(ortho.crs.and_then(|crs| crs.epsg()), Some(32_632));
}

#[test]
fn what_no_splat_covers_is_no_data() {
    let folder = Folder::new("gap");
    // A hole of 8 m by 8 m, far wider than a splat.
    let hole = |p: &[f64; 3]| (20.0..28.0).contains(&p[0]) && (2.0..10.0).contains(&p[1]);
    let points: Vec<[f64; 3]> = points().into_iter().filter(|p| !hole(p)).collect();
    let files = folder.files("a");
    let (_, stats) = draw(&folder.write("scan.ply", &points, ""), &OrthoOptions::new(0.25), &files);
    let (width, colors) = levels(files.color.as_ref().unwrap());
    let (_, heights) = numbers(files.dsm.as_ref().unwrap());
    let (_, normals) = numbers(files.normals.as_ref().unwrap());
    for (i, (color, height)) in colors.iter().zip(&heights).enumerate() {
        let empty = color[3] == 0;
        assert_eq!((empty, empty), (*height == NO_DATA, normals[3 * i] == NO_DATA), "pixel {i}");
        assert!(color[3] == 0 || color[3] == 255);
    }
    let rows = heights.len() / width;
    let at = |x: f64, y: f64| heights[(rows - 1 - (y / 0.25) as usize) * width + (x / 0.25) as usize];
    // Splats extend into the hole by their radius, some 0.6 m.
    assert!([[24.0, 6.0], [21.2, 3.2], [26.8, 8.8]].iter().all(|[x, y]| at(*x, *y) == NO_DATA));
    assert!([[19.8, 6.0], [28.2, 6.0], [10.0, 5.0]].iter().all(|[x, y]| at(*x, *y) > 90.0));
    assert_eq!(stats.covered as usize, heights.iter().filter(|z| **z != NO_DATA).count());
}

#[test]
fn what_cannot_be_drawn_is_one_clear_error() {
    let folder = Folder::new("errors");
    let path = folder.write("scan.ply", &points(), "");
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
    let other = folder.write("other.ply", &points(), "comment crs EPSG:32633\n");
    let first = folder.write("first.ply", &points(), "comment crs EPSG:32632\n");
    let opened = Ortho::open(&[&first, &other], &OrthoOptions::new(0.5), &NoProgress);
    assert!(opened.err().unwrap().to_string().contains("`crs`"));
}

#[test]
fn files_side_by_side_are_one() {
    let folder = Folder::new("files");
    let points = points();
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
    // The points are the same, so the splats are too, whatever file they come from.
    assert!(of_one == of_two);
}

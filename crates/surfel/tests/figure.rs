//! Figures: panels share their camera and colours, distances are exact, and light keeps the hue of values.

use std::path::PathBuf;
use surfel_app::figure::{Drawing, FigureImage, FigureOptions, FigureRequest, Picture};
use surfel_app::request::RenderOptions;
use surfel_backend::Backend;
use surfel_load::Error;
use surfel_model::glam::DVec3;
use surfel_model::{Colormap, Scene};
use surfel_sample::NoProgress;

/// A folder that is removed when dropped.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("surfel-figure-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    /// Writes points, and returns the file's path.
    fn points(&self, name: &str, points: &[DVec3]) -> PathBuf {
        let lines: String = points.iter().map(|p| format!("{} {} {}\n", p.x, p.y, p.z)).collect();
        self.file(name, &lines)
    }

    fn file(&self, name: &str, text: &str) -> PathBuf {
        let path = self.0.join(name);
        std::fs::write(&path, text).unwrap();
        path
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Returns points on a sphere of this radius.
fn sphere(count: u32, radius: f64) -> Vec<DVec3> {
    let at = |i: u32| {
        let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(count);
        let ((sin, cos), r) = ((2.399_963_229_728_653 * f64::from(i)).sin_cos(), (1.0 - z * z).sqrt());
        DVec3::new(r * cos, r * sin, z) * radius
    };
    (0..count).map(at).collect()
}

fn render() -> RenderOptions {
    let mut options = RenderOptions::default();
    for (flag, text) in [("size", "120x120"), ("view", "20,20"), ("up", "+z")] {
        options.set(flag, text).unwrap();
    }
    options
}

fn draw(inputs: &[PathBuf], render: &RenderOptions, figure: &FigureOptions) -> Result<FigureImage, Error> {
    let request = FigureRequest { inputs, render, figure, stdin: None };
    request.draw(&mut Backend::auto().unwrap(), &NoProgress, &mut |_| {})
}

/// Returns the images of panels, in order.
fn panels(drawing: &Drawing) -> Vec<&Picture> {
    drawing.pictures().filter(|picture| picture.size[0] == 120).collect()
}

fn words(image: &FigureImage) -> Vec<&str> {
    image.drawing.texts().map(|text| text.text.as_str()).collect()
}

/// Returns hue in degrees and lightness of a colour, in CIE L*a*b*.
fn hue_and_lightness(levels: [u8; 3]) -> (f64, f64) {
    let linear = levels.map(|level| surfel_math::srgb::decode(f64::from(level) / 255.0));
    let matrix = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]];
    let white = [0.9505, 1.0, 1.089];
    let [x, y, z] = [0, 1, 2].map(|r| {
        let t: f64 = (0..3).map(|c| matrix[r][c] * linear[c]).sum::<f64>() / white[r];
        if t > 0.008_856 { t.cbrt() } else { 7.787 * t + 16.0 / 116.0 }
    });
    ((200.0 * (y - z)).atan2(500.0 * (x - y)).to_degrees(), 116.0 * y - 16.0)
}

#[test]
fn light_changes_the_lightness_of_errors_a_little_and_never_their_hue() {
    let folder = Folder::new("hue");
    // The larger sphere is 0.1 from the mesh of the smaller one everywhere, to within its facets.
    let files = [folder.points("truth.xyz", &sphere(4000, 1.0)), folder.points("ours.xyz", &sphere(4000, 1.1))];
    let mut figure = FigureOptions::default();
    (figure.error_row, figure.error_max) = (Some(Colormap::Viridis), Some(0.2));
    let image = draw(&files, &render(), &figure).unwrap();
    let all = panels(&image.drawing);
    assert_eq!(all.len(), 3);
    let (hue, lightness) = hue_and_lightness([33, 145, 140]);
    let mut seen = (0, f64::INFINITY, 0.0_f64);
    let side = 120;
    for (i, [r, g, b, _]) in all[2].rgba.iter().enumerate() {
        let (x, y) = (i % side, i / side);
        // Pixels of the outline are mixed with the background.
        let is_inside = (x as f64 - 59.5).hypot(y as f64 - 59.5) < 40.0;
        if is_inside {
            let (found, l) = hue_and_lightness([*r, *g, *b]);
            assert!((found - hue).abs() < 4.0, "{x} {y}: hue {found}, expected {hue}");
            seen = (seen.0 + 1, seen.1.min(l), seen.2.max(l));
        }
    }
    assert!(seen.0 > 4000 && seen.1 > lightness - 15.0 && seen.2 < lightness + 3.0, "{seen:?} {lightness}");
    assert!(seen.2 - seen.1 > 2.0, "shape is visible: {seen:?}");
}

#[test]
fn errors_are_measured_to_points_or_to_a_mesh() {
    let folder = Folder::new("distance");
    let square = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nf 1 2 3\nf 1 3 4\n";
    let grid = |z: f64| -> Vec<DVec3> {
        (0..400).map(|i| DVec3::new(f64::from(i % 20) / 10.0 - 0.95, f64::from(i / 20) / 10.0 - 0.95, z)).collect()
    };
    let (mesh, above) = (folder.file("mesh.obj", square), folder.points("above.xyz", &grid(0.25)));
    let mut figure = FigureOptions::default();
    figure.error_row = Some(Colormap::Viridis);
    figure.unit = Some("m".into());
    let to_mesh = draw(&[mesh, above.clone()], &render(), &figure).unwrap();
    assert!(words(&to_mesh).contains(&"mean 0.250 m"), "{:?}", words(&to_mesh));
    // A quarter of the points: to the nearest of those left, one spacing or its diagonal is the least distance. They
    // are a little below the others, so that distances back aren't 0. The Chamfer distance is the mean of both means.
    let is_kept = |(i, _): &(usize, DVec3)| i % 2 == 0 && i / 20 % 2 == 0;
    let few: Vec<DVec3> = grid(-0.03).into_iter().enumerate().filter(is_kept).map(|(_, p)| p).collect();
    let all = grid(0.0);
    let least = |p: &DVec3, to: &[DVec3]| to.iter().map(|q| p.distance(*q)).fold(f64::INFINITY, f64::min);
    let mean = |from: &[DVec3], to: &[DVec3]| from.iter().map(|p| least(p, to)).sum::<f64>() / from.len() as f64;
    let chamfer = 0.5 * (mean(&all, &few) + mean(&few, &all));
    let files = [folder.points("few.xyz", &few), folder.points("all.xyz", &all)];
    let to_points = draw(&files, &render(), &figure).unwrap();
    let expected = format!("CD {chamfer:.4} m");
    assert!(words(&to_points).contains(&expected.as_str()), "{expected}: {:?}", words(&to_points));
}

#[test]
fn panels_share_camera_light_and_range() {
    let folder = Folder::new("shared");
    let points = sphere(2000, 1.0);
    let mut beside = points.clone();
    beside.extend(points.iter().map(|p| *p * 0.1 + DVec3::new(3.0, 0.0, 2.0)));
    let files = [folder.points("a.xyz", &points), folder.points("b.xyz", &beside)];
    let mut render = render();
    render.set("color-by", "height").unwrap();
    let image = draw(&files, &render, &FigureOptions::default()).unwrap();
    let all = panels(&image.drawing);
    // The sphere of both files has the same place and the same colours.
    let differs = |a: &[u8; 4], b: &[u8; 4]| a.iter().zip(b).any(|(a, b)| a.abs_diff(*b) > 16);
    let drawn = || all[0].rgba.iter().zip(&all[1].rgba).filter(|(a, _)| a[..3] != [255; 3]);
    let (other, count) = (drawn().filter(|(a, b)| differs(a, b)).count(), drawn().count());
    assert!(count > 500 && other * 50 < count, "{other} of {count} pixels differ");
    assert_eq!(words(&image).iter().filter(|text| **text == "height").count(), 1, "one bar");
    assert!(words(&image).contains(&"a") && words(&image).contains(&"b"), "titles are the files' names");
}

#[test]
fn figures_have_the_width_that_is_asked_for() {
    let folder = Folder::new("width");
    let files = [folder.points("a.xyz", &sphere(500, 1.0)), folder.points("b.xyz", &sphere(500, 1.0))];
    let mut figure = FigureOptions::default();
    figure.width = Some(surfel_app::figure::Length::Inches(3.0));
    figure.error_row = Some(Colormap::Inferno);
    let image = draw(&files, &render(), &figure).unwrap();
    assert_eq!((image.drawing.size[0], image.dpi), (900, 300.0));
    let text = image.drawing.texts().find(|text| text.text == "a").unwrap();
    assert!((text.size - 8.0 * 300.0 / 72.0).abs() < 1e-9, "8 points");
    figure.width = Some(surfel_app::figure::Length::Pixels(60.0));
    figure.font_pt = Some(8.0);
    assert!(draw(&files, &render(), &figure).unwrap_err().to_string().contains("--width"));
}

#[test]
fn subjects_have_rows_of_their_own() {
    let folder = Folder::new("subjects");
    let far: Vec<DVec3> = sphere(500, 2.0).into_iter().map(|p| p + DVec3::X * 100.0).collect();
    let (a, b) = (folder.points("a.xyz", &sphere(500, 1.0)), folder.points("b.xyz", &far));
    let files = [a.clone(), a, b.clone(), b];
    let mut figure = FigureOptions::default();
    figure.subjects = Some(2);
    figure.titles = vec!["truth".into(), "ours".into()];
    figure.row_titles = vec!["near".into(), "far".into()];
    let image = draw(&files, &render(), &figure).unwrap();
    let all = panels(&image.drawing);
    let covered = |picture: &Picture| picture.rgba.iter().filter(|pixel| pixel[..3] != [255; 3]).count();
    assert_eq!(all.len(), 4);
    assert!(all.iter().all(|picture| covered(picture) > 4000), "each fills its panel");
    let rows = |picture: &Picture| picture.size[1];
    let heights: Vec<u32> = all.iter().map(|picture| rows(picture)).collect();
    assert!(heights.iter().all(|height| *height < 120), "rows are cropped to what they show: {heights:?}");
    assert!(rows(all[0]) == rows(all[1]) && rows(all[2]) == rows(all[3]), "a subject has one height");
    assert_eq!(words(&image).iter().filter(|text| **text == "truth").count(), 1, "titles are below the last row");
    figure.subjects = Some(3);
    assert!(draw(&files, &render(), &figure).unwrap_err().to_string().contains("--subjects 3"));
}

#[test]
fn objects_have_the_colour_that_is_asked_for() {
    let folder = Folder::new("color");
    let file = folder.points("a.xyz", &sphere(2000, 1.0));
    let mut options = render();
    options.set("color", "#c04020").unwrap();
    options.set("shader", "unlit").unwrap();
    options.set("background", "white").unwrap();
    let request = surfel_app::request::Request::new(
        surfel_app::request::Source::of(&[file], None).unwrap(),
        &surfel_app::request::Pictures::One,
        &options,
    );
    let request = request.unwrap();
    let loaded = request.load(&NoProgress).unwrap();
    let resolved = request.resolve(loaded, &NoProgress, &mut |_| {}).unwrap();
    assert_eq!(resolved.file.objects[0].material.color.map(|color| color.0), Some([0xc0, 0x40, 0x20]));
    // The scene file alone gives the same image.
    let options = surfel_load::LoadOptions::default();
    let (again, _): (Scene, _) =
        surfel_load::load_scene(&resolved.file, std::path::Path::new(""), &options, &NoProgress).unwrap();
    for scene in [&resolved.scene, &again] {
        let mut backend = Backend::auto().unwrap();
        let resident = backend.upload(scene).unwrap();
        let frame = backend.render(&resident, &resolved.file.camera, &resolved.file.settings).unwrap();
        assert_eq!(surfel_io::to_srgb8(frame.color())[60 * 120 + 60], [0xc0, 0x40, 0x20, 255]);
    }
}

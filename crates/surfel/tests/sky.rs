//! Light of skies, and ground, from flags and scene files to images.

use std::path::{Path, PathBuf};
use surfel_app::request::{Pictures, Request, Resolved, SceneSource, Source};
use surfel_app::{RenderOptions, session::Session};
use surfel_backend::{Backend, BackendOptions};
use surfel_load::Error;
use surfel_model::Shader;
use surfel_model::{GroundStyle, SceneFile};
use surfel_render::{Frame, Planes, Region, Renderer as _, View};
use surfel_sample::NoProgress;

const SIDE: usize = 64;

/// Writes a ball of points that stands on the point (0, 0, 0), and returns its path.
fn ball(name: &str) -> PathBuf {
    let path = std::env::temp_dir().join(format!("surfel-sky-{}-{name}.xyz", std::process::id()));
    let mut text = String::new();
    for i in 0..4000 {
        let z = 1.0 - (2.0 * f64::from(i) + 1.0) / 4000.0;
        let ((sin, cos), r) = ((2.399_963_229_728_653 * f64::from(i)).sin_cos(), (1.0 - z * z).sqrt());
        text += &format!("{:.5} {:.5} {:.5}\n", r * cos, r * sin, z + 1.0);
    }
    std::fs::write(&path, text).unwrap();
    path
}

fn options(flags: &[(&str, &str)]) -> RenderOptions {
    let mut options = RenderOptions::default();
    for (name, text) in [("size", "64x64"), ("up", "+z"), ("light-directions", "16")] {
        options.set(name, text).unwrap();
    }
    if !flags.iter().any(|(name, _)| *name == "eye") {
        options.set("view", "30,35").unwrap();
    }
    flags.iter().for_each(|(name, text)| options.set(name, text).unwrap());
    options
}

fn resolve(source: Source, options: &RenderOptions) -> Result<Resolved, Error> {
    let request = Request::new(source, &Pictures::One, options)?;
    let loaded = request.load(&NoProgress)?;
    request.resolve(loaded, &NoProgress, &mut |_| ())
}

fn resolved(path: &Path, options: &RenderOptions) -> Resolved {
    resolve(Source::of(&[path.to_path_buf()], None).unwrap(), options).unwrap()
}

fn draw(resolved: &Resolved, region: Option<Region>, planes: Planes) -> Frame {
    let mut backend = Backend::by_name("cpu", &BackendOptions::default()).unwrap();
    let resident = backend.upload(&resolved.scene).unwrap();
    let view = View::of_region(&resolved.file.camera, region).unwrap();
    let mut frame = Frame::default();
    backend.render_into(&resident, &view, &resolved.file.settings, planes, &mut frame).unwrap();
    frame
}

fn image(path: &Path, flags: &[(&str, &str)]) -> Vec<[f32; 4]> {
    draw(&resolved(path, &options(flags)), None, Planes::COLOR).color().to_vec()
}

#[test]
fn sky_lights_the_top_and_its_light_stands_still() {
    let path = ball("top");
    let scene = resolved(&path, &options(&[("light", "sky")]));
    assert_eq!((scene.file.settings.shader, &scene.file.lights, scene.file.ground), (Shader::Unlit, &None, None));
    let frame = draw(&scene, None, Planes::COLOR);
    let level = |row: usize| frame.color()[row * SIDE + SIDE / 2][0];
    let rows: Vec<usize> = (0..SIDE).filter(|row| frame.color()[row * SIDE + SIDE / 2][3] > 0.99).collect();
    let (top, bottom) = (level(rows[rows.len() / 10]), level(rows[rows.len() * 9 / 10]));
    assert!(top > 1.5 * bottom && bottom > 0.2, "{top} above {bottom}");
    // A turn moves the camera and no light.
    let (camera, moved) = scene.turned(1, 4);
    assert!(camera != scene.file.camera && moved.is_none());
    std::fs::remove_file(path).unwrap();
}

#[test]
fn ground_has_a_shadow_behind_the_image_and_its_background() {
    let path = ball("shadow");
    // Views that are framed leave more room above a ground.
    let [eye, target] = [("eye", "2.2,-3.8,4"), ("target", "0,0,1")];
    let clear = image(&path, &[("light", "studio"), ("background", "transparent"), eye, target]);
    let shadow = image(&path, &[("ground", "shadow"), ("background", "transparent"), eye, target]);
    let white = image(&path, &[("ground", "shadow"), ("background", "white"), eye, target]);
    let mut darkest: f32 = 0.0;
    for ((clear, shadow), white) in clear.iter().zip(&shadow).zip(&white) {
        // The ball doesn't change, and what it leaves gets black of the shadow's alpha, then white.
        let [r, g, b, a] = *clear;
        let behind = (shadow[3] - a) / (1.0 - a).max(1e-6);
        assert!(shadow.iter().zip([r, g, b]).all(|(s, c)| (s - c).abs() < 1e-6), "{shadow:?} {clear:?}");
        assert!((white[0] - (r + 1.0 - shadow[3])).abs() < 1e-5 && (white[3] - 1.0).abs() < 1e-6);
        darkest = darkest.max(if a < 0.01 { behind } else { 0.0 });
    }
    assert!((0.15..0.9).contains(&darkest), "the darkest shadow has the alpha {darkest}");
    assert!(shadow[0][3] < 0.02, "far away there is no shadow");
    std::fs::remove_file(path).unwrap();
}

#[test]
fn planes_and_grids_fade_and_vanish_from_below() {
    let path = ball("plane");
    let background = ("background", "transparent");
    let plane = image(&path, &[("ground", "plane"), background]);
    let grid = image(&path, &[("ground", "grid"), background]);
    let last = SIDE * SIDE - SIDE / 2;
    assert!(plane[last][3] > 0.9 && plane[last][0] > 0.3, "{:?}", plane[last]);
    let lines = grid.iter().filter(|c| c[3] > 0.1 && c[0] > 0.0).count();
    assert!(lines > 50, "{lines} pixels show lines");
    let [eye, target] = [("eye", "2.2,-3.8,-2"), ("target", "0,0,1")];
    let below = image(&path, &[("ground", "plane"), eye, target, background]);
    let plain = image(&path, &[("light", "studio"), eye, target, background]);
    assert!(below == plain);
    // A ground leaves room around what is framed.
    let covered = |flags: &[(&str, &str)]| image(&path, flags).iter().filter(|c| c[3] > 0.5).count();
    let (alone, above) = (covered(&[("light", "sky"), background]), covered(&[("ground", "shadow"), background]));
    assert!((above as f64) < 0.9 * alone as f64 && 2 * above > alone, "{above} of {alone}");
    std::fs::remove_file(path).unwrap();
}

#[test]
fn regions_encoded_colours_and_sessions_equal_the_whole_image() {
    let path = ball("parts");
    let flags = [("ground", "grid"), ("bounce", "on"), ("background", "#204060")];
    let scene = resolved(&path, &options(&flags));
    let whole = draw(&scene, None, Planes::COLOR.with_rgba8(true));
    let region = Region { x: 10, y: 30, width: 33, height: 21 };
    let part = draw(&scene, Some(region), Planes::COLOR);
    for y in 0..21 {
        let row = (30 + y) * SIDE + 10;
        assert_eq!(part.color()[y * 33..(y + 1) * 33], whole.color()[row..row + 33]);
    }
    let encoded = draw(&scene, None, Planes::default().with_color(false).with_rgba8(true));
    assert_eq!(encoded.rgba8(), whole.rgba8());
    assert!(encoded.color().is_empty() && whole.rgba8().iter().all(|pixel| pixel[3] == 255));

    let mut session = Session::start(vec![path.clone()], None, "cpu", BackendOptions::default()).unwrap();
    for flags in [&flags[..], &[("light", "headlight")], &flags] {
        let options = options(&flags.iter().copied().filter(|(name, _)| *name != "light").collect::<Vec<_>>());
        let options = if flags.len() == 1 { headlight() } else { options };
        session.show(&options, &NoProgress, &mut |_| ()).unwrap();
        session.draw(&options, Planes::COLOR).unwrap();
    }
    assert_eq!(session.frame().color(), whole.color());
    std::fs::remove_file(path).unwrap();
}

fn headlight() -> RenderOptions {
    let mut options = RenderOptions::default();
    for (name, text) in [("size", "64x64"), ("up", "+z"), ("view", "30,35"), ("light", "headlight")] {
        options.set(name, text).unwrap();
    }
    options
}

#[test]
fn scene_files_hold_sky_and_ground_and_flags_replace_them() {
    let path = ball("file");
    let first = resolved(&path, &options(&[("light", "studio"), ("ground", "grid"), ("bounce", "on")]));
    let json = serde_json::to_string(&first.file).unwrap();
    let file: SceneFile = serde_json::from_str(&json).unwrap();
    let again = |flags: &[(&str, &str)]| {
        let mut options = RenderOptions::default();
        flags.iter().for_each(|(name, text)| options.set(name, text).unwrap());
        let source = SceneSource {
            file: file.clone(),
            keys: ["shader".to_owned()].into(),
            name: "scene.json".into(),
            base: PathBuf::new(),
        };
        resolve(Source::Scene(Box::new(source)), &options).unwrap()
    };
    let same = again(&[]);
    assert_eq!((&same.file.sky, same.file.ground), (&first.file.sky, first.file.ground));
    assert_eq!(draw(&same, None, Planes::COLOR).color(), draw(&first, None, Planes::COLOR).color());
    assert_eq!(again(&[("ground", "plane")]).file.ground.map(|ground| ground.style), Some(GroundStyle::Plane));
    assert_eq!(again(&[("ground", "none")]).file.ground, None);
    assert_eq!(again(&[("light-directions", "7")]).file.sky.map(|sky| sky.directions), Some(7));
    assert_eq!(again(&[("bounce", "off")]).file.sky.map(|sky| sky.bounce), Some(false));
    let lit = again(&[("light", "headlight")]);
    assert_eq!((lit.file.sky, lit.file.ground), (None, None));
    std::fs::remove_file(path).unwrap();
}

#[test]
fn styles_light_what_can_store_light_and_flags_win() {
    let path = ball("style");
    let style = |flags: &[(&str, &str)]| {
        let mut all = RenderOptions::default();
        for (name, text) in [("style", "figure"), ("up", "+z")].iter().chain(flags) {
            all.set(name, text).unwrap();
        }
        resolved(&path, &all).file
    };
    let plain = style(&[]);
    assert!(plain.sky.is_some_and(|sky| sky.bounce) && plain.ground.is_some());
    let toon = style(&[("shader", "toon")]);
    assert!(toon.sky.is_none() && toon.ground.is_none() && toon.settings.shader == Shader::Toon);
    let headlight = style(&[("light", "headlight")]);
    assert!(headlight.sky.is_none() && headlight.ground.is_none());
    let bare = style(&[("ground", "none"), ("bounce", "off")]);
    assert!(bare.sky.is_some_and(|sky| !sky.bounce) && bare.ground.is_none());
    std::fs::remove_file(path).unwrap();
}

#[test]
fn lights_that_contradict_other_flags_are_refused() {
    for (flags, named) in [
        ([("light", "studio"), ("shader", "toon")], "--shader"),
        ([("light", "sun"), ("shadows", "on")], "--shadows"),
        ([("light", "sky"), ("matcap", "builtin")], "--matcap"),
        ([("light", "headlight"), ("ground", "plane")], "--ground"),
        ([("light", "headlight"), ("bounce", "on")], "--bounce"),
        ([("light", "headlight"), ("light-directions", "8")], "--light-directions"),
    ] {
        let mut options = RenderOptions::default();
        flags.iter().for_each(|(name, text)| options.set(name, text).unwrap());
        let error = options.check().unwrap_err().to_string();
        assert!(error.contains(named), "{error}");
    }
    let path = ball("unused");
    for flags in [[("bounce", "on")], [("light-directions", "8")]] {
        let mut options = RenderOptions::default();
        flags.iter().for_each(|(name, text)| options.set(name, text).unwrap());
        let error =
            resolve(Source::of(std::slice::from_ref(&path), None).unwrap(), &options).err().unwrap().to_string();
        assert!(error.contains("--light studio"), "{error}");
    }
    std::fs::remove_file(path).unwrap();
}

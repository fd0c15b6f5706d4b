//! Sessions: their images equal those of requests that load the files anew, to the bit.

use std::path::{Path, PathBuf};
use surfel_app::request::{Pictures, Request, Source};
use surfel_app::{RenderOptions, session::Session};
use surfel_backend::{Backend, BackendOptions};
use surfel_render::{Frame, Planes, Renderer as _, View};
use surfel_sample::NoProgress;

/// Writes a hill of points with classes, and returns its path.
fn hill(name: &str) -> PathBuf {
    let path = std::env::temp_dir().join(format!("surfel-session-{}-{name}.txt", std::process::id()));
    let mut text = "x y z classification\n".to_owned();
    for i in 0..2500 {
        let (x, y) = (f64::from(i % 50) * 0.1, f64::from(i / 50) * 0.1);
        text += &format!("{x:.2} {y:.2} {:.4} {}\n", (x * 1.3).sin() * 0.4 + (y * 0.9).cos() * 0.5, 2 + i % 3);
    }
    std::fs::write(&path, text).unwrap();
    path
}

fn options(flags: &[(&str, &str)]) -> RenderOptions {
    let mut options = RenderOptions::default();
    options.set("size", "90x70").unwrap();
    flags.iter().for_each(|(name, text)| options.set(name, text).unwrap());
    options
}

/// Draws an image as `surfel render` does.
fn fresh(path: &Path, options: &RenderOptions) -> Frame {
    let source = Source::of(&[path.to_path_buf()], None).unwrap();
    let request = Request::new(source, &Pictures::One, options).unwrap();
    let loaded = request.load(&NoProgress).unwrap();
    let resolved = request.resolve(loaded, &NoProgress, &mut |_| ()).unwrap();
    let mut backend = Backend::by_name("cpu", &BackendOptions::default()).unwrap();
    let resident = backend.upload(&resolved.scene).unwrap();
    let (view, mut frame) = (View::new(&resolved.file.camera).unwrap(), Frame::default());
    backend.render_into(&resident, &view, &resolved.file.settings, Planes::COLOR, &mut frame).unwrap();
    frame
}

#[test]
fn images_equal_those_of_fresh_requests_whatever_came_before() {
    let path = hill("equal");
    let mut session = Session::start(vec![path.clone()], None, "cpu", BackendOptions::default()).unwrap();
    let near = [("eye", "2,-3,4"), ("target", "2.5,2.5,0"), ("camera-up", "0,0,1")];
    let all: [Vec<(&str, &str)>; 9] = [
        vec![],
        near.to_vec(),
        [&near[..], &[("shader", "edl")]].concat(),
        [&near[..], &[("shadows", "on"), ("preset", "quality")]].concat(),
        [&near[..], &[("classes", "2,3"), ("color-by", "classification")]].concat(),
        [&near[..], &[("ortho", "on"), ("ortho-height", "3")]].concat(),
        vec![("view", "back"), ("cull", "back"), ("background", "0.1,0.2,0.3")],
        vec![("up", "+y")],
        vec![],
    ];
    for flags in &all {
        let options = options(flags);
        let expected = fresh(&path, &options);
        for glances in [true, false] {
            if glances && session.shown().is_some() {
                let mut moved = options.clone();
                (moved.eye, moved.view) = (Some([5.0, 5.0, 5.0]), None);
                session.draw_preview(&moved).unwrap();
            }
            session.show(&options, &NoProgress, &mut |_| ()).unwrap();
            session.draw(&options, Planes::COLOR).unwrap();
            assert!(session.frame().color() == expected.color(), "{flags:?} {glances}");
        }
    }
    std::fs::remove_file(path).unwrap();
}

#[test]
fn samples_give_way_to_all_points() {
    let path = hill("sample");
    let mut session = Session::start(vec![path.clone()], None, "cpu", BackendOptions::default()).unwrap();
    // So few points have no sample. They are loaded once.
    assert!(session.show_coarse(&options(&[]), &NoProgress).unwrap().is_none());
    assert!(session.draw_preview(&options(&[])).is_err());
    std::fs::remove_file(&path).unwrap();
    session.show(&options(&[]), &NoProgress, &mut |_| ()).unwrap();

    let mut session = Session::start(vec![path.clone()], None, "cpu", BackendOptions::default()).unwrap();
    let mut text = String::new();
    for i in 0..120_000 {
        let (x, y) = (f64::from(i % 400) * 0.1, f64::from(i / 400) * 0.1);
        text += &format!("{x:.2} {y:.2} {:.3}\n", (x * 0.3).sin() * (y * 0.2).cos());
    }
    std::fs::write(&path, text).unwrap();
    let options = options(&[("view", "iso")]);
    let loader = session.show_coarse(&options, &NoProgress).unwrap().unwrap();
    session.draw_preview(&options).unwrap();
    assert!(session.frame().color().iter().any(|pixel| pixel[0] < 0.9), "the sample is invisible");
    let loaded = loader.load(&NoProgress).unwrap();
    session.adopt(loaded);
    let mut notes = 0;
    session.show(&options, &NoProgress, &mut |_| notes += 1).unwrap();
    session.draw(&options, Planes::COLOR).unwrap();
    assert!(notes > 0 && session.frame().color() == fresh(&path, &options).color());
    assert_eq!(session.description()["splats"], 120_000);
    std::fs::remove_file(path).unwrap();
}

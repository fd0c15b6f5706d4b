//! Tests of packed images of the reference, and of comparisons with them on a machine that doesn't draw them.

use std::path::PathBuf;
use surfel_conformance::backends::{Backend, Start, run_reporting};
use surfel_conformance::expectations::Extent;
use surfel_conformance::harness::{Truth, Verdict};
use surfel_conformance::{runner, truths};

const SCENES: [&str; 3] = ["facing-splat", "tilted-splat", "panes"];

fn is_wanted(name: &str) -> bool {
    SCENES.iter().any(|scene| name.starts_with(scene))
}

/// A folder that is removed when the value is dropped.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("surfel-truths-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

#[test]
fn packed_images_are_the_same_bits_and_judge_a_backend_alike() {
    let folder = Folder::new("bits");
    let path = folder.0.join("truths.gz");
    let drawn = Truth::all(is_wanted).unwrap();
    assert!(drawn.len() >= 2, "the scenes have other names");
    truths::write(&path, &drawn).unwrap();
    let read = truths::read(&path, is_wanted).unwrap();
    assert_eq!(read.len(), drawn.len());
    for (read, drawn) in read.iter().zip(&drawn) {
        assert_eq!(read.case.name, drawn.case.name);
        let [read, drawn] = [read, drawn].map(|truth| truth.want.as_ref().unwrap());
        assert_eq!([read.width(), read.height()], [drawn.width(), drawn.height()]);
        assert_eq!((read.color(), read.depth()), (drawn.color(), drawn.depth()));
        assert_eq!((read.normal(), read.weight(), read.margin()), (drawn.normal(), drawn.weight(), drawn.margin()));
    }
    let start = Start { adapter: None, validation: false, path: surfel_gpu::GpuPath::Auto, wgsl: false };
    let mut seen = Vec::new();
    let run = run_reporting(Backend::Cpu, start, &read, Extent::SomeScenes, |session, truth, report, _| {
        let repeated = session.repeat(&truth.case, 3).unwrap();
        assert!(repeated.hashes.values().all(|hashes| hashes.len() == 3 && hashes[0] == hashes[2]), "{repeated:?}");
        seen.push(report.verdict.clone());
    });
    assert!(run.unwrap().is_ok());
    assert_eq!(seen, vec![Verdict::Passed; read.len()]);
    // A wrong pixel in the file is found.
    let mut spoilt = read;
    spoilt[0].want.as_mut().unwrap().color_mut()[40] = [9.0; 4];
    let run = run_reporting(Backend::Cpu, start, &spoilt, Extent::SomeScenes, |_, _, _, _| ()).unwrap();
    assert!(matches!(run.checked[0].report.verdict, Verdict::Failed(_)) && run.checked[1].report.is_ok());
}

#[test]
fn packed_images_of_another_program_are_refused() {
    let folder = Folder::new("refused");
    let path = folder.0.join("truths.gz");
    let problem = |path: &std::path::Path| truths::read(path, is_wanted).err().unwrap().to_string();
    assert!(problem(&path).contains("truths.gz"));
    std::fs::write(&path, "no stream").unwrap();
    assert!(problem(&path).contains("truths.gz"));
    let drawn = Truth::all(|name| name == SCENES[0]).unwrap();
    truths::write(&path, &drawn).unwrap();
    let lacks = problem(&path);
    assert!(lacks.contains("holds no image of") && lacks.contains("build program and file together"), "{lacks}");
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    assert!(problem(&path).contains("truths.gz"));
}

#[test]
fn runner_writes_a_line_for_each_scene() {
    let folder = Folder::new("lines");
    let (path, out) = (folder.0.join("truths.gz"), folder.0.join("out"));
    let run = |words: &[&str]| runner::main(words.iter().map(|word| (*word).to_owned()));
    let (path, out_words) = (path.to_string_lossy().into_owned(), out.to_string_lossy().into_owned());
    let scenes = ["--backend", "cpu", "--scene", "facing-splat"];
    assert_eq!(run(&[&scenes[..], &["--write-truths", &path]].concat()), std::process::ExitCode::SUCCESS);
    let words = [&scenes[..], &["--truths", &path, "--out", &out_words, "--no-validation"]].concat();
    assert_eq!(run(&words), std::process::ExitCode::SUCCESS);
    let lines = std::fs::read_to_string(out.join("results.jsonl")).unwrap();
    let count = Truth::all(|name| name.contains("facing-splat")).unwrap().len();
    assert_eq!(lines.lines().count(), count);
    let first = lines.lines().next().unwrap();
    for part in ["\"kind\":\"conformance\"", "\"backend\":\"cpu\"", "\"verdict\":\"passed\"", "\"hashes\":{\"Z\":["] {
        assert!(first.contains(part), "{part}: {first}");
    }
}

//! Tests that no output is lost or overwritten, and that errors name the file at fault.

#![cfg(unix)]

use crate::common::{Folder, ball, las_at, points};
use std::os::unix::fs::symlink;

/// Returns points with varying heights, for colours by height.
fn hill() -> String {
    let at = |i: u32| (f64::from(i % 20), f64::from(i / 20));
    (0..400).map(at).map(|(x, y)| format!("{x} {y} {}\n", (x * 0.3).sin() + y * 0.1)).collect()
}

#[test]
fn two_outputs_of_one_file_are_refused_whatever_they_are_called() {
    let f = Folder::new("same-output");
    f.write("a.las", las_at(20, 0));
    f.write("a.xyz", hill());
    f.write("b.xyz", hill());
    std::fs::create_dir(f.path().join("in")).unwrap();
    let link = |to: &str, from: &str| symlink(f.path().join(to), f.path().join(from)).unwrap();
    f.write("t.png", "");
    f.write("t.tif", "");
    link("t.png", "to-t.png");
    link("t.tif", "to-t.tif");
    link("in", "to-in");
    let by_height = "--color-by height --force";
    for words in [
        "ortho a.las --gsd 0.5 -o s.tif --dsm ./s.tif --force",
        "ortho a.las --gsd 0.5 -o t.tif --dsm to-t.tif --force",
        "ortho a.las --gsd 0.5 -o in/s.tif --normals to-in/s.tif --force",
        "ortho a.las --gsd 0.5 -o s.tif --dsm in/../s.tif --force",
        &format!("ortho a.las --gsd 0.5 -o s.tif --colorbar=./s.tif {by_height}"),
        &format!("render a.xyz {by_height} --colorbar=./k.png -o k.png"),
        &format!("render a.xyz {by_height} --colorbar=to-t.png -o t.png"),
        // One colour bar of two inputs, and one image.
        &format!("render a.xyz b.xyz {by_height} --colorbar=k.png -o {{input}}.png"),
        "render a.xyz in/a.xyz -o {input}.png --force",
        &format!("convert a.xyz {by_height} --colorbar=./o.ply -o o.ply"),
    ] {
        let before = f.names();
        let error = f.run(words).fails(2, "").stderr();
        assert!(
            ["is the name of", "are one file", "would both be written to"].iter().any(|part| error.contains(part)),
            "{words}: {error}"
        );
        assert_eq!(f.names(), before, "{words}");
    }
    // Different files with similar names.
    f.run(&format!("render a.xyz {by_height} --colorbar=in/k.png -o k.png --size 16x16")).code(0);
    assert!(f.has("in/k.png") && f.has("k.png"));
}

#[test]
fn inputs_are_not_written_over_by_images() {
    let f = Folder::new("input-output");
    f.write("a.ply", ball());
    f.run("a.ply -o a.png --size 16x16").code(0);
    f.run("a.ply -o b.png --size 16x16 --view front").code(0);
    symlink(f.path().join("b.png"), f.path().join("to-b.png")).unwrap();
    let before = f.read("b.png");
    f.run("compare a.png b.png --diff ./b.png --force").fails(2, "is an input, too");
    f.run("compare a.png b.png --diff to-b.png --force").fails(2, "is an input, too");
    assert_eq!(f.read("b.png"), before);
}

#[test]
fn planted_links_are_not_followed_by_resume() {
    let f = Folder::new("planted");
    f.write("a.las", las_at(20, 0));
    f.write("precious", "SECRET");
    std::fs::create_dir(f.path().join("r.copc.laz.resume")).unwrap();
    for name in ["points", "lock", "manifest.json", "manifest.json.new"] {
        let planted = f.path().join("r.copc.laz.resume").join(name);
        symlink(f.path().join("precious"), &planted).unwrap();
        f.run("convert a.las -o r.copc.laz --resume").fails(3, "which is a link or no file");
        std::fs::remove_file(planted).unwrap();
    }
    assert_eq!(f.read("precious"), b"SECRET");
    f.run("convert a.las -o r.copc.laz --resume").code(0);
}

#[test]
fn wrong_inputs_are_blamed_also_while_writing() {
    let f = Folder::new("blamed");
    f.write("nan.xyz", format!("{}nan 1 2\n", points()));
    let header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty double x\nproperty double y\nproperty double z\n";
    f.write("nan.ply", format!("{header}end_header\n0 0 0\n1 nan 0\n0 1 inf\n"));
    f.write("nans.ply", format!("{header}end_header\nnan 0 0\n1 nan 0\n0 1 inf\n"));
    let mut none = las_at(1, 0);
    none.truncate(375);
    none[247..255].fill(0);
    f.write("none.las", none);
    let mut wide = las_at(2, 0);
    wide.truncate(375);
    wide[105..107].copy_from_slice(&65_535_u16.to_le_bytes());
    wide.resize(375 + 4 * 65_535, 0);
    f.write("wide.las", wide);
    for (input, expected) in [("none.las", 3), ("wide.las", 3), ("nans.ply", 3)] {
        let run = f.run(&format!("convert {input} -o o.copc.laz")).fails(expected, &format!("error: {input}: "));
        assert!(!run.stderr().contains("cannot write it"), "{}", run.stderr());
        assert!(!f.has("o.copc.laz"), "{input}");
    }
    // NaN points among others are dropped, as in drawing, or are reported as a fault of the input.
    for input in ["nan.ply", "nan.xyz"] {
        let run = f.run(&format!("convert {input} -o o.copc.laz --force"));
        assert!(!run.stderr().contains("cannot write it"), "{}", run.stderr());
    }
    f.write("a.ply", ball());
    let name = "x".repeat(300);
    let cameras = format!(
        r#"{{"fl_x": 20, "fl_y": 20, "cx": 8, "cy": 8, "w": 16, "h": 16, "frames": [{{"file_path": "{name}.png",
            "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,5],[0,0,0,1]]}}]}}"#
    );
    f.write("transforms.json", cameras);
    f.run("a.ply --cameras transforms.json -o o-{name}.png")
        .fails(3, "transforms.json: has a camera name of 300 bytes");
    f.run("a.ply --cameras transforms.json -o o.png").code(0);
}

#[test]
fn a_terminal_obeys_no_file_name() {
    let f = Folder::new("names");
    let name = "a\u{1b}[31m\nb\u{202e}.ply";
    let error = f.run_words(&[name, "-o", "o.png"]).fails(3, "a\\u{1b}[31m\\nb\\u{202e}.ply").stderr();
    assert!(error.lines().any(|line| line.starts_with("error: a\\u{1b}")), "{error}");
    f.write(name, ball());
    let run = f.run_words(&["convert", name, "-o", "o\u{7}.ply", "-v"]).code(0);
    let output = f.run_words(&[name, "-o", "./o\u{7}.png", "--size", "16x16", "-v"]).code(0).stderr();
    for text in [run.stderr(), output] {
        assert!(!text.contains(['\u{1b}', '\u{7}', '\u{202e}']), "{text:?}");
    }
}

#[test]
fn coincident_points_by_levels_are_as_few_as_without() {
    let f = Folder::new("coincident");
    let mut las = las_at(40, 0);
    let record = las[375..375 + 36].to_vec();
    (0..5000).for_each(|_| las.extend_from_slice(&record));
    las[247..255].copy_from_slice(&6600_u64.to_le_bytes());
    f.write("a.las", las);
    f.run("convert a.las -o a.copc.laz").code(0);
    let splats = |input: &str| {
        let run = f.run(&format!("{input} -o o.png --size 64x64 --stats --force")).code(0);
        (run.json()["splats"].as_u64().unwrap(), run.stderr())
    };
    let (by_levels, note) = splats("a.copc.laz --all-levels");
    let (in_core, _) = splats("a.las");
    assert_eq!((by_levels, in_core), (1615, 1615), "{note}");
    assert!(note.contains("left out 4985 points, because more than 16 are in their place"), "{note}");
    assert_eq!(splats("a.copc.laz --all-levels --all-points").0, 6600);
    let seen = splats("a.copc.laz").0;
    assert!(seen <= 1615, "{seen}");
}

/// Returns the resident memory of a process, in KiB.
#[cfg(target_os = "linux")]
fn resident_kib(process: u32) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap();
    line.split_whitespace().next().unwrap().parse().unwrap()
}

#[cfg(target_os = "linux")]
#[test]
fn serve_gives_back_the_memory_of_a_large_image() {
    use std::io::{BufRead, BufReader, Write};
    let f = Folder::new("serve-memory");
    f.write("a.ply", ball());
    let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_surfel"))
        .current_dir(f.path())
        .args(["serve", "--stdio", "a.ply", "--threads", "1", "--backend", "cpu", "-q"])
        .stdin(std::process::Stdio::piped())
        .stdout(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    let mut answers = BufReader::new(child.stdout.take().unwrap()).lines();
    let mut requests = child.stdin.take().unwrap();
    let mut draw = |size: &str| {
        writeln!(requests, r#"{{"output": "o.png", "size": {size}, "force": true}}"#).unwrap();
        let answer = answers.next().unwrap().unwrap();
        assert!(answer.contains("\"ok\":true"), "{answer}");
        resident_kib(child.id())
    };
    let before = draw("[64, 64]");
    // Its colours alone need 96 MB.
    draw("[3000, 2000]");
    let after = draw("[64, 64]");
    assert!(after < before + (48 << 10), "{before} KiB before, {after} KiB after");
    drop(requests);
    assert!(child.wait().unwrap().success());
}

#[test]
fn a_small_stack_of_the_first_thread_suffices() {
    let f = Folder::new("small-stack");
    f.write("a.xyz", hill());
    let program = env!("CARGO_BIN_EXE_surfel");
    let words = format!("ulimit -s 256 && exec {program} render a.xyz --size 32x32 -o a.png");
    let output = std::process::Command::new("sh").current_dir(f.path()).args(["-c", &words]).output().unwrap();
    assert!(output.status.success(), "{output:?}");
    assert_eq!(f.image("a.png").width, 32);
}

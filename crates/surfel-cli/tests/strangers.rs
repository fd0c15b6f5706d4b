//! Files from unknown sources: references stay in their folder, and costs are bounded. Partially written files never
//! remain.

use crate::common;

#[cfg(unix)]
use common::ignores_signal;
use common::{Folder, cube};
use std::time::Duration;

/// Returns a textured square that names the material library `library`.
fn square(library: &str) -> String {
    format!(
        "mtllib {library}\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl m\n\
         f 1/1 2/2 3/3 4/4\n"
    )
}

#[test]
fn references_stay_in_the_folder_of_the_file_unless_a_flag_allows_others() {
    let f = Folder::new("outside");
    std::fs::create_dir_all(f.path().join("in/sub")).unwrap();
    f.write("m.mtl", "newmtl m\nKd 1 0 0\n");
    f.write("in/sub/my m.mtl", "newmtl m\nKd 1 0 0\nmap_Kd ../../t.png\n");
    f.write("in/a.obj", square("../m.mtl"));
    f.write("in/b.obj", square("sub/my%20m.mtl"));
    f.write("in/c.obj", square("/etc/passwd"));
    f.run("in/b.obj -o t.png --size 4x4").code(0);
    let render =
        |words: &str| f.run(&format!("render {words} -o o.png --force --size 8x8 --per-face")).code(0).stderr();
    for (file, what) in [("a", "../m.mtl"), ("b", "sub/../../t.png"), ("c", "/etc/passwd")] {
        let said = render(&format!("in/{file}.obj"));
        assert!(said.contains(what) && said.contains("--allow-outside"), "{file}: {said}");
        let inputs = f.image("o.png").metadata.into_iter().find(|(key, _)| key == "surfel:inputs").unwrap().1;
        assert!(!inputs.contains("passwd") && !inputs.contains("t.png"), "{inputs}");
    }
    let said = render("in/b.obj --allow-outside");
    assert!(!said.contains("left out"), "{said}");
    let said = f.run("again o.png -o again.png").code(0).stderr();
    assert!(said.contains("to the bit"), "{said}");
    // A buffer can't be omitted.
    let gltf = |uri: &str| {
        format!(
            r#"{{"asset": {{"version": "2.0"}}, "buffers": [{{"uri": "{uri}", "byteLength": 4}}],
            "scenes": [{{}}], "scene": 0}}"#
        )
    };
    f.write("secret.bin", "secret");
    for uri in ["../secret.bin", "%2e%2e/secret.bin", "..%2Fsecret.bin"] {
        f.write("in/d.gltf", gltf(uri));
        f.run("in/d.gltf -o x.png").fails(3, "--allow-outside");
        let allowed = f.run("in/d.gltf -o x.png --allow-outside").code(3).stderr();
        assert!(!allowed.contains("--allow-outside"), "{uri}: {allowed}");
    }
    f.run("info in/a.obj").code(0);
    // Files that the user names may be anywhere, also in a scene file.
    f.write("b.obj", cube());
    f.write("in/s.json", common::scene("").replace("\"a.ply\"", "\"../b.obj\""));
    f.run("in/s.json -o s.png").code(0);
}

#[test]
fn textures_are_reduced_to_the_size_that_is_allowed_and_that_is_said() {
    let f = Folder::new("max-texture");
    f.write("b.obj", cube());
    f.run("b.obj -o t.png --size 64x48 --no-metadata").code(0);
    f.write("t.mtl", "newmtl m\nmap_Kd t.png\n");
    f.write("a.obj", square("t.mtl"));
    let said = f.run("a.obj -o a.png --size 8x8 --max-texture 20").code(0).stderr();
    assert!(said.contains("reduced a texture of 64x48 texels to 16x12 (--max-texture 20"), "{said}");
    let said = f.run("a.obj -o b.png --size 8x8 --max-texture 64").code(0).stderr();
    assert!(!said.contains("reduced"), "{said}");
    let said = f.run("info a.obj --max-texture 8").code(0).stderr();
    assert!(said.contains("reduced"), "{said}");
}

#[test]
fn points_that_stand_for_nothing_are_left_out_and_counted() {
    let f = Folder::new("no-return");
    let (good, zeros) = (common::points(), "0 0 0\n");
    f.write("few.xyz", good.clone() + &zeros.repeat(16));
    f.write("many.xyz", good.clone() + &zeros.repeat(17));
    f.write("equal.xyz", "1 2 3\n".repeat(100_000));
    f.write("zero.xyz", zeros.repeat(5000));
    let splats = |words: &str| {
        let run = f.run(&format!("{words} -o o.png --size 16x16 --force --stats")).code(0);
        (run.json()["splats"].as_u64().unwrap(), run.stderr())
    };
    assert_eq!(splats("few.xyz").0, 316);
    let (count, said) = splats("many.xyz");
    assert_eq!(count, 300);
    assert!(said.contains("left out 17 of 317 points at exactly 0,0,0") && said.contains("--all-points"), "{said}");
    assert_eq!(splats("many.xyz --all-points").0, 317);
    // Sixteen points represent any number at one place, so time is bounded by the file's length.
    let (count, said) = splats("equal.xyz");
    assert_eq!(count, 16);
    assert!(said.contains("99984 points left out, because more than 16 are in their place, to a billionth"), "{said}");
    assert_eq!(splats("zero.xyz").0, 16);
}

/// Returns 101 points as text PLY, all with the same alpha: one at `first`, and a grid whose coordinates are multiplied
/// by `scale`.
fn scattered(first: &str, scale: f64, alpha: f64) -> String {
    let names = ["x", "y", "z", "alpha"].map(|name| format!("property float {name}\n")).concat();
    let point = |i: u32| [i % 10, i / 10, i % 7].map(|c| format!("{:e}", f64::from(c) * scale)).join(" ");
    let points = (0..100).map(|i| format!("{} {alpha}\n", point(i))).collect::<String>();
    format!("ply\nformat ascii 1.0\nelement vertex 101\n{names}end_header\n{first} {alpha}\n{points}")
}

#[test]
fn a_picture_without_anything_on_it_says_what_to_do() {
    let f = Folder::new("blank");
    // An alpha too small for any image; alphas that are all 0 would mean opaque.
    f.write("clear.ply", scattered("3 3 3", 1.0, 1e-45));
    f.write("stray.ply", scattered("1e9 0 0", 1.0, 1.0));
    f.write("far.ply", scattered("0 0 0", 3.5e37, 1.0));
    f.write("seen.ply", scattered("3 3 3", 1.0, 1.0));
    let said = |words: &str| f.run(&format!("{words} --size 32x32 --force")).code(0).stderr();
    let count = |said: &str| said.matches("note: nothing is seen").count();
    let notes = [("clear.ply", "--transparency off"), ("stray.ply", "--outliers drop"), ("far.ply", "scale them")];
    for (words, what) in notes {
        for ending in ["png", "exr", "jpg"] {
            let said = said(&format!("{words} -o o.{ending}"));
            let note = said.lines().find(|line| line.starts_with("note: nothing is seen: "));
            assert!(count(&said) == 1 && note.is_some_and(|note| note.contains(what)), "{words} {ending}: {said}");
        }
    }
    let turned = said("clear.ply -o o{frame}.png --turntable --frames 3");
    assert!(count(&turned) == 1 && turned.contains("nothing is seen in 3 of 3 pictures"), "{turned}");
    // The suggested remedies work; a part of an image may be blank.
    for words in ["seen.ply", "clear.ply --transparency off", "stray.ply --outliers drop", "clear.ply --tile 1/2"] {
        let said = said(&format!("{words} -o o.png"));
        assert_eq!(count(&said), 0, "{words}: {said}");
    }
    let said = said("stray.ply -o o.png");
    assert!(said.contains("1 isolated point (") && !said.contains("1 isolated points"), "{said}");
}

#[test]
fn a_polygon_that_repeats_its_corners_is_drawn_once() {
    let f = Folder::new("repeats");
    f.write("a.obj", format!("v 0 0 0\nv 1 0 0\nv 0 1 0\nf{}\n", " 1 2 3".repeat(2000)));
    let run = f.run("a.obj -o a.png --size 16x16 --stats").code(0);
    // Half a square of side 512 splats, not two thousand times that number, which would be limited to 500,000.
    let splats = run.json()["splats"].as_u64().unwrap();
    assert!((100_000..200_000).contains(&splats), "{splats}");
    assert!(run.stderr().contains("1999 triangles repeat others"), "{}", run.stderr());
}

/// Returns a splat file that takes some time to write.
fn many() -> String {
    let count = 60_000;
    let mut many = format!("ply\nformat ascii 1.0\ncomment interior_weight 3\nelement vertex {count}\n");
    for name in ["x", "y", "z", "nx", "ny", "nz", "radius"] {
        many += &format!("property float {name}\n");
    }
    many += "end_header\n";
    (0..count).for_each(|i| many += &format!("{} {} 0.123456 0 0 1 0.75\n", i % 300, i / 300));
    many
}

/// Runs the program and ends it by a signal during writing, repeatedly until that succeeds. Returns the number of
/// temporary files that remain.
#[cfg(unix)]
fn ended_by(f: &Folder, signal: &str) -> usize {
    let temporary = || f.names().into_iter().filter(|name| name.ends_with(".tmp")).count();
    for _ in 0..40 {
        let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_surfel"))
            .current_dir(f.path())
            .args(["convert", "many.ply", "--ascii", "-o", "o.ply", "--quiet"])
            .spawn()
            .unwrap();
        let mut met = false;
        while child.try_wait().unwrap().is_none() {
            if temporary() > 0 {
                met = std::process::Command::new("kill").args([signal, &child.id().to_string()]).status().is_ok();
                break;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        let ended = child.wait().unwrap();
        if met && !ended.success() {
            assert!(std::os::unix::process::ExitStatusExt::signal(&ended).is_some(), "{ended}");
            assert!(!f.has("o.ply"), "a part of a file");
            return temporary();
        }
        let _ = std::fs::remove_file(f.path().join("o.ply"));
    }
    panic!("{signal} never came in the middle of writing");
}

#[cfg(unix)]
#[test]
fn a_signal_leaves_no_temporary_file_and_the_next_run_removes_what_a_kill_left() {
    let f = Folder::new("signals");
    f.write("many.ply", many());
    assert_eq!(ended_by(&f, "-TERM"), 0);
    // A shell's background jobs ignore it, and what is ignored at the start stays ignored.
    if !ignores_signal(2) {
        assert_eq!(ended_by(&f, "-INT"), 0);
    }
    assert_eq!(ended_by(&f, "-KILL"), 1);
    f.run("convert many.ply -o whole.ply").code(0);
    assert_eq!(f.names(), ["many.ply", "whole.ply"]);
}

/// Returns a command that starts the program in a shell after the command `words`.
#[cfg(unix)]
fn after(f: &Folder, words: &str, arguments: &str) -> std::process::Command {
    let mut shell = std::process::Command::new("sh");
    let program = env!("CARGO_BIN_EXE_surfel");
    shell.current_dir(f.path()).args(["-c", &format!("{words}; exec \"$0\" {arguments}"), program]);
    shell
}

#[cfg(target_os = "linux")]
#[test]
fn signals_ignored_at_the_start_stay_ignored() {
    let f = Folder::new("nohup");
    f.write("many.ply", many());
    let convert = "convert many.ply --ascii -o o.ply --quiet";
    let mut child = after(&f, "trap '' HUP INT TERM", convert).spawn().unwrap();
    while !f.names().iter().any(|name| name.ends_with(".tmp")) {
        assert!(child.try_wait().unwrap().is_none(), "it was never seen writing");
        std::thread::sleep(Duration::from_millis(1));
    }
    for signal in ["-HUP", "-INT", "-TERM"] {
        let sent = std::process::Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap();
        assert!(sent.success(), "{signal}");
    }
    assert!(child.wait().unwrap().success());
    assert_eq!(f.names(), ["many.ply", "o.ply"]);
}

#[cfg(unix)]
#[test]
fn a_file_beyond_the_system_s_limit_is_an_error_that_leaves_nothing() {
    let f = Folder::new("xfsz");
    f.write("many.ply", many());
    for (output, flags) in [("o.ply", ""), ("o.png", "render --size 2000x2000 --shader depth"), ("o.exr", "render")] {
        let command = if flags.is_empty() { "convert" } else { flags };
        let run = after(&f, "ulimit -f 1", &format!("{command} many.ply -o {output} -q")).output().unwrap();
        let said = String::from_utf8_lossy(&run.stderr);
        assert_eq!(run.status.code(), Some(1), "{output}: {said}");
        assert!(said.starts_with(&format!("error: {output}: cannot write it: File too large")), "{said}");
        assert_eq!(f.names(), ["many.ply"]);
    }
}

//! Exit codes, error messages of at most four lines, and no files left behind by failed runs.

use crate::common;

use common::{Folder, ball, cube, scene};
use std::process::Command;

#[test]
fn usage_errors_exit_with_2() {
    let f = Folder::new("usage");
    f.write("a.ply", ball());
    f.write("s.json", scene(""));
    for (words, part) in [
        ("render a.ply -o x.png --size 0x5", "WxH"),
        ("render a.ply -o x.png --fov-y 200", "degrees"),
        ("render a.ply -o x.png --ortho --fov-y 30", "cannot be used with"),
        ("render a.ply -o x.png --view top --eye 1,2,3", "cannot be used with"),
        ("render a.ply -o x.png --eye 1,2", "X,Y,Z"),
        ("render a.ply -o x.png --filter best", "principal"),
        ("render a.ply -o x.png --frames 4", "--turntable"),
        ("render a.ply -o x.png --frames 4 --turntable", "{frame}"),
        ("render a.ply -o x.png --samples 2 --backend cpu", "--backend reference"),
        ("render a.ply -o x.png --size 8x8 --region 4,4,8,8", "region"),
        ("render a.ply -o x.png --eye 1,1,1 --target 1,1,1", "camera"),
        ("render a.ply -o x.png --size 60000x60000", "pixels"),
        ("render a.ply -o x.bmp", ".png, .jpg, .exr or .npz"),
        ("render a.ply -o x.gif", "several frames"),
        ("render a.ply -o x.jpg --png16", "JPEG"),
        ("render a.ply -o x.jpg --exr-f32", "JPEG"),
        ("a.ply a.ply", "{input}"),
        ("render a.ply -o x.png --exr-f32", "EXR"),
        ("render a.ply -o - --stats", "stdout"),
        ("render a.ply", "-o"),
        ("render", "INPUT"),
        ("render a.ply -o x.png --nonsense", "--nonsense"),
        ("render s.json a.ply -o x.png", "goes alone"),
        ("ortho a.ply --gsd 0 -o x.tif", "more than 0"),
        ("ortho a.ply --gsd 1e-7 -o x.tif", "larger gsd"),
        ("ortho a.ply --gsd 0.1 --bounds 1,1,0,0 -o x.tif", "X0 < X1"),
        ("ortho a.ply --gsd 0.1 --bounds 0,0,1e9,1e9 -o x.tif", "larger gsd or smaller bounds"),
        ("ortho a.ply --gsd 0.1 --bounds 0,0,inf,1 -o x.tif", "finite"),
        ("ortho a.ply --gsd 0.1 --crs 25832 -o x.tif", "EPSG:25832"),
        ("ortho a.ply --gsd 0.1 --crs EPSG:4326 -o x.tif", "degrees"),
        ("ortho a.ply --gsd 0.1 --crs EPSG:65536 -o x.tif", "32766"),
        ("ortho a.ply --gsd 0.1 -o x.png", ".tif"),
        ("ortho a.ply --gsd 0.1 -o x.tif --dsm x.tif", "name of -o's file"),
        ("ortho a.ply -o x.tif", "--gsd"),
        ("ortho a.ply --gsd 0.1", "--output"),
        ("ortho a.ply --gsd 0.1 --size 99999999x1 -o x.tif", "--size"),
        ("ortho a.ply --gsd 0.1 --fill 0 -o x.tif", "--fill"),
        ("ortho a.ply --gsd 0.1 --fill 1000 --dsm x.tif", "512 pixels"),
        ("convert a.ply -o x.obj", ".ply"),
        ("convert a.ply -o x.ply --per-face", "expected a mesh"),
        ("convert a.ply -o x.ply --per-face --splats 5", "cannot be used with"),
        ("render a.ply -o x.png --per-face --splats 5", "cannot be used with"),
        ("render a.ply -o x.png --splats 5", "holds splats, expected a mesh for --splats"),
        ("render a.ply -o x.png --max-points 5", "expected points for --max-points"),
        ("convert a.ply -o x.ply --max-points 5", "expected points for --max-points"),
        ("render s.json -o x.png --sharp", "expected points or a mesh for --sharp"),
        ("render a.ply -o x.png --cull front", "back"),
        ("compare a.png b.png --fail-above ssim=1", "METRIC=V"),
        ("completions tcsh-like", "possible values"),
    ] {
        f.run(words).fails(2, part);
    }
    assert_eq!(f.names(), ["a.ply", "s.json"]);
}

#[test]
fn bad_input_exits_with_3() {
    let f = Folder::new("input");
    f.write("empty.ply", "");
    f.write("zero.ply", ball().replace("vertex 200", "vertex 0").split_inclusive("end_header\n").next().unwrap());
    f.write("nan.ply", ball().replacen("0.25", "nan", 1));
    f.write("short.ply", &ball()[..900]);
    f.write("huge.ply", ball().replace("vertex 200", "vertex 99999999999"));
    let binary = ball().replace("ascii", "binary_little_endian").replace("vertex 200", "vertex 18446744073709551615");
    f.write("huge_binary.ply", binary);
    f.write("noise.ply", [0xfeu8; 4096]);
    f.write("nothing.obj", "v 0 0 nan\n");
    f.write("bad.json", "{\"camera\": 1}");
    f.write("key.json", scene("\"filtre\": \"ewa\""));
    f.write("range.json", scene("").replace("[40, 30]", "[0, 30]"));
    f.write("missing.json", scene("").replace("a.ply", "nowhere.ply"));
    for name in ["empty.ply", "zero.ply", "nan.ply", "short.ply", "huge.ply", "huge_binary.ply", "noise.ply"] {
        f.run(&format!("{name} -o x.png --size 8x8")).fails(3, name);
        f.run(&format!("convert {name} -o x.ply")).fails(3, name);
    }
    for name in ["empty.ply", "nan.ply", "short.ply", "huge.ply", "huge_binary.ply", "noise.ply", "key.json"] {
        f.run(&format!("info {name}")).fails(3, name);
    }
    for name in ["bad.json", "key.json", "range.json", "missing.json", "nothing.obj", "nowhere.ply", "."] {
        f.run(&format!("render {name} -o x.png")).fails(3, name.strip_suffix("missing.json").unwrap_or(name));
    }
    assert!(!f.has("x.png") && !f.has("x.ply"));
    f.run("nan.ply -o x.png --size 8x8 --repair").code(0);
}

#[test]
fn backends_that_are_not_here_exit_with_4() {
    let f = Folder::new("backend");
    f.write("a.ply", ball());
    for backend in ["ash", "wgpu", "cpu"] {
        // Either there is no adapter at all, or none with this name.
        f.run(&format!("a.ply -o x.png --backend {backend} --adapter teapot")).fails(4, backend);
    }
    f.run("a.ply -o x.png --backend reference --adapter teapot").fails(4, "teapot");
    assert!(!f.has("x.png"));
    let list = f.run("backends --json").code(0).json();
    let of = |name: &str| list.as_array().unwrap().iter().find(|b| b["name"] == name).unwrap().clone();
    assert_eq!(of("reference")["available"], true);
    // A reason is given exactly if the backend isn't available.
    for backend in ["ash", "wgpu"] {
        assert_eq!(of(backend)["available"] == true, of(backend)["reason"].is_null(), "{backend}");
    }
    assert!(f.run("backends").code(0).stdout().contains("reference"));
}

/// Tests the program without the Cargo feature `wgpu`, as it is built by default.
#[cfg(not(feature = "wgpu"))]
#[test]
fn backend_that_is_not_built_in_names_its_feature() {
    let f = Folder::new("not-built");
    f.write("a.ply", ball());
    f.run("a.ply -o x.png --backend wgpu").fails(4, "--features gpu");
    assert!(!f.has("x.png"));
    let list = f.run("backends --json").code(0).json();
    let wgpu = list.as_array().unwrap().iter().find(|b| b["name"] == "wgpu").unwrap();
    assert!(wgpu["reason"].as_str().unwrap().contains("--features gpu"), "{wgpu}");
}

#[test]
fn abuffer_is_drawn_by_any_backend_that_starts() {
    let f = Folder::new("abuffer");
    let properties = ["x", "y", "z", "nx", "ny", "nz", "radius", "red", "green", "blue", "alpha"];
    let properties = properties.map(|name| format!("property float {name}\n")).concat();
    let splat = "0 0 0 0 0 1 0.5 1 1 1 0.5";
    f.write("a.ply", format!("ply\nformat ascii 1.0\nelement vertex 1\n{properties}end_header\n{splat}\n"));
    f.write("s.json", scene("\"transparency\": \"abuffer:3\""));
    let list = f.run("backends --json").code(0).json();
    for backend in ["auto", "cpu", "reference", "ash", "wgpu"] {
        let listed = list.as_array().unwrap().iter().find(|b| b["name"] == backend);
        if listed.is_none_or(|b| b["available"] == true) {
            let stats = f.run(&format!("s.json -o {backend}.png --backend {backend} --stats")).code(0).json();
            assert!(backend == "auto" || stats["backend"] == backend, "{stats}");
        } else {
            f.run(&format!("s.json -o {backend}.png --backend {backend}")).fails(4, backend);
        }
        assert_eq!(f.has(&format!("{backend}.png")), listed.is_none_or(|b| b["available"] == true));
    }
}

/// Tests that nothing is printed about a missing `XDG_RUNTIME_DIR`, without which Mesa's layers and libwayland write to
/// stderr.
#[test]
fn stderr_is_silent_without_a_runtime_folder() {
    let f = Folder::new("runtime");
    f.write("a.ply", ball());
    let quiet = |words: &str, runtime_dir: Option<&str>| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_surfel"));
        command.current_dir(f.path()).args(words.split_whitespace());
        command.env_remove("XDG_RUNTIME_DIR").env_remove("WAYLAND_DISPLAY");
        command.envs(runtime_dir.map(|path| ("XDG_RUNTIME_DIR", path)));
        let output = command.output().unwrap();
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    for runtime_dir in [None, Some(""), Some("relative")] {
        assert_eq!(quiet("backends", runtime_dir), (Some(0), String::new()), "{runtime_dir:?}");
        let (code, stderr) = quiet("a.ply -q -o x.png --size 8x8 --force --backend wgpu", runtime_dir);
        // Without such a backend the program fails, and prints nothing else.
        assert!(matches!(code, Some(0 | 4)) && !stderr.contains("XDG_RUNTIME_DIR"), "{code:?} {stderr}");
        // Arguments are preserved although the environment is changed.
        assert_eq!(quiet("render", runtime_dir).0, Some(2));
    }
}

#[test]
fn views_of_missing_files_exit_with_3_and_open_no_server() {
    let f = Folder::new("no-view");
    f.run("view a.ply --no-open").fails(3, "a.ply");
    assert_eq!(f.names(), Vec::<String>::new());
}

#[test]
fn processor_and_reference_sum_in_more_than_f16() {
    let f = Folder::new("halves");
    f.write("a.ply", ball());
    for backend in ["cpu", "reference"] {
        f.run(&format!("a.ply -o {backend}.png --size 8x8 --accumulate f16 --backend {backend}")).code(0);
    }
}

#[test]
fn cpu_draws_polygons_and_shadows() {
    let f = Folder::new("CPU");
    f.write("a.ply", ball());
    f.write("b.obj", cube());
    f.write("mesh.json", scene("").replace("\"splats\": \"a.ply\"", "\"mesh\": \"b.obj\""));
    f.run("a.ply -o shadows.png --size 8x8 --shadows --backend cpu").code(0);
    f.run("mesh.json -o mesh.png --backend cpu").code(0);
}

#[test]
fn existing_files_are_refused_without_force() {
    let f = Folder::new("exists");
    f.write("a.ply", ball());
    f.write("x.png", "mine");
    f.write("y.ply", "mine");
    f.run("a.ply -o x.png --size 8x8").fails(1, "--force");
    f.run("convert a.ply -o y.ply").fails(1, "--force");
    assert_eq!((f.read("x.png"), f.read("y.ply")), (b"mine".to_vec(), b"mine".to_vec()));
    f.run("a.ply -o x.png --size 8x8 --force").code(0);
    f.run("convert a.ply -o y.ply --force").code(0);
    assert!(f.read("x.png").starts_with(b"\x89PNG") && f.read("y.ply").starts_with(b"ply\n"));
    f.run("a.ply -o nowhere/x.png").fails(1, "folder");
}

#[test]
fn help_version_pages_and_completions_exit_with_0() {
    let f = Folder::new("pages");
    assert!(f.run("--help").code(0).stdout().contains("render"));
    assert!(f.run("render --help").code(0).stdout().contains("--depth-tolerance"));
    assert!(f.run("--version").code(0).stdout().starts_with("surfel "));
    assert!(f.run("man").code(0).stdout().contains(".TH surfel"));
    for shell in ["bash", "zsh", "fish"] {
        assert!(f.run(&format!("completions {shell}")).code(0).stdout().contains("depth-tolerance"), "{shell}");
    }
    f.run("").code(2);
}

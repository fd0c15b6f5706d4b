//! Output of `render`, and precedence of flag, scene file, preset and default.

use crate::common;

use common::{Folder, ball, cube, points, scene};
use serde_json::Value;
use std::fs;

fn metadata(f: &Folder, name: &str, key: &str) -> Value {
    let planes = f.image(name);
    let (_, text) = planes.metadata.iter().find(|(k, _)| k == key).unwrap();
    serde_json::from_str(text).unwrap()
}

#[test]
fn printed_scene_gives_the_same_pixels() {
    let f = Folder::new("print");
    f.write("a.ply", ball());
    f.write("b.obj", cube());
    f.write("p.xyz", points());
    for (i, flags) in [
        "a.ply --size 48x32",
        "a.ply p.xyz --size 32x32 --ortho --view top --up +z --shader normal --background 0.1,0.2,0.3,0.5",
        "p.xyz --size 32x24 --eye 3,1,2 --fov-y 50 --preset fastest --depth-tolerance abs:0.1 --edge-aa",
    ]
    .iter()
    .enumerate()
    {
        f.run(&format!("{flags} -o a{i}.exr")).code(0);
        let printed = f.run(&format!("{flags} --print-scene")).code(0);
        assert!(!printed.stdout().contains(f.path().to_str().unwrap()), "{}", printed.stdout());
        f.write(&format!("{i}.json"), printed.bytes());
        // The image doesn't depend on the current folder: paths are relative to the scene file.
        fs::create_dir_all(f.path().join("elsewhere")).unwrap();
        f.run_in("elsewhere", &format!("../{i}.json -o ../b{i}.exr"), b"").code(0);
        let (a, b) = (f.image(&format!("a{i}.exr")), f.image(&format!("b{i}.exr")));
        assert!(a.color.is_some() && a.color == b.color, "{flags}");
        assert!(a.depth == b.depth && a.normal == b.normal && a.weight == b.weight, "{flags}");
        assert!(a.weight.unwrap().iter().any(|w| *w > 0.0), "{flags}: nothing is drawn");
    }
}

#[test]
fn flag_wins_over_scene_file_over_preset_over_default() {
    let f = Folder::new("precedence");
    f.write("a.ply", ball());
    f.write("s.json", scene("\"filter\": \"ewa\", \"shader\": \"phong\""));
    let resolved = |words: &str| f.run(&format!("render {words} --print-scene")).code(0).json()["settings"].clone();
    let plain = resolved("s.json");
    assert_eq!((&plain["filter"], &plain["mapping"], &plain["cutoff"]), (&"ewa".into(), &"exact".into(), &2.0.into()));
    let preset = resolved("s.json --preset fastest");
    assert_eq!((&preset["filter"], &preset["mapping"]), (&"ewa".into(), &"affine".into()));
    assert_eq!(preset["cutoff"], 2.0);
    let flag = resolved("s.json --preset fastest --filter clamp --cutoff 3 --shader unlit");
    assert_eq!((&flag["filter"], &flag["cutoff"], &flag["shader"]), (&"clamp".into(), &3.0.into(), &"unlit".into()));
    let bare = resolved("a.ply");
    assert_eq!((&bare["filter"], &bare["shader"]), (&"principal".into(), &"phong".into()));
    let bare = resolved("a.ply --preset fastest --mapping exact");
    assert_eq!((&bare["filter"], &bare["mapping"]), (&"none".into(), &"exact".into()));
    let camera = f.run("s.json --print-scene --size 20x10 --eye 0,1,6 --fov-y 40").code(0).json()["camera"].clone();
    assert_eq!((&camera["size"], &camera["eye"]), (&serde_json::json!([20, 10]), &serde_json::json!([0.0, 1.0, 6.0])));
    assert_eq!(camera["projection"]["perspective"]["fov_y_deg"], 40.0);
}

#[test]
fn config_file_stands_below_the_command_line() {
    let f = Folder::new("config");
    f.write("a.ply", ball());
    f.write(
        "c.toml",
        "size = \"24x16\"\nfov-y = 20\nfilter = \"ewa\"\nedge-aa = true\nquiet = true\neye = [0, 1, 9.5]\n",
    );
    let scene = f.run("a.ply --config c.toml --print-scene --filter clamp").code(0).json();
    assert_eq!(scene["camera"]["size"], serde_json::json!([24, 16]));
    assert_eq!(scene["camera"]["eye"], serde_json::json!([0.0, 1.0, 9.5]));
    assert_eq!((&scene["settings"]["filter"], &scene["settings"]["edge_aa"]), (&"clamp".into(), &true.into()));
    let scene = f.run("a.ply --config c.toml --print-scene --ortho").code(0).json();
    assert!(scene["camera"]["projection"]["orthographic"].is_object());
    f.write("bad.toml", "sise = 3\n");
    f.run("a.ply --config bad.toml --print-scene").fails(2, "sise");
    f.write("bad.toml", "size = \n");
    f.run("a.ply --config bad.toml --print-scene").fails(2, "bad.toml");
    f.run("a.ply --config nowhere.toml --print-scene").fails(2, "nowhere.toml");
}

#[test]
fn region_is_a_crop_of_the_whole() {
    let f = Folder::new("region");
    f.write("a.ply", ball());
    f.run("a.ply -o whole.exr --size 40x30 --exr-f32 --backend reference").code(0);
    f.run("a.ply -o part.exr --size 40x30 --exr-f32 --region 11,5,20,15 --backend reference").code(0);
    let (whole, part) = (f.image("whole.exr"), f.image("part.exr"));
    assert_eq!((part.width, part.height), (20, 15));
    for y in 0..15 {
        for x in 0..20 {
            let (i, j) = ((y + 5) * 40 + x + 11, y * 20 + x);
            assert_eq!(part.color.as_ref().unwrap()[j], whole.color.as_ref().unwrap()[i], "{x},{y}");
            assert_eq!(part.depth.as_ref().unwrap()[j], whole.depth.as_ref().unwrap()[i], "{x},{y}");
        }
    }
}

#[test]
fn automatic_frame_shows_everything_and_fills_the_image() {
    let f = Folder::new("framing");
    f.write("a.ply", ball());
    f.write("b.obj", cube());
    f.run("convert b.obj -o b.ply --splats 3000").code(0);
    for flags in ["a.ply", "b.ply", "b.ply --ortho", "a.ply --view left --size 96x48", "a.ply --size 48x96 --fov-y 90"]
    {
        f.run(
            &format!("{flags} -o x.exr --force --background transparent --size 96x96")
                .replace("--size 96x96", if flags.contains("--size") { "" } else { "--size 96x96" }),
        )
        .code(0);
        let image = f.image("x.exr");
        let (w, h) = (image.width as usize, image.height as usize);
        let color = image.color.unwrap();
        let covered = |x: usize, y: usize| color[y * w + x][3] > 0.0;
        assert!((0..w).all(|x| !covered(x, 0) && !covered(x, h - 1)), "{flags}: cut off above or below");
        assert!((0..h).all(|y| !covered(0, y) && !covered(w - 1, y)), "{flags}: cut off at a side");
        let columns = (0..w).filter(|x| (0..h).any(|y| covered(*x, y))).count() as f64 / w as f64;
        let rows = (0..h).filter(|y| (0..w).any(|x| covered(x, *y))).count() as f64 / h as f64;
        // Framing aims at 0.9; half a pixel and the filter's reach of √½ px on each side are added.
        assert!((0.87..0.96).contains(&columns.max(rows)), "{flags}: {columns} {rows}");
    }
}

#[test]
fn names_are_filled_in_and_turntables_turn() {
    let f = Folder::new("names");
    f.write("a.ply", ball());
    f.run("a.ply -o {input}_{backend}_{frame}.png --size 16x16 --backend reference").code(0);
    assert!(f.has("a_reference_0000.png"));
    f.run("a.ply -o t_{frame}.png --size 24x24 --frames 4 --turntable --shader unlit").code(0);
    let frames: Vec<_> = (0..4).map(|i| f.image(&format!("t_000{i}.png")).color).collect();
    assert!((0..4).all(|i| frames[i] != frames[(i + 1) % 4]), "the frames are alike");
    assert!(!f.has("t_0004.png"));
    f.run("a.ply -o t_{frame}.png --size 8x8 --frames 5 --turntable").fails(1, "t_0000.png");
    assert!(!f.has("t_0004.png"), "written although another frame's file was in the way");
}

#[test]
fn images_go_to_stdout_and_results_nowhere_else() {
    let f = Folder::new("stdout");
    f.write("a.ply", ball());
    let run = f.run("a.ply -o - --size 16x16").code(0);
    assert!(run.bytes().starts_with(b"\x89PNG") && run.bytes().ends_with(b"IEND\xaeB`\x82"));
    f.run("a.ply -o x.png --size 16x16").code(0);
    assert_eq!(f.run("a.ply -o y.png --size 16x16 -q").code(0).stderr(), "");
    assert_eq!(f.run("a.ply -o z.png --size 16x16").code(0).stdout(), "");
    assert_eq!(f.names(), ["a.ply", "x.png", "y.png", "z.png"]);
}

#[test]
fn statistics_have_the_promised_keys() {
    let f = Folder::new("stats");
    f.write("a.ply", ball());
    let stats = f.run("a.ply -o x.png --size 16x16 --stats --repeat 2 --threads 1").code(0).json();
    for key in
        ["frame_ms", "passes", "splats", "drawn", "fragments", "bytes_per_splat", "backend", "adapter", "threads"]
    {
        assert!(!stats[key].is_null(), "{key}");
    }
    assert_eq!((&stats["splats"], &stats["runs"], &stats["threads"]), (&200.into(), &2.into(), &1.into()));
    assert!(stats["passes"].as_object().unwrap().values().all(Value::is_number));
    for stage in ["cull", "setup", "binning", "tiles"] {
        assert!(stats["passes"][stage].as_f64().unwrap() >= 0.0, "{stage}");
    }
    let counter = |name: &str| stats["counters"][name].as_f64().unwrap_or_else(|| panic!("{name}"));
    assert_eq!(counter("culled") + stats["drawn"].as_f64().unwrap(), 200.0);
    let fragments = stats["fragments"].as_f64().unwrap();
    assert!(
        fragments > 0.0
            && fragments <= counter("fragments_inside")
            && counter("fragments_inside") <= counter("fragments_tested")
    );
    for name in ["tile_pairs", "block_pairs", "gb_per_s", "tile_ns_per_block_pair", "batch_bytes"] {
        assert!(counter(name) > 0.0, "{name}");
    }
    assert!(stats["frame_ms"].as_f64().unwrap() > 0.0);
}

#[test]
fn verified_image_says_both_errors_and_whether_its_preset_is_kept() {
    let f = Folder::new("verify");
    f.write("a.ply", ball());
    let text = f.run("a.ply -o x.png --size 24x24 --backend cpu --verify").code(0).stdout();
    assert!(text.contains("fidelity  max_abs") && text.contains("preset balanced: fidelity at least"), "{text}");
    assert!(text.contains("kept"), "{text}");
    let stats = f.run("a.ply --size 24x24 --backend cpu --verify --stats").code(0).json();
    assert!(stats["verify"]["fidelity"]["psnr"].as_f64().unwrap() > stats["promise"]["fidelity_db"].as_f64().unwrap());
    assert_eq!((&stats["preset"], &stats["verify"]["promise_kept"]), (&"balanced".into(), &true.into()));
    // Settings that match no preset have no promise.
    let own = f.run("a.ply --size 24x24 --backend cpu --cutoff 1.3 --verify --stats").code(0).json();
    assert!(own["preset"].is_null() && own["promise"].is_null() && own["verify"]["model"].is_null());
    assert!(own["verify"]["fidelity"]["psnr"].is_number());
}

#[test]
fn compare_holds_an_image_to_its_presets_promise() {
    let f = Folder::new("verify-preset");
    f.write("a.ply", ball());
    f.run("a.ply -o best.exr --exr-f32 --size 24x24 --preset reference").code(0);
    f.run("a.ply -o fast.exr --exr-f32 --size 24x24 --preset fast").code(0);
    f.run("compare best.exr fast.exr --verify-preset fast").code(0);
    // The same settings promise the same image.
    f.run("compare best.exr best.exr --verify-preset quality").code(0);
    let broken = f.run("compare best.exr fast.exr --verify-preset quality").code(5);
    assert!(broken.stderr().contains("promise of preset quality"), "{}", broken.stderr());
}

#[test]
fn threads_change_no_pixel() {
    let f = Folder::new("threads");
    f.write("p.xyz", points());
    f.run("p.xyz -o a.png --size 32x32 --threads 1").code(0);
    f.run("p.xyz -o b.png --size 32x32 --threads 3").code(0);
    assert_eq!(f.image("a.png").color, f.image("b.png").color);
}

#[test]
fn exr_has_all_planes_and_says_how_it_was_made() {
    let f = Folder::new("planes");
    f.write("a.ply", ball());
    f.run("a.ply -o x.exr --size 16x16 --filter ewa").code(0);
    let image = f.image("x.exr");
    assert!(image.color.is_some() && image.depth.is_some() && image.normal.is_some() && image.weight.is_some());
    assert!(image.depth.unwrap().contains(&f32::INFINITY));
    assert_eq!(metadata(&f, "x.exr", "surfel:settings")["filter"], "ewa");
    assert_eq!(metadata(&f, "x.exr", "surfel:camera")["size"], serde_json::json!([16, 16]));
    f.run("a.ply -o x.png --size 16x16 --png16").code(0);
    let png = f.read("x.png");
    assert!(png.windows(14).any(|w| w == b"surfel:version"));
    assert_eq!(png[24], 16, "bits a sample");
}

#[test]
fn samples_average_the_reference() {
    let f = Folder::new("samples");
    f.write("a.ply", ball());
    f.run("a.ply -o x.png --size 16x16 --samples 3").code(0);
    f.run("a.ply -o y.png --size 16x16").code(0);
    assert_ne!(f.image("x.png").color, f.image("y.png").color);
}

#[test]
fn up_comes_from_the_format_and_is_printed() {
    let f = Folder::new("up");
    f.write("a.ply", ball());
    f.write("p.xyz", points());
    assert!(f.run("a.ply -o a.png --size 8x8").code(0).stderr().contains("up is +y"));
    assert!(f.run("p.xyz -o b.png --size 8x8").code(0).stderr().contains("up is +z"));
    assert_eq!(f.run("p.xyz --up -x --print-scene").code(0).json()["up"], "-x");
    assert_eq!(f.run("p.xyz --up auto --print-scene").code(0).json()["up"], "+z");
    // The notes state the reason and the flag that corrects it, and the view and the flag that repeats it.
    let note = f.run("a.ply -o c.png --size 8x8").code(0).stderr();
    assert!(note.contains("nothing in the data says it") && note.contains("--up +z"), "{note}");
    let (_, seen) = note.split_once("--view ").expect("the view is said");
    let view = seen.split_whitespace().next().expect("the view is named");
    let camera = |words: &str| f.run(&format!("a.ply --print-scene {words}")).code(0).json()["camera"].clone();
    assert_eq!((camera(""), camera("--view auto")), (camera(&format!("--view {view}")), camera("")));
    let note = f.run("a.ply -o d.png --size 8x8 --up +z --view front").code(0).stderr();
    assert!(!note.contains("up is") && !note.contains("seen from"), "{note}");
}

#[test]
fn camera_file_and_named_views_set_the_camera() {
    let f = Folder::new("camera");
    f.write("a.ply", ball());
    f.write(
        "c.json",
        r#"{"eye": [1,2,9], "target": [0,0,0], "projection": {"perspective": {"fov_y_deg": 25}}, "size": [20, 10]}"#,
    );
    let camera = |words: &str| f.run(&format!("a.ply --print-scene {words}")).code(0).json()["camera"].clone();
    let given = camera("--camera c.json --eye 2,2,9");
    assert_eq!((&given["eye"], &given["size"]), (&serde_json::json!([2.0, 2.0, 9.0]), &serde_json::json!([20, 10])));
    let eye = |words: &str| -> Vec<f64> { serde_json::from_value(camera(words)["eye"].clone()).unwrap() };
    assert!(eye("--view front")[2] > 3.0 && eye("--view back")[2] < -3.0);
    assert!(eye("--view right")[0] > 3.0 && eye("--view left")[0] < -3.0);
    assert!(eye("--view top")[1] > 3.0 && eye("--view bottom")[1] < -3.0);
    assert_eq!(eye("--view 30,20"), eye("--view iso"));
    assert!(eye("--view 0,0")[2] > 3.0 && eye("--view -90,0")[0] < -3.0 && eye("--view 0,90")[1] > 3.0);
    assert!(eye("--view front --up +z")[1] < -3.0 && eye("--view right --up +z")[0] > 3.0);
    // The view is straight down the up axis, so another up direction is chosen.
    f.run("a.ply -o top.png --size 8x8 --eye 0,5,0 --target 0,0,0").code(0);
    f.write("bad.json", "{}");
    f.run("a.ply --print-scene --camera bad.json").fails(3, "bad.json");
}

#[test]
fn automatic_backend_is_the_cpu_where_no_gpu_is() {
    let f = Folder::new("auto");
    f.write("a.ply", ball());
    let stats = f.run("a.ply --stats --size 8x8").code(0).json();
    if stats["backend"] != "cpu" {
        let adapter = stats["adapter"].as_str().unwrap().to_lowercase();
        assert!(["llvmpipe", "swiftshader", "avx", "sse"].iter().all(|name| !adapter.contains(name)), "{stats}");
        assert!(stats["backend"] != "reference", "{stats}");
        println!("skipped: this machine has a GPU, {adapter}");
    }
}

#[test]
fn gpu_backends_draw_what_the_cpu_draws() {
    let f = Folder::new("gpu");
    f.write("a.ply", ball());
    f.run("a.ply -o cpu.exr --size 48x40 --exr-f32 --backend cpu").code(0);
    let there = f.run("backends --json").code(0).json();
    for backend in ["ash", "wgpu"] {
        if !there.as_array().unwrap().iter().any(|b| b["name"] == backend && b["available"] == true) {
            let required = std::env::var("SURFEL_REQUIRE").unwrap_or_default();
            assert!(
                !required.split(',').any(|word| word.trim() == backend),
                "SURFEL_REQUIRE asks for {backend}: {there}"
            );
            println!("skipped: no {backend}");
            continue;
        }
        f.run(&format!("a.ply -o {backend}.exr --size 48x40 --exr-f32 --backend {backend}")).code(0);
        // Largest difference between two f32 programs apart from decisions.
        f.run(&format!("compare {backend}.exr cpu.exr --fail-below psnr=60")).code(0);
        // The image is the backend's own, not the other backend's file.
        let stats = f.run(&format!("a.ply --stats --size 8x8 --backend {backend}")).code(0).json();
        assert_eq!(stats["backend"], backend);
        assert!(stats["passes"].as_object().unwrap().values().all(Value::is_number));
    }
}

/// Returns three cameras around the ball of splats, with the ball in the middle of each view.
fn transforms() -> String {
    let camera = |name: &str, x: [f64; 3], y: [f64; 3], z: [f64; 3]| {
        let row = |i: usize| [x[i], y[i], z[i], 4.0 * z[i]];
        serde_json::json!({ "file_path": format!("images/{name}.jpg"),
            "transform_matrix": [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]] })
    };
    let frames = [
        camera("front", [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]),
        camera("right", [0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]),
        camera("top", [1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]),
    ];
    serde_json::json!({ "fl_x": 60.0, "cx": 24.0, "cy": 16.0, "w": 48, "h": 32, "frames": frames }).to_string()
}

#[test]
fn cameras_of_another_program_give_an_image_each() {
    let f = Folder::new("cameras");
    f.write("a.ply", ball());
    f.write("transforms.json", transforms());
    fs::create_dir(f.path().join("out")).unwrap();
    let run = f.run("a.ply --cameras transforms.json -o out/{name}.exr --stats").code(0);
    assert_eq!(run.json()["frames"], 3);
    assert_eq!(fs::read_dir(f.path().join("out")).unwrap().count(), 3);
    let front = f.image("out/front.exr");
    assert_eq!((front.width, front.height), (48, 32));
    for name in ["front", "right", "top"] {
        let depth = f.image(&format!("out/{name}.exr")).depth.unwrap();
        // The ball has radius 1 and is at distance 4 from every camera.
        let middle = depth[16 * 48 + 24];
        assert!((middle - 3.0).abs() < 0.05 && depth[0].is_infinite(), "{name}: {middle}");
    }
    // One of the images can be repeated from its metadata, and smaller images show the same.
    f.run("again out/right.exr -o again.exr").code(0);
    assert_eq!(f.image("again.exr").depth, f.image("out/right.exr").depth);
    f.run("a.ply --cameras transforms.json -o small_{name}.png --size 24x16").code(0);
    assert_eq!(f.image("small_top.png").width, 24);
}

#[test]
fn cameras_that_cannot_be_used_are_refused() {
    let f = Folder::new("bad-cameras");
    f.write("a.ply", ball());
    f.write("transforms.json", transforms());
    f.run("a.ply --cameras transforms.json -o out.png").fails(2, "{name}");
    f.run("a.ply --cameras transforms.json --view front -o {name}.png").code(2);
    f.write("transforms.json", transforms().replace("right", "front"));
    f.run("a.ply --cameras transforms.json -o {name}.png").fails(3, "two cameras have images called front");
    f.write("transforms.json", transforms().replace("\"cx\"", "\"k1\":0.1,\"cx\""));
    f.run("a.ply --cameras transforms.json -o {name}.png").fails(3, "colmap image_undistorter");
    f.run("a.ply --cameras none.json -o {name}.png").fails(3, "none.json");
    assert_eq!(f.names(), ["a.ply", "transforms.json"]);
}

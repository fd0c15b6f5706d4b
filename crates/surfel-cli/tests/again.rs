//! Metadata in images, and `surfel again`.

use crate::common;

use common::{Folder, ball, cube, points, scene};
use serde_json::{Value, json};

fn text(f: &Folder, image: &str, key: &str) -> Option<String> {
    f.image(image).metadata.into_iter().find(|(k, _)| k == key).map(|(_, text)| text)
}

fn value(f: &Folder, image: &str, key: &str) -> Value {
    serde_json::from_str(&text(f, image, key).unwrap_or_else(|| panic!("{image} has no {key}"))).unwrap()
}

#[test]
fn images_carry_what_decides_them_and_nothing_else() {
    let f = Folder::new("carry");
    std::fs::create_dir_all(f.path().join("out")).unwrap();
    f.write("a.ply", ball());
    f.write("out/a.ply", ball());
    // Always the CPU: images drawn by a GPU also store its name.
    f.run("a.ply -o out/x.png --size 24x16 --threads 1 --backend cpu").code(0);
    assert_eq!(text(&f, "out/x.png", "surfel:version").unwrap(), env!("CARGO_PKG_VERSION"));
    // The stored scene is that of --print-scene, with paths relative to the image's folder.
    let mut printed = f.run("a.ply --size 24x16 --print-scene").code(0).json();
    assert_eq!(printed["objects"][0]["splats"], "a.ply");
    printed["objects"][0]["splats"] = json!("../a.ply");
    assert_eq!(value(&f, "out/x.png", "surfel:scene"), printed);
    assert_eq!(value(&f, "out/x.png", "surfel:drawn")["backend"], "cpu");
    let input = &value(&f, "out/x.png", "surfel:inputs")[0];
    assert_eq!((&input["path"], &input["bytes"]), (&json!("../a.ply"), &json!(ball().len())));
    assert_eq!(input["sha256"].as_str().unwrap().len(), 64);
    // The file doesn't depend on threads, name, statistics or the current folder.
    f.run("a.ply -o out/y.png --size 24x16 --backend cpu --threads 3 --stats --repeat 2 -v").code(0);
    f.run_in("out", "../a.ply -o z.png --size 24x16 --backend cpu", b"").code(0);
    assert!(f.read("out/x.png") == f.read("out/y.png") && f.read("out/x.png") == f.read("out/z.png"));
    let all = format!("{:?}", f.image("out/y.png").metadata);
    for part in ["thread", "y.png", "repeat", "stats", f.path().to_str().unwrap()] {
        assert!(!all.contains(part), "{part}: {all}");
    }
    // The metadata is in standard PNG chunks, before the pixels.
    let png = f.read("out/x.png");
    let at = |part: &[u8]| png.windows(part.len()).position(|w| w == part);
    assert!(at(b"tEXtsurfel:scene\0{").unwrap() < at(b"IDAT").unwrap());
    f.run("a.ply -o out/bare.png --size 24x16 --backend cpu --no-metadata").code(0);
    f.run("a.ply -o out/bare.exr --size 24x16 --no-metadata").code(0);
    assert_eq!(f.image("out/bare.png").metadata, []);
    assert!(f.image("out/bare.exr").metadata.iter().all(|(key, _)| !key.starts_with("surfel")));
    assert_eq!(f.image("out/bare.png").color, f.image("out/x.png").color);
}

#[test]
fn again_repeats_every_kind_of_image_to_the_bit() {
    let f = Folder::new("again");
    std::fs::create_dir_all(f.path().join("out")).unwrap();
    std::fs::create_dir_all(f.path().join("größe")).unwrap();
    f.write("a.ply", ball());
    f.write("b.obj", cube());
    f.write("größe/p.xyz", points());
    f.write("s.json", scene("\"shader\": \"toon\", \"transparency\": \"peel:2\""));
    f.run("a.ply -o ball.png --size 16x16").code(0);
    for (i, words) in [
        "a.ply --size 24x24",
        "a.ply b.obj --splats 400 --size 24x24 --view top --up +z --background 0.1,0.2,0.3,0.5 --png16",
        "größe/p.xyz --size 20x24 --max-points 150 --radius-scale 1.5 --edge-aa",
        "b.obj --size 24x24 --splats 300 --cull none --preset fastest --shadows",
        "b.obj --size 24x24 --sharp --crease-angle 30 --cull back",
        "s.json --region 4,5,20,16 --camera-up 1,1,0",
        "a.ply --size 12x12 --samples 2 --storage 16 --backend reference",
        "a.ply --size 12x12 --matcap ball.png",
    ]
    .iter()
    .enumerate()
    {
        f.run(&format!("{words} -o out/{i}.png")).code(0);
        let said = f.run(&format!("again out/{i}.png -o out/{i}-again.png")).code(0).stderr();
        assert!(said.contains("the same image") && said.contains("to the bit"), "{words}: {said}");
        assert!(f.read(&format!("out/{i}.png")) == f.read(&format!("out/{i}-again.png")), "{words}");
    }
    // Frames of a turntable, whose lights turn with the camera.
    f.run("a.ply --size 16x16 --frames 3 --turntable -o out/t{frame}.png").code(0);
    f.run("again out/t0001.png -o out/t.png").code(0);
    assert!(f.read("out/t0001.png") == f.read("out/t.png") && f.read("out/t0000.png") != f.read("out/t.png"));
    // EXR with all its planes; stdin.
    f.run("a.ply --size 16x16 --exr-f32 -o out/x.exr").code(0);
    f.run("again out/x.exr -o out/y.exr").code(0);
    assert_eq!(f.image("out/x.exr"), f.image("out/y.exr"));
    f.run_in("", "- -o out/p.png --size 16x16", ball().as_bytes()).code(0);
    f.run_in("", "again out/p.png -o out/q.png", ball().as_bytes()).code(0);
    assert_eq!(f.read("out/p.png"), f.read("out/q.png"));
    // Default output name, and stdout.
    f.run_in("out", "again t0002.png", b"").code(0);
    assert_eq!(f.read("out/t0002-again.png"), f.read("out/t0002.png"));
    f.run_in("out", "again t0002.png", b"").fails(1, "--force");
    // From another folder, only the paths differ.
    f.run("again out/0.png -o here.png").code(0);
    assert_eq!(f.image("here.png").color, f.image("out/0.png").color);
    assert_eq!(value(&f, "here.png", "surfel:scene")["objects"][0]["splats"], "a.ply");
    assert_eq!(f.run("again out/0.png -o -").code(0).bytes(), f.read("here.png"));
}

#[test]
fn again_asks_the_gpu_backend_that_drew_the_image() {
    let f = Folder::new("gpu-again");
    f.write("a.ply", ball());
    let there = f.run("backends --json").code(0).json();
    for backend in ["ash", "wgpu"] {
        if !there.as_array().unwrap().iter().any(|b| b["name"] == backend && b["available"] == true) {
            let required = std::env::var("SURFEL_REQUIRE").unwrap_or_default();
            assert!(!required.split(',').any(|word| word.trim() == backend), "SURFEL_REQUIRE has {backend}: {there}");
            println!("skipped: no {backend}");
            continue;
        }
        f.run(&format!("a.ply -o {backend}.png --size 24x24 --backend {backend}")).code(0);
        let drawn = value(&f, &format!("{backend}.png"), "surfel:drawn");
        assert!(drawn["backend"] == backend && drawn["adapter"].is_string(), "{drawn}");
        let said = f.run(&format!("again {backend}.png -o {backend}-again.png -v")).code(0).stderr();
        assert!(said.contains(&format!("backend {backend}")) && said.contains("to the bit"), "{said}");
        assert_eq!(f.read(&format!("{backend}.png")), f.read(&format!("{backend}-again.png")));
    }
}

#[test]
fn again_says_what_is_missing_or_changed() {
    let f = Folder::new("changed");
    std::fs::create_dir_all(f.path().join("out")).unwrap();
    f.write("a.ply", ball());
    f.write("b.obj", cube());
    f.run("a.ply b.obj -o x.png --size 16x16 --splats 400 --backend cpu").code(0);
    // A changed input is reported, and drawn.
    f.write("a.ply", ball().replace("0.25", "0.2"));
    let said = f.run("again x.png -o y.png").code(0).stderr();
    assert!(said.contains("a.ply has changed") && !said.contains("b.obj has changed"), "{said}");
    assert!(said.contains("y.png: is not the image of x.png"), "{said}");
    assert_ne!(f.image("x.png").color, f.image("y.png").color);
    // All missing inputs are named; nothing is written.
    std::fs::remove_file(f.path().join("a.ply")).unwrap();
    f.run("again x.png -o z.png").fails(3, "a.ply");
    std::fs::rename(f.path().join("x.png"), f.path().join("out/x.png")).unwrap();
    f.run("again out/x.png -o z.png").fails(3, "b.obj");
    assert!(!f.has("z.png"));
    // Files that an input refers to are inputs too.
    f.write("t.obj", format!("mtllib t.mtl\n{}", cube()));
    f.run("t.obj -o t.png --size 8x8 --splats 400").code(0);
    assert_eq!(value(&f, "t.png", "surfel:inputs")[0], json!({ "path": "t.mtl", "missing": true }));
    f.run("again t.png -o u.png").code(0);
    f.write("t.mtl", "newmtl m\nKd 1 0 0\n");
    assert!(f.run("again t.png -o u.png --force").code(0).stderr().contains("t.mtl was not there"));
    f.run("t.obj -o t.png --size 8x8 --splats 400 --force").code(0);
    f.write("t.mtl", "newmtl m\nKd 0 1 0\n");
    assert!(f.run("again t.png -o u.png --force").code(0).stderr().contains("t.mtl has changed"));
    std::fs::remove_file(f.path().join("t.mtl")).unwrap();
    f.run("again t.png -o u.png --force").fails(3, "t.mtl");
    // An image without a scene, a file that isn't an image, and another output format.
    f.write("a.ply", ball());
    f.run("a.ply -o bare.png --size 8x8 --no-metadata").code(0);
    f.run("again bare.png").fails(3, "--no-metadata");
    f.run("again a.ply").fails(3, "a.ply");
    f.run("a.ply -o x.jpg --size 8x8").code(0);
    f.run("again x.jpg").fails(3, "carries no scene");
    f.run("a.ply -o x.png --size 8x8").code(0);
    f.run("again x.png -o x.exr").fails(2, "a PNG");
    f.run("again x.png -o z.jpg").fails(2, "a PNG");
    f.run("again x.png -o z.png --backend reference").code(0);
}

/// Writes a grey PNG of 4 × 4 pixels with these metadata entries.
fn forged(f: &Folder, name: &str, texts: &[(&str, String)]) {
    let color = vec![[0.5, 0.5, 0.5, 1.0]; 16];
    let planes = surfel_io::Planes { width: 4, height: 4, color: Some(color), ..Default::default() };
    let metadata = texts.iter().map(|(key, text)| ((*key).to_owned(), text.clone())).collect();
    let options = surfel_io::PngOptions { metadata, ..Default::default() };
    surfel_io::save_png(&f.path().join(name), true, &planes.view(), &options).unwrap();
}

#[test]
fn again_tells_of_other_versions_and_of_damaged_or_broken_promises() {
    let f = Folder::new("forged");
    f.write("a.ply", ball());
    f.run("a.ply -o x.png --size 8x8 --backend cpu").code(0);
    let of = |key: &'static str| (key, text(&f, "x.png", key).unwrap());
    let (scene, drawn, inputs) = (of("surfel:scene"), of("surfel:drawn"), of("surfel:inputs"));
    let version = |text: &str| ("surfel:version", text.to_owned());
    // The same inputs and version but another image: a broken promise.
    let own = version(env!("CARGO_PKG_VERSION"));
    forged(&f, "f.png", &[own.clone(), scene.clone(), drawn.clone(), inputs.clone()]);
    f.run("again f.png -o y.png").fails(5, "is not the image of f.png to the bit");
    assert_eq!(f.image("y.png").color, f.image("x.png").color);
    forged(&f, "f.png", &[version("0.0.1"), scene.clone(), drawn.clone(), inputs.clone()]);
    let said = f.run("again f.png -o y.png --force").code(0).stderr();
    assert!(said.contains("drawn by surfel 0.0.1") && said.contains("is not the image"), "{said}");
    // Entries of unknown origin aren't accepted as command-line flags.
    for (bad, part) in [
        (r#"{"backend": "cpu", "output": "evil.png"}"#, "output"),
        (r#"{"backend": "cpu", "config": "c.toml"}"#, "config"),
        (r#"{"backend": "gpu9"}"#, "damaged"),
        (r#"{"backend": "cpu", "region": "1,2"}"#, "damaged"),
        (r#"{"backend": "#, "damaged"),
    ] {
        forged(&f, "f.png", &[own.clone(), scene.clone(), ("surfel:drawn", bad.to_owned())]);
        f.run("again f.png -o z.png").fails(3, part);
    }
    forged(&f, "f.png", &[("surfel:scene", "{\"camera\": 1}".to_owned())]);
    f.run("again f.png -o z.png").fails(3, "f.png");
    assert!(!f.has("z.png") && !f.has("evil.png"));
}

//! Conversion of files to splats: the flags that `render` and `convert` share, and `convert` of scene files.

use crate::common;

use common::{Folder, ball, cube, points, scene};
use serde_json::json;

#[test]
fn render_takes_what_convert_takes_and_draws_what_it_would_write() {
    let f = Folder::new("shared");
    f.write("a.ply", ball());
    f.write("b.obj", cube());
    f.write("p.xyz", points());
    for (i, (file, flags)) in [
        ("b.obj", "--splats 500 --cull back"),
        ("b.obj", "--splats 500 --cull none"),
        ("b.obj", "--per-face --cull none --radius-scale 0.75"),
        ("b.obj", "--per-vertex --cull none"),
        ("b.obj", "--sharp --splats 100"),
        ("b.obj", "--sharp --crease-angle 30 --error 0.01"),
        ("p.xyz", "--max-points 120"),
        ("p.xyz", "--radius-scale 1.5 --sharp"),
        ("a.ply", "--radius-scale 1.5"),
        ("a.ply", "--cull none"),
    ]
    .iter()
    .enumerate()
    {
        f.run(&format!("convert {file} {flags} -o {i}.ply")).code(0);
        f.run(&format!("{i}.ply -o {i}-ply.exr --size 32x32 --exr-f32")).code(0);
        f.run(&format!("{file} {flags} -o {i}.exr --size 32x32 --exr-f32")).code(0);
        let (one, other) = (f.image(&format!("{i}.exr")), f.image(&format!("{i}-ply.exr")));
        assert!(one.color == other.color && one.depth == other.depth, "{file} {flags}");
        // And each flag has an effect.
        let fewer = if *file == "b.obj" { "--splats 400" } else { "" };
        f.run(&format!("{file} {fewer} -o plain.exr --size 32x32 --exr-f32 --force")).code(0);
        assert!(f.image("plain.exr").weight != one.weight, "{file} {flags} has no effect");
    }
    assert_eq!(f.run("info 6.ply --json").code(0).json()["splats"], 120);
    let said = f.run("p.xyz -o x.png --size 8x8 --max-points 120").code(0).stderr();
    assert!(said.contains("120 of 300 points are left"), "{said}");
    // A flag that applies to only one of the inputs is accepted.
    f.run("a.ply b.obj -o x.png --size 8x8 --splats 40 --force").code(0);
}

#[test]
fn scene_file_says_how_files_become_splats() {
    let f = Folder::new("convert-key");
    f.write("a.ply", ball());
    f.write("b.obj", cube());
    f.write("p.xyz", points());
    let flags = "--splats 60 --max-points 90 --radius-scale 1.25 --cull back";
    let printed = f.run(&format!("b.obj p.xyz {flags} --print-scene")).code(0).json();
    for object in printed["objects"].as_array().unwrap() {
        assert_eq!(object["convert"], json!({ "splats": 60, "max_points": 90, "radius_scale": 1.25 }));
        assert_eq!(object["material"]["cull"], "back");
    }
    assert!(f.run("a.ply --print-scene").code(0).json()["objects"][0]["convert"].is_null(), "nothing is said");
    f.write("s.json", scene("").replace("\"a.ply\"", "\"b.obj\", \"convert\": {\"splats\": 60, \"radius_scale\": 2}"));
    let splats = |words: &str| f.run(&format!("{words} --stats")).code(0).json()["splats"].clone();
    assert_eq!(splats("s.json"), 60);
    // A flag takes precedence over the file.
    assert_eq!(splats("s.json --splats 70"), 70);
    assert_eq!(splats("s.json --per-face"), 12);
    assert_eq!(splats("s.json --sharp --splats 48"), 48);
    // Keys without effect on a file are reported, even though no flag asks for them.
    f.write("q.json", scene("").replace("\"a.ply\"", "\"p.xyz\", \"convert\": {\"splats\": 60}"));
    let said = f.run("q.json -o q.png").code(0).stderr();
    assert!(said.contains("p.xyz: holds points, so that convert.splats has no effect"), "{said}");
    for (bad, part) in [
        (r#"{"splats": 0}"#, "objects[0].convert.splats"),
        (r#"{"splat": 5}"#, "splat"),
        (r#"{"per_face": true, "sharp": true}"#, "both"),
    ] {
        f.write("bad.json", scene("").replace("\"a.ply\"", &format!("\"b.obj\", \"convert\": {bad}")));
        f.run("bad.json -o x.png").fails(3, part);
    }
}

/// Returns a square of 20×20 quads with vertex colours in waves.
fn painted() -> String {
    let mut text = String::new();
    for i in 0..21 * 21 {
        let (x, y) = (f64::from(i % 21) / 10.0, f64::from(i / 21) / 10.0);
        let level = 0.5 + 0.4 * (9.0 * x).sin() * (8.0 * y).cos();
        text += &format!("v {x} {y} 0 {level:.4} {:.4} 0.5\n", 1.0 - level);
    }
    for i in (0..20 * 20).map(|i| i / 20 * 21 + i % 20 + 1) {
        text += &format!("f {i} {} {} {}\n", i + 1, i + 22, i + 21);
    }
    text
}

#[test]
fn textures_are_taken_as_the_flag_or_the_scene_says() {
    let f = Folder::new("texture");
    f.write("m.obj", painted());
    f.write("p.xyz", points());
    f.write("a.ply", ball());
    let write =
        |flags: &str, name: &str| f.run(&format!("convert m.obj --splats 400 {flags} -o {name}")).code(0).stderr();
    write("", "plain.ply");
    write("--texture point", "point.ply");
    write("--texture ewa", "ewa.ply");
    let said = write("--texture fit", "fit.ply");
    assert!(said.contains("fitted to") && said.contains("colours blend to within"), "{said}");
    assert!(f.read("plain.ply") == f.read("point.ply"));
    assert!(f.read("ewa.ply") != f.read("fit.ply") && f.read("fit.ply") != f.read("point.ply"));
    // The same image by render, and from a scene file; with one thread or several.
    f.run("fit.ply -o 1.exr --size 32x32 --exr-f32").code(0);
    f.run("m.obj --splats 400 --texture fit -o 2.exr --size 32x32 --exr-f32 --threads 1").code(0);
    assert!(f.image("1.exr").color == f.image("2.exr").color);
    let printed = f.run("m.obj --splats 400 --texture fit --print-scene").code(0).json();
    assert_eq!(printed["objects"][0]["convert"], json!({ "splats": 400, "texture": "fit" }));
    let both = f.run("m.obj --splats auto --texture x.png --texture ewa --print-scene").code(0).json();
    let convert = &both["objects"][0]["convert"];
    assert_eq!((&convert["splats"], &convert["texture"][1]), (&json!("auto"), &json!("ewa")), "{both}");
    let said = f.run("convert m.obj --splats auto -o auto.ply").code(0).stderr();
    assert!(said.contains("its shape asks for") && said.contains("its colours for"), "{said}");
    // Colours of points.
    let said = f.run("convert p.xyz --colors fit -o p.ply").code(0).stderr();
    assert!(said.contains("colours"), "{said}");
    for (words, part) in [
        ("convert m.obj --texture fit --texture ewa -o x.ply", "--texture is given twice"),
        ("convert p.xyz --texture fit -o x.ply", "expected a mesh or an octree for --texture"),
        ("convert a.ply --texture ewa -o x.ply", "expected a mesh or an octree for --texture"),
        ("convert m.obj --colors fit -o x.ply", "expected points for --colors"),
        ("convert m.obj --splats none -o x.ply", "expected auto, or a whole number"),
        ("convert m.obj --sharp --splats auto -o x.ply", "auto"),
    ] {
        f.run(words).fails(2, part);
    }
}

//! How files become splats: the flags that `render` and `convert` share, and `convert` of scene files.

mod common;

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
        ("a.ply", "--cull back"),
    ]
    .iter()
    .enumerate()
    {
        f.run(&format!("convert {file} {flags} -o {i}.ply")).code(0);
        f.run(&format!("{i}.ply -o {i}-ply.exr --size 32x32 --exr-f32")).code(0);
        f.run(&format!("{file} {flags} -o {i}.exr --size 32x32 --exr-f32")).code(0);
        let (one, other) = (f.image(&format!("{i}.exr")), f.image(&format!("{i}-ply.exr")));
        assert!(one.color == other.color && one.depth == other.depth, "{file} {flags}");
        // And none of the flags is without effect.
        let fewer = if *file == "b.obj" { "--splats 400" } else { "" };
        f.run(&format!("{file} {fewer} -o plain.exr --size 32x32 --exr-f32 --force")).code(0);
        assert!(f.image("plain.exr").weight != one.weight, "{file} {flags} has no effect");
    }
    assert_eq!(f.run("info 6.ply --json").code(0).json()["counts"]["splats"], 120);
    let said = f.run("p.xyz -o x.png --size 8x8 --max-points 120").code(0).stderr();
    assert!(said.contains("120 of 300 points are left"), "{said}");
    // A flag that is for one of the inputs is right.
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
    // A flag wins over the file.
    assert_eq!(splats("s.json --splats 70"), 70);
    assert_eq!(splats("s.json --per-face"), 12);
    assert_eq!(splats("s.json --sharp --splats 48"), 48);
    // What a file has no use for is said, where no flag asks for it.
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

//! `compare`, `info` and `convert`.

use crate::common;

use common::{Folder, ball, cube, points};

#[test]
fn compare_measures_and_judges() {
    let f = Folder::new("compare");
    f.write("a.ply", ball());
    f.run("a.ply -o a.exr --size 24x24").code(0);
    f.run("a.ply -o a.png --size 24x24").code(0);
    f.run("a.ply -o b.exr --size 24x24 --shader normal").code(0);
    f.run("a.ply -o c.png --size 20x24").code(0);
    let same = f.run("compare a.exr a.exr --json --fail-above max-abs=0 --fail-below psnr=200").code(0).json();
    assert_eq!((&same["max_abs"], &same["rmse"], &same["flip"]), (&0.0.into(), &0.0.into(), &0.0.into()));
    assert_eq!(same["psnr"], "inf");
    let other = f.run("compare a.exr b.exr --json").code(0).json();
    let number = |key: &str| other[key].as_f64().unwrap();
    let rmse = number("rmse");
    assert!(number("max_abs") > rmse && rmse > 0.01 && number("flip") > 0.01);
    // Definition: 20·log10(1/RMSE); 1e-9 is far above rounding.
    assert!((number("psnr") + 20.0 * rmse.log10()).abs() < 1e-9);
    for plane in ["Z", "normal", "weight"] {
        assert_eq!(other["planes"][plane]["max_abs"], 0.0, "{plane}");
    }
    f.run(&format!("compare a.exr b.exr --fail-above rmse={}", rmse * 1.01)).code(0);
    f.run(&format!("compare a.exr b.exr --fail-above rmse={}", rmse * 0.99)).fails(5, "rmse");
    f.run("compare a.exr b.exr --fail-below psnr=100 --diff d.png").fails(5, "psnr");
    assert_eq!(f.image("d.png").width, 24);
    f.run("compare a.exr b.exr --diff d.png").fails(1, "--force");
    // 8 bits and half floats: half a level in the encoded image, near white 1/510 · 2.2 in linear light.
    f.run("compare a.exr a.png --fail-above max_abs=0.006").code(0);
    f.run("compare a.exr c.png").fails(3, "24x24 and 20x24");
    f.run("compare a.exr a.ply").fails(3, "a.ply");
    f.run("compare a.exr nowhere.png").fails(3, "nowhere.png");
    assert!(f.run("compare a.exr b.exr").code(0).stdout().contains("psnr"));
}

#[test]
fn info_says_what_a_file_holds() {
    let f = Folder::new("info");
    f.write("a.ply", ball());
    f.write("b.obj", cube());
    f.write("p.xyz", points());
    let splats = f.run("info a.ply --json").code(0).json();
    assert_eq!((&splats["kind"], &splats["splats"]), (&"splats".into(), &200.into()));
    assert_eq!((&splats["radii"]["median"], &splats["radii"]["estimated"]), (&0.25.into(), &false.into()));
    assert_eq!(splats["up"], "+y");
    assert_eq!(splats["attributes"]["radius"], serde_json::json!({"min": 0.25, "max": 0.25}));
    assert_eq!(splats["attributes"]["colour"]["max"].as_array().unwrap().len(), 3);
    let top = splats["bounds"][1][2].as_f64().unwrap();
    assert!((1.0..1.1).contains(&top), "{top}");
    let mesh = f.run("info b.obj --json").code(0).json();
    assert_eq!((&mesh["vertices"], &mesh["triangles"]), (&8.into(), &12.into()));
    assert_eq!(mesh["bounds"][1], serde_json::json!([1.0, 1.0, 1.0]));
    let cloud = f.run("info p.xyz --json").code(0).json();
    assert_eq!((&cloud["points"], &cloud["up"]), (&300.into(), &"+z".into()));
    assert_eq!(cloud["radii"]["estimated"], true);
    // Points have no extent, so their positions give the bounds.
    let position = &cloud["attributes"]["position"];
    assert_eq!(cloud["bounds"], serde_json::json!([position["min"], position["max"]]));
    assert!(cloud["memory_bytes"].as_u64().unwrap() >= 3600);
    assert!(f.run("info p.xyz").code(0).stdout().contains("300 points"));
}

#[test]
fn radii_may_lack_normals_and_change_no_axis() {
    let f = Folder::new("radii");
    // Splats get the up axis of most splat files, unless a comment states that they were made from points.
    for (comment, up) in [("", "+y"), ("comment made of points\n", "+z")] {
        f.write("a.ply", ball().replace("element", &format!("{comment}element")));
        let said = f.run("a.ply -o a.png --size 8x8 --force").code(0).stderr();
        assert!(said.contains(&format!("up is {up}")), "{said}");
    }
    let bare = |radius: &str| {
        let rows: String = points().lines().map(|at| format!("{at} {radius}\n")).collect();
        let names: String = ["x", "y", "z", "radius"].map(|name| format!("property float {name}\n")).concat();
        format!("ply\nformat ascii 1.0\nelement vertex 300\n{names}end_header\n{rows}")
    };
    // Three hundred points of a sphere are 0.2 apart.
    f.write("small.ply", bare("0.25"));
    f.write("large.ply", bare("5"));
    let said = f.run("convert small.ply -o s.ply").code(0).stderr();
    assert!(said.contains("normals estimated") && said.contains("radii as the file has them (median 0.250)"), "{said}");
    let facts = f.run("info s.ply --json").code(0).json();
    assert_eq!(facts["radii"]["min"], 0.25);
    assert_eq!(facts["attributes"]["radius"], serde_json::json!({"min": 0.25, "max": 0.25}), "once");
    assert_eq!(f.run("info small.ply --json").code(0).json()["radii"]["how"], "given");
    let said = f.run("convert large.ply -o l.ply").code(0).stderr();
    assert!(said.contains("left a column") && said.contains("expected at most 5"), "{said}");
    assert!(f.run("info l.ply --json").code(0).json()["attributes"].to_string().contains("\"max\":5.0"));
    let said = f.run("convert small.ply --max-points 100 -o t.ply").code(0).stderr();
    assert!(said.contains("radii estimated") && said.contains("left the file's radii a column"), "{said}");
    f.run("small.ply --where radius>1 -o n.png").fails(3, "none is left");
}

#[test]
fn info_estimates_large_clouds_as_a_render_would() {
    let f = Folder::new("large");
    let grid = |n: usize| -> String { (0..n * n).map(|i| format!("{} {} 0\n", i % n, i / n)).collect() };
    f.write("p.xyz", grid(150));
    let median = f.run("info p.xyz --json").code(0).json()["radii"]["median"].as_f64().unwrap();
    f.run("convert p.xyz -o p.ply").code(0);
    let real = f.run("info p.ply --json").code(0).json()["radii"]["median"].as_f64().unwrap();
    // A regular grid has one spacing, so a sample of it has the same median, up to f32 radii.
    assert!((median / real - 1.0).abs() < 1e-3, "{median} {real}");
}

#[test]
fn convert_makes_splats_that_render_alike() {
    let f = Folder::new("convert");
    f.write("p.xyz", points());
    f.write("b.obj", cube());
    let said = f.run("convert p.xyz -o p.ply").code(0).stderr();
    assert!(said.contains("300") && said.contains("estimated") && said.contains("interior weight"), "{said}");
    // Few rough points are drawn as balls otherwise.
    f.run("p.xyz --points-as surface -o a.exr --size 24x24").code(0);
    f.run("p.ply -o b.exr --size 24x24").code(0);
    assert_eq!(f.image("a.exr").color, f.image("b.exr").color);
    let count = |words: &str| {
        f.run(&format!("convert b.obj -o x.ply --force {words}")).code(0);
        f.run("info x.ply --json").code(0).json()
    };
    assert_eq!(count("--per-face")["splats"], 12);
    assert_eq!(count("--per-vertex")["splats"], 8);
    let one = count("--splats 500");
    assert_eq!(one["splats"], 500);
    assert!(one["interior_weight"].as_f64().unwrap() > 1.0);
    let two = count("--splats 500 --radius-scale 2 --ascii");
    let ratio = two["radii"]["median"].as_f64().unwrap() / one["radii"]["median"].as_f64().unwrap();
    assert!((1.5..=2.01).contains(&ratio), "{ratio}");
    let stdout = f.run("convert b.obj -o - --per-face");
    assert!(stdout.code(0).bytes().starts_with(b"ply\n"));
}

#[test]
fn hybrid_holds_a_mesh_as_splats_and_polygons() {
    let f = Folder::new("hybrid");
    f.write("b.obj", cube());
    f.run("convert b.obj --hybrid -o b.ply").fails(2, ".surfel");
    f.run("convert b.obj -o b.surfel").fails(2, "--hybrid");
    f.run("convert b.obj --hybrid -o b.surfel").code(0);
    f.run("convert b.obj --hybrid -o b.surfel").fails(1, "--force");
    let facts = f.run("info b.surfel --json").code(0).json();
    assert_eq!((&facts["kind"], &facts["triangles"]), (&"octree".into(), &12.into()));
    assert_eq!(facts["bounds"][1], serde_json::json!([1.0, 1.0, 1.0]));
    let splats = |error: &str| {
        let words = format!("b.surfel -o {error}.png --size 96x96 --backend reference --lod-error {error} --stats");
        f.run(&words).code(0).json()["splats"].as_u64().unwrap()
    };
    assert_eq!(splats("0.01"), 0, "polygons alone");
    assert!(splats("100") > 100, "splats alone");
    // A cube in either form is the same except at edges, which splats of 2 % of its size round off (measured: 0.08).
    f.run("compare 0.01.png 100.png --fail-above rmse=0.12").code(0);
    f.write("damaged.surfel", &f.read("b.surfel")[..900]);
    f.run("damaged.surfel -o x.png").fails(3, "damaged.surfel");
    f.write("wrong.surfel", "ply?");
    f.run("wrong.surfel -o x.png").fails(3, "SURFEL");
}

#[test]
fn what_the_cpu_does_not_draw_the_reference_does() {
    let f = Folder::new("frame");
    f.write("a.ply", ball());
    f.write("b.obj", cube());
    f.write("mesh.json", common::scene("").replace("\"splats\": \"a.ply\"", "\"mesh\": \"b.obj\""));
    f.run("mesh.json -o mesh.png").code(0);
    f.run("a.ply -o toon.png --size 24x24 --shader toon --shadows").code(0);
    f.run("a.ply -o peel.png --size 24x24 --transparency peel:3").code(0);
    let covered = f.image("mesh.png").color.unwrap().iter().filter(|c| c[3] > 0.5).count();
    assert!(covered > 100, "{covered}");
}

#[test]
fn convert_sharp_clips_along_creases_and_says_how_far_off_it_is() {
    let f = Folder::new("sharp");
    f.write("b.obj", cube());
    f.write("p.xyz", points());
    let run = f.run("convert b.obj -o x.ply --sharp --splats 48 --crease-angle 30").code(0);
    assert!(
        run.stderr().contains("12 ridges of 12 edges") && run.stderr().contains("sharp errors"),
        "{}",
        run.stderr()
    );
    let info = f.run("info x.ply --json").code(0).json();
    assert_eq!(info["splats"], 48);
    assert!(info["attributes"]["clip lines"].is_object(), "{info}");
    assert!(info["sharp_errors"].as_str().unwrap().starts_with("splats to mesh"), "{info}");
    assert!(f.run("info x.ply").code(0).stdout().contains("sharp errors"));
    f.run("x.ply -o x.png --size 24x24").code(0);
    f.run("convert x.ply -o y.ply --sharp").fails(2, "holds splats");
    f.run("convert b.obj -o y.ply --crease-angle 30").fails(2, "--sharp");
    f.run("convert b.obj -o y.ply --sharp --per-face").fails(2, "--per-face");
    f.run("convert b.obj -o y.ply --sharp --error 0").fails(2, "");
}

#[test]
fn convert_sharp_finds_the_edges_of_points() {
    let f = Folder::new("sharp-points");
    f.write("p.xyz", points());
    f.run("convert p.xyz -o p.ply --sharp --splats 9").fails(2, "p.xyz");
    let said = f.run("convert p.xyz -o p.ply --sharp --crease-angle 120").code(0).stderr();
    assert!(said.contains("nothing is clipped"), "{said}");
    // Three faces of a cube, 24 points along an edge.
    let at = |i: usize| (i as f64 + 0.5) / 24.0;
    let grid = || (0..24 * 24).map(|i| (at(i % 24), at(i / 24)));
    let faces = grid().map(|(a, b)| format!("{a} {b} 0\n{a} 0 {b}\n0 {a} {b}\n"));
    f.write("c.xyz", faces.collect::<String>());
    let said = f.run("convert c.xyz -o c.ply --sharp").code(0).stderr();
    assert!(said.contains("splats clipped along edges"), "{said}");
    let info = f.run("info c.ply --json").code(0).json();
    assert!(info["attributes"]["clip lines"].is_object(), "{info}");
}

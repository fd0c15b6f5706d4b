//! Interface that users' scripts and files rely on: settings by flag, the scene file's keys and defaults, and the PLY
//! profile's forms of the same splats.

use crate::common;

use common::{Folder, cube, points, scene};
use serde_json::{Value, json};

/// Returns all planes of a scene file's image, drawn by the reference backend.
fn image(f: &Folder, file: &str) -> surfel_io::Planes {
    f.run(&format!("{file} -o {file}.exr --backend reference --exr-f32 --force")).code(0);
    let mut planes = f.image(&format!("{file}.exr"));
    planes.metadata.clear();
    assert!(planes.weight.as_ref().is_some_and(|w| w.iter().any(|w| *w > 0.0)), "{file} shows nothing");
    planes
}

/// Encodes splats as a PLY file with the given properties and rows.
fn ply(properties: &str, rows: &[&str]) -> String {
    let properties: String = properties.split(' ').map(|p| format!("property {}\n", p.replace(':', " "))).collect();
    format!("ply\nformat ascii 1.0\nelement vertex {}\n{properties}end_header\n{}\n", rows.len(), rows.join("\n"))
}

const ELLIPSES: &str =
    "float:x float:y float:z float:su float:sv float:sw float:tu float:tv float:tw float:red float:green float:blue";

fn ellipses() -> String {
    ply(
        ELLIPSES,
        &[
            "-0.5 0 0 0.5 0 0 0 1 0 0.5 0.25 1",
            "0.5 0.125 0.25 0.5 0 0.25 0 1 0 1 0.5 0.125",
            "0 -0.5 -1 1 0 0 0 0.5 0 0.25 1 0.5",
        ],
    )
}

#[test]
fn settings_by_flag_are_what_the_scene_file_says() {
    let f = Folder::new("flags");
    f.write("a.ply", ellipses());
    f.write("s.json", scene(""));
    let print = |words: &str| f.run(&format!("render s.json --print-scene {words}")).code(0).json();
    for (flag, key, expected) in [
        ("--filter none", "filter", json!("none")),
        ("--filter clamp", "filter", json!("clamp")),
        ("--filter adjust", "filter", json!("adjust")),
        ("--filter principal", "filter", json!("principal")),
        ("--filter ewa", "filter", json!("ewa")),
        ("--mapping affine", "mapping", json!("affine")),
        ("--cutoff 1.5", "cutoff", json!(1.5)),
        ("--prefilter 1.25", "prefilter_radius_px", json!(1.25)),
        ("--prefilter 0", "prefilter_radius_px", json!(0.0)),
        ("--depth-tolerance 0.5", "depth_tolerance", json!({"relative": 0.5})),
        ("--depth-tolerance abs:0.25", "depth_tolerance", json!({"absolute": 0.25})),
        ("--accumulate f16", "accumulate", json!("f16")),
        ("--transparency peel:4", "transparency", json!("peel:4")),
        ("--transparency peel:4:drop", "transparency", json!("peel:4:drop")),
        ("--transparency abuffer:3", "transparency", json!("abuffer:3")),
        ("--clip paper", "clip", json!("paper")),
        ("--clip line", "clip", json!("line")),
        ("--clip off", "clip", json!("off")),
        ("--shader phong", "shader", json!("phong")),
        ("--shader toon", "shader", json!("toon")),
        ("--shader normal", "shader", json!("normal")),
        ("--shader depth", "shader", json!("depth")),
        ("--edge-aa", "edge_aa", json!(true)),
        ("--edge-aa=on", "edge_aa", json!(true)),
        ("--edge-aa=samples", "edge_aa", json!("samples")),
        ("--edge-aa --edge-aa=off", "edge_aa", json!(null)),
    ] {
        if flag == "--edge-aa --edge-aa=off" {
            f.run(&format!("render s.json --print-scene {flag}")).fails(2, "--edge-aa");
            continue;
        }
        assert_eq!(print(flag)["settings"][key], expected, "{flag}");
        // One flag changes one key.
        let mut changed = print(flag)["settings"].clone();
        changed[key] = print("")["settings"][key].clone();
        assert_eq!(changed, print("")["settings"], "{flag}");
    }
    assert_eq!(print("--edge-aa=off")["settings"]["edge_aa"], false);
    let scene = print("--background 0.25,0.5,1 --up -z --camera-up 1,0,0 --target 0,0,1 --fov-y 20 --size 12x9");
    assert_eq!((&scene["background"], &scene["up"]), (&json!([0.25, 0.5, 1.0, 1.0]), &json!("-z")));
    assert_eq!(
        (&scene["camera"]["up"], &scene["camera"]["target"]),
        (&json!([1.0, 0.0, 0.0]), &json!([0.0, 0.0, 1.0]))
    );
    assert_eq!(print("--background 0,0,0,0.5")["background"], json!([0.0, 0.0, 0.0, 0.5]));
    assert_eq!(print("--background transparent")["background"], json!([0.0, 0.0, 0.0, 0.0]));
}

#[test]
fn scene_file_defaults_are_the_documented_ones() {
    let f = Folder::new("defaults");
    f.write("a.ply", ellipses());
    let shaded = |settings: &str| scene(&format!("\"shader\": \"phong\"{settings}"));
    f.write("short.json", shaded(""));
    let mut long: Value = serde_json::from_str(&shaded("")).unwrap();
    long["up"] = json!("+y");
    long["background"] = json!([0, 0, 0, 0]);
    long["ambient"] = json!([0.1, 0.1, 0.1]);
    long["lights"] = json!([{"directional": {"direction": [0, 0, -1], "color": [1, 1, 1], "shadow": false}}]);
    long["camera"]["up"] = json!([0, 1, 0]);
    long["camera"]["near"] = json!(0.01);
    long["objects"][0]["matrix"] = json!([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]);
    long["objects"][0]["material"] =
        json!({"ambient": 1, "diffuse": 1, "specular": 0.2, "shininess": 32, "cull": "none", "two_sided": true});
    long["settings"] = json!({"filter": "principal", "cutoff": 2.0,
        "prefilter_radius_px": std::f64::consts::FRAC_1_SQRT_2,
        "mapping": "exact", "depth_tolerance": {"relative": 1.0}, "shader": "phong", "edge_aa": false,
        "transparency": "off", "clip": "exact", "accumulate": "f32"});
    f.write("long.json", long.to_string());
    let want = image(&f, "short.json");
    assert_eq!(image(&f, "long.json"), want);
    // Every key has an effect here, except those that have nothing to act on.
    let differs = |change: &dyn Fn(&mut Value)| {
        let mut other = long.clone();
        change(&mut other);
        f.write("other.json", other.to_string());
        image(&f, "other.json") != want
    };
    assert!(differs(&|s| s["background"] = json!([0, 0, 0, 1])));
    assert!(differs(&|s| s["ambient"] = json!([0.1, 0.2, 0.1])));
    assert!(differs(&|s| s["lights"] = json!([])));
    assert!(differs(&|s| s["camera"]["up"] = json!([0.1, 1, 0])));
    assert!(differs(&|s| s["camera"]["near"] = json!(4.9)));
    for (key, value) in [("ambient", 0.5), ("diffuse", 0.5), ("specular", 0.5), ("shininess", 2.0)] {
        assert!(differs(&|s| s["objects"][0]["material"][key] = json!(value)), "{key}");
    }
    for (key, value) in [
        ("filter", json!("ewa")),
        ("cutoff", json!(1.0)),
        ("prefilter_radius_px", json!(5.0)),
        ("depth_tolerance", json!({"absolute": 2.0})),
        ("shader", json!("unlit")),
        ("edge_aa", json!(true)),
        ("edge_aa", json!("samples")),
        ("mapping", json!("affine")),
    ] {
        assert!(differs(&|s| s["settings"][key] = value.clone()), "{key}");
    }
}

#[test]
fn scene_file_matrices_are_column_major_and_compose_as_points_do() {
    let f = Folder::new("matrix");
    f.write("a.ply", ellipses());
    // x' = 2y + 0.25, y' = x, z' = z − 1; this also mirrors.
    let matrix = "0,1,0,0, 2,0,0,0, 0,0,1,0, 0.25,0,-1,1";
    f.write("m.json", scene("").replace("\"a.ply\"", &format!("\"a.ply\", \"matrix\": [{matrix}]")));
    let moved = [
        "0.25 -0.5 -1 0 0.5 0 2 0 0 0.5 0.25 1",
        "0.5 0.5 -0.75 0 0.5 0.25 2 0 0 1 0.5 0.125",
        "-0.75 0 -2 0 1 0 1 0 0 0.25 1 0.5",
    ];
    f.write("b.ply", ply(ELLIPSES, &moved));
    f.write("b.json", scene("").replace("a.ply", "b.ply"));
    let (a, b) = (image(&f, "m.json"), image(&f, "b.json"));
    assert_eq!((a.color, a.depth, a.weight), (b.color, b.depth, b.weight));
    // The outside stays the outside: s × t is reversed, the normal isn't (two-sided materials show the same either
    // way).
    let side = "\"a.ply\", \"material\": {\"cull\": \"back\", \"two_sided\": false}";
    f.write("c.json", scene("").replace("\"a.ply\"", &format!("{side}, \"matrix\": [{matrix}]")));
    f.write("d.json", scene("").replace("\"a.ply\"", &side.replace("a.ply", "b.ply")));
    image(&f, "c.json");
    f.run("d.json -o d.exr --backend reference").code(0);
    assert!(f.image("d.exr").weight.unwrap().iter().all(|w| *w == 0.0), "s × t of the moved splats faces away");
    for bad in ["1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,2", "1,0,0,0, 1,0,0,0, 0,0,1,0, 0,0,0,1", "1,0,0"] {
        f.write("bad.json", scene("").replace("\"a.ply\"", &format!("\"a.ply\", \"matrix\": [{bad}]")));
        f.run("bad.json -o bad.png").fails(3, "bad.json");
    }
}

#[test]
fn scene_file_splats_may_be_points_or_a_mesh_and_paths_are_relative_to_it() {
    let f = Folder::new("kinds");
    std::fs::create_dir_all(f.path().join("sub")).unwrap();
    f.write("sub/b.obj", cube());
    f.write("sub/p.xyz", points());
    for (file, words) in [("b.obj", "b.obj"), ("p.xyz", "p.xyz")] {
        f.write("sub/s.json", scene("\"shader\": \"phong\"").replace("a.ply", words));
        let splats = image(&f, "sub/s.json");
        f.run(&format!("convert sub/{file} -o sub/c.ply --force")).code(0);
        f.write("sub/c.json", scene("\"shader\": \"phong\"").replace("a.ply", "c.ply"));
        assert_eq!(image(&f, "sub/c.json"), splats, "{file}");
    }
    // Polygons give another image, with sharp edges and a weight of 0.
    f.write("sub/m.json", scene("").replace("\"splats\": \"a.ply\"", "\"mesh\": \"b.obj\""));
    f.run("sub/m.json -o m.exr --backend reference").code(0);
    let mesh = f.image("m.exr");
    let covered = mesh.depth.unwrap().iter().filter(|z| z.is_finite()).count();
    assert!(covered > 20 && mesh.weight.unwrap().iter().all(|w| *w == 0.0), "{covered}");
}

#[test]
fn scene_file_lights_and_projections_have_their_forms() {
    let f = Folder::new("forms");
    f.write("a.ply", ellipses());
    let with = |key: &str, value: Value| {
        let mut file: Value = serde_json::from_str(&scene("\"shader\": \"phong\"")).unwrap();
        match key.split_once('.') {
            Some((outer, inner)) => file[outer][inner] = value,
            None => file[key] = value,
        }
        file.to_string()
    };
    let lights = [
        json!({"directional": {"direction": [-1, -1, -1]}}),
        json!({"point": {"position": [0, 3, 0], "color": [1, 0.5, 1]}}),
        json!({"spot": {"position": [0, 3, 3], "direction": [0, -1, -1], "inner_deg": 20, "outer_deg": 30}}),
        json!({"spot": {"position": [0, 3, 3], "direction": [0, -1, -1], "inner_deg": 20, "outer_deg": 30,
            "shadow": true}}),
    ];
    for light in lights {
        f.write("l.json", with("lights", json!([light])));
        image(&f, "l.json");
    }
    // Only lights that cast shadows have the key; angles must be ordered.
    for light in [
        json!({"point": {"position": [0, 3, 0], "shadow": true}}),
        json!({"spot": {"position": [0, 3, 3], "direction": [0, -1, 0], "inner_deg": 40, "outer_deg": 30}}),
        json!({"directional": {"direction": [0, 0, 0]}}),
        json!({"area": {"position": [0, 3, 0]}}),
    ] {
        f.write("l.json", with("lights", json!([light])));
        f.run("l.json -o l.png").fails(3, "l.json");
    }
    // 30° over 30 rows, and the same by focal length and centre in pixels.
    f.write("p.json", with("camera.projection", json!({"perspective": {"fov_y_deg": 30}})));
    let focal = 15.0 / 15f64.to_radians().tan();
    let intrinsics = json!({"intrinsics": {"fx": focal, "fy": focal, "cx": 20, "cy": 15}});
    f.write("i.json", with("camera.projection", intrinsics));
    let (p, i) = (image(&f, "p.json"), image(&f, "i.json"));
    let close = |a: &[f32], b: &[f32]| a.iter().zip(b).all(|(a, b)| a == b || (a - b).abs() < 1e-5);
    assert!(close(p.color.unwrap().as_flattened(), i.color.unwrap().as_flattened()));
    assert!(close(&p.depth.unwrap(), &i.depth.unwrap()));
    f.write("o.json", with("camera.projection", json!({"orthographic": {"height": 3}})));
    f.run("o.json -o o.png").fails(3, "far");
    let ortho: Value =
        serde_json::from_str(&with("camera.projection", json!({"orthographic": {"height": 3}}))).unwrap();
    let mut ortho = ortho.clone();
    ortho["camera"]["far"] = json!(20);
    f.write("o.json", ortho.to_string());
    image(&f, "o.json");
}

#[test]
fn ply_forms_of_the_same_splats_give_the_same_image() {
    let f = Folder::new("ply");
    f.write("a.ply", ellipses());
    f.write("s.json", scene("\"shader\": \"normal\""));
    let want = image(&f, "s.json");
    // Another order and other types.
    let shuffled = "double:blue double:tw double:tv double:tu double:sw double:sv double:su double:z double:y double:x \
                    double:red double:green";
    f.write(
        "a.ply",
        ply(
            shuffled,
            &[
                "1 0 1 0 0 0 0.5 0 0 -0.5 0.5 0.25",
                "0.125 0 1 0 0.25 0 0.5 0.25 0.125 0.5 1 0.5",
                "0.5 0 0.5 0 0 0 1 -1 -0.5 0 0.25 1",
            ],
        ),
    );
    assert_eq!(image(&f, "s.json"), want);
    // The other two encodings, written by the program itself.
    f.write("x.ply", ellipses());
    f.run("convert x.ply -o a.ply --force").code(0);
    assert!(f.read("a.ply").windows(20).any(|w| w == b"binary_little_endian"));
    assert_eq!(image(&f, "s.json"), want);
    f.run("convert x.ply -o a.ply --force --ascii").code(0);
    assert_eq!(image(&f, "s.json"), want);
    let mut big = b"ply\nformat binary_big_endian 1.0\nelement vertex 3\n".to_vec();
    for property in ELLIPSES.split(' ') {
        big.extend(format!("property {}\n", property.replace(':', " ")).bytes());
    }
    big.extend(b"end_header\n");
    let text = ellipses();
    let rows = text.split_once("end_header\n").unwrap().1;
    big.extend(rows.split_whitespace().flat_map(|v| v.parse::<f32>().unwrap().to_be_bytes()));
    f.write("a.ply", big);
    assert_eq!(image(&f, "s.json"), want);
}

#[test]
fn ply_optional_properties_mean_what_the_profile_says() {
    let f = Folder::new("optional");
    let axes = "float:x float:y float:z float:su float:sv float:sw float:tu float:tv float:tw";
    let row = "0 0 0 1 0 0 0 1 0";
    let drawn = |properties: &str, row: &str, settings: &str| {
        f.write("a.ply", ply(properties, &[row]));
        f.write("s.json", scene(settings));
        image(&f, "s.json")
    };
    let plain = drawn(axes, row, "");
    // Splats without a colour are white; sRGB bytes are decoded, floats are linear; alpha is linear in both forms.
    assert_eq!(plain.color.as_ref().unwrap()[15 * 40 + 20], [1.0; 4]);
    let color = |kind: &str, values: &str| {
        let properties = format!("{axes} {kind}:red {kind}:green {kind}:blue {kind}:alpha");
        drawn(&properties, &format!("{row} {values}"), "\"transparency\": \"peel:2\"").color.unwrap()[15 * 40 + 20]
    };
    let bytes = color("uchar", "188 255 0 51");
    // IEC 61966-2-1: ((188/255 + 0.055)/1.055)^2.4 = 0.502886; premultiplied by 51/255.
    assert!((bytes[0] - 0.2 * 0.502_886_5).abs() < 1e-6 && (bytes[1] - 0.2).abs() < 1e-6, "{bytes:?}");
    assert!((bytes[3] - 0.2).abs() < 1e-6, "{bytes:?}");
    let floats = color("float", "0.5 1 0 0.2");
    assert!((floats[0] - 0.1).abs() < 1e-6 && (floats[3] - 0.2).abs() < 1e-6, "{floats:?}");
    // A disk is an ellipse with equal axes.
    let disk = drawn("float:x float:y float:z float:nx float:ny float:nz float:radius", "0 0 0 0 0 3 1", "");
    assert_eq!((&disk.depth, &disk.normal), (&plain.depth, &plain.normal));
    // A normal in addition to the axes is used for shading.
    let tilted = drawn(&format!("{axes} float:nx float:ny float:nz"), &format!("{row} 3 0 4"), "");
    let normal = tilted.normal.unwrap()[15 * 40 + 20];
    assert!((normal[0] - 0.6).abs() < 1e-6 && (normal[2] - 0.8).abs() < 1e-6, "{normal:?}");
    assert_eq!(tilted.weight, plain.weight);
    // Clips: NaN means none; a line keeps a·u + b·v + c ≥ 0; modes.
    let curve = "float:clip_theta1 float:clip_theta3 float:clip_u float:clip_v float:clip_w";
    let clipped = |properties: &str, values: &str| {
        drawn(&format!("{axes} {properties}"), &format!("{row} {values}"), "").weight.unwrap()
    };
    let count = |weights: &[f32]| weights.iter().filter(|w| **w > 0.0).count();
    let whole = plain.weight.unwrap();
    assert_eq!(clipped(curve, "0 3 0 1 nan"), whole);
    // From 0 to π counter-clockwise: the upper half is clipped.
    let lower = clipped(curve, "0 3.14159265 0 0 0");
    assert!(lower[10 * 40 + 20] == 0.0 && lower[20 * 40 + 20] > 0.0);
    let line = "float:clip_line0_a float:clip_line0_b float:clip_line0_c";
    let right = clipped(line, "1 0 0");
    assert!(right[15 * 40 + 16] == 0.0 && right[15 * 40 + 24] > 0.0);
    assert_eq!(clipped(line, "1 0 nan"), whole);
    let two = format!("{line} float:clip_line2_a float:clip_line2_b float:clip_line2_c");
    let (and, or) = (clipped(&two, "1 0 0 0 1 0"), clipped(&format!("{two} uchar:clip_mode"), "1 0 0 0 1 0 1"));
    assert_eq!(clipped(&format!("{two} uchar:clip_mode"), "1 0 0 0 1 0 0"), and);
    let quarter = count(&whole) as f64 / 4.0;
    for (weights, quarters) in [(&and, 1.0), (&right, 2.0), (&or, 3.0)] {
        // Up to a column of pixels.
        assert!((count(weights) as f64 - quarters * quarter).abs() < 14.0, "{quarters} {}", count(weights));
    }
}

#[test]
fn ply_unknown_properties_and_comments_survive_a_conversion() {
    let f = Folder::new("unknown");
    let text = ply(&format!("{ELLIPSES} short:label double:time"), &["0 0 0 1 0 0 0 1 0 0 0 1 -7 0.125"]);
    f.write("a.ply", text.replace("element", "comment interior_weight 3.5\ncomment by hand\nelement"));
    f.run("convert a.ply -o b.ply --ascii").code(0);
    let converted = String::from_utf8(f.read("b.ply")).unwrap();
    for part in ["property short label", "property double time", "comment by hand", "comment interior_weight 3.5"] {
        assert!(converted.contains(part), "{part}: {converted}");
    }
    assert!(converted.trim_end().ends_with("-7 0.125"), "{converted}");
}

#[test]
fn points_that_are_nowhere_are_counted_and_splats_that_are_invalid_refused() {
    let f = Folder::new("nowhere");
    f.write("p.xyz", points() + "nan 0 0\n1 inf 0\n");
    let said = f.run("p.xyz -o p.png --size 16x16").code(0).stderr();
    assert!(said.contains("dropped 2 points") && said.contains("estimated"), "{said}");
    f.write("a.ply", ellipses().replacen("0.5 0.125 0.25", "nan 0.125 0.25", 1));
    f.run("a.ply -o a.png --size 16x16").fails(3, "--repair");
    let said = f.run("a.ply -o a.png --size 16x16 --repair").code(0).stderr();
    assert!(said.contains("dropped 1"), "{said}");
}

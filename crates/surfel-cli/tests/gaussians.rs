//! Files of trained Gaussians: detected, requested by options, and refused.

use crate::common;

use common::{Folder, ball, scene};
use serde_json::json;

/// Returns a PLY of four Gaussians with harmonics of degree 1. They are flat (2DGS) if `third` is `None`, and otherwise
/// solid (3DGS) with `third` as the value of `scale_2`.
fn gaussians(third: Option<&str>) -> String {
    let mut names: Vec<String> = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"].map(Into::into).into();
    names.extend((0..9).map(|i| format!("f_rest_{i}")));
    names.extend(["opacity", "scale_0", "scale_1"].map(Into::into));
    names.extend(third.map(|_| "scale_2".to_owned()));
    names.extend((0..4).map(|i| format!("rot_{i}")));
    let properties: String = names.iter().map(|name| format!("property float {name}\n")).collect();
    let mut text = format!("ply\nformat ascii 1.0\nelement vertex 4\n{properties}end_header\n");
    for (i, place) in ["0 0 0", "0.4 0 0.3", "-0.3 0.3 -0.2", "0 -0.4 0.1"].into_iter().enumerate() {
        let rest = ["0.1"; 9].join(" ");
        let third = third.unwrap_or_default();
        text += &format!("{place} 0 0 0 1 {i} -1 {rest} {i} -1.2 -1.6 {third} 1 0.{i} 0.2 0\n");
    }
    text
}

#[test]
fn bare_files_of_gaussians_are_drawn_as_trained() {
    let f = Folder::new("bare");
    f.write("flat.ply", gaussians(None));
    f.write("solid.ply", gaussians(Some("-2")));
    for name in ["flat", "solid"] {
        let planes = "--planes alpha,median_depth,distortion,depth,normal";
        let run = f.run(&format!("{name}.ply -o {name}.exr --size 40x30 {planes}")).code(0);
        assert!(run.stderr().contains("--composite over"), "{}", run.stderr());
        assert!(!run.stderr().contains("ignored"), "{}", run.stderr());
        let image = f.image(&format!("{name}.exr"));
        let plane = |name: &str| image.other.iter().find(|(n, _)| n == name).map(|(_, values)| values.as_slice());
        let (alpha, median) = (plane("alpha").unwrap(), plane("median_depth").unwrap());
        assert_eq!(alpha, image.weight.as_deref().unwrap());
        assert!(alpha.iter().any(|a| *a > 0.9) && alpha.iter().all(|a| (0.0..=1.0).contains(a)));
        let depth = image.depth.as_deref().unwrap();
        assert!(median.iter().zip(depth).all(|(m, z)| m.is_finite() == z.is_finite()));
        assert!(plane("distortion").unwrap().iter().any(|d| *d > 0.0) && image.normal.is_some());
        let printed = f.run(&format!("render {name}.ply --print-scene --size 40x30")).code(0).json();
        assert_eq!(
            (&printed["settings"]["composite"], &printed["settings"]["shader"]),
            (&json!("over"), &json!("unlit"))
        );
        // The printed scene gives the same image, and so does the image's metadata.
        f.write("printed.json", printed.to_string());
        f.run(&format!("printed.json -o p-{name}.exr {planes}")).code(0);
        let again = f.image(&format!("p-{name}.exr"));
        assert_eq!((again.color, again.other), (image.color, image.other));
        f.run(&format!("again {name}.exr -o again-{name}.exr")).code(0);
    }
}

#[test]
fn flags_of_surfaces_and_other_files_beside_make_surfaces_of_gaussians() {
    let f = Folder::new("surfaces");
    f.write("flat.ply", gaussians(None));
    f.write("ball.ply", ball());
    let print =
        |words: &str| f.run(&format!("render {words} --print-scene --size 40x30")).code(0).json()["settings"].clone();
    for words in [
        "flat.ply --composite surface",
        "flat.ply --shader phong",
        "flat.ply --crop -1,-1,-1,1,1,1",
        "flat.ply --edge-aa",
        "flat.ply ball.ply",
    ] {
        assert_eq!((&print(words)["composite"], &print(words)["shader"]), (&json!(null), &json!("phong")), "{words}");
        f.run(&format!("{words} -o a.png --size 40x30 --force")).code(0);
    }
    // A scene file draws them as a surface by default; a flag decides otherwise.
    f.write("a.ply", gaussians(None));
    f.write("s.json", scene(""));
    let surface = f.run("s.json -o surface.exr").code(0).stderr();
    assert!(surface.contains("ignored"), "{surface}");
    f.run("s.json -o over.exr --composite over").code(0);
    f.write("o.json", scene("\"composite\": \"over\""));
    f.run("o.json -o same.exr").code(0);
    f.write("p.json", scene("\"composite\": \"over\", \"sort\": \"pixel\""));
    f.run("p.json -o p.exr").code(0);
    f.run("o.json -o q.exr --sort pixel").code(0);
    assert_eq!(f.image("p.exr").color, f.image("q.exr").color);
    assert_eq!(print("flat.ply --sort pixel")["sort"], json!("pixel"));
    // Only two of the filters apply to Gaussians.
    for (filter, of_gaussians) in [("clamp", json!(null)), ("principal", json!("principal"))] {
        let settings = print(&format!("flat.ply --filter {filter}"));
        assert_eq!((&settings["composite"], &settings["gaussian_filter"]), (&json!("over"), &of_gaussians));
        f.run(&format!("o.json -o {filter}.exr --filter {filter}")).code(0);
    }
    assert_eq!(f.image("clamp.exr").color, f.image("same.exr").color);
    assert_ne!(f.image("principal.exr").color, f.image("same.exr").color);
    assert_eq!(print("flat.ply --filter ewa")["composite"], json!(null));
    f.write("g.json", scene("\"composite\": \"over\", \"gaussian_filter\": \"principal\""));
    f.run("g.json -o g.exr").code(0);
    assert_eq!(f.image("principal.exr").color, f.image("g.exr").color);
    f.write("g.json", scene("\"composite\": \"over\", \"gaussian_filter\": \"ewa\""));
    f.run("g.json -o h.exr").fails(3, "clamp or principal");
    assert_eq!(f.image("over.exr").color, f.image("same.exr").color);
    assert_ne!(f.image("over.exr").color, f.image("surface.exr").color);
    f.run("convert flat.ply -o splats.ply").code(0);
    assert_eq!(f.run("info splats.ply --json").code(0).json()["splats"], 4);
}

#[test]
fn info_counts_all_gaussians_and_says_their_degree() {
    let f = Folder::new("faint");
    // The first Gaussian is so faint that it isn't part of a surface.
    let text = gaussians(Some("-2")).replacen(" 0 -1.2", " -5 -1.2", 1);
    f.write("faint.ply", text);
    let facts = f.run("info faint.ply --json").code(0).json();
    assert_eq!((&facts["kind"], &facts["splats"]), (&json!("Gaussians"), &json!(4)));
    assert_eq!(facts["harmonics_degree"], 1);
    let near = |at: &serde_json::Value, expected: [f64; 3]| {
        (0..3).all(|k| (at[k].as_f64().unwrap() - expected[k]).abs() < 1e-6)
    };
    let [low, high] = [&facts["bounds"][0], &facts["bounds"][1]];
    assert!(near(low, [-0.3, -0.4, -0.2]) && near(high, [0.4, 0.3, 0.3]), "{facts}");
    assert!(!facts["notes"].to_string().contains("ignored"), "{facts}");
    assert!(f.run("info faint.ply").code(0).stdout().contains("4 Gaussians of degree 1"));
    // A smoothing filter may make all of them faint; the image is then blank, which isn't an error.
    let filtered = gaussians(Some("-9")).replace("end_header", "property float filter_3D\nend_header");
    let rows: Vec<String> = filtered
        .lines()
        .map(|l| if l.starts_with(char::is_numeric) || l.starts_with('-') { format!("{l} 0.5") } else { l.to_owned() })
        .collect();
    f.write("filtered.ply", rows.join("\n") + "\n");
    let said = f.run("filtered.ply -o filtered.png --size 8x8").code(0).stderr();
    assert!(said.contains("applied the 3D smoothing filter"), "{said}");
}

#[test]
fn what_cannot_be_drawn_over_is_refused() {
    let f = Folder::new("refused");
    f.write("flat.ply", gaussians(None));
    f.write("ball.ply", ball());
    f.run("flat.ply -o a.png --composite over --shader phong").fails(2, "--shader");
    f.run("flat.ply -o a.png --composite over --crop 0,0,0,1,1,1").fails(2, "--crop");
    f.run("flat.ply -o a.exr --composite over --planes index").fails(2, "--planes");
    f.run("ball.ply -o a.png --composite over").fails(3, "--composite over");
    f.run("flat.ply -o a.png --sort pixel --shader phong").fails(2, "--shader");
    f.run("flat.ply -o a.png --sort pixel --composite surface").fails(2, "--sort");
    f.run("flat.ply -o a.png --sort depth").fails(2, "pixel");
    f.run("ball.ply -o a.png --sort pixel").fails(3, "--sort");
    f.run("flat.ply -o a.png --composite over --filter ewa").fails(2, "--filter");
    f.run("flat.ply -o a.png --composite over --prefilter 1").fails(2, "--prefilter");
    f.write("s.json", scene(""));
    f.write("a.ply", gaussians(None));
    f.run("s.json -o a.png --sort pixel").fails(3, "--sort");
    f.run("flat.ply ball.ply -o a.png --composite over").fails(3, "surfaces");
    f.run("ball.ply -o a.exr --planes alpha").fails(3, "--composite over");
    f.run("flat.ply -o a.png --composite under").fails(2, "surface");
    f.write("nan.ply", gaussians(None).replace("0.4 0 0.3", "nan 0 0.3"));
    f.run("nan.ply -o a.png").fails(3, "splat 1");
    let repaired = f.run("nan.ply -o a.png --size 40x30 --repair").code(0);
    assert!(repaired.stderr().contains("dropped 1"), "{}", repaired.stderr());
    f.write(
        "none.ply",
        gaussians(None).replace("vertex 4", "vertex 0").split_inclusive("end_header\n").next().unwrap(),
    );
    f.run("none.ply -o b.png").fails(3, "no Gaussian");
    assert!(!f.has("b.png"));
}

#[test]
fn what_is_too_near_to_be_drawn_is_said() {
    let f = Folder::new("near");
    let small = |text: String| {
        let small = |line: &str| {
            let mut words: Vec<String> = line.split(' ').map(Into::into).collect();
            words[..3].iter_mut().for_each(|v| *v = (0.01 * v.parse::<f64>().unwrap()).to_string());
            words.join(" ") + "\n"
        };
        let (head, rows) = text.split_once("end_header\n").unwrap();
        format!("{head}end_header\n{}", rows.lines().map(small).collect::<String>()).replace("-1.2 -1.6", "-6 -6")
    };
    f.write("small.ply", small(gaussians(None)));
    f.write("flat.ply", gaussians(None));
    let run = f.run("small.ply -o a.png --size 40x30").code(0);
    assert!(run.stderr().contains("4 of 4") && run.stderr().contains("--ortho"), "{}", run.stderr());
    for words in ["small.ply --ortho", "flat.ply", "small.ply --composite surface"] {
        let run = f.run(&format!("{words} -o b.png --size 40x30 --force")).code(0);
        assert!(!run.stderr().contains("nearer"), "{words}: {}", run.stderr());
    }
}

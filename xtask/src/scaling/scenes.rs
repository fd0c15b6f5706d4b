//! Shapes of scenes: many objects, lights, layers and clips, and many cameras and files.

use super::Shape;
use super::documents::words;
use super::points::random;
use std::fmt::Write;
use std::io;
use std::path::Path;

/// Writes a text splat file of disks that face +z and have the opacity `alpha`; `place` returns their centres.
fn disks(path: &Path, n: usize, alpha: f64, place: impl Fn(usize) -> [f64; 3]) -> io::Result<()> {
    let mut text = format!("ply\nformat ascii 1.0\nelement vertex {n}\n");
    for name in ["x", "y", "z", "nx", "ny", "nz", "radius", "alpha"] {
        let _ = writeln!(text, "property float {name}");
    }
    text.push_str("end_header\n");
    for i in 0..n {
        let [x, y, z] = place(i);
        let _ = writeln!(text, "{x} {y} {z} 0 0 1 0.5 {alpha}");
    }
    std::fs::write(path, text)
}

const CAMERA: &str = r#""camera": {"eye": [0, 0, 5], "target": [0, 0, 0], "up": [0, 1, 0],
    "projection": {"perspective": {"fov_y_deg": 40}}, "near": 0.1, "size": [32, 32]}"#;

fn scene(folder: &Path, parts: &str) -> io::Result<Vec<String>> {
    std::fs::write(folder.join("scene.json"), format!("{{{CAMERA}, {parts}}}"))?;
    Ok(words("render scene.json -o out.png --force --backend cpu"))
}

/// Writes a scene of splats one behind another, which all cover the same pixels.
fn stack(folder: &Path, n: usize, settings: &str, alpha: f64) -> io::Result<Vec<String>> {
    disks(&folder.join("a.ply"), n, alpha, |i| [0.0, 0.0, -(i as f64) * 5e-4])?;
    scene(folder, &format!(r#""objects": [{{"splats": "a.ply"}}], "settings": {settings}"#))
}

fn abuffer(folder: &Path, n: usize) -> io::Result<Vec<String>> {
    stack(folder, n, r#"{"transparency": "abuffer:8", "depth_tolerance": "abs:1e-4"}"#, 0.001)
}

/// Writes a scene of splats whose depths all overlap, so that they are one surface of an A-buffer.
fn abuffer_of_one(folder: &Path, n: usize) -> io::Result<Vec<String>> {
    stack(folder, n, r#"{"transparency": "abuffer:8", "depth_tolerance": "abs:100"}"#, 0.001)
}

fn peel(folder: &Path, n: usize) -> io::Result<Vec<String>> {
    stack(folder, n, r#"{"transparency": "peel:4", "depth_tolerance": "abs:1e-4"}"#, 0.001)
}

fn opaque(folder: &Path, n: usize) -> io::Result<Vec<String>> {
    stack(folder, n, r#"{"depth_tolerance": "abs:1e-4"}"#, 1.0)
}

fn objects(folder: &Path, n: usize, are_apart: bool) -> io::Result<Vec<String>> {
    let name = |i: usize| format!("a{}.ply", if are_apart { i } else { 0 });
    let count = if are_apart { n } else { 1 };
    (0..count).try_for_each(|i| disks(&folder.join(name(i)), 4, 1.0, |k| [k as f64 - 2.0, 0.0, 0.0]))?;
    let all: Vec<String> = (0..n)
        .map(|i| {
            let x = random(i, 1) - 0.5;
            format!(r#"{{"splats": "{}", "matrix": [1,0,0,0, 0,1,0,0, 0,0,1,0, {x},0,0,1]}}"#, name(i))
        })
        .collect();
    scene(folder, &format!(r#""objects": [{}]"#, all.join(",")))
}

fn lights(folder: &Path, n: usize, has_shadows: bool) -> io::Result<Vec<String>> {
    disks(&folder.join("a.ply"), 2000, 1.0, |i| [random(i, 1) - 0.5, random(i, 2) - 0.5, random(i, 3) - 0.5])?;
    let all: Vec<String> = (0..n)
        .map(|i| {
            let [x, y] = [1, 2].map(|salt| random(i, salt) - 0.5);
            let color = "[0.01, 0.01, 0.01]";
            format!(r#"{{"directional": {{"direction": [{x}, {y}, -1], "color": {color}, "shadow": {has_shadows}}}}}"#)
        })
        .collect();
    scene(
        folder,
        &format!(
            r#""lights": [{}], "objects": [{{"splats": "a.ply"}}], "settings": {{"shader": "phong"}}"#,
            all.join(",")
        ),
    )
}

/// Writes a scene of opaque splats in front of a light with a shadow map.
fn shadow_casters(folder: &Path, n: usize) -> io::Result<Vec<String>> {
    disks(&folder.join("a.ply"), n, 1.0, |i| [0.0, 0.0, -0.01 * i as f64])?;
    scene(
        folder,
        r#""lights": [{"directional": {"direction": [0.1, 0, -1], "color": [1, 1, 1], "shadow": true}}],
           "objects": [{"splats": "a.ply"}], "settings": {"shader": "phong"}"#,
    )
}

/// Writes a scene of ellipses in one place, each clipped by a curve and four lines.
fn clips(folder: &Path, n: usize) -> io::Result<Vec<String>> {
    let lines = (0..4).flat_map(|k| ["a", "b", "c"].map(|name| format!("clip_line{k}_{name}")));
    let names = "x y z su sv sw tu tv tw clip_theta1 clip_theta3 clip_u clip_v clip_w".split(' ').map(str::to_owned);
    let mut text = format!("ply\nformat ascii 1.0\nelement vertex {n}\n");
    names.chain(lines).for_each(|name| _ = writeln!(text, "property float {name}"));
    text.push_str("end_header\n");
    for i in 0..n {
        let z = -0.001 * random(i, 4);
        let _ = write!(text, "0 0 {z} 1 0 0 0 1 0 -2.5 0.5 0.1 0.2 0.7");
        let _ = writeln!(text, " 1 0 0.5 -1 0 0.6 0 1 0.7 0 -1 0.8");
    }
    std::fs::write(folder.join("a.ply"), text)?;
    scene(folder, r#""objects": [{"splats": "a.ply"}]"#)
}

/// Writes trained Gaussians in one place, which are blended one over another.
fn gaussians(folder: &Path, n: usize, sort: &str) -> io::Result<Vec<String>> {
    let names = "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";
    let mut text = format!("ply\nformat ascii 1.0\nelement vertex {n}\n");
    names.split(' ').for_each(|name| _ = writeln!(text, "property float {name}"));
    text.push_str("end_header\n");
    for i in 0..n {
        let _ = writeln!(text, "0 0 {} 0.5 0.5 0.5 -6 -1 -1 -1 1 0 0 0", 2.0 * random(i, 4) - 1.0);
    }
    std::fs::write(folder.join("a.ply"), text)?;
    scene(
        folder,
        &format!(r#""objects": [{{"splats": "a.ply"}}], "settings": {{"composite": "over", "sort": "{sort}"}}"#),
    )
}

/// Writes `n` cameras in the format of NeRF's `transforms.json`, for an image each.
fn cameras(folder: &Path, n: usize) -> io::Result<Vec<String>> {
    disks(&folder.join("a.ply"), 4, 1.0, |k| [k as f64 - 2.0, 0.0, 0.0])?;
    let frames: Vec<String> = (0..n)
        .map(|i| {
            format!(r#"{{"file_path": "i{i}.png", "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,5],[0,0,0,1]]}}"#)
        })
        .collect();
    let json =
        format!(r#"{{"fl_x": 8, "fl_y": 8, "cx": 4, "cy": 4, "w": 8, "h": 8, "frames": [{}]}}"#, frames.join(","));
    std::fs::write(folder.join("transforms.json"), json)?;
    std::fs::create_dir(folder.join("out"))?;
    Ok(words("render a.ply --cameras transforms.json -o out/{name}.png --force --backend cpu"))
}

/// Writes `n` input files for one image.
fn inputs(folder: &Path, n: usize) -> io::Result<Vec<String>> {
    (0..n).try_for_each(|i| disks(&folder.join(format!("a{i}.ply")), 4, 1.0, |k| [k as f64 - 2.0, i as f64, 0.0]))?;
    let mut command = vec!["render".to_owned()];
    command.extend((0..n).map(|i| format!("a{i}.ply")));
    command.extend(words("-o out.png --force --size 32x32 --backend cpu"));
    Ok(command)
}

/// Writes a configuration file of one key and `n` lines of comments.
fn configuration(folder: &Path, n: usize) -> io::Result<Vec<String>> {
    disks(&folder.join("a.ply"), 4, 1.0, |k| [k as f64 - 2.0, 0.0, 0.0])?;
    let comments: String = (0..n).map(|i| format!("# line {i}\n")).collect();
    std::fs::write(folder.join("flags.toml"), comments + "size = \"8x8\"\n")?;
    Ok(words("render a.ply -o out.png --force --backend cpu --config flags.toml"))
}

fn jobs(folder: &Path, n: usize) -> io::Result<Vec<String>> {
    disks(&folder.join("a.ply"), 4, 1.0, |k| [k as f64 - 2.0, 0.0, 0.0])?;
    let mut command = words("jobs --cuecmd a.ply -o {frame}.png");
    command.extend([format!("--frames={n}"), format!("--tasks={n}")]);
    Ok(command)
}

pub(super) fn shapes() -> Vec<Shape> {
    type Command = fn(&Path, usize) -> io::Result<Vec<String>>;
    let all: [(&str, usize, &str, Command); 18] = [
        ("A-buffer of many surfaces", 4000, "surfaces", abuffer),
        ("A-buffer of one thick surface", 4000, "splats", abuffer_of_one),
        ("peeling many surfaces", 4000, "surfaces", peel),
        ("opaque surfaces behind each other", 20_000, "surfaces", opaque),
        ("scene of many objects of one file", 1000, "objects", |folder, n| objects(folder, n, false)),
        ("scene of many files", 500, "files", |folder, n| objects(folder, n, true)),
        ("scene of many lights", 500, "lights", |folder, n| lights(folder, n, false)),
        ("scene of many shadow maps", 4, "lights", |folder, n| lights(folder, n, true)),
        ("shadow map of many casters", 20_000, "splats", shadow_casters),
        ("clip curves in one place", 5000, "splats", clips),
        ("Gaussians in one place, by centre", 5000, "Gaussians", |folder, n| gaussians(folder, n, "center")),
        ("Gaussians in one place, by pixel", 2000, "Gaussians", |folder, n| gaussians(folder, n, "pixel")),
        ("many cameras", 250, "images", cameras),
        ("many inputs", 250, "files", inputs),
        ("configuration of many lines", 50_000, "lines", configuration),
        ("job of many tasks", 5000, "tasks", jobs),
        ("scene of comments and keys", 2000, "objects", many_keys),
        ("glass in one place", 2000, "splats", glass),
    ];
    all.into_iter().map(|(name, n, counts, make)| Shape::new(name, (n, counts), make)).collect()
}

/// Writes a scene of `n` objects, each with conversion options.
fn many_keys(folder: &Path, n: usize) -> io::Result<Vec<String>> {
    disks(&folder.join("a.ply"), 4, 1.0, |k| [k as f64 - 2.0, 0.0, 0.0])?;
    let all: Vec<String> = (0..n)
        .map(|i| format!(r#"{{"splats": "a.ply", "convert": {{"color_by": "height", "range": [0, {}]}}}}"#, 1 + i % 5))
        .collect();
    scene(folder, &format!(r#""objects": [{}]"#, all.join(",")))
}

/// Writes a scene of `n` transparent splats at random positions, drawn with an A-buffer.
fn glass(folder: &Path, n: usize) -> io::Result<Vec<String>> {
    disks(&folder.join("a.ply"), n, 0.5, |i| [random(i, 1) - 0.5, random(i, 2) - 0.5, -4.0 * random(i, 3)])?;
    scene(folder, r#""objects": [{"splats": "a.ply"}], "settings": {"transparency": "abuffer:8"}"#)
}

//! Regression tests for changes that must not change behaviour. They compare exit code, messages, scene and pixels for
//! every kind of bare file and for every command.
//!
//! `expected.txt` holds what the program printed. `SURFEL_NET=write cargo test -p surfel-cli --test tests net` records
//! it anew; `git diff` then shows what changed, and the commit says why.

mod inputs;

use crate::common::Folder;
use std::fmt::Write as _;
use std::path::Path;

/// Command lines that are run after the bare files, in this order: later ones read what earlier ones wrote.
const COMMANDS: &[&str] = &[
    "info tile.las",
    "info --json mesh.ply",
    "info --json gaussians.ply",
    "info colors.txt",
    "convert bare.xyz -o splats.ply",
    "convert bare.xyz -o - --ascii",
    "convert hill.obj -o mesh-splats.ply --splats 200",
    "convert cube.obj -o sharp.ply --sharp --splats 100",
    "convert hill.obj -o octree.surfel --hybrid",
    "convert tile.las -o tile.copc.laz",
    "convert colors.txt -o fit.ply --colors fit",
    "render splats.ply -o default.png --size 48x36",
    "render octree.surfel -o octree.png --size 48x36",
    "render tile.copc.laz -o copc.png --size 48x36 --color-by classification",
    "render tile.las -o height.png --size 48x36 --color-by height --colorbar --colormap viridis",
    "render mesh.ply -o temperature.png --size 48x36 --color-by temperature",
    "render labels.txt -o labels.exr --size 48x36 --planes depth,normal,index,label --label label",
    "render ball.ply -o phong.png --size 48x36 --shader phong --shadows --edge-aa=samples",
    "render ball.ply -o toon.png --size 48x36 --shader toon --edge-aa=on",
    "render ball.ply -o edl.png --size 48x36 --shader edl --filter ewa --background 1,1,1,1",
    "render ball.ply -o fast.png --size 48x36 --preset fast",
    "render ball.ply -o quality.png --size 48x36 --preset quality",
    "render ball.ply -o top.png --size 48x36 --view top --ortho",
    "render ball.ply -o eye.png --size 48x36 --eye 3,3,3 --target 0,0,0 --fov-y 40",
    "render ball.ply -o region.png --size 48x36 --region 8,8,16,12",
    "render gaussians.ply -o surface.png --size 48x36 --composite surface",
    "render gaussians.ply -o sorted.png --size 48x36 --sort pixel",
    "render dense.xyz -o reference.png --size 32x24 --backend reference",
    "render ball.ply hill.obj -o two.png --size 48x36 --print-scene",
    "render ball.ply -o turn.png --frames 3 --turntable --size 24x18",
    "render ball.ply -o turn-{frame}.png --frames 3 --turntable --size 24x18",
    "render raw.bin -o raw.png --size 48x36 --columns f4:x,y,z",
    "again default.png -o again.png",
    "compare phong.png toon.png",
    "compare default.png again.png",
    "ortho tile.las -o ortho.tif --gsd 0.2",
    "ortho tile.las --dsm dsm.tif --gsd 0.2",
    "ortho hill.obj -o hill.tif --gsd 0.2",
    "jobs --slurm a.json -o frames/{frame}.png --frames 4",
    "stitch default.png -o stitched.png",
    "view missing.ply",
    "--version",
    "help",
    "render --help",
    "convert --help",
    "ortho --help",
    "completions bash",
    "man",
    "render",
    "render missing.ply -o missing.png",
    "render ball.ply -o out.bmp",
    "render ball.ply -o default.png",
    "render ball.ply -o x.png --size 0x5",
    "render ball.ply -o x.png --shader none",
    "render ball.ply -o x.png --sise 48x36",
    "convert ball.ply -o x.obj",
    "info missing.ply",
    "compare default.png missing.png",
    "nonsense",
];

/// Returns the 64-bit FNV-1a hash of bytes.
fn hash(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3))
}

/// Describes an image in lines appended to `text`. Each plane gets a line with the image's size and the plane's hash,
/// and each metadata entry other than the version gets a line. Planes of whole numbers are omitted. If the image can't
/// be read, appends the error.
fn put_image(text: &mut String, path: &Path) {
    let image = match surfel_io::read_image(path) {
        Ok(image) => image,
        Err(error) => {
            let _ = writeln!(text, "  not read: {error}");
            return;
        }
    };
    let mut put = |name: &str, numbers: Vec<f32>| {
        let bytes: Vec<u8> = numbers.iter().flat_map(|v| v.to_bits().to_le_bytes()).collect();
        let _ = writeln!(text, "  {name} {}x{} {:016x}", image.width, image.height, hash(&bytes));
    };
    image.color.iter().for_each(|plane| put("color", plane.as_flattened().to_vec()));
    image.normal.iter().for_each(|plane| put("normal", plane.as_flattened().to_vec()));
    image.depth.iter().for_each(|plane| put("depth", plane.clone()));
    image.weight.iter().for_each(|plane| put("weight", plane.clone()));
    image.other.iter().for_each(|(name, plane)| put(name, plane.clone()));
    for (key, value) in image.metadata.iter().filter(|(key, _)| *key != "surfel:version") {
        let _ = writeln!(text, "  {key} {value}");
    }
}

/// Runs a command, and appends its exit code, what it printed, and the content of the files that it created to `text`.
/// Notes on the choice of a backend are omitted, and long or binary content is replaced by a hash.
fn put_run(text: &mut String, folder: &Folder, command: &str) {
    let before = folder.names();
    let (code, out, err) = folder.run(command).parts();
    let _ = writeln!(text, "\n$ surfel {command}\n  exit {code}");
    let shown = |line: &str| line.replace(&folder.path().display().to_string(), "FOLDER");
    // Other machines may have GPUs, and say so.
    let lines = err.lines().filter(|line| !line.starts_with("note: drawing with "));
    for line in lines {
        let _ = writeln!(text, "  | {}", shown(line));
    }
    match std::str::from_utf8(&out) {
        Ok(lines) if out.len() < 4000 => text.extend(lines.lines().map(|line| format!("  > {}\n", shown(line)))),
        _ => text.push_str(&format!("  > {} bytes {:016x}\n", out.len(), hash(&out))),
    }
    for name in folder.names().iter().filter(|name| !before.contains(name)) {
        let path = folder.path().join(name);
        let _ = writeln!(text, "  wrote {name}");
        if name.ends_with(".png") || name.ends_with(".exr") {
            put_image(text, &path);
        } else if path.is_file() {
            let bytes = folder.read(name);
            let _ = writeln!(text, "  {} bytes {:016x}", bytes.len(), hash(&bytes));
        }
    }
}

#[test]
fn behaviour_of_every_kind_of_file_and_of_every_command_is_as_recorded() {
    if !cfg!(all(feature = "wgpu", feature = "ash")) {
        println!("skipped: help was recorded of the program with the features wgpu and ash");
        return;
    }
    let folder = Folder::new("net");
    let mut text = String::new();
    let inputs = inputs::all();
    inputs.iter().for_each(|(name, bytes)| folder.write(name, bytes));
    for (name, _) in &inputs {
        put_run(&mut text, &folder, &format!("{name} -o {name}.png --size 48x36 --backend cpu"));
    }
    for command in COMMANDS {
        // Other machines may have GPUs.
        let draws = command.starts_with("render ") && command.contains(" -o ") && !command.contains("--backend");
        put_run(&mut text, &folder, &format!("{command}{}", if draws { " --backend cpu" } else { "" }));
    }
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/net/expected.txt");
    if std::env::var_os("SURFEL_NET").is_some_and(|value| value == "write") {
        std::fs::write(&path, &text).unwrap();
        return;
    }
    let expected = std::fs::read_to_string(&path).unwrap();
    let runs = |text: &str| text.split("\n$ ").map(str::to_owned).collect::<Vec<String>>();
    let (expected, found) = (runs(&expected), runs(&text));
    let differ: Vec<String> =
        expected.iter().zip(&found).filter(|(a, b)| a != b).map(|(a, b)| format!("was:\n$ {a}\nis:\n$ {b}")).collect();
    assert!(
        differ.is_empty() && expected.len() == found.len(),
        "{} of {} runs differ; SURFEL_NET=write records them anew if that is meant\n{}",
        differ.len(),
        found.len(),
        differ.join("\n")
    );
}

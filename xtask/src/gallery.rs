//! `cargo xtask gallery`: draws the images of docs/gallery.md, and of models that the repository may not contain.

use std::path::Path;
use std::process::Command;

use crate::{assets, cargo};

/// Conversions that make the input files of images.
const CONVERSIONS: &[&[&str]] =
    &[&["convert", "assets/generated/part.obj", "-o", "assets/generated/part-sharp.ply", "--sharp", "--splats", "960"]];

/// Images: name, and arguments of the program.
const IMAGES: &[(&str, &[&str])] = &[
    ("glass", &["assets/gallery/glass.json"]),
    ("half-spot", &["assets/gallery/half-spot.json"]),
    ("half-spot-parts", &["assets/gallery/half-spot.json", "--shader", "normal"]),
    ("shadows", &["assets/gallery/shadows.json"]),
    ("toon", &["assets/gallery/toon.json"]),
    ("matcap", &["assets/gallery/matcap.json"]),
    ("matcap-clay", &["assets/gallery/matcap.json", "--matcap", "builtin"]),
    ("scan-phong", &["assets/gallery/scan.json", "--shader", "phong"]),
    ("scan-edl", &["assets/gallery/scan.json"]),
    ("silhouette-plain", &["assets/gallery/silhouette.json", "--edge-aa=off"]),
    ("silhouette", &["assets/gallery/silhouette.json"]),
    ("texture", &["assets/gallery/texture.json"]),
    ("sharp-part-whole", &["assets/gallery/sharp-part.json", "--clip", "off"]),
    ("sharp-part", &["assets/gallery/sharp-part.json"]),
];

/// The same for images of [`GENERATED`] inputs.
const LIT: &[(&str, &[&str])] = &[(
    "figure-studio",
    &[
        "assets/generated/spot-scan.xyz",
        "--light",
        "studio",
        "--ground",
        "shadow",
        "--bounce",
        "--color",
        "#c8b8a0",
        "--background",
        "white",
        "--edge-aa=samples",
        "--size",
        "480x360",
    ],
)];

/// Folder of generated inputs of figures.
const GENERATED: &str = "assets/generated";

/// Figures of docs/figures.md: name of the image, files in [`GENERATED`], and flags.
const FIGURES: &[(&str, &[&str], &str)] = &[
    (
        "figure-completion",
        &["chair-truth.xyz", "chair-partial.xyz", "chair-coarse.xyz", "chair-fine.xyz"],
        "--titles Ground_truth,Input,Coarse,Fine --view 40,25 --error-row --unit m --size 3x4 --width 900",
    ),
    (
        "figure-subjects",
        &[
            "chair-truth.xyz",
            "chair-coarse.xyz",
            "chair-fine.xyz",
            "table-truth.xyz",
            "table-coarse.xyz",
            "table-fine.xyz",
        ],
        "--subjects 2 --titles Ground_truth,Coarse,Fine --row-titles Chair,Table --view 40,25 --color steelblue \
         --width 640",
    ),
    (
        "figure-mesh",
        &["../spot/spot.obj", "spot-scan.xyz"],
        "--titles Model,Scan --view 150,15 --error-row=inferno --color #c8b8a0 --width 640",
    ),
    (
        "figure-classes",
        &["village.txt"],
        "--classes !7 --color-by classification --value-title class --annotate scale,north --unit m --view top --ortho \
         --width 800",
    ),
    (
        "figure-height",
        &["spot-scan.xyz"],
        "--color-by height --colormap plasma --value-title height_[dm] --annotate scale,axes --unit dm --view 150,15 \
         --text-at 0.42,0.75,-0.35=ear --text-at 0,0.2,0.65=back --width 560",
    ),
    (
        "figure-soft",
        &["chair-truth.xyz", "chair-partial.xyz", "chair-fine.xyz"],
        "--titles Ground_truth,Input,Completed --view 40,25 --light studio --bounce --ground shadow --color steelblue \
         --width 640",
    ),
];

/// Number of scans of the film of docs/films.md.
const SWINGS: usize = 24;

/// Images of models that the repository may not contain: name of the scene in assets/gallery/models, and file of the
/// model.
const MODELS: &[(&str, &str)] = &[("lion", "lion_takanawa.ply"), ("igea", "igea.ply")];

/// Placeholder for the models' folder in their scenes.
const PLACEHOLDER: &str = "MODELS/";

/// Output folder of the models' images, relative to the workspace: among build results, outside of the tree.
const MODEL_IMAGES: &str = "target/gallery";

/// Draws every image of docs/gallery.md, the figures of docs/figures.md and the film of docs/films.md.
pub(crate) fn run(root: &Path) -> bool {
    let image = |(name, arguments): &(&str, &[&str])| draw(root, arguments, &format!("docs/images/{name}.png"));
    assets::run(root)
        && CONVERSIONS.iter().all(|arguments| surfel(root, &[arguments, &["--force"][..]].concat()))
        && IMAGES.iter().chain(LIT).all(image)
        && village(root)
        && FIGURES.iter().all(|figure| draw_figure(root, figure))
        && film(root)
}

/// Draws the images of the models in a folder, which is relative to the current folder.
pub(crate) fn run_models(root: &Path, folder: &str) -> bool {
    let result = std::env::current_dir().and_then(|here| {
        std::fs::create_dir_all(root.join(MODEL_IMAGES))?;
        let folder = here.join(folder);
        let mut found = 0;
        for (name, file) in MODELS {
            if !folder.join(file).is_file() {
                println!("skipped: {} isn't there", folder.join(file).display());
                continue;
            }
            found += 1;
            let template = std::fs::read_to_string(root.join(format!("assets/gallery/models/{name}.json")))?;
            let scene = format!("{MODEL_IMAGES}/{name}.json");
            std::fs::write(root.join(&scene), in_folder(&template, &folder))?;
            if !draw(root, &[&scene], &format!("{MODEL_IMAGES}/{name}.png")) {
                return Ok(false);
            }
        }
        Ok(found > 0)
    });
    result.unwrap_or_else(|error| {
        eprintln!("error: could not write to {MODEL_IMAGES}: {error}");
        false
    })
}

/// Returns a scene with the placeholder replaced by this folder.
fn in_folder(template: &str, folder: &Path) -> String {
    let escaped = folder.display().to_string().replace('\\', "\\\\").replace('"', "\\\"");
    template.replace(PLACEHOLDER, &format!("{escaped}/"))
}

/// Draws an image by the CPU backend, which supports all of them and gives the same bits on any machine.
fn draw(root: &Path, arguments: &[&str], file: &str) -> bool {
    println!("{file}");
    surfel(root, &[arguments, &["-o", file, "--force", "--backend", "cpu"][..]].concat())
}

/// Writes the village of the figures, which a script of Python's standard library generates.
fn village(root: &Path) -> bool {
    let output = Command::new("python3").current_dir(root).arg("assets/tutorial/village.py").output();
    let written = output.and_then(|output| {
        if !output.status.success() {
            return Err(std::io::Error::other(String::from_utf8_lossy(&output.stderr).into_owned()));
        }
        std::fs::write(root.join(GENERATED).join("village.txt"), output.stdout)
    });
    if let Err(error) = &written {
        eprintln!("error: could not write {GENERATED}/village.txt by python3 assets/tutorial/village.py: {error}");
    }
    written.is_ok()
}

/// Draws the film of scans that a script of Python's standard library generates.
fn film(root: &Path) -> bool {
    let script = ["assets/tutorial/swing.py", GENERATED];
    let written = Command::new("python3").current_dir(root).args(script).status();
    if !written.is_ok_and(|status| status.success()) {
        eprintln!("error: could not run python3 {}", script.join(" "));
        return false;
    }
    let scans: Vec<String> = (0..SWINGS).map(|i| format!("{GENERATED}/swing-{i:02}.csv")).collect();
    let scans: Vec<&str> = scans.iter().map(String::as_str).collect();
    let flags = "--sequence --color-by speed --up +z --view 25,25 --size 320x200 --fps 12";
    let words = [&["render"], &scans[..], &flags.split(' ').collect::<Vec<_>>()].concat();
    draw(root, &words, "docs/images/film-sequence.gif")
}

/// Draws a figure of files in the folder of generated inputs. An underscore in its flags is a space.
fn draw_figure(root: &Path, (name, files, flags): &(&str, &[&str], &str)) -> bool {
    let file = format!("docs/images/{name}.png");
    println!("{file}");
    let inputs = files.iter().map(|name| format!("{GENERATED}/{name}"));
    let flags = flags.split(' ').map(|flag| flag.replace('_', " "));
    let words: Vec<String> = std::iter::once("figure".to_owned()).chain(inputs).chain(flags).collect();
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    surfel(root, &[&words, &["-o", &file, "--force", "--backend", "cpu"][..]].concat())
}

/// Runs the program, built for release.
fn surfel(root: &Path, arguments: &[&str]) -> bool {
    let mut command = cargo(root);
    command.args(["run", "--quiet", "--release", "--locked", "--package", "surfel-cli", "--"]).args(arguments);
    match command.status() {
        Ok(status) => status.success(),
        Err(error) => {
            eprintln!("error: could not run {}: {error}", command.get_program().display());
            false
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gallery_scenes_of_models_name_them_in_the_folder_that_is_given() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
        for (name, file) in MODELS {
            let template = std::fs::read_to_string(root.join(format!("assets/gallery/models/{name}.json"))).unwrap();
            let scene = in_folder(&template, Path::new("/some \"folder\""));
            assert!(scene.contains(&format!("/some \\\"folder\\\"/{file}\"")), "{scene}");
            assert!(!scene.contains(PLACEHOLDER));
        }
    }
}

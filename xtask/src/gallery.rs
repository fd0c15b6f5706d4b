//! `cargo xtask gallery`: draws the images of docs/gallery.md and docs/figures.md, and of models that the repository
//! may not contain.

use std::path::Path;
use std::process::Command;

use crate::{assets, cargo};

/// Arguments of the conversions that make input files for images.
const CONVERSIONS: &[&[&str]] =
    &[&["convert", "assets/generated/part.obj", "-o", "assets/generated/part-sharp.ply", "--sharp", "--splats", "960"]];

/// Images: the file name without extension, and arguments of the program.
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

/// Folder of generated inputs of figures.
const GENERATED: &str = "assets/generated";

/// Page whose images are drawn by the commands on it.
const PAGE: &str = "docs/figures.md";
/// Width of the page's figures in pixels, which replaces the width in their commands.
const FIGURE_WIDTH: &str = "720";
/// Size of the page's other images in pixels, which replaces the size in their commands.
const IMAGE_SIZE: &str = "640x480";

/// Number of scans in the film of docs/films.md.
const SWINGS: usize = 24;

/// Images of models that the repository may not contain: the scene's name in assets/gallery/models, and the model's
/// file.
const MODELS: &[(&str, &str)] = &[("lion", "lion_takanawa.ply"), ("igea", "igea.ply")];

/// Placeholder for the path of the models' folder, in the scene files of [`MODELS`].
const PLACEHOLDER: &str = "MODELS/";

/// Output folder of the models' images, relative to the workspace. It is in the build folder, which git ignores.
const MODEL_IMAGES: &str = "target/gallery";

/// Draws every image of docs/gallery.md, the figures of docs/figures.md and the film of docs/films.md.
pub(crate) fn run(root: &Path) -> bool {
    let image = |(name, arguments): &(&str, &[&str])| draw(root, arguments, &format!("docs/images/{name}.png"));
    assets::run(root)
        && CONVERSIONS.iter().all(|arguments| surfel(root, &[arguments, &["--force"][..]].concat()))
        && IMAGES.iter().all(image)
        && village(root)
        && page(root)
        && film(root)
}

/// Draws the images of the models in `folder`, which is relative to the current folder. True if at least one image was
/// drawn, and none failed.
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

/// Returns the text of a scene in which the placeholder is replaced by a folder.
fn in_folder(template: &str, folder: &Path) -> String {
    let escaped = folder.display().to_string().replace('\\', "\\\\").replace('"', "\\\"");
    template.replace(PLACEHOLDER, &format!("{escaped}/"))
}

/// Draws an image with the CPU backend, which supports all images and gives the same bits on every machine.
fn draw(root: &Path, arguments: &[&str], file: &str) -> bool {
    println!("{file}");
    surfel(root, &[arguments, &["-o", file, "--force", "--backend", "cpu"][..]].concat())
}

/// Generates the village of the figures with a Python script.
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

/// Draws the film of scans, which a Python script generates.
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

/// Draws the images of the page [`PAGE`] by the commands on it.
fn page(root: &Path) -> bool {
    let text = match std::fs::read_to_string(root.join(PAGE)) {
        Ok(text) => text,
        Err(error) => {
            eprintln!("error: could not read {PAGE}: {error}");
            return false;
        }
    };
    commands(&text).iter().all(|(image, words)| {
        let words: Vec<&str> = words.iter().map(String::as_str).collect();
        draw(root, &words, &format!("docs/images/{image}.png"))
    })
}

/// Returns the first image after each command of the program on a page. Each has its name, and the words of its command
/// with the page's image size and without an output file.
fn commands(page: &str) -> Vec<(String, Vec<String>)> {
    let (mut command, mut is_command, mut found) = (String::new(), false, Vec::new());
    for line in page.lines() {
        if let Some(language) = line.strip_prefix("```") {
            is_command = language == "sh";
            if is_command {
                command.clear();
            }
        } else if is_command {
            command += line.strip_suffix('\\').unwrap_or(line);
            command.push(' ');
        } else if let Some((_, rest)) = line.split_once("](images/").filter(|(text, _)| text.starts_with("![")) {
            let name = rest.strip_suffix(".png)").unwrap_or(rest);
            if let Some(words) = std::mem::take(&mut command).strip_prefix("surfel ") {
                found.push((name.to_owned(), sized(&split(words))));
            }
        }
    }
    found
}

/// Splits a shell command into words, of which some are in single quotes.
fn split(text: &str) -> Vec<String> {
    let (mut words, mut word, mut is_quoted) = (Vec::new(), String::new(), false);
    for letter in text.chars() {
        match letter {
            '\'' => is_quoted = !is_quoted,
            ' ' if !is_quoted => words.extend(Some(std::mem::take(&mut word)).filter(|word| !word.is_empty())),
            _ => word.push(letter),
        }
    }
    words.extend(Some(word).filter(|word| !word.is_empty()));
    words.iter().flat_map(|word| expanded(word)).collect()
}

/// Expands a list in braces in a word, as shells do.
fn expanded(word: &str) -> Vec<String> {
    let Some((before, (list, after))) = word.split_once('{').and_then(|(a, b)| Some((a, b.split_once('}')?))) else {
        return vec![word.to_owned()];
    };
    let rest = expanded(after);
    list.split(',').flat_map(|item| rest.iter().map(move |after| format!("{before}{item}{after}"))).collect()
}

/// Returns the words of a command without its output file, and with the size [`IMAGE_SIZE`]. For figures, the width is
/// [`FIGURE_WIDTH`] instead, and `--dpi` is left out.
fn sized(words: &[String]) -> Vec<String> {
    let is_figure = words.first().is_some_and(|word| word == "figure");
    // The size of a figure's panel determines the proportions of the figure, so it isn't replaced.
    let replaced: &[&str] = if is_figure { &["-o", "--width", "--dpi"] } else { &["-o", "--size"] };
    let mut all = Vec::new();
    let mut words = words.iter();
    while let Some(word) = words.next() {
        if replaced.contains(&word.as_str()) {
            words.next();
        } else {
            all.push(word.clone());
        }
    }
    let size = if is_figure { ["--width", FIGURE_WIDTH] } else { ["--size", IMAGE_SIZE] };
    all.extend(size.map(str::to_owned));
    all
}

/// Runs the program `surfel`, built for release.
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
    fn commands_of_a_page_are_those_above_its_images() {
        let page = "```sh\nsurfel figure a.ply \\\n 'b c.ply' --width 85mm -o x.pdf\n```\n\n![Two](images/two.png)\n\n\
                    ![Other](images/other.png)\n```sh\nsurfel a.ply --size 9x9 -o a.png\n```\n![One](images/one.png)\n";
        let found = commands(page);
        let names: Vec<&str> = found.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names, ["two", "one"]);
        assert_eq!(found[0].1, ["figure", "a.ply", "b c.ply", "--width", FIGURE_WIDTH]);
        assert_eq!(found[1].1, ["a.ply", "--size", IMAGE_SIZE]);
        assert_eq!(expanded("{a,b}-{c,d}.x"), ["a-c.x", "a-d.x", "b-c.x", "b-d.x"]);
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
        let own = commands(&std::fs::read_to_string(root.join(PAGE)).unwrap());
        assert_eq!(own.len(), 12, "{own:?}");
    }

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

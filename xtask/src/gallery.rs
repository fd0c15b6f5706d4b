//! `cargo xtask gallery`: the pictures of docs/gallery.md.

use std::path::Path;

use crate::{assets, cargo};

/// Pictures, with what the program is asked for.
const PICTURES: &[(&str, &[&str])] = &[
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
];

pub(crate) fn run(root: &Path) -> bool {
    assets::run(root)
        && PICTURES.iter().all(|(name, arguments)| {
            let file = format!("docs/images/{name}.png");
            println!("{file}");
            let mut command = cargo(root);
            command.args(["run", "--quiet", "--release", "--locked", "--package", "surfel-cli", "--"]);
            // The processor: it draws all of them, and the same bits anywhere.
            command.args(*arguments).args(["-o", &file, "--force", "--backend", "cpu"]);
            match command.status() {
                Ok(status) => status.success(),
                Err(error) => {
                    eprintln!("error: could not run {}: {error}", command.get_program().display());
                    false
                }
            }
        })
}

//! `cargo xtask assets`: generates scenes and writes them to `assets/generated/`.
//!
//! Everything follows from formulas and one fixed seed, so that every machine generates the same files.

mod clouds;
mod completion;
mod halves;
mod part;
mod ply;
mod scan;
mod textured;

use std::io;
use std::path::Path;

/// Output folder, relative to the workspace.
const FOLDER: &str = "assets/generated";

pub(crate) fn run(root: &Path) -> bool {
    let folder = root.join(FOLDER);
    let mut written = Vec::new();
    let result = write(root, &folder, &mut |name, bytes| {
        std::fs::write(folder.join(name), &bytes)?;
        written.push((name.to_owned(), bytes.len()));
        Ok(())
    });
    for (name, bytes) in &written {
        println!("{FOLDER}/{name}: {bytes} bytes");
    }
    match result {
        Ok(()) => true,
        Err(error) => {
            eprintln!("error: could not write to {}: {error}", folder.display());
            false
        }
    }
}

type Sink<'a> = &'a mut dyn FnMut(&str, Vec<u8>) -> io::Result<()>;

fn write(root: &Path, folder: &Path, sink: Sink<'_>) -> io::Result<()> {
    std::fs::create_dir_all(folder)?;
    sink("checkerboard.ply", clouds::checkerboard().to_ply())?;
    sink("checkerboard.json", clouds::CHECKERBOARD_SCENE.into())?;
    sink("sphere.ply", clouds::sphere().to_ply())?;
    sink("glass-spheres.ply", clouds::glass_spheres().to_ply())?;
    sink("part.obj", part::part().to_obj().into_bytes())?;
    sink("spot-scan.xyz", scan::scan(root)?)?;
    completion::files().into_iter().try_for_each(|(name, bytes)| sink(&name, bytes))?;
    sink("checkerboard-60.obj", textured::checkerboard(60))?;
    sink("checkerboard-12.obj", textured::checkerboard(12))?;
    sink("checkerboard-3.obj", textured::checkerboard(3))?;
    sink("photograph.obj", textured::photograph())?;
    let [left, right] = halves::halves(root)?;
    sink("spot-left.obj", left)?;
    sink("spot-right.obj", right)?;
    halves::MATERIALS.into_iter().try_for_each(|name| sink(name, std::fs::read(root.join("assets/spot").join(name))?))
}

//! Test of the front page's program, compiled as a newcomer would: in its own crate, with Cargo's default profiles.

use std::path::Path;
use std::process::Command;

use crate::{cargo, python};

/// Stack size with which the optimised program's threads are tested, in bytes: the smallest default of any operating
/// system.
const MIN_STACK: &str = "524288";

/// Builds and runs the program of README.md, unoptimised and in release mode. Prints failures; returns true if there
/// are none.
pub(crate) fn test(root: &Path) -> bool {
    println!("\n== front page");
    let outcome = written(root).and_then(|folder| {
        ran(root, &folder, &["run", "--quiet"], None)?;
        ran(root, &folder, &["run", "--quiet", "--release"], Some(MIN_STACK))
    });
    match outcome {
        Ok(()) => println!("the program of README.md runs, unoptimised and as a release"),
        Err(ref problem) => println!("error: {problem}"),
    }
    outcome.is_ok()
}

/// Writes a crate with the program, and returns the crate's folder.
fn written(root: &Path) -> Result<std::path::PathBuf, String> {
    let folder = python::target(root).join("front-page");
    let failed = |error: std::io::Error| format!("{}: can't be written: {error}", folder.display());
    let readme = std::fs::read_to_string(root.join("README.md")).map_err(failed)?;
    let program = program_of(&readme).ok_or("README.md has no program under '## As a library'")?;
    let library = root.join("crates").join("surfel");
    let package = crate::tidy::package_name(&library.join("Cargo.toml")).unwrap_or_default();
    let manifest = format!(
        "[package]\nname = \"front-page\"\nversion = \"0.0.0\"\nedition = \"2024\"\n\n[workspace]\n\n\
         [dependencies]\nsurfel = {{ package = {package:?}, path = {:?} }}\n",
        library.display().to_string()
    );
    std::fs::create_dir_all(folder.join("src")).map_err(failed)?;
    std::fs::write(folder.join("Cargo.toml"), manifest).map_err(failed)?;
    std::fs::write(folder.join("src").join("main.rs"), program).map_err(failed)?;
    // With this lock file, the crate uses the versions of the workspace, which are already downloaded.
    std::fs::copy(root.join("Cargo.lock"), folder.join("Cargo.lock")).map_err(failed)?;
    Ok(folder)
}

/// Returns the first program in README.md's section on the library.
pub(crate) fn program_of(readme: &str) -> Option<&str> {
    first_block(readme, "## As a library", "```rust")
}

/// Returns the first program in README.md's section on Python.
pub(crate) fn python_of(readme: &str) -> Option<&str> {
    first_block(readme, "## In Python", "```python")
}

/// Returns the first block of code after a heading. `fence` is the line that begins the block.
fn first_block<'a>(page: &'a str, heading: &str, fence: &str) -> Option<&'a str> {
    let section = page.split_once(heading)?.1;
    let program = section.split_once(fence)?.1.split_once('\n')?.1;
    Some(program.split_once("```")?.0)
}

fn ran(root: &Path, folder: &Path, words: &[&str], stack: Option<&str>) -> Result<(), String> {
    let image = folder.join("out.png");
    let _ = std::fs::remove_file(&image);
    let mut command: Command = cargo(root);
    command.current_dir(folder).args(words).env("CARGO_TARGET_DIR", folder.join("target"));
    if let Some(stack) = stack {
        command.env("RUST_MIN_STACK", stack);
    }
    let status = command.status().map_err(|error| format!("cargo {} can't be run: {error}", words.join(" ")))?;
    match (status.success(), image.is_file()) {
        (true, true) => Ok(()),
        (true, false) => Err(format!("cargo {}: the program wrote no out.png", words.join(" "))),
        (false, _) => Err(format!("cargo {} in {} ended with {status}", words.join(" "), folder.display())),
    }
}

#[cfg(test)]
mod tests {
    use super::{program_of, python_of};

    #[test]
    fn readme_has_programs() {
        let readme = std::fs::read_to_string(crate::workspace_root().join("README.md")).unwrap();
        let program = program_of(&readme).unwrap();
        assert!(program.starts_with("use surfel::") && program.contains("fn main()") && program.ends_with("}\n"));
        let python = python_of(&readme).unwrap();
        assert!(python.starts_with("import surfel\n") && python.contains("surfel.open(\"scan.ply\")"), "{python}");
    }
}

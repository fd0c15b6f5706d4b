//! Puts the WGSL modules together, parses and validates them with naga, and lists their functions. An invalid shader
//! fails the build with naga's own message, which points at the line.

use std::error::Error;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use naga::valid::{Capabilities, ValidationFlags, Validator};

/// What the line before each module starts with.
const MODULE: &str = "// ==== ";

fn main() -> Result<(), Box<dyn Error>> {
    let folder = PathBuf::from(std::env::var("CARGO_MANIFEST_DIR")?).join("wgsl");
    let out = PathBuf::from(std::env::var("OUT_DIR")?);
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=wgsl");
    let text = concatenate(&folder)?;
    std::fs::write(out.join("surfel.wgsl"), &text)?;
    match functions(&text) {
        Ok(list) => Ok(std::fs::write(out.join("functions.rs"), list)?),
        Err(message) => {
            // A build script is heard a line at a time.
            for line in message.lines() {
                println!("cargo::error={line}");
            }
            Err("the shaders are not valid WGSL, see above".into())
        }
    }
}

/// The modules that the manifest names, in its order, each under a line that says where it is from.
fn concatenate(folder: &Path) -> Result<String, Box<dyn Error>> {
    let manifest = std::fs::read_to_string(folder.join("manifest.txt"))?;
    let names = || manifest.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'));
    for entry in std::fs::read_dir(folder)? {
        let name = entry?.file_name();
        let name = name.to_string_lossy();
        if name.ends_with(".wgsl") && !names().any(|listed| listed == name) {
            return Err(format!("wgsl/{name} is not in wgsl/manifest.txt: add it").into());
        }
    }
    let mut text = String::new();
    for name in names() {
        let module = std::fs::read_to_string(folder.join(name)).map_err(|e| format!("wgsl/{name}: {e}"))?;
        write!(text, "{MODULE}{name}\n{module}\n")?;
    }
    Ok(text)
}

/// Rust source of the sorted list of the shader's functions, or naga's message.
fn functions(text: &str) -> Result<String, String> {
    let module = naga::front::wgsl::parse_str(text).map_err(|e| {
        let line = e.location(text).map(|at| at.line_number);
        place(text, line) + &e.emit_to_string(text)
    })?;
    let mut validator = Validator::new(ValidationFlags::all(), Capabilities::empty());
    validator.validate(&module).map_err(|e| {
        let line = e.location(text).map(|at| at.line_number);
        place(text, line) + &e.emit_to_string(text)
    })?;
    let mut names: Vec<&str> = module.functions.iter().filter_map(|(_, f)| f.name.as_deref()).collect();
    names.sort_unstable();
    Ok(format!("&{names:?}"))
}

/// The module's file and line of a line of the whole text, counted from 1.
fn place(text: &str, line: Option<u32>) -> String {
    let Some(line) = line else { return String::new() };
    let before = text.lines().take(line as usize).enumerate();
    let module = before.filter_map(|(i, l)| Some((i as u32 + 1, l.strip_prefix(MODULE)?))).last();
    module.map_or_else(String::new, |(start, name)| format!("in wgsl/{name}, line {}:\n", line - start))
}

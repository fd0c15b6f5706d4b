//! Concatenates the WGSL modules, parses and validates them with naga, and writes the files that the crate includes:
//! the WGSL texts, the SPIR-V and, by reflection, the names of formulas, offsets of struct members, constants, and
//! bindings of entry points. An invalid shader fails the build with naga's own message, which points at the line.

mod fragment_variants;
mod reflect;
mod spirv;

use std::error::Error;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use naga::Module;
use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};

/// Beginning of the comment line that names a module's file, before the module's text.
const MODULE: &str = "// ==== ";

fn main() -> Result<(), Box<dyn Error>> {
    let folder = PathBuf::from(std::env::var("CARGO_MANIFEST_DIR")?);
    let out = PathBuf::from(std::env::var("OUT_DIR")?);
    for part in ["build", "wgsl", "passes"] {
        println!("cargo::rerun-if-changed={part}");
    }
    let formulas = concatenate(&folder, "wgsl")?;
    let entry_points = format!("{MODULE}build/fragment_variants.rs\n{}", fragment_variants::entry_points()?);
    let passes = formulas.clone() + &concatenate(&folder, "passes")? + &entry_points;
    std::fs::write(out.join("formulas.wgsl"), &formulas)?;
    std::fs::write(out.join("passes.wgsl"), &passes)?;
    let (module, _) = reported(checked(&formulas))?;
    std::fs::write(out.join("functions.rs"), reflect::functions(&module))?;
    let (module, info) = reported(checked(&passes))?;
    std::fs::write(out.join("spirv.rs"), spirv::modules(&module)?)?;
    std::fs::write(out.join("layout.rs"), reflect::layouts(&module)?)?;
    std::fs::write(out.join("entries.rs"), reflect::entries(&module, &info)?)?;
    Ok(())
}

/// Concatenates the modules that a folder's manifest lists, in this order. A comment line before each module names its
/// file.
fn concatenate(root: &Path, folder: &str) -> Result<String, Box<dyn Error>> {
    let manifest = std::fs::read_to_string(root.join(folder).join("manifest.txt"))?;
    let names = || manifest.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'));
    for entry in std::fs::read_dir(root.join(folder))? {
        let name = entry?.file_name();
        let name = name.to_string_lossy();
        if name.ends_with(".wgsl") && !names().any(|listed| listed == name) {
            return Err(format!("{folder}/{name} is not in {folder}/manifest.txt: add it").into());
        }
    }
    let mut text = String::new();
    for name in names() {
        let path = root.join(folder).join(name);
        let module = std::fs::read_to_string(path).map_err(|e| format!("{folder}/{name}: {e}"))?;
        write!(text, "{MODULE}{folder}/{name}\n{module}\n")?;
    }
    Ok(text)
}

/// Parses and validates WGSL. The error is naga's message.
fn checked(text: &str) -> Result<(Module, ModuleInfo), String> {
    let module = naga::front::wgsl::parse_str(text).map_err(|e| {
        let line = e.location(text).map(|at| at.line_number);
        place(text, line) + &e.emit_to_string(text)
    })?;
    let mut validator = Validator::new(ValidationFlags::all(), Capabilities::empty());
    let info = validator.validate(&module).map_err(|e| {
        let line = e.location(text).map(|at| at.line_number);
        place(text, line) + &e.emit_to_string(text)
    })?;
    Ok((module, info))
}

/// Prints the message of an error in a form that cargo displays, and returns the error in short.
fn reported<T>(result: Result<T, String>) -> Result<T, Box<dyn Error>> {
    result.map_err(|message| {
        // Cargo displays one line per message of a build script.
        for line in message.lines() {
            println!("cargo::error={line}");
        }
        "the shaders are not valid WGSL, see above".into()
    })
}

/// Returns a text that names the module's file, and the line in it, of line `line` of the concatenated text. Both lines
/// are counted from 1. Empty if the line is unknown.
fn place(text: &str, line: Option<u32>) -> String {
    let Some(line) = line else { return String::new() };
    let before = text.lines().take(line as usize).enumerate();
    let module = before.filter_map(|(i, l)| Some((i as u32 + 1, l.strip_prefix(MODULE)?))).last();
    module.map_or_else(String::new, |(start, name)| format!("in {name}, line {}:\n", line - start))
}

//! Data that isn't shipped with the project: golden scenes and scanned models.
//!
//! The environment variable `SURFEL_TEST_DATA` names the folder that holds them, as `golden/` and `models/`. Without it
//! the folder `shared` beside the workspace is taken. Tests that find nothing say that they are skipped.

use crate::backends::is_required;
use std::path::{Path, PathBuf};

/// The environment variable that names the folder.
pub const VARIABLE: &str = "SURFEL_TEST_DATA";

/// Where the folder is without the variable, relative to the workspace.
const DEFAULT: &str = "../shared";

/// A folder of the data, `golden` or `models`; without it a printed line that says so, and `None`.
///
/// # Panics
/// If the folder isn't there and `SURFEL_REQUIRE` asks for `test-data`.
pub fn folder(name: &str) -> Option<PathBuf> {
    let workspace = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let data = std::env::var_os(VARIABLE).map_or_else(|| workspace.join(DEFAULT), PathBuf::from);
    let folder = data.join(name);
    if folder.is_dir() {
        return Some(folder);
    }
    let what = format!("no folder '{name}' in {}: {VARIABLE} says where test data is", data.display());
    assert!(!is_required("test-data"), "SURFEL_REQUIRE asks for test-data, but there is {what}");
    println!("skipped: {what}");
    None
}

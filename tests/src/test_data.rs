//! Location of the test data that isn't shipped with the project: golden scenes and scanned models.
//!
//! The environment variable `SURFEL_TEST_DATA` names the folder with the subfolders `golden/` and `models/`. The
//! default is the folder `shared` beside the workspace. Tests whose data is missing print that they are skipped.

use crate::backends::is_required;
use std::path::{Path, PathBuf};

/// Environment variable that names the folder.
pub const VARIABLE: &str = "SURFEL_TEST_DATA";

/// Default folder, relative to the workspace.
const DEFAULT: &str = "../shared";

/// Returns the subfolder `golden` or `models` of the test data. If it doesn't exist, prints a note and returns `None`.
///
/// # Panics
/// If the folder doesn't exist and `SURFEL_REQUIRE` names `test-data`.
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

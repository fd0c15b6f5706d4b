//! Reads arbitrary bytes as SPLAT, SPZ, SOG and Draco files.

#![no_main]

use libfuzzer_sys::fuzz_target;
use std::path::Path;
use surfel_io::{Format, LoadOptions, load_bytes};

// A decoder's panic that the reader catches isn't a finding: without libFuzzer's hook it unwinds as in the program.
fuzz_target!(init: std::panic::set_hook(Box::new(|_| ())), |bytes: &[u8]| {
    let options = LoadOptions { repair: bytes.len() % 2 == 1, ..LoadOptions::default() };
    for extension in ["splat", "spz", "sog", "drc"] {
        let name = Path::new("t").with_extension(extension);
        if let Err(error) = load_bytes(bytes, Format::from_extension(&name), &name, &options) {
            assert!(error.to_string().lines().count() <= 4);
        }
    }
});

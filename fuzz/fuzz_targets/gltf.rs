//! Reads arbitrary bytes as glTF and GLB files.

#![no_main]

use libfuzzer_sys::fuzz_target;
use std::path::Path;
use surfel_io::{Format, LoadOptions, load_bytes};

// A decoder's panic that the reader catches isn't a finding: without libFuzzer's hook it unwinds as in the program.
fuzz_target!(init: std::panic::set_hook(Box::new(|_| ())), |bytes: &[u8]| {
    let options = LoadOptions { repair: bytes.len() % 2 == 1, ..LoadOptions::default() };
    if let Err(error) = load_bytes(bytes, Some(Format::Gltf), Path::new("t"), &options) {
        assert!(error.to_string().lines().count() <= 4);
    }
});

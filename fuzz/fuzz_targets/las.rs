//! Reads arbitrary bytes as LAS, LAZ or COPC files.

#![no_main]

use libfuzzer_sys::fuzz_target;
use std::path::Path;
use surfel_io::{LoadOptions, load_bytes};

// A decoder's panic that the reader catches isn't a finding: without libFuzzer's hook it unwinds as in the program.
fuzz_target!(init: std::panic::set_hook(Box::new(|_| ())), |bytes: &[u8]| {
    let bytes = [b"LASF", bytes].concat();
    for repair in [false, true] {
        let options = LoadOptions { repair, ..LoadOptions::default() };
        if let Err(error) = load_bytes(&bytes, None, Path::new("t"), &options) {
            assert!(error.to_string().lines().count() <= 4);
        }
    }
});

//! Reads arbitrary bytes as a point tile or a tileset of 3D Tiles.

#![no_main]

use libfuzzer_sys::fuzz_target;
use std::path::Path;
use surfel_io::{Format, LoadOptions, load_bytes};

fuzz_target!(|bytes: &[u8]| {
    let options = LoadOptions { repair: bytes.len() % 2 == 1, ..LoadOptions::default() };
    for format in [Format::Pnts, Format::Tileset] {
        if let Err(error) = load_bytes(bytes, Some(format), Path::new("t"), &options) {
            assert!(error.to_string().lines().count() <= 4);
        }
    }
});

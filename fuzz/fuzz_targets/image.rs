//! Reads arbitrary bytes as an image: EXR, PNG, JPEG or WebP.

#![no_main]

use libfuzzer_sys::fuzz_target;
use std::path::Path;

// A decoder's panic that the reader catches isn't a finding: without libFuzzer's hook it unwinds as in the program.
fuzz_target!(init: std::panic::set_hook(Box::new(|_| ())), |bytes: &[u8]| {
    if let Ok(planes) = surfel_io::read_image_bytes(bytes, Path::new("t")) {
        let pixels = planes.width as usize * planes.height as usize;
        assert!(planes.color.is_none_or(|c| c.len() == pixels));
        assert!(planes.depth.is_none_or(|d| d.len() == pixels));
    }
});

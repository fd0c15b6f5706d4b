//! Reads arbitrary bytes as a scene file.

#![no_main]

use libfuzzer_sys::fuzz_target;
use std::path::Path;
use surfel_io::scene_file;

fuzz_target!(|bytes: &[u8]| {
    if let Ok(file) = scene_file::parse(bytes, Path::new("t")) {
        let text = scene_file::to_json_pretty(&file);
        assert!(scene_file::parse(text.as_bytes(), Path::new("t")).is_ok_and(|again| again == file), "{text}");
    }
});

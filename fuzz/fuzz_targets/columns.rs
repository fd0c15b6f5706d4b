//! Reads arbitrary bytes as PLY, PCD or NumPy arrays, from a file part by part and from memory: both must give the same
//! result.

#![no_main]

use libfuzzer_sys::fuzz_target;
use std::path::PathBuf;
use surfel_io::{Format, LoadOptions, load, load_bytes};

/// Returns the path of this process's file, in a memory file system if there is one.
fn path(extension: &str) -> PathBuf {
    let shared = PathBuf::from("/dev/shm");
    let folder = if shared.is_dir() { shared } else { std::env::temp_dir() };
    folder.join(format!("surfel-fuzz-{}.{extension}", std::process::id()))
}

// A decoder's panic that the reader catches isn't a finding: without libFuzzer's hook it unwinds as in the program.
fuzz_target!(init: std::panic::set_hook(Box::new(|_| ())), |bytes: &[u8]| {
    let options = LoadOptions { repair: bytes.len() % 2 == 1, ..LoadOptions::default() };
    let extension = match bytes {
        [0x93, ..] => "npy",
        [b'P', b'K', ..] => "npz",
        [b'p', b'l', ..] => "ply",
        [b'#' | b'V' | b'F', ..] => "pcd",
        // Other formats aren't read part by part.
        _ => return,
    };
    let path = path(extension);
    std::fs::write(&path, bytes).expect("room for a small file");
    let words = |loaded: Result<_, surfel_io::IoError>| match loaded {
        Ok(loaded) => format!("{loaded:?}"),
        Err(error) => {
            let words = error.to_string();
            assert!(words.lines().count() <= 4);
            words
        }
    };
    let of_file = words(load(&path, &options));
    std::fs::remove_file(&path).expect("it was written");
    let of_memory = words(load_bytes(bytes, Format::from_extension(&path), &path, &options));
    assert_eq!(of_file, of_memory);
});

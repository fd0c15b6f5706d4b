//! Reads arbitrary bytes as E57 files with correct checksums: other files are refused before anything is read.

#![no_main]

use libfuzzer_sys::fuzz_target;
use std::path::Path;
use surfel_io::{LoadOptions, load_bytes};

// A decoder's panic that the reader catches isn't a finding: without libFuzzer's hook it unwinds as in the program.
fuzz_target!(init: std::panic::set_hook(Box::new(|_| ())), |bytes: &[u8]| {
    let mut bytes = [b"ASTM-E57", bytes].concat();
    bytes.resize(bytes.len().div_ceil(1024) * 1024, 0);
    for page in bytes.chunks_exact_mut(1024) {
        // CRC-32C, bit by bit; big endian in the file.
        let mut crc = !0_u32;
        for byte in &page[..1020] {
            crc ^= u32::from(*byte);
            for _ in 0..8 {
                crc = (crc >> 1) ^ (0x82f6_3b78 & (crc & 1).wrapping_neg());
            }
        }
        page[1020..].copy_from_slice(&(!crc).to_be_bytes());
    }
    for repair in [false, true] {
        let options = LoadOptions { repair, ..LoadOptions::default() };
        if let Err(error) = load_bytes(&bytes, None, Path::new("t"), &options) {
            assert!(error.to_string().lines().count() <= 4);
        }
    }
});

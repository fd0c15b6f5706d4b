//! Parses arbitrary text as a coordinate reference system in a file's comments, and writes an image with it.

#![no_main]

use libfuzzer_sys::fuzz_target;
use std::path::PathBuf;
use surfel_io::{Crs, GeoImage, GeoSamples, write_geotiffs};

fuzz_target!(|text: &str| {
    let comments: Vec<String> = text.lines().map(str::to_owned).collect();
    let Some(crs) = Crs::of_comments(&comments) else { return };
    // The comments that a system writes state the same system again, except for the code, which text and keys already
    // state.
    let again = Crs::of_comments(&crs.comments()).expect("a system says something");
    assert_eq!((crs.epsg(), crs.is_geographic()), (again.epsg(), again.is_geographic()));
    assert_eq!(crs.words(), again.words());
    assert_eq!(crs.words().lines().count(), 1);
    let shared = PathBuf::from("/dev/shm");
    let folder = if shared.is_dir() { shared } else { std::env::temp_dir() };
    let path = folder.join(format!("surfel-fuzz-{}.tif", std::process::id()));
    let image = GeoImage {
        path: path.clone(),
        size: [1, 1],
        samples: GeoSamples::Rgba8,
        left_top: [0.0, 0.0],
        pixel: 1.0,
        crs: Some(crs),
        software: "fuzz".to_owned(),
    };
    write_geotiffs(&[image], true, |_| Ok::<(), surfel_io::IoError>(())).expect("an image of one pixel");
    std::fs::remove_file(&path).expect("it was written");
});

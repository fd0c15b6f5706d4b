//! Files of formats that aren't built are refused with the name of their Cargo feature. Run with `cargo test -p
//! surfel-io --no-default-features`.

use std::path::Path;
use surfel_io::{Format, LoadOptions, load_bytes, read_image_bytes};

#[test]
fn left_out_formats_name_their_feature_and_others_are_read() {
    for (format, built, feature) in [
        (Format::Obj, cfg!(feature = "obj"), "obj"),
        (Format::Stl, cfg!(feature = "stl"), "stl"),
        (Format::Gltf, cfg!(feature = "gltf"), "gltf"),
        (Format::Xyz, cfg!(feature = "points"), "points"),
        (Format::Ptx, cfg!(feature = "points"), "points"),
        (Format::Pcd, cfg!(feature = "pcd"), "pcd"),
        (Format::Npy, cfg!(feature = "npy"), "npy"),
        (Format::Npz, cfg!(feature = "npy"), "npy"),
        (Format::Off, cfg!(feature = "off"), "off"),
        (Format::Drc, cfg!(feature = "draco"), "draco"),
        (Format::Splat, cfg!(feature = "gaussians"), "gaussians"),
        (Format::Spz, cfg!(feature = "gaussians"), "gaussians"),
        (Format::Sog, cfg!(feature = "gaussians"), "gaussians"),
        (Format::Las, cfg!(feature = "las"), "las"),
        (Format::E57, cfg!(feature = "e57"), "e57"),
    ] {
        let error = load_bytes(b"? ?", Some(format), Path::new("t"), &LoadOptions::default()).unwrap_err();
        let hint = format!("build with the Cargo feature \"{feature}\" of surfel-io");
        assert_eq!(error.to_string().contains(&hint), !built, "{error}");
        assert!(error.is_bad_input());
    }
    let error = read_image_bytes(b"\x76\x2f\x31\x01", Path::new("t")).unwrap_err().to_string();
    assert_eq!(error.contains("\"exr\" of surfel-io"), !cfg!(feature = "exr"), "{error}");
    let error = read_image_bytes(b"\xff\xd8\xff", Path::new("t")).unwrap_err().to_string();
    assert_eq!(error.contains("\"jpeg\" of surfel-io"), !cfg!(feature = "jpeg"), "{error}");
    let ply = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float \
               z\nend_header\n1 2 3";
    assert!(load_bytes(ply.as_bytes(), None, Path::new("t"), &LoadOptions::default()).is_ok());
}

//! Gaussian splats in SPLAT, SPZ, SOG and packed PLY, and Draco files. The tests build the files byte by byte.

#![cfg(all(feature = "draco", feature = "gaussians", feature = "webp"))]

use flate2::Compression;
use flate2::write::GzEncoder;
use glam::DVec3;
use image::{ExtendedColorType, codecs::webp::WebPEncoder};
use std::io::Write;
use std::path::Path;
use surfel_io::{Content, Format, LoadOptions, Loaded, load_bytes};
use surfel_model::{SplatCloud, Up};

fn try_load(name: &str, bytes: &[u8]) -> Result<Loaded, String> {
    let hint = Format::from_extension(Path::new(name));
    load_bytes(bytes, hint, Path::new(name), &LoadOptions::default())
        .map_err(|e| e.to_string())
        .inspect_err(|e| assert!(e.lines().count() <= 4, "{e}"))
}

fn refused(name: &str, bytes: impl AsRef<[u8]>, expected: &str) {
    let error = try_load(name, bytes.as_ref()).map(|l| l.content).unwrap_err();
    assert!(error.contains(expected), "{error}\nexpected: {expected}");
}

fn splats(name: &str, bytes: impl AsRef<[u8]>, up: Up) -> SplatCloud {
    let loaded = try_load(name, bytes.as_ref()).unwrap_or_else(|e| panic!("{e}"));
    assert!(loaded.gaussian && loaded.up == up, "{:?}", loaded.up);
    match loaded.content {
        Content::Splats(cloud) => cloud,
        other => panic!("{other:?}"),
    }
}

fn le(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// Linear value of the sRGB-encoded level 128 of 255.
const HALF_OF_255: f32 = 0.215_860_5;

/// Checks the single splat of every test file, at (1, −2, 3). Its standard deviations are 1, ½ and almost 0, along axes
/// rotated by a quarter turn about z. `size_error` is a relative tolerance, `place_error` one in world units, and
/// `angle_error` one in radians.
fn check(cloud: &SplatCloud, size_error: f64, place_error: f64, angle_error: f64) {
    assert!((cloud.center(0) - DVec3::new(1.0, -2.0, 3.0)).length() <= place_error, "{}", cloud.center(0));
    let (s, t) = cloud.axes(0);
    // Twice the standard deviation, in the order of the axes.
    assert!((s.length() - 2.0).abs() <= 2.0 * size_error && (t.length() - 1.0).abs() <= size_error, "{s} {t}");
    assert!((s.normalize() - DVec3::Y).length() <= angle_error, "{s}");
    assert!((t.normalize() + DVec3::X).length() <= angle_error, "{t}");
}

#[test]
fn splat_rows_are_read() {
    let mut row = le(&[1.0, -2.0, 3.0, 1.0, 0.5, 0.001]);
    row.extend([255, 128, 0, 204, 219, 128, 128, 219]);
    let mut faint = row.clone();
    faint[27] = 5;
    let bytes = [row.clone(), faint].concat();
    let cloud = splats("a.splat", &bytes, Up::MinusY);
    // Equal bytes of w and z are an exact quarter turn; the rest is f32.
    check(&cloud, 1e-6, 0.0, 1e-6);
    assert_eq!((cloud.len(), cloud.color(0), cloud.alpha(0)), (1, [1.0, HALF_OF_255, 0.0], 0.8));
    for end in [0, 1, 31, 33, 63] {
        assert!(try_load("a.splat", &bytes[..end]).is_err());
    }
    row[28..].fill(128);
    assert!(try_load("a.splat", &row).is_err(), "a rotation of no length");
}

fn gzip(content: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(content).unwrap();
    encoder.finish().unwrap()
}

/// Returns the 16-byte header and the streams of one splat, with 12 fractional bits.
fn spz(version: u32) -> (Vec<u8>, Vec<Vec<u8>>) {
    let mut header = b"NGSP".to_vec();
    header.extend(version.to_le_bytes());
    header.extend([1, 0, 0, 0, 1, 12, 0, 6]);
    let place = [1.0_f64, -2.0, 3.0];
    let positions = match version {
        1 => place.iter().flat_map(|&v| half::f16::from_f64(v).to_le_bytes()).collect(),
        _ => place.iter().flat_map(|v| ((v * 4096.0) as i32).to_le_bytes()[..3].to_vec()).collect(),
    };
    // exp(160/16 − 10) = 1; the nearest to ln ½ is 149, ½·1.0057; 0 is exp(−10).
    let scales = vec![160, 149, 0];
    // w is omitted; z has 511 of 511/√2. Before version 3: x, y and z from −1 to 1, with 0.7098 as nearest value.
    let rotation = if version < 3 { vec![128, 128, 218] } else { (3_u32 << 30 | 511).to_le_bytes().to_vec() };
    // (level/255 − ½)/0.15·C0 + ½: 255 is 1.44, 128 is 0.504, 0 is −0.44.
    (header, vec![positions, vec![204], vec![255, 128, 0], scales, rotation, vec![128; 9]])
}

#[test]
fn spz_of_every_gzip_version_is_read() {
    for version in 1..=3 {
        let (header, streams) = spz(version);
        let bytes = [header, streams.concat()].concat();
        for file in [gzip(&bytes), bytes.clone()] {
            let cloud = splats("a", &file, Up::PlusY);
            // Scale as above; positions are exact; half a step of 1/127.5 rotates the axes by twice that.
            check(&cloud, 0.007, 0.0, if version < 3 { 0.02 } else { 1e-6 });
            assert_eq!(cloud.alpha(0), 0.8);
            let [r, g, b] = cloud.color(0);
            // sRGB 0.5037 is 0.2175.
            assert!(r == 1.0 && (g - 0.2175).abs() < 1e-3 && b == 0.0, "{r} {g} {b}");
        }
        for end in 0..bytes.len() {
            assert!(try_load("a.spz", &bytes[..end]).is_err(), "{end}");
            assert!(try_load("a.spz", &gzip(&bytes[..end])).is_err(), "{end}");
        }
        for (at, value, expected) in [
            (4, 9, "version 9"),
            (11, 255, "ends within its 4278190081 splats"),
            (8, 0, "holds no splat"),
            (12, 5, "degree 5"),
            (13, 31, "31 bits"),
        ] {
            let mut wrong = bytes.clone();
            wrong[at] = value;
            refused("a.spz", wrong, expected);
        }
    }
}

#[test]
fn spz_and_splat_rows_are_read_as_trained() {
    let options = LoadOptions { gaussians: true, ..LoadOptions::default() };
    let load = |name: &str, bytes: &[u8]| {
        let loaded = load_bytes(bytes, Format::from_extension(Path::new(name)), Path::new(name), &options).unwrap();
        assert!(loaded.gaussian && loaded.notes.is_empty(), "{:?}", loaded.notes);
        match loaded.content {
            Content::Gaussians(cloud) => cloud,
            other => panic!("{other:?}"),
        }
    };
    let (header, mut streams) = spz(3);
    streams[5] = vec![0, 64, 255, 128, 129, 127, 1, 2, 3];
    let cloud = load("a.spz", &[header, streams.concat()].concat());
    let rest = &cloud.coefficients(0)[1..];
    let step = 1.0 / 128.0;
    assert_eq!(rest[..2], [[-1.0, -0.5, 127.0 * step], [0.0, step, -step]]);
    assert_eq!((cloud.data().degree, cloud.data().kind), (1, surfel_model::GaussianKind::Solid));
    assert!((cloud.data().opacities[0] - 0.8).abs() < 1e-6);
    let mut row = le(&[1.0, -2.0, 3.0, 1.0, 0.5, 0.001]);
    row.extend([255, 128, 0, 5, 219, 128, 128, 219]);
    let cloud = load("a.splat", &row);
    assert_eq!((cloud.len(), cloud.data().sigmas[0], cloud.data().degree), (1, [1.0, 0.5, 0.001], 0));
    let shown = cloud.coefficients(0)[0].map(|c| f64::from(c) * 0.282_094_791_773_878_14 + 0.5);
    for (shown, level) in shown.into_iter().zip([255.0, 128.0, 0.0]) {
        assert!((shown - level / 255.0).abs() < 1e-6, "{shown}");
    }
}

/// Builds a Zstandard frame with one raw block of fewer than 256 bytes.
fn zstd(content: &[u8]) -> Vec<u8> {
    let block = 1 | (content.len() as u32) << 3;
    let head = [&[0x28, 0xb5, 0x2f, 0xfd, 0x20, content.len() as u8][..], &block.to_le_bytes()[..3]].concat();
    [head, content.to_vec()].concat()
}

fn spz4() -> Vec<u8> {
    let (mut bytes, streams) = spz(4);
    let packed: Vec<Vec<u8>> = streams.iter().map(|s| zstd(s)).collect();
    // Eight bytes of unknown extensions precede the table.
    bytes.extend(40_u32.to_le_bytes());
    bytes.extend([0; 12]);
    bytes.extend([1, 0, 2, 0, 0, 0, 0, 0]);
    for (whole, packed) in streams.iter().zip(&packed) {
        bytes.extend((packed.len() as u64).to_le_bytes());
        bytes.extend((whole.len() as u64).to_le_bytes());
    }
    bytes.extend(packed.concat());
    bytes
}

#[cfg(feature = "zstd")]
#[test]
fn spz_of_version_4_is_read() {
    let bytes = spz4();
    check(&splats("a", &bytes, Up::PlusY), 0.007, 0.0, 1e-6);
    for end in 0..bytes.len() {
        assert!(try_load("a.spz", &bytes[..end]).is_err(), "{end}");
    }
    for (at, value) in [(8, 2), (15, 5), (16, 255), (19, 255), (48, 8), (46, 1)] {
        let mut wrong = bytes.clone();
        wrong[at] = value;
        assert!(try_load("a.spz", &wrong).is_err(), "{at}");
    }
}

#[cfg(not(feature = "zstd"))]
#[test]
fn spz_of_version_4_names_its_feature() {
    refused("a.spz", spz4(), "build with the feature zstd, as by cargo run --release --features zstd");
}

/// Builds a ZIP file of stored members.
fn zip(members: &[(&str, Vec<u8>)]) -> Vec<u8> {
    let (mut bytes, mut directory) = (Vec::new(), Vec::new());
    for (name, content) in members {
        let start = (bytes.len() as u32).to_le_bytes();
        let (size, length) = ((content.len() as u32).to_le_bytes(), (name.len() as u16).to_le_bytes());
        bytes.extend([b"PK\x03\x04\x14\0\0\0\0\0\0\0\0\0\0\0\0\0", &size[..], &size, &length, &[0, 0]].concat());
        bytes.extend(name.as_bytes());
        bytes.extend(content);
        directory
            .extend([b"PK\x01\x02\x14\0\x14\0\0\0\0\0\0\0\0\0\0\0\0\0", &size[..], &size, &length, &[0; 12]].concat());
        directory.extend(start);
        directory.extend(name.as_bytes());
    }
    let (count, start) = ((members.len() as u16).to_le_bytes(), (bytes.len() as u32).to_le_bytes());
    let size = (directory.len() as u32).to_le_bytes();
    bytes.extend(&directory);
    bytes.extend([b"PK\x05\x06\0\0\0\0", &count[..], &count, &size, &start, &[0, 0]].concat());
    bytes
}

/// Builds an image of one row of two pixels, the second one beyond the splat count.
fn picture(texel: [u8; 4]) -> Vec<u8> {
    let mut bytes = Vec::new();
    WebPEncoder::new_lossless(&mut bytes).encode(&[texel, [7; 4]].concat(), 2, 1, ExtendedColorType::Rgba8).unwrap();
    bytes
}

fn sog(meta: &str) -> Vec<u8> {
    let members = sog_members(meta);
    let names: Vec<String> = members.iter().map(|(name, _)| format!("scene/{name}")).collect();
    let members = names.iter().zip(members).map(|(name, (_, bytes))| (name.as_str(), bytes));
    zip(&members.collect::<Vec<_>>())
}

/// Returns `meta.json` and its images.
fn sog_members(meta: &str) -> [(&'static str, Vec<u8>); 6] {
    // Logarithms of 2, −3 and 4, in the range −2 to 2, in 16 bits.
    let place = [2.0_f64.ln(), -(3.0_f64.ln()), 4.0_f64.ln()];
    let place = place.map(|v| ((v + 2.0) / 4.0 * 65_535.0).round() as u16);
    // w of the rotation is omitted, and z is √½·(2·255/255 − 1).
    [
        ("meta.json", meta.as_bytes().to_vec()),
        ("means_l.webp", picture([place[0] as u8, place[1] as u8, place[2] as u8, 255])),
        ("means_u.webp", picture([(place[0] >> 8) as u8, (place[1] >> 8) as u8, (place[2] >> 8) as u8, 255])),
        ("quats.webp", picture([128, 128, 255, 252])),
        ("scales.webp", picture([2, 1, 0, 255])),
        ("sh0.webp", picture([2, 1, 0, 204])),
    ]
}

const FILES: &str = r#""files":["means_l.webp","means_u.webp"]"#;

fn sog2() -> String {
    // ½ + C0·c is 1.06, 0.5 and −0.06.
    format!(
        r#"{{"version":2,"count":1,"means":{{"mins":[-2,-2,-2],"maxs":[2,2,2],{FILES}}},
"scales":{{"codebook":[-9,-0.6931471805599453,0],"files":["scales.webp"]}},"quats":{{"files":["quats.webp"]}},
"sh0":{{"codebook":[-2,0,2],"files":["sh0.webp"]}},"shN":{{"count":0}}}}"#
    )
}

#[test]
fn sog_of_both_versions_is_read() {
    // A step of the logarithm is 4/65535; half of it at 4 is 1.3e-4. 128 of 255 in x and y of the rotation is 0.0028
    // instead of 0.
    let cloud = splats("a", sog(&sog2()), Up::MinusY);
    check(&cloud, 1e-6, 2e-4, 0.012);
    // sRGB ½.
    assert_eq!((cloud.color(0), cloud.alpha(0)), ([1.0, 0.214_041_14, 0.0], 0.8));
    // Version 1 has ranges: bytes 2, 1 and 0 of 255 within −255·ln2…: ½^(2−k); sh0 so that 0 is −2; alpha is a logit.
    let ln2 = 2.0_f64.ln();
    let meta = format!(
        r#"{{"means":{{"shape":[1,3],"mins":[-2,-2,-2],"maxs":[2,2,2],{FILES}}},
"scales":{{"mins":[{0},{0},-9],"maxs":[{1},{1},9],"files":["scales.webp"]}},"quats":{{"files":["quats.webp"]}},
"sh0":{{"mins":[-2,-2,-2,0],"maxs":[508,508,508,{2}],"files":["sh0.webp"]}}}}"#,
        -2.0 * ln2,
        253.0 * ln2,
        // ln 4 is the logit of 0.8; the byte is 204.
        4.0_f64.ln() * 255.0 / 204.0
    );
    let cloud = splats("a", sog(&meta), Up::MinusY);
    check(&cloud, 1e-6, 2e-4, 0.012);
    assert!((cloud.alpha(0) - 0.8).abs() < 1e-6 && cloud.color(0) == [1.0, 0.214_041_14, 0.0]);
}

#[test]
fn sog_of_files_in_a_folder_is_read_by_its_meta_json() {
    let folder = tempfile::tempdir().unwrap();
    let meta = folder.path().join("meta.json");
    for (name, bytes) in sog_members(&sog2()) {
        std::fs::write(folder.path().join(name), bytes).unwrap();
    }
    assert!(surfel_io::names_geometry(&meta));
    let loaded = surfel_io::load(&meta, &LoadOptions::default()).unwrap();
    assert_eq!((loaded.format, loaded.up, loaded.beside.len()), (Format::Sog, Up::MinusY, 5));
    let Content::Splats(cloud) = loaded.content else { panic!("{:?}", loaded.content) };
    assert_eq!(cloud, splats("a", sog(&sog2()), Up::MinusY));
    let refused = |meta: &Path, expected: &str| {
        let error = surfel_io::load(meta, &LoadOptions::default()).unwrap_err().to_string();
        assert!(error.contains(expected) && error.lines().count() <= 4, "{error}");
    };
    // Images outside the folder, and missing ones.
    let out = sog2().replace("\"sh0.webp\"", "\"../sh0.webp\"");
    std::fs::write(&meta, out).unwrap();
    refused(&meta, "can't read the picture '../sh0.webp', which it names: it is outside");
    std::fs::write(&meta, sog2()).unwrap();
    std::fs::remove_file(folder.path().join("quats.webp")).unwrap();
    refused(&meta, "can't read the picture 'quats.webp'");
    // In memory there are no files beside it.
    let error = try_load("meta.json", sog2().as_bytes()).unwrap_err();
    assert!(error.contains("not available here"), "{error}");
}

#[test]
fn sog_faults_are_errors() {
    let ok = sog2();
    for (from, to, expected) in [
        (r#""version":2"#, r#""version":3"#, "version 3"),
        (r#""count":1"#, r#""count":0"#, "counts no splats"),
        (r#""count":1"#, r#""count":3"#, "has 2 pixels for 3 splats"),
        (r#""count":1"#, r#""count":18446744073709551615"#, "has 2 pixels for"),
        (r#""means_u.webp""#, r#""../means_u.webp""#, "has no '../means_u.webp'"),
        (r#","means_u.webp""#, "", "names too few pictures"),
        (r#""maxs":[2,2,2]"#, r#""maxs":[2]"#, "not finite"),
        (r#""codebook":[-9,"#, r#""codebook":[1e999,"#, "meta.json is no description"),
        (r#""quats""#, r#""quads""#, "missing field `quats`"),
    ] {
        assert!(ok.contains(from), "{from}");
        refused("a.sog", sog(&ok.replacen(from, to, 1)), expected);
    }
    let whole = sog(&ok);
    for end in 0..whole.len() {
        assert!(try_load("a.sog", &whole[..end]).is_err(), "{end}");
    }
    let mut wrong = whole;
    let at = wrong.windows(4).position(|w| w == b"WEBP").unwrap();
    wrong[at + 8..at + 20].fill(0xff);
    refused("a.sog", wrong, "can't be read");
}

fn packed_ply(bounds_of_colors: bool) -> Vec<u8> {
    let sides = ["min_x", "min_y", "min_z", "max_x", "max_y", "max_z"];
    let scales = ["min_scale_x", "min_scale_y", "min_scale_z", "max_scale_x", "max_scale_y", "max_scale_z"];
    let colors = ["min_r", "min_g", "min_b", "max_r", "max_g", "max_b"];
    let colors = if bounds_of_colors { &colors[..] } else { &[] };
    let names: String = sides.iter().chain(&scales).chain(colors).map(|n| format!("property float {n}\n")).collect();
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement chunk 1\n{names}element vertex 1\nproperty uint \
         packed_position\nproperty uint packed_rotation\nproperty uint packed_scale\nproperty uint \
         packed_color\nelement sh 1\nproperty uchar f_rest_0\nend_header\n"
    )
    .into_bytes();
    // The position is at fraction 1 of x, 0 of y and 1 of z; the scales at 0 of x and 1 of y and z.
    bytes.extend(le(&[-1.0, -2.0, -3.0, 1.0, 2.0, 3.0]));
    bytes.extend(le(&[0.0, -5.0, -9.0, 5.0, 0.5_f32.ln(), -7.0]));
    if bounds_of_colors {
        bytes.extend(le(&[0.0, 0.0, 0.0, 2.0, 2.0, 2.0]));
    }
    let position = 2047_u32 << 21 | 2047;
    // The first component, w, is omitted; z has all 10 bits, x and y nearly ½.
    let rotation = 512_u32 << 20 | 512 << 10 | 1023;
    let scale = 1023_u32 << 11 | 2047;
    for word in [position, rotation, scale, 0xff80_00cc] {
        bytes.extend(word.to_le_bytes());
    }
    bytes.push(0);
    bytes
}

#[test]
fn packed_ply_is_read() {
    for bounds_of_colors in [false, true] {
        let bytes = packed_ply(bounds_of_colors);
        let cloud = splats("a.ply", &bytes, Up::MinusY);
        // 512 of 1023 is 0.0007 above ½ in x and y of the rotation.
        check(&cloud, 1e-6, 1e-6, 0.005);
        let green = if bounds_of_colors { 1.0 } else { HALF_OF_255 };
        assert_eq!((cloud.color(0), cloud.alpha(0)), ([1.0, green, 0.0], 0.8));
        // Harmonics are last and aren't read.
        for end in 0..bytes.len() - 1 {
            assert!(try_load("a.ply", &bytes[..end]).is_err(), "{end}");
        }
    }
    let text = |from: &str, to: &str| {
        let bytes = packed_ply(false);
        let at = bytes.windows(from.len()).position(|w| w == from.as_bytes()).unwrap();
        [&bytes[..at], to.as_bytes(), &bytes[at + from.len()..]].concat()
    };
    refused("a.ply", text("element chunk 1", "element other 1"), "has no element 'chunk'");
    refused("a.ply", text("element chunk 1", "element chunk 0"), "has 0 chunks for 1 splats");
    refused("a.ply", text("min_x", "mun_x"), "lack");
    refused("a.ply", text("uint packed_scale", "int packed_scale"), "not of the type uint");
}

#[test]
fn draco_files_hold_meshes_or_points() {
    let square = include_bytes!("data/square.drc");
    let loaded = try_load("a", square).unwrap();
    assert_eq!((loaded.format, loaded.up), (Format::Drc, Up::PlusY));
    let Content::Mesh(mesh) = loaded.content else { panic!() };
    assert_eq!((mesh.positions.len(), mesh.triangles.len()), (4, 2));
    // Five points at k·(1, 2, −1) with the colours (255 − 51k, 128, 0) and the numbers 2k, in any order.
    let cut = include_bytes!("data/points.drc");
    let Content::Points(cloud) = try_load("a", cut).unwrap().content else { panic!() };
    assert_eq!((cloud.len(), cloud.extras[0].name.as_str()), (5, "generic_2"));
    let numbers = match &cloud.extras[0].values {
        surfel_model::ExtraValues::U8(v) => v.clone(),
        other => panic!("{other:?}"),
    };
    for (i, number) in numbers.into_iter().enumerate() {
        let k = f64::from(number) / 2.0;
        // Positions may be quantised: 8 units in 11 bits.
        assert!((cloud.positions.get(i) - DVec3::new(1.0, 2.0, -1.0) * k).length() < 8.0 / 2048.0);
        assert_eq!(cloud.colors.as_ref().unwrap()[i][1], HALF_OF_255);
    }
    for end in 0..cut.len() - 4 {
        assert!(try_load("a.drc", &cut[..end]).is_err(), "{end}");
    }
}

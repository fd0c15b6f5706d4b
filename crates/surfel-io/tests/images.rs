//! Pictures written and read back.

use std::path::Path;
use surfel_io::{BitDepth, ExrOptions, Planes, PngOptions, read_image_bytes, write_exr, write_png};

fn planes() -> Planes {
    let (width, height) = (37, 23);
    let n = (width * height) as usize;
    let f = |i: usize, k: f32| (i as f32 * 0.013 + k).sin().abs();
    Planes {
        width,
        height,
        color: Some((0..n).map(|i| [f(i, 0.0), f(i, 1.0) * 7.0, 1e-6, if i % 3 == 0 { 0.0 } else { 1.0 }]).collect()),
        depth: Some((0..n).map(|i| if i % 5 == 0 { f32::INFINITY } else { f(i, 2.0) * 1e5 }).collect()),
        normal: Some((0..n).map(|i| [f(i, 3.0), -0.0, -f(i, 4.0)]).collect()),
        weight: Some((0..n).map(|i| f(i, 5.0)).collect()),
        other: vec![("fragments".into(), (0..n).map(|i| i as f32).collect())],
        metadata: Vec::new(),
    }
}

fn exr(planes: &Planes, options: &ExrOptions) -> Vec<u8> {
    let mut bytes = Vec::new();
    write_exr(&mut bytes, &planes.view(), options).unwrap();
    bytes
}

fn read(bytes: &[u8]) -> Planes {
    read_image_bytes(bytes, Path::new("t")).unwrap_or_else(|e| panic!("{e}"))
}

#[test]
fn exr_in_f32_survives_bit_by_bit() {
    let planes = planes();
    let read = read(&exr(&planes, &ExrOptions { f32_color: true, metadata: Vec::new() }));
    assert_eq!(read, planes);
}

#[test]
fn exr_color_is_f16_unless_asked() {
    let planes = planes();
    let half = read(&exr(&planes, &ExrOptions::default()));
    assert_eq!((&half.depth, &half.normal), (&planes.depth, &planes.normal));
    assert_ne!(half.color, planes.color);
    for (a, b) in half.color.unwrap().iter().flatten().zip(planes.color.unwrap().iter().flatten()) {
        // Half a unit in the last place of 11 bits, or of the smallest subnormal, 2⁻²⁴.
        assert!((a - b).abs() <= b.abs() / 2048.0 + 3e-8, "{a} {b}");
    }
}

#[test]
fn exr_holds_only_the_planes_given() {
    let all = planes();
    let depth = Planes { width: all.width, height: all.height, depth: all.depth.clone(), ..Planes::default() };
    assert_eq!(read(&exr(&depth, &ExrOptions::default())), depth);
    let none = Planes { width: 4, height: 4, ..Planes::default() };
    assert!(write_exr(&mut Vec::new(), &none.view(), &ExrOptions::default()).is_err());
    let short = Planes { width: 4, ..depth };
    assert!(write_exr(&mut Vec::new(), &short.view(), &ExrOptions::default()).is_err());
    let mut twice = all;
    twice.other.push(("Z".into(), twice.other[0].1.clone()));
    assert!(write_exr(&mut Vec::new(), &twice.view(), &ExrOptions::default()).is_err());
}

#[test]
fn exr_metadata_is_kept_and_the_bytes_are_always_the_same() {
    let metadata: Vec<(String, String)> =
        (0..20).map(|i| (format!("surfel:key{i:02}"), format!("value {i} °"))).collect();
    let options = ExrOptions { f32_color: false, metadata: metadata.clone() };
    let first = exr(&planes(), &options);
    assert_eq!(read(&first).metadata, metadata);
    // Hash maps are seeded anew each time, so that twenty attributes would almost never agree by chance.
    assert!((0..5).all(|_| exr(&planes(), &options) == first));
    let odd = ExrOptions { f32_color: false, metadata: vec![("".into(), "é → ☃\0".into())] };
    assert_eq!(read(&exr(&planes(), &odd)).metadata, [("_".to_owned(), "é ? ??".to_owned())]);
}

#[test]
fn exr_truncated_or_lying_is_an_error() {
    let bytes = exr(&planes(), &ExrOptions::default());
    for end in (0..bytes.len()).step_by(97) {
        assert!(read_image_bytes(&bytes[..end], Path::new("t")).is_err(), "{end}");
    }
    // A data window of 60000 by 60000 in a file of a few kilobytes.
    let mut lying = bytes;
    for name in [&b"dataWindow\0box2i\0"[..], b"displayWindow\0box2i\0"] {
        let at = lying.windows(name.len()).position(|w| w == name).unwrap() + name.len() + 4;
        lying[at + 8..at + 12].copy_from_slice(&60_000_i32.to_le_bytes());
        lying[at + 12..at + 16].copy_from_slice(&60_000_i32.to_le_bytes());
    }
    let error = read_image_bytes(&lying, Path::new("t")).unwrap_err().to_string();
    assert!(error.contains("60001x60001"), "{error}");
}

#[test]
fn png_is_straight_srgb_and_reads_back_within_half_a_code() {
    // Premultiplied: full red at half cover, a grey, clipped highlights, nothing, and not a number.
    let color = vec![
        [0.5, 0.0, 0.0, 0.5],
        [0.214_041_14, 0.214_041_14, 0.214_041_14, 1.0],
        [4.0, -1.0, 1.0, 1.0],
        [0.0; 4],
        [f32::NAN; 4],
        [f32::NAN, 0.5, f32::INFINITY, 1.0],
    ];
    let planes = Planes { width: 3, height: 2, color: Some(color.clone()), ..Planes::default() };
    for (depth, codes) in [(BitDepth::Eight, 255.0), (BitDepth::Sixteen, 65_535.0)] {
        let metadata = vec![("Software".into(), "surfel — test".into())];
        let mut bytes = Vec::new();
        write_png(&mut bytes, &planes.view(), &PngOptions { depth, metadata }).unwrap();
        assert!(bytes.windows(4).any(|w| w == b"sRGB") && bytes.windows(4).any(|w| w == b"iTXt"));
        let read = read(&bytes).color.unwrap();
        // Half a code of alpha, and of a colour of slope at most 2.4·1.055⁻¹ there.
        let tolerance = 1.3 / codes;
        for (i, expected) in
            [[0.5, 0.0, 0.0, 0.5], color[1], [1.0, 0.0, 1.0, 1.0], [0.0; 4], [0.0; 4], [0.0, 0.5, 1.0, 1.0]]
                .iter()
                .enumerate()
        {
            let close = read[i].iter().zip(expected).all(|(a, b)| (a - b).abs() <= tolerance);
            assert!(close, "{codes} {i}: {:?} {expected:?}", read[i]);
        }
    }
}

#[test]
fn png_truncated_or_lying_is_an_error() {
    let mut bytes = Vec::new();
    write_png(&mut bytes, &planes().view(), &PngOptions::default()).unwrap();
    // All but the end chunk has to be there.
    for end in (0..bytes.len() - 12).step_by(53) {
        assert!(read_image_bytes(&bytes[..end], Path::new("t")).is_err(), "{end}");
    }
    let mut lying = Vec::new();
    let mut encoder = png::Encoder::new(&mut lying, 16_384, 16_384);
    encoder.set_color(png::ColorType::Rgba);
    encoder.write_header().unwrap().write_chunk(png::chunk::IDAT, &[0x78, 0x9c]).unwrap();
    let error = read_image_bytes(&lying, Path::new("t")).unwrap_err().to_string();
    assert!(error.contains("16384x16384"), "{error}");
}

#[test]
fn png_of_other_color_types_is_read() {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 2, 1);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.write_header().unwrap().write_image_data(&[0, 128]).unwrap();
    // IEC 61966-2-1 of 128/255.
    assert_eq!(read(&bytes).color.unwrap(), [[0.0, 0.0, 0.0, 1.0], [0.215_860_5, 0.215_860_5, 0.215_860_5, 1.0]]);
    let error = read_image_bytes(b"GIF89a", Path::new("t.gif")).unwrap_err().to_string();
    assert!(error.contains("'GIF89a'") && error.contains("OpenEXR, PNG or JPEG"), "{error}");
}

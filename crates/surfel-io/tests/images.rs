//! Round trips of images: written and read back.

#![cfg(all(feature = "exr", feature = "jpeg"))]

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
        whole: Vec::new(),
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
fn exr_colors_beyond_the_range_of_f16_are_finite() {
    let color = Some(vec![[65_504.0, 65_520.0, -3e38, 1.0], [f32::MAX, f32::MIN, 0.5, 1.0]]);
    let planes = Planes { width: 2, height: 1, color, ..Planes::default() };
    let half = read(&exr(&planes, &ExrOptions::default())).color.unwrap();
    assert_eq!(half, [[65_504.0, 65_504.0, -65_504.0, 1.0], [65_504.0, -65_504.0, 0.5, 1.0]]);
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
    // Hash maps have a new seed each time, so that twenty attributes would almost never agree by chance.
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
    // A data window of 60000 × 60000 in a file of a few kilobytes.
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
    // Premultiplied: full red at half coverage, a grey, clipped highlights, nothing, and NaN.
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
        // Half a level of alpha, and of a colour whose slope is at most 2.4·1.055⁻¹ there.
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
fn png_texts_are_kept_as_text_chunks_that_every_reader_knows() {
    let entry = |key: &str, text: &str| (key.to_owned(), text.to_owned());
    let metadata = vec![entry("a:scene", "{\"x\": [1, 2]}"), entry("b", "naïve → ☃")];
    let mut bytes = Vec::new();
    let options = PngOptions { metadata: metadata.clone(), ..PngOptions::default() };
    write_png(&mut bytes, &planes().view(), &options).unwrap();
    assert_eq!(read(&bytes).metadata, metadata);
    let chunk =
        |kind: &[u8], start: &[u8]| bytes.windows(kind.len() + start.len()).any(|w| w == [kind, start].concat());
    assert!(chunk(b"tEXt", b"a:scene\0{") && chunk(b"iTXt", b"b\0"));
    let mut bare = Vec::new();
    write_png(&mut bare, &planes().view(), &PngOptions::default()).unwrap();
    assert_eq!((read(&bare).metadata, read(&bare).color), (Vec::new(), read(&bytes).color));
}

#[cfg(feature = "jpeg")]
#[test]
fn jpeg_is_blended_onto_its_background_and_reads_back_within_its_quality() {
    use surfel_io::{JpegOptions, write_jpeg};
    // Bands of 8×8 blocks, each of one colour, so that only rounding causes errors.
    let colors = [[0.5, 0.0, 0.0, 0.5], [0.2, 0.7, 0.1, 1.0], [0.0; 4], [f32::NAN; 4], [4.0, -1.0, 1.0, 1.0]];
    let color: Vec<[f32; 4]> = (0..40 * 8).map(|i| colors[i % 40 / 8]).collect();
    let planes = Planes { width: 40, height: 8, color: Some(color), ..Planes::default() };
    let written = |quality: u8| {
        let mut bytes = Vec::new();
        let options = JpegOptions { quality, background: [0.0, 0.25, 1.0] };
        write_jpeg(&mut bytes, &planes.view(), &options).map(|()| bytes)
    };
    let bytes = written(92).unwrap();
    assert_eq!(bytes, written(92).unwrap());
    assert!(bytes.starts_with(&[0xff, 0xd8, 0xff]));
    let found = read(&bytes).color.unwrap();
    // Expected values of C + (1 − alpha) · background.
    let expected = [[0.5, 0.125, 0.5], [0.2, 0.7, 0.1], [0.0, 0.25, 1.0], [0.0, 0.25, 1.0], [1.0, 0.0, 1.0]];
    for (band, expected) in expected.iter().enumerate() {
        let found = found[4 * 40 + band * 8 + 4];
        // Three levels of 255 where the encoding is steepest relative to linear light, with a slope of 2.3.
        let close = found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 3.0 * 2.3 / 255.0);
        assert!(close && found[3] == 1.0, "{band}: {found:?} {expected:?}");
    }
    let detailed = Planes { width: 40, height: 8, ..planes.clone() };
    let noise = (0..320_u32).map(|i| [(i.wrapping_mul(2_654_435_761) >> 24) as f32 / 255.0, 0.5, 0.5, 1.0]).collect();
    let detailed = Planes { color: Some(noise), ..detailed };
    let size = |quality: u8| {
        let mut bytes = Vec::new();
        write_jpeg(&mut bytes, &detailed.view(), &JpegOptions { quality, ..JpegOptions::default() }).unwrap();
        bytes.len()
    };
    assert!(size(20) < size(92) && size(92) < size(100));
    assert!(written(0).is_err() && written(101).is_err());
    let wide = Planes { width: 65_536, height: 1, color: Some(vec![[0.0; 4]; 65_536]), ..Planes::default() };
    let error = write_jpeg(&mut Vec::new(), &wide.view(), &JpegOptions::default()).unwrap_err().to_string();
    assert!(error.contains("65536x1") && error.contains("65535"), "{error}");
}

#[test]
fn png_truncated_or_lying_is_an_error() {
    let mut bytes = Vec::new();
    write_png(&mut bytes, &planes().view(), &PngOptions::default()).unwrap();
    // All chunks except the end chunk are required.
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
    assert!(error.contains("'GIF89a'") && error.contains("OpenEXR, PNG, JPEG or WebP"), "{error}");
}

/// WebP file in hexadecimal: 8×8 texels of (200, 100, 50), lossy.
#[cfg(feature = "webp")]
const WEBP: &str = "524946463a00000057454250565038202e000000f001009d012a0800080001402625a00274ba01f80004c80000\
                    feae17ff36040cd0fa60ffd26cf136789b3e398000";

#[cfg(feature = "webp")]
#[test]
fn webp_is_read_and_its_size_is_held_against_its_bytes() {
    let mut bytes: Vec<u8> =
        (0..WEBP.len()).step_by(2).map(|i| u8::from_str_radix(&WEBP[i..i + 2], 16).unwrap()).collect();
    let image = read(&bytes);
    assert_eq!((image.width, image.height), (8, 8));
    let color = image.color.unwrap();
    // Lossy: a tolerance of two levels of 255, where one level is 0.009 of light.
    let expected = [200.0, 100.0, 50.0].map(|level| surfel_math::srgb::decode(level / 255.0) as f32);
    for texel in color {
        assert!(texel[3] == 1.0 && (0..3).all(|k| (texel[k] - expected[k]).abs() < 0.02), "{texel:?}");
    }
    // The key frame's header has 14 bits each for width and height.
    let at = bytes.windows(3).position(|w| w == [0x9d, 0x01, 0x2a]).unwrap() + 3;
    bytes[at..at + 4].copy_from_slice(&[0xff, 0x3f, 0xff, 0x3f]);
    let error = read_image_bytes(&bytes, Path::new("t.webp")).unwrap_err().to_string();
    assert!(error.contains("says that it has 16383x16383 pixels, but is"), "{error}");
}

/// Encodes a baseline JPEG of 8×8 texels of one colour. The colour is given as differences of (Y, Cb, Cr) or of a grey
/// from 128, each −127 to 127.
fn jpeg(levels: &[i32]) -> Vec<u8> {
    let mut bytes = vec![0xff, 0xd8];
    let mut segment = |marker: u8, data: &[u8]| {
        bytes.extend([0xff, marker]);
        bytes.extend((data.len() as u16 + 2).to_be_bytes());
        bytes.extend(data);
    };
    // Quantisation steps of 8, so that the coefficient of a block's mean is the level itself.
    segment(0xdb, &[&[0][..], &[8; 64]].concat());
    let n = levels.len() as u8;
    let components: Vec<u8> = (1..=n).flat_map(|id| [id, 0x11, 0]).collect();
    segment(0xc0, &[&[8, 0, 8, 0, 8, n][..], &components].concat());
    // Huffman codes: four bits for each bit length, 0 to 7, of the means; one bit for the end of a block, the only
    // other symbol.
    segment(0xc4, &[&[0, 0, 0, 0, 8][..], &[0; 12], &[0, 1, 2, 3, 4, 5, 6, 7]].concat());
    segment(0xc4, &[&[0x10, 1][..], &[0; 15], &[0]].concat());
    let scan: Vec<u8> = (1..=n).flat_map(|id| [id, 0]).collect();
    segment(0xda, &[&[n][..], &scan, &[0, 63, 0]].concat());
    let mut bits = String::new();
    for &level in levels {
        let size = (32 - level.unsigned_abs().leading_zeros()) as usize;
        let value = if level < 0 { level + (1 << size) - 1 } else { level };
        bits += &format!("{size:04b}");
        bits += &if size > 0 { format!("{value:0size$b}") } else { String::new() };
        bits.push('0');
    }
    while !bits.len().is_multiple_of(8) {
        bits.push('1');
    }
    bytes.extend((0..bits.len()).step_by(8).map(|i| u8::from_str_radix(&bits[i..i + 8], 2).unwrap()));
    bytes.extend([0xff, 0xd9]);
    bytes
}

#[test]
fn jpeg_in_color_and_grey_is_read() {
    // R = Y + 1.402 Cr, G = Y - 0.344 Cb - 0.714 Cr, B = Y + 1.772 Cb (JFIF).
    for (levels, expected) in [(&[-44, -14, 82][..], [199, 30, 59]), (&[0], [128; 3]), (&[-100], [28; 3])] {
        let bytes = jpeg(levels);
        let image = read(&bytes);
        assert_eq!((image.width, image.height), (8, 8));
        let color = image.color.unwrap();
        assert_eq!(color.len(), 64);
        for texel in color {
            for (found, level) in texel.iter().zip(expected) {
                let encoded = surfel_math::srgb::encode(f64::from(*found)) * 255.0;
                assert!((encoded - f64::from(level)).abs() < 1.5, "{texel:?} {expected:?}");
            }
            assert_eq!(texel[3], 1.0);
        }
        // Without its scan there is no image.
        let header = bytes.windows(2).position(|w| w == [0xff, 0xda]).unwrap();
        assert!((0..=header).all(|end| read_image_bytes(&bytes[..end], Path::new("t")).is_err()));
    }
}

/// Encodes a PNG of two texels, and reads it back as linear premultiplied RGBA.
fn png_texels(color: png::ColorType, depth: png::BitDepth, data: &[u8], palette: &[u8], trns: &[u8]) -> Vec<[f32; 4]> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 2, 1);
    encoder.set_color(color);
    encoder.set_depth(depth);
    if !palette.is_empty() {
        encoder.set_palette(palette.to_vec());
    }
    if !trns.is_empty() {
        encoder.set_trns(trns.to_vec());
    }
    encoder.write_header().unwrap().write_image_data(data).unwrap();
    read(&bytes).color.unwrap()
}

#[test]
fn png_of_16_bits_palettes_and_transparent_colors_is_read() {
    use png::{BitDepth as Depth, ColorType as Color};
    // IEC 61966-2-1 of 0x8000/65535, and of 128/255.
    let (half, coarse) = (0.214_049_28, 0.215_860_5);
    let data = [0x80, 0, 0x80, 0, 255, 255, 255, 255];
    let grey = png_texels(Color::GrayscaleAlpha, Depth::Sixteen, &data, &[], &[]);
    assert!((grey[0][0] - half / 2.0).abs() < 1e-5 && (grey[0][3] - 0.5).abs() < 1e-4, "{grey:?}");
    assert_eq!(grey[1], [1.0; 4]);
    let palette = png_texels(Color::Indexed, Depth::Two, &[0b0100_0000], &[255, 0, 0, 0, 128, 0], &[255, 0]);
    assert_eq!(palette, [[0.0; 4], [1.0, 0.0, 0.0, 1.0]]);
    let bits = png_texels(Color::Grayscale, Depth::One, &[0b0100_0000], &[], &[]);
    assert_eq!(bits, [[0.0, 0.0, 0.0, 1.0], [1.0; 4]]);
    let key = png_texels(Color::Rgb, Depth::Eight, &[1, 2, 3, 128, 128, 128], &[], &[0, 1, 0, 2, 0, 3]);
    assert_eq!(key, [[0.0; 4], [coarse, coarse, coarse, 1.0]]);
}

#[test]
fn whole_numbers_and_positions_are_kept() {
    let ids = vec![0, 16_777_217, 4_294_967_294, 4_294_967_295];
    let whole = vec![("index".to_owned(), ids.clone()), ("object".to_owned(), vec![3; 4])];
    let planes = Planes { width: 2, height: 2, whole, ..Planes::default() };
    let far = [[4_500_000.062_5, -7_100_000.0, f64::INFINITY]; 4];
    let view = surfel_io::PlanesView { position: Some(&far), ..planes.view() };
    let mut bytes = Vec::new();
    write_exr(&mut bytes, &view, &ExrOptions::default()).unwrap();
    let back = read(&bytes);
    assert_eq!(back.whole, planes.whole);
    let [x, y, z] =
        ["position.X", "position.Y", "position.Z"].map(|name| back.other.iter().find(|(n, _)| n == name).unwrap().1[0]);
    // EXR has only f32.
    assert_eq!((x, y, z), (4_500_000.0, -7_100_000.0, f32::INFINITY));
    let mut npz = Vec::new();
    surfel_io::write_npz(&mut npz, &view).unwrap();
    assert!(npz.windows(8).any(|w| w == far[0][0].to_le_bytes()), "f64 in full");
    assert!(npz.windows(16).any(|w| w == ids.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>()));
    // An integer plane of another size, or no plane at all, is refused.
    let short = Planes { whole: vec![("index".into(), vec![1])], ..planes };
    assert!(write_exr(&mut Vec::new(), &short.view(), &ExrOptions::default()).is_err());
    let none = Planes { width: 2, height: 2, ..Planes::default() };
    assert!(surfel_io::write_npz(&mut Vec::new(), &none.view()).is_err());
}

#[cfg(feature = "geotiff")]
#[test]
fn tiles_become_a_tiff_with_their_samples() {
    use std::fs::File;
    use std::io::BufReader;
    use surfel_io::{PlanesView, Tile, save_png, stitch};
    let folder = tempfile::tempdir().unwrap();
    // Two strips of 1 MiB and a shorter one; more strips with 16 bits.
    let (width, edges) = (603, [0, 301, 640, 947]);
    let color = |x: u32, y: u32| {
        let alpha = if x.is_multiple_of(7) { 0.0 } else { 0.25 + 0.75 * y as f32 / 947.0 };
        [x as f32 / 603.0, y as f32 / 947.0, ((x * 31 + y * 17) % 97) as f32 / 97.0, 1.0].map(|c| c * alpha)
    };
    for depth in [BitDepth::Eight, BitDepth::Sixteen] {
        let options = PngOptions { depth, ..PngOptions::default() };
        let save = |name: &str, from: u32, to: u32| {
            let pixels: Vec<_> = (from..to).flat_map(|y| (0..width).map(move |x| color(x, y))).collect();
            let planes = PlanesView { width, height: to - from, color: Some(&pixels), ..PlanesView::default() };
            let path = folder.path().join(name);
            save_png(&path, true, &planes, &options).unwrap();
            path
        };
        let tiles: Vec<Tile> = (edges.windows(2))
            .map(|e| {
                let path = save(&format!("{}.png", e[0]), e[0], e[1]);
                let header = surfel_io::read_image_header(&path).unwrap();
                Tile { path, x: 0, y: e[0], header }
            })
            .collect();
        let whole = folder.path().join("whole.TIF");
        stitch(&whole, true, [width, 947], &tiles, &[]).unwrap();
        let mut png = png::Decoder::new(BufReader::new(File::open(save("whole.png", 0, 947)).unwrap()));
        png.set_transformations(png::Transformations::IDENTITY);
        let mut png = png.read_info().unwrap();
        let mut expected = vec![0; png.output_buffer_size().unwrap()];
        png.next_frame(&mut expected).unwrap();
        let mut tiff = tiff::decoder::Decoder::new(BufReader::new(File::open(&whole).unwrap())).unwrap();
        assert_eq!(tiff.dimensions().unwrap(), (width, 947));
        let bits = if depth == BitDepth::Eight { 8 } else { 16 };
        assert_eq!(tiff.colortype().unwrap(), tiff::ColorType::RGBA(bits));
        let found: Vec<u8> = match tiff.read_image().unwrap() {
            tiff::decoder::DecodingResult::U8(samples) => samples,
            tiff::decoder::DecodingResult::U16(samples) => samples.into_iter().flat_map(u16::to_be_bytes).collect(),
            other => panic!("{other:?}"),
        };
        assert!(found == expected, "{bits} bits");
        // A missing tile leaves the file unchanged.
        let before = std::fs::read(&whole).unwrap();
        assert!(stitch(&whole, true, [width, 947], &tiles[1..], &[]).is_err());
        assert!(std::fs::read(&whole).unwrap() == before);
    }
}

//! Tests that decoded pixels of small files equal, to the bit, those that Surfel 0.2.0 decoded, which called the codecs
//! `png`, `zune-jpeg` and `image-webp` directly.

use std::path::Path;
use surfel_images::read_image_bytes;

/// Name of a test file, its width and height in pixels, and the FNV-1a hash of its linear premultiplied pixels.
type Expected = (&'static str, [u32; 2], u64);

/// PNG of all colour types, with transparent key colours, palettes, gamma and profile, some interlaced; WebP lossy and
/// lossless.
const EXACT: [Expected; 17] = [
    ("animated.png", [3, 9], 0x9b57_7bc3_6be4_b526),
    ("animated.webp", [3, 9], 0x63f6_1e0a_63e5_bd1c),
    ("grey-1-interlaced.png", [3, 9], 0x54f7_e983_b1f0_6d05),
    ("grey-16-interlaced.png", [3, 9], 0x0985_685a_7289_c4bf),
    ("grey-4-key.png", [3, 9], 0x66f0_9b48_37d1_7d5b),
    ("grey-alpha-16-interlaced.png", [3, 9], 0x21a6_1031_61b4_bb6b),
    ("grey-alpha-8.png", [3, 9], 0xa6a0_4cba_ffe3_4f63),
    ("lossless-alpha.webp", [3, 9], 0x9b57_7bc3_6be4_b526),
    ("lossless.webp", [3, 9], 0x5b2f_5d93_2b03_495d),
    ("lossy-alpha.webp", [37, 23], 0x7bc3_ac6d_2120_6447),
    ("lossy.webp", [37, 23], 0x8651_976c_c0c4_8946),
    ("palette-2-alpha-interlaced.png", [3, 9], 0xae8e_1c05_ebff_2a11),
    ("palette-8.png", [3, 9], 0xaeed_7e2c_b085_360f),
    ("rgb-16-key.png", [3, 9], 0x8c58_f4d8_144f_0da5),
    ("rgb-8-key-interlaced.png", [3, 9], 0x56f6_b6f3_4a12_b47b),
    ("rgba-16-gamma-profile.png", [3, 9], 0x28ac_5dac_966a_68c6),
    ("rgba-8-interlaced.png", [3, 9], 0x9b57_7bc3_6be4_b526),
];

/// JPEG: baseline and progressive; grey, YCbCr, RGB, CMYK and YCCK; subsampled chroma, restart markers, a profile.
const JPEG: [Expected; 8] = [
    ("420.jpg", [37, 23], 0xe655_a01d_64ec_77f5),
    ("422-progressive-profile.jpg", [37, 23], 0xb70b_cd1b_9f0d_3cdd),
    ("cmyk-progressive.jpg", [3, 9], 0xc6b1_88d8_b5e0_428a),
    ("cmyk.jpg", [3, 9], 0xc6b1_88d8_b5e0_428a),
    ("grey-progressive.jpg", [37, 23], 0x6fa4_d8e7_207b_1772),
    ("restarts.jpg", [37, 23], 0xd4ec_5129_5a09_2bc2),
    ("rgb.jpg", [37, 23], 0x3301_d829_b6ee_8eb1),
    ("ycck.jpg", [3, 9], 0x97c5_ba79_2389_3be1),
];

#[test]
fn png_and_webp_are_decoded_to_the_bit() {
    let is_built_in = |(name, ..): &Expected| cfg!(feature = "webp") || name.ends_with(".png");
    EXACT.into_iter().filter(is_built_in).for_each(check);
}

/// Runs on x86-64 only, because JPEG decoders may round differently on other processors.
#[cfg(all(feature = "jpeg", target_arch = "x86_64"))]
#[test]
fn jpeg_is_decoded_to_the_bit() {
    JPEG.into_iter().for_each(check);
}

fn check((name, size, expected): Expected) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name);
    let image = read_image_bytes(&std::fs::read(&path).unwrap(), &path).unwrap();
    assert_eq!([image.width, image.height], size, "{name}");
    let color = image.color.unwrap();
    let bytes = color.iter().flatten().flat_map(|c| c.to_bits().to_le_bytes());
    // FNV-1a.
    let hash = bytes.fold(0xcbf2_9ce4_8422_2325_u64, |h, b| (h ^ u64::from(b)).wrapping_mul(0x100_0000_01b3));
    assert_eq!(hash, expected, "{name}: {hash:016x}");
}

/// Cut and mutated files give an image or an error, but no panic.
#[test]
fn damaged_images_are_read_or_refused() {
    let mut state = 1_u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize
    };
    for (name, ..) in EXACT.into_iter().chain(JPEG) {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name);
        let whole = std::fs::read(&path).unwrap();
        for end in (0..whole.len()).step_by(17) {
            drop(read_image_bytes(&whole[..end], &path));
        }
        for _ in 0..200 {
            let mut bytes = whole.clone();
            for _ in 0..1 + random() % 4 {
                let at = random() % bytes.len();
                bytes[at] = random() as u8;
            }
            drop(read_image_bytes(&bytes, &path));
        }
    }
}

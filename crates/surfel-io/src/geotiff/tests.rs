//! Round trips: images are written, and read by another decoder.

use super::*;
use crate::color::linear_of_8_bit;
use tiff::decoder::{Decoder, DecodingResult};
use tiff::tags::Tag;

/// Returns a file path for one test.
fn file(name: &str) -> PathBuf {
    std::env::temp_dir().join(format!("surfel-geotiff-{name}-{}.tif", std::process::id()))
}

fn image(name: &str, size: [u32; 2], samples: GeoSamples) -> GeoImage {
    let crs = Some(Crs::of_epsg(25_832));
    let left_top = [637_000.1, 4_851_300.3];
    let software = "surfel test".into();
    GeoImage { path: file(name), size, samples, bands: vec![], has_marks: false, left_top, pixel: 0.1, crs, software }
}

#[test]
fn rectangles_in_any_order_make_the_image_and_what_is_not_written_is_no_data() {
    let size = [700, 300];
    let dsm = image("order", size, GeoSamples::F32(1));
    let rgb = GeoImage { path: file("order-rgb"), samples: GeoSamples::Rgba8, ..dsm.clone() };
    let value = |x: u32, y: u32| 1000.0 + x as f32 * 0.37 - y as f32 * 1.25;
    let color = |x: u32, y: u32| [x as u8, y as u8, (x ^ y) as u8, 255];
    let linear = |[r, g, b, _]: [u8; 4]| {
        let [r, g, b] = [r, g, b].map(|level| linear_of_8_bit()[usize::from(level)]);
        [r, g, b, 1.0]
    };
    // Blocks of 200 pixels from column 30 on, the last first; columns 0 to 29 are never written.
    let done: Result<(), IoError> = write_geotiffs(&[dsm.clone(), rgb.clone()], true, |tiles| {
        for y in (0..size[1]).step_by(200).rev() {
            for x in (30..size[0]).step_by(200).rev() {
                let (w, h) = ((size[0] - x).min(200), (size[1] - y).min(200));
                let of = |i: u32| (x + i % w, y + i / w);
                let numbers: Vec<f32> = (0..w * h).map(|i| value(of(i).0, of(i).1)).collect();
                tiles[0].write_f32([x, y], w, &numbers, &[])?;
                let colors: Vec<[f32; 4]> = (0..w * h).map(|i| linear(color(of(i).0, of(i).1))).collect();
                tiles[1].write_color([x, y], w, &colors, &[])?;
            }
        }
        Ok(())
    });
    done.unwrap();
    let mut decoder = Decoder::new(File::open(&dsm.path).unwrap()).unwrap();
    let DecodingResult::F32(numbers) = decoder.read_image().unwrap() else { panic!() };
    let mut of_rgb = Decoder::new(File::open(&rgb.path).unwrap()).unwrap();
    let DecodingResult::U8(colors) = of_rgb.read_image().unwrap() else { panic!() };
    for (i, (number, rgba)) in numbers.iter().zip(colors.chunks_exact(4)).enumerate() {
        let (x, y) = (i as u32 % size[0], i as u32 / size[0]);
        let written = x >= 30;
        assert_eq!(*number, if written { value(x, y) } else { GeoSamples::NODATA }, "{x} {y}");
        assert_eq!(rgba, if written { color(x, y) } else { [0; 4] }, "{x} {y}");
    }
    assert_eq!((numbers.len(), colors.len()), (210_000, 840_000));
    let mut tag = |tag| decoder.get_tag(tag).unwrap();
    assert_eq!(tag(Tag::ModelTiepointTag).into_f64_vec().unwrap()[3..5], [637_000.1, 4_851_300.3]);
    assert_eq!(tag(Tag::ModelPixelScaleTag).into_f64_vec().unwrap(), [0.1, 0.1, 0.0]);
    assert_eq!(tag(Tag::GeoKeyDirectoryTag).into_u16_vec().unwrap()[12..], [3072, 0, 1, 25_832]);
    assert_eq!(tag(Tag::GdalNodata).into_string().unwrap(), "-9999");
    for path in [dsm.path, rgb.path] {
        std::fs::remove_file(path).unwrap();
    }
}

#[test]
fn large_image_is_a_bigtiff_and_its_empty_tiles_are_one() {
    let large = image("big", [60_000, 60_000], GeoSamples::F32(1));
    let done: Result<(), IoError> = write_geotiffs(std::slice::from_ref(&large), true, |tiles| {
        tiles[0].write_f32([59_999, 59_999], 1, &[7.0], &[])
    });
    done.unwrap();
    let bytes = std::fs::read(&large.path).unwrap();
    assert_eq!((bytes[2..4] == 43_u16.to_le_bytes(), bytes.len() < 2_000_000), (true, true), "{}", bytes.len());
    let mut decoder = Decoder::new(File::open(&large.path).unwrap()).unwrap();
    let DecodingResult::F32(last) = decoder.read_chunk(235 * 235 - 1).unwrap() else { panic!() };
    // The image's edges cut the last tile.
    assert_eq!((last.last(), last[0]), (Some(&7.0), GeoSamples::NODATA));
    std::fs::remove_file(&large.path).unwrap();
}

#[test]
fn failed_drawing_leaves_no_file_and_rectangles_stay_inside() {
    let one = image("failed", [10, 10], GeoSamples::F32(3));
    let outside = |at, width, count: usize| {
        let done: Result<(), IoError> = write_geotiffs(std::slice::from_ref(&one), true, |tiles| {
            tiles[0].write_f32(at, width, &vec![0.0; count], &[])
        });
        (done.is_err(), one.path.exists())
    };
    assert_eq!(outside([1, 0], 10, 30), (true, false));
    assert_eq!(outside([0, 10], 10, 30), (true, false));
    assert_eq!(outside([0, 0], 10, 31), (true, false));
    assert_eq!(outside([u32::MAX, 0], 10, 30), (true, false));
    assert_eq!(outside([0, 0], 10, 30), (false, true));
    std::fs::remove_file(&one.path).unwrap();
}

/// Returns the little-endian 16-bit number at the byte offset `at`.
fn u16_at(bytes: &[u8], at: usize) -> usize {
    u16::from_le_bytes([bytes[at], bytes[at + 1]]).into()
}

fn u32_at(bytes: &[u8], at: usize) -> usize {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize
}

/// Returns the byte offsets of the directories of a classic TIFF, in the order of their links. Also returns the offset
/// at which the entries of the last directory end.
fn directories(bytes: &[u8]) -> (Vec<usize>, usize) {
    let (mut found, mut at, mut end) = (Vec::new(), u32_at(bytes, 4), 0);
    while at != 0 {
        found.push(at);
        end = at + 2 + 12 * u16_at(bytes, at) + 4;
        at = u32_at(bytes, end - 4);
    }
    (found, end)
}

/// Returns width and height in pixels, decoded pixels, and tile offsets of the image, then of each overview.
fn images(path: &Path) -> Vec<([u32; 2], DecodingResult, Vec<u64>)> {
    let mut decoder = Decoder::new(File::open(path).unwrap()).unwrap();
    let mut all = Vec::new();
    loop {
        let (width, height) = decoder.dimensions().unwrap();
        let numbers = decoder.read_image().unwrap();
        all.push(([width, height], numbers, decoder.get_tag_u64_vec(Tag::TileOffsets).unwrap()));
        if !decoder.more_images() {
            return all;
        }
        decoder.next_image().unwrap();
    }
}

#[test]
fn files_are_cloud_optimised() {
    let dsm = image("cog", [1030, 600], GeoSamples::F32(1));
    let rgb = GeoImage { path: file("cog-rgb"), samples: GeoSamples::Rgba8, ..dsm.clone() };
    let done: Result<(), IoError> = write_geotiffs(&[dsm.clone(), rgb.clone()], true, |tiles| {
        // Only the west is written: tiles in the east are never begun.
        for y in (0..600).step_by(100) {
            let numbers: Vec<f32> = (0..40_000).map(|i| (i % 400) as f32 + (y + i / 400) as f32 * 0.5).collect();
            tiles[0].write_f32([0, y], 400, &numbers, &[])?;
            tiles[1].write_color([0, y], 400, &[[0.2, 0.4, 0.6, 1.0]; 40_000], &[])?;
            tiles.iter_mut().try_for_each(|tiles| tiles.done_above(y + 100))?;
        }
        Ok(())
    });
    done.unwrap();
    for path in [&dsm.path, &rgb.path] {
        let bytes = std::fs::read(path).unwrap();
        // Order: header, GDAL's structural metadata, directories, tile lists, tiles.
        let (found, end) = directories(&bytes);
        assert!(bytes[8..].starts_with(b"GDAL_STRUCTURAL_METADATA_SIZE=000055 bytes\nLAYOUT=IFDS_BEFORE_DATA\n"));
        assert!(found[0] < 300 && found.is_sorted() && found.iter().all(|at| at % 2 == 0), "{found:?}");
        let images = images(path);
        let sizes: Vec<[u32; 2]> = images.iter().map(|image| image.0).collect();
        assert_eq!(sizes, [[1030, 600], [515, 300], [258, 150], [129, 75]]);
        // The smallest overview's tiles are first, row by row; empty tiles share one offset.
        let mut before = end as u64;
        for (_, _, offsets) in images.iter().rev() {
            let mut seen: Vec<u64> = offsets.clone();
            let mut known = std::collections::BTreeSet::new();
            seen.retain(|offset| known.insert(*offset));
            assert!(seen.is_sorted() && seen[0] > before, "{offsets:?} after {before}");
            before = *seen.last().unwrap();
        }
        assert_eq!((images[0].2.len(), images[0].2[2]), (15, images[0].2[4]));
    }
    std::fs::remove_file(&dsm.path).unwrap();
    std::fs::remove_file(&rgb.path).unwrap();
}

#[test]
fn overviews_are_means_of_what_is_data() {
    let dsm = image("overviews", [515, 301], GeoSamples::F32(1));
    let rgb = GeoImage { path: file("overviews-rgb"), samples: GeoSamples::Rgba8, ..dsm.clone() };
    let normals = GeoImage { path: file("overviews-n"), samples: GeoSamples::F32(3), ..dsm.clone() };
    // Half of every four pixels is no data.
    let is_data = |x: u32, y: u32| (x + y).is_multiple_of(2);
    let number = |x: u32, y: u32| if is_data(x, y) { (x * 3 + y * 7) as f32 } else { GeoSamples::NODATA };
    let of = |i: u32| (i % 515, i / 515);
    let done: Result<(), IoError> = write_geotiffs(&[dsm.clone(), rgb.clone(), normals.clone()], true, |tiles| {
        let numbers: Vec<f32> = (0..515 * 301).map(|i| number(of(i).0, of(i).1)).collect();
        tiles[0].write_f32([0, 0], 515, &numbers, &[])?;
        let light = |x: u32| if x.is_multiple_of(2) { [1.0, 0.0, 0.0, 1.0] } else { [0.0, 1.0, 0.0, 1.0] };
        let colors: Vec<[f32; 4]> = (0..515 * 301).map(|i| light(of(i).0)).collect();
        tiles[1].write_color([0, 0], 515, &colors, &[])?;
        let lean = |x: u32| if x.is_multiple_of(2) { [0.6, 0.0, 0.8] } else { [-0.6, 0.0, 0.8] };
        let leaning: Vec<f32> = (0..515 * 301).flat_map(|i| lean(of(i).0)).collect();
        tiles[2].write_f32([0, 0], 515, &leaning, &[])
    });
    done.unwrap();
    let [heights, colors, normals_found] = [&dsm, &rgb, &normals].map(|image| images(&image.path));
    let (DecodingResult::F32(half), DecodingResult::U8(levels), DecodingResult::F32(normal)) =
        (&heights[1].1, &colors[1].1, &normals_found[1].1)
    else {
        panic!()
    };
    assert_eq!((heights[1].0, half.len()), ([258, 151], 258 * 151));
    for (x, y) in [(0, 0), (100, 70), (257, 20), (0, 150), (257, 150)] {
        let four = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(dx, dy)| (2 * x + dx, 2 * y + dy));
        let data: Vec<f32> = four
            .into_iter()
            .filter(|(x, y)| *x < 515 && *y < 301 && is_data(*x, *y))
            .map(|(x, y)| number(x, y))
            .collect();
        let mean = data.iter().sum::<f32>() / data.len() as f32;
        assert_eq!(half[(y * 258 + x) as usize], mean, "{x} {y}");
    }
    // Half of the light of red and half of that of green, not half of their levels; the last column is red alone.
    assert_eq!(levels[..4], [188, 188, 0, 255]);
    assert_eq!(levels[257 * 4..258 * 4], [255, 0, 0, 255]);
    assert_eq!(normal[..3], [0.0, 0.0, 1.0]);
    for image in [dsm, rgb, normals] {
        std::fs::remove_file(image.path).unwrap();
    }
}

#[test]
fn marks_are_a_last_band_of_their_own() {
    let dsm = image("marks", [300, 2], GeoSamples::F32(1));
    let dsm = GeoImage { has_marks: true, bands: vec!["height", "filled"], ..dsm };
    let rgb = GeoImage { path: file("marks-rgb"), samples: GeoSamples::Rgba8, bands: vec![], ..dsm.clone() };
    let marked: Vec<bool> = (0..600).map(|i| i % 3 == 0).collect();
    let done: Result<(), IoError> = write_geotiffs(&[dsm.clone(), rgb.clone()], true, |tiles| {
        let numbers: Vec<f32> = (0..600).map(|i| if i == 1 { GeoSamples::NODATA } else { i as f32 }).collect();
        tiles[0].write_f32([0, 0], 300, &numbers, &marked)?;
        tiles[1].write_color([0, 0], 300, &[[1.0; 4]; 600], &marked)
    });
    done.unwrap();
    let DecodingResult::F32(numbers) = &images(&dsm.path)[0].1 else { panic!() };
    assert_eq!(numbers[..8], [0.0, 1.0, GeoSamples::NODATA, GeoSamples::NODATA, 2.0, 0.0, 3.0, 1.0]);
    // The decoder returns 0 for the fifth band of colours, so it is decoded by hand.
    let mut decoder = Decoder::new(File::open(&rgb.path).unwrap()).unwrap();
    let offset = decoder.get_tag_u64_vec(Tag::TileOffsets).unwrap()[0] as usize;
    let mut row = vec![0; 256 * 5];
    flate2::read::ZlibDecoder::new(&std::fs::read(&rgb.path).unwrap()[offset..]).read_exact(&mut row).unwrap();
    for i in 5..row.len() {
        row[i] = row[i].wrapping_add(row[i - 5]);
    }
    for (i, pixel) in row.chunks_exact(5).enumerate() {
        assert_eq!(pixel, [255, 255, 255, 255, if i % 3 == 0 { 255 } else { 0 }], "{i}");
    }
    let mut decoder = Decoder::new(File::open(&dsm.path).unwrap()).unwrap();
    let metadata = decoder.get_tag(Tag::Unknown(42_112)).unwrap().into_string().unwrap();
    assert!(metadata.contains(r#"sample="1" role="description">filled<"#), "{metadata}");
    for image in [dsm, rgb] {
        std::fs::remove_file(image.path).unwrap();
    }
}

#[test]
fn tiles_of_finished_rows_leave_memory_whatever_was_drawn_of_them() {
    let sparse = image("sparse", [4096, 4096], GeoSamples::F32(1));
    let done: Result<(), IoError> = write_geotiffs(std::slice::from_ref(&sparse), true, |tiles| {
        for y in (0..4096).step_by(64) {
            // One pixel of a block, and not in every block.
            for x in (0..4096).step_by(512) {
                tiles[0].write_f32([x + y % 512, y], 1, &[1.0], &[])?;
            }
            tiles[0].done_above(y + 64)?;
            let begun: usize = tiles[0].levels.iter().map(|level| level.begun.len()).sum();
            assert!(begun <= 32, "{begun} at {y}");
        }
        Ok(())
    });
    done.unwrap();
    let found = images(&sparse.path);
    let DecodingResult::F32(last) = &found.last().unwrap().1 else { panic!() };
    assert!(last.iter().filter(|v| **v == 1.0).count() > 200);
    std::fs::remove_file(&sparse.path).unwrap();
}

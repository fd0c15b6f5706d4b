//! GeoTIFF (OGC 19-008r4) images, written rectangle by rectangle in any order: tiled, deflated, north up, as BigTIFF
//! where 4 GiB may not be enough. What was never written is no data.

use crate::atomic::Pending;
use crate::crs::Crs;
use crate::error::{IoError, WRITE};
use flate2::Compression;
use flate2::write::ZlibEncoder;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use surfel_math::srgb::nearest_8_bit;
use tiff::TiffError;
use tiff::encoder::{DirectoryEncoder, TiffEncoder, TiffKind, TiffKindBig, TiffKindStandard};
use tiff::tags::Tag;

/// Side of a tile in pixels.
const TILE: u32 = 256;
/// Deflate's level: 3 makes heights 6 % smaller, and writing them takes 1.7 times as long.
const LEVEL: u32 = 1;
/// Raw bytes from which a file is a BigTIFF: deflate adds less than one byte in a thousand.
const BIG_FROM: u64 = 4_200_000_000;

/// What a pixel holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GeoSamples {
    /// Red, green, blue (sRGB-encoded) and straight alpha, 8 bits each. No data is alpha 0.
    Rgba8,
    /// So many numbers, f32. No data is [`GeoSamples::NODATA`].
    F32(u16),
}

impl GeoSamples {
    /// The number that stands for no data in f32 images.
    pub const NODATA: f32 = -9999.0;

    fn count(self) -> usize {
        match self {
            Self::Rgba8 => 4,
            Self::F32(count) => count.into(),
        }
    }

    /// Bytes of a pixel.
    fn bytes(self) -> usize {
        match self {
            Self::Rgba8 => 4,
            Self::F32(count) => 4 * usize::from(count),
        }
    }
}

/// An image to be written, and where it lies.
#[derive(Clone, Debug, PartialEq)]
pub struct GeoImage {
    /// The file.
    pub path: PathBuf,
    /// Columns and rows, at least 1.
    pub size: [u32; 2],
    /// What a pixel holds.
    pub samples: GeoSamples,
    /// x of the image's left edge, y of its upper edge.
    pub left_top: [f64; 2],
    /// Side of a pixel, in the units of x and y.
    pub pixel: f64,
    /// The coordinate reference system.
    pub crs: Option<Crs>,
    /// The program that writes it.
    pub software: String,
}

/// The open image that rectangles are written to.
pub struct GeoTiles<'a, 'file> {
    image: &'a GeoImage,
    directory: Directory<'a, 'file>,
    /// Tiles that have some of their pixels, and how many.
    begun: BTreeMap<(u32, u32), (Vec<u8>, usize)>,
    offsets: Vec<u64>,
    lengths: Vec<u64>,
}

type Sink<'a> = &'a mut BufWriter<File>;

enum Encoder<'a> {
    Classic(TiffEncoder<Sink<'a>, TiffKindStandard>),
    Big(TiffEncoder<Sink<'a>, TiffKindBig>),
}

enum Directory<'a, 'file> {
    Classic(DirectoryEncoder<'a, Sink<'file>, TiffKindStandard>),
    Big(DirectoryEncoder<'a, Sink<'file>, TiffKindBig>),
}

/// Writes images together: `draw` fills their tiles, in the order of `images`. They appear when all are whole.
///
/// # Errors
/// [`IoError::Exists`] if a file is there and `overwrite` is false, before anything is drawn; [`IoError::System`] where
/// one can't be written; and what `draw` says.
pub fn write_geotiffs<E: From<IoError>>(
    images: &[GeoImage],
    overwrite: bool,
    draw: impl FnOnce(&mut [GeoTiles<'_, '_>]) -> Result<(), E>,
) -> Result<(), E> {
    let mut files = images.iter().map(|i| Pending::new(&i.path, overwrite)).collect::<Result<Vec<_>, IoError>>()?;
    let mut encoders = Vec::with_capacity(images.len());
    for (image, file) in images.iter().zip(&mut files) {
        encoders.push(Encoder::new(image, &mut file.sink).map_err(|e| failed(&image.path, e))?);
    }
    let mut tiles = Vec::with_capacity(images.len());
    for (image, encoder) in images.iter().zip(&mut encoders) {
        tiles.push(GeoTiles::new(image, encoder).map_err(|e| failed(&image.path, e))?);
    }
    draw(&mut tiles)?;
    for (image, tiles) in images.iter().zip(tiles) {
        tiles.finish().map_err(|e| failed(&image.path, e))?;
    }
    drop(encoders);
    files.into_iter().try_for_each(Pending::publish)?;
    Ok(())
}

fn failed(path: &Path, error: TiffError) -> IoError {
    let source = match error {
        TiffError::IoError(source) => source,
        other => io::Error::other(other),
    };
    IoError::System { path: path.to_path_buf(), action: WRITE, source }
}

impl<'a> Encoder<'a> {
    fn new(image: &GeoImage, sink: Sink<'a>) -> Result<Self, TiffError> {
        let [columns, rows] = tile_counts(image.size).map(u64::from);
        let bytes = columns * rows * u64::from(TILE * TILE) * image.samples.bytes() as u64;
        Ok(if bytes < BIG_FROM {
            Self::Classic(TiffEncoder::new(sink)?)
        } else {
            Self::Big(TiffEncoder::new_big(sink)?)
        })
    }
}

fn tile_counts(size: [u32; 2]) -> [u32; 2] {
    size.map(|side| side.div_ceil(TILE))
}

/// Runs the same on a directory of either kind.
macro_rules! with {
    ($directory:expr, $name:ident => $body:expr) => {
        match $directory {
            Directory::Classic($name) => $body,
            Directory::Big($name) => $body,
        }
    };
}

impl<'a, 'file> GeoTiles<'a, 'file> {
    fn new(image: &'a GeoImage, encoder: &'a mut Encoder<'file>) -> Result<Self, TiffError> {
        let [columns, rows] = tile_counts(image.size);
        let count = columns as usize * rows as usize;
        let directory = match encoder {
            Encoder::Classic(encoder) => Directory::Classic(encoder.image_directory()?),
            Encoder::Big(encoder) => Directory::Big(encoder.image_directory()?),
        };
        Ok(Self { image, directory, begun: BTreeMap::new(), offsets: vec![0; count], lengths: vec![0; count] })
    }

    /// Writes a rectangle of an image of [`GeoSamples::Rgba8`], whose left upper pixel is `at`: rows of `width` pixels
    /// from the top, linear RGBA, premultiplied. No pixel may be written twice.
    ///
    /// # Errors
    /// [`IoError::System`] if the file can't be written.
    pub fn write_color(&mut self, at: [u32; 2], width: u32, pixels: &[[f32; 4]]) -> Result<(), IoError> {
        let encode = |[r, g, b, a]: &[f32; 4]| {
            let straight = if *a > 0.0 { 1.0 / a } else { 0.0 };
            let [r, g, b] = [r, g, b].map(|c| nearest_8_bit(c * straight));
            [r, g, b, (a.clamp(0.0, 1.0) * 255.0 + 0.5) as u8]
        };
        let levels: Vec<[u8; 4]> = pixels.par_iter().with_min_len(4096).map(encode).collect();
        self.write(at, width, levels.as_flattened())
    }

    /// As [`GeoTiles::write_color`], of an image of [`GeoSamples::F32`]: the numbers of a pixel beside each other.
    ///
    /// # Errors
    /// As [`GeoTiles::write_color`].
    pub fn write_f32(&mut self, at: [u32; 2], width: u32, numbers: &[f32]) -> Result<(), IoError> {
        let bytes: Vec<u8> = numbers.iter().flat_map(|v| v.to_be_bytes()).collect();
        self.write(at, width, &bytes)
    }

    fn write(&mut self, [x, y]: [u32; 2], width: u32, bytes: &[u8]) -> Result<(), IoError> {
        let pixel = self.image.samples.bytes();
        let height = (bytes.len() / pixel / (width as usize).max(1)) as u32;
        let inside = x.checked_add(width).is_some_and(|end| end <= self.image.size[0])
            && y.checked_add(height).is_some_and(|end| end <= self.image.size[1]);
        if !inside || bytes.len() != pixel * width as usize * height as usize {
            let outside = io::Error::other("a rectangle isn't inside of the image");
            return Err(failed(&self.image.path, TiffError::IoError(outside)));
        }
        if width == 0 || height == 0 {
            return Ok(());
        }
        let mut whole = Vec::new();
        for row in y / TILE..=(y + height - 1) / TILE {
            for column in x / TILE..=(x + width - 1) / TILE {
                let empty = || (empty_tile(self.image.samples), 0);
                let (tile, count) = self.begun.entry((row, column)).or_insert_with(empty);
                let from = [x.max(column * TILE), y.max(row * TILE)];
                let to = [(x + width).min((column + 1) * TILE), (y + height).min((row + 1) * TILE)];
                let run = (to[0] - from[0]) as usize * pixel;
                for line in from[1]..to[1] {
                    let source = ((line - y) as usize * width as usize + (from[0] - x) as usize) * pixel;
                    let target = ((line % TILE) * TILE + from[0] % TILE) as usize * pixel;
                    tile[target..target + run].copy_from_slice(&bytes[source..source + run]);
                }
                *count += (to[0] - from[0]) as usize * (to[1] - from[1]) as usize;
                if *count >= self.visible([column, row]) {
                    whole.push((row, column));
                }
            }
        }
        let whole: Vec<_> = whole.into_iter().filter_map(|at| Some((at, self.begun.remove(&at)?.0))).collect();
        self.compress(whole).map_err(|e| failed(&self.image.path, e))
    }

    /// Pixels of a tile that are inside of the image.
    fn visible(&self, tile: [u32; 2]) -> usize {
        let side = |k: usize| (self.image.size[k] - tile[k] * TILE).min(TILE) as usize;
        side(0) * side(1)
    }

    /// Compresses tiles on all threads and writes them in their order.
    fn compress(&mut self, tiles: Vec<((u32, u32), Vec<u8>)>) -> Result<(), TiffError> {
        let samples = self.image.samples;
        let packed: Vec<_> = tiles.into_par_iter().map(|(at, tile)| (at, deflated(tile, samples))).collect();
        let [columns, _] = tile_counts(self.image.size);
        for ((row, column), bytes) in packed {
            let (index, bytes) = (row as usize * columns as usize + column as usize, bytes?);
            self.offsets[index] = with!(&mut self.directory, directory => directory.write_data(bytes.as_slice()))?;
            self.lengths[index] = bytes.len() as u64;
        }
        Ok(())
    }

    /// Writes the tiles that miss pixels, one for all those that were never begun, and the directory.
    fn finish(mut self) -> Result<(), TiffError> {
        let begun = std::mem::take(&mut self.begun);
        self.compress(begun.into_iter().map(|(at, (tile, _))| (at, tile)).collect())?;
        if self.lengths.contains(&0) {
            let bytes = deflated(empty_tile(self.image.samples), self.image.samples)?;
            let offset = with!(&mut self.directory, directory => directory.write_data(bytes.as_slice()))?;
            for (at, length) in self.offsets.iter_mut().zip(&mut self.lengths).filter(|(_, length)| **length == 0) {
                (*at, *length) = (offset, bytes.len() as u64);
            }
        }
        let Self { image, directory, offsets, lengths, .. } = self;
        match directory {
            Directory::Classic(mut directory) => {
                write_tags(&mut directory, image)?;
                let short = |values: Vec<u64>| values.into_iter().map(u32::try_from).collect::<Result<Vec<u32>, _>>();
                directory.write_tag(Tag::TileOffsets, short(offsets)?.as_slice())?;
                directory.write_tag(Tag::TileByteCounts, short(lengths)?.as_slice())?;
                directory.finish()
            }
            Directory::Big(mut directory) => {
                write_tags(&mut directory, image)?;
                directory.write_tag(Tag::TileOffsets, offsets.as_slice())?;
                directory.write_tag(Tag::TileByteCounts, lengths.as_slice())?;
                directory.finish()
            }
        }
        .map(drop)
    }
}

/// All tags but those that say where the tiles are.
fn write_tags<K: TiffKind>(out: &mut DirectoryEncoder<'_, Sink<'_>, K>, image: &GeoImage) -> Result<(), TiffError> {
    let samples = image.samples.count();
    out.write_tag(Tag::ImageWidth, image.size[0])?;
    out.write_tag(Tag::ImageLength, image.size[1])?;
    out.write_tag(Tag::Compression, 8_u16)?;
    out.write_tag(Tag::SamplesPerPixel, samples as u16)?;
    out.write_tag(Tag::PlanarConfiguration, 1_u16)?;
    out.write_tag(Tag::TileWidth, TILE)?;
    out.write_tag(Tag::TileLength, TILE)?;
    match image.samples {
        GeoSamples::Rgba8 => {
            out.write_tag(Tag::BitsPerSample, [8_u16; 4].as_slice())?;
            out.write_tag(Tag::PhotometricInterpretation, 2_u16)?;
            // Straight alpha.
            out.write_tag(Tag::ExtraSamples, 2_u16)?;
            out.write_tag(Tag::Predictor, 2_u16)?;
        }
        GeoSamples::F32(_) => {
            out.write_tag(Tag::BitsPerSample, vec![32_u16; samples].as_slice())?;
            out.write_tag(Tag::PhotometricInterpretation, 1_u16)?;
            if samples > 1 {
                out.write_tag(Tag::ExtraSamples, vec![0_u16; samples - 1].as_slice())?;
            }
            out.write_tag(Tag::SampleFormat, vec![3_u16; samples].as_slice())?;
            out.write_tag(Tag::Predictor, 3_u16)?;
            out.write_tag(Tag::GdalNodata, format!("{}", GeoSamples::NODATA).as_str())?;
        }
    }
    let software: String = image.software.chars().filter(char::is_ascii_graphic).collect();
    out.write_tag(Tag::Software, software.as_str())?;
    let [left, top] = image.left_top;
    out.write_tag(Tag::ModelPixelScaleTag, [image.pixel, image.pixel, 0.0].as_slice())?;
    out.write_tag(Tag::ModelTiepointTag, [0.0, 0.0, 0.0, left, top, 0.0].as_slice())?;
    let Some(crs) = &image.crs else { return Ok(()) };
    let (keys, doubles, text) = crs.image_keys();
    out.write_tag(Tag::GeoKeyDirectoryTag, keys.as_slice())?;
    if !doubles.is_empty() {
        out.write_tag(Tag::GeoDoubleParamsTag, doubles.as_slice())?;
    }
    if !text.is_empty() {
        out.write_tag(Tag::GeoAsciiParamsTag, text.as_str())?;
    }
    Ok(())
}

/// A tile without data; numbers have their most significant byte first.
fn empty_tile(samples: GeoSamples) -> Vec<u8> {
    let pixels = (TILE * TILE) as usize;
    match samples {
        GeoSamples::Rgba8 => vec![0; pixels * samples.bytes()],
        GeoSamples::F32(count) => GeoSamples::NODATA.to_be_bytes().repeat(pixels * usize::from(count)),
    }
}

/// A tile after TIFF's predictor (horizontal differences; of floats, by planes of bytes: TIFF Technical Note 3) and
/// deflate.
fn deflated(mut tile: Vec<u8>, samples: GeoSamples) -> io::Result<Vec<u8>> {
    let mut planes = vec![0; TILE as usize * samples.bytes()];
    for row in tile.chunks_exact_mut(TILE as usize * samples.bytes()) {
        if let GeoSamples::F32(_) = samples {
            let numbers = row.len() / 4;
            for (i, number) in row.chunks_exact(4).enumerate() {
                for (k, byte) in number.iter().enumerate() {
                    planes[k * numbers + i] = *byte;
                }
            }
            row.copy_from_slice(&planes);
        }
        for i in (samples.count()..row.len()).rev() {
            row[i] = row[i].wrapping_sub(row[i - samples.count()]);
        }
    }
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::new(LEVEL));
    encoder.write_all(&tile)?;
    encoder.finish()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::linear_of_8_bit;
    use tiff::decoder::{Decoder, DecodingResult};

    /// A file of its own for each test.
    fn file(name: &str) -> PathBuf {
        std::env::temp_dir().join(format!("surfel-geotiff-{name}-{}.tif", std::process::id()))
    }

    fn image(name: &str, size: [u32; 2], samples: GeoSamples) -> GeoImage {
        let crs = Some(Crs::of_epsg(25_832));
        let left_top = [637_000.1, 4_851_300.3];
        GeoImage { path: file(name), size, samples, left_top, pixel: 0.1, crs, software: "surfel test".into() }
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
        // Blocks of 200 pixels from 30 on, the last first; column 0 to 29 is never written.
        let done: Result<(), IoError> = write_geotiffs(&[dsm.clone(), rgb.clone()], true, |tiles| {
            for y in (0..size[1]).step_by(200).rev() {
                for x in (30..size[0]).step_by(200).rev() {
                    let (w, h) = ((size[0] - x).min(200), (size[1] - y).min(200));
                    let of = |i: u32| (x + i % w, y + i / w);
                    let numbers: Vec<f32> = (0..w * h).map(|i| value(of(i).0, of(i).1)).collect();
                    tiles[0].write_f32([x, y], w, &numbers)?;
                    let colors: Vec<[f32; 4]> = (0..w * h).map(|i| linear(color(of(i).0, of(i).1))).collect();
                    tiles[1].write_color([x, y], w, &colors)?;
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
        let done: Result<(), IoError> =
            write_geotiffs(std::slice::from_ref(&large), true, |tiles| tiles[0].write_f32([59_999, 59_999], 1, &[7.0]));
        done.unwrap();
        let bytes = std::fs::read(&large.path).unwrap();
        assert_eq!((bytes[2..4] == 43_u16.to_ne_bytes(), bytes.len() < 2_000_000), (true, true), "{}", bytes.len());
        let mut decoder = Decoder::new(File::open(&large.path).unwrap()).unwrap();
        let DecodingResult::F32(last) = decoder.read_chunk(235 * 235 - 1).unwrap() else { panic!() };
        // The last tile is cut by the image's edges.
        assert_eq!((last.last(), last[0]), (Some(&7.0), GeoSamples::NODATA));
        std::fs::remove_file(&large.path).unwrap();
    }

    #[test]
    fn failed_drawing_leaves_no_file_and_rectangles_stay_inside() {
        let one = image("failed", [10, 10], GeoSamples::F32(3));
        let outside = |at, width, count: usize| {
            let done: Result<(), IoError> = write_geotiffs(std::slice::from_ref(&one), true, |tiles| {
                tiles[0].write_f32(at, width, &vec![0.0; count])
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
}

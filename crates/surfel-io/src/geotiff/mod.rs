//! Writing of GeoTIFF (OGC 19-008r4) images, rectangle by rectangle in any order. Files are tiled, deflated, north up,
//! and cloud-optimised (OGC 21-026) with overviews; they are BigTIFF if they may exceed 4 GiB. Pixels that are never
//! written are no data.
//!
//! A cloud-optimised file begins with its directories. The tiles of the smallest overview follow, then those of the
//! next larger one, and so on; the tiles of the image itself are last. Tiles are completed in another order. Until the
//! end they are stored, compressed, in an unnamed file in the output's folder.

mod head;
mod reduce;
#[cfg(test)]
mod tests;

use crate::atomic::{Pending, unnamed_in};
use crate::crs::Crs;
use crate::error::{IoError, WRITE};
use flate2::Compression;
use flate2::write::ZlibEncoder;
use head::{Head, TileList};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use surfel_math::srgb::nearest_8_bit;

/// Side of a tile in pixels.
const TILE: u32 = 256;
/// Deflate level of the tiles, from 0 to 9. Level 3 would make images of heights 6 % smaller and take 1.7 times as
/// long.
const LEVEL: u32 = 1;
/// Size of the uncompressed image with its overviews, in bytes, from which a file is a BigTIFF. Deflate makes
/// incompressible data less than 0.1 % larger.
const BIG_FROM: u64 = 4_200_000_000;

/// Pixel format of a GeoTIFF image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GeoSamples {
    /// Red, green, blue (sRGB-encoded) and straight alpha, 8 bits each. Pixels without data have alpha 0.
    Rgba8,
    /// The given number of f32 bands. Pixels without data have [`GeoSamples::NODATA`] in all bands.
    F32(u16),
}

impl GeoSamples {
    /// Value that marks pixels without data in f32 images.
    pub const NODATA: f32 = -9999.0;
}

/// Description and georeference of an image to be written.
#[derive(Clone, Debug, PartialEq)]
pub struct GeoImage {
    /// Path of the output file.
    pub path: PathBuf,
    /// Numbers of columns and rows, each at least 1.
    pub size: [u32; 2],
    /// Pixel format, without the band that `has_marks` adds.
    pub samples: GeoSamples,
    /// Names of the bands in their order, which GDAL displays as descriptions. If empty, the file names no bands.
    pub bands: Vec<&'static str>,
    /// True if an additional last band marks interpolated pixels: 255 in 8 bits or 1 as f32. Other pixels have 0, but
    /// [`GeoSamples::NODATA`] in an f32 image if they have no data.
    pub has_marks: bool,
    /// x of the image's left edge and y of its upper edge, in units of the coordinate reference system.
    pub left_top: [f64; 2],
    /// Side of a pixel, in units of the coordinate reference system.
    pub pixel: f64,
    /// Coordinate reference system of x and y. If `None`, the file states none.
    pub crs: Option<Crs>,
    /// Name of the writing program.
    pub software: String,
}

impl GeoImage {
    /// Returns the number of bands, including the mark.
    fn count(&self) -> usize {
        let own = match self.samples {
            GeoSamples::Rgba8 => 4,
            GeoSamples::F32(count) => count.into(),
        };
        own + usize::from(self.has_marks)
    }

    /// Returns the size of a pixel in bytes, including the mark.
    fn pixel_bytes(&self) -> usize {
        match self.samples {
            GeoSamples::Rgba8 => self.count(),
            GeoSamples::F32(_) => 4 * self.count(),
        }
    }

    /// Returns the sizes of the image and its overviews. Each overview has half the columns and rows of the level
    /// before, rounded up; the last one fits into a tile. An image that fits into a tile has no overview.
    fn sizes(&self) -> Vec<[u32; 2]> {
        let mut sizes = vec![self.size];
        while let Some(size) = sizes.last().filter(|size| size.iter().any(|side| *side > TILE)) {
            sizes.push(size.map(|side| side.div_ceil(2)));
        }
        sizes
    }
}

/// An open image that rectangles are written to.
pub struct GeoTiles<'a> {
    image: &'a GeoImage,
    /// The image, then its overviews by decreasing size.
    levels: Vec<Level>,
    /// Temporary file with the compressed tiles, in order of completion.
    waiting: BufWriter<File>,
    waiting_bytes: u64,
}

/// The image or one of its overviews.
struct Level {
    size: [u32; 2],
    /// Incomplete tiles by row and column: uncompressed pixels, and how many of the pixels have been written.
    begun: BTreeMap<(u32, u32), (Vec<u8>, usize)>,
    /// Offset and length in bytes of each compressed tile in the temporary file, row by row. The length is 0 until the
    /// tile is complete.
    places: Vec<(u64, u32)>,
}

/// Row and column of a tile, and its uncompressed pixels.
type Finished = ((u32, u32), Vec<u8>);

/// Writes several GeoTIFF files together. `draw` writes the pixels: it gets an open image for each of `images`, in the
/// same order. The files appear under their names once all are complete.
///
/// # Errors
/// [`IoError::Exists`] if a file exists and `overwrite` is false, before anything is drawn; [`IoError::System`] if a
/// file can't be written; any error of `draw`.
pub fn write_geotiffs<E: From<IoError>>(
    images: &[GeoImage],
    overwrite: bool,
    draw: impl FnOnce(&mut [GeoTiles<'_>]) -> Result<(), E>,
) -> Result<(), E> {
    let mut files = images.iter().map(|i| Pending::new(&i.path, overwrite)).collect::<Result<Vec<_>, IoError>>()?;
    let mut tiles = Vec::with_capacity(images.len());
    for image in images {
        tiles.push(GeoTiles::new(image).map_err(|e| failed(&image.path, e))?);
    }
    draw(&mut tiles)?;
    for ((image, tiles), file) in images.iter().zip(tiles).zip(&mut files) {
        tiles.finish(&mut file.sink).map_err(|e| failed(&image.path, e))?;
    }
    files.into_iter().try_for_each(Pending::publish)?;
    Ok(())
}

fn failed(path: &Path, source: io::Error) -> IoError {
    IoError::System { path: path.to_path_buf(), action: WRITE, source }
}

fn tile_counts(size: [u32; 2]) -> [u32; 2] {
    size.map(|side| side.div_ceil(TILE))
}

impl Level {
    fn new(size: [u32; 2]) -> Self {
        let [columns, rows] = tile_counts(size);
        Self { size, begun: BTreeMap::new(), places: vec![(0, 0); columns as usize * rows as usize] }
    }

    /// Returns how many columns and rows of pixels of the tile `[column, row]` are inside the image.
    fn visible(&self, [column, row]: [u32; 2]) -> [u32; 2] {
        [self.size[0] - column * TILE, self.size[1] - row * TILE].map(|side| side.min(TILE))
    }

    /// Copies `bytes`, the pixels of a rectangle whose upper left pixel is `[x, y]`, into this level's tiles. Removes
    /// and returns the tiles that are complete.
    fn put(&mut self, image: &GeoImage, [x, y]: [u32; 2], [width, height]: [u32; 2], bytes: &[u8]) -> Vec<Finished> {
        let pixel = image.pixel_bytes();
        let mut whole = Vec::new();
        for row in y / TILE..=(y + height - 1) / TILE {
            for column in x / TILE..=(x + width - 1) / TILE {
                let (tile, count) = self.begun.entry((row, column)).or_insert_with(|| (empty_tile(image), 0));
                let from = [x.max(column * TILE), y.max(row * TILE)];
                let to = [(x + width).min((column + 1) * TILE), (y + height).min((row + 1) * TILE)];
                let run = (to[0] - from[0]) as usize * pixel;
                for line in from[1]..to[1] {
                    let source = ((line - y) as usize * width as usize + (from[0] - x) as usize) * pixel;
                    let target = ((line % TILE) * TILE + from[0] % TILE) as usize * pixel;
                    tile[target..target + run].copy_from_slice(&bytes[source..source + run]);
                }
                *count += (to[0] - from[0]) as usize * (to[1] - from[1]) as usize;
                let count = *count;
                let [columns, rows] = self.visible([column, row]).map(|side| side as usize);
                if count >= columns * rows {
                    whole.push((row, column));
                }
            }
        }
        whole.into_iter().filter_map(|at| Some((at, self.begun.remove(&at)?.0))).collect()
    }

    /// Removes and returns the incomplete tiles that end above a row of pixels. If the image ends at or above the row,
    /// these are all incomplete tiles.
    fn above(&mut self, row: u32) -> Vec<Finished> {
        let end = if row >= self.size[1] { u32::MAX } else { row / TILE };
        let rest = self.begun.split_off(&(end, 0));
        std::mem::replace(&mut self.begun, rest).into_iter().map(|(at, (tile, _))| (at, tile)).collect()
    }
}

impl<'a> GeoTiles<'a> {
    fn new(image: &'a GeoImage) -> io::Result<Self> {
        let folder = image.path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let waiting = BufWriter::with_capacity(1 << 18, unnamed_in(folder)?);
        Ok(Self { image, levels: image.sizes().into_iter().map(Level::new).collect(), waiting, waiting_bytes: 0 })
    }

    /// Writes a rectangle of an image of [`GeoSamples::Rgba8`], whose upper left pixel is `at` (column, row). `pixels`
    /// are linear premultiplied RGBA, in rows of `width` pixels from the top. `marked` has a flag per pixel, true if it
    /// is interpolated, and is used only if the image has marks. No pixel may be written twice.
    ///
    /// # Errors
    /// [`IoError::System`] if the temporary file can't be written, or if the rectangle isn't whole rows inside the
    /// image.
    pub fn write_color(
        &mut self,
        at: [u32; 2],
        width: u32,
        pixels: &[[f32; 4]],
        marked: &[bool],
    ) -> Result<(), IoError> {
        let encode = |[r, g, b, a]: &[f32; 4]| {
            let straight = if *a > 0.0 { 1.0 / a } else { 0.0 };
            let [r, g, b] = [r, g, b].map(|c| nearest_8_bit(c * straight));
            [r, g, b, (a.clamp(0.0, 1.0) * 255.0 + 0.5) as u8]
        };
        let levels: Vec<[u8; 4]> = pixels.par_iter().with_min_len(4096).map(encode).collect();
        if !self.image.has_marks {
            return self.write(at, width, levels.as_flattened());
        }
        let mark = |i: usize| if marked.get(i).is_some_and(|marked| *marked) { 255 } else { 0 };
        let bytes: Vec<u8> =
            levels.iter().enumerate().flat_map(|(i, [r, g, b, a])| [*r, *g, *b, *a, mark(i)]).collect();
        self.write(at, width, &bytes)
    }

    /// Writes a rectangle of an image of [`GeoSamples::F32`], as [`GeoTiles::write_color`] does. `numbers` are the
    /// bands of the first pixel, then of the next one, and so on, without the band of marks.
    ///
    /// # Errors
    /// Errors of [`GeoTiles::write_color`].
    pub fn write_f32(&mut self, at: [u32; 2], width: u32, numbers: &[f32], marked: &[bool]) -> Result<(), IoError> {
        if !self.image.has_marks {
            let bytes: Vec<u8> = numbers.iter().flat_map(|v| v.to_be_bytes()).collect();
            return self.write(at, width, &bytes);
        }
        let own = self.image.count() - 1;
        let mut bytes = Vec::with_capacity((numbers.len() + numbers.len() / own.max(1)) * 4);
        for (i, pixel) in numbers.chunks_exact(own.max(1)).enumerate() {
            bytes.extend(pixel.iter().flat_map(|v| v.to_be_bytes()));
            let mark = match marked.get(i) {
                _ if pixel[0] == GeoSamples::NODATA => GeoSamples::NODATA,
                Some(true) => 1.0,
                _ => 0.0,
            };
            bytes.extend(mark.to_be_bytes());
        }
        self.write(at, width, &bytes)
    }

    /// Declares that no further pixels above a row of the image will be written. Incomplete tiles above the row are
    /// finished, so that only a few rows of tiles are in memory.
    ///
    /// # Errors
    /// [`IoError::System`] if the file can't be written.
    pub fn done_above(&mut self, row: u32) -> Result<(), IoError> {
        self.finish_above(row).map_err(|e| failed(&self.image.path, e))
    }

    fn finish_above(&mut self, mut row: u32) -> io::Result<()> {
        for level in 0..self.levels.len() {
            let finished = self.levels[level].above(row);
            self.store(level, finished)?;
            // The last row of an overview may represent a single row.
            row = if row >= self.levels[level].size[1] { u32::MAX } else { row / 2 };
        }
        Ok(())
    }

    fn write(&mut self, at: [u32; 2], width: u32, bytes: &[u8]) -> Result<(), IoError> {
        let height = (bytes.len() / self.image.pixel_bytes() / (width as usize).max(1)) as u32;
        let inside = at[0].checked_add(width).is_some_and(|end| end <= self.image.size[0])
            && at[1].checked_add(height).is_some_and(|end| end <= self.image.size[1]);
        if !inside || bytes.len() != self.image.pixel_bytes() * width as usize * height as usize {
            let outside = io::Error::other("a rectangle isn't inside of the image");
            return Err(failed(&self.image.path, outside));
        }
        if width == 0 || height == 0 {
            return Ok(());
        }
        let whole = self.levels[0].put(self.image, at, [width, height], bytes);
        self.store(0, whole).map_err(|e| failed(&self.image.path, e))
    }

    /// Compresses tiles of a level on all threads and appends them to the temporary file in order. Adds their pixels,
    /// at half the size, to the next overview.
    fn store(&mut self, level: usize, tiles: Vec<Finished>) -> io::Result<()> {
        if tiles.is_empty() {
            return Ok(());
        }
        let image = self.image;
        let current = &self.levels[level];
        let has_overview = level + 1 < self.levels.len();
        let packed: Vec<_> = tiles
            .into_par_iter()
            .map(|((row, column), tile)| {
                let visible = current.visible([column, row]);
                let half = if has_overview { reduce::halved(&tile, visible, image) } else { Vec::new() };
                ((row, column), visible.map(|side| side.div_ceil(2)), half, deflated(tile, image))
            })
            .collect();
        let mut above = Vec::new();
        for ((row, column), half_size, half, bytes) in packed {
            let bytes = bytes?;
            let columns = tile_counts(self.levels[level].size)[0];
            self.levels[level].places[(row * columns + column) as usize] = self.append(&bytes)?;
            if has_overview {
                let at = [column * TILE / 2, row * TILE / 2];
                above.extend(self.levels[level + 1].put(image, at, half_size, &half));
            }
        }
        self.store(level + 1, above)
    }

    fn append(&mut self, bytes: &[u8]) -> io::Result<(u64, u32)> {
        let at = self.waiting_bytes;
        self.waiting.write_all(bytes)?;
        self.waiting_bytes += bytes.len() as u64;
        Ok((at, bytes.len() as u32))
    }

    /// Writes the file: its head, then all tiles.
    fn finish(mut self, out: &mut impl Write) -> io::Result<()> {
        self.finish_above(u32::MAX)?;
        // One empty tile per level represents all tiles that were never begun.
        if self.levels.iter().any(|level| level.places.iter().any(|(_, length)| *length == 0)) {
            let empty = self.append(&deflated(empty_tile(self.image), self.image)?)?;
            let unfinished = self.levels.iter_mut().flat_map(|level| &mut level.places);
            unfinished.filter(|(_, length)| *length == 0).for_each(|place| *place = empty);
        }
        let mut lists: Vec<TileList> = self.levels.iter().map(|level| TileList::new(level.places.len())).collect();
        for (list, level) in lists.iter_mut().zip(&self.levels) {
            list.lengths = level.places.iter().map(|(_, length)| *length).collect();
        }
        let raw = |size: [u32; 2]| tile_counts(size).into_iter().map(u64::from).product::<u64>();
        let tiles: u64 = self.levels.iter().map(|level| raw(level.size)).sum();
        let is_big = tiles * u64::from(TILE * TILE) * self.image.pixel_bytes() as u64 >= BIG_FROM;
        let sizes: Vec<[u32; 2]> = self.levels.iter().map(|level| level.size).collect();
        let head = Head { image: self.image, sizes: &sizes, is_big };
        // The head's length doesn't depend on the tile offsets.
        let mut at = head.bytes(&lists)?.len() as u64;
        let mut order: Vec<(u64, u32)> = Vec::new();
        for (list, level) in lists.iter_mut().zip(&self.levels).rev() {
            let mut written: BTreeMap<u64, u64> = BTreeMap::new();
            for (offset, place) in list.offsets.iter_mut().zip(&level.places) {
                *offset = *written.entry(place.0).or_insert_with(|| {
                    order.push(*place);
                    at += u64::from(place.1);
                    at - u64::from(place.1)
                });
            }
        }
        out.write_all(&head.bytes(&lists)?)?;
        self.waiting.flush()?;
        let mut waiting = self.waiting.into_inner().map_err(io::IntoInnerError::into_error)?;
        let mut tile = Vec::new();
        for (at, length) in order {
            tile.resize(length as usize, 0);
            waiting.seek(SeekFrom::Start(at))?;
            waiting.read_exact(&mut tile)?;
            out.write_all(&tile)?;
        }
        Ok(())
    }
}

/// Returns an uncompressed tile without data. Numbers are big endian, as the predictor in [`deflated`] needs them.
fn empty_tile(image: &GeoImage) -> Vec<u8> {
    let pixels = (TILE * TILE) as usize;
    match image.samples {
        GeoSamples::Rgba8 => vec![0; pixels * image.count()],
        GeoSamples::F32(_) => GeoSamples::NODATA.to_be_bytes().repeat(pixels * image.count()),
    }
}

/// Compresses a tile: applies TIFF's predictor, then deflate. The predictor stores horizontal differences of bytes.
/// Before that it sorts the bytes of floats into planes (TIFF Technical Note 3).
fn deflated(mut tile: Vec<u8>, image: &GeoImage) -> io::Result<Vec<u8>> {
    let (row_bytes, count) = (TILE as usize * image.pixel_bytes(), image.count());
    let mut planes = vec![0; row_bytes];
    for row in tile.chunks_exact_mut(row_bytes) {
        if let GeoSamples::F32(_) = image.samples {
            let numbers = row.len() / 4;
            for (i, number) in row.chunks_exact(4).enumerate() {
                for (k, byte) in number.iter().enumerate() {
                    planes[k * numbers + i] = *byte;
                }
            }
            row.copy_from_slice(&planes);
        }
        for i in (count..row.len()).rev() {
            row[i] = row[i].wrapping_sub(row[i - count]);
        }
    }
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::new(LEVEL));
    encoder.write_all(&tile)?;
    encoder.finish()
}

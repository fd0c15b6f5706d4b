//! Stitching of image tiles to a whole image, with only a few rows in memory at a time.

use crate::png::{BitDepth, PngOptions, start_png};
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, Write};
use std::path::{Path, PathBuf};
use surfel_files::atomic;
use surfel_files::error::ShowPath as _;
use surfel_files::error::{Fault, IoError, Problem, READ};
use surfel_model::MAX_IMAGE_SIDE;

/// Header of a PNG or EXR file, which is read without the pixels.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ImageHeader {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Channels and number format of the pixels. Tiles of one image must agree in it.
    pub samples: Samples,
    /// Names and values of the text attributes, sorted by name.
    pub metadata: Vec<(String, String)>,
}

/// Channels and number format of an image's pixels.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Samples {
    /// PNG with RGBA samples of this number of bits.
    Png(BitDepth),
    /// EXR channels in their order: name, number of bytes per sample, and letter of the type (`h` half, `f` float, `u`
    /// integer).
    Exr(Vec<(String, usize, char)>),
}

impl std::fmt::Display for Samples {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Png(BitDepth::Eight) => f.write_str("PNG of 8 bits"),
            Self::Png(BitDepth::Sixteen) => f.write_str("PNG of 16 bits"),
            Self::Exr(channels) => {
                f.write_str("EXR of")?;
                channels.iter().try_for_each(|(name, bytes, kind)| write!(f, " {name}:{kind}{}", 8 * bytes))
            }
        }
    }
}

impl Samples {
    /// Returns the number of bytes per pixel of each section of a row. A PNG row is one section of RGBA pixels. In an
    /// EXR row, each channel is a section of its own.
    fn parts(&self) -> Vec<usize> {
        match self {
            Self::Png(BitDepth::Eight) => vec![4],
            Self::Png(BitDepth::Sixteen) => vec![8],
            Self::Exr(channels) => channels.iter().map(|(_, bytes, _)| *bytes).collect(),
        }
    }
}

/// Tile of an image: an image file, and the position of its upper left pixel in the whole image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Tile {
    /// Path of the image file.
    pub path: PathBuf,
    /// Column of the whole image where the tile's upper left pixel belongs.
    pub x: u32,
    /// Row of the whole image where the tile's upper left pixel belongs.
    pub y: u32,
    /// Header of the tile's file, from [`read_image_header`].
    pub header: ImageHeader,
}

impl Tile {
    fn right(&self) -> u64 {
        u64::from(self.x) + u64::from(self.header.width)
    }

    fn bottom(&self) -> u64 {
        u64::from(self.y) + u64::from(self.header.height)
    }
}

/// Reads the header of a PNG or EXR file that Surfel wrote.
///
/// # Errors
/// [`IoError::System`] if the file can't be read; [`IoError::Invalid`] if it isn't a PNG or EXR, or has a layout that
/// Surfel doesn't write.
pub fn read_image_header(path: &Path) -> Result<ImageHeader, IoError> {
    Rows::open(path).map(|(header, _)| header)
}

/// Writes an image of `size` pixels from its tiles, whose samples are unchanged. The output has the format of the
/// tiles. If `out` ends in .tif or .tiff, PNG tiles become a TIFF without `metadata`. Only tiles in the current row are
/// open. Each has one row of a PNG or 16 rows of an EXR in memory.
///
/// # Errors
/// [`IoError`] if a pixel is in no tile or in two, or if tiles differ in pixel format or can't be read. Also
/// [`IoError`] if `out` can't be written, or if it exists and `overwrite` is false.
pub fn stitch(
    out: &Path,
    overwrite: bool,
    size: [u32; 2],
    tiles: &[Tile],
    metadata: &[(String, String)],
) -> Result<(), IoError> {
    let Some(first) = tiles.first() else {
        return Err(Fault::from(Problem::new("is of no tiles").expected("at least one")).of(out));
    };
    if size.iter().any(|&side| side == 0 || side > MAX_IMAGE_SIDE) {
        let what = format!("would be an image of {}x{} pixels", size[0], size[1]);
        return Err(Fault::from(Problem::new(what).expected(format!("1 to {MAX_IMAGE_SIDE} a side"))).of(out));
    }
    if let Some(other) = tiles.iter().find(|tile| tile.header.samples != first.header.samples) {
        let problem = Problem::new(format!("is a {}", other.header.samples));
        let expected = format!("a {}, as {} is", first.header.samples, first.path.shown());
        return Err(Fault::from(problem.expected(expected)).of(&other.path));
    }
    let mut sorted: Vec<&Tile> = tiles.iter().collect();
    sorted.sort_by_key(|tile| (tile.y, tile.x));
    check_cover(size, &sorted, out)?;
    let mut whole = Whole { size, parts: first.header.samples.parts(), waiting: &sorted, open: Vec::new(), y: 0 };
    let is_tiff = out.extension().is_some_and(|e| e.eq_ignore_ascii_case("tif") || e.eq_ignore_ascii_case("tiff"));
    match &first.header.samples {
        Samples::Exr(_) if is_tiff => {
            let problem = Problem::new("is a TIFF, but the tiles are EXRs").expected("a name in .exr");
            Err(Fault::from(problem).of(out))
        }
        #[cfg(not(feature = "tiff"))]
        Samples::Png(_) if is_tiff => Err(Fault::from(Problem::not_built("TIFF", "geotiff")).of(out)),
        #[cfg(feature = "tiff")]
        Samples::Png(depth) if is_tiff => {
            let mut failed = None;
            let written = atomic::write_seekable(out, overwrite, |sink| {
                let next = |row: &mut [u8]| whole.next_row(row).map_err(|error| keep(&mut failed, error));
                super::tiff::write_rows(sink, size, *depth, "surfel", next)
            });
            failed.map_or(written, Err)
        }
        Samples::Png(depth) => {
            let options = PngOptions { depth: *depth, metadata: metadata.to_vec() };
            let mut failed = None;
            let written = atomic::write(out, overwrite, |sink| {
                let mut png = start_png(sink, size, &options)?;
                let mut rows = png.stream_writer().map_err(io::Error::other)?;
                let mut row = vec![0; whole.row_bytes()];
                for _ in 0..size[1] {
                    whole.next_row(&mut row).map_err(|error| keep(&mut failed, error))?;
                    rows.write_all(&row)?;
                }
                rows.finish().map_err(io::Error::other)?;
                png.finish().map_err(io::Error::other)
            });
            failed.map_or(written, Err)
        }
        #[cfg(feature = "exr")]
        Samples::Exr(_) => {
            let mut failed = None;
            let written = atomic::write_seekable(out, overwrite, |sink| {
                let next = |row: &mut [u8]| whole.next_row(row).map_err(|error| keep(&mut failed, error));
                super::exr::write_rows(sink, size, &first.path, metadata, next)
            });
            failed.map_or(written, Err)
        }
        #[cfg(not(feature = "exr"))]
        Samples::Exr(_) => Err(Fault::from(Problem::not_built("OpenEXR", "exr")).of(out)),
    }
}

/// Stores a tile's [`IoError`] in `failed`, because the writer of the whole image can only return an [`io::Error`].
/// Returns one as a placeholder.
fn keep(failed: &mut Option<IoError>, error: IoError) -> io::Error {
    *failed = Some(error);
    io::Error::other("a tile can't be read")
}

/// Returns an error unless each pixel of the whole image is in exactly one tile. `tiles` are sorted by the row, then by
/// the column, of their upper left pixels.
fn check_cover([width, height]: [u32; 2], tiles: &[&Tile], out: &Path) -> Result<(), IoError> {
    let outside = |tile: &&&Tile| tile.right() > u64::from(width) || tile.bottom() > u64::from(height);
    if let Some(tile) = tiles.iter().find(outside) {
        let Tile { x, y, header, .. } = tile;
        let what = format!("is {}x{} pixels at {x},{y} of an image", header.width, header.height);
        return Err(Fault::from(Problem::new(what).expected(format!("a part of {width}x{height}"))).of(&tile.path));
    }
    let mut edges: Vec<u64> = tiles.iter().flat_map(|tile| [u64::from(tile.y), tile.bottom()]).collect();
    edges.extend([0, u64::from(height)]);
    edges.sort_unstable();
    edges.dedup();
    let (mut waiting, mut open): (&[&Tile], Vec<&Tile>) = (tiles, Vec::new());
    for rows in edges.windows(2) {
        let (from, to) = (rows[0], rows[1]);
        open.retain(|tile| tile.bottom() > from);
        let starting = waiting.iter().take_while(|tile| u64::from(tile.y) == from).count();
        let (now, later) = waiting.split_at(starting);
        open.extend(now);
        waiting = later;
        open.sort_by_key(|tile| tile.x);
        let mut x = 0;
        for tile in &open {
            if u64::from(tile.x) < x {
                let what = format!("has pixels that another tile has, at {},{from}", tile.x);
                return Err(Fault::from(Problem::new(what).expected("every pixel in one tile")).of(&tile.path));
            }
            if u64::from(tile.x) > x {
                return Err(missing(out, (x, u64::from(tile.x)), (from, to)));
            }
            x = tile.right();
        }
        if x < u64::from(width) {
            return Err(missing(out, (x, u64::from(width)), (from, to)));
        }
    }
    Ok(())
}

fn missing(out: &Path, columns: (u64, u64), rows: (u64, u64)) -> IoError {
    let (last_column, last_row) = (columns.1 - 1, rows.1 - 1);
    let what =
        format!("the columns {} to {last_column} of the rows {} to {last_row} are in no tile", columns.0, rows.0);
    Fault::from(Problem::new(what).expected("every pixel in one tile").help("draw the missing tiles first")).of(out)
}

/// Whole image that is assembled from tiles, row by row.
struct Whole<'a> {
    size: [u32; 2],
    /// Number of bytes per pixel of each section of a row, from [`Samples::parts`].
    parts: Vec<usize>,
    /// Tiles that begin at or below the next row and aren't open yet, sorted by the row of their upper left pixel.
    waiting: &'a [&'a Tile],
    open: Vec<(&'a Tile, Rows)>,
    y: u64,
}

impl Whole<'_> {
    fn row_bytes(&self) -> usize {
        self.parts.iter().sum::<usize>() * self.size[0] as usize
    }

    /// Assembles the next row of the whole image from the tiles that it crosses.
    fn next_row(&mut self, row: &mut [u8]) -> Result<(), IoError> {
        let y = self.y;
        self.open.retain(|(tile, _)| tile.bottom() > y);
        while let Some((tile, later)) = self.waiting.split_first().filter(|(tile, _)| u64::from(tile.y) == y) {
            let (header, rows) = Rows::open(&tile.path)?;
            if header != tile.header {
                return Err(Fault::from(Problem::new("has changed while it was read")).of(&tile.path));
            }
            self.open.push((*tile, rows));
            self.waiting = later;
        }
        let width = self.size[0] as usize;
        for (tile, rows) in &mut self.open {
            let part = rows.next().map_err(|problem| Fault::from(problem).of(&tile.path))?;
            let (x, columns) = (tile.x as usize, tile.header.width as usize);
            let (mut to, mut from) = (0, 0);
            for bytes in &self.parts {
                let target = row.get_mut((to * width + x * bytes)..(to * width + (x + columns) * bytes));
                let source = part.get(from * columns..(from + bytes) * columns);
                if let (Some(target), Some(source)) = (target, source) {
                    target.copy_from_slice(source);
                }
                (to, from) = (to + bytes, from + bytes);
            }
        }
        self.y += 1;
        Ok(())
    }
}

/// Reader of the rows of a tile's image file.
enum Rows {
    Png(Box<png::Reader<BufReader<File>>>),
    #[cfg(feature = "exr")]
    Exr(Box<super::exr::ExrRows>),
}

impl Rows {
    fn open(path: &Path) -> Result<(ImageHeader, Self), IoError> {
        let system = |source| IoError::System { path: path.to_path_buf(), action: READ, source };
        let mut file = File::open(path).map_err(system)?;
        if !file.metadata().map_err(system)?.is_file() {
            return Err(system(io::Error::other("it is no file")));
        }
        let mut start = Vec::new();
        Read::by_ref(&mut file).take(8).read_to_end(&mut start).map_err(system)?;
        file.rewind().map_err(system)?;
        let file = BufReader::with_capacity(1 << 18, file);
        let opened = if start.starts_with(&[0x76, 0x2f, 0x31, 0x01]) {
            #[cfg(feature = "exr")]
            let opened = super::exr::ExrRows::open(file).map(|(header, rows)| (header, Self::Exr(Box::new(rows))));
            #[cfg(not(feature = "exr"))]
            let opened = Err(Problem::not_built("OpenEXR", "exr"));
            opened
        } else if start == b"\x89PNG\r\n\x1a\n" {
            open_png(file)
        } else {
            Err(Problem::new("is not a tile that can be read").expected("a PNG or EXR that surfel drew"))
        };
        opened.map_err(|problem| Fault::from(problem).of(path))
    }

    fn next(&mut self) -> Result<&[u8], Problem> {
        match self {
            Self::Png(reader) => match reader.next_row() {
                Ok(Some(row)) => Ok(row.data()),
                Ok(None) => Err(damaged("it ends early")),
                Err(error) => Err(damaged(&error.to_string())),
            },
            #[cfg(feature = "exr")]
            Self::Exr(rows) => rows.next(),
        }
    }
}

/// Returns the problem for a tile that can't be decoded.
pub(super) fn damaged(why: &str) -> Problem {
    let why: String = why.chars().take(200).map(|c| if c.is_control() { ' ' } else { c }).collect();
    Problem::new(format!("can't be read as an image: {why}")).help("draw the tile again: it is damaged")
}

fn open_png(file: BufReader<File>) -> Result<(ImageHeader, Rows), Problem> {
    let reader = png::Decoder::new(file).read_info().map_err(|error| damaged(&error.to_string()))?;
    let info = reader.info();
    let depth = match (info.color_type, info.bit_depth, info.interlaced) {
        (png::ColorType::Rgba, png::BitDepth::Eight, false) => BitDepth::Eight,
        (png::ColorType::Rgba, png::BitDepth::Sixteen, false) => BitDepth::Sixteen,
        (color, bits, _) => {
            let what = format!("is a PNG of {color:?} with {} bits", bits as u8);
            return Err(Problem::new(what).expected("RGBA of 8 or 16 bits, not interlaced, as surfel draws it"));
        }
    };
    check_side(info.width, info.height)?;
    let metadata = super::png::texts_of(info);
    let header = ImageHeader { width: info.width, height: info.height, samples: Samples::Png(depth), metadata };
    Ok((header, Rows::Png(Box::new(reader))))
}

pub(super) fn check_side(width: u32, height: u32) -> Result<(), Problem> {
    if width == 0 || height == 0 || width > MAX_IMAGE_SIDE || height > MAX_IMAGE_SIDE {
        let what = format!("is an image of {width}x{height} pixels");
        return Err(Problem::new(what).expected(format!("1 to {MAX_IMAGE_SIDE} a side")));
    }
    Ok(())
}

//! Writing of RGBA TIFF images row by row, in strips compressed by deflate. Files that may exceed 4 GiB are BigTIFF.

use crate::png::BitDepth;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use tiff::encoder::{TiffEncoder, TiffKind, TiffKindBig, TiffKindStandard};
use tiff::tags::Tag;
use tiff::{TiffError, TiffResult};

/// Target size, in bytes before compression, of a strip of rows. A strip has at least one row.
const STRIP_BYTES: usize = 1 << 20;
/// Compression level of deflate. Higher levels take twice the time and reduce the size by a few per cent.
const LEVEL: u32 = 3;
/// Smallest size of the pixels, in bytes before compression, from which the file is written as BigTIFF. TIFF ends at 4
/// GiB, and deflate may add up to 0.1 %.
const BIG_FROM: u64 = 4_200_000_000;

/// Writes an image with sRGB-encoded RGB and straight alpha. `next` provides its rows from the top, with 16-bit samples
/// in big-endian order, as in a PNG.
///
/// # Errors
/// [`io::Error`] of `sink` or of `next`.
pub(super) fn write_rows(
    sink: &mut BufWriter<File>,
    size: [u32; 2],
    depth: BitDepth,
    software: &str,
    next: impl FnMut(&mut [u8]) -> io::Result<()>,
) -> io::Result<()> {
    let sample = if depth == BitDepth::Sixteen { 2 } else { 1 };
    let raw = u64::from(size[0]) * u64::from(size[1]) * 4 * sample as u64;
    let image = Image { size, sample, software };
    let written = if raw < BIG_FROM {
        let short = |values: &[u64]| values.iter().copied().map(u32::try_from).collect::<Result<Vec<u32>, _>>();
        TiffEncoder::new(sink).and_then(|encoder| {
            image.write::<TiffKindStandard>(encoder, next, |directory, tag, values| {
                directory.write_tag(tag, short(values)?.as_slice())
            })
        })
    } else {
        TiffEncoder::new_big(sink).and_then(|encoder| {
            image.write::<TiffKindBig>(encoder, next, |directory, tag, values| directory.write_tag(tag, values))
        })
    };
    written.map_err(|error| match error {
        TiffError::IoError(error) => error,
        other => io::Error::other(other),
    })
}

/// Encoder of the output file's directory of tags, with the kind `K` of TIFF: standard or BigTIFF.
type Directory<'a, 'file, K> = tiff::encoder::DirectoryEncoder<'a, &'file mut BufWriter<File>, K>;

struct Image<'a> {
    size: [u32; 2],
    /// Number of bytes per sample.
    sample: usize,
    software: &'a str,
}

impl Image<'_> {
    fn write<K: TiffKind>(
        &self,
        mut encoder: TiffEncoder<&mut BufWriter<File>, K>,
        mut next: impl FnMut(&mut [u8]) -> io::Result<()>,
        write_places: impl Fn(&mut Directory<'_, '_, K>, Tag, &[u64]) -> TiffResult<()>,
    ) -> TiffResult<()> {
        let [width, height] = self.size;
        let row_bytes = width as usize * 4 * self.sample;
        let rows = (STRIP_BYTES / row_bytes).clamp(1, height as usize);
        let mut directory = encoder.image_directory()?;
        let (mut offsets, mut lengths) = (Vec::new(), Vec::new());
        let mut strip = vec![0; rows * row_bytes];
        let mut left = height as usize;
        while left > 0 {
            let now = rows.min(left);
            let strip = &mut strip[..now * row_bytes];
            for row in strip.chunks_exact_mut(row_bytes) {
                next(row)?;
                self.predict(row);
            }
            let mut packed = ZlibEncoder::new(Vec::new(), Compression::new(LEVEL));
            packed.write_all(strip)?;
            let packed = packed.finish()?;
            offsets.push(directory.write_data(packed.as_slice())?);
            lengths.push(packed.len() as u64);
            left -= now;
        }
        directory.write_tag(Tag::ImageWidth, width)?;
        directory.write_tag(Tag::ImageLength, height)?;
        directory.write_tag(Tag::BitsPerSample, [8 * self.sample as u16; 4].as_slice())?;
        directory.write_tag(Tag::Compression, 8_u16)?;
        directory.write_tag(Tag::PhotometricInterpretation, 2_u16)?;
        directory.write_tag(Tag::SamplesPerPixel, 4_u16)?;
        directory.write_tag(Tag::RowsPerStrip, rows as u32)?;
        directory.write_tag(Tag::PlanarConfiguration, 1_u16)?;
        directory.write_tag(Tag::Predictor, 2_u16)?;
        // Straight alpha.
        directory.write_tag(Tag::ExtraSamples, 2_u16)?;
        directory.write_tag(Tag::Software, self.software)?;
        write_places(&mut directory, Tag::StripOffsets, &offsets)?;
        write_places(&mut directory, Tag::StripByteCounts, &lengths)?;
        directory.finish().map(drop)
    }

    /// Applies the horizontal predictor of TIFF: replaces samples by their differences from the pixel to the left.
    /// 16-bit samples are big-endian in the input, and native-endian in the output, as in the file.
    fn predict(&self, row: &mut [u8]) {
        if self.sample == 1 {
            for i in (4..row.len()).rev() {
                row[i] = row[i].wrapping_sub(row[i - 4]);
            }
            return;
        }
        let at = |row: &[u8], i: usize| u16::from_be_bytes([row[2 * i], row[2 * i + 1]]);
        for i in (0..row.len() / 2).rev() {
            let before = if i < 4 { 0 } else { at(row, i - 4) };
            let off = at(row, i).wrapping_sub(before).to_ne_bytes();
            row[2 * i..2 * i + 2].copy_from_slice(&off);
        }
    }
}

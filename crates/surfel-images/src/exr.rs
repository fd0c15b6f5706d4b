//! Reading and writing of OpenEXR images. Files have one part with the channels R, G, B, A, Z, normal.X/Y/Z, weight and
//! further planes of a frame, with lossless ZIP compression.

use crate::planes::{Planes, PlanesView};
use crate::stitch::{ImageHeader, Samples, check_side, damaged};
use exr::block::writer::ChunksWriter;
use exr::block::{UncompressedBlock, reader::AllChunksReader};
use exr::math::Vec2;
use exr::meta::MetaData;
use exr::meta::attribute::{IntegerBounds, SampleType};
use exr::meta::header::Header;
use exr::prelude::{
    AnyChannel, AnyChannels, AttributeValue, Blocks, Compression, Encoding, FlatSamples, Image, Layer, LayerAttributes,
    LineOrder, ReadChannels, ReadLayers, Text, WritableImage, read as read_exr,
};
use half::f16;
use std::fs::File;
use std::io::{self, BufReader, BufWriter, Cursor, Read, Seek, SeekFrom, Write};
use std::path::Path;
use surfel_files::atomic;
use surfel_files::error::{IoError, Problem};
use surfel_model::{MAX_IMAGE_PIXELS, MAX_IMAGE_SIDE};

/// Channel names of the world-space position of the surface at each pixel.
const POSITION: [&str; 3] = ["position.X", "position.Y", "position.Z"];

/// Options for writing an EXR file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ExrOptions {
    /// True if colours are written as 32-bit floats, false for 16-bit floats. Other planes are always 32-bit.
    pub f32_color: bool,
    /// Names and values of the text attributes to write. Characters beyond Latin-1 become `?`.
    pub metadata: Vec<(String, String)>,
}

/// Rounds a colour channel to a half float. Infinity becomes the largest finite value, so that images contain no
/// infinities.
fn half_of(channel: f32) -> f16 {
    f16::from_f32(channel.clamp(f16::MIN.to_f32(), f16::MAX.to_f32()))
}

/// Writes all planes, except 8-bit colours, as one EXR part. Equal planes give equal bytes.
///
/// # Errors
/// [`io::Error`] if there is no plane, a plane has the wrong size, two have the same name, or `out` fails.
pub fn write_exr(out: &mut dyn Write, planes: &PlanesView<'_>, options: &ExrOptions) -> io::Result<()> {
    planes.pixels()?;
    let mut channels: Vec<AnyChannel<FlatSamples>> = Vec::new();
    if let Some(color) = planes.color {
        for (i, name) in ["R", "G", "B", "A"].into_iter().enumerate() {
            let values = color.iter().map(|c| c[i]);
            let samples = if options.f32_color {
                FlatSamples::F32(values.collect())
            } else {
                FlatSamples::F16(values.map(half_of).collect())
            };
            channels.push(AnyChannel::new(name, samples));
        }
    }
    for (name, plane) in [("Z", planes.depth), ("weight", planes.weight)] {
        channels.extend(plane.map(|p| AnyChannel::new(name, FlatSamples::F32(p.to_vec()))));
    }
    if let Some(normal) = planes.normal {
        for (i, name) in ["normal.X", "normal.Y", "normal.Z"].into_iter().enumerate() {
            channels.push(AnyChannel::new(name, FlatSamples::F32(normal.iter().map(|n| n[i]).collect())));
        }
    }
    for (i, name) in POSITION.into_iter().enumerate() {
        let values = planes.position.map(|p| p.iter().map(|at| at[i] as f32).collect());
        channels.extend(values.map(|values| AnyChannel::new(name, FlatSamples::F32(values))));
    }
    for (name, plane) in &planes.whole {
        channels.push(AnyChannel { name: latin(name), ..AnyChannel::new("", FlatSamples::U32(plane.to_vec())) });
    }
    for (name, plane) in &planes.other {
        channels.push(AnyChannel { name: latin(name), ..AnyChannel::new("", FlatSamples::F32(plane.to_vec())) });
    }
    let channels = AnyChannels::sort(channels.into_iter().collect());
    let mut names: Vec<&Text> = channels.list.iter().map(|c| &c.name).collect();
    names.dedup();
    if names.len() != channels.list.len() || names.is_empty() {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, "planes need names, each a different one"));
    }
    let mut attributes = LayerAttributes::default();
    for (name, value) in &options.metadata {
        attributes.other.insert(attribute_name(name), AttributeValue::Text(latin(value)));
    }
    let encoding =
        Encoding { compression: Compression::ZIP16, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing };
    let size = (planes.width as usize, planes.height as usize);
    let image = Image::from_layer(Layer::new(size, attributes, encoding, channels));
    let mut bytes = Cursor::new(Vec::new());
    image.write().non_parallel().to_buffered(&mut bytes).map_err(io::Error::other)?;
    let mut bytes = bytes.into_inner();
    sort_attributes(&mut bytes);
    out.write_all(&bytes)
}

/// Writes an EXR like [`write_exr`], to a file and atomically.
///
/// # Errors
/// [`IoError::Exists`] if the file exists and `overwrite` is false; [`IoError::System`].
pub fn save_exr(path: &Path, overwrite: bool, planes: &PlanesView<'_>, options: &ExrOptions) -> Result<(), IoError> {
    atomic::write(path, overwrite, |out| write_exr(out, planes, options))
}

fn latin(text: &str) -> Text {
    let ok = |c: char| u32::from(c) < 256 && c != '\0';
    let text: String = text.chars().map(|c| if ok(c) { c } else { '?' }).collect();
    Text::new_or_none(text).unwrap_or_else(|| Text::from(""))
}

/// Converts a text to an attribute name of 1 to 31 characters, the limit of older readers.
fn attribute_name(name: &str) -> Text {
    let name: String = name.chars().map(|c| if c.is_ascii_graphic() { c } else { '_' }).take(31).collect();
    Text::from(if name.is_empty() { "_" } else { name.as_str() })
}

/// Sorts the attributes in an EXR header by name. The crate's writer stores them in a hash map, whose order differs
/// from run to run. A header that can't be parsed is unchanged.
fn sort_attributes(bytes: &mut [u8]) {
    const START: usize = 8; // magic number and version
    let string = |from: usize| Some(from + bytes.get(from..)?.iter().position(|&b| b == 0)? + 1);
    let mut attributes: Vec<&[u8]> = Vec::new();
    let mut end = START;
    while bytes.get(end).is_some_and(|&b| b != 0) {
        let Some(data) = string(end).and_then(string) else { return };
        let Some(&[a, b, c, d]) = bytes.get(data..data + 4) else { return };
        let Some(next) = (data + 4).checked_add(u32::from_le_bytes([a, b, c, d]) as usize) else { return };
        let Some(attribute) = bytes.get(end..next) else { return };
        attributes.push(attribute);
        end = next;
    }
    attributes.sort_unstable();
    let sorted = attributes.concat();
    if let Some(target) = bytes.get_mut(START..end) {
        target.copy_from_slice(&sorted);
    }
}

pub(super) fn read(bytes: &[u8]) -> Result<Planes, Problem> {
    let help = "copy or export the file again: it is damaged";
    let problem = |e: exr::error::Error| {
        let why: String = e.to_string().chars().take(200).map(|c| if c.is_control() { ' ' } else { c }).collect();
        Problem::new(format!("can't be read as OpenEXR: {why}")).help(help)
    };
    let meta = MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(problem)?;
    let header = meta.headers.iter().find(|h| !h.deep);
    let header =
        header.ok_or_else(|| Problem::new("has no flat image").expected("an OpenEXR part without deep data"))?;
    let (width, height) = (header.layer_size.width(), header.layer_size.height());
    let pixels = width.saturating_mul(height);
    let side = MAX_IMAGE_SIDE as usize;
    if width > side || height > side || pixels as u64 > MAX_IMAGE_PIXELS || pixels == 0 {
        let what = format!("is an image of {width}x{height} pixels");
        return Err(Problem::new(what).expected(format!("at most {MAX_IMAGE_PIXELS} pixels, {side} a side")));
    }
    // No compression in the format exceeds deflate's ratio of 1032, so that the file can't contain more pixels.
    let decoded = pixels.saturating_mul(header.channels.bytes_per_pixel);
    if decoded > bytes.len().saturating_mul(1100).saturating_add(1 << 20) {
        let what = format!("says that it has {width}x{height} pixels, but is {} bytes long", bytes.len());
        return Err(Problem::new(what).help(help));
    }
    if header.channels.list.iter().any(|c| c.sampling.area() != 1) {
        return Err(Problem::new("has subsampled channels").expected("a value for every pixel in each channel"));
    }
    // The B44 decompression of the crate `exr` panics on some damaged blocks. These files are refused, too.
    let decode = || {
        read_exr()
            .no_deep_data()
            .largest_resolution_level()
            .all_channels()
            .first_valid_layer()
            .all_attributes()
            .non_parallel()
            .from_buffered(Cursor::new(bytes))
            .map_err(problem)
    };
    let image = std::panic::catch_unwind(decode).unwrap_or_else(|_| Err(Problem::new("is damaged").help(help)))?;
    let layer = image.layer_data;
    let (width, height) = (layer.size.width(), layer.size.height());
    let metadata = texts(layer.attributes.other.iter().chain(&image.attributes.other));
    let mut whole = Vec::new();
    let floats = layer.channel_data.list.into_iter().filter_map(|channel| match channel.sample_data {
        FlatSamples::U32(values) => {
            whole.push((channel.name.to_string(), values));
            None
        }
        _ => Some(channel),
    });
    let floats: Vec<_> = floats.collect();
    let mut channels: Vec<(String, Vec<f32>)> = floats
        .into_iter()
        .map(|c| (c.name.to_string(), c.sample_data.values_as_f32().collect::<Vec<f32>>()))
        .filter(|(_, values)| values.len() == width * height)
        .collect();
    let mut take = |name: &str| {
        let index = channels.iter().position(|(n, _)| n == name)?;
        Some(channels.remove(index).1)
    };
    let alpha = take("A");
    let color = match (take("R"), take("G"), take("B")) {
        (Some(r), Some(g), Some(b)) => Some((r, g, b)),
        _ => take("Y").map(|y| (y.clone(), y.clone(), y)),
    };
    let color = color.map(|(r, g, b)| {
        let a = alpha.as_deref();
        (0..r.len()).map(|i| [r[i], g[i], b[i], a.map_or(1.0, |a| a[i])]).collect()
    });
    let depth = take("Z");
    let weight = take("weight");
    let normal = match (take("normal.X"), take("normal.Y"), take("normal.Z")) {
        (Some(x), Some(y), Some(z)) => Some((0..x.len()).map(|i| [x[i], y[i], z[i]]).collect()),
        _ => None,
    };
    whole.retain(|(_, values): &(_, Vec<u32>)| values.len() == width * height);
    let (width, height, other) = (width as u32, height as u32, channels);
    Ok(Planes { width, height, color, depth, normal, weight, other, whole, metadata })
}

/// Returns names and values of the text attributes, sorted by name.
fn texts<'a>(attributes: impl Iterator<Item = (&'a Text, &'a AttributeValue)>) -> Vec<(String, String)> {
    let text = |(name, value): (&Text, &AttributeValue)| match value {
        AttributeValue::Text(text) => Some((name.to_string(), text.to_string())),
        _ => None,
    };
    let mut texts: Vec<_> = attributes.filter_map(text).collect();
    texts.sort();
    texts
}

/// Number of image rows that [`write_exr`] compresses together as one block.
const BLOCK_LINES: usize = 16;
/// Largest number of channels that [`tile_header`] accepts in a tile of an image.
const MAX_CHANNELS: usize = 64;

/// Reader of the lines of an EXR file, with one block in memory. A line has the samples of one channel after another,
/// in native byte order.
pub(super) struct ExrRows {
    chunks: AllChunksReader<BufReader<File>>,
    block: Vec<u8>,
    line_bytes: usize,
    /// Number of the next row of the image, counted from the top. The field `at` is the byte offset in `block` at which
    /// this row begins.
    y: usize,
    at: usize,
}

impl ExrRows {
    pub(super) fn open(file: BufReader<File>) -> Result<(ImageHeader, Self), Problem> {
        let reader = exr::block::read(file, false).map_err(|e| damaged(&e.to_string()))?;
        let header = tile_header(reader.headers())?;
        let channels = header.channels.list.iter().map(|channel| match channel.sample_type {
            SampleType::F16 => (channel.name.to_string(), 2, 'h'),
            SampleType::F32 => (channel.name.to_string(), 4, 'f'),
            SampleType::U32 => (channel.name.to_string(), 4, 'u'),
        });
        let size = [header.layer_size.width(), header.layer_size.height()];
        let [width, height] = size.map(|side| u32::try_from(side).unwrap_or(u32::MAX));
        check_side(width, height)?;
        let found = ImageHeader {
            width,
            height,
            samples: Samples::Exr(channels.collect()),
            metadata: texts(header.own_attributes.other.iter().chain(&header.shared_attributes.other)),
        };
        let line_bytes = header.channels.bytes_per_pixel * size[0];
        let chunks = reader.all_chunks(false).map_err(|e| damaged(&e.to_string()))?;
        Ok((found, Self { chunks, block: Vec::new(), line_bytes, y: 0, at: 0 }))
    }

    pub(super) fn next(&mut self) -> Result<&[u8], Problem> {
        if self.at >= self.block.len() {
            let failed = |e: exr::error::Error| damaged(&e.to_string());
            let chunk = self.chunks.next().ok_or_else(|| damaged("it ends early"))?.map_err(failed)?;
            let meta = exr::block::reader::ChunksReader::meta_data(&self.chunks);
            let block = UncompressedBlock::decompress_chunk(chunk, meta, false).map_err(failed)?;
            if block.index.pixel_position != Vec2(0, self.y) || block.data.len() < self.line_bytes {
                return Err(damaged("its lines are not in order"));
            }
            (self.block, self.at) = (block.data, 0);
        }
        let line = self.at..self.at + self.line_bytes;
        (self.y, self.at) = (self.y + 1, line.end);
        self.block.get(line).ok_or_else(|| damaged("a line is cut off"))
    }
}

/// Returns the header of an EXR file that has the layout of [`write_exr`], so that its rows can be stitched. Returns an
/// error for other files.
fn tile_header(headers: &[Header]) -> Result<&Header, Problem> {
    let ours = |header: &&Header| {
        !header.deep
            && header.compression == Compression::ZIP16
            && header.blocks == exr::meta::BlockDescription::ScanLines
            && header.line_order == LineOrder::Increasing
            && (1..=MAX_CHANNELS).contains(&header.channels.list.len())
            && header.channels.list.iter().all(|c| c.sampling.area() == 1)
    };
    match headers {
        [header] => Some(header).filter(ours),
        _ => None,
    }
    .ok_or_else(|| {
        Problem::new("is an OpenEXR that surfel wouldn't write")
            .expected("one part of flat lines in increasing order with ZIP compression, 16 lines a block")
    })
}

/// Writes an EXR image of `size` pixels whose rows the function `next` provides. The header is that of the file `like`,
/// except for size and texts. The bytes are equal to those that [`write_exr`] writes for the same pixels.
pub(super) fn write_rows(
    sink: &mut BufWriter<File>,
    [width, height]: [u32; 2],
    like: &Path,
    metadata: &[(String, String)],
    mut next: impl FnMut(&mut [u8]) -> io::Result<()>,
) -> io::Result<()> {
    let meta = MetaData::read_from_file(like, false).map_err(io::Error::other)?;
    let mut header = tile_header(&meta.headers).map_err(|problem| io::Error::other(problem.to_string()))?.clone();
    let size = Vec2(width as usize, height as usize);
    header.layer_size = size;
    header.shared_attributes.display_window = IntegerBounds::from_dimensions(size);
    header.own_attributes.other.retain(|_, value| !matches!(value, AttributeValue::Text(_)));
    for (name, value) in metadata {
        header.own_attributes.other.insert(attribute_name(name), AttributeValue::Text(latin(value)));
    }
    let header =
        header.with_encoding(Compression::ZIP16, exr::meta::BlockDescription::ScanLines, LineOrder::Increasing);
    let line_bytes = header.channels.bytes_per_pixel * size.width();
    let written = exr::block::write(&mut *sink, [header].into_iter().collect(), true, |meta, chunks| {
        for (i, index) in exr::block::enumerate_ordered_header_block_indices(&meta.headers) {
            let mut data = vec![0; line_bytes * index.pixel_size.height().min(BLOCK_LINES)];
            data.chunks_exact_mut(line_bytes).try_for_each(&mut next)?;
            chunks.write_chunk(i, UncompressedBlock { index, data }.compress_to_chunk(&meta.headers)?)?;
        }
        Ok(())
    });
    written.map_err(io::Error::other)?;
    // The header precedes the pixels, and is small except for its texts.
    sink.flush()?;
    let texts: usize = metadata.iter().map(|(name, value)| name.len() + value.len() + 64).sum();
    let mut start = Vec::new();
    let mut file: &File = sink.get_ref();
    file.seek(SeekFrom::Start(0))?;
    file.take((texts + (1 << 16)) as u64).read_to_end(&mut start)?;
    sort_attributes(&mut start);
    file.seek(SeekFrom::Start(0))?;
    file.write_all(&start)
}

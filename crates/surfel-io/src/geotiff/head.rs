//! The head of a cloud-optimised GeoTIFF: header, directories of the image and its overviews, and tile offsets.

use super::{GeoImage, GeoSamples, TILE};
use std::io;

/// Structural metadata of GDAL, written after the header. They state that all directories precede all tiles, so that
/// readers can rely on it. The blank at the end reserves room for YES, which a program that modifies the file writes
/// there.
const STRUCTURE: &str = "LAYOUT=IFDS_BEFORE_DATA\nKNOWN_INCOMPATIBLE_EDITION=NO\n ";

const SHORT: u16 = 3;
const LONG: u16 = 4;
const ASCII: u16 = 2;
const DOUBLE: u16 = 12;
const LONG8: u16 = 16;

/// Byte offsets in the file and lengths in bytes of the tiles of the image or of one overview, row by row.
pub(super) struct TileList {
    pub(super) offsets: Vec<u64>,
    pub(super) lengths: Vec<u32>,
}

impl TileList {
    pub(super) fn new(count: usize) -> Self {
        Self { offsets: vec![0; count], lengths: vec![0; count] }
    }
}

/// The part of a GeoTIFF before its tiles: header and directories.
pub(super) struct Head<'a> {
    pub(super) image: &'a GeoImage,
    /// Width and height in pixels of the image, and then of each overview.
    pub(super) sizes: &'a [[u32; 2]],
    pub(super) is_big: bool,
}

/// An entry of a TIFF directory. Entries for tile offsets and lengths (`is_list`) have their values after all
/// directories, unless these fit into the entry.
struct Entry {
    tag: u16,
    kind: u16,
    count: usize,
    bytes: Vec<u8>,
    is_list: bool,
}

impl Entry {
    fn new(tag: u16, kind: u16, count: usize, bytes: Vec<u8>) -> Self {
        Self { tag, kind, count, bytes, is_list: false }
    }

    fn short(tag: u16, values: &[u16]) -> Self {
        Self::new(tag, SHORT, values.len(), values.iter().flat_map(|v| v.to_le_bytes()).collect())
    }

    fn long(tag: u16, values: &[u32]) -> Self {
        Self::new(tag, LONG, values.len(), values.iter().flat_map(|v| v.to_le_bytes()).collect())
    }

    fn double(tag: u16, values: &[f64]) -> Self {
        Self::new(tag, DOUBLE, values.len(), values.iter().flat_map(|v| v.to_le_bytes()).collect())
    }

    /// Creates an entry with a NUL-terminated text, without non-ASCII characters.
    fn text(tag: u16, text: &str) -> Self {
        let mut bytes: Vec<u8> = text.bytes().filter(|b| b.is_ascii() && *b != 0).collect();
        bytes.push(0);
        Self::new(tag, ASCII, bytes.len(), bytes)
    }
}

impl Head<'_> {
    /// Returns the bytes of the head. `lists` has the offsets and lengths of the tiles of the image, and then of each
    /// overview.
    pub(super) fn bytes(&self, lists: &[TileList]) -> io::Result<Vec<u8>> {
        let mut out = Vec::new();
        out.extend(if self.is_big { &b"II\x2b\0\x08\0\0\0"[..] } else { &b"II\x2a\0"[..] });
        let first = out.len();
        self.put_offset(0, &mut out)?;
        let length = STRUCTURE.len();
        out.extend(format!("GDAL_STRUCTURAL_METADATA_SIZE={length:06} bytes\n{STRUCTURE}").bytes());
        let mut link = first;
        let mut late: Vec<(usize, Vec<u8>)> = Vec::new();
        for (level, list) in lists.iter().enumerate() {
            even(&mut out);
            self.patch(link, out.len(), &mut out)?;
            link = self.directory(self.entries(level, list)?, &mut out, &mut late)?;
        }
        for (place, bytes) in late {
            even(&mut out);
            self.patch(place, out.len(), &mut out)?;
            out.extend(bytes);
        }
        even(&mut out);
        Ok(out)
    }

    /// Appends a directory and the values that don't fit into its entries. Values of lists are appended to `late`
    /// instead, each with the position of its offset in the file. Returns the position at which the offset of the next
    /// directory is stored.
    fn directory(&self, entries: Vec<Entry>, out: &mut Vec<u8>, late: &mut Vec<(usize, Vec<u8>)>) -> io::Result<usize> {
        let room = if self.is_big { 8 } else { 4 };
        let mut values = Vec::new();
        if self.is_big {
            out.extend((entries.len() as u64).to_le_bytes());
        } else {
            out.extend((entries.len() as u16).to_le_bytes());
        }
        for entry in entries {
            out.extend(entry.tag.to_le_bytes());
            out.extend(entry.kind.to_le_bytes());
            self.put_offset(entry.count as u64, out)?;
            let place = out.len();
            if entry.bytes.len() <= room {
                out.extend(&entry.bytes);
                out.resize(place + room, 0);
            } else {
                out.resize(place + room, 0);
                if entry.is_list { late.push((place, entry.bytes)) } else { values.push((place, entry.bytes)) }
            }
        }
        let link = out.len();
        self.put_offset(0, out)?;
        for (place, bytes) in values {
            even(out);
            self.patch(place, out.len(), out)?;
            out.extend(bytes);
        }
        Ok(link)
    }

    /// Appends a file offset or a count, in 8 bytes for a BigTIFF, else in 4.
    fn put_offset(&self, value: u64, out: &mut Vec<u8>) -> io::Result<()> {
        match self.is_big {
            true => out.extend(value.to_le_bytes()),
            false => out.extend(u32::try_from(value).map_err(io::Error::other)?.to_le_bytes()),
        }
        Ok(())
    }

    fn patch(&self, place: usize, value: usize, out: &mut [u8]) -> io::Result<()> {
        let mut bytes = Vec::new();
        self.put_offset(value as u64, &mut bytes)?;
        out[place..place + bytes.len()].copy_from_slice(&bytes);
        Ok(())
    }

    /// Returns the directory entries of the image (level 0) or of an overview, sorted by tag.
    fn entries(&self, level: usize, list: &TileList) -> io::Result<Vec<Entry>> {
        let (image, size) = (self.image, self.sizes[level]);
        let count = image.count();
        let mut entries = vec![
            // Reduced-resolution flag.
            Entry::long(254, &[u32::from(level > 0)]),
            Entry::long(256, &[size[0]]),
            Entry::long(257, &[size[1]]),
            // Deflate.
            Entry::short(259, &[8]),
            Entry::short(277, &[count as u16]),
            Entry::short(284, &[1]),
            Entry::long(322, &[TILE]),
            Entry::long(323, &[TILE]),
        ];
        match image.samples {
            GeoSamples::Rgba8 => {
                entries.push(Entry::short(258, &vec![8; count]));
                entries.push(Entry::short(262, &[2]));
                // Straight alpha, then an unspecified band.
                entries.push(Entry::short(338, &[2, 0][..count - 3]));
                entries.push(Entry::short(317, &[2]));
            }
            GeoSamples::F32(_) => {
                entries.push(Entry::short(258, &vec![32; count]));
                entries.push(Entry::short(262, &[1]));
                if count > 1 {
                    entries.push(Entry::short(338, &vec![0; count - 1]));
                }
                entries.push(Entry::short(339, &vec![3; count]));
                entries.push(Entry::short(317, &[3]));
                entries.push(Entry::text(42_113, &format!("{}", GeoSamples::NODATA)));
            }
        }
        let offsets = match self.is_big {
            true => {
                Entry::new(324, LONG8, list.offsets.len(), list.offsets.iter().flat_map(|v| v.to_le_bytes()).collect())
            }
            false => {
                let short: Result<Vec<u32>, _> = list.offsets.iter().map(|v| u32::try_from(*v)).collect();
                Entry::long(324, &short.map_err(io::Error::other)?)
            }
        };
        entries.push(Entry { is_list: true, ..offsets });
        entries.push(Entry { is_list: true, ..Entry::long(325, &list.lengths) });
        if level == 0 {
            self.add_place(&mut entries);
        }
        entries.sort_by_key(|entry| entry.tag);
        Ok(entries)
    }

    /// Adds the entries that describe the whole image: georeference, band names and software.
    fn add_place(&self, entries: &mut Vec<Entry>) {
        let image = self.image;
        let software: String = image.software.chars().filter(char::is_ascii_graphic).collect();
        entries.push(Entry::text(305, &software));
        if !image.bands.is_empty() {
            let item = |(band, name): (usize, &&str)| {
                format!("  <Item name=\"DESCRIPTION\" sample=\"{band}\" role=\"description\">{name}</Item>\n")
            };
            let items: String = image.bands.iter().enumerate().map(item).collect();
            entries.push(Entry::text(42_112, &format!("<GDALMetadata>\n{items}</GDALMetadata>\n")));
        }
        let [left, top] = image.left_top;
        entries.push(Entry::double(33_550, &[image.pixel, image.pixel, 0.0]));
        entries.push(Entry::double(33_922, &[0.0, 0.0, 0.0, left, top, 0.0]));
        let Some(crs) = &image.crs else { return };
        let crate::crs::GeoKeys { directory: keys, doubles, text } = crs.image_keys();
        entries.push(Entry::short(34_735, &keys));
        if !doubles.is_empty() {
            entries.push(Entry::double(34_736, &doubles));
        }
        if !text.is_empty() {
            entries.push(Entry::text(34_737, &text));
        }
    }
}

/// Pads the file to an even offset, where TIFF values must begin.
fn even(out: &mut Vec<u8>) {
    if out.len() % 2 == 1 {
        out.push(0);
    }
}

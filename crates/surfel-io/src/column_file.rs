//! Point files that consist of columns of numbers. They are read block by block, so that they may be larger than
//! memory. Formats are PLY, PCD, NPY, NPZ, E57, PTX, COLMAP points, text, and rows without a header, each also with
//! gzip. Text and compressed files are first converted to binary columns in a temporary file without a name.

#![cfg_attr(
    not(all(feature = "e57", feature = "npy", feature = "pcd", feature = "points")),
    allow(unused, reason = "some parts are those of one format")
)]

use crate::bytes::{Bytes, OpenFile};
use crate::content::LoadOptions;
use crate::context::Context;
use crate::crs::Crs;
use crate::error::{Fault, IoError, Problem, READ, unwritable};
use crate::files::{Siblings, most_unpacked};
use crate::format::Format;
use crate::gzip;
use crate::ply;
use crate::ply::colors::FloatColors;
use crate::point_columns::{Named, Roles};
use crate::point_count::PointCount;
use crate::strided::{NumberType, Place, Strided};
use glam::DVec3;
use std::borrow::Cow;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;
use std::sync::Arc;
use surfel_model::{TableColumns, Up};

/// Maximum number of columns of a point file. Files with more don't count as point files: [`ColumnFile::open`] returns
/// `None`.
const MAX_COLUMNS: usize = 128;
/// Number of bytes at the start of a file that are read to detect its format; for PCD files and compressed files, more
/// are read. The number of points of a text file is estimated from as many bytes each at its start, middle and end.
const HEAD_BYTES: usize = 1 << 16;

/// An open point file of one of this module's formats, whose columns are read block by block.
#[derive(Clone, Debug)]
pub(crate) struct ColumnFile {
    pub(crate) format: Format,
    pub(crate) names: Vec<String>,
    pub(crate) places: Vec<Place>,
    pub(crate) roles: Roles,
    pub(crate) rows: usize,
    pub(crate) notes: Vec<String>,
    /// Position of the scanner in file coordinates, if one scanner recorded all points.
    pub(crate) viewpoint: Option<DVec3>,
    pub(crate) crs: Crs,
    /// Encoding of colours that are stored as floats. Only files whose number types are meaningful use it
    /// ([`Self::is_typed`]).
    pub(crate) float_colors: FloatColors,
    /// Temporary file with the columns of a text or compressed file. `None` if the columns are read from the file
    /// itself.
    unpacked: Option<Arc<OpenFile>>,
}

/// Format, estimated number of points and up axis of a point file, from its header or from samples of its data.
pub(crate) struct Survey {
    pub(crate) format: Format,
    pub(crate) count: PointCount,
    /// Up axis, if the file states it.
    pub(crate) up: Option<Up>,
}

/// Detects the format of a point file from its first bytes (`head`). XYZ and PTS files also need their extension, and
/// binary COLMAP points all `bytes`. A binary file without a header is only a point file if `columns` states types for
/// its rows. Returns `None` for unsupported files, but may return a format that isn't one of points.
fn format_of(path: &Path, head: &[u8], bytes: Bytes<'_>, columns: Option<&TableColumns>) -> Option<Format> {
    let format = Format::from_signature(head, None).ok()?;
    #[cfg(feature = "pcd")]
    let format = format.or(crate::pcd::looks_like(&head[..head.len().min(4096)]).then_some(Format::Pcd));
    let format = format.or(crate::raw_rows::is_raw(path, head, columns).then_some(Format::Raw));
    #[cfg(feature = "points")]
    let format = format.or_else(|| {
        if crate::points::looks_like_ptx(head) {
            return Some(Format::Ptx);
        }
        let hint = Format::from_extension(path);
        let is_colmap =
            || crate::colmap_points::looks_like(path, head) || crate::colmap_points::looks_like_binary(bytes);
        if matches!(hint, None | Some(Format::Xyz)) && columns.is_none() && is_colmap() {
            return Some(Format::Colmap);
        }
        let named = hint.filter(|f| matches!(f, Format::Xyz | Format::Pts))?;
        let is_table = crate::text_rows::looks_like(head) || crate::text_rows::is_table(head);
        (is_table || columns.is_some() && !crate::format::is_binary(head)).then_some(named)
    });
    format
}

/// Returns the first bytes of a file, as many as the detection of its format needs.
fn head_of(bytes: Bytes<'_>) -> Cow<'_, [u8]> {
    let head = bytes.at_most(0, HEAD_BYTES);
    #[cfg(feature = "pcd")]
    if crate::pcd::looks_like(&head) {
        return bytes.at_most(0, crate::pcd::Table::HEAD_BYTES);
    }
    head
}

/// Returns a context for a reader that needs one, without access to other files. It collects the reader's notes.
fn context(options: &LoadOptions) -> Context<'_> {
    Context::new(options, Siblings::None)
}

/// Detects format and up axis of a point file, and estimates its number of points, from its header or from samples of
/// its data. Returns `None` for other files, for invalid headers, and for files that have no points or are too short
/// for the stated number.
pub(crate) fn survey(path: &Path, columns: Option<&TableColumns>) -> Option<Survey> {
    let file = OpenFile::open_any(path)?;
    let bytes = file.bytes();
    if !gzip::is_gzip(&bytes.at_most(0, 4)) {
        return survey_of(path, bytes, [bytes.len() as u64; 2], columns);
    }
    let (head, all) = gzip::head(bytes, 4 * HEAD_BYTES);
    survey_of(path, Bytes::Memory(&head), [all, most_unpacked(bytes.len())], columns)
}

/// Implements [`survey`] for `bytes`, which may be only the unpacked start of a compressed file. `all` is the estimated
/// size of the unpacked file in bytes, and `most` the largest possible size.
fn survey_of(path: &Path, bytes: Bytes<'_>, [all, most]: [u64; 2], columns: Option<&TableColumns>) -> Option<Survey> {
    let head = head_of(bytes);
    let format = format_of(path, &head, bytes, columns)?;
    // Points are assumed to have colours unless the start of the file shows that they have none.
    let (mut has_normals, mut has_colors) = (false, true);
    let (points, least_bytes, up) = match format {
        Format::Ply => {
            let vertices = ply::points::Vertices::of(bytes).ok()??;
            (has_normals, has_colors) = (vertices.has("nx"), vertices.has("red"));
            (vertices.points(), vertices.least_bytes(), vertices.up())
        }
        #[cfg(feature = "pcd")]
        Format::Pcd => {
            let table = crate::pcd::Table::of(&head).ok()?;
            let up = table.up(&mut context(&LoadOptions::default()));
            (has_normals, has_colors) = (table.has("normal_x"), table.has("rgb") || table.has("rgba"));
            (table.points() as u64, table.least_bytes() as u64, up)
        }
        #[cfg(feature = "npy")]
        Format::Npy => {
            let array = crate::npy::survey(bytes)?;
            (has_normals, has_colors) = (array.has_normals, array.has_colors);
            (array.points, array.bytes, None)
        }
        #[cfg(feature = "npy")]
        Format::Npz => {
            let arrays = crate::npy::Members::of(bytes).ok()?.survey()?;
            (has_normals, has_colors) = (arrays.has_normals, arrays.has_colors);
            (arrays.points, 0, None)
        }
        #[cfg(feature = "e57")]
        Format::E57 => (crate::e57::survey(&mut bytes.source()).ok()?, 0, None),
        Format::Raw => (all / columns?.row_bytes().max(1) as u64, 0, None),
        #[cfg(feature = "points")]
        Format::Colmap if crate::format::is_binary(&head) => (crate::colmap_points::count(bytes)?, 0, None),
        #[cfg(feature = "points")]
        Format::Xyz | Format::Pts | Format::Ptx | Format::Colmap => {
            // Points with positions and colours have at least six numbers a line.
            has_colors = head.split(|b| *b == b'\n').take(2).any(|line| line.split(|b| *b <= b',').count() > 5);
            // Estimates the number of lines from samples at the start, the middle and the end.
            let places = [0, bytes.len() / 2, bytes.len().saturating_sub(HEAD_BYTES)];
            let (mut seen, mut lines) = (0, 1);
            for part in places.map(|start| bytes.at_most(start, HEAD_BYTES)) {
                seen += part.len();
                lines += part.iter().filter(|b| **b == b'\n').count();
            }
            ((all as f64 * lines as f64 / seen as f64) as u64, 0, None)
        }
        _ => return None,
    };
    let row_bytes = all / points.max(1);
    let count = PointCount { points, has_radii: false, has_normals, has_colors, row_bytes };
    (points > 0 && least_bytes <= most).then_some(Survey { format, count, up })
}

impl ColumnFile {
    /// Opens a point file. Returns `None` for other files, for files of splats, for files that can't be opened, and for
    /// files with more than [`MAX_COLUMNS`] columns. Text and compressed data are unpacked to a temporary file in
    /// `folder`.
    pub(crate) fn open(path: &Path, folder: &Path, columns: Option<&TableColumns>) -> Result<Option<Self>, IoError> {
        let Some(file) = OpenFile::open_any(path) else { return Ok(None) };
        let opened = Self::of_any(path, file.bytes(), folder, columns).map_err(|fault| fault.of(path))?;
        let system = |source| IoError::System { path: path.to_path_buf(), action: READ, source };
        file.failure().map_or(Ok(opened), |source| Err(system(source)))
    }

    fn of_any(
        path: &Path,
        bytes: Bytes<'_>,
        folder: &Path,
        columns: Option<&TableColumns>,
    ) -> Result<Option<Self>, Fault> {
        if !gzip::is_gzip(&bytes.at_most(0, 4)) {
            return Self::of(path, bytes, folder, columns);
        }
        let (head, _) = gzip::head(bytes, 4 * HEAD_BYTES);
        if format_of(path, &head, Bytes::Memory(&head), columns).is_none() {
            return Ok(None);
        }
        let mut out = Unnamed::new(folder);
        gzip::unpack(bytes, &mut out)?;
        let opened = Self::of(path, out.written()?, folder, columns)?;
        let inside = out.finished.map(Arc::new);
        Ok(opened.map(|opened| Self { unpacked: opened.unpacked.or(inside), ..opened }))
    }

    fn of(path: &Path, bytes: Bytes<'_>, folder: &Path, columns: Option<&TableColumns>) -> Result<Option<Self>, Fault> {
        let head = head_of(bytes);
        let Some(format) = format_of(path, &head, bytes, columns) else { return Ok(None) };
        let options = LoadOptions { columns: columns.cloned(), ..LoadOptions::default() };
        let mut context = context(&options);
        let mut out = Unnamed::new(folder);
        // Only E57 files have a viewpoint here, and only E57 and PLY files a coordinate reference system.
        let (mut viewpoint, mut crs) = (None, Crs::default());
        let mut float_colors = FloatColors::Linear;
        let (columns, mut roles) = match format {
            Format::Ply => {
                let Some(vertices) = ply::points::Vertices::of(bytes)? else { return Ok(None) };
                float_colors = vertices.float_colors();
                crs = vertices.crs();
                let is_unpacked = vertices.unpack(bytes, &mut out)?;
                vertices.columns(if is_unpacked { out.written()? } else { bytes }, is_unpacked)?
            }
            #[cfg(feature = "pcd")]
            Format::Pcd => {
                let table = crate::pcd::Table::of(&head)?;
                let is_unpacked = table.unpack(bytes, &mut out)?;
                table.columns(if is_unpacked { out.written()? } else { bytes }, is_unpacked, &mut context)?
            }
            #[cfg(feature = "npy")]
            Format::Npy => crate::npy::columns_in(bytes, &mut context)?,
            #[cfg(feature = "npy")]
            Format::Npz => {
                let members = crate::npy::Members::of(bytes)?;
                let unpacked = if members.unpack(&mut out)? { Some(out.written()?) } else { None };
                let Some(found) = members.columns(unpacked, &mut context)? else { return Ok(None) };
                found
            }
            #[cfg(feature = "e57")]
            Format::E57 => {
                let table = crate::e57::unpack(&mut bytes.source(), &mut out, &mut context.notes)?;
                (viewpoint, crs) = (table.viewpoint, table.crs.clone());
                table.columns(out.written()?)
            }
            Format::Raw => {
                let Some(columns) = columns else { return Ok(None) };
                crate::raw_rows::columns_in(bytes, columns)?
            }
            #[cfg(feature = "points")]
            Format::Xyz | Format::Pts | Format::Ptx | Format::Colmap => {
                let table = match format {
                    Format::Colmap => crate::colmap_points::unpack(bytes, &mut out)?,
                    Format::Ptx => crate::points::unpack_ptx(bytes, &mut out, None, &mut context)?,
                    _ => crate::points::unpack(bytes, format == Format::Pts, &mut out, &mut context)?,
                };
                table.columns(out.written()?, &mut context)?
            }
            _ => return Ok(None),
        };
        if roles.are_splats() || columns.len() > MAX_COLUMNS {
            return Ok(None);
        }
        let places = columns.iter().map(|c| c.values.place()).collect::<Option<Vec<Place>>>();
        let rows = columns.first().map_or(0, |c| c.values.len());
        let (Some(mut places), true) = (places, rows > 0) else {
            return Err(Problem::new("holds no point").expected("at least one").into());
        };
        let names = columns.into_iter().map(|Named { name, .. }| name).collect();
        roles.packed_color = roles.packed_color.filter(|(i, _)| {
            let is_four_bytes = matches!(places[*i].kind, NumberType::I32 | NumberType::U32 | NumberType::F32);
            if is_four_bytes {
                places[*i].kind = NumberType::U32;
            }
            is_four_bytes
        });
        let unpacked = out.finished.map(Arc::new);
        Ok(Some(Self {
            format,
            names,
            places,
            roles,
            rows,
            notes: context.notes,
            viewpoint,
            crs,
            float_colors,
            unpacked,
        }))
    }

    /// True if the file's number types define the range of colours and the precision of coordinates, as in PLY and E57
    /// files. In other formats colours are sRGB-encoded and their range is estimated from their values.
    pub(crate) fn is_typed(&self) -> bool {
        matches!(self.format, Format::Ply | Format::E57)
    }

    /// True if the file's numbers count as printed text without types: XYZ, PTS, PTX and COLMAP points, even binary
    /// ones. PLY and PCD files never do, because their headers state number types.
    pub(crate) fn is_text(&self) -> bool {
        matches!(self.format, Format::Xyz | Format::Pts | Format::Ptx | Format::Colmap)
    }

    /// Passes the file's columns to `f` and returns the result of `f`. `path` must be the path of the file that was
    /// opened.
    pub(crate) fn with<R>(&self, path: &Path, f: impl FnOnce(&[Strided<'_>]) -> R) -> Result<R, IoError> {
        let system = |source| IoError::System { path: path.to_path_buf(), action: READ, source };
        let own = match &self.unpacked {
            Some(_) => None,
            None => Some(OpenFile::open_any(path).ok_or_else(|| system(io::ErrorKind::NotFound.into()))?),
        };
        let Some(file) = own.as_ref().or(self.unpacked.as_deref()) else {
            return Err(system(io::ErrorKind::NotFound.into()));
        };
        let columns: Option<Vec<Strided<'_>>> = self.places.iter().map(|place| place.of(file.bytes())).collect();
        let changed = || io::Error::other("it has changed since it was opened");
        let columns = columns.ok_or_else(|| system(changed()))?;
        let made = f(&columns);
        match file.failed() {
            Some(error) => Err(system(error)),
            None => Ok(made),
        }
    }
}

/// Writer to a temporary file without a name in `folder`. The file is created when the first bytes are written.
struct Unnamed<'a> {
    folder: &'a Path,
    file: Option<BufWriter<File>>,
    bytes: usize,
    finished: Option<OpenFile>,
}

impl<'a> Unnamed<'a> {
    fn new(folder: &'a Path) -> Self {
        Self { folder, file: None, bytes: 0, finished: None }
    }

    /// Returns all bytes that were written, for reading. Must be called only once, after all bytes were written.
    fn written(&mut self) -> Result<Bytes<'_>, Problem> {
        let Some(file) = self.file.take() else { return Ok(Bytes::Memory(&[])) };
        let file = file.into_inner().map_err(|error| unwritable(error.into_error()))?;
        Ok(self.finished.insert(OpenFile::of(file, self.bytes)).bytes())
    }
}

impl Write for Unnamed<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let file = match &mut self.file {
            Some(file) => file,
            none => none.insert(BufWriter::with_capacity(1 << 20, tempfile::tempfile_in(self.folder)?)),
        };
        let written = file.write(bytes)?;
        self.bytes += written;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.as_mut().map_or(Ok(()), Write::flush)
    }
}

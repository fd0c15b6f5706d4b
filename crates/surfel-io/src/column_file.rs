//! Files whose points are columns of numbers, read block by block, so that there may be more of them than fit into
//! memory: PLY, PCD, NPY and text. Text and compressed points become binary ones first, in a file without a name.

use crate::bytes::{Bytes, OpenFile};
use crate::content::LoadOptions;
use crate::context::Context;
use crate::error::{Fault, IoError, Problem, READ};
use crate::files::Siblings;
use crate::format::Format;
use crate::ply;
use crate::point_columns::{Named, Roles};
use crate::strided::{NumberType, Place, Strided};
use std::borrow::Cow;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;
use std::sync::Arc;
use surfel_model::Up;

/// Most columns of such a file.
const MAX_COLUMNS: usize = 128;
/// Bytes at the start of a file by which its format is told, and by which the points of a text are counted.
const HEAD_BYTES: usize = 1 << 16;

/// A file of columns that are read block by block.
#[derive(Clone, Debug)]
pub(crate) struct ColumnFile {
    pub(crate) format: Format,
    pub(crate) names: Vec<String>,
    pub(crate) places: Vec<Place>,
    pub(crate) roles: Roles,
    pub(crate) rows: usize,
    pub(crate) notes: Vec<String>,
    /// Where the columns are, if not in the file itself.
    unpacked: Option<Arc<OpenFile>>,
}

/// What the start of a file says.
pub(crate) struct Survey {
    pub(crate) format: Format,
    /// How many points there are; of text it is an estimate.
    pub(crate) points: u64,
    /// Which axis is up, if it says so.
    pub(crate) up: Option<Up>,
}

/// A header that is parsed.
enum Head<'a> {
    Ply(ply::points::Vertices),
    #[cfg(feature = "pcd")]
    Pcd(crate::pcd::Table<'a>),
    #[cfg(feature = "npy")]
    Npy,
    #[cfg(feature = "points")]
    Text {
        pts: bool,
    },
    #[allow(dead_code)]
    Never(&'a ()),
}

impl<'a> Head<'a> {
    /// `None` of a file of another format, or of one that holds anything but points.
    fn of(format: Option<Format>, bytes: Bytes<'_>, head: &'a [u8]) -> Result<Option<Self>, Fault> {
        Ok(match format {
            Some(Format::Ply) => ply::points::Vertices::of(bytes)?.map(Self::Ply),
            #[cfg(feature = "pcd")]
            Some(Format::Pcd) => Some(Self::Pcd(crate::pcd::Table::of(head)?)),
            #[cfg(feature = "npy")]
            Some(Format::Npy) => Some(Self::Npy),
            #[cfg(feature = "points")]
            Some(Format::Xyz | Format::Pts) => Some(Self::Text { pts: format == Some(Format::Pts) }),
            _ => None,
        })
    }
}

/// The format by the file's first bytes, and by its name where it is text.
fn format_of(path: &Path, head: &[u8]) -> Option<Format> {
    let format = Format::from_signature(head, None).ok()?;
    #[cfg(feature = "pcd")]
    let format = format.or(crate::pcd::looks_like(&head[..head.len().min(4096)]).then_some(Format::Pcd));
    #[cfg(feature = "points")]
    let format = format.or_else(|| {
        let named = Format::from_extension(path).filter(|f| matches!(f, Format::Xyz | Format::Pts))?;
        let is_other = crate::gzip::is_gzip(head) || crate::points::looks_like_ptx(head);
        (!is_other && crate::points::looks_like(head)).then_some(named)
    });
    #[cfg(not(feature = "points"))]
    let _ = path;
    format
}

/// First bytes of a file: enough of a PCD for its header.
fn head_of(bytes: Bytes<'_>) -> Cow<'_, [u8]> {
    let head = bytes.at_most(0, HEAD_BYTES);
    #[cfg(feature = "pcd")]
    if crate::pcd::looks_like(&head) {
        return bytes.at_most(0, crate::pcd::Table::HEAD_BYTES);
    }
    head
}

/// A context that gathers notes.
fn context(options: &LoadOptions) -> Context<'_> {
    Context::new(options, Siblings::None)
}

/// True of points with normals and radii: those are splats.
fn are_splats(roles: &Roles) -> bool {
    roles.radius.is_some() && roles.normal.is_some()
}

/// What the start of such a file says; `None` of others, and of those whose header can't be right.
pub(crate) fn survey(path: &Path) -> Option<Survey> {
    let file = OpenFile::open_any(path)?;
    let bytes = file.bytes();
    let head = head_of(bytes);
    let format = format_of(path, &head)?;
    let options = LoadOptions::default();
    let mut context = context(&options);
    let (points, least_bytes, up) = match Head::of(Some(format), bytes, &head).ok()?? {
        Head::Ply(vertices) => (vertices.points(), vertices.least_bytes(), vertices.up()),
        #[cfg(feature = "pcd")]
        Head::Pcd(table) => (table.points() as u64, table.least_bytes() as u64, table.up(&mut context)),
        #[cfg(feature = "npy")]
        Head::Npy => {
            let (columns, roles) = crate::npy::columns_in(bytes, &mut context).ok()?;
            if are_splats(&roles) {
                return None;
            }
            (columns.first()?.values.len() as u64, 0, None)
        }
        #[cfg(feature = "points")]
        Head::Text { .. } => {
            // By lines at its start, in its middle and at its end.
            let places = [0, bytes.len() / 2, bytes.len().saturating_sub(HEAD_BYTES)];
            let (mut seen, mut lines) = (0, 1);
            for part in places.map(|start| bytes.at_most(start, HEAD_BYTES)) {
                seen += part.len();
                lines += part.iter().filter(|b| **b == b'\n').count();
            }
            ((bytes.len() as f64 * lines as f64 / seen as f64) as u64, 0, None)
        }
        Head::Never(()) => return None,
    };
    (points > 0 && least_bytes <= bytes.len() as u64).then_some(Survey { format, points, up })
}

impl ColumnFile {
    /// A file of points; `None` of any other. What has to be unpacked is, to a file in `folder`.
    pub(crate) fn open(path: &Path, folder: &Path) -> Result<Option<Self>, IoError> {
        let Some(file) = OpenFile::open_any(path) else { return Ok(None) };
        let opened = Self::of(path, &file, folder).map_err(|fault| fault.of(path))?;
        let system = |source| IoError::System { path: path.to_path_buf(), action: READ, source };
        file.failure().map_or(Ok(opened), |source| Err(system(source)))
    }

    fn of(path: &Path, file: &OpenFile, folder: &Path) -> Result<Option<Self>, Fault> {
        let bytes = file.bytes();
        let head = head_of(bytes);
        let Some(format) = format_of(path, &head) else { return Ok(None) };
        let options = LoadOptions::default();
        let mut context = context(&options);
        let Some(parsed) = Head::of(Some(format), bytes, &head)? else { return Ok(None) };
        let mut out = Unnamed { folder, file: None, bytes: 0 };
        #[cfg(feature = "points")]
        let mut table = crate::points::Table::default();
        let is_unpacked = match &parsed {
            Head::Ply(vertices) => vertices.unpack(bytes, &mut out)?,
            #[cfg(feature = "pcd")]
            Head::Pcd(header) => header.unpack(bytes, &mut out)?,
            #[cfg(feature = "points")]
            Head::Text { pts } => {
                table = crate::points::unpack(bytes, *pts, &mut out, &mut context)?;
                true
            }
            _ => false,
        };
        let unpacked = out.finish().map_err(crate::error::unwritable)?.filter(|_| is_unpacked).map(Arc::new);
        let data = unpacked.as_ref().map_or(bytes, |file| file.bytes());
        let (columns, roles) = match &parsed {
            Head::Ply(vertices) => vertices.columns(data, is_unpacked)?,
            #[cfg(feature = "pcd")]
            Head::Pcd(header) => header.columns(data, is_unpacked, &mut context)?,
            #[cfg(feature = "npy")]
            Head::Npy => crate::npy::columns_in(data, &mut context)?,
            #[cfg(feature = "points")]
            Head::Text { .. } => table.columns(data, &mut context),
            Head::Never(()) => return Ok(None),
        };
        if are_splats(&roles) || columns.len() > MAX_COLUMNS {
            return Ok(None);
        }
        let places = columns.iter().map(|c| c.values.place()).collect::<Option<Vec<Place>>>();
        let rows = columns.first().map_or(0, |c| c.values.len());
        let (Some(places), true) = (places, rows > 0) else {
            return Err(Problem::new("holds no point").expected("at least one").into());
        };
        let names = columns.into_iter().map(|Named { name, .. }| name).collect();
        let (mut places, mut roles) = (places, roles);
        roles.packed_color = roles.packed_color.filter(|(i, _)| {
            let is_four_bytes = matches!(places[*i].kind, NumberType::I32 | NumberType::U32 | NumberType::F32);
            if is_four_bytes {
                places[*i].kind = NumberType::U32;
            }
            is_four_bytes
        });
        Ok(Some(Self { format, names, places, roles, rows, notes: context.notes, unpacked }))
    }

    /// Colours that are floats are linear, as in a PLY file; elsewhere they are sRGB-encoded.
    pub(crate) fn has_linear_floats(&self) -> bool {
        self.format == Format::Ply
    }

    /// True of printed numbers.
    pub(crate) fn is_text(&self) -> bool {
        matches!(self.format, Format::Xyz | Format::Pts)
    }

    /// Hands over the columns of the file at `path`, which is the one that was opened.
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

/// A file without a name in a folder, made with the first bytes.
struct Unnamed<'a> {
    folder: &'a Path,
    file: Option<BufWriter<File>>,
    bytes: usize,
}

impl Unnamed<'_> {
    fn finish(self) -> io::Result<Option<OpenFile>> {
        let Some(file) = self.file else { return Ok(None) };
        let file = file.into_inner().map_err(io::IntoInnerError::into_error)?;
        Ok(Some(OpenFile::of(file, self.bytes)))
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

//! Loading of geometry files: detection of the format, and the choice of its reader.

use crate::RegularFile;
use crate::ascii;
use crate::bytes::{Bytes, OpenFile};
#[cfg(feature = "points")]
use crate::colmap_points;
use crate::content::{Content, LoadOptions};
use crate::context::Context;
#[cfg(feature = "draco")]
use crate::drc;
#[cfg(feature = "e57")]
use crate::e57;
use crate::error::{Fault, IoError, Problem, READ, quote};
use crate::files::{self, Siblings};
use crate::format::{self, Format, KNOWN_FORMATS};
#[cfg(feature = "gltf")]
use crate::gltf;
use crate::gzip;
#[cfg(feature = "las")]
use crate::las;
use crate::loaded::{Loaded, run};
#[cfg(feature = "npy")]
use crate::npy;
#[cfg(feature = "obj")]
use crate::obj;
#[cfg(feature = "off")]
use crate::off;
#[cfg(feature = "pcd")]
use crate::pcd;
#[cfg(feature = "points")]
use crate::points;
#[cfg(any(feature = "laz", feature = "npy", feature = "pcd", feature = "points"))]
use crate::raw_rows;
#[cfg(feature = "stl")]
use crate::stl;
#[cfg(feature = "points")]
use crate::text_rows;
#[cfg(feature = "gltf")]
use crate::tileset;
use crate::{octree, ply, scene_file};
#[cfg(feature = "gaussians")]
use crate::{sog, splat_rows, spz};
use glam::DVec3;
use std::io::{Read, Seek};
use std::path::Path;
use surfel_model::PointCloud;

/// Loads splats, Gaussians, points, a mesh or an octree from a file. The content and the extension decide the format.
/// Textures, materials and buffers that the file names are read only from the file's folder and below, unless
/// [`LoadOptions::allow_outside`] is true.
///
/// # Errors
/// [`IoError::System`] if the file can't be read. [`IoError::Invalid`] if it is damaged, or in a format that this build
/// has no reader for. [`IoError::Model`] if it contains splats that violate docs/rendering-model.md, §10, and
/// `options.repair` is false.
pub fn load(path: &Path, options: &LoadOptions) -> Result<Loaded, IoError> {
    if let Some((format, mut file)) = open_seekable(path) {
        let read = |context: &mut Context<'_>| Ok((format, read_survey(format, &mut file, context)?));
        return run(read, path, Siblings::of(path, options.allow_outside), options);
    }
    if let Some((format, file)) = columns_file(path, options) {
        let read = |context: &mut Context<'_>| Ok((format, read_columns(format, file.bytes(), context)?));
        let loaded = run(read, path, Siblings::of(path, options.allow_outside), options);
        let failure = |source| IoError::System { path: path.to_path_buf(), action: READ, source };
        return file.failure().map_or(loaded, |source| Err(failure(source)));
    }
    let bytes = files::read(path, files::MAX_BYTES)?;
    load_whole(&bytes, Format::from_extension(path), path, Siblings::of(path, options.allow_outside), options)
}

/// Loads a file whose bytes are in memory. If `options` name no columns and no format is recognised, the bytes may be
/// rows of numbers without a header. They are read if their values fit exactly one common layout of columns, which a
/// note then states.
fn load_whole(
    bytes: &[u8],
    hint: Option<Format>,
    name: &Path,
    siblings: Siblings,
    options: &LoadOptions,
) -> Result<Loaded, IoError> {
    #[cfg(any(feature = "laz", feature = "npy", feature = "pcd", feature = "points"))]
    if options.columns.is_none()
        && let Some(columns) = raw_rows::detected(name, bytes)
        && recognise(bytes, hint, name, options).is_err()
    {
        let note = format!("has no header: read as rows of {columns}, which its values fit; `columns` names others");
        let options = LoadOptions { columns: Some(columns), ..options.clone() };
        let mut loaded = run(|context| read_bytes(bytes, hint, name, context), name, siblings, &options)?;
        loaded.notes.insert(0, note);
        return Ok(loaded);
    }
    run(|context| read_bytes(bytes, hint, name, context), name, siblings, options)
}

/// Properties of a file's points as a whole, which [`survey`] returns.
#[derive(Clone, Debug)]
pub struct PointSurvey {
    /// Format, up axis and notes of the file. The field `content` is an empty point cloud, and `attributes` is empty.
    pub loaded: Loaded,
    /// Minimum and maximum of the positions, in the file's units; `None` without points.
    pub bounds: Option<(DVec3, DVec3)>,
    /// Minimum and maximum of each colour channel, in linear RGB; `None` without colours.
    pub colors: Option<([f32; 3], [f32; 3])>,
}

/// Passes the points of a LAS, LAZ or COPC file to `each`, block by block, without colours and row numbers. A block
/// lacks a column if all its values are zero. Memory doesn't grow with the number of points. Returns `None` for other
/// files, and for files that can't be opened.
///
/// # Errors
/// Errors of [`load`].
#[cfg_attr(not(feature = "las"), expect(unused_variables, unused_mut, reason = "there are no other such formats"))]
pub fn survey(
    path: &Path,
    options: &LoadOptions,
    each: &mut dyn FnMut(PointCloud),
) -> Result<Option<PointSurvey>, IoError> {
    let Some((format, mut file)) = open_seekable(path).filter(|(format, _)| *format != Format::E57) else {
        return Ok(None);
    };
    #[cfg(not(feature = "las"))]
    return Ok(None);
    #[cfg(feature = "las")]
    {
        let mut found = None;
        let read = |context: &mut Context<'_>| {
            let las::blocks::Blocks { cloud, bounds, colors } = las::blocks::read(&mut file, format, each, context)?;
            found = Some((bounds, colors));
            Ok((format, Content::Points(cloud)))
        };
        let mut loaded = run(read, path, Siblings::None, options)?;
        loaded.attributes = Vec::new();
        Ok(found.map(|(bounds, colors)| PointSurvey { loaded, bounds, colors }))
    }
}

/// Opens a file that is read with seeking, so that its bytes needn't be in memory: LAS, LAZ, COPC or E57. Returns
/// `None` for other formats, and for anything that isn't a regular file.
fn open_seekable(path: &Path) -> Option<(Format, RegularFile)> {
    let mut file = RegularFile::open(path).ok()??;
    let mut head = Vec::new();
    (&mut file).take(512).read_to_end(&mut head).ok()?;
    Some((Format::from_seekable_signature(&head)?, file))
}

/// Opens a file whose columns are read in place, so that memory contains the data only once: PLY, PCD, NPY, NPZ or rows
/// of numbers without a header. Returns `None` for other formats, for files of more than [`files::MAX_BYTES`], and for
/// anything that isn't a regular file.
#[allow(unused_variables, reason = "options matter to formats that may be left out")]
fn columns_file(path: &Path, options: &LoadOptions) -> Option<(Format, OpenFile)> {
    const END_BYTES: usize = 1 << 16;
    let file = OpenFile::open(path)?;
    let bytes = file.bytes();
    let mut ends = bytes.at_most(0, END_BYTES).into_owned();
    ends.extend_from_slice(&bytes.at_most(bytes.len().saturating_sub(END_BYTES).max(ends.len()), END_BYTES));
    let format = Format::from_signature(&ends, None).ok()?;
    #[cfg(feature = "pcd")]
    let format = format.or(pcd::looks_like(&ends[..ends.len().min(4096)]).then_some(Format::Pcd));
    #[cfg(any(feature = "laz", feature = "npy", feature = "pcd", feature = "points"))]
    let format = format.or(raw_rows::is_raw(path, &ends, options.columns.as_ref()).then_some(Format::Raw));
    let is_read = |f: &Format| matches!(f, Format::Ply | Format::Pcd | Format::Npy | Format::Npz | Format::Raw);
    let format = format.filter(is_read)?;
    Some((format, file))
}

/// True if a JSON file describes geometry in other files: a 3D Tiles tileset or SOG's `meta.json`. The content decides,
/// because scene files also have names that end in `.json`.
pub fn names_geometry(path: &Path) -> bool {
    let is_known: [fn(&[u8]) -> bool; _] = [
        #[cfg(feature = "gltf")]
        tileset::looks_like,
        #[cfg(feature = "gaussians")]
        sog::looks_like,
    ];
    files::read(path, scene_file::MAX_BYTES).is_ok_and(|bytes| is_known.iter().any(|known| known(&bytes)))
}

/// Loads a file from memory, like [`load`]. `hint` is the format that the file's extension would give. `name` is the
/// file's name, for messages and for formats that the name helps to detect. Files that the data refer to aren't read.
///
/// # Errors
/// Errors of [`load`].
pub fn load_bytes(bytes: &[u8], hint: Option<Format>, name: &Path, options: &LoadOptions) -> Result<Loaded, IoError> {
    load_whole(bytes, hint, name, Siblings::None, options)
}

fn read_bytes(
    bytes: &[u8],
    hint: Option<Format>,
    name: &Path,
    context: &mut Context<'_>,
) -> Result<(Format, Content), Fault> {
    if bytes.is_empty() {
        return Err(Problem::new("is empty").into());
    }
    let mut unpacked = Vec::new();
    let is_packed = gzip::is_gzip(bytes);
    if is_packed {
        gzip::unpack(Bytes::Memory(bytes), &mut unpacked)?;
    }
    let bytes = if is_packed { &unpacked } else { bytes };
    let as_text = matches!(hint, None | Some(Format::Xyz | Format::Pts));
    let decoded = if as_text { ascii::utf8_of_utf16(bytes) } else { None };
    let bytes = decoded.as_deref().unwrap_or(bytes);
    let format = recognise(bytes, hint, name, context.options)?;
    Ok((format, read_as(format, bytes, context)?))
}

/// Detects the format of a file in memory. Signatures come first, then the content of rows that `options` describe,
/// PCD, PTX, COLMAP points and SOG, then `hint`, and last the content of the remaining formats.
#[allow(unused_variables, reason = "options matter to formats that may be left out")]
fn recognise(bytes: &[u8], hint: Option<Format>, name: &Path, options: &LoadOptions) -> Result<Format, Problem> {
    if let Some(format) = Format::from_signature(bytes, hint)? {
        return Ok(format);
    }
    let head = &bytes[..bytes.len().min(4096)];
    #[cfg(any(feature = "laz", feature = "npy", feature = "pcd", feature = "points"))]
    if raw_rows::is_raw(name, head, options.columns.as_ref()) {
        return Ok(Format::Raw);
    }
    #[cfg(feature = "pcd")]
    if pcd::looks_like(head) {
        return Ok(Format::Pcd);
    }
    #[cfg(feature = "points")]
    if points::looks_like_ptx(head) {
        return Ok(Format::Ptx);
    }
    #[cfg(feature = "points")]
    if matches!(hint, None | Some(Format::Xyz))
        && options.columns.is_none()
        && (colmap_points::looks_like(name, head) || colmap_points::looks_like_binary(Bytes::Memory(bytes)))
    {
        return Ok(Format::Colmap);
    }
    #[cfg(feature = "gaussians")]
    if matches!(hint, None | Some(Format::Sog)) && head.trim_ascii_start().starts_with(b"{") && sog::looks_like(bytes) {
        return Ok(Format::Sog);
    }
    if let Some(format) = hint {
        return Ok(format);
    }
    if let Some(problem) = format::unsupported_by_extension(name) {
        return Err(problem);
    }
    #[cfg(feature = "stl")]
    if stl::looks_like(bytes) {
        return Ok(Format::Stl);
    }
    #[cfg(feature = "gltf")]
    if tileset::looks_like(bytes) {
        return Ok(Format::Tileset);
    }
    // A row of numbers may begin with any byte.
    if head.trim_ascii_start().starts_with(b"{") && !format::is_binary(head) {
        return Ok(Format::Gltf);
    }
    #[cfg(feature = "off")]
    if off::looks_like(head) {
        return Ok(Format::Off);
    }
    #[cfg(feature = "obj")]
    if obj::looks_like(head) {
        return Ok(Format::Obj);
    }
    #[cfg(feature = "points")]
    if text_rows::looks_like(head) || options.columns.is_some() && !format::is_binary(head) {
        return Ok(Format::Xyz);
    }
    let found = quote(&head[..head.len().min(12)]);
    let problem = Problem::new(format!("is in no format that Surfel knows: it starts with {found}"));
    let problem = problem.expected(KNOWN_FORMATS);
    #[cfg(any(feature = "laz", feature = "npy", feature = "pcd", feature = "points"))]
    if format::is_binary(head) {
        return Err(problem.help(raw_rows::RAW_HELP));
    }
    Err(problem)
}

fn read_as(format: Format, bytes: &[u8], context: &mut Context<'_>) -> Result<Content, Fault> {
    match format {
        Format::Ply | Format::Pcd | Format::Npy | Format::Npz | Format::Raw => {
            read_columns(format, Bytes::Memory(bytes), context)
        }
        Format::Surfel => octree::read(bytes, context),
        #[cfg(feature = "obj")]
        Format::Obj => obj::read(bytes, context),
        #[cfg(feature = "stl")]
        Format::Stl => stl::read(bytes, context),
        #[cfg(feature = "gltf")]
        Format::Gltf | Format::Glb => gltf::read(bytes, context),
        #[cfg(feature = "gltf")]
        Format::Tileset => tileset::read(bytes, context),
        #[cfg(feature = "gltf")]
        Format::Pnts => tileset::read_pnts(bytes, context),
        #[cfg(feature = "points")]
        Format::Xyz | Format::Pts => points::read(bytes, format == Format::Pts, context),
        #[cfg(feature = "points")]
        Format::Ptx => points::read_ptx(bytes, context),
        #[cfg(feature = "points")]
        Format::Colmap => colmap_points::read(bytes, context),
        #[cfg(feature = "off")]
        Format::Off => off::read(bytes, context),
        #[cfg(feature = "draco")]
        Format::Drc => drc::read(bytes, context),
        #[cfg(feature = "gaussians")]
        Format::Splat => splat_rows::read(bytes, context),
        #[cfg(feature = "gaussians")]
        Format::Spz => spz::read(bytes, context),
        #[cfg(feature = "gaussians")]
        Format::Sog => sog::read(bytes, context),
        Format::Las | Format::Laz | Format::Copc | Format::E57 => {
            read_survey(format, &mut std::io::Cursor::new(bytes), context)
        }
        #[cfg(not(feature = "obj"))]
        Format::Obj => Err(Problem::not_built(format.name(), "obj").into()),
        #[cfg(not(feature = "stl"))]
        Format::Stl => Err(Problem::not_built(format.name(), "stl").into()),
        #[cfg(not(feature = "gltf"))]
        Format::Gltf | Format::Glb | Format::Tileset | Format::Pnts => {
            Err(Problem::not_built(format.name(), "gltf").into())
        }
        #[cfg(not(feature = "points"))]
        Format::Xyz | Format::Pts | Format::Ptx | Format::Colmap => {
            Err(Problem::not_built(format.name(), "points").into())
        }
        #[cfg(not(feature = "off"))]
        Format::Off => Err(Problem::not_built(format.name(), "off").into()),
        #[cfg(not(feature = "draco"))]
        Format::Drc => Err(Problem::not_built(format.name(), "draco").into()),
        #[cfg(not(feature = "gaussians"))]
        Format::Splat | Format::Spz | Format::Sog => Err(Problem::not_built(format.name(), "gaussians").into()),
    }
}

fn read_columns(format: Format, bytes: Bytes<'_>, context: &mut Context<'_>) -> Result<Content, Fault> {
    match format {
        #[cfg(feature = "pcd")]
        Format::Pcd => pcd::read(bytes, context),
        #[cfg(feature = "npy")]
        Format::Npy => npy::read(bytes, context),
        #[cfg(feature = "npy")]
        Format::Npz => npy::read_archive(bytes, context),
        #[cfg(any(feature = "laz", feature = "npy", feature = "pcd", feature = "points"))]
        Format::Raw => raw_rows::read(bytes, context),
        #[cfg(not(feature = "pcd"))]
        Format::Pcd => Err(Problem::not_built(format.name(), "pcd").into()),
        #[cfg(not(feature = "npy"))]
        Format::Npy | Format::Npz => Err(Problem::not_built(format.name(), "npy").into()),
        _ => ply::read(bytes, context),
    }
}

#[cfg_attr(not(any(feature = "las", feature = "e57")), allow(unused_variables))]
fn read_survey<S>(format: Format, source: &mut S, context: &mut Context<'_>) -> Result<Content, Fault>
where
    S: Read + Seek + Send + Sync,
{
    match format {
        #[cfg(feature = "e57")]
        Format::E57 => e57::read(source, context),
        #[cfg(not(feature = "e57"))]
        Format::E57 => Err(Problem::not_built(format.name(), "e57").into()),
        #[cfg(feature = "las")]
        _ => las::read(source, format, context),
        #[cfg(not(feature = "las"))]
        _ => Err(Problem::not_built(format.name(), "las").into()),
    }
}

//! The result of loading a file, and the functions that run a reader.

use crate::content::{Content, LoadOptions};
use crate::context::Context;
use crate::error::{Fault, IoError};
use crate::files::Siblings;
use crate::format::Format;
use std::path::{Path, PathBuf};
use surfel_model::Up;

/// Geometry of a loaded file, with its properties and notes for the user.
#[derive(Clone, Debug, PartialEq)]
pub struct Loaded {
    /// Geometry that was read from the file.
    pub content: Content,
    /// Format of the file, as it was detected.
    pub format: Format,
    /// Up axis of the geometry: as stated in the file or detected from its points, else the format's default. Defaults
    /// are +z for STL and for formats of points alone, such as LAS, E57 and text. They are −y for Gaussian-splat PLY,
    /// SPLAT, SOG and COLMAP, which have the axes of a camera with y down. They are +y for all others.
    pub up: Up,
    /// True if the file contains trained Gaussians, even if they were converted to splats.
    pub gaussian: bool,
    /// Notes for the user, as sentences without a full stop: what was dropped, ignored or assumed.
    pub notes: Vec<String>,
    /// Files that the file refers to, such as textures and buffers, whether they exist or not; sorted.
    pub beside: Vec<PathBuf>,
    /// Names of the attributes that the geometry has: "position", "normal", "colour", …, then the names of its other
    /// columns.
    pub attributes: Vec<String>,
}

/// Runs a reader that has no access to other files.
#[cfg(feature = "laz")]
pub(crate) fn run_plain(
    read: impl FnOnce(&mut Context<'_>) -> Result<(Format, Content), Fault>,
    name: &Path,
    options: &LoadOptions,
) -> Result<Loaded, IoError> {
    run(read, name, Siblings::None, options)
}

/// Runs a reader, and returns its content with notes and properties of the file. `name` is the file's path, for
/// messages.
pub(crate) fn run(
    read: impl FnOnce(&mut Context<'_>) -> Result<(Format, Content), Fault>,
    name: &Path,
    siblings: Siblings,
    options: &LoadOptions,
) -> Result<Loaded, IoError> {
    let mut context = Context::new(options, siblings);
    let (format, content) = read(&mut context).map_err(|fault| fault.of(name))?;
    let is_table = matches!(format, Format::Xyz | Format::Pts | Format::Npy | Format::Npz | Format::Raw);
    if options.columns.is_some() && !is_table {
        context
            .note(format!("`columns` has no effect: it names the columns of tables of numbers, and this is {format}"));
    }
    let up = content.own_up().unwrap_or(format.default_up(context.gaussian));
    let attributes = content.attributes();
    let beside = context.siblings.asked();
    let mut notes = context.take_notes();
    notes.extend(context.textures.told());
    Ok(Loaded { content, format, up, gaussian: context.gaussian, notes, beside, attributes })
}

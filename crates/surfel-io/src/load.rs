//! Loading: the table of readers. A file's format is told here, and its reader called.

use crate::content::{Content, LoadOptions};
use crate::context::Context;
use crate::error::{Fault, IoError, Problem, quote};
use crate::files::{self, Siblings};
use crate::format::{Format, KNOWN_FORMATS};
#[cfg(feature = "gltf")]
use crate::gltf;
#[cfg(feature = "obj")]
use crate::obj;
#[cfg(feature = "points")]
use crate::points;
#[cfg(feature = "stl")]
use crate::stl;
use crate::{octree, ply};
use std::path::{Path, PathBuf};
use surfel_model::Up;

/// A loaded file.
#[derive(Clone, Debug, PartialEq)]
pub struct Loaded {
    /// What it held.
    pub content: Content,
    /// The format it was in.
    pub format: Format,
    /// Which axis is up: as the file says, else the format's default. glTF, OBJ and PLY: +y. STL, XYZ and PTS:
    /// +z. Gaussian-splat PLY: −y (their cameras look along +z with y down); as glTF: +y.
    pub up: Up,
    /// The splats are Gaussians.
    pub gaussian: bool,
    /// What the user should know, as sentences without a full stop: what was dropped, ignored or assumed.
    pub notes: Vec<String>,
    /// Files beside it that it refers to, such as textures and buffers, whether they are there or not, sorted.
    pub beside: Vec<PathBuf>,
    /// Attributes found, in words: "position", "normal", "colour", … and the names of those that Surfel doesn't
    /// interpret.
    pub attributes: Vec<String>,
}

/// Loads splats, points or a mesh from a file, whose format is told by its first bytes and its extension.
/// Textures, materials and buffers that it refers to are looked for beside it, in its folder and below
/// ([`LoadOptions::allow_outside`]).
///
/// # Errors
/// [`IoError`] if the file can't be read, is damaged, is in a format that this build has no reader for, or holds
/// splats that break the rules of the rendering model (§10) and `options.repair` is false.
pub fn load(path: &Path, options: &LoadOptions) -> Result<Loaded, IoError> {
    let bytes = files::read(path, files::MAX_BYTES)?;
    run(&bytes, Format::from_extension(path), path, Siblings::of(path, options.allow_outside), options)
}

/// As [`load`], from memory. `hint` stands for the extension; `name` is for messages. Files that the data refer
/// to are not looked for.
///
/// # Errors
/// As [`load`].
pub fn load_bytes(bytes: &[u8], hint: Option<Format>, name: &Path, options: &LoadOptions) -> Result<Loaded, IoError> {
    run(bytes, hint, name, Siblings::None, options)
}

fn run(
    bytes: &[u8],
    hint: Option<Format>,
    name: &Path,
    siblings: Siblings,
    options: &LoadOptions,
) -> Result<Loaded, IoError> {
    let mut context = Context::new(options, siblings);
    let mut read = || {
        if bytes.is_empty() {
            return Err(Problem::new("is empty").into());
        }
        let format = recognise(bytes, hint)?;
        Ok((format, read_as(format, bytes, &mut context)?))
    };
    let (format, content) = read().map_err(|fault: Fault| fault.of(name))?;
    let up = content.own_up().unwrap_or(format.default_up(context.gaussian));
    let attributes = content.attributes();
    let beside = context.siblings.asked();
    context.notes.extend(context.textures.told());
    Ok(Loaded { content, format, up, gaussian: context.gaussian, notes: context.notes, beside, attributes })
}

/// By the file's first bytes where they say it for certain, else by `hint`, else by a look at the content.
fn recognise(bytes: &[u8], hint: Option<Format>) -> Result<Format, Problem> {
    if let Some(format) = Format::from_signature(bytes, hint)?.or(hint) {
        return Ok(format);
    }
    let head = &bytes[..bytes.len().min(4096)];
    #[cfg(feature = "stl")]
    if stl::looks_like(bytes) {
        return Ok(Format::Stl);
    }
    if head.trim_ascii_start().starts_with(b"{") {
        return Ok(Format::Gltf);
    }
    #[cfg(feature = "obj")]
    if obj::looks_like(head) {
        return Ok(Format::Obj);
    }
    #[cfg(feature = "points")]
    if points::looks_like(head) {
        return Ok(Format::Xyz);
    }
    let found = quote(&head[..head.len().min(12)]);
    Err(Problem::new(format!("is in no format that Surfel knows: it starts with {found}")).expected(KNOWN_FORMATS))
}

fn read_as(format: Format, bytes: &[u8], context: &mut Context<'_>) -> Result<Content, Fault> {
    match format {
        Format::Ply => ply::read(bytes, context),
        Format::Surfel => octree::read(bytes, context),
        #[cfg(feature = "obj")]
        Format::Obj => obj::read(bytes, context),
        #[cfg(feature = "stl")]
        Format::Stl => stl::read(bytes, context),
        #[cfg(feature = "gltf")]
        Format::Gltf | Format::Glb => gltf::read(bytes, context),
        #[cfg(feature = "points")]
        Format::Xyz | Format::Pts => points::read(bytes, format == Format::Pts, context),
        #[cfg(not(feature = "obj"))]
        Format::Obj => Err(Problem::not_built(format.name(), "obj").into()),
        #[cfg(not(feature = "stl"))]
        Format::Stl => Err(Problem::not_built(format.name(), "stl").into()),
        #[cfg(not(feature = "gltf"))]
        Format::Gltf | Format::Glb => Err(Problem::not_built(format.name(), "gltf").into()),
        #[cfg(not(feature = "points"))]
        Format::Xyz | Format::Pts => Err(Problem::not_built(format.name(), "points").into()),
    }
}

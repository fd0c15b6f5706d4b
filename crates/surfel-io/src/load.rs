//! Loading: which format a file is in, and what comes out of it.

use crate::error::{Fault, Problem};
use crate::files::{self, Beside};
use crate::texture::Decoder;
use crate::{IoError, container, gltf, obj, ply, points, stl};
use std::fmt;
use std::path::{Path, PathBuf};
use surfel_model::{CloudData, Hybrid, Mesh, OnInvalid, PointCloud, Shape, SplatCloud, Up};

/// How to load.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LoadOptions {
    /// Drops invalid splats and says how many, instead of refusing the file.
    pub repair: bool,
    /// A texture (PNG or JPEG) for a mesh that has texture coordinates and names no texture itself.
    pub texture: Option<PathBuf>,
}

/// What a file held.
#[derive(Clone, Debug, PartialEq)]
pub enum Content {
    /// Splats, valid and ready to be drawn.
    Splats(SplatCloud),
    /// Points without extent; all positions are finite.
    Points(PointCloud),
    /// Triangles; indices are in range and positions finite.
    Mesh(Mesh),
    /// Splats and polygons in an octree.
    Hybrid(Box<Hybrid>),
}

impl Content {
    /// The axis that the file itself says is up.
    pub fn own_up(&self) -> Option<Up> {
        match self {
            Self::Splats(splats) => splats.data().up,
            Self::Points(points) => points.up,
            Self::Mesh(mesh) => mesh.up,
            Self::Hybrid(hybrid) => hybrid.mesh().up,
        }
    }
}

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
    /// What the user should know, as sentences without a full stop: what was dropped, ignored or assumed.
    pub notes: Vec<String>,
    /// Attributes found, in words: "position", "normal", "colour", … and the names of those that Surfel doesn't
    /// interpret.
    pub attributes: Vec<String>,
}

/// Formats that can be loaded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Format {
    /// Stanford PLY.
    Ply,
    /// Wavefront OBJ.
    Obj,
    /// STL, text or binary.
    Stl,
    /// glTF as JSON.
    Gltf,
    /// glTF as one binary file.
    Glb,
    /// Columns of numbers: XYZ, TXT, CSV, ASC.
    Xyz,
    /// Leica PTS: a count, then x y z intensity r g b.
    Pts,
    /// Surfel's own octree of splats and polygons.
    Surfel,
}

impl Format {
    /// Its name: "PLY", "OBJ", …
    pub fn name(self) -> &'static str {
        match self {
            Self::Ply => "PLY",
            Self::Obj => "OBJ",
            Self::Stl => "STL",
            Self::Gltf => "glTF",
            Self::Glb => "GLB",
            Self::Xyz => "XYZ",
            Self::Pts => "PTS",
            Self::Surfel => "Surfel octree",
        }
    }

    /// By a file name's extension, in either case.
    pub fn from_extension(path: &Path) -> Option<Self> {
        Some(match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "ply" => Self::Ply,
            "obj" => Self::Obj,
            "stl" => Self::Stl,
            "gltf" => Self::Gltf,
            "glb" => Self::Glb,
            "xyz" | "txt" | "csv" | "asc" | "xyzrgb" | "xyzn" => Self::Xyz,
            "pts" => Self::Pts,
            "surfel" => Self::Surfel,
            _ => return None,
        })
    }

    /// By the file's first bytes where they say it for certain, else by `hint`, else by a look at the content.
    fn of(bytes: &[u8], hint: Option<Self>) -> Result<Self, Problem> {
        let formats = "PLY, OBJ, STL, glTF, GLB, XYZ (TXT, CSV) or PTS";
        for (magic, name) in [
            (&b"LASF"[..], "LAS/LAZ"),
            (b"ASTM-E57", "E57"),
            (b"# .PCD", "PCD"),
            (b"PK\x03\x04", "ZIP"),
            (b"\x1f\x8b", "GZIP"),
            (b"\x89PNG", "PNG image"),
            (b"\x76\x2f\x31\x01", "OpenEXR image"),
        ] {
            if bytes.starts_with(magic) {
                let problem = Problem::new(format!("is a {name} file, which can't be loaded as geometry"));
                return Err(problem.expected(formats).help("convert it to PLY first"));
            }
        }
        if bytes.starts_with(container::SIGNATURE) {
            return Ok(Self::Surfel);
        }
        if hint == Some(Self::Surfel) {
            let found = crate::error::quote(&bytes[..bytes.len().min(12)]);
            let problem = Problem::new(format!("is no octree of surfel: it starts with {found}"));
            return Err(problem.expected("the signature SURFEL").help("the file is damaged, or named wrong"));
        }
        if bytes.starts_with(b"glTF") {
            return Ok(Self::Glb);
        }
        if bytes.starts_with(b"ply\n") || bytes.starts_with(b"ply\r") {
            return Ok(Self::Ply);
        }
        if let Some(hint) = hint {
            return Ok(hint);
        }
        let head = &bytes[..bytes.len().min(4096)];
        if stl::looks_like(bytes) {
            Ok(Self::Stl)
        } else if head.trim_ascii_start().starts_with(b"{") {
            Ok(Self::Gltf)
        } else if obj::looks_like(head) {
            Ok(Self::Obj)
        } else if points::looks_like(head) {
            Ok(Self::Xyz)
        } else {
            let found = crate::error::quote(&head[..head.len().min(12)]);
            Err(Problem::new(format!("is in no format that Surfel knows: it starts with {found}")).expected(formats))
        }
    }
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Loads splats, points or a mesh from a file, whose format is told by its first bytes and its extension.
/// Textures, materials and buffers that it refers to are looked for beside it.
///
/// # Errors
/// [`IoError`] if the file can't be read, is damaged, or holds splats that break the rules of the rendering
/// model (§10) and `options.repair` is false.
pub fn load(path: &Path, options: &LoadOptions) -> Result<Loaded, IoError> {
    let bytes = files::read(path, files::MAX_BYTES)?;
    run(&bytes, Format::from_extension(path), path, Beside::of(path), options)
}

/// As [`load`], from memory. `hint` stands for the extension; `name` is for messages. Files that the data refer
/// to are not looked for.
///
/// # Errors
/// As [`load`].
pub fn load_bytes(bytes: &[u8], hint: Option<Format>, name: &Path, options: &LoadOptions) -> Result<Loaded, IoError> {
    run(bytes, hint, name, Beside::Nowhere, options)
}

fn run(
    bytes: &[u8],
    hint: Option<Format>,
    name: &Path,
    beside: Beside,
    options: &LoadOptions,
) -> Result<Loaded, IoError> {
    let mut context = Context { options, beside, notes: Vec::new(), gaussian: false, textures: Decoder::new() };
    let mut read = || {
        if bytes.is_empty() {
            return Err(Problem::new("is empty").into());
        }
        let format = Format::of(bytes, hint)?;
        let content = match format {
            Format::Ply => ply::read(bytes, &mut context),
            Format::Obj => obj::read(bytes, &mut context),
            Format::Stl => stl::read(bytes, &mut context),
            Format::Gltf | Format::Glb => gltf::read(bytes, &mut context),
            Format::Xyz | Format::Pts => points::read(bytes, format == Format::Pts, &mut context),
            Format::Surfel => container::read(bytes, &mut context),
        }?;
        Ok((format, content))
    };
    let (format, content) = read().map_err(|fault: Fault| fault.of(name))?;
    let default_up = match format {
        Format::Ply if context.gaussian => Up::MinusY,
        Format::Ply | Format::Obj | Format::Gltf | Format::Glb | Format::Surfel => Up::PlusY,
        Format::Stl | Format::Xyz | Format::Pts => Up::PlusZ,
    };
    let up = content.own_up().unwrap_or(default_up);
    let attributes = attributes(&content);
    Ok(Loaded { content, format, up, notes: context.notes, attributes })
}

/// What readers share: the options, the files beside theirs, and the notes they leave.
pub(crate) struct Context<'a> {
    pub(crate) options: &'a LoadOptions,
    pub(crate) beside: Beside,
    notes: Vec<String>,
    /// Decodes textures within what one file may use.
    pub(crate) textures: Decoder,
    /// The splats were Gaussians.
    pub(crate) gaussian: bool,
}

impl Context<'_> {
    pub(crate) fn note(&mut self, note: String) {
        self.notes.push(note);
    }

    /// Validates splats, or drops the invalid ones.
    pub(crate) fn splats(&mut self, data: CloudData) -> Result<Content, Fault> {
        let on_invalid = if self.options.repair { OnInvalid::Drop } else { OnInvalid::Refuse };
        let (cloud, repaired) = SplatCloud::new(data, on_invalid)?;
        if let Some((index, problem)) = repaired.first {
            self.note(format!("dropped {} invalid splats; the first was splat {index}: {problem}", repaired.dropped));
        }
        Ok(Content::Splats(cloud))
    }

    /// Drops points that aren't anywhere.
    pub(crate) fn points(&mut self, mut points: PointCloud) -> Result<Content, Fault> {
        points.check_columns()?;
        let dropped = points.drop_non_finite();
        if dropped > 0 {
            self.note(format!("dropped {dropped} points whose coordinates are not finite"));
        }
        Ok(Content::Points(points))
    }

    /// Validates a mesh and gives it the texture of the options, if it wants one.
    pub(crate) fn mesh(&mut self, mut mesh: Mesh) -> Result<Content, Fault> {
        mesh.validate()?;
        if let (Some(path), None, true) = (&self.options.texture, &mesh.texture, mesh.uvs.is_some()) {
            let texture = files::read(path, 1 << 30).map_err(|e| e.to_string());
            let texture = texture.and_then(|bytes| self.textures.decode(&bytes));
            let texture =
                texture.map_err(|why| Problem::new(format!("can't use the texture {}: {why}", path.display())))?;
            mesh.texture = Some(std::sync::Arc::new(texture));
        }
        Ok(Content::Mesh(mesh))
    }
}

fn of_mesh(m: &Mesh, add: &mut impl FnMut(bool, &str)) {
    add(m.normals.is_some(), "normal");
    add(m.colors.is_some(), "colour");
    add(m.alphas.is_some(), "alpha");
    add(m.uvs.is_some(), "texture coordinates");
    add(m.texture.is_some(), "texture");
}

fn attributes(content: &Content) -> Vec<String> {
    let mut found = vec!["position".to_owned()];
    let mut add = |there: bool, name: &str| {
        if there {
            found.push(name.to_owned());
        }
    };
    let extras = match content {
        Content::Splats(splats) => {
            let d = splats.data();
            let clips = d.clips.as_ref();
            let disks = matches!(d.shape, Shape::Disks { .. });
            add(disks, "normal");
            add(disks, "radius");
            add(!disks, "half-axes");
            add(d.shading_normals.is_some(), "shading normal");
            add(d.colors.is_some(), "colour");
            add(d.alphas.is_some(), "alpha");
            add(clips.is_some_and(|c| c.curves.is_some()), "clip curve");
            add(clips.is_some_and(|c| c.lines.is_some()), "clip lines");
            add(d.interior_weight.is_some(), "interior weight");
            d.extras.as_slice()
        }
        Content::Points(p) => {
            add(p.normals.is_some(), "normal");
            add(p.colors.is_some(), "colour");
            add(p.alphas.is_some(), "alpha");
            p.extras.as_slice()
        }
        Content::Mesh(mesh) => {
            of_mesh(mesh, &mut add);
            &[]
        }
        Content::Hybrid(hybrid) => {
            of_mesh(hybrid.mesh(), &mut add);
            &[]
        }
    };
    found.extend(extras.iter().map(|e| e.name.escape_debug().to_string()));
    found
}

//! The formats that can be loaded: their names, extensions, signatures, and which axis they have up.

use crate::error::{Problem, quote};
use std::fmt;
use std::path::Path;
use surfel_model::Up;

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
    /// Points of laser scanners: ASPRS LAS 1.0 to 1.4.
    Las,
    /// LAS, compressed by LASzip.
    Laz,
    /// LAZ whose chunks are the nodes of an octree.
    Copc,
    /// Scans of terrestrial scanners: ASTM E2807.
    E57,
    /// Surfel's own octree of splats and polygons.
    Surfel,
}

/// What a file that is in none of the formats can be instead.
pub(crate) const KNOWN_FORMATS: &str = "PLY, OBJ, STL, glTF, GLB, LAS, LAZ, E57, XYZ (TXT, CSV) or PTS";

/// First bytes of a `.surfel` file. The line end shows a file that was sent as text.
pub(crate) const OCTREE_SIGNATURE: &[u8; 8] = b"SURFEL\r\n";

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
            Self::Las => "LAS",
            Self::Laz => "LAZ",
            Self::Copc => "COPC",
            Self::E57 => "E57",
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
            "las" => Self::Las,
            "laz" => Self::Laz,
            "e57" => Self::E57,
            "surfel" => Self::Surfel,
            _ => return None,
        })
    }

    /// The axis that is up in files that don't say so. Gaussian splats in PLY come from cameras that look along +z
    /// with y down.
    pub(crate) fn default_up(self, holds_gaussians: bool) -> Up {
        match self {
            Self::Ply if holds_gaussians => Up::MinusY,
            Self::Ply | Self::Obj | Self::Gltf | Self::Glb | Self::Surfel => Up::PlusY,
            Self::Stl | Self::Xyz | Self::Pts | Self::Las | Self::Laz | Self::Copc | Self::E57 => Up::PlusZ,
        }
    }

    /// The formats that are read here and there in a file, by its first bytes.
    pub(crate) fn of_survey(head: &[u8]) -> Option<Self> {
        if head.starts_with(b"ASTM-E57") {
            return Some(Self::E57);
        }
        if !head.starts_with(b"LASF") {
            return None;
        }
        let compressed = head.get(104).is_some_and(|b| b & 0xc0 != 0);
        Some(match head.get(377..381) {
            _ if !compressed => Self::Las,
            Some(b"copc") => Self::Copc,
            _ => Self::Laz,
        })
    }

    /// By the file's first bytes where they say it for certain, `None` where they don't.
    ///
    /// # Errors
    /// [`Problem`] if they are those of a format that isn't geometry, or if a `.surfel` file lacks its own.
    pub(crate) fn from_signature(bytes: &[u8], hint: Option<Self>) -> Result<Option<Self>, Problem> {
        for (magic, name) in [
            (&b"# .PCD"[..], "PCD"),
            (b"PK\x03\x04", "ZIP"),
            (b"\x1f\x8b", "GZIP"),
            (b"\x89PNG", "PNG image"),
            (b"\x76\x2f\x31\x01", "OpenEXR image"),
        ] {
            if bytes.starts_with(magic) {
                let problem = Problem::new(format!("is a {name} file, which can't be loaded as geometry"));
                return Err(problem.expected(KNOWN_FORMATS).help("convert it to PLY first"));
            }
        }
        if bytes.starts_with(OCTREE_SIGNATURE) {
            return Ok(Some(Self::Surfel));
        }
        if let Some(format) = Self::of_survey(bytes) {
            return Ok(Some(format));
        }
        if hint == Some(Self::Surfel) {
            let found = quote(&bytes[..bytes.len().min(12)]);
            let problem = Problem::new(format!("is no octree of surfel: it starts with {found}"));
            return Err(problem.expected("the signature SURFEL").help("the file is damaged, or named wrong"));
        }
        if bytes.starts_with(b"glTF") {
            return Ok(Some(Self::Glb));
        }
        Ok((bytes.starts_with(b"ply\n") || bytes.starts_with(b"ply\r")).then_some(Self::Ply))
    }
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

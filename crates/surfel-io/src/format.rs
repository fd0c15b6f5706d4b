//! The supported geometry formats: names, extensions, signatures and default up axes.

use crate::error::{Problem, quote};
use std::fmt;
use std::path::Path;
use surfel_model::Up;

/// A supported geometry format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Format {
    /// Stanford PLY: splats, Gaussians, points or a mesh.
    Ply,
    /// Wavefront OBJ: a mesh or points as text.
    Obj,
    /// STL: a mesh, as text or binary.
    Stl,
    /// glTF: a scene whose JSON refers to buffers in other files.
    Gltf,
    /// glTF as one binary file, JSON and buffer together.
    Glb,
    /// Points as columns of numbers in a text file, such as XYZ, TXT, CSV or ASC.
    Xyz,
    /// Leica PTS: points as text, a count and then rows of x y z intensity r g b.
    Pts,
    /// Leica PTX: scans as text, with their poses.
    Ptx,
    /// PCD of the Point Cloud Library: points.
    Pcd,
    /// A NumPy array (`.npy`).
    Npy,
    /// Named NumPy arrays (`.npz`).
    Npz,
    /// Object File Format: a mesh or points as text.
    Off,
    /// A mesh or points compressed by Draco.
    Drc,
    /// Antimatter15's `.splat`: Gaussian splats in rows of 32 bytes.
    Splat,
    /// Gaussian splats compressed as SPZ.
    Spz,
    /// Gaussian splats compressed as SOG.
    Sog,
    /// Points of laser scanners: ASPRS LAS 1.0 to 1.5.
    Las,
    /// LAS, compressed by LASzip.
    Laz,
    /// COPC: LAZ whose chunks are the nodes of an octree.
    Copc,
    /// Scans of terrestrial scanners: ASTM E2807.
    E57,
    /// Point tiles of 3D Tiles 1.0 and 1.1; the file is the tileset's JSON.
    Tileset,
    /// A point tile of 3D Tiles 1.0.
    Pnts,
    /// COLMAP's sparse points: `points3D.txt` or `points3D.bin`.
    Colmap,
    /// Rows of binary numbers without a header; the caller names the columns ([`crate::LoadOptions::columns`]).
    Raw,
    /// Surfel's own octree of splats and polygons.
    Surfel,
}

/// Names of the supported formats, as text for messages about other files.
pub(crate) const KNOWN_FORMATS: &str = "PLY, OBJ, OFF, STL, glTF, GLB, DRC, LAS, LAZ, E57, PCD, XYZ (TXT, CSV), PTS, \
     PTX, NPY, NPZ, COLMAP's points3D, 3D Tiles, SPLAT, SPZ or SOG";

/// Signatures of unsupported formats: first bytes, what the file is, and advice.
const UNSUPPORTED_SIGNATURES: &[(&[u8], &str, &str)] = &[
    (b"version https://git-lfs", "is a Git LFS pointer and not the file itself", "fetch the file: git lfs pull"),
    (b"<!DOCTYPE", "is a web page", PAGE),
    (b"<!doctype", "is a web page", PAGE),
    (b"<html", "is a web page", PAGE),
    (b"<?xml", "is an XML file", "export it as PLY, GLB or OBJ"),
    (b"CCB2", "is a BIN file of CloudCompare", "save it as PLY in CloudCompare"),
    (b"b3dm", "is a tile of 3D Tiles", "export it as GLB"),
    (b"#ROSBAG", "is a bag of ROS", "export its point clouds as PCD"),
    (b"\x89MCAP", "is an MCAP recording", "export its point clouds as PCD"),
    (b"Kaydara FBX", "is an FBX file", MESH),
    (b"BLENDER", "is a Blender file", MESH),
    (b"PXR-USDC", "is a USD file", MESH),
    (b"#usda", "is a USD file", MESH),
    (b"#VRML", "is a VRML file", MESH),
    (b"ISO-10303-21", "is a STEP file", "export a mesh of it as STL or GLB, e.g. with FreeCAD"),
    (b"# vtk", "is a VTK file", "save it as PLY, e.g. in ParaView"),
    (b"<VTKFile", "is a VTK file", "save it as PLY, e.g. in ParaView"),
    (b"\x89HDF", "is an HDF5 file", ARRAY),
    (b"MATLAB 5.0", "is a MAT file of MATLAB", ARRAY),
    (b"PAR1", "is a Parquet file", ARRAY),
    (b"\x80\x04\x95", "is a pickle of Python", ARRAY),
    (b"BZh", "is compressed by bzip2", UNPACK),
    (b"\xfd7zXZ", "is compressed by xz", UNPACK),
    (b"\x28\xb5\x2f\xfd", "is compressed by Zstandard", UNPACK),
    (b"7z\xbc\xaf", "is a 7z archive", UNPACK),
    (b"Rar!", "is a RAR archive", UNPACK),
    (b"\x89PNG", "is a PNG image, which can't be loaded as geometry", IMAGE),
    (b"\xff\xd8\xff", "is a JPEG image, which can't be loaded as geometry", IMAGE),
    (b"\x76\x2f\x31\x01", "is an OpenEXR image, which can't be loaded as geometry", IMAGE),
    (b"II*\0", "is a TIFF image, which can't be loaded as geometry", IMAGE),
    (b"%PDF", "is a PDF file", "name a file of points, splats or a mesh"),
];
const PAGE: &str = "download the file again: a server's answer was saved in its place";
const MESH: &str = "export it as GLB or OBJ, e.g. with Blender";
const ARRAY: &str = "save its points from Python: numpy.save('points.npy', points)";
const UNPACK: &str = "unpack it first";
const IMAGE: &str = "name a file of points, splats or a mesh";

/// Extensions of unsupported formats without a signature: extension, what the file is, and advice.
const UNSUPPORTED_EXTENSIONS: &[(&str, &str, &str)] = &[
    ("ksplat", "is a KSPLAT file", "convert it to PLY first, e.g. with splat-transform"),
    ("rcp", "is a ReCap project", "export it as E57 or PTS in ReCap, and that as PLY"),
    ("rcs", "is a ReCap scan", "export it as E57 or PTS in ReCap, and that as PLY"),
    ("fls", "is a scan of FARO", "export it as PTX or XYZ in SCENE"),
    ("3ds", "is a 3DS file", MESH),
    ("dae", "is a COLLADA file", MESH),
    ("dxf", "is a DXF file", MESH),
    ("dwg", "is a DWG file", MESH),
    ("3mf", "is a 3MF file", "export it as STL, e.g. with the program that made it"),
];

/// First bytes of a `.surfel` file. A changed line end reveals that the file was transferred as text.
pub(crate) const OCTREE_SIGNATURE: &[u8; 8] = b"SURFEL\r\n";

impl Format {
    /// Returns the format's name for messages: "PLY", "OBJ", …
    pub fn name(self) -> &'static str {
        match self {
            Self::Ply => "PLY",
            Self::Obj => "OBJ",
            Self::Stl => "STL",
            Self::Gltf => "glTF",
            Self::Glb => "GLB",
            Self::Xyz => "XYZ",
            Self::Pts => "PTS",
            Self::Ptx => "PTX",
            Self::Pcd => "PCD",
            Self::Npy => "NPY",
            Self::Npz => "NPZ",
            Self::Off => "OFF",
            Self::Drc => "Draco",
            Self::Splat => "SPLAT",
            Self::Spz => "SPZ",
            Self::Sog => "SOG",
            Self::Las => "LAS",
            Self::Laz => "LAZ",
            Self::Copc => "COPC",
            Self::E57 => "E57",
            Self::Tileset => "3D Tiles",
            Self::Pnts => "PNTS",
            Self::Colmap => "COLMAP points",
            Self::Raw => "raw binary",
            Self::Surfel => "Surfel octree",
        }
    }

    /// Returns the format that the extension of a file's name stands for, in upper or lower case; `None` for unknown
    /// extensions. A final `.gz` is ignored.
    pub fn from_extension(path: &Path) -> Option<Self> {
        if extension(path)? == "gz" {
            return Self::from_extension(Path::new(path.file_stem()?));
        }
        Some(match extension(path)?.as_str() {
            "ply" => Self::Ply,
            "obj" => Self::Obj,
            "stl" => Self::Stl,
            "gltf" => Self::Gltf,
            "glb" => Self::Glb,
            "xyz" | "txt" | "csv" | "asc" | "xyzrgb" | "xyzn" | "neu" | "pwn" => Self::Xyz,
            "pts" => Self::Pts,
            "ptx" => Self::Ptx,
            "pcd" => Self::Pcd,
            "npy" => Self::Npy,
            "npz" => Self::Npz,
            "off" | "coff" | "noff" | "cnoff" => Self::Off,
            "drc" => Self::Drc,
            "splat" => Self::Splat,
            "spz" => Self::Spz,
            "sog" => Self::Sog,
            "las" => Self::Las,
            "laz" => Self::Laz,
            "e57" => Self::E57,
            "pnts" => Self::Pnts,
            "surfel" => Self::Surfel,
            _ => return None,
        })
    }

    /// Returns the up axis of this format's files if they don't state one. PLY files of Gaussian splats
    /// (`holds_gaussians`) have the axes of cameras, with y down.
    pub(crate) fn default_up(self, holds_gaussians: bool) -> Up {
        match self {
            Self::Ply if holds_gaussians => Up::MinusY,
            // COLMAP's world has the axes of a camera, and so do Gaussian splats trained from it.
            Self::Splat | Self::Sog | Self::Colmap => Up::MinusY,
            Self::Ply | Self::Obj | Self::Off | Self::Gltf | Self::Glb | Self::Drc | Self::Spz | Self::Surfel => {
                Up::PlusY
            }
            Self::Stl | Self::Xyz | Self::Pts | Self::Ptx | Self::Pcd | Self::Npy | Self::Npz | Self::Raw => Up::PlusZ,
            Self::Las | Self::Laz | Self::Copc | Self::E57 | Self::Tileset | Self::Pnts => Up::PlusZ,
        }
    }

    /// Detects E57, LAS, LAZ and COPC files from a file's first bytes. These formats are read with seeking instead of
    /// from memory.
    pub(crate) fn from_seekable_signature(head: &[u8]) -> Option<Self> {
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

    /// Detects the format from the file's first bytes; returns `None` if they aren't conclusive. For a ZIP file,
    /// `bytes` must also include its last 64 KiB.
    ///
    /// # Errors
    /// [`Problem`] if the bytes are those of an unsupported format, or if a `.surfel` file (by `hint`) lacks its
    /// signature.
    pub(crate) fn from_signature(bytes: &[u8], hint: Option<Self>) -> Result<Option<Self>, Problem> {
        let head = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes).trim_ascii_start();
        if let Some((_, what, help)) =
            UNSUPPORTED_SIGNATURES.iter().find(|(magic, ..)| bytes.starts_with(magic) || head.starts_with(magic))
        {
            return Err(Problem::new(*what).expected(KNOWN_FORMATS).help(*help));
        }
        if bytes.get(257..262) == Some(b"ustar") {
            return Err(Problem::new("is a TAR archive").expected(KNOWN_FORMATS).help(UNPACK));
        }
        let certain: [(&[u8], Self); 7] = [
            (b"# .PCD", Self::Pcd),
            (b"\x93NUMPY", Self::Npy),
            (b"NGSP", Self::Spz),
            (b"DRACO", Self::Drc),
            (b"glTF", Self::Glb),
            (b"pnts", Self::Pnts),
            (OCTREE_SIGNATURE, Self::Surfel),
        ];
        if let Some((_, format)) = certain.iter().find(|(magic, _)| bytes.starts_with(magic)) {
            return Ok(Some(*format));
        }
        if bytes.starts_with(b"PK\x03\x04") {
            return zipped(bytes).map(Some);
        }
        if let Some(format) = Self::from_seekable_signature(bytes) {
            return Ok(Some(format));
        }
        if hint == Some(Self::Surfel) {
            let found = quote(&bytes[..bytes.len().min(12)]);
            let problem = Problem::new(format!("is no octree of surfel: it starts with {found}"));
            return Err(problem.expected("the signature SURFEL").help("the file is damaged, or named wrong"));
        }
        Ok((bytes.starts_with(b"ply\n") || bytes.starts_with(b"ply\r")).then_some(Self::Ply))
    }
}

fn extension(path: &Path) -> Option<String> {
    Some(path.extension()?.to_str()?.to_ascii_lowercase())
}

/// True if the start of a file contains control bytes that text doesn't have.
pub(crate) fn is_binary(head: &[u8]) -> bool {
    head.iter().any(|b| *b < b' ' && !b.is_ascii_whitespace() && !matches!(b, 0x0b | 0x1a | 0x1b))
}

/// Returns the problem of a file that isn't recognised by its content, and whose extension is that of an unsupported
/// format. Returns `None` for other extensions.
pub(crate) fn unsupported_by_extension(path: &Path) -> Option<Problem> {
    let extension = extension(path)?;
    let (_, what, help) = UNSUPPORTED_EXTENSIONS.iter().find(|(e, ..)| *e == extension)?;
    Some(Problem::new(*what).expected(KNOWN_FORMATS).help(*help))
}

/// Detects the format of a ZIP file by the names of its members; an unsupported one is an error. The names are searched
/// in the first and last 64 KiB of the file, where they are stored uncompressed.
fn zipped(bytes: &[u8]) -> Result<Format, Problem> {
    let ends = [&bytes[..bytes.len().min(1 << 16)], &bytes[bytes.len().saturating_sub(1 << 16)..]];
    let has = |name: &[u8]| ends.iter().any(|end| end.windows(name.len()).any(|w| w == name));
    if has(b"meta.json") {
        return Ok(Format::Sog);
    }
    if has(b".npy") {
        return Ok(Format::Npz);
    }
    let (what, help) = if has(b"3dmodel.model") {
        ("is a 3MF file", "export it as STL, e.g. with the program that made it")
    } else if has(b"data.pkl") {
        ("is a file of PyTorch", ARRAY)
    } else if has(b"doc.kml") {
        ("is a KMZ file", MESH)
    } else {
        ("is a ZIP archive", UNPACK)
    };
    Err(Problem::new(what).expected(KNOWN_FORMATS).help(help))
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

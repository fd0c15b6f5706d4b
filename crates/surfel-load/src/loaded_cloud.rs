//! A file loaded as splats.

use crate::coloring::Coloring;
use crate::effects::UnusedOption;
use crate::levels::LevelReport;
use std::path::PathBuf;
use std::sync::Arc;
use surfel_framing::UpReason;
use surfel_io::Format;
use surfel_model::{Octree, SplatCloud, Up};
use surfel_sample::{MeshReport, PointReport};

/// Conversion by which splats were made from a file's content, with its report.
#[derive(Clone, Debug, PartialEq)]
pub enum Conversion {
    /// No conversion, because the file has splats.
    None,
    /// Conversion of points.
    Points(PointReport),
    /// Conversion of a mesh.
    Mesh(MeshReport),
    /// Conversion of a mesh to splats that are clipped along its creases.
    #[cfg(feature = "sharp")]
    SharpMesh(Box<surfel_sample::SharpReport>),
}

/// A file loaded as splats.
#[derive(Clone, Debug)]
pub struct LoadedCloud {
    /// The splats, at least one.
    pub cloud: SplatCloud,
    /// Format of the file.
    pub format: Format,
    /// Up axis stated in the file, or else the format's default.
    pub up: Up,
    /// Reason why the up axis is certain. `None` if it is only the format's default, and files of the format have any
    /// up axis.
    pub up_reason: Option<UpReason>,
    /// True if no back of a splat is ever visible: the splats cover a watertight mesh from outside, or there are splats
    /// for each visible side.
    pub is_watertight: bool,
    /// True if the splats were made from trained Gaussians. Their alphas are opacities of overlapping volumes, not of a
    /// surface.
    pub gaussian: bool,
    /// Conversion by which the splats were made.
    pub conversion: Conversion,
    /// Colouring by an attribute, if the options request one.
    pub coloring: Option<Coloring>,
    /// Octree, if the file contains one; `cloud` then has its finest splats.
    pub octree: Option<Arc<Octree>>,
    /// Statistics of the nodes read from a COPC file; `None` if all points were read.
    pub levels: Option<LevelReport>,
    /// Notes for the user on data that was dropped, assumed or estimated: sentences without a full stop.
    pub notes: Vec<String>,
    /// Files to which the file refers, such as textures and buffers, whether they exist or not; sorted.
    pub beside: Vec<PathBuf>,
    /// Loading options that have no effect on the file's content.
    pub unused: Vec<UnusedOption>,
}

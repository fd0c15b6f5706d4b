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

/// Conversion that made splats from a file's content.
#[derive(Clone, Debug, PartialEq)]
pub enum Conversion {
    /// The file held splats.
    None,
    /// The file held points.
    Points(PointReport),
    /// The file held a mesh.
    Mesh(MeshReport),
    /// The file held a mesh, and the splats are clipped along its creases.
    #[cfg(feature = "sharp")]
    SharpMesh(Box<surfel_sample::SharpReport>),
}

/// A file loaded as splats.
#[derive(Clone, Debug)]
pub struct LoadedCloud {
    /// The splats; at least one.
    pub cloud: SplatCloud,
    /// Format of the file.
    pub format: Format,
    /// Up axis stated in the file, else the format's default.
    pub up: Up,
    /// Reason why the up axis is certain; `None` for the default of a format whose files occur with any axis up.
    pub up_reason: Option<UpReason>,
    /// True if the splats cover a watertight mesh from outside, so that their backs are never visible.
    pub closed: bool,
    /// True if the splats were Gaussians, whose alphas are opacities of a volume.
    pub gaussian: bool,
    /// Conversion that made the splats.
    pub conversion: Conversion,
    /// Colouring by an attribute, if the options ask for one.
    pub coloring: Option<Coloring>,
    /// Octree of the file, if it is one; `cloud` then holds its finest splats.
    pub octree: Option<Arc<Octree>>,
    /// Report of the nodes read from a COPC file, if some weren't.
    pub levels: Option<LevelReport>,
    /// Notes for the user on what was dropped, assumed or estimated: sentences without a full stop.
    pub notes: Vec<String>,
    /// Files that the file refers to, such as textures and buffers, whether they exist or not; sorted.
    pub beside: Vec<PathBuf>,
    /// Loading options that have no effect on the file's content.
    pub unused: Vec<UnusedOption>,
}

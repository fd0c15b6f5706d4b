//! From a file to splats: splats as they are, points and meshes converted.

use crate::Error;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use surfel_io::{Content, Format};
use surfel_model::{Hybrid, Mesh, SplatCloud, Up};
use surfel_sample::{MeshMethod, MeshOptions, MeshReport, PointOptions, PointReport, Progress};

/// How files are loaded and made into splats.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadOptions {
    /// Drops invalid splats and says how many, instead of refusing the file.
    pub repair: bool,
    /// A texture (PNG or JPEG) for meshes with texture coordinates that name none themselves.
    pub texture: Option<PathBuf>,
    /// How meshes become splats; `None`: as suits the mesh ([`MeshOptions::auto`]).
    pub method: Option<MeshMethod>,
    /// Multiplies the radii of splats that are made of points and meshes; greater than 0.
    pub radius_scale: f64,
    /// Estimates the interior weight of splat files that don't say it, which edge antialiasing needs.
    pub interior_weight: bool,
}

impl Default for LoadOptions {
    fn default() -> Self {
        Self { repair: false, texture: None, method: None, radius_scale: 1.0, interior_weight: false }
    }
}

/// What was made of a file's content.
#[derive(Clone, Debug, PartialEq)]
pub enum Conversion {
    /// It held splats.
    None,
    /// It held points.
    Points(PointReport),
    /// It held a mesh.
    Mesh(MeshReport),
}

/// A file as splats.
#[derive(Clone, Debug)]
pub struct Prepared {
    /// The splats; at least one.
    pub cloud: SplatCloud,
    /// The format it was in.
    pub format: Format,
    /// Which axis is up: as the file says, else the format's default.
    pub up: Up,
    /// They cover a closed mesh from outside: nobody sees the back of one.
    pub closed: bool,
    /// How the splats were made.
    pub conversion: Conversion,
    /// The octree that the file holds; `cloud` is then its finest splats.
    pub hybrid: Option<Arc<Hybrid>>,
    /// What the user should know, as sentences without a full stop: what was dropped, assumed or estimated.
    pub notes: Vec<String>,
}

/// Loads a file and makes splats of it: a splat file as it is, points and meshes converted.
///
/// # Errors
/// [`Error::Io`] if the file can't be read or is damaged, [`Error::Sample`] if no splats can be made of it,
/// [`Error::Unsuitable`] if it holds no splat.
pub fn prepare(path: &Path, options: &LoadOptions, progress: &dyn Progress) -> Result<Prepared, Error> {
    let io_options = surfel_io::LoadOptions { repair: options.repair, texture: options.texture.clone() };
    let loaded = surfel_io::load(path, &io_options)?;
    let sample = |source| Error::Sample { path: path.to_path_buf(), source };
    let mut notes = loaded.notes;
    let (mut closed, mut octree) = (false, None);
    let (mut cloud, conversion) = match loaded.content {
        Content::Hybrid(hybrid) => {
            closed = surfel_sample::is_closed(hybrid.mesh());
            let leaves = hybrid.nodes().iter().filter(|n| n.is_leaf()).map(|n| n.splats.clone());
            let edges = hybrid.transitions().iter().map(|t| t.splats.clone());
            let cloud = hybrid.cloud_of(&leaves.chain(edges).collect::<Vec<_>>())?;
            octree = Some(Arc::from(hybrid));
            (cloud, Conversion::None)
        }
        Content::Splats(cloud) => {
            closed = cloud.data().comments.iter().any(|c| c == surfel_sample::CLOSED_MESH);
            (cloud, Conversion::None)
        }
        Content::Points(points) => {
            let point_options = PointOptions { radius_scale: options.radius_scale, ..PointOptions::default() };
            let made = surfel_sample::splats_from_points(&points, &point_options, progress);
            let (cloud, report) = made.map_err(sample)?;
            notes.push(points_note(&report));
            (cloud, Conversion::Points(report))
        }
        Content::Mesh(mesh) => {
            let auto = MeshOptions::auto(&mesh);
            closed = surfel_sample::is_closed(&mesh);
            let method = options.method.unwrap_or(auto.method);
            let mesh_options = MeshOptions { method, radius_scale: options.radius_scale };
            let (cloud, report) = surfel_sample::splats_from_mesh(&mesh, &mesh_options, progress).map_err(sample)?;
            notes.push(mesh_note(&mesh, &report));
            (cloud, Conversion::Mesh(report))
        }
    };
    if cloud.is_empty() {
        let problem = "holds no splat, expected at least one: check that the file is complete".to_owned();
        return Err(Error::Unsuitable { path: path.to_path_buf(), problem });
    }
    if options.interior_weight
        && cloud.data().interior_weight.is_none()
        && let Some(weight) = surfel_sample::interior_weight(&cloud)
    {
        cloud.set_interior_weight(weight);
        notes.push(format!("the file says no interior weight: estimated {weight:.3}"));
    }
    Ok(Prepared { cloud, format: loaded.format, up: loaded.up, closed, conversion, hybrid: octree, notes })
}

/// Loads a file that is drawn as polygons.
///
/// # Errors
/// As [`prepare`]; also [`Error::Unsuitable`] if the file holds no triangles.
pub(crate) fn load_mesh(path: &Path, options: &LoadOptions) -> Result<(Arc<Mesh>, Up, Vec<String>), Error> {
    let io_options = surfel_io::LoadOptions { repair: options.repair, texture: options.texture.clone() };
    let loaded = surfel_io::load(path, &io_options)?;
    let found = match loaded.content {
        Content::Mesh(mesh) if !mesh.triangles.is_empty() => return Ok((Arc::new(mesh), loaded.up, loaded.notes)),
        Content::Hybrid(hybrid) => return Ok((Arc::new(hybrid.mesh().clone()), loaded.up, loaded.notes)),
        Content::Mesh(_) => "a mesh without triangles",
        Content::Points(_) => "points",
        Content::Splats(_) => "splats",
    };
    let problem = format!("holds {found}, expected triangles for an object's \"mesh\": give it as \"splats\"");
    Err(Error::Unsuitable { path: path.to_path_buf(), problem })
}

fn points_note(report: &PointReport) -> String {
    let normals = match (report.normals_given, report.normals_estimated) {
        (_, 0) => "normals kept".to_owned(),
        (0, _) => "normals estimated from neighbours".to_owned(),
        (given, estimated) => format!("{given} normals kept, {estimated} estimated from neighbours"),
    };
    let mut note = format!(
        "a point cloud: {} splats, {normals}, radii estimated from neighbours (median {:.4})",
        report.splats, report.median_radius
    );
    if report.outliers > 0 {
        note += &format!("; {} isolated points", report.outliers);
    }
    note
}

fn mesh_note(mesh: &Mesh, report: &MeshReport) -> String {
    let how = match report.method {
        MeshMethod::PerFace => "one a face",
        MeshMethod::PerVertex => "one a vertex",
        MeshMethod::Count(_) => "spread over the surface",
    };
    let mut note = format!(
        "a mesh of {} triangles: {} splats, {how} (median radius {:.4})",
        mesh.triangles.len(),
        report.splats,
        report.median_radius
    );
    if report.degenerate > 0 {
        note += &format!("; {} triangles have no area", report.degenerate);
    }
    note
}

//! Meshes to splats.

mod closed;
mod count;
mod eliminate;
mod features;
pub(crate) mod geometry;
mod hybrid;
mod octree;
pub(crate) mod per_face;
pub(crate) mod random;
mod transitions;
mod vertices;

use crate::{Progress, SampleError, interior};
use geometry::Geometry;
use glam::DVec3;
use surfel_model::{CloudData, Column3, Mesh, OnInvalid, SplatCloud};

pub use closed::is_closed;
pub use hybrid::{HybridOptions, hybrid_from_mesh};
pub use vertices::points_from_mesh;

/// How a mesh becomes splats.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshMethod {
    /// One ellipse a triangle, through its three vertices (Bézier clipping paper 2012, §5.1).
    PerFace,
    /// The vertices as points: for dense scans.
    PerVertex,
    /// This many samples, spread evenly over the surface.
    Count(usize),
}

/// How a mesh becomes splats.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshOptions {
    /// The method.
    pub method: MeshMethod,
    /// Multiplies every radius; greater than 0, default 1.
    pub radius_scale: f64,
}

/// What was found while splats were made of a mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshReport {
    /// The method used.
    pub method: MeshMethod,
    /// Splats made.
    pub splats: usize,
    /// Triangles without area, which no splat was made of.
    pub degenerate: usize,
    /// Creases and borders of the surface that splats near them were trimmed to, as a number of mesh edges.
    pub feature_edges: usize,
    /// Median of the larger semi-axes, in object units.
    pub median_radius: f64,
    /// The cloud's interior weight, as stored in it.
    pub interior_weight: Option<f64>,
}

/// Vertices from which a mesh counts as dense.
const DENSE: usize = 50_000;
/// Spacing of automatic samples as a share of the largest side of the bounds: 2 px in a picture of 1024², where
/// one standard deviation of a splat is 1.7 px.
const SPACING: f64 = 2.0 / 1024.0;
/// Fewest and most automatic samples.
const AUTOMATIC: (f64, f64) = (20_000.0, 500_000.0);

impl MeshOptions {
    /// Options with a method and the radius scale 1.
    pub fn new(method: MeshMethod) -> Self {
        Self { method, radius_scale: 1.0 }
    }

    /// What a user wants to see who asked for nothing. A mesh that is dense (above 50,000 vertices), even and without
    /// a texture: its vertices. Any other: samples about 2 px apart in a picture of 1024², 20,000 to 500,000 of them.
    /// One without triangles or area: its vertices.
    pub fn auto(mesh: &Mesh) -> Self {
        let bad = |i: &u32| *i as usize >= mesh.positions.len();
        if mesh.triangles.is_empty() || mesh.triangles.iter().flatten().any(bad) {
            return Self::new(MeshMethod::PerVertex);
        }
        let geometry = Geometry::new(mesh);
        let (extent, area) = (geometry.extent, geometry.total_area());
        if area <= 0.0 || !area.is_finite() {
            return Self::new(MeshMethod::PerVertex);
        }
        let textured = mesh.texture.is_some() && mesh.uvs.is_some();
        if mesh.positions.len() > DENSE && !textured && geometry.area_of_long_triangles(extent / 64.0) < 0.01 * area {
            return Self::new(MeshMethod::PerVertex);
        }
        let count = (area / (SPACING * extent).powi(2)).clamp(AUTOMATIC.0, AUTOMATIC.1);
        Self::new(MeshMethod::Count(count as usize))
    }
}

/// Makes splats of a mesh.
///
/// Colours come from the texture (times the vertex colours) or the vertex colours; alphas likewise. Origin, up and
/// comments carry over, and the cloud's `interior_weight` is set.
///
/// - [`MeshMethod::PerFace`]: the Steiner circumellipse of each triangle, s and t its principal half-axes, s × t
///   outward. Vertex normals of the mesh, where it has them, become shading normals.
/// - [`MeshMethod::PerVertex`]: [`points_from_mesh`], then radii from the local spacing as for points.
/// - [`MeshMethod::Count`]: exactly that many samples. Up to a million of them are blue noise (weighted sample
///   elimination), more are stratified. A disk lies in the smooth normal's plane (the mesh's own normals, or
///   angle-weighted ones that don't average across creases above 40°) unless that is more than 20° off the face:
///   then it lies in the face's plane and the smooth normal is its shading normal. Near creases and borders, disks
///   are trimmed to ellipses that hardly hang over.
///
/// # Errors
/// [`SampleError::Empty`] without vertices or triangles, [`SampleError::NoArea`] when no triangle has any,
/// [`SampleError::Option`] for options out of range, [`SampleError::TooMany`] above 268 million elements, and
/// [`SampleError::Model`] for a mesh that isn't valid.
pub fn splats_from_mesh(
    mesh: &Mesh,
    options: &MeshOptions,
    progress: &dyn Progress,
) -> Result<(SplatCloud, MeshReport), SampleError> {
    SampleError::check_scale(options.radius_scale)?;
    mesh.validate()?;
    if mesh.positions.is_empty() {
        return Err(SampleError::Empty { what: "mesh", missing: "vertices" });
    }
    if options.method == MeshMethod::PerVertex {
        return vertices::splats(mesh, options, progress);
    }
    if mesh.triangles.is_empty() {
        return Err(SampleError::Empty { what: "mesh", missing: "triangles" });
    }
    SampleError::check_count("triangles", mesh.triangles.len())?;
    let mut report = MeshReport {
        method: options.method,
        splats: 0,
        degenerate: 0,
        feature_edges: 0,
        median_radius: 0.0,
        interior_weight: None,
    };
    let data = match options.method {
        MeshMethod::Count(count) => count::splats(mesh, count, options.radius_scale, &mut report, progress)?,
        _ => per_face::splats(mesh, options.radius_scale, &mut report, progress)?,
    };
    finish(mesh, data, report, progress)
}

/// Adds what carries over, validates, and measures the interior weight.
fn finish(
    mesh: &Mesh,
    data: CloudData,
    mut report: MeshReport,
    progress: &dyn Progress,
) -> Result<(SplatCloud, MeshReport), SampleError> {
    let data = CloudData { up: mesh.up, comments: mesh.comments.clone(), ..data };
    let (mut cloud, _) = SplatCloud::new(data, OnInvalid::Refuse)?;
    progress.stage("interior weight", 1);
    report.splats = cloud.len();
    let mut radii: Vec<f64> = (0..cloud.len()).map(|i| cloud.radius_max(i)).collect();
    report.median_radius = crate::radii::median(&mut radii).unwrap_or(0.0);
    report.interior_weight = interior::interior_weight(&cloud);
    if let Some(weight) = report.interior_weight {
        cloud.set_interior_weight(weight);
    }
    progress.advance(1);
    Ok((cloud, report))
}

/// A column of centres, as exact as the mesh's own positions are: f32 unless those have more.
pub(crate) fn centers(mesh: &Mesh, centers: &[DVec3]) -> Column3 {
    if mesh.positions.low().is_some() {
        Column3::from_f64(centers)
    } else {
        Column3::from_f32(centers.iter().map(|p| p.as_vec3()).collect())
    }
}

//! A mesh's vertices as points.

use super::geometry::Geometry;
use super::{MeshMethod, MeshOptions, MeshReport};
use crate::{PointOptions, Progress, SampleError, assemble, points};
use glam::DVec3;
use surfel_model::{Mesh, PointCloud, SplatCloud};

/// The vertices of a mesh as points, with its own normals or angle-weighted ones, and the colours of its texture and
/// vertices. Vertices in the same place whose normals agree within 60° (texture seams) become one point; vertices
/// of no triangle have normal zero (unknown).
///
/// # Errors
/// [`SampleError::Empty`] without vertices, [`SampleError::Model`] for a mesh that isn't valid.
pub fn points_from_mesh(mesh: &Mesh) -> Result<PointCloud, SampleError> {
    mesh.validate()?;
    if mesh.positions.is_empty() {
        return Err(SampleError::Empty { what: "mesh", missing: "vertices" });
    }
    SampleError::check_count("vertices", mesh.positions.len())?;
    SampleError::check_count("triangles", mesh.triangles.len())?;
    let geometry = Geometry::new(mesh);
    let weld = geometry.weld();
    let normals = geometry.vertex_normals(&weld);
    let rgba = geometry.is_painted().then(|| vertex_colors(&geometry));
    let (colors, alphas) = assemble::paint(rgba);
    let mut points = PointCloud {
        origin: mesh.origin,
        positions: mesh.positions.clone(),
        normals: Some(assemble::normals32(&normals)),
        colors,
        alphas,
        extras: Vec::new(),
        up: mesh.up,
        comments: mesh.comments.clone(),
    };
    let keep: Vec<bool> = weld
        .iter()
        .enumerate()
        .map(|(i, first)| {
            let (n, m) = (normals[i], normals[*first as usize]);
            i == *first as usize || (n != DVec3::ZERO && m != DVec3::ZERO && n.dot(m) < 0.5)
        })
        .collect();
    if keep.contains(&false) {
        points.retain(&keep);
    }
    Ok(points)
}

fn vertex_colors(geometry: &Geometry) -> Vec<[f32; 4]> {
    let mesh = geometry.mesh;
    let at = |i: usize| {
        let [r, g, b] = mesh.colors.as_ref().map_or([1.0; 3], |c| c[i]);
        let mut color = [r, g, b, mesh.alphas.as_ref().map_or(1.0, |a| a[i])];
        if let (Some(texture), Some(uvs)) = (&mesh.texture, &mesh.uvs) {
            color.iter_mut().zip(texture.sample(uvs[i])).for_each(|(c, t)| *c *= t);
        }
        color
    };
    (0..mesh.positions.len()).map(at).collect()
}

pub(crate) fn splats(
    mesh: &Mesh,
    options: &MeshOptions,
    progress: &dyn Progress,
) -> Result<(SplatCloud, MeshReport), SampleError> {
    let points = points_from_mesh(mesh)?;
    let point_options = PointOptions { radius_scale: options.radius_scale, ..PointOptions::default() };
    let (cloud, found) = points::splats_from_points(&points, &point_options, progress)?;
    let degenerate = Geometry::new(mesh).degenerate();
    let report = MeshReport {
        method: MeshMethod::PerVertex,
        splats: cloud.len(),
        degenerate,
        feature_edges: 0,
        median_radius: found.median_radius,
        interior_weight: found.interior_weight,
    };
    Ok((cloud, report))
}

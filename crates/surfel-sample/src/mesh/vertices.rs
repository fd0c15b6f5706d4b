//! Conversion of a mesh's vertices to points and splats.

use super::closed::is_oriented;
use super::geometry::{Geometry, SAME_NORMAL};
use super::options::{MeshMethod, MeshOptions, MeshReport};
use crate::radii::COVER;
use crate::{PointOptions, Progress, SampleError, assemble, points};
use glam::DVec3;
use surfel_math::basis::unit;
use surfel_model::{CloudData, Column3, Mesh, OnInvalid, PointCloud, Shape, SplatCloud};

/// Smallest cosine (60°) between the normals of two vertices at one position at which they become one point. Also the
/// smallest cosine between the normals of a vertex (or its disk) and a face at which the face determines the disk.
const AGREE: f64 = 0.5;
/// Largest factor by which a disk grows to cover the triangles around its vertex. Larger disks of long triangles would
/// reach over borders.
const MAX_GROWN: f64 = 2.0;

/// Converts the vertices of a mesh to points, with stored or angle-weighted normals, and with the colours of the mesh's
/// texture and vertices. A vertex at the same position as an earlier one (texture seams) adds a point only if its
/// normal and the first vertex's are known and differ by more than 60°. Vertices without triangles have normal zero
/// (unknown). Vertices that an alpha mask cuts, or with alpha 0, are dropped.
///
/// # Errors
/// [`SampleError::Empty`] without vertices, [`SampleError::TooMany`] above 268 million vertices or triangles, and
/// [`SampleError::Model`] for an invalid mesh.
pub fn points_from_mesh(mesh: &Mesh) -> Result<PointCloud, SampleError> {
    Ok(vertices(mesh)?.points)
}

/// Points made of a mesh's vertices, and the vertices from which they were made.
struct Vertices {
    points: PointCloud,
    /// Index of the mesh vertex from which each point was made.
    sources: Vec<u32>,
    /// Index of the first vertex at the same position, for each vertex of the mesh.
    weld: Vec<u32>,
}

fn vertices(mesh: &Mesh) -> Result<Vertices, SampleError> {
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
    let unseen: Vec<bool> = match &alphas {
        Some(alphas) => alphas.iter().map(|a| *a == 0.0).collect(),
        None => vec![false; mesh.positions.len()],
    };
    let mut points = PointCloud {
        origin: mesh.origin,
        positions: mesh.positions.clone(),
        normals: Some(assemble::normals32(&normals)),
        colors,
        alphas,
        up: mesh.up,
        comments: mesh.comments.clone(),
        ..PointCloud::default()
    };
    let keep: Vec<bool> = weld
        .iter()
        .enumerate()
        .map(|(i, first)| {
            let (n, m) = (normals[i], normals[*first as usize]);
            !unseen[i] && (i == *first as usize || (n != DVec3::ZERO && m != DVec3::ZERO && n.dot(m) < AGREE))
        })
        .collect();
    let sources = (0..keep.len() as u32).filter(|i| keep[*i as usize]).collect();
    if keep.contains(&false) {
        points.retain(&keep);
    }
    Ok(Vertices { points, sources, weld })
}

fn vertex_colors(geometry: &Geometry) -> Vec<[f32; 4]> {
    let mesh = geometry.mesh;
    // A vertex has one material, so any of its triangles can provide it.
    let mut face_of = vec![usize::MAX; mesh.positions.len()];
    for (face, t) in mesh.triangles.iter().enumerate() {
        t.iter().for_each(|i| face_of[*i as usize] = face);
    }
    let at = |i: usize| {
        let material = mesh.material(face_of[i]);
        let [r, g, b] = mesh.colors.as_ref().map_or([1.0; 3], |c| c[i]);
        let mut color = [r, g, b, mesh.alphas.as_ref().map_or(1.0, |a| a[i])];
        if let (Some(texture), Some(uvs)) = (material.texture, &mesh.uvs) {
            color.iter_mut().zip(texture.sample(uvs[i])).for_each(|(c, t)| *c *= t);
        }
        color[3] = material.alpha.opacity(color[3]);
        color
    };
    (0..mesh.positions.len()).map(at).collect()
}

pub(crate) fn splats(
    mesh: &Mesh,
    options: &MeshOptions,
    progress: &dyn Progress,
) -> Result<(SplatCloud, MeshReport), SampleError> {
    let Vertices { mut points, sources, weld } = vertices(mesh)?;
    let point_options =
        PointOptions { radius_scale: options.radius_scale, lays_by_normals: true, ..PointOptions::default() };
    let geometry = Geometry::new(mesh);
    // Stored normals are for shading; the faces determine the plane and the visible side of a splat.
    let shading = points.normals.clone().filter(|_| mesh.normals.is_some());
    if let Some(shading) = &shading {
        points.normals = Some(assemble::normals32(&plane_normals(&geometry, &weld, &sources, shading)));
    }
    let (mut cloud, found) = points::splats_from_points(&points, &point_options, progress)?;
    cloud = cover_triangles(cloud, &geometry, &weld, &sources, options.radius_scale)?;
    if let Some(shading) = shading {
        let of = |i: usize| Some(unit(shading.get(i))).filter(|n| *n != DVec3::ZERO).unwrap_or(cloud.normal(i));
        let normals: Vec<DVec3> = (0..cloud.len()).map(of).collect();
        if normals.iter().enumerate().any(|(i, n)| cloud.normal(i).dot(*n) < SAME_NORMAL) {
            let shading_normals = Some(assemble::normals32(&normals));
            cloud = SplatCloud::new(CloudData { shading_normals, ..cloud.into_data() }, OnInvalid::Refuse)?.0;
        }
    }
    cloud.set_oriented(is_oriented(mesh));
    let (degenerate, repeated) = (geometry.degenerate(), geometry.repeated);
    let report = MeshReport {
        method: MeshMethod::PerVertex,
        detail: None,
        splats: cloud.len(),
        degenerate,
        repeated,
        feature_edges: 0,
        flat: false,
        median_radius: found.median_radius,
        interior_weight: found.interior_weight,
    };
    Ok((cloud, report))
}

/// Enlarges disks that leave holes in the triangles around their vertex. Points alone don't show that large triangles
/// next to small ones, or narrow faces, are surface. In every triangle, each disk reaches past the region nearest to
/// its vertex, so that the triangle's three disks cover it. Disks grow at most by the factor [`MAX_GROWN`], and not for
/// triangles that face more than 60° away from them. Ellipses don't grow.
fn cover_triangles(
    cloud: SplatCloud,
    geometry: &Geometry,
    weld: &[u32],
    sources: &[u32],
    scale: f64,
) -> Result<SplatCloud, SampleError> {
    let mut point_of: Vec<Option<u32>> = vec![None; weld.len()];
    for (point, source) in sources.iter().enumerate() {
        point_of[*source as usize] = Some(point as u32);
    }
    let mut grown: Vec<(usize, f64)> = Vec::new();
    for (face, t) in geometry.mesh.triangles.iter().enumerate().filter(|(face, _)| geometry.areas[*face] > 0.0) {
        let corners = t.map(|i| geometry.positions[i as usize]);
        for k in 0..3 {
            let [p, q, r] = [k, (k + 1) % 3, (k + 2) % 3].map(|i| corners[i]);
            let Some(i) = point_of[t[k] as usize].or(point_of[weld[t[k] as usize] as usize]) else { continue };
            let (i, margin) = (i as usize, COVER * scale);
            // The region nearest to a corner reaches at most as far as the longer of its two edges.
            let may_grow = margin * margin * (q - p).length_squared().max((r - p).length_squared())
                > cloud.radius_max(i) * cloud.radius_max(i);
            if may_grow && geometry.normals[face].dot(cloud.normal(i)) >= AGREE {
                grown.push((i, margin * reach(q - p, r - p)));
            }
        }
    }
    let mut data = cloud.into_data();
    if let Shape::Disks { radii, .. } = &mut data.shape {
        let own = radii.clone();
        for (i, reach) in grown {
            radii[i] = radii[i].max(reach.min(MAX_GROWN * f64::from(own[i])) as f32);
        }
    }
    Ok(SplatCloud::new(data, OnInvalid::Refuse)?.0)
}

/// Returns the radius of a corner's own region in a triangle: all points that are nearer to this corner than to the
/// other two. The corner is the origin, and the other two are `a` and `b`.
fn reach(a: DVec3, b: DVec3) -> f64 {
    let beyond = |x: DVec3, corner: DVec3| x.dot(corner) - 0.5 * corner.length_squared();
    let mut nearest = vec![DVec3::ZERO, a, b];
    for corner in [a, b] {
        let mut kept = Vec::with_capacity(5);
        for (i, x) in nearest.iter().enumerate() {
            let next = nearest[(i + 1) % nearest.len()];
            let (here, there) = (beyond(*x, corner), beyond(next, corner));
            if here <= 0.0 {
                kept.push(*x);
            }
            if (here <= 0.0) != (there <= 0.0) {
                kept.push(x.lerp(next, here / (here - there)));
            }
        }
        nearest = kept;
    }
    nearest.iter().map(|x| x.length()).fold(0.0, f64::max)
}

/// Returns the unit normals of the splats' planes at some vertices. The normals of adjacent faces within 60° of the
/// vertex's own normal are averaged by angle, so that hard edges stay hard. If no face agrees, all faces count; without
/// faces, the vertex's own normal is used.
fn plane_normals(geometry: &Geometry, weld: &[u32], sources: &[u32], own: &Column3) -> Vec<DVec3> {
    let mut corners: Vec<(u32, u32)> = Vec::with_capacity(3 * geometry.areas.len());
    for (face, t) in geometry.mesh.triangles.iter().enumerate().filter(|(face, _)| geometry.areas[*face] > 0.0) {
        corners.extend((0..3).map(|k| (weld[t[k] as usize], (3 * face + k) as u32)));
    }
    corners.sort_unstable();
    let of = |(i, source): (usize, &u32)| {
        let own = unit(own.get(i));
        let place = weld[*source as usize];
        let from = corners.partition_point(|(at, _)| *at < place);
        let here = || corners[from..].iter().take_while(|(at, _)| *at == place).map(|(_, corner)| *corner as usize);
        let normal = |corner: usize| geometry.normals[corner / 3];
        let weighted = |corner: usize| geometry.angle(corner / 3, corner % 3) * normal(corner);
        let agreeing = unit(here().filter(|corner| normal(*corner).dot(own) >= AGREE).map(weighted).sum());
        let all: DVec3 = unit(here().map(weighted).sum());
        [agreeing, all, own].into_iter().find(|n| *n != DVec3::ZERO).unwrap_or_default()
    };
    sources.iter().enumerate().map(of).collect()
}

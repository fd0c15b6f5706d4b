//! Polygons among splats (rendering model §6): finds the nearest polygon of each pixel, and evaluates its surface.

use crate::margin;
use crate::pixels;
use crate::scene::ResidentMesh;
use glam::DVec3;
use rayon::prelude::*;
use surfel_math::basis::{normal_matrix, unit};
use surfel_math::bounds::Extent;
use surfel_math::triangle::{self, Triangle, interpolate};
use surfel_math::{V2, V3};
use surfel_model::Cull;
use surfel_render::{FramePlan, Region, View};

/// Triangle of a mesh, projected to the view.
pub(crate) struct ScreenTriangle {
    mesh: u32,
    /// Index of the triangle in its mesh.
    index: u32,
    triangle: Triangle<f64>,
    extent: Extent<f64>,
    /// True if the triangle faces away from the eye.
    back_facing: bool,
    /// Distance between the triangle's facing cosine and the limit at which a facing decision changes; infinite if
    /// nothing depends on facing.
    facing_margin: f64,
}

/// Nearest polygon of a pixel, and its depth.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Hit {
    /// Planar depth of the polygon at the pixel; +∞ if there is no polygon.
    pub z: f64,
    /// Index of the triangle in [`Polygons::triangles`].
    triangle: u32,
    /// True if rounding could change which polygon is nearest, or remove it.
    pub marginal: bool,
}

impl Hit {
    pub(crate) const NONE: Self = Self { z: f64::INFINITY, triangle: u32::MAX, marginal: false };
}

/// Albedo, normal and material factors at a point of a polygon, as the input of lighting.
pub(crate) struct Material {
    pub albedo: DVec3,
    /// Unit normal of the polygon in world space, turned to the eye if the material is two-sided; zero if it is
    /// undefined.
    pub normal: DVec3,
    /// Ambient, diffuse, specular and shininess factors of the material.
    pub factors: [f64; 4],
}

/// Projected triangles of all meshes in a frame.
pub(crate) struct Polygons<'a> {
    meshes: &'a [ResidentMesh],
    view: &'a View,
    triangles: Vec<ScreenTriangle>,
}

/// Returns the position of a vertex in view space.
fn vertex(mesh: &ResidentMesh, view: &View, i: u32) -> DVec3 {
    let m = &mesh.mesh;
    // The eye is subtracted before the rotation, so that scenes far from the origin stay exact.
    let origin = mesh.world_from_object.transform_point3(m.origin) - view.eye;
    view.view_from_world * (origin + mesh.world_from_object.matrix3 * m.positions.get(i as usize))
}

impl<'a> Polygons<'a> {
    /// Projects every triangle that the plan draws.
    pub(crate) fn new(meshes: &'a [ResidentMesh], view: &'a View, plan: &FramePlan) -> Self {
        let of_mesh = |(i, mesh): (usize, &ResidentMesh)| {
            let project = |k| project(mesh, i as u32, k, view);
            let selection = plan.selection_of(mesh.source);
            let triangles = (0..mesh.mesh.triangles.len()).into_par_iter();
            let triangles = triangles.filter(|k| selection.is_none_or(|s| s.has_triangle(*k as u32)));
            triangles.filter_map(project).collect::<Vec<_>>()
        };
        let triangles = meshes.iter().enumerate().flat_map(of_mesh).collect();
        Self { meshes, view, triangles }
    }

    /// Returns the nearest polygon of every pixel of `rect`; of equally near ones, the first. `rim_px` is the distance
    /// from an edge, in pixels of the view, within which rounding could change a hit; `None` if margins aren't needed.
    pub(crate) fn nearest(&self, rect: Region, rim_px: Option<f64>) -> Vec<Hit> {
        let mut hits = vec![Hit::NONE; rect.width as usize * rect.height as usize];
        let mut of_row = vec![Vec::new(); rect.height as usize];
        for (i, t) in self.triangles.iter().enumerate() {
            let (columns, rows) = pixels::touched(&t.extent, rect);
            if !columns.is_empty() {
                rows.for_each(|y| of_row[(y - rect.y) as usize].push((i as u32, columns.clone())));
            }
        }
        let rows = hits.par_chunks_mut(rect.width as usize).zip(&of_row).zip(rect.y..rect.y + rect.height);
        rows.for_each(|((hits, triangles), y)| {
            for (i, columns) in triangles {
                for x in columns.clone() {
                    let hit = &mut hits[(x - rect.x) as usize];
                    self.test(*i, pixels::center(x, y), hit, rim_px);
                }
            }
        });
        hits
    }

    fn test(&self, index: u32, pixel: V2<f64>, hit: &mut Hit, rim_px: Option<f64>) {
        let with_margin = rim_px.is_some();
        let t = &self.triangles[index as usize];
        let (inside, on_rim) = (t.triangle.contains(pixel), rim_px.is_some_and(|rim| on_rim(&t.triangle, pixel, rim)));
        if !inside && !on_rim {
            return;
        }
        let z = t.triangle.depth(t.triangle.barycentric(pixel));
        let projection = &self.view.projection;
        let exists = z >= projection.near && z <= projection.far();
        if with_margin {
            let open = on_rim || margin::on_depth(z, projection.near) || t.facing_margin <= margin::RELATIVE;
            hit.marginal |= open && z <= hit.z;
            hit.marginal |= exists && margin::on_depth(z, hit.z);
        }
        if inside && exists && z < hit.z {
            let marginal = with_margin && (hit.marginal && margin::on_depth(z, hit.z));
            let open = on_rim || margin::on_depth(z, projection.near) || t.facing_margin <= margin::RELATIVE;
            *hit = Hit { z, triangle: index, marginal: marginal || (with_margin && open) };
        }
    }

    /// Returns the index of the mesh to which a hit belongs; `None` without a hit.
    pub(crate) fn mesh_of(&self, hit: &Hit) -> Option<usize> {
        self.triangles.get(hit.triangle as usize).map(|t| t.mesh as usize)
    }

    /// Returns the depth gradient of the hit polygon at a pixel: the change of its depth per pixel to the right and per
    /// pixel down.
    pub(crate) fn depth_gradient(&self, hit: &Hit, pixel: V2<f64>) -> V2<f64> {
        let t = &self.triangles[hit.triangle as usize].triangle;
        t.gradient(t.z, hit.z, pixel)
    }

    /// Evaluates colour, normal and material factors of the hit polygon at a pixel.
    pub(crate) fn material(&self, hit: &Hit, pixel: V2<f64>) -> Material {
        let t = &self.triangles[hit.triangle as usize];
        let resident = &self.meshes[t.mesh as usize];
        let mesh = &*resident.mesh;
        let corners = mesh.triangles[t.index as usize].map(|i| i as usize);
        let b = t.triangle.barycentric(pixel);
        let blend3 = |values: [DVec3; 3]| values[0] * b[0] + values[1] * b[1] + values[2] * b[2];
        let color = |column: &[[f32; 3]]| blend3(corners.map(|i| DVec3::from(column[i].map(f64::from))));
        let mut albedo = mesh.colors.as_deref().map_or(DVec3::ONE, color);
        if let (Some(uvs), Some(mipmaps)) = (&mesh.uvs, &resident.mipmaps) {
            let texture = mipmaps.texture();
            let axis = |k: usize| {
                let values = corners.map(|i| f64::from(uvs[i][k]));
                let value = interpolate(b, values);
                (value, t.triangle.gradient(values, value, pixel))
            };
            let ((u, du), (v, dv)) = (axis(0), axis(1));
            let (w, h) = (f64::from(texture.width), f64::from(texture.height));
            let footprint = (du.x * w).hypot(dv.x * h).max((du.y * w).hypot(dv.y * h));
            let texel = mipmaps.sample([u as f32, v as f32], footprint);
            albedo *= DVec3::new(texel[0].into(), texel[1].into(), texel[2].into());
        }
        let to_world = normal_matrix(&resident.world_from_object.matrix3);
        let smooth =
            |column: &[[f32; 3]]| blend3(corners.map(|i| unit(to_world * DVec3::from(column[i].map(f64::from)))));
        let flat = || unit(to_world * outward(resident, t.index as usize));
        let mut normal = unit(mesh.normals.as_deref().map_or(DVec3::ZERO, smooth));
        if normal == DVec3::ZERO || !normal.is_finite() {
            normal = flat();
        }
        if resident.material.two_sided && t.back_facing {
            normal = -normal;
        }
        Material { albedo, normal, factors: resident.material.factors() }
    }
}

/// Returns the outward normal of a triangle in object space, not normalised. It points to the side from which the
/// corners run counter-clockwise.
fn outward(mesh: &ResidentMesh, k: usize) -> DVec3 {
    let [a, b, c] = mesh.mesh.triangles[k].map(|i| mesh.mesh.positions.get(i as usize));
    (b - a).cross(c - a)
}

fn project(mesh: &ResidentMesh, mesh_index: u32, k: usize, view: &View) -> Option<ScreenTriangle> {
    let corners = mesh.mesh.triangles[k].map(|i| vertex(mesh, view, i));
    let normal = view.view_from_world * unit(normal_matrix(&mesh.world_from_object.matrix3) * outward(mesh, k));
    let (facing, cosine) = match view.projection.is_perspective() {
        true => (normal.dot(corners[0]), normal.dot(unit(corners[0]))),
        false => (normal.z, normal.z),
    };
    let back_facing = facing >= 0.0;
    if mesh.material.cull == Cull::Back && back_facing {
        return None;
    }
    let corners = corners.map(V3::from);
    let extent = triangle::bounds(corners, &view.projection)?;
    let sided = mesh.material.two_sided || mesh.material.cull == Cull::Back;
    Some(ScreenTriangle {
        mesh: mesh_index,
        index: k as u32,
        // One anchor for all triangles makes adjacent ones test a shared edge by the same number.
        triangle: Triangle::new(corners, V2::new(0.0, 0.0), &view.projection),
        extent,
        back_facing,
        facing_margin: if sided { cosine.abs() } else { f64::INFINITY },
    })
}

/// True if rounding could change whether the pixel is inside the triangle: it is within `rim_px` of some edge, and not
/// outside of any edge by more.
fn on_rim(t: &Triangle<f64>, pixel: V2<f64>, rim_px: f64) -> bool {
    let distances = t.edges.map(|e| e.at(pixel) / e.x.hypot(e.y));
    distances.iter().all(|d| *d >= -rim_px) && distances.iter().any(|d| d.abs() <= rim_px)
}

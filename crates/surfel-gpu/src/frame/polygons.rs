//! Polygons that may touch a tile (rendering model §6). They are set up in f64, as in the reference, and uploaded.

use crate::frame::object_transform::ObjectTransform;
use crate::frame::pixel_range::pixel_range;
use crate::scene::segment::UploadedMesh;
use crate::struct_writer::StructWriter;
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use surfel_math::basis::unit;
use surfel_math::triangle::{self, Triangle};
use surfel_math::{V2, V3};
use surfel_model::Cull;
use surfel_render::{Region, SelectedParts, View};
use surfel_shaders::layout;

/// Number of triangles per task when triangles are set up in parallel; results don't depend on it.
const TRIANGLES_PER_TASK: usize = 1024;

/// Mesh in a view, for the setup of its triangles for a tile.
struct MeshView<'a> {
    mesh: &'a UploadedMesh,
    transform: ObjectTransform,
    view: &'a View,
    tile: Region,
    /// True if back faces are drawn even if the material culls them.
    both_sides: bool,
}

/// Returns the words of the shaders' `Polygon`s that may touch the tile, for each of `meshes`, in their order. If
/// polygons have equal depth at a pixel, the first in this order is drawn. `octrees` are the parts of octrees that the
/// frame draws. `both_sides` is true to draw back faces even if a material culls them.
pub(crate) fn polygon_words(
    meshes: &[UploadedMesh],
    octrees: &[SelectedParts],
    view: &View,
    tile: Region,
    both_sides: bool,
) -> Vec<Vec<u32>> {
    let of_mesh = |mesh: &UploadedMesh| {
        let transform = ObjectTransform::new(&mesh.world_from_object, view);
        let seen = MeshView { mesh, transform, view, tile, both_sides };
        let count = mesh.mesh.triangles.len();
        let selection = mesh.octree.and_then(|index| SelectedParts::of(octrees, index));
        let is_drawn = |k: &usize| selection.is_none_or(|selection| selection.has_triangle(*k as u32));
        let some = |first: usize| -> Vec<u32> {
            let triangles = (first..count.min(first + TRIANGLES_PER_TASK)).filter(is_drawn);
            triangles.filter_map(|k| seen.polygon(k)).flatten().collect()
        };
        // The results are collected in order, whatever the number of threads.
        (0..count).into_par_iter().step_by(TRIANGLES_PER_TASK).map(some).collect::<Vec<Vec<u32>>>().concat()
    };
    meshes.iter().map(of_mesh).collect()
}

impl MeshView<'_> {
    /// Returns the words of the shaders' `Polygon` of triangle `k`. `None` if the triangle isn't drawn: it faces away
    /// and is culled, can't touch the tile, or has no area in the view.
    fn polygon(&self, k: usize) -> Option<Vec<u32>> {
        let (mesh, projection) = (&self.mesh.mesh, &self.view.projection);
        let corners = mesh.triangles.get(k)?.map(|i| i as usize);
        let positions = corners.map(|i| mesh.positions.get(i));
        let at = positions.map(|p| self.transform.point(mesh.origin) + self.transform.linear * p);
        let outward = (positions[1] - positions[0]).cross(positions[2] - positions[0]);
        let flat = unit(self.transform.normals * outward);
        let in_view = self.view.view_from_world * flat;
        let facing = if projection.is_perspective() { in_view.dot(at[0]) } else { in_view.z };
        let (back_facing, material) = (facing >= 0.0, &self.mesh.material);
        if back_facing && material.cull == Cull::Back && !self.both_sides {
            return None;
        }
        let at = at.map(V3::from);
        let extent = triangle::bounds(at, projection)?;
        let columns = pixel_range(extent.min.x, extent.max.x, self.tile.x, self.tile.width)?;
        let rows = pixel_range(extent.min.y, extent.max.y, self.tile.y, self.tile.height)?;
        // The anchor is the centre of the targets' first pixel, so that offsets are integers.
        let anchor = V2::new(f64::from(self.tile.x) + 0.5, f64::from(self.tile.y) + 0.5);
        let shape = Triangle::new(at, anchor, projection);
        let largest = shape.edges.iter().map(|e| e.x.abs().max(e.y.abs())).fold(0.0, f64::max);
        if !(largest > 0.0 && largest.is_finite()) {
            return None;
        }
        // Scaling by a power of two doesn't round, so neighbours still classify their common edge by the same number.
        let scale = (-largest.log2().floor()).exp2();
        let middle = |[first, end]: [u32; 2]| first + (end - first) / 2;
        let base = [middle(columns), middle(rows)];
        let to_base = V2::new(f64::from(base[0]), f64::from(base[1]));
        use layout::polygon as to;
        let mut words = StructWriter::new(to::SIZE);
        for (i, e) in shape.edges.iter().enumerate() {
            let offset = to::EDGES + i * layout::linear::SIZE;
            words.f64(offset + layout::linear::C, e.at(to_base) * scale);
            words.f64(offset + layout::linear::X, e.x * scale).f64(offset + layout::linear::Y, e.y * scale);
            words.f64(to::COVERS + 4 * i, e.c * scale);
        }
        words.i32x2(to::BASE, [(self.tile.x + base[0]).cast_signed(), (self.tile.y + base[1]).cast_signed()]);
        words.f64s(to::Z, shape.z);
        words.u32(to::BOX, columns[0] | rows[0] << 16).u32(to::BOX + 4, columns[1] | rows[1] << 16);
        words.u32(to::TEXTURE_AT, self.mesh.texture_at);
        let side = if back_facing && material.two_sided { -1.0 } else { 1.0 };
        self.attributes(corners, flat * side, side, &mut words);
        words.f64s(to::MATERIAL, material.factors());
        Some(words.into_words())
    }

    /// Writes colours, normals and texture coordinates of a triangle's corners, and the normal of its plane, to its
    /// polygon. Corners without a colour are white, and corners without a valid normal get that of the plane. `flat` is
    /// the unit normal of the plane, with the sign of `side`. `side` is −1 if the material is two-sided and the
    /// triangle back-facing, else 1.
    fn attributes(&self, corners: [usize; 3], flat: DVec3, side: f64, words: &mut StructWriter) {
        use layout::polygon as to;
        let mesh = &self.mesh.mesh;
        let vector = |column: &Option<Vec<[f32; 3]>>, i: usize| {
            column.as_ref().and_then(|c| c.get(i)).map(|v| DVec3::from(v.map(f64::from)))
        };
        let colors = [to::COLOR0, to::COLOR1, to::COLOR2];
        let normals = [to::NORMAL0, to::NORMAL1, to::NORMAL2];
        for ((i, color_at), normal_at) in corners.into_iter().zip(colors).zip(normals) {
            words.vec3(color_at, vector(&mesh.colors, i).unwrap_or(DVec3::ONE));
            let normal = vector(&mesh.normals, i).map(|n| unit(self.transform.normals * n) * side);
            words.vec3(normal_at, normal.filter(|n| n.is_finite()).unwrap_or(flat));
        }
        words.vec3(to::FLAT_NORMAL, flat);
        let uvs = mesh.uvs.as_deref().unwrap_or_default();
        let uv = corners.map(|i| uvs.get(i).map_or(DVec2::ZERO, |uv| DVec2::from(uv.map(f64::from))));
        // Textures repeat: subtracting the same integer from all three corners changes nothing and improves f32
        // precision.
        let turns = uv[0].floor();
        let uv = uv.map(|uv| if uv.is_finite() && turns.is_finite() { uv - turns } else { DVec2::ZERO });
        words.f64s(to::U, uv.map(|uv| uv.x)).f64s(to::V, uv.map(|uv| uv.y));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DAffine3, Vec3};
    use std::sync::Arc;
    use surfel_model::{Camera, Column3, Material, Mesh, Projection};

    /// Returns two triangles of different size beside each other in the plane z = 0, and one that faces away from the
    /// eye.
    fn polygons(cull: Cull, region: Region) -> Vec<Vec<f32>> {
        let corners = [[-1.0, -1.0], [1.0, -1.0], [1.1, 0.9], [-1.5, 1.7]].map(|[x, y]| Vec3::new(x, y, 0.0));
        let mesh = Mesh {
            positions: Column3::from_f32(corners.to_vec()),
            triangles: vec![[0, 1, 2], [0, 2, 3], [0, 2, 1]],
            ..Mesh::default()
        };
        let material = Material { cull, ..Material::default() };
        let world_from_object = DAffine3::IDENTITY;
        let uploaded = UploadedMesh {
            source: 0,
            mesh: Arc::new(mesh),
            octree: None,
            world_from_object,
            material,
            texture_at: layout::ABSENT,
        };
        let projection = Projection::Perspective { fov_y_deg: 45.0 };
        let (eye, up, size) = ([0.3, 0.1, 5.0], [0.0, 1.0, 0.0], [64, 64]);
        let view = View::new(&Camera { eye, target: [0.0; 3], up, projection, near: 0.1, far: None, size }).unwrap();
        let words = polygon_words(&[uploaded], &[], &view, region, false).concat();
        let floats = |polygon: &[u32]| polygon.iter().map(|&w| f32::from_bits(w)).collect();
        words.chunks_exact(layout::polygon::SIZE / 4).map(floats).collect()
    }

    const WHOLE: Region = Region { x: 0, y: 0, width: 64, height: 64 };

    #[test]
    fn neighbours_have_the_negative_of_each_other_s_edge() {
        let found = polygons(Cull::None, WHOLE);
        let edge = |polygon: &[f32], i: usize| {
            let at = (layout::polygon::EDGES + i * layout::linear::SIZE) / 4;
            let covers = polygon[layout::polygon::COVERS / 4 + i];
            [covers, polygon[at + layout::linear::X / 4], polygon[at + layout::linear::Y / 4]]
        };
        // The edge between corners 0 and 2 is opposite to the first triangle's second vertex and the other's third.
        let (a, b) = (edge(&found[0], 1), edge(&found[1], 2));
        // Each triangle is scaled by its own power of two.
        let scale = a[1] / b[1];
        assert!(scale < 0.0 && scale.abs().log2().fract() == 0.0, "{scale}");
        assert_eq!(a, b.map(|v| v * scale));
    }

    #[test]
    fn polygons_that_face_away_or_lie_beside_the_tile_are_left_out() {
        assert_eq!(polygons(Cull::None, WHOLE).len(), 3);
        assert_eq!(polygons(Cull::Back, WHOLE).len(), 2);
        assert_eq!(polygons(Cull::None, Region { width: 4, ..WHOLE }).len(), 0);
    }
}

//! Search for the nearest triangle in each pixel of a block (rendering model §6).
//!
//! A *block* is 4×4 pixels ([`BLOCK`](crate::tiles::grid::BLOCK)). A *lane* is one of the 16 numbers that SIMD
//! instructions compute at once.

use crate::setup::triangles::ScreenTriangle;
use crate::simd::compress::ones;
use crate::simd::lanes::{LANES, Lanes};
use fearless_simd::Simd;
use fearless_simd::prelude::SimdMask;
use surfel_math::mapping::Linear;
use surfel_math::triangle::Triangle;
use surfel_math::{Real, V2};

/// The nearest polygon in each pixel of a block.
#[derive(Clone, Copy)]
pub(crate) struct Nearest<S: Simd> {
    /// Depths of the nearest polygons; +∞ in pixels without one.
    pub z: Lanes<S>,
    /// Indices of the nearest polygons in the block's list, as the bits of floats.
    which: Lanes<S>,
}

/// Returns a linear form relative to the first pixel of a block, in lanes. The form is rounded once: adjacent
/// triangles, whose edges are each other's negatives, still decide by the same number.
#[inline(always)]
fn about<S: Simd>(simd: S, form: &Linear<f64>, first: V2<f64>) -> Linear<Lanes<S>> {
    let k = |v: f64| Lanes::splat(simd, v as f32);
    Linear { c: k(form.at(first)), x: k(form.x), y: k(form.y) }
}

/// Returns the position of a pixel's centre.
pub(crate) fn center((x, y): (i32, i32)) -> V2<f64> {
    V2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)
}

/// Returns the pixel of this lane in a block whose first pixel is given.
pub(crate) fn pixel_of((x, y): (i32, i32), lane: usize) -> (i32, i32) {
    (x + (lane % 4) as i32, y + (lane / 4) as i32)
}

/// Returns the nearest polygon in each pixel of a block; of equally near ones, the first in the list. Polygons at
/// depths outside the range `exists` are ignored.
#[inline(always)]
pub(crate) fn nearest<S: Simd>(simd: S, list: &[&ScreenTriangle], at: (i32, i32), exists: [f32; 2]) -> Nearest<S> {
    let k = |v: f32| Lanes::splat(simd, v);
    let first = center(at);
    let d = V2::new(Lanes::block_columns(simd), Lanes::block_rows(simd));
    let mut nearest = Nearest { z: k(f32::INFINITY), which: k(0.0) };
    for (i, t) in list.iter().enumerate() {
        if nearest.z.le(k(t.z_min)).all_true() {
            continue;
        }
        let [a, b, c] = &t.triangle.edges;
        let edges = [about(simd, a, first), about(simd, b, first), about(simd, c, first)];
        let triangle = Triangle { edges, z: [k(0.0); 3] };
        let inside = triangle.contains(d);
        if inside.to_bitmask() == 0 {
            continue;
        }
        // In this order of operations, the depths of a large triangle's far corners don't cancel in f32.
        let z = about(simd, &t.depth, first).at(d) / about(simd, &t.weight, first).at(d);
        let closer = inside & k(exists[0]).le(z) & z.le(k(exists[1])) & z.lt(nearest.z);
        nearest.z = Lanes::select(closer, z, nearest.z);
        nearest.which = Lanes::select(closer, k(f32::from_bits(i as u32)), nearest.which);
    }
    nearest
}

impl<S: Simd> Nearest<S> {
    /// Returns the depths of the nearest polygons, moved back in the lanes whose bits are set. They move by
    /// `allowance`, a function of a polygon's depth and of the change of this depth per pixel to the right and down.
    #[inline(never)]
    pub(crate) fn moved_back(
        &self,
        simd: S,
        list: &[&ScreenTriangle],
        at: (i32, i32),
        lanes: u64,
        allowance: impl Fn(f64, V2<f64>) -> f64,
    ) -> Lanes<S> {
        let (mut z, which) = (self.z.to_array(), self.indices());
        for lane in ones(lanes) {
            let Some(t) = list.get(which[lane]) else { continue };
            let own = f64::from(z[lane]);
            let gradient = t.triangle.gradient(t.triangle.z, own, center(pixel_of(at, lane)));
            z[lane] = (own + allowance(own, gradient)) as f32;
        }
        Lanes::load(simd, &z)
    }

    /// Returns the index of each pixel's nearest polygon in the block's list; 0 in pixels without one.
    #[inline(always)]
    pub(crate) fn indices(&self) -> [usize; LANES] {
        self.which.to_array().map(|bits| bits.to_bits() as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cull::chunks::{MeshPart, mesh_parts};
    use crate::scene::mesh::StoredMesh;
    use crate::setup::triangles::{TriangleSegment, project};
    use crate::simd::level::{Instructions, SimdLevel, with_instructions};
    use crate::tiles::grid::Grid;
    use glam::{DAffine3, DVec3};
    use std::sync::Arc;
    use surfel_model::{Camera, Column3, Cull, Geometry, Material, Mesh, Object, Projection};
    use surfel_render::View;

    const SIZE: u32 = 64;

    fn view() -> View {
        let projection = Projection::Perspective { fov_y_deg: 45.0 };
        let (eye, target, up) = ([0.0, 0.0, 3.0], [0.0; 3], [0.0, 1.0, 0.0]);
        View::new(&Camera { eye, target, up, projection, near: 0.1, far: None, size: [SIZE; 2] }).unwrap()
    }

    /// Returns a pseudo-random number in [−1, 1).
    fn noise(i: usize) -> f64 {
        let x = (i as f64 * 12.9898).sin() * 43758.5453;
        2.0 * (x - x.floor()) - 1.0
    }

    /// Returns a sheet larger than the image, of n×n quads whose diagonals run either way. The vertices are displaced
    /// at random in all directions, without folds.
    fn crumpled(n: usize, seed: usize) -> Mesh {
        let vertex = |i: usize| {
            let (x, y) = ((i % (n + 1)) as f64 / n as f64 - 0.5, (i / (n + 1)) as f64 / n as f64 - 0.5);
            let bend = 0.3 / n as f64;
            DVec3::new(
                3.4 * x + bend * noise(3 * i + seed),
                3.4 * y + bend * noise(3 * i + 1 + seed),
                bend * noise(3 * i + 2 + seed),
            )
        };
        let positions: Vec<DVec3> = (0..(n + 1) * (n + 1)).map(vertex).collect();
        let triangles = (0..n * n).flat_map(|i| {
            let a = (i / n * (n + 1) + i % n) as u32;
            let [b, c, d] = [a + 1, a + n as u32 + 1, a + n as u32 + 2];
            if (i + seed).is_multiple_of(2) { [[a, b, d], [a, d, c]] } else { [[a, b, c], [b, d, c]] }
        });
        Mesh { positions: Column3::from_f64(&positions), triangles: triangles.collect(), ..Mesh::default() }
    }

    fn stored(mesh: Mesh) -> StoredMesh {
        let mesh = Arc::new(mesh);
        let geometry = Geometry::Mesh(mesh.clone());
        let object = Object { geometry, world_from_object: DAffine3::IDENTITY, material: Material::default() };
        StoredMesh::new(&object, &mesh, &mut Default::default())
    }

    fn projected(instructions: Instructions, meshes: &[StoredMesh], view: &View, grid: &Grid) -> Vec<TriangleSegment> {
        let parts: Vec<MeshPart> = mesh_parts(meshes, &[], view).map(|(part, _)| part).collect();
        project(instructions, meshes, &parts, view, grid, Cull::None)
    }

    /// Counts the triangles that cover each pixel at any depth, according to the tiles' lists.
    fn coverage(mesh: Mesh, tile_blocks: u32) -> Vec<u32> {
        let (view, meshes) = (view(), [stored(mesh)]);
        let grid = Grid::new(view.region, tile_blocks);
        let mut counts = vec![0; (SIZE * SIZE) as usize];
        let instructions = Instructions::new(SimdLevel::Best).unwrap();
        for segment in projected(instructions, &meshes, &view, &grid) {
            for tile in 0..grid.tiles() {
                for entry in segment.lists.of(tile) {
                    for block in (0..64u32).filter(|block| entry.blocks >> block & 1 != 0) {
                        let px = |tile: u32, block: u32| (tile * grid.tile_px() + block * 4) as i32;
                        let at = (px(tile as u32 % grid.columns, block % 8), px(tile as u32 / grid.columns, block / 8));
                        let list = [&segment.triangles[entry.record as usize]];
                        let z = with_instructions!(instructions, simd =>
                            nearest(simd, &list, at, [0.1, f32::MAX]).z.to_array());
                        for (lane, z) in z.into_iter().enumerate().filter(|(_, z)| z.is_finite()) {
                            assert!(z > 0.0);
                            let (x, y) = pixel_of(at, lane);
                            counts[(y as u32 * SIZE + x as u32) as usize] += 1;
                        }
                    }
                }
            }
        }
        counts
    }

    #[test]
    fn polygons_of_a_closed_sheet_cover_every_pixel_once() {
        for (seed, n) in [(1, 3), (2, 8), (3, 21), (4, 100)] {
            for tile_blocks in [2, 8] {
                let counts = coverage(crumpled(n, seed), tile_blocks);
                let wrong = counts.iter().filter(|count| **count != 1).count();
                assert_eq!(wrong, 0, "{n}×{n}, tiles of {tile_blocks} blocks");
            }
        }
    }

    #[test]
    fn polygon_edges_through_pixel_centres_belong_to_one_side() {
        // The sides and the diagonal of the quad run through pixel centres: x = ±1 and y = ±1 at depth 2 are pixels 16
        // and 48 at this focal length.
        let quad = |shift: f64| {
            let at = |x: f64, y: f64| DVec3::new(x + shift, y + shift, 1.0);
            let positions = Column3::from_f64(&[at(-0.25, -0.25), at(0.25, -0.25), at(0.25, 0.25), at(-0.25, 0.25)]);
            Mesh { positions, triangles: vec![[0, 1, 2], [0, 2, 3]], ..Mesh::default() }
        };
        let mut view = view();
        // A pixel is 1/16 at depth 2: all numbers are exact.
        view.projection.focal_px = [32.0; 2];
        let half_pixel = 1.0 / 32.0;
        for shift in [0.0, half_pixel] {
            let meshes = [stored(quad(shift))];
            let grid = Grid::new(view.region, 8);
            let instructions = Instructions::new(SimdLevel::Best).unwrap();
            let segments = projected(instructions, &meshes, &view, &grid);
            let list: Vec<&ScreenTriangle> = segments.iter().flat_map(|s| &s.triangles).collect();
            let mut counts = [0, 0];
            for y in (0..SIZE as i32).step_by(4) {
                for x in (0..SIZE as i32).step_by(4) {
                    for one in &list {
                        with_instructions!(instructions, simd => {
                            let z = nearest(simd, &[one], (x, y), [0.1, f32::MAX]).z.to_array();
                            counts[0] += z.iter().filter(|z| z.is_finite()).count();
                        });
                    }
                    with_instructions!(instructions, simd => {
                        let z = nearest(simd, &list, (x, y), [0.1, f32::MAX]).z.to_array();
                        counts[1] += z.iter().filter(|z| z.is_finite()).count();
                    });
                }
            }
            // 8×8 pixels, each covered once, wherever the edges run.
            assert_eq!(counts, [64, 64], "shifted by {shift}");
        }
    }
}

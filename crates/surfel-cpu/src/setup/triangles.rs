//! Projection of triangles to the screen, sorted into tiles (rendering model §6).
//!
//! A *block* is 4×4 pixels ([`BLOCK`]). A *tile* is a square of blocks ([`Grid`](crate::tiles::grid::Grid)).

use crate::cull::chunks::MeshPart;
use crate::scene::mesh::StoredMesh;
use crate::simd::level::{Instructions, with_instructions};
use crate::tiles::bins::{Entries, Entry, Kind, TileLists};
use crate::tiles::drawn::DrawnBlocks;
use crate::tiles::grid::{BLOCK, Grid, TILE_BLOCKS};
use fearless_simd::Simd;
use glam::{DMat3, DVec3};
use surfel_math::bounds::Extent;
use surfel_math::mapping::Linear;
use surfel_math::triangle::{self, Triangle};
use surfel_math::{V2, V3};
use surfel_model::Cull;
use surfel_render::View;

/// Amount by which a triangle's box of pixels is widened on every side, in pixels. It is far above the rounding of its
/// corners, and too small to cost time.
const BOX_SLACK_PX: f64 = 1e-3;

/// A triangle projected to the screen.
pub(crate) struct ScreenTriangle {
    /// Index of the mesh in the scene's list of meshes.
    pub mesh: u32,
    /// Index of the triangle in the mesh.
    pub index: u32,
    /// Edges of the triangle as linear forms over pixels, and the depths of its vertices. The forms are relative to the
    /// image's corner, so that adjacent triangles test a shared edge by the same number.
    ///
    /// Edges are multiplied by a power of two that makes their gradients about 1. This rounds nothing, so adjacent
    /// triangles still agree.
    pub triangle: Triangle<f64>,
    /// Σ E: the sum of the three edges' forms E, by which interpolated attributes are divided.
    pub weight: Linear<f64>,
    /// Σ E·z: the sum of the edges' forms E times the depths z of the opposite vertices. A pixel's depth is this form
    /// divided by `weight`.
    pub depth: Linear<f64>,
    /// Lower bound of the depth of the triangle's fragments, in world units.
    pub z_min: f32,
    /// True if the triangle's material is two-sided and its outward side faces away from the eye. Always false for
    /// other materials, because nothing depends on it.
    pub back_facing: bool,
}

/// Projected triangles of some parts of one mesh, in the mesh's order, with each tile's list of the triangles that
/// touch it.
pub(crate) struct TriangleSegment {
    pub triangles: Vec<ScreenTriangle>,
    pub lists: TileLists,
}

impl TriangleSegment {
    /// Returns the heap memory that triangles and lists use, in bytes.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(self.triangles.as_slice()) + self.lists.bytes()
    }
}

/// Projects the triangles of the mesh parts `parts` that may touch the grid's region, in scene order. [`Cull::None`]
/// disables back-face culling, overriding the materials.
pub(crate) fn project(
    instructions: Instructions,
    meshes: &[StoredMesh],
    parts: &[MeshPart],
    view: &View,
    grid: &Grid,
    cull: Cull,
) -> Vec<TriangleSegment> {
    project_some(instructions, meshes, parts, view, grid, cull, DrawnBlocks::default())
}

/// Projects, as [`project`] does, only the triangles that touch the blocks in `drawn`.
pub(crate) fn project_some(
    instructions: Instructions,
    meshes: &[StoredMesh],
    parts: &[MeshPart],
    view: &View,
    grid: &Grid,
    cull: Cull,
    drawn: DrawnBlocks<'_>,
) -> Vec<TriangleSegment> {
    let mut segments = Vec::new();
    for of_mesh in parts.chunk_by(|a, b| a.mesh == b.mesh) {
        let index = of_mesh[0].mesh;
        let mesh = &meshes[index as usize];
        // Among equally near triangles the first is shown, so they are sorted to the mesh's order.
        let mut triangles: Vec<u32> = of_mesh.iter().flat_map(|part| mesh.part(part.part)).copied().collect();
        triangles.sort_unstable();
        let projector = Projector::new(mesh, index, view, cull, drawn);
        // Formulas in f64 don't use lanes, but the CPU's fused multiply-add.
        segments.push(with_instructions!(instructions, simd =>
            simd.vectorize(#[inline(always)] || projector.all(&triangles, grid))));
    }
    segments
}

/// A mesh in a view: the data that the projection of all its triangles shares.
struct Projector<'a> {
    mesh: &'a StoredMesh,
    /// Index of the mesh in the scene's list of meshes.
    index: u32,
    view: &'a View,
    cull: Cull,
    drawn: DrawnBlocks<'a>,
    linear: DMat3,
    /// View position of the mesh's origin.
    origin: DVec3,
}

impl<'a> Projector<'a> {
    fn new(mesh: &'a StoredMesh, index: u32, view: &'a View, cull: Cull, drawn: DrawnBlocks<'a>) -> Self {
        let (linear, origin) = mesh.in_view(view);
        let cull = if cull == Cull::None { cull } else { mesh.material.cull };
        Self { mesh, index, view, cull, drawn, linear, origin }
    }

    /// Projects the triangles with these indices and sorts them into tiles.
    #[inline(always)]
    fn all(&self, indices: &[u32], grid: &Grid) -> TriangleSegment {
        let (mut triangles, mut entries) = (Vec::new(), Entries::default());
        for &index in indices {
            if let Some((triangle, extent)) = self.project(index as usize) {
                let before = entries.len();
                for_tiles(&triangle, &extent, triangles.len() as u32, (grid, self.drawn), &mut entries);
                if entries.len() > before {
                    triangles.push(triangle);
                }
            }
        }
        let mut lists = TileLists::default();
        lists.sort(&mut entries, grid);
        TriangleSegment { triangles, lists }
    }

    #[inline(always)]
    fn project(&self, k: usize) -> Option<(ScreenTriangle, Extent<f64>)> {
        let mut corners = [DVec3::ZERO; 3];
        for (corner, i) in corners.iter_mut().zip(self.mesh.mesh.triangles[k]) {
            *corner = self.origin + self.linear * self.mesh.mesh.positions.get(i as usize);
        }
        let projection = &self.view.projection;
        if corners.iter().all(|p| p.z < projection.near) || corners.iter().all(|p| p.z > projection.far()) {
            return None;
        }
        // Facing is computed only if it matters.
        let back_facing = (self.cull == Cull::Back || self.mesh.material.two_sided) && {
            let normal = self.view.view_from_world * self.mesh.flat_normal(k);
            let facing = if projection.is_perspective() { normal.dot(corners[0]) } else { normal.z };
            facing >= 0.0
        };
        if self.cull == Cull::Back && back_facing {
            return None;
        }
        let z_min = corners.iter().map(|p| p.z).fold(f64::INFINITY, f64::min).max(projection.near);
        let corners = corners.map(V3::from);
        let extent = triangle::bounds(corners, projection)?;
        let triangle = scaled(Triangle::new(corners, V2::new(0.0, 0.0), projection))?;
        let [a, b, c] = triangle.edges;
        let weight = Linear { c: a.c + b.c + c.c, x: a.x + b.x + c.x, y: a.y + b.y + c.y };
        let sum = |v: [f64; 3]| triangle::interpolate(v, triangle.z);
        let depth = Linear { c: sum([a.c, b.c, c.c]), x: sum([a.x, b.x, c.x]), y: sum([a.y, b.y, c.y]) };
        // Reduced by several roundings of f32.
        let z_min = (z_min * (1.0 - 1e-6)) as f32;
        let (mesh, index) = (self.index, k as u32);
        Some((ScreenTriangle { mesh, index, triangle, weight, depth, z_min, back_facing }, extent))
    }
}

/// Multiplies the edges' forms by a power of two so that their largest gradient is between 1 and 2. `None` if all
/// gradients are zero or one isn't finite.
#[inline(always)]
fn scaled(mut t: Triangle<f64>) -> Option<Triangle<f64>> {
    let largest = t.edges.iter().fold(0.0f64, |m, e| m.max(e.x.abs()).max(e.y.abs()));
    let exponent = (largest.to_bits() >> 52) as i64;
    let finite = t.edges.iter().all(|e| e.x.is_finite() && e.y.is_finite() && e.c.is_finite());
    // 2^−e has the biased exponent 2046 − exponent.
    let scale = f64::from_bits(u64::try_from(2046 - exponent).ok()? << 52);
    if exponent == 0 || !scale.is_normal() || !finite {
        return None;
    }
    for e in &mut t.edges {
        (e.c, e.x, e.y) = (e.c * scale, e.x * scale, e.y * scale);
    }
    Some(t)
}

/// Adds an entry for every tile whose pixels a triangle may cover. `extent` is the triangle's box of pixels.
#[inline(always)]
fn for_tiles(
    t: &ScreenTriangle,
    extent: &Extent<f64>,
    index: u32,
    (grid, drawn): (&Grid, DrawnBlocks<'_>),
    entries: &mut Entries,
) {
    let r = grid.region;
    let Some([x0, x1]) = blocks(extent.min.x, extent.max.x, [r.x, r.width], grid.origin[0]) else { return };
    let Some([y0, y1]) = blocks(extent.min.y, extent.max.y, [r.y, r.height], grid.origin[1]) else { return };
    let size = grid.tile_blocks;
    // A triangle whose box has few blocks is listed in all of them.
    let small = x1 - x0 < 2 && y1 - y0 < 2;
    for row in y0 / size..=y1 / size {
        for column in x0 / size..=x1 / size {
            let first = [column * size, row * size];
            let mut bits = 0u64;
            let wanted = drawn.of(row * grid.columns + column);
            if wanted == 0 {
                continue;
            }
            for y in y0.max(first[1])..=y1.min(first[1] + size - 1) {
                for x in x0.max(first[0])..=x1.min(first[0] + size - 1) {
                    let [cx, cy] = [grid.origin[0] + x * BLOCK, grid.origin[1] + y * BLOCK];
                    let hit = small || may_cover(t, V2::new(f64::from(cx) + 2.0, f64::from(cy) + 2.0));
                    bits |= u64::from(hit) << (TILE_BLOCKS * (y - first[1]) + x - first[0]);
                }
            }
            bits &= wanted;
            if bits != 0 {
                entries.push(Entry::new(bits, index, row * grid.columns + column, Kind::Any));
            }
        }
    }
}

/// Returns the first and last block that has pixel centres between the coordinates `min` and `max` along one axis. Only
/// the `length` pixels from `start` on count. Blocks are numbered from the grid's `origin`. `None` if there is no such
/// pixel.
fn blocks(min: f64, max: f64, [start, length]: [u32; 2], origin: u32) -> Option<[u32; 2]> {
    let (low, high) = (f64::from(start), f64::from(start + length));
    // Saturating casts: a box that isn't finite is clipped to the region.
    let first = (min - 0.5 - BOX_SLACK_PX).ceil().clamp(low, high) as u32;
    let end = ((max - 0.5 + BOX_SLACK_PX).floor() + 1.0).clamp(low, high) as u32;
    (first < end).then(|| [(first - origin) / BLOCK, (end - 1 - origin) / BLOCK])
}

/// True if a triangle may cover a pixel of the block with this centre, that is, if no edge excludes all of them.
#[inline(always)]
fn may_cover(t: &ScreenTriangle, center: V2<f64>) -> bool {
    let [a, b, c] = &t.triangle.edges;
    reaches(a, center) && reaches(b, center) && reaches(c, center)
}

/// True if the inner side of a triangle's edge contains a pixel centre of the block with this centre.
#[inline(always)]
fn reaches(edge: &Linear<f64>, center: V2<f64>) -> bool {
    // Pixel centres are at most 1.5 from the block's centre.
    edge.at(center) + (1.5 + BOX_SLACK_PX) * (edge.x.abs() + edge.y.abs()) >= 0.0
}

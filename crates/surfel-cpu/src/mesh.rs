//! Meshes: how they are kept, and their triangles on the screen, sorted into tiles (§6).

use crate::bins::{BLOCK, Entries, Entry, Grid, Kind, TILE_BLOCKS, TileLists};
use crate::level::{Instructions, with_instructions};
use crate::placed::pixels_of_box;
use fearless_simd::Simd;
use glam::{DAffine3, DMat3, DVec3};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;
use surfel_math::basis::{normal_matrix, unit};
use surfel_math::bounds::Extent;
use surfel_math::mapping::Linear;
use surfel_math::triangle::{self, Triangle};
use surfel_math::{V2, V3};
use surfel_model::{Cull, Material, Mesh, Mipmaps, Object};
use surfel_render::{Region, View};

/// Triangles that one task projects and bins.
const TRIANGLES_PER_TASK: usize = 16 * 1024;

/// Pixels by which a box is grown: far above the rounding of its corners, and below what costs time.
const BOX_SLACK_PX: f64 = 1e-3;

/// One object of polygons.
pub(crate) struct StoredMesh {
    pub mesh: Arc<Mesh>,
    pub world_from_object: DAffine3,
    pub material: Material,
    /// The mesh's texture and its smaller levels.
    pub mipmaps: Option<Arc<Mipmaps>>,
    /// Object to world normals, up to scale.
    pub normals: DMat3,
    /// Balls that hold so many triangles each, in their order.
    balls: Vec<Ball>,
}

/// Triangles of a ball: enough that looking at it costs nothing, and few enough to lie close together where a mesh's triangles
/// that follow each other do.
const TRIANGLES_PER_BALL: usize = 256;

/// A ball about some triangles.
struct Ball {
    /// In the object, about the mesh's origin.
    center: DVec3,
    radius: f64,
}

impl Ball {
    fn about(mesh: &Mesh, triangles: &[[u32; 3]]) -> Self {
        let corners = || triangles.as_flattened().iter().map(|&i| mesh.positions.get(i as usize));
        let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for p in corners() {
            (min, max) = (min.min(p), max.max(p));
        }
        let center = 0.5 * (min + max);
        Self { center, radius: corners().map(|p| p.distance(center)).fold(0.0, f64::max) }
    }
}

impl StoredMesh {
    /// A mesh as it is drawn; smaller levels of a texture that another object has are shared.
    pub(crate) fn new(object: &Object, mesh: &Arc<Mesh>, others: &[Self]) -> Self {
        Self {
            mesh: mesh.clone(),
            world_from_object: object.world_from_object,
            material: object.material,
            mipmaps: Mipmaps::of_mesh(mesh, others.iter().filter_map(|other| other.mipmaps.as_ref())),
            normals: normal_matrix(&object.world_from_object.matrix3),
            balls: mesh.triangles.par_chunks(TRIANGLES_PER_BALL).map(|t| Ball::about(mesh, t)).collect(),
        }
    }

    /// Number of triangles.
    pub(crate) fn triangles(&self) -> usize {
        self.mesh.triangles.len()
    }

    /// Ranges of triangles of which some may lie in a view's depth, with the pixels that they may touch: least x and y, greatest
    /// x and y.
    pub(crate) fn seen<'a>(&'a self, view: &'a View) -> impl Iterator<Item = ([f64; 4], Range<usize>)> + 'a {
        let (linear, origin) = self.placed(view);
        // The Frobenius norm bounds the largest singular value; the slack is far above rounding.
        let stretch = linear.to_cols_array().iter().map(|x| x * x).sum::<f64>().sqrt() * (1.0 + 1e-9);
        let projection = &view.projection;
        self.balls.iter().enumerate().filter_map(move |(i, ball)| {
            let (center, radius) = (origin + linear * ball.center, ball.radius * stretch);
            let is_seen = center.z + radius >= projection.near && center.z - radius <= projection.far();
            let first = i * TRIANGLES_PER_BALL;
            let range = first..(first + TRIANGLES_PER_BALL).min(self.triangles());
            is_seen.then(|| (pixels_of_box(projection, center, DVec3::splat(radius), 1.0), range))
        })
    }

    /// Object to view directions, and view position of the mesh's origin.
    fn placed(&self, view: &View) -> (DMat3, DVec3) {
        // Subtracting the eye before anything is rotated keeps scenes far from the origin exact.
        let origin = self.world_from_object.transform_point3(self.mesh.origin) - view.eye;
        (view.view_from_world * self.world_from_object.matrix3, view.view_from_world * origin)
    }

    /// Unit world normal of a triangle's own plane: the side from which its corners run counter-clockwise.
    pub(crate) fn flat_normal(&self, triangle: usize) -> DVec3 {
        let [a, b, c] = self.mesh.triangles[triangle].map(|i| self.mesh.positions.get(i as usize));
        unit(self.normals * (b - a).cross(c - a))
    }
}

/// A triangle on the screen.
pub(crate) struct ScreenTriangle {
    /// Index of the mesh, and of the triangle in it.
    pub mesh: u32,
    pub index: u32,
    /// About the origin of all pixels, so that neighbours judge their edge by the same number. Edges are multiplied by a power of
    /// two that makes their gradients about 1: that rounds nothing, so neighbours still agree.
    pub triangle: Triangle<f64>,
    /// Σ E and Σ E·z over the edges' values E: the depth is the second over the first.
    pub weight: Linear<f64>,
    pub depth: Linear<f64>,
    /// No fragment is nearer.
    pub z_min: f32,
    /// Faces away from the eye.
    pub back_facing: bool,
}

/// Some triangles of a mesh, with each tile's list of them in their order.
pub(crate) struct TriangleSegment {
    pub triangles: Vec<ScreenTriangle>,
    pub lists: TileLists,
}

impl TriangleSegment {
    /// Bytes of heap memory in use.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(self.triangles.as_slice()) + self.lists.bytes()
    }
}

/// Projects every triangle that may touch the grid's region, in scene order. Under [`Cull::None`] back faces aren't left out,
/// whatever the material says.
pub(crate) fn project_all(
    instructions: Instructions,
    meshes: &[StoredMesh],
    view: &View,
    grid: &Grid,
    cull: Cull,
) -> Vec<TriangleSegment> {
    let Region { x, y, width, height } = grid.region;
    let [x0, y0, x1, y1] = [x, y, x + width, y + height].map(f64::from);
    let mut tasks: Vec<(usize, Range<usize>)> = Vec::new();
    for (i, mesh) in meshes.iter().enumerate() {
        for ([left, top, right, bottom], triangles) in mesh.seen(view) {
            if right < x0 || left > x1 || bottom < y0 || top > y1 {
                continue;
            }
            match tasks.last_mut() {
                Some((last, range))
                    if *last == i && range.end == triangles.start && range.len() < TRIANGLES_PER_TASK =>
                {
                    range.end = triangles.end;
                }
                _ => tasks.push((i, triangles)),
            }
        }
    }
    let segment = |(i, triangles): &(usize, Range<usize>)| {
        let (i, triangles) = (*i, triangles.clone());
        let mesh = &meshes[i];
        let projector = Projector::new(mesh, i as u32, view, cull);
        // Formulas in f64 need no lanes, but a processor's fused multiply-add.
        with_instructions!(instructions, simd => simd.vectorize(#[inline(always)] || projector.all(triangles, grid)))
    };
    tasks.par_iter().map(segment).collect()
}

/// What is the same for all triangles of a mesh in a view.
struct Projector<'a> {
    mesh: &'a StoredMesh,
    /// Its index.
    index: u32,
    view: &'a View,
    cull: Cull,
    linear: DMat3,
    /// View position of the mesh's origin.
    origin: DVec3,
}

impl<'a> Projector<'a> {
    fn new(mesh: &'a StoredMesh, index: u32, view: &'a View, cull: Cull) -> Self {
        let (linear, origin) = mesh.placed(view);
        Self { mesh, index, view, cull: if cull == Cull::None { cull } else { mesh.material.cull }, linear, origin }
    }

    /// Projects and sorts a range of the mesh's triangles.
    #[inline(always)]
    fn all(&self, range: Range<usize>, grid: &Grid) -> TriangleSegment {
        let (mut triangles, mut entries) = (Vec::new(), Entries::default());
        for k in range {
            if let Some((triangle, extent)) = self.project(k) {
                let before = entries.len();
                for_tiles(&triangle, &extent, triangles.len() as u32, grid, &mut entries);
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
        // Its side is looked at only where something hangs on it.
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
        // Several roundings of f32 nearer.
        let z_min = (z_min * (1.0 - 1e-6)) as f32;
        let (mesh, index) = (self.index, k as u32);
        Some((ScreenTriangle { mesh, index, triangle, weight, depth, z_min, back_facing }, extent))
    }
}

/// The same triangle with edges whose largest gradient is between 1 and 2; `None` where none has any, or is finite.
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

/// Adds an entry for every tile whose pixels a triangle may cover.
#[inline(always)]
fn for_tiles(t: &ScreenTriangle, extent: &Extent<f64>, index: u32, grid: &Grid, entries: &mut Entries) {
    let r = grid.region;
    let Some([x0, x1]) = blocks(extent.min.x, extent.max.x, [r.x, r.width], grid.origin[0]) else { return };
    let Some([y0, y1]) = blocks(extent.min.y, extent.max.y, [r.y, r.height], grid.origin[1]) else { return };
    let size = grid.tile_blocks;
    // Of few blocks all count.
    let small = x1 - x0 < 2 && y1 - y0 < 2;
    for row in y0 / size..=y1 / size {
        for column in x0 / size..=x1 / size {
            let first = [column * size, row * size];
            let mut bits = 0u64;
            for y in y0.max(first[1])..=y1.min(first[1] + size - 1) {
                for x in x0.max(first[0])..=x1.min(first[0] + size - 1) {
                    let [cx, cy] = [grid.origin[0] + x * BLOCK, grid.origin[1] + y * BLOCK];
                    let hit = small || may_cover(t, V2::new(f64::from(cx) + 2.0, f64::from(cy) + 2.0));
                    bits |= u64::from(hit) << (TILE_BLOCKS * (y - first[1]) + x - first[0]);
                }
            }
            if bits != 0 {
                entries.push(Entry::new(bits, index, row * grid.columns + column, Kind::Any));
            }
        }
    }
}

/// First and last block, from the grid's origin, of the pixels of a range whose centres lie between two coordinates.
fn blocks(min: f64, max: f64, [start, length]: [u32; 2], origin: u32) -> Option<[u32; 2]> {
    let (low, high) = (f64::from(start), f64::from(start + length));
    // Saturating casts: a box that isn't finite is cut to the region.
    let first = (min - 0.5 - BOX_SLACK_PX).ceil().clamp(low, high) as u32;
    let end = ((max - 0.5 + BOX_SLACK_PX).floor() + 1.0).clamp(low, high) as u32;
    (first < end).then(|| [(first - origin) / BLOCK, (end - 1 - origin) / BLOCK])
}

/// False if an edge shows that no pixel of the block with this centre is covered.
#[inline(always)]
fn may_cover(t: &ScreenTriangle, center: V2<f64>) -> bool {
    let [a, b, c] = &t.triangle.edges;
    reaches(a, center) && reaches(b, center) && reaches(c, center)
}

/// True if an edge's inner side reaches the block with this centre.
#[inline(always)]
fn reaches(edge: &Linear<f64>, center: V2<f64>) -> bool {
    // Pixel centres are at most 1.5 from the block's.
    edge.at(center) + (1.5 + BOX_SLACK_PX) * (edge.x.abs() + edge.y.abs()) >= 0.0
}

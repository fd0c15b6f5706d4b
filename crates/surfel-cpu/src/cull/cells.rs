//! Division of a view into cells, the parts of an image that one thread sets up and draws alone. A cell's records
//! (projected splats) fit the thread's cache.
//!
//! A record is written once and read once or twice. If all splats were set up before any is drawn, the records of a
//! million splats would no longer be in the caches. Waiting for memory would then cost a third of a frame.
//!
//! A *tile* is a square of 8 to 32 pixels a side ([`Grid`](crate::tiles::grid::Grid)).

use crate::cull::balls::{BallPart, BallView, ball_parts};
use crate::cull::chunks::{MeshPart, VisibleChunk, mesh_parts};
use crate::cull::object::{ObjectView, inside};
use crate::scene::mesh::StoredMesh;
use crate::tiles::grid::Grid;
use surfel_render::{Region, SelectedParts, View};

/// A cell of a view: a rectangle of whole tiles, clipped to the frame's region, that one thread sets up and draws
/// alone.
pub(crate) struct Cell {
    pub region: Region,
    /// Chunks that may touch the cell, from near to far.
    pub chunks: Vec<VisibleChunk>,
    /// Number of chunks, the nearest ones, that are set up before the others are tested for occlusion. All chunks, if
    /// the test would cost more than it saves.
    pub first: usize,
    /// Parts of meshes that may touch the cell.
    pub mesh_parts: Vec<MeshPart>,
    /// Chunks of balls that may touch the cell, from near to far.
    pub ball_parts: Vec<BallPart>,
    /// Estimated time to draw the cell, as a number of splats that take as long.
    cost: f64,
}

/// Estimated time to draw a covered pixel, relative to the time to draw a splat.
const SPLATS_PER_PIXEL: f64 = 0.3;

/// Smallest number of cells per thread that the division aims at, so that no thread waits long for the last cell. A
/// single thread divides a frame only if the frame has more splats and triangles than [`CellLimits::splats`].
const CELLS_PER_THREAD: usize = 8;

/// Approximate number of tiles per cell if screen-space passes need a G-buffer of the cell. At 16 KiB per tile, the
/// G-buffer should about fit a thread's cache.
const TILES_OF_GBUFFER: usize = 128;

/// Average number of splats over each pixel of a cell that are set up before the remaining splats are tested for
/// occlusion. They are about three surfaces, of three or four splats each.
const LAYERS: f64 = 10.0;

/// Smallest fraction of a cell's splats that must be behind the splats that are set up first ([`LAYERS`]) for occlusion
/// culling to pay.
const MIN_HIDDEN_FRACTION: f64 = 0.3;

/// Smallest number of splats in a cell for which occlusion is tested, as a fraction of [`CellLimits::splats`]. Drawing
/// fewer splats takes no longer than finding what they occlude.
const MIN_LOAD_FRACTION: f64 = 0.5;

/// A chunk of splats, a part of a mesh or a chunk of balls, which is assigned to the cells that it may touch.
#[derive(Clone, Copy)]
enum Part {
    Chunk(VisibleChunk),
    Mesh(MeshPart),
    Balls(BallPart),
}

/// A chunk of splats or balls, or a part of a mesh, with the estimates by which a view is divided into cells.
#[derive(Clone, Copy)]
struct PartInView {
    part: Part,
    /// Number of splats, triangles or balls in the part; all cost about the same time.
    splats: f64,
    /// Memory of the part's records (projected splats) and of their entries in tiles' lists. The unit is the memory of
    /// a record with one entry.
    load: f64,
    /// Total area of the part's splats, in square pixels, as if all faced the eye. 0 for triangles and balls, for
    /// clouds with transparent splats, and for chunks around the eye.
    area_px: f64,
    /// Nearest and farthest planar depth of the part, in world units; 0 for parts of meshes, where they aren't needed.
    depths: [f64; 2],
    /// Bounds of the pixels that the part may touch, clipped to the frame's region: minimum x and y, maximum x and y.
    pixels: [f64; 4],
}

impl PartInView {
    /// Returns the estimated fraction of the part's splats that are on these pixels (minimum x and y, maximum x and y).
    fn share(&self, pixels: &[f64; 4]) -> f64 {
        let side = |axis: usize| {
            let length = self.pixels[axis + 2] - self.pixels[axis];
            let common = self.pixels[axis + 2].min(pixels[axis + 2]) - self.pixels[axis].max(pixels[axis]);
            if length > 0.0 { (common / length).clamp(0.0, 1.0) } else { 1.0 }
        };
        side(0) * side(1)
    }

    /// True if the part may touch these pixels (minimum x and y, maximum x and y), or a margin of `reach` pixels around
    /// them.
    fn touches(&self, pixels: &[f64; 4], reach: f64) -> bool {
        (0..2)
            .all(|axis| self.pixels[axis] <= pixels[axis + 2] + reach && self.pixels[axis + 2] >= pixels[axis] - reach)
    }
}

/// Limits on the size of cells ([`Cell`]), from the caller of [`divide`].
#[derive(Clone, Copy)]
pub(crate) struct CellLimits {
    /// Largest number of splats and triangles in a cell; splats that cover many tiles count for more. At 140 bytes each
    /// they should about fit a thread's cache.
    pub splats: usize,
    /// Width of the margin around a cell, in pixels, whose pixels the screen-space passes read for the cell's own
    /// pixels.
    pub reach_px: u32,
    /// Number of threads that draw the frame.
    pub threads: usize,
}

/// Content of a view in addition to chunks of splats.
#[derive(Clone, Copy)]
pub(crate) struct OtherParts<'a> {
    pub meshes: &'a [StoredMesh],
    pub octrees: &'a [SelectedParts],
    pub balls: &'a [BallView<'a>],
}

/// Divides the grid's region into cells and assigns the view's content to them. Cells obey the limits as far as whole
/// tiles allow, and are sorted by cost, the largest first.
pub(crate) fn divide(
    objects: &[ObjectView<'_>],
    chunks: &[VisibleChunk],
    OtherParts { meshes, octrees, balls }: OtherParts<'_>,
    view: &View,
    grid: &Grid,
    limits: &CellLimits,
) -> Vec<Cell> {
    let of_chunk = |visible: &VisibleChunk| {
        let (object, chunk) = visible.of(objects);
        let center = object.center(chunk);
        let around = object.pixels(center, chunk);
        let pixels = inside(around, grid.region);
        // Splats around the eye may occlude anything or nothing, and transparent splats occlude nothing.
        let area_px =
            if around[0].is_finite() && !object.is_transparent() { object.area_px(center, chunk) } else { 0.0 };
        let load = object.load(center, chunk, pixels, grid.tile_px());
        let (part, splats) = (Part::Chunk(*visible), chunk.count as f64);
        PartInView { part, splats, load, area_px, depths: object.depths(center, chunk), pixels }
    };
    let of_mesh = |(part, pixels): (MeshPart, [f64; 4])| {
        let triangles = meshes[part.mesh as usize].part(part.part).len() as f64;
        let (part, pixels) = (Part::Mesh(part), inside(pixels, grid.region));
        PartInView { part, splats: triangles, load: triangles, area_px: 0.0, depths: [0.0; 2], pixels }
    };
    let seen = |p: &PartInView| p.pixels[0] <= p.pixels[2] && p.pixels[1] <= p.pixels[3];
    let mesh_parts = mesh_parts(meshes, octrees, view).map(of_mesh).filter(seen);
    let of_balls = |(part, pixels, depths, count): (BallPart, [f64; 4], [f64; 2], usize)| {
        let (part, splats, pixels) = (Part::Balls(part), count as f64, inside(pixels, grid.region));
        PartInView { part, splats, load: splats, area_px: 0.0, depths, pixels }
    };
    let mut ball_parts: Vec<PartInView> = ball_parts(balls).map(of_balls).filter(seen).collect();
    ball_parts.sort_by(|a, b| a.depths[0].total_cmp(&b.depths[0]));
    let parts: Vec<PartInView> = chunks.iter().map(of_chunk).chain(mesh_parts).chain(ball_parts).collect();
    let pixels = f64::from(grid.region.width) * f64::from(grid.region.height);
    let total = parts.iter().map(|p| p.splats).sum::<f64>() + pixels * SPLATS_PER_PIXEL;
    // A single thread shares no work, and divides a view only if the view exceeds its cache.
    let is_shared = limits.threads > 1 || parts.iter().map(|p| p.splats).sum::<f64>() > limits.splats as f64;
    let mut cells_wanted = if is_shared { limits.threads * CELLS_PER_THREAD } else { 1 };
    if limits.reach_px > 0 {
        cells_wanted = cells_wanted.max(grid.tiles() / TILES_OF_GBUFFER);
    }
    let cost = total / cells_wanted as f64;
    let limits = Limits { load: limits.splats.max(1) as f64, cost, reach: f64::from(limits.reach_px) };
    let mut cells = Vec::new();
    limits.split(grid, [0, grid.columns, 0, grid.rows], &parts, &mut cells);
    cells.sort_by(|a, b| b.cost.total_cmp(&a.cost));
    cells
}

/// Largest load and cost of a cell. A cell that exceeds neither, or has only one tile, isn't divided further.
struct Limits {
    /// Largest memory of a cell's records (projected splats) and of their entries in tiles' lists. The unit is the
    /// memory of a record with one entry.
    load: f64,
    /// Largest estimated time to draw a cell, as a number of splats that take as long.
    cost: f64,
    /// Width of the margin around a cell, in pixels, whose pixels the screen-space passes read for the cell's own
    /// pixels.
    reach: f64,
}

impl Limits {
    fn split(&self, grid: &Grid, tiles: [u32; 4], parts: &[PartInView], cells: &mut Vec<Cell>) {
        let pixels = bounds(grid, tiles);
        let sum = |[splats, load]: [f64; 2], p: &PartInView| {
            let share = p.share(&pixels);
            [splats + p.splats * share, load + p.load * share]
        };
        let [splats, load] = parts.iter().fold([0.0; 2], sum);
        let area = (pixels[2] - pixels[0]) * (pixels[3] - pixels[1]);
        let cost = splats + if parts.is_empty() { 0.0 } else { area * SPLATS_PER_PIXEL };
        let [x0, x1, y0, y1] = tiles;
        let small = x1 - x0 <= 1 && y1 - y0 <= 1;
        if small || (load <= self.load && cost <= self.cost) {
            let (mut chunks, mut mesh_parts, mut ball_parts) = (Vec::new(), Vec::new(), Vec::new());
            for in_view in parts {
                match in_view.part {
                    Part::Chunk(chunk) => chunks.push(chunk),
                    Part::Mesh(part) => mesh_parts.push(part),
                    Part::Balls(part) => ball_parts.push(part),
                }
            }
            // Chunks precede meshes in `parts`.
            let first = first(&parts[..chunks.len()], &pixels, self.load);
            cells.push(Cell { region: region(&pixels), chunks, first, mesh_parts, ball_parts, cost });
            return;
        }
        let halves = if x1 - x0 >= y1 - y0 {
            let middle = x0.midpoint(x1);
            [[x0, middle, y0, y1], [middle, x1, y0, y1]]
        } else {
            let middle = y0.midpoint(y1);
            [[x0, x1, y0, middle], [x0, x1, middle, y1]]
        };
        for tiles in halves {
            let pixels = bounds(grid, tiles);
            let inside: Vec<PartInView> = parts.iter().filter(|p| p.touches(&pixels, self.reach)).copied().collect();
            self.split(grid, tiles, &inside, cells);
        }
    }
}

/// Returns the number of a cell's nearest chunks that are set up before occlusion is tested. They have about [`LAYERS`]
/// splats per pixel. Returns the number of all chunks if the test doesn't pay. `chunks` are sorted from near to far.
/// `most` is the largest number of splats in a cell.
fn first(chunks: &[PartInView], pixels: &[f64; 4], most: f64) -> usize {
    let enough = LAYERS * (pixels[2] - pixels[0]) * (pixels[3] - pixels[1]);
    let (mut area, mut farthest) = (0.0, 0.0f64);
    let Some(first) = chunks.iter().position(|chunk| {
        area += chunk.area_px * chunk.share(pixels);
        if area <= enough {
            farthest = farthest.max(chunk.depths[1]);
        }
        area > enough
    }) else {
        return chunks.len();
    };
    let splats = |chunk: &PartInView| chunk.splats * chunk.share(pixels);
    let behind: f64 = chunks[first..].iter().filter(|chunk| chunk.depths[0] > farthest).map(splats).sum();
    let total: f64 = chunks.iter().map(splats).sum();
    if total > MIN_LOAD_FRACTION * most && behind > MIN_HIDDEN_FRACTION * total { first } else { chunks.len() }
}

/// Returns the bounds of the pixels of a rectangle of tiles, clipped to the grid's region: minimum x and y, maximum x
/// and y.
fn bounds(grid: &Grid, [x0, x1, y0, y1]: [u32; 4]) -> [f64; 4] {
    let (r, size) = (grid.region, grid.tile_px());
    let x = |column: u32| (grid.origin[0] + column * size).clamp(r.x, r.x + r.width);
    let y = |row: u32| (grid.origin[1] + row * size).clamp(r.y, r.y + r.height);
    [x(x0), y(y0), x(x1), y(y1)].map(f64::from)
}

fn region([x0, y0, x1, y1]: &[f64; 4]) -> Region {
    Region { x: *x0 as u32, y: *y0 as u32, width: (x1 - x0) as u32, height: (y1 - y0) as u32 }
}

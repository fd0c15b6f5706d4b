//! A view cut into cells: parts that a thread sets up and draws by itself, whose records fit its cache.
//!
//! A record is written once and read once or twice. Set up all together, those of a million splats are gone from the caches
//! before they are drawn, and waiting for memory takes a third of a frame.

use crate::bins::Grid;
use crate::hidden;
use crate::placed::{ObjectSetup, inside};
use crate::prepare::Seen;
use surfel_render::Region;

/// A part of a view: whole tiles, as far as its region goes.
pub(crate) struct Cell {
    pub region: Region,
    /// First and end column, first and end row, in tiles of the view's grid.
    tiles: [u32; 4],
    /// Chunks that may touch it, from near to far.
    pub seen: Vec<Seen>,
    /// How many of them come first, if the others may be hidden; else all.
    pub first: usize,
    /// What it costs, about, in splats.
    cost: f64,
}

impl Cell {
    /// Its tiles, row by row.
    pub(crate) fn tiles<'a>(&'a self, grid: &'a Grid) -> impl Iterator<Item = usize> + 'a {
        let [x0, x1, y0, y1] = self.tiles;
        (y0..y1).flat_map(move |y| (x0..x1).map(move |x| (y * grid.columns + x) as usize))
    }
}

/// What a covered pixel costs, in splats.
const SPLATS_PER_PIXEL: f64 = 0.3;

/// Cells a thread, at least, so that none waits long for the last.
const CELLS_PER_THREAD: usize = 8;

/// A chunk and the pixels that it may touch, as far as there are any: least x and y, greatest x and y.
#[derive(Clone, Copy)]
struct Placed {
    seen: Seen,
    splats: f64,
    /// Memory that they take, in records.
    load: f64,
    /// Areas of its splats together, pixels.
    area_px: f64,
    /// Nearest and farthest depth.
    depths: [f64; 2],
    pixels: [f64; 4],
}

impl Placed {
    /// What it is in some pixels.
    fn part(&self, pixels: &[f64; 4]) -> hidden::Share {
        let share = self.share(pixels);
        hidden::Share { splats: self.splats * share, area_px: self.area_px * share, depths: self.depths }
    }

    /// The share of its splats in some pixels.
    fn share(&self, pixels: &[f64; 4]) -> f64 {
        let side = |axis: usize| {
            let length = self.pixels[axis + 2] - self.pixels[axis];
            let common = self.pixels[axis + 2].min(pixels[axis + 2]) - self.pixels[axis].max(pixels[axis]);
            if length > 0.0 { (common / length).clamp(0.0, 1.0) } else { 1.0 }
        };
        side(0) * side(1)
    }

    /// True if it may touch some pixels, or what lies so far around them.
    fn touches(&self, pixels: &[f64; 4], reach: f64) -> bool {
        (0..2)
            .all(|axis| self.pixels[axis] <= pixels[axis + 2] + reach && self.pixels[axis + 2] >= pixels[axis] - reach)
    }
}

/// Cuts the grid's region into cells of about `most` splats at most, fewer if they have many tiles, the costliest first. What a cell's pixels hang on may lie
/// `reach` pixels beside them.
pub(crate) fn divide(
    setups: &[ObjectSetup<'_>],
    seen: &[Seen],
    grid: &Grid,
    (most, reach): (usize, u32),
    threads: usize,
) -> Vec<Cell> {
    let placed: Vec<Placed> = seen
        .iter()
        .map(|&seen| {
            let setup = &setups[seen.object as usize];
            let chunk = &setup.object.chunks[seen.chunk as usize];
            let center = setup.center(chunk);
            let around = setup.pixels(center, chunk);
            let pixels = inside(around, grid.region);
            // What lies about the eye may hide anything or nothing, and what is transparent hides nothing.
            let area_px =
                if around[0].is_finite() && !setup.is_transparent() { setup.area_px(center, chunk) } else { 0.0 };
            let load = setup.load(center, chunk, pixels, grid.tile_px());
            Placed { seen, splats: chunk.count as f64, load, area_px, depths: setup.depths(center, chunk), pixels }
        })
        .collect();
    let pixels = f64::from(grid.region.width) * f64::from(grid.region.height);
    let total = placed.iter().map(|p| p.splats).sum::<f64>() + pixels * SPLATS_PER_PIXEL;
    let cost = total / (threads * CELLS_PER_THREAD) as f64;
    let limits = Limits { load: most as f64, cost, reach: f64::from(reach) };
    let mut cells = Vec::new();
    limits.split(grid, [0, grid.columns, 0, grid.rows], &placed, &mut cells);
    cells.sort_by(|a, b| b.cost.total_cmp(&a.cost));
    cells
}

/// Where cells are cut no further.
struct Limits {
    /// In records.
    load: f64,
    cost: f64,
    /// Pixels around a cell that it hangs on.
    reach: f64,
}

impl Limits {
    fn split(&self, grid: &Grid, tiles: [u32; 4], placed: &[Placed], cells: &mut Vec<Cell>) {
        let pixels = bounds(grid, tiles);
        let sum = |[splats, load]: [f64; 2], p: &Placed| {
            let share = p.share(&pixels);
            [splats + p.splats * share, load + p.load * share]
        };
        let [splats, load] = placed.iter().fold([0.0; 2], sum);
        let area = (pixels[2] - pixels[0]) * (pixels[3] - pixels[1]);
        let cost = splats + if placed.is_empty() { 0.0 } else { area * SPLATS_PER_PIXEL };
        let [x0, x1, y0, y1] = tiles;
        let small = x1 - x0 <= 1 && y1 - y0 <= 1;
        if small || (load <= self.load && cost <= self.cost) {
            let seen = placed.iter().map(|p| p.seen).collect();
            let first = hidden::first(placed.iter().map(|p| p.part(&pixels)), area, self.load);
            cells.push(Cell { region: region(&pixels), tiles, seen, first, cost });
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
            let inside: Vec<Placed> = placed.iter().filter(|p| p.touches(&pixels, self.reach)).copied().collect();
            self.split(grid, tiles, &inside, cells);
        }
    }
}

/// Pixels of some tiles inside the grid's region: least x and y, greatest x and y.
fn bounds(grid: &Grid, [x0, x1, y0, y1]: [u32; 4]) -> [f64; 4] {
    let (r, size) = (grid.region, grid.tile_px());
    let x = |column: u32| (grid.origin[0] + column * size).clamp(r.x, r.x + r.width);
    let y = |row: u32| (grid.origin[1] + row * size).clamp(r.y, r.y + r.height);
    [x(x0), y(y0), x(x1), y(y1)].map(f64::from)
}

fn region([x0, y0, x1, y1]: &[f64; 4]) -> Region {
    Region { x: *x0 as u32, y: *y0 as u32, width: (x1 - x0) as u32, height: (y1 - y0) as u32 }
}

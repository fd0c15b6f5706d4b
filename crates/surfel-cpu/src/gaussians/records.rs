//! From clouds of Gaussians to lists of records by tile, front to back.

use crate::gaussians::grid::{TILE_PX, TileGrid};
use crate::scene::resident::StoredGaussians;
use rayon::prelude::*;
use std::ops::Range;
use surfel_math::gaussian::{self, GaussianForms};
use surfel_math::{V2, V3};
use surfel_model::Sort;
use surfel_render::{FramePlan, GaussianView, Region, View};

/// Gaussians of a part: enough to amortise its lists, few enough to share work among threads.
const PART: usize = 1 << 15;

/// A Gaussian as tiles blend it.
pub(super) struct Record {
    /// The pixel that its centre is in, and where in it: an offset from a pixel is then exact in f32.
    pub base: [i32; 2],
    pub fraction: [f32; 2],
    pub forms: GaussianForms<f32>,
    pub opacity: f32,
    /// What α is multiplied by.
    pub weight: f32,
    pub color: [f32; 3],
    /// World space.
    pub normal: [f32; 3],
    /// Depth before which it doesn't show: at least 0, and no less than that of records before it in pixel order.
    pub nearest: f32,
    /// Its place among the scene's.
    pub number: u32,
    /// Pixels that it may touch, within the region.
    pub rows: Range<u32>,
    columns: Range<u32>,
}

/// Some of the Gaussians that follow each other in order.
#[derive(Default)]
pub(super) struct Part {
    pub records: Vec<Record>,
    /// Where each listed tile's entries begin.
    starts: Vec<u32>,
    /// Indices of records, ascending within a tile.
    entries: Vec<u32>,
}

/// A Gaussian's place in the order.
#[derive(Clone, Copy)]
pub(super) struct Place {
    /// Bits of the depth, not negative, by which it is in order.
    depth: u64,
    cloud: u32,
    index: u32,
}

/// All Gaussians behind the near plane by the depth of their centres, or for pixels to put them in order by the depth
/// at which they begin; equally deep ones in the scene's order.
pub(super) fn in_order(clouds: &[StoredGaussians], (view, plan): (&View, &FramePlan)) -> Vec<Place> {
    let near = gaussian::near(&view.projection);
    let mut order: Vec<Place> = Vec::new();
    for (cloud, StoredGaussians { gaussians, world_from_object }) in clouds.iter().enumerate() {
        let seen = GaussianView::new(gaussians, world_from_object, (view, plan));
        let depth = |i: usize| match plan.sort {
            Sort::Pixel => seen.project(i).map(|projected| projected.nearest.max(0.0)),
            // Sort::Center, the default.
            _ => Some(seen.depth(i)).filter(|depth| *depth > near),
        };
        order.par_extend(
            (0..gaussians.len())
                .into_par_iter()
                .filter_map(|i| Some(Place { depth: depth(i)?.to_bits(), cloud: cloud as u32, index: i as u32 })),
        );
    }
    order.par_sort_unstable_by_key(|place| (place.depth, place.cloud, place.index));
    order
}

/// Records of those that the view shows, in parts.
pub(super) fn project(
    clouds: &[StoredGaussians],
    order: &[Place],
    (view, plan): (&View, &FramePlan),
    grid: &TileGrid,
) -> Vec<Part> {
    let seen: Vec<GaussianView<'_>> =
        clouds.iter().map(|c| GaussianView::new(&c.gaussians, &c.world_from_object, (view, plan))).collect();
    let mut firsts = vec![0];
    firsts.extend(clouds.iter().scan(0, |sum, c| {
        *sum += c.gaussians.len();
        Some(*sum)
    }));
    let record = |place: &Place| {
        let (cloud, i) = (place.cloud as usize, place.index as usize);
        let opacity = clouds[cloud].gaussians.data().opacities[i];
        let record = record(&seen[cloud], i, opacity, view, grid.region)?;
        Some(Record { number: (firsts[cloud] + i) as u32, ..record })
    };
    order
        .par_chunks(PART)
        .map(|places| Part { records: places.iter().filter_map(record).collect(), ..Part::default() })
        .collect()
}

fn record(seen: &GaussianView<'_>, i: usize, opacity: f32, view: &View, region: Region) -> Option<Record> {
    let projected = seen.project(i)?;
    let V2 { x, y } = projected.center_px;
    let [lo, hi] = projected.bounds_px.unwrap_or([V2::new(-1e9, -1e9), V2::new(1e9, 1e9)]);
    let columns = pixels(x, [lo.x, hi.x], [region.x, region.width]);
    let rows = pixels(y, [lo.y, hi.y], [region.y, region.height]);
    if columns.is_empty() || rows.is_empty() {
        return None;
    }
    let two = |c: [f64; 2]| c.map(|c| c as f32);
    let three = |c: [f64; 3]| c.map(|c| c as f32);
    let GaussianForms { u, v, w, z, low_pass } = projected.forms;
    let V3 { x: nx, y: ny, z: nz } = projected.normal;
    let normal = view.view_from_world.transpose() * glam::DVec3::new(nx, ny, nz);
    // Centres are within bounds of their footprints, but may be far outside of the image.
    let base = [x, y].map(|c| c.floor().clamp(-1e9, 1e9));
    Some(Record {
        base: base.map(|c| c as i32),
        fraction: [(x - base[0]) as f32, (y - base[1]) as f32],
        forms: GaussianForms { u: two(u), v: two(v), w: three(w), z: three(z), low_pass: low_pass as f32 },
        opacity,
        weight: projected.weight as f32,
        color: three(seen.color(i)),
        normal: normal.as_vec3().to_array(),
        nearest: projected.nearest.max(0.0) as f32,
        number: 0,
        rows,
        columns,
    })
}

/// Pixels of a region's side whose centres are at these offsets from a place, and a little more.
fn pixels(center: f64, [lo, hi]: [f64; 2], [start, length]: [u32; 2]) -> Range<u32> {
    // Rounding in f32 may reach past exact bounds.
    let slack = 1e-3 * (hi - lo) + 1e-2;
    let within = |at: f64| at.clamp(f64::from(start), f64::from(start + length)) as u32;
    within((center + lo - slack - 0.5).ceil())..within((center + hi + slack - 0.5).floor() + 1.0)
}

/// Tiles that a record may touch: rows and columns of tiles.
fn tiles(record: &Record, grid: &TileGrid) -> [Range<usize>; 2] {
    let of = |pixels: &Range<u32>, start: u32| {
        let tile = |px: u32| ((px - start) / TILE_PX) as usize;
        tile(pixels.start)..tile(pixels.end - 1) + 1
    };
    [of(&record.rows, grid.region.y), of(&record.columns, grid.region.x)]
}

/// Cuts the tiles into ranges whose lists have at most so many entries, or one tile.
pub(super) fn batches(parts: &[Part], grid: &TileGrid, most: u64) -> Vec<Range<usize>> {
    let add = |mut a: Vec<u64>, b: Vec<u64>| {
        a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
        a
    };
    let counts = parts.par_iter().map(|part| part.counts(grid)).reduce(|| vec![0; grid.tiles()], add);
    let (mut batches, mut start, mut entries) = (Vec::new(), 0, 0);
    for (tile, count) in counts.iter().enumerate() {
        if entries + count > most && tile > start {
            batches.push(start..tile);
            (start, entries) = (tile, 0);
        }
        entries += count;
    }
    batches.push(start..grid.tiles());
    batches
}

impl Part {
    /// Number of records of each tile.
    fn counts(&self, grid: &TileGrid) -> Vec<u64> {
        let mut counts = vec![0; grid.tiles()];
        for record in &self.records {
            let [rows, columns] = tiles(record, grid);
            for row in rows {
                let first = row * grid.columns;
                counts[first + columns.start..first + columns.end].iter_mut().for_each(|count| *count += 1);
            }
        }
        counts
    }

    /// Lists the records of some tiles.
    pub(super) fn list(&mut self, listed: &Range<usize>, grid: &TileGrid) {
        let touched = |record: &Record, each: &mut dyn FnMut(usize)| {
            let [rows, columns] = tiles(record, grid);
            let rows = rows.start.max(listed.start / grid.columns)..rows.end.min((listed.end - 1) / grid.columns + 1);
            for row in rows {
                let first = row * grid.columns;
                let of_row = (first + columns.start).max(listed.start)..(first + columns.end).min(listed.end);
                of_row.for_each(|tile| each(tile - listed.start));
            }
        };
        self.starts.clear();
        self.starts.resize(listed.len() + 1, 0);
        let starts = &mut self.starts;
        self.records.iter().for_each(|record| touched(record, &mut |tile| starts[tile + 1] += 1));
        for tile in 0..listed.len() {
            starts[tile + 1] += starts[tile];
        }
        self.entries.clear();
        self.entries.resize(starts.last().map_or(0, |end| *end as usize), 0);
        let mut next = starts.clone();
        for (i, record) in self.records.iter().enumerate() {
            touched(record, &mut |tile| {
                self.entries[next[tile] as usize] = i as u32;
                next[tile] += 1;
            });
        }
    }

    /// The records of a listed tile.
    pub(super) fn of_tile(&self, tile: usize) -> impl Iterator<Item = &Record> {
        let range = self.starts[tile] as usize..self.starts[tile + 1] as usize;
        self.entries[range].iter().map(|i| &self.records[*i as usize])
    }
}

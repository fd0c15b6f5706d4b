//! Projection of Gaussians to records, and each tile's list of the records that touch it, front to back.
//!
//! A *record* is a projected Gaussian ([`Record`]).

use crate::gaussians::grid::{TILE_PX, TileGrid};
use crate::scene::resident::StoredGaussians;
use rayon::prelude::*;
use std::ops::Range;
use surfel_math::gaussian::{self, GaussianForms, ProjectedGaussian};
use surfel_math::{V2, V3};
use surfel_model::Sort;
use surfel_render::{FramePlan, GaussianView, Region, View};

/// Number of Gaussians in a part: enough to make the cost of its tile lists small, few enough to distribute work among
/// threads.
const PART: usize = 1 << 15;

/// A projected Gaussian, in the form in which tiles blend it.
#[derive(Clone)]
pub(super) struct Record {
    /// Column and row of the pixel that contains the projected centre.
    pub base: [i32; 2],
    /// Offset, in pixels, of the projected centre from the upper left corner of the pixel `base`. Differences of `base`
    /// and other pixels are whole numbers, which are exact in f32.
    pub fraction: [f32; 2],
    pub forms: GaussianForms<f32>,
    pub opacity: f32,
    /// Factor of α for a filtered Gaussian: the ratio of its own area to the filtered footprint's; 1 with the filters
    /// used in training.
    pub weight: f32,
    pub color: [f32; 3],
    /// Unit normal in world space.
    pub normal: [f32; 3],
    /// Smallest planar depth of the Gaussian's visible fragments, at least 0. Records are sorted by this depth if
    /// pixels sort their fragments.
    pub nearest: f32,
    /// Number of the Gaussian in the scene, counted through all clouds; breaks ties of depth.
    pub number: u32,
    /// Rows of pixels that the Gaussian may touch, within the region.
    pub rows: Range<u32>,
    /// Columns of pixels that the Gaussian may touch, within the region.
    pub columns: Range<u32>,
}

/// A part of a frame's records: [`PART`] consecutive ones in sorted order, and their lists by tile.
#[derive(Default)]
pub(super) struct Part {
    pub records: Vec<Record>,
    /// Index in `entries` of each listed tile's first entry, followed by the number of entries.
    starts: Vec<u32>,
    /// Indices in `records` of the records that touch each tile, tile by tile; ascending within a tile.
    entries: Vec<u32>,
}

/// Sort key of a record, and where the record is before sorting.
#[derive(Clone, Copy)]
struct Place {
    /// Bits of the depth by which records are sorted; they are in the order of the depths, which aren't negative.
    depth: u64,
    /// Index of the [`Run`] that contains the record. Runs and their records are in scene order.
    run: u32,
    /// Index of the record among the run's records.
    index: u32,
}

/// A range of up to [`PART`] consecutive Gaussians of a cloud, which one task projects.
struct Run {
    /// Index of the cloud among the scene's objects of Gaussians.
    cloud: usize,
    /// Number of the cloud's first Gaussian in the scene, counted through all clouds.
    first: usize,
    /// Range of the Gaussians in the cloud.
    range: Range<usize>,
}

/// Projects all visible Gaussians to records, and returns the records sorted, in parts. They are sorted by the depth of
/// their centres, or by their smallest depth if pixels sort their fragments. Records of equal depth are in scene order.
///
/// Gaussians are projected in memory order, because a Gaussian has hundreds of bytes. In depth order, each would wait
/// for memory several times.
pub(super) fn project(clouds: &[StoredGaussians], (view, plan): (&View, &FramePlan), grid: &TileGrid) -> Vec<Part> {
    let seen: Vec<GaussianView<'_>> =
        clouds.iter().map(|c| GaussianView::new(&c.gaussians, &c.world_from_object, (view, plan))).collect();
    let (mut runs, mut first) = (Vec::new(), 0);
    for (cloud, stored) in clouds.iter().enumerate() {
        let count = stored.gaussians.len();
        let range = |start| start..count.min(start + PART);
        runs.extend((0..count).step_by(PART).map(|start| Run { cloud, first, range: range(start) }));
        first += count;
    }
    let near = gaussian::near(&view.projection);
    let of_run = |run: &Run| -> Vec<(u64, Record)> {
        let (seen, opacities) = (&seen[run.cloud], &clouds[run.cloud].gaussians.data().opacities);
        let record = |i: usize| {
            let projected = seen.project(i)?;
            let depth = match plan.sort {
                Sort::Pixel => projected.nearest.max(0.0),
                // `Sort::Center`, the default.
                _ => Some(seen.depth(i)).filter(|depth| *depth > near)?,
            };
            let record = record(seen, i, projected, opacities[i], view, grid.region)?;
            Some((depth.to_bits(), Record { number: (run.first + i) as u32, ..record }))
        };
        run.range.clone().filter_map(record).collect()
    };
    let records: Vec<Vec<(u64, Record)>> = runs.par_iter().map(of_run).collect();
    let places = |(run, records): (usize, &Vec<(u64, Record)>)| -> Vec<Place> {
        let place = |(index, (depth, _)): (usize, &(u64, Record))| Place {
            depth: *depth,
            run: run as u32,
            index: index as u32,
        };
        records.iter().enumerate().map(place).collect()
    };
    let mut order: Vec<Place> = records.par_iter().enumerate().flat_map_iter(places).collect();
    order.par_sort_unstable_by_key(|place| (place.depth, place.run, place.index));
    let at = |place: &Place| records[place.run as usize][place.index as usize].1.clone();
    order.par_chunks(PART).map(|places| Part { records: places.iter().map(at).collect(), ..Part::default() }).collect()
}

fn record(
    seen: &GaussianView<'_>,
    i: usize,
    projected: ProjectedGaussian,
    opacity: f32,
    view: &View,
    region: Region,
) -> Option<Record> {
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
    // A visible Gaussian's centre may be far outside the image, so the base pixel is clamped.
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

/// Returns the pixels along one axis whose centres are between the offsets `lo` and `hi` from `center`, plus a little
/// slack. The range is clipped to the `length` pixels from `start` on.
fn pixels(center: f64, [lo, hi]: [f64; 2], [start, length]: [u32; 2]) -> Range<u32> {
    // Rounding in f32 may reach past exact bounds.
    let slack = 1e-3 * (hi - lo) + 1e-2;
    let within = |at: f64| at.clamp(f64::from(start), f64::from(start + length)) as u32;
    within((center + lo - slack - 0.5).ceil())..within((center + hi + slack - 0.5).floor() + 1.0)
}

/// Returns the rows and columns of the tiles that a record may touch.
fn tiles(record: &Record, grid: &TileGrid) -> [Range<usize>; 2] {
    let of = |pixels: &Range<u32>, start: u32| {
        let tile = |px: u32| ((px - start) / TILE_PX) as usize;
        tile(pixels.start)..tile(pixels.end - 1) + 1
    };
    [of(&record.rows, grid.region.y), of(&record.columns, grid.region.x)]
}

/// Divides the tiles into consecutive ranges whose lists have at most `most` entries together. A range has at least one
/// tile; a single tile may have more entries.
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
    /// Returns the number of this part's records that may touch each tile.
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

    /// Lists this part's records by tile, for a range of tiles.
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

    /// Returns this part's records that may touch a tile. `tile` is counted from the first listed tile.
    pub(super) fn of_tile(&self, tile: usize) -> impl Iterator<Item = &Record> {
        let range = self.starts[tile] as usize..self.starts[tile + 1] as usize;
        self.entries[range].iter().map(|i| &self.records[*i as usize])
    }
}

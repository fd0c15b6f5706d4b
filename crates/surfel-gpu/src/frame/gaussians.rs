//! Trained Gaussians (docs/gaussians.md): projected and put in order once a frame, in f64, and listed for each tile by
//! cells of 16×16 pixels.

use crate::scene::limits::Limits;
use crate::scene::segment::{UploadedGaussians, UploadedScene};
use crate::struct_writer::StructWriter;
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use std::ops::Range;
use surfel_math::gaussian::{self, GaussianForms, ProjectedGaussian};
use surfel_math::{V2, V3};
use surfel_model::Sort;
use surfel_render::{FramePlan, GaussianView, Region, View};
use surfel_shaders::layout;

/// Side of a cell, pixels.
const CELL: u32 = layout::GAUSSIAN_CELL;
/// Words of the shaders' `GaussianRecord`.
const RECORD_WORDS: usize = layout::gaussian_record::SIZE / 4;

/// A Gaussian as a view shows it.
struct Projected {
    /// The shaders' `GaussianRecord`.
    record: [u32; RECORD_WORDS],
    /// Pixels of the image that it may touch; neither is empty.
    columns: Range<u32>,
    rows: Range<u32>,
}

/// The Gaussians that a view shows, in order.
pub(crate) struct ProjectedGaussians(Vec<Projected>);

/// The Gaussians that a tile shows.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct GaussianLists {
    /// The shaders' `gaussian_records`, one at least.
    pub records: Vec<u32>,
    /// The shaders' `gaussian_lists`.
    pub lists: Vec<u32>,
    /// Number of records.
    pub count: u32,
}

/// Gaussians of a tile that are too many for the limits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct TooMany {
    count: u64,
    bytes: u64,
}

impl TooMany {
    /// What is wrong and what to do, where a tile can't be smaller.
    pub(crate) fn message(self, limits: Limits) -> String {
        let (count, bytes, most) = (self.count, self.bytes, limits.buffer_bytes.min(limits.memory_bytes));
        format!(
            "{count} Gaussians before {CELL}x{CELL} pixels need {bytes} bytes, expected at most {most}; choose \
             --backend cpu"
        )
    }
}

impl ProjectedGaussians {
    /// All that are behind the near plane and within the view's region, by the depth of their centres, or for pixels to
    /// put them in order by the depth at which they begin; equally deep ones in the scene's order.
    pub(crate) fn new(scene: &UploadedScene, view: &View, plan: &FramePlan) -> Self {
        let near = gaussian::near(&view.projection);
        let mut order: Vec<(u64, u32, u32)> = Vec::new();
        let mut seen = Vec::new();
        let mut first = 0;
        for (cloud, UploadedGaussians { cloud: gaussians, world_from_object }) in scene.gaussians.iter().enumerate() {
            let of_view = GaussianView::new(gaussians, world_from_object, (view, plan));
            let depth = |i: usize| match plan.sort {
                Sort::Pixel => of_view.project(i).map(|projected| projected.nearest.max(0.0)),
                // Sort::Center, the default.
                _ => Some(of_view.depth(i)).filter(|depth| *depth > near),
            };
            let placed = (0..gaussians.len()).into_par_iter();
            order.par_extend(placed.filter_map(|i| Some((depth(i)?.to_bits(), cloud as u32, i as u32))));
            seen.push((of_view, &gaussians.data().opacities, first));
            first += gaussians.len() as u32;
        }
        order.par_sort_unstable();
        let projected = |&(_, cloud, i): &(u64, u32, u32)| {
            let (of_view, opacities, first) = seen.get(cloud as usize)?;
            let projected = of_view.project(i as usize)?;
            let [columns, rows] = pixels(&projected, view.region)?;
            let opacity = *opacities.get(i as usize)?;
            let record = record(&projected, view, opacity, of_view.color(i as usize), first + i)?;
            Some(Projected { record, columns, rows })
        };
        Self(order.par_iter().filter_map(projected).collect())
    }

    /// Those of a tile, listed by its cells.
    pub(crate) fn lists(&self, tile: Region, limits: Limits) -> Result<GaussianLists, TooMany> {
        let columns = tile.width.div_ceil(CELL) as usize;
        let cells = columns * tile.height.div_ceil(CELL) as usize;
        let touched: Vec<(&Projected, [Range<u32>; 2])> =
            self.0.par_iter().filter_map(|g| Some((g, g.cells(tile)?))).collect();
        let of_cells = |[columns, rows]: &[Range<u32>; 2]| columns.len() as u64 * rows.len() as u64;
        let entries: u64 = touched.par_iter().map(|(_, cells)| of_cells(cells)).sum();
        let count = touched.len() as u64;
        let (records, lists) = (count * layout::gaussian_record::SIZE as u64, 4 * (cells as u64 + 1 + entries));
        let bytes = records + lists;
        let largest = records.max(lists);
        let fits = largest <= limits.buffer_bytes.min(4 * u64::from(u32::MAX)) && bytes <= limits.memory_bytes;
        if !fits || (bytes > limits.record_bytes && cells > 1) {
            return Err(TooMany { count, bytes });
        }
        // Rows of cells first, so that each is listed by one thread.
        let mut rows = vec![Vec::new(); cells / columns.max(1)];
        for (i, (_, [_, of_rows])) in touched.iter().enumerate() {
            let of_rows = rows.get_mut(of_rows.start as usize..of_rows.end as usize);
            of_rows.into_iter().flatten().for_each(|row| row.push(i as u32));
        }
        let list_row = |row: &Vec<u32>| {
            let mut of_cells = vec![Vec::new(); columns];
            for &i in row {
                let Some((_, [columns, _])) = touched.get(i as usize) else { continue };
                let of_columns = of_cells.get_mut(columns.start as usize..columns.end as usize);
                of_columns.into_iter().flatten().for_each(|cell| cell.push(i));
            }
            of_cells
        };
        let of_cells: Vec<Vec<u32>> = rows.par_iter().flat_map_iter(list_row).collect();
        let mut words = Vec::with_capacity((lists / 4) as usize);
        let mut start = cells as u32 + 1;
        for cell in &of_cells {
            words.push(start);
            start += cell.len() as u32;
        }
        words.push(start);
        of_cells.iter().for_each(|cell| words.extend_from_slice(cell));
        let mut records = Vec::with_capacity((records / 4) as usize);
        touched.iter().for_each(|(g, _)| records.extend_from_slice(&g.record));
        records.resize(records.len().max(RECORD_WORDS), 0);
        Ok(GaussianLists { records, lists: words, count: count as u32 })
    }
}

impl Projected {
    /// Columns and rows of a tile's cells that it may touch; `None` for none.
    fn cells(&self, tile: Region) -> Option<[Range<u32>; 2]> {
        let of = |pixels: &Range<u32>, start: u32, length: u32| {
            let within = pixels.start.max(start)..pixels.end.min(start + length);
            (!within.is_empty()).then(|| (within.start - start) / CELL..(within.end - start - 1) / CELL + 1)
        };
        Some([of(&self.columns, tile.x, tile.width)?, of(&self.rows, tile.y, tile.height)?])
    }
}

/// Columns and rows of pixels within a region whose centres a Gaussian may touch, and a little more; `None` for none.
fn pixels(projected: &ProjectedGaussian, region: Region) -> Option<[Range<u32>; 2]> {
    let [lo, hi] = projected.bounds_px.unwrap_or([V2::new(-1e9, -1e9), V2::new(1e9, 1e9)]);
    let of = |center: f64, [lo, hi]: [f64; 2], [start, length]: [u32; 2]| {
        // Rounding in f32 may reach past exact bounds.
        let slack = 1e-3 * (hi - lo) + 1e-2;
        let within = |at: f64| at.clamp(f64::from(start), f64::from(start + length)) as u32;
        let pixels = within((center + lo - slack - 0.5).ceil())..within((center + hi + slack - 0.5).floor() + 1.0);
        (!pixels.is_empty()).then_some(pixels)
    };
    let V2 { x, y } = projected.center_px;
    Some([of(x, [lo.x, hi.x], [region.x, region.width])?, of(y, [lo.y, hi.y], [region.y, region.height])?])
}

/// The shaders' `GaussianRecord`.
fn record(
    projected: &ProjectedGaussian,
    view: &View,
    opacity: f32,
    color: [f64; 3],
    number: u32,
) -> Option<[u32; RECORD_WORDS]> {
    use layout::{gaussian_forms as form, gaussian_record as at};
    let V2 { x, y } = projected.center_px;
    let V3 { x: nx, y: ny, z: nz } = projected.normal;
    // Centres are within bounds of their footprints, but may be far outside of the image.
    let base = [x, y].map(|c| c.floor().clamp(-1e9, 1e9));
    let GaussianForms { u, v, w, z, low_pass } = projected.forms;
    let mut words = StructWriter::new(at::SIZE);
    words.i32x2(at::BASE, base.map(|c| c as i32)).vec2(at::FRACTION, DVec2::new(x - base[0], y - base[1]));
    words.f64s(at::FORMS + form::U, u).f64s(at::FORMS + form::V, v);
    words.f64s(at::FORMS + form::W, w).f64s(at::FORMS + form::Z, z).f64(at::FORMS + form::LOW_PASS, low_pass);
    words.f64s(at::COLOR, color).f32(at::OPACITY, opacity).f64(at::WEIGHT, projected.weight);
    words.vec3(at::NORMAL, view.view_from_world.transpose() * DVec3::new(nx, ny, nz));
    words.f64(at::NEAREST, projected.nearest.max(0.0)).u32(at::NUMBER, number);
    words.into_words().try_into().ok()
}

/// A region's halves, along its longer side, cut between cells; `None` for one cell.
pub(crate) fn halves(region: Region) -> Option<[Region; 2]> {
    let Region { x, y, width, height } = region;
    let half = |length: u32| length.div_ceil(CELL).div_ceil(2) * CELL;
    if width.max(height) <= CELL {
        return None;
    }
    Some(if width >= height {
        let first = half(width);
        [Region { width: first, ..region }, Region { x: x + first, width: width - first, ..region }]
    } else {
        let first = half(height);
        [Region { height: first, ..region }, Region { y: y + first, height: height - first, ..region }]
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_cover_every_pixel_once_down_to_cells_of_the_same_grid() {
        let whole = Region { x: 5, y: 9, width: 75, height: 40 };
        let (mut open, mut hits, mut cells) = (vec![whole], vec![0; 75 * 40], 0);
        while let Some(region) = open.pop() {
            match halves(region) {
                Some(parts) => open.extend(parts),
                None => {
                    cells += 1;
                    assert_eq!(((region.x - 5) % CELL, (region.y - 9) % CELL), (0, 0), "{region:?}");
                    for y in region.y - 9..region.y - 9 + region.height {
                        (0..region.width).for_each(|x| hits[(y * 75 + region.x - 5 + x) as usize] += 1);
                    }
                }
            }
        }
        assert!(hits.iter().all(|&h| h == 1));
        assert_eq!(cells, 5 * 3);
    }

    #[test]
    fn tile_lists_what_touches_its_cells_in_order_within_the_limits() {
        let gaussian = |columns, rows, number| Projected { record: [number; RECORD_WORDS], columns, rows };
        let all = ProjectedGaussians(vec![
            gaussian(0..100, 0..100, 7),
            gaussian(31..33, 20..21, 8),
            gaussian(90..100, 0..100, 9),
            gaussian(16..17, 47..48, 10),
        ]);
        let tile = Region { x: 16, y: 16, width: 33, height: 32 };
        let lists = all.lists(tile, Limits::default()).unwrap();
        // Three columns of two rows; the third Gaussian is beside the tile.
        assert_eq!(lists.count, 3);
        assert_eq!(lists.records.chunks(RECORD_WORDS).map(|r| r[0]).collect::<Vec<_>>(), [7, 8, 10]);
        let of_cell = |c: usize| &lists.lists[lists.lists[c] as usize..lists.lists[c + 1] as usize];
        let expected: [&[u32]; 6] = [&[0, 1], &[0, 1], &[0], &[0, 2], &[0], &[0]];
        assert_eq!((0..6).map(of_cell).collect::<Vec<_>>(), expected);
        assert_eq!(lists.lists.len() as u32, lists.lists[6]);
        let bytes = 3 * layout::gaussian_record::SIZE as u64 + 4 * lists.lists.len() as u64;
        for (limits, fits) in [
            (Limits { record_bytes: bytes, ..Limits::default() }, true),
            (Limits { record_bytes: bytes - 1, ..Limits::default() }, false),
            (Limits { memory_bytes: bytes - 1, ..Limits::default() }, false),
            (Limits { buffer_bytes: 3 * layout::gaussian_record::SIZE as u64 - 1, ..Limits::default() }, false),
        ] {
            assert_eq!(all.lists(tile, limits).is_ok(), fits, "{limits:?}");
        }
        // One cell may have more than is drawn at once, if the device has room.
        let cell = Region { width: 16, height: 16, ..tile };
        assert!(all.lists(cell, Limits { record_bytes: 0, ..Limits::default() }).is_ok());
        let too_many = all.lists(cell, Limits { memory_bytes: 200, ..Limits::default() }).unwrap_err();
        assert_eq!(too_many, TooMany { count: 2, bytes: 2 * layout::gaussian_record::SIZE as u64 + 4 * 4 });
        // Nothing there: buffers can't be empty.
        let nothing = ProjectedGaussians(Vec::new()).lists(tile, Limits::default()).unwrap();
        assert_eq!((nothing.count, nothing.records.len(), nothing.lists), (0, RECORD_WORDS, vec![7; 7]));
    }
}

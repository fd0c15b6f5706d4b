//! Trained Gaussians (docs/gaussians.md). They are projected and sorted once per frame, in f64, and listed for each
//! tile by cells of 16×16 pixels. A *record* is a projected Gaussian in the uploaded buffer; an *entry* of a list is
//! the index of a record.

use crate::scene::limits::Limits;
use crate::scene::segment::{UploadedGaussians, UploadedScene};
use crate::struct_writer::StructWriter;
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use std::ops::Range;
use surfel_math::gaussian::{self, GaussianForms, ProjectedGaussian, depth_step_f32};
use surfel_math::{V2, V3};
use surfel_model::Sort;
use surfel_render::{FramePlan, GaussianView, Region, View};
use surfel_shaders::layout;

/// Side of a cell, in pixels. A cell is a square of a tile that has its own list of the Gaussians that may touch it.
const CELL: u32 = layout::GAUSSIAN_CELL;
/// Size of the shaders' `GaussianRecord` in words.
const RECORD_WORDS: usize = layout::gaussian_record::SIZE / 4;

/// Gaussian projected into a view.
struct Projected {
    /// Words of the shaders' `GaussianRecord`.
    record: [u32; RECORD_WORDS],
    /// Image columns that the Gaussian may touch, in pixels; never empty.
    columns: Range<u32>,
    /// Image rows that the Gaussian may touch, in pixels; never empty.
    rows: Range<u32>,
}

/// Visible Gaussians of a view, sorted by depth.
pub(crate) struct ProjectedGaussians {
    /// The Gaussians, in the order in which pixels read them.
    all: Vec<Projected>,
    /// True if each pixel blends its fragments in the order of their own depths, false if in the order of the
    /// Gaussians' centres.
    by_pixel: bool,
}

/// Gaussians of a tile, in the layout of the GPU's buffers.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct GaussianLists {
    /// Words of the shaders' `gaussian_records`; at least one record.
    pub records: Vec<u32>,
    /// Words of the shaders' `gaussian_lists`: the cells' lists of records, then the initial state of each pixel.
    pub lists: Vec<u32>,
    /// Size in bytes of the uninitialised memory that follows `lists`. It stores fragments that a pixel has read but
    /// can't blend yet.
    pub room_bytes: u64,
    /// Number of records.
    pub count: u32,
    /// Offset of the per-pixel states in `lists`, in words; `None` if a single dispatch finishes every pixel.
    pub(crate) states_at: Option<u32>,
    /// Maximum number of fragments per pixel that wait to be blended in depth order.
    pub(crate) room: u32,
}

/// Largest memory of a tile's waiting fragments (read, but not yet blended), in bytes. A tile that needs more is split,
/// unless it is a single cell.
const MAX_WAITING_BYTES: u64 = 64 << 20;
/// Size in bytes of a fragment that waits to be blended.
const WAITING_BYTES: u64 = 4 * layout::GAUSSIAN_ROOM_WORDS as u64;
/// Smallest and largest number of waiting fragments for which a pixel has memory, if its list has at least so many
/// entries. A list n times as long as the number for which there is memory takes about n passes.
const WAITING_RANGE: [u64; 2] = [64, 1 << 15];
/// Number of passes over a pixel's list that are accepted to save memory. If a list would take more passes, the pixel
/// gets memory for more waiting fragments, within [`WAITING_RANGE`].
const MAX_TURNS: u64 = 64;
/// Largest number of dispatches that run before the host checks again whether all pixels are finished.
const MAX_DISPATCHES: u32 = 64;

impl GaussianLists {
    /// True if a single dispatch finishes every pixel. Otherwise only a readback tells how many dispatches are needed.
    pub fn is_single_dispatch(&self) -> bool {
        self.states_at.is_none()
    }

    /// Returns the number of dispatches to add after the first `dispatches`; `None` if the last one finished every
    /// pixel. `planes` are the first words of the planes that the shaders wrote.
    pub fn more_dispatches(&self, dispatches: u32, planes: &[u32]) -> Option<u32> {
        let unfinished = planes.get(layout::GAUSSIANS_UNFINISHED_AT as usize).map(|&word| f32::from_bits(word));
        let is_unfinished = self.states_at.is_some() && unfinished == Some(dispatches as f32);
        is_unfinished.then_some(dispatches.min(MAX_DISPATCHES))
    }
}

/// Sizes of the memory for the states and waiting fragments of a tile's pixels.
#[derive(Clone, Copy, Default)]
struct WaitingMemory {
    /// Size of all pixels' states, in words; 0 if a single dispatch finishes every pixel.
    state_words: u64,
    /// Maximum number of waiting fragments per pixel, a power of two; 0 if none wait.
    room: u64,
    /// Size of the memory of all pixels' waiting fragments, in bytes.
    bytes: u64,
}

impl WaitingMemory {
    /// Computes the memory that `pixels` pixels need if the longest list has `longest` entries. `by_pixel` is true if
    /// each pixel sorts its own fragments. Waiting fragments get more than [`MAX_WAITING_BYTES`] only if a pixel
    /// otherwise had memory for fewer than the minimum of [`WAITING_RANGE`], or needed more than [`MAX_TURNS`] passes.
    /// States and fragments together take at most `most_bytes`, unless that is too little for one fragment per pixel.
    fn new(by_pixel: bool, longest: u64, pixels: u64, most_bytes: u64) -> Self {
        if !by_pixel && longest <= u64::from(layout::GAUSSIAN_READS) {
            return Self::default();
        }
        let state_words = u64::from(layout::GAUSSIAN_STATE_WORDS) * pixels;
        if !by_pixel {
            return Self { state_words, ..Self::default() };
        }
        let [least, most] = WAITING_RANGE;
        let within = |bytes: u64| 1 << (bytes / (pixels * WAITING_BYTES).max(1)).max(1).ilog2();
        let whole = longest.next_power_of_two().clamp(1, most);
        let needed = longest.div_ceil(MAX_TURNS).next_power_of_two().clamp(least, most);
        let room =
            whole.min(needed.max(within(MAX_WAITING_BYTES))).min(within(most_bytes.saturating_sub(4 * state_words)));
        Self { state_words, room, bytes: room * pixels * WAITING_BYTES }
    }
}

/// Error: the Gaussians of a tile exceed the memory limits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct TooManyGaussians {
    /// Number of Gaussians that may touch the tile.
    count: u64,
    bytes: u64,
}

impl TooManyGaussians {
    /// Returns a message that states the cause and a remedy. It is for a tile of a single cell, which can't be split
    /// further.
    pub(crate) fn message(self, limits: Limits) -> String {
        let (count, bytes, most) = (self.count, self.bytes, limits.buffer_bytes.min(limits.memory_bytes));
        format!(
            "{count} Gaussians before {CELL}x{CELL} pixels need {bytes} bytes, expected at most {most}; choose \
             `backend=cpu`"
        )
    }
}

impl ProjectedGaussians {
    /// Projects the Gaussians that are beyond the near plane and within the view's region, and sorts them by depth.
    ///
    /// The sort key is the depth of the centre. If each pixel sorts its own fragments, the key is the smallest depth of
    /// the Gaussian instead. Gaussians of equal depth stay in the scene's order.
    pub(crate) fn new(scene: &UploadedScene, view: &View, plan: &FramePlan) -> Self {
        let (near, by_pixel) = (gaussian::near(&view.projection), plan.sort == Sort::Pixel);
        let mut order: Vec<(u64, u32, u32)> = Vec::new();
        let mut seen = Vec::new();
        let mut first = 0;
        for (cloud, UploadedGaussians { cloud: gaussians, world_from_object, .. }) in scene.gaussians.iter().enumerate()
        {
            let of_view = GaussianView::new(gaussians, world_from_object, (view, plan));
            let key = |i: usize| match by_pixel {
                // The depth is rounded as in the shader, so that no fragment is nearer than the record being read.
                true => Some(depth_step_f32(of_view.project(i)?.nearest.max(0.0) as f32).into()),
                false => Some(of_view.depth(i)).filter(|depth| *depth > near).map(f64::to_bits),
            };
            let placed = (0..gaussians.len()).into_par_iter();
            order.par_extend(placed.filter_map(|i| Some((key(i)?, cloud as u32, i as u32))));
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
        Self { all: order.par_iter().filter_map(projected).collect(), by_pixel }
    }

    /// Returns the Gaussians that may touch a tile, listed by its cells. Fails if they exceed the device's buffers or
    /// memory. A tile of several cells, which can be split, also fails beyond `Limits::record_bytes` or
    /// [`MAX_WAITING_BYTES`].
    pub(crate) fn lists(&self, tile: Region, limits: Limits) -> Result<GaussianLists, TooManyGaussians> {
        let columns = tile.width.div_ceil(CELL) as usize;
        let cells = columns * tile.height.div_ceil(CELL) as usize;
        let touched: Vec<(&Projected, [Range<u32>; 2])> =
            self.all.par_iter().filter_map(|g| Some((g, g.cells(tile)?))).collect();
        let of_cells = |[columns, rows]: &[Range<u32>; 2]| columns.len() as u64 * rows.len() as u64;
        let entries: u64 = touched.par_iter().map(|(_, cells)| of_cells(cells)).sum();
        let count = touched.len() as u64;
        let (records, lists) = (count * layout::gaussian_record::SIZE as u64, 4 * (cells as u64 + 1 + entries));
        let check = |lists: u64, rooms: u64| {
            let (bytes, largest) = (records + lists + rooms, records.max(lists + rooms));
            let fits = largest <= limits.buffer_bytes.min(4 * u64::from(u32::MAX)) && bytes <= limits.memory_bytes;
            let is_small = (bytes - rooms <= limits.record_bytes && rooms <= MAX_WAITING_BYTES) || cells == 1;
            if fits && is_small { Ok(()) } else { Err(TooManyGaussians { count, bytes }) }
        };
        check(lists, 0)?;
        // Gaussians are first sorted into rows of cells, so that one thread lists each row.
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
        let longest = of_cells.iter().map(Vec::len).max().unwrap_or(0) as u64;
        let pixels = u64::from(tile.width) * u64::from(tile.height);
        // A tile of one cell can't be split and may use all remaining memory.
        let left = limits.buffer_bytes.saturating_sub(lists).min(limits.memory_bytes.saturating_sub(records + lists));
        let most_bytes = if cells == 1 { left } else { u64::MAX };
        let WaitingMemory { state_words, room, bytes: room_bytes } =
            WaitingMemory::new(self.by_pixel, longest, pixels, most_bytes);
        check(lists + 4 * state_words, room_bytes)?;
        let states_at = (state_words > 0).then_some(words.len() as u32);
        words.resize(words.len() + state_words as usize, 0);
        let mut records = Vec::with_capacity((records / 4) as usize);
        touched.iter().for_each(|(g, _)| records.extend_from_slice(&g.record));
        records.resize(records.len().max(RECORD_WORDS), 0);
        Ok(GaussianLists { records, lists: words, room_bytes, count: count as u32, states_at, room: room as u32 })
    }
}

impl Projected {
    /// Returns the columns and rows of a tile's cells that the Gaussian may touch; `None` if it touches none.
    fn cells(&self, tile: Region) -> Option<[Range<u32>; 2]> {
        let of = |pixels: &Range<u32>, start: u32, length: u32| {
            let within = pixels.start.max(start)..pixels.end.min(start + length);
            (!within.is_empty()).then(|| (within.start - start) / CELL..(within.end - start - 1) / CELL + 1)
        };
        Some([of(&self.columns, tile.x, tile.width)?, of(&self.rows, tile.y, tile.height)?])
    }
}

/// Returns the columns and rows of the pixels of an image region whose centres a Gaussian may cover, with some slack.
/// `None` if there are none.
fn pixels(projected: &ProjectedGaussian, region: Region) -> Option<[Range<u32>; 2]> {
    let [lo, hi] = projected.bounds_px.unwrap_or([V2::new(-1e9, -1e9), V2::new(1e9, 1e9)]);
    let of = |center: f64, [lo, hi]: [f64; 2], [start, length]: [u32; 2]| {
        // Rounding in f32 may exceed exact bounds.
        let slack = 1e-3 * (hi - lo) + 1e-2;
        let within = |at: f64| at.clamp(f64::from(start), f64::from(start + length)) as u32;
        let pixels = within((center + lo - slack - 0.5).ceil())..within((center + hi + slack - 0.5).floor() + 1.0);
        (!pixels.is_empty()).then_some(pixels)
    };
    let V2 { x, y } = projected.center_px;
    Some([of(x, [lo.x, hi.x], [region.x, region.width])?, of(y, [lo.y, hi.y], [region.y, region.height])?])
}

/// Returns the words of the shaders' `GaussianRecord`. `number` is the Gaussian's index among all Gaussians of the
/// scene.
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
    // Centres lie within the bounds of their footprints, but may be far outside of the image.
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

/// Splits a region into halves along its longer side, at a boundary of cells; `None` if it has a single cell.
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
        let all = vec![
            gaussian(0..100, 0..100, 7),
            gaussian(31..33, 20..21, 8),
            gaussian(90..100, 0..100, 9),
            gaussian(16..17, 47..48, 10),
        ];
        let all = ProjectedGaussians { all, by_pixel: false };
        let tile = Region { x: 16, y: 16, width: 33, height: 32 };
        let lists = all.lists(tile, Limits::default()).unwrap();
        // The tile has three columns and two rows of cells; the third Gaussian is beside the tile.
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
        // A single cell may exceed the record limit if the device has enough memory.
        let cell = Region { width: 16, height: 16, ..tile };
        assert!(all.lists(cell, Limits { record_bytes: 0, ..Limits::default() }).is_ok());
        let too_many = all.lists(cell, Limits { memory_bytes: 200, ..Limits::default() }).unwrap_err();
        assert_eq!(too_many, TooManyGaussians { count: 2, bytes: 2 * layout::gaussian_record::SIZE as u64 + 4 * 4 });
        // An empty tile still has a record, since buffers can't be empty.
        let nothing = ProjectedGaussians { all: Vec::new(), by_pixel: false }.lists(tile, Limits::default()).unwrap();
        assert_eq!((nothing.count, nothing.records.len(), nothing.lists), (0, RECORD_WORDS, vec![7; 7]));
        assert_eq!((lists.states_at, lists.room_bytes), (None, 0));
        // Pixels that sort their own fragments have states, and memory for as many waiting fragments as there are
        // Gaussians.
        let by_pixel = ProjectedGaussians { by_pixel: true, ..all };
        let ordered = by_pixel.lists(tile, Limits::default()).unwrap();
        let (at, pixels) = (lists.lists.len(), 33 * 32);
        assert_eq!((ordered.states_at, ordered.room, &ordered.lists[..at]), (Some(at as u32), 2, &lists.lists[..]));
        assert_eq!(ordered.lists.len(), at + layout::GAUSSIAN_STATE_WORDS as usize * pixels);
        assert_eq!(ordered.room_bytes, 2 * 12 * pixels as u64);
        let enough = ordered.room_bytes + bytes + 4 * u64::from(layout::GAUSSIAN_STATE_WORDS) * pixels as u64;
        for (memory_bytes, fits) in [(enough, true), (enough - 1, false)] {
            assert_eq!(by_pixel.lists(tile, Limits { memory_bytes, ..Limits::default() }).is_ok(), fits);
        }
    }

    #[test]
    fn long_lists_get_rooms_that_few_turns_suffice_for() {
        let room = |longest, pixels| WaitingMemory::new(true, longest, pixels, u64::MAX).room;
        assert_eq!([room(0, 100), room(1, 100), room(5, 100), room(1000, 100)], [1, 1, 8, 1024]);
        // 64 MiB, shared by many pixels, are 85 fragments for each of 256×256.
        assert_eq!([room(1000, 65_536), room(4096, 65_536), room(5000, 65_536)], [64, 64, 128]);
        // A cell has 256 pixels.
        assert_eq!([room(20_000, 256), room(1 << 20, 256), room(u64::from(u32::MAX), 256)], [16_384, 16_384, 32_768]);
        // Of 64 KiB, states take 24; the rest is enough for 13 fragments a pixel.
        assert_eq!(
            [WaitingMemory::new(true, 5000, 256, 64 << 10).room, WaitingMemory::new(true, 5000, 256, 0).room],
            [8, 1]
        );
        let by_center = |longest| WaitingMemory::new(false, longest, 10, u64::MAX);
        assert_eq!(
            (by_center(32_768).state_words, by_center(32_769).state_words, by_center(99_999).bytes),
            (0, 240, 0)
        );
    }

    #[test]
    fn dispatches_go_on_while_the_last_one_left_pixels_unfinished() {
        let lists = GaussianLists { states_at: Some(7), ..GaussianLists::default() };
        let more = |dispatches: u32, last: f32| lists.more_dispatches(dispatches, &[last.to_bits(), 9]);
        assert_eq!([more(1, 0.0), more(1, 1.0), more(2, 1.0), more(2, 2.0)], [None, Some(1), None, Some(2)]);
        assert_eq!([more(128, 128.0), more(192, 191.0)], [Some(64), None]);
        assert_eq!(GaussianLists::default().more_dispatches(1, &[1f32.to_bits()]), None);
    }
}

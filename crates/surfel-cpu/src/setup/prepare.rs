//! Setup of a cell: one thread projects the cell's chunks and sorts the records into tiles.
//!
//! A *block* is 4×4 pixels ([`BLOCK`](crate::tiles::grid::BLOCK)). A *cell* is a part of the view that one thread draws
//! alone ([`Cell`](crate::cull::cells::Cell)). A *record* is a splat projected to the screen
//! ([`Record`](crate::setup::record::Record)). A *tile* is a square of blocks ([`Grid`](crate::tiles::grid::Grid)).

use crate::cull::chunks::VisibleChunk;
use crate::cull::object::ObjectView;
use crate::setup::clips::CellClips;
use crate::setup::near::NearSplat;
use crate::setup::project::{SetupOutput, TransparentOutput};
use crate::setup::segment::{Segment, TransparentSegment};
use crate::setup::tiny::TinyFinder;
use crate::simd::level::{Instructions, with_instructions};
use crate::tiles::bins::Entries;
use crate::tiles::drawn::DrawnBlocks;
use crate::tiles::grid::Grid;
use crate::tiles::pool::Pool;
use fearless_simd::Simd;
use surfel_render::Region;
use surfel_render::clock::Instant;

/// Buffers that are reused from one cell's setup to the next.
#[derive(Default)]
pub(crate) struct SetupPool {
    segments: Pool<Segment>,
    entries: Pool<Entries>,
}

impl SetupPool {
    pub(crate) fn give_back(&self, segments: Vec<Segment>) {
        segments.into_iter().for_each(|segment| self.segments.give_back(segment));
    }
}

/// Data that the setup of all cells of a view shares.
#[derive(Clone, Copy)]
pub(crate) struct CellSetup<'a> {
    pub instructions: Instructions,
    pub objects: &'a [ObjectView<'a>],
    /// Finder of tiny splats, whose fragments setup computes itself ([`tiny`](crate::setup::tiny)). `None` if all
    /// splats are evaluated block by block.
    pub tiny: Option<&'a TinyFinder>,
    pub pool: &'a SetupPool,
}

/// The splats of a cell after setup: projected to records and sorted into tiles.
#[derive(Default)]
pub(crate) struct CellSplats {
    /// Opaque splats, one segment for each setup of chunks.
    pub segments: Vec<Segment>,
    /// Transparent splats, one segment for each setup of chunks that found any.
    pub transparent: Vec<TransparentSegment>,
    /// Near splats ([`near`](crate::setup::near)), which are evaluated in f64.
    pub near: Vec<NearSplat>,
    pub clips: CellClips,
}

impl CellSplats {
    /// Returns the largest depth tolerance ε, in world units, of the opaque splats of oriented clouds, if front and
    /// back sides are blended separately; else 0.
    pub(crate) fn largest_epsilon(&self) -> f32 {
        self.segments.iter().fold(0.0, |largest, segment| largest.max(segment.largest_epsilon))
    }

    fn all(&self) -> impl Iterator<Item = &Segment> {
        self.segments.iter().chain(self.transparent.iter().map(|t| &t.segment))
    }

    /// Returns the number of splats in the chunks that were set up.
    pub(crate) fn set_up(&self) -> u64 {
        self.segments.iter().map(|s| s.set_up).sum()
    }

    /// Returns the number of splats drawn, each counted in one cell.
    pub(crate) fn drawn(&self) -> u64 {
        self.segments.iter().map(|s| s.drawn).sum()
    }

    /// Returns the fraction of the setup's time that sorting records into tiles took.
    pub(crate) fn sort_share(&self) -> f64 {
        let [set_up, sort] = self.segments.iter().fold([0.0; 2], |[a, b], s| [a + s.set_up_s, b + s.sort_s]);
        if sort > 0.0 { sort / (set_up + sort) } else { 0.0 }
    }

    /// Returns the number of entries in tiles' lists: pairs of a record and a tile that it touches.
    pub(crate) fn tile_pairs(&self) -> u64 {
        self.all().map(|s| s.lists.len() as u64).sum()
    }

    /// Returns the heap memory that records, lists and clips use, in bytes.
    pub(crate) fn bytes(&self) -> usize {
        let transparent: usize = self.transparent.iter().map(|t| size_of_val(t.splats.as_slice())).sum();
        let near = size_of_val(self.near.as_slice());
        self.all().map(Segment::bytes).sum::<usize>() + transparent + near + self.clips.bytes()
    }
}

impl CellSetup<'_> {
    /// Sets up the splats of these chunks that may touch the grid's region, and appends them to `splats`, sorted into
    /// the grid's tiles. `counted` is the part of the region that belongs to no other cell; splats count as drawn if
    /// their centre, clamped to the view, is there.
    pub(crate) fn add(&self, chunks: &[VisibleChunk], grid: &Grid, counted: Region, splats: &mut CellSplats) {
        self.add_some(chunks, grid, counted, DrawnBlocks::default(), splats);
    }

    /// Sets up, as [`Self::add`] does, only the splats that touch the blocks in `drawn`.
    pub(crate) fn add_some(
        &self,
        chunks: &[VisibleChunk],
        grid: &Grid,
        counted: Region,
        drawn: DrawnBlocks<'_>,
        splats: &mut CellSplats,
    ) {
        let (mut segment, mut entries) = (self.pool.segments.take(), self.pool.entries.take());
        let mut transparent = TransparentOutput::default();
        segment.clear();
        entries.clear();
        let [first_clip, first_transparent_clip] = splats.clips.next_numbers();
        segment.clips.restart(first_clip);
        transparent.segment.clips.restart(first_transparent_clip);
        let mut out = SetupOutput {
            grid: *grid,
            counted,
            tiny: self.tiny,
            segment: &mut segment,
            entries: &mut entries,
            drawn,
            transparent: Some(&mut transparent),
        };
        let start = Instant::now();
        with_instructions!(self.instructions, simd => project_chunks(simd, self.objects, chunks, &mut out));
        if drawn.set().is_some() {
            [&mut entries, &mut transparent.entries].into_iter().for_each(|entries| retain(entries, drawn));
        }
        let after_setup = Instant::now();
        segment.lists.sort(&mut entries, grid);
        self.pool.entries.give_back(entries);
        let has_transparent = !transparent.splats.is_empty();
        if has_transparent {
            transparent.segment.lists.sort(&mut transparent.entries, grid);
        }
        segment.set_up_s = (after_setup - start).as_secs_f64();
        segment.sort_s = after_setup.elapsed().as_secs_f64();
        for segment in [&mut segment, &mut transparent.segment] {
            segment.move_near_and_clips(&mut splats.near, &mut splats.clips);
        }
        splats.segments.push(segment);
        if has_transparent {
            let TransparentOutput { segment, splats: own, .. } = transparent;
            splats.transparent.push(TransparentSegment { segment, splats: own });
        }
    }
}

/// Removes the entries of records that touch no drawn block of their tile.
fn retain(entries: &mut Entries, drawn: DrawnBlocks<'_>) {
    let mut count = 0;
    for at in 0..entries.len() {
        let entry = entries[at];
        entries[count] = entry;
        count += usize::from(entry.blocks & drawn.of(entry.tile() as u32) != 0);
    }
    entries.resize(count);
}

#[inline(always)]
fn project_chunks<S: Simd>(simd: S, objects: &[ObjectView<'_>], chunks: &[VisibleChunk], out: &mut SetupOutput<'_>) {
    simd.vectorize(
        #[inline(always)]
        || {
            let mut sides = None;
            for visible in chunks {
                let object = &objects[visible.object as usize];
                let sides = match &mut sides {
                    Some((index, sides)) if *index == visible.object => &*sides,
                    other => &other.insert((visible.object, object.sides(out.grid.region))).1,
                };
                object.project_chunk(simd, visible.chunk as usize, sides, out);
            }
        },
    );
}

//! Setup of a cell: its chunks, projected and sorted into tiles by one thread.

use crate::cull::chunks::VisibleChunk;
use crate::cull::object::ObjectView;
use crate::setup::candidates::{Candidates, Pick};
use crate::setup::clips::CellClips;
use crate::setup::near::NearSplat;
use crate::setup::project::{SetupOutput, TransparentOutput};
use crate::setup::segment::{Segment, TransparentSegment};
use crate::setup::tiny::TinyFinder;
use crate::simd::lanes::LANES;
use crate::simd::level::{Instructions, with_instructions};
use crate::tiles::bins::Entries;
use crate::tiles::drawn::DrawnBlocks;
use crate::tiles::grid::Grid;
use crate::tiles::pool::Pool;
use fearless_simd::Simd;
use std::time::Instant;
use surfel_render::Region;

/// Memory that one cell's setup leaves to the next.
#[derive(Default)]
pub(crate) struct SetupPool {
    segments: Pool<Segment>,
    entries: Pool<Entries>,
    candidates: Pool<Candidates>,
}

impl SetupPool {
    pub(crate) fn give_back(&self, splats: CellSplats) {
        splats.segments.into_iter().for_each(|segment| self.segments.give_back(segment));
        splats.candidates.into_iter().for_each(|candidates| self.candidates.give_back(candidates));
    }
}

/// What setup of all cells of a view shares.
#[derive(Clone, Copy)]
pub(crate) struct CellSetup<'a> {
    pub instructions: Instructions,
    pub objects: &'a [ObjectView<'a>],
    /// Where splats of few pixels are evaluated by setup.
    pub tiny: Option<&'a TinyFinder>,
    pub pool: &'a SetupPool,
    /// Splats that may touch samples are noted.
    pub notes_candidates: bool,
}

/// What is set up.
#[derive(Clone, Copy)]
enum Source<'a> {
    Chunks(&'a [VisibleChunk]),
    /// For their candidates alone.
    Occluded(&'a [VisibleChunk]),
    Picks(&'a [Pick]),
}

/// Splats of a cell, set up and sorted into tiles.
#[derive(Default)]
pub(crate) struct CellSplats {
    pub segments: Vec<Segment>,
    pub transparent: Vec<TransparentSegment>,
    pub near: Vec<NearSplat>,
    pub clips: CellClips,
    pub candidates: Option<Candidates>,
}

impl CellSplats {
    /// The largest ε of opaque splats whose sides are kept apart.
    pub(crate) fn largest_epsilon(&self) -> f32 {
        self.segments.iter().fold(0.0, |largest, segment| largest.max(segment.largest_epsilon))
    }

    fn all(&self) -> impl Iterator<Item = &Segment> {
        self.segments.iter().chain(self.transparent.iter().map(|t| &t.segment))
    }

    /// Splats that were looked at one by one.
    pub(crate) fn set_up(&self) -> u64 {
        self.segments.iter().map(|s| s.set_up).sum()
    }

    /// Splats that are drawn, each counted in one cell.
    pub(crate) fn drawn(&self) -> u64 {
        self.segments.iter().map(|s| s.drawn).sum()
    }

    /// The share of its time that sorting into tiles took.
    pub(crate) fn sort_share(&self) -> f64 {
        let [set_up, sort] = self.segments.iter().fold([0.0; 2], |[a, b], s| [a + s.set_up_s, b + s.sort_s]);
        if sort > 0.0 { sort / (set_up + sort) } else { 0.0 }
    }

    /// Pairs of record and tile.
    pub(crate) fn tile_pairs(&self) -> u64 {
        self.all().map(|s| s.pairs() as u64).sum()
    }

    /// Bytes of heap memory in use.
    pub(crate) fn bytes(&self) -> usize {
        let transparent: usize = self.transparent.iter().map(|t| size_of_val(t.splats.as_slice())).sum();
        let near = size_of_val(self.near.as_slice());
        let candidates = self.candidates.as_ref().map_or(0, Candidates::bytes);
        self.all().map(Segment::bytes).sum::<usize>() + transparent + near + self.clips.bytes() + candidates
    }
}

impl CellSetup<'_> {
    /// Sets up what of some chunks may touch a grid's region, and sorts it into its tiles, after what is in `splats`
    /// already; `counted` is what of the region no other cell has.
    pub(crate) fn add(&self, chunks: &[VisibleChunk], grid: &Grid, counted: Region, splats: &mut CellSplats) {
        self.add_all(Source::Chunks(chunks), grid, counted, DrawnBlocks::default(), splats);
    }

    /// Notes the candidates of chunks that nothing else is wanted of.
    pub(crate) fn add_occluded(&self, chunks: &[VisibleChunk], grid: &Grid, counted: Region, splats: &mut CellSplats) {
        if self.notes_candidates && !chunks.is_empty() {
            self.add_all(Source::Occluded(chunks), grid, counted, DrawnBlocks::default(), splats);
        }
    }

    /// [`Self::add`] of some splats, for some blocks.
    pub(crate) fn add_picks(
        &self,
        picks: &[Pick],
        grid: &Grid,
        counted: Region,
        drawn: DrawnBlocks<'_>,
        splats: &mut CellSplats,
    ) {
        self.add_all(Source::Picks(picks), grid, counted, drawn, splats);
    }

    fn add_all(
        &self,
        source: Source<'_>,
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
        if self.notes_candidates && splats.candidates.is_none() {
            let mut candidates = self.pool.candidates.take();
            candidates.clear();
            splats.candidates = Some(candidates);
        }
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
            candidates: splats.candidates.as_mut(),
            only_candidates: matches!(source, Source::Occluded(_)),
        };
        let start = Instant::now();
        with_instructions!(self.instructions, simd => project(simd, self.objects, source, &mut out));
        if drawn.set().is_some() {
            [&mut entries, &mut transparent.entries].into_iter().for_each(|entries| retain(entries, drawn));
        }
        let after_setup = Instant::now();
        segment.sort(&mut entries, grid);
        self.pool.entries.give_back(entries);
        let has_transparent = !transparent.splats.is_empty();
        if has_transparent {
            transparent.segment.sort(&mut transparent.entries, grid);
        }
        segment.set_up_s = (after_setup - start).as_secs_f64();
        segment.sort_s = after_setup.elapsed().as_secs_f64();
        for segment in [&mut segment, &mut transparent.segment] {
            segment.move_rare(&mut splats.near, &mut splats.clips);
        }
        splats.segments.push(segment);
        if has_transparent {
            let TransparentOutput { segment, splats: own, .. } = transparent;
            splats.transparent.push(TransparentSegment { segment, splats: own });
        }
    }
}

/// Leaves the entries of these blocks.
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
fn project<S: Simd>(simd: S, objects: &[ObjectView<'_>], source: Source<'_>, out: &mut SetupOutput<'_>) {
    simd.vectorize(
        #[inline(always)]
        || match source {
            Source::Chunks(chunks) | Source::Occluded(chunks) => {
                let mut sides = None;
                for visible in chunks {
                    let object = &objects[visible.object as usize];
                    let sides = match &mut sides {
                        Some((index, sides)) if *index == visible.object => &*sides,
                        other => &other.insert((visible.object, object.sides(out.grid.region))).1,
                    };
                    object.project_chunk(simd, (visible.chunk as usize, visible.rank), sides, out);
                }
            }
            Source::Picks(mut picks) => {
                while let Some(first) = picks.first() {
                    let object = &objects[first.object as usize];
                    let goes_on = |pick: &&Pick| pick.object == first.object && !pick.is_near;
                    // Near ones go before and after others wherever these end, so that sums have one order.
                    let count = picks.iter().take(LANES).take_while(goes_on).count();
                    let (now, rest) = picks.split_at(count.max(1));
                    if count == 0 {
                        let chunk = &object.object.chunks[first.chunk as usize];
                        object.push_near(simd, chunk, first.slot as usize, 1, out);
                    } else {
                        object.project_picks(simd, now, out);
                    }
                    picks = rest;
                }
            }
        },
    );
}

//! Before anything is drawn: which chunks a view may see, how its rows are shared out, and chunks set up and sorted into tiles.

use crate::bins::{BLOCK, Grid, Segment};
use crate::clip::{FrameClips, ScreenClips};
use crate::level::{Instructions, with_instructions};
use crate::mesh::StoredMesh;
use crate::near::NearSplat;
use crate::placed::{ObjectSetup, inside};
use crate::record::Class;
use crate::recycle::Recycled;
use crate::renderer::Evaluation;
use crate::setup::{SetupOutput, VeilOutput};
use crate::store::{CHUNK, StoredObject};
use crate::veil::VeilSegment;
use fearless_simd::Simd;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;
use surfel_model::Cull;
use surfel_render::{FramePlan, Region, View};

/// Chunks that one task sets up and bins, at most: enough splats (64 × 256) to be worth a list per tile.
const CHUNKS_PER_SEGMENT: usize = 64;

/// Tasks a thread, at least, so that none waits long for the last.
const SEGMENTS_PER_THREAD: usize = 8;

/// A chunk that may be seen.
#[derive(Clone, Copy)]
pub(crate) struct Seen {
    pub object: u32,
    pub chunk: u32,
    /// Depth of its centre: what is near comes first, so that what it hides is found early.
    z: f64,
}

/// Splats of chunks that can't be seen as a whole.
#[derive(Clone, Copy, Default)]
pub(crate) struct Unseen {
    pub outside: u64,
    pub turned_away: u64,
}

/// What is prepared: the splats of some objects for a view.
#[derive(Clone, Copy)]
pub(crate) struct Preparation<'a> {
    pub instructions: Instructions,
    pub objects: &'a [StoredObject],
    pub view: &'a View,
    pub plan: &'a FramePlan,
    pub tile_px: u32,
    /// Most splats that a batch of rows sets up, about.
    pub batch_splats: usize,
    /// [`Cull::None`]: nothing is left out for facing away, whatever its material says.
    pub cull: Cull,
    pub evaluation: Evaluation,
    /// Whether splats of few pixels become dots.
    pub finds_dots: bool,
    pub recycled: &'a Recycled,
}

/// Splats of some rows, set up and sorted into tiles.
#[derive(Default)]
pub(crate) struct Prepared {
    pub segments: Vec<Segment>,
    pub veils: Vec<VeilSegment>,
    pub near: Vec<NearSplat>,
    pub clips: FrameClips,
}

impl Prepared {
    /// Adds what was set up later.
    fn extend(&mut self, parts: Vec<(Segment, Option<VeilSegment>)>) {
        for (mut segment, veil) in parts {
            segment.move_rare(&mut self.near, &mut self.clips);
            self.segments.push(segment);
            match veil {
                Some(mut veil) => {
                    veil.segment.move_rare(&mut self.near, &mut self.clips);
                    self.veils.push(veil);
                }
                None => self.clips.push(ScreenClips::default()),
            }
        }
    }

    fn all(&self) -> impl Iterator<Item = &Segment> {
        self.segments.iter().chain(self.veils.iter().map(|v| &v.segment))
    }

    /// Splats that were looked at one by one.
    pub(crate) fn set_up(&self) -> u64 {
        self.segments.iter().map(|s| s.set_up).sum()
    }

    /// Splats that are drawn, each counted in one part of a view.
    pub(crate) fn drawn(&self) -> u64 {
        self.segments.iter().map(|s| s.drawn).sum()
    }

    /// The share of its time that sorting into tiles took.
    pub(crate) fn sort_share(&self) -> f64 {
        let [set_up, sort] = self.segments.iter().fold([0.0; 2], |[a, b], s| [a + s.set_up_s, b + s.sort_s]);
        if sort > 0.0 { sort / (set_up + sort) } else { 0.0 }
    }

    /// Records by the evaluator that draws them, in the order of [`Class::ALL`].
    pub(crate) fn evaluators(&self) -> [u64; Class::ALL.len()] {
        let mut counts = [0; Class::ALL.len()];
        for record in self.all().flat_map(|segment| segment.records.iter()) {
            let class = record.class();
            for (count, _) in counts.iter_mut().zip(Class::ALL).filter(|(_, one)| *one == class) {
                *count += 1;
            }
        }
        let small: u64 = self.all().map(|s| s.small_dots.len() as u64).sum();
        let unfolded: u64 = self.all().map(|s| s.unfolded).sum();
        for (count, _) in counts.iter_mut().zip(Class::ALL).filter(|(_, class)| *class == Class::Dot) {
            *count = (*count + small).saturating_sub(unfolded);
        }
        counts
    }

    /// Pairs of record and tile.
    pub(crate) fn tile_pairs(&self) -> u64 {
        self.all().map(|s| s.pairs() as u64).sum()
    }

    /// Bytes of heap memory in use.
    pub(crate) fn bytes(&self) -> usize {
        let veils: usize = self.veils.iter().map(|v| size_of_val(v.splats.as_slice())).sum();
        self.all().map(Segment::bytes).sum::<usize>() + veils + size_of_val(self.near.as_slice()) + self.clips.bytes()
    }
}

impl<'a> Preparation<'a> {
    /// A region cut into tiles.
    pub(crate) fn grid(&self, region: Region) -> Grid {
        Grid::new(region, self.tile_px / BLOCK)
    }

    /// What is the same for all splats of each object.
    pub(crate) fn setups(&self) -> Vec<ObjectSetup<'a>> {
        let objects = self.objects.iter().enumerate();
        objects
            .map(|(i, o)| {
                ObjectSetup::new(o, i as u32, self.view, self.plan, (self.cull, self.evaluation, self.finds_dots))
            })
            .collect()
    }

    /// Chunks that are not outside the view or turned away, from near to far, and how many splats those others have.
    pub(crate) fn seen(&self, setups: &[ObjectSetup<'_>]) -> (Vec<Seen>, Unseen) {
        let [outside, turned_away] = [const { AtomicU64::new(0) }; 2];
        let (out, away) = (&outside, &turned_away);
        let mut seen: Vec<Seen> = setups
            .par_iter()
            .enumerate()
            .flat_map(|(object, setup)| {
                let region = self.view.region.grown(self.plan.reach_px(), self.view.size);
                let chunks = setup.object.chunks.par_iter().enumerate().with_min_len(1024);
                chunks.filter_map(move |(chunk, c)| {
                    let center = setup.center(c);
                    let count = |of: &AtomicU64| {
                        of.fetch_add(c.count as u64, Ordering::Relaxed);
                        true
                    };
                    let unseen =
                        (setup.is_outside(center, c, region) && count(out)) || (setup.is_turned_away(c) && count(away));
                    (!unseen).then_some(Seen { object: object as u32, chunk: chunk as u32, z: center.z })
                })
            })
            .collect();
        let order = |a: &Seen, b: &Seen| a.z.total_cmp(&b.z).then((a.object, a.chunk).cmp(&(b.object, b.chunk)));
        seen.par_sort_unstable_by(order);
        (seen, Unseen { outside: outside.into_inner(), turned_away: turned_away.into_inner() })
    }

    /// Splats of some chunks.
    pub(crate) fn splats(&self, seen: &[Seen]) -> usize {
        seen.iter().map(|s| self.objects[s.object as usize].chunks[s.chunk as usize].count).sum()
    }

    /// Rows of the view's region, in batches that each set up about as many splats and triangles as they may; a triangle takes as
    /// much memory as a splat, and a splat of many tiles more.
    pub(crate) fn batches(&self, setups: &[ObjectSetup<'_>], seen: &[Seen], meshes: &[StoredMesh]) -> Vec<Region> {
        let region = self.view.region;
        let triangles = meshes.iter().map(StoredMesh::triangles).sum::<usize>();
        let most = self.batch_splats.max(1) as f64;
        let tile = self.tile_px;
        let of_splats = seen.iter().map(|s| {
            let setup = &setups[s.object as usize];
            let chunk = &setup.object.chunks[s.chunk as usize];
            let center = setup.center(chunk);
            let pixels = inside(setup.pixels(center, chunk), region);
            (pixels, setup.load(center, chunk, pixels, tile))
        });
        if of_splats.clone().map(|(_, load)| load).sum::<f64>() + triangles as f64 <= most || region.height == 0 {
            return vec![region];
        }
        let strips = (region.y + region.height).div_ceil(tile) - region.y / tile;
        let mut load = vec![0.0; strips as usize];
        let of_triangles =
            meshes.iter().flat_map(|mesh| mesh.seen(self.view)).map(|(pixels, range)| (pixels, range.len() as f64));
        for ([_, top, _, bottom], whole) in of_splats.chain(of_triangles) {
            let strip = |row: f64| {
                let strip = (row / f64::from(tile)).floor() - f64::from(region.y / tile);
                strip.clamp(0.0, f64::from(strips - 1)) as usize
            };
            let covered = strip(top)..=strip(bottom);
            let share = whole / (covered.end() - covered.start() + 1) as f64;
            load[covered].iter_mut().for_each(|l| *l += share);
        }
        let mut batches = Vec::new();
        let (mut first, mut sum) = (region.y, 0.0);
        for (i, load) in load.iter().enumerate() {
            let strip_y = ((region.y / tile + i as u32) * tile).max(region.y);
            if sum > 0.0 && sum + load > most {
                batches.push(Region { y: first, height: strip_y - first, ..region });
                (first, sum) = (strip_y, 0.0);
            }
            sum += load;
        }
        batches.push(Region { y: first, height: region.y + region.height - first, ..region });
        batches
    }

    /// Sets up what may touch a grid's region, and sorts it into its tiles; `counted` is what of it no other part of the view has.
    pub(crate) fn set_up(&self, setups: &[ObjectSetup<'_>], seen: &[Seen], grid: &Grid, counted: Region) -> Prepared {
        let threads = rayon::current_num_threads();
        let per_task = seen.len().div_ceil(threads * SEGMENTS_PER_THREAD).clamp(1, CHUNKS_PER_SEGMENT);
        let mut prepared = Prepared { clips: FrameClips::new(per_task * CHUNK), ..Prepared::default() };
        let clips = &prepared.clips;
        let task = |(i, chunks)| self.segment(setups, chunks, grid, counted, clips.first_of(i));
        let parts = seen.par_chunks(per_task).enumerate().map(task).collect();
        prepared.extend(parts);
        prepared
    }

    /// [`Self::set_up`] by one thread, after what is `prepared` already.
    pub(crate) fn set_up_alone(
        &self,
        setups: &[ObjectSetup<'_>],
        seen: &[Seen],
        (grid, counted): (&Grid, Region),
        prepared: &mut Prepared,
    ) {
        let first_clips = prepared.clips.first_of(0);
        prepared.extend(vec![self.segment(setups, seen, grid, counted, first_clips)]);
    }

    fn segment(
        &self,
        setups: &[ObjectSetup<'_>],
        chunks: &[Seen],
        grid: &Grid,
        counted: Region,
        first_clips: [u32; 2],
    ) -> (Segment, Option<VeilSegment>) {
        let (mut segment, mut entries) = (self.recycled.segment(), self.recycled.entries());
        let mut veil = VeilOutput::default();
        segment.clips.restart(first_clips[0]);
        veil.segment.clips.restart(first_clips[1]);
        let mut out =
            SetupOutput { grid: *grid, counted, segment: &mut segment, entries: &mut entries, veil: Some(&mut veil) };
        let start = Instant::now();
        with_instructions!(self.instructions, simd => set_up(simd, setups, chunks, &mut out));
        let after_setup = Instant::now();
        segment.sort(&mut entries, grid);
        self.recycled.give_back_entries(entries);
        let veil = (!veil.splats.is_empty()).then(|| {
            veil.segment.sort(&mut veil.entries, grid);
            VeilSegment { segment: veil.segment, splats: veil.splats }
        });
        segment.set_up_s = (after_setup - start).as_secs_f64();
        segment.sort_s = after_setup.elapsed().as_secs_f64();
        (segment, veil)
    }
}

#[inline(always)]
fn set_up<S: Simd>(simd: S, setups: &[ObjectSetup<'_>], chunks: &[Seen], out: &mut SetupOutput<'_>) {
    simd.vectorize(
        #[inline(always)]
        || {
            let mut sides = None;
            for seen in chunks {
                let setup = &setups[seen.object as usize];
                let sides = match &mut sides {
                    Some((object, sides)) if *object == seen.object => &*sides,
                    other => &other.insert((seen.object, setup.sides(out.grid.region))).1,
                };
                setup.chunk(simd, seen.chunk as usize, sides, out);
            }
        },
    );
}

//! Data of a tile in addition to the resident scene: visible chunks, splats that reach the near plane, polygons, balls,
//! Gaussians and uniforms. A *segment* is the part of an object's splats that shares a buffer
//! ([`Segment`](crate::Segment)). A *record* is a splat as set up for a tile: its projected forms, pixel boxes and
//! colour in a buffer.

use crate::frame::balls::{MAX_BALLS, TileBalls};
use crate::frame::culling::{RegionFrustum, is_back_facing, may_reach_near};
use crate::frame::gaussians::GaussianLists;
use crate::frame::near_plane::{NearPlaneChunk, NearPlaneRecords, NearPlaneSetup};
use crate::frame::object_transform::ObjectTransform;
use crate::frame::planes::PlaneLayout;
use crate::frame::polygons::polygon_words;
use crate::frame::tiling::targets_of;
use crate::frame::uniforms::{FrameScene, TileRegions, frame_words};
use crate::passes::cells::{CellCapacity, CellCounts};
use crate::passes::pass_list::{has_layers, is_of_shadow_map};
use crate::passes::schedule::VisibleSegments;
use crate::scene::clip::{CELL_CLIP_WORDS, Variant, cell_clip_words};
use crate::scene::limits::Limits;
use crate::scene::placement::PlacedBounds;
use crate::scene::segment::{Segment, UploadedScene};
use crate::struct_writer::StructWriter;
use glam::DVec3;
use rayon::prelude::*;
use std::ops::Range;
use surfel_model::{ClipPolicy, CloudData, Cull, NO_LABEL};
use surfel_render::{FramePlan, Identity, Pass, Region, SAMPLES_SIDE, View};
use surfel_shaders::layout;

/// Smallest number of polygons with which a tile is refused. Targets store the indices of polygons as f32, which is
/// exact below 2²⁴.
const MAX_POLYGONS: u32 = 1 << 24;

/// Data of one segment that a tile uploads, and of its splats that may touch the tile.
#[derive(Clone, Debug)]
pub struct SegmentData {
    /// Clip variant, which selects the pipelines that draw the segment.
    pub variant: Variant,
    /// True if the segment is drawn in transparent layers.
    pub is_transparent: bool,
    /// Words of the shaders' `chunks`, for all chunks of the segment. In the compute path, words of `cell_chunks`, of
    /// only the chunks that can touch the tile.
    pub chunks: Vec<u32>,
    /// Words of the shaders' `near_bits`, at least one.
    pub near_bits: Vec<u32>,
    /// True if no splat of the segment is drawn in the tile: each chunk is outside of the tile, facing away and culled,
    /// or not among the selected parts of its octree.
    pub is_outside: bool,
    /// Ranges of the segment's splats, and so of its records, to draw. They contain all splats of the chunks that can
    /// touch the tile, and few others between these chunks.
    pub runs: Vec<Range<u32>>,
    /// Depth of the origin of the farthest chunk that can touch the tile, in world units; 0 if none can. For splats
    /// that the application places, the largest depth of their bounding sphere.
    farthest: f64,
    /// Number of splats of the chunks that can touch the tile.
    splats: u64,
    /// Number of the compute path's workgroups that set up the segment: one per chunk that can touch the tile, or
    /// several if the segment is a single chunk because the application places its splats.
    groups: u32,
    /// Work that the CPU did to find this data.
    work: HostWork,
}

/// Counts of the CPU's work that grows with the number of splats of a scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct HostWork {
    /// Number of chunks that were tested against the view. A chunk has up to 256 splats or, if the application places
    /// them, all splats of a segment.
    pub chunks: u64,
    /// Number of splats that were visited one by one.
    pub splats: u64,
}

impl std::ops::AddAssign for HostWork {
    fn add_assign(&mut self, other: Self) {
        self.chunks += other.chunks;
        self.splats += other.splats;
    }
}

/// Splats that reach the near plane and are drawn by the same pipelines; at least one.
#[derive(Clone, Debug)]
pub struct NearRecords {
    /// Clip variant, which selects the pipelines that draw the splats.
    pub variant: Variant,
    /// True if the splats are drawn in transparent layers.
    pub is_transparent: bool,
    /// Words of the shaders' `records`.
    pub records: Vec<u32>,
    /// Copies of `records` for layers in which each splat is lit separately: they store the splat's centre in place of
    /// the unfiltered footprint. Empty if no layer needs them.
    pub lit: Vec<u32>,
    /// Words of the shaders' `record_clips`; empty unless the splats are clipped.
    pub clips: Vec<u32>,
    /// Identity of each splat: the index of its object, and the splat's index in the object's cloud.
    splats: Vec<[u32; 2]>,
}

impl NearRecords {
    /// Returns the number of records.
    pub fn count(&self) -> u32 {
        (self.records.len() / (layout::record::SIZE / 4)) as u32
    }

    /// Returns the range of all records, as a list of ranges like [`SegmentData::runs`].
    pub fn runs(&self) -> Vec<Range<u32>> {
        std::iter::once(0..self.count()).collect()
    }
}

/// Data of a tile in addition to the resident scene.
#[derive(Clone, Debug)]
pub struct TileData {
    /// Image region that the tile's textures (targets) cover: the tile and, for passes that read neighbouring pixels, a
    /// border.
    pub targets: Region,
    /// The tile itself, whose pixels are shaded.
    pub tile: Region,
    /// Words of the shaders' `frame`.
    pub frame: Vec<u32>,
    /// Data of each segment of the scene, in the scene's order.
    pub segments: Vec<SegmentData>,
    /// Splats that reach the near plane, grouped by the pipelines that draw them.
    pub near: Vec<NearRecords>,
    /// Words of the shaders' `polygons` that may touch the tile; one polygon of zeros if there are none.
    pub polygons: Vec<u32>,
    /// Number of polygons that may touch the tile.
    pub polygon_count: u32,
    /// Words of the shaders' `balls`, at least one.
    pub balls: Vec<u32>,
    /// Identity of each ball that may touch the tile: the index of its object among the scene's objects of balls, and
    /// the ball's index in the object's cloud.
    ball_members: Vec<[u32; 2]>,
    /// Trained Gaussians; `None` in frames of surfaces.
    pub gaussians: Option<GaussianLists>,
    /// Number of the tile's polygons that belong to each mesh.
    mesh_polygons: Vec<u32>,
    /// Layout of the planes that the tile's shading writes.
    pub planes: PlaneLayout,
    /// Cell counts for the compute path; `None` if raster hardware draws the tile.
    pub cells: Option<CellCounts>,
}

impl TileData {
    /// Returns the data of a tile that raster hardware draws.
    pub fn new(scene: &UploadedScene, frame: &FrameScene, view: &View, plan: &FramePlan, tile: Region) -> Self {
        Self::by(scene, frame, view, plan, tile, false)
    }

    /// Returns the data of a tile that the compute path draws.
    pub(crate) fn of_cells(
        scene: &UploadedScene,
        frame: &FrameScene,
        view: &View,
        plan: &FramePlan,
        tile: Region,
    ) -> Self {
        let mut data = Self::by(scene, frame, view, plan, tile, true);
        let mut cells = CellCounts {
            size: CellCounts::size_of([data.targets.width, data.targets.height]),
            near: data.near.iter().map(NearRecords::count).sum(),
            has_places: plan.planes.index || plan.has(Pass::RemainingLayer),
            has_clips: plan.clip != ClipPolicy::Off,
            has_sides: plan.keeps_facings,
            has_layers: has_layers(plan) && data.visible().has_transparent(),
            plane_floats: data.planes.buffer_floats,
            ..CellCounts::default()
        };
        for segment in &mut data.segments {
            let first = cells.all_chunks();
            for (group, chunk) in (first..).zip(segment.chunks.chunks_exact_mut(layout::cell_chunk::SIZE / 4)) {
                chunk[layout::cell_chunk::GROUP / 4] = group;
            }
            cells.chunks.push(segment.groups);
            cells.splats += segment.splats;
        }
        use layout::frame as at;
        let words = [
            // The compute path also has to tell apart transparent splats of which no layer is drawn.
            (at::HAS_LAYERS, u32::from(plan.separates_transparent)),
            (at::CELL_COLUMNS, cells.size[0]),
            (at::CELL_COUNT, cells.cells()),
            (at::CELL_CHUNK_COUNT, cells.all_chunks()),
            (at::CELL_GROUP_COUNT, cells.groups()),
        ];
        data.put_frame_words(&words);
        data.cells = Some(cells);
        data
    }

    /// Writes the capacity of the compute path's buffers to the tile's uniform.
    pub(crate) fn put_room(&mut self, room: CellCapacity) {
        use layout::frame as at;
        let Some(cells) = &self.cells else { return };
        let words = [
            (at::CELL_RECORD_ROOM, room.records),
            (at::CELL_BIN_PAIR_ROOM, room.bin_pairs),
            (at::CELL_PAIR_ROOM, room.pairs),
            (at::CELL_ACTIVE_ROOM, if cells.is_of_samples { room.active } else { 0 }),
            (at::CELL_HEADER, cells.header(room)),
        ];
        self.put_frame_words(&words);
    }

    /// Marks this tile as the n-th tile of samples, counted from 1, after the tile of pixels that its samples belong
    /// to. The compute path draws both. `plan` is that of the pixels.
    pub(crate) fn put_part(&mut self, n: u32, plan: &FramePlan) {
        self.put_frame_words(&[(layout::frame::CELL_PART, n)]);
        if let Some(cells) = &mut self.cells {
            (cells.is_of_samples, cells.has_layered_samples) = (true, has_layers(plan));
        }
    }

    /// Sets words of the tile's uniform, given as pairs of byte offset and word.
    fn put_frame_words(&mut self, words: &[(usize, u32)]) {
        for &(offset, value) in words {
            if let Some(word) = self.frame.get_mut(offset / 4) {
                *word = value;
            }
        }
    }

    /// Returns the data of a tile, for the compute path if `by_cells`, else for raster hardware.
    fn by(
        scene: &UploadedScene,
        frame: &FrameScene,
        view: &View,
        plan: &FramePlan,
        tile: Region,
        by_cells: bool,
    ) -> Self {
        let of_tile = if plan.has(Pass::Gaussians) { PlaneLayout::of_gaussians } else { PlaneLayout::new };
        let mut planes = of_tile(plan.planes, tile.width * tile.height);
        let targets = targets_of(tile, view, plan);
        if by_cells {
            planes = planes.with_cell_data(plan, [targets.width, targets.height]);
        }
        let setup = NearPlaneSetup { view, plan, tile: targets };
        let parts: Vec<(SegmentData, NearPlaneRecords)> =
            scene.segments.par_iter().map(|segment| segment_data(scene, frame, segment, &setup, by_cells)).collect();
        let of_meshes = match plan.has(Pass::Polygons) {
            true => polygon_words(&scene.meshes, &plan.octrees, view, targets, is_of_shadow_map(plan)),
            false => Vec::new(),
        };
        let polygons_in = |words: &[u32]| (words.len() / (layout::polygon::SIZE / 4)) as u32;
        let mesh_polygons: Vec<u32> = of_meshes.iter().map(|words| polygons_in(words)).collect();
        let (mut polygons, polygon_count) = (of_meshes.concat(), mesh_polygons.iter().sum());
        polygons.resize(polygons.len().max(layout::polygon::SIZE / 4), 0);
        let mut near: Vec<NearRecords> = Vec::new();
        let mut segments = Vec::with_capacity(parts.len());
        for (segment, own) in parts {
            let (variant, is_transparent) = (segment.variant, segment.is_transparent);
            segments.push(segment);
            if own.records.is_empty() {
                continue;
            }
            match near.iter_mut().find(|n| n.variant == variant && n.is_transparent == is_transparent) {
                Some(alike) => {
                    alike.records.extend(own.records);
                    alike.lit.extend(own.lit);
                    alike.clips.extend(own.clips);
                    alike.splats.extend(own.splats);
                }
                None => near.push(NearRecords {
                    variant,
                    is_transparent,
                    records: own.records,
                    lit: own.lit,
                    clips: own.clips,
                    splats: own.splats,
                }),
            }
        }
        let mut frame = frame_words(scene, frame, view, plan, &TileRegions { tile, targets }, &planes);
        let farthest = segments.iter().map(|segment| segment.farthest).fold(view.projection.near, f64::max);
        // The unit is a power of two within the range of f32, whatever the scene's scale.
        let unit = farthest.log2().round().clamp(-100.0, 100.0).exp2() as f32;
        for (offset, value) in [(layout::frame::DEPTH_UNIT, unit), (layout::frame::PER_DEPTH_UNIT, 1.0 / unit)] {
            if let Some(word) = frame.get_mut(offset / 4) {
                *word = value.to_bits();
            }
        }
        let balls = TileBalls::new(&scene.balls, view, plan, targets);
        let gaussians = None;
        Self {
            targets,
            tile,
            frame,
            segments,
            near,
            polygons,
            polygon_count,
            balls: balls.words,
            ball_members: balls.members,
            gaussians,
            mesh_polygons,
            planes,
            cells: None,
        }
    }

    /// Adds the lists of trained Gaussians to the tile's data.
    pub(crate) fn put_gaussians(&mut self, lists: GaussianLists) {
        let states_at = lists.states_at.unwrap_or(layout::ABSENT);
        for (offset, value) in
            [(layout::frame::GAUSSIAN_STATES_AT, states_at), (layout::frame::GAUSSIAN_ROOM, lists.room)]
        {
            if let Some(word) = self.frame.get_mut(offset / 4) {
                *word = value;
            }
        }
        self.gaussians = Some(lists);
    }

    /// Returns the width and height of the tile's textures (targets) in pixels. With edge samples, they are large
    /// enough for the samples of one pixel.
    pub fn target_size(&self, plan: &FramePlan) -> [u32; 2] {
        let least = if plan.has(Pass::EdgeSamples) { SAMPLES_SIDE } else { 1 };
        [self.targets.width.max(least), self.targets.height.max(least)]
    }

    /// Makes this tile a tile of samples, which writes the means of its samples to the planes of the tile `pixels`.
    /// `samples` is the region of this tile in samples.
    pub(crate) fn attach_to_pixel_tile(&mut self, pixels: &Self, samples: Region) {
        use layout::frame as at;
        let (tile, targets) = (pixels.tile, pixels.targets);
        let first = [samples.x / SAMPLES_SIDE - targets.x, samples.y / SAMPLES_SIDE - targets.y];
        let pairs = [
            (at::SHADE_ORIGIN_PX, [tile.x - targets.x, tile.y - targets.y]),
            (at::SHADE_SIZE_PX, [tile.width, tile.height]),
            (at::PIXELS_SIZE_PX, [targets.width, targets.height]),
            (at::FIRST_PIXEL, first),
        ];
        let planes = &pixels.planes;
        // Without transparent splats in view, the layers of the pixels aren't written.
        let has_layers = pixels.cells.as_ref().is_some_and(CellCounts::draws_layers);
        let numbers = [
            (at::SAMPLES_AT, planes.buffer_floats),
            (at::LAYERS_AT, if has_layers { planes.layers_at } else { layout::ABSENT }),
            (at::IS_OF_SAMPLES, 1),
            (at::COLOR_AT, planes.color_at),
            (at::SURFACES_AT, planes.surfaces_at),
            (at::EDGES_AT, planes.edges_at),
        ];
        let words = pairs.into_iter().flat_map(|(at, [x, y])| [(at, x), (at + 4, y)]).chain(numbers);
        for (offset, value) in words {
            if let Some(word) = self.frame.get_mut(offset / 4) {
                *word = value;
            }
        }
        self.planes = pixels.planes;
        self.cells.iter_mut().for_each(|cells| cells.plane_floats = planes.buffer_floats);
    }

    /// Checks that the buffers of the tile's polygons and balls fit the device's limits, and that there are fewer than
    /// 2²⁴ of each.
    ///
    /// # Errors
    /// A message that states the cause and a remedy, if they don't fit.
    pub fn check(&self, limits: Limits) -> Result<(), String> {
        let balls = 4 * self.balls.len() as u64;
        if balls > limits.buffer_bytes || self.ball_members.len() >= MAX_BALLS {
            let (count, most) = (self.ball_members.len(), limits.buffer_bytes);
            return Err(format!(
                "{count} balls in view need {balls} bytes, expected at most {most} and {MAX_BALLS} balls; render by \
                 `region`, or choose `backend=cpu`"
            ));
        }
        let bytes = 4 * self.polygons.len() as u64;
        if bytes <= limits.buffer_bytes && self.polygon_count < MAX_POLYGONS {
            return Ok(());
        }
        let (count, most) = (self.polygon_count, limits.buffer_bytes);
        Err(format!(
            "{count} polygons in view need {bytes} bytes, expected at most {most} and {MAX_POLYGONS} polygons; render \
             by `region`, or have the mesh converted to splats"
        ))
    }

    /// Replaces the background by a transparent one.
    pub fn clear_background(&mut self) {
        for at in [layout::frame::BACKGROUND, layout::frame::GAUSSIAN_BACKGROUND] {
            self.frame.iter_mut().skip(at / 4).take(4).for_each(|word| *word = 0);
        }
    }

    /// Sets how the depth buffer of the embedding application, into which the tile is composited, stores depths. It
    /// stores `offset` + `scale`/z for a perspective projection, and `offset` + `scale`·z for an orthographic one.
    pub fn set_host_depth(&mut self, offset: f32, scale: f32) {
        let at = layout::frame::HOST_DEPTH / 4;
        for (word, value) in self.frame.iter_mut().skip(at).zip([offset, scale]) {
            *word = value.to_bits();
        }
    }

    /// Returns the identity of the splat, ball or polygon with a draw number and a record number; [`Identity::NOTHING`]
    /// if there is none. An identity is object, row and label; a polygon has only an object.
    ///
    /// `draw` is the index of a segment, −2 for polygons, or −3 for balls. For splats that reach the near plane, it is
    /// the number of segments plus an index in [`TileData::near`]. `record` is the number of the record within the
    /// draw.
    pub fn identity(&self, scene: &UploadedScene, draw: i32, record: usize) -> Identity {
        let splat = |[object, i]: [u32; 2]| {
            let uploaded = scene.objects.get(object as usize)?;
            Some(identity_of(uploaded.cloud.data(), uploaded.source, i))
        };
        let found = match usize::try_from(draw) {
            Ok(draw) => match scene.segments.get(draw) {
                Some(segment) => segment.members.get(record).and_then(|&i| splat([segment.object, i])),
                None => self.near.get(draw - scene.segments.len()).and_then(|near| splat(*near.splats.get(record)?)),
            },
            Err(_) if draw == -3 => self.ball_members.get(record).and_then(|&[object, i]| {
                let uploaded = scene.balls.get(object as usize)?;
                Some(identity_of(uploaded.cloud.data(), uploaded.source, i))
            }),
            Err(_) => {
                let mut last = 0;
                let is_own = |count: &u32| {
                    last += *count;
                    (record as u32) < last
                };
                let mesh = self.mesh_polygons.iter().position(is_own).and_then(|mesh| scene.meshes.get(mesh));
                mesh.map(|mesh| Identity { object: mesh.source, ..Identity::NOTHING })
            }
        };
        found.unwrap_or(Identity::NOTHING)
    }

    /// Returns the identity (object, row and label) of a splat that the compute path drew: splat number `n` of the
    /// group of records number `group`. Groups are numbered segment by segment; those of splats that reach the near
    /// plane come last. [`Identity::NOTHING`] if there is none.
    pub fn cell_identity(&self, scene: &UploadedScene, group: i32, n: usize) -> Identity {
        let Ok(mut group) = usize::try_from(group) else { return Identity::NOTHING };
        let words = layout::cell_chunk::SIZE / 4;
        for (draw, segment) in (0..).zip(&self.segments) {
            let groups = segment.groups as usize;
            if group < groups {
                let is_placed = scene.segments.get(draw as usize).is_some_and(|segment| segment.placed.is_some());
                let first = if is_placed {
                    group * layout::CELL_WORKGROUP as usize
                } else {
                    let at = group * words + layout::cell_chunk::FIRST / 4;
                    segment.chunks.get(at).copied().unwrap_or(0) as usize
                };
                return self.identity(scene, draw, first + n);
            }
            group -= groups;
        }
        self.identity(scene, self.segments.len() as i32, group * layout::CELL_WORKGROUP as usize + n)
    }

    /// Returns the words of the shaders' `near_records` for the compute path: the records of all splats that reach the
    /// near plane, each followed by a zero and the view position of the splat's centre (zeros unless a layer is lit
    /// splat by splat). In frames that evaluate clips, the clips of the two footprints come next, or zeros if the splat
    /// has no clip. At least one word.
    pub fn cell_near_words(&self) -> Vec<u32> {
        let has_clips = self.cells.as_ref().is_some_and(|cells| cells.has_clips);
        let record_words = layout::record::SIZE / 4;
        let mut words = Vec::new();
        for near in &self.near {
            let mut clips = near.clips.chunks_exact(layout::clip::SIZE / 4);
            let mut lit = near.lit.chunks_exact(record_words);
            let is_clipped = has_clips && near.variant == Variant::Clipped;
            let clipped = if is_clipped { layout::RECORD_CLIPPED } else { 0 };
            let layered = if near.is_transparent { layout::RECORD_LAYERED } else { 0 };
            for record in near.records.chunks_exact(record_words) {
                let first = words.len();
                words.extend_from_slice(record);
                if let Some(flags) = words.get_mut(first + layout::record::FLAGS / 4) {
                    *flags |= clipped | layered;
                }
                let lit = lit.next().unwrap_or_default();
                words.push(0);
                words.extend(center_words(lit));
                if !has_clips {
                    continue;
                }
                for _ in 0..2 {
                    let clip = if is_clipped { clips.next() } else { None };
                    words.extend(clip.map_or([0; CELL_CLIP_WORDS], cell_clip_words));
                }
            }
        }
        // A buffer isn't empty.
        if words.is_empty() { vec![0] } else { words }
    }

    /// Returns the segments that may touch the tile, opaque and transparent ones apart.
    pub fn visible(&self) -> VisibleSegments {
        let inside = self.segments.iter().enumerate().filter(|(_, segment)| !segment.is_outside);
        let (transparent, opaque): (Vec<_>, Vec<_>) = inside.partition(|(_, segment)| segment.is_transparent);
        let indices = |found: Vec<(usize, &SegmentData)>| found.into_iter().map(|(i, _)| i).collect();
        let near_transparent = self.near.iter().any(|near| near.is_transparent);
        VisibleSegments { opaque: indices(opaque), transparent: indices(transparent), near_transparent }
    }

    /// Returns the number of records that the CPU has set up: splats that reach the near plane, balls and Gaussians.
    pub fn host_records(&self) -> u32 {
        let gaussians = self.gaussians.as_ref().map_or(0, |lists| lists.count);
        let balls = self.ball_members.len() as u32;
        self.near.iter().map(NearRecords::count).sum::<u32>() + gaussians + balls
    }

    /// Returns the work that the CPU did to find the tile's data, summed over all segments.
    pub fn host_work(&self) -> HostWork {
        let mut all = HostWork::default();
        self.segments.iter().for_each(|segment| all += segment.work);
        all
    }

    /// Returns the clip variants of the tile's splats. [`Variant::Whole`] is always included, so that every draw has a
    /// pipeline.
    pub fn variants(&self) -> Vec<Variant> {
        let seen = self.segments.iter().filter(|s| !s.is_outside).map(|s| s.variant);
        let clipped = seen.chain(self.near.iter().map(|n| n.variant)).any(|v| v == Variant::Clipped);
        if clipped { vec![Variant::Whole, Variant::Clipped] } else { vec![Variant::Whole] }
    }
}

/// Returns the words of the view position of a splat's centre from a record of [`NearRecords::lit`]; zeros if the
/// record is empty.
fn center_words(record: &[u32]) -> [u32; 3] {
    use layout::record::{VISIBLE_U, VISIBLE_V};
    [VISIBLE_U, VISIBLE_U + 4, VISIBLE_V].map(|at| record.get(at / 4).copied().unwrap_or(0))
}

/// Returns the identity of the splat with index `i` in the cloud of the scene's object number `object`. Without stored
/// rows its row is `i`, and without stored labels it has none.
fn identity_of(data: &CloudData, object: u32, i: u32) -> Identity {
    let of = |column: &Option<Vec<u32>>| column.as_ref()?.get(i as usize).copied();
    Identity { row: of(&data.rows).unwrap_or(i), object, label: of(&data.labels).unwrap_or(NO_LABEL) }
}

/// Largest gap between two runs of splats that are drawn together, in splats. Drawing the splats of the gap costs less
/// than another draw call.
const MAX_GAP: u32 = 1024;

/// Appends a run, or merges it with the last one if the gap between them is at most [`MAX_GAP`].
fn add_run(runs: &mut Vec<Range<u32>>, run: Range<u32>) {
    match runs.last_mut().filter(|last| run.start - last.end <= MAX_GAP) {
        Some(last) => last.end = run.end,
        None => runs.push(run),
    }
}

/// Returns the data of a segment in a tile, and the records of its splats that reach the near plane.
fn segment_data(
    scene: &UploadedScene,
    frame: &FrameScene,
    segment: &Segment,
    setup: &NearPlaneSetup<'_>,
    by_cells: bool,
) -> (SegmentData, NearPlaneRecords) {
    let variant = if setup.plan.clip == ClipPolicy::Off { Variant::Whole } else { segment.variant };
    let is_transparent = segment.is_transparent && setup.plan.separates_transparent;
    let (chunks, near_bits) = (Vec::new(), Vec::new());
    let mut data = SegmentData {
        variant,
        is_transparent,
        chunks,
        near_bits,
        is_outside: true,
        runs: Vec::new(),
        farthest: 0.0,
        splats: 0,
        groups: 0,
        work: HostWork::default(),
    };
    let mut near = NearPlaneRecords::default();
    let index = segment.object as usize;
    let (Some(object), Some(transform)) = (scene.objects.get(index), frame.transforms.get(index)) else {
        return (data, near);
    };
    let frustum = RegionFrustum::new(setup.tile, setup.view, setup.plan);
    if let Some(placed) = segment.placed {
        placed_data(&mut data, &placed.bounds, segment, transform, &frustum, by_cells);
        return (data, near);
    }
    let selection = object.octree.as_ref().and_then(|(index, _)| setup.plan.selection_of(*index));
    let chunk_bytes = if by_cells { layout::cell_chunk::SIZE } else { layout::chunk::SIZE };
    data.chunks.reserve(segment.chunks.len() * chunk_bytes / 4);
    data.work.chunks += segment.chunks.len() as u64;
    let culls_back = object.material.cull == Cull::Back && !is_of_shadow_map(setup.plan);
    for (number, chunk) in (0..).zip(&segment.chunks) {
        let center = transform.point(chunk.space.origin);
        let members = segment.members.get(chunk.first as usize..(chunk.first + chunk.count) as usize);
        let members = members.unwrap_or_default();
        // An octree's chunk is drawn as a whole or not at all, so its first splat decides.
        let is_drawn = selection.is_none_or(|chosen| members.first().is_some_and(|&splat| chosen.has_splat(splat)));
        let is_culled = frustum.is_outside(center, chunk.bounding_radius * transform.stretch)
            || (culls_back && is_back_facing(chunk, transform, setup.view));
        let state = if !is_drawn || is_culled {
            layout::CHUNK_OUTSIDE
        } else if may_reach_near(chunk, center, transform, setup.view) {
            let near_chunk = NearPlaneChunk {
                object,
                object_index: segment.object,
                transform,
                members,
                space: &chunk.space,
                storage: scene.storage,
                variant,
                is_transparent,
            };
            data.work.splats += members.len() as u64;
            let bits = setup.chunk(&near_chunk, &mut near);
            bits.map_or(layout::CHUNK_ORDINARY, |bits| {
                let start = data.near_bits.len() as u32;
                data.near_bits.extend(bits);
                start
            })
        } else {
            layout::CHUNK_ORDINARY
        };
        if state != layout::CHUNK_OUTSIDE {
            data.is_outside = false;
            add_run(&mut data.runs, chunk.first..chunk.first + chunk.count);
            data.farthest = data.farthest.max(center.z);
            data.splats += u64::from(chunk.count);
        } else if by_cells {
            continue;
        }
        data.groups += 1;
        put_chunk(&mut data.chunks, center, state, by_cells.then_some([chunk.first, chunk.count, number]));
    }
    if data.near_bits.is_empty() {
        data.near_bits.push(0);
    }
    (data, near)
}

/// Appends the words of a chunk: of the shaders' `Chunk` or, if `of_cells` gives the chunk's first splat, its number of
/// splats and its number in the segment, of their `CellChunk`. `center` is the view position of the chunk's origin, and
/// `state` the shaders' `Chunk.state`.
fn put_chunk(to: &mut Vec<u32>, center: DVec3, state: u32, of_cells: Option<[u32; 3]>) {
    let bytes = if of_cells.is_some() { layout::cell_chunk::SIZE } else { layout::chunk::SIZE };
    let mut words = StructWriter::after(std::mem::take(to), bytes);
    match of_cells {
        Some([first, count, number]) => {
            use layout::cell_chunk as at;
            words.vec3(at::CENTER, center).u32(at::STATE, state);
            words.u32(at::FIRST, first).u32(at::COUNT, count).u32(at::CHUNK, number);
        }
        None => {
            words.vec3(layout::chunk::CENTER, center).u32(layout::chunk::STATE, state);
        }
    }
    *to = words.into_words();
}

/// Fills in the data of a segment whose splats the application places: a single chunk about the object's origin, which
/// is culled as a whole by the application's box. The device leaves out splats that reach the near plane.
fn placed_data(
    data: &mut SegmentData,
    bounds: &PlacedBounds,
    segment: &Segment,
    transform: &ObjectTransform,
    frustum: &RegionFrustum,
    by_cells: bool,
) {
    let count = segment.members.len() as u32;
    let center = transform.point(bounds.center);
    data.near_bits.push(0);
    data.work.chunks += 1;
    let is_outside = frustum.is_outside(center, bounds.radius * transform.stretch);
    let state = if is_outside { layout::CHUNK_OUTSIDE } else { layout::CHUNK_ORDINARY };
    if !is_outside {
        data.is_outside = false;
        data.runs.push(0..count);
        data.farthest = center.z + bounds.radius * transform.stretch;
        data.splats = u64::from(count);
        data.groups = count.div_ceil(layout::CELL_WORKGROUP);
    } else if by_cells {
        return;
    }
    put_chunk(&mut data.chunks, transform.point(DVec3::ZERO), state, by_cells.then_some([0, count, 0]));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_hold_every_splat_that_was_added_and_skip_what_is_far_between() {
        let mut runs = Vec::new();
        for first in [0, 256, 1024, 4096, 4352, 100_000] {
            add_run(&mut runs, first..first + 256);
        }
        assert_eq!(runs, [0..1280, 4096..4608, 100_000..100_256]);
    }
}

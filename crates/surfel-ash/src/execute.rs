//! Recording of the steps of a tile. "To record" is to write GPU commands. A *record* is a splat as set up for a tile.
//! A *segment* is the part of an object's splats that shares a buffer ([`surfel_gpu::Segment`]).

use crate::commands::Commands;
use crate::descriptors::{Resource, Sets, numbered};
use crate::device::Device;
use crate::error::Failure;
use crate::memory::Buffer;
use crate::pipelines::{Pipeline, Pipelines};
use crate::queries::Queries;
use crate::scene::{ResidentScene, resident, resident_before};
use crate::targets::Targets;
use ash::vk;
use gpu_allocator::MemoryLocation;
use std::collections::HashMap;
use std::ops::Range;
use std::sync::Arc;
use surfel_gpu::{
    Draw, FrameScene, GAUSSIAN_BUFFERS, GaussianLists, LAYER_HEADER_BYTES, Layer, NearRecords, PIXEL_PASS_BUFFERS,
    PIXEL_PASS_TEXTURES, PixelPass, SETUP_STEPS_BINDING, Step, Sums, Target, TileData, Variant, layer_draw_offset,
    layer_draw_words, workgroups,
};
use surfel_shaders::layout;

/// Resources that the steps of a tile read, as descriptor sets and draw calls. They are dropped after the steps have
/// been executed.
pub(crate) struct Tile<'a> {
    scene: &'a ResidentScene,
    pipelines: &'a Pipelines,
    targets: &'a Targets,
    queries: &'a Queries,
    /// Descriptor set of the frame's uniform, objects, lights, shadow maps and matcap.
    frame: vk::DescriptorSet,
    /// Descriptor set of those of the frame's bindings that splat setup uses.
    setup_frame: vk::DescriptorSet,
    /// Descriptor set of each pixel pass.
    pixels: HashMap<PixelPass, vk::DescriptorSet>,
    /// Descriptor set of the targets and buffers that each draw reads in addition to the frame's and the records; none
    /// for draws that read no more.
    reads: HashMap<Draw, vk::DescriptorSet>,
    /// Size of the drawn part of the targets, in pixels.
    size: [u32; 2],
    /// Size of the shaded region, in pixels.
    shaded: [u32; 2],
    /// Descriptor sets of each segment of splats; `None` for segments that can't touch the tile.
    segments: Vec<Option<SegmentSets>>,
    /// Draw calls of splats that reach the near plane.
    near: Vec<RecordDraw>,
    /// Descriptor set of the polygons, and their number.
    polygons: (vk::DescriptorSet, u32),
    /// Buffer of a counter: the number of splats that the GPU has set up and that touch the tile.
    drawn: Buffer,
    /// Host-readable copy of `drawn`.
    pub drawn_readback: Buffer,
    /// Indirect draws of transparent layers; `None` if no pass of the tile draws such layers.
    layer_draws: Option<Buffer>,
    /// Host-readable copy of the header of `layer_draws`, which has the number of drawn layers.
    pub layers_readback: Option<Buffer>,
    /// Buffers that the descriptor sets refer to.
    _buffers: Vec<Buffer>,
    /// Pool of the descriptor sets.
    _sets: Sets,
}

/// Inputs from which a [`Tile`] is created.
#[derive(Clone, Copy)]
pub(crate) struct TileInputs<'a> {
    pub scene: &'a ResidentScene,
    pub pipelines: &'a Pipelines,
    pub targets: &'a Targets,
    pub queries: &'a Queries,
    pub frame: &'a FrameScene,
    pub data: &'a TileData,
    /// Pixel passes among the steps of the tile and of its samples.
    pub pixel_passes: &'a [PixelPass],
    /// Texels of the shadow maps that the tile reads.
    pub shadow_texels: &'a Buffer,
    /// Texels of the shadow maps that the tile writes.
    pub drawn_shadow_texels: &'a Buffer,
}

/// Descriptor sets of a segment of splats.
struct SegmentSets {
    /// Descriptor sets of setup. The first counts the splats that are drawn, the second doesn't, for repeated setups.
    setup: [vk::DescriptorSet; 2],
    /// Draw call of the segment's records.
    drawn: RecordDraw,
}

/// Draw call of some ranges of one buffer of records.
#[derive(Clone)]
struct RecordDraw {
    variant: Variant,
    is_transparent: bool,
    records: vk::DescriptorSet,
    /// Descriptor set that replaces `records` in passes that light each splat separately.
    lit: Option<vk::DescriptorSet>,
    /// Ranges of records to draw, in order. Transparent layers are drawn indirectly, with all records.
    runs: Vec<Range<u32>>,
    /// Index of this draw: segments of the scene come first, then elements of `data.near`. It is the number of the draw
    /// in the plane of nearest splats, and its place among the indirect draws of layers.
    index: usize,
}

/// Returns the images of the targets that a shader reads, with their binding numbers.
fn bound<'t>(targets: &'t Targets, reads: &[(u32, Target)]) -> Vec<(u32, Resource<'t>)> {
    targets.images(reads).into_iter().map(|(binding, image)| (binding, Resource::Image(image))).collect()
}

/// Creates the descriptor set of records, and of their clips if the variant has clips.
fn records_set(
    sets: &Sets,
    pipelines: &Pipelines,
    records: &Buffer,
    clips: Option<&Buffer>,
    variant: Variant,
) -> Result<vk::DescriptorSet, Failure> {
    let clips = clips.filter(|_| variant == Variant::Clipped);
    sets.set(&pipelines.splats(variant)?.records_set, "records", &numbered([records].into_iter().chain(clips)))
}

/// Creates the descriptor sets of each segment of splats; `None` for segments that can't touch the tile. The two
/// counters are buffers for the number of drawn splats. The first counts splats at their first setup in the tile, the
/// second at repeated setups. Buffers that the sets refer to are added to `buffers`.
fn segment_sets(
    device: &Arc<Device>,
    sets: &Sets,
    inputs: &TileInputs<'_>,
    counters: [&Buffer; 2],
    buffers: &mut Vec<Buffer>,
) -> Result<Vec<Option<SegmentSets>>, Failure> {
    let TileInputs { scene, pipelines, targets, data, .. } = *inputs;
    let storage = vk::BufferUsageFlags::STORAGE_BUFFER;
    let mut segments = Vec::with_capacity(scene.segments.len());
    for (index, (segment, data)) in scene.segments.iter().zip(&data.segments).enumerate() {
        if data.is_outside {
            segments.push(None);
            continue;
        }
        let chunks = Buffer::filled(device, "chunks", &data.chunks, storage)?;
        let near_bits = Buffer::filled(device, "near bits", &data.near_bits, storage)?;
        let setup = |counter| {
            let records = &*segment.records;
            let all = [&segment.uniform, &segment.splats, &chunks, &near_bits, &records.records, counter];
            let clips = records.clips.iter().filter(|_| data.variant == Variant::Clipped);
            let mut all = numbered(all.into_iter().chain(clips));
            all.extend(bound(targets, &[(SETUP_STEPS_BINDING, Target::Steps)]));
            sets.set(&pipelines.splats(data.variant)?.setup_set, "segment", &all)
        };
        let setup = [setup(counters[0])?, setup(counters[1])?];
        let (variant, is_transparent, runs) = (data.variant, data.is_transparent, data.runs.clone());
        let records = records_set(sets, pipelines, &segment.records.records, segment.records.clips.as_ref(), variant)?;
        let drawn = RecordDraw { variant, is_transparent, records, lit: None, runs, index };
        segments.push(Some(SegmentSets { setup, drawn }));
        buffers.extend([chunks, near_bits]);
    }
    Ok(segments)
}

/// Creates the draw calls of the splats that reach the near plane: one per element of `data.near`. Buffers that their
/// descriptor sets refer to are added to `buffers`.
fn near_draws(
    device: &Arc<Device>,
    sets: &Sets,
    inputs: &TileInputs<'_>,
    buffers: &mut Vec<Buffer>,
) -> Result<Vec<RecordDraw>, Failure> {
    let TileInputs { scene, pipelines, data, .. } = *inputs;
    let storage = vk::BufferUsageFlags::STORAGE_BUFFER;
    let mut near = Vec::with_capacity(data.near.len());
    for (i, of_variant) in data.near.iter().enumerate() {
        let clips = match of_variant.variant {
            Variant::Whole => None,
            Variant::Clipped => Some(Buffer::filled(device, "clips of near records", &of_variant.clips, storage)?),
        };
        let records = Buffer::filled(device, "near records", &of_variant.records, storage)?;
        let lit = match of_variant.lit.is_empty() {
            true => None,
            false => Some(Buffer::filled(device, "lit near records", &of_variant.lit, storage)?),
        };
        let (variant, is_transparent) = (of_variant.variant, of_variant.is_transparent);
        let set = |records| records_set(sets, pipelines, records, clips.as_ref(), variant);
        let lit_set = lit.as_ref().map(set).transpose()?;
        near.push(RecordDraw {
            variant,
            is_transparent,
            records: set(&records)?,
            lit: lit_set,
            runs: of_variant.runs(),
            index: scene.segments.len() + i,
        });
        buffers.extend([Some(records), lit, clips].into_iter().flatten());
    }
    Ok(near)
}

impl<'a> Tile<'a> {
    pub(crate) fn new(device: &Arc<Device>, inputs: &TileInputs<'a>) -> Result<Self, Failure> {
        let TileInputs { scene, pipelines, targets, queries, frame, data, pixel_passes, .. } = *inputs;
        let storage = vk::BufferUsageFlags::STORAGE_BUFFER;
        // Number of sets: three for frame, setup and polygons; one per draw and pixel pass; two per element of
        // `data.near`; three per segment.
        let draws = &targets.key.draws;
        let sets = Sets::new(
            device,
            (3 + draws.len() + pixel_passes.len() + 2 * data.near.len() + 3 * scene.segments.len()) as u32,
        )?;
        let mut buffers = Vec::new();
        let frame_buffers = frame_buffers(device, data, frame)?;
        let [uniform, objects, lights, maps, matcap] = &frame_buffers;
        let all = numbered([uniform, objects, lights, maps, inputs.shadow_texels, matcap]);
        let frame_set = sets.set(&pipelines.frame_set, "frame", &all)?;
        let setup_frame = sets.set(&pipelines.setup_frame_set, "frame of setup", &all)?;
        buffers.extend(frame_buffers);
        let counter = |name| Buffer::filled(device, name, &[0], storage | vk::BufferUsageFlags::TRANSFER_SRC);
        let (drawn, again) = (counter("drawn")?, counter("drawn again")?);
        let to_host = vk::BufferUsageFlags::TRANSFER_DST;
        let drawn_readback = Buffer::new(device, "drawn to read", 4, to_host, MemoryLocation::GpuToCpu)?;
        let bound = |reads: &[(u32, Target)]| bound(targets, reads);
        let segments = segment_sets(device, &sets, inputs, [&drawn, &again], &mut buffers)?;
        let near = near_draws(device, &sets, inputs, &mut buffers)?;
        buffers.push(again);
        let mut reads = HashMap::new();
        for &draw in draws.iter().filter(|draw| draw.has_reads() && !draw.binds_as_pixel_pass()) {
            let layout = &pipelines.draw(draw, Variant::Whole, targets.key.precision)?.reads_set;
            let mut all = bound(draw.reads());
            all.extend(
                draw.layer_composites_binding().map(|binding| (binding, Resource::Buffer(&targets.layer_composites))),
            );
            reads.insert(draw, sets.set(layout, draw.name(), &all)?);
        }
        let polygons = Buffer::filled(device, "polygons", &data.polygons, storage)?;
        let polygons_set = sets.set(&pipelines.polygons_set, "polygons", &numbered([&polygons]))?;
        let balls = Buffer::filled(device, "balls", &data.balls, storage)?;
        let (mut layer_draws, mut layers_readback) = (None, None);
        if draws.iter().any(|draw| draw.is_transparent()) {
            let near = data.near.iter().map(NearRecords::count);
            let words = layer_draw_words(scene.segments.iter().map(|segment| segment.count).chain(near));
            let usage = vk::BufferUsageFlags::INDIRECT_BUFFER | vk::BufferUsageFlags::TRANSFER_SRC | storage;
            layer_draws = Some(Buffer::filled(device, "draws of layers", &words, usage)?);
            let location = MemoryLocation::GpuToCpu;
            layers_readback = Some(Buffer::new(device, "layers to read", LAYER_HEADER_BYTES, to_host, location)?);
        }
        let bound_draws = layer_draws.as_ref().unwrap_or(&drawn);
        let layer_composites = &targets.layer_composites;
        let others = [
            &targets.planes,
            &polygons,
            &scene.texels,
            layer_composites,
            layer_composites,
            inputs.drawn_shadow_texels,
            bound_draws,
            &balls,
        ];
        let mut all = bound(&PIXEL_PASS_TEXTURES);
        all.extend(PIXEL_PASS_BUFFERS.into_iter().zip(others.map(Resource::Buffer)));
        let of_gaussians = match &data.gaussians {
            Some(GaussianLists { records, lists, room_bytes, .. }) => {
                let lists = resident_before(device, "lists of Gaussians", lists, *room_bytes)?;
                vec![resident(device, "Gaussians", records)?, lists]
            }
            None => Vec::new(),
        };
        all.extend(GAUSSIAN_BUFFERS.into_iter().zip(of_gaussians.iter().map(Resource::Buffer)));
        let mut pixel_sets = HashMap::new();
        for &pass in pixel_passes {
            pixel_sets.insert(pass, sets.set(&pipelines.pixels(pass)?.set, pass.entry(), &all)?);
        }
        for &draw in draws.iter().filter(|draw| draw.binds_as_pixel_pass()) {
            let layout = &pipelines.draw(draw, Variant::Whole, targets.key.precision)?.reads_set;
            reads.insert(draw, sets.set(layout, draw.name(), &all)?);
        }
        buffers.extend([polygons, balls]);
        buffers.extend(of_gaussians);
        Ok(Self {
            scene,
            pipelines,
            targets,
            queries,
            frame: frame_set,
            setup_frame,
            pixels: pixel_sets,
            reads,
            size: [data.targets.width, data.targets.height],
            shaded: [data.tile.width, data.tile.height],
            segments,
            near,
            polygons: (polygons_set, data.polygon_count),
            drawn,
            drawn_readback,
            layer_draws,
            layers_readback,
            _buffers: buffers,
            _sets: sets,
        })
    }

    /// Records all steps of the tile, the steps of its samples, and copies of the data that the host reads. `samples`
    /// are the parts of the samples, with their steps.
    pub(crate) fn record(
        &self,
        commands: &Commands<'_>,
        steps: &[Step],
        samples: &[(Self, &[Step])],
    ) -> Result<(), Failure> {
        self.queries.begin(commands);
        self.steps(commands, steps)?;
        self.queries.end(commands);
        if let Some((first, _)) = samples.first() {
            first.queries.begin(commands);
            samples.iter().try_for_each(|(part, steps)| part.steps(commands, steps))?;
            first.queries.end(commands);
        }
        let floats = u64::from(self.targets.key.floats);
        commands.copy(self.targets.planes.raw(), self.targets.readback.raw(), 4 * floats.max(1));
        commands.copy(self.drawn.raw(), self.drawn_readback.raw(), 4);
        for tile in std::iter::once(self).chain(samples.iter().map(|part| &part.0)) {
            if let (Some(draws), Some(readback)) = (&tile.layer_draws, &tile.layers_readback) {
                commands.copy(draws.raw(), readback.raw(), LAYER_HEADER_BYTES);
            }
        }
        commands.barrier_to_host();
        Ok(())
    }

    /// Records the tile's steps, the pass over trained Gaussians, `times` times again, and a copy of the planes.
    pub(crate) fn dispatch_again(&self, commands: &Commands<'_>, steps: &[Step], times: u32) -> Result<(), Failure> {
        for step in (0..times).flat_map(|_| steps) {
            self.step(commands, step)?;
            commands.barrier();
        }
        let bytes = 4 * u64::from(self.targets.key.floats);
        commands.copy(self.targets.planes.raw(), self.targets.readback.raw(), bytes);
        commands.barrier_to_host();
        Ok(())
    }

    /// Records steps with barriers and queries of their times.
    fn steps(&self, commands: &Commands<'_>, steps: &[Step]) -> Result<(), Failure> {
        for step in steps {
            self.queries.timed(commands, step.name(), || self.step(commands, step))?;
            commands.barrier();
        }
        Ok(())
    }

    /// Records a step.
    fn step(&self, commands: &Commands<'_>, step: &Step) -> Result<(), Failure> {
        match step {
            Step::Setup { segments, first } => {
                for &i in segments {
                    let (Some(segment), Some(Some(sets))) = (self.scene.segments.get(i), self.segments.get(i)) else {
                        continue;
                    };
                    let pipeline = &self.pipelines.splats(sets.drawn.variant)?.setup;
                    bind_pipeline(commands, pipeline, vk::PipelineBindPoint::COMPUTE);
                    let [counted, uncounted] = sets.setup;
                    let sets = [self.setup_frame, if *first { counted } else { uncounted }];
                    bind_sets(commands, pipeline, vk::PipelineBindPoint::COMPUTE, &sets);
                    dispatch(commands, [workgroups(segment.count, "setup", 0), 1]);
                }
                Ok(())
            }
            Step::Draw { draw, segments, first } => self.draw(commands, *draw, segments, *first),
            Step::PixelPass(pixels) => {
                let pipeline = &self.pipelines.pixels(*pixels)?.pipeline;
                let missing = || Failure::other("a pixel pass was recorded that was not prepared");
                let set = *self.pixels.get(pixels).ok_or_else(missing)?;
                bind_pipeline(commands, pipeline, vk::PipelineBindPoint::COMPUTE);
                bind_sets(commands, pipeline, vk::PipelineBindPoint::COMPUTE, &[self.frame, set]);
                let [width, height] = pixels.size(self.size, self.shaded);
                dispatch(commands, [workgroups(width, "shade", 0), workgroups(height, "shade", 1)]);
                Ok(())
            }
        }
    }

    /// Records a render pass. `first` is true for the first step of this pass in the tile, which clears its targets.
    fn draw(&self, commands: &Commands<'_>, draw: Draw, segments: &[usize], first: bool) -> Result<(), Failure> {
        let vulkan = &commands.device.raw;
        let pass = &self.pipelines.draw(draw, Variant::Whole, self.targets.key.precision)?.pass;
        // Lookups that can fail come before the render pass begins, because a render pass that began has to end.
        let segments = segments.iter().filter_map(|&i| Some(&self.segments.get(i)?.as_ref()?.drawn));
        // Splats that reach the near plane belong to no segment. They are drawn in the first step of each pass. Draws
        // without records have no pipeline for clipped splats.
        let takes_near = first && draw.draws_records();
        let records: Vec<&RecordDraw> = segments
            .chain(self.near.iter().filter(|near| takes_near && near.is_transparent == draw.is_transparent()))
            .collect();
        let mut variants = HashMap::new();
        for variant in records.iter().map(|drawn| drawn.variant).chain([Variant::Whole]) {
            variants.insert(variant, &self.pipelines.draw(draw, variant, self.targets.key.precision)?.pipeline);
        }
        let [width, height] = self.size;
        let area = vk::Rect2D { offset: vk::Offset2D::default(), extent: vk::Extent2D { width, height } };
        let clear_values = pass.clear_values();
        let info = vk::RenderPassBeginInfo::default()
            .render_pass(pass.raw(first))
            .framebuffer(self.targets.framebuffer(draw)?)
            .render_area(area)
            .clear_values(&clear_values);
        // SAFETY: pass and framebuffer are compatible, the images are in the pass's initial layouts; it is ended below.
        unsafe { vulkan.cmd_begin_render_pass(commands.raw, &info, vk::SubpassContents::INLINE) };
        // Clip space has y up, as in WebGPU, so the viewport flips y.
        let (width, height) = (width as f32, height as f32);
        let viewport = vk::Viewport { x: 0.0, y: height, width, height: -height, min_depth: 0.0, max_depth: 1.0 };
        // SAFETY: Vulkan 1.1 takes viewports of negative height; the pipeline's viewport is dynamic.
        unsafe { vulkan.cmd_set_viewport(commands.raw, 0, &[viewport]) };
        // SAFETY: inside of the framebuffer; the pipeline's scissor is dynamic.
        unsafe { vulkan.cmd_set_scissor(commands.raw, 0, &[area]) };
        let reads = self.reads.get(&draw).copied();
        let bind = |pipeline: &Pipeline, records: Option<vk::DescriptorSet>| {
            let sets: Vec<vk::DescriptorSet> = [Some(self.frame), records, reads].into_iter().flatten().collect();
            bind_pipeline(commands, pipeline, vk::PipelineBindPoint::GRAPHICS);
            bind_sets(commands, pipeline, vk::PipelineBindPoint::GRAPHICS, &sets);
        };
        let strip = |vertices: Range<u32>, run: Range<u32>| {
            let (count, instances) = (vertices.len() as u32, run.len() as u32);
            // SAFETY: pipeline, sets, viewport and scissor are set; where records are drawn, those of the run exist.
            unsafe { vulkan.cmd_draw(commands.raw, count, instances, vertices.start, run.start) };
        };
        let quads = || {
            for drawn in &records {
                let Some(pipeline) = variants.get(&drawn.variant) else { continue };
                let records = drawn.lit.filter(|_| draw.is_lit()).unwrap_or(drawn.records);
                bind(pipeline, Some(records));
                let Some(draws) = self.layer_draws.as_ref().filter(|_| draw.is_transparent()) else {
                    drawn.runs.iter().for_each(|run| strip(Draw::quad(drawn.index), run.clone()));
                    continue;
                };
                let (at, stride) = (layer_draw_offset(drawn.index), layout::draw_arguments::SIZE as u32);
                // SAFETY: pipeline, sets, viewport and scissor are set; the buffer has the usage and the arguments of
                // this draw, of no more records than there are.
                unsafe { vulkan.cmd_draw_indirect(commands.raw, draws.raw(), at, 1, stride) };
            }
        };
        match (draw, variants.get(&Variant::Whole)) {
            (Draw::Sums(layer, Sums::Color | Sums::Surface), _) if layer != Layer::EdgeBackground => {
                self.queries.counted(commands, quads);
            }
            (Draw::Edges | Draw::Steps | Draw::Probe(_), Some(pipeline)) => {
                bind(pipeline, None);
                strip(0..3, 0..draw.triangles());
            }
            (Draw::Polygons, Some(pipeline)) => {
                bind(pipeline, Some(self.polygons.0));
                strip(0..4, 0..self.polygons.1);
            }
            _ => quads(),
        }
        // SAFETY: begun above.
        unsafe { vulkan.cmd_end_render_pass(commands.raw) };
        Ok(())
    }
}

/// Records the binding of a pipeline.
pub(crate) fn bind_pipeline(commands: &Commands<'_>, pipeline: &Pipeline, point: vk::PipelineBindPoint) {
    // SAFETY: the pipeline is of that bind point and outlives the submission.
    unsafe { commands.device.raw.cmd_bind_pipeline(commands.raw, point, pipeline.raw.raw) };
}

/// Records the binding of descriptor sets, numbered from 0, for a pipeline.
pub(crate) fn bind_sets(
    commands: &Commands<'_>,
    pipeline: &Pipeline,
    point: vk::PipelineBindPoint,
    sets: &[vk::DescriptorSet],
) {
    let layout = pipeline.layout.raw;
    // SAFETY: the sets were made with the layouts that the pipeline's is made of, from set 0 on.
    unsafe { commands.device.raw.cmd_bind_descriptor_sets(commands.raw, point, layout, 0, sets, &[]) };
}

/// Records a dispatch of `x`×`y` workgroups.
pub(crate) fn dispatch(commands: &Commands<'_>, [x, y]: [u32; 2]) {
    // SAFETY: a compute pipeline and its sets are bound; every device supports 65535 groups an axis, and a segment or a
    // tile has fewer.
    unsafe { commands.device.raw.cmd_dispatch(commands.raw, x, y, 1) };
}

/// Creates the buffers of the frame's descriptor set, in the order of their bindings, excluding the texels of shadow
/// maps.
pub(crate) fn frame_buffers(device: &Arc<Device>, data: &TileData, frame: &FrameScene) -> Result<[Buffer; 5], Failure> {
    let storage = vk::BufferUsageFlags::STORAGE_BUFFER;
    Ok([
        Buffer::filled(device, "frame", &data.frame, vk::BufferUsageFlags::UNIFORM_BUFFER)?,
        Buffer::filled(device, "objects", &frame.objects, storage)?,
        Buffer::filled(device, "lights", &frame.lights, storage)?,
        Buffer::filled(device, "shadow maps", &frame.shadow_maps, storage)?,
        Buffer::filled(device, "matcap", &frame.matcap, storage)?,
    ])
}

//! Records a tile's steps.

use crate::commands::Commands;
use crate::descriptors::{Resource, Sets};
use crate::device::Device;
use crate::error::Failure;
use crate::memory::Buffer;
use crate::pipelines::{Pipeline, Pipelines};
use crate::queries::Queries;
use crate::scene::{Records, ResidentScene};
use crate::targets::Targets;
use ash::vk;
use gpu_allocator::MemoryLocation;
use std::collections::HashMap;
use std::sync::Arc;
use surfel_gpu::{Draw, FrameScene, Layer, SHADE_READS, Step, Sums, TileData, Variant, groups};

/// Everything that the steps of a tile read. Dropped after they were executed.
pub(crate) struct Tile<'a> {
    scene: &'a ResidentScene,
    pipelines: &'a Pipelines,
    targets: &'a Targets,
    queries: &'a Queries,
    frame: vk::DescriptorSet,
    shade: vk::DescriptorSet,
    /// What draws read.
    reads: HashMap<Draw, vk::DescriptorSet>,
    /// Size of what is shaded.
    shaded: [u32; 2],
    segments: Vec<Option<SegmentSets>>,
    near: Vec<Drawn>,
    polygons: (vk::DescriptorSet, u32),
    /// Splats that were set up and touch the tile, and where the host reads it.
    drawn: Buffer,
    pub drawn_readback: Buffer,
    /// What the sets refer to, and the sets' pool.
    _buffers: Vec<Buffer>,
    _sets: Sets,
}

struct SegmentSets {
    /// For counting and for uncounted setup.
    setup: [vk::DescriptorSet; 2],
    drawn: Drawn,
}

/// Records to be drawn.
#[derive(Clone, Copy)]
struct Drawn {
    variant: Variant,
    records: vk::DescriptorSet,
    count: u32,
}

impl<'a> Tile<'a> {
    pub(crate) fn new(
        device: &Arc<Device>,
        (scene, pipelines, targets, queries): (&'a ResidentScene, &'a Pipelines, &'a Targets, &'a Queries),
        frame: &FrameScene,
        data: &TileData,
    ) -> Result<Self, Failure> {
        let storage = vk::BufferUsageFlags::STORAGE_BUFFER;
        // Frame, sums and polygons; one of each draw and each group of near records; three of each segment.
        let draws = &targets.key.draws;
        let sets = Sets::new(device, (3 + draws.len() + data.near.len() + 3 * scene.segments.len()) as u32)?;
        let mut buffers = Vec::new();
        let frame_buffers = [
            Buffer::filled(device, "frame", &data.frame, vk::BufferUsageFlags::UNIFORM_BUFFER)?,
            Buffer::filled(device, "objects", &frame.objects, storage)?,
            Buffer::filled(device, "lights", &frame.lights, storage)?,
        ];
        let frame_set = sets.set(&pipelines.frame_set, "frame", &frame_buffers.each_ref().map(Resource::Buffer))?;
        buffers.extend(frame_buffers);
        let counter = |name| Buffer::filled(device, name, &[0], storage | vk::BufferUsageFlags::TRANSFER_SRC);
        let (drawn, again) = (counter("drawn")?, counter("drawn again")?);
        let to_host = vk::BufferUsageFlags::TRANSFER_DST;
        let drawn_readback = Buffer::new(device, "drawn to read", 4, to_host, MemoryLocation::GpuToCpu)?;
        let records_set = |records: &Records, variant: Variant, count| -> Result<Drawn, Failure> {
            let clips = records.clips.iter().filter(|_| variant == Variant::Clipped);
            let all: Vec<Resource<'_>> = [&records.records].into_iter().chain(clips).map(Resource::Buffer).collect();
            Ok(Drawn { variant, records: sets.set(&pipelines.splats(variant)?.records_set, "records", &all)?, count })
        };
        let mut segments = Vec::with_capacity(scene.segments.len());
        for (segment, data) in scene.segments.iter().zip(&data.segments) {
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
                let all: Vec<Resource<'_>> = all.into_iter().chain(clips).map(Resource::Buffer).collect();
                sets.set(&pipelines.splats(data.variant)?.setup_set, "segment", &all)
            };
            let setup = [setup(&drawn)?, setup(&again)?];
            let drawn = records_set(&segment.records, data.variant, segment.count)?;
            segments.push(Some(SegmentSets { setup, drawn }));
            buffers.extend([chunks, near_bits]);
        }
        let mut near = Vec::with_capacity(data.near.len());
        for of_variant in &data.near {
            let clips = match of_variant.variant {
                Variant::Whole => None,
                Variant::Clipped => Some(Buffer::filled(device, "clips of near records", &of_variant.clips, storage)?),
            };
            let records = Buffer::filled(device, "near records", &of_variant.records, storage)?;
            let records = Records { records, clips };
            near.push(records_set(&records, of_variant.variant, of_variant.count())?);
            buffers.extend([Some(records.records), records.clips].into_iter().flatten());
        }
        buffers.push(again);
        let bound = |reads| -> Vec<(u32, Resource<'_>)> {
            targets.images(reads).into_iter().map(|(binding, image)| (binding, Resource::Image(image))).collect()
        };
        let only = |bound: &[(u32, Resource<'a>)]| -> Vec<Resource<'a>> { bound.iter().map(|entry| entry.1).collect() };
        let mut reads = HashMap::new();
        for &draw in draws.iter().filter(|draw| !draw.reads().is_empty()) {
            let layout = &pipelines.draw(draw, Variant::Whole, targets.key.precision)?.reads_set;
            reads.insert(draw, sets.set(layout, draw.name(), &only(&bound(draw.reads())))?);
        }
        let polygons = Buffer::filled(device, "polygons", &data.polygons, storage)?;
        let polygons_set = sets.set(&pipelines.polygons_set, "polygons", &[Resource::Buffer(&polygons)])?;
        let mut shade = bound(&SHADE_READS);
        // The bindings that the images leave free.
        let others = [(4, &targets.planes), (12, &polygons), (13, &scene.texels)];
        shade.extend(others.map(|(binding, buffer)| (binding, Resource::Buffer(buffer))));
        shade.sort_by_key(|entry| entry.0);
        let shade = sets.set(&pipelines.shade_set, "sums", &shade.iter().map(|entry| entry.1).collect::<Vec<_>>())?;
        buffers.push(polygons);
        Ok(Self {
            scene,
            pipelines,
            targets,
            queries,
            frame: frame_set,
            shade,
            reads,
            shaded: data.shaded,
            segments,
            near,
            polygons: (polygons_set, data.polygon_count),
            drawn,
            drawn_readback,
            _buffers: buffers,
            _sets: sets,
        })
    }

    /// Records all steps and what the host reads of them.
    pub(crate) fn record(&self, commands: &Commands<'_>, steps: &[Step]) -> Result<(), Failure> {
        self.queries.begin(commands);
        for step in steps {
            self.queries.timed(commands, step.name(), || self.step(commands, step))?;
            commands.barrier();
        }
        self.queries.end(commands);
        let floats = u64::from(self.targets.key.floats);
        commands.copy(self.targets.planes.raw(), self.targets.readback.raw(), 4 * floats.max(1));
        commands.copy(self.drawn.raw(), self.drawn_readback.raw(), 4);
        commands.barrier_to_host();
        Ok(())
    }

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
                    let sets = [self.frame, if *first { counted } else { uncounted }];
                    bind_sets(commands, pipeline, vk::PipelineBindPoint::COMPUTE, &sets);
                    dispatch(commands, [groups(segment.count, "setup", 0), 1]);
                }
                Ok(())
            }
            Step::Draw { draw, segments, first } => self.draw(commands, *draw, segments, *first),
            Step::Shade => {
                let pipeline = &self.pipelines.shade;
                bind_pipeline(commands, pipeline, vk::PipelineBindPoint::COMPUTE);
                bind_sets(commands, pipeline, vk::PipelineBindPoint::COMPUTE, &[self.frame, self.shade]);
                let [width, height] = self.shaded;
                dispatch(commands, [groups(width, "shade", 0), groups(height, "shade", 1)]);
                Ok(())
            }
        }
    }

    fn draw(&self, commands: &Commands<'_>, draw: Draw, segments: &[usize], first: bool) -> Result<(), Failure> {
        let vulkan = &commands.device.raw;
        let pass = &self.pipelines.draw(draw, Variant::Whole, self.targets.key.precision)?.pass;
        // Looked up before the render pass begins, which must end whatever happens.
        let segments = segments.iter().filter_map(|&i| Some(self.segments.get(i)?.as_ref()?.drawn));
        // The near splats have no segment: they go with the first.
        let records: Vec<Drawn> = segments.chain(self.near.iter().copied().filter(|_| first)).collect();
        let mut variants = HashMap::new();
        for variant in records.iter().map(|drawn| drawn.variant).chain([Variant::Whole]) {
            variants.insert(variant, &self.pipelines.draw(draw, variant, self.targets.key.precision)?.pipeline);
        }
        let [width, height] = self.targets.key.size;
        let area = vk::Rect2D { offset: vk::Offset2D::default(), extent: vk::Extent2D { width, height } };
        let clear_values = pass.clear_values();
        let info = vk::RenderPassBeginInfo::default()
            .render_pass(pass.raw(first))
            .framebuffer(self.targets.framebuffer(draw)?)
            .render_area(area)
            .clear_values(&clear_values);
        // SAFETY: pass and framebuffer are compatible, the images are in the pass's initial layouts; it is ended below.
        unsafe { vulkan.cmd_begin_render_pass(commands.raw, &info, vk::SubpassContents::INLINE) };
        // Clip space has y up, as in WebGPU: the viewport turns it over.
        let (width, height) = (width as f32, height as f32);
        let viewport = vk::Viewport { x: 0.0, y: height, width, height: -height, min_depth: 0.0, max_depth: 1.0 };
        // SAFETY: Vulkan 1.1 takes viewports of negative height; the pipeline's viewport is dynamic.
        unsafe { vulkan.cmd_set_viewport(commands.raw, 0, &[viewport]) };
        // SAFETY: inside of the framebuffer; the pipeline's scissor is dynamic.
        unsafe { vulkan.cmd_set_scissor(commands.raw, 0, &[area]) };
        let reads = self.reads.get(&draw).copied();
        let strip = |pipeline: &Pipeline, records: Option<vk::DescriptorSet>, vertices: u32, count: u32| {
            let sets: Vec<vk::DescriptorSet> = [Some(self.frame), records, reads].into_iter().flatten().collect();
            bind_pipeline(commands, pipeline, vk::PipelineBindPoint::GRAPHICS);
            bind_sets(commands, pipeline, vk::PipelineBindPoint::GRAPHICS, &sets);
            // SAFETY: pipeline, sets, viewport and scissor are set; there are `count` records where records are drawn.
            unsafe { vulkan.cmd_draw(commands.raw, vertices, count, 0, 0) };
        };
        let quads = || {
            for drawn in &records {
                if let Some(pipeline) = variants.get(&drawn.variant) {
                    strip(pipeline, Some(drawn.records), 4, drawn.count);
                }
            }
        };
        match (draw, variants.get(&Variant::Whole)) {
            (Draw::Sums(Layer::Front | Layer::Among, Sums::Color | Sums::Surface), _) => {
                self.queries.counted(commands, quads);
            }
            (Draw::Edges, Some(pipeline)) => strip(pipeline, None, 3, 1),
            (Draw::Polygons, Some(pipeline)) => strip(pipeline, Some(self.polygons.0), 4, self.polygons.1),
            _ => quads(),
        }
        // SAFETY: begun above.
        unsafe { vulkan.cmd_end_render_pass(commands.raw) };
        Ok(())
    }
}

fn bind_pipeline(commands: &Commands<'_>, pipeline: &Pipeline, point: vk::PipelineBindPoint) {
    // SAFETY: the pipeline is of that bind point and outlives the submission.
    unsafe { commands.device.raw.cmd_bind_pipeline(commands.raw, point, pipeline.raw.raw) };
}

fn bind_sets(commands: &Commands<'_>, pipeline: &Pipeline, point: vk::PipelineBindPoint, sets: &[vk::DescriptorSet]) {
    let layout = pipeline.layout.raw;
    // SAFETY: the sets were made with the layouts that the pipeline's is made of, from set 0 on.
    unsafe { commands.device.raw.cmd_bind_descriptor_sets(commands.raw, point, layout, 0, sets, &[]) };
}

fn dispatch(commands: &Commands<'_>, [x, y]: [u32; 2]) {
    // SAFETY: a compute pipeline and its sets are bound; every device takes 65535 groups an axis, and a segment or a tile
    // has fewer.
    unsafe { commands.device.raw.cmd_dispatch(commands.raw, x, y, 1) };
}

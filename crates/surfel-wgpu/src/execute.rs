//! Recording of the steps of a tile. "To record" is to write GPU commands. A *record* is a splat as set up for a tile.
//! A *segment* is the part of an object's splats that shares a buffer ([`surfel_gpu::Segment`]).

use crate::host_target::HostTarget;
use crate::pipelines::{HostKey, Part, Pipelines};
use crate::queries::{Queries, Query};
use crate::queue::Queue;
use crate::scene::{Records, ResidentScene, bind, bind_some, bind_with, filled, filled_before};
use crate::targets::Targets;
use std::collections::HashMap;
use std::ops::Range;
use surfel_gpu::{
    Draw, FrameScene, GAUSSIAN_BUFFERS, GaussianLists, HOST_DEPTH_BINDING, HOST_PLANES_BINDING, NearRecords,
    PIXEL_PASS_BUFFERS, PIXEL_PASS_TEXTURES, PixelPass, SETUP_STEPS_BINDING, Step, Target, TileData, Variant,
    binding_slots, layer_draw_offset, layer_draw_words, workgroups,
};

/// Resources that the steps of a tile read, as bind groups and draw calls.
pub(crate) struct Tile<'a> {
    pub scene: &'a ResidentScene,
    pub pipelines: &'a Pipelines,
    pub targets: &'a Targets,
    frame_group: wgpu::BindGroup,
    setup_frame_group: wgpu::BindGroup,
    /// Bind groups of each segment; `None` for segments that can't touch the tile.
    segments: Vec<Option<SegmentGroups>>,
    /// Draw calls of splats that reach the near plane.
    near: Vec<RecordDraw>,
    /// Bind group of the polygons.
    polygons_group: wgpu::BindGroup,
    /// Number of polygons.
    polygon_count: u32,
    /// Bind group of each pixel pass.
    pixels: HashMap<PixelPass, wgpu::BindGroup>,
    /// Bind group for compositing sums and layers into the application's render target.
    composite_group: wgpu::BindGroup,
    /// Bind group for compositing the planes into the application's render target.
    host_planes_group: wgpu::BindGroup,
    /// Bind group of the pass that binds the same group as a pixel pass ([`Draw::binds_as_pixel_pass`]), if the tile
    /// has one.
    steps_group: Option<wgpu::BindGroup>,
    /// Size of the drawn part of the targets, in pixels.
    size: [u32; 2],
    /// Size of the shaded region, in pixels.
    shaded: [u32; 2],
    /// Buffer with the number of splats that the GPU has set up and that touch the tile.
    pub drawn: wgpu::Buffer,
    /// Indirect draws of transparent layers; `None` if no pass of the tile draws such layers.
    pub layer_draws: Option<wgpu::Buffer>,
}

/// Inputs from which a [`Tile`] is created.
#[derive(Clone, Copy)]
pub(crate) struct TileInputs<'a> {
    pub scene: &'a ResidentScene,
    pub pipelines: &'a Pipelines,
    pub targets: &'a Targets,
    pub frame: &'a FrameScene,
    pub data: &'a TileData,
    /// Pixel passes among the steps of the tile and of its samples.
    pub pixel_passes: &'a [PixelPass],
    /// Texels of the shadow maps that the tile reads.
    pub shadow_texels: &'a wgpu::Buffer,
    /// Texels of the shadow maps that the tile writes.
    pub drawn_shadow_texels: &'a wgpu::Buffer,
    /// Depth buffer of the application, which occludes transparent splats; `None` if the tile isn't drawn into the
    /// application's render target, or the buffer can't be read.
    pub host_depth: Option<&'a wgpu::TextureView>,
}

/// Bind groups of a segment.
struct SegmentGroups {
    /// Bind groups of setup. The first counts the splats that are drawn, the second doesn't, for repeated setups.
    setup: [wgpu::BindGroup; 2],
    /// Draw call of the segment's records.
    drawn: RecordDraw,
}

/// Draw call of some ranges of one buffer of records.
struct RecordDraw {
    variant: Variant,
    is_transparent: bool,
    group: wgpu::BindGroup,
    /// Bind group that replaces `group` in passes that light each splat separately.
    lit_group: Option<wgpu::BindGroup>,
    /// Ranges of records to draw, in order. Transparent layers are drawn indirectly, with all records.
    runs: Vec<Range<u32>>,
    /// Index of this draw: segments of the scene come first, then elements of `data.near`. It is the number of the draw
    /// in the plane of nearest splats, and its place among the indirect draws of layers.
    index: usize,
}

/// Creates the bind groups of each segment of splats; `None` for segments that can't touch the tile. `counters` are two
/// buffers for the number of drawn splats. The first counts splats at their first setup in the tile, the second at
/// repeated setups.
fn segment_groups(
    device: &wgpu::Device,
    queue: &Queue,
    inputs: &TileInputs<'_>,
    counters: [&wgpu::Buffer; 2],
) -> Vec<Option<SegmentGroups>> {
    let TileInputs { scene, pipelines, targets, data, .. } = *inputs;
    let storage = wgpu::BufferUsages::STORAGE;
    let sampled = targets.entries(&[(SETUP_STEPS_BINDING, Target::Steps)]);
    let groups = scene.segments.iter().zip(&data.segments).enumerate().map(|(index, (segment, data))| {
        let pipeline = pipelines.splats(data.variant).filter(|_| !data.is_outside)?;
        let chunks = filled(device, queue, "chunks", &data.chunks, storage);
        let near_bits = filled(device, queue, "near bits", &data.near_bits, storage);
        let setup = counters.map(|counter| {
            let records = &segment.records;
            let buffers = [&segment.uniform, &segment.splats, &chunks, &near_bits, &records.records, counter];
            let clips = records.clips.iter().filter(|_| data.variant == Variant::Clipped);
            let buffers: Vec<&wgpu::Buffer> = buffers.into_iter().chain(clips).collect();
            bind_with(device, "segment", &pipeline.setup_group.layout, &buffers, &sampled)
        });
        let group = segment.records.group(device, pipeline, data.variant);
        let (variant, is_transparent) = (data.variant, data.is_transparent);
        let runs = data.runs.clone();
        let drawn = RecordDraw { variant, is_transparent, group, lit_group: None, runs, index };
        Some(SegmentGroups { setup, drawn })
    });
    groups.collect()
}

/// Creates the draw calls of the splats that reach the near plane: one per element of `data.near`.
fn near_draws(device: &wgpu::Device, queue: &Queue, inputs: &TileInputs<'_>) -> Vec<RecordDraw> {
    let TileInputs { scene, pipelines, data, .. } = *inputs;
    let storage = wgpu::BufferUsages::STORAGE;
    let draws = data.near.iter().enumerate().filter_map(|(i, near)| {
        let records = filled(device, queue, "near records", &near.records, storage);
        let clipped = near.variant == Variant::Clipped;
        let clips = clipped.then(|| filled(device, queue, "clips of near records", &near.clips, storage));
        let pipeline = pipelines.splats(near.variant)?;
        let lit_group = (!near.lit.is_empty()).then(|| {
            let records = filled(device, queue, "lit near records", &near.lit, storage);
            Records { records, clips: clips.clone() }.group(device, pipeline, near.variant)
        });
        let group = Records { records, clips }.group(device, pipeline, near.variant);
        let (variant, is_transparent) = (near.variant, near.is_transparent);
        let index = scene.segments.len() + i;
        let runs = near.runs();
        Some(RecordDraw { variant, is_transparent, group, lit_group, runs, index })
    });
    draws.collect()
}

/// Creates the buffers and the bind group of a tile's frame: its uniform, objects, lights, shadow maps and matcap. The
/// first two buffers are the uniform and the objects.
fn frame_group(device: &wgpu::Device, queue: &Queue, inputs: &TileInputs<'_>) -> ([wgpu::Buffer; 5], wgpu::BindGroup) {
    let TileInputs { pipelines, frame, data, shadow_texels, .. } = *inputs;
    let storage = wgpu::BufferUsages::STORAGE;
    let buffers = [
        filled(device, queue, "frame", &data.frame, wgpu::BufferUsages::UNIFORM),
        filled(device, queue, "objects", &frame.objects, storage),
        filled(device, queue, "lights", &frame.lights, storage),
        filled(device, queue, "shadow maps", &frame.shadow_maps, storage),
        filled(device, queue, "matcap", &frame.matcap, storage),
    ];
    let [uniform, objects, lights, maps, matcap] = &buffers;
    let all = [uniform, objects, lights, maps, shadow_texels, matcap];
    let group = bind(device, "frame", &pipelines.frame_group.layout, &all);
    (buffers, group)
}

/// Creates the bind group of the planes, to composite them into the application's render target.
fn host_planes_group(device: &wgpu::Device, inputs: &TileInputs<'_>) -> wgpu::BindGroup {
    let layout = &inputs.pipelines.host_planes_group.layout;
    bind_some(device, "planes to compose", layout, &[(HOST_PLANES_BINDING, &inputs.targets.planes)])
}

/// Records the compositing of a part of the image, `host.part`, into the application's render target. `groups` are the
/// bind groups of the frame, and of what the part reads.
fn composite(
    encoder: &mut wgpu::CommandEncoder,
    pipelines: &Pipelines,
    groups: [&wgpu::BindGroup; 2],
    host: HostKey,
    target: &HostTarget<'_>,
) {
    let load = wgpu::Operations { load: wgpu::LoadOp::Load, store: wgpu::StoreOp::Store };
    let view = target.index.filter(|_| host.part == Part::Index).unwrap_or(target.color);
    let color = wgpu::RenderPassColorAttachment { view, depth_slice: None, resolve_target: None, ops: load };
    let depth = wgpu::RenderPassDepthStencilAttachment {
        view: target.depth,
        depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Load, store: wgpu::StoreOp::Store }),
        stencil_ops: None,
    };
    let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some("composite"),
        color_attachments: &[Some(color)],
        depth_stencil_attachment: host.part.has_depth().then_some(depth),
        ..wgpu::RenderPassDescriptor::default()
    });
    if let Some(pipeline) = pipelines.composite(host) {
        pass.set_pipeline(pipeline);
        groups.into_iter().zip(0..).for_each(|(group, number)| pass.set_bind_group(number, group, &[]));
        pass.draw(0..3, 0..1);
    }
}

/// Records the compositing of planes that the compute path has drawn, part by part.
pub(crate) fn composite_planes(
    encoder: &mut wgpu::CommandEncoder,
    (device, queue): (&wgpu::Device, &Queue),
    inputs: &TileInputs<'_>,
    parts: &[HostKey],
    target: &HostTarget<'_>,
) {
    let (_, frame) = frame_group(device, queue, inputs);
    let planes = host_planes_group(device, inputs);
    parts.iter().for_each(|&host| composite(encoder, inputs.pipelines, [&frame, &planes], host, target));
}

impl<'a> Tile<'a> {
    pub(crate) fn new(device: &wgpu::Device, queue: &Queue, inputs: &TileInputs<'a>) -> Self {
        let TileInputs { scene, pipelines, targets, data, .. } = *inputs;
        let storage = wgpu::BufferUsages::STORAGE;
        let ([uniform, objects, ..], frame_group) = &frame_group(device, queue, inputs);
        let frame_group = frame_group.clone();
        let setup_frame_group =
            bind(device, "frame of setup", &pipelines.setup_frame_group.layout, &[uniform, objects]);
        let counter = |label| filled(device, queue, label, &[0], storage | wgpu::BufferUsages::COPY_SRC);
        let (drawn, again) = (counter("drawn"), counter("drawn again"));
        let segments = segment_groups(device, queue, inputs, [&drawn, &again]);
        let near = near_draws(device, queue, inputs);
        let polygons = filled(device, queue, "polygons", &data.polygons, storage);
        let polygons_group = bind(device, "polygons", &pipelines.polygons_group.layout, &[&polygons]);
        let balls = filled(device, queue, "balls", &data.balls, storage);
        let gaussians = data.gaussians.as_ref().map(|GaussianLists { records, lists, room_bytes, .. }| {
            [("Gaussians", records, 0), ("lists of Gaussians", lists, *room_bytes)]
                .map(|(label, words, more)| filled_before(device, queue, label, words, more, storage))
        });
        let has_layers = targets.key.draws.iter().any(|draw| draw.is_transparent());
        let layer_draws = has_layers.then(|| {
            let near = data.near.iter().map(NearRecords::count);
            let words = layer_draw_words(scene.segments.iter().map(|segment| segment.count).chain(near));
            let usage = wgpu::BufferUsages::INDIRECT | wgpu::BufferUsages::COPY_SRC | storage;
            filled(device, queue, "draws of layers", &words, usage)
        });
        let finish = |entry: &str, layout: &wgpu::BindGroupLayout| {
            let layer_draws = layer_draws.as_ref().unwrap_or(&drawn);
            let layer_composites = &targets.layer_composites;
            let buffers = [
                &targets.planes,
                &polygons,
                &scene.texels,
                layer_composites,
                layer_composites,
                inputs.drawn_shadow_texels,
                layer_draws,
                &balls,
            ];
            let buffers = PIXEL_PASS_BUFFERS
                .into_iter()
                .zip(buffers)
                .map(|(binding, buffer)| wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() });
            let of_gaussians = GAUSSIAN_BUFFERS
                .into_iter()
                .zip(gaussians.iter().flatten())
                .map(|(binding, buffer)| wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() });
            let used = binding_slots(&[entry], 1);
            let host_depth = inputs.host_depth.map(|view| wgpu::BindGroupEntry {
                binding: HOST_DEPTH_BINDING,
                resource: wgpu::BindingResource::TextureView(view),
            });
            let all =
                targets.entries(&PIXEL_PASS_TEXTURES).into_iter().chain(buffers).chain(of_gaussians).chain(host_depth);
            let entries: Vec<_> = all.filter(|entry| used.iter().any(|slot| slot.binding == entry.binding)).collect();
            device.create_bind_group(&wgpu::BindGroupDescriptor { label: Some(entry), layout, entries: &entries })
        };
        Self {
            pixels: inputs
                .pixel_passes
                .iter()
                .filter_map(|&p| Some((p, finish(p.entry(), &pipelines.pixels(p)?.group.layout))))
                .collect(),
            composite_group: finish("composite_fragment", &pipelines.composite_group.layout),
            host_planes_group: host_planes_group(device, inputs),
            steps_group: targets.key.draws.iter().find(|draw| draw.binds_as_pixel_pass()).and_then(|&draw| {
                let [_, entry] = draw.entries(Variant::Whole);
                let pipeline = pipelines.draw(draw, Variant::Whole, targets.key.precision)?;
                Some(finish(&entry, &pipeline.reads_group.layout))
            }),
            scene,
            pipelines,
            targets,
            frame_group,
            setup_frame_group,
            segments,
            near,
            polygons_group,
            polygon_count: data.polygon_count,
            size: [data.targets.width, data.targets.height],
            shaded: [data.tile.width, data.tile.height],
            drawn,
            layer_draws,
        }
    }

    /// Records a step of the tile.
    pub(crate) fn step(&self, encoder: &mut wgpu::CommandEncoder, step: &Step, queries: Option<&mut Queries>) {
        match step {
            Step::Setup { segments, first } => self.setup(encoder, segments, *first, step.name(), queries),
            Step::Draw { draw, segments, first } => self.draw(encoder, *draw, segments, *first, queries),
            Step::PixelPass(pixels) => {
                let (Some(pipeline), Some(group)) = (self.pipelines.pixels(*pixels), self.pixels.get(pixels)) else {
                    return;
                };
                compute(encoder, step.name(), queries, |pass| {
                    pass.set_pipeline(&pipeline.raw);
                    pass.set_bind_group(0, &self.frame_group, &[]);
                    pass.set_bind_group(1, group, &[]);
                    let [width, height] = pixels.size(self.size, self.shaded);
                    pass.dispatch_workgroups(workgroups(width, "shade", 0), workgroups(height, "shade", 1), 1);
                });
            }
        }
    }

    /// Records the tile's steps, the pass over trained Gaussians, `times` times again.
    pub(crate) fn dispatch_again(&self, encoder: &mut wgpu::CommandEncoder, steps: &[Step], times: u32) {
        for step in (0..times).flat_map(|_| steps) {
            self.step(encoder, step, None);
        }
    }

    /// Records the compositing of a part of the image, `host.part`, into the application's render target.
    pub(crate) fn composite(&self, encoder: &mut wgpu::CommandEncoder, host: HostKey, target: &HostTarget<'_>) {
        let own = if host.part.reads_planes() { &self.host_planes_group } else { &self.composite_group };
        composite(encoder, self.pipelines, [&self.frame_group, own], host, target);
    }

    /// Records the setup of splats. `first` is true if they are set up for the first time in the tile, and counted.
    fn setup(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        segments: &[usize],
        first: bool,
        name: &'static str,
        queries: Option<&mut Queries>,
    ) {
        compute(encoder, name, queries, |pass| {
            for &i in segments {
                let (Some(segment), Some(Some(SegmentGroups { setup: [counted, uncounted], drawn }))) =
                    (self.scene.segments.get(i), self.segments.get(i))
                else {
                    continue;
                };
                let Some(pipeline) = self.pipelines.splats(drawn.variant) else { continue };
                pass.set_pipeline(&pipeline.setup);
                pass.set_bind_group(0, &self.setup_frame_group, &[]);
                pass.set_bind_group(1, if first { counted } else { uncounted }, &[]);
                pass.dispatch_workgroups(workgroups(segment.count, "setup", 0), 1, 1);
            }
        });
    }

    /// Records a render pass. `first` is true for the first step of this pass in the tile, which clears its targets.
    fn draw(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        draw: Draw,
        segments: &[usize],
        first: bool,
        queries: Option<&mut Queries>,
    ) {
        let colors: Vec<Option<wgpu::RenderPassColorAttachment<'_>>> = draw
            .colors()
            .iter()
            .map(|&target| {
                let ops = operations(first, wgpu::Color::TRANSPARENT);
                let view = self.targets.view(target)?;
                Some(wgpu::RenderPassColorAttachment { view, depth_slice: None, resolve_target: None, ops })
            })
            .collect();
        let depth_stencil_attachment = draw.depth().and_then(|target| {
            // A reversed depth of 0 means infinitely far.
            let depth_ops = Some(operations(first, 0.0));
            let view = self.targets.view(target)?;
            Some(wgpu::RenderPassDepthStencilAttachment { view, depth_ops, stencil_ops: None })
        });
        let query = Query::next(queries, draw.name());
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some(draw.name()),
            color_attachments: &colors,
            depth_stencil_attachment,
            timestamp_writes: query.and_then(Query::of_render),
            ..wgpu::RenderPassDescriptor::default()
        });
        let counted = query.and_then(Query::invocations);
        if let Some((set, index)) = counted {
            pass.begin_pipeline_statistics_query(set, index);
        }
        let [width, height] = self.size.map(|side| side as f32);
        pass.set_viewport(0.0, 0.0, width, height, 0.0, 1.0);
        self.record(&mut pass, draw, segments, first);
        if counted.is_some() {
            pass.end_pipeline_statistics_query();
        }
    }

    /// Records the draw calls of a render pass.
    fn record(&self, pass: &mut wgpu::RenderPass<'_>, draw: Draw, segments: &[usize], first: bool) {
        let bound = |pass: &mut wgpu::RenderPass<'_>, variant| {
            let Some(pipeline) = self.pipelines.draw(draw, variant, self.targets.key.precision) else { return };
            pass.set_pipeline(&pipeline.raw);
            pass.set_bind_group(0, &self.frame_group, &[]);
            let as_pixel_pass = self.steps_group.as_ref().filter(|_| draw.binds_as_pixel_pass());
            if let Some(reads) = as_pixel_pass.or_else(|| self.targets.reads(draw)) {
                pass.set_bind_group(draw.reads_group(), reads, &[]);
            }
        };
        if !draw.draws_records() {
            bound(pass, Variant::Whole);
            if draw == Draw::Polygons {
                pass.set_bind_group(1, &self.polygons_group, &[]);
                pass.draw(0..4, 0..self.polygon_count);
            } else {
                pass.draw(0..3, 0..draw.triangles());
            }
            return;
        }
        let segments = segments.iter().filter_map(|&i| Some(&self.segments.get(i)?.as_ref()?.drawn));
        let mut last = None;
        // Splats that reach the near plane belong to no segment. They are drawn in the first step of each pass.
        let near = self.near.iter().filter(|near| first && near.is_transparent == draw.is_transparent());
        for drawn in segments.chain(near) {
            if last.replace(drawn.variant) != Some(drawn.variant) {
                bound(pass, drawn.variant);
            }
            let lit_group = drawn.lit_group.as_ref().filter(|_| draw.is_lit());
            pass.set_bind_group(1, lit_group.unwrap_or(&drawn.group), &[]);
            match self.layer_draws.as_ref().filter(|_| draw.is_transparent()) {
                Some(draws) => pass.draw_indirect(draws, layer_draw_offset(drawn.index)),
                None => drawn.runs.iter().for_each(|run| pass.draw(Draw::quad(drawn.index), run.clone())),
            }
        }
    }
}

/// Records a compute pass whose commands the function `record` records, and queries of its time and invocations.
pub(crate) fn compute(
    encoder: &mut wgpu::CommandEncoder,
    name: &'static str,
    queries: Option<&mut Queries>,
    record: impl FnOnce(&mut wgpu::ComputePass<'_>),
) {
    let query = Query::next(queries, name);
    let timestamp_writes = query.and_then(Query::of_compute);
    let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some(name), timestamp_writes });
    let counted = query.and_then(Query::invocations);
    if let Some((set, index)) = counted {
        pass.begin_pipeline_statistics_query(set, index);
    }
    record(&mut pass);
    if counted.is_some() {
        pass.end_pipeline_statistics_query();
    }
}

/// Returns the operations of a render pass on a target: clear it to `value`, or load it; then store it.
fn operations<V>(clear: bool, value: V) -> wgpu::Operations<V> {
    let load = if clear { wgpu::LoadOp::Clear(value) } else { wgpu::LoadOp::Load };
    wgpu::Operations { load, store: wgpu::StoreOp::Store }
}

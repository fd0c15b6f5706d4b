//! Compute path, which draws by compute shaders instead of raster hardware: its buffers, and recording of the
//! dispatches for a tile.

use crate::execute::{TileInputs, compute};
use crate::pipelines::CellPipeline;
use crate::queries::Queries;
use crate::queue::Queue;
use crate::scene::{empty, filled};
use std::collections::HashMap;
use surfel_gpu::{CellBinding, CellBuffer, CellCapacity, CellRound, CellStage, CellStep, CellTiles, binding_slots};

/// Buffers of the compute path, reused from frame to frame while they are large enough.
#[derive(Default)]
pub(crate) struct CellBuffers {
    buffers: HashMap<CellBuffer, wgpu::Buffer>,
    /// Capacity of the buffers; `None` before the first tile.
    pub room: Option<CellCapacity>,
}

impl CellBuffers {
    /// Creates buffers with the capacity `room` for a tile and its samples, unless the existing ones are large enough.
    pub(crate) fn prepare(&mut self, device: &wgpu::Device, tiles: &CellTiles, room: CellCapacity) {
        self.room = Some(room);
        for buffer in CellBuffer::ALL {
            let bytes = tiles.bytes(buffer, room);
            if self.buffers.get(&buffer).is_none_or(|made| made.size() < bytes) {
                // The old buffer is freed first, because memory may not suffice for both.
                self.buffers.remove(&buffer);
                let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
                self.buffers.insert(buffer, empty(device, buffer.name(), bytes, usage));
            }
        }
    }

    /// Returns the total size of all buffers, in bytes.
    pub(crate) fn bytes(&self) -> u64 {
        self.buffers.values().map(wgpu::Buffer::size).sum()
    }

    /// Returns a buffer; `None` before [`CellBuffers::prepare`].
    pub(crate) fn get(&self, buffer: CellBuffer) -> Option<&wgpu::Buffer> {
        self.buffers.get(&buffer)
    }
}

/// Resources that the dispatches of a tile read.
pub(crate) struct CellTile<'a> {
    inputs: TileInputs<'a>,
    stages: &'a [CellStage],
    /// Bind groups of each dispatch, stage by stage: the frame's group and the dispatch's own. `None` if a resource is
    /// missing.
    groups: Vec<Vec<Option<[wgpu::BindGroup; 2]>>>,
}

impl<'a> CellTile<'a> {
    /// Creates the resources of a tile. `buffers` are those of the compute path, and `stages` draw the tile.
    pub(crate) fn new(
        device: &wgpu::Device,
        queue: &Queue,
        inputs: &TileInputs<'a>,
        buffers: &CellBuffers,
        stages: &'a [CellStage],
    ) -> Self {
        let TileInputs { scene, pipelines, targets, frame, data, .. } = *inputs;
        let (storage, uniforms) = (wgpu::BufferUsages::STORAGE, wgpu::BufferUsages::UNIFORM);
        let frame_buffers = [
            filled(device, queue, "frame", &data.frame, uniforms),
            filled(device, queue, "objects", &frame.objects, storage),
            filled(device, queue, "lights", &frame.lights, storage),
            filled(device, queue, "shadow maps", &frame.shadow_maps, storage),
            inputs.shadow_texels.clone(),
            filled(device, queue, "matcap", &frame.matcap, storage),
        ];
        let rounds: HashMap<CellRound, wgpu::Buffer> = CellRound::ALL
            .into_iter()
            .map(|round| (round, filled(device, queue, "round", &round.words(), uniforms)))
            .collect();
        let near = data.cell_near_words();
        let near = filled(device, queue, "near records", &near, storage);
        let seen = data.segments.iter().enumerate().filter(|(_, segment)| !segment.is_outside);
        let segments: HashMap<usize, [wgpu::Buffer; 2]> = seen
            .map(|(index, segment)| {
                let chunks = filled(device, queue, "chunks of cells", &segment.chunks, storage);
                (index, [chunks, filled(device, queue, "near bits", &segment.near_bits, storage)])
            })
            .collect();
        let frame_group = |entry: &str, layout: &wgpu::BindGroupLayout| {
            let slots = binding_slots(&[entry], 0);
            let entries = slots.iter().filter_map(|slot| {
                let resource = frame_buffers.get(slot.binding as usize)?.as_entire_binding();
                Some(wgpu::BindGroupEntry { binding: slot.binding, resource })
            });
            let entries: Vec<_> = entries.collect();
            device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("frame of cells"),
                layout,
                entries: &entries,
            })
        };
        let group = |step: &CellStep, layout: &wgpu::BindGroupLayout| {
            let resident = || scene.segments.get(step.segment?);
            let segment = || segments.get(&step.segment?);
            let one = |binding: u32| {
                let buffer = match CellBinding::of(binding, step.round)? {
                    CellBinding::Segment => &resident()?.uniform,
                    CellBinding::Splats => &resident()?.splats,
                    CellBinding::Chunks => &segment()?[0],
                    CellBinding::NearBits => &segment()?[1],
                    CellBinding::NearRecords => &near,
                    CellBinding::Planes => &targets.planes,
                    CellBinding::Round => rounds.get(&step.round)?,
                    CellBinding::Buffer(buffer) => buffers.get(buffer)?,
                };
                Some(wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() })
            };
            let slots = binding_slots(&[step.entry], 1);
            let entries = slots.iter().map(|slot| one(slot.binding)).collect::<Option<Vec<_>>>()?;
            let descriptor = wgpu::BindGroupDescriptor { label: Some(step.entry), layout, entries: &entries };
            Some(device.create_bind_group(&descriptor))
        };
        let of_step = |step: &CellStep| {
            let CellPipeline { frame_group: frame_layout, group: layout, .. } = pipelines.cells(step.entry)?;
            Some([frame_group(step.entry, &frame_layout.layout), group(step, &layout.layout)?])
        };
        let groups = stages.iter().map(|stage| stage.steps.iter().map(of_step).collect()).collect();
        Self { inputs: *inputs, stages, groups }
    }

    /// Records the dispatches of all stages, and queries of their times.
    pub(crate) fn record(&self, encoder: &mut wgpu::CommandEncoder, queries: &mut Queries) {
        let TileInputs { pipelines, .. } = self.inputs;
        for (stage, groups) in self.stages.iter().zip(&self.groups) {
            compute(encoder, stage.name, Some(&mut *queries), |pass| {
                for (step, groups) in stage.steps.iter().zip(groups) {
                    let (Some(pipeline), Some([frame, own])) = (pipelines.cells(step.entry), groups) else { continue };
                    pass.set_pipeline(&pipeline.raw);
                    pass.set_bind_group(0, frame, &[]);
                    pass.set_bind_group(1, own, &[]);
                    let [x, y] = step.workgroups;
                    pass.dispatch_workgroups(x, y, 1);
                }
            });
        }
    }
}

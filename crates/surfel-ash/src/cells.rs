//! Drawing by compute shaders instead of raster hardware (the *compute path*): its buffers, and recording of the
//! dispatches for a tile.

use crate::commands::Commands;
use crate::descriptors::{Resource, Sets, numbered};
use crate::device::Device;
use crate::error::Failure;
use crate::execute::{TileInputs, bind_pipeline, bind_sets, dispatch, frame_buffers};
use crate::memory::Buffer;
use crate::queries::Queries;
use crate::scene::ResidentScene;
use crate::targets::Targets;
use ash::vk;
use gpu_allocator::MemoryLocation;
use std::collections::HashMap;
use std::sync::Arc;
use surfel_gpu::{CellBinding, CellBuffer, CellCapacity, CellRound, CellStage, CellStep, CellTiles};

/// Buffers of the compute path, reused from frame to frame while they are large enough.
#[derive(Default)]
pub(crate) struct CellBuffers {
    buffers: HashMap<CellBuffer, Buffer>,
    /// Capacity of the buffers; `None` before the first tile.
    pub room: Option<CellCapacity>,
}

impl CellBuffers {
    /// Creates buffers with the capacity `room` for a tile and its samples, unless the existing ones are large enough.
    pub(crate) fn prepare(
        &mut self,
        device: &Arc<Device>,
        tiles: &CellTiles,
        room: CellCapacity,
    ) -> Result<(), Failure> {
        self.room = Some(room);
        for buffer in CellBuffer::ALL {
            let bytes = tiles.bytes(buffer, room);
            if self.buffers.get(&buffer).is_none_or(|made| made.bytes < bytes) {
                // The old buffer is freed first, because memory may not suffice for both.
                self.buffers.remove(&buffer);
                let usage = vk::BufferUsageFlags::STORAGE_BUFFER | vk::BufferUsageFlags::TRANSFER_SRC;
                let made = Buffer::new(device, buffer.name(), bytes, usage, MemoryLocation::GpuOnly)?;
                self.buffers.insert(buffer, made);
            }
        }
        Ok(())
    }

    /// Returns the total size of all buffers, in bytes.
    pub(crate) fn bytes(&self) -> u64 {
        self.buffers.values().map(|buffer| buffer.bytes).sum()
    }

    /// Returns a buffer; an error before [`CellBuffers::prepare`].
    pub(crate) fn get(&self, buffer: CellBuffer) -> Result<&Buffer, Failure> {
        self.buffers.get(&buffer).ok_or_else(|| Failure::other("a buffer of cells was not made"))
    }
}

/// Resources that the dispatches of a tile read. They are dropped after the dispatches have been executed.
pub(crate) struct CellTile<'a> {
    inputs: TileInputs<'a>,
    stages: &'a [CellStage],
    /// Descriptor sets of each dispatch, stage by stage: the frame's set and the dispatch's own.
    sets: Vec<Vec<[vk::DescriptorSet; 2]>>,
    /// Buffers that the descriptor sets refer to.
    _buffers: Vec<Buffer>,
    /// Pool of the descriptor sets.
    _sets: Sets,
}

/// Buffers of a segment that a tile creates: the shaders' `cell_chunks` and `near_bits`.
struct SegmentBuffers {
    chunks: Buffer,
    near_bits: Buffer,
}

impl<'a> CellTile<'a> {
    /// Creates the resources of a tile. `cells` are the buffers of the compute path, and `stages` draw the tile.
    pub(crate) fn new(
        device: &Arc<Device>,
        inputs: &TileInputs<'a>,
        cells: &CellBuffers,
        stages: &'a [CellStage],
    ) -> Result<Self, Failure> {
        let TileInputs { scene, pipelines, targets, frame, data, .. } = *inputs;
        let storage = vk::BufferUsageFlags::STORAGE_BUFFER;
        let dispatches: usize = stages.iter().map(|stage| stage.steps.len()).sum();
        // Each dispatch has one set of the frame and one of its own.
        let sets = Sets::new(device, 2 * dispatches as u32)?;
        let frame_buffers = frame_buffers(device, data, frame)?;
        let [uniform, objects, lights, maps, matcap] = &frame_buffers;
        let frame_resources = numbered([uniform, objects, lights, maps, inputs.shadow_texels, matcap]);
        let round = |round: CellRound| {
            let words = round.words();
            Ok((round, Buffer::filled(device, "round", &words, vk::BufferUsageFlags::UNIFORM_BUFFER)?))
        };
        let rounds: HashMap<CellRound, Buffer> =
            CellRound::ALL.into_iter().map(round).collect::<Result<_, Failure>>()?;
        let near = data.cell_near_words();
        let near = Buffer::filled(device, "near records", &near, storage)?;
        let mut segments = HashMap::new();
        for (index, segment) in data.segments.iter().enumerate().filter(|(_, segment)| !segment.is_outside) {
            let chunks = Buffer::filled(device, "chunks of cells", &segment.chunks, storage)?;
            let near_bits = Buffer::filled(device, "near bits", &segment.near_bits, storage)?;
            segments.insert(index, SegmentBuffers { chunks, near_bits });
        }
        let resources = Resources { scene, targets, cells, rounds: &rounds, near: &near, segments: &segments };
        let mut all = Vec::with_capacity(stages.len());
        for stage in stages {
            let mut of_stage = Vec::with_capacity(stage.steps.len());
            for step in &stage.steps {
                let pipeline = pipelines.cells(step.entry)?;
                let own = resources.of(step, &pipeline.set.numbers())?;
                of_stage.push([
                    sets.set(&pipeline.frame_set, "frame of cells", &frame_resources)?,
                    sets.set(&pipeline.set, step.entry, &own)?,
                ]);
            }
            all.push(of_stage);
        }
        let mut buffers: Vec<Buffer> = frame_buffers.into();
        buffers.extend(rounds.into_values());
        buffers.extend(segments.into_values().flat_map(|segment| [segment.chunks, segment.near_bits]));
        buffers.push(near);
        Ok(Self { inputs: *inputs, stages, sets: all, _buffers: buffers, _sets: sets })
    }

    /// Records the dispatches of all stages, barriers between them, and queries of their times.
    fn record(&self, commands: &Commands<'_>) -> Result<(), Failure> {
        let TileInputs { pipelines, queries, .. } = self.inputs;
        for (stage, sets) in self.stages.iter().zip(&self.sets) {
            queries.timed(commands, stage.name, || {
                stage.steps.iter().zip(sets).try_for_each(|(step, sets)| {
                    let pipeline = &pipelines.cells(step.entry)?.pipeline;
                    bind_pipeline(commands, pipeline, vk::PipelineBindPoint::COMPUTE);
                    bind_sets(commands, pipeline, vk::PipelineBindPoint::COMPUTE, sets);
                    dispatch(commands, step.workgroups);
                    // Dispatches that set up segments are independent of each other, so only the last one needs a
                    // barrier.
                    if step.segment.is_none() || stage.steps.last() == Some(step) {
                        commands.barrier_of_compute();
                    }
                    Ok::<(), Failure>(())
                })
            })?;
        }
        Ok(())
    }
}

/// Buffers that the host reads: a tile's planes, and the counters of the tile and its samples.
pub(crate) struct CellReadback<'a> {
    pub targets: &'a Targets,
    /// Size of the planes in bytes.
    pub plane_bytes: u64,
    pub counters: &'a Buffer,
    /// Host-readable copy of the counters.
    pub read_counters: &'a Buffer,
}

/// Records the stages of a tile and its samples, and copies of the data that the host reads: planes and counters.
pub(crate) fn record_tiles(
    commands: &Commands<'_>,
    tiles: &[CellTile<'_>],
    queries: &Queries,
    readback: &CellReadback<'_>,
) -> Result<(), Failure> {
    queries.begin(commands);
    commands.barrier();
    tiles.iter().try_for_each(|tile| tile.record(commands))?;
    commands.barrier();
    queries.end(commands);
    let CellReadback { targets, plane_bytes, counters, read_counters } = *readback;
    commands.copy(targets.planes.raw(), targets.readback.raw(), plane_bytes);
    commands.copy(counters.raw(), read_counters.raw(), read_counters.bytes);
    commands.barrier_to_host();
    Ok(())
}

/// Resources that the steps of a tile can bind.
struct Resources<'a> {
    scene: &'a ResidentScene,
    targets: &'a Targets,
    cells: &'a CellBuffers,
    /// Uniform of each round.
    rounds: &'a HashMap<CellRound, Buffer>,
    /// Records of splats that reach the near plane.
    near: &'a Buffer,
    /// Buffers of each segment that can touch the tile, by the segment's index.
    segments: &'a HashMap<usize, SegmentBuffers>,
}

impl<'a> Resources<'a> {
    /// Returns the resources that a step binds at these numbers of group 1, each with its number.
    fn of(&self, step: &CellStep, bindings: &[u32]) -> Result<Vec<(u32, Resource<'a>)>, Failure> {
        let missing = || Failure::other(format!("{} binds what a tile of cells doesn't have", step.entry));
        let resident = || step.segment.and_then(|index| self.scene.segments.get(index)).ok_or_else(missing);
        let segment = || step.segment.and_then(|index| self.segments.get(&index)).ok_or_else(missing);
        let one = |&binding: &u32| {
            let buffer = match CellBinding::of(binding, step.round).ok_or_else(missing)? {
                CellBinding::Segment => &resident()?.uniform,
                CellBinding::Splats => &resident()?.splats,
                CellBinding::Chunks => &segment()?.chunks,
                CellBinding::NearBits => &segment()?.near_bits,
                CellBinding::NearRecords => self.near,
                CellBinding::Planes => &self.targets.planes,
                CellBinding::Round => self.rounds.get(&step.round).ok_or_else(missing)?,
                CellBinding::Buffer(buffer) => self.cells.get(buffer)?,
            };
            Ok((binding, Resource::Buffer(buffer)))
        };
        bindings.iter().map(one).collect()
    }
}

//! GPU queries: times of a tile's steps, and counts of fragments and shader invocations.

use crate::commands::Commands;
use crate::device::Device;
use crate::error::Failure;
use crate::object::{Owned, destroy};
use ash::vk;
use std::cell::RefCell;
use std::sync::Arc;
use surfel_render::{PassTime, Stats};

/// Maximum number of steps of a tile that are timed. Further steps, in scenes with very many segments, aren't timed.
const MAX_STEPS: u32 = 512;

/// Shader stages whose invocations are counted, in the order of the flags' bits, in which Vulkan writes the counts.
const COUNTED: vk::QueryPipelineStatisticFlags = vk::QueryPipelineStatisticFlags::from_raw(
    vk::QueryPipelineStatisticFlags::VERTEX_SHADER_INVOCATIONS.as_raw()
        | vk::QueryPipelineStatisticFlags::FRAGMENT_SHADER_INVOCATIONS.as_raw()
        | vk::QueryPipelineStatisticFlags::COMPUTE_SHADER_INVOCATIONS.as_raw(),
);
/// Names of the counts of [`COUNTED`] in the statistics, in the same order.
const COUNTERS: [&str; 3] = ["vertex_invocations", "fragment_invocations", "compute_invocations"];

/// GPU queries that measure a tile: pools of timestamps, of counts of shader invocations, and of counts of fragments.
/// Pools of queries that the device doesn't support are `None`.
pub(crate) struct Queries {
    device: Arc<Device>,
    times: Option<Owned<vk::QueryPool>>,
    invocations: Option<Owned<vk::QueryPool>>,
    samples: Option<Owned<vk::QueryPool>>,
    /// Maximum number of steps that can be timed.
    most_steps: u32,
    /// Name that replaces the names of all steps in the statistics; `None` if steps have their own names.
    label: Option<&'static str>,
    /// Names of the steps timed so far.
    steps: RefCell<Vec<&'static str>>,
    /// Number of render passes whose fragments were counted so far.
    counted_passes: RefCell<u32>,
}

impl Queries {
    /// Creates the queries for a tile of `steps` steps. If `label` is set, it replaces the steps' names, and fragments
    /// aren't counted.
    pub(crate) fn new(device: &Arc<Device>, label: Option<&'static str>, steps: usize) -> Result<Self, Failure> {
        let most_steps = (steps as u32).clamp(1, MAX_STEPS);
        let caps = &device.caps;
        let pool = |wanted: bool, kind, count, statistics| -> Result<Option<Owned<vk::QueryPool>>, Failure> {
            if !wanted {
                return Ok(None);
            }
            let info =
                vk::QueryPoolCreateInfo::default().query_type(kind).query_count(count).pipeline_statistics(statistics);
            // SAFETY: the feature that this type needs is enabled.
            let raw = unsafe { device.raw.create_query_pool(&info, None) }?;
            Ok(Some(Owned::new(device, raw, "queries", destroy!(destroy_query_pool))))
        };
        let none = vk::QueryPipelineStatisticFlags::empty();
        Ok(Self {
            device: device.clone(),
            times: pool(caps.timestamp_period > 0.0, vk::QueryType::TIMESTAMP, 2 * most_steps, none)?,
            invocations: pool(caps.counts_invocations, vk::QueryType::PIPELINE_STATISTICS, 1, COUNTED)?,
            samples: pool(caps.counts_samples && label.is_none(), vk::QueryType::OCCLUSION, most_steps, none)?,
            most_steps,
            label,
            steps: RefCell::default(),
            counted_passes: RefCell::default(),
        })
    }

    /// Starts the queries of a tile: resets all of them, and begins counting shader invocations.
    pub(crate) fn begin(&self, commands: &Commands<'_>) {
        let counts = [(&self.times, 2 * self.most_steps), (&self.invocations, 1), (&self.samples, self.most_steps)];
        for (pool, count) in counts {
            if let Some(pool) = pool {
                // SAFETY: the pool has that many queries; recorded outside of render passes.
                unsafe { self.device.raw.cmd_reset_query_pool(commands.raw, pool.raw, 0, count) };
            }
        }
        if let Some(pool) = &self.invocations {
            let none = vk::QueryControlFlags::empty();
            // SAFETY: the query was reset; it ends in this command buffer, outside of render passes as it begins.
            unsafe { self.device.raw.cmd_begin_query(commands.raw, pool.raw, 0, none) };
        }
    }

    /// Ends counting shader invocations in the tile.
    pub(crate) fn end(&self, commands: &Commands<'_>) {
        if let Some(pool) = &self.invocations {
            // SAFETY: begun in this command buffer, outside of render passes.
            unsafe { self.device.raw.cmd_end_query(commands.raw, pool.raw, 0) };
        }
    }

    /// Records commands by calling `step`, and measures their time under a name.
    pub(crate) fn timed<T>(&self, commands: &Commands<'_>, name: &'static str, step: impl FnOnce() -> T) -> T {
        let index = self.steps.borrow().len() as u32;
        let pool = self.times.as_ref().filter(|_| index < self.most_steps);
        if pool.is_some() {
            self.steps.borrow_mut().push(self.label.unwrap_or(name));
        }
        let stamp = |stage, query| {
            if let Some(pool) = pool {
                // SAFETY: the query was reset and is written once; the queue family has timestamps.
                unsafe { self.device.raw.cmd_write_timestamp(commands.raw, stage, pool.raw, query) };
            }
        };
        stamp(vk::PipelineStageFlags::TOP_OF_PIPE, 2 * index);
        let result = step();
        stamp(vk::PipelineStageFlags::BOTTOM_OF_PIPE, 2 * index + 1);
        result
    }

    /// Records draws by calling `draw` inside a render pass, and counts their fragments.
    pub(crate) fn counted<T>(&self, commands: &Commands<'_>, draw: impl FnOnce() -> T) -> T {
        let index = *self.counted_passes.borrow();
        let Some(pool) = self.samples.as_ref().filter(|_| index < self.most_steps) else { return draw() };
        *self.counted_passes.borrow_mut() += 1;
        let precise = vk::QueryControlFlags::PRECISE;
        // SAFETY: the query was reset, precise counting is enabled, and it ends in the same subpass.
        unsafe { self.device.raw.cmd_begin_query(commands.raw, pool.raw, index, precise) };
        let result = draw();
        // SAFETY: begun in this subpass.
        unsafe { self.device.raw.cmd_end_query(commands.raw, pool.raw, index) };
        result
    }

    /// Adds the measured times and counts to the statistics. The device must have executed the tile.
    pub(crate) fn add(&self, stats: &mut Stats) -> Result<(), Failure> {
        let steps = self.steps.borrow();
        if let Some(pool) = self.times.as_ref().filter(|_| !steps.is_empty()) {
            let mut ticks = vec![0u64; 2 * steps.len()];
            self.results(pool, &mut ticks)?;
            for (&name, pair) in steps.iter().zip(ticks.chunks_exact(2)) {
                let [start, end] = pair else { continue };
                let ms = end.saturating_sub(*start) as f64 * self.device.caps.timestamp_period * 1e-6;
                match stats.passes.iter_mut().find(|pass| pass.name == name) {
                    Some(pass) => pass.ms += ms,
                    None => stats.passes.push(PassTime { name, ms }),
                }
            }
        }
        if let Some(pool) = &self.invocations {
            let mut counts = [[0u64; COUNTERS.len()]];
            self.results(pool, &mut counts)?;
            for (name, count) in COUNTERS.into_iter().zip(counts.as_flattened()) {
                match stats.counters.iter_mut().find(|counter| counter.0 == name) {
                    Some(counter) => counter.1 += *count as f64,
                    None => stats.counters.push((name, *count as f64)),
                }
            }
        }
        let passes = *self.counted_passes.borrow() as usize;
        if let Some(pool) = self.samples.as_ref().filter(|_| passes > 0) {
            let mut samples = vec![0u64; passes];
            self.results(pool, &mut samples)?;
            stats.fragments += samples.iter().sum::<u64>();
        }
        Ok(())
    }

    /// Reads the results of the first queries of a pool, as many as `values` has elements.
    fn results<T>(&self, pool: &Owned<vk::QueryPool>, values: &mut [T]) -> Result<(), Failure> {
        let flags = vk::QueryResultFlags::TYPE_64 | vk::QueryResultFlags::WAIT;
        // SAFETY: as many queries as values were written by a submission that was waited for; values are plain 64-bit
        // numbers, as many for each query as its type gives.
        unsafe { self.device.raw.get_query_pool_results(pool.raw, 0, values, flags) }?;
        Ok(())
    }
}

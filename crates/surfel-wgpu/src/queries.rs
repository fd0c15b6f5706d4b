//! GPU queries: times of passes and counts of shader invocations, if the adapter supports them.

use surfel_render::{PassTime, Stats};

/// Maximum number of passes of a tile that are measured. Further passes, in scenes with very many segments, aren't
/// measured.
const MAX_PASSES: u32 = 512;

/// Shader stages whose invocations are counted, in the order of the flags' bits, in which wgpu writes the counts.
const COUNTED: wgpu::PipelineStatisticsTypes = wgpu::PipelineStatisticsTypes::VERTEX_SHADER_INVOCATIONS
    .union(wgpu::PipelineStatisticsTypes::FRAGMENT_SHADER_INVOCATIONS)
    .union(wgpu::PipelineStatisticsTypes::COMPUTE_SHADER_INVOCATIONS);
/// Names of the counts of [`COUNTED`] in the statistics, in the same order.
const COUNTERS: [&str; 3] = ["vertex_invocations", "fragment_invocations", "compute_invocations"];

/// GPU queries that measure the passes of a tile.
pub(crate) struct Queries {
    /// Query set of timestamps, and the duration of a timestamp tick in nanoseconds. `None` if the device has no
    /// timestamps.
    times: Option<(wgpu::QuerySet, f64)>,
    /// Query set of the shader stages in [`COUNTED`]; `None` if the device can't count invocations.
    invocations: Option<wgpu::QuerySet>,
    /// Names of the passes measured so far.
    names: Vec<&'static str>,
    /// Name that replaces the names of all following passes in the statistics; `None` if they have their own names.
    label: Option<&'static str>,
}

/// Reserved queries of one pass.
#[derive(Clone, Copy)]
pub(crate) struct Query<'a> {
    queries: &'a Queries,
    index: u32,
}

impl Queries {
    /// Creates the query sets that the device's features allow.
    pub(crate) fn new(device: &wgpu::Device, queue: &wgpu::Queue) -> Self {
        let set = |wanted, label, ty, count| {
            let descriptor = wgpu::QuerySetDescriptor { label: Some(label), ty, count };
            device.features().contains(wanted).then(|| device.create_query_set(&descriptor))
        };
        let times = set(wgpu::Features::TIMESTAMP_QUERY, "pass times", wgpu::QueryType::Timestamp, 2 * MAX_PASSES);
        let counted = wgpu::QueryType::PipelineStatistics(COUNTED);
        Self {
            times: times.map(|set| (set, queue.get_timestamp_period().into())),
            invocations: set(wgpu::Features::PIPELINE_STATISTICS_QUERY, "invocations", counted, MAX_PASSES),
            names: Vec::new(),
            label: None,
        }
    }

    /// Starts the queries of a tile anew. If `label` is set, it replaces the names of the tile's passes in the
    /// statistics.
    pub(crate) fn restart(&mut self, label: Option<&'static str>) {
        self.names.clear();
        self.rename(label);
    }

    /// Sets the name that replaces the names of the following passes; `None` restores their own names.
    pub(crate) fn rename(&mut self, label: Option<&'static str>) {
        self.label = label;
    }

    /// Records a copy of the results to a new buffer. Returns the buffer and its size in bytes; `None` if there are no
    /// results.
    pub(crate) fn resolve(
        &self,
        device: &wgpu::Device,
        encoder: &mut wgpu::CommandEncoder,
    ) -> Option<(wgpu::Buffer, u64)> {
        let passes = self.names.len() as u32;
        let [of_times, of_invocations] = self.bytes();
        let bytes = of_times + of_invocations;
        if bytes == 0 {
            return None;
        }
        let usage = wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC;
        let buffer = crate::scene::empty(device, "pass costs", bytes, usage);
        if let Some((set, _)) = &self.times {
            encoder.resolve_query_set(set, 0..2 * passes, &buffer, 0);
        }
        if let Some(set) = &self.invocations {
            encoder.resolve_query_set(set, 0..passes, &buffer, of_times);
        }
        Some((buffer, bytes))
    }

    /// Returns the sizes in bytes of the timestamps and of the invocation counts. The first is padded to the alignment
    /// of the second.
    fn bytes(&self) -> [u64; 2] {
        let passes = self.names.len() as u64;
        let times = if self.times.is_some() { 16 * passes } else { 0 };
        let invocations = if self.invocations.is_some() { 8 * COUNTERS.len() as u64 * passes } else { 0 };
        [times.next_multiple_of(wgpu::QUERY_RESOLVE_BUFFER_ALIGNMENT), invocations]
    }

    /// Returns the layout of the buffer that [`Queries::resolve`] fills. The layout stays valid after further passes
    /// are recorded.
    pub(crate) fn pass_record(&self) -> PassRecord {
        let [times, _] = self.bytes();
        PassRecord {
            names: self.names.clone(),
            period: self.times.as_ref().map(|times| times.1),
            counts: self.invocations.is_some(),
            times_words: (times / 4) as usize,
        }
    }
}

/// Layout of a buffer of query results, by which its words are interpreted.
pub(crate) struct PassRecord {
    names: Vec<&'static str>,
    /// Duration of a timestamp tick in nanoseconds; `None` without timestamps.
    period: Option<f64>,
    /// True if the buffer has counts of invocations after the timestamps.
    counts: bool,
    /// Size of the timestamps in words, padding included.
    times_words: usize,
}

impl PassRecord {
    /// Adds the times and invocation counts of the passes to the statistics. `words` is the content of the buffer.
    pub(crate) fn add(&self, words: &[u32], stats: &mut Stats) {
        let (times, invocations) = words.split_at_checked(self.times_words).unwrap_or((words, &[]));
        let number =
            |from: &[u32], at: usize| Some(u64::from(*from.get(2 * at)?) | u64::from(*from.get(2 * at + 1)?) << 32);
        for (i, &name) in self.names.iter().enumerate() {
            let ticks = number(times, 2 * i).zip(number(times, 2 * i + 1));
            let (Some(period), Some((start, end))) = (self.period, ticks) else { continue };
            let ms = end.saturating_sub(start) as f64 * period * 1e-6;
            match stats.passes.iter_mut().find(|pass| pass.name == name) {
                Some(pass) => pass.ms += ms,
                None => stats.passes.push(PassTime { name, ms }),
            }
        }
        for (i, name) in COUNTERS.into_iter().enumerate().filter(|_| self.counts) {
            let of_pass = |pass: usize| number(invocations, COUNTERS.len() * pass + i).unwrap_or(0);
            let sum = (0..self.names.len()).map(of_pass).sum::<u64>() as f64;
            match stats.counters.iter_mut().find(|counter| counter.0 == name) {
                Some(counter) => counter.1 += sum,
                None => stats.counters.push((name, sum)),
            }
        }
    }
}

impl<'a> Query<'a> {
    /// Reserves the next queries for the pass `name`; `None` without queries, or if none are left.
    pub(crate) fn next(queries: Option<&'a mut Queries>, name: &'static str) -> Option<Self> {
        let queries = queries?;
        let index = queries.names.len() as u32;
        if index >= MAX_PASSES {
            return None;
        }
        queries.names.push(queries.label.unwrap_or(name));
        Some(Self { queries, index })
    }

    /// Returns the query set of timestamps, and the indices for the begin and end of the pass; `None` without
    /// timestamps.
    fn timestamps(self) -> Option<(&'a wgpu::QuerySet, [Option<u32>; 2])> {
        let (set, _) = self.queries.times.as_ref()?;
        Some((set, [Some(2 * self.index), Some(2 * self.index + 1)]))
    }

    /// Returns the timestamps that a render pass writes; `None` without timestamps.
    pub(crate) fn of_render(self) -> Option<wgpu::RenderPassTimestampWrites<'a>> {
        let (query_set, [beginning_of_pass_write_index, end_of_pass_write_index]) = self.timestamps()?;
        Some(wgpu::RenderPassTimestampWrites { query_set, beginning_of_pass_write_index, end_of_pass_write_index })
    }

    /// Returns the timestamps that a compute pass writes; `None` without timestamps.
    pub(crate) fn of_compute(self) -> Option<wgpu::ComputePassTimestampWrites<'a>> {
        let (query_set, [beginning_of_pass_write_index, end_of_pass_write_index]) = self.timestamps()?;
        Some(wgpu::ComputePassTimestampWrites { query_set, beginning_of_pass_write_index, end_of_pass_write_index })
    }

    /// Returns the query set that counts invocations, and the index of this pass's query; `None` if invocations aren't
    /// counted.
    pub(crate) fn invocations(self) -> Option<(&'a wgpu::QuerySet, u32)> {
        Some((self.queries.invocations.as_ref()?, self.index))
    }
}

//! Time of passes, where the adapter counts it.

use surfel_render::PassTime;

/// Passes of a tile that are timed; a scene of very many segments goes on untimed.
const MOST_PASSES: u32 = 512;

/// Timestamps of a tile.
pub(crate) struct Timer {
    set: wgpu::QuerySet,
    names: Vec<&'static str>,
    /// Nanoseconds of a tick.
    period: f64,
}

impl Timer {
    /// `None` where the adapter has no timestamps.
    pub(crate) fn new(device: &wgpu::Device, queue: &wgpu::Queue) -> Option<Self> {
        if !device.features().contains(wgpu::Features::TIMESTAMP_QUERY) {
            return None;
        }
        let set = device.create_query_set(&wgpu::QuerySetDescriptor {
            label: Some("pass times"),
            ty: wgpu::QueryType::Timestamp,
            count: 2 * MOST_PASSES,
        });
        Some(Self { set, names: Vec::new(), period: queue.get_timestamp_period().into() })
    }

    pub(crate) fn restart(&mut self) {
        self.names.clear();
    }

    /// Takes the next pair of timestamps: those before and after the pass `name`.
    fn next(&mut self, name: &'static str) -> Option<[Option<u32>; 2]> {
        let first = 2 * self.names.len() as u32;
        if first >= 2 * MOST_PASSES {
            return None;
        }
        self.names.push(name);
        Some([Some(first), Some(first + 1)])
    }

    pub(crate) fn render(&mut self, name: &'static str) -> Option<wgpu::RenderPassTimestampWrites<'_>> {
        let [beginning_of_pass_write_index, end_of_pass_write_index] = self.next(name)?;
        let query_set = &self.set;
        Some(wgpu::RenderPassTimestampWrites { query_set, beginning_of_pass_write_index, end_of_pass_write_index })
    }

    pub(crate) fn compute(&mut self, name: &'static str) -> Option<wgpu::ComputePassTimestampWrites<'_>> {
        let [beginning_of_pass_write_index, end_of_pass_write_index] = self.next(name)?;
        let query_set = &self.set;
        Some(wgpu::ComputePassTimestampWrites { query_set, beginning_of_pass_write_index, end_of_pass_write_index })
    }

    /// Bytes of the timestamps taken.
    pub(crate) fn bytes(&self) -> u64 {
        16 * self.names.len() as u64
    }

    /// Copies the timestamps to `buffer`, which is as long.
    pub(crate) fn resolve(&self, encoder: &mut wgpu::CommandEncoder, buffer: &wgpu::Buffer) {
        encoder.resolve_query_set(&self.set, 0..2 * self.names.len() as u32, buffer, 0);
    }

    /// Adds the passes' times to those of earlier tiles.
    pub(crate) fn add(&self, words: &[u32], passes: &mut Vec<PassTime>) {
        let ticks = |at: usize| Some(u64::from(*words.get(2 * at)?) | u64::from(*words.get(2 * at + 1)?) << 32);
        for (i, &name) in self.names.iter().enumerate() {
            let (Some(start), Some(end)) = (ticks(2 * i), ticks(2 * i + 1)) else { continue };
            let ms = end.saturating_sub(start) as f64 * self.period * 1e-6;
            match passes.iter_mut().find(|pass| pass.name == name) {
                Some(pass) => pass.ms += ms,
                None => passes.push(PassTime { name, ms }),
            }
        }
    }
}

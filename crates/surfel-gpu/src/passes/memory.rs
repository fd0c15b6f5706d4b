//! Memory that a frame takes beside the scene: the targets of its plan's draws, and layer composites.

use crate::passes::draw::Draw;
use crate::passes::targets::{Target, TargetFormat};
use surfel_model::Accumulate;
use surfel_render::{FramePlan, Stats};
use surfel_shaders::layout;

/// Name of the counter of [`count_frame_bytes`]: targets and layer composites of the largest tile.
const TARGET_BYTES: &str = "target_bytes";

/// Name of the other counter of [`count_frame_bytes`]: texels of shadow maps.
const SHADOW_BYTES: &str = "shadow_bytes";

/// Precision of the sums.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Precision {
    /// 24 bits.
    F32,
    /// 11 bits.
    F16,
}

impl Precision {
    /// The precision of a plan's sums, on a device that blends them in f32 or doesn't.
    pub fn of(plan: &FramePlan, blends_f32: bool) -> Self {
        if blends_f32 && plan.accumulate == Accumulate::F32 { Self::F32 } else { Self::F16 }
    }

    /// Bytes of a sum.
    pub(crate) fn sum_bytes(self) -> u64 {
        match self {
            Self::F32 => 4,
            Self::F16 => 2,
        }
    }
}

/// What a tile's targets depend on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TargetKey {
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Precision of the sums.
    pub precision: Precision,
    /// The draws that write and read them.
    pub draws: Vec<Draw>,
    /// Floats of the planes.
    pub floats: u32,
}

impl TargetKey {
    /// Bytes of the targets and layer composites.
    pub fn bytes(&self) -> u64 {
        target_bytes(&self.draws, self.size, self.precision)
    }
}

impl Target {
    /// Size of its texture: a tile's where one of its draws needs it, else one pixel, for shaders have to bind
    /// something.
    pub fn size(self, draws: &[Draw], tile: [u32; 2]) -> [u32; 2] {
        let is_drawn = draws.iter().any(|draw| draw.colors().contains(&self) || draw.depth() == Some(self));
        if is_drawn { tile } else { [1, 1] }
    }
}

impl TargetFormat {
    /// Bytes of a texel.
    pub fn bytes(self, sums: Precision) -> u64 {
        let sum_bytes = sums.sum_bytes();
        match self {
            Self::Sums4 => 4 * sum_bytes,
            Self::Sums2 => 2 * sum_bytes,
            Self::Exact2 => 8,
            Self::Depth | Self::Exact1 => 4,
        }
    }
}

fn pixels([width, height]: [u32; 2]) -> u64 {
    u64::from(width) * u64::from(height)
}

/// Bytes of a tile's layer composites; of one pixel where no layers are drawn.
pub fn layer_composite_bytes(draws: &[Draw], tile: [u32; 2]) -> u64 {
    let is_drawn = draws.iter().any(|draw| draw.is_transparent());
    layout::layer_composite::SIZE as u64 * pixels(if is_drawn { tile } else { [1, 1] })
}

/// Bytes of all targets of a tile and of its layer composites.
pub fn target_bytes(draws: &[Draw], tile: [u32; 2], sums: Precision) -> u64 {
    let targets = Target::ALL.into_iter().map(|t| t.format().bytes(sums) * pixels(t.size(draws, tile)));
    targets.sum::<u64>() + layer_composite_bytes(draws, tile)
}

/// Counts the bytes of a tile's targets and of the shadow maps beside it; the counters hold those of the largest tile.
pub fn count_frame_bytes(target_bytes: u64, shadow_bytes: u64, stats: &mut Stats) {
    raise_counter(TARGET_BYTES, target_bytes as f64, stats);
    raise_counter(SHADOW_BYTES, shadow_bytes as f64, stats);
}

/// Raises a counter to a number, if it is less.
pub(crate) fn raise_counter(name: &'static str, number: f64, stats: &mut Stats) {
    match stats.counters.iter_mut().find(|counter| counter.0 == name) {
        Some(counter) => counter.1 = counter.1.max(number),
        None => stats.counters.push((name, number)),
    }
}

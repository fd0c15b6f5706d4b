//! Memory that a frame takes beside the scene: what a plan doesn't draw isn't there.

use crate::targets::{Draw, Target, TargetFormat};
use surfel_model::Accumulate;
use surfel_render::{FramePlan, Stats};
use surfel_shaders::layout;

/// Name of the counter of [`count_frame_bytes`]: textures and veils of the largest tile.
const TARGET_BYTES: &str = "target_bytes";

/// Name of the other one: texels of shadow maps.
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
    /// A plan's, on a device that blends sums in f32 or doesn't.
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

/// What a tile's targets have to be.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TargetKey {
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Of the sums.
    pub precision: Precision,
    /// What is drawn.
    pub draws: Vec<Draw>,
    /// Floats of the planes.
    pub floats: u32,
}

impl TargetKey {
    /// Bytes of the textures and veils.
    pub fn bytes(&self) -> u64 {
        target_bytes(&self.draws, self.size, self.precision)
    }
}

impl Target {
    /// Size of its texture: a tile's where one of its draws needs it, else one pixel, for shaders have to bind something.
    pub fn size(self, draws: &[Draw], tile: [u32; 2]) -> [u32; 2] {
        let is_drawn = draws.iter().any(|draw| draw.colors().contains(&self) || draw.depth() == Some(self));
        if is_drawn { tile } else { [1, 1] }
    }
}

impl TargetFormat {
    /// Bytes of a texel.
    pub(crate) fn bytes(self, sums: Precision) -> u64 {
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

/// Bytes of what a tile's layers of transparent splats come to; of one pixel where none are drawn.
pub fn veil_bytes(draws: &[Draw], tile: [u32; 2]) -> u64 {
    let is_drawn = draws.iter().any(|draw| draw.is_transparent());
    layout::veil::SIZE as u64 * pixels(if is_drawn { tile } else { [1, 1] })
}

/// Bytes of all targets of a tile and of its veils.
pub fn target_bytes(draws: &[Draw], tile: [u32; 2], sums: Precision) -> u64 {
    let targets = Target::ALL.into_iter().map(|t| t.format().bytes(sums) * pixels(t.size(draws, tile)));
    targets.sum::<u64>() + veil_bytes(draws, tile)
}

/// Counts the bytes of a tile's targets, and of the shadow maps beside it: of the tile that has most.
pub fn count_frame_bytes(target_bytes: u64, shadow_bytes: u64, stats: &mut Stats) {
    count_most(TARGET_BYTES, target_bytes as f64, stats);
    count_most(SHADOW_BYTES, shadow_bytes as f64, stats);
}

/// Raises a counter to a number.
pub(crate) fn count_most(name: &'static str, number: f64, stats: &mut Stats) {
    match stats.counters.iter_mut().find(|counter| counter.0 == name) {
        Some(counter) => counter.1 = counter.1.max(number),
        None => stats.counters.push((name, number)),
    }
}

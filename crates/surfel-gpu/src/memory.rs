//! Memory that a frame takes beside the scene: what a plan doesn't draw isn't there.

use crate::targets::{Draw, Target, TargetFormat};
use surfel_render::Stats;
use surfel_shaders::layout;

/// Name of the counter of [`count_frame_bytes`]: textures and veils of the largest tile.
const TARGET_BYTES: &str = "target_bytes";

/// Name of the other one: texels of shadow maps.
const SHADOW_BYTES: &str = "shadow_bytes";

impl Target {
    /// Size of its texture: a tile's where one of its draws needs it, else one pixel, for shaders have to bind something.
    pub fn size(self, draws: &[Draw], tile: [u32; 2]) -> [u32; 2] {
        let is_drawn = draws.iter().any(|draw| draw.colors().contains(&self) || draw.depth() == Some(self));
        if is_drawn { tile } else { [1, 1] }
    }
}

impl TargetFormat {
    /// Bytes of a texel, where a sum has so many.
    fn bytes(self, sum_bytes: u64) -> u64 {
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

/// Bytes of all targets of a tile and of its veils, where a sum has so many (4, or 2 in f16).
pub fn target_bytes(draws: &[Draw], tile: [u32; 2], sum_bytes: u64) -> u64 {
    let targets = Target::ALL.into_iter().map(|t| t.format().bytes(sum_bytes) * pixels(t.size(draws, tile)));
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

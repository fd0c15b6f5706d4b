//! Memory that a frame needs in addition to the scene: the textures (targets) of its draws, and layer composites, which
//! are the transparent layers of each pixel.

use crate::passes::draw::Draw;
use crate::passes::targets::{Target, TargetFormat};
use surfel_model::Accumulate;
use surfel_render::{FramePlan, Stats};
use surfel_shaders::layout;

/// Name, in the statistics, of the counter of the bytes of targets and layer composites in the largest tile. See
/// [`count_frame_bytes`].
const TARGET_BYTES: &str = "target_bytes";

/// Name, in the statistics, of the counter of the bytes of shadow maps. See [`count_frame_bytes`].
const SHADOW_BYTES: &str = "shadow_bytes";

/// Precision in which weighted attributes are summed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Precision {
    /// 32-bit floats, with 24 bits of precision.
    F32,
    /// 16-bit floats, with 11 bits of precision.
    F16,
}

impl Precision {
    /// Returns the precision of a plan's sums. `blends_f32` is true if the device can blend f32 targets.
    pub fn of(plan: &FramePlan, blends_f32: bool) -> Self {
        if blends_f32 && plan.accumulate == Accumulate::F32 { Self::F32 } else { Self::F16 }
    }

    /// Returns the size of one sum in bytes.
    pub(crate) fn sum_bytes(self) -> u64 {
        match self {
            Self::F32 => 4,
            Self::F16 => 2,
        }
    }
}

/// Parameters that determine a tile's textures (targets) and buffers. Those of an earlier tile with an equal key can be
/// reused.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TargetKey {
    /// Width and height of the targets, in pixels.
    pub size: [u32; 2],
    /// Precision of the sums.
    pub precision: Precision,
    /// Render passes that write and read the targets.
    pub draws: Vec<Draw>,
    /// Number of floats in the tile's buffer of planes.
    pub floats: u32,
}

impl TargetKey {
    /// Returns the size of the targets and layer composites in bytes.
    pub fn bytes(&self) -> u64 {
        target_bytes(&self.draws, self.size, self.precision)
    }
}

impl Target {
    /// Returns the size of the target's texture in pixels. It is `tile`, the size of the tile's targets, if one of
    /// `draws` writes the target. Otherwise it is one pixel, since shaders have to bind some texture.
    pub fn size(self, draws: &[Draw], tile: [u32; 2]) -> [u32; 2] {
        let is_drawn = draws.iter().any(|draw| draw.colors().contains(&self) || draw.depth() == Some(self));
        if is_drawn { tile } else { [1, 1] }
    }
}

impl TargetFormat {
    /// Returns the size of a texel in bytes.
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

/// Returns the number of pixels of a width and height.
fn pixels([width, height]: [u32; 2]) -> u64 {
    u64::from(width) * u64::from(height)
}

/// Returns the size of a tile's layer composites, the transparent layers of each pixel, in bytes. Without transparent
/// layers, the composites have a single pixel.
pub fn layer_composite_bytes(draws: &[Draw], tile: [u32; 2]) -> u64 {
    let is_drawn = draws.iter().any(|draw| draw.is_transparent());
    layout::layer_composite::SIZE as u64 * pixels(if is_drawn { tile } else { [1, 1] })
}

/// Returns the size of all targets of a tile and of its layer composites, in bytes.
pub fn target_bytes(draws: &[Draw], tile: [u32; 2], sums: Precision) -> u64 {
    let targets = Target::ALL.into_iter().map(|t| t.format().bytes(sums) * pixels(t.size(draws, tile)));
    targets.sum::<u64>() + layer_composite_bytes(draws, tile)
}

/// Raises the statistics' counters of bytes to the sizes of a tile's targets and of its shadow maps. The counters thus
/// give the sizes of the largest tile.
pub fn count_frame_bytes(target_bytes: u64, shadow_bytes: u64, stats: &mut Stats) {
    raise_counter(TARGET_BYTES, target_bytes as f64, stats);
    raise_counter(SHADOW_BYTES, shadow_bytes as f64, stats);
}

/// Adds `number` to a counter, and creates the counter if it is missing.
pub(crate) fn add_counter(name: &'static str, number: f64, stats: &mut Stats) {
    match stats.counters.iter_mut().find(|counter| counter.0 == name) {
        Some(counter) => counter.1 += number,
        None => stats.counters.push((name, number)),
    }
}

/// Raises a counter to `number` if it is lower, and creates the counter if it is missing.
pub(crate) fn raise_counter(name: &'static str, number: f64, stats: &mut Stats) {
    match stats.counters.iter_mut().find(|counter| counter.0 == name) {
        Some(counter) => counter.1 = counter.1.max(number),
        None => stats.counters.push((name, number)),
    }
}

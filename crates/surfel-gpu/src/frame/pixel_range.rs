//! Ranges of pixels that a splat may touch, computed on the CPU as in the shaders.

use surfel_shaders::layout;

/// Margin by which the box of a splat's pixels is enlarged on each side, in pixels; the same as in the shaders.
const BOX_SLACK_PX: f64 = layout::BOX_SLACK_PX as f64;

/// Returns the pixels of the tile whose centres lie between `min` and `max`, both image coordinates in pixels. The tile
/// has `length` pixels along this axis from pixel `start` on. The result is the first pixel and one past the last,
/// counted from `start`; `None` if there are none.
pub(crate) fn pixel_range(min: f64, max: f64, start: u32, length: u32) -> Option<[u32; 2]> {
    let limit = f64::from(length);
    let first = (min - f64::from(start) - 0.5 - BOX_SLACK_PX).ceil().clamp(0.0, limit);
    let end = ((max - f64::from(start) - 0.5 + BOX_SLACK_PX).floor() + 1.0).clamp(0.0, limit);
    (first < end).then_some([first as u32, end as u32])
}

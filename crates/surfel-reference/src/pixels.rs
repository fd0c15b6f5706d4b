//! Geometry of a rectangle's pixels: centres, neighbours, and the pixels that a footprint may touch.

use crate::margin;
use surfel_math::V2;
use surfel_math::bounds::Extent;
use surfel_render::Region;

/// Returns the centre of the pixel in column `x` and row `y`.
pub(crate) fn center(x: u32, y: u32) -> V2<f64> {
    V2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)
}

/// Returns the centre of pixel `index` of a rectangle; indices count row by row.
pub(crate) fn center_in(rect: Region, index: usize) -> V2<f64> {
    center(rect.x + index as u32 % rect.width, rect.y + index as u32 / rect.width)
}

/// Returns the up to eight neighbours of pixel `index` inside a rectangle; indices count row by row.
pub(crate) fn neighbours(rect: Region, index: usize) -> impl Iterator<Item = usize> + use<> {
    let (width, height) = (rect.width as usize, rect.height as usize);
    let (x, y) = (index % width, index / width);
    let columns = x.saturating_sub(1)..=(x + 1).min(width - 1);
    (y.saturating_sub(1)..=(y + 1).min(height - 1))
        .flat_map(move |row| columns.clone().map(move |column| row * width + column))
        .filter(move |&neighbour| neighbour != index)
}

/// Returns the up to four neighbours inside a rectangle that share a side with pixel `index`; indices count row by row.
pub(crate) fn side_neighbours(rect: Region, index: usize) -> impl Iterator<Item = usize> + use<> {
    let (width, height) = (rect.width as usize, rect.height as usize);
    let (x, y) = (index % width, index / width);
    let left = (x > 0).then(|| index - 1);
    let right = (x + 1 < width).then(|| index + 1);
    let above = (y > 0).then(|| index - width);
    let below = (y + 1 < height).then(|| index + width);
    [left, right, above, below].into_iter().flatten()
}

/// Returns the columns and rows of `rect` whose pixel centres are in `extent`. A small slack makes sure that neither
/// rounding nor the decision margin loses a pixel.
pub(crate) fn touched(extent: &Extent<f64>, rect: Region) -> (std::ops::Range<u32>, std::ops::Range<u32>) {
    let range = |min: f64, max: f64, start: u32, length: u32| {
        let (lo, hi) = (f64::from(start), f64::from(start + length));
        // The limits also hold for an infinite box. The slack is twice the margin of an image of samples: its pixels
        // are a quarter as wide, so that the margin spans four times as many.
        let slack = 8.0 * margin::RIM_PX;
        let first = (min - 0.5 - slack).ceil().clamp(lo, hi) as u32;
        let end = ((max - 0.5 + slack).floor() + 1.0).clamp(lo, hi) as u32;
        first..end.max(first)
    };
    (range(extent.min.x, extent.max.x, rect.x, rect.width), range(extent.min.y, extent.max.y, rect.y, rect.height))
}

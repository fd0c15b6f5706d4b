//! Edge antialiasing by coverage (§5, ours after Z01 §7).

use crate::raster::{Kept, Passes};
use surfel_render::Region;

/// Marks edge pixels: those with an 8-neighbour inside the image whose nearest depth (kept value less its writer's ε)
/// lies beyond the pixel's own kept value by more than its own writer's ε, and those that have filtered
/// fragments but nothing kept.
pub(crate) fn edge_pixels(passes: &Passes, rect: Region) -> Vec<bool> {
    let (width, height) = (rect.width as usize, rect.height as usize);
    let is_edge = |x: usize, y: usize| {
        let at = y * width + x;
        let own = passes.kept[at];
        if own.value == f64::INFINITY {
            return passes.sums[at].fragments > 0;
        }
        let columns = x.saturating_sub(1)..=(x + 1).min(width - 1);
        (y.saturating_sub(1)..=(y + 1).min(height - 1))
            .flat_map(|ny| columns.clone().map(move |nx| ny * width + nx))
            .any(|neighbour| neighbour != at && steps_back(own, passes.kept[neighbour]))
    };
    (0..width * height).map(|at| is_edge(at % width, at / width)).collect()
}

fn steps_back(own: Kept, neighbour: Kept) -> bool {
    neighbour.value - neighbour.epsilon > own.value + own.epsilon
}

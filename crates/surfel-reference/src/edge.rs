//! Edge antialiasing by coverage (§5, ours after Z01 §7).

use crate::margin;
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

/// Marks the pixels whose edge decision rounding could flip: no neighbour decides it for sure, and one is within the
/// margin of doing so, or would do so if a marginal visibility test of either pixel came out the other way.
pub(crate) fn marginal_edges(passes: &Passes, rect: Region) -> Vec<bool> {
    let (width, height) = (rect.width as usize, rect.height as usize);
    let is_marginal = |at: usize| {
        let (x, y) = (at % width, at / width);
        let own = passes.possible[at];
        let columns = x.saturating_sub(1)..=(x + 1).min(width - 1);
        let neighbours = || {
            (y.saturating_sub(1)..=(y + 1).min(height - 1))
                .flat_map(|ny| columns.clone().map(move |nx| ny * width + nx))
                .filter(|&neighbour| neighbour != at)
        };
        // Without anything kept for sure, whether anything is kept is open: the pixel itself is marked for that.
        let pairs = |neighbour: usize| {
            let other = passes.possible[neighbour];
            [own.nearest, own.farthest].into_iter().flat_map(move |a| [other.nearest, other.farthest].map(|b| (a, b)))
        };
        let surely = |(a, b): (Kept, Kept)| steps_back(a, b) && !margin::on_step(a, b);
        let perhaps = |(a, b): (Kept, Kept)| steps_back(a, b) || margin::on_step(a, b);
        let decided = neighbours().any(|n| pairs(n).all(surely));
        !decided && neighbours().any(|n| pairs(n).any(perhaps))
    };
    (0..width * height).map(is_marginal).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::raster::{Possible, Sums};

    /// A row of pixels that keep these depths for sure, with ε = 0.1.
    fn row(depths: &[f64]) -> (Passes, Region) {
        let kept: Vec<Kept> = depths.iter().map(|&z| Kept { value: z + 0.1, epsilon: 0.1 }).collect();
        let possible = kept.iter().map(|&k| Possible { nearest: k, farthest: k }).collect();
        let sums = vec![Sums::default(); depths.len()];
        let rect = Region { x: 0, y: 0, width: depths.len() as u32, height: 1 };
        (Passes { kept, sums, possible, fragments: 0 }, rect)
    }

    #[test]
    fn edge_margin_holds_steps_that_rounding_could_take() {
        // Steps back where the neighbour is more than 2ε = 0.2 deeper; 1e-4 relative is 1.2e-4 here.
        for (step, edge, marginal) in
            [(0.1, false, false), (0.2001, true, true), (0.1999, false, true), (0.2002, true, false)]
        {
            let (passes, rect) = row(&[1.0, 1.0 + step]);
            assert_eq!(edge_pixels(&passes, rect)[0], edge, "{step}");
            assert_eq!(marginal_edges(&passes, rect)[0], marginal, "{step}");
            assert!(!marginal_edges(&passes, rect)[1], "{step}");
        }
    }

    #[test]
    fn edge_margin_ends_where_another_neighbour_decides() {
        let (passes, rect) = row(&[1.2001, 1.0, 3.0]);
        assert_eq!(marginal_edges(&passes, rect), [false, false, false]);
    }

    #[test]
    fn edge_margin_follows_marginal_visibility_of_a_neighbour() {
        let (mut passes, rect) = row(&[1.0, 1.0]);
        passes.possible[1].farthest = Kept::NOTHING;
        assert_eq!(marginal_edges(&passes, rect), [true, false]);
    }
}

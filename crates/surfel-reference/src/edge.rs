//! Edge antialiasing by coverage (rendering model §5, our method after Z01 §7).

use crate::margin;
use crate::pixels::neighbours;
use crate::polygon::Hit;
use crate::raster::Passes;
use crate::threshold::Threshold;
use surfel_render::Region;

/// Nearest surfaces of a rectangle of pixels, in which edge pixels are detected.
pub(crate) struct Edges<'a> {
    pub passes: &'a Passes,
    /// Nearest polygon of each pixel, whether a splat occludes it or not; empty if the frame has no polygons.
    pub polygons: &'a [Hit],
    pub rect: Region,
}

impl Edges<'_> {
    /// Returns a flag per pixel, true for edge pixels. At an edge, the nearest surface of an 8-neighbour inside the
    /// image is more than ε beyond the pixel's own threshold. ε belongs to the splat that set the threshold. A pixel
    /// with filtered fragments but without a threshold is an edge too.
    ///
    /// The nearest surface begins at the threshold minus its ε, or at a polygon. A polygon that splats occlude is
    /// beyond their threshold, and doesn't count.
    pub(crate) fn pixels(&self) -> Vec<bool> {
        let is_edge = |at: usize| {
            let own = self.passes.thresholds[at];
            if own.depth == f64::INFINITY {
                return self.passes.sums[at].fragments > 0;
            }
            let nearest = |n: usize| step(self.passes.thresholds[n]).min(self.polygon(n).0);
            neighbours(self.rect, at).any(|n| nearest(n) > limit(own))
        };
        (0..self.count()).map(is_edge).collect()
    }

    /// Returns a flag per pixel, true if rounding could change whether the pixel is an edge. At such a pixel, no
    /// neighbour makes an edge for certain, and at least one may make an edge. A neighbour may if its depth is within
    /// the margin of the pixel's limit. It also may if rounding could change a visibility test of either pixel, or of a
    /// polygon.
    pub(crate) fn marginal(&self) -> Vec<bool> {
        let is_marginal = |at: usize| {
            let own = self.passes.possible[at];
            // Pixels for which a threshold is uncertain are already marked.
            let pairs = |n: usize| {
                let (other, (z, open)) = (self.passes.possible[n], self.polygon(n));
                let steps = [other.nearest, other.farthest].map(step);
                let all = steps.into_iter().flat_map(move |s| [s.min(z), if open { s } else { s.min(z) }]);
                all.flat_map(move |s| [own.nearest, own.farthest].map(|own| (limit(own), s)))
            };
            let surely = |(near, far): (f64, f64)| far > near && !margin::on_step(near, far);
            let perhaps = |(near, far): (f64, f64)| far > near || margin::on_step(near, far);
            let decided = neighbours(self.rect, at).any(|n| pairs(n).all(surely));
            !decided && neighbours(self.rect, at).any(|n| pairs(n).any(perhaps))
        };
        (0..self.count()).map(is_marginal).collect()
    }

    fn count(&self) -> usize {
        self.rect.width as usize * self.rect.height as usize
    }

    /// Returns the depth of the nearest polygon in pixel `at` (+∞ without one), and true if rounding could change it.
    fn polygon(&self, at: usize) -> (f64, bool) {
        self.polygons.get(at).map_or((f64::INFINITY, false), |hit| (hit.z, hit.marginal))
    }
}

/// Returns the depth at which a pixel's own surface ends: one ε behind [`Threshold::writer_depth`].
fn limit(own: Threshold) -> f64 {
    own.writer_depth + own.epsilon
}

/// Returns the depth at which a neighbour's surface begins: one ε in front of [`Threshold::writer_depth`].
fn step(neighbour: Threshold) -> f64 {
    neighbour.writer_depth - neighbour.epsilon
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::raster::Sums;
    use crate::threshold::PossibleThresholds;

    fn edges<'a>((passes, rect): &'a (Passes, Region), polygons: &'a [Hit]) -> Edges<'a> {
        Edges { passes, polygons, rect: *rect }
    }

    /// Returns the passes' results for a row of pixels whose nearest surfaces have these depths and ε = 0.1. Rounding
    /// could change none of the thresholds.
    fn row(depths: &[f64]) -> (Passes, Region) {
        let at = |depth: f64| Threshold { depth, writer_depth: depth, epsilon: 0.1, ..Threshold::NONE };
        let thresholds: Vec<Threshold> = depths.iter().map(|&z| at(z + 0.1)).collect();
        let possible =
            thresholds.iter().map(|&k| PossibleThresholds { nearest: k, farthest: k, tie: Threshold::NONE }).collect();
        let sums = vec![Sums::default(); depths.len()];
        let rect = Region { x: 0, y: 0, width: depths.len() as u32, height: 1 };
        (Passes { thresholds, sums, possible, fragments: 0 }, rect)
    }

    #[test]
    fn edge_margin_holds_steps_that_rounding_could_take() {
        // A step exists if the neighbour is more than 2ε = 0.2 deeper; the relative margin 1e-4 is 1.2e-4 here.
        for (step, edge, marginal) in
            [(0.1, false, false), (0.2001, true, true), (0.1999, false, true), (0.2002, true, false)]
        {
            let row = row(&[1.0, 1.0 + step]);
            assert_eq!(edges(&row, &[]).pixels()[0], edge, "{step}");
            let found = edges(&row, &[]).marginal();
            assert_eq!(found, [marginal, false], "{step}");
        }
    }

    #[test]
    fn edge_margin_ends_where_another_neighbour_decides() {
        let row = row(&[1.2001, 1.0, 3.0]);
        assert_eq!(edges(&row, &[]).marginal(), [false, false, false]);
    }

    #[test]
    fn edge_margin_follows_marginal_visibility_of_a_neighbour() {
        let mut row = row(&[1.0, 1.0]);
        row.0.possible[1].farthest = Threshold::NONE;
        assert_eq!(edges(&row, &[]).marginal(), [true, false]);
    }

    #[test]
    fn edge_is_none_where_a_polygon_goes_on_with_the_surface() {
        let row = row(&[1.0, 3.0]);
        let polygon = |z, marginal| {
            let mut hit = Hit::NONE;
            (hit.z, hit.marginal) = (z, marginal);
            [Hit::NONE, hit]
        };
        // A polygon within 2ε of the pixel's own surface is no step; a farther one is.
        for (z, edge) in [(1.1, false), (1.19, false), (1.3, true), (4.0, true)] {
            assert_eq!(edges(&row, &polygon(z, false)).pixels()[0], edge, "{z}");
            assert!(!edges(&row, &polygon(z, false)).marginal()[0], "{z}");
        }
        // Rounding could remove the first polygon, and move the second across the limit of a step.
        assert!(edges(&row, &polygon(1.1, true)).marginal()[0]);
        assert!(edges(&row, &polygon(1.2001, false)).marginal()[0]);
    }
}

//! Depth steps between neighbouring pixels, for edge antialiasing by samples (rendering model §5).

use crate::front::MeshLayer;
use crate::layer_compositor::LayerCompositor;
use crate::margin;
use crate::pixels::{center_in, side_neighbours};
use crate::raster::Passes;
use crate::threshold::{PossibleThresholds, Threshold};
use surfel_math::depth::step_allowance;
use surfel_render::{Region, View};

/// Depth range of a pixel's nearest surface, `begin` to `end`. `end` is −∞ if only one of the footprints, unfiltered or
/// filtered, has a surface in the pixel. Such a pixel has a depth step to every neighbour.
#[derive(Clone, Copy, Debug, PartialEq)]
struct DepthRange {
    begin: f64,
    end: f64,
}

impl DepthRange {
    const NONE: Self = Self { begin: f64::INFINITY, end: f64::INFINITY };

    fn of(threshold: Threshold) -> Self {
        Self { begin: threshold.writer_depth - threshold.epsilon, end: threshold.writer_depth + threshold.epsilon }
    }

    /// True if there is a depth step between the two ranges.
    fn steps_to(self, other: Self) -> bool {
        other.begin > self.end || self.begin > other.end
    }

    /// True if rounding could add or remove a depth step between the two ranges.
    fn nearly_steps_to(self, other: Self) -> bool {
        margin::on_step(self.end, other.begin) || margin::on_step(other.end, self.begin)
    }
}

/// Nearest surfaces of a rectangle of pixels, between which depth steps are detected.
pub(crate) struct Steps<'a> {
    pub front: &'a Passes,
    pub meshes: Option<&'a MeshLayer<'a>>,
    /// Passes over the transparent splats in front of opaque surfaces, and each pixel's transparent layers; `None`
    /// without such splats.
    pub transparent: Option<(&'a Passes, &'a [LayerCompositor])>,
    pub rect: Region,
    pub view: &'a View,
}

impl Steps<'_> {
    /// Returns a flag per pixel, true if the pixel is at a step: a neighbour that shares a side is beyond a depth step,
    /// or has another number of transparent layers.
    pub(crate) fn pixels(&self) -> Vec<bool> {
        let reaches: Vec<[DepthRange; 2]> = (0..self.count())
            .map(|at| {
                let opaque = self.opaque(at, self.front.thresholds[at], true);
                [opaque, self.transparent.map_or(DepthRange::NONE, |(passes, _)| DepthRange::of(passes.thresholds[at]))]
            })
            .collect();
        let steps = |a: usize, b: usize| {
            (0..2).any(|i| reaches[a][i].steps_to(reaches[b][i])) || self.layers(a) != self.layers(b)
        };
        (0..self.count()).map(|at| side_neighbours(self.rect, at).any(|n| steps(at, n))).collect()
    }

    /// Returns a flag per pixel, true if rounding could change whether the pixel is at a step. At such a pixel, no
    /// neighbour makes a step for certain, and at least one may.
    pub(crate) fn marginal(&self) -> Vec<bool> {
        let possible: Vec<[Vec<DepthRange>; 2]> = (0..self.count()).map(|at| self.possible(at)).collect();
        let open_layers = |at: usize| self.transparent.is_some_and(|(_, layers)| layers[at].marginal);
        let is_marginal = |at: usize| {
            let mut perhaps = false;
            for n in side_neighbours(self.rect, at) {
                let mut surely = !open_layers(at) && !open_layers(n) && self.layers(at) != self.layers(n);
                perhaps |= open_layers(at) || open_layers(n);
                for (own, other) in possible[at].iter().zip(&possible[n]) {
                    let pairs = || own.iter().flat_map(|a| other.iter().map(|b| (*a, *b)));
                    surely |= pairs().all(|(a, b)| a.steps_to(b) && !a.nearly_steps_to(b));
                    perhaps |= pairs().any(|(a, b)| a.steps_to(b) || a.nearly_steps_to(b));
                }
                if surely {
                    return false;
                }
            }
            perhaps
        };
        (0..self.count()).map(is_marginal).collect()
    }

    fn count(&self) -> usize {
        self.rect.width as usize * self.rect.height as usize
    }

    /// Returns the number of non-empty transparent layers of a pixel.
    fn layers(&self, at: usize) -> u32 {
        self.transparent.map_or(0, |(_, layers)| layers[at].count)
    }

    /// Returns the depth range of the nearest opaque surface in pixel `at`: that of splats with this threshold, or of a
    /// nearer polygon if `with_polygon` is true.
    fn opaque(&self, at: usize, threshold: Threshold, with_polygon: bool) -> DepthRange {
        let splats = DepthRange::of(threshold);
        let hit = self.meshes.filter(|_| with_polygon).map(|meshes| (meshes, meshes.hits[at]));
        let Some((meshes, hit)) = hit.filter(|(_, hit)| hit.z.is_finite()) else {
            let has_weight = self.front.sums[at].weight > 0.0;
            let end = if has_weight == threshold.depth.is_finite() { splats.end } else { f64::NEG_INFINITY };
            return DepthRange { end, ..splats };
        };
        if splats.begin <= hit.z {
            return splats;
        }
        let gradient = meshes.polygons.depth_gradient(&hit, center_in(self.rect, at));
        DepthRange { begin: hit.z, end: hit.z + step_allowance(hit.z, gradient, &self.view.projection) }
    }

    /// Returns all depth ranges that the nearest opaque and the nearest transparent surface could have, for either
    /// result of the tests that rounding could change.
    fn possible(&self, at: usize) -> [Vec<DepthRange>; 2] {
        let all = |possible: &PossibleThresholds| {
            let PossibleThresholds { nearest, farthest, tie } = *possible;
            [nearest, farthest, if tie.depth.is_finite() { tie } else { nearest }]
        };
        let polygon = self.meshes.map(|meshes| meshes.hits[at]);
        let mut opaque = Vec::new();
        for threshold in all(&self.front.possible[at]) {
            opaque.push(self.opaque(at, threshold, true));
            if polygon.is_some_and(|hit| hit.marginal) {
                opaque.push(self.opaque(at, threshold, false));
            }
            // Polygon and splats begin at nearly the same depth, so either may be the nearest surface.
            if polygon.is_some_and(|hit| margin::on_depth(hit.z, threshold.writer_depth - threshold.epsilon)) {
                opaque.push(DepthRange::of(threshold));
            }
        }
        let sums = &self.front.sums[at];
        if polygon.is_none_or(|hit| hit.z.is_infinite()) && sums.marginal && sums.fragments <= 1 {
            // The only fragment may vanish, or a first one may appear.
            opaque.push(DepthRange::of(self.front.thresholds[at]));
            opaque.push(DepthRange { end: f64::NEG_INFINITY, ..DepthRange::of(self.front.thresholds[at]) });
        }
        let transparent = self.transparent.map_or(vec![DepthRange::NONE], |(passes, _)| {
            all(&passes.possible[at]).into_iter().map(DepthRange::of).collect()
        });
        [opaque, transparent]
    }
}

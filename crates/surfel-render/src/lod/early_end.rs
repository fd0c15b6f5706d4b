//! Early end of a selection of LOD nodes, before all splats are as small as requested.

use super::{Eye, FADE_OCTAVES, LevelNode};
use glam::DVec3;
use std::ops::Range;

/// Smallest number of points per pixel of the views at which a selection of LOD nodes may end early. More points hardly
/// change an image, since each contributes little to a pixel's colour.
const POINTS_A_PIXEL: u64 = 5;
/// Smallest number of selected points at which a selection may end early. Fewer points are read quickly, so that
/// skipping some of them gains nothing.
const MIN_POINTS: u64 = 1_000_000;
/// Largest ratio of the actual error to the requested error, both sizes of splats in pixels, where finer points are
/// skipped. A ratio of 2 is one level of detail.
const MAX_ERRORS: f64 = 2.0;
/// Largest fractions of the views' area in which points may be skipped. The first applies if splats there are
/// [`MAX_ERRORS`] times as large as requested, the second if they are barely larger than requested. Elsewhere the
/// image is as fine as requested, or as fine as the file.
const MAX_SKIPPED_FRACTIONS: [f64; 2] = [0.25, 0.375];
/// Number of cells along each side of an image. The fraction of cells with skipped nodes measures how much of the image
/// lacks points.
const CELLS: usize = 64;

/// Number of candidate errors per octave (factor of 2) at which the early end of a selection is tested.
const STEPS: i32 = 64;

/// Test whether a selection of LOD nodes may end early: the image has enough points although some of its splats are
/// larger than requested.
///
/// On a slanted surface, such as land toward the horizon, a splat's size is a poor measure of the number of points per
/// pixel. Land that is foreshortened to 1/16 of its area has 16 times as many. A selection ends once it has
/// [`POINTS_A_PIXEL`] per pixel of its views, and [`MIN_POINTS`] in total. The remaining nodes are skipped: since the
/// largest splats are refined first, these are the farthest ones. Splats of skipped nodes may be up to [`MAX_ERRORS`]
/// times too large while they cover at most a quarter of the views' area. Over a larger part, the allowed error
/// decreases evenly ([`MAX_SKIPPED_FRACTIONS`]). At the end of a selection, levels fade in ([`FADE_OCTAVES`]). A node
/// that has not faded in completely counts as skipped. The decision depends only on the nodes and the views, so an
/// image is the same for any threads and caches. The constants are measured on land seen at a slant. There, an image
/// with half of the points differs from that of the full selection by a mean FLIP of 0.002.
pub(super) struct EarlyEnd<'a> {
    /// The views that the selection is for, relative to the object.
    eyes: &'a [Eye<'a>],
    /// Nodes required for the requested error, the largest size first. The size, in pixels, is that of the coarser
    /// splats drawn where the node isn't selected.
    wanted: &'a [(f64, &'a LevelNode)],
    /// Number of visible nodes that are skipped or have not completely faded in, per cell of each view.
    skipped_per_cell: Vec<u32>,
    /// Number of cells in which skipped or partly faded-in nodes are visible: the number of nonzero elements of
    /// `skipped_per_cell`.
    cells: usize,
}

impl<'a> EarlyEnd<'a> {
    /// Returns the error in pixels at which a selection may end early; `None` if it may not end above `least_px`.
    /// `wanted` are the nodes required for the error `error_px`, the largest first.
    pub(super) fn error_px(
        eyes: &'a [Eye<'a>],
        wanted: &'a [(f64, &'a LevelNode)],
        (error_px, least_px): (f64, f64),
    ) -> Option<f64> {
        let pixels: u64 = eyes.iter().map(|eye| eye.view.size.map(u64::from)).map(|[w, h]| w.saturating_mul(h)).sum();
        let least_points = pixels.saturating_mul(POINTS_A_PIXEL).max(MIN_POINTS);
        let all = wanted.iter().fold(0_u64, |sum, (_, node)| sum.saturating_add(node.points));
        if all < least_points {
            return None;
        }
        let mut enough = Self { eyes, wanted, skipped_per_cell: vec![0; eyes.len() * CELLS * CELLS], cells: 0 };
        let (mut taken, mut in_place, mut points) = (0, 0, 0_u64);
        let is_above = |i: usize, size_px: f64| wanted.get(i).is_some_and(|(size, _)| *size > size_px);
        let most_px = MAX_ERRORS * error_px;
        while is_above(in_place, most_px * FADE_OCTAVES.exp2()) {
            in_place += 1;
        }
        (in_place..wanted.len()).for_each(|i| enough.mark_skipped(i));
        for step in 0..STEPS {
            let size_px = most_px * (-f64::from(step) / f64::from(STEPS)).exp2();
            while is_above(in_place, size_px * FADE_OCTAVES.exp2()) {
                enough.put(in_place);
                in_place += 1;
            }
            while is_above(taken, size_px) {
                points = points.saturating_add(wanted[taken].1.points);
                taken += 1;
            }
            if size_px <= least_px || enough.cells == 0 {
                break;
            }
            if points >= least_points && size_px <= error_px * enough.most_errors() {
                return Some(size_px);
            }
        }
        None
    }

    /// Returns the largest ratio to the requested error that is allowed for the current number of cells with skipped
    /// nodes.
    fn most_errors(&self) -> f64 {
        let share = self.cells as f64 / self.skipped_per_cell.len() as f64;
        let least = (MAX_SKIPPED_FRACTIONS[1] - share) / (MAX_SKIPPED_FRACTIONS[1] - MAX_SKIPPED_FRACTIONS[0]);
        1.0 + least.min(1.0) * (MAX_ERRORS - 1.0)
    }

    /// Marks the node at this index of `wanted` as skipped, in the cells where it may be visible.
    fn mark_skipped(&mut self, wanted: usize) {
        for cell in cells_of(self.eyes, self.wanted[wanted].1) {
            self.skipped_per_cell[cell] += 1;
            self.cells += usize::from(self.skipped_per_cell[cell] == 1);
        }
    }

    /// Undoes [`Self::mark_skipped`] for the node at this index of `wanted`, which is selected and completely faded in.
    fn put(&mut self, wanted: usize) {
        for cell in cells_of(self.eyes, self.wanted[wanted].1) {
            self.skipped_per_cell[cell] -= 1;
            self.cells -= usize::from(self.skipped_per_cell[cell] == 0);
        }
    }
}

/// Returns the indices of the cells, of all views, in which a node may be visible.
fn cells_of(eyes: &[Eye<'_>], node: &LevelNode) -> impl Iterator<Item = usize> {
    let of_view = |(i, eye): (usize, &Eye<'_>)| {
        let [columns, rows] = cells_in_view(eye, node);
        rows.flat_map(move |row| columns.clone().map(move |column| (i * CELLS + row) * CELLS + column))
    };
    eyes.iter().enumerate().flat_map(of_view)
}

/// Returns the columns and rows of a view's cells that contain the visible part of a node's cube. Returns all cells if
/// a part of the cube is nearer than the near plane.
fn cells_in_view(eye: &Eye<'_>, node: &LevelNode) -> [Range<usize>; 2] {
    let projection = &eye.view.projection;
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for corner in 0..8 {
        let side = |k: u32| if corner >> k & 1 == 1 { node.half } else { -node.half };
        let at = eye.at(node.center + DVec3::new(side(0), side(1), side(2)));
        let is_near = at.z < projection.near;
        let depth = if projection.is_perspective() { at.z } else { 1.0 };
        for k in 0..2 {
            let px = at[k] / depth * projection.focal_px[k] + projection.principal_px[k];
            low[k] = if is_near { f64::NEG_INFINITY } else { low[k].min(px) };
            high[k] = if is_near { f64::INFINITY } else { high[k].max(px) };
        }
    }
    [0, 1].map(|k| {
        let cell = |px: f64| px / f64::from(eye.view.size[k]) * CELLS as f64;
        // The conversion saturates numbers out of range.
        let (start, end) = (cell(low[k]).floor() as usize, cell(high[k]).ceil() as usize);
        start.min(CELLS)..end.min(CELLS)
    })
}

#[cfg(test)]
mod tests {
    use super::super::{LevelSelection, StopReason, select_levels};
    use super::*;
    use crate::View;
    use glam::DAffine3;
    use surfel_model::Camera;

    const LEVELS: u32 = 7;

    /// Returns a plane of 1024 x 1024 cells of size 1 in levels of nodes, with points spaced by a 64th of a node's
    /// side.
    fn plane(points: u64) -> Vec<LevelNode> {
        let mut nodes = Vec::new();
        for level in 0..LEVELS {
            let (cells, side) = (1_u32 << level, 1024.0 / f64::from(1_u32 << level));
            let first = nodes.len() as u32 + cells * cells;
            for i in 0..cells * cells {
                let bit = |k: u32, shift: u32| (i >> (2 * k + shift) & 1) << k;
                let at = |shift| (0..level).map(|k| bit(k, shift)).sum::<u32>();
                let middle = |c: u32| (f64::from(c) + 0.5) * side - 512.0;
                let children = if level + 1 == LEVELS { 0..0 } else { first + 4 * i..first + 4 * i + 4 };
                let center = DVec3::new(middle(at(0)), middle(at(1)), 0.0);
                let splat_radius = std::f64::consts::SQRT_2 * side / 64.0;
                nodes.push(LevelNode { center, half: side / 2.0, splat_radius, points, children });
            }
        }
        nodes
    }

    fn slanted(height: f64, size: u32) -> View {
        let camera = Camera::perspective([-500.0, -90.0, height], [-410.0, -45.0, 0.0], 45.0, [size, size]);
        View::new(&camera.with_up([0.0, 0.0, 1.0])).unwrap()
    }

    fn chosen(nodes: &[LevelNode], view: &View, error_px: f64) -> LevelSelection {
        select_levels(nodes, &DAffine3::IDENTITY, std::slice::from_ref(view), error_px, 1 << 40)
    }

    #[test]
    fn slant_ends_early_within_twice_the_error() {
        let (nodes, view) = (plane(4096), slanted(30.0, 400));
        let found = chosen(&nodes, &view, 1.0);
        assert!(found.end == StopReason::EnoughPoints && found.points >= 1_000_000, "{found:?}");
        assert!(found.error_px > 1.0 && found.error_px <= MAX_ERRORS);
        // With fewer points in the same nodes, none is skipped.
        let all = chosen(&plane(1024), &view, 1.0);
        assert!(all.end == StopReason::Error && all.error_px <= 1.0 && all.nodes.len() > found.nodes.len());
        assert!(found.nodes.iter().all(|i| all.nodes.contains(i)));
        // A larger image needs 5 points per pixel.
        let points = chosen(&nodes, &slanted(30.0, 700), 1.0).points;
        assert!(points >= 5 * 700 * 700, "{points}");
    }

    /// On a surface that faces the eye, a splat that is too large is visible.
    #[test]
    fn nothing_is_left_out_of_most_of_a_picture() {
        let camera = Camera::perspective([0.0, 0.0, 300.0], [0.0; 3], 45.0, [400, 400]).with_up([0.0, 1.0, 0.0]);
        let view = View::new(&camera).unwrap();
        for error_px in [0.4, 0.6, 1.0, 1.5, 2.0] {
            let found = chosen(&plane(1 << 16), &view, error_px);
            assert!(found.points > MIN_POINTS && found.end == StopReason::Error, "{error_px}: {found:?}");
        }
    }

    #[test]
    fn error_changes_little_from_one_view_to_the_next() {
        let nodes = plane(4096);
        let (mut last, mut ends, mut largest) = (None, [0; 2], 0.0_f64);
        for step in 0..400 {
            let found = chosen(&nodes, &slanted(600.0 * 0.99_f64.powi(step), 400), 1.0);
            ends[usize::from(found.end == StopReason::EnoughPoints)] += 1;
            let error_px = found.error_px.max(1.0);
            let change = last.map_or(0.0, |last: f64| (error_px / last).log2().abs());
            (last, largest) = (Some(error_px), largest.max(change));
        }

        assert!(ends[0] > 20 && ends[1] > 20 && largest < 0.125, "{ends:?} {largest}");
    }

    #[test]
    fn cells_are_those_that_a_node_shows_in() {
        let nodes = plane(1);
        for view in [slanted(30.0, 400), slanted(300.0, 640)] {
            let eye = Eye::new(&DAffine3::IDENTITY, surfel_model::Cull::None, &view);
            for node in &nodes[1..] {
                let [columns, rows] = cells_in_view(&eye, node);
                for step in 0..81 {
                    let at = [step % 9, step / 9].map(|v| f64::from(v) / 4.0 - 1.0);
                    let p = eye.at(node.center + node.half * DVec3::new(at[0], at[1], 0.0));
                    let pixel = |k: usize| p[k] / p.z * view.projection.focal_px[k] + view.projection.principal_px[k];
                    let cell = |k: usize| pixel(k) / f64::from(view.size[k]) * CELLS as f64;
                    let shows = p.z >= view.projection.near && [0, 1].iter().all(|k| (0.0..64.0).contains(&cell(*k)));
                    let [column, row] = [0, 1].map(|k| cell(k) as usize);
                    // A point on a border is in both cells.
                    let is_in = columns.contains(&column) || columns.end == column;
                    assert!(!shows || is_in && (rows.contains(&row) || rows.end == row), "{node:?}");
                }
            }
        }
    }
}

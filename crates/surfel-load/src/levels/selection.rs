//! Selection of the nodes of a COPC file for an overview or for views.

use super::{LevelReport, Levels};
use crate::LoadOptions;
use std::path::Path;
use surfel_io::copc::{Copc, CopcNode, LevelValues};
use surfel_model::{Outliers, PointColors};
use surfel_render::{FADE_OCTAVES, LevelNode, Magnification, SplatVisibility, StopReason, select_levels};

/// Largest number of points in an overview of a file: its coarsest levels, which are enough to place a camera. The
/// first level that has points may have more.
const OVERVIEW_POINTS: u64 = 100_000;

/// Ratio of splat radius to point spacing at which the splats of a level cover the surface without gaps. The points of
/// a level are those nearest to the centres of grid cells whose side is the spacing. So no position is farther from the
/// nearest point than the diagonal of a cell's face.
pub(super) const COVERING_RADIUS: f32 = std::f32::consts::SQRT_2;

/// Nodes selected from a COPC file, and how their points are drawn.
pub(super) struct Selection {
    /// Indices of the selected nodes into the file's nodes.
    pub(super) nodes: Vec<u32>,
    pub(super) cut: NodeStates,
    /// Fading between levels; `None` for an overview and for several views, whose points don't fade.
    pub(super) fade: Option<Fade>,
    pub(super) report: LevelReport,
}

impl Selection {
    /// True if a view lacks some of the file's points, or if some of its points are fading in. False for an overview.
    pub(super) fn is_partial(&self, levels: &Levels) -> bool {
        *levels != Levels::Overview && (!self.report.is_whole() || self.cut.fades)
    }
}

/// Selects the nodes for an overview, or for views with at most `most` points.
pub(super) fn select(copc: &Copc, levels: &Levels, options: &LoadOptions, most: u64) -> Selection {
    let mut fade = None;
    let (nodes, error_px, end) = match levels {
        Levels::Overview => (overview(copc.nodes()), 0.0, StopReason::Error),
        Levels::Views { views, world_from_object, error_px, .. } => {
            let nodes: Vec<LevelNode> = copc.nodes().iter().map(|node| level_node(copc, node)).collect();
            // Levels fade in over an interval of errors whose geometric mean is `error_px`.
            let from_px = if views.len() == 1 { error_px * (-0.5 * FADE_OCTAVES).exp2() } else { *error_px };
            let found = select_levels(&nodes, world_from_object, views, from_px, most);
            // Images that share one selection never switch to another, so that no fading is needed.
            if let [view] = &views[..] {
                let magnification = Magnification::new(world_from_object, view);
                fade = Some(Fade { magnification, error_px: from_px.max(found.error_px) });
            }
            (found.nodes, found.error_px, found.end)
        }
    };
    let cut = match levels {
        Levels::Overview => NodeStates::default(),
        Levels::Views { .. } => {
            let keeps = options.level_store.as_ref().is_some_and(|store| store.caches_nodes());
            NodeStates::new(copc, &nodes, fade.as_ref(), keeps)
        }
    };
    let all = copc.nodes();
    let chosen = || nodes.iter().map(|i| &all[*i as usize]);
    let report = LevelReport {
        points: [chosen().map(|n| n.points).sum(), copc.points()],
        nodes: [nodes.len(), all.len()],
        bytes: [chosen().map(|n| n.bytes).sum(), all.iter().map(|n| n.bytes).sum()],
        error_px: fade.as_ref().filter(|_| cut.fades).map_or(error_px, |fade| fade.error_px),
        end,
    };
    Selection { nodes, cut, fade, report }
}

/// Returns the selection of levels that the options request for a file; `None` to read all points, as from stdin and if
/// isolated points are dropped.
pub(crate) fn chosen<'a>(path: &Path, options: &'a LoadOptions) -> Option<&'a Levels> {
    // Isolated points can't be detected in a coarse level, whose points lack their finer neighbours.
    let is_by_levels =
        options.convert.outliers != Some(Outliers::Drop) && (options.stdin.is_none() || path != Path::new("-"));
    options.levels.as_ref().filter(|_| is_by_levels)
}

/// Returns the visibility test by which points outside of the frustum are skipped. Returns `None` if the levels state
/// no margin for skipping, or if skipping points would change estimates for other points, or row numbers.
pub(super) fn visibility<'a>(levels: &'a Levels, copc: &Copc, options: &LoadOptions) -> Option<SplatVisibility<'a>> {
    let Levels::Views { views, world_from_object, margin_px: Some(margin_px), .. } = levels else { return None };
    let is_of_all =
        options.interior_weight || options.convert.sharp || options.convert.colors == Some(PointColors::Fit);
    let has_rows = options.rows || options.label.is_some() || options.chooses_points();
    let is_alone = copc.has_splats() && !is_of_all && !has_rows;
    is_alone.then(|| SplatVisibility::new(world_from_object, views, *margin_px))
}

/// Selects whole levels from the root down, with at most [`OVERVIEW_POINTS`] points but at least the first level that
/// has points.
fn overview(nodes: &[CopcNode]) -> Vec<u32> {
    let (mut chosen, mut points) = (0, 0);
    for level in nodes.chunk_by(|a, b| a.level == b.level) {
        points += level.iter().map(|node| node.points).sum::<u64>();
        // The first level that has points is always selected.
        if points > OVERVIEW_POINTS && nodes[..chosen].iter().any(|node| node.points > 0) {
            break;
        }
        chosen += level.len();
    }
    (0..chosen as u32).collect()
}

fn level_node(copc: &Copc, node: &CopcNode) -> LevelNode {
    let (center, half) = copc.cube(node);
    let splat_radius = f64::from(COVERING_RADIUS) * copc.spacing(node.level);
    LevelNode { center, half, splat_radius, points: node.points, children: node.children.clone() }
}

/// Fading between levels while a camera approaches, so that nothing pops.
///
/// A level begins to fade in where the projected splat radius of the level above equals the tolerated error. It has
/// faded in where this radius is √2 times the error. In between, the area of each new splat grows linearly from 0. The
/// areas of the existing splats shrink linearly to those of the new level, a quarter. On a surface, a level has three
/// times as many points as all levels above it together. So the covered area stays constant, and the new splats'
/// fraction of it grows linearly.
pub(super) struct Fade {
    pub(super) magnification: Magnification,
    error_px: f64,
}

impl Fade {
    /// Returns the projected radius of splats that cover a level with point spacing 1, as a multiple of the tolerated
    /// error. `pixels` is the magnification in pixels per unit of length.
    pub(super) fn errors(&self, pixels: f64) -> f64 {
        f64::from(COVERING_RADIUS) * pixels / self.error_px
    }

    /// True if all points of a node have faded in, so that the level above no longer replaces them.
    fn is_done(&self, copc: &Copc, node: &CopcNode) -> bool {
        let (center, half) = copc.cube(node);
        let above = node.level.checked_sub(1).map(|above| copc.spacing(above));
        above.is_none_or(|above| self.errors(self.magnification.least_in(center, half)) * above >= FADE_OCTAVES.exp2())
    }
}

/// State of each node of the file relative to a selection. Each list has one entry per node of the file.
#[derive(Default)]
pub(super) struct NodeStates {
    pub(super) is_chosen: Vec<bool>,
    /// Values that are read for each node's points: their own, averages over missing finer points, or both. Averages
    /// are needed where finer points are missing or fade in. Both kinds are needed if this holds in only some parts of
    /// the node.
    pub(super) values: Vec<LevelValues>,
    /// True if the node and all of its descendants are selected and have faded in. Their points are drawn like ordinary
    /// points, without enlargement or fading.
    pub(super) is_complete: Vec<bool>,
    /// True if some selected nodes are still fading in, so that the next image of a moving camera differs.
    fades: bool,
}

impl NodeStates {
    /// Computes the states of all nodes if the nodes `chosen` are selected. `keeps` is true if nodes are cached; they
    /// then get all values that later selections may need.
    fn new(copc: &Copc, chosen: &[u32], fade: Option<&Fade>, keeps: bool) -> Self {
        let all = copc.nodes();
        let mut is_chosen = vec![false; all.len()];
        chosen.iter().for_each(|i| is_chosen[*i as usize] = true);
        let mut is_done = vec![false; all.len()];
        let done = |i: &u32| fade.is_none_or(|fade| fade.is_done(copc, &all[*i as usize]));
        chosen.iter().for_each(|i| is_done[*i as usize] = done(i));
        let fades = chosen.iter().any(|i| !is_done[*i as usize] && all[*i as usize].points > 0);
        let missing = |node: &CopcNode| node.children.clone().any(|child| !is_done[child as usize]);
        // The first selected node with points determines whether the cloud has colours and normals.
        let first = chosen.iter().map(|i| &all[*i as usize]).find(|node| node.points > 0).map_or(0, |node| node.level);
        let value =
            |node: &CopcNode| match (missing(node), node.children.clone().any(|child| is_chosen[child as usize])) {
                (false, _) => LevelValues::Without,
                (true, false) if node.level > first && !keeps => LevelValues::Alone,
                (true, _) => LevelValues::With,
            };
        let values: Vec<LevelValues> = all.iter().map(value).collect();
        let mut is_complete = is_done;
        for (i, node) in all.iter().enumerate().rev() {
            is_complete[i] &=
                values[i] == LevelValues::Without && node.children.clone().all(|child| is_complete[child as usize]);
        }
        Self { is_chosen, values, is_complete, fades }
    }
}

//! Levels of detail for points: reading what a view needs of a COPC file, and writing COPC files.

pub use crate::level_choice::{Levels, Seen};

use crate::options::io_options;
use crate::words::counted;
use crate::{Error, LoadOptions, memory};
use glam::{DAffine3, DVec3, Vec3};
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use surfel_io::atomic::Temporary;
pub use surfel_io::copc::resume_folder;
use surfel_io::copc::{
    Copc, CopcNode, CopcOptions, CopcReport, Keeps, LEAST_MEMORY, LEVEL_COLORS, LEVEL_NORMALS, LevelValues,
    NodeColumns, PointSplat, RADIUS, save_temporary_copc,
};
use surfel_io::{Content, Loaded};
use surfel_model::{
    CloudData, Column3, ExtraColumn, ExtraValues, OnInvalid, Outliers, PointCloud, PointColors, Shape, SplatCloud,
    TableColumns,
};
use surfel_render::{FADE_OCTAVES, LevelEnd, LevelNode, Magnification, Sight, View, select_levels};
use surfel_sample::{PointOptions, PointReport, Progress};

/// Largest number of points in an overview.
const OVERVIEW_POINTS: u64 = 100_000;
/// Largest number of points drawn for a view, unless the options state another.
pub const DEFAULT_MOST_POINTS: u64 = 10_000_000;
/// Ratio of splat radius to point spacing at which a level's splats cover the surface without gaps. A level's points
/// are those nearest to the centres of grid cells, so no place is farther from the nearest point than the diagonal of a
/// cell's face.
const CLOSING: f32 = std::f32::consts::SQRT_2;
/// Largest factor by which an estimated radius grows to cover a level. Where points are denser than the level's spacing
/// suggests, the spacing is meaningless. Radii stated in the file aren't limited, since they were estimated from all
/// points.
const MOST_GROWN: f32 = 4.0;
/// Radius of a splat that starts to fade in, relative to its final radius: 1/400 of the area.
const LEAST_GROWN: f64 = 0.05;
/// Fewest points from which splats are estimated.
const LEAST_POINTS: usize = 16;

/// Internal column with the spacing of points where finer points are missing, else 0. It exists until splats are made.
const SPACING: &str = "surfel_level_spacing";
/// Internal column with the fade-in radius of each point relative to its final radius. It exists if the file states no
/// radii, until splats are made.
const GROWTH: &str = "surfel_level_growth";

/// Report of what was read from a COPC file.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LevelReport {
    /// Points read, and points in the file.
    pub points: [u64; 2],
    /// Nodes read, and nodes in the file.
    pub nodes: [usize; 2],
    /// Compressed bytes read, and in the file.
    pub bytes: [u64; 2],
    /// Largest splat radius in pixels where finer visible points are missing; 0 for an overview.
    pub error_px: f64,
    /// Stop reason of the selection.
    pub end: LevelEnd,
}

impl LevelReport {
    /// True if all points were read.
    pub fn is_whole(&self) -> bool {
        self.points[0] == self.points[1]
    }
}

/// True if `path` is a regular file that can be opened.
fn is_file(path: &Path) -> bool {
    matches!(surfel_io::RegularFile::open(path), Ok(Some(_)))
}

/// True if `path` is a COPC file that can be read.
pub fn has_levels(path: &Path) -> bool {
    matches!(Copc::open(path), Ok(Some(_)))
}

/// Returns the selection that the options state for a file; `None` reads all points.
pub(crate) fn chosen<'a>(path: &Path, options: &'a LoadOptions) -> Option<&'a Levels> {
    // Without its finer neighbours, a coarse level's points would count as isolated.
    let is_by_levels = options.outliers == Outliers::Keep && (options.stdin.is_none() || path != Path::new("-"));
    options.levels.as_ref().filter(|_| is_by_levels)
}

/// Reads the selected nodes of the COPC file at `copc_path`, which is `path` itself or a copy of it. Returns `None` if
/// the options ask for all points, or the file isn't COPC.
pub(crate) fn read(
    path: &Path,
    copc_path: &Path,
    options: &LoadOptions,
) -> Result<Option<(Loaded, LevelReport)>, Error> {
    let Some(levels) = chosen(path, options) else { return Ok(None) };
    let opened = Copc::open(copc_path).or_else(|error| if is_file(copc_path) { Err(error) } else { Ok(None) });
    let Some(copc) = opened? else { return Ok(None) };
    // The allocator still holds memory from writing the file.
    let left = options.level_store.as_ref().filter(|_| path != copc_path).map_or(0, |store| store.left_bytes());
    let budget = options.memory.or_else(memory::default_budget).map(|bytes| bytes.saturating_sub(left));
    let point_bytes = if copc.has_colors() { memory::KNOWN_COLORED_BYTES } else { memory::KNOWN_BYTES };
    let fitting = budget.map_or(u64::MAX, |bytes| bytes / point_bytes);
    let most = options.max_points.map_or(DEFAULT_MOST_POINTS.min(fitting), |most| most as u64);
    let mut fade = None;
    let (nodes, error_px, end) = match levels {
        Levels::Overview => (overview(copc.nodes()), 0.0, LevelEnd::Error),
        Levels::Views { views, world_from_object, error_px, .. } => {
            let nodes: Vec<LevelNode> = copc.nodes().iter().map(|node| level_node(&copc, node)).collect();
            // A level begins to fade in before its error is reached, and finishes as much later.
            let from_px = if views.len() == 1 { error_px * (-0.5 * FADE_OCTAVES).exp2() } else { *error_px };
            let found = select_levels(&nodes, world_from_object, views, from_px, most);
            // Images that share a selection never switch to another, so they don't fade.
            if let [view] = &views[..] {
                let magnification = Magnification::new(world_from_object, view);
                fade = Some(Fade { magnification, error_px: from_px.max(found.error_px) });
            }
            (found.nodes, found.error_px, found.end)
        }
    };
    let all = copc.nodes();
    let chosen = || nodes.iter().map(|i| &all[*i as usize]);
    let cut = match levels {
        Levels::Overview => Cut::default(),
        Levels::Views { .. } => {
            let keeps = options.level_store.as_ref().is_some_and(|store| store.keeps_nodes());
            Cut::new(&copc, &nodes, fade.as_ref(), keeps)
        }
    };
    let report = LevelReport {
        points: [chosen().map(|n| n.points).sum(), copc.points()],
        nodes: [nodes.len(), all.len()],
        bytes: [chosen().map(|n| n.bytes).sum(), all.iter().map(|n| n.bytes).sum()],
        error_px: fade.as_ref().filter(|_| cut.fades).map_or(error_px, |fade| fade.error_px),
        end,
    };
    memory::check(path, report.points[0], point_bytes, options.memory, memory::Remedy::Fewer)?;
    let room = budget.map(|all| all.saturating_sub(report.points[0] * point_bytes));
    let copc = copc.with_cache(options.level_store.as_ref().and_then(|store| store.nodes(room)));
    // Any column may be part of a condition.
    let has_choice = options.chooses_classes() || options.returns.is_some() || options.condition.is_some();
    // An overview reads all columns: it must classify noise, which may not influence the camera.
    let has_values = options.color_by.is_some() || options.label.is_some() || *levels == Levels::Overview;
    let is_partial = *levels != Levels::Overview && (!report.is_whole() || cut.fades);
    let columns = match has_choice || has_values {
        true => NodeColumns::All,
        false => NodeColumns::Splats(if is_partial { &cut.values } else { &[] }),
    };
    // With more points than `max_points`, some are dropped evenly.
    let is_thinned = options.max_points.is_some_and(|most| report.points[0] > most as u64);
    let sight = sight(levels, &copc, options).filter(|_| columns != NodeColumns::All && !is_thinned);
    let shows = |level: u32, center: DVec3, radius: f64| {
        // Finer points may be missing.
        let reach = (radius * options.radius_scale).max(f64::from(CLOSING) * copc.spacing(level));
        !is_known(&(radius as f32)) || sight.as_ref().is_none_or(|sight| sight.shows(center, reach))
    };
    let keeps = sight.is_some().then_some(&shows as Keeps<'_>);
    // A copy names the columns of its source itself.
    let names = options.columns.clone().filter(|_| path == copc_path);
    let io_options = surfel_io::LoadOptions { columns: names, ..io_options(options) };
    let mut found = copc.kept_points_of(&nodes, (columns, keeps), &io_options)?;
    if let Content::Points(points) = &mut found.loaded.content {
        if options.rows || options.label.is_some() {
            points.rows = Some(rows(&copc, &nodes, points, path)?);
        }
        if is_partial {
            mark(&copc, &cut, fade.as_ref(), (&nodes, &found.ends), points);
        }
    }
    if is_partial {
        let limit = match options.max_points {
            Some(_) => "`max_points` ends it",
            None if most < DEFAULT_MOST_POINTS => "`memory` ends it",
            None => "`max_points` raises the limit that ends it",
        };
        found.loaded.notes.push(note(&report, limit));
    }
    Ok(Some((found.loaded, report)))
}

/// Returns the visibility test for points, if skipping points outside the frustum changes neither the estimates for
/// other points nor the row numbers.
fn sight<'a>(levels: &'a Levels, copc: &Copc, options: &LoadOptions) -> Option<Sight<'a>> {
    let Levels::Views { views, world_from_object, sight_px: Some(margin_px), .. } = levels else { return None };
    let is_of_all = options.interior_weight || options.sharp || options.colors != PointColors::AsIs;
    let has_rows = options.rows || options.label.is_some() || options.chooses_points();
    let is_alone = copc.has_splats() && !is_of_all && !has_rows;
    is_alone.then(|| Sight::new(world_from_object, views, *margin_px))
}

/// Returns each point's row in the file, for points read from these nodes. `read.rows` holds the rows among all points
/// that were decoded.
fn rows(copc: &Copc, nodes: &[u32], read: &PointCloud, path: &Path) -> Result<Vec<u32>, Error> {
    // Row 4294967295 means that there is no splat.
    if copc.points() >= u64::from(u32::MAX) {
        let problem = format!(
            "has {} points, and rows of a plane end at 4294967294: leave out the planes index and label",
            copc.points()
        );
        return Err(Error::Unsuitable { path: path.to_path_buf(), problem });
    }
    let first = copc.first_rows();
    let in_file = nodes.iter().flat_map(|node| {
        let first = first[*node as usize];
        (first..first + copc.nodes()[*node as usize].points).map(|row| row as u32)
    });
    Ok(match &read.rows {
        None => in_file.collect(),
        Some(kept) => {
            let in_file: Vec<u32> = in_file.collect();
            kept.iter().map(|row| in_file[*row as usize]).collect()
        }
    })
}

/// Describes which nodes a selection omits, why, and the option that changes it.
fn note(report: &LevelReport, limit: &str) -> String {
    let mebibytes = report.bytes.map(|bytes| bytes as f64 / f64::from(1 << 20));
    let (error_px, finer) = (report.error_px, "`lod_error` draws finer ones");
    let why = match report.end {
        LevelEnd::Points => format!("{limit} at splats of {error_px:.1} px"),
        LevelEnd::Enough => format!("more than 5 points a pixel at splats of {error_px:.2} px; {finer}"),
        LevelEnd::Error => format!("splats of {error_px:.2} px at most; {finer}"),
    };
    format!(
        "drawn by levels: {} of {} nodes, {:.1} of {:.1} MiB read ({why}; `all_levels` draws all points)",
        report.nodes[0], report.nodes[1], mebibytes[0], mebibytes[1]
    )
}

/// Selects whole levels from the root down, as many as fit [`OVERVIEW_POINTS`].
fn overview(nodes: &[CopcNode]) -> Vec<u32> {
    let (mut chosen, mut points) = (0, 0);
    for level in nodes.chunk_by(|a, b| a.level == b.level) {
        points += level.iter().map(|node| node.points).sum::<u64>();
        // At least the first level with points is selected.
        if points > OVERVIEW_POINTS && nodes[..chosen].iter().any(|node| node.points > 0) {
            break;
        }
        chosen += level.len();
    }
    (0..chosen as u32).collect()
}

fn level_node(copc: &Copc, node: &CopcNode) -> LevelNode {
    let (center, half) = copc.cube(node);
    let splat_radius = f64::from(CLOSING) * copc.spacing(node.level);
    LevelNode { center, half, splat_radius, points: node.points, children: node.children.clone() }
}

/// Fading between levels while a view approaches, so that nothing pops.
///
/// The fade begins where splats of the level above measure the error, and ends where they measure √2 of it. Meanwhile
/// the area of each new splat grows linearly from 0 to its own, and the areas of the existing splats shrink linearly to
/// the new level's, a quarter. On a surface a level has three times as many points as all levels above it together.
/// Hence the covered area stays constant, and the new splats' fraction of it grows linearly too.
struct Fade {
    magnification: Magnification,
    error_px: f64,
}

impl Fade {
    /// Returns the radius of splats that cover a level with point spacing 1, in units of the error.
    fn errors(&self, pixels: f64) -> f64 {
        f64::from(CLOSING) * pixels / self.error_px
    }

    /// True if all points of a node have faded in, and the level above is no longer drawn.
    fn is_done(&self, copc: &Copc, node: &CopcNode) -> bool {
        let (center, half) = copc.cube(node);
        let above = node.level.checked_sub(1).map(|above| copc.spacing(above));
        above.is_none_or(|above| self.errors(self.magnification.least_in(center, half)) * above >= FADE_OCTAVES.exp2())
    }
}

/// Boundary of a selection of nodes; the lists have an entry per node of the file.
#[derive(Default)]
struct Cut {
    is_chosen: Vec<bool>,
    /// Values of each node's points: their own, averages for unselected children, or both. Averages are needed where
    /// children are missing or fade in; both, where only some are.
    values: Vec<LevelValues>,
    /// True if the node and all nodes below it are drawn as if there were no levels.
    is_complete: Vec<bool>,
    /// True if some selected nodes fade in.
    fades: bool,
}

impl Cut {
    /// Computes the boundary of a selection. With `keeps`, nodes that stay cached have all values that later selections
    /// may need.
    fn new(copc: &Copc, chosen: &[u32], fade: Option<&Fade>, keeps: bool) -> Self {
        let all = copc.nodes();
        let mut is_chosen = vec![false; all.len()];
        chosen.iter().for_each(|i| is_chosen[*i as usize] = true);
        let mut is_done = vec![false; all.len()];
        let done = |i: &u32| fade.is_none_or(|fade| fade.is_done(copc, &all[*i as usize]));
        chosen.iter().for_each(|i| is_done[*i as usize] = done(i));
        let fades = chosen.iter().any(|i| !is_done[*i as usize] && all[*i as usize].points > 0);
        let missing = |node: &CopcNode| node.children.clone().any(|child| !is_done[child as usize]);
        // The first nodes with points decide whether the cloud has colours and normals at all.
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

/// Drawing parameters of a point that depend on its level.
#[derive(Clone, Copy, PartialEq)]
struct Mark {
    /// Point spacing where finer points are missing, else 0.
    spacing: f32,
    /// Fraction of the level's averages in the point's colour and normal, for the finer points that are missing.
    /// Negative if the point isn't drawn.
    share: f32,
    /// Radius relative to the final radius.
    growth: f32,
}

/// Computes the drawing parameters of a point of `level`, where the selected nodes end at level `deepest`; `is_missing`
/// if the file has finer points there. If levels fade, a splat that covers a level with point spacing 1 measures
/// `errors` times the error.
fn mark_of(
    level: u32,
    (mut deepest, mut is_missing): (u32, bool),
    errors: Option<f64>,
    spacing: impl Fn(u32) -> f64,
) -> Mark {
    let above = |of: u32| errors.map_or(f64::INFINITY, |errors| errors * spacing(of - 1));
    // A node is selected by its nearest place, so elsewhere it may be finer than needed.
    while deepest > 0 && above(deepest) <= 1.0 {
        (deepest, is_missing) = (deepest - 1, true);
    }
    // 0 where a level begins to fade in, 1 where its splats have their own areas.
    let fading = if deepest == 0 { 1.0 } else { (above(deepest).log2() / FADE_OCTAVES).min(1.0) };
    let is_new = level == deepest && fading < 1.0;
    let share = match deepest.checked_sub(level) {
        None => -1.0,
        Some(0) => f64::from(u8::from(is_missing)),
        Some(1) => 1.0 - fading,
        _ => 0.0,
    };
    let growth = if is_new { fading.sqrt().max(LEAST_GROWN) } else { 1.0 };
    let own = if is_missing { spacing(deepest) } else { 0.0 };
    let spacing = match deepest {
        0 => own,
        _ if is_new => own * growth,
        // The areas approach the level's own linearly; at the last level, 0.
        _ => (own * own * fading + spacing(deepest - 1).powi(2) * (1.0 - fading)).sqrt(),
    };
    Mark { spacing: spacing as f32, share: share as f32, growth: growth as f32 }
}

/// Marks points with the point spacing where finer points are missing, and blends their colours and normals with their
/// level's averages if the file has these. Removes points that haven't begun to fade in.
fn mark(copc: &Copc, cut: &Cut, fade: Option<&Fade>, (chosen, ends): (&[u32], &[usize]), points: &mut PointCloud) {
    let all = copc.nodes();
    let spacings: Vec<f64> = (0..=all.last().map_or(0, |node| node.level)).map(|level| copc.spacing(level)).collect();
    let (origin, positions) = (points.origin, &points.positions);
    let mut marks = vec![Mark { spacing: 0.0, share: 0.0, growth: 1.0 }; points.len()];
    let (mut rest, mut start) = (&mut marks[..], 0);
    let mut parts = Vec::new();
    for (node, end) in chosen.iter().zip(ends) {
        let (own, others) = rest.split_at_mut(end - start);
        // Complete nodes lack no finer points.
        if !cut.is_complete[*node as usize] {
            parts.push((*node as usize, start, own));
        }
        (rest, start) = (others, *end);
    }
    parts.into_par_iter().for_each(|(node, start, marks)| {
        for (i, mark) in marks.iter_mut().enumerate() {
            let at = origin + positions.get(start + i);
            let finest = copc.cell_of(at);
            let mut deepest = node;
            let is_missing = loop {
                let cell = Copc::cell_above(finest, all[deepest].level + 1);
                let mut children = all[deepest].children.clone();
                match children.find(|c| all[*c as usize].cell == cell) {
                    // No finer point is near.
                    None => break false,
                    Some(child) if cut.is_chosen[child as usize] => deepest = child as usize,
                    Some(_) => break true,
                }
            };
            let errors = fade.map(|fade| fade.errors(fade.magnification.at(at)));
            let end = (all[deepest].level, is_missing);
            *mark = mark_of(all[node].level, end, errors, |level| spacings[level as usize]);
            // Where no finer points are missing, the average is the point's own value.
            if cut.values[node] == LevelValues::Alone && mark.share == 0.0 {
                mark.share = 1.0;
            }
        }
    });
    let mut columns = vec![(SPACING, marks.iter().map(|mark| mark.spacing).collect())];
    match points.extras.iter_mut().find(|e| e.name == RADIUS).map(|e| &mut e.values) {
        Some(ExtraValues::F32(radii)) => radii.iter_mut().zip(&marks).for_each(|(radius, mark)| *radius *= mark.growth),
        _ => columns.push((GROWTH, marks.iter().map(|mark| mark.growth).collect())),
    }
    let column = |(name, values): (&str, _)| ExtraColumn { name: name.into(), values: ExtraValues::F32(values) };
    points.extras.extend(columns.into_iter().map(column));
    if marks.iter().any(|mark| mark.share < 0.0) {
        points.retain(&marks.iter().map(|mark| mark.share >= 0.0).collect::<Vec<_>>());
        marks.retain(|mark| mark.share >= 0.0);
    }
    // A column of zeros may be omitted.
    let column = |names: [&str; 3]| {
        let found = names.map(|name| points.extras.iter().find(|e| e.name == name).map(|e| &e.values));
        found.iter().any(Option::is_some).then_some(found)
    };
    let value = |values: Option<&ExtraValues>, i: usize| values.map_or(0.0, |values| values.get(i));
    if let (Some(levels), Some(linear)) = (column(LEVEL_COLORS), &mut points.colors) {
        linear.par_iter_mut().zip(&marks).enumerate().filter(|(_, (_, mark))| mark.share > 0.0).for_each(
            |(i, (color, mark))| {
                let level = levels.map(|level| surfel_math::srgb::decode(value(level, i) / 65_535.0) as f32);
                *color = Vec3::from(*color).lerp(Vec3::from(level), mark.share).to_array();
            },
        );
    }
    if let (Some(levels), Some(own)) = (column(LEVEL_NORMALS), &mut points.normals) {
        let vector = |i: usize| {
            let (own, share) = (own.get(i).as_vec3(), marks[i].share);
            let level = if share > 0.0 { Vec3::from(levels.map(|level| value(level, i) as f32)) } else { Vec3::ZERO };
            if level == Vec3::ZERO {
                return own;
            }
            own.normalize_or_zero().lerp(level.normalize_or_zero(), share).normalize_or(own)
        };
        *own = Column3::from_f32((0..own.len()).into_par_iter().map(vector).collect());
    }
}

/// Radii that Surfel stored in a file's points.
pub(crate) struct Radii(Option<Vec<f32>>);

impl Radii {
    /// Removes the columns that Surfel added from a cloud, and returns its radii.
    pub(crate) fn take(points: &mut PointCloud) -> Self {
        let radii = take_f32(&mut points.extras, RADIUS);
        points.extras.retain(|e| !LEVEL_COLORS.iter().chain(&LEVEL_NORMALS).any(|name| e.name == *name));
        Self(radii)
    }

    /// True if the points have stored normals and radii, so that neighbours aren't needed to make splats.
    pub(crate) fn are_stated(points: &PointCloud) -> bool {
        points.normals.is_some() && points.extras.iter().any(|e| e.name == RADIUS)
    }

    /// True if the file has normals and at least one valid radius.
    pub(crate) fn are_known(&self, points: &PointCloud) -> bool {
        points.normals.is_some() && self.0.iter().flatten().any(is_known)
    }

    /// Makes splats with the stored radii and normals, reusing the points' memory.
    pub(crate) fn splats(
        self,
        points: PointCloud,
        scale: f64,
    ) -> Result<(SplatCloud, PointReport), surfel_model::ModelError> {
        let radii = self.0.unwrap_or_default();
        let mut sorted: Vec<f32> = radii.iter().copied().filter(is_known).collect();
        let middle = sorted.len().saturating_sub(1) / 2;
        let median = if sorted.is_empty() { 0.0 } else { *sorted.select_nth_unstable_by(middle, f32::total_cmp).1 };
        drop(sorted);
        let radii = radii.into_iter().map(|r| if is_known(&r) { r } else { median } * scale as f32).collect();
        let normals = points.normals.unwrap_or_default();
        let up = |n: Vec3| if n.is_finite() && n != Vec3::ZERO { n } else { Vec3::Z };
        let normals = Column3::from_f32((0..normals.len()).map(|i| up(normals.get(i).as_vec3())).collect());
        let data = CloudData {
            colors: points.colors,
            alphas: points.alphas,
            up: points.up,
            extras: points.extras,
            comments: points.comments,
            ..CloudData::new(points.origin, points.positions, Shape::Disks { normals, radii })
        };
        let (mut splats, _) = SplatCloud::new(data, OnInvalid::Refuse)?;
        let mut report = PointReport::default();
        (report.splats, report.normals_given) = (splats.len(), splats.len());
        report.median_radius = f64::from(median) * scale;
        // Splats of levels are enlarged first.
        let is_level = splats.data().extras.iter().any(|e| e.name == SPACING);
        report.interior_weight = if is_level { None } else { surfel_sample::interior_weight(&splats) };
        if let Some(weight) = report.interior_weight {
            splats.set_interior_weight(weight);
        }
        Ok((splats, report))
    }
}

/// True for a valid radius: positive and finite.
fn is_known(radius: &f32) -> bool {
    *radius > 0.0 && radius.is_finite()
}

fn take_f32(extras: &mut Vec<ExtraColumn>, name: &str) -> Option<Vec<f32>> {
    let at = extras.iter().position(|e| e.name == name)?;
    match extras.remove(at).values {
        ExtraValues::F32(values) => Some(values),
        _ => None,
    }
}

/// Enlarges splats so that they cover the surface at their level without gaps. `weighed`: the interior weight is
/// needed; `stated`: the file states the radii.
pub(crate) fn close(cloud: SplatCloud, weighed: bool, stated: bool) -> Result<SplatCloud, surfel_model::ModelError> {
    let weight = cloud.data().interior_weight;
    if !cloud.data().extras.iter().any(|e| e.name == SPACING) {
        return Ok(cloud);
    }
    let mut data = cloud.into_data();
    let spacing = take_f32(&mut data.extras, SPACING).unwrap_or_default();
    let growth = take_f32(&mut data.extras, GROWTH).unwrap_or_default();
    let closing = |radius: f32, i: usize| {
        let radius = radius * growth.get(i).copied().unwrap_or(1.0);
        let grown = CLOSING * spacing.get(i).copied().unwrap_or(0.0);
        radius.max(if stated { grown } else { grown.min(MOST_GROWN * radius) })
    };
    match &mut data.shape {
        Shape::Disks { radii, .. } | Shape::Balls { radii, .. } => {
            radii.iter_mut().enumerate().for_each(|(i, r)| *r = closing(*r, i));
        }
        Shape::Ellipses { s, t } => {
            let grown = |axis: &Column3| {
                let one = |i: usize| {
                    let v = axis.get(i).as_vec3();
                    v * (closing(v.length(), i) / v.length().max(f32::MIN_POSITIVE))
                };
                Column3::from_f32((0..axis.len()).map(one).collect())
            };
            (*s, *t) = (grown(s), grown(t));
        }
    }
    data.interior_weight = None;
    let (mut cloud, _) = SplatCloud::new(data, OnInvalid::Refuse)?;
    if weighed && let Some(weight) = surfel_sample::interior_weight(&cloud).or(weight) {
        cloud.set_interior_weight(weight);
    }
    Ok(cloud)
}

/// True if the name is that of a COPC file ([`save_copc`]): it ends in .copc.laz.
pub fn is_copc(output: &Path) -> bool {
    output.file_name().is_some_and(|name| name.to_string_lossy().to_ascii_lowercase().ends_with(".copc.laz"))
}

/// True if the name is that of a COPC file's shard ([`CopcRequest::shard`]): it ends in .shard.
pub fn is_shard(output: &Path) -> bool {
    output.extension().is_some_and(|e| e.eq_ignore_ascii_case("shard"))
}

/// Options for writing a COPC file.
#[derive(Clone, Debug, Default)]
pub struct CopcRequest {
    /// True if an existing file is replaced.
    pub overwrite: bool,
    /// Memory budget in bytes, approximately; `None`: [`memory::default_budget`].
    pub memory: Option<u64>,
    /// True if progress is saved in the folder [`resume_folder`], and continued from there.
    pub resume: bool,
    /// Shard to write, as its index and the number of shards, to a file that ends in .shard; the complete file is made
    /// from all shards.
    pub shard: Option<[u32; 2]>,
    /// Names of the columns of tables among the inputs ([`LoadOptions::columns`]).
    pub columns: Option<TableColumns>,
}

/// Formats the numbers of points, nodes and levels of a written COPC file for a message.
pub fn summary(report: &CopcReport) -> String {
    let [points, nodes, levels] =
        [(report.points, "points"), (report.nodes as u64, "nodes"), (report.levels as u64, "levels")]
            .map(|(n, what)| counted(n, what));
    format!("{points} in {nodes} of {levels}")
}

/// Writes files of points as one COPC file ([`surfel_io::copc::save_copc`]), or a shard of it, or merges shards. The
/// points get normals and radii, so that views can be drawn without estimating them again.
///
/// # Errors
/// [`Error::Usage`] for less memory than [`surfel_io::copc::LEAST_MEMORY`]; otherwise as
/// [`surfel_io::copc::save_copc`].
pub fn save_copc(
    inputs: &[PathBuf],
    output: &Path,
    request: &CopcRequest,
    progress: &dyn Progress,
) -> Result<CopcReport, Error> {
    if let Some(bytes) = request.memory.filter(|bytes| *bytes < LEAST_MEMORY) {
        let problem = format!("`memory={bytes}`: writing by levels takes at least {LEAST_MEMORY} bytes (200M)");
        return Err(Error::Usage(problem));
    }
    let options = CopcOptions {
        overwrite: request.overwrite,
        memory: request.memory.or_else(memory::default_budget).unwrap_or(LEAST_MEMORY),
        resume: request.resume,
        shard: request.shard,
        columns: request.columns.clone(),
    };
    let written = |progress: &dyn Fn(&'static str, u64, u64)| {
        surfel_io::copc::save_copc(inputs, output, &options, Some(&splats_of_part), progress)
    };
    Ok(by_stages(progress, written)?)
}

/// Writes a temporary COPC file in `folder` as [`save_copc`] does, with the given column names. The file exists until
/// the returned value is dropped.
pub(crate) fn save_temporary(
    (input, columns): (&Path, Option<&TableColumns>),
    folder: &Path,
    memory: u64,
    progress: &dyn Progress,
) -> Result<Temporary, Error> {
    let written = |progress: &dyn Fn(&'static str, u64, u64)| {
        save_temporary_copc((&[input.to_path_buf()], columns), folder, memory, Some(&splats_of_part), progress)
    };
    Ok(by_stages(progress, written)?.0)
}

/// Estimates normals and radii of points that are a chunk of a cloud.
fn splats_of_part(points: &PointCloud) -> Result<Vec<PointSplat>, String> {
    if points.len() < LEAST_POINTS {
        return Ok(vec![PointSplat::default(); points.len()]);
    }
    let options = PointOptions { coincident: usize::MAX, ellipses: false, ..PointOptions::default() };
    let made = surfel_sample::splats_from_points(points, &options, &surfel_sample::NoProgress);
    let (cloud, _) = made.map_err(|e| e.to_string())?;
    let splat = |i: usize| {
        let normal = surfel_math::basis::unit(cloud.normal(i)).as_vec3().to_array();
        PointSplat { normal, radius: cloud.radius_max(i) as f32 }
    };
    Ok((0..cloud.len()).map(splat).collect())
}

/// Translates progress by stage name, amount done and total into calls of `progress`.
fn by_stages<T>(progress: &dyn Progress, write: impl FnOnce(&dyn Fn(&'static str, u64, u64)) -> T) -> T {
    let stage = std::cell::RefCell::new(("", 0));
    let tell = |name: &'static str, done: u64, all: u64| {
        let mut last = stage.borrow_mut();
        if last.0 != name {
            progress.stage(name, all);
            *last = (name, 0);
        }
        progress.advance(done.saturating_sub(last.1));
        last.1 = done;
    };
    write(&tell)
}

/// Returns a selection of levels for views of an object with this transformation. Projected splats are at most
/// `error_px` pixels large.
pub fn views_of(views: &[View], world_from_object: DAffine3, error_px: f64) -> Levels {
    Seen { views, error_px, sight_px: None }.levels(world_from_object)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A view approaches in steps of 0.1 %.
    #[test]
    fn points_come_in_without_a_step() {
        const FINEST: u32 = 4;
        let spacing = |level: u32| (-f64::from(level)).exp2();
        for extra in [0, 1] {
            for level in 0..=FINEST {
                let mut before: Option<Mark> = None;
                let mut errors = 0.3;
                while errors < 40.0 {
                    // The least deep selection that the views need nearby, and one level more.
                    let needed = (0..FINEST).take_while(|above| errors * spacing(*above) > 1.0).count() as u32;
                    let deepest = (needed + extra).min(FINEST);
                    let of =
                        |level: u32, deepest: u32| mark_of(level, (deepest, deepest < FINEST), Some(errors), spacing);
                    if level > needed {
                        // Not selected, or not yet faded in.
                        assert!(of(level, deepest.max(level)).share < 0.0, "{level} at {errors}");
                    } else {
                        let mark = of(level, deepest);
                        // Splats are never larger than the error.
                        let size_px = f64::from(mark.spacing) * errors;
                        assert!(size_px <= 1.0 + 1e-6, "{level} at {errors}: {size_px}");
                        // Per step, areas change by 0.003 of half an octave; new splats start at 1/400.
                        let nothing = Mark { growth: 0.0, spacing: 0.0, ..mark };
                        let last = before.unwrap_or(if level == 0 { mark } else { nothing });
                        let grown = (mark.growth.powi(2) - last.growth.powi(2)).abs();
                        let apart =
                            (mark.spacing.powi(2) - last.spacing.powi(2)).abs() / spacing(needed).powi(2) as f32;
                        assert!(grown < 0.006 && (level == 0 || apart < 0.013), "{level} at {errors}: {grown} {apart}");
                        assert!(mark.share >= 0.0 && (mark.share - last.share).abs() < 0.01, "{level} at {errors}");
                        if (1..FINEST).contains(&needed) {
                            // One existing splat and three new ones cover what four splats of the new level cover.
                            let [old, new] = [needed - 1, needed].map(|level| of(level, deepest).spacing.powi(2));
                            let covered = (old + 3.0 * new) / (4.0 * spacing(needed).powi(2) as f32);
                            let fades = of(needed, deepest).growth < 1.0;
                            assert!(
                                if fades { (covered - 1.0).abs() < 0.01 } else { old == new },
                                "{errors}: {covered}"
                            );
                        }
                        before = Some(mark);
                    }
                    errors *= 1.001;
                }
                let done = mark_of(level, (FINEST, false), Some(errors), spacing);
                assert!(done == Mark { spacing: 0.0, share: 0.0, growth: 1.0 } && before == Some(done), "{level}");
            }
        }
        // Images that share a selection draw the selected level as it is.
        let shared = |level, deepest, is_missing| mark_of(level, (deepest, is_missing), None, spacing);
        assert_eq!([shared(2, 2, true).spacing, shared(2, 2, true).share], [0.25, 1.0]);
        assert_eq!([shared(1, 2, true).spacing, shared(1, 2, true).share], [0.25, 0.0]);
        assert_eq!([shared(1, 2, false).spacing, shared(1, 2, false).share], [0.0, 0.0]);
    }

    #[test]
    fn splats_close_their_level_however_dense_all_points_are() {
        let cloud = || {
            let centers = Column3::from_f32(vec![Vec3::ZERO, Vec3::X]);
            let normals = Column3::from_f32(vec![Vec3::Z; 2]);
            let column = |name: &str, values| ExtraColumn { name: name.into(), values: ExtraValues::F32(values) };
            let extras = vec![column(SPACING, vec![1.0, 0.0]), column(GROWTH, vec![1.0, 0.5])];
            let shape = Shape::Disks { normals, radii: vec![0.1; 2] };
            let data = CloudData { extras, ..CloudData::new(DVec3::ZERO, centers, shape) };
            SplatCloud::new(data, OnInvalid::Refuse).unwrap().0
        };
        // Radii stated for all points, and radii estimated from the points read.
        for (stated, radius) in [(true, CLOSING), (false, MOST_GROWN * 0.1)] {
            let closed = close(cloud(), false, stated).unwrap();
            assert_eq!([0, 1].map(|i| closed.radius_max(i) as f32), [radius, 0.05]);
        }
    }
}

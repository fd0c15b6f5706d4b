//! Dispatches of the compute path, in order.

use crate::passes::cells::{CellCounts, CellRoom, CellRound};
use crate::passes::pass_list::distinct;
use crate::passes::pixel_pass::EDGE_SAMPLES;
use surfel_model::Shader;
use surfel_render::{FramePlan, Pass};
use surfel_shaders::layout;

/// Side of the workgroups of passes over pixels.
const PIXEL_GROUP: u32 = 8;

/// Dispatch of the compute path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CellStep {
    /// Entry point of the shader.
    pub entry: &'static str,
    /// Round that selects the step's bindings and the contents of its uniform.
    pub round: CellRound,
    /// Segment whose splats the step reads; `None` for steps that read no segment.
    pub segment: Option<usize>,
    /// Number of workgroups along x and y.
    pub workgroups: [u32; 2],
}

impl CellStep {
    /// Returns a step of a number of workgroups, which are arranged in rows of [`layout::CELL_ROW`].
    fn of(entry: &'static str, round: CellRound, count: u64) -> Self {
        Self { entry, round, segment: None, workgroups: grid(count) }
    }

    /// Returns a step with a workgroup per cell.
    fn over_cells(entry: &'static str, cells: &CellCounts) -> Self {
        Self { entry, round: CellRound::Sorted, segment: None, workgroups: cells.size }
    }

    /// Returns a step with an invocation per pixel.
    fn over_pixels(entry: &'static str, size: [u32; 2]) -> Self {
        let workgroups = size.map(|side| side.div_ceil(PIXEL_GROUP));
        Self { entry, round: CellRound::Sorted, segment: None, workgroups }
    }
}

/// Dispatches that share a name in the statistics.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CellStage {
    /// Name in the statistics.
    pub name: &'static str,
    /// Dispatches in order; each depends on all before it.
    pub steps: Vec<CellStep>,
}

/// Entry points that draw a plan's cells.
struct RasterEntries {
    cells: &'static str,
    /// Entry points for the parts of dense cells: thresholds, sums, and combining the parts. `None` where the sides of
    /// oriented splats are separated: their cells are drawn whole.
    of_parts: Option<[&'static str; 3]>,
    /// Entry point that finds edges and blends them by coverage.
    edges: Option<&'static str>,
    /// Entry point that draws the samples of edge pixels.
    samples: Option<&'static str>,
}

impl RasterEntries {
    fn of(plan: &FramePlan) -> Self {
        let has_surface = plan.attributes.normal || plan.attributes.depth;
        let is_full = !plan.shadow_maps.is_empty() || plan.shader == Shader::Toon;
        let (by_coverage, by_samples) = (plan.has(Pass::EdgeAntialiasing), plan.has(Pass::EdgeSamples));
        let edges = by_coverage.then_some(if is_full { "cell_shadowed_edges" } else { "cell_edges" });
        let samples = by_samples.then_some(match (plan.keeps_facings, is_full) {
            (false, false) => "cell_samples",
            (false, true) => "cell_shadowed_samples",
            (true, false) => "cell_sided_samples",
            (true, true) => "cell_sided_shadowed_samples",
        });
        let is_edged = by_coverage || by_samples;
        let cells = match (plan.keeps_facings, is_full, is_edged) {
            (true, false, false) => "cell_sided_surfaces",
            (true, true, false) => "cell_sided_shadowed_surfaces",
            (true, false, true) => "cell_sided_edged_surfaces",
            (true, true, true) => "cell_sided_shadowed_edged_surfaces",
            (false, false, true) => "cell_edged_surfaces",
            (false, true, true) => "cell_shadowed_edged_surfaces",
            (false, true, false) => "cell_shadowed_surfaces",
            (false, false, false) if has_surface => "cell_surfaces",
            (false, false, false) => "cell_colors",
        };
        let thresholds = if is_edged { "cell_part_edged_thresholds" } else { "cell_part_thresholds" };
        let sums = match (is_edged, is_full || has_surface) {
            (true, _) => "cell_part_edged_surfaces",
            (false, true) => "cell_part_surfaces",
            (false, false) => "cell_part_colors",
        };
        let combine = match (is_full, is_edged) {
            (false, false) => "cell_combine",
            (true, false) => "cell_combine_shadowed",
            (false, true) => "cell_combine_edged",
            (true, true) => "cell_combine_shadowed_edged",
        };
        let of_parts = (!plan.keeps_facings).then_some([thresholds, sums, combine]);
        Self { cells, of_parts, edges, samples }
    }
}

/// Arranges a number of workgroups in rows of [`layout::CELL_ROW`].
fn grid(count: u64) -> [u32; 2] {
    let row = u64::from(layout::CELL_ROW);
    [count.min(row) as u32, count.div_ceil(row) as u32]
}

fn blocks(count: u64) -> u64 {
    count.div_ceil(u64::from(layout::CELL_BLOCK))
}

fn begin(cells: &CellCounts, room: CellRoom) -> CellStep {
    let elements = u64::from(cells.header(room)).max(1);
    CellStep::of("cell_begin", CellRound::Groups, elements.div_ceil(layout::CELL_WORKGROUP.into()))
}

/// Returns the steps that set up splats.
fn setup(cells: &CellCounts) -> Vec<CellStep> {
    let of_segments = cells.chunks.iter().enumerate().filter(|(_, chunks)| **chunks > 0);
    let mut steps: Vec<CellStep> = of_segments
        .map(|(segment, &chunks)| CellStep {
            segment: Some(segment),
            ..CellStep::of("cell_setup", CellRound::Groups, u64::from(chunks))
        })
        .collect();
    if cells.near > 0 {
        steps.push(CellStep::of("cell_near", CellRound::Groups, u64::from(cells.near_groups())));
    }
    steps
}

/// Returns the two steps of a scan.
fn scan(round: CellRound, length: u64) -> [CellStep; 2] {
    ["cell_scan_blocks", "cell_scan_add"].map(|entry| CellStep::of(entry, round, blocks(length)))
}

/// Returns the steps that emit pairs and sort them by cell.
fn sort(cells: &CellCounts, room: CellRoom) -> Vec<CellStep> {
    let groups = u64::from(cells.groups());
    let mut steps = scan(CellRound::Groups, groups).to_vec();
    steps.push(CellStep::of("cell_emit", CellRound::Groups, groups));
    let pair_blocks = blocks(u64::from(room.pairs));
    for round in [CellRound::Low, CellRound::High] {
        let digits = round.words(cells, room).get(2).copied().map_or(1, u64::from);
        steps.push(CellStep::of("cell_count_digits", round, pair_blocks));
        steps.extend(scan(round, digits * pair_blocks));
        steps.push(CellStep::of("cell_scatter", round, pair_blocks));
    }
    let ranges = u64::from(room.pairs).div_ceil(layout::CELL_WORKGROUP.into());
    steps.push(CellStep::of("cell_find_ranges", CellRound::Sorted, ranges));
    steps
}

/// Returns the stages that draw a tile of pixels, whose shaded part measures `shaded` pixels, in order.
pub(crate) fn cell_stages(plan: &FramePlan, cells: &CellCounts, room: CellRoom, shaded: [u32; 2]) -> Vec<CellStage> {
    let entries = RasterEntries::of(plan);
    let mut first = vec![begin(cells, room)];
    first.extend(setup(cells));
    let mut stages = vec![CellStage { name: "setup", steps: first }];
    if cells.groups() > 0 {
        stages.push(CellStage { name: "sort", steps: sort(cells, room) });
    }
    let mut raster = vec![CellStep::over_cells(entries.cells, cells)];
    if let Some([thresholds, sums, combine]) = entries.of_parts.filter(|_| room.parts() > 0 && cells.groups() > 0) {
        raster.extend([thresholds, sums].map(|entry| CellStep::of(entry, CellRound::Sorted, room.parts())));
        raster.push(CellStep::over_cells(combine, cells));
    }
    stages.push(CellStage { name: "raster", steps: raster });
    if looks_at_neighbours(plan) {
        let steps = vec![CellStep::over_pixels("cell_neighbours", shaded)];
        stages.push(CellStage { name: "shade", steps });
    }
    if let Some(entry) = entries.edges {
        stages.push(CellStage { name: "edges", steps: vec![CellStep::over_cells(entry, cells)] });
    }
    stages
}

/// Returns the stages that draw a tile of samples, which belong to `pixels` pixels, in order.
pub(crate) fn sample_stages(plan: &FramePlan, cells: &CellCounts, room: CellRoom, pixels: [u32; 2]) -> Vec<CellStage> {
    let Some(samples) = RasterEntries::of(plan).samples else { return Vec::new() };
    let mut edges = vec![begin(cells, room), CellStep::over_pixels("cell_steps", pixels)];
    edges.extend(scan(CellRound::Active, u64::from(cells.cells()) + 1));
    let list = u64::from(cells.cells()).div_ceil(layout::CELL_WORKGROUP.into());
    edges.push(CellStep::of("cell_list_active", CellRound::Groups, list));
    let mut stages = vec![CellStage { name: "edges", steps: edges }];
    if cells.groups() > 0 {
        stages.push(CellStage { name: "setup of samples", steps: setup(cells) });
        stages.push(CellStage { name: "sort of samples", steps: sort(cells, room) });
    }
    let steps = vec![CellStep::of(samples, CellRound::Sorted, u64::from(room.active))];
    stages.push(CellStage { name: EDGE_SAMPLES, steps });
    stages
}

fn looks_at_neighbours(plan: &FramePlan) -> bool {
    plan.planes.color && (plan.has(Pass::Outlines) || plan.has(Pass::EyeDome))
}

/// True for entry points of the compute path. Their pipelines have their own layout of the frame's buffers.
pub fn is_cell_entry(entry: &str) -> bool {
    entry.starts_with("cell_")
}

/// Returns all entry points that a plan's cells may need, each once.
pub fn cell_entries(plan: &FramePlan) -> Vec<&'static str> {
    let RasterEntries { cells, of_parts, edges, samples } = RasterEntries::of(plan);
    let before = [
        "cell_begin",
        "cell_setup",
        "cell_near",
        "cell_scan_blocks",
        "cell_scan_add",
        "cell_emit",
        "cell_count_digits",
        "cell_scatter",
        "cell_find_ranges",
    ];
    let of_samples = samples.into_iter().flat_map(|samples| ["cell_steps", "cell_list_active", samples]);
    let neighbours = looks_at_neighbours(plan).then_some("cell_neighbours");
    let raster = [cells].into_iter().chain(of_parts.into_iter().flatten());
    distinct(before.into_iter().chain(raster).chain(neighbours).chain(edges).chain(of_samples))
}

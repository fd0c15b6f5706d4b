//! Dispatches of the compute path, in order. A *cell* is a square of 16×16 pixels of a tile, which one workgroup draws.
//! An *entry point* is the function of a shader with which a dispatch begins.

use crate::passes::cells::{CellCapacity, CellCounts, CellRound};
use crate::passes::pass_list::{distinct, has_layers, peeled_layers};
use crate::passes::pixel_pass::EDGE_SAMPLES;
use surfel_model::{ClipPolicy, Shader};
use surfel_render::{FramePlan, Pass};
use surfel_shaders::layout;

/// Number of invocations along each side of the square workgroups of passes over pixels.
const PIXEL_GROUP: u32 = 8;

/// One dispatch of a compute shader in the compute path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CellStep {
    /// Name of the shader's entry point.
    pub entry: &'static str,
    /// Round that selects the step's bindings and the contents of its uniform.
    pub round: CellRound,
    /// Index of the segment whose splats the dispatch reads; `None` if it reads no segment.
    pub segment: Option<usize>,
    /// Number of workgroups along x and y.
    pub workgroups: [u32; 2],
}

impl CellStep {
    /// Creates a step of at least `count` workgroups, which are arranged in rows of [`layout::CELL_ROW`].
    fn of(entry: &'static str, round: CellRound, count: u64) -> Self {
        Self { entry, round, segment: None, workgroups: grid(count) }
    }

    /// Creates a step with one invocation per item, of `count` items.
    fn over_items(entry: &'static str, count: u32) -> Self {
        Self::of(entry, CellRound::Groups, u64::from(count).div_ceil(layout::CELL_WORKGROUP.into()))
    }

    /// Creates a step with one workgroup per cell.
    fn over_cells(entry: &'static str, cells: &CellCounts) -> Self {
        Self { entry, round: CellRound::Sorted, segment: None, workgroups: cells.size }
    }

    /// Creates a step with one invocation per pixel. `size` is the width and height in pixels.
    fn over_pixels(entry: &'static str, size: [u32; 2]) -> Self {
        let workgroups = size.map(|side| side.div_ceil(PIXEL_GROUP));
        Self { entry, round: CellRound::Sorted, segment: None, workgroups }
    }
}

/// Group of dispatches with one name in the statistics.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CellStage {
    /// Name of the stage in the statistics.
    pub name: &'static str,
    /// Dispatches in order. Each depends on all before it, except that setups of different segments are independent.
    pub steps: Vec<CellStep>,
}

/// Names of the shader entry points that rasterise cells (squares of 16×16 pixels), in the variants that a frame's plan
/// requires.
struct RasterEntries {
    /// Entry point that draws whole cells.
    cells: &'static str,
    /// Entry points for dense cells, which have more than `DENSE_PAIRS` pairs and are split into parts: they find
    /// thresholds, sum attributes, and combine the parts.
    of_parts: [&'static str; 3],
    /// Entry points that find edges and blend them by coverage. The first is for whole cells. The others are for parts
    /// of dense cells: they find thresholds, sum attributes, and combine the parts. `None` unless edges are antialiased
    /// by coverage.
    edges: Option<[&'static str; 4]>,
    /// Entry point that draws the samples of edge pixels, or only their opaque surfaces if the plan has transparent
    /// layers; `None` unless edges are antialiased by samples.
    samples: Option<&'static str>,
}

impl RasterEntries {
    fn of(plan: &FramePlan) -> Self {
        let has_surface = plan.attributes.normal || plan.attributes.depth;
        let is_clipped = plan.clip != ClipPolicy::Off;
        // The entry points for clipped splats draw images of every kind.
        let is_full = is_clipped || !plan.shadow_maps.is_empty() || plan.shader == Shader::Toon;
        let (by_coverage, by_samples) = (plan.has(Pass::EdgeAntialiasing), plan.has(Pass::EdgeSamples));
        let whole = match (is_clipped, is_full) {
            (true, _) => "cell_clipped_edges",
            (false, true) => "cell_shadowed_edges",
            (false, false) => "cell_edges",
        };
        let combined = if is_full { "cell_combine_shadowed_edges" } else { "cell_combine_edges" };
        let [thresholds, sums] = match is_clipped {
            true => ["cell_part_clipped_edge_thresholds", "cell_part_clipped_edges"],
            false => ["cell_part_edge_thresholds", "cell_part_edges"],
        };
        let edges = by_coverage.then_some([whole, thresholds, sums, combined]);
        let of_layers = if plan.keeps_facings { "cell_sided_layered_samples" } else { "cell_layered_samples" };
        let samples = by_samples.then_some(match (is_clipped, plan.keeps_facings, is_full) {
            _ if has_layers(plan) => of_layers,
            (true, false, _) => "cell_clipped_samples",
            (true, true, _) => "cell_clipped_sided_samples",
            (false, false, false) => "cell_samples",
            (false, false, true) => "cell_shadowed_samples",
            (false, true, false) => "cell_sided_samples",
            (false, true, true) => "cell_sided_shadowed_samples",
        });
        let is_edged = by_coverage || by_samples;
        let of_clipped = match (plan.keeps_facings, is_edged) {
            (false, false) => "cell_clipped_surfaces",
            (true, false) => "cell_clipped_sided_surfaces",
            (false, true) => "cell_clipped_edged_surfaces",
            (true, true) => "cell_clipped_sided_edged_surfaces",
        };
        let of_whole = match (plan.keeps_facings, is_full, is_edged) {
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
        let cells = if is_clipped { of_clipped } else { of_whole };
        let thresholds = match (is_clipped, is_edged) {
            (false, false) => "cell_part_thresholds",
            (false, true) => "cell_part_edged_thresholds",
            (true, false) => "cell_part_clipped_thresholds",
            (true, true) => "cell_part_clipped_edged_thresholds",
        };
        let sums = match (is_clipped, is_edged, is_full || has_surface) {
            (true, false, _) => "cell_part_clipped_surfaces",
            (true, true, _) => "cell_part_clipped_edged_surfaces",
            (false, true, _) => "cell_part_edged_surfaces",
            (false, false, true) => "cell_part_surfaces",
            (false, false, false) => "cell_part_colors",
        };
        let combine = match (is_full, is_edged) {
            (false, false) => "cell_combine",
            (true, false) => "cell_combine_shadowed",
            (false, true) => "cell_combine_edged",
            (true, true) => "cell_combine_shadowed_edged",
        };
        let sided = ["cell_part_sided_thresholds", "cell_part_sided_surfaces", "cell_combine_sided"];
        let of_parts = if plan.keeps_facings { sided } else { [thresholds, sums, combine] };
        Self { cells, of_parts, edges, samples }
    }
}

/// Names of the entry points that write records of splats: `chunks` sets up the splats of chunks, `near` copies the
/// records of splats that reach the near plane, which the CPU has set up.
struct SetupEntries {
    chunks: &'static str,
    near: &'static str,
}

impl SetupEntries {
    fn of(plan: &FramePlan) -> Self {
        match plan.clip {
            ClipPolicy::Off => Self { chunks: "cell_setup", near: "cell_near" },
            _ => Self { chunks: "cell_clipped_setup", near: "cell_clipped_near" },
        }
    }
}

/// Returns a grid of at least `count` workgroups, in rows of [`layout::CELL_ROW`].
fn grid(count: u64) -> [u32; 2] {
    let row = u64::from(layout::CELL_ROW);
    [count.min(row) as u32, count.div_ceil(row) as u32]
}

/// Returns the number of blocks that `count` elements of a scan or sort fill.
fn blocks(count: u64) -> u64 {
    count.div_ceil(u64::from(layout::CELL_BLOCK))
}

/// Returns the step that clears the tile's counters and the header of its lists.
fn begin(cells: &CellCounts, room: CellCapacity) -> CellStep {
    let words = u64::from(cells.header(room)).max(1);
    CellStep::of("cell_begin", CellRound::Groups, words.div_ceil(layout::CELL_WORKGROUP.into()))
}

/// Returns the steps that write the records of a tile's splats.
fn setup(plan: &FramePlan, cells: &CellCounts) -> Vec<CellStep> {
    let entries = SetupEntries::of(plan);
    let of_segments = cells.chunks.iter().enumerate().filter(|(_, chunks)| **chunks > 0);
    let mut steps: Vec<CellStep> = of_segments
        .map(|(segment, &chunks)| CellStep {
            segment: Some(segment),
            ..CellStep::of(entries.chunks, CellRound::Groups, u64::from(chunks))
        })
        .collect();
    if cells.near > 0 {
        steps.push(CellStep::of(entries.near, CellRound::Groups, u64::from(cells.near_groups())));
    }
    steps
}

/// Returns the two steps of a prefix sum (scan) over `length` elements.
fn scan(round: CellRound, length: u64) -> [CellStep; 2] {
    ["cell_scan_blocks", "cell_scan_add"].map(|entry| CellStep::of(entry, round, blocks(length)))
}

/// Returns the steps that sort a tile's records by bin, and write the lists of cells.
fn sort(cells: &CellCounts, room: CellCapacity) -> Vec<CellStep> {
    use CellRound::{Groups, Lists};
    let bin_blocks = room.bin_blocks(cells);
    let mut steps = scan(Groups, cells.group_counts()).to_vec();
    steps.push(CellStep::of("cell_sort_bins", Groups, cells.groups().into()));
    steps.push(CellStep::of("cell_find_bins", Groups, 1));
    steps.push(CellStep::of("cell_count_lists", Lists, bin_blocks));
    steps.extend(scan(Lists, u64::from(layout::CELL_WORKGROUP) * bin_blocks));
    steps.push(CellStep::of("cell_write_lists", Lists, bin_blocks));
    steps.push(CellStep::of("cell_find_lists", Lists, cells.bins().into()));
    steps
}

/// Name, in the statistics, of the stage that draws transparent layers.
const LAYERS: &str = "layers";

/// Entry points that draw one layer: of whole cells, and of parts of dense cells. The latter sum attributes and combine
/// the parts.
struct LayerEntries {
    cells: &'static str,
    sums: &'static str,
    combine: &'static str,
}

/// Entry points of a peeled layer. [`LAYER_THRESHOLDS`] precedes the parts of dense cells.
const PEELED: LayerEntries =
    LayerEntries { cells: "cell_peeled_layer", sums: "cell_part_peeled_layer", combine: "cell_combine_peeled_layer" };

/// Entry points of the last layer, that of all remaining fragments.
const REMAINING: LayerEntries = LayerEntries {
    cells: "cell_remaining_layer",
    sums: "cell_part_remaining_layer",
    combine: "cell_combine_remaining_layer",
};

/// Entry point that finds the thresholds of a peeled layer in parts of dense cells.
const LAYER_THRESHOLDS: &str = "cell_part_layer_thresholds";

/// Entry points that find the nearest transparent splat of each pixel, for the steps of edge samples: of whole cells,
/// of parts of dense cells, and combined from the parts.
const LAYER_EDGES: [&str; 3] = ["cell_layer_edges", "cell_part_layer_edges", "cell_combine_layer_edges"];

/// Entry point that lights splats one by one, for the last layer.
const LIGHT: &str = "cell_light";

/// Entry point that counts the layers of a tile's cells.
const COUNT_LAYERS: &str = "cell_count_layers";

/// Entry points that draw the layers of samples: a peeled layer, the last layer, and the means of samples.
const SAMPLES_PEELED: &str = "cell_samples_peeled_layer";
const SAMPLES_REMAINING: &str = "cell_samples_remaining_layer";
const COMPOSITE_SAMPLES: &str = "cell_composite_samples";

/// Returns the steps that draw transparent layers over a tile of pixels, whose shaded part has the width and height
/// `shaded` in pixels.
fn layers(plan: &FramePlan, cells: &CellCounts, room: CellCapacity, shaded: [u32; 2]) -> Vec<CellStep> {
    let parts = room.parts();
    let part = |entry| (parts > 0).then(|| CellStep::of(entry, CellRound::Sorted, parts));
    let one = |entries: &LayerEntries, thresholds: Option<&'static str>| {
        let mut steps = vec![CellStep::over_cells(entries.cells, cells)];
        steps.extend(thresholds.into_iter().chain([entries.sums]).filter_map(part));
        steps.extend((parts > 0).then(|| CellStep::over_cells(entries.combine, cells)));
        steps
    };
    let mut steps = vec![CellStep::over_cells("cell_begin_layers", cells)];
    let has_remaining = plan.has(Pass::RemainingLayer);
    steps.extend(has_remaining.then(|| CellStep::over_items(LIGHT, room.records)));
    for _ in 0..peeled_layers(plan) {
        steps.extend(one(&PEELED, Some(LAYER_THRESHOLDS)));
    }
    if has_remaining {
        steps.extend(one(&REMAINING, None));
    }
    steps.push(CellStep::over_pixels("cell_composite_layers", shaded));
    steps.push(CellStep::over_items(COUNT_LAYERS, cells.cells()));
    if plan.has(Pass::EdgeSamples) {
        let [whole, sums, combine] = LAYER_EDGES;
        steps.push(CellStep::over_cells(whole, cells));
        steps.extend(part(sums));
        steps.extend((parts > 0).then(|| CellStep::over_cells(combine, cells)));
    }
    steps
}

/// Returns the steps that draw the layers of samples and write their means.
fn sample_layers(plan: &FramePlan, cells: &CellCounts, room: CellCapacity) -> Vec<CellStep> {
    let over_active = |entry| CellStep::of(entry, CellRound::Sorted, u64::from(room.active));
    let mut steps = Vec::new();
    if cells.draws_layers() {
        let has_remaining = plan.has(Pass::RemainingLayer);
        steps.extend(has_remaining.then(|| CellStep::over_items(LIGHT, room.records)));
        steps.extend((0..peeled_layers(plan)).map(|_| over_active(SAMPLES_PEELED)));
        steps.extend(has_remaining.then(|| over_active(SAMPLES_REMAINING)));
        steps.push(CellStep::over_items(COUNT_LAYERS, room.active));
    }
    steps.push(over_active(COMPOSITE_SAMPLES));
    steps
}

/// Returns all entry points that draw the transparent layers of a plan.
fn layer_entries(plan: &FramePlan) -> Vec<&'static str> {
    if !has_layers(plan) {
        return Vec::new();
    }
    let by_samples = plan.has(Pass::EdgeSamples);
    let mut entries = vec!["cell_begin_layers", "cell_composite_layers", COUNT_LAYERS];
    if peeled_layers(plan) > 0 {
        entries.extend([PEELED.cells, LAYER_THRESHOLDS, PEELED.sums, PEELED.combine]);
        entries.extend(by_samples.then_some(SAMPLES_PEELED));
    }
    if plan.has(Pass::RemainingLayer) {
        entries.extend([LIGHT, REMAINING.cells, REMAINING.sums, REMAINING.combine]);
        entries.extend(by_samples.then_some(SAMPLES_REMAINING));
    }
    if by_samples {
        entries.extend(LAYER_EDGES.into_iter().chain([COMPOSITE_SAMPLES]));
    }
    entries
}

/// Returns the stages that draw a tile of pixels, in order. `shaded` is the width and height of the tile's shaded part
/// in pixels.
pub(crate) fn cell_stages(
    plan: &FramePlan,
    cells: &CellCounts,
    room: CellCapacity,
    shaded: [u32; 2],
) -> Vec<CellStage> {
    let entries = RasterEntries::of(plan);
    let mut first = vec![begin(cells, room)];
    first.extend(setup(plan, cells));
    let mut stages = vec![CellStage { name: "setup", steps: first }];
    if cells.groups() > 0 {
        stages.push(CellStage { name: "sort", steps: sort(cells, room) });
    }
    let parts = if cells.groups() > 0 { room.parts() } else { 0 };
    let over = |whole, [thresholds, sums, combine]: [&'static str; 3]| {
        let mut steps = vec![CellStep::over_cells(whole, cells)];
        if parts > 0 {
            steps.extend([thresholds, sums].map(|entry| CellStep::of(entry, CellRound::Sorted, parts)));
            steps.push(CellStep::over_cells(combine, cells));
        }
        steps
    };
    stages.push(CellStage { name: "raster", steps: over(entries.cells, entries.of_parts) });
    if has_neighbour_passes(plan) {
        let steps = vec![CellStep::over_pixels("cell_neighbours", shaded)];
        stages.push(CellStage { name: "shade", steps });
    }
    if let Some([whole, thresholds, sums, combine]) = entries.edges {
        stages.push(CellStage { name: "edges", steps: over(whole, [thresholds, sums, combine]) });
    }
    if cells.draws_layers() {
        stages.push(CellStage { name: LAYERS, steps: layers(plan, cells, room, shaded) });
    }
    stages
}

/// Returns the stages that draw a tile of samples, in order. `pixels` is the width and height, in pixels, of the region
/// that the samples belong to.
pub(crate) fn sample_stages(
    plan: &FramePlan,
    cells: &CellCounts,
    room: CellCapacity,
    pixels: [u32; 2],
) -> Vec<CellStage> {
    let Some(samples) = RasterEntries::of(plan).samples else { return Vec::new() };
    let mut edges = vec![begin(cells, room), CellStep::over_pixels("cell_steps", pixels)];
    edges.extend(scan(CellRound::Active, u64::from(cells.cells()) + 1));
    edges.push(CellStep::over_items("cell_sum_active", cells.size[0] + 1));
    edges.push(CellStep::over_items("cell_list_active", cells.cells()));
    let mut stages = vec![CellStage { name: "edges", steps: edges }];
    if cells.groups() > 0 {
        stages.push(CellStage { name: "setup of samples", steps: setup(plan, cells) });
        stages.push(CellStage { name: "sort of samples", steps: sort(cells, room) });
    }
    let mut steps = vec![CellStep::of(samples, CellRound::Sorted, u64::from(room.active))];
    if cells.has_layered_samples {
        steps.extend(sample_layers(plan, cells, room));
    }
    stages.push(CellStage { name: EDGE_SAMPLES, steps });
    stages
}

/// True if the plan draws outlines or eye-dome lighting, whose pass reads neighbouring pixels.
fn has_neighbour_passes(plan: &FramePlan) -> bool {
    plan.planes.color && (plan.has(Pass::Outlines) || plan.has(Pass::EyeDome))
}

/// True if the entry point belongs to the compute path: its name begins with `cell_`. Its pipeline then has its own
/// layout of the frame's buffers, and its SPIR-V for `ash` has neither checks of indices nor loop bounds
/// (`shaders/build/spirv.rs`).
pub fn is_cell_entry(entry: &str) -> bool {
    entry.starts_with("cell_")
}

/// Returns all entry points that the compute path may need for a plan, each once.
pub fn cell_entries(plan: &FramePlan) -> Vec<&'static str> {
    let RasterEntries { cells, of_parts, edges, samples } = RasterEntries::of(plan);
    let SetupEntries { chunks, near } = SetupEntries::of(plan);
    let before = [
        "cell_begin",
        chunks,
        near,
        "cell_scan_blocks",
        "cell_scan_add",
        "cell_sort_bins",
        "cell_find_bins",
        "cell_count_lists",
        "cell_write_lists",
        "cell_find_lists",
    ];
    let of_samples =
        samples.into_iter().flat_map(|samples| ["cell_steps", "cell_sum_active", "cell_list_active", samples]);
    let neighbours = has_neighbour_passes(plan).then_some("cell_neighbours");
    let raster = [cells].into_iter().chain(of_parts);
    let after = neighbours.into_iter().chain(edges.into_iter().flatten()).chain(layer_entries(plan)).chain(of_samples);
    distinct(before.into_iter().chain(raster).chain(after))
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_model::{Camera, EdgeAa, Projection, Settings};
    use surfel_render::{Capabilities, Planes, SceneSummary, View, plan};

    fn planned(summary: &SceneSummary, change: impl FnOnce(&mut Settings)) -> FramePlan {
        let projection = Projection::Perspective { fov_y_deg: 45.0 };
        let (eye, up, size) = ([0.0, 0.0, 5.0], [0.0, 1.0, 0.0], [8, 8]);
        let view = View::new(&Camera { eye, target: [0.0; 3], up, projection, near: 0.1, far: None, size }).unwrap();
        let mut settings = Settings::default();
        change(&mut settings);
        plan(summary, &view, &settings, Planes::COLOR, &Capabilities::everything("test")).unwrap()
    }

    fn cells(chunks: &[u32], near: u32, is_of_samples: bool) -> CellCounts {
        let splats = 256 * u64::from(chunks.iter().sum::<u32>());
        CellCounts { size: [5, 3], chunks: chunks.to_vec(), splats, near, is_of_samples, ..CellCounts::default() }
    }

    fn room(pairs: u32) -> CellCapacity {
        CellCapacity { records: 100, bin_pairs: 100, pairs, active: 9 }
    }

    fn names(stages: &[CellStage]) -> Vec<&str> {
        stages.iter().flat_map(|stage| stage.steps.iter().map(|step| step.entry)).collect()
    }

    #[test]
    fn plan_runs_what_it_asks_for_and_no_more() {
        let plain = SceneSummary::default();
        let of = |shader| {
            let plan = planned(&plain, |s| s.shader = shader);
            let stages = cell_stages(&plan, &cells(&[], 0, false), room(1), [8, 8]);
            names(&stages)[1..].iter().map(|&name| name.to_owned()).collect::<Vec<_>>()
        };
        assert_eq!(of(Shader::Unlit), ["cell_colors"]);
        assert_eq!(of(Shader::Phong), ["cell_surfaces"]);
        assert_eq!(of(Shader::Toon), ["cell_shadowed_surfaces", "cell_neighbours"]);
        assert_eq!(of(Shader::Edl), ["cell_surfaces", "cell_neighbours"]);
        let plan = planned(&plain, |s| s.shader = Shader::Unlit);
        let of = |cells: &CellCounts, pairs| cell_stages(&plan, cells, room(pairs), [8, 8]);
        // A tile that no splat touches is only cleared and shaded.
        assert_eq!(names(&of(&cells(&[0, 0], 0, false), 9999)), ["cell_begin", "cell_colors"]);
        // With few pairs no cell can be dense.
        let few = of(&cells(&[3, 0], 0, false), layout::DENSE_PAIRS);
        let few = names(&few);
        assert_eq!(few.iter().filter(|name| **name == "cell_setup").count(), 1);
        assert!(
            !few.contains(&"cell_near") && !few.contains(&"cell_part_thresholds") && few.contains(&"cell_write_lists")
        );
        let many = of(&cells(&[3, 2], 7, false), layout::DENSE_PAIRS + 1);
        let many = names(&many);
        assert_eq!(many.iter().filter(|name| **name == "cell_setup").count(), 2);
        assert_eq!(&many[many.len() - 3..], ["cell_part_thresholds", "cell_part_colors", "cell_combine"]);
        assert!(many.contains(&"cell_near") && many.iter().all(|name| cell_entries(&plan).contains(name)));
        // A plan without edges has no pass for them.
        let is_of_edges = |name: &str| name.contains("edge") || name.contains("sample") || name.contains("active");
        assert!(!cell_entries(&plan).into_iter().any(is_of_edges));
        assert!(sample_stages(&plan, &cells(&[3], 0, true), room(1), [8, 8]).is_empty());
    }

    #[test]
    fn clips_are_evaluated_only_where_a_plan_does() {
        let clipped = SceneSummary { clips: true, ..SceneSummary::default() };
        let both = SceneSummary { both_facings: true, ..clipped.clone() };
        for (summary, edge_aa) in [
            (&clipped, EdgeAa::Off),
            (&clipped, EdgeAa::Coverage),
            (&clipped, EdgeAa::Samples),
            (&both, EdgeAa::Off),
            (&both, EdgeAa::Samples),
        ] {
            let by = |clip| {
                let plan = planned(summary, |s| (s.edge_aa, s.clip) = (edge_aa, clip));
                let pairs = layout::DENSE_PAIRS + 1;
                let mut stages = cell_stages(&plan, &cells(&[3], 5, false), room(pairs), [8, 8]);
                stages.extend(sample_stages(&plan, &cells(&[3], 5, true), room(pairs), [8, 8]));
                let used: Vec<&'static str> =
                    stages.iter().flat_map(|stage| stage.steps.iter().map(|step| step.entry)).collect();
                assert!(used.iter().all(|name| cell_entries(&plan).contains(name)), "{used:?}");
                // Passes that read clips, or records as splats. Some are for frames of every kind.
                let of_splats = ["setup", "near", "surfaces", "thresholds", "part", "samples", "edges"];
                let reads = |name: &&str| of_splats.iter().any(|word| name.contains(word));
                let of_all = ["combine", "part_sided"];
                let used = used.into_iter().filter(reads);
                used.filter(|name| !of_all.iter().any(|word| name.contains(word))).collect::<Vec<_>>()
            };
            for clip in [ClipPolicy::Exact, ClipPolicy::Line] {
                assert!(by(clip).iter().all(|name| name.contains("clipped")), "{edge_aa:?} {:?}", by(clip));
            }
            assert!(by(ClipPolicy::Off).iter().all(|name| !name.contains("clipped")), "{edge_aa:?}");
        }
    }

    #[test]
    fn layers_are_drawn_only_where_transparent_splats_may_be_seen() {
        let glass = SceneSummary { transparent: true, ..SceneSummary::default() };
        let by = |transparency: &str| planned(&glass, |s| s.transparency = transparency.parse().unwrap());
        let layered = CellCounts { has_layers: true, ..cells(&[3], 0, false) };
        let of_pixels = |plan: &FramePlan, cells: &CellCounts, pairs| {
            let stages = cell_stages(plan, cells, room(pairs), [8, 8]);
            let layers = stages.into_iter().find(|stage| stage.name == LAYERS);
            layers.map_or(Vec::new(), |stage| stage.steps.iter().map(|step| step.entry).collect())
        };
        let begin = "cell_begin_layers";
        let end = ["cell_composite_layers", "cell_count_layers"];
        let last = ["cell_light", "cell_remaining_layer"];
        let peeled = "cell_peeled_layer";
        for (transparency, entries) in [
            ("peel:1", vec![begin, last[0], last[1], end[0], end[1]]),
            ("peel:3", vec![begin, last[0], peeled, peeled, last[1], end[0], end[1]]),
            ("peel:3:drop", vec![begin, peeled, peeled, end[0], end[1]]),
        ] {
            let plan = by(transparency);
            assert_eq!(of_pixels(&plan, &layered, 1), entries, "{transparency}");
            assert!(of_pixels(&plan, &cells(&[3], 0, false), 1).is_empty());
            // Dense cells add passes over parts.
            let dense = of_pixels(&plan, &layered, layout::DENSE_PAIRS + 1);
            let is_peeled = entries.contains(&peeled);
            let peeled_parts = ["cell_part_layer_thresholds", "cell_part_peeled_layer", "cell_combine_peeled_layer"];
            assert!(peeled_parts.iter().all(|entry| dense.contains(entry) == is_peeled), "{dense:?}");
            assert!(dense.iter().all(|name| cell_entries(&plan).contains(name)));
        }
        // Samples have the same layers, and steps among them are found in the tile of pixels.
        let finer = CellCounts { is_of_samples: true, has_layered_samples: true, ..layered.clone() };
        let [of_steps, of_parts, _] = LAYER_EDGES;
        let opaque = "cell_layered_samples";
        for (transparency, entries) in [
            ("peel:1", vec![opaque, LIGHT, SAMPLES_REMAINING, COUNT_LAYERS, COMPOSITE_SAMPLES]),
            ("peel:2:drop", vec![opaque, SAMPLES_PEELED, COUNT_LAYERS, COMPOSITE_SAMPLES]),
        ] {
            let change = |s: &mut Settings| {
                (s.transparency, s.edge_aa) = (transparency.parse().unwrap(), EdgeAa::Samples);
            };
            let plan = planned(&glass, change);
            let last = |cells: &CellCounts| sample_stages(&plan, cells, room(1), [8, 8]).pop().unwrap().steps;
            assert_eq!(last(&finer).iter().map(|step| step.entry).collect::<Vec<_>>(), entries, "{transparency}");
            assert!(entries.iter().all(|name| cell_entries(&plan).contains(name)));
            let of_background = CellCounts { has_layers: false, ..finer.clone() };
            let without: Vec<&str> = last(&of_background).iter().map(|step| step.entry).collect();
            assert_eq!(without, [opaque, COMPOSITE_SAMPLES]);
            assert!(of_pixels(&plan, &layered, 1).contains(&of_steps));
            assert!(of_pixels(&plan, &layered, layout::DENSE_PAIRS + 1).contains(&of_parts));
            assert!(!of_pixels(&by(transparency), &layered, 1).contains(&of_steps));
        }
        let gathered = of_pixels(&by("abuffer:4"), &layered, 1);
        assert_eq!(gathered.iter().filter(|name| **name == peeled).count(), 16);
        assert!(!cell_entries(&by("off")).iter().any(|name| name.contains("layer") || *name == "cell_light"));
        assert!(!cell_entries(&by("peel:1")).contains(&peeled));
    }

    #[test]
    fn sides_are_kept_apart_only_where_a_plan_does() {
        let both = SceneSummary { both_facings: true, ..SceneSummary::default() };
        for (shader, entry) in [(Shader::Phong, "cell_sided_surfaces"), (Shader::Toon, "cell_sided_shadowed_surfaces")]
        {
            let entries = cell_entries(&planned(&both, |s| s.shader = shader));
            let is_of_sides = |name: &&str| !name.starts_with("cell_part") || name.contains("sided");
            assert!(entries.contains(&entry) && entries.iter().all(is_of_sides), "{entries:?}");
            let plan = planned(&SceneSummary::default(), |s| s.shader = shader);
            assert!(!cell_entries(&plan).iter().any(|name| name.contains("sided")));
        }
    }

    #[test]
    fn edges_add_a_pass_over_cells_and_samples_the_passes_of_a_finer_tile() {
        let plain = SceneSummary::default();
        let by = |edge_aa| planned(&plain, |s| s.edge_aa = edge_aa);
        let (pixels, samples) = (cells(&[3], 0, false), cells(&[3], 0, true));
        let pairs = layout::DENSE_PAIRS + 1;
        let coverage = cell_stages(&by(EdgeAa::Coverage), &pixels, room(pairs), [8, 8]);
        let raster =
            ["cell_edged_surfaces", "cell_part_edged_thresholds", "cell_part_edged_surfaces", "cell_combine_edged"];
        let edges = ["cell_edges", "cell_part_edge_thresholds", "cell_part_edges", "cell_combine_edges"];
        assert_eq!(names(&coverage)[11..], [raster, edges].concat());
        assert!(sample_stages(&by(EdgeAa::Coverage), &samples, room(pairs), [8, 8]).is_empty());
        let plan = by(EdgeAa::Samples);
        assert!(!names(&cell_stages(&plan, &pixels, room(pairs), [8, 8])).contains(&"cell_edges"));
        let stages = sample_stages(&plan, &samples, room(pairs), [20, 12]);
        let of_stages: Vec<&str> = stages.iter().map(|stage| stage.name).collect();
        assert_eq!(of_stages, ["edges", "setup of samples", "sort of samples", EDGE_SAMPLES]);
        assert_eq!(names(&stages).last(), Some(&"cell_samples"));
        assert!(names(&stages).iter().all(|name| cell_entries(&plan).contains(name)));
        // One invocation per pixel, and one workgroup per active cell.
        assert_eq!(stages[0].steps[1].workgroups, [3, 2]);
        assert_eq!(stages[3].steps[0].workgroups, [9, 1]);
        // Samples of a tile that no splat touches are those of the background.
        let none = sample_stages(&plan, &cells(&[], 0, true), room(pairs), [20, 12]);
        assert_eq!(none.iter().map(|stage| stage.name).collect::<Vec<_>>(), ["edges", EDGE_SAMPLES]);
    }

    #[test]
    fn workgroups_are_within_the_limits_of_a_dispatch() {
        for count in [1, 32_768, 32_769, 10_000_000] {
            let [x, y] = grid(count);
            assert!(x <= 65_535 && y <= 65_535 && u64::from(x) * u64::from(y) >= count, "{count}");
        }
    }
}

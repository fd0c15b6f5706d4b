//! Compute path: draws opaque splats by compute shaders, without raster hardware. This module decides which frames it
//! draws, sizes its buffers, and lists its dispatches. `shaders/passes/cells.wgsl` explains the algorithm.

use crate::passes::pixel_pass::PixelPass;
use crate::scene::limits::Limits;
use surfel_model::{Accumulate, ClipPolicy, Shader};
use surfel_render::{FramePlan, Pass, Stats};
use surfel_shaders::layout;

/// Largest side, in pixels, of a tile that the compute path draws: cells are sorted by two digits of eight bits.
pub(crate) const LARGEST_CELL_TILE: u32 = 256 * layout::CELL_SIDE;

/// GPU path by which frames are drawn. All paths draw the same image up to the rounding of sums.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum GpuPath {
    /// Compute shaders for the frames that they can draw, raster hardware for all others.
    #[default]
    Auto,
    /// Raster hardware: quads, depth tests and additive blending.
    Raster,
    /// Compute shaders for the frames that they can draw, raster hardware for all others, whatever [`GpuPath::Auto`]
    /// prefers.
    Compute,
}

impl GpuPath {
    /// True if compute shaders draw a plan's frames. They draw frames of opaque, unclipped splats whose sums are f32.
    ///
    /// Clipped or transparent splats, polygons, trained Gaussians, edge antialiasing, the plane of indices and the
    /// shadow maps themselves need raster hardware.
    pub fn draws_cells(self, plan: &FramePlan) -> bool {
        let is_drawn = |pass: &Pass| {
            use Pass::{Attributes, EyeDome, Outlines, Shade, ShadowMap, Visibility};
            matches!(pass, ShadowMap | Visibility | Attributes | Shade | Outlines | EyeDome)
        };
        let has_splats = plan.has(Pass::Visibility) && plan.has(Pass::Shade);
        let is_whole = plan.clip == ClipPolicy::Off && !plan.separates_transparent;
        let is_exact = plan.accumulate == Accumulate::F32;
        let has_only_these = plan.passes.iter().all(is_drawn) && !plan.planes.index;
        self != Self::Raster && has_splats && is_whole && is_exact && has_only_these
    }
}

/// Name of the counter of pairs of a splat and a cell that the compute path drew.
pub const CELL_PAIRS: &str = "cell_pairs";

/// Round of the compute path. Some passes run several times in a tile; the round selects their bindings and uniform.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum CellRound {
    /// Counts and emits the pairs of groups.
    Groups,
    /// Sorts pairs by the lower digit of the cell's number.
    Low,
    /// Sorts pairs by the upper digit of the cell's number.
    High,
    /// Reads the sorted pairs.
    Sorted,
}

/// Buffer of the compute path. Its contents are valid for one tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum CellBuffer {
    /// Records of splats: the shaders' `cell_records`.
    Records,
    /// Groups of records: the shaders' `cell_groups`.
    Groups,
    /// Counts of records and pairs: the shaders' `cell_counters`. The host reads them back for [`CellRoom::holds`].
    Counters,
    /// Pairs as they are emitted and, after the second digit, fully sorted.
    Pairs,
    /// Pairs sorted by the lower digit.
    HalfSortedPairs,
    /// Histograms of the radix sort: number of pairs per digit and block.
    Digits,
    /// Sums of the blocks of a scan.
    Sums,
    /// Depth thresholds and sums of the parts of dense cells.
    Parts,
}

impl CellBuffer {
    /// All buffers.
    pub const ALL: [Self; 8] = [
        Self::Records,
        Self::Groups,
        Self::Counters,
        Self::Pairs,
        Self::HalfSortedPairs,
        Self::Digits,
        Self::Sums,
        Self::Parts,
    ];

    /// Returns the buffer's name for messages and debuggers.
    pub fn name(self) -> &'static str {
        match self {
            Self::Records => "records of cells",
            Self::Groups => "groups",
            Self::Counters => "counters",
            Self::Pairs => "pairs",
            Self::HalfSortedPairs => "half-sorted pairs",
            Self::Digits => "digits",
            Self::Sums => "scanned sums",
            Self::Parts => "parts of cells",
        }
    }

    /// Returns the buffer's size for a tile, in bytes.
    pub fn bytes(self, cells: &CellCounts, room: CellRoom) -> u64 {
        let blocks = |count: u64| count.div_ceil(u64::from(layout::CELL_BLOCK));
        let digits = DIGITS * blocks(u64::from(room.pairs));
        match self {
            Self::Records => room.record_bytes(),
            Self::Groups => 4 * u64::from(1 + layout::GROUP_WORDS) * u64::from(cells.groups()),
            Self::Counters => COUNTER_BYTES,
            Self::Pairs | Self::HalfSortedPairs => room.pair_bytes(cells),
            Self::Digits => 4 * digits,
            Self::Sums => 4 * blocks(digits.max(u64::from(cells.groups()))),
            Self::Parts => room.part_bytes(),
        }
    }
}

/// Number of values of a digit.
const DIGITS: u64 = layout::CELL_WORKGROUP as u64;

/// Size of [`CellBuffer::Counters`] in bytes. The host reads the whole buffer.
pub const COUNTER_BYTES: u64 = layout::cell_counters::SIZE as u64;

/// Resource behind a binding of the compute path's passes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CellBinding {
    /// The shaders' `segment`: the uniform of the step's segment.
    Segment,
    /// The shaders' `splats` of the step's segment.
    Splats,
    /// The shaders' `cell_chunks` of the step's segment.
    Chunks,
    /// The shaders' `near_bits` of the step's segment.
    NearBits,
    /// The target `Steps`. Only frames that draw samples at edges have it.
    Steps,
    /// Records of splats at the near plane.
    NearRecords,
    /// The frame's `planes`.
    Planes,
    /// The uniform with the words of [`CellRound::words`].
    Round,
    /// A buffer of the compute path.
    Buffer(CellBuffer),
}

impl CellBinding {
    /// Returns the resource at a binding number of group 1 in a round; `None` if no step uses the number.
    pub fn of(binding: u32, round: CellRound) -> Option<Self> {
        use CellBuffer::{Counters, Digits, Groups, HalfSortedPairs, Pairs, Parts, Records, Sums};
        Some(match binding {
            0 => Self::Segment,
            1 => Self::Splats,
            3 => Self::NearBits,
            4 => Self::Planes,
            7 => Self::Steps,
            40 | 52 => Self::Buffer(Records),
            41 => Self::Buffer(Groups),
            42 | 53 => Self::Buffer(Counters),
            43 => Self::Chunks,
            44 => Self::NearRecords,
            45 => Self::Round,
            46 => Self::Buffer(if round == CellRound::Groups { Groups } else { Digits }),
            47 => Self::Buffer(Sums),
            48 => Self::Buffer(if round == CellRound::High { HalfSortedPairs } else { Pairs }),
            49 => Self::Buffer(if round == CellRound::Low { HalfSortedPairs } else { Pairs }),
            54 | 55 => Self::Buffer(Parts),
            _ => return None,
        })
    }
}

impl CellRound {
    /// All rounds.
    pub const ALL: [Self; 4] = [Self::Groups, Self::Low, Self::High, Self::Sorted];

    /// Returns the words of the shaders' `CellRound` for a tile.
    pub fn words(self, cells: &CellCounts) -> Vec<u32> {
        let bits = u32::BITS - cells.cells().saturating_sub(1).leading_zeros();
        let low = bits.div_ceil(2);
        let (scanned, shift, digits) = match self {
            Self::Groups | Self::Sorted => (layout::SCANNED_GROUPS, 0, 1),
            Self::Low => (layout::SCANNED_DIGITS, 0, 1 << low),
            Self::High => (layout::SCANNED_DIGITS, low, 1 << (bits - low)),
        };
        let mut words = vec![scanned, shift, digits];
        words.resize(layout::cell_round::SIZE.next_multiple_of(16) / 4, 0);
        words
    }
}

/// Counts of a tile that the CPU computes before it is drawn.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CellCounts {
    /// Number of columns and rows of cells.
    pub size: [u32; 2],
    /// Number of chunks that may touch the tile, per segment of the scene.
    pub chunks: Vec<u32>,
    /// Number of splats in these chunks.
    pub splats: u64,
    /// Number of records of splats at the near plane.
    pub near: u32,
}

impl CellCounts {
    /// Returns the number of columns and rows of cells in targets of a size in pixels.
    pub(crate) fn size_of([width, height]: [u32; 2]) -> [u32; 2] {
        [width, height].map(|side| side.div_ceil(layout::CELL_SIDE))
    }

    /// Returns the number of cells.
    pub fn cells(&self) -> u32 {
        self.size.iter().product()
    }

    /// Returns the number of chunks that may touch the tile.
    pub(crate) fn all_chunks(&self) -> u32 {
        self.chunks.iter().sum()
    }

    /// Returns the number of groups of records: one per chunk, plus groups of splats at the near plane.
    pub fn groups(&self) -> u32 {
        self.all_chunks() + self.near_groups()
    }

    fn near_groups(&self) -> u32 {
        self.near.div_ceil(layout::CELL_WORKGROUP)
    }
}

/// Capacity of the compute path's buffers, in records and pairs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CellRoom {
    /// Maximum number of records.
    pub records: u32,
    /// Maximum number of pairs of a record and a cell.
    pub pairs: u32,
}

impl CellRoom {
    /// Estimates the capacity for a tile before its first frame. The records are three fifths of the splats, or all of
    /// them in a small tile. The pairs are two per record and four per cell. `None` if the buffers would exceed the
    /// limits.
    pub fn estimate(cells: &CellCounts, limits: Limits) -> Option<Self> {
        let splats = cells.splats + u64::from(cells.near);
        let few = splats.min(1 << 18);
        let records = few.max(splats * 3 / 5);
        let pairs = (2 * records + 4 * u64::from(cells.cells())).min(u64::from(u32::MAX));
        Self::within([records.max(1), pairs], cells, limits)
    }

    /// Returns the capacity to draw a tile with: that of the tile before, or an estimate if it exceeds the limits or
    /// there is none. `None` if the estimate exceeds the limits, too.
    pub fn start(before: Option<Self>, cells: &CellCounts, limits: Limits) -> Option<Self> {
        let kept = before.and_then(|room| Self::within([room.records, room.pairs].map(u64::from), cells, limits));
        kept.or_else(|| Self::estimate(cells, limits))
    }

    /// Adds the records and pairs that were drawn to the statistics. `counters` are the words of
    /// [`CellBuffer::Counters`].
    pub fn count(counters: &[u32], stats: &mut Stats) {
        let [records, pairs] = needed(counters);
        stats.drawn += records;
        match stats.counters.iter_mut().find(|counter| counter.0 == CELL_PAIRS) {
            Some(counter) => counter.1 += pairs as f64,
            None => stats.counters.push((CELL_PAIRS, pairs as f64)),
        }
    }

    /// True if all records and pairs of a tile fit. `counters` are the words of [`CellBuffer::Counters`]. If not,
    /// nothing of the tile was drawn.
    pub fn holds(self, counters: &[u32]) -> bool {
        let [records, pairs] = needed(counters);
        records <= u64::from(self.records) && pairs <= u64::from(self.pairs)
    }

    /// Returns the capacity that a tile needs according to `counters`, with a margin of a quarter if the limits permit.
    /// `None` if the tile exceeds the limits. `counters` are the words of [`CellBuffer::Counters`].
    pub fn grown(self, counters: &[u32], cells: &CellCounts, limits: Limits) -> Option<Self> {
        let [records, pairs] = needed(counters);
        let exact = [records.max(self.records.into()), pairs.max(self.pairs.into())];
        let ample = [records + records / 4, pairs + pairs / 4];
        let ample = [ample[0].max(exact[0]), ample[1].max(exact[1])];
        Self::within(ample, cells, limits).or_else(|| Self::within([records, pairs], cells, limits))
    }

    fn within([records, pairs]: [u64; 2], cells: &CellCounts, limits: Limits) -> Option<Self> {
        let room = Self { records: records.try_into().ok()?, pairs: pairs.try_into().ok()? };
        let most = limits.buffer_bytes.min(limits.cell_bytes);
        let bytes = room.record_bytes().max(room.pair_bytes(cells)).max(room.part_bytes());
        (bytes <= most).then_some(room)
    }

    fn record_bytes(self) -> u64 {
        layout::record::SIZE as u64 * u64::from(self.records)
    }

    /// Returns the number of parts that dense cells may have; 0 if the pairs are too few for any dense cell.
    fn parts(self) -> u64 {
        let is_any_dense = self.pairs > layout::DENSE_PAIRS;
        if is_any_dense { 2 * u64::from(self.pairs).div_ceil(u64::from(layout::PART_PAIRS)) } else { 0 }
    }

    fn part_bytes(self) -> u64 {
        4 * u64::from(layout::PART_WORDS * layout::CELL_WORKGROUP) * self.parts()
    }

    fn pair_bytes(self, cells: &CellCounts) -> u64 {
        layout::cell_pair::SIZE as u64 * (u64::from(cells.cells()) + u64::from(self.pairs))
    }
}

/// Returns the numbers of records and pairs that a tile needs, from the words of [`CellBuffer::Counters`].
fn needed(counters: &[u32]) -> [u64; 2] {
    [layout::cell_counters::RECORDS, layout::cell_counters::PAIRS]
        .map(|offset| counters.get(offset / 4).copied().map_or(0, u64::from))
}

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

/// Dispatches that share a name in the statistics.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CellStage {
    /// Name in the statistics.
    pub name: &'static str,
    /// Dispatches in order; each depends on all before it.
    pub steps: Vec<CellStep>,
}

/// Returns the pixel passes that follow the cells of a plan.
pub fn pixel_passes_after_cells(plan: &FramePlan) -> Vec<PixelPass> {
    let looks_at_neighbours = plan.planes.color && (plan.has(Pass::Outlines) || plan.has(Pass::EyeDome));
    looks_at_neighbours.then_some(PixelPass::CellNeighbours).into_iter().collect()
}

/// Entry points that draw a plan's cells.
struct RasterEntries {
    cells: &'static str,
    /// Entry points for the parts of dense cells: thresholds, sums, and combining the parts. `None` where the sides of
    /// oriented splats are separated: their cells are drawn whole.
    of_parts: Option<[&'static str; 3]>,
}

impl RasterEntries {
    fn of(plan: &FramePlan) -> Self {
        let has_surface = plan.attributes.normal || plan.attributes.depth;
        let is_full = !plan.shadow_maps.is_empty() || plan.shader == Shader::Toon;
        if plan.keeps_facings {
            let cells = if is_full { "cell_sided_shadowed_surfaces" } else { "cell_sided_surfaces" };
            return Self { cells, of_parts: None };
        }
        let (cells, parts) = match (is_full, has_surface) {
            (true, _) => ("cell_shadowed_surfaces", "cell_part_surfaces"),
            (false, true) => ("cell_surfaces", "cell_part_surfaces"),
            (false, false) => ("cell_colors", "cell_part_colors"),
        };
        let combine = if is_full { "cell_combine_shadowed" } else { "cell_combine" };
        Self { cells, of_parts: Some(["cell_part_thresholds", parts, combine]) }
    }
}

/// Arranges a number of workgroups in rows of [`layout::CELL_ROW`].
fn grid(count: u64) -> [u32; 2] {
    let row = u64::from(layout::CELL_ROW);
    [count.min(row) as u32, count.div_ceil(row) as u32]
}

/// Returns the stages that draw a tile, in order.
pub fn cell_stages(plan: &FramePlan, cells: &CellCounts, room: CellRoom) -> Vec<CellStage> {
    let workgroup = u64::from(layout::CELL_WORKGROUP);
    let blocks = |count: u64| count.div_ceil(u64::from(layout::CELL_BLOCK));
    let step = |entry, round, count: u64| CellStep { entry, round, segment: None, workgroups: grid(count) };
    let begin = step("cell_begin", CellRound::Groups, u64::from(cells.cells()).div_ceil(workgroup));
    let mut setup = vec![begin];
    let of_segments = cells.chunks.iter().enumerate().filter(|(_, chunks)| **chunks > 0);
    setup.extend(of_segments.map(|(segment, &chunks)| CellStep {
        segment: Some(segment),
        ..step("cell_setup", CellRound::Groups, u64::from(chunks))
    }));
    if cells.near > 0 {
        setup.push(step("cell_near", CellRound::Groups, u64::from(cells.near_groups())));
    }
    let entries = RasterEntries::of(plan);
    let of_cells = |entry| CellStep { workgroups: cells.size, ..step(entry, CellRound::Sorted, 0) };
    let mut raster = vec![of_cells(entries.cells)];
    if let Some([thresholds, sums, combine]) = entries.of_parts.filter(|_| room.parts() > 0 && cells.groups() > 0) {
        let of_parts = |entry| step(entry, CellRound::Sorted, room.parts());
        raster.extend([of_parts(thresholds), of_parts(sums), of_cells(combine)]);
    }
    let mut stages = vec![CellStage { name: "setup", steps: setup }];
    let groups = u64::from(cells.groups());
    if groups > 0 {
        let scan = |round, length: u64| {
            let count = blocks(length);
            [step("cell_scan_blocks", round, count), step("cell_scan_add", round, count)]
        };
        let mut sort = scan(CellRound::Groups, groups).to_vec();
        sort.push(step("cell_emit", CellRound::Groups, groups));
        let pair_blocks = blocks(u64::from(room.pairs));
        for round in [CellRound::Low, CellRound::High] {
            let digits = round.words(cells).get(2).copied().map_or(1, u64::from);
            sort.push(step("cell_count_digits", round, pair_blocks));
            sort.extend(scan(round, digits * pair_blocks));
            sort.push(step("cell_scatter", round, pair_blocks));
        }
        sort.push(step("cell_find_ranges", CellRound::Sorted, u64::from(room.pairs).div_ceil(workgroup)));
        stages.push(CellStage { name: "sort", steps: sort });
    }
    stages.push(CellStage { name: "raster", steps: raster });
    stages
}

/// True for entry points that draw cells. Their pipelines have their own layout of the frame's buffers.
pub fn is_cell_entry(entry: &str) -> bool {
    entry.starts_with("cell_") && entry != PixelPass::CellNeighbours.entry()
}

/// Returns all entry points that a plan's cells may need, each once.
pub fn cell_entries(plan: &FramePlan) -> Vec<&'static str> {
    let RasterEntries { cells, of_parts } = RasterEntries::of(plan);
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
    before.into_iter().chain([cells]).chain(of_parts.into_iter().flatten()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_model::{Camera, EdgeAa, Projection, Settings};
    use surfel_render::{Capabilities, GaussianColors, Planes, SceneSummary, View, plan};
    use surfel_shaders::{BindingKind, ENTRIES};

    fn planned(summary: &SceneSummary, planes: Planes, change: impl FnOnce(&mut Settings)) -> FramePlan {
        let projection = Projection::Perspective { fov_y_deg: 45.0 };
        let (eye, up, size) = ([0.0, 0.0, 5.0], [0.0, 1.0, 0.0], [8, 8]);
        let view = View::new(&Camera { eye, target: [0.0; 3], up, projection, near: 0.1, far: None, size }).unwrap();
        let mut settings = Settings::default();
        change(&mut settings);
        plan(summary, &view, &settings, planes, &Capabilities::everything("test")).unwrap()
    }

    fn cells(chunks: &[u32], near: u32) -> CellCounts {
        CellCounts { size: [5, 3], chunks: chunks.to_vec(), splats: 256 * u64::from(chunks.iter().sum::<u32>()), near }
    }

    #[test]
    fn compute_shaders_draw_opaque_whole_splats_and_nothing_else() {
        let plain = SceneSummary::default();
        for shader in [Shader::Unlit, Shader::Phong, Shader::Normal, Shader::Toon, Shader::Edl, Shader::Matcap] {
            let plan = planned(&plain, Planes::ALL.with_fragments(true), |s| s.shader = shader);
            let drawn = [GpuPath::Auto, GpuPath::Compute, GpuPath::Raster].map(|path| path.draws_cells(&plan));
            assert_eq!(drawn, [true, true, false], "{shader:?}");
        }
        let with = |change: fn(&mut SceneSummary)| {
            let mut summary = SceneSummary::default();
            change(&mut summary);
            summary
        };
        let others = [
            planned(&with(|s| s.clips = true), Planes::COLOR, |_| ()),
            planned(&with(|s| s.meshes = true), Planes::COLOR, |_| ()),
            planned(&with(|s| s.gaussians = Some(GaussianColors::Linear)), Planes::COLOR, |_| ()),
            planned(&with(|s| s.transparent = true), Planes::COLOR, |s| {
                s.transparency = "peel:2".parse().unwrap();
            }),
            planned(&plain, Planes::COLOR, |s| s.edge_aa = EdgeAa::Coverage),
            planned(&plain, Planes::COLOR, |s| s.edge_aa = EdgeAa::Samples),
            planned(&plain, Planes::COLOR, |s| s.accumulate = Accumulate::F16),
            planned(&plain, Planes::COLOR.with_index(true), |_| ()),
        ];
        for (i, plan) in others.iter().enumerate() {
            assert!(!GpuPath::Compute.draws_cells(plan), "{i}");
        }
        // With clipping and transparency disabled, all splats are opaque and unclipped.
        let off = planned(&with(|s| (s.clips, s.transparent) = (true, true)), Planes::COLOR, |s| {
            s.clip = ClipPolicy::Off;
            s.transparency = "off".parse().unwrap();
        });
        assert!(GpuPath::Auto.draws_cells(&off));
    }

    #[test]
    fn plan_runs_what_it_asks_for_and_no_more() {
        let plain = SceneSummary::default();
        let of = |shader| {
            let plan = planned(&plain, Planes::COLOR, |s| s.shader = shader);
            (RasterEntries::of(&plan).cells, pixel_passes_after_cells(&plan))
        };
        assert_eq!(of(Shader::Unlit), ("cell_colors", vec![]));
        assert_eq!(of(Shader::Phong), ("cell_surfaces", vec![]));
        assert_eq!(of(Shader::Toon), ("cell_shadowed_surfaces", vec![PixelPass::CellNeighbours]));
        assert_eq!(of(Shader::Edl), ("cell_surfaces", vec![PixelPass::CellNeighbours]));
        let plan = planned(&plain, Planes::COLOR, |s| s.shader = Shader::Unlit);
        let names = |cells: &CellCounts, pairs| -> Vec<&str> {
            let stages = cell_stages(&plan, cells, CellRoom { records: 100, pairs });
            stages.iter().flat_map(|stage| stage.steps.iter().map(|step| step.entry)).collect()
        };
        // A tile that no splat touches is only cleared and shaded.
        assert_eq!(names(&cells(&[0, 0], 0), 9999), ["cell_begin", "cell_colors"]);
        // With few pairs no cell can be dense.
        let few = names(&cells(&[3, 0], 0), layout::DENSE_PAIRS);
        assert_eq!(few.iter().filter(|name| **name == "cell_setup").count(), 1);
        assert!(!few.contains(&"cell_near") && !few.contains(&"cell_part_thresholds") && few.contains(&"cell_emit"));
        let many = names(&cells(&[3, 2], 7), layout::DENSE_PAIRS + 1);
        assert_eq!(many.iter().filter(|name| **name == "cell_setup").count(), 2);
        assert_eq!(&many[many.len() - 3..], ["cell_part_thresholds", "cell_part_colors", "cell_combine"]);
        assert!(many.contains(&"cell_near") && many.iter().all(|name| cell_entries(&plan).contains(name)));
    }

    #[test]
    fn sides_are_kept_apart_only_where_a_plan_does() {
        let both = SceneSummary { both_facings: true, ..SceneSummary::default() };
        for (shader, entry) in [(Shader::Phong, "cell_sided_surfaces"), (Shader::Toon, "cell_sided_shadowed_surfaces")]
        {
            let plan = planned(&both, Planes::COLOR, |s| s.shader = shader);
            assert!(GpuPath::Auto.draws_cells(&plan));
            let entries = cell_entries(&plan);
            assert!(entries.contains(&entry) && !entries.iter().any(|name| name.starts_with("cell_part")));
            let plan = planned(&SceneSummary::default(), Planes::COLOR, |s| s.shader = shader);
            assert!(!cell_entries(&plan).iter().any(|name| name.contains("sided")));
        }
    }

    #[test]
    fn passes_bind_what_every_device_has() {
        for entry in ENTRIES.iter().filter(|entry| entry.name.starts_with("cell_")) {
            let storage = |kind| matches!(kind, BindingKind::StorageRead | BindingKind::StorageWrite);
            let buffers = entry.bindings.iter().filter(|binding| storage(binding.kind)).count();
            assert!(buffers <= 8, "{} binds {buffers} storage buffers", entry.name);
            let invocations: u32 = entry.workgroup.iter().product();
            assert!(invocations <= 256, "{}", entry.name);
            if entry.name == PixelPass::CellNeighbours.entry() {
                continue;
            }
            for binding in entry.bindings.iter().filter(|binding| binding.group == 1) {
                for round in CellRound::ALL {
                    assert!(CellBinding::of(binding.binding, round).is_some(), "{} {binding:?}", entry.name);
                }
            }
        }
        for count in [1, 32_768, 32_769, 10_000_000] {
            let [x, y] = grid(count);
            assert!(x <= 65_535 && y <= 65_535 && u64::from(x) * u64::from(y) >= count, "{count}");
        }
    }

    #[test]
    fn digits_tell_all_cells_apart() {
        for size in [[1, 1], [1, 2], [5, 3], [64, 64], [120, 68], [256, 256]] {
            let counts = CellCounts { size, ..CellCounts::default() };
            let [low, high] = [CellRound::Low, CellRound::High].map(|round| round.words(&counts));
            assert_eq!((low[1], 1 << high[1]), (0, low[2]), "{size:?}");
            assert!(u64::from(low[2]) * u64::from(high[2]) >= u64::from(counts.cells()), "{size:?}");
            assert!(low[2].max(high[2]) <= DIGITS as u32, "{size:?}");
        }
        assert!(CellCounts::size_of([LARGEST_CELL_TILE; 2]).iter().product::<u32>() <= 1 << 16);
    }

    #[test]
    fn room_grows_to_what_is_needed_or_is_refused() {
        let (counts, all) = (cells(&[4], 3), Limits::default());
        let room = CellRoom::estimate(&counts, all).unwrap();
        assert_eq!(room.records, 4 * 256 + 3);
        assert!(room.holds(&[room.records, room.pairs]) && !room.holds(&[room.records + 1, 0]));
        let needed = [room.records, 40_000_000];
        assert!(!room.holds(&needed));
        let grown = room.grown(&needed, &counts, all).unwrap();
        assert!(grown.holds(&needed) && grown.records >= room.records);
        // The capacity of the tile before is used while it is within the limits.
        assert_eq!(CellRoom::start(Some(grown), &counts, all), Some(grown));
        let little = Limits { cell_bytes: 1 << 20, ..all };
        assert_eq!(CellRoom::start(Some(grown), &counts, little), Some(room));
        assert_eq!(room.grown(&needed, &counts, little), None);
        assert_eq!(CellRoom::estimate(&counts, Limits { cell_bytes: 1000, ..all }), None);
        // The count of pairs overflows.
        assert_eq!(room.grown(&[1, u32::MAX], &counts, all), None);
        for buffer in CellBuffer::ALL {
            let [less, more] = [room, grown].map(|room| buffer.bytes(&counts, room));
            assert!(less <= more, "{buffer:?}");
        }
    }
}

//! The compute path, which draws opaque splats without raster hardware: which frames it draws, its buffers, and its
//! steps. `shaders/passes/cells.wgsl` says how it works.

use crate::passes::pixel_pass::PixelPass;
use crate::scene::limits::Limits;
use surfel_model::ClipPolicy;
use surfel_render::{FramePlan, Pass};
use surfel_shaders::layout;

/// Largest side of a tile that the compute path draws, pixels: its cells are sorted by two digits of eight bits.
pub(crate) const LARGEST_CELL_TILE: u32 = 256 * layout::CELL_SIDE;

/// The way in which a GPU draws frames. The images are the same up to the rounding of sums.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum GpuPath {
    /// Compute shaders where they draw a frame, else raster hardware.
    #[default]
    Auto,
    /// Raster hardware: quads, depth tests and additive blending.
    Raster,
    /// Compute shaders wherever they draw a frame, else raster hardware. Today it does what [`GpuPath::Auto`] does.
    Compute,
}

impl GpuPath {
    /// True if a plan's frames are drawn by compute shaders: frames of opaque, whole splats on one surface. Clipped or
    /// transparent splats, both facings of oriented clouds, polygons, trained Gaussians, antialiased edges, the planes
    /// of indices and shadow maps need raster hardware.
    pub fn draws_cells(self, plan: &FramePlan) -> bool {
        let is_drawn = |pass: &Pass| {
            use Pass::{Attributes, EyeDome, Outlines, Shade, ShadowMap, Visibility};
            matches!(pass, ShadowMap | Visibility | Attributes | Shade | Outlines | EyeDome)
        };
        let has_splats = plan.has(Pass::Visibility) && plan.has(Pass::Shade);
        let is_whole = plan.clip == ClipPolicy::Off && !plan.keeps_facings && !plan.separates_transparent;
        self != Self::Raster && has_splats && is_whole && !plan.planes.index && plan.passes.iter().all(is_drawn)
    }
}

/// Which of the repeated passes a step is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum CellRound {
    /// Counting the pairs of groups, and emitting them.
    Groups,
    /// Sorting by the lower digit of the cell.
    Low,
    /// Sorting by the upper digit.
    High,
    /// Reading the sorted pairs.
    Sorted,
}

/// A buffer of the compute path, whose contents last for a tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum CellBuffer {
    /// The shaders' `cell_records`.
    Records,
    /// The shaders' `cell_groups`.
    Groups,
    /// The shaders' `cell_counters`, which the host reads: see [`CellRoom::holds`].
    Counters,
    /// Pairs, as they are emitted and at last sorted.
    Pairs,
    /// Pairs, sorted by the lower digit.
    HalfSortedPairs,
    /// How often each block has each digit.
    Digits,
    /// Sums of scanned blocks.
    Sums,
}

impl CellBuffer {
    /// All of them.
    pub const ALL: [Self; 7] =
        [Self::Records, Self::Groups, Self::Counters, Self::Pairs, Self::HalfSortedPairs, Self::Digits, Self::Sums];

    /// A name for messages and debuggers.
    pub fn name(self) -> &'static str {
        match self {
            Self::Records => "records of cells",
            Self::Groups => "groups",
            Self::Counters => "counters",
            Self::Pairs => "pairs",
            Self::HalfSortedPairs => "half-sorted pairs",
            Self::Digits => "digits",
            Self::Sums => "scanned sums",
        }
    }

    /// Its size in bytes for a tile.
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
        }
    }
}

/// Values of a digit.
const DIGITS: u64 = layout::CELL_WORKGROUP as u64;

/// Bytes of [`CellBuffer::Counters`], all of which the host reads.
pub const COUNTER_BYTES: u64 = layout::cell_counters::SIZE as u64;

/// What a binding of the compute path's passes is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CellBinding {
    /// The shaders' `segment` of the step's segment.
    Segment,
    /// Its `splats`.
    Splats,
    /// Its `cell_chunks`.
    Chunks,
    /// Its `near_bits`.
    NearBits,
    /// The target `Steps`, which frames of samples alone have.
    Steps,
    /// Records of splats at the near plane.
    NearRecords,
    /// The frame's `planes`.
    Planes,
    /// The uniform of [`CellRound::words`].
    Round,
    /// A buffer of the path.
    Buffer(CellBuffer),
}

impl CellBinding {
    /// What a binding number of group 1 is in a step of a round; `None` for numbers that no step has.
    pub fn of(binding: u32, round: CellRound) -> Option<Self> {
        use CellBuffer::{Counters, Digits, Groups, HalfSortedPairs, Pairs, Records, Sums};
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
            _ => return None,
        })
    }
}

impl CellRound {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Groups, Self::Low, Self::High, Self::Sorted];

    /// Words of the shaders' `CellRound` for a tile.
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

/// Counts of a tile that the host knows.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CellCounts {
    /// Columns and rows of cells.
    pub size: [u32; 2],
    /// Chunks of each segment that may touch the tile.
    pub chunks: Vec<u32>,
    /// Splats of these.
    pub splats: u64,
    /// Records of splats at the near plane.
    pub near: u32,
}

impl CellCounts {
    /// Cells of targets of this size.
    pub(crate) fn size_of([width, height]: [u32; 2]) -> [u32; 2] {
        [width, height].map(|side| side.div_ceil(layout::CELL_SIDE))
    }

    /// Number of cells.
    pub fn cells(&self) -> u32 {
        self.size.iter().product()
    }

    /// Number of chunks that may touch the tile.
    pub(crate) fn all_chunks(&self) -> u32 {
        self.chunks.iter().sum()
    }

    /// Groups of records: one of each chunk, and those of splats at the near plane.
    pub fn groups(&self) -> u32 {
        self.all_chunks() + self.near_groups()
    }

    fn near_groups(&self) -> u32 {
        self.near.div_ceil(layout::CELL_WORKGROUP)
    }
}

/// How many records and pairs the buffers of the compute path have room for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CellRoom {
    /// Records.
    pub records: u32,
    /// Pairs of records and cells.
    pub pairs: u32,
}

impl CellRoom {
    /// Room for a tile before its first frame was drawn: most splats are drawn or half of them, and touch two cells.
    /// `None` if the tile doesn't fit the limits.
    pub fn estimate(cells: &CellCounts, limits: Limits) -> Option<Self> {
        let splats = cells.splats + u64::from(cells.near);
        let few = splats.min(1 << 18);
        let records = few.max(splats * 3 / 5);
        let pairs = (2 * records + 4 * u64::from(cells.cells())).min(u64::from(u32::MAX));
        Self::within([records.max(1), pairs], cells, limits)
    }

    /// Room to draw a tile with: what there is from tiles before, or an estimate. `None` if the tile doesn't fit the
    /// limits.
    pub fn start(before: Option<Self>, cells: &CellCounts, limits: Limits) -> Option<Self> {
        let kept = before.and_then(|room| Self::within([room.records, room.pairs].map(u64::from), cells, limits));
        kept.or_else(|| Self::estimate(cells, limits))
    }

    /// Splats that were drawn, of the words of [`CellBuffer::Counters`].
    pub fn drawn(counters: &[u32]) -> u32 {
        needed(counters)[0] as u32
    }

    /// True if the buffers held what a tile needed: words of [`CellBuffer::Counters`]. What didn't fit wasn't drawn.
    pub fn holds(self, counters: &[u32]) -> bool {
        let [records, pairs] = needed(counters);
        records <= u64::from(self.records) && pairs <= u64::from(self.pairs)
    }

    /// Room for what a tile turned out to need, and a quarter more. `None` if it doesn't fit the limits.
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
        (room.record_bytes() <= most && room.pair_bytes(cells) <= most).then_some(room)
    }

    fn record_bytes(self) -> u64 {
        layout::record::SIZE as u64 * u64::from(self.records)
    }

    fn pair_bytes(self, cells: &CellCounts) -> u64 {
        layout::cell_pair::SIZE as u64 * (u64::from(cells.cells()) + u64::from(self.pairs))
    }
}

/// Records and pairs that counters say a tile needs.
fn needed(counters: &[u32]) -> [u64; 2] {
    [layout::cell_counters::RECORDS, layout::cell_counters::PAIRS]
        .map(|offset| counters.get(offset / 4).copied().map_or(0, u64::from))
}

/// A dispatch of the compute path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CellStep {
    /// Entry point.
    pub entry: &'static str,
    /// What its bindings are, and what its uniform says.
    pub round: CellRound,
    /// The segment whose splats it reads.
    pub segment: Option<usize>,
    /// Workgroups along x and y.
    pub workgroups: [u32; 2],
}

/// Dispatches of one name in the statistics.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CellStage {
    /// The name.
    pub name: &'static str,
    /// The dispatches, each of which needs all before it.
    pub steps: Vec<CellStep>,
}

/// The pixel passes that follow a plan's cells.
pub fn pixel_passes_after_cells(plan: &FramePlan) -> Vec<PixelPass> {
    let looks_at_neighbours = plan.planes.color && (plan.has(Pass::Outlines) || plan.has(Pass::EyeDome));
    looks_at_neighbours.then_some(PixelPass::CellNeighbours).into_iter().collect()
}

/// The entry point that draws a plan's cells.
pub(crate) fn raster_entry(plan: &FramePlan) -> &'static str {
    let has_surface = plan.attributes.normal || plan.attributes.depth;
    let is_full = !plan.shadow_maps.is_empty() || plan.shader == surfel_model::Shader::Toon;
    match (is_full, has_surface) {
        (true, _) => "cell_shadowed_surfaces",
        (false, true) => "cell_surfaces",
        (false, false) => "cell_colors",
    }
}

/// Workgroups of a dispatch of so many, as rows of [`layout::CELL_ROW`].
fn grid(count: u64) -> [u32; 2] {
    let row = u64::from(layout::CELL_ROW);
    [count.min(row) as u32, count.div_ceil(row) as u32]
}

/// The stages of a tile.
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
    let raster = CellStep {
        entry: raster_entry(plan),
        round: CellRound::Sorted,
        segment: None,
        workgroups: cells.size,
    };
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
    stages.push(CellStage { name: "raster", steps: vec![raster] });
    stages
}

/// The entry points that a plan's cells may need, each once.
pub fn cell_entries(plan: &FramePlan) -> Vec<&'static str> {
    vec![
        "cell_begin",
        "cell_setup",
        "cell_near",
        "cell_scan_blocks",
        "cell_scan_add",
        "cell_emit",
        "cell_count_digits",
        "cell_scatter",
        "cell_find_ranges",
        raster_entry(plan),
    ]
}

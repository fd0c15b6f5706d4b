//! Compute path: draws splats by compute shaders, without raster hardware. This module decides which frames it
//! draws and sizes its buffers. `shaders/passes/cells.wgsl` explains the algorithm. A *cell* is a square of 16×16
//! pixels of a tile, which one workgroup draws. A *bin* is a square of 16×16 cells. A *record* is a splat as set up for
//! a tile: its projected forms, pixel boxes and colour in a buffer. A *pair* is a record and a cell that the record may
//! touch, a *bin pair* a record and a bin.

use crate::passes::layer_draws::LAYERS_DRAWN;
use crate::passes::memory::{add_counter, raise_counter};
use crate::scene::limits::Limits;
use surfel_render::{FramePlan, Pass, Stats};
use surfel_shaders::layout;

/// Side of a bin, in cells.
pub(crate) const BIN_SIDE: u32 = layout::BIN_SIDE;

/// Maximum number of bins of a tile, or of a tile of samples. A workgroup has one invocation per bin.
pub(crate) const MAX_BINS: u32 = layout::CELL_WORKGROUP;

/// Largest side of a tile that the compute path draws, in pixels: a square of [`MAX_BINS`].
pub(crate) const MAX_CELL_TILE: u32 = 16 * BIN_SIDE * layout::CELL_SIDE;

/// Way in which the GPU draws a frame: by raster hardware or by compute shaders. All paths draw the same image up to
/// the rounding of sums.
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
    /// True if compute shaders draw the frames of a plan. They draw frames of splats, clipped or not, and always sum in
    /// f32.
    ///
    /// Polygons, balls, trained Gaussians and the drawing of shadow maps need raster hardware.
    pub fn draws_cells(self, plan: &FramePlan) -> bool {
        let is_drawn = |pass: &Pass| {
            use Pass::{
                ABuffer, Attributes, EdgeAntialiasing, EdgeSamples, EyeDome, Nearest, Outlines, PeelLayer,
                RemainingLayer, Shade, ShadowMap, Visibility,
            };
            let is_of_splats = matches!(pass, ShadowMap | Visibility | Attributes | Nearest | Shade);
            let is_of_layers = matches!(pass, PeelLayer | RemainingLayer | ABuffer);
            is_of_splats || is_of_layers || matches!(pass, Outlines | EyeDome | EdgeAntialiasing | EdgeSamples)
        };
        let has_splats = plan.has(Pass::Visibility) && plan.has(Pass::Shade);
        self != Self::Raster && has_splats && plan.passes.iter().all(is_drawn)
    }
}

/// Name, in the statistics, of the counter of pairs of a splat and a cell that the compute path drew, excluding
/// samples.
pub const CELL_PAIRS: &str = "cell_pairs";

/// Names of the counters for edge samples in the statistics: active cells (those with a sampled pixel), and pairs of a
/// splat and an active cell.
const OF_SAMPLES: [&str; 2] = ["sample_cells", "sample_pairs"];

/// Round of the compute path. Some shader passes run several times in a tile, on other buffers; the round selects their
/// bindings and their uniform.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum CellRound {
    /// Counts the bin pairs of each group of records, and sorts them by bin.
    Groups,
    /// Numbers the active cells of a tile of samples, which are the cells with a sampled pixel.
    Active,
    /// Writes the lists of cells from the records of their bins.
    Lists,
    /// Reads the lists, to draw the cells.
    Sorted,
}

/// Buffer of the compute path. Its contents are valid while one tile is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum CellBuffer {
    /// Records of splats: the shaders' `cell_records`.
    Records,
    /// Groups of records, which are set up together, and numbers of their bin pairs: the shaders' `cell_groups`. A
    /// group has the records of a chunk, or those of up to 256 splats that reach the near plane or that the application
    /// places.
    Groups,
    /// Counts of records, pairs and active cells of each tile: the shaders' `cell_counters`. The host reads them back
    /// for [`CellCapacity::holds`].
    Counters,
    /// Pairs of a record and a bin, sorted by bin: the shaders' `bin_records`.
    BinRecords,
    /// Ranges of the bins in [`CellBuffer::BinRecords`].
    Bins,
    /// Lists of cells: the index of each record that may touch the cell, in the order of splats. A header stores the
    /// range of each list.
    Lists,
    /// Number of pairs per cell and block of its bin's records.
    Counts,
    /// Sums of blocks of numbers, which the first pass of a prefix sum (scan) computes.
    Sums,
    /// Depth thresholds and sums of the parts into which dense cells, those with very many pairs, are split.
    Parts,
    /// Number of active cells (with a sampled pixel) before each cell in a tile of samples, and their summed-area
    /// table: the shaders' `cell_active`.
    Active,
}

impl CellBuffer {
    /// All buffers.
    pub const ALL: [Self; 10] = [
        Self::Records,
        Self::Groups,
        Self::Counters,
        Self::BinRecords,
        Self::Bins,
        Self::Lists,
        Self::Counts,
        Self::Sums,
        Self::Parts,
        Self::Active,
    ];

    /// Returns the buffer's name for messages and debuggers.
    pub fn name(self) -> &'static str {
        match self {
            Self::Records => "records of cells",
            Self::Groups => "groups",
            Self::Counters => "counters",
            Self::BinRecords => "records of bins",
            Self::Bins => "bins",
            Self::Lists => "lists of cells",
            Self::Counts => "counts of lists",
            Self::Sums => "scanned sums",
            Self::Parts => "parts of cells",
            Self::Active => "active cells",
        }
    }

    /// Returns the buffer's size in bytes for a tile of pixels and the tiles of its samples, whose counts are `all`,
    /// with the capacity `room`.
    pub(crate) fn bytes(self, all: &[CellCounts], room: CellCapacity) -> u64 {
        match self {
            Self::Counters => COUNTER_BYTES * all.len() as u64,
            _ => all.iter().map(|cells| self.bytes_of_one(cells, room)).max().unwrap_or(0),
        }
    }

    /// Returns the buffer's size in bytes for a single tile.
    fn bytes_of_one(self, cells: &CellCounts, room: CellCapacity) -> u64 {
        let blocks = |count: u64| count.div_ceil(u64::from(layout::CELL_BLOCK));
        match self {
            Self::Records => room.record_bytes(cells),
            Self::Groups => cells.group_bytes(),
            Self::Counters => COUNTER_BYTES,
            Self::BinRecords => room.bin_pair_bytes(),
            Self::Bins => layout::cell_bin::SIZE as u64 * (u64::from(MAX_BINS) + 1),
            Self::Lists => room.list_bytes(cells),
            Self::Counts => 4 * room.list_counts(cells),
            Self::Sums => {
                let scanned = room.list_counts(cells).max(cells.group_counts());
                4 * blocks(scanned.max(u64::from(cells.cells()) + 1))
            }
            Self::Parts => room.part_bytes(cells),
            Self::Active => 4 * cells.active_words(),
        }
    }
}

/// Size of one tile's counters in [`CellBuffer::Counters`], in bytes.
const COUNTER_BYTES: u64 = layout::cell_counters::SIZE as u64;

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
    /// The shaders' `near_records`: records of splats that reach the near plane, which the CPU has set up.
    NearRecords,
    /// The shaders' `planes`, the results of the tile.
    Planes,
    /// The uniform that contains the words of [`CellRound::words`].
    Round,
    /// A buffer of the compute path.
    Buffer(CellBuffer),
}

impl CellBinding {
    /// Returns the resource at binding number `binding` of group 1 in a round; `None` if no step uses the number.
    pub fn of(binding: u32, round: CellRound) -> Option<Self> {
        use CellBuffer::{Active, BinRecords, Bins, Counters, Counts, Groups, Lists, Parts, Records, Sums};
        Some(match binding {
            0 => Self::Segment,
            1 => Self::Splats,
            3 => Self::NearBits,
            4 => Self::Planes,
            40 | 52 => Self::Buffer(Records),
            41 => Self::Buffer(Groups),
            42 | 53 => Self::Buffer(Counters),
            43 => Self::Chunks,
            44 => Self::NearRecords,
            45 => Self::Round,
            46 => Self::Buffer(match round {
                CellRound::Groups => Groups,
                CellRound::Active => Active,
                _ => Counts,
            }),
            47 => Self::Buffer(Sums),
            54 => Self::Buffer(Parts),
            56 | 57 => Self::Buffer(Active),
            58 | 59 => Self::Buffer(BinRecords),
            60 | 61 => Self::Buffer(Bins),
            62 | 63 => Self::Buffer(Lists),
            _ => return None,
        })
    }
}

impl CellRound {
    /// All rounds.
    pub const ALL: [Self; 4] = [Self::Groups, Self::Active, Self::Lists, Self::Sorted];

    /// Returns the words of the shaders' `CellRound` for this round.
    pub fn words(self) -> Vec<u32> {
        let scanned = match self {
            Self::Groups | Self::Sorted => layout::SCANNED_GROUPS,
            Self::Active => layout::SCANNED_ACTIVE,
            Self::Lists => layout::SCANNED_LISTS,
        };
        let mut words = vec![scanned];
        words.resize(layout::cell_round::SIZE.next_multiple_of(16) / 4, 0);
        words
    }
}

/// Counts for a tile that the CPU computes before the tile is drawn.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CellCounts {
    /// Number of columns and rows of cells.
    pub size: [u32; 2],
    /// Number of workgroups that set up each segment of the scene: one per chunk that may touch the tile, or several if
    /// the segment is a single chunk because the application places its splats.
    pub chunks: Vec<u32>,
    /// Number of splats in the chunks that may touch the tile.
    pub splats: u64,
    /// Number of records of splats that reach the near plane.
    pub near: u32,
    /// True for a tile of samples: only its active cells have lists.
    pub is_of_samples: bool,
    /// True if records store the index and centre of their splat, which planes such as `index` and layers that are lit
    /// splat by splat need.
    pub has_places: bool,
    /// True if records of clipped splats store their clips.
    pub has_clips: bool,
    /// True if transparent layers are drawn.
    pub has_layers: bool,
    /// True for a tile of samples whose plan has transparent layers: its samples are stored before their means are
    /// written.
    pub has_layered_samples: bool,
    /// Number of floats of the planes that the tile writes, of a tile of samples those of its tile of pixels.
    pub plane_floats: u32,
    /// True if the sides of oriented splats are separated.
    pub has_sides: bool,
}

impl CellCounts {
    /// Returns the number of columns and rows of cells for targets of this size in pixels.
    pub(crate) fn size_of([width, height]: [u32; 2]) -> [u32; 2] {
        [width, height].map(|side| side.div_ceil(layout::CELL_SIDE))
    }

    /// Returns the number of cells.
    pub fn cells(&self) -> u32 {
        self.size.iter().product()
    }

    /// Returns the number of workgroups that set up segments, the sum of [`CellCounts::chunks`].
    pub(crate) fn all_chunks(&self) -> u32 {
        self.chunks.iter().sum()
    }

    /// Returns the number of groups of records: one per workgroup that sets up a segment, plus those of splats that
    /// reach the near plane.
    pub fn groups(&self) -> u32 {
        self.all_chunks() + self.near_groups()
    }

    /// Returns the number of groups of records of splats that reach the near plane.
    pub(crate) fn near_groups(&self) -> u32 {
        self.near.div_ceil(layout::CELL_WORKGROUP)
    }

    /// True if the tile has records, and transparent layers are drawn of them.
    pub(crate) fn draws_layers(&self) -> bool {
        self.has_layers && self.groups() > 0
    }

    /// Returns the number of counts of bin pairs: one per bin and group.
    pub(crate) fn group_counts(&self) -> u64 {
        u64::from(self.bins()) * u64::from(self.groups())
    }

    /// Returns the size of [`CellBuffer::Groups`], in bytes.
    fn group_bytes(&self) -> u64 {
        4 * (self.group_counts() + u64::from(layout::GROUP_WORDS) * u64::from(self.groups()))
    }

    /// Returns the number of bins.
    pub(crate) fn bins(&self) -> u32 {
        bins_of(self.size)
    }

    /// Returns the number of header words before the lists of cells: two per cell of the bins, or three per active cell
    /// of samples.
    pub(crate) fn header(&self, room: CellCapacity) -> u32 {
        if self.is_of_samples { 3 * room.active } else { 2 * BIN_SIDE * BIN_SIDE * self.bins() }
    }

    /// Returns the number of words of [`CellBuffer::Active`], at least one.
    fn active_words(&self) -> u64 {
        let [columns, rows] = self.size.map(u64::from);
        if self.is_of_samples { columns * rows + 1 + (columns + 1) * (rows + 1) } else { 1 }
    }
}

/// Returns the number of bins of a tile with these numbers of columns and rows of cells.
pub(crate) fn bins_of(size: [u32; 2]) -> u32 {
    size.map(|cells| cells.div_ceil(BIN_SIDE)).iter().product()
}

/// Capacity of the compute path's buffers. Tiles that exceed it aren't drawn, and the host draws them again with more.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CellCapacity {
    /// Maximum number of records.
    pub records: u32,
    /// Maximum number of pairs of a record and a bin.
    pub bin_pairs: u32,
    /// Maximum number of pairs of a record and a cell.
    pub pairs: u32,
    /// Maximum number of active cells of a tile of samples; 0 if there are no samples.
    pub active: u32,
}

/// Capacity that a tile requires of the buffers, as in [`CellCapacity`]. The number of pairs is 0 if the other numbers
/// exceeded the capacity: then pairs weren't counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct CellNeeds {
    records: u64,
    bin_pairs: u64,
    pairs: u64,
    active: u64,
}

impl CellNeeds {
    /// Returns the required capacity of a tile, from the words of its counters.
    fn of_one(counters: &[u32]) -> Self {
        use layout::cell_counters::{ACTIVE_CELLS, BIN_PAIRS, PAIRS, RECORDS};
        let [records, bin_pairs, pairs, active] = [RECORDS, BIN_PAIRS, PAIRS, ACTIVE_CELLS]
            .map(|offset| counters.get(offset / 4).copied().map_or(0, u64::from));
        Self { records, bin_pairs, pairs, active }
    }

    /// Returns the largest required capacity of all tiles, from the words of [`CellBuffer::Counters`].
    fn of(counters: &[u32]) -> Self {
        of_tiles(counters).fold(Self::default(), Self::max)
    }

    /// Returns the larger of each two numbers.
    fn max(self, other: Self) -> Self {
        Self {
            records: self.records.max(other.records),
            bin_pairs: self.bin_pairs.max(other.bin_pairs),
            pairs: self.pairs.max(other.pairs),
            active: self.active.max(other.active),
        }
    }

    /// Returns the needs that a capacity just meets.
    fn of_room(room: CellCapacity) -> Self {
        Self {
            records: room.records.into(),
            bin_pairs: room.bin_pairs.into(),
            pairs: room.pairs.into(),
            active: room.active.into(),
        }
    }
}

/// True if a flag of the counters, given by its offset in bytes, is set in any tile. `counters` are the words of
/// [`CellBuffer::Counters`].
fn is_set_in_any(flag: usize, counters: &[u32]) -> bool {
    let mut tiles = counters.chunks_exact(layout::cell_counters::SIZE / 4);
    tiles.any(|words| words.get(flag / 4).is_some_and(|&word| word != 0))
}

/// True if a cell of samples has more pairs than the compute path draws. `counters` are the words of
/// [`CellBuffer::Counters`].
fn is_crowded(counters: &[u32]) -> bool {
    is_set_in_any(layout::cell_counters::IS_CROWDED, counters)
}

/// Returns an iterator over the required capacities of a tile of pixels and of the tiles of its samples, from the words
/// of [`CellBuffer::Counters`].
fn of_tiles(counters: &[u32]) -> impl Iterator<Item = CellNeeds> {
    counters.chunks_exact(layout::cell_counters::SIZE / 4).map(CellNeeds::of_one)
}

/// Largest number of active cells of samples for which buffers are sized before a tile is first drawn. Buffers grow if
/// a tile has more.
const FIRST_ACTIVE: u32 = 1 << 14;

/// Same as [`FIRST_ACTIVE`] with transparent layers, where an active cell takes 13 KiB.
const FIRST_LAYERED_ACTIVE: u32 = 1 << 12;

impl CellCapacity {
    /// Estimates the capacity for a tile and its samples, whose counts are `all`, before the first frame. Records are
    /// estimated as 3/5 of the splats in visible chunks, but as all of up to 2¹⁸ splats. Bin pairs are estimated as 5/4
    /// per record plus 64 per bin. Pairs are estimated as two per record plus four per cell or, in a tile of samples,
    /// per active cell. `None` if the buffers would exceed the limits.
    fn estimate(all: &[CellCounts], limits: Limits) -> Option<Self> {
        let of_one = |cells: &CellCounts| {
            let splats = cells.splats + u64::from(cells.near);
            let records = splats.min(1 << 18).max(splats * 3 / 5);
            let first = if cells.has_layered_samples { FIRST_LAYERED_ACTIVE } else { FIRST_ACTIVE };
            let active = if cells.is_of_samples { u64::from(cells.cells().min(first)) } else { 0 };
            let drawn_cells = if cells.is_of_samples { active } else { u64::from(cells.cells()) };
            let most = |count: u64| count.min(u32::MAX.into());
            let bin_pairs = most(records + records / 4 + 64 * u64::from(cells.bins()));
            CellNeeds { records: records.max(1), bin_pairs, pairs: most(2 * records + 4 * drawn_cells), active }
        };
        let needs = all.iter().map(of_one).fold(CellNeeds::default(), CellNeeds::max);
        Self::within(needs, all, limits)
    }

    /// Returns the capacity with which a tile and its samples are first drawn. It is `before`, the capacity of an
    /// earlier tile, if that is within the limits, and an estimate otherwise. `None` if the estimate exceeds the
    /// limits, too.
    pub(crate) fn start(before: Option<Self>, all: &[CellCounts], limits: Limits) -> Option<Self> {
        let estimate = Self::estimate(all, limits);
        let kept = before.and_then(|room| {
            let active = room.active.max(estimate.map_or(0, |room| room.active));
            Self::within(CellNeeds::of_room(Self { active, ..room }), all, limits)
        });
        kept.or(estimate)
    }

    /// True if transparent fragments remain behind the layers of an A-buffer that were drawn, in a tile or its samples.
    /// They have to be drawn again with more layers ([`crate::with_more_layers`]). `counters` are the words of
    /// [`CellBuffer::Counters`].
    pub fn lacks_layers(plan: &FramePlan, counters: &[u32]) -> bool {
        plan.has(Pass::ABuffer) && is_set_in_any(layout::cell_counters::LAYERS_REMAIN, counters)
    }

    /// Adds the numbers of records, pairs and layers that were drawn to the statistics. `counters` are the words of
    /// [`CellBuffer::Counters`]. Records of samples don't count, because their splats were counted with the tile of
    /// pixels.
    pub fn count(counters: &[u32], stats: &mut Stats) {
        let layers = counters.get(layout::cell_counters::LAYERS / 4).copied().unwrap_or(0);
        if layers > 0 {
            raise_counter(LAYERS_DRAWN, layers.into(), stats);
        }
        let mut tiles = of_tiles(counters);
        let pixels = tiles.next().unwrap_or_default();
        stats.drawn += pixels.records;
        add_counter(CELL_PAIRS, pixels.pairs as f64, stats);
        for samples in tiles {
            let [cells, pairs] = OF_SAMPLES;
            add_counter(cells, samples.active as f64, stats);
            add_counter(pairs, samples.pairs as f64, stats);
        }
    }

    /// True if a tile and its samples fit the capacity, and no cell of samples has more pairs than the compute path
    /// draws. `counters` are the words of [`CellBuffer::Counters`]. If a tile doesn't fit, it has to be drawn again.
    pub fn holds(self, counters: &[u32]) -> bool {
        let (own, needs) = (CellNeeds::of_room(self), CellNeeds::of(counters));
        !is_crowded(counters) && own.max(needs) == own
    }

    /// Returns the capacity that a tile and its samples need, with a margin of a quarter if the limits permit.
    /// `counters` are the words of [`CellBuffer::Counters`]. `None` if the capacity exceeds the limits, or if a cell of
    /// samples has too many pairs for the compute path.
    pub(crate) fn grown(self, counters: &[u32], all: &[CellCounts], limits: Limits) -> Option<Self> {
        if is_crowded(counters) {
            return None;
        }
        let needs = CellNeeds::of(counters);
        let more = |count: u64| count + count / 4;
        let ample = CellNeeds {
            records: more(needs.records),
            bin_pairs: more(needs.bin_pairs),
            pairs: more(needs.pairs),
            active: more(needs.active),
        };
        let ample = ample.max(CellNeeds::of_room(self));
        // Pairs that weren't counted need at least the room that they had.
        let least = CellNeeds { pairs: if needs.pairs == 0 { self.pairs.into() } else { needs.pairs }, ..needs };
        Self::within(ample, all, limits).or_else(|| Self::within(least, all, limits))
    }

    /// Returns the capacity for the given needs; `None` if the buffers would exceed the limits. Active cells are
    /// limited to the number of cells.
    fn within(needs: CellNeeds, all: &[CellCounts], limits: Limits) -> Option<Self> {
        let of_samples = all.iter().filter(|cells| cells.is_of_samples);
        let active = needs.active.min(of_samples.map(|cells| u64::from(cells.cells())).max().unwrap_or(0));
        let [records, bin_pairs, pairs] = [needs.records, needs.bin_pairs, needs.pairs].map(u32::try_from);
        let room =
            Self { records: records.ok()?, bin_pairs: bin_pairs.ok()?, pairs: pairs.ok()?, active: active as u32 };
        let most = limits.buffer_bytes.min(limits.cell_bytes);
        let bytes = |cells: &CellCounts| {
            let of_samples = 4 * room.sample_floats(cells);
            let of_lists = room.list_bytes(cells).max(4 * room.list_counts(cells)).max(room.bin_pair_bytes());
            of_lists.max(cells.group_bytes()).max(room.record_bytes(cells)).max(room.part_bytes(cells)).max(of_samples)
        };
        let is_within = all.iter().map(bytes).max().unwrap_or(0) <= most;
        let floats_fit = 4 * room.all_floats(all) <= limits.buffer_bytes.min(u32::MAX.into());
        (is_within && floats_fit).then_some(room)
    }

    /// Returns the size of the buffer of records for a tile, in bytes.
    fn record_bytes(self, cells: &CellCounts) -> u64 {
        // Parts are stored one after another, so a part that no pass writes has room before later parts.
        let parts = match (cells.has_clips, cells.has_places) {
            (true, _) => layout::CLIP_PART + 2 * layout::CLIP_PARTS,
            (false, true) => layout::RECORD_PLACE + 1,
            (false, false) => layout::RECORD_PARTS,
        };
        16 * u64::from(parts) * u64::from(self.records)
    }

    /// Returns the maximum number of parts into which all dense cells of a tile together are split; 0 if there are too
    /// few pairs for any dense cell.
    pub(crate) fn parts(self) -> u64 {
        let is_any_dense = self.pairs > layout::DENSE_PAIRS;
        if is_any_dense { 2 * u64::from(self.pairs).div_ceil(u64::from(layout::PART_PAIRS)) } else { 0 }
    }

    /// Returns the number of floats of the samples of a tile of samples with transparent layers; 0 for other tiles.
    fn sample_floats(self, cells: &CellCounts) -> u64 {
        let of_cell = if cells.has_layered_samples { layout::SAMPLE_WORDS * layout::CELL_WORKGROUP } else { 0 };
        u64::from(of_cell) * u64::from(self.active)
    }

    /// Returns the number of floats of the planes of a tile of pixels and, if samples have transparent layers, of the
    /// samples after them. `all` are the counts of the tile and of the tiles of its samples.
    pub(crate) fn all_floats(self, all: &[CellCounts]) -> u64 {
        all.iter().map(|cells| u64::from(cells.plane_floats) + self.sample_floats(cells)).max().unwrap_or(0)
    }

    /// Returns the size of the buffer of parts of dense cells of a tile, in bytes.
    fn part_bytes(self, cells: &CellCounts) -> u64 {
        let words = if cells.has_sides { layout::SIDED_PART_WORDS } else { layout::PART_WORDS };
        4 * u64::from(words * layout::CELL_WORKGROUP) * self.parts()
    }

    /// Returns the size of the buffer of bin pairs, in bytes. A pair has two words.
    fn bin_pair_bytes(self) -> u64 {
        8 * u64::from(self.bin_pairs)
    }

    /// Returns the size of the buffer of lists for a tile, in bytes, header included.
    fn list_bytes(self, cells: &CellCounts) -> u64 {
        4 * (u64::from(cells.header(self)) + u64::from(self.pairs))
    }

    /// Returns the maximum number of blocks into which the records of all bins of a tile are divided.
    pub(crate) fn bin_blocks(self, cells: &CellCounts) -> u64 {
        u64::from(self.bin_pairs).div_ceil(layout::CELL_WORKGROUP.into()) + u64::from(cells.bins())
    }

    /// Returns the maximum number of counts from which the lists of a tile are made: one per cell of a bin and block of
    /// its records.
    fn list_counts(self, cells: &CellCounts) -> u64 {
        u64::from(layout::CELL_WORKGROUP) * self.bin_blocks(cells)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::passes::cell_stages::is_cell_entry;
    use surfel_model::{Accumulate, Camera, ClipPolicy, EdgeAa, Projection, Settings, Shader};
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
        let splats = 256 * u64::from(chunks.iter().sum::<u32>());
        CellCounts { size: [5, 3], chunks: chunks.to_vec(), splats, near, ..CellCounts::default() }
    }

    #[test]
    fn compute_shaders_draw_splats_and_nothing_else() {
        let plain = SceneSummary::default();
        for shader in [Shader::Unlit, Shader::Phong, Shader::Normal, Shader::Toon, Shader::Edl, Shader::Matcap] {
            let plan = planned(&plain, Planes::ALL.with_fragments(true), |s| s.shader = shader);
            let drawn = [GpuPath::Auto, GpuPath::Compute, GpuPath::Raster].map(|path| path.draws_cells(&plan));
            assert_eq!(drawn, [true, true, false], "{shader:?}");
            for edge_aa in [EdgeAa::Coverage, EdgeAa::Samples] {
                let plan = planned(&plain, Planes::ALL, |s| (s.shader, s.edge_aa) = (shader, edge_aa));
                assert!(GpuPath::Auto.draws_cells(&plan), "{shader:?} {edge_aa:?}");
            }
        }
        let with = |change: fn(&mut SceneSummary)| {
            let mut summary = SceneSummary::default();
            change(&mut summary);
            summary
        };
        let others = [
            planned(&with(|s| s.meshes = true), Planes::COLOR, |_| ()),
            planned(&with(|s| s.gaussians = Some(GaussianColors::Linear)), Planes::COLOR, |_| ()),
        ];
        for (i, plan) in others.iter().enumerate() {
            assert!(!GpuPath::Compute.draws_cells(plan), "{i}");
        }
        for transparency in ["peel:1", "peel:3", "peel:3:drop", "abuffer:4"] {
            for edge_aa in [EdgeAa::Off, EdgeAa::Coverage, EdgeAa::Samples] {
                let plan = planned(&with(|s| s.transparent = true), Planes::ALL.with_index(true), |s| {
                    (s.transparency, s.edge_aa) = (transparency.parse().unwrap(), edge_aa);
                });
                assert!(GpuPath::Auto.draws_cells(&plan), "{transparency} {edge_aa:?}");
            }
        }
        // Sums are in f32 whatever the settings permit.
        assert!(GpuPath::Auto.draws_cells(&planned(&plain, Planes::COLOR, |s| s.accumulate = Accumulate::F16)));
        assert!(GpuPath::Auto.draws_cells(&planned(&plain, Planes::ALL.with_index(true), |_| ())));
        for clip in [ClipPolicy::Exact, ClipPolicy::Line, ClipPolicy::Off] {
            assert!(GpuPath::Auto.draws_cells(&planned(&with(|s| s.clips = true), Planes::ALL, |s| s.clip = clip)));
        }
        // With transparency disabled, all splats are opaque.
        let off = planned(&with(|s| (s.clips, s.transparent) = (true, true)), Planes::COLOR, |s| {
            s.clip = ClipPolicy::Off;
            s.transparency = "off".parse().unwrap();
        });
        assert!(GpuPath::Auto.draws_cells(&off));
    }

    #[test]
    fn passes_bind_what_every_device_has() {
        for entry in ENTRIES.iter().filter(|entry| is_cell_entry(entry.name)) {
            let storage = |kind| matches!(kind, BindingKind::StorageRead | BindingKind::StorageWrite);
            let buffers = entry.bindings.iter().filter(|binding| storage(binding.kind)).count();
            assert!(buffers <= 8, "{} binds {buffers} storage buffers", entry.name);
            let invocations: u32 = entry.workgroup.iter().product();
            assert!(invocations <= 256, "{}", entry.name);
            for binding in entry.bindings.iter().filter(|binding| binding.group == 1) {
                for round in CellRound::ALL {
                    assert!(CellBinding::of(binding.binding, round).is_some(), "{} {binding:?}", entry.name);
                }
            }
        }
    }

    #[test]
    fn a_workgroup_has_an_invocation_for_each_bin() {
        assert_eq!(bins_of(CellCounts::size_of([MAX_CELL_TILE; 2])), MAX_BINS);
        for (size, bins) in [([1, 1], 1), ([16, 16], 1), ([17, 16], 2), ([120, 68], 40), ([256, 256], 256)] {
            let counts = CellCounts { size, ..CellCounts::default() };
            let room = CellCapacity { records: 1, bin_pairs: 257, pairs: 1, active: 7 };
            assert_eq!((counts.bins(), room.bin_blocks(&counts)), (bins, 2 + u64::from(bins)));
            // Two words for every cell of the bins, or three for every active cell of samples.
            assert_eq!(counts.header(room), 512 * bins);
            assert_eq!(CellCounts { is_of_samples: true, ..counts }.header(room), 21);
        }
    }

    #[test]
    fn room_grows_to_what_is_needed_or_is_refused() {
        let (counts, all) = ([cells(&[4], 3)], Limits::default());
        let room = CellCapacity::start(None, &counts, all).unwrap();
        assert_eq!((room.records, room.active), (4 * 256 + 3, 0));
        let counters = |records, pairs: u32, active| {
            let mut words = vec![0; layout::cell_counters::SIZE / 4];
            words[layout::cell_counters::RECORDS / 4] = records;
            words[layout::cell_counters::BIN_PAIRS / 4] = pairs / 2;
            words[layout::cell_counters::PAIRS / 4] = pairs;
            words[layout::cell_counters::ACTIVE_CELLS / 4] = active;
            words
        };
        assert!(room.holds(&counters(room.records, room.pairs, 0)) && !room.holds(&counters(room.records + 1, 0, 0)));
        let needed = counters(room.records, 40_000_000, 0);
        assert!(!room.holds(&needed));
        let grown = room.grown(&needed, &counts, all).unwrap();
        assert!(grown.holds(&needed) && grown.records >= room.records);
        // The capacity of the tile before is used while it is within the limits.
        assert_eq!(CellCapacity::start(Some(grown), &counts, all), Some(grown));
        let little = Limits { cell_bytes: 1 << 20, ..all };
        assert_eq!(CellCapacity::start(Some(grown), &counts, little), Some(room));
        assert_eq!(room.grown(&needed, &counts, little), None);
        assert_eq!(CellCapacity::start(None, &counts, Limits { cell_bytes: 1000, ..all }), None);
        // The count of pairs overflows.
        assert_eq!(room.grown(&counters(1, u32::MAX, 0), &counts, all), None);
        for buffer in CellBuffer::ALL {
            let [less, more] = [room, grown].map(|room| buffer.bytes(&counts, room));
            assert!(less <= more, "{buffer:?}");
        }
        // Samples need room for active cells: at first for some, later for as many as there are.
        let samples = CellCounts { size: [256, 200], is_of_samples: true, ..cells(&[4], 3) };
        let counts = [cells(&[4], 3), samples];
        let room = CellCapacity::start(Some(grown), &counts, all).unwrap();
        assert_eq!(room, CellCapacity { active: FIRST_ACTIVE, ..grown });
        let needed = [counters(5, 6, 0), counters(7, 8, FIRST_ACTIVE + 1)].concat();
        assert!(!room.holds(&needed));
        let more = room.grown(&needed, &counts, all).unwrap();
        assert!(more.holds(&needed) && more.active <= 256 * 200);
        let mut stats = Stats::default();
        CellCapacity::count(&needed, &mut stats);
        let [active, pairs] = [("sample_cells", f64::from(FIRST_ACTIVE + 1)), ("sample_pairs", 8.0)];
        assert_eq!((stats.drawn, stats.counters), (5, vec![(CELL_PAIRS, 6.0), active, pairs]));
    }

    #[test]
    fn layers_of_samples_are_stored_within_the_limits() {
        let samples = CellCounts { size: [256, 200], is_of_samples: true, plane_floats: 1000, ..cells(&[4], 3) };
        let layered = CellCounts { has_layered_samples: true, ..samples.clone() };
        let room = CellCapacity::start(None, std::slice::from_ref(&layered), Limits::default()).unwrap();
        // 13 words for each of 256 samples of an active cell.
        assert_eq!(room.active, FIRST_LAYERED_ACTIVE);
        assert_eq!(room.all_floats(std::slice::from_ref(&layered)), 1000 + 13 * 256 * u64::from(FIRST_LAYERED_ACTIVE));
        assert_eq!(room.all_floats(&[samples]), 1000);
        let bytes = 4 * 13 * 256 * u64::from(FIRST_LAYERED_ACTIVE);
        for (cell_bytes, is_within) in [(bytes, true), (bytes - 1, false)] {
            let limits = Limits { cell_bytes, ..Limits::default() };
            assert_eq!(CellCapacity::start(None, std::slice::from_ref(&layered), limits).is_some(), is_within);
        }
        let limits = Limits { buffer_bytes: bytes, ..Limits::default() };
        assert_eq!(CellCapacity::start(None, std::slice::from_ref(&layered), limits), None);
        // Layers that remain behind those of samples are drawn, too.
        let glass = SceneSummary { transparent: true, ..SceneSummary::default() };
        let plan = planned(&glass, Planes::COLOR, |s| s.transparency = "abuffer:4".parse().unwrap());
        let mut counters = vec![0; 2 * layout::cell_counters::SIZE / 4];
        assert!(!CellCapacity::lacks_layers(&plan, &counters));
        counters[(layout::cell_counters::SIZE + layout::cell_counters::LAYERS_REMAIN) / 4] = 1;
        assert!(CellCapacity::lacks_layers(&plan, &counters));
    }
}

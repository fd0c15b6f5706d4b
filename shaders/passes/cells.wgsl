// The compute path: draws splats without raster hardware. The targets are cut into cells of 16×16 pixels.
//
// Setup writes the records of the splats that are drawn, without gaps. Each cell gets a list of the records that may
// touch it (cell_lists.wgsl), and one workgroup draws each cell (cell_raster.wgsl). Lists are in the order of splats.
// So a pixel's sums are added in one order, whatever the device does in parallel.
//
// No pass sorts by depth: the visibility loop finds a minimum of depths, and attributes are sums.
//
// Samples of edge pixels are drawn by the same passes, as pixels of a view four times as fine (cell_samples.wgsl). Few
// cells of that view contain a sampled pixel. Only these active cells are numbered, and only they have lists.

// Side of a cell in pixels.
const CELL_SIDE: u32 = 16u;
// Side of a bin in cells. A bin is a square of cells whose lists are written together (cell_lists.wgsl).
const BIN_SIDE: u32 = 16u;
// Number of invocations of each workgroup of the passes in this file. It is also the largest number of splats of a
// chunk and of bins of a tile, and the number of cells of a bin.
const CELL_WORKGROUP: u32 = 256u;
// Workgroups in a row of a dispatch: a device allows at most 65535 along an axis.
const CELL_ROW: u32 = 32768u;
// Number of elements that a workgroup scans or sorts.
const CELL_BLOCK: u32 = 2048u;
// Size of a record in parts of type vec4u. RECORD_PLACE is the number of the part that follows if the plane of nearest
// splats is requested, or if the last layer is lit splat by splat. Its first word is the splat's group times
// CELL_WORKGROUP, plus the splat's index in the group. The others are the view position of the splat's centre, which
// `cell_light` replaces by the colour of the lit splat.
const RECORD_PARTS: u32 = 9u;
const RECORD_PLACE: u32 = 9u;
// Number of the part of a record at which its clips begin in a frame with clipped splats, and number of parts of a
// clip. The clip of the unfiltered footprint precedes that of the filtered one.
const CLIP_PART: u32 = 10u;
const CLIP_PARTS: u32 = 6u;
// Number of words that `cell_groups` stores for each group, the records of one workgroup of setup, after the numbers of
// bin pairs: the index of the group's first record, and its number of records.
const GROUP_WORDS: u32 = 2u;

// Values of CellRound.scanned, the numbers whose prefix sums a scan computes: numbers of bin pairs per bin and group, a
// number per cell that is 1 if the cell is active, or numbers of pairs per cell and block of its bin's records.
const SCANNED_GROUPS: u32 = 0u;
const SCANNED_ACTIVE: u32 = 1u;
const SCANNED_LISTS: u32 = 2u;

// A chunk that may touch the tile. One workgroup sets up its splats, and their records form a group. If the application
// places the splats, several workgroups divide the chunk, and each has its own group.
struct CellChunk {
    // View position of the chunk's origin.
    center: vec3f,
    // CHUNK_ORDINARY, or the index in `near_bits` of the first word with the bits of the chunk's splats.
    state: u32,
    // Index in the segment of the chunk's first splat, and number of its splats.
    first: u32,
    count: u32,
    // Index of the chunk among the segment's chunks, and of its first group among all groups.
    chunk: u32,
    group: u32,
}

// Counts of a tile, or of a frame of samples, which the host reads back.
struct CellCounters {
    // Number of records that the tile needs: one for each splat that was set up and may touch a cell.
    records: atomic<u32>,
    // Number of bin pairs, of a record and a bin that it may touch, saturated at the largest u32.
    bin_pairs: atomic<u32>,
    // Number of pairs of a record and a cell, which is the length of all lists. It is saturated at the largest u32, and
    // 0 if records or bin pairs exceed their buffers.
    pairs: atomic<u32>,
    // Number of active cells of a tile of samples.
    active_cells: atomic<u32>,
    // 1 if an active cell has more than CROWDED_PAIRS pairs.
    is_crowded: atomic<u32>,
    // Largest number of layers of transparent splats that a cell draws, and 1 if fragments remain behind the layers of
    // any cell.
    layers: atomic<u32>,
    layers_remain: atomic<u32>,
}

// CellCounters for passes that only read them.
struct CellCounts {
    records: u32,
    bin_pairs: u32,
    pairs: u32,
    active_cells: u32,
    is_crowded: u32,
    layers: u32,
    layers_remain: u32,
}

// A bin's elements of `bin_records`: the index of the first, and one past that of the last. They are divided into
// blocks of up to CELL_WORKGROUP records, which are numbered through all bins; `block` is the number of the first.
struct CellBin {
    first: u32,
    end: u32,
    block: u32,
}

// Parameter of a scan: the kind of numbers to scan, SCANNED_….
struct CellRound {
    scanned: u32,
}

// Records of all splats, part by part (see `part_at`).
@group(1) @binding(40) var<storage, read_write> cell_records_out: array<vec4u>;
// One word per bin and group, bin by bin: the number of the group's bin pairs and, after a scan, the index in
// `bin_records` of the first of them. GROUP_WORDS words per group follow (see `group_at`).
@group(1) @binding(41) var<storage, read_write> cell_groups: array<u32>;
// Counts of the tile of pixels, then of the frames of its samples.
@group(1) @binding(42) var<storage, read_write> cell_counters: array<CellCounters>;
// Chunks of the segment that may touch the tile.
@group(1) @binding(43) var<storage, read> cell_chunks: array<CellChunk>;
// Records of splats that reach the near plane, which the host has set up, one after another: the parts of a record, the
// part RECORD_PLACE included, and in a frame with clipped splats the two clips.
@group(1) @binding(44) var<storage, read> near_records: array<vec4u>;
@group(1) @binding(45) var<uniform> cell_round: CellRound;
// Numbers to scan. Those of lists are stored bin by bin, for each bin cell by cell, and for each cell block by block.
@group(1) @binding(46) var<storage, read_write> scanned: array<u32>;
// Sum of each block of `scanned`.
@group(1) @binding(47) var<storage, read_write> scan_sums: array<u32>;
// The buffers `cell_records_out` and `cell_counters`, for passes that only read them.
@group(1) @binding(52) var<storage, read> cell_records: array<vec4u>;
@group(1) @binding(53) var<storage, read> cell_counts: array<CellCounts>;
// Number of active cells before each cell of the grid, row by row, and then that of all. The summed-area table of
// active cells follows: for each row r up to the number of rows, and each column c up to the number of columns, the
// number of active cells in rows before r and columns before c. Only read in frames of samples.
@group(1) @binding(56) var<storage, read> cell_active: array<u32>;
// The bin pairs, bin by bin, and within a bin in the order of splats: for each, the cells of the bin that the record
// may touch (`packed_cells`). After `frame.cell_bin_pair_room` words, the index of each record follows.
@group(1) @binding(58) var<storage, read_write> bin_records_out: array<u32>;
@group(1) @binding(59) var<storage, read> bin_records: array<u32>;
// Bins of the tile, at most CELL_WORKGROUP, and an element that begins after the last of them.
@group(1) @binding(60) var<storage, read_write> cell_bins_out: array<CellBin>;
@group(1) @binding(61) var<storage, read> cell_bins: array<CellBin>;
// Lists of cells: a header of `frame.cell_header` words, then the indices of records. The header has two words per
// cell: the index of the first word of the cell's list, and one past that of the last. Cells are counted as by
// `cell_number`. In a frame of samples the header has these words for active cells alone. One word per active cell
// follows: its `cell_number` plus 1, or 0 if the element is unused.
@group(1) @binding(62) var<storage, read_write> cell_lists_out: array<u32>;
@group(1) @binding(63) var<storage, read> cell_lists: array<u32>;

// Sum of the values of all invocations up to each one, its own included.
var<workgroup> scan_partial: array<u32, CELL_WORKGROUP>;

// Returns a + b, or the largest u32 if the sum is larger. No buffer has room for so many pairs.
fn saturating_sum(a: u32, b: u32) -> u32 {
    let sum = a + b;
    return select(sum, 0xffffffffu, sum < a);
}

// Returns the sum of the values of all invocations of the workgroup before this one, number i. All invocations of the
// workgroup have to call it. After a barrier, `scan_partial[CELL_WORKGROUP - 1u]` is the sum of all values.
fn workgroup_scan(i: u32, value: u32) -> u32 {
    scan_partial[i] = value;
    workgroupBarrier();
    for (var reach = 1u; reach < CELL_WORKGROUP; reach *= 2u) {
        var sum = scan_partial[i];
        if i >= reach {
            sum = saturating_sum(sum, scan_partial[i - reach]);
        }
        workgroupBarrier();
        scan_partial[i] = sum;
        workgroupBarrier();
    }
    if i == 0u {
        return 0u;
    }
    return scan_partial[i - 1u];
}

// Returns the index of part k of a record in `cell_records`. Records are stored part by part, so that neighbouring
// invocations that access neighbouring records share memory transactions.
fn part_at(k: u32, record: u32) -> u32 {
    return k * frame.cell_record_room + record;
}

// Returns the number of a workgroup in its dispatch, whose rows have CELL_ROW workgroups.
fn workgroup_number(group: vec3u) -> u32 {
    return group.y * CELL_ROW + group.x;
}

// Returns the number of bin pairs to sort. It is 0 if records, bin pairs or active cells exceed their buffers: the host
// then draws the tile again.
fn fitting_bin_pairs(counts: CellCounts) -> u32 {
    let fits = counts.records <= frame.cell_record_room && counts.bin_pairs <= frame.cell_bin_pair_room
        && counts.active_cells <= frame.cell_active_room;
    return select(0u, counts.bin_pairs, fits);
}

// Returns the number of pairs to draw. It is 0 if anything exceeds its buffer.
fn fitting_pairs(counts: CellCounts) -> u32 {
    return select(0u, counts.pairs, fitting_bin_pairs(counts) > 0u && counts.pairs <= frame.cell_pair_room);
}

// Returns the counts of this frame, for passes that also write them.
fn counted() -> CellCounts {
    let part = frame.cell_part;
    return CellCounts(
        atomicLoad(&cell_counters[part].records),
        atomicLoad(&cell_counters[part].bin_pairs),
        atomicLoad(&cell_counters[part].pairs),
        atomicLoad(&cell_counters[part].active_cells),
        0u,
        0u,
        0u,
    );
}

// Returns the number of columns of bins.
fn bin_columns() -> u32 {
    return (frame.cell_columns + (BIN_SIDE - 1u)) / BIN_SIDE;
}

// Returns the number of bins.
fn bin_count() -> u32 {
    let rows = frame.cell_count / frame.cell_columns;
    return bin_columns() * ((rows + (BIN_SIDE - 1u)) / BIN_SIDE);
}

// Returns the number of a cell (column, row). Cells are numbered bin by bin, and row by row in a bin. Bins are numbered
// row by row.
fn cell_number(cell: vec2u) -> u32 {
    let bin = (cell.y / BIN_SIDE) * bin_columns() + cell.x / BIN_SIDE;
    return bin * CELL_WORKGROUP + (cell.y % BIN_SIDE) * BIN_SIDE + cell.x % BIN_SIDE;
}

// Returns the cell (column, row) with this number.
fn numbered_cell(number: u32) -> vec2u {
    let bin = number / CELL_WORKGROUP;
    let in_bin = number % CELL_WORKGROUP;
    let corner = vec2u(bin % bin_columns(), bin / bin_columns()) * BIN_SIDE;
    return corner + vec2u(in_bin % BIN_SIDE, in_bin / BIN_SIDE);
}

// Starts a tile: clears its counts and the header of its lists.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_begin(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    let word = workgroup_number(group) * CELL_WORKGROUP + i;
    if word == 0u {
        atomicStore(&cell_counters[frame.cell_part].records, 0u);
        atomicStore(&cell_counters[frame.cell_part].bin_pairs, 0u);
        atomicStore(&cell_counters[frame.cell_part].pairs, 0u);
        atomicStore(&cell_counters[frame.cell_part].active_cells, 0u);
        atomicStore(&cell_counters[frame.cell_part].is_crowded, 0u);
        atomicStore(&cell_counters[frame.cell_part].layers, 0u);
        atomicStore(&cell_counters[frame.cell_part].layers_remain, 0u);
    }
    if word < frame.cell_header {
        cell_lists_out[word] = 0u;
    }
}

// Returns the cells that a record's footprints may touch: first column and row, then numbers of columns and rows.
// `boxes` are the record's visible_box and filtered_box, of which at most one is empty.
fn cells_of(boxes: vec4u) -> vec4u {
    let empty = vec2<bool>(boxes.y == 0u, boxes.w == 0u);
    let first = vec4u(boxes.x & 0xffffu, boxes.x >> 16u, boxes.z & 0xffffu, boxes.z >> 16u);
    let end = vec4u(boxes.y & 0xffffu, boxes.y >> 16u, boxes.w & 0xffffu, boxes.w >> 16u);
    var least = min(first.xy, first.zw);
    var most = max(end.xy, end.zw);
    if empty.x {
        least = first.zw;
        most = end.zw;
    }
    if empty.y {
        least = first.xy;
        most = end.xy;
    }
    let from_cell = least / CELL_SIDE;
    return vec4u(from_cell, (most + (CELL_SIDE - 1u)) / CELL_SIDE - from_cell);
}

// Returns the index of an element of the summed-area table of active cells.
fn active_area_at(row: u32, column: u32) -> u32 {
    return frame.cell_count + 1u + row * (frame.cell_columns + 1u) + column;
}

// True if a record with these cells, as `cells_of` returns them, touches an active cell.
fn touches_active_cell(cells: vec4u) -> bool {
    let end = cells.xy + cells.zw;
    let below = cell_active[active_area_at(end.y, end.x)] - cell_active[active_area_at(end.y, cells.x)];
    return below > cell_active[active_area_at(cells.y, end.x)] - cell_active[active_area_at(cells.y, cells.x)];
}

// Returns the bins that contain these cells: first column and row, then numbers of columns and rows.
fn bins_of(cells: vec4u) -> vec4u {
    let first = cells.xy / BIN_SIDE;
    return vec4u(first, (cells.xy + cells.zw + (BIN_SIDE - 1u)) / BIN_SIDE - first);
}

// Returns the bins of a record with these cells, as `bins_of` does, or none in a frame of samples if the record touches
// no active cell.
fn bins_of_record(cells: vec4u) -> vec4u {
    if frame.is_of_samples != 0u && !touches_active_cell(cells) {
        return vec4u(0u, 0u, 0u, 0u);
    }
    return bins_of(cells);
}

// Returns the index in `cell_groups` of the words of a group after the numbers of bin pairs: the index of the group's
// first record, and its number of records.
fn group_at(group: u32) -> u32 {
    return bin_count() * frame.cell_group_count + GROUP_WORDS * group;
}

// Index of the first record of the workgroup's group.
var<workgroup> group_first_record: u32;
// Number of bin pairs of the workgroup's group, per bin.
var<workgroup> group_pairs: array<atomic<u32>, CELL_WORKGROUP>;

// Writes a group's records without gaps and counts its bin pairs. Invocation i of the workgroup passes one record and
// the view position of its splat's centre. Records without bin pairs are left out. All invocations of the workgroup
// have to call it, with `may_be_there` false if they have no record. Returns the index of the invocation's record, or
// ABSENT if it wasn't written.
fn write_group(group: u32, i: u32, record: Record, center: vec3f, may_be_there: bool) -> u32 {
    atomicStore(&group_pairs[i], 0u);
    let boxes = vec4u(record.visible_box, record.filtered_box);
    var bins = vec4u(0u, 0u, 0u, 0u);
    if may_be_there {
        bins = bins_of_record(cells_of(boxes));
    }
    let is_there = bins.z > 0u;
    let rank = workgroup_scan(i, select(0u, 1u, is_there));
    let live = scan_partial[CELL_WORKGROUP - 1u];
    for (var row = bins.y; row < bins.y + bins.w; row++) {
        for (var column = bins.x; column < bins.x + bins.z; column++) {
            atomicAdd(&group_pairs[row * bin_columns() + column], 1u);
        }
    }
    if i == 0u {
        var first = 0u;
        if live > 0u {
            first = atomicAdd(&cell_counters[frame.cell_part].records, live);
        }
        group_first_record = first;
    }
    workgroupBarrier();
    let first = group_first_record;
    if i < bin_count() {
        cell_groups[i * frame.cell_group_count + group] = atomicLoad(&group_pairs[i]);
    }
    if i == 0u {
        let at = group_at(group);
        cell_groups[at] = first;
        cell_groups[at + 1u] = live;
    }
    if is_there && first + rank < frame.cell_record_room {
        let at = first + rank;
        cell_records_out[part_at(0u, at)] = vec4u(bitcast<vec2u>(record.base), bitcast<vec2u>(record.fraction));
        cell_records_out[part_at(1u, at)] = bitcast<vec4u>(vec4f(record.visible_u, record.visible_v));
        cell_records_out[part_at(2u, at)] = bitcast<vec4u>(vec4f(record.depth, record.scale, record.epsilon));
        cell_records_out[part_at(3u, at)] =
            vec4u(bitcast<vec2u>(record.range), bitcast<u32>(record.weight_scale), record.flags);
        cell_records_out[part_at(4u, at)] = bitcast<vec4u>(vec4f(record.u, record.v));
        cell_records_out[part_at(5u, at)] = bitcast<vec4u>(vec4f(record.w, record.at_anchor));
        cell_records_out[part_at(6u, at)] = bitcast<vec4u>(vec4f(record.color, record.w_at_anchor));
        cell_records_out[part_at(7u, at)] = bitcast<vec4u>(vec4f(record.normal, record.coverage));
        cell_records_out[part_at(8u, at)] = boxes;
        if frame.nearest_at != ABSENT || frame.has_remaining_layer != 0u {
            cell_records_out[part_at(RECORD_PLACE, at)] = vec4u(group * CELL_WORKGROUP + i, bitcast<vec3u>(center));
        }
        return at;
    }
    return ABSENT;
}

// Writes a clip of a record into its parts from number `part` on. The fourth words of the parts are the curve's sign,
// the lines' sign, and the c, x and y of the fourth line.
fn write_clip(record: u32, part: u32, clip: Clip) {
    let lines = clip.lines;
    cell_records_out[part_at(part, record)] =
        bitcast<vec4u>(vec4f(clip.chord.c, clip.chord.x, clip.chord.y, clip.curve_sign));
    cell_records_out[part_at(part + 1u, record)] =
        bitcast<vec4u>(vec4f(clip.side1.c, clip.side1.x, clip.side1.y, clip.line_sign));
    cell_records_out[part_at(part + 2u, record)] =
        bitcast<vec4u>(vec4f(clip.side3.c, clip.side3.x, clip.side3.y, lines[3].c));
    cell_records_out[part_at(part + 3u, record)] =
        bitcast<vec4u>(vec4f(lines[0].c, lines[0].x, lines[0].y, lines[3].x));
    cell_records_out[part_at(part + 4u, record)] =
        bitcast<vec4u>(vec4f(lines[1].c, lines[1].x, lines[1].y, lines[3].y));
    cell_records_out[part_at(part + 5u, record)] = bitcast<vec4u>(vec4f(lines[2].c, lines[2].x, lines[2].y, 0.0));
}

// Returns the number of workgroups that set up `count` splats.
fn setup_workgroups(count: u32) -> u32 {
    return (count + (CELL_WORKGROUP - 1u)) / CELL_WORKGROUP;
}

// The splat of an invocation after setup, and its place.
struct CellSplat {
    splat: SetUpSplat,
    // Index of the splat in its segment.
    own: u32,
    // Group of the splat's record; ABSENT if the workgroup has no chunk.
    group: u32,
}

// Sets up the splat of invocation i of workgroup `number`. A workgroup sets up a chunk or, if the application places
// the splats, up to CELL_WORKGROUP splats of the segment's single chunk.
fn set_up_in_chunk(number: u32, i: u32) -> CellSplat {
    let is_placed = segment.is_placed != 0u;
    let groups = select(arrayLength(&cell_chunks), setup_workgroups(segment.count), is_placed);
    if number >= groups {
        return CellSplat(no_set_up_splat(), 0u, ABSENT);
    }
    var chunk = cell_chunks[select(number, 0u, is_placed)];
    if is_placed {
        // The workgroups divide the single chunk.
        chunk.first = number * CELL_WORKGROUP;
        chunk.count = min(segment.count - chunk.first, CELL_WORKGROUP);
        chunk.group += number;
    }
    let own = chunk.first + i;
    var splat = no_set_up_splat();
    if i < chunk.count {
        let code = stored_word(own * segment.stride);
        if code != SPLAT_HIDDEN && !is_set_up_by_host(code, chunk.state) {
            splat = set_up(own, chunk.chunk, chunk.center);
        }
    }
    return CellSplat(splat, own, chunk.group);
}

// Sets up the splats of a chunk.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_setup(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    let found = set_up_in_chunk(workgroup_number(group), i);
    if found.group == ABSENT {
        return;
    }
    let record = found.splat.record;
    _ = write_group(found.group, i, record, center_of(record), found.splat.is_there);
}

// Sets up the splats of a chunk in a frame with clipped splats, and writes their clips.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_clipped_setup(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    let found = set_up_in_chunk(workgroup_number(group), i);
    if found.group == ABSENT {
        return;
    }
    var record = found.splat.record;
    let is_clipped = segment.clip_at != ABSENT;
    record.flags |= select(0u, RECORD_CLIPPED, is_clipped);
    let at = write_group(found.group, i, record, center_of(record), found.splat.is_there);
    if is_clipped && at != ABSENT {
        let clips = clips_of(found.own, found.splat.footprints);
        write_clip(at, CLIP_PART, clips.visible);
        write_clip(at, CLIP_PART + CLIP_PARTS, clips.filtered);
    }
}

// Returns two words as f32 numbers.
fn near_vec2(bits: vec2u) -> vec2f {
    return bitcast<vec2f>(bits);
}

// Returns the record that begins at element `at` of `near_records`.
fn near_record(at: u32) -> Record {
    return Record(
        bitcast<vec2i>(near_records[at].xy), near_vec2(near_records[at].zw),
        near_vec2(near_records[at + 1u].xy), near_vec2(near_records[at + 1u].zw),
        near_vec2(near_records[at + 2u].xy), bitcast<f32>(near_records[at + 2u].z),
        bitcast<f32>(near_records[at + 2u].w),
        near_vec2(near_records[at + 3u].xy), bitcast<f32>(near_records[at + 3u].z), near_records[at + 3u].w,
        near_vec2(near_records[at + 4u].xy), near_vec2(near_records[at + 4u].zw),
        near_vec2(near_records[at + 5u].xy), near_vec2(near_records[at + 5u].zw),
        bitcast<vec3f>(near_records[at + 6u].xyz), bitcast<f32>(near_records[at + 6u].w),
        bitcast<vec3f>(near_records[at + 7u].xyz), bitcast<f32>(near_records[at + 7u].w),
        near_records[at + 8u].xy, near_records[at + 8u].zw,
    );
}

// Copies a record of a splat that reaches the near plane into its group: the record of invocation i of workgroup
// `number`. The record has `parts` parts. Returns the index of the copy, or ABSENT if there is none.
fn copy_near_record(number: u32, i: u32, parts: u32) -> u32 {
    let index = number * CELL_WORKGROUP + i;
    var record: Record;
    var center = vec3f(0.0, 0.0, 0.0);
    var is_there = index < arrayLength(&near_records) / parts;
    if is_there {
        record = near_record(parts * index);
        center = bitcast<vec3f>(near_records[parts * index + RECORD_PLACE].yzw);
        is_there = record.visible_box.y != 0u || record.filtered_box.y != 0u;
    }
    return write_group(frame.cell_chunk_count + number, i, record, center, is_there);
}

// Copies the records of splats that reach the near plane, which the host has set up, into groups after those of chunks.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_near(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    let number = workgroup_number(group);
    let parts = RECORD_PARTS + 1u;
    if number * CELL_WORKGROUP >= arrayLength(&near_records) / parts {
        return;
    }
    _ = copy_near_record(number, i, parts);
}

// Copies the records of splats that reach the near plane with their clips, in a frame with clipped splats.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_clipped_near(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    let number = workgroup_number(group);
    let parts = CLIP_PART + 2u * CLIP_PARTS;
    if number * CELL_WORKGROUP >= arrayLength(&near_records) / parts {
        return;
    }
    let at = copy_near_record(number, i, parts);
    if at != ABSENT {
        let clips = parts * (number * CELL_WORKGROUP + i) + CLIP_PART;
        for (var k = 0u; k < 2u * CLIP_PARTS; k++) {
            cell_records_out[part_at(CLIP_PART + k, at)] = near_records[clips + k];
        }
    }
}

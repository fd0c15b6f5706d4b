// The compute path: draws splats without raster hardware. The targets are cut into cells of 16×16 pixels.
//
// Setup writes the records of the splats that are drawn, without gaps. Each record and each cell that it may touch
// become a pair. The pairs are sorted by cell, and one workgroup draws each cell (cell_raster.wgsl). The sort is
// stable, and pairs are emitted in the order of splats. So a pixel's sums are added in one order, whatever the device
// does in parallel.
//
// No pass sorts by depth: the visibility loop finds a minimum of depths, and attributes are sums.
//
// Samples of edge pixels are drawn by the same passes, as pixels of a view four times as fine (cell_samples.wgsl). Few
// cells of that view contain a sampled pixel. Only these active cells are numbered, and only they have pairs.

// Side of a cell in pixels.
const CELL_SIDE: u32 = 16u;
// Number of invocations of each workgroup of the passes in this file. It is also the largest number of splats of a
// chunk, and of values of a digit of the sort.
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
// Number of words that `cell_groups` stores for each group, the records of one workgroup of setup, after the counts of
// pairs: the index of the group's first record, and its number of records.
const GROUP_WORDS: u32 = 2u;

// Values of CellRound.scanned, the numbers whose prefix sums a scan computes: counts of pairs per group, counts of
// pairs per digit and block, or a number per cell that is 1 if the cell is active.
const SCANNED_GROUPS: u32 = 0u;
const SCANNED_DIGITS: u32 = 1u;
const SCANNED_ACTIVE: u32 = 2u;

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
    // Number of records that the tile needs: one for each splat that was set up and has a pair.
    records: atomic<u32>,
    // Number of pairs that the records need, saturated at the largest u32.
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
    pairs: u32,
    active_cells: u32,
    is_crowded: u32,
    layers: u32,
    layers_remain: u32,
}

// A record and a cell that it may touch. A buffer of pairs begins with a header of one element per cell, whose fields
// `cell` and `record` store the index of the first of the cell's sorted pairs, and one past that of the last. In a
// frame of samples the header has elements for active cells alone. A second list follows them: per active cell, its
// number in the grid (`cell`), and 1 (`record`) to mark the element as used.
struct CellPair {
    cell: u32,
    record: u32,
}

// Parameters of a pass that runs several times: the kind of numbers to scan, SCANNED_…, and the digit of the cell's
// number to sort by. The digit is the bits from `shift` on; it has `digits` values, a power of two.
struct CellRound {
    scanned: u32,
    shift: u32,
    digits: u32,
}

// Records of all splats, part by part (see `part_at`).
@group(1) @binding(40) var<storage, read_write> cell_records_out: array<vec4u>;
// One word per group: its number of pairs and, after a scan, the index of its first pair, without the header.
// GROUP_WORDS words per group follow: the index of its first record, and its number of records.
@group(1) @binding(41) var<storage, read_write> cell_groups: array<u32>;
// Counts of the tile of pixels, then of the frames of its samples.
@group(1) @binding(42) var<storage, read_write> cell_counters: array<CellCounters>;
// Chunks of the segment that may touch the tile.
@group(1) @binding(43) var<storage, read> cell_chunks: array<CellChunk>;
// Records of splats that reach the near plane, which the host has set up, one after another: the parts of a record, the
// part RECORD_PLACE included, and in a frame with clipped splats the two clips.
@group(1) @binding(44) var<storage, read> near_records: array<vec4u>;
@group(1) @binding(45) var<uniform> cell_round: CellRound;
// Numbers to scan. Counts of digits are stored digit by digit, and for each digit block by block.
@group(1) @binding(46) var<storage, read_write> scanned: array<u32>;
// Sum of each block of `scanned`.
@group(1) @binding(47) var<storage, read_write> scan_sums: array<u32>;
// Pairs that a pass reads and, in the next binding, pairs that it writes: a header, then the pairs.
@group(1) @binding(48) var<storage, read> pairs_in: array<CellPair>;
@group(1) @binding(49) var<storage, read_write> pairs_out: array<CellPair>;
// The buffers `cell_records_out` and `cell_counters`, for passes that only read them.
@group(1) @binding(52) var<storage, read> cell_records: array<vec4u>;
@group(1) @binding(53) var<storage, read> cell_counts: array<CellCounts>;
// Number of active cells before each cell of the grid, row by row, and then that of all. The summed-area table of
// active cells follows: for each row r up to the number of rows, and each column c up to the number of columns, the
// number of active cells in rows before r and columns before c. Only read in frames of samples.
@group(1) @binding(56) var<storage, read> cell_active: array<u32>;

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

// Returns the number of pairs to draw. It is 0 if records, pairs or active cells exceed their buffers: the host then
// draws the tile again.
fn drawn_pairs(counts: CellCounts) -> u32 {
    let fits = counts.records <= frame.cell_record_room && counts.pairs <= frame.cell_pair_room
        && counts.active_cells <= frame.cell_active_room;
    return select(0u, counts.pairs, fits);
}

// Returns the counts of this frame, for passes that also write them.
fn counted() -> CellCounts {
    let part = frame.cell_part;
    return CellCounts(
        atomicLoad(&cell_counters[part].records),
        atomicLoad(&cell_counters[part].pairs),
        atomicLoad(&cell_counters[part].active_cells),
        0u,
        0u,
        0u,
    );
}

// Returns the number of pairs to draw in this frame.
fn pair_count() -> u32 {
    return drawn_pairs(cell_counts[frame.cell_part]);
}

// Starts a tile: clears its counts and the header of its pairs.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_begin(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    let cell = workgroup_number(group) * CELL_WORKGROUP + i;
    if cell == 0u {
        atomicStore(&cell_counters[frame.cell_part].records, 0u);
        atomicStore(&cell_counters[frame.cell_part].pairs, 0u);
        atomicStore(&cell_counters[frame.cell_part].active_cells, 0u);
        atomicStore(&cell_counters[frame.cell_part].is_crowded, 0u);
        atomicStore(&cell_counters[frame.cell_part].layers, 0u);
        atomicStore(&cell_counters[frame.cell_part].layers_remain, 0u);
    }
    if cell < frame.cell_header {
        pairs_out[cell] = CellPair(0u, 0u);
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

// Returns the number of active cells in the first `rows` rows of the cells of a record, as `cells_of` returns them.
fn active_in_rows(cells: vec4u, rows: u32) -> u32 {
    let end = cells.x + cells.z;
    let below = cell_active[active_area_at(cells.y + rows, end)] - cell_active[active_area_at(cells.y + rows, cells.x)];
    return below - (cell_active[active_area_at(cells.y, end)] - cell_active[active_area_at(cells.y, cells.x)]);
}

// Returns the number of pairs of a record with these cells, as `cells_of` returns them: all cells, or the active ones
// in a frame of samples.
fn pairs_of_cells(cells: vec4u) -> u32 {
    if frame.is_of_samples == 0u {
        return cells.z * cells.w;
    }
    return active_in_rows(cells, cells.w);
}

// Returns `rows` plus `step` if the k-th active cell of a record lies behind so many rows, else `rows`.
fn rows_before(cells: vec4u, k: u32, rows: u32, step: u32) -> u32 {
    // All rows together have more than k active cells.
    let next = min(rows + step, cells.w);
    return select(rows, next, active_in_rows(cells, next) <= k);
}

// Returns the number of the k-th cell, from 0, that has a pair with a record with these cells. In a frame of samples it
// is the number among active cells; those of a row have consecutive numbers.
fn nth_cell(cells: vec4u, k: u32) -> u32 {
    if frame.is_of_samples == 0u {
        return (cells.y + k / cells.z) * frame.cell_columns + cells.x + k % cells.z;
    }
    // A binary search, without a loop like `first_after`, and without branches: SwiftShader's compiler takes minutes
    // and gigabytes for sixteen of them. A grid has at most 65536 rows.
    var rows = rows_before(cells, k, 0u, 32768u);
    rows = rows_before(cells, k, rows, 16384u);
    rows = rows_before(cells, k, rows, 8192u);
    rows = rows_before(cells, k, rows, 4096u);
    rows = rows_before(cells, k, rows, 2048u);
    rows = rows_before(cells, k, rows, 1024u);
    rows = rows_before(cells, k, rows, 512u);
    rows = rows_before(cells, k, rows, 256u);
    rows = rows_before(cells, k, rows, 128u);
    rows = rows_before(cells, k, rows, 64u);
    rows = rows_before(cells, k, rows, 32u);
    rows = rows_before(cells, k, rows, 16u);
    rows = rows_before(cells, k, rows, 8u);
    rows = rows_before(cells, k, rows, 4u);
    rows = rows_before(cells, k, rows, 2u);
    rows = rows_before(cells, k, rows, 1u);
    let left = k - active_in_rows(cells, rows);
    return cell_active[(cells.y + rows) * frame.cell_columns + cells.x] + left;
}

// Index of the first record of the workgroup's group.
var<workgroup> group_first_record: u32;
// Number of pairs of the workgroup's group.
var<workgroup> group_pairs: atomic<u32>;

// Writes a group's records without gaps and counts its pairs. Invocation i of the workgroup passes one record and the
// view position of its splat's centre. Records without pairs are left out. All invocations of the workgroup have to
// call it, with `may_be_there` false if they have no record. Returns the index of the invocation's record, or ABSENT if
// it wasn't written.
fn write_group(group: u32, i: u32, record: Record, center: vec3f, may_be_there: bool) -> u32 {
    if i == 0u {
        atomicStore(&group_pairs, 0u);
    }
    let boxes = vec4u(record.visible_box, record.filtered_box);
    var own_pairs = 0u;
    if may_be_there {
        own_pairs = pairs_of_cells(cells_of(boxes));
    }
    let is_there = own_pairs > 0u;
    let rank = workgroup_scan(i, select(0u, 1u, is_there));
    let live = scan_partial[CELL_WORKGROUP - 1u];
    if is_there {
        atomicAdd(&group_pairs, own_pairs);
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
    if i == 0u {
        cell_groups[group] = atomicLoad(&group_pairs);
        let at = frame.cell_group_count + GROUP_WORDS * group;
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

// Returns the number of blocks, of up to CELL_BLOCK elements, that `count` elements fill.
fn blocks_of(count: u32) -> u32 {
    return (count + (CELL_BLOCK - 1u)) / CELL_BLOCK;
}

// Returns the number of elements to scan in this round, if the tile has this number of pairs.
fn scan_length(pairs: u32) -> u32 {
    if cell_round.scanned == SCANNED_GROUPS {
        return frame.cell_group_count;
    }
    if cell_round.scanned == SCANNED_ACTIVE {
        return frame.cell_count + 1u;
    }
    return cell_round.digits * blocks_of(pairs);
}

// Number of elements that an invocation scans: CELL_BLOCK/CELL_WORKGROUP.
const SCAN_PER_INVOCATION: u32 = 8u;

// First pass of a scan, which replaces each element of `scanned` by the sum of all elements before it. This pass sums
// each block. The second, cell_scan_add, scans each block from the sum of all blocks before it.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_scan_blocks(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    let block = workgroup_number(group);
    let length = scan_length(pair_count());
    if block * CELL_BLOCK >= length {
        return;
    }
    let first = block * CELL_BLOCK + i * SCAN_PER_INVOCATION;
    var sum = 0u;
    for (var k = 0u; k < SCAN_PER_INVOCATION; k++) {
        if first + k < length {
            sum = saturating_sum(sum, scanned[first + k]);
        }
    }
    let before = workgroup_scan(i, sum);
    if i == CELL_WORKGROUP - 1u {
        scan_sums[block] = saturating_sum(before, sum);
    }
}

// Second pass of a scan. A scan of groups also writes the number of pairs of the tile to its counters, and a scan of
// active cells the number of these.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_scan_add(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    let block = workgroup_number(group);
    let part = frame.cell_part;
    let length = scan_length(drawn_pairs(counted()));
    var of_blocks = 0u;
    for (var earlier = i; earlier < min(block, blocks_of(length)); earlier += CELL_WORKGROUP) {
        of_blocks = saturating_sum(of_blocks, scan_sums[earlier]);
    }
    let unused = workgroup_scan(i, of_blocks);
    let before_block = scan_partial[CELL_WORKGROUP - 1u];
    workgroupBarrier();
    let first = block * CELL_BLOCK + i * SCAN_PER_INVOCATION;
    var values: array<u32, SCAN_PER_INVOCATION>;
    var sum = 0u;
    for (var k = 0u; k < SCAN_PER_INVOCATION; k++) {
        if first + k < length {
            values[k] = scanned[first + k];
            sum = saturating_sum(sum, values[k]);
        }
    }
    var before = saturating_sum(before_block, workgroup_scan(i, sum));
    for (var k = 0u; k < SCAN_PER_INVOCATION; k++) {
        if first + k < length {
            scanned[first + k] = before;
            before = saturating_sum(before, values[k]);
        }
    }
    if i == CELL_WORKGROUP - 1u && block + 1u == blocks_of(length) {
        if cell_round.scanned == SCANNED_GROUPS {
            atomicStore(&cell_counters[part].pairs, before);
        }
        if cell_round.scanned == SCANNED_ACTIVE {
            atomicStore(&cell_counters[part].active_cells, before);
        }
    }
}

// Returns the smallest number at which `scan_partial` is greater than k, or the last number.
fn first_after(k: u32) -> u32 {
    // Without a loop, because some software drivers end a shader after 65535 iterations.
    var at = 0u;
    at += select(0u, 128u, scan_partial[at + 127u] <= k);
    at += select(0u, 64u, scan_partial[at + 63u] <= k);
    at += select(0u, 32u, scan_partial[at + 31u] <= k);
    at += select(0u, 16u, scan_partial[at + 15u] <= k);
    at += select(0u, 8u, scan_partial[at + 7u] <= k);
    at += select(0u, 4u, scan_partial[at + 3u] <= k);
    at += select(0u, 2u, scan_partial[at + 1u] <= k);
    at += select(0u, 1u, scan_partial[at] <= k);
    return min(at, CELL_WORKGROUP - 1u);
}

// Writes the pairs of a group, in the order of its records. Each invocation writes every 256th pair, so that the pairs
// of large splats are spread over all invocations.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_emit(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    let number = workgroup_number(group);
    if number >= frame.cell_group_count || pair_count() == 0u {
        return;
    }
    let at = frame.cell_group_count + GROUP_WORDS * number;
    let first = cell_groups[at];
    let live = cell_groups[at + 1u];
    var own = 0u;
    if i < live {
        own = pairs_of_cells(cells_of(cell_records[part_at(8u, first + i)]));
    }
    let unused = workgroup_scan(i, own);
    let count = scan_partial[CELL_WORKGROUP - 1u];
    let to = frame.cell_header + cell_groups[number];
    for (var k = i; k < count; k += CELL_WORKGROUP) {
        // Finds the first record whose pairs end after k.
        let low = first_after(k);
        let record = first + low;
        let cells = cells_of(cell_records[part_at(8u, record)]);
        var before = 0u;
        if low > 0u {
            before = scan_partial[low - 1u];
        }
        pairs_out[to + k] = CellPair(nth_cell(cells, k - before), record);
    }
}

// Returns the digit of a pair's cell by which this round sorts.
fn digit_of(pair: CellPair) -> u32 {
    return (pair.cell >> cell_round.shift) & (cell_round.digits - 1u);
}

// Number of pairs of the block per value of the digit.
var<workgroup> digit_counts: array<atomic<u32>, CELL_WORKGROUP>;

// Counts the pairs of a block per value of the digit.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_count_digits(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    let block = workgroup_number(group);
    let count = pair_count();
    if block * CELL_BLOCK >= count {
        return;
    }
    atomicStore(&digit_counts[i], 0u);
    workgroupBarrier();
    for (var k = 0u; k < CELL_BLOCK; k += CELL_WORKGROUP) {
        let at = block * CELL_BLOCK + k + i;
        if at < count {
            atomicAdd(&digit_counts[digit_of(pairs_in[frame.cell_header + at])], 1u);
        }
    }
    workgroupBarrier();
    if i < cell_round.digits {
        scanned[i * blocks_of(count) + block] = atomicLoad(&digit_counts[i]);
    }
}

// Number of words with one bit for each of 256 pairs.
const ROUND_WORDS: u32 = 8u;

// One bit for each of the 256 pairs that are moved at a time, per value of the digit: word w, for pairs 32·w to 32·w +
// 31, of value v is at w·CELL_WORKGROUP + v.
var<workgroup> round_bits: array<atomic<u32>, 2048>;
// Position, without the header, to which the next pair with each value of the digit moves.
var<workgroup> digit_ends: array<u32, CELL_WORKGROUP>;

// Moves the pairs of a block to their positions in the order of one digit; pairs with equal digits stay in their order.
// The bits of 256 pairs at a time give each pair the number of earlier pairs with the same digit.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_scatter(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    let block = workgroup_number(group);
    let count = pair_count();
    if block * CELL_BLOCK >= count {
        return;
    }
    for (var word = 0u; word < ROUND_WORDS; word++) {
        atomicStore(&round_bits[word * CELL_WORKGROUP + i], 0u);
    }
    if i < cell_round.digits {
        digit_ends[i] = scanned[i * blocks_of(count) + block];
    }
    workgroupBarrier();
    let own_word = i / 32u;
    let own_bit = 1u << (i % 32u);
    for (var k = 0u; k < CELL_BLOCK; k += CELL_WORKGROUP) {
        let at = block * CELL_BLOCK + k + i;
        var pair: CellPair;
        var digit = 0u;
        if at < count {
            pair = pairs_in[frame.cell_header + at];
            digit = digit_of(pair);
            atomicOr(&round_bits[own_word * CELL_WORKGROUP + digit], own_bit);
        }
        workgroupBarrier();
        if at < count {
            var rank = countOneBits(atomicLoad(&round_bits[own_word * CELL_WORKGROUP + digit]) & (own_bit - 1u));
            for (var word = 0u; word < own_word; word++) {
                rank += countOneBits(atomicLoad(&round_bits[word * CELL_WORKGROUP + digit]));
            }
            pairs_out[frame.cell_header + digit_ends[digit] + rank] = pair;
        }
        workgroupBarrier();
        var found = 0u;
        for (var word = 0u; word < ROUND_WORDS; word++) {
            found += countOneBits(atomicExchange(&round_bits[word * CELL_WORKGROUP + i], 0u));
        }
        digit_ends[i] += found;
        workgroupBarrier();
    }
}

// Largest number of pairs of an active cell of samples. Such cells aren't drawn in parts, and the host draws a tile
// with more by raster hardware.
const CROWDED_PAIRS: u32 = 12288u;

// Writes the header of the sorted pairs: the begin and end of the pairs of each cell.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_find_ranges(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    let index = workgroup_number(group) * CELL_WORKGROUP + i;
    let part = frame.cell_part;
    let count = drawn_pairs(counted());
    if index >= count {
        return;
    }
    let at = frame.cell_header + index;
    let cell = pairs_out[at].cell;
    if frame.is_of_samples != 0u && index >= CROWDED_PAIRS && pairs_out[at - CROWDED_PAIRS].cell == cell {
        atomicStore(&cell_counters[part].is_crowded, 1u);
    }
    if index == 0u || pairs_out[at - 1u].cell != cell {
        pairs_out[cell].cell = at;
    }
    if index + 1u == count || pairs_out[at + 1u].cell != cell {
        pairs_out[cell].record = at + 1u;
    }
}

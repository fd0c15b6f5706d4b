// Lists of the compute path: the records that may touch each cell (16×16 pixels), in the order of splats.
//
// Records are sorted in two steps. First by bins, which are squares of 16×16 cells: setup counts the bin pairs of each
// group, which are a record and a bin that it may touch. After a scan, a workgroup moves the pairs of a group to their
// bins. Most splats touch one bin. Second, a workgroup reads a block of up to 256 records of a bin. A pass counts the
// records that may touch each of its cells; after a scan, the next pass appends the records to the lists of the cells.
//
// In both steps the workgroup sets one bit for each record and each bin or cell that the record may touch. So
// everything stays in the order of splats, and no pair of a record and a cell is ever moved: a list stores four bytes
// per pair.

// Returns the number of blocks, of up to CELL_BLOCK elements, that `count` elements fill.
fn blocks_of(count: u32) -> u32 {
    return (count + (CELL_BLOCK - 1u)) / CELL_BLOCK;
}

// Returns the number of blocks of records of all bins.
fn all_bin_blocks() -> u32 {
    return cell_bins[CELL_WORKGROUP].block;
}

// Returns the number of elements to scan in this round, if `pairs` bin pairs are sorted.
fn scan_length(pairs: u32) -> u32 {
    if cell_round.scanned == SCANNED_GROUPS {
        return bin_count() * frame.cell_group_count;
    }
    if cell_round.scanned == SCANNED_ACTIVE {
        return frame.cell_count + 1u;
    }
    return select(0u, CELL_WORKGROUP * all_bin_blocks(), pairs > 0u);
}

// Number of elements that an invocation scans: CELL_BLOCK/CELL_WORKGROUP.
const SCAN_PER_INVOCATION: u32 = 8u;

// First pass of a scan, which replaces each element of `scanned` by the sum of all elements before it. This pass sums
// each block. The second, cell_scan_add, scans each block from the sum of all blocks before it.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_scan_blocks(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    let block = workgroup_number(group);
    let length = scan_length(fitting_bin_pairs(cell_counts[frame.cell_part]));
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

// Second pass of a scan. It also writes the sum of all numbers to the tile's counters: that of bin pairs, of pairs or
// of active cells.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_scan_add(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    let block = workgroup_number(group);
    let part = frame.cell_part;
    let length = scan_length(fitting_bin_pairs(counted()));
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
            atomicStore(&cell_counters[part].bin_pairs, before);
        }
        if cell_round.scanned == SCANNED_LISTS {
            atomicStore(&cell_counters[part].pairs, before);
        }
        if cell_round.scanned == SCANNED_ACTIVE {
            atomicStore(&cell_counters[part].active_cells, before);
        }
    }
}

// Returns the number of bin pairs to sort.
fn bin_pair_count() -> u32 {
    return fitting_bin_pairs(cell_counts[frame.cell_part]);
}

// Returns the number of pairs to draw.
fn pair_count() -> u32 {
    return fitting_pairs(cell_counts[frame.cell_part]);
}

// Number of words with one bit for each of 256 records.
const MARK_WORDS: u32 = 8u;

// One bit for each record of a group or block, and each bin or cell that the record may touch: word w, for records 32·w
// to 32·w + 31, of bin or cell c is at w·CELL_WORKGROUP + c.
var<workgroup> marks: array<atomic<u32>, 2048>;

// Clears `marks`. All invocations of the workgroup have to call it, and then pass a barrier.
fn clear_marks(i: u32) {
    for (var word = 0u; word < MARK_WORDS; word++) {
        atomicStore(&marks[word * CELL_WORKGROUP + i], 0u);
    }
}

// Returns the number of marks of bin or cell c for records before record i.
fn marks_before(c: u32, i: u32) -> u32 {
    let own_word = i / 32u;
    var count = countOneBits(atomicLoad(&marks[own_word * CELL_WORKGROUP + c]) & ((1u << (i % 32u)) - 1u));
    for (var word = 0u; word < own_word; word++) {
        count += countOneBits(atomicLoad(&marks[word * CELL_WORKGROUP + c]));
    }
    return count;
}

// Returns the cells that a record with these cells, as `cells_of` returns them, may touch in a bin (column, row). Bits
// 0 to 15 have four bits each for the first column and row, and the last column and row, relative to the bin.
fn packed_cells(cells: vec4u, bin: vec2u) -> u32 {
    let corner = bin * BIN_SIDE;
    let first = max(cells.xy, corner) - corner;
    let last = min(cells.xy + cells.zw, corner + BIN_SIDE) - corner - 1u;
    return first.x | (first.y << 4u) | (last.x << 8u) | (last.y << 12u);
}

// Moves the bin pairs of a group to their bins.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_sort_bins(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    let number = workgroup_number(group);
    if number >= frame.cell_group_count || bin_pair_count() == 0u {
        return;
    }
    clear_marks(i);
    workgroupBarrier();
    let record = cell_groups[group_at(number)] + i;
    let is_there = i < cell_groups[group_at(number) + 1u];
    var cells = vec4u(0u, 0u, 0u, 0u);
    var bins = vec4u(0u, 0u, 0u, 0u);
    if is_there {
        cells = cells_of(cell_records[part_at(8u, record)]);
        bins = bins_of(cells);
    }
    for (var row = bins.y; row < bins.y + bins.w; row++) {
        for (var column = bins.x; column < bins.x + bins.z; column++) {
            atomicOr(&marks[(i / 32u) * CELL_WORKGROUP + row * bin_columns() + column], 1u << (i % 32u));
        }
    }
    workgroupBarrier();
    for (var row = bins.y; row < bins.y + bins.w; row++) {
        for (var column = bins.x; column < bins.x + bins.z; column++) {
            let bin = row * bin_columns() + column;
            let to = cell_groups[bin * frame.cell_group_count + number] + marks_before(bin, i);
            bin_records_out[to] = packed_cells(cells, vec2u(column, row));
            bin_records_out[frame.cell_bin_pair_room + to] = record;
        }
    }
}

// Writes the bins of a tile: one bin per invocation of a single workgroup.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_find_bins(@builtin(local_invocation_index) i: u32) {
    let count = bin_pair_count();
    var first = 0u;
    var end = 0u;
    if count > 0u && i < bin_count() {
        first = cell_groups[i * frame.cell_group_count];
        end = count;
        if i + 1u < bin_count() {
            end = cell_groups[(i + 1u) * frame.cell_group_count];
        }
    }
    let own = (end - first + (CELL_WORKGROUP - 1u)) / CELL_WORKGROUP;
    let before = workgroup_scan(i, own);
    cell_bins_out[i] = CellBin(first, end, before);
    if i == CELL_WORKGROUP - 1u {
        cell_bins_out[CELL_WORKGROUP] = CellBin(count, count, before + own);
    }
}

// Block of a bin's records.
struct BinBlock {
    // Number of the bin.
    bin: u32,
    // Indices in `bin_records` of the block's first record, and number of its records.
    first: u32,
    count: u32,
    // Index in `scanned` of the number of the first cell of the bin, and number of blocks of the bin. The numbers of
    // later cells follow at distances of `blocks`.
    number_at: u32,
    blocks: u32,
}

// Returns `bin` plus `step` if that bin's blocks begin at or before block `number`, else `bin`.
fn bin_before(number: u32, bin: u32, step: u32) -> u32 {
    return select(bin, bin + step, cell_bins[bin + step].block <= number);
}

// Returns block `number` of those of all bins.
fn bin_block(number: u32) -> BinBlock {
    // Without a loop, because some software drivers end a shader after 65535 iterations. Bins without blocks begin
    // where the next bin begins.
    var bin = bin_before(number, 0u, 128u);
    bin = bin_before(number, bin, 64u);
    bin = bin_before(number, bin, 32u);
    bin = bin_before(number, bin, 16u);
    bin = bin_before(number, bin, 8u);
    bin = bin_before(number, bin, 4u);
    bin = bin_before(number, bin, 2u);
    bin = bin_before(number, bin, 1u);
    let found = cell_bins[bin];
    let blocks = cell_bins[bin + 1u].block - found.block;
    let k = number - found.block;
    let first = found.first + k * CELL_WORKGROUP;
    let count = min(found.end - first, CELL_WORKGROUP);
    return BinBlock(bin, first, count, found.block * CELL_WORKGROUP + k, blocks);
}

// Returns the first column and row of `packed_cells`.
fn first_packed(packed: u32) -> vec2u {
    return vec2u(packed & 15u, (packed >> 4u) & 15u);
}

// Returns the last column and row of `packed_cells`.
fn last_packed(packed: u32) -> vec2u {
    return vec2u((packed >> 8u) & 15u, (packed >> 12u) & 15u);
}

// Largest number of cells of a bin that one invocation marks alone. All invocations together mark the cells of records
// that touch more.
const MARKED_ALONE: u32 = 31u;

// Records of the block that touch many cells of the bin, in no order: the record's number in the block in bits 16 to
// 23, and its `packed_cells`.
var<workgroup> wide_records: array<u32, CELL_WORKGROUP>;
var<workgroup> wide_count: atomic<u32>;

// Marks the cells of a block's records. All invocations of the workgroup have to call it; afterwards invocation i may
// read the marks of cell i.
fn mark_cells(block: BinBlock, i: u32) {
    clear_marks(i);
    if i == 0u {
        atomicStore(&wide_count, 0u);
    }
    workgroupBarrier();
    if i < block.count {
        let packed = bin_records[block.first + i];
        let first = first_packed(packed);
        let end = last_packed(packed) + 1u;
        if (end.x - first.x) * (end.y - first.y) > MARKED_ALONE {
            wide_records[atomicAdd(&wide_count, 1u)] = packed | (i << 16u);
        } else {
            for (var y = first.y; y < end.y; y++) {
                for (var x = first.x; x < end.x; x++) {
                    atomicOr(&marks[(i / 32u) * CELL_WORKGROUP + y * BIN_SIDE + x], 1u << (i % 32u));
                }
            }
        }
    }
    workgroupBarrier();
    let own = vec2u(i % BIN_SIDE, i / BIN_SIDE);
    let wide = atomicLoad(&wide_count);
    for (var k = 0u; k < wide; k++) {
        let packed = wide_records[k];
        if all(first_packed(packed) <= own) && all(own <= last_packed(packed)) {
            let record = packed >> 16u;
            atomicOr(&marks[(record / 32u) * CELL_WORKGROUP + i], 1u << (record % 32u));
        }
    }
}

// True if cell i of a bin has a list: if it is active, in a frame of samples.
fn has_list(bin: u32, i: u32) -> bool {
    if frame.is_of_samples == 0u {
        return true;
    }
    let cell = numbered_cell(bin * CELL_WORKGROUP + i);
    let index = cell.y * frame.cell_columns + cell.x;
    if cell.x >= frame.cell_columns || index >= frame.cell_count {
        return false;
    }
    return cell_active[index] < cell_active[index + 1u];
}

// Counts the records of a block per cell of its bin.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_count_lists(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    let number = workgroup_number(group);
    if number >= all_bin_blocks() {
        return;
    }
    let block = bin_block(number);
    mark_cells(block, i);
    var count = 0u;
    if has_list(block.bin, i) {
        for (var word = 0u; word < MARK_WORDS; word++) {
            count += countOneBits(atomicLoad(&marks[word * CELL_WORKGROUP + i]));
        }
    }
    scanned[block.number_at + i * block.blocks] = count;
}

// Appends the records of a block to the lists of the cells of its bin.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_write_lists(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    let number = workgroup_number(group);
    if number >= all_bin_blocks() || pair_count() == 0u {
        return;
    }
    let block = bin_block(number);
    mark_cells(block, i);
    if !has_list(block.bin, i) {
        return;
    }
    var at = frame.cell_header + scanned[block.number_at + i * block.blocks];
    for (var word = 0u; word < MARK_WORDS; word++) {
        var bits = atomicLoad(&marks[word * CELL_WORKGROUP + i]);
        while bits != 0u {
            let record = block.first + word * 32u + firstTrailingBit(bits);
            cell_lists_out[at] = bin_records[frame.cell_bin_pair_room + record];
            bits &= bits - 1u;
            at++;
        }
    }
}

// Largest number of pairs of an active cell of samples. Such cells aren't drawn in parts, and the host draws a tile
// with more by raster hardware.
const CROWDED_PAIRS: u32 = 12288u;

// Returns an element of `scanned` after a scan of lists, or the number of pairs `count` after the last element.
fn scanned_pair(at: u32, count: u32) -> u32 {
    if at < CELL_WORKGROUP * all_bin_blocks() {
        return scanned[at];
    }
    return count;
}

// Writes the header of the lists: the begin and end of the list of each cell. Each workgroup writes those of a bin.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_find_lists(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    let bin = workgroup_number(group);
    let part = frame.cell_part;
    let count = fitting_pairs(counted());
    if bin >= bin_count() || count == 0u || !has_list(bin, i) {
        return;
    }
    let blocks = cell_bins[bin + 1u].block - cell_bins[bin].block;
    let at = cell_bins[bin].block * CELL_WORKGROUP + i * blocks;
    let first = scanned_pair(at, count);
    let end = scanned_pair(at + blocks, count);
    var number = bin * CELL_WORKGROUP + i;
    if frame.is_of_samples != 0u {
        let cell = numbered_cell(number);
        number = cell_active[cell.y * frame.cell_columns + cell.x];
        if end - first > CROWDED_PAIRS {
            atomicStore(&cell_counters[part].is_crowded, 1u);
        }
    }
    cell_lists_out[2u * number] = frame.cell_header + first;
    cell_lists_out[2u * number + 1u] = frame.cell_header + end;
}
